"""A folder that a crash left is completed: readable, verified, and never taken for a run that was completed."""

import json
import os
from pathlib import Path

import pytest

from bench.control.lease import take_lease
from bench.control.recover import recover
from bench.control.run_record import RunRecord, decode_run
from bench.record.benchfile import BenchFile, load_bench_file
from bench.record.events.run import Invalid, Measured, PhaseBegun
from bench.record.events.safe import Takeover, TakeoverEnded
from bench.record.recording import Run, read_manifest, verify
from drivers.base.errors import BenchInUse, RecordError

BENCH = """
[bench]
name = "b"
latitude_deg = 40.0
[table]
driver = "acutrol3000"
port = "/dev/ttyT0"
[chamber]
driver = "weiss"
port = "/dev/ttyC0"
[[gyro]]
name = "fog_1"
driver = "kvh1750"
unit = "F1"
axis = "x"
port = "/dev/ttyG0"
"""


def left_open(bench: Path, runs: Path, run_id: str = "r") -> tuple[BenchFile, Path]:
    """Return bench and folder of a run that was never closed, its last event and last mark cut in the middle."""
    bench.write_text(BENCH)
    file = load_bench_file(bench)
    record = RunRecord.create(runs, run_id, "test", {}, file, None)
    port = record.tap("fog_1")
    record.tap("table")
    record.tap("chamber")
    record.stream_starts("fog_1", 4)
    port.received(b"idle" + bytes(36), 3.0)
    record.event(1.0, PhaseBegun("a"))
    record.event(2.0, Measured("m", 1.0, "K", None, None, True))
    record._journal.close()
    record._events.close()
    with (record.folder / "events.jsonl").open("ab") as log:
        log.write(b'{"time_s": 9.0, "ki')
    with (record.folder / "raw" / "fog_1.idx").open("ab") as index:
        index.write(b"\x01\x02\x03")
    return file, record.folder


@pytest.fixture
def crashed(tmp_path):
    return left_open(tmp_path / "lab.toml", tmp_path / "runs")


def test_what_a_crash_left_is_completed_as_aborted_and_verifies(crashed):
    _, folder = crashed
    assert read_manifest(folder).outcome == "running"
    assert read_manifest(folder).stream == {"fog_1": {"start_offset": 4}}
    assert read_manifest(folder).flush_interval_s == 1.0
    manifest = recover(folder)
    assert manifest.outcome == "aborted" and manifest.reason.startswith("Recovered")
    assert manifest.duration_s == 3.0 and manifest.measurements[0]["name"] == "m"
    rows = Run.open(folder).events
    assert rows[-1]["outcome"] == "aborted" and any("cut off" in str(row.get("text")) for row in rows)
    assert not verify(folder, decode_run).problems
    assert (folder / "raw" / "fog_1.idx").stat().st_size == 16  # the torn mark is cut off
    before = (folder / "manifest.json").read_bytes()
    recover(folder)
    assert (folder / "manifest.json").read_bytes() == before


def test_a_raw_file_that_a_power_cut_left_shorter_than_its_index_is_told_with_the_time(crashed):
    """Its marks are cut to what is there: nobody reads on past the end."""
    _, folder = crashed
    os.truncate(folder / "raw" / "fog_1.bin", 10)
    assert "lacks 30 bytes" in verify(folder, decode_run).problems[1].text
    recover(folder)
    (hole,) = [invalid for _, invalid in Run.open(folder).of(Invalid)]
    assert (hole.code, hole.facts) == ("record_hole", {"file": "fog_1.bin", "from_s": 0.0})
    assert (folder / "raw" / "fog_1.idx").stat().st_size == 0
    assert not verify(folder, decode_run).problems


def test_a_disk_without_inodes_is_told_and_the_run_can_be_recovered_later(crashed, monkeypatch):
    _, folder = crashed

    def full(folder):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("bench.control.recover.decode_run", full)
        with pytest.raises(RecordError, match="No space left"):
            recover(folder)
    assert read_manifest(folder).outcome == "running"
    assert recover(folder).outcome == "aborted" and not verify(folder, decode_run).problems


def test_a_run_whose_lease_is_still_held_is_left_alone(crashed):
    file, folder = crashed
    with take_lease(file, "run s"):
        going_on = RunRecord.create(folder.parent, "s", "test", {}, file, None).folder
        with pytest.raises(BenchInUse, match="may still be going on"):
            recover(going_on)
    assert read_manifest(going_on).outcome == "running"


def test_who_took_the_bench_after_the_run_began_does_not_hold_up_its_recovery(crashed, monkeypatch):
    """A later run, or another lab whose terminals have the numbers that the killed one's had."""
    file, folder = crashed
    monkeypatch.setattr("bench.control.lease.utc_now", lambda: "2999-01-01T00:00:00.000+00:00")
    with take_lease(file, "run of another lab"):
        assert recover(folder).outcome == "aborted"


def test_what_the_watchdog_did_is_told(crashed):
    _, folder = crashed
    (folder / "watchdog").mkdir()
    events = (Takeover("runner_silent", "2026-11-22T10:00:00+00:00", 7, 2.13), TakeoverEnded(True))
    rows = "".join(json.dumps(event.row(time_s)) + "\n" for time_s, event in enumerate(events))
    (folder / "watchdog" / "events.jsonl").write_text(rows)
    assert "took over (no sign of life for 2.1 s): made safe" in recover(folder).reason
