"""The platform's temperature against its course at the reference heading, and its lagged core temperature."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import SIDEREAL_DAY_S
from drivers.base.errors import RecordError

HARMONICS = 8
_FULL_TURN = 0.98
_LEAST_SAMPLES = 3 * (2 * HARMONICS + 1)


@dataclass(frozen=True, eq=False)
class ReferenceTemperature:
    """T_ref over the sidereal angle at the reference heading: mean, then cos and sin of each harmonic, degC.

    `residual_k`: rms of what the harmonics leave; `closure_k`: by how much the temperature had changed after
    the full turn, 0 in equilibrium.
    """

    coefficients: Array
    residual_k: float
    closure_k: float

    def at(self, angle_rad: Array) -> Array:
        """Return T_ref in degC, shape of `angle_rad`."""
        return np.asarray(
            harmonics(np.asarray(angle_rad), (len(self.coefficients) - 1) // 2) @ self.coefficients
        )


def harmonics(angle_rad: Array, number: int) -> Array:
    """Return [1, cos, sin, cos 2, sin 2, ...] of angles of any shape, on a new last axis."""
    orders = angle_rad[..., None] * np.arange(1, number + 1)
    both = np.stack([np.cos(orders), np.sin(orders)], axis=-1).reshape(*angle_rad.shape, 2 * number)
    return np.concatenate([np.ones((*angle_rad.shape, 1)), both], axis=-1)


def fit_reference(angle_rad: Array, temp_c: Array, number: int = HARMONICS) -> ReferenceTemperature:
    """Fit T_ref to the last full turn of the sidereal angle in the samples, shape (n,), NaN where missing.

    Folded on the sidereal angle, not on the clock: a solar day would cost 0.005 K a day of a 0.3 K swing.
    Raises RecordError when the samples do not cover a full turn.
    """
    good = np.isfinite(temp_c)
    inside = good & (angle_rad > angle_rad[-1] - 2.0 * np.pi)
    turn, temperature = angle_rad[inside], temp_c[inside]
    span = float(turn[-1] - turn[0]) / (2.0 * np.pi) if len(turn) else 0.0
    widest = float(np.diff(turn).max()) if len(turn) > 1 else np.inf
    if span < _FULL_TURN or len(turn) < _LEAST_SAMPLES or widest > np.pi / number:
        raise RecordError(
            "no full sidereal day of temperature at the reference heading",
            found=f"{span * SIDEREAL_DAY_S / 3600.0:.1f} h, {len(turn)} samples, longest gap "
            f"{widest / (2.0 * np.pi) * SIDEREAL_DAY_S / 3600.0:.1f} h",
            expected=f"{SIDEREAL_DAY_S / 3600.0:.1f} h without a gap, at least {_LEAST_SAMPLES} samples",
            remedy="stay longer at the reference heading before the first turn",
        )
    rows = harmonics(turn, number)
    # A slow trend (warm-up, room) would be folded into a step at the ends: it is fitted beside and left out.
    trend = (turn - turn.mean()) / (2.0 * np.pi)
    solution = np.linalg.lstsq(np.column_stack([rows, trend]), temperature, rcond=None)[0]
    coefficients = solution[:-1].copy()
    coefficients[0] += 0.5 * solution[-1]
    left = temperature - rows @ solution[:-1] - trend * solution[-1]
    return ReferenceTemperature(coefficients, float(np.sqrt(np.mean(left**2))), float(solution[-1]))


def fourier_terms(angle_rad: Array, change_k: Array) -> Array:
    """Return (b0, ac, as), K, of dT = b0 + ac cos + as sin over the last sidereal day at each sample, (n, 3).

    Uniform samples; NaN until a full day has passed. A missing sample (NaN) is left out.
    """
    good = np.isfinite(change_k)
    rows = harmonics(angle_rad, 1) * good[:, None]
    products = rows[:, :, None] * rows[:, None, :]
    values = rows * np.where(good, change_k, 0.0)[:, None]
    begin = np.searchsorted(angle_rad, angle_rad - 2.0 * np.pi + 1e-9, side="left")
    ends = np.arange(1, len(angle_rad) + 1)
    full = angle_rad - angle_rad[0] >= 2.0 * np.pi * _FULL_TURN
    terms = np.full((len(angle_rad), 3), np.nan)
    if full.any():
        normal = _between(products, begin[full], ends[full])
        right = _between(values, begin[full], ends[full])
        enough = np.linalg.cond(normal) < 1e3
        at = np.flatnonzero(full)[enough]
        terms[at] = np.linalg.solve(normal[enough], right[enough][..., None])[..., 0]
    return terms


def lagged(value: Array, ratio: float) -> Array:
    """Return a first-order lag of uniform samples (n,); `ratio` = step / time constant.

    Exact for an input that is linear between samples; starts settled on the first sample.
    """
    from scipy.signal import lfilter  # slow to import

    decay, before, now = lag_weights(ratio)
    state = before * value[:1] + decay * value[:1]
    return np.concatenate([value[:1], lfilter([now, before], [1.0, -decay], value[1:], zi=state)[0]])


@lru_cache(maxsize=64)
def lag_weights(ratio: float) -> tuple[float, float, float]:
    """Return (a, b, c) of y' = a y + b u + c u', a first-order lag over `ratio` time constants, u linear."""
    decay = float(np.exp(-ratio))
    mean = -float(np.expm1(-ratio)) / ratio if ratio > 0.0 else 1.0
    return decay, mean - decay, 1.0 - mean


def _between(values: Array, begin: Array, end: Array) -> Array:
    total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    return np.asarray(total[end] - total[begin])
