"""The compensation in real time: temperature in, misalignment out, sample by sample."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.heading._frames import position_error
from bench.analysis.heading._lagged import FAST_TAU_S, LaggedModel
from bench.analysis.heading._second import missing_second
from bench.analysis.heading._temperature import lag_weights
from drivers.base.arrays import Array
from drivers.base.constants import EARTH_RATE_RAD_S
from drivers.base.errors import ConfigurationError, RecordError

HOLD_S = 2.0 * 3600.0
OUTSIDE = 1.5
_LATITUDE_DEG = 3.0


@dataclass(frozen=True, eq=False)
class Compensated:
    """What a block of samples gave: misalignment `phi_as` and drift `drift_dph`, (n, 3); flags (n,).

    `held`: the temperature was missing; `outside`: a regressor beyond 1.5 times its calibrated range.
    """

    phi_as: Array
    drift_dph: Array
    held: NDArray[np.bool_]
    outside: NDArray[np.bool_]


class HeadingCompensator:
    """Runs a fitted model forward. Any chunking of the same samples gives the same numbers.

    Feed it from the alignment on, so that the lag knows the past; the misalignment counts from the first sample.
    The angle must be counted as in the calibration: a clock offset turns the whole correction about the pole.
    """

    def __init__(self, model: LaggedModel, latitude_deg: float | None = None) -> None:
        """Raises ConfigurationError where the model says that temperature is not what drives the drift."""
        if model.evidence.cause in ("heading", "none"):
            raise ConfigurationError(
                "this platform's heading effect is not driven by its temperature",
                found=f"costs {model.evidence.none:.0f} without a cause, {model.evidence.temperature:.0f} "
                f"with temperature, {model.evidence.steps:.0f} with a constant drift of each heading",
                expected="temperature to explain more than constant drifts do",
                remedy="look for friction, magnetic fields or cable forces that change with heading; "
                "compensating with temperature would add error",
            )
        self.model = model
        latitude = model.latitude_deg if latitude_deg is None else latitude_deg
        if abs(latitude - model.latitude_deg) > _LATITUDE_DEG:
            raise ConfigurationError(
                "the coefficients were found at another latitude",
                found=f"{latitude:.2f} deg",
                expected=f"{model.latitude_deg:.2f} deg within {_LATITUDE_DEG:g} deg",
                remedy="calibrate at this latitude: the steady coefficient mixes two causes that "
                "scale differently",
            )
        self.latitude_deg = latitude
        # The part of the drift that gravity rectifies is proportional to cos(latitude).
        scale = math.cos(math.radians(latitude)) / math.cos(math.radians(model.latitude_deg))
        self._gain = model.gain.copy()
        self._gain[:, 1:3] *= scale
        if model.second is not None:
            self._gain[:, -2:] *= scale
        self._time_s = float("nan")
        self._inputs = (0.0, 0.0)
        self._lags = (0.0, 0.0, 0.0)
        self._second = (0.0, 0.0)
        self._second_seen_s = float("-inf")
        self._seen_s = float("-inf")
        self._phi = np.zeros(3)
        self._drift = np.zeros(3)

    def feed(
        self, time_s: Array, sidereal_rad: Array, temp_c: Array, second_c: Array | None = None
    ) -> Compensated:
        """Take samples, arrays of shape (n,), later than all before; NaN temperatures are bridged.

        A missing temperature holds the last change for 2 h; then the change is let go to zero with the
        model's own lag. `second_c` where the model has a second sensor. Raises RecordError for time that goes
        back, or without `second_c` where it is needed.
        """
        count = len(time_s)
        other = np.zeros(count)
        if self.model.second is not None:
            if second_c is None:
                raise missing_second("the compensation")
            other = self.model.second.change(np.asarray(sidereal_rad), temp_c, second_c)
        expected = self.model.reference.at(np.asarray(sidereal_rad))
        phi, drift, terms = (np.empty((count, size)) for size in (3, 3, len(self.model.terms)))
        held = np.asarray(~(np.isfinite(temp_c) & np.isfinite(other)))
        own = len(self.model.terms) - (3 if self.model.second else 0)
        level = self.model.reference.coefficients[0]
        cosine, sine = np.cos(sidereal_rad), np.sin(sidereal_rad)
        for at in range(count):
            now = float(time_s[at])
            change, absolute = self._input(now, float(temp_c[at]), float(expected[at]), float(level))
            further = self._further(now, float(other[at]))
            x, fast, slow = self._advance(now, change, absolute)
            row = (x, x * cosine[at], x * sine[at], fast - x, slow**2 - (slow - x) ** 2)
            terms[at, :own] = row[:own]
            terms[at, own:] = (further, further * cosine[at], further * sine[at])[: terms.shape[1] - own]
            drift[at] = self._gain @ terms[at]
            if self._time_s == self._time_s:
                self._phi = self._phi + 0.5 * (self._drift + drift[at]) * (now - self._time_s)
            self._drift, self._time_s = drift[at].copy(), now
            phi[at] = self._phi
        outside = np.asarray((np.abs(terms) > OUTSIDE * self.model.largest).any(axis=1))
        return Compensated(phi, drift, held, outside)

    def _input(self, now_s: float, temp_c: float, expected_c: float, level_c: float) -> tuple[float, float]:
        if temp_c == temp_c:
            self._seen_s = now_s
            return temp_c - expected_c, temp_c - level_c
        change = self._inputs[0] if now_s - self._seen_s <= HOLD_S else 0.0
        return change, change + expected_c - level_c

    def _further(self, now_s: float, change: float) -> float:
        """Return the lagged change of the second sensor; called before `_advance`, which moves the time."""
        if self.model.second is None:
            return 0.0
        old, x = self._second
        if change == change:
            self._second_seen_s = now_s
        else:
            change = old if now_s - self._second_seen_s <= HOLD_S else 0.0
        if self._time_s != self._time_s:
            x = change
        else:
            a, b, c = lag_weights((now_s - self._time_s) / self.model.second.tau_s)
            x = a * x + b * old + c * change
        self._second = (change, x)
        return x

    def _advance(self, now_s: float, change: float, absolute: float) -> tuple[float, float, float]:
        if self._time_s != self._time_s:
            self._lags = (change, change, absolute)
        else:
            step_s = now_s - self._time_s
            if not step_s > 0.0:
                raise RecordError(
                    "time goes back or stands still in a compensation",
                    found=f"a step of {step_s:g} s",
                    expected="times increasing",
                    remedy="sort the samples, drop those that came twice",
                )
            a, b, c = lag_weights(step_s / self.model.tau_s)
            af, bf, cf = lag_weights(step_s / FAST_TAU_S)
            x, fast, slow = self._lags
            old, old_absolute = self._inputs
            self._lags = (
                a * x + b * old + c * change,
                af * fast + bf * old + cf * change,
                a * slow + b * old_absolute + c * absolute,
            )
        self._inputs = (change, absolute)
        return self._lags


class PositionCorrector:
    """Turns misalignments into corrected position errors; a damped INS shows them `delay_s` late.

    Keeps the misalignments of the last `delay_s`, nothing else.
    """

    def __init__(self, latitude_deg: float, delay_s: float = 0.0) -> None:
        self._latitude_deg, self._delay_s = latitude_deg, delay_s
        self._past: deque[tuple[float, Array]] = deque()

    def correction(self, time_s: Array, sidereal_rad: Array, phi_as: Array) -> tuple[Array, Array]:
        """Return (north, east), arcsec, to subtract from latitude and cos(latitude) longitude; arrays (n,)."""
        times = np.concatenate([[moment for moment, _ in self._past], time_s])
        known = np.concatenate([np.array([phi for _, phi in self._past]).reshape(-1, 3), phi_as])
        shown = np.asarray(time_s) - self._delay_s
        seen = np.stack([np.interp(shown, times, column) for column in known.T], axis=1)
        first_s = times[-1] - self._delay_s if len(times) else 0.0
        keep = max(0, int(np.searchsorted(times, first_s, side="right")) - 1)
        self._past = deque(zip(times[keep:].tolist(), known[keep:], strict=True))
        angle = np.asarray(sidereal_rad) - self._delay_s * EARTH_RATE_RAD_S
        return position_error(seen, angle, self._latitude_deg)
