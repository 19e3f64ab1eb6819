"""Reads the growing files of a run by their tails: the events' last lines, the history from where it was left."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

from bench.control.live import read_history
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
        self.count = 0
        """Lines read so far: changes when there is news."""
        self._offset = -1
        self._rest = b""

    def update(self) -> bool:
        """Read what has come; return whether there is news."""
        try:
            size = self.path.stat().st_size
            torn = self._offset < 0 or size - self._offset > _MOST_BYTES
            if torn:
                self._offset = max(0, size - _TAIL_BYTES)
                self._rest = b""
                torn = self._offset > 0
            if size <= self._offset:
                return False
            with self.path.open("rb") as file:
                file.seek(self._offset)
                data = file.read(size - self._offset)
        except OSError:
            return False
        self._offset += len(data)
        *whole, self._rest = (self._rest + data).split(b"\n")
        if len(self._rest) > _MOST_BYTES:
            self._rest = b""
        before = self.count
        for line in whole[1:] if torn else whole:
            with suppress(ValueError):
                row = parse_json(line)
                if isinstance(row, dict) and "kind" in row:
                    self.lines.append(row)
                    self.count += 1
        return self.count > before


class HistoryTail:
    """A run's live/history.jsonl. Opened late, its last quarter megabyte is read in full, and of what was before
    a line in each of some thousand places: the cost does not grow with the run.
    """

    def __init__(self, run: Path) -> None:
        self.run = run
        self._offset: int | None = None

    def update(self) -> list[Line]:
        """Return the rows that have come, in order of time; the first call returns the past, thinned."""
        if self._offset is None:
            return list(self._past())
        rows, self._offset = read_history(self.run, self._offset)
        return rows

    def _past(self) -> Iterator[Line]:
        path = self.run / "live" / "history.jsonl"
        try:
            size = path.stat().st_size
        except OSError:
            return
        recent = max(0, size - _RECENT_BYTES)
        if recent:
            with path.open("rb", buffering=4096) as file:
                step = max(1, recent // _SAMPLES)
                for start in range(0, recent, step):
                    file.seek(start)
                    if start:
                        file.readline(_RECENT_BYTES)
                    if file.tell() >= recent:
                        break
                    if (row := _row(file.readline(_RECENT_BYTES))) is not None:
                        yield row
                file.seek(recent)
                file.readline(_RECENT_BYTES)
                recent = file.tell()
        rows, self._offset = read_history(self.run, recent)
        yield from rows


def _row(line: bytes) -> Line | None:
    with suppress(ValueError):
        row = parse_json(line)
        if isinstance(row, dict):
            return row
    return None
