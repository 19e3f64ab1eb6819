"""Effects on what is beside the gyro's rate: chamber air, temperatures, table, sample times.

A channel is a recorded signal with a small simulator of its own: what the channel should have done, given what
was demanded of it or what acted on it (recorded as well). An effect of a channel is a set of the simulator's
parameters, or a function of another package that changes the simulated signal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._effect import Parameter

Channel = Literal[
    "chamber_air",
    "case_temperature",
    "gyro_temperature",
    "table_angle",
    "table_rate",
    "time_stamps",
    "platform_drift",
]
"""All but the last have a simulator here; a platform's drift shows in its position only."""
CHANNEL_UNITS: Mapping[Channel, str] = {
    "chamber_air": "K",
    "case_temperature": "K",
    "gyro_temperature": "K",
    "table_angle": "arcsec",
    "table_rate": "deg/s",
    "time_stamps": "ms",
}
EmulatedBy = Literal["plant", "sample_clock", "platform", "nothing"]
Values = Mapping[str, tuple[float, ...]]
"""Effect's name to the values of its parameters."""
_PAST_S = 4 * 3600


@dataclass(frozen=True)
class Demand:
    """A target in force from `time_s` on; `ramp_per_s` is the rate asked for (always > 0; inf: at once)."""

    time_s: float
    target: float
    ramp_per_s: float


@dataclass(frozen=True)
class ChannelInputs:
    """What acted on a channel in one run, at equal steps: all (n,) float64, the channel's unit unless said.

    `drive` is what the channel should follow: the air for the case, the case for the gyro, the demand for the
    table; for the air `demands` says it and `drive` is the target. `start` is the channel's own first value.
    `angle_deg` is the table's angle. `period_s` is the step. `heat_w` is the heat that a heater was told to put
    into a case, `door` how far a door or lid of it is open, 0 to 1: means over the steps, (0,) where none is
    recorded.
    """

    time_s: Array
    drive: Array
    start: float
    period_s: float
    demands: tuple[Demand, ...] = ()
    angle_deg: Array = field(default_factory=lambda: np.zeros(0))
    heat_w: Array = field(default_factory=lambda: np.zeros(0))
    door: Array = field(default_factory=lambda: np.zeros(0))


@dataclass(frozen=True)
class ChannelEffect:
    """One way in which a channel can differ: parameters with their `neutral` values, at which it is absent.

    `apply(inputs, signal, values)` returns the changed signal (n,); None for parameters that the channel's own
    simulator has. A third party's effect needs `apply`. `needed` says that the channel has no simulation without
    values for it in the model (a heat capacity has no neutral value). `known` ones are fitted within their
    uncertainty and never called a cause (a mass is weighed). `starts` are values from which a fit begins as well,
    where the signal is far from linear in them, or a function that makes them of the other effects' values.
    `acts(inputs)` says whether what drives the effect is in a recording at all; without it, it always is.
    `emulated_by`: the part of an emulated lab that has the effect, "nothing" if no device of it does; a
    `sample_clock` takes its one value as the clock's error in ppm, a `platform` its values as the drift.
    """

    name: str
    channel: Channel
    parameters: tuple[Parameter, ...]
    neutral: tuple[float, ...]
    follows: str
    source: str
    meaning: str
    apply: Callable[[ChannelInputs, Array, tuple[float, ...]], Array] | None = None
    needed: bool = False
    known: bool = False
    starts: tuple[tuple[float, ...], ...] | Callable[[Values], tuple[tuple[float, ...], ...]] = ()
    acts: Callable[[ChannelInputs], bool] | None = None
    emulated_by: EmulatedBy = "plant"

    def of(self, values: Values) -> tuple[float, ...]:
        """Return the effect's own values, the neutral ones where it has none."""
        return tuple(values.get(self.name, self.neutral))

    def begins(self, values: Values) -> tuple[tuple[float, ...], ...]:
        """Return the values from which a fit begins as well, where the other effects have `values`."""
        return self.starts(values) if callable(self.starts) else self.starts


def applied(
    channel: Channel, inputs: ChannelInputs, signal: Array, values: Values, effects: Iterable[ChannelEffect]
) -> Array:
    """Return a channel's signal, (n,), after every effect of it with an `apply`, in order."""
    for effect in effects:
        if effect.channel == channel and effect.apply is not None and effect.of(values) != effect.neutral:
            signal = effect.apply(inputs, signal, effect.of(values))
    return signal


class AppliedBySecond:
    """A channel's effects with an `apply` as a plant has them: every second, on the last four hours at 1 s.

    A plant knows the past only: what looks ahead in a recording sees the present second as the last one.
    """

    def __init__(self, channel: Channel, values: Values, effects: Iterable[ChannelEffect]) -> None:
        self._channel, self._values = channel, values
        self._effects = [
            effect for effect in effects if effect.channel == channel and effect.apply is not None
        ]
        self._past = np.zeros((3, 2 * _PAST_S))
        self._known, self._time_s = 0, 0.0

    def step(self, drive: float, signal: float, demands: tuple[Demand, ...] = ()) -> float:
        """Return the signal of the next second with the effects; arguments as in `ChannelInputs`."""
        if not self._effects:
            return signal
        if self._known == self._past.shape[1]:
            self._past[:, :_PAST_S] = self._past[:, _PAST_S:]
            self._known = _PAST_S
        self._past[:, self._known] = self._time_s, drive, signal
        self._known += 1
        self._time_s += 1.0
        time_s, drives, signals = self._past[:, max(self._known - _PAST_S, 0) : self._known]
        inputs = ChannelInputs(time_s, drives, float(signals[0]), 1.0, demands)
        return float(applied(self._channel, inputs, signals, self._values, self._effects)[-1])
