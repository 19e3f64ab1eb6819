"""How large a signal is against noise, and how much of one another takes away: what the nominal model
re-calibrates is projected out, noise is white, 1/f and a random walk at the data sheet's values, every run has
a free bias.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from drivers.base.arrays import Array


@dataclass(frozen=True)
class NoiseLevels:
    """Coefficients of IEEE Std 952: N in deg/sqrt(h), B in deg/h, K in deg/h/sqrt(h), quantum in arcsec."""

    white: float
    flicker: float
    walk: float
    quantum: float = 0.0

    def power(self, n: int, period_s: float) -> Array:
        """Return the variance of the orthonormal DCT-II coefficients 1 .. n-1 of noise, (deg/h)^2, (n - 1,).

        Spectral densities: N^2, B^2 / (2 pi f), K^2 / (2 pi f)^2; coefficient k has the frequency k / (2 n
        period).
        """
        half_cycles = np.arange(1, n) / n
        frequency_hz = half_cycles / 2.0 / period_s
        steps = 4.0 * np.sin(0.5 * np.pi * half_cycles) ** 2
        return np.asarray(
            3600.0 * self.white**2 / period_s
            + self.flicker**2 / (2.0 * math.pi * frequency_hz * period_s)
            + self.walk**2 * period_s / 3600.0 / steps
            + self.quantum**2 / 12.0 / period_s**2 * steps
        )


@dataclass(frozen=True, eq=False)
class Part:
    """A run's share of signals: `rows` (p, n) signals in deg/h, `nominal` (q, n) columns, `seen` (n,) samples."""

    rows: Array
    nominal: Array
    seen: NDArray[np.bool_]
    period_s: float = 1.0


def remaining(parts: Sequence[Part], noise: NoiseLevels) -> Array:
    """Return the Gram matrix (p, p) of signals in all runs, nominal columns and each run's bias projected out.

    Its diagonal is the square of a deflection.
    """
    gram: Array | float = 0.0
    count = len(parts[0].rows)
    for part in parts:
        n = part.rows.shape[1]
        stack = _bridged(np.concatenate((part.rows, part.nominal)), part.seen)
        whole = dct(stack, norm="ortho", axis=-1)[:, 1:] / np.sqrt(noise.power(n, part.period_s))
        gram = gram + whole @ whole.T
    gram = np.asarray(gram)
    nominal = gram[count:, count:]
    scale = np.sqrt(np.maximum(np.diag(nominal), 1e-300))
    inverse = np.linalg.pinv(nominal / np.outer(scale, scale), rcond=1e-10) / np.outer(scale, scale)
    return np.asarray(gram[:count, :count] - gram[:count, count:] @ inverse @ gram[count:, :count])


def resampled(values: Array, period_s: float, to_s: float) -> Array:
    """Return the means of rows (p, n) over steps of `to_s`, (p, m): every value holds for its own period."""
    whole = np.concatenate((np.zeros((len(values), 1)), np.cumsum(values, axis=1)), axis=1)
    edges = np.arange(math.floor(values.shape[1] * period_s / to_s + 1e-6) + 1) * to_s / period_s
    index = np.arange(whole.shape[1])
    return np.stack([np.diff(np.interp(edges, index, row)) for row in whole]) * period_s / to_s


def deflection(parts: Sequence[Part], noise: NoiseLevels) -> float:
    """Return the deflection of the first signal; a tenth of it is its signal-to-noise ratio."""
    return math.sqrt(max(float(remaining(parts, noise)[0, 0]), 0.0))


def _bridged(values: Array, seen: NDArray[np.bool_]) -> Array:
    """Return rows (p, n) with what was not seen interpolated: it tells nothing."""
    if seen.all():
        return values
    index, known = np.arange(values.shape[1]), np.flatnonzero(seen)
    return np.stack([np.interp(index, known, row[known]) for row in values])
