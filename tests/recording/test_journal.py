"""The raw journal: what was handed in is on disk byte for byte, and trouble with the disk is told."""

import resource
import shutil
import signal

import numpy as np
import pytest

from bench.recording import Journal, PortJournal
from drivers.errors import RecordError


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


def test_nothing_is_written_before_the_interval_has_passed(tmp_path):
    journal = Journal(tmp_path, flush_interval_s=1.0)
    port = journal.port("p")
    journal.maybe_flush(0.0)
    port.received(b"x" * 100, 0.5)
    journal.maybe_flush(0.9)
    assert (tmp_path / "raw" / "p.bin").stat().st_size == 0
    journal.close()
    assert (tmp_path / "raw" / "p.bin").stat().st_size == 100


def test_in_virtual_time_a_megabyte_is_written_without_waiting_for_the_wall(tmp_path):
    journal = Journal(tmp_path, flush_interval_s=1.0)
    port = journal.port("p")
    for second in range(1, 5):
        port.received(b"x" * 300_000, float(second))
        journal.maybe_flush(float(second))
    assert (tmp_path / "raw" / "p.bin").stat().st_size == 1_200_000
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
    port.flush(sync=True)
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
