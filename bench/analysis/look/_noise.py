"""Allan deviation at full rate, the five coefficients behind it, and whether they describe it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.analysis.common.allan import AllanDeviation, allan_deviation
from bench.analysis.common.allan_confidence import confidence_interval
from bench.analysis.common.allan_noise import NOISE_NAMES, NoiseCoefficients, fit_noise
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
    """Allan deviation over averaging time, (k,), in `unit`, with its 95 % interval; `fitted`: that of the fit.

    `coefficients`, `low`, `high`: Q, N, B, K, R of IEEE Std 952 and their 95 % intervals, `unit` being deg/h and
    times being in h; None without enough averaging times. `worst_ratio`: fit over data, or data over fit, at
    `worst_tau_s`, where it leaves the data's 99.9 % interval most (1: nowhere). `fits`: whether that is less than
    a fifth. `white`: deviation times root of averaging time where the slope is -1/2, as read off, unit sqrt(h);
    `lowest` the lowest deviation over 0.664: what bias instability is at most. NaN where there is none.
    """

    unit: str
    tau_s: Array
    deviation: Array
    low: Array
    high: Array
    fitted: Array
    coefficients: tuple[float, ...]
    coefficient_low: tuple[float, ...]
    coefficient_high: tuple[float, ...]
    worst_ratio: float
    worst_tau_s: float
    fits: bool
    white: float
    lowest: float


def allan_of(values: Array, per_s: float, unit: str) -> AllanLook | None:
    """Return the Allan deviation of an unbroken record (n,); None for one of fewer than 32 samples."""
    if len(values) < 32:
        return None
    allan = allan_deviation(values, per_s)
    low, high = confidence_interval(allan)
    white, lowest = _read_off(allan)
    measured = (unit, allan.tau_s, allan.deviation, low, high)
    try:
        fit = fit_noise(allan)
    except (ConfigurationError, np.linalg.LinAlgError):
        nothing = (np.nan,) * len(NOISE_NAMES)
        fitted = np.full(len(low), np.nan)
        return AllanLook(*measured, fitted, nothing, nothing, nothing, np.nan, np.nan, False, white, lowest)
    fitted = fit.coefficients.deviation(allan.tau_s)
    ratio, tau_s = _misfit(allan, fitted)
    values_of, low_of, high_of = (_values(part) for part in (fit.coefficients, fit.low, fit.high))
    return AllanLook(*measured, fitted, values_of, low_of, high_of, ratio, tau_s, ratio < _OFF, white, lowest)


def _values(coefficients: NoiseCoefficients) -> tuple[float, ...]:
    return tuple(float(getattr(coefficients, name)) for name in NOISE_NAMES)


def _misfit(allan: AllanDeviation, fitted: Array) -> tuple[float, float]:
    """Return the largest ratio between fit and data beyond the data's scatter, and its averaging time."""
    used = allan.tau_s <= 0.1 * allan.record_s
    low, high = confidence_interval(allan, level=_LEVEL)
    off = np.where(used & ((fitted < low) | (fitted > high)), np.abs(np.log(fitted / allan.deviation)), 0.0)
    worst = int(np.argmax(off))
    return float(np.exp(off[worst])), float(allan.tau_s[worst])


def _read_off(allan: AllanDeviation) -> tuple[float, float]:
    """Return white noise and lowest deviation as they are read off the curve, up to a tenth of the record."""
    used = allan.tau_s <= 0.1 * allan.record_s
    tau, deviation = allan.tau_s[used], allan.deviation[used]
    if len(tau) < 3 or not (deviation > 0.0).all():
        return np.nan, np.nan
    slope = np.diff(np.log(deviation)) / np.diff(np.log(tau))
    white = np.flatnonzero(np.abs(slope + 0.5) < _WHITE_SLOPE)
    level = deviation * np.sqrt(tau / _PER_HOUR)
    return (float(np.median(level[white])) if len(white) else np.nan), float(deviation.min()) / _FLICKER
