"""Curves of any length in bounded memory: the extremes of every stretch of time, so that no spike is lost."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bench.present.panel._values import rounded

Row = list[float | None]
"""Middle of the stretch in s of bench time, then lowest and highest value of every column; None where unknown."""

_DIGITS = 8


class MinMax:
    """Extremes of several columns over stretches of `width_s`, at most `capacity` of them.

    `growing`: when it is full, neighbours are merged and `width_s` doubles, so that the whole run stays; else the
    oldest stretch goes. `version` counts what makes a reader start over, `rows` are in order of time.
    """

    def __init__(self, columns: int, width_s: float, capacity: int, *, growing: bool) -> None:
        self.width_s = width_s
        self.version = 0
        self._columns = columns
        self._capacity = capacity
        self._growing = growing
        self._buckets: list[int] = []
        self._extremes: list[list[float]] = []

    def __len__(self) -> int:
        return len(self._buckets)

    def add(self, time_s: float, values: Sequence[float | None]) -> None:
        """Take the columns' values at `time_s`; None and NaN are no values. Time that goes back is left out."""
        bucket = math.floor(time_s / self.width_s)
        if self._buckets and bucket < self._buckets[-1]:
            return
        if not self._buckets or bucket > self._buckets[-1]:
            self._buckets.append(bucket)
            self._extremes.append([math.inf, -math.inf] * self._columns)
        extremes = self._extremes[-1]
        for column, value in enumerate(values):
            if value is not None and math.isfinite(value):
                extremes[2 * column] = min(extremes[2 * column], value)
                extremes[2 * column + 1] = max(extremes[2 * column + 1], value)
        while len(self._buckets) > self._capacity:
            self._shrink()

    def rows(self, first: int = 0) -> list[Row]:
        """Return the rows from index `first` on."""
        first = max(0, first)
        return [
            [round((bucket + 0.5) * self.width_s, 3), *(rounded(value, _DIGITS) for value in extremes)]
            for bucket, extremes in zip(self._buckets[first:], self._extremes[first:], strict=True)
        ]

    def _shrink(self) -> None:
        if not self._growing:
            del self._buckets[0], self._extremes[0]
            return
        self.width_s *= 2.0
        self.version += 1
        buckets, extremes = self._buckets, self._extremes
        self._buckets, self._extremes = [], []
        for bucket, row in zip(buckets, extremes, strict=True):
            if self._buckets and self._buckets[-1] == bucket // 2:
                last = self._extremes[-1]
                last[::2] = map(min, last[::2], row[::2])
                last[1::2] = map(max, last[1::2], row[1::2])
            else:
                self._buckets.append(bucket // 2)
                self._extremes.append(row)
