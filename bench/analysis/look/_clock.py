"""The clock of a log: sample rate, gaps, rows at odd times; and rows and columns that hold nothing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.statistics import stretches
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

_GAP = 1.5
"""Times the usual step from which on rows are missing."""
_BRIDGED = 3
"""Missing rows in a row that are interpolated; a longer gap cuts the record."""
_STUCK = 50
"""Equal values one after the other from which on a changing column counts as stuck."""
_MOST_TIMES, _ALWAYS = 100, 1_000_000
"""Times as many places as rows, and as many places always, that a log's gaps may make."""
_CAUGHT_UP = 3
"""Rows after a late one by which it is made up for."""
_BURST_ROWS = (64, 512, 4096)
"""Rows whose span may say the pace of times that are coarse, or at which a host read rows in bursts."""
_BURST_STEADY = 1.35
"""Ratio of long and short such spans (90 % and 10 %) up to which they have one pace."""
_FEW_EVEN = 0.98
"""Part of steps alike below which they may be those of bursts, if they cover less than half of the time."""
_PAD = 4
"""Rows at an end that only repeat one value from which on they are padding."""


@dataclass(frozen=True)
class Clock:
    """`rate_hz` is NaN where neither the log nor anybody says it; figures are then per sample.

    `gaps`: pauses of more than one and a half steps, `lost` the rows missing in them, `longest_s` the longest;
    `odd` rows at a time not after the one before. `jitter_s` is 1 sigma of the steps. `source` says who told.
    `bursts`: the times are those at which a host read rows in bursts; rows are taken as equally far apart.
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
    bursts: bool = False

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
        placed = values
        if self.count != len(values) or (self.slot < 0).any():
            placed = np.full(self.count, np.nan)
            placed[self.slot[self.slot >= 0]] = values[self.slot >= 0]
        missing = ~np.isfinite(placed)
        if not missing.any() or missing.all():
            return placed
        placed = np.where(missing, np.nan, placed)
        known = np.flatnonzero(~missing)
        for start, stop in stretches(missing):
            if stop - start <= _BRIDGED and start > 0 and stop < self.count:
                missing[start:stop] = False
        at = np.flatnonzero(~missing & np.isnan(placed))
        placed[at] = np.interp(at, known, placed[known])
        return placed


def clock_of(
    time_s: Array | None, rows: int, rate_hz: float | None, source: str, *, in_s: bool
) -> tuple[Clock, Grid]:
    """Return clock and grid of a log: by its times (rows,), else by a rate that was told, else by row.

    `in_s`: the times' unit is known; else they only say where rows are missing.
    """
    if time_s is None:
        return Clock(rate_hz or np.nan, source if rate_hz else "nobody", 0.0, rows), Grid(
            np.arange(rows), rows
        )
    known = np.isfinite(time_s)
    time_s = np.where(known, time_s, np.maximum.accumulate(np.where(known, time_s, time_s[np.argmax(known)])))
    step = np.diff(time_s)
    forward = step > 0.0
    usual = float(np.median(step[forward]))
    even = forward & (step < _GAP * usual) & (step > usual / _GAP)
    if even.mean() > 0.5:
        usual = float(step[even].mean())
    covered = step[even].sum() / max(step[forward].sum(), 1e-300)
    coarse = (step == 0.0).mean() > 0.5
    pace = _pace_of_bursts(time_s) if coarse or (even.mean() < _FEW_EVEN and covered < 0.5) else None
    if pace is None:
        ahead = forward.astype(np.int64)
        # A row that came late is none missing where those after it come early by as much: a bus or host was busy.
        late_rows = np.flatnonzero(forward & (step / usual >= 1.5))
        later = late_rows[:, None] + np.arange(1, _CAUGHT_UP + 1)
        inside = later < len(step)
        later = np.where(inside, later, 0)
        early = np.where(inside & forward[later], np.clip(1.0 - step[later] / usual, 0.0, 1.0), 0.0)
        ahead[late_rows] = np.maximum(np.rint(step[late_rows] / usual - early.sum(axis=1)), 1.0)
    else:
        (usual, longest_s), forward = pace, np.ones(len(step), np.bool_)
        ahead = np.where(step > longest_s, np.rint(step / usual), 1.0).astype(np.int64)
    unit_s = 1.0 if in_s else 1.0 / (usual * (rate_hz or 1.0))
    late = ahead > 1
    if ahead.sum() > _MOST_TIMES * rows + _ALWAYS:
        at = int(np.argmax(ahead))
        raise ConfigurationError(
            "the times are none of a recording",
            where=f"row {at + 1}",
            found=f"{time_s[at]:.9g}, then {time_s[at + 1]:.9g}",
            expected="gaps not far longer than the record",
            remedy="leave out the rows before or after",
        )
    slot = np.concatenate(([0], np.where(forward, np.cumsum(ahead), -1)))
    clock = Clock(
        rate_hz=rate_hz or (1.0 / usual if in_s else np.nan),
        source=source if rate_hz else "the time column" if in_s else "nobody",
        start_s=float(time_s[0]) * unit_s,
        rows=rows,
        gaps=int(late.sum()),
        lost=int((ahead[late] - 1).sum()),
        longest_s=float(step[late].max(initial=0.0)) * unit_s,
        odd=int((~forward).sum()),
        jitter_s=float(step[even].std()) * unit_s if even.any() else 0.0,
        bursts=pace is not None,
    )
    return clock, Grid(slot, int(slot.max()) + 1)


def _pace_of_bursts(time_s: Array) -> tuple[float, float] | None:
    """Return the usual step of rows (n,) that came in bursts of one pace, and the longest between bursts.

    None for too few rows, or rows of no steady pace.
    """
    for rows in _BURST_ROWS:
        spans = time_s[rows:] - time_s[:-rows]
        if len(spans) < 3 * rows:
            return None
        short, usual, long = np.quantile(spans, (0.1, 0.5, 0.9))
        if 0.0 < long < _BURST_STEADY * short:
            return float(spans[spans < 2.0 * usual].mean()) / rows, float(usual)
    return None


def without_padding(columns: Mapping[str, Array]) -> tuple[dict[str, Array], list[str]]:
    """Leave out empty columns, rows at the ends that hold nothing, and first rows unlike the rest."""
    remarks = []
    kept = {name: values for name, values in columns.items() if np.isfinite(values).any()}
    if empty := [name for name in columns if name not in kept]:
        remarks.append(f"left out, no numbers: {', '.join(empty)}")
    rows = len(next(iter(kept.values()), ()))
    varying = [values for values in kept.values() if not bool(np.all(np.diff(values[:1000]) > 0.0))]
    begin, end = 0, rows
    if varying and rows > 1:
        begin = max(_broken(varying), _idle(varying))
        end = rows - _idle([values[::-1] for values in varying])
    if begin or end < rows:
        remarks.append(
            f"left out: {begin} rows before the first and {rows - end} after the last one with values"
        )
    return {name: values[begin:end] for name, values in kept.items()}, remarks


def _broken(columns: list[Array]) -> int:
    """Return how many of the first 8 rows are a header of numbers: fractions above columns of whole numbers."""
    broken = ~np.all([values[:1000] == np.rint(values[:1000]) for values in columns], axis=0)
    return 0 if len(broken) < 80 or broken[8:].any() else int(np.flatnonzero(broken).max(initial=-1)) + 1


def _idle(columns: list[Array]) -> int:
    """Return how many first rows say nothing: no value, or at least `_PAD` times the same in all columns."""
    same = np.all([(c[1:] == c[:-1]) | (np.isnan(c[1:]) & np.isnan(c[:-1])) for c in columns], axis=0)
    blank = np.all([np.isnan(c) for c in columns], axis=0)
    run = int(np.argmin(same)) + 1 if not same.all() else 0
    return max(0 if blank.all() else int(np.argmin(blank)), run if run >= _PAD else 0)


def held_remarks(columns: Mapping[str, Array]) -> list[str]:
    """Say which columns (n,) are stuck, are copies of another, or are only renewed now and then."""
    remarks = []
    names = list(columns)
    for number, name in enumerate(names):
        values = columns[name]
        twins = [one for one in names[:number] if np.array_equal(columns[one], values, equal_nan=True)]
        changes = np.flatnonzero(values[1:] != values[:-1]) + 1
        if twins:
            remarks.append(f"{name} is a copy of {twins[0]}")
        elif not len(changes):
            remarks.append(f"{name} is stuck at {values[0]:g}")
        else:
            edges = np.concatenate(([0], changes, [len(values)]))
            length = np.diff(edges)
            long = length > max(_STUCK, 20.0 * len(values) / (1 + len(changes)))
            for start, rows in zip(edges[:-1][long][:3], length[long], strict=False):
                remarks.append(
                    f"{name} is stuck at {values[start]:g} for {rows} rows from row {start + 1} on"
                )
            usual = int(np.median(length[1:-1])) if len(changes) > 100 else 1
            if usual >= 2 and (length[1:-1] == usual).mean() > 0.8:
                remarks.append(f"{name} is renewed every {usual} rows only")
    return remarks
