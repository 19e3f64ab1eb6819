"""A compensation on a live stream: features second by second, the model every step, the corrected rate.

Everything a flight computer would have to do, written so that the exported C does the same: ring buffers of
fixed size, no look ahead. What `prepare` does to a recorded run, this does to a stream, to rounding.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntFlag

import numpy as np
from numpy.typing import NDArray

from bench.analysis.thermal._features import CHANGE_S, WINDOW_S
from bench.analysis.thermal._types import Stepper
from drivers.base.arrays import Array

LONGEST_GAP_S = 600
"""A longer silence restarts the stream: what the model remembers is no longer the state of the unit."""


class Flag(IntFlag):
    """What is doubtful about a sample; 0 is none of it."""

    OUT_OF_RANGE = 1  # an input outside the training runs' range: the model extrapolates
    MISSING = 2  # a temperature or the rate is not a number; the inputs hold their last value
    LATE = 4  # seconds are missing before this sample, or its time is not after the last one's
    EARLY = 8  # earlier after power-on than any sample that was trained
    CLAMPED = 16  # the correction was cut to its limits
    RESTARTED = 32  # the model was started afresh with this sample
    NO_DRIFT = 64  # no temperature has been seen yet: nothing is corrected


FEATURES = ("t_in", "t_out", "dt_60", "gradient")
Interval = tuple[float, float]
Features = tuple[float, float, float, float]


@dataclass(frozen=True)
class Limits:
    """What a correction may be trusted with.

    `inputs`: valid interval of t_in, t_out, gradient (degC) and dt_60 (degC/min), by name. `bias_dph`,
    `sf_error_ppm`: intervals the outputs are cut to. `trained_from_s`: first time after power-on that was
    trained.
    """

    inputs: Mapping[str, Interval]
    bias_dph: Interval
    sf_error_ppm: Interval
    trained_from_s: float

    def flags(self, features: Array) -> NDArray[np.uint8]:
        """Return OUT_OF_RANGE where one of the `FEATURES` leaves its interval, (..., 4) -> (...)."""
        low, high = np.array([self.inputs[name] for name in FEATURES]).T
        inside = np.all((features >= low) & (features <= high), axis=-1)
        return np.where(inside, 0, int(Flag.OUT_OF_RANGE)).astype(np.uint8)

    def clamp(self, drift: Array) -> tuple[Array, NDArray[np.uint8]]:
        """Cut (..., 2) outputs to their intervals; the flag is CLAMPED where that changed one."""
        low, high = np.array([self.bias_dph, self.sf_error_ppm]).T
        cut = np.clip(drift, low, high)
        return cut, np.where((cut == drift).all(axis=-1), 0, int(Flag.CLAMPED)).astype(np.uint8)


@dataclass(frozen=True)
class CorrectedSample:
    """One second: the corrected rate (deg/s), the drift taken off it (deg/h, ppm) and what is doubtful.

    `bias_half_dph`, `sf_half_ppm`: half widths of the 95 % interval of the drift as means of 100 s would show it;
    NaN before there is a drift, and for a compensation without them.
    """

    time_s: float
    rate_dps: float
    bias_dph: float
    sf_error_ppm: float
    flags: Flag
    bias_half_dph: float = math.nan
    sf_half_ppm: float = math.nan


class FeatureStream:
    """The features of `prepare`, from temperatures that arrive second by second; NaN is a missing second."""

    def __init__(self, step_s: int) -> None:
        self._step_s = step_s
        self._count = 0
        self._whole = WINDOW_S + CHANGE_S
        self._inside: deque[float] = deque(maxlen=WINDOW_S + CHANGE_S)
        self._case: deque[float] = deque(maxlen=WINDOW_S)
        self._held: Features = (math.nan, math.nan, math.nan, math.nan)

    def push(self, gyro_temp_c: float, case_temp_c: float) -> Features | None:
        """Take one second; return (t_in, t_out, dt_60, gradient) on every step's first second, else None.

        The first second must have both temperatures.
        """
        if self._count == 0:
            # The unit is taken to have been at its first temperature before the stream began.
            self._inside.extend([gyro_temp_c] * (WINDOW_S + CHANGE_S))
        self._inside.append(gyro_temp_c)
        self._case.append(case_temp_c)
        self._count += 1
        self._whole = self._whole + 1 if math.isfinite(gyro_temp_c + case_temp_c) else 0
        on_step = (self._count - 1) % self._step_s == 0
        # A mean that runs empty holds its last value, which may fall between two steps.
        if on_step or self._whole < WINDOW_S + CHANGE_S:
            self._held = self._means()
        return self._held if on_step else None

    def _means(self) -> Features:
        number = min(self._count, WINDOW_S)
        inside, case = list(self._inside), list(self._case)
        change = [inside[-k] - inside[-k - CHANGE_S] for k in range(1, number + 1)]
        t_in = _mean(inside[-number:], self._held[0])
        t_out = _mean(case, self._held[1])
        return t_in, t_out, _mean(change, self._held[2]), t_in - t_out


def _mean(values: list[float], otherwise: float) -> float:
    finite = [value for value in values if math.isfinite(value)]
    return math.fsum(finite) / len(finite) if finite else otherwise


class CompensationStream:
    """Corrects a gyro's rate while it is measured; made by `Compensation.stream`.

    Time is seconds since power-on; one sample a second is expected. Between the model's steps its last drift
    holds.
    """

    def __init__(
        self,
        new_stepper: Callable[[], Stepper],
        step_s: int,
        limits: Limits,
        k_ref: float,
        half_widths: Callable[[Array], Array] = lambda features: np.full(2, np.nan),
    ) -> None:
        self._half_widths, self._half = half_widths, (math.nan, math.nan)
        self._new_stepper, self._step_s, self._limits, self._k_ref = new_stepper, step_s, limits, k_ref
        self._running: tuple[FeatureStream, Stepper] | None = None
        self._last_s = -math.inf
        self._drift = (0.0, 0.0)
        self._model_flags = Flag.NO_DRIFT

    def push(self, time_s: float, gyro_temp_c: float, case_temp_c: float, rate: float) -> CorrectedSample:
        """Take one second: temperatures in degC, the gyro's output in k_ref units per deg/s (NaN = missing).

        A sample that is not after the last one is corrected with the drift at hand and changes nothing.
        """
        flags = Flag(0)
        if time_s < self._limits.trained_from_s:
            flags |= Flag.EARLY
        temperatures = math.isfinite(gyro_temp_c) and math.isfinite(case_temp_c)
        if not (temperatures and math.isfinite(rate)):
            flags |= Flag.MISSING
        gap = 0 if self._running is None else max(-1, round(time_s - self._last_s) - 1)
        if gap != 0:
            flags |= Flag.LATE
        if self._running is None or gap > LONGEST_GAP_S:
            self._running, self._drift, self._model_flags = None, (0.0, 0.0), Flag.NO_DRIFT
            self._half = (math.nan, math.nan)
            if temperatures:
                self._running, gap = (FeatureStream(self._step_s), self._new_stepper()), 0
                flags |= Flag.RESTARTED
        if self._running is not None and gap >= 0:
            self._last_s = time_s
            for _ in range(gap):
                self._second(*self._running, math.nan, math.nan)
            self._second(*self._running, gyro_temp_c, case_temp_c)
        bias_dph, sf_error_ppm = self._drift
        corrected = (rate / self._k_ref - bias_dph / 3600.0) / (1.0 + sf_error_ppm * 1e-6)
        return CorrectedSample(
            time_s, corrected, bias_dph, sf_error_ppm, flags | self._model_flags, *self._half
        )

    def _second(
        self, features: FeatureStream, stepper: Stepper, gyro_temp_c: float, case_temp_c: float
    ) -> None:
        inputs = features.push(gyro_temp_c, case_temp_c)
        if inputs is None:
            return
        drift, clamped = self._limits.clamp(np.array(stepper.step(*inputs)))
        self._drift = (float(drift[0]), float(drift[1]))
        bias_half_dph, sf_half_ppm = self._half_widths(np.array(inputs)).tolist()
        self._half = (bias_half_dph, sf_half_ppm)
        self._model_flags = Flag(int(clamped | self._limits.flags(np.array(inputs))))
