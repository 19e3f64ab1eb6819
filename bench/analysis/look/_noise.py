"""Allan deviation at full rate, the five coefficients behind it, and whether they describe it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.analysis.common.allan import AllanDeviation, allan_deviation
from bench.analysis.common.allan_confidence import confidence_interval
from bench.analysis.common.allan_noise import fit_noise
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

_OFF = 1.2
"""Ratio of fit and data that matters to nobody below."""
_LEVEL = 0.999
_WHITE_SLOPE = 0.15
_FLICKER = 0.664
_PER_HOUR = 3600.0


@dataclass(frozen=True, eq=False)
class AllanLook:
    """Allan deviation over averaging time, (k,), in `unit`, with its 95 % interval, and what it shows.

    `coefficients`, (3, 5): Q, N, B, K, R of IEEE Std 952, low and high ends of their 95 % intervals, `unit`
    being deg/h and times being in h; NaN without enough averaging times; `fitted` their curve. `worst_ratio`:
    fit over data, or data over fit, at `worst_tau_s`, where it leaves the data's 99.9 % interval most (1:
    nowhere). `white`: deviation times root of averaging time where the slope is -1/2, as read off, unit
    sqrt(h); `lowest` the lowest deviation over 0.664: what bias instability is at most. NaN where there is
    none.
    """

    unit: str
    tau_s: Array
    deviation: Array
    low: Array
    high: Array
    coefficients: Array
    fitted: Array
    worst_ratio: float
    worst_tau_s: float
    white: float
    lowest: float

    @property
    def fits(self) -> bool:
        """Whether the fit leaves the data's interval by less than a fifth."""
        return self.worst_ratio < _OFF


def allan_of(values: Array, per_s: float, unit: str) -> AllanLook | None:
    """Return the Allan deviation of an unbroken record (n,); None for one of fewer than 32 samples."""
    if len(values) < 32:
        return None
    allan = allan_deviation(values, per_s)
    values, fitted = np.full((3, 5), np.nan), np.full(len(allan.tau_s), np.nan)
    worst, worst_s = np.nan, np.nan
    try:
        fit = fit_noise(allan)
    except (ConfigurationError, np.linalg.LinAlgError):
        pass  # too few averaging times, or a curve without scatter
    else:
        values = np.sqrt([part.squares() for part in (fit.coefficients, fit.low, fit.high)])
        fitted = fit.coefficients.deviation(allan.tau_s)
        low, high = confidence_interval(allan, level=_LEVEL)
        used = (allan.tau_s <= 0.1 * allan.record_s) & ((fitted < low) | (fitted > high))
        off = np.where(used, np.abs(np.log(fitted / allan.deviation)), 0.0)
        worst, worst_s = float(np.exp(off.max())), float(allan.tau_s[np.argmax(off)])
    interval = confidence_interval(allan)
    return AllanLook(
        unit, allan.tau_s, allan.deviation, *interval, values, fitted, worst, worst_s, *_read_off(allan)
    )


def _read_off(allan: AllanDeviation) -> tuple[float, float]:
    """Return white noise and lowest deviation as they are read off the curve, up to a tenth of the record."""
    used = allan.tau_s <= 0.1 * allan.record_s
    tau, deviation = allan.tau_s[used], allan.deviation[used]
    if len(tau) < 3 or not (deviation > 0.0).all():
        return np.nan, np.nan
    slope = np.diff(np.log(deviation)) / np.diff(np.log(tau))
    white = (deviation * np.sqrt(tau / _PER_HOUR))[:-1][np.abs(slope + 0.5) < _WHITE_SLOPE]
    return (float(np.median(white)) if len(white) else np.nan), float(deviation.min()) / _FLICKER
