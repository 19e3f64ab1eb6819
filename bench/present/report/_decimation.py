"""Fewer points for a plot, with every extremum kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from drivers.base.arrays import Array

_MOST_POINTS = 400


def decimate(x: ArrayLike, y: ArrayLike, buckets: int) -> tuple[Array, Array]:
    """Return at most 2 * `buckets` + 2 points of a curve (x and y of shape (n,)), in order.

    Of every bucket of equal sample count its smallest and its largest y stay, of the curve its first and last
    sample; a bucket without data leaves one NaN, so that gaps stay gaps. Short curves come back unchanged.
    """
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    if len(y) <= 2 * buckets + 2:
        return x, y
    width = -(-len(y) // buckets)
    padded = np.full(buckets * width, np.nan)
    padded[: len(y)] = y
    rows = padded.reshape(buckets, width)
    empty = np.isnan(rows)
    first = np.arange(buckets) * width
    low = first + np.where(empty, np.inf, rows).argmin(axis=1)
    high = first + np.where(empty, -np.inf, rows).argmax(axis=1)
    keep = np.unique(np.concatenate(([0, len(y) - 1], low, high)))
    keep = keep[keep < len(y)]
    return x[keep], y[keep]


def thinned_spectrum(frequency: Array, density: Array) -> tuple[Array, Array]:
    """Return log10 of frequency and amplitude density: lowest and highest of buckets equal in log frequency."""
    x, y = np.log10(frequency), 0.5 * np.log10(density)
    if len(x) <= _MOST_POINTS:
        return x, y
    bucket = np.floor((x - x[0]) / (x[-1] - x[0]) * (_MOST_POINTS / 2)).astype(int)
    starts = np.flatnonzero(np.diff(bucket, prepend=-1))
    low, high = np.minimum.reduceat(y, starts), np.maximum.reduceat(y, starts)
    return np.repeat(x[starts], 2), np.stack([low, high], axis=1).ravel()
