"""A run's samples by seconds: means over each, and the phase that each belongs to."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array


@dataclass(frozen=True, eq=False)
class SecondMeans:
    """A gyro's means over whole seconds, (n,), NaN without a valid sample; `lost`: part of the samples."""

    rate_dps: Array
    temp_c: Array
    lost: float


def seconds(table: Mapping[str, NDArray[Any]]) -> Array:
    """Return the time column of a table in s of bench time, shape (n,)."""
    return np.asarray(table["time_ns"] * 1e-9, dtype=np.float64)


def second_rows(table: Mapping[str, NDArray[Any]], start_s: int) -> NDArray[np.int64]:
    """Return the row of each sample's second, shape (n,): row k holds start_s + k < time <= start_s + k + 1.

    In integers: 15_000_000_000 ns times 1e-9 is more than 15 s.
    """
    return np.asarray(-(-table["time_ns"] // 1_000_000_000) - start_s - 1, dtype=np.int64)


def row_means(
    values: NDArray[Any], row: NDArray[np.int64], count: int, use: NDArray[np.bool_] | None = None
) -> Array:
    """Return the means of the values of each row, (count,), NaN for a row without any.

    Left out: NaN, values of rows outside, and those that `use` (n,) says.
    """
    values = values.astype(np.float64)
    kept = (row >= 0) & (row < count) & ~np.isnan(values)
    if use is not None:
        kept &= use
    sums = np.bincount(row[kept], values[kept], count)
    samples = np.bincount(row[kept], minlength=count)
    return np.where(samples > 0, sums / np.maximum(samples, 1), np.nan)


def names_at(starts_s: Sequence[float], names: Sequence[str], times_s: Array) -> NDArray[np.str_]:
    """Return the name that holds at every time, (n,): each from its start on, the first one before it, too."""
    row = np.searchsorted(np.array(starts_s), times_s, side="right") - 1
    return np.asarray(np.array(names)[np.maximum(row, 0)])
