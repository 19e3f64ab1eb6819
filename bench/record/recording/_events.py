"""Files that only grow, and of these events.jsonl: one JSON object a line; a torn last line is told."""

from __future__ import annotations

import errno
import json
import os
import threading
import zlib
from array import array
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, TypeVar

from bench.record.events import Event, Row, read_event
from drivers.base.errors import RecordError
from drivers.base.files import RECORD_BYTES, parse_json, read_bounded
from drivers.base.system import open_flags, sync_data

EVENTS_FILE = "events.jsonl"

_E = TypeVar("_E", bound=Event)
_PIECE_BYTES = 1 << 16
"""Bytes with a check sum of their own: so many are in doubt if one is not as it was written."""


class AppendFile:
    """A file in a run folder that only grows; a failed write keeps what is on disk and what is still pending.

    `size`: bytes that the operating system has taken, and where the next ones go. Whatever becomes of the file
    meanwhile, they stand in their place: what somebody cut off, or was never written, reads as zeros.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.pending = bytearray()
        self.unsynced = False
        self.size = 0
        self._told = -1
        self._sums = array("L")
        try:
            self._fd = os.open(path, open_flags("O_RDWR", "O_CREAT", "O_EXCL"), 0o644)
        except OSError as error:
            raise record_error(path, error) from error

    @property
    def closed(self) -> bool:
        """Whether the file has been closed."""
        return self._fd < 0

    def write(self) -> None:
        """Hand everything pending to the operating system; raises RecordError (disk full, folder gone)."""
        if not self.pending:
            return
        written = 0
        try:
            os.lseek(self._fd, self.size, os.SEEK_SET)
            while written < len(self.pending):
                with memoryview(self.pending)[written:] as rest:  # nobody may hold it when more is added
                    written += os.write(self._fd, rest)
            if os.fstat(self._fd).st_nlink == 0:
                raise FileNotFoundError(2, "the file was deleted while it was being written")
        except OSError as error:
            raise record_error(self.path, error) from error
        finally:
            self.unsynced |= written > 0
            with memoryview(self.pending) as view:
                self._sum(view[:written])
            del self.pending[:written]

    def _sum(self, data: bytes | memoryview) -> None:
        """Take bytes behind the last ones into size and check sums."""
        at = 0
        while at < len(data):
            inside = self.size % _PIECE_BYTES
            part = data[at : at + _PIECE_BYTES - inside]
            before = self._sums.pop() if inside else 0
            self._sums.append(zlib.crc32(part, before))
            self.size += len(part)
            at += len(part)

    def as_written_to(self) -> int | None:
        """Return how many bytes are surely as they were written if any is not, and was not told, else None.

        Reads the whole file. Finds what `whole_to` cannot: bytes that were changed in their place, or cut off
        between its look and a write. RecordError if the file cannot be read.
        """
        try:
            os.lseek(self._fd, 0, os.SEEK_SET)
            for number, known in enumerate(self._sums):
                start = number * _PIECE_BYTES
                if 0 <= self._told < start + _PIECE_BYTES:
                    return None
                if zlib.crc32(self._read(min(_PIECE_BYTES, self.size - start))) != known:
                    return start
        except OSError as error:
            raise record_error(self.path, error) from error
        return None

    def _read(self, count: int) -> bytes:
        """Return the next `count` bytes, fewer at the end only: the system may hand over less than was asked."""
        content = bytearray()
        while len(content) < count and (piece := os.read(self._fd, count - len(content))):
            content += piece
        return bytes(content)

    def whole_to(self) -> int | None:
        """Return how many bytes are as they were written if the file is longer or shorter than that, else None.

        The same loss is told once. RecordError if the file cannot be asked.
        """
        try:
            size = os.lseek(self._fd, 0, os.SEEK_END)  # cheaper than fstat
        except OSError as error:
            raise record_error(self.path, error) from error
        whole = min(size, self.size)
        if size == self.size or 0 <= self._told <= whole:
            return None
        self._told = whole
        return whole

    def restart(self, size: int) -> None:
        """Go on at `size` bytes; what stood behind them is gone."""
        try:
            os.ftruncate(self._fd, size)
            os.lseek(self._fd, 0, os.SEEK_SET)
            content = self._read(size)
        except OSError as error:
            raise record_error(self.path, error) from error
        self.size, self._told, self._sums = 0, -1, array("L")
        self._sum(content)

    def sync(self) -> None:
        """Wait until what was written is on the disk; raises OSError. May be called from another thread."""
        self.unsynced = False
        try:
            sync_data(self._fd)
        except OSError:
            self.unsynced = True
            raise

    def close(self) -> None:
        """Close the descriptor without writing; harmless when closed already. Raises RecordError."""
        if not self.closed:
            descriptor, self._fd = self._fd, -1  # whatever close says, the descriptor is gone
            try:
                os.close(descriptor)
            except OSError as error:
                raise record_error(self.path, error) from error


def record_error(path: Path, error: OSError) -> RecordError:
    """Return the RecordError that tells the operator about `error` at `path`."""
    return RecordError(
        "the run cannot be recorded any further",
        where=str(path),
        found=error.strerror or str(error),
        expected="a run folder that can be written, with space on its disk",
        remedy="free space or name another folder; what was recorded so far can be read",
    )


class Line(NamedTuple):
    """A line of an event log: bench time in s, and what happened."""

    time_s: float
    event: Event


class EventLog:
    """The event log being written: every line goes to the operating system at once.

    In a run the journal's thread does that (`Journal.adopt`), so that no event waits for a slow disk.
    """

    def __init__(self, folder: Path) -> None:
        self.file = AppendFile(folder / EVENTS_FILE)
        self._lines = bytearray()
        self._lock = threading.Lock()
        self._wake: Callable[[], None] | None = None

    def written_by(self, wake: Callable[[], None] | None) -> None:
        """Have somebody else call `write` soon after `wake` is called for a line; None: nobody else."""
        self._wake = wake

    def event(self, time_s: float, event: Event) -> None:
        """Write one line: what happened at bench time `time_s`."""
        text = json.dumps(event.row(time_s), ensure_ascii=False, allow_nan=False)
        with self._lock:
            self._lines += text.encode("utf-8") + b"\n"
        if self._wake is None:
            self.write()
        else:
            self._wake()

    def write(self) -> None:
        """Hand the lines that wait to the operating system; raises RecordError. One thread at a time."""
        with self._lock:
            lines, self._lines = self._lines, bytearray()
        self.file.pending += lines
        self._look()
        self.file.write()
        self._look()

    def _look(self) -> None:
        """Raise RecordError if lines are missing that were written; those that follow begin a line."""
        whole = self.file.whole_to()
        if whole is not None:
            try:
                begun = self.file.path.read_bytes().rfind(b"\n", 0, whole) + 1
            except OSError as error:
                raise record_error(self.file.path, error) from error
            self.file.restart(begun)
            raise record_error(self.file.path, OSError(errno.EIO, "lines are missing that were written"))

    def sync(self) -> None:
        """Wait until every line is on the disk; raises RecordError."""
        self.write()
        try:
            self.file.sync()
        except OSError as error:
            raise record_error(self.file.path, error) from error

    def close(self) -> None:
        """Sync and close; raises RecordError."""
        if self.file.closed:
            return
        try:
            self.sync()
        finally:
            self.file.close()


@dataclass(frozen=True)
class Events:
    """Events as read: `rows` as they are written, `lines` what they say.

    `torn` is the text of an incomplete last line, empty if there was none.
    """

    rows: tuple[Row, ...]
    torn: str = ""
    lines: tuple[Line, ...] = ()

    def of(self, kind: type[_E]) -> list[tuple[float, _E]]:
        """Return the events of a class, subclasses included, each with its bench time in s."""
        return [(line.time_s, line.event) for line in self.lines if isinstance(line.event, kind)]


def read_events(folder: Path) -> Events:
    """Read events.jsonl of a run folder; RecordError if it cannot be read or a line in its middle is broken."""
    path = folder / EVENTS_FILE
    try:
        content = read_bounded(path, RECORD_BYTES)
    except FileNotFoundError:
        return Events(())
    except OSError as error:
        raise RecordError(
            "the event log cannot be read",
            where=str(path),
            found=error.strerror or str(error),
            expected="a regular file that can be read",
        ) from error
    whole, _, torn = content.rpartition(b"\n")
    rows: list[Row] = []
    lines: list[Line] = []
    for number, line in enumerate(whole.split(b"\n") if whole else [], start=1):
        try:
            row = parse_json(line)
            lines.append(Line(*read_event(row)))
        except (ValueError, OverflowError) as error:
            raise RecordError(
                "the event log is damaged",
                where=f"{path}, line {number}",
                found=f"{line[:60]!r} ({error})",
                expected="one JSON object a line with time_s, kind and the fields of its kind",
                remedy="restore the file from a copy; raw bytes and tables are not affected",
            ) from error
        rows.append(row)
    return Events(tuple(rows), torn.decode("utf-8", "replace"), tuple(lines))
