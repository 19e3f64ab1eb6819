"""What happens in a run, kind by kind: the lines of a run folder's events.jsonl."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import isfinite
from typing import Any, Literal

from bench.record.events._base import BenchTime, Event, Flag, Number, Whole

_MOST_NUMBERS = 2000
Sense = Literal["shortest", "positive", "negative"]
Role = Literal["look", "answer", "run", "configure"]
"""What an operator may do who is signed in at the panel; each role includes those before it."""


class Step(Event, kind="step"):
    """The test plan's own step begins."""

    code: str
    title: str


class PhaseBegun(Event, kind="phase"):
    """A phase begins; it lasts until the next."""

    phase: str


class Note(Event, kind="note"):
    """A remark for people."""

    text: str = ""


class Prompt(Event, kind="prompt"):
    """A question is put to the operator; `picture`: what shows what is meant, a file of the run folder."""

    question: str
    picture: str | None = None


BEFOREHAND = "answered beforehand"
"""Who answers where nobody is asked: then nobody has done anything either."""


class Answer(Event, kind="answer"):
    """The one answer that counts; `act`, `mounting` and `details` say what the question asked to be done.

    `by`: a name, or `BEFOREHAND`. `role`: as which whoever answered was signed in; None for a name that nobody
    has checked.
    """

    question: str
    answer: str
    by: str
    act: str | None = None
    mounting: str | None = None
    details: dict[str, Any] = field(default_factory=dict)
    role: Role | None = None


Source = Literal[
    "air_temperature",
    "air_rate",
    "unit_temperature",
    "gyro_output",
    "axis_azimuth",
    "east_angle",
    "table_angle",
    "table_rate",
    "heading",
]
"""What a measured number was read from: its uncertainty follows from that."""


@dataclass(frozen=True)
class Basis:
    """What a measured number rests on, for its uncertainty budget (JCGM 100).

    `of`: what it was read from. `since_s`: where the stretch of the record begins that it was made of, up to when
    it is written down; None for the phase that is then. `change_k`: of an `air_rate`, how far the air fell
    between the two readings that it is made of, None for the whole fall. `standard_error`: that of the number
    itself, by repeats, in its unit. `inputs`: quantity of the bench's `[[calibration]]` -> how the number is to
    be corrected, in its unit, for each unit that the instrument shows too much.
    """

    of: Source | None = None
    since_s: BenchTime | None = None
    change_k: Number | None = None
    standard_error: Number | None = None
    inputs: dict[str, Number] = field(default_factory=dict)


class Measured(Event, kind="measurement"):
    """A measured number; `passed` is None where there are no limits: nothing was judged.

    `gyro`: the one whose figure it is, None for a figure of the bench or of every unit.
    """

    name: str
    value: Number | None
    unit: str
    low: Number | None
    high: Number | None
    passed: Flag | None
    gyro: str | None = None
    basis: Basis | None = None

    @classmethod
    def against(
        cls,
        name: str,
        value: float,
        unit: str,
        low: float | None,
        high: float | None,
        gyro: str | None = None,
        basis: Basis | None = None,
    ) -> Measured:
        """Return a value judged by its limits, which are inside themselves; NaN is outside of any."""
        inside = (low is None or value >= low) and (high is None or value <= high)
        passed = None if low is None and high is None else inside
        return cls(name, value, unit, low, high, passed, gyro, basis)


def labels(items: Sequence[Measured]) -> list[str]:
    """Return what tells measurements apart: the name, "name of gyro" where several gyros have one of it."""
    gyros: dict[str, set[str | None]] = {}
    for item in items:
        gyros.setdefault(item.name, set()).add(item.gyro)
    several = {name for name, own in gyros.items() if len(own) > 1}
    return [
        f"{item.name} of {item.gyro}" if item.gyro and item.name in several else item.name for item in items
    ]


class Series(Event, kind="series"):
    """Columns of numbers that a procedure worked out: the run's report shows a table, with `plot` curves too.

    `columns`: heading with its unit, as "error [ppm]" -> numbers, None or NaN where one is not known, all of one
    length. The first column is what the others are plotted over. ValueError for columns of different lengths, for
    none, and for more than 2,000 numbers: what is longer is a table of the record.
    """

    title: str
    columns: dict[str, list[Number | None]]
    plot: bool = False

    def __post_init__(self) -> None:
        columns = {str(name): [_known(value) for value in values] for name, values in self.columns.items()}
        lengths = {name: len(values) for name, values in columns.items()}
        if len(set(lengths.values())) != 1 or sum(lengths.values()) > _MOST_NUMBERS:
            raise ValueError(
                f"series {self.title!r}: found {lengths}, expected columns of one length and at most "
                f"{_MOST_NUMBERS} numbers"
            )
        object.__setattr__(self, "columns", columns)


def _known(value: float | None) -> float | None:
    return None if value is None or not isfinite(value) else float(value)


class Requested(Event, kind="request"):
    """Somebody asked for pause, resume or abort; `role` as in an answer."""

    action: str
    by: str
    utc: str
    role: Role | None = None


class Paused(Event, kind="paused"):
    """The run stands still between two steps, telemetry running."""

    by: str


class Resumed(Event, kind="resumed"):
    """The run goes on."""

    by: str


class UnitsOff(Event, kind="units_off"):
    """The units are switched off and on: what they do not send until `units_on` is not lost."""


class UnitsOn(Event, kind="units_on"):
    """The units are on again."""


class Alarm(Event, kind="alarm", alarming=True):
    """Something is wrong with a device; `code` and `facts` say what, `text` says it to people."""

    device: str
    text: str
    code: str | None = None
    facts: dict[str, Any] | None = None


class Invalid(Event, kind="invalid", alarming=True):
    """The run is invalid for its purpose from here on; `code` and `facts` say why, `text` says it to people."""

    code: str
    text: str
    facts: dict[str, Any]


class Repeat(Event, kind="repeat"):
    """An exchange with table or chamber is tried again; `text` has what was received of it."""

    device: str
    text: str


class Section(Event, kind="section"):
    """A section of a scale-factor run begins: a rate of a group of rates."""

    group: Whole
    rate_dps: Number


class Interval(Event, kind="interval"):
    """An interval of measurement of the standards' test plan ended: from when to when, and under what.

    `roll_deg`: how far the unit was turned about its axis under test, against its first mounting.
    """

    test: str
    start_s: BenchTime
    end_s: BenchTime
    cycle: Number | None = None
    step: Number | None = None
    input_dph: Number | None = None
    rate_dps: Number | None = None
    sequence: Number | None = None
    temp_c: Number | None = None
    roll_deg: Number | None = None


class Scheme(Event, kind="scheme"):
    """The scheme of positions that a calibration run turns through, as the table really turns it."""

    name: str
    source: str
    home: str
    moves: str
    dwell_s: Number
    rate_dps: Number
    mounting: str = ""


class Position(Event, kind="position"):
    """A position of the scheme is reached, its dwell begins."""

    number: Whole


class Turn(Event, kind="turn"):
    """A turn of the scheme begins."""

    number: Whole
    axis: str
    by_deg: Number
    to_deg: Number


class Outcome(Event, kind="outcome"):
    """How the run ended; the last line. `sealed`: its manifest was sealed with a checksum of its own."""

    outcome: str
    reason: str = ""
    sealed: Flag | None = None


class Demand(Event):
    """Base of what a device is told."""

    device: str


class AngleDemand(Demand, kind="demand_angle"):
    """A table axis is sent to an angle."""

    axis: str
    angle_deg: Number
    sense: Sense = "shortest"

    def __str__(self) -> str:
        return f"{self.angle_deg:.3f} deg"


class RateDemand(Demand, kind="demand_rate"):
    """A table axis is to turn at a rate; 0 brings it to rest. `acceleration_dps2`: None as set before."""

    axis: str
    rate_dps: Number
    acceleration_dps2: Number | None = None

    def __str__(self) -> str:
        return f"{self.rate_dps:g} deg/s" if self.rate_dps else "at rest"


class HomeDemand(Demand, kind="demand_home"):
    """A table axis is sent to its reference position."""

    axis: str

    def __str__(self) -> str:
        return "home"


class AirDemand(Demand, kind="demand_air"):
    """The chamber's set point; `ramp_k_per_min` None: as fast as it can."""

    set_point_c: Number
    ramp_k_per_min: Number | None = None


class ConditioningDemand(Demand, kind="demand_conditioning"):
    """The chamber is to start or stop conditioning."""

    on: Flag


class PowerDemand(Demand, kind="demand_power"):
    """An output of a supply is switched on or off; `units`: those that it feeds."""

    output: Whole
    on: Flag
    units: list[str] = field(default_factory=list)


class NavigationDemand(Demand, kind="demand_navigation"):
    """A platform is told to end its alignment and navigate."""
