"""What happens in a run, kind by kind: the lines of a run folder's events.jsonl."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

from bench.record.events._base import BenchTime, Event, Flag, Number, Whole

Sense = Literal["shortest", "positive", "negative"]


@dataclass(frozen=True)
class Step(Event):
    """The test plan's own step begins."""

    code: str
    title: str
    kind: ClassVar[str] = "step"


@dataclass(frozen=True)
class PhaseBegun(Event):
    """A phase begins; it lasts until the next."""

    phase: str
    kind: ClassVar[str] = "phase"


@dataclass(frozen=True)
class Note(Event):
    """A remark for people."""

    text: str = ""
    kind: ClassVar[str] = "note"


@dataclass(frozen=True)
class Prompt(Event):
    """A question is put to the operator."""

    question: str
    kind: ClassVar[str] = "prompt"


@dataclass(frozen=True)
class Answer(Event):
    """The one answer that counts; `act`, `mounting` and `details` say what the question asked to be done."""

    question: str
    answer: str
    by: str
    act: str | None = None
    mounting: str | None = None
    details: dict[str, Any] = field(default_factory=dict)
    kind: ClassVar[str] = "answer"


@dataclass(frozen=True)
class Measured(Event):
    """A measured number; `passed` is None where there are no limits: nothing was judged."""

    name: str
    value: Number | None
    unit: str
    low: Number | None
    high: Number | None
    passed: Flag | None
    kind: ClassVar[str] = "measurement"


@dataclass(frozen=True)
class Requested(Event):
    """Somebody asked for pause, resume or abort."""

    action: str
    by: str
    utc: str
    kind: ClassVar[str] = "request"


@dataclass(frozen=True)
class Paused(Event):
    """The run stands still between two steps, telemetry running."""

    by: str
    kind: ClassVar[str] = "paused"


@dataclass(frozen=True)
class Resumed(Event):
    """The run goes on."""

    by: str
    kind: ClassVar[str] = "resumed"


@dataclass(frozen=True)
class UnitsOff(Event):
    """The units are switched off and on: what they do not send until `units_on` is not lost."""

    kind: ClassVar[str] = "units_off"


@dataclass(frozen=True)
class UnitsOn(Event):
    """The units are on again."""

    kind: ClassVar[str] = "units_on"


@dataclass(frozen=True)
class Alarm(Event):
    """Something is wrong with a device; `code` and `facts` say what, `text` says it to people."""

    device: str
    text: str
    code: str | None = None
    facts: dict[str, Any] | None = None
    kind: ClassVar[str] = "alarm"
    alarming: ClassVar[bool] = True


@dataclass(frozen=True)
class Invalid(Event):
    """The run is invalid for its purpose from here on; `code` and `facts` say why, `text` says it to people."""

    code: str
    text: str
    facts: dict[str, Any]
    kind: ClassVar[str] = "invalid"
    alarming: ClassVar[bool] = True


@dataclass(frozen=True)
class Repeat(Event):
    """An exchange with table or chamber is tried again; `text` has what was received of it."""

    device: str
    text: str
    kind: ClassVar[str] = "repeat"


@dataclass(frozen=True)
class Section(Event):
    """A section of a scale-factor run begins: a rate of a group of rates."""

    group: Whole
    rate_dps: Number
    kind: ClassVar[str] = "section"


@dataclass(frozen=True)
class Interval(Event):
    """An interval of measurement of the standards' test plan ended: from when to when, and under what."""

    test: str
    start_s: BenchTime
    end_s: BenchTime
    cycle: Number | None = None
    step: Number | None = None
    input_dph: Number | None = None
    rate_dps: Number | None = None
    sequence: Number | None = None
    temp_c: Number | None = None
    kind: ClassVar[str] = "interval"


@dataclass(frozen=True)
class Scheme(Event):
    """The scheme of positions that a calibration run turns through, as the table really turns it."""

    name: str
    source: str
    home: str
    moves: str
    dwell_s: Number
    rate_dps: Number
    mounting: str = ""
    kind: ClassVar[str] = "scheme"


@dataclass(frozen=True)
class Position(Event):
    """A position of the scheme is reached, its dwell begins."""

    number: Whole
    kind: ClassVar[str] = "position"


@dataclass(frozen=True)
class Turn(Event):
    """A turn of the scheme begins."""

    number: Whole
    axis: str
    by_deg: Number
    to_deg: Number
    kind: ClassVar[str] = "turn"


@dataclass(frozen=True)
class Outcome(Event):
    """How the run ended; the last line."""

    outcome: str
    reason: str = ""
    kind: ClassVar[str] = "outcome"


@dataclass(frozen=True)
class Demand(Event):
    """Base of what a device is told."""

    device: str


@dataclass(frozen=True)
class AngleDemand(Demand):
    """A table axis is sent to an angle."""

    axis: str
    angle_deg: Number
    sense: Sense = "shortest"
    kind: ClassVar[str] = "demand_angle"

    def __str__(self) -> str:
        return f"{self.angle_deg:.3f} deg"


@dataclass(frozen=True)
class RateDemand(Demand):
    """A table axis is to turn at a rate; 0 brings it to rest. `acceleration_dps2`: None as set before."""

    axis: str
    rate_dps: Number
    acceleration_dps2: Number | None = None
    kind: ClassVar[str] = "demand_rate"

    def __str__(self) -> str:
        return f"{self.rate_dps:g} deg/s" if self.rate_dps else "at rest"


@dataclass(frozen=True)
class HomeDemand(Demand):
    """A table axis is sent to its reference position."""

    axis: str
    kind: ClassVar[str] = "demand_home"

    def __str__(self) -> str:
        return "home"


@dataclass(frozen=True)
class AirDemand(Demand):
    """The chamber's set point; `ramp_k_per_min` None: as fast as it can."""

    set_point_c: Number
    ramp_k_per_min: Number | None = None
    kind: ClassVar[str] = "demand_air"


@dataclass(frozen=True)
class ConditioningDemand(Demand):
    """The chamber is to start or stop conditioning."""

    on: Flag
    kind: ClassVar[str] = "demand_conditioning"


@dataclass(frozen=True)
class NavigationDemand(Demand):
    """A platform is told to end its alignment and navigate."""

    kind: ClassVar[str] = "demand_navigation"
