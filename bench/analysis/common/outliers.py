"""Outliers: single values that stand far off those about them (a lost bit, a shock)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array

FAR = 8.0
"""Standard deviations from which on a value stands far off those about it."""
RARE = 0.01
"""Part of a gyro's values that may be outliers: of more, it is the noise that has tails."""
_MAD = 1.4826
_FEWEST = 32


def outliers(values: Array, *, most: float = 1.0) -> tuple[NDArray[np.int64], Array]:
    """Return places of single values (or two) far off the median of five, and how far, (m,); NaN are no values.

    A change of level is none. None at all where more than the part `most` of the values is far off: then it is
    the noise that has tails. Nor of fewer than 32 values.
    """
    place = np.flatnonzero(np.isfinite(values))
    if len(place) < _FEWEST:
        return np.zeros(0, np.int64), np.zeros(0)
    known = values[place]
    off = known - _medians_of_five(known)
    away = np.abs(off)
    # the 95 % point beside the median: noise in steps may have a median of nothing
    sigma = max(_MAD * float(np.median(away)), float(np.quantile(away, 0.95)) / 1.96)
    far = np.flatnonzero(away > FAR * sigma) if sigma > 0.0 else np.zeros(0, np.int64)
    if len(far) > most * len(known):
        return np.zeros(0, np.int64), np.zeros(0)
    return place[far], off[far]


def _medians_of_five(values: Array) -> Array:
    """Return the median of each value and the two on either side, (n,); beyond the ends they are mirrored."""
    a, b, c, d, e = (np.pad(values, 2, mode="reflect")[k : len(values) + k] for k in range(5))
    # of two pairs the larger minimum and the smaller maximum are in the middle, with the fifth
    low = np.maximum(np.minimum(a, b), np.minimum(c, d))
    high = np.minimum(np.maximum(a, b), np.maximum(c, d))
    return np.asarray(np.maximum(np.minimum(e, low), np.minimum(np.maximum(e, low), high)))
