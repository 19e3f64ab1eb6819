"""A first-order follower of samples."""

from __future__ import annotations

import math

import numpy as np

from drivers.base.arrays import Array


def follower(values: Array, time_constant_s: float, period_s: float, start: float) -> Array:
    """First-order follower, exact for an input that is linear between samples; `start` is its first value."""
    if time_constant_s < 1e-6 * period_s:
        return values
    decay = math.exp(-period_s / time_constant_s)
    mean = (1.0 - decay) * time_constant_s / period_s
    coefficients = [1.0 - mean, mean - decay]
    from scipy.signal import lfilter  # here: a lab starts without scipy (decision 0021)

    first = start - coefficients[0] * values[0]
    result, _ = lfilter(coefficients, [1.0, -decay], values, zi=[first])
    return np.asarray(result)


def gain(time_constant_s: float) -> float:
    """Return the share of the way that a follower goes in one second; 1 for one without a lag."""
    return 1.0 - math.exp(-1.0 / time_constant_s) if time_constant_s > 0.0 else 1.0
