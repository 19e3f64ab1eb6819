"""What a formula sees in a plant, in the place of a `Stimulus`: one second at a time, or rates without a history.

A diagnosis sees a whole run and smooths over a minute about each sample; a plant knows the past only. Its
temperatures are free of noise, so it takes backward differences and does not smooth. In a recording, changes come
up to half a minute later and are rounded off; for lags of minutes this is below a few per cent.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import NoReturn, cast

import numpy as np

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects._stimulus import REFERENCE_C, Stimulus, gain


class _InPlaceOfStimulus:
    @property
    def in_place_of_stimulus(self) -> Stimulus:
        """This, for a formula: it has what the formula's effect says that it follows."""
        return cast(Stimulus, self)

    def __getattr__(self, name: str) -> NoReturn:
        raise ConfigurationError(
            "an effect's formula asks for more than its inputs say",
            where="simulators.effects",
            found=name,
            expected="inputs that name everything that the formula follows",
        )


class Tick(_InPlaceOfStimulus):
    """One second of a plant, at steps of 1 s: numbers, and the memory that `lagged` and `slack` need.

    A formula calls these two in the same order at every tick: the number of a call says whose memory it is.
    """

    def __init__(self) -> None:
        self.time_s = -1.0
        self.warm_k = self.case_warm_k = self.gradient_k = math.nan
        self.warming_k_per_min = self.gradient_rate_k_per_min = 0.0
        self._memory: list[float] = []
        self._calls = 0

    def move(self, t_in_c: float, t_out_c: float) -> None:
        """Go on to the next second, counted from power-on."""
        warm_k, gradient_k = t_in_c - REFERENCE_C, t_in_c - t_out_c
        if self.time_s >= 0.0:
            self.warming_k_per_min = 60.0 * (warm_k - self.warm_k)
            self.gradient_rate_k_per_min = 60.0 * (gradient_k - self.gradient_k)
        self.time_s += 1.0
        self.warm_k, self.case_warm_k, self.gradient_k = warm_k, t_out_c - REFERENCE_C, gradient_k
        self._calls = 0

    def lagged(self, value: float, lag_s: float) -> float:
        """Return a first-order follower, settled at its first value; the value itself for lag 0."""
        before = self._before(value)
        return self._keep(before + gain(lag_s) * (value - before))

    def slack(self, value: float, half_width: float) -> float:
        """Return by how much a play operator is off its input: it moves only when pushed."""
        before = self._before(value)
        return self._keep(min(max(before, value - half_width), value + half_width)) - value

    def slacks(self, value: float, half_widths: Sequence[float], curve: Callable[[float], float]) -> float:
        """Return by how much the mean of a curve of some plays is off the curve of their input."""
        plays = [value + self.slack(value, half) for half in half_widths]
        return sum(curve(each) for each in plays) / len(plays) - curve(value)

    def _before(self, first: float) -> float:
        if self._calls == len(self._memory):
            self._memory.append(first)
        return self._memory[self._calls]

    def _keep(self, value: float) -> float:
        self._memory[self._calls] = value
        self._calls += 1
        return value


class AtRate(_InPlaceOfStimulus):
    """Samples of which a formula follows the input rate alone."""

    def __init__(self, rate_dph: Array) -> None:
        self.input_rate_dph = rate_dph
        self.mean_speed_dph = np.abs(rate_dph)
        self.axis_rate_dps = rate_dph / 3600.0

    def __len__(self) -> int:
        return len(self.input_rate_dph)
