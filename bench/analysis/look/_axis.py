"""What the record of one axis shows: level, drift, steps, outliers, limits, quantum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from bench.analysis.common.statistics import stretches
from drivers.base.arrays import Array

_BLOCKS = 32
_OUTLIER, _STEP = 8.0, 8.0
"""Times the robust sigma from which on a sample is an outlier, a change of level a step."""
_STEP_BLOCKS, _STEP_SPAN = 2048, 32
_AT_LIMIT = 5
"""Equal samples one after the other at an extreme from which on it is a limit."""
_SAMPLE = 1 << 17
_MAD = 1.4826


@dataclass(frozen=True)
class Step:
    """A change of level between two samples of a rest: seconds from the first row, size in the axis' unit."""

    time_s: float
    size: float


@dataclass(frozen=True)
class Figures:
    """Figures of one axis at rest, in its unit.

    `mean` and `drift_per_h` with 1 sigma from block means, their correlation counted; `sigma` of the samples.
    `outliers`: samples 8 robust sigma off the mean of their neighbours, the largest by `largest_outlier`, the
    first at `first_outlier_s`. `limits`: values at which the whole record stays again and again.
    `quantum`: step between neighbouring values, NaN where there is no grid.
    """

    samples: int
    missing: int
    mean: float
    mean_sigma: float
    sigma: float
    drift_per_h: float
    drift_sigma: float
    steps: tuple[Step, ...]
    outliers: int
    first_outlier_s: float
    largest_outlier: float
    limits: tuple[float, ...]
    quantum: float


def figures_of(values: Array, rest: NDArray[np.bool_], per_s: float) -> tuple[Figures, Array]:
    """Return the figures of an axis (n,), NaN where it has no value, and the axis with outliers interpolated."""
    finite = np.isfinite(values)
    used = finite & rest
    flat = values[used]
    odd, sizes = _outliers(flat)
    index = np.flatnonzero(used)
    clean = values
    if len(odd):
        clean = values.copy()
        kept = np.delete(np.arange(len(flat)), odd)
        clean[index[odd]] = np.interp(odd, kept, flat[kept])
        flat = clean[used]
    time_h = index / per_s / 3600.0
    mean, mean_sigma, drift, drift_sigma = _trend(flat, time_h)
    figures = Figures(
        int(finite.sum()),
        int((~finite).sum()),
        mean,
        mean_sigma,
        float(flat.std()) if len(flat) else np.nan,
        drift,
        drift_sigma,
        _steps(clean, used, per_s),
        len(odd),
        float(index[odd[0]] / per_s) if len(odd) else np.nan,
        float(sizes[np.argmax(np.abs(sizes))]) if len(odd) else 0.0,
        _limits(values[finite]),
        _quantum(values[finite]),
    )
    return figures, clean


def longest(mask: NDArray[np.bool_]) -> slice:
    """Return the longest stretch in which `mask` (n,) is true."""
    runs = stretches(mask)
    if not len(runs):
        return slice(0, 0)
    start, stop = runs[np.argmax(runs[:, 1] - runs[:, 0])]
    return slice(int(start), int(stop))


def _trend(values: Array, time_h: Array) -> tuple[float, float, float, float]:
    """Return mean and slope (a hour) with 1 sigma each, from means of 32 blocks."""
    size = len(values) // _BLOCKS
    if size < 1:
        return float(values.mean()) if len(values) else np.nan, np.nan, np.nan, np.nan
    means, times = (
        column[: size * _BLOCKS].reshape(_BLOCKS, size).mean(axis=1) for column in (values, time_h)
    )
    mean_sigma = float(means.std(ddof=1) * _correlated(means - means.mean()) / np.sqrt(_BLOCKS))
    centred = times - times.mean()
    slope = float(centred @ means / (centred @ centred))
    left = means - means.mean() - slope * centred
    scatter = float(np.sqrt(left @ left / (_BLOCKS - 2)))
    return (
        float(values.mean()),
        mean_sigma,
        slope,
        scatter * _correlated(left) / float(np.linalg.norm(centred)),
    )


def _correlated(left: Array) -> float:
    """Return by how much correlation of neighbours makes a mean less certain."""
    power = float(left @ left)
    rho = min(max(float(left[1:] @ left[:-1]) / power, 0.0), 0.9) if power > 0.0 else 0.0
    return float(np.sqrt((1.0 + rho) / (1.0 - rho)))


def _outliers(values: Array) -> tuple[NDArray[np.int64], Array]:
    """Return places of samples far from both neighbours, and how far off the mean of these they are."""
    if len(values) < 32:
        return np.zeros(0, np.int64), np.zeros(0)
    off = values[1:-1] - 0.5 * (values[:-2] + values[2:])
    sigma = _MAD * float(np.median(np.abs(off - np.median(off))))
    sigma = sigma or float(off.std())
    if sigma == 0.0:
        return np.zeros(0, np.int64), np.zeros(0)
    size = np.abs(off)
    far = np.flatnonzero(size > _OUTLIER * sigma)
    # An outlier moves its neighbours by half its size: the largest of three is the one.
    around = [size[np.clip(far + shift, 0, len(size) - 1)] for shift in (-1, 1)]
    far = far[(size[far] >= around[0]) & (size[far] >= around[1])]
    return far + 1, off[far]


def _steps(values: Array, used: NDArray[np.bool_], per_s: float) -> tuple[Step, ...]:
    """Return changes of level: means before and after differ by 8 times what is usual in the record."""
    part = longest(used)
    flat = values[part]
    size = max(1, len(flat) // _STEP_BLOCKS)
    blocks = flat[: len(flat) // size * size].reshape(-1, size).mean(axis=1)
    span = min(_STEP_SPAN, len(blocks) // 8)
    if span < 4:
        return ()
    total = np.concatenate(([0.0], np.cumsum(blocks - blocks.mean())))
    sums = total[span:] - total[:-span]
    change = (sums[span:] - sums[:-span]) / span
    change -= np.median(change)
    usual = _MAD * float(np.median(np.abs(change)))
    if usual == 0.0:
        return ()
    peaks, _ = find_peaks(np.abs(change), height=_STEP * usual, distance=2 * span)
    # A step makes a triangle as wide as the span either way; a hump or a ramp does not.
    sharp = [
        peak for peak in peaks
        if np.abs(change[max(peak - span, 0)] / change[peak]) < 0.5
        and np.abs(change[min(peak + span, len(change) - 1)] / change[peak]) < 0.5
    ]  # fmt: skip
    start = part.start
    return tuple(Step((start + (peak + span) * size) / per_s, float(change[peak])) for peak in sharp)


def _limits(values: Array) -> tuple[float, ...]:
    """Return extremes at which the record stays: at least 5 samples in a row, and far more than just inside."""
    if len(values) < 100:
        return ()
    low, high = float(values.min()), float(values.max())
    limits = []
    for extreme, sign in ((low, 1.0), (high, -1.0)):
        at = values == extreme
        near = ((values - extreme) * sign > 0.0) & ((values - extreme) * sign < 0.02 * (high - low))
        if at.sum() < _AT_LIMIT or at.sum() < 3 * near.sum() or at.mean() > 0.9:
            continue
        runs = stretches(at)
        if int((runs[:, 1] - runs[:, 0]).max()) >= _AT_LIMIT and abs(
            extreme - np.median(values)
        ) > 4.0 * _spread(values):
            limits.append(extreme)
    return tuple(limits)


def _spread(values: Array) -> float:
    sample = values[:: max(1, len(values) // _SAMPLE)]
    return float(_MAD * np.median(np.abs(np.diff(sample))) / np.sqrt(2.0))


def _quantum(values: Array) -> float:
    """Return the step of the grid that the values stand on, NaN without one."""
    distinct = np.unique(values[:_SAMPLE])
    gaps = np.diff(distinct)
    gaps = (
        gaps[gaps > 1e-9 * max(abs(distinct[0]), abs(distinct[-1]), 1e-300)]
        if len(distinct) > 2
        else gaps[:0]
    )
    if len(gaps) < 2:
        return float(gaps[0]) if len(gaps) else np.nan
    smallest = gaps.min()
    quantum = float(np.median(gaps[gaps < 1.5 * smallest]))
    steps = gaps / quantum
    on_grid = np.abs(steps - np.rint(steps)) < 0.05 + 1e-3 * steps
    return quantum if on_grid.mean() > 0.95 and np.median(steps) < 20.0 else np.nan
