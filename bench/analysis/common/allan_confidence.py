"""How sure an Allan deviation is: equivalent degrees of freedom by noise type, chi-square intervals.

Source: Greenhall and Riley, Uncertainty of Stability Variances Based on Finite Differences (PTTI 2003);
NIST SP 1065 sections 5.3 and 5.4.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.allan import AllanDeviation
from drivers.base.arrays import Array

_STEPS = 32
"""Starts an averaging time at which the correlation of differences is summed when the averaging time is long."""
_REACH = 8.0
"""Averaging times after which differences are taken for independent."""


def noise_exponents(allan: AllanDeviation) -> NDArray[np.int64]:
    """Return the power-law exponent alpha of the rate's spectrum at every averaging time, shape (k,).

    2 for quantisation (white phase), 0 for angle random walk, -1 for flicker, -2 for rate random walk, from the
    slope of log deviation over log averaging time: -1, -1/2, 0, +1/2. Slopes are taken over the neighbours. An
    exponent never rises again: slower noise has taken over, and a steep end of the curve is scatter.
    """
    if len(allan.tau_s) < 2:
        return np.zeros(len(allan.tau_s), dtype=np.int64)
    tiny = np.finfo(np.float64).tiny
    log_tau, log_deviation = np.log(allan.tau_s), np.log(np.maximum(allan.deviation, tiny))
    slope = np.gradient(log_deviation, log_tau)
    alpha = np.rint(-2.0 * slope - 1.0)
    exponents = np.where(alpha >= 1.0, 2, np.clip(alpha, -2.0, 0.0)).astype(np.int64)
    return np.asarray(np.minimum.accumulate(exponents))


def degrees_of_freedom(samples: int, length: int, alpha: int) -> float:
    """Return the equivalent degrees of freedom of the overlapping Allan variance of `samples` rate samples.

    `length` samples an averaging time, spectrum exponent `alpha` (2, 0, -1 or -2). edf = 2 E^2 / Var =
    M / sum (1 - |j|/M) rho(j)^2 over the M starts, rho being the correlation of differences j starts apart. For
    long averaging times 32 starts each stand for all: more add next to nothing.
    """
    per_tau = length if alpha == 2 else min(length, _STEPS)
    count = max(1.0, (samples - 2 * length) * per_tau / length + 1.0)
    if alpha == 2:  # white phase: only differences that share a sample are correlated
        lag, rho = length * np.arange(-2, 3), np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / 6.0
    else:
        reach = int(min(np.ceil(count) - 1, _REACH * per_tau))
        lag = np.arange(-reach, reach + 1)
        rho = _correlation(lag / per_tau, alpha)
    return float(count / np.sum(np.maximum(1.0 - np.abs(lag) / count, 0.0) * rho**2))


def _correlation(t: Array, alpha: int) -> Array:
    """Correlation of two second phase differences `t` averaging times apart.

    From the generalised autocovariance of phase (Greenhall and Riley, table of s_x): -|t|, t^2 ln|t| and |t|^3
    up to a factor for alpha 0, -1 and -2.
    """

    def phase(lag: Array) -> Array:
        distance = np.abs(lag)
        if alpha == 0:
            return -distance
        if alpha == -1:
            return distance**2 * np.log(np.maximum(distance, np.finfo(np.float64).tiny))
        return distance**3

    def difference(lag: Array) -> Array:
        near = phase(lag + 1.0) + phase(lag - 1.0)
        return 6.0 * phase(lag) - 4.0 * near + phase(lag + 2.0) + phase(lag - 2.0)

    return np.asarray(difference(t) / difference(np.zeros(1)))


def confidence_interval(
    allan: AllanDeviation, *, level: float = 0.95, alpha: NDArray[np.int64] | None = None
) -> tuple[Array, Array]:
    """Return the lower and upper end of the interval that holds the true deviation with probability `level`.

    Shape (k,) each: deviation * sqrt(edf / chi2). `alpha` are the noise exponents, by default those the
    deviation's own slope shows.
    """
    from scipy.special import gammaincinv  # slow to import

    exponents = noise_exponents(allan) if alpha is None else alpha
    samples = round(allan.record_s * allan.rate_hz)
    lengths = np.rint(allan.tau_s * allan.rate_hz).astype(np.int64)
    edf = np.array(
        [degrees_of_freedom(samples, int(m), int(a)) for m, a in zip(lengths, exponents, strict=True)]
    )
    tail = (1.0 - level) / 2.0
    # The chi-square quantile of probability p is 2 gammaincinv(edf / 2, p).
    low = allan.deviation * np.sqrt(edf / (2.0 * gammaincinv(edf / 2.0, 1.0 - tail)))
    high = allan.deviation * np.sqrt(edf / (2.0 * gammaincinv(edf / 2.0, tail)))
    return np.asarray(low), np.asarray(high)
