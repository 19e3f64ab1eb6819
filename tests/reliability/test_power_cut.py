"""A power cut: what was synced is there, and any part of what was written later. All of it can be read."""

import os
import random
import shutil
from pathlib import Path

import numpy as np
import pytest

from bench.control.recover import recover
from bench.control.run_record import RunRecord, decode_run
from bench.record.benchfile import bench_file_from
from bench.record.events.run import Note
from bench.record.recording import Run, verify
from drivers.base.errors import RecordError

FILE = {
    "bench": {"name": "power cut", "latitude_deg": 40.0},
    "table": {"driver": "acutrol3000", "port": "/nowhere/table"},
    "chamber": {"driver": "weiss", "port": "/nowhere/chamber"},
    "gyro": [{"name": "fog_1", "driver": "kvh1750", "unit": "F", "axis": "x", "port": "/nowhere/fog"}],
}
STREAM = np.random.default_rng(1).integers(0, 256, 40_000).astype(np.uint8).tobytes()


def stop_threads(record):
    """The test says when something is written and synced."""
    record._journal._writer.stop()
    record._journal._syncer.stop()


@pytest.fixture(scope="module")
def cut(tmp_path_factory):
    """A run as the disk has it in the middle of recording, and how much of each file had been synced by then."""
    folder = tmp_path_factory.mktemp("runs")
    synced, sync = {}, os.fdatasync

    def noted(descriptor):
        path = Path(f"/proc/self/fd/{descriptor}").readlink()
        size = os.fstat(descriptor).st_size
        sync(descriptor)
        synced[os.path.relpath(path, folder / "run")] = size

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fdatasync", noted)
        record = RunRecord.create(folder, "run", "test", {}, bench_file_from(FILE), None)
        stop_threads(record)
        ports = [record.tap(name) for name in ("fog_1", "table", "chamber")]
        record.stream_starts("fog_1", 0)
        for block in range(100):
            for port in ports:
                port.received(STREAM[400 * block : 400 * (block + 1)], 0.01 * block)
                port.sent(b"?\r\n", 0.01 * block)
            record.event(0.01 * block, Note(f"block {block}"))
            if block % 30 == 10:
                record._journal._write()
            if block == 40:
                record._journal._sync()
        before = dict(synced)  # first, then the copy: what is synced meanwhile counts as not
        record._journal._write()
        shutil.copytree(folder / "run", folder / "disk")
        record.close("completed", "", 1.0)
    assert before["raw/fog_1.bin"] >= 40 * 400 and before["events.jsonl"] > 0
    return folder / "disk", before


@pytest.mark.parametrize("seed", range(12))
def test_whatever_the_disk_had_taken_is_readable_and_holds_all_that_was_synced(cut, tmp_path, seed):
    disk, synced = cut
    draw, folder = random.Random(seed), tmp_path / "run"
    shutil.copytree(disk, folder)
    for path in [*(folder / "raw").iterdir(), folder / "events.jsonl"]:
        least, most = synced.get(os.path.relpath(path, folder), 0), path.stat().st_size
        os.truncate(path, draw.choice([least, most, draw.randint(least, most)]))
    manifest = recover(folder)
    assert manifest.outcome == "aborted" and manifest.reason.startswith("Recovered")
    assert not verify(folder, decode_run).problems
    raw = (folder / "raw" / "fog_1.bin").read_bytes()
    assert STREAM.startswith(raw) and len(raw) >= synced["raw/fog_1.bin"]
    notes = [row["text"] for row in Run.open(folder).events if str(row.get("text")).startswith("block ")]
    assert notes == [f"block {number}" for number in range(len(notes))] and len(notes) >= 40


def test_a_run_folder_whose_mount_is_gone_ends_the_run_with_the_bench_at_rest(tmp_path, monkeypatch):
    """The mount of the folder goes away: every call on it fails. What had been synced is still on the disk."""
    record = RunRecord.create(tmp_path, "run", "test", {}, bench_file_from(FILE), None)
    stop_threads(record)
    port = record.tap("fog_1")
    record.tap("table")
    record.tap("chamber")
    record.stream_starts("fog_1", 0)
    port.received(STREAM[:4000], 0.0)
    record._journal._write()
    write = os.write

    def gone(descriptor, data):
        if Path(f"/proc/self/fd/{descriptor}").readlink().is_relative_to(tmp_path):
            raise OSError(5, "Input/output error")
        return write(descriptor, data)

    with monkeypatch.context() as patch:
        patch.setattr(os, "write", gone)
        port.received(STREAM[4000:8000], 1.0)
        record._journal._try(record._journal._write)
        with pytest.raises(RecordError, match="Input/output error"):
            record.check()
        ending, _ = record.close("completed", "", 2.0)
    assert ending.outcome == "aborted" and "cannot be recorded any further" in ending.reason
    assert (tmp_path / "run" / "raw" / "fog_1.bin").read_bytes() == STREAM[:4000]
    assert not verify(tmp_path / "run", decode_run).problems
