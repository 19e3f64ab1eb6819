"""Reads the growing files of a run by their tails: the events' last lines, the history from where it was left."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from bench.control.live import read_lines
from drivers.base.files import parse_json

Line = dict[str, Any]
_TAIL_BYTES = 65_536
_MOST_BYTES = 4 << 20
_KEPT_LINES = 200
_RECENT_BYTES = 262_144
_SAMPLES = 1500


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


def _size(path: Path) -> int:
    """Return a file's size in bytes, 0 if there is none."""
    try:
        return path.stat().st_size
    except OSError:
        return 0
