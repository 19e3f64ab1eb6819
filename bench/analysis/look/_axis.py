"""What the record of one axis shows: level, drift, steps, outliers, limits, quantum."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import find_peaks

from bench.analysis.common.outliers import FAR, outliers
from bench.analysis.common.statistics import stretches
from drivers.base.arrays import Array

_BLOCKS = 32
_STEP_BLOCKS, _STEP_SPAN = 2048, 32
_AT_LIMIT = 5
"""Equal samples one after the other at an extreme from which on it is a limit."""
_SAMPLE = 1 << 17
_MAD = 1.4826


@dataclass(frozen=True)
class Figures:
    """Figures of one axis at rest, in its unit.

    `mean` and `drift_per_h` with 1 sigma from block means, their correlation counted; `sigma` of the samples.
    `steps`: changes of level, (s from the first row, size). `outliers`: samples 8 robust sigma off the median
    of five, the largest by `largest_outlier`, the first at `first_outlier_s`. `limits`: values at
    which the whole record stays again and again. `quantum`: step between neighbouring values, NaN where there
    is no grid.
    """

    samples: int
    missing: int
    mean: float
    mean_sigma: float
    sigma: float
    drift_per_h: float
    drift_sigma: float
    steps: tuple[tuple[float, float], ...]
    outliers: int
    first_outlier_s: float
    largest_outlier: float
    limits: tuple[float, ...]
    quantum: float


def figures_of(
    values: Array, rest: NDArray[np.bool_], per_s: float, recorded: Array
) -> tuple[Figures, Array]:
    """Return the figures of an axis (n,), NaN where it has no value, and the axis with outliers interpolated.

    `recorded` (rows,) are its values as they stand in the log: an interpolated one would be on no grid.
    """
    finite = np.isfinite(values)
    index = np.flatnonzero(finite & rest)
    flat = values[index]
    odd, sizes = outliers(flat)
    clean = values
    if len(odd):
        clean = values.copy()
        kept = np.delete(np.arange(len(flat)), odd)
        clean[index[odd]] = np.interp(odd, kept, flat[kept])
        flat = clean[index]
    spread = float(flat.std()) if len(flat) else np.nan
    mean, mean_sigma, drift, drift_sigma = _trend(flat, index / per_s / 3600.0)
    first_s, largest = (index[odd[0]] / per_s, sizes[np.argmax(np.abs(sizes))]) if len(odd) else (np.nan, 0.0)
    figures = Figures(
        samples=int(finite.sum()), missing=int((~finite).sum()), mean=mean, mean_sigma=mean_sigma,
        sigma=spread, drift_per_h=drift, drift_sigma=drift_sigma, steps=level_steps(clean, finite & rest, per_s),
        outliers=len(odd), first_outlier_s=float(first_s), largest_outlier=float(largest),
        limits=_limits(recorded), quantum=_quantum(recorded),
    )  # fmt: skip
    return figures, clean


def longest(mask: NDArray[np.bool_]) -> slice:
    """Return the longest stretch in which `mask` (n,) is true."""
    start, stop = max(stretches(mask).tolist(), key=lambda run: run[1] - run[0], default=(0, 0))
    return slice(start, stop)


def _trend(values: Array, time_h: Array) -> tuple[float, float, float, float]:
    """Return mean and slope (a hour) with 1 sigma each, from means of 32 blocks."""
    size = len(values) // _BLOCKS
    if size < 1:
        return float(values.mean()) if len(values) else np.nan, np.nan, np.nan, np.nan
    means, times = (part[: size * _BLOCKS].reshape(_BLOCKS, size).mean(axis=1) for part in (values, time_h))
    times -= times.mean()
    off = means - means.mean()
    slope = float(times @ off / (times @ times))
    left = off - slope * times
    slope_sigma = np.sqrt(left @ left / (_BLOCKS - 2) / (times @ times)) * _correlated(left)
    mean_sigma = off.std(ddof=1) / np.sqrt(_BLOCKS) * _correlated(off)
    return float(values.mean()), float(mean_sigma), slope, float(slope_sigma)


def _correlated(left: Array) -> float:
    """Return by how much correlation of neighbours makes a mean less certain."""
    rho = float(np.clip(left[1:] @ left[:-1] / max(float(left @ left), 1e-300), 0.0, 0.9))
    return float(np.sqrt((1.0 + rho) / (1.0 - rho)))


def level_steps(values: Array, used: NDArray[np.bool_], per_s: float) -> tuple[tuple[float, float], ...]:
    """Return changes of level of a record (n,) in its longest `used` stretch: s from the first row, and size.

    Means before and after differ by 8 times what is usual in the record.
    """
    part = longest(used)
    size = max(1, (part.stop - part.start) // _STEP_BLOCKS)
    blocks = _block_means(values[part], size)
    span = min(_STEP_SPAN, len(blocks) // 8)
    if span < 4:
        return ()
    total = np.concatenate(([0.0], np.cumsum(blocks - blocks.mean())))
    sums = total[span:] - total[:-span]
    change = (sums[span:] - sums[:-span]) / span
    change -= np.median(change)
    usual = _MAD * float(np.median(np.abs(change)))
    peaks, _ = find_peaks(np.abs(change), height=max(FAR * usual, 1e-300), distance=2 * span)
    # A step makes a triangle as wide as the span either way; a hump or a ramp does not.
    sides = [np.abs(change[np.clip(peaks + side, 0, len(change) - 1)]) for side in (-span, span)]
    sharp = peaks[np.maximum(*sides) < 0.5 * np.abs(change[peaks])] if usual else peaks[:0]
    return tuple(
        ((part.start + (peak + span) * size) / per_s, float(change[peak])) for peak in sharp.tolist()
    )


def _block_means(values: Array, size: int) -> Array:
    return np.asarray(values[: len(values) // size * size].reshape(-1, size).mean(axis=1))


def _limits(values: Array) -> tuple[float, ...]:
    """Return extremes at which the record stays: at least 5 samples in a row, and far more than just inside."""
    limits = []
    for extreme in (values.min(), values.max()) if len(values) >= 100 else ():
        at = values == extreme
        near = ~at & (np.abs(values - extreme) < 0.02 * np.ptp(values))
        if at.sum() < max(_AT_LIMIT, 3 * near.sum()) or at.mean() > 0.9:
            continue
        run = longest(at)
        spread = _MAD * np.median(np.abs(np.diff(values[:: max(1, len(values) // _SAMPLE)]))) / np.sqrt(2.0)
        if run.stop - run.start >= _AT_LIMIT and abs(extreme - np.median(values)) > 4.0 * spread:
            limits.append(float(extreme))
    return tuple(limits)


def _quantum(values: Array) -> float:
    """Return the step of the grid that the values stand on, NaN without one."""
    distinct = np.unique(values[:_SAMPLE])
    gaps = np.diff(distinct)
    gaps = gaps[gaps > 1e-9 * np.abs(distinct).max(initial=1e-300)]
    if len(gaps) < 2:
        return float(gaps[0]) if len(gaps) else np.nan
    quantum = float(np.median(gaps[gaps < 1.5 * gaps.min()]))
    steps = gaps / quantum
    on_grid = np.abs(steps - np.rint(steps)) < 0.05 + 1e-3 * steps
    return quantum if on_grid.mean() > 0.95 and np.median(steps) < 20.0 else np.nan
