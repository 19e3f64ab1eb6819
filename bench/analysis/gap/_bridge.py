"""Missing samples: bridged by what their surroundings say, and what that does to noise.

A bridge is the best linear prediction under the gyro's noise (ordinary kriging; Cressie, Statistics for Spatial
Data, 1993, section 3.2) from means over ever longer stretches on both sides. Data and every column are bridged
alike, so a true model stays true. A line between the two samples next to a gap would spread their noise over it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct

from bench.analysis.gap._noise import FLICKER_TIMES_S, Noise, power_of
from drivers.base.arrays import Array

_STRETCHES = np.concatenate(([0], 2 ** np.arange(13)))
"""Samples from a gap's edge to the borders of the stretches that are averaged."""
_EMPTY = 1e9
"""Variance of a stretch without samples, in units of a sample's."""
_DRAWS = 64
_KEPT = 6
"""Lengths of runs and noises whose draws are kept."""
_BINS_AN_OCTAVE = 4


@dataclass(frozen=True)
class Bridge:
    """How the gaps of one run are filled: for three points of each the weights of the stretches around it.

    `starts`, `stops` (g,) are the gaps' samples, `low`, `high` (g, 2k) the stretches', `counts` (g, 2k) the
    samples they hold, `weights` (g, 3, 2k) sum to one.
    """

    missing: NDArray[np.bool_]
    starts: NDArray[np.int64]
    stops: NDArray[np.int64]
    low: NDArray[np.int64]
    high: NDArray[np.int64]
    counts: NDArray[np.int64]
    weights: Array

    @cached_property
    def _between(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Borders of all stretches in order, and which of them are those of each stretch, (g, 2k)."""
        borders, inverse = np.unique(np.stack((self.low, self.high)), return_inverse=True)
        low, high = inverse.reshape(2, *self.low.shape)
        return borders, low, high

    @cached_property
    def _filled(self) -> tuple[NDArray[np.int64], NDArray[np.int64], tuple[Array, Array, Array]]:
        """Samples that are filled, the gap of each, and its weights of the gap's three points."""
        at = np.flatnonzero(self.missing)
        gap = np.searchsorted(self.stops, at, side="right")
        # from -1 at the first sample of a gap over 0 in its middle to 1 at its last
        along = (2.0 * at - self.starts[gap] - self.stops[gap] + 1.0) / np.maximum(
            self.stops[gap] - self.starts[gap] - 1.0, 1.0
        )
        return at, gap, (np.maximum(-along, 0.0), 1.0 - np.abs(along), np.maximum(along, 0.0))

    def over(self, values: NDArray[Any]) -> NDArray[Any]:
        """Return rows (p, n) with the missing samples filled."""
        if not len(self.starts):
            return values
        result = values.copy()
        result[:, self.missing] = 0.0
        # sums between borders of stretches, not over every sample
        borders, low, high = self._between
        sums = np.zeros((len(values), len(borders)))
        inside = np.add.reduceat(result[:, : borders[-1]], borders[:-1], axis=1)
        np.cumsum(inside, axis=1, out=sums[:, 1:])
        means = (sums[:, high] - sums[:, low]) / np.maximum(self.counts, 1)
        points = np.matmul(means.transpose(1, 0, 2), self.weights.transpose(0, 2, 1)).transpose(1, 0, 2)
        at, gap, (first, middle, last) = self._filled
        result[:, at] = points[:, gap, 0] * first + points[:, gap, 1] * middle + points[:, gap, 2] * last
        return result


def bridge(missing: NDArray[np.bool_], period_s: float, noise: Noise) -> Bridge:
    """Return how to fill the `missing` samples (n,) of a run under its noise."""
    return _bridge(missing.tobytes(), len(missing), period_s, noise)


def noise_left(missing: NDArray[np.bool_], period_s: float, filled_for: Noise, noise: Noise) -> Array:
    """Return the power of bridged noise over that of noise without gaps, by DCT coefficient 1 .. n-1, (n - 1,).

    Found by simulation of 64 runs (fixed draws), smoothed to four bins an octave. Fast coefficients lack the
    samples that are missing; slow ones are known from fewer samples, and their power is higher.
    """
    return _noise_left(missing.tobytes(), len(missing), period_s, filled_for, noise)


@lru_cache(maxsize=256)
def _bridge(mask: bytes, n: int, period_s: float, noise: Noise) -> Bridge:
    missing = np.frombuffer(mask, dtype=np.bool_)
    change = np.diff(np.concatenate(([False], missing, [False])).astype(np.int8))
    starts, stops = np.flatnonzero(change == 1), np.flatnonzero(change == -1)
    before = starts[:, None] - _STRETCHES
    after = stops[:, None] + _STRETCHES
    low = np.clip(np.concatenate((before[:, 1:], after[:, :-1]), axis=1), 0, n)
    high = np.clip(np.concatenate((before[:, :-1], after[:, 1:]), axis=1), 0, n)
    known = np.concatenate(([0], np.cumsum(~missing)))
    moments = np.concatenate(([0.0], np.cumsum(np.where(missing, 0.0, np.arange(n)))))
    counts = known[high] - known[low]
    centres = (moments[high] - moments[low]) / np.maximum(counts, 1)
    targets = np.stack((starts, 0.5 * (starts + stops - 1), stops - 1.0), axis=1)
    weights = _weights(centres, counts, targets, period_s, noise)
    return Bridge(missing, starts, stops, low, high, counts, weights)


def _weights(
    centres: Array, counts: NDArray[np.int64], targets: Array, period_s: float, noise: Noise
) -> Array:
    """Return weights of the stretches (g, j, k) for the targets (g, j), ordinary kriging."""
    g, k = centres.shape
    white = noise.arw_deg_per_sqrt_h**2 * 3600.0 / period_s
    white += noise.quantum_arcsec**2 / 6.0 / period_s**2
    alone = np.where(counts > 0, white / np.maximum(counts, 1), _EMPTY * white)
    system = np.ones((g, k + 1, k + 1))
    system[:, :k, :k] = -_variogram(np.abs(centres[:, :, None] - centres[:, None, :]) * period_s, noise)
    system[:, np.arange(k), np.arange(k)] += alone
    system[:, k, k] = 0.0
    aims = np.ones((g, k + 1, targets.shape[1]))
    aims[:, :k] = -_variogram(np.abs(centres[:, :, None] - targets[:, None, :]) * period_s, noise)
    scale = white  # both sides in units of a sample's variance, for the solver
    system[:, :k, :k] /= scale
    aims[:, :k] /= scale
    weights = np.linalg.solve(system, aims)[:, :k] * (counts > 0)[:, :, None]
    return np.asarray(np.swapaxes(weights / weights.sum(axis=1, keepdims=True), 1, 2))


def _variogram(lag_s: Array, noise: Noise) -> Array:
    """Return half the variance of the change of the slow noise over a time, (deg/h)^2."""
    flicker = noise.bias_instability_dph**2 * math.log(3.0) / math.pi
    markov = (1.0 - np.exp(-lag_s[..., None] / FLICKER_TIMES_S)).sum(axis=-1)
    return np.asarray(flicker * markov + 0.5 * noise.rate_random_walk_dph_per_sqrt_h**2 * lag_s / 3600.0)


@lru_cache(maxsize=_KEPT)
def _drawn(n: int, period_s: float, noise: Noise) -> tuple[NDArray[Any], NDArray[np.int64], Array]:
    """Return runs of noise from fixed draws (64, n), and their energy over its power by bin of coefficients.

    The bin of each coefficient from 1 on, (n - 1,), is between them. Runs of one length share them; single
    precision is a thousandth of what so few draws tell.
    """
    unit = np.random.default_rng(0).standard_normal((_DRAWS, n - 1)).astype(np.float32)
    drawn = np.zeros((_DRAWS, n), dtype=np.float32)
    np.multiply(unit, np.sqrt(power_of(noise, n, period_s)), out=drawn[:, 1:], casting="same_kind")
    _, bins = np.unique(np.floor(_BINS_AN_OCTAVE * np.log2(np.arange(1, n))), return_inverse=True)
    energy = np.asarray(np.bincount(bins, np.einsum("ij,ij->j", unit, unit, dtype=np.float64)), np.float64)
    return idct(drawn, norm="ortho", axis=-1, overwrite_x=True), bins, energy


@lru_cache(maxsize=256)
def _noise_left(mask: bytes, n: int, period_s: float, filled_for: Noise, noise: Noise) -> Array:
    filled = _bridge(mask, n, period_s, filled_for)
    if not len(filled.starts):
        return np.ones(n - 1)
    drawn, bins, drawn_energy = _drawn(n, period_s, noise)
    seen = dct(filled.over(drawn), norm="ortho", axis=-1, overwrite_x=True)[:, 1:]
    # against the very draws, whose own power at the lowest coefficients is not the expected one
    power = power_of(noise, n, period_s)
    energy = np.bincount(bins, np.einsum("ij,ij->j", seen, seen, dtype=np.float64) / power)
    return np.asarray((energy / drawn_energy)[bins])
