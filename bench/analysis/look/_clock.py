"""The clock of a log: sample rate, gaps, rows at odd times; and rows and columns that hold nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.statistics import stretches
from drivers.base.arrays import Array

_GAP = 1.5
"""Times the usual step from which on rows are missing."""
_BRIDGED = 3
"""Missing rows in a row that are interpolated; a longer gap cuts the record."""
_STUCK = 50
"""Equal values one after the other from which on a changing column counts as stuck."""
_LOOK_AT_START = 8
_PAD = 4
"""Rows at an end that only repeat one value from which on they are padding."""


@dataclass(frozen=True)
class Clock:
    """`rate_hz` is NaN where neither the log nor anybody says it; figures are then per sample.

    `gaps`: pauses of more than one and a half steps, `lost` the rows missing in them, `longest_s` the longest;
    `odd` rows at a time not after the one before. `jitter_s` is 1 sigma of the steps. `source` says who told.
    """

    rate_hz: float
    source: str
    start_s: float
    rows: int
    gaps: int = 0
    lost: int = 0
    longest_s: float = 0.0
    odd: int = 0
    jitter_s: float = 0.0

    @property
    def known(self) -> bool:
        """Whether the sample rate is known."""
        return bool(np.isfinite(self.rate_hz))

    @property
    def per_s(self) -> float:
        """Samples a second, 1 (a sample) where that is not known."""
        return self.rate_hz if self.known else 1.0


@dataclass(frozen=True, eq=False)
class Grid:
    """Where every row of the log stands on a grid of equal steps; `slot` (rows,), -1 for a row left out."""

    slot: NDArray[np.int64]
    count: int

    def put(self, values: Array) -> Array:
        """Return a column (rows,) on the grid (count,): up to 3 missing values interpolated, others NaN."""
        if self.count == len(values) and self.slot[-1] == self.count - 1 and bool((self.slot >= 0).all()):
            placed = values
        else:
            placed = np.full(self.count, np.nan)
            placed[self.slot[self.slot >= 0]] = values[self.slot >= 0]
        missing = ~np.isfinite(placed)
        if not missing.any() or missing.all():
            return placed
        placed = placed.copy()
        bridged = np.zeros(self.count, np.bool_)
        for start, stop in stretches(missing):
            bridged[start:stop] = stop - start <= _BRIDGED and start > 0 and stop < self.count
        known = np.flatnonzero(~missing)
        at = np.flatnonzero(bridged)
        placed[at] = np.interp(at, known, placed[known])
        return placed


def clock_of(time_s: Array | None, rows: int, rate_hz: float | None, source: str) -> tuple[Clock, Grid]:
    """Return clock and grid of a log: by its times (rows,), else by a rate that was told, else by row."""
    if time_s is None:
        whole = Grid(np.arange(rows), rows)
        return Clock(rate_hz or np.nan, source if rate_hz else "nobody", 0.0, rows), whole
    step = np.diff(time_s)
    forward = step > 0.0
    usual = float(np.median(step[forward]))
    even = forward & (step < _GAP * usual) & (step > usual / _GAP)
    if even.mean() > 0.5:
        usual = float(step[even].mean())
    late = forward & (step > _GAP * usual)
    lost = np.rint(step[late] / usual - 1.0)
    slot = np.zeros(rows, np.int64)
    slot[1:] = np.cumsum(np.where(late, np.rint(np.where(late, step, 0.0) / usual), 1.0 * forward))
    slot[1:][~forward] = -1
    clock = Clock(
        rate_hz or 1.0 / usual,
        source if rate_hz else "the time column",
        float(time_s[0]),
        rows,
        int(late.sum()),
        int(lost.sum()),
        float(step[late].max(initial=0.0)),
        int((~forward).sum()),
        float(step[even].std()) if even.any() else 0.0,
    )
    return clock, Grid(slot, int(slot.max()) + 1)


def without_padding(columns: Mapping[str, Array]) -> tuple[dict[str, Array], list[str]]:
    """Leave out empty columns, rows at the ends that hold nothing, and first rows unlike the rest."""
    remarks = []
    empty = [name for name, values in columns.items() if not np.isfinite(values).any()]
    if empty:
        remarks.append(f"left out, no numbers: {', '.join(empty)}")
    kept = {name: values for name, values in columns.items() if name not in empty}
    if not kept:
        return {}, remarks
    rows = len(next(iter(kept.values())))
    varying = [values for values in kept.values() if not _grows(values)]
    begin, end = _begin(varying), rows
    if varying:
        end = rows - _repeated_at_end([values[::-1] for values in varying])
        begin = max(begin, _repeated_at_end(varying))
    if begin or end < rows:
        remarks.append(
            f"left out: {begin} rows before the first and {rows - end} after the last one with values"
        )
    return {name: values[begin:end] for name, values in kept.items()}, remarks


def _grows(values: Array) -> bool:
    return len(values) > 1 and bool(np.all(np.diff(values[:1000]) > 0.0))


def _begin(columns: list[Array]) -> int:
    """Return how many first rows are a header of numbers: fractions above columns of whole numbers."""
    whole = [values[:1000] == np.rint(values[:1000]) for values in columns]
    if not whole or len(whole[0]) < 10 * _LOOK_AT_START:
        return 0
    broken = ~np.all(whole, axis=0)
    if broken[_LOOK_AT_START:].any() or not broken.any():
        return 0
    return int(np.flatnonzero(broken)[-1]) + 1


def _repeated_at_end(columns: list[Array]) -> int:
    """Return how many first rows say nothing: no value, or at least `_PAD` times the same in all columns."""
    rows = len(columns[0])
    same = np.ones(rows - 1, np.bool_)
    blank = np.ones(rows, np.bool_)
    for values in columns:
        same &= (values[1:] == values[:-1]) | (np.isnan(values[1:]) & np.isnan(values[:-1]))
        blank &= np.isnan(values)
    changes = np.flatnonzero(~same)
    run = int(changes[0]) + 1 if len(changes) else 0
    first = np.flatnonzero(~blank)
    blank_run = int(first[0]) if len(first) else 0
    return max(blank_run, run if run >= _PAD else 0)


def held_remarks(columns: Mapping[str, Array]) -> list[str]:
    """Say which columns are stuck, are copies of another, or are only renewed now and then.

    `columns`: those that measure something, name -> (n,).
    """
    remarks = []
    names = list(columns)
    for number, name in enumerate(names):
        values = columns[name]
        twin = next(
            (one for one in names[:number] if np.array_equal(columns[one], values, equal_nan=True)), None
        )
        if twin is not None:
            remarks.append(f"{name} is a copy of {twin}")
            continue
        same = values[1:] == values[:-1]
        if same.all():
            remarks.append(f"{name} is stuck at {values[0]:g}")
            continue
        runs = stretches(same)
        length = runs[:, 1] - runs[:, 0] + 1 if len(runs) else np.zeros(0, np.int64)
        usual = max(_STUCK, 20.0 * len(values) / (1 + int((~same).sum())))
        for start, stop in runs[length > usual][:3]:
            remarks.append(
                f"{name} is stuck at {values[start]:g} for {stop - start + 1} rows from row {start + 1} on"
            )
        renewed = np.diff(np.flatnonzero(~same))
        if len(renewed) > 100 and np.median(renewed) >= 2 and (renewed == np.median(renewed)).mean() > 0.8:
            remarks.append(f"{name} is renewed every {int(np.median(renewed))} rows only")
    return remarks
