"""Reads the growing files of a run by their tails: the events' last lines, the history from where it was left."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO

from bench.control.live import read_lines
from drivers.base.files import parse_json

Line = dict[str, Any]
_TAIL_BYTES = 65_536
_MOST_BYTES = 4 << 20
_KEPT_LINES = 200
_RECENT_BYTES = 262_144
_SAMPLES = 1500
_WINDOW_BYTES = 1 << 20
_LATEST_S, _MOST_PHASES = 3.2e7, 1000


class EventTail:
    """The last lines of an events.jsonl; a file opened late is read from its last 64 KiB on."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.lines: deque[Line] = deque(maxlen=_KEPT_LINES)
        self._offset = -1

    def update(self) -> bool:
        """Read what has come; return whether there is news."""
        size = _size(self.path)
        if self._offset < 0 or size - self._offset > _MOST_BYTES:
            self._offset = max(0, size - _TAIL_BYTES)  # mostly within a line, whose end alone is no JSON
        rows, self._offset = read_lines(self.path, self._offset)
        events = [row for row in rows if "kind" in row]
        self.lines += events
        return bool(events)


class PhaseTail:
    """The phases of a run that goes on, read from where its events.jsonl was left."""

    def __init__(self, run: Path) -> None:
        self.phases: list[tuple[str, float]] = []
        """Name and start, s of bench time."""
        self._path = run / "events.jsonl"
        self._offset = 0

    def update(self) -> None:
        """Read what has come; a phase whose line is not as it should be is none."""
        rows, self._offset = read_lines(self._path, self._offset)
        for row in rows:
            name, time_s = row.get("phase"), row.get("time_s")
            if row.get("kind") != "phase" or not isinstance(name, str) or not isinstance(time_s, int | float):
                continue
            if abs(time_s) < _LATEST_S and len(self.phases) < _MOST_PHASES:
                self.phases.append((name, float(time_s)))


class HistoryTail:
    """A run's live/history.jsonl. Opened late, its last quarter megabyte is read in full, and of what was before
    a line in each of some thousand places: the cost does not grow with the run.
    """

    def __init__(self, run: Path) -> None:
        self._path = run / "live" / "history.jsonl"
        self._offset: int | None = None

    def update(self) -> list[Line]:
        """Return the rows that have come, in order of time; the first call returns the past, thinned."""
        if self._offset is None:
            return list(self._past())
        rows, self._offset = read_lines(self._path, self._offset)
        return rows

    def _past(self) -> Iterator[Line]:
        recent = max(0, _size(self._path) - _RECENT_BYTES)
        if recent:
            with self._path.open("rb", buffering=4096) as file:
                step = max(1, recent // _SAMPLES)
                for start in range(0, recent, step):
                    file.seek(start)
                    if start:
                        file.readline(_RECENT_BYTES)
                    if file.tell() >= recent:
                        break
                    with suppress(ValueError):
                        row = parse_json(file.readline(_RECENT_BYTES))
                        if isinstance(row, dict):
                            yield row
                file.seek(recent)
                file.readline(_RECENT_BYTES)
                recent = file.tell()
        rows, self._offset = read_lines(self._path, recent)
        yield from rows


def history_between(run: Path, from_s: float, to_s: float) -> list[Line]:
    """Return the rows of a run's live/history.jsonl in a stretch of bench time, in order.

    Of a stretch of more than a megabyte a line in each of `_SAMPLES` places.
    """
    path = run / "live" / "history.jsonl"
    try:
        with path.open("rb", buffering=4096) as file:
            size = _size(path)
            low, high = (_place(file, size, time_s) for time_s in (from_s, to_s))
            high = min(size, high + _TAIL_BYTES)  # the last lines of the stretch begin there
            if high - low <= _WINDOW_BYTES:
                file.seek(low)
                lines = file.read(high - low).splitlines()
            else:
                lines = []
                for start in range(low, high, (high - low) // _SAMPLES):
                    file.seek(start)
                    file.readline(_RECENT_BYTES)
                    lines.append(file.readline(_RECENT_BYTES))
    except OSError:
        return []
    rows = [row for line in lines if (row := _parsed(line)) is not None]
    return [row for row in rows if from_s <= row["time_s"] <= to_s]


def _place(file: BinaryIO, size: int, time_s: float) -> int:
    """Return an offset at which a line begins: those before it are earlier than `time_s`, by halving."""
    low, high = 0, size
    while high - low > 1:
        middle = (low + high) // 2
        file.seek(middle)
        file.readline(_RECENT_BYTES)
        row = _parsed(file.readline(_RECENT_BYTES))
        if row is not None and row["time_s"] < time_s:
            low = middle
        else:
            high = middle
    if low:
        file.seek(low)
        file.readline(_RECENT_BYTES)
        return file.tell()
    return 0


def _parsed(line: bytes) -> Line | None:
    with suppress(ValueError):
        row = parse_json(line)
        if isinstance(row, dict) and isinstance(row.get("time_s"), int | float):
            return row
    return None


def _size(path: Path) -> int:
    """Return a file's size in bytes, 0 if there is none."""
    try:
        return path.stat().st_size
    except OSError:
        return 0
