"""Runs on S3 (moto's server, over HTTP): read as from a disk, of tables the stretch asked for, damage is seen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from bench.present.cli._app import app
from bench.record.events.run import Outcome, PhaseBegun
from bench.record.recording import (
    EventLog,
    Manifest,
    Run,
    decode_stream,
    read_manifest,
    read_table,
    seal,
    verify,
    write_manifest,
)
from bench.record.recording._remote import local_manifests, local_run
from bench.record.run_folder import url_of
from drivers.base.errors import RecordError

START = "2026-11-21T00:00:00.000+00:00"


@pytest.fixture
def kept(tmp_path: Path, fake: Any) -> Path:
    """A sealed run on the disk."""
    folder = tmp_path / "runs" / "r1"
    folder.mkdir(parents=True)
    facts = {
        "run_id": "r1",
        "procedure": "zero-bias-cold-shock",
        "started_utc": START,
        "units": {"fog": "F-1"},
    }
    write_manifest(folder, Manifest(**facts))
    log = EventLog(folder)
    log.event(0.0, PhaseBegun("warm_up"))
    log.event(20.0, Outcome("completed", ""))
    log.close()
    fake.record(folder, range(2000), 0.01)
    decode_stream(folder, fake.source())
    seal(folder, Manifest(**facts, outcome="completed", ended_utc=START, duration_s=20.0))
    return folder


def test_a_run_on_s3_reads_as_the_one_on_the_disk(bucket: Any, kept: Path, tmp_path: Path) -> None:
    storage, name = bucket
    storage.put(str(kept), f"{name}/runs/r1", recursive=True)
    far, near = Run.open(f"s3://{name}/runs/r1"), Run.open(kept)
    assert (far.manifest, far.events, far.gyros) == (near.manifest, near.events, near.gyros)
    for stretch in ((None, None), (4.0, 9.0)):
        ours, theirs = far.gyro("fog", None, *stretch), near.gyro("fog", None, *stretch)
        assert list(ours) == list(theirs)
        assert all(np.array_equal(ours[column], theirs[column], equal_nan=True) for column in ours)
    assert not list((tmp_path / "cache").rglob("*.parquet")), "a table was copied whole"
    assert not list((tmp_path / "cache").rglob("*.bin")), "raw bytes were copied"
    with pytest.raises(RecordError, match="no such table"):
        far.chamber()


def test_a_run_on_s3_verifies_and_damage_is_named(bucket: Any, kept: Path, fake: Any) -> None:
    storage, name = bucket
    storage.put(str(kept), f"{name}/runs/r1", recursive=True)

    def decode(folder: Path, out: Path) -> None:
        decode_stream(folder, fake.source(), out)

    url = Path(f"s3://{name}/runs/r1")  # as a command line gives it: one slash is gone
    assert verify(url, decode).passed
    raw = bytearray((kept / "raw" / "fog.bin").read_bytes())
    raw[100] ^= 1
    storage.pipe(f"{name}/runs/r1/raw/fog.bin", bytes(raw))
    assert "raw/fog.bin" in {problem.path for problem in verify(url, decode).problems}


def test_arrivals_of_a_run_on_s3_are_those_on_the_disk(bucket: Any, kept: Path, fake: Any) -> None:
    storage, name = bucket
    storage.put(str(kept), f"{name}/runs/r1", recursive=True)
    far = Run.open(f"s3://{name}/runs/r1")
    assert far.has_arrivals("fog") and not far.has_arrivals("table")
    found = far.arrivals(fake.source())
    assert found.count.tolist() == list(range(2000))
    assert found.arrival_s == pytest.approx(1.0 + 0.01 * np.arange(2000))


def test_only_what_is_not_in_the_cache_as_it_was_sealed_is_fetched_again(bucket: Any, kept: Path) -> None:
    """Small files beside the sealed ones come with a new manifest only: nothing else tells of their change."""
    storage, name = bucket
    for extra in ("a.txt", "z.txt"):
        (kept / extra).write_text("first")
    storage.put(str(kept), f"{name}/runs/r1", recursive=True)
    folder = local_run(f"s3://{name}/runs/r1")
    for file in ("a.txt", "events.jsonl", "z.txt"):
        (folder / file).write_bytes(b"x" * (folder / file).stat().st_size)
    (folder / "z.txt").unlink()
    assert local_run(f"s3://{name}/runs/r1") == folder
    assert (folder / "events.jsonl").read_bytes() == (kept / "events.jsonl").read_bytes()
    assert (folder / "a.txt").read_text() == "xxxxx" and (folder / "z.txt").read_text() == "first"
    seal(kept, read_manifest(kept), reason="sealed anew")
    storage.put(str(kept / "manifest.json"), f"{name}/runs/r1/manifest.json")
    local_run(f"s3://{name}/runs/r1")
    assert (folder / "a.txt").read_text() == "first"


def test_a_cache_that_somebody_cleared_is_filled_again(bucket: Any, kept: Path) -> None:
    storage, name = bucket
    storage.put(str(kept), f"{name}/runs/r1", recursive=True)
    folder = local_manifests(Path(f"s3://{name}/runs"))
    (folder / "r1" / "manifest.json").unlink()
    storage.rm(f"{name}/runs/r1", recursive=True)
    assert not list(local_manifests(Path(f"s3://{name}/runs")).glob("*/manifest.json"))


def test_the_list_follows_what_lies_in_the_bucket(bucket: Any, kept: Path) -> None:
    storage, name = bucket
    for run in ("r1", "r2"):
        storage.put(str(kept), f"{name}/runs/{run}", recursive=True)
    command = ["runs", "list", f"s3://{name}/runs", "--json"]
    assert CliRunner().invoke(app, command).output.count('"completed"') == 2
    storage.rm(f"{name}/runs/r2", recursive=True)
    assert CliRunner().invoke(app, command).output.count('"completed"') == 1
    shown = CliRunner().invoke(app, ["runs", "show", f"s3://{name}/runs/r1"])
    assert "zero-bias-cold-shock" in shown.output


@pytest.mark.parametrize(
    ("path", "text"), [("runs/none", "not a run folder|no such place"), ("runs", "not a run folder")]
)
def test_a_url_without_a_run_is_refused(bucket: Any, kept: Path, path: str, text: str) -> None:
    storage, name = bucket
    storage.put(str(kept), f"{name}/runs/r1", recursive=True)
    with pytest.raises(RecordError, match=text):
        Run.open(f"s3://{name}/{path}")


def test_a_storage_that_nobody_knows_is_refused() -> None:
    with pytest.raises(RecordError, match="storage cannot be read"):
        Run.open("gopher://host/run")


@pytest.mark.parametrize(
    ("place", "url"),
    [
        ("s3://bucket/runs/a/", "s3://bucket/runs/a"),
        (Path("s3://bucket/runs/a"), "s3://bucket/runs/a"),
        ("/srv/runs/a", ""),
        ("runs/a", ""),
        ("C:/runs/a", ""),
        (Path("runs/x:/a"), ""),
    ],
)
def test_urls_are_told_from_paths(place: Path | str, url: str) -> None:
    assert url_of(place) == url


def test_a_local_path_costs_no_import(kept: Path) -> None:
    import subprocess
    import sys

    opened = f"from bench.record.recording import Run; Run.open({str(kept)!r})"
    code = f"import sys; {opened}; print('fsspec' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout == "False\n"
    assert len(read_table(kept / "gyro_fog.parquet")["time_ns"]) == 2000


def test_a_run_that_goes_on_is_read_as_it_is_now(bucket: Any, kept: Path, tmp_path: Path) -> None:
    """Uploaded while it is open, and again later: its events are longer, its manifest is the same."""
    storage, name = bucket
    running = tmp_path / "running"
    running.mkdir()
    write_manifest(running, Manifest(run_id="r2", procedure="own", started_utc=START, units={"fog": "F-1"}))
    log = EventLog(running)
    found = []
    for phase in ("warm_up", "reference"):
        log.event(10.0, PhaseBegun(phase))
        for path in running.iterdir():
            storage.put(str(path), f"{name}/runs/r2/{path.name}")
        found.append([event.phase for _, event in Run.open(f"s3://{name}/runs/r2").of(PhaseBegun)])
    log.close()
    assert found == [["warm_up"], ["warm_up", "reference"]]
