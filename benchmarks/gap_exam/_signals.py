"""Small parts of simulations: followers, relaxation spectra, coloured noise, reproducible random numbers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from zlib import crc32

import numpy as np
from scipy.signal import lfilter

from drivers.base.arrays import Array


def drawn(seed: int, *what: str | int) -> np.random.Generator:
    """Return random numbers that depend on a seed and on what they are for."""
    return np.random.default_rng([seed, *(crc32(str(part).encode()) for part in what)])


def follow(values: Array, time_s: float, step_s: float) -> Array:
    """Return a first-order follower of values (..., m), settled at the first."""
    decay = math.exp(-step_s / time_s)
    settled = decay * values[..., :1]
    return np.asarray(lfilter([1.0 - decay], [1.0, -decay], values, axis=-1, zi=settled)[0])


def spectrum_of_lags(
    values: Array, times_s: Sequence[float], weights: Sequence[float], step_s: float
) -> Array:
    """Return the weighted mean of followers."""
    total = sum(w * follow(values, t, step_s) for t, w in zip(times_s, weights, strict=True))
    return np.asarray(total / sum(weights))


def markov(sigma: float, time_s: float, gaps_s: Array, rng: np.random.Generator) -> Array:
    """Return a first-order Markov process at points `gaps_s` (n,) apart, stationary from the first on."""
    if np.ptp(gaps_s) < 1e-9:
        decay = math.exp(-float(gaps_s[0]) / time_s)
        kicks = sigma * math.sqrt(1.0 - decay**2) * rng.standard_normal(len(gaps_s))
        return np.asarray(lfilter([1.0], [1.0, -decay], kicks, zi=[decay * sigma * rng.standard_normal()])[0])
    # uneven steps: on an even grid, read off in between
    even = float(np.median(gaps_s))
    at = np.cumsum(gaps_s)
    grid = np.arange(math.ceil(at[-1] / even) + 1) * even
    return np.asarray(np.interp(at, grid, markov(sigma, time_s, np.full(len(grid), even), rng)))


def walk(dph_per_sqrt_h: float, gaps_s: Array, rng: np.random.Generator) -> Array:
    """Return a random walk at points `gaps_s` (n,) apart."""
    return np.asarray(np.cumsum(dph_per_sqrt_h * np.sqrt(gaps_s / 3600.0) * rng.standard_normal(len(gaps_s))))


def flicker(level_dph: float, gaps_s: Array, rng: np.random.Generator) -> Array:
    """Return noise of a spectral density B^2 / (2 pi f) at points `gaps_s` (n,) apart.

    Exponentially correlated processes with times in a ratio of r have it together if each has the variance
    B^2 ln(r) / pi.
    """
    sigma = level_dph * math.sqrt(math.log(_RATIO) / math.pi)
    return np.asarray(sum(markov(sigma, time_s, gaps_s, rng) for time_s in _TIMES_S))


_RATIO = 3.0
_TIMES_S = tuple(0.3 * _RATIO**k for k in range(13))


def slope_per_min(values: Array, step_s: float) -> Array:
    """Return the rate of change a minute."""
    return np.asarray(60.0 * np.gradient(values, step_s))


def smooth_step(x: Array) -> Array:
    """Return the logistic function, without overflow."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(x, -50.0, 50.0))))


def play(values: Array, half_width: float) -> Array:
    """Return the play operator of values (m,): it starts at the first, and follows when half a width away."""
    held, result = float(values[0]), np.empty(len(values))
    for k, value in enumerate(values.tolist()):
        held = min(max(held, value - half_width), value + half_width)
        result[k] = held
    return result
