"""The raw journal: what was handed in is on disk byte for byte, and trouble with the disk is told."""

import os
import resource
import shutil
import signal
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bench.record.events.run import Note
from bench.record.recording import EventLog, Journal, PortJournal, read_events
from drivers.base.errors import RecordError

pytestmark = pytest.mark.concurrent


def marks(path):
    return np.fromfile(path, dtype="<i8").reshape(-1, 2).tolist()


def test_bytes_and_marks_of_both_directions_reach_their_files(tmp_path):
    port = PortJournal(tmp_path, "chamber")
    port.sent(b"$01I\r", 1.5)
    port.received(b"0050.0 ", 1.5000000014)
    port.received(b"0024.6\r", 2.25)
    port.flush(sync=True)
    raw = tmp_path / "raw"
    assert (raw / "chamber.bin").read_bytes() == b"0050.0 0024.6\r"
    assert marks(raw / "chamber.idx") == [[7, 1_500_000_001], [14, 2_250_000_000]]
    assert (raw / "chamber.sent.bin").read_bytes() == b"$01I\r"
    assert marks(raw / "chamber.sent.idx") == [[5, 1_500_000_000]]


def test_index_is_little_endian_int64(tmp_path):
    port = PortJournal(tmp_path, "p")
    port.received(b"abc", 1e-9)
    port.flush(sync=False)
    assert (tmp_path / "raw" / "p.idx").read_bytes() == bytes([3, *[0] * 7, 1, *[0] * 7])


class Writer:
    """In the ticker's place: the test is the thread."""

    def __init__(self, period_s, call, name):
        self.period_s, self.call, self.woken, self.stopped = period_s, call, 0, False

    def wake(self):
        self.woken += 1

    def stop(self):
        self.stopped = True


@pytest.fixture
def journal(tmp_path, monkeypatch):
    monkeypatch.setattr("bench.record.recording._journal.Ticker", Writer)
    journal = Journal(tmp_path, flush_interval_s=1.0)
    yield journal
    journal.close()


def test_everything_is_written_and_synced_four_times_in_an_interval(tmp_path, journal, monkeypatch):
    synced = []
    real = os.fdatasync
    monkeypatch.setattr(
        "os.fdatasync", lambda fd: (synced.append(Path(f"/proc/self/fd/{fd}").readlink()), real(fd))
    )
    assert journal._writer.period_s == journal._syncer.period_s == 0.25
    port = journal.port("p")
    port.received(b"x" * 100, 0.5)
    journal.check()
    assert (tmp_path / "raw" / "p.bin").stat().st_size == 0 and journal._writer.woken == 0
    journal._writer.call()
    assert (tmp_path / "raw" / "p.bin").stat().st_size == 100
    assert synced == []
    journal._syncer.call()
    assert {path.name for path in synced} == {"p.bin", "p.idx"}
    port.received(b"y" * 7, 0.6)
    journal.close()
    assert (tmp_path / "raw" / "p.bin").stat().st_size == 107


def test_a_megabyte_wakes_the_writer(journal):
    port = journal.port("p")
    for second in range(1, 5):
        port.received(b"x" * 300_000, float(second))
        journal.check()
    assert journal._writer.woken == 1


def test_a_disk_that_stalls_stalls_nobody_until_memory_would_run_out(journal, monkeypatch):
    """The writer is in a write that never returns: bytes, events and checks go on."""
    monkeypatch.setattr("bench.record.recording._journal._MOST_WAITING_BYTES", 3 << 20)
    port, log = journal.port("p"), EventLog(journal.folder)
    journal.adopt(log)
    for second in range(3):
        port.received(b"x" * (1 << 20), float(second))
        log.event(float(second), Note("a stall"))
        journal.check()
    assert (journal.folder / "events.jsonl").read_bytes() == b""
    port.received(b"x", 4.0)
    with pytest.raises(RecordError, match="does not keep up") as full:
        journal.check()
    assert (full.value.found, full.value.expected) == ("3 MiB that are not written yet", "less than 3 MiB")
    journal._writer.call()
    journal.check()
    assert len((journal.folder / "events.jsonl").read_bytes().splitlines()) == 3
    assert (journal.folder / "raw" / "p.bin").stat().st_size == (3 << 20) + 1


def test_a_quarter_of_a_gibibyte_may_wait_for_the_disk(journal):
    port = SimpleNamespace(pending_bytes=256 << 20)
    journal._ports.append(port)
    journal.check()
    port.pending_bytes += 1
    with pytest.raises(RecordError, match="does not keep up"):
        journal.check()
    journal._ports.remove(port)


def test_what_the_writer_meets_is_raised_once_by_the_next_check(journal):
    port = journal.port("p")
    shutil.rmtree(journal.folder / "raw")
    port.received(b"x", 0.0)
    journal._writer.call()
    with pytest.raises(RecordError, match="deleted"):
        journal.check()
    journal.check()
    with pytest.raises(RecordError, match="deleted"):
        port.received(b"y", 1.0)
        journal.close()


def test_a_port_is_never_recorded_over(tmp_path):
    Journal(tmp_path, 1.0).port("p")
    with pytest.raises(RecordError, match=r"p\.bin.*exists"):
        Journal(tmp_path, 1.0).port("p")


def test_a_vanished_folder_is_told(tmp_path):
    journal = Journal(tmp_path / "run", 1.0)
    port = journal.port("p")
    shutil.rmtree(tmp_path / "run")
    port.received(b"x", 0.0)
    with pytest.raises(RecordError, match="deleted"):
        port.flush(sync=False)


def test_a_folder_that_was_moved_or_whose_mount_is_gone_is_told(tmp_path, monkeypatch):
    """Its open files take every byte still: only its name tells that it cannot be closed."""
    monkeypatch.setattr("bench.record.recording._journal.Ticker", Writer)
    folder, moved = tmp_path / "run", tmp_path / "moved"
    folder.mkdir()
    journal = Journal(folder, flush_interval_s=1.0)
    port = journal.port("fog_1")
    journal._syncer.call()
    journal.check()
    folder.rename(moved)
    folder.mkdir()
    port.received(b"abc", 1.0)
    journal._writer.call()
    journal._syncer.call()
    with pytest.raises(RecordError, match="no longer in its place"):
        journal.check()
    journal.close()
    assert (moved / "raw" / "fog_1.bin").read_bytes() == b"abc"


def test_a_full_disk_is_told_and_what_fitted_can_be_read(tmp_path):
    """A file-size limit makes the same partial write and error as a full disk does."""
    port = PortJournal(tmp_path, "p")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    handler = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    data = bytes(range(256)) * 8
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
        port.received(data[:900], 1.0)
        port.flush(sync=True)
        port.received(data[900:], 2.0)
        with pytest.raises(RecordError, match=r"p\.bin.*recorded any further"):
            port.flush(sync=True)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, handler)
    assert (tmp_path / "raw" / "p.bin").read_bytes() == data[:1000]
    assert marks(tmp_path / "raw" / "p.idx") == [[900, 1_000_000_000]]
    assert port.pending_bytes == 2048 - 1000
    port.flush(sync=True)
    assert port.pending_bytes == 0
    assert (tmp_path / "raw" / "p.bin").read_bytes() == data


def test_close_tries_every_port_before_it_raises(tmp_path):
    journal = Journal(tmp_path, 1.0)
    first, second = journal.port("first"), journal.port("second")
    first.received(b"1", 0.0)
    second.received(b"2", 0.0)
    (tmp_path / "raw" / "first.bin").unlink()
    with pytest.raises(RecordError, match="deleted"):
        journal.close()
    assert (tmp_path / "raw" / "second.bin").read_bytes() == b"2"
    journal.close()


def swallowing(monkeypatch, ends):
    """Have every write to files of this end vanish, as a disk that lies has it."""
    write = os.write

    def lie(descriptor, data):
        name = Path(f"/proc/self/fd/{descriptor}").readlink().name
        return len(data) if name.endswith(ends) else write(descriptor, data)

    monkeypatch.setattr(os, "write", lie)


@pytest.mark.parametrize("how", ["cut", "cut to nothing", "swallowed"])
def test_bytes_behind_a_hole_stand_in_their_place_and_the_hole_is_told_with_its_time(
    tmp_path, monkeypatch, how
):
    """Ten bytes a second; the file ends at 25 bytes for a while, or at none."""
    port, path = PortJournal(tmp_path, "p"), tmp_path / "raw" / "p.bin"
    came = b"".join(bytes([second]) * 10 for second in range(1, 9))
    for second in range(1, 9):
        port.received(came[10 * second - 10 : 10 * second], float(second))
        if how == "swallowed":
            with monkeypatch.context() as patch:
                if second in (3, 4):
                    swallowing(patch, ".bin")
                port.flush(sync=True)
        else:
            port.flush(sync=True)
            if second == 4:
                os.truncate(path, 25 if how == "cut" else 0)
    whole = {"cut": 25, "cut to nothing": 0, "swallowed": 20}[how]
    assert path.read_bytes() == came[:whole] + bytes(40 - whole) + came[40:]
    assert marks(tmp_path / "raw" / "p.idx") == [[10 * s, s * 10**9] for s in range(1, 9)]
    (hole,) = port.take_holes()
    assert (hole.file, hole.whole_bytes, hole.from_s) == ("p.bin", whole, float(whole // 10))
    port.flush(sync=True)
    assert port.take_holes() == []  # once


def test_a_hole_is_told_though_nothing_comes_any_more(tmp_path):
    port = PortJournal(tmp_path, "p")
    port.received(b"0123456789", 1.0)
    port.flush(sync=False)
    os.truncate(tmp_path / "raw" / "p.bin", 9)
    port.flush(sync=False)
    assert [(hole.file, hole.from_s) for hole in port.take_holes()] == [("p.bin", 0.0)]


def test_a_hole_is_told_though_somebody_asks_while_it_is_being_noted(tmp_path, monkeypatch):
    """The bench asks at every poll; when the hole begins is read from the disk meanwhile."""
    port, path = PortJournal(tmp_path, "p"), tmp_path / "raw" / "p.bin"
    port.received(b"0123456789", 1.0)
    port.flush(sync=False)
    os.truncate(path, 9)
    asked = []
    read_bytes = type(path).read_bytes

    def asked_while_it_reads(self):
        asked.append(port.take_holes())
        return read_bytes(self)

    monkeypatch.setattr(type(path), "read_bytes", asked_while_it_reads)
    port.flush(sync=False)
    assert asked == [[]]
    assert [hole.file for hole in port.take_holes()] == ["p.bin"] and port.take_holes() == []


@pytest.mark.parametrize("how", ["cut between look and write", "one bit", "the first byte of a later piece"])
def test_bytes_that_are_not_as_they_came_are_found_when_the_journal_is_closed(tmp_path, monkeypatch, how):
    """No length gives these away: the file is read back."""
    journal = Journal(tmp_path, 1.0)
    port, path = journal.port("p"), tmp_path / "raw" / "p.bin"
    seek = os.lseek

    def cut_first(fd, offset, whence):
        if (offset, whence) == (150_000, os.SEEK_SET):
            os.truncate(path, 70_000)
        return seek(fd, offset, whence)

    if how == "cut between look and write":
        monkeypatch.setattr(os, "lseek", cut_first)
    for second in range(1, 5):
        port.received(bytes([second]) * 50_000, float(second))
        port.flush(sync=False)
    assert path.stat().st_size == 200_000 and not port.take_holes()
    if how != "cut between look and write":
        content = bytearray(path.read_bytes())
        content[3 if how == "one bit" else 131_072] ^= 1
        path.write_bytes(content)
    journal.close()
    whole, from_s = {"one bit": (0, 0.0), "cut between look and write": (65_536, 1.0)}.get(
        how, (131_072, 2.0)
    )
    (hole,) = journal.take_holes()
    assert (hole.file, hole.whole_bytes, hole.written_bytes) == ("p.bin", whole, 200_000)
    assert hole.from_s == from_s


@pytest.mark.parametrize("size", [40, 39, 0])
def test_marks_that_were_cut_off_give_their_bytes_to_no_later_time(tmp_path, size):
    """The index loses marks; the bytes of these have the time of the last of them, not that of the next."""
    port, index = PortJournal(tmp_path, "p"), tmp_path / "raw" / "p.idx"
    for second in range(1, 6):
        port.received(b"0123456789", float(second))
        port.flush(sync=False)
        if second == 4:
            os.truncate(index, size)
    kept = size // 16
    assert marks(index) == [
        *([10 * s, s * 10**9] for s in range(1, kept + 1)),
        [40, 4 * 10**9],
        [50, 5 * 10**9],
    ]
    assert [(hole.file, hole.from_s) for hole in port.take_holes()] == [("p.idx", float(kept))]


def test_an_event_log_that_loses_lines_ends_the_run(tmp_path, journal):
    log = EventLog(tmp_path)
    journal.adopt(log)
    for number in range(3):
        log.event(float(number), Note("said"))
    journal._writer.call()
    os.truncate(tmp_path / "events.jsonl", 30)
    journal._writer.call()
    with pytest.raises(RecordError, match="lines are missing"):
        journal.check()
    log.event(3.0, Note("later"))
    journal._writer.call()
    journal.check()
    assert [line.time_s for line in read_events(tmp_path).lines] == [3.0]
