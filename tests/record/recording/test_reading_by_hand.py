"""What is read of a run's files, made by hand in the test: indices, loggers, manifests, frames of CAN."""

import json

import numpy as np
import pytest

from bench.record.events.run import Note
from bench.record.recording import (
    EventLog,
    Journal,
    Manifest,
    PortJournal,
    Run,
    StreamReport,
    read_table,
    table_writer,
    verify,
    write_manifest,
)
from bench.record.recording._decode import _Rows
from bench.record.recording._free_parts import check_free_parts
from bench.record.recording._raw import missing_tail, raw_path
from bench.record.recording._verify import _compare_tables
from drivers.base.errors import RecordError

START = "2026-11-21T00:00:00.000+00:00"


def manifest(**changes):
    return Manifest(**{"run_id": "r1", "procedure": "p", "started_utc": START} | changes)


def write(path, **columns):
    with table_writer(path, path.stem) as writer:
        writer.write({column: np.asarray(values) for column, values in columns.items()})


@pytest.mark.parametrize(
    ("size", "missing"), [(9, None), (8, (1, 2.0)), (5, (4, 1.0)), (3, (6, 1.0)), (2, (7, 0.0))]
)
def test_a_file_that_ends_before_its_index_lacks_bytes_from_its_last_whole_mark_on(tmp_path, size, missing):
    """Bytes 3, 7 and 9 came at 1, 2 and 3 s."""
    path = tmp_path / "p.bin"
    path.write_bytes(bytes(size))
    np.array([[3, 10**9], [7, 2 * 10**9], [9, 3 * 10**9]], "<i8").tofile(path.with_suffix(".idx"))
    assert missing_tail(path) == missing


@pytest.mark.parametrize(
    ("taints", "valid"),
    [
        ({"before"}, [True, False, True, True, False, True]),
        ({"after"}, [True, True, False, True, True, False]),
        ({"before", "after"}, [True, False, False, True, False, False]),
        (set(), [True] * 6),
    ],
)
@pytest.mark.parametrize("at_once", [1, 2, 3, 6])
def test_a_sample_beside_lost_ones_is_valid_if_its_messages_are_surely_of_one(taints, valid, at_once):
    """Samples are lost before the third and before the sixth row, however many rows come at once."""
    lost = np.array([0, 0, 3, 0, 0, 1])
    rows = _Rows(frozenset(taints))
    found = []
    for at in range(0, 6, at_once):
        part = slice(at, at + at_once)
        found += rows.judged({"lost_before": lost[part], "valid": np.ones(len(lost[part]), bool)})[
            "valid"
        ].tolist()
    assert [*found, *rows.kept["valid"].tolist()] == valid


def test_a_sensor_is_read_of_the_logger_that_has_it_not_of_any_other(tmp_path):
    loggers = [
        {"name": "a", "sensors": {"3": "case"}},
        {"name": "b", "sensors": {"4": "room"}},
        {"name": "c"},
    ]
    write_manifest(tmp_path, manifest(bench={"logger": loggers}))
    ticks = np.array([1, 2]) * 10**9
    write(tmp_path / "logger_a.parquet", time_ns=ticks, aux_3_temp_c=[20.0, 21.0])
    write(tmp_path / "logger_b.parquet", time_ns=ticks, aux_4_temp_c=[30.0, np.nan])
    write(tmp_path / "chamber.parquet", time_ns=ticks, aux_5_temp_c=[40.0, 41.0])
    run = Run.open(tmp_path)
    for number, times_s, temps_c in (
        (3, [1.0, 2.0], [20.0, 21.0]),
        (4, [1.0], [30.0]),
        (5, [1.0, 2.0], [40.0, 41.0]),
    ):
        at_s, temp_c = run.sensor(number)
        assert (at_s.tolist(), temp_c.tolist()) == (times_s, temps_c)


@pytest.mark.parametrize(("duration_s", "shown"), [(None, "not closed"), (12.5, 12.5), (0.0, 0.0)])
def test_a_run_shows_how_long_it_took_once_it_was_closed(tmp_path, duration_s, shown):
    write_manifest(tmp_path, manifest(duration_s=duration_s))
    assert Run.open(tmp_path).shown()["bench time, s"] == shown


def test_a_truth_that_is_one_number_has_no_means_and_a_damaged_one_is_told(tmp_path):
    write_manifest(tmp_path, manifest())
    np.savez(tmp_path / "truth_fog.npz", scale_ppm=np.array(3.5))
    run = Run.open(tmp_path)
    assert run.true_means("fog", "scale_ppm", 0, 1) is None
    (tmp_path / "truth_fog.npz").write_bytes(b"PK\x03\x04 and no more")
    with pytest.raises(RecordError, match="not a readable file of arrays"):
        run.truth("fog")


@pytest.mark.parametrize(("room", "fits"), [(3200, True), (3199, False)])
def test_a_stretch_needs_its_columns_and_the_time_twice_in_memory(tmp_path, monkeypatch, room, fits):
    """100 rows of a column and the time, 8 bytes a number, once in Arrow and once as numpy: 3200 bytes."""
    path = tmp_path / "gyro_fog.parquet"
    write(path, time_ns=np.arange(100), rate_dps=np.arange(100.0), temp_c=np.zeros(100))
    monkeypatch.setattr("os.sysconf", {"SC_PAGE_SIZE": 1, "SC_PHYS_PAGES": room}.__getitem__)
    if fits:
        assert read_table(path, ["rate_dps"])["rate_dps"].tolist() == list(range(100))
    else:
        with pytest.raises(RecordError, match="larger than this machine's memory"):
            read_table(path, ["rate_dps"])


def test_where_tables_begin_to_differ_is_said(tmp_path):
    kept, rebuilt = tmp_path / "kept.parquet", tmp_path / "rebuilt.parquet"
    write(kept, rate_dps=np.array([1.0, 2.0, 3.0, 4.0]))
    write(rebuilt, rate_dps=np.array([1.0, 2.5, 3.0, 4.5]))
    assert _compare_tables(kept, rebuilt) == "rate_dps differs from row 1 on: 2.0, rebuilt 2.5"


PARTS = {
    "started_utc": START,
    "bench": {"bench": {"name": "b", "latitude_deg": 48.0}, "gyro": [{"name": "fog"}]},
    "stream": {"fog": {"frames": 7}},
    "measurements": [{"name": "a", "value": 1.5, "passed": True}],
    "parameters": {"rate_dps": 1.5},
}


@pytest.mark.parametrize(
    "changes",
    [
        {"stream": {"fog": {"frames": "7"}}},
        {"stream": {"fog": {"frames": 7.0}}},
        {"stream": {"fog": {"frames": True}}},
        {"measurements": [{"name": "a", "value": "1.5"}]},
        {"measurements": [{"name": "a", "passed": "yes"}]},
        {"measurements": [{"name": "a", "value": float("inf")}]},
        {"bench": {"gyro": [{"name": "fog", "axis": 1.0}]}},
        {"parameters": {"rate_dps": float("nan")}},
    ],
)
def test_a_number_in_a_manifest_is_a_number_and_a_word_is_a_word(changes):
    check_free_parts(PARTS)
    with pytest.raises(ValueError, match="validation error"):
        check_free_parts(PARTS | changes)


@pytest.mark.parametrize("name", ["a" * 4097, "raw/a\nb", "raw\\a", "../a", "/a", "raw//a"])
def test_a_file_of_a_run_has_a_name_that_every_system_takes(name):
    assert manifest(written={"a" * 4096: 1, "raw/a.bin": 2}).written["raw/a.bin"] == 2
    with pytest.raises(ValueError, match="validation error"):
        manifest(written={name: 1})


def test_a_stream_of_which_nothing_came_counts_nothing():
    report = StreamReport()
    assert {value for value in vars(report).values() if isinstance(value, int)} == {0}
    assert report.rejected == {} and report.warnings == () and report.sample_rate_hz is None


def test_the_event_log_is_text_that_people_read_and_its_file_is_let_go(tmp_path):
    log = EventLog(tmp_path)
    log.event(1.0, Note("25 °C, Prüfstand"))
    assert "25 °C, Prüfstand".encode() in (tmp_path / "events.jsonl").read_bytes()
    assert not log.file.closed
    log.close()
    assert log.file.closed
    log.close()


def test_a_port_whose_folder_cannot_be_made_is_told(tmp_path):
    (tmp_path / "raw").write_text("a file in the folder's place")
    with pytest.raises(RecordError, match="cannot be recorded") as refused:
        PortJournal(tmp_path, "p")
    assert refused.value.where == str(tmp_path / "raw")


def test_of_the_ports_that_could_not_be_written_the_first_is_told(tmp_path):
    journal = Journal(tmp_path, 1.0)
    for name in ("first", "second"):
        journal.port(name).received(b"1", 0.0)
        (tmp_path / "raw" / f"{name}.bin").unlink()
    with pytest.raises(RecordError, match="deleted") as refused:
        journal.close()
    assert refused.value.where.endswith("first.bin")


def test_frames_of_a_can_port_have_the_time_of_their_lines_between_the_arrivals(tmp_path):
    """Lines of 10 and 12 bytes end at 10, 22 and 32; bytes 10, 20 and 40 came at 1, 2 and 4 s."""
    write_manifest(tmp_path, manifest())
    path = raw_path(tmp_path, "can")
    path.parent.mkdir()
    path.write_bytes(b"t1232AABB\r" + b"t1003010203\r" + b"t7FF2CCDD\r" + bytes(8))
    np.array([[10, 10**9], [20, 2 * 10**9], [40, 4 * 10**9]], "<i8").tofile(path.with_suffix(".idx"))
    ((frames, times_s),) = Run.open(tmp_path).can_frames("can")
    assert frames["id"].tolist() == [0x123, 0x100, 0x7FF]
    assert times_s.tolist() == pytest.approx([1.0, 2.2, 3.2])
    path.with_suffix(".idx").write_bytes(b"")
    assert list(Run.open(tmp_path).can_frames("can")) == []


def test_a_run_that_was_never_closed_is_told_with_its_files_left_alone(tmp_path):
    write_manifest(tmp_path, manifest())
    before = (tmp_path / "manifest.json").read_bytes()
    (problem,) = verify(tmp_path, lambda *_: None).problems
    assert problem.path == "manifest.json" and "never closed" in problem.text
    assert (tmp_path / "manifest.json").read_bytes() == before and json.loads(before)["outcome"] == "running"
