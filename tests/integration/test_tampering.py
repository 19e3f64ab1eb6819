"""A sealed run that somebody changed is found out; a raw file that loses bytes makes its run invalid."""

import hashlib
import json
import os
import select
import shutil

import pyarrow.parquet as pq
import pytest

from bench.control.procedure import Demands, Parameters, Procedure
from bench.control.run_record import decode_run
from bench.lab.emulated import EmulatedLab, Plant
from bench.present.report import report_run
from bench.record.events.run import Invalid
from bench.record.recording import Run, read_manifest, verify


def problems(folder):
    """Return what is wrong by file, the first of each."""
    return {problem.path: problem.text for problem in verify(folder, decode_run).problems[::-1]}


@pytest.fixture
def copy(short_run, tmp_path):
    return shutil.copytree(short_run, tmp_path / "run")


def edited(folder, change):
    """Change the manifest as an editor does: everything else stays byte for byte."""
    path = folder / "manifest.json"
    data = json.loads(path.read_text())
    change(data)
    path.write_text(json.dumps(data, indent=2, ensure_ascii=False) + "\n")


def resealed(folder):
    """Give the manifest a seal anew: what somebody does who has read how that is made."""
    path = folder / "manifest.json"
    content = path.read_bytes()
    seal = json.loads(content)["seal"].encode()
    unsealed = content.replace(seal, b"")
    new = hashlib.sha256(unsealed).hexdigest().encode()
    path.write_bytes(content.replace(seal, new))


def other_outcome(data):
    data["outcome"], data["reason"] = "aborted", "stopped"


def other_value(data):
    data["measurements"][0]["value"] = 0.01


def other_unit(data):
    data["units"]["fog_1"] = "FOG-999"


def no_lab(data):
    data["emulated"] = None


def no_events(data):
    del data["files"]["events.jsonl"]


def no_raw(data):
    del data["files"]["raw/fog_1.bin"]


CHANGES = [other_outcome, other_value, other_unit, no_lab, no_events, no_raw]


def test_a_run_is_sealed_and_verifies(short_run):
    report = verify(short_run, decode_run)
    assert report.passed and report.sealed
    manifest = (short_run / "manifest.json").read_bytes()
    seal = json.loads(manifest)["seal"].encode()
    assert hashlib.sha256(manifest.replace(seal, b"")).hexdigest().encode() == seal
    raw = {path: path.stat().st_size for path in (short_run / "raw").iterdir()}
    assert read_manifest(short_run).written == {f"raw/{path.name}": size for path, size in raw.items()}


@pytest.mark.parametrize("change", CHANGES)
def test_every_change_of_the_manifest_is_found(copy, change):
    edited(copy, change)
    assert problems(copy)["manifest.json"] == "changed after it was sealed"
    page = report_run(copy).read_text()
    assert "Record changed" in page and "Run valid" not in page


def test_a_single_byte_of_the_manifest_is_found(copy):
    path = copy / "manifest.json"
    path.write_bytes(path.read_bytes().replace(b"\n", b" \n", 1))
    assert problems(copy) == {"manifest.json": "changed after it was sealed"}


@pytest.mark.parametrize("change", [other_outcome, other_value, no_events, no_raw])
def test_who_makes_the_seal_anew_is_given_away_by_the_events_and_the_folder(copy, change):
    edited(copy, change)
    resealed(copy)
    assert problems(copy)


def test_a_seal_that_is_taken_off_is_missed(copy):
    edited(copy, lambda data: data.pop("seal"))
    assert problems(copy) == {"manifest.json": "its seal was taken off"}


@pytest.mark.parametrize("lines", [slice(0, -2), slice(1, None), slice(0, 0)])
def test_dropped_events_are_found(copy, lines):
    path = copy / "events.jsonl"
    path.write_bytes(b"".join(path.read_bytes().splitlines(keepends=True)[lines]))
    assert "events.jsonl" in problems(copy)


def test_a_truth_that_is_changed_taken_away_or_added_is_found(copy):
    path = copy / "truth_fog_1.npz"
    content = path.read_bytes()
    path.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    assert problems(copy).keys() == {path.name}
    path.unlink()
    assert problems(copy) == {path.name: "missing"}
    path.write_bytes(content)
    (copy / "truth_fog_2.npz").write_bytes(content)
    assert problems(copy) == {"truth_fog_2.npz": "not in the manifest"}


def test_what_is_put_beside_the_watchdogs_notes_is_found(copy):
    (copy / "watchdog").mkdir()
    (copy / "watchdog" / "events.jsonl").write_bytes(b"")
    assert problems(copy) == {"watchdog/events.jsonl": "not in the manifest"}


def test_a_run_of_before_the_seal_is_read_and_said_to_have_none(copy):
    path = copy / "events.jsonl"
    path.write_bytes(path.read_bytes().replace(b', "sealed": true', b""))

    def older(data):
        del data["seal"], data["written"], data["files"]["truth_fog_1.npz"]
        content = path.read_bytes()
        data["files"]["events.jsonl"] = {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}

    edited(copy, older)
    report = verify(copy, decode_run)
    assert report.passed and not report.sealed
    assert Run.open(copy).seal == "none" and "Run valid" in report_run(copy).read_text()


def cut_after_20_s(bench, p):
    """Wait 40 s; the file of the gyro's bytes is cut by half in the middle, if the mounting says so."""
    bench.wait(20.0, "before")
    path = bench._record.folder / "raw" / "fog_1.bin"
    while path.stat().st_size < 1000:  # the journal's thread writes four times a second
        select.select([], [], [], 0.01)
    if p.cut:
        os.truncate(path, path.stat().st_size // 2)
        bench._record._journal._writer.wake()
    bench.wait(20.0, "after")


class CutParameters(Parameters):
    cut: bool = True


CUT = Procedure(
    "cut", "A cut", "", CutParameters, cut_after_20_s, lambda _: 40.0, lambda _: Demands(1.0, 20.0, 25.0)
)


def test_a_raw_file_that_is_cut_during_a_run_makes_it_invalid_and_moves_no_sample_in_time(
    bench, fog_file, tmp_path
):
    """What comes after the hole has the times that it has in a run without one."""
    runs = {}
    for cut in (True, False):
        with EmulatedLab(fog_file, Plant(seed=3)) as lab:
            runs[cut] = bench.drive(lab.file, tmp_path / str(cut), CUT, cut=cut)
    assert runs[False].outcome == "completed", runs[False].reason
    assert runs[True].outcome == "invalid" and "fog_1.bin" in runs[True].reason
    run = Run.open(runs[True].folder)
    (hole,) = [invalid for _, invalid in run.of(Invalid)]
    assert (hole.code, hole.facts["file"]) == ("record_hole", "fog_1.bin")
    here, there = (
        pq.read_table(runs[cut].folder / "gyro_fog_1.parquet").to_pandas() for cut in (True, False)
    )
    assert 0.3 * len(there) < len(here) < len(there)
    both = here.merge(there, on="counter", suffixes=("", "_whole"))
    assert len(both) == len(here) and here["counter"].iloc[-1] == there["counter"].iloc[-1]
    assert (both["time_ns"] - both["time_ns_whole"]).abs().max() < 1_000_000
    assert (both["rate_dps"] == both["rate_dps_whole"]).all()
    lost = here["lost_before"].to_numpy()
    last_s = here["time_ns"][lost.argmax() - 1] * 1e-9
    # cut between the writer's look and its write, it is found at the end, from the start of a piece on
    assert hole.facts["from_s"] == 0.0 or 0.0 <= last_s - hole.facts["from_s"] < 0.5  # pieces of 0.4 s
    assert not problems(runs[True].folder)
