"""The raw record of a run: every byte of every port as it came and went, with its time, append only.

Bytes are gathered in memory (a call costs well under a microsecond). Threads of the journal's own write and sync
them, four times in every flush interval (a second at most) or when a megabyte is waiting, so that a slow
disk delays neither the bench nor an emergency stop, a busy procedure no write. A killed process loses what came
since the last write began: a quarter of the interval, and as long as the kernel holds up a write, which a disk
that stalls makes it do. A power cut loses what came since the last sync began. What the threads meet is raised by
the next `Journal.check`.
"""

from __future__ import annotations

import sys
import threading
from array import array
from bisect import bisect_right
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from bench.record.recording._events import AppendFile, EventLog, record_error
from drivers.base.clock import Ticker
from drivers.base.errors import RecordError

RAW_FOLDER = "raw"
_BLOCK_BYTES = 1 << 20
_MOST_WAITING_BYTES = 256 << 20
_LONGEST_INTERVAL_S = 1.0

TIE_NS = 1000
_MARK_BYTES = 16


@dataclass(frozen=True)
class Hole:
    """A raw file that is not as it was written: bytes or marks are missing after bench time `from_s`."""

    file: str
    whole_bytes: int
    written_bytes: int
    from_s: float


class _Direction:
    """Bytes one way and their index: int64 little-endian pairs (bytes so far, bench time in ns)."""

    def __init__(self, folder: Path, stem: str) -> None:
        self._holes: list[Hole] = []
        self.data = AppendFile(folder / f"{stem}.bin")
        self.index = AppendFile(folder / f"{stem}.idx")
        self.last_ns = -TIE_NS
        self._total = 0
        self._bytes = bytearray()
        self._marks = array("q")
        self._lock = threading.Lock()
        self._handed_on = 0
        self._unwritten_marks = array("q")
        self._last_mark = array("q")

    def add(self, data: bytes, time_s: float, other_ns: int) -> None:
        """Take bytes; `other_ns` is the last time in the other direction.

        Virtual time stands still between an answer and the next question: a tie is broken by one nanosecond,
        so that the order of question and answer can be read back from their times. On a wall clock the bytes of
        a stream come from a thread of its own while another writes.
        """
        time_ns = round(time_s * 1e9)
        with self._lock:
            if other_ns - TIE_NS < time_ns <= other_ns:
                time_ns = other_ns + 1
            self.last_ns = time_ns
            self._bytes += data
            self._total += len(data)
            self._marks.append(self._total)
            self._marks.append(time_ns)

    @property
    def pending_bytes(self) -> int:
        """Bytes taken and not yet written."""
        return len(self._bytes) + len(self.data.pending)

    def write(self) -> None:
        """Write the bytes before the marks, so that a mark on disk never speaks of bytes that are not.

        Nobody waits for the disk to add: what has been gathered changes hands under the lock, writing does not.
        When the disk takes only part of the bytes, the marks of that part are written. Before and after it is
        seen whether both files have what was written so far.
        """
        self._look()
        with self._lock:
            gathered, self._bytes = self._bytes, bytearray()
            marks, self._marks = self._marks, array("q")
        if not (gathered or marks or self.data.pending or self._unwritten_marks or self.index.pending):
            return
        self.data.pending += gathered
        self._handed_on += len(gathered)
        self._unwritten_marks.extend(marks)
        try:
            self.data.write()
        finally:
            self._write_marks(self._handed_on - len(self.data.pending))
        self._look()

    def _write_marks(self, bytes_on_disk: int) -> None:
        whole = 2 * bisect_right(self._unwritten_marks[::2], bytes_on_disk)
        marks, self._unwritten_marks = self._unwritten_marks[:whole], self._unwritten_marks[whole:]
        self._last_mark = marks[-2:] or self._last_mark
        self._add_to_index(marks)

    def _add_to_index(self, marks: array[int]) -> None:
        if sys.byteorder == "big":
            marks = array("q", marks)
            marks.byteswap()
        self.index.pending += marks.tobytes()
        self.index.write()

    def _look(self) -> None:
        """Note whether bytes or marks are missing, and go on so that those that follow keep their times."""
        for file in (self.data, self.index):
            whole = file.whole_to()
            if whole is None:
                continue
            written = file.size
            if file is self.index:  # zeros are no marks: it goes on behind those that are whole
                self.index.restart(whole // _MARK_BYTES * _MARK_BYTES)
                self._add_to_index(self._last_mark)
            self._add_hole(file, whole, written)

    def compare(self) -> None:
        """Note whether a file has other bytes than were written; raises RecordError if it cannot be read."""
        for file in (self.data, self.index):
            if (whole := file.as_written_to()) is not None:
                self._add_hole(file, whole, file.size)

    def _add_hole(self, file: AppendFile, whole: int, written: int) -> None:
        self._holes.append(Hole(file.path.name, whole, written, self._time_s(file, whole)))

    def take_holes(self) -> list[Hole]:
        """Return what was found missing since this was last asked; the journal's thread may be adding one."""
        taken = self._holes[:]
        del self._holes[: len(taken)]  # the same list: what is being added must not go to an old one
        return taken

    def _time_s(self, file: AppendFile, whole: int) -> float:
        """Return the bench time of the last mark that a file has in its first `whole` bytes; 0 for none."""
        marks = array("q")
        try:
            content = self.index.path.read_bytes()
        except OSError:  # it is in another place by now
            return 0.0
        marks.frombytes(content[: len(content) // _MARK_BYTES * _MARK_BYTES])
        if sys.byteorder == "big":
            marks.byteswap()
        count = whole // _MARK_BYTES if file is self.index else bisect_right(marks[::2], whole)
        return marks[2 * count - 1] / 1e9 if count else 0.0


class PortJournal:
    """What one port received and sent: `raw/<port>.bin`, `.idx`, `.sent.bin`, `.sent.idx`; a `Tap` for a link."""

    def __init__(self, folder: Path, port_name: str) -> None:
        raw = folder / RAW_FOLDER
        try:
            raw.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise record_error(raw, error) from error
        self.name = port_name
        self._received = _Direction(raw, port_name)
        self._sent = _Direction(raw, f"{port_name}.sent")

    def received(self, data: bytes, arrival_s: float) -> None:
        """Take bytes as they came; `arrival_s` is the bench time of the last one."""
        self._received.add(data, arrival_s, self._sent.last_ns)

    def sent(self, data: bytes, time_s: float) -> None:
        """Take bytes as they were written at bench time `time_s`."""
        self._sent.add(data, time_s, self._received.last_ns)

    @property
    def pending_bytes(self) -> int:
        """Bytes received or sent and not yet written."""
        return self._received.pending_bytes + self._sent.pending_bytes

    @property
    def files(self) -> tuple[AppendFile, ...]:
        """The four files of the port."""
        return (self._received.data, self._received.index, self._sent.data, self._sent.index)

    def take_holes(self) -> list[Hole]:
        """Return what was found missing of the files since this was last asked."""
        return [*self._received.take_holes(), *self._sent.take_holes()]

    def flush(self, sync: bool) -> None:
        """Write what is pending and, with `sync`, wait for the disk; raises RecordError."""
        try:
            self._received.write()
        finally:
            self._sent.write()
        if sync:
            _sync(self.files)

    def compare(self) -> None:
        """Read the files and note what is not as it was written; raises RecordError."""
        self._received.compare()
        self._sent.compare()


class Journal:
    """All port journals of a run, its event log, and the threads that write them."""

    def __init__(self, folder: Path, flush_interval_s: float) -> None:
        self.folder = folder
        self._place = _place(folder)
        self._ports: list[PortJournal] = []
        self._events: EventLog | None = None
        self._failure: Exception | None = None
        self._closed = False
        period_s = min(flush_interval_s, _LONGEST_INTERVAL_S) / 4.0
        self._writer = Ticker(period_s, lambda: self._try(self._write), "journal writer")
        self._syncer = Ticker(period_s, lambda: self._try(self._sync), "journal syncer")

    def port(self, name: str) -> PortJournal:
        """Start the journal of a port; RecordError if the folder cannot be written or has that port already."""
        journal = PortJournal(self.folder, name)
        self._ports.append(journal)
        return journal

    def adopt(self, log: EventLog) -> None:
        """Write the lines of an event log as they come, and sync them with the rest."""
        self._events = log
        log.written_by(self._writer.wake)

    def check(self) -> None:
        """Raise the RecordError that the writer met; wake it if a megabyte is waiting."""
        if self._failure is not None:
            failure, self._failure = self._failure, None
            raise failure
        waiting = sum(port.pending_bytes for port in self._ports)
        if waiting >= _BLOCK_BYTES:
            self._writer.wake()
        if waiting > _MOST_WAITING_BYTES:
            raise RecordError(
                "the disk does not keep up",
                where=str(self.folder),
                found=f"{waiting >> 20} MiB that are not written yet",
                expected=f"less than {_MOST_WAITING_BYTES >> 20} MiB",
                remedy="name a folder on a faster disk with --runs",
            )

    def take_holes(self) -> list[Hole]:
        """Return what was found missing of raw files since this was last asked."""
        return [hole for port in self._ports for hole in port.take_holes()]

    @property
    def written(self) -> dict[str, int]:
        """How many bytes the operating system took of each raw file, by name in the run folder."""
        files = [file for port in self._ports for file in port.files]
        return {file.path.relative_to(self.folder).as_posix(): file.size for file in files}

    def close(self) -> None:
        """Write, sync, read back and close every file; all are tried before RecordError is raised."""
        if self._closed:
            return
        self._closed = True
        self._writer.stop()
        self._syncer.stop()
        if self._events is not None:
            self._events.written_by(None)
        failures: list[Exception] = []
        for port in self._ports:
            try:
                port.flush(sync=True)
                port.compare()
            except Exception as error:
                failures.append(error)
            for file in port.files:
                try:
                    file.close()
                except RecordError as error:
                    failures.append(error)
        if failures:
            raise failures[0]

    def _try(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Exception as error:
            self._failure = error if not isinstance(error, OSError) else record_error(self.folder, error)

    def _write(self) -> None:
        for port in self._ports:
            port.flush(sync=False)
        if self._events is not None:
            self._events.write()

    def _sync(self) -> None:
        if (
            _place(self.folder) != self._place
        ):  # moved, or its mount is gone: it could not be closed at the end
            raise record_error(self.folder, FileNotFoundError(2, "the run folder is no longer in its place"))
        files = [file for port in self._ports for file in port.files]
        _sync(files if self._events is None else [self._events.file, *files])


def _place(folder: Path) -> tuple[int, int]:
    """Return what tells a folder from another one of its name, zeros if there is none. Raises RecordError."""
    try:
        found = folder.stat()
    except FileNotFoundError:
        return (0, 0)
    except OSError as error:
        raise record_error(folder, error) from error
    return (found.st_dev, found.st_ino)


def _sync(files: Iterable[AppendFile]) -> None:
    for file in files:
        if file.unsynced and not file.closed:
            try:
                file.sync()
            except OSError as error:
                raise record_error(file.path, error) from error
