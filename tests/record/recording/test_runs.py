"""Manifest, verification and reading of run folders."""

import json
import shutil
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from bench.record.events.run import Outcome, PhaseBegun
from bench.record.recording import (
    EventLog,
    Manifest,
    Run,
    decode_stream,
    read_manifest,
    read_table,
    seal,
    second_rows,
    seconds,
    table_writer,
    verify,
    write_manifest,
)
from drivers.base.errors import RecordError


def manifest(**changes):
    fields = {
        "run_id": "r1",
        "procedure": "zero-bias-cold-shock",
        "started_utc": "2026-11-21T00:00:00.000+00:00",
    }
    return Manifest(**(fields | changes))


def make_run(folder, fake, samples=range(2000), outcome="completed"):
    folder.mkdir(exist_ok=True)
    write_manifest(folder, manifest())
    log = EventLog(folder)
    for time_s, phase in ((0.0, "warm_up"), (3.5, "shock"), (12.0, "return")):
        log.event(time_s, PhaseBegun(phase))
    log.event(20.0, Outcome(outcome, ""))
    log.close()
    fake.record(folder, samples, 0.01)
    decode_stream(folder, fake.source())
    return seal(folder, manifest(outcome=outcome, parameters={"shock_rate_k_per_min": 12.5}))


@pytest.fixture(scope="module")
def sealed(tmp_path_factory, request):
    return tmp_path_factory.mktemp("sealed") / "run"


@pytest.fixture
def run(sealed, fake):
    """A sealed run, made once; tests that damage it take a copy."""
    if not sealed.exists():
        make_run(sealed, fake)
    return sealed


@pytest.fixture
def decode(fake):
    return lambda folder, out: decode_stream(folder, fake.source(), out)


def test_a_sealed_run_verifies(run, decode):
    report = verify(run, decode)
    assert report.passed, report.problems
    assert report.files == 6
    assert report.tables == 1


def test_checksums_are_those_of_sha256sum(run):
    import hashlib

    entry = json.loads((run / "manifest.json").read_text())["files"]["raw/fog.bin"]
    content = (run / "raw" / "fog.bin").read_bytes()
    assert entry == {"sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content)}


@settings(max_examples=30, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(pick=st.integers(0, 5), where=st.floats(0, 1, exclude_max=True), bit=st.integers(0, 7))
def test_a_single_flipped_bit_in_any_file_is_found_and_named(run, decode, tmp_path_factory, pick, where, bit):
    copy = tmp_path_factory.mktemp("copy") / "run"
    shutil.copytree(run, copy)
    names = [name for name, entry in sorted(read_manifest(copy).files.items()) if entry.bytes]
    name = names[pick % len(names)]
    content = bytearray((copy / name).read_bytes())
    content[int(where * len(content))] ^= 1 << bit
    (copy / name).write_bytes(content)
    report = verify(copy, decode)
    assert name in [problem.path for problem in report.problems]
    shutil.rmtree(copy)


def test_a_table_edited_with_its_checksum_is_still_found(run, decode, fake, tmp_path):
    """Whoever changes a value and repairs the checksum is given away by the raw bytes."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    table = pq.read_table(copy / "gyro_fog.parquet")
    rate = table["rate_dps"].to_numpy().copy()
    rate[1234] += 1.0
    at = table.column_names.index("rate_dps")
    table = table.set_column(at, table.schema.field(at), pa.array(rate))
    pq.write_table(table, copy / "gyro_fog.parquet")
    seal(copy, read_manifest(copy))
    (problem,) = verify(copy, decode).problems
    assert problem.path == "gyro_fog.parquet"
    assert "rate_dps differs from row 1234 on: 123401.0, rebuilt 123400.0" in problem.text


def test_missing_and_additional_files_are_named(run, decode, tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    (copy / "gyro_fog.parquet").unlink()
    (copy / "raw" / "other.bin").write_bytes(b"x")
    paths = {problem.path: problem.text for problem in verify(copy, decode).problems}
    assert paths == {
        "gyro_fog.parquet": "missing",
        "raw/other.bin": "not in the manifest",
    }


def test_a_table_that_the_manifest_does_not_know_and_one_without_raw_bytes_are_named(run, decode, tmp_path):
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    shutil.copy(copy / "gyro_fog.parquet", copy / "gyro_ghost.parquet")
    (problem,) = verify(copy, decode).problems
    assert (problem.path, problem.text) == ("gyro_ghost.parquet", "not in the manifest")
    seal(copy, read_manifest(copy), outcome="completed")
    assert "cannot be rebuilt: the raw bytes hold nothing for it" in {
        problem.text for problem in verify(copy, decode).problems if problem.path == "gyro_ghost.parquet"
    }


def test_a_run_that_was_killed_is_not_complete_and_says_so(tmp_path, fake, decode):
    write_manifest(tmp_path, manifest())
    fake.record(tmp_path, range(100), 0.01)
    run = Run.open(tmp_path)
    assert not run.complete
    assert run.manifest.outcome == "running"
    assert "never closed" in verify(tmp_path, decode).problems[0].text
    with pytest.raises(RecordError, match="raw bytes only"):
        run.gyro("fog")


def test_the_manifest_is_replaced_in_one_piece(tmp_path, monkeypatch):
    write_manifest(tmp_path, manifest())
    before = (tmp_path / "manifest.json").read_bytes()

    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(RecordError, match="No space left"):
        write_manifest(tmp_path, manifest(outcome="completed"))
    assert (tmp_path / "manifest.json").read_bytes() == before


def test_a_running_run_is_not_sealed(tmp_path):
    with pytest.raises(RecordError, match="cannot be sealed"):
        seal(tmp_path, manifest())


@pytest.mark.parametrize("content", [b"", b"{", b"[]", b'{"format": 2}', b'{"format":1,"run_id":"a","x":1}'])
def test_a_damaged_manifest_is_told(tmp_path, content):
    (tmp_path / "manifest.json").write_bytes(content)
    with pytest.raises(RecordError, match="manifest cannot be read"):
        Run.open(tmp_path)


def test_a_folder_that_is_no_run_is_told(tmp_path):
    with pytest.raises(RecordError, match="not a run folder"):
        Run.open(tmp_path)


def test_phases_last_until_the_next(run):
    got = [(phase.name, phase.start_s, phase.end_s) for phase in Run.open(run).phases()]
    assert got == [("warm_up", 0.0, 3.5), ("shock", 3.5, 12.0), ("return", 12.0, 20.0)]


def test_a_stretch_of_some_columns_is_read(run):
    opened = Run.open(run)
    assert opened.gyros == ("fog",)
    got = opened.gyro("fog", ["counter", "temp_c"], start_s=5.995, end_s=6.495)
    assert list(got) == ["counter", "temp_c"]
    assert got["counter"].tolist() == list(range(500, 550))
    assert len(opened.gyro("fog", ["counter"], start_s=100.0)["counter"]) == 0
    times = seconds(opened.gyro("fog", ["time_ns"]))
    assert times == pytest.approx(1.0 + 0.01 * np.arange(2000), abs=1e-8)


def test_unknown_columns_and_tables_are_told_with_what_there_is(run):
    opened = Run.open(run)
    with pytest.raises(RecordError, match=r"rate_dpz.*rate_dps"):
        opened.gyro("fog", ["rate_dpz"])
    with pytest.raises(RecordError, match="chamber"):
        opened.chamber()


def test_only_overlapping_row_groups_are_read(tmp_path):
    import pyarrow.parquet as pq

    from bench.record.recording._read import _overlapping

    with table_writer(tmp_path / "t.parquet", "t") as writer:
        writer.write({"time_ns": np.arange(300_000) * 10_000_000})
    file = pq.ParquetFile(tmp_path / "t.parquet")
    edge = 65536 * 10_000_000
    assert _overlapping(file, 0, edge) == ([0], True)
    assert _overlapping(file, 0, edge - 10_000_000) == ([0], False)
    assert _overlapping(file, 1, edge) == ([0], False)
    assert _overlapping(file, edge, edge + 1) == ([1], False)
    assert _overlapping(file, edge - 10_000_000, 3 * edge + 1) == ([0, 1, 2, 3], False)
    assert _overlapping(file, edge - 9_999_999, 3 * edge) == ([1, 2], True)


def test_a_stretch_is_the_whole_cut_at_its_ends(tmp_path):
    path = tmp_path / "t.parquet"
    times = np.arange(200_000, dtype=np.int64) * 10_000_000
    with table_writer(path, "t") as writer:
        writer.write({"time_ns": times, "x": np.arange(200_000, dtype=np.float64)})
    edge_s = 655.36
    for start_s, end_s in (
        (None, None),
        (0.0, edge_s),
        (0.0, 5e-9),
        (edge_s, None),
        (3.005, 2 * edge_s),
        (1e4, None),
    ):
        low, high = (
            (-np.inf if start_s is None else start_s * 1e9),
            (np.inf if end_s is None else end_s * 1e9),
        )
        expected = np.flatnonzero((times >= low) & (times < high))
        np.testing.assert_array_equal(read_table(path, ["x"], start_s, end_s)["x"], expected)


def test_decoding_and_reading_a_run_load_neither_pandas_nor_torch(run):
    code = f"""
import sys
from pathlib import Path
from bench.record.recording import Run, decode_instrument, verify
import numpy as np
folder = Path({str(run)!r})
table = Run.open(folder).gyro("fog")
verify(folder, lambda run, out: decode_instrument(
    run, "fog", "gyro_fog", lambda _: ({{**table, "counter": table["counter"] + 1}}, {{}}), out))
assert not {{"pandas", "torch"}} & set(sys.modules), "loaded"
"""
    done = subprocess.run([sys.executable, "-c", code], check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_a_sample_at_the_end_of_a_second_belongs_to_it():
    whole = np.arange(1, 86_401, dtype=np.int64)
    for offset_ns, row in ((0, whole - 1), (1, whole), (-1, whole - 1)):
        assert np.array_equal(second_rows({"time_ns": whole * 10**9 + offset_ns}, 0), row)
    assert second_rows({"time_ns": np.array([15 * 10**9])}, 10).tolist() == [4]
