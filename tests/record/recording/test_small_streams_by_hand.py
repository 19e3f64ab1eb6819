"""Streams of one and two frames, counters of many ticks, files that the system does not give back."""

import errno
import hashlib
import os

import numpy as np
import pytest

from bench.record.recording import Manifest, Run, read_table, table_writer, write_manifest
from bench.record.recording._decode import decode_stream
from bench.record.recording._events import AppendFile
from bench.record.recording._remote import local_run
from bench.record.recording._tables import ROW_GROUP
from bench.record.recording._timing import StreamTimer, _rough_period_s
from drivers.base.errors import RecordError

START = "2026-11-21T00:00:00.000+00:00"


def marks(arrival_s, size=10):
    ends = size * np.arange(1, len(arrival_s) + 1)
    return ends, np.column_stack((ends, np.rint(np.asarray(arrival_s) * 1e9).astype(np.int64)))


def fed(counter, arrival_s, block, *, step=16.0, rate_hz=125.0, modulo=256):
    timer = StreamTimer(modulo, step, rate_hz)
    ends, index = marks(arrival_s)
    for at in range(0, len(counter), block):
        timer.feed(np.asarray(counter[at : at + block], np.int64), ends[at : at + block], index)
    return timer


@pytest.mark.parametrize("count", [1, 2, 3])
def test_the_first_frames_of_a_stream_are_neither_lost_nor_twice(tmp_path, fake, count):
    """The counter of the frame before the first is not known: it is taken to be one less."""
    fake.record(tmp_path, np.arange(5, 5 + count), 0.01)
    report = decode_stream(tmp_path, fake.source())
    assert (report.frames, report.lost, report.duplicates, report.invalid) == (count, 0, 0, 0)
    assert read_table(tmp_path / "gyro_fog.parquet")["lost_before"].tolist() == [0] * count


@pytest.mark.parametrize("block", [1, 2, 7, 1000])
def test_the_step_of_a_counter_does_not_depend_on_how_the_first_frames_come(block):
    """16 ticks a sample at 125 Hz; a batch of one frame tells no step, and later losses make none."""
    sample = np.concatenate((np.arange(200), 200 + 2 * np.arange(200)))
    timing = fed(16 * sample % 256, 1.0 + 0.008 * sample, block).fit()
    assert timing.counter_step == 16.0
    assert timing.sample_rate_hz == pytest.approx(125.0, rel=1e-6)


def test_what_was_lost_before_the_last_arrival_is_not_taken_for_what_is_lost_behind_it():
    """Ten frames an arrival. Within the first ten 4 samples are lost; behind them a wrap of 16 and one."""
    sample = np.arange(400)
    sample[6:] += 4
    sample[13:] += 17
    ends = 10 * np.arange(1, 401)
    index = np.arange(9, 400, 10)
    arrival_ns = np.rint(1e9 * (1.0 + 0.008 * sample[index])).astype(np.int64)
    timer = StreamTimer(256, 16.0, 125.0)
    for at in range(0, 400, 10):
        timer.feed(
            16 * sample[at : at + 10] % 256, ends[at : at + 10], np.column_stack((ends[index], arrival_ns))
        )
    assert timer.fit().corrections.tolist() == [[13, 256]]


def test_the_rough_period_leaves_out_windows_behind_a_suspect_frame():
    """The first frame of all may be the suspect one: its number is 0, which is none of -1."""
    count, arrival_s = np.array([0, 100, 200]), np.array([0.0, 9.0, 10.0])
    assert _rough_period_s(count, arrival_s, np.array([-1, 0, -1]), 0.5) == pytest.approx(0.01)


@pytest.mark.parametrize(("gaps", "odd", "regular"), [(8, 2, True), (10, 2, True), (10, 3, False)])
def test_batches_are_regular_if_three_of_four_times_between_them_are(gaps, odd, regular):
    """Of so many gaps of 16 ms `odd` are of 40 ms."""
    gaps_s = np.full(gaps, 0.016)
    gaps_s[1 : 1 + odd] = 0.040
    index = 4 * np.arange(1, gaps + 2) - 1
    timer = StreamTimer(1 << 20, 1.0, 250.0)
    ends = 10 * np.arange(1, 4 * gaps + 5)
    arrival_s = 1.0 + np.concatenate(([0.0], np.cumsum(gaps_s)))
    timer.feed(
        np.arange(4 * gaps + 4),
        ends,
        np.column_stack((ends[index], np.rint(arrival_s * 1e9).astype(np.int64))),
    )
    assert (timer._batch() is not None) is regular


def refuses(*_):
    raise OSError(errno.EIO, "Input/output error")


@pytest.mark.parametrize(
    ("call", "what"), [("ftruncate", "restart"), ("close", "close"), ("lseek", "whole_to")]
)
def test_an_error_of_the_system_is_told_as_one_of_the_record(tmp_path, monkeypatch, call, what):
    file = AppendFile(tmp_path / "f.bin")
    file.pending += b"abc"
    file.write()
    with monkeypatch.context() as patched, pytest.raises(RecordError, match="Input/output error"):
        patched.setattr(os, call, refuses)
        file.restart(0) if what == "restart" else getattr(file, what)()


def test_a_loss_at_the_very_beginning_that_was_told_is_not_told_as_a_change(tmp_path):
    """Cut to nothing and told so: what stands in the first piece now is known to be gone."""
    file = AppendFile(tmp_path / "f.bin")
    file.pending += b"abcdef"
    file.write()
    (tmp_path / "f.bin").write_bytes(b"")
    assert file.whole_to() == 0
    assert file.as_written_to() is None
    file.close()


def test_a_table_that_ends_with_its_row_group_has_no_empty_one_behind_it(tmp_path):
    with table_writer(tmp_path / "t.parquet", "a table") as writer:
        writer.write({"time_ns": np.arange(ROW_GROUP)})
    assert len(read_table(tmp_path / "t.parquet")["time_ns"]) == ROW_GROUP


@pytest.mark.parametrize("rows", [0, 3])
def test_a_table_of_few_rows_is_written_whole(tmp_path, rows):
    with table_writer(tmp_path / "t.parquet", "a table") as writer:
        writer.write({"time_ns": np.arange(rows), "rate_dps": np.zeros(rows, np.float32)})
    assert {name: len(column) for name, column in read_table(tmp_path / "t.parquet").items()} == {
        "time_ns": rows,
        "rate_dps": rows,
    }


@pytest.mark.parametrize(("reason", "shown"), [("", "aborted"), ("too hot", "aborted (too hot)")])
def test_a_run_shows_its_outcome_with_the_reason_and_has_its_manifests_digest(tmp_path, reason, shown):
    (tmp_path / "raw").mkdir()
    manifest = Manifest(run_id="r1", procedure="p", started_utc=START, outcome="aborted", reason=reason)
    write_manifest(tmp_path, manifest)
    (tmp_path / "events.jsonl").write_bytes(b"")
    run = Run.open(tmp_path)
    assert run.shown()["outcome"] == shown and run.shown()["run"] == "r1"
    assert run.checksum == hashlib.sha256((tmp_path / "manifest.json").read_bytes()).hexdigest()


def test_a_folder_that_cannot_be_listed_says_why(tmp_path, monkeypatch):
    write_manifest(tmp_path, Manifest(run_id="r1", procedure="p", started_utc=START))

    def denied(self, pattern):
        raise PermissionError(errno.EACCES, "Permission denied")

    monkeypatch.setattr(type(tmp_path), "glob", denied)
    with pytest.raises(RecordError, match=r"cannot be read.*Found: Permission denied"):
        local_run(tmp_path)
