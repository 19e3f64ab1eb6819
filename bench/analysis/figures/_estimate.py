"""Estimates with the interval that holds them, where noise alone would make a figure.

A largest residual, a spread and a ratio grow with noise: a perfect unit shows them too. Here each is estimated
as the size for which the value found would be the median, and its 95 % interval is that of the sizes for which
the value found is not too rare (inverted tests; JCGM 101 for the draws).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bench.analysis.common.quantiles import chi_squared
from drivers.base.arrays import Array

DRAWS = 2000
"""Draws of the noise behind an interval: its ends are then good to a tenth of their distance."""
TWO_SIDED = 1.959964
"""Standard errors to either side that hold 95 % of a normal distribution."""
_TAIL = 0.025
_HALVINGS = 24


@dataclass(frozen=True)
class Estimate:
    """A value and the ends of its 95 % interval, in one unit.

    `seen`: whether the record shows it at all. One that is not seen is known to be at most `bound`.
    `freedom`: degrees of freedom where the scatter of repeats made the interval.
    """

    value: float
    low: float
    high: float
    seen: bool = True
    freedom: float = math.inf

    @property
    def bound(self) -> float:
        """The larger end of the interval by magnitude."""
        return max(abs(self.low), abs(self.high))

    def times(self, factor: float) -> Estimate:
        """Return it in another unit."""
        low, high = sorted((factor * self.low, factor * self.high))
        return Estimate(factor * self.value, low, high, self.seen)


def linear(value: float, draws: Array) -> Estimate:
    """Return a value whose error is normal, as `draws`, shape (m,), are; seen if its interval leaves zero out."""
    half = TWO_SIDED * float(np.std(draws))
    return Estimate(value, value - half, value + half, abs(value) > half)


def largest(values: Array, draws: Array) -> Estimate:
    """Return the largest magnitude behind `values` (k,) whose errors are distributed as `draws` (m, k).

    The lower end and the value take the true ones to be shaped as those found, the upper end takes one of them
    to stand alone: a flat shape gains most from noise, a single one least. Seen if noise alone gives as much in
    fewer than 2.5 % of the draws.
    """
    size = np.abs(values)
    peak = int(np.argmax(size))
    found = float(size[peak])
    if found == 0.0 or not draws.any():
        return Estimate(found, found, found, found > 0.0)
    others = np.delete(np.abs(draws), peak, axis=1).max(axis=1, initial=0.0) <= found
    alone, shape = draws[others, peak], values / found

    def like_those(a: float) -> float:
        return float(np.mean(np.abs(a * shape + draws).max(axis=1) <= found))

    def one(a: float) -> float:
        return float(np.sum(np.abs(a + alone) <= found)) / len(draws)

    most = found + 6.0 * float(draws.std(axis=0).max())
    low = _where(like_those, 1.0 - _TAIL, most)
    value = max(_where(like_those, 0.5, most), low)
    return Estimate(value, low, max(_where(one, _TAIL, most), value), low > 0.0)


def spread(values: ArrayLike, covariance: Array) -> Estimate:
    """Return the standard deviation of `values` (n,) beyond errors of known `covariance` (n, n).

    The sample variance is taken for chi-squared with n - 1 degrees of freedom about the sum of both variances.
    """
    found = np.asarray(values, dtype=np.float64)
    freedom = len(found) - 1
    contrast = np.eye(len(found)) - 1.0 / len(found)
    noise = float(np.trace(contrast @ covariance)) / freedom
    square = float(np.var(found, ddof=1))
    total = freedom * square
    low, high = (max(total / chi_squared(p, freedom) - noise, 0.0) for p in (1.0 - _TAIL, _TAIL))
    value = max(square - noise, 0.0)
    return Estimate(value**0.5, low**0.5, max(high, square) ** 0.5, low > 0.0)


def _where(share: Callable[[float], float], level: float, most: float) -> float:
    """Return the size in [0, most] at which a share that falls with size reaches `level`; 0 if it is below."""
    if share(0.0) <= level:
        return 0.0
    low, high = 0.0, most
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if share(middle) > level else (low, middle)
    return 0.5 * (low + high)
