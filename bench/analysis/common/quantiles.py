"""Quantiles of the distributions behind intervals; scipy is loaded by who asks for one."""

from __future__ import annotations

import math
from statistics import NormalDist


def student(probability: float, freedom: float) -> float:
    """Return a quantile of Student's t; `freedom` may be infinite."""
    if freedom == math.inf:
        return NormalDist().inv_cdf(probability)
    from scipy.special import stdtrit  # slow to import, scipy.stats ten times as slow

    return float(stdtrit(freedom, probability))


def chi_squared(probability: float, freedom: float) -> float:
    """Return a quantile of chi-squared; `freedom` need not be whole."""
    from scipy.special import gammaincinv  # slow to import, scipy.stats ten times as slow

    return 2.0 * float(gammaincinv(0.5 * freedom, probability))
