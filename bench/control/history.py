"""Recent telemetry in bounded memory: one ring of rows (time, values) per instrument."""

from __future__ import annotations

import threading

import numpy as np
from numpy.typing import NDArray


class History:
    """The last `capacity` rows of (time_s, *columns); reading returns copies, oldest first."""

    def __init__(self, columns: tuple[str, ...], capacity: int = 65536) -> None:
        self._names = ("time_s", *columns)
        self._rows = np.full((capacity, len(self._names)), np.nan)
        self._count = 0
        self._last: dict[str, float] | None = {}
        """The newest row, None when nobody has looked at it yet."""
        self._lock = threading.Lock()

    def __len__(self) -> int:
        return min(self._count, len(self._rows))

    def append(self, time_s: float, *values: float) -> None:
        """Add a row."""
        with self._lock:
            self._rows[self._count % len(self._rows)] = (time_s, *values)
            self._count += 1
            self._last = None

    def extend(self, rows: NDArray[np.float64]) -> None:
        """Add rows (n, 1 + columns), each with its time first; of more than the capacity the last remain."""
        if not len(rows):
            return
        with self._lock:
            capacity = len(self._rows)
            count = self._count + np.arange(len(rows))[-capacity:]
            self._rows[count % capacity] = rows[-capacity:]
            self._count += len(rows)
            self._last = None

    @property
    def last(self) -> dict[str, float]:
        """The newest row by column name; empty before the first. Whoever wants to change it copies it."""
        last = self._last
        if last is None:
            with self._lock:
                row = self._rows[(self._count - 1) % len(self._rows)]
                last = self._last = dict(zip(self._names, row.tolist(), strict=True))
        return last

    def row_at(self, time_s: float) -> dict[str, float]:
        """Return the newest row at or before `time_s`; empty if there is none."""
        with self._lock:
            at = self._count % len(self._rows) if self._count > len(self._rows) else 0
            for part in (self._rows[:at], self._rows[at : self._count]):
                if found := int(np.searchsorted(part[:, 0], time_s, side="right")):
                    return dict(zip(self._names, part[found - 1].tolist(), strict=True))
        return {}

    def since(self, start_s: float) -> dict[str, NDArray[np.float64]]:
        """Return the rows with time >= `start_s`, arrays of shape (n,) by column name."""
        with self._lock:
            at = self._count % len(self._rows) if self._count > len(self._rows) else 0
            parts = (self._rows[at : self._count], self._rows[:at])
            recent = [part[np.searchsorted(part[:, 0], start_s) :] for part in parts]
            rows = np.concatenate(recent)
        return {name: rows[:, i].copy() for i, name in enumerate(self._names)}
