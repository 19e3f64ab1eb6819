"""A disk that fails in one call: the record is sealed for what it is, or left for `runs recover`."""

import errno
import os
from pathlib import Path

import numpy as np
import pytest

from bench.control.recover import recover
from bench.control.run_record import RunRecord, decode_run
from bench.record.benchfile import bench_file_from
from bench.record.recording import Journal, read_events, read_manifest, verify
from drivers.base.errors import RecordError

pytestmark = pytest.mark.concurrent

FILE = {
    "bench": {"name": "failing disk", "latitude_deg": 40.0},
    "table": {"driver": "acutrol3000", "port": "/nowhere/table"},
    "chamber": {"driver": "weiss", "port": "/nowhere/chamber"},
    "gyro": [{"name": "fog_1", "driver": "kvh1750", "unit": "F", "axis": "x", "port": "/nowhere/fog"}],
}
STREAM = np.random.default_rng(1).integers(0, 256, 4000).astype(np.uint8).tobytes()


def begun(folder):
    record = RunRecord.create(folder, "run", "test", {}, bench_file_from(FILE), None)
    ports = {name: record.tap(name) for name in ("fog_1", "table", "chamber")}
    record.stream_starts("fog_1", 17)
    for block in range(10):
        for port in ports.values():
            port.received(STREAM[400 * block : 400 * (block + 1)], 0.01 * block)
    return record


def failing(monkeypatch, name, when):
    """Have a function of `os` fail with EIO whenever `when` says so of its arguments; return what was asked."""
    real = getattr(os, name)

    def call(*args, **kwargs):
        if when(*args):
            raise OSError(errno.EIO, "Input/output error")
        return real(*args, **kwargs)

    monkeypatch.setattr(os, name, call)


def file_of(descriptor):
    return Path(f"/proc/self/fd/{descriptor}").readlink().name


def only(count):
    """Return a counter that says yes once, the `count`-th time."""
    asked = iter(range(1, 1_000_000))
    return lambda: next(asked) == count


def test_a_file_that_cannot_be_asked_for_its_length_is_told_in_words(tmp_path, monkeypatch):
    journal = Journal(tmp_path, 1.0)
    journal._writer.stop()
    journal._syncer.stop()
    journal.port("p").received(b"abc", 0.5)
    with monkeypatch.context() as patch:
        failing(patch, "lseek", lambda fd, *_: file_of(fd) == "p.bin")
        journal._try(journal._write)
        with pytest.raises(RecordError, match="cannot be recorded any further"):
            journal.check()
    journal.close()
    assert (tmp_path / "raw" / "p.bin").read_bytes() == b"abc"


def test_a_folder_that_cannot_be_asked_for_is_told_in_words(tmp_path, monkeypatch):
    journal = Journal(tmp_path, 1.0)
    journal._syncer.stop()
    with monkeypatch.context() as patch:
        failing(patch, "stat", lambda path, *_: path == tmp_path)
        journal._try(journal._sync)
        with pytest.raises(RecordError, match="cannot be recorded any further"):
            journal.check()
    journal.close()


def test_a_read_that_hands_over_less_than_was_asked_is_no_hole(tmp_path, monkeypatch):
    record, read = begun(tmp_path), os.read
    monkeypatch.setattr(os, "read", lambda fd, count: read(fd, max(1, count // 2)))
    manifest, _ = record.close("completed", "", 1.0)
    assert (manifest.outcome, manifest.reason) == ("completed", "")


@pytest.mark.parametrize("call", ["write", "fdatasync"])
def test_a_run_whose_end_is_not_in_its_events_is_aborted(tmp_path, monkeypatch, call):
    """The last event is the only one of its log, and so is the sync behind it."""
    record = begun(tmp_path)
    record._journal.close()
    strike = only(1)
    with monkeypatch.context() as patch:
        failing(patch, call, lambda fd, *_: file_of(fd) == "events.jsonl" and strike())
        manifest, _ = record.close("completed", "", 1.0)
    assert manifest.outcome == "aborted" and "cannot be recorded any further" in manifest.reason
    assert read_events(tmp_path / "run").rows[-1]["outcome"] == "aborted"
    assert verify(tmp_path / "run", decode_run).passed


def test_a_stream_that_could_not_be_decoded_keeps_its_start(tmp_path, monkeypatch):
    record = begun(tmp_path)
    strike = only(1)
    with monkeypatch.context() as patch:
        failing(patch, "stat", lambda path, *_: str(path).endswith("raw/table.bin") and strike())
        manifest, _ = record.close("completed", "", 1.0)
    assert manifest.outcome == "aborted" and "could not be decoded" in manifest.reason
    assert manifest.stream["fog_1"]["start_offset"] == 17
    assert verify(tmp_path / "run", decode_run).passed  # that it has no tables is said in its reason


def test_a_run_that_cannot_be_sealed_is_told_and_recovered_later(tmp_path, monkeypatch):
    record = begun(tmp_path)
    with monkeypatch.context() as patch:
        failing(patch, "stat", lambda path, *_: str(path).endswith("events.jsonl"))
        with pytest.raises(RecordError, match="cannot be recorded any further"):
            record.close("completed", "", 1.0)
    assert read_manifest(tmp_path / "run").outcome == "running"
    assert recover(tmp_path / "run").outcome == "aborted"
    assert verify(tmp_path / "run", decode_run).passed
    assert (tmp_path / "run" / "raw" / "fog_1.bin").read_bytes() == STREAM


def test_an_event_log_that_cannot_be_read_is_told_in_words(tmp_path):
    (tmp_path / "events.jsonl").mkdir()
    with pytest.raises(RecordError, match="the event log cannot be read"):
        read_events(tmp_path)
