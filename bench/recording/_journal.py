"""The raw record of a run: every byte of every port as it came and went, with its time, append only.

Bytes are gathered in memory (a call costs well under a microsecond), written in blocks and synced on a cadence:

* `Journal.maybe_flush` writes once `flush_interval_s` of bench time and the same of wall time (at most a second)
  have passed, or a megabyte is waiting. On a wall clock that is the interval; in virtual time, where hours pass
  in seconds, it is one write a second or a megabyte rather than thousands.
* fdatasync follows a write at most once a wall second, on a thread of its own: a slow disk delays neither the
  bench nor an emergency stop. A killed process loses what was not yet written, a power cut what was not synced.
"""

from __future__ import annotations

import sys
import threading
from array import array
from bisect import bisect_right
from collections.abc import Iterable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from bench.recording._append import AppendFile, record_error
from drivers.clock import host_seconds

RAW_FOLDER = "raw"
_BLOCK_BYTES = 1 << 20
_LONGEST_WALL_INTERVAL_S = 1.0


TIE_NS = 1000


class _Direction:
    """Bytes one way and their index: int64 little-endian pairs (bytes so far, bench time in ns)."""

    def __init__(self, folder: Path, stem: str) -> None:
        self.data = AppendFile(folder / f"{stem}.bin")
        self.index = AppendFile(folder / f"{stem}.idx")
        self.last_ns = -TIE_NS
        self._total = 0
        self._bytes = bytearray()
        self._marks = array("q")
        self._lock = threading.Lock()
        self._handed_on = 0
        self._unwritten_marks = array("q")

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
        When the disk takes only part of the bytes, the marks of that part are written.
        """
        with self._lock:
            gathered, self._bytes = self._bytes, bytearray()
            marks, self._marks = self._marks, array("q")
        self.data.pending += gathered
        self._handed_on += len(gathered)
        self._unwritten_marks.extend(marks)
        try:
            self.data.write()
        finally:
            self._write_marks(self._handed_on - len(self.data.pending))

    def _write_marks(self, bytes_on_disk: int) -> None:
        whole = 2 * bisect_right(self._unwritten_marks[::2], bytes_on_disk)
        marks, self._unwritten_marks = self._unwritten_marks[:whole], self._unwritten_marks[whole:]
        if sys.byteorder == "big":
            marks.byteswap()
        self.index.pending += marks.tobytes()
        self.index.write()


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

    def flush(self, sync: bool) -> None:
        """Write what is pending and, with `sync`, wait for the disk; raises RecordError."""
        try:
            self._received.write()
        finally:
            self._sent.write()
        if sync:
            _sync(self.files)


class Journal:
    """All port journals of a run and their flushing; see the module for the cadence."""

    def __init__(self, folder: Path, flush_interval_s: float) -> None:
        self.folder = folder
        self._interval_s = flush_interval_s
        self._wall_interval_s = min(flush_interval_s, _LONGEST_WALL_INTERVAL_S)
        self._ports: list[PortJournal] = []
        self._adopted: list[AppendFile] = []
        self._flushed_s = float("-inf")
        self._flushed_wall_s = host_seconds()
        self._synced_wall_s = host_seconds()
        self._sync_thread = ThreadPoolExecutor(max_workers=1, thread_name_prefix="journal-sync")
        self._syncing: Future[None] | None = None
        self._closed = False

    def port(self, name: str) -> PortJournal:
        """Start the journal of a port; RecordError if the folder cannot be written or has that port already."""
        journal = PortJournal(self.folder, name)
        self._ports.append(journal)
        return journal

    def adopt(self, file: AppendFile) -> None:
        """Sync another append-only file (the event log) on the same cadence."""
        self._adopted.append(file)

    def maybe_flush(self, now_s: float) -> None:
        """Flush if the cadence asks for it at bench time `now_s`; raises RecordError."""
        if now_s - self._flushed_s < self._interval_s:
            return
        wall_s = host_seconds()
        waiting = sum(port.pending_bytes for port in self._ports)
        if wall_s - self._flushed_wall_s < self._wall_interval_s and waiting < _BLOCK_BYTES:
            return
        self._flushed_s = now_s
        self._flushed_wall_s = wall_s
        for port in self._ports:
            port.flush(sync=False)
        if wall_s - self._synced_wall_s >= self._wall_interval_s:
            self._synced_wall_s = wall_s
            self._sync_aside()

    def close(self) -> None:
        """Write and sync everything and close the files; every file is tried before RecordError is raised."""
        if self._closed:
            return
        self._closed = True
        self._sync_thread.shutdown(wait=True)
        failures: list[Exception] = []
        for port in self._ports:
            try:
                port.flush(sync=True)
            except Exception as error:
                failures.append(error)
            for file in port.files:
                file.close()
        if failures:
            raise failures[0]

    def _sync_aside(self) -> None:
        if self._syncing is not None:
            if not self._syncing.done():
                return
            self._syncing.result()
        files = [*self._adopted, *(file for port in self._ports for file in port.files)]
        self._syncing = self._sync_thread.submit(_sync, files)


def _sync(files: Iterable[AppendFile]) -> None:
    for file in files:
        if file.unsynced and not file.closed:
            try:
                file.sync()
            except OSError as error:
                raise record_error(file.path, error) from error
