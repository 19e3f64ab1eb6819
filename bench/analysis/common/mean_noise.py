"""How the means of a record over several stretches scatter together, given its noise coefficients.

The integral of the rate is a process with stationary second differences; its generalised autocovariance is
-N^2 |t| / 2 for angle random walk, B^2 t^2 ln|t| / (2 pi) for flicker, K^2 |t|^3 / 12 for rate random walk and
Q^2 at t = 0 for quantisation (Greenhall and Riley, PTTI 2003, scaled to IEEE Std 952). A mean is a difference of
that integral, so the covariance of means follows in closed form.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from bench.analysis.common.allan_noise import NoiseCoefficients
from drivers.base.arrays import Array


def covariance_of_means(start_s: ArrayLike, end_s: ArrayLike, noise: NoiseCoefficients) -> Array:
    """Return the covariance (n, n) in (deg/h)^2 of the means from `start_s` to `end_s`, shape (n,) each.

    It holds for weights that sum to zero (differences, slopes, residuals): flicker and random walk have no
    variance of their own mean. A ramp is no noise and is left out.
    """
    start = np.asarray(start_s, dtype=np.float64) / 3600.0
    end = np.asarray(end_s, dtype=np.float64) / 3600.0
    ends = np.concatenate([end, start])
    integral = _autocovariance(ends[:, None] - ends[None, :], noise)
    count, length = len(start), end - start
    both = integral[:count] - integral[count:]
    return np.asarray((both[:, :count] - both[:, count:]) / np.outer(length, length))


def white_variance(length_s: ArrayLike, noise: NoiseCoefficients) -> Array:
    """Return the variance in (deg/h)^2 of means over `length_s` of angle random walk and quantisation alone."""
    hours = np.asarray(length_s, dtype=np.float64) / 3600.0
    return np.asarray(
        noise.angle_random_walk_deg_sqrt_h**2 / hours + 2.0 * (noise.quantisation_deg / hours) ** 2
    )


def freedom_of_blocks(count: int, length_s: float, noise: NoiseCoefficients) -> float:
    """Return the degrees of freedom of the sample variance of `count` consecutive means of `length_s`.

    2 E^2 / Var for normal noise: tr(PC)^2 / tr(PCPC), P taking the mean off and C the covariance, which
    repeats along its diagonals and is summed by them. Without any noise count - 1, as for white noise.
    """
    lag_h = length_s / 3600.0 * np.arange(-1.0, count + 1.0)
    integral = _autocovariance(lag_h, noise)
    row = (2.0 * integral[1:-1] - integral[2:] - integral[:-2]) / (length_s / 3600.0) ** 2
    if not row.any():
        return float(count - 1)
    sums = np.cumsum(row)
    of_rows = sums + sums[::-1] - row[0]
    weights = np.where(np.arange(count) == 0, count, 2 * (count - np.arange(count)))
    trace = count * row[0] - of_rows.sum() / count
    square = weights @ row**2 - 2.0 / count * (of_rows @ of_rows) + (of_rows.sum() / count) ** 2
    return float(trace**2 / square)


def draws(covariance: Array, count: int, seed: int = 0) -> Array:
    """Return `count` draws (count, n) of normal errors with `covariance` (n, n); the same for the same seed.

    More than twice as many as there are errors have that very covariance and no mean: 2,000 plain ones, the same
    for every unit, would make every interval of a figure too wide or too narrow by some 2 %.
    """
    values, vectors = np.linalg.eigh(covariance)
    factor = vectors * np.sqrt(np.maximum(values, 0.0))
    normal = np.random.default_rng(seed).standard_normal((count, len(covariance)))
    if count > 2 * len(covariance):
        normal -= normal.mean(axis=0)
        lower = np.linalg.cholesky(normal.T @ normal / count)
        normal = np.linalg.solve(lower, normal.T).T
    return np.asarray(normal @ factor.T)


def _autocovariance(lag_h: Array, noise: NoiseCoefficients) -> Array:
    size = np.abs(lag_h)
    quantisation, walk, flicker, drift, _ = noise.squares()
    logarithm = np.log(np.where(size > 0.0, size, 1.0))
    return np.asarray(
        quantisation * (size == 0.0)
        - 0.5 * walk * size
        + flicker / (2.0 * np.pi) * size**2 * logarithm
        + drift / 12.0 * size**3
    )
