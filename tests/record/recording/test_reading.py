"""What a run says of itself, from tables and a manifest written by hand: means, angles, times, refusals."""

import json
import math

import numpy as np
import pytest

from bench.record.events.run import Invalid, Measured, Outcome, PhaseBegun
from bench.record.recording import (
    EventLog,
    Manifest,
    PortJournal,
    Run,
    decode_stream,
    read_manifest,
    read_table,
    seal,
    table_writer,
    verify,
    write_manifest,
)
from bench.record.recording import _read as reading
from bench.record.recording._decode import _not_sent
from bench.record.recording._tables import row_means
from bench.record.recording._timing import StreamTimer
from drivers.base.errors import RecordError

START = "2026-11-21T00:00:00.000+00:00"


def manifest(**changes):
    return Manifest(**{"run_id": "r1", "procedure": "p", "started_utc": START} | changes)


def write(folder, name, **columns):
    with table_writer(folder / f"{name}.parquet", name) as writer:
        writer.write({column: np.asarray(values) for column, values in columns.items()})


def write_gyro(folder, time_s, rate_dps, **changes):
    count = len(time_s)
    columns = {
        "time_ns": np.rint(np.asarray(time_s) * 1e9).astype(np.int64),
        "rate_dps": np.asarray(rate_dps, np.float32),
        "temp_c": np.full(count, 20.0, np.float32),
        "valid": np.ones(count, np.bool_),
        "lost_before": np.zeros(count, np.int32),
    }
    write(folder, "gyro_fog", **columns | changes)


@pytest.fixture
def folder(tmp_path):
    write_manifest(tmp_path, manifest())
    return tmp_path


@pytest.mark.parametrize("at_once", [1, 7, 3600])
def test_second_means_are_those_of_each_second_however_much_is_read_at_once(folder, monkeypatch, at_once):
    """A rate of k deg/s in second k (its end included), 50 samples each; one of them damaged, some lost."""
    monkeypatch.setattr(reading, "_AT_ONCE_S", at_once)
    ticks = np.arange(1, 50 * 20 + 1)
    rate = (ticks - 1) // 50
    valid = np.ones(len(ticks), np.bool_)
    valid[50 * 7 + 3] = False
    rates = np.where(valid, rate, 1e6)
    rates[50 * 9 : 50 * 10] = np.nan
    lost = np.zeros(len(ticks), np.int32)
    lost[50 * 8] = 350
    write_gyro(folder, ticks / 50.0, rates, valid=valid, lost_before=lost)
    means = Run.open(folder).second_means("fog", 2, 16)
    expected = [float(second) for second in range(2, 16)]
    expected[9 - 2] = math.nan
    assert means.rate_dps.tolist() == pytest.approx(expected, nan_ok=True)
    assert means.temp_c.tolist() == pytest.approx([20.0] * 14)
    assert means.lost == pytest.approx(350 / (350 + 14 * 50))


def test_a_sample_at_the_start_counts_into_the_first_second_if_asked_for(folder):
    write_gyro(folder, [1.0, 2.0, 2.5, 3.0, 4.0], [1.0, 2.0, 4.0, 9.0, 16.0])
    run = Run.open(folder)
    assert run.second_means("fog", 2, 4).rate_dps.tolist() == [6.5, 16.0]
    assert run.second_means("fog", 2, 4, from_start=True).rate_dps.tolist() == pytest.approx(
        [5.0, math.nan], nan_ok=True
    )
    assert run.second_means("fog", 2, 3).lost == 0.0
    assert len(run.second_means("fog", 2, 2).rate_dps) == 0


def test_means_of_rows_leave_out_what_is_outside_or_no_number():
    values = np.array([1.0, 3.0, np.nan, 5.0, 7.0, 100.0])
    row = np.array([0, 0, 0, 2, -1, 3])
    assert row_means(values, row, 3).tolist() == pytest.approx([2.0, math.nan, 5.0], nan_ok=True)
    use = np.array([True, False, True, True, True, True])
    assert row_means(values, row, 3, use).tolist() == pytest.approx([1.0, math.nan, 5.0], nan_ok=True)


def test_the_phase_at_a_time_is_the_last_begun(folder):
    times_s = np.array([-1.0, 0.0, 9.99, 10.0, 99.0])
    assert Run.open(folder).phase_at(times_s).tolist() == ["run"] * 5
    log = EventLog(folder)
    log.event(0.0, PhaseBegun("soak"))
    log.event(10.0, PhaseBegun("shock"))
    log.close()
    assert Run.open(folder).phase_at(times_s).tolist() == ["soak", "soak", "soak", "shock", "shock"]


def test_a_case_has_the_temperature_of_its_sensor_between_the_chambers_rows(folder):
    gyro = {"kind": "gyro", "role": "unit under test"}
    write_manifest(folder, manifest(devices={"fog": {**gyro, "case_sensor": 2}, "bare": gyro}))
    time_ns = np.array([0, 10, 20]) * 10**9
    write(folder, "chamber", time_ns=time_ns, aux_1_temp_c=[0.0] * 3, aux_2_temp_c=[20.0, 30.0, 10.0])
    run = Run.open(folder)
    assert run.case_temp_c("fog", np.array([-5.0, 2.5, 15.0, 99.0])).tolist() == [20.0, 22.5, 20.0, 10.0]
    assert run.case_temp_c("bare", np.array([0.0])) is None


def test_the_tables_angle_counts_turns_and_the_earths_rate_follows_it(folder):
    """15.041 deg/h of the stars' day (IERS 2010: 7.292115e-5 rad/s), times the cosine of 60 deg: half of it."""
    site = {"bench": {"name": "b", "latitude_deg": 60.0}}
    write_manifest(folder, manifest(bench=site, measurements=({"name": "azimuth_error", "value": 5.0},)))
    time_s = np.arange(0, 41)
    angle_deg = (350.0 + 10.0 * time_s) % 360.0
    write(folder, "turntable", time_ns=time_s * 10**9, angle_deg=angle_deg, rate_dps=np.full(41, 10.0))
    run = Run.open(folder)
    times_s = np.array([10.0, 10.5, 30.0])
    assert run.table_angle_deg(times_s).tolist() == pytest.approx([90.0, 95.0, 290.0])
    over_zero = run.table_angle_deg(np.array([0.5, 36.5, 37.5]))
    assert (over_zero - over_zero[0]).tolist() == pytest.approx([0.0, 360.0, 370.0])
    north_dph = math.degrees(7.292115e-5) * 3600.0 * 0.5
    expected = [north_dph * math.cos(math.radians(angle + 5.0)) for angle in (90.0, 95.0, 290.0)]
    assert run.earth_rate_dph(times_s).tolist() == pytest.approx(expected, rel=1e-7)
    assert Run.open(folder).azimuth_error_deg == 5.0


def test_parameters_and_measurements_are_numbers_or_nothing():
    made = manifest(
        parameters={"ramp": 12.5, "count": 3, "name": "x" * 99, "flag": True},
        measurements=({"name": "a", "value": 1.5}, {"name": "b", "value": None}),
    )
    assert (made.parameter("ramp"), made.parameter("count"), made.parameter("none")) == (12.5, 3, None)
    for name, found in (("name", "'" + "x" * 59), ("flag", "True")):
        with pytest.raises(RecordError, match=f"the parameter {name} is no number") as refused:
            made.parameter(name)
        assert (refused.value.where, refused.value.found) == ("run r1", found)
    assert (made.measured("a"), made.measured("b"), made.measured("c")) == (1.5, None, None)


def test_what_a_manifest_does_not_have_is_named_by_its_key():
    made = manifest(units={"fog": "F-1"}, bench={"bench": {"name": "b"}})
    assert (made.unit("fog"), made.bench_name, made.complete) == ("F-1", "b", False)
    for ask, key in (
        (lambda: made.latitude_deg, "bench.bench.latitude_deg"),
        (lambda: made.device("table"), "devices.table"),
        (lambda: made.unit("can"), "units.can"),
    ):
        with pytest.raises(RecordError) as refused:
            ask()
        assert refused.value.found == f"no {key} in manifest.json"
    assert manifest(bench={"bench": {"latitude_deg": 40.5}}).latitude_deg == 40.5
    assert manifest(outcome="aborted").complete and manifest().bench_name == ""


@pytest.mark.parametrize(("value", "sound"), [(0, True), (2**63 - 1, True), (2**63, False), (-1, False)])
def test_a_count_in_a_manifest_is_a_whole_number_of_64_bits(folder, value, sound):
    text = json.loads((folder / "manifest.json").read_text())
    text["stream"] = {"fog": {"frames": value}}
    (folder / "manifest.json").write_text(json.dumps(text))
    if sound:
        assert read_manifest(folder).stream["fog"]["frames"] == value
    else:
        with pytest.raises(RecordError, match="frames"):
            read_manifest(folder)


@pytest.mark.parametrize(("year", "sound"), [(1969, False), (1970, True), (2999, True), (3000, False)])
def test_a_run_began_in_a_year_that_clocks_know(folder, year, sound):
    text = (folder / "manifest.json").read_text().replace("2026-11-21", f"{year}-11-21")
    (folder / "manifest.json").write_text(text)
    if sound:
        assert read_manifest(folder).started_utc.startswith(str(year))
    else:
        with pytest.raises(RecordError, match="no time of a run"):
            read_manifest(folder)


def test_a_table_that_is_none_is_told_in_a_line(tmp_path):
    path = tmp_path / "chamber.parquet"
    path.write_bytes(b"no table at all")
    with pytest.raises(RecordError, match="the table cannot be read") as refused:
        read_table(path)
    assert "magic bytes" in refused.value.found and "\n" not in refused.value.found


def test_arrivals_are_those_of_the_first_frame_that_came_whole(tmp_path, fake):
    """A mark within a frame, before any whole one, is of no frame; of two in one piece the first counts."""
    port = PortJournal(tmp_path, "fog")
    frames = [fake.encode(n, 0.0) for n in range(6)]
    stream = b"".join(frames)
    for piece, time_s in ((stream[:3], 1.0), (stream[3:7], 2.0), (stream[7:24], 3.0), (stream[24:], 4.0)):
        port.received(piece, time_s)
    port.flush(sync=False)
    write_manifest(tmp_path, manifest())
    found = Run.open(tmp_path).arrivals(fake.source())
    assert found.count.tolist() == [0, 2, 5] and found.arrival_s.tolist() == [2.0, 3.0, 4.0]
    assert found.count_s == pytest.approx(0.01)
    assert Run.open(tmp_path).has_arrivals("fog") and not Run.open(tmp_path).has_arrivals("table")


def test_of_missing_samples_those_are_not_sent_whose_time_lies_in_a_span_without_power():
    """99 samples of 0.1 s are missing before the one at 20 s: those of 10.1 to 19.9 s."""
    lost, time_ns = np.array([0, 99], np.int32), np.array([10, 20]) * 10**9
    for spans, count in (
        ([(0.0, 100.0)], 99),
        ([(10.0, 20.0)], 99),
        ([(0.0, 15.0)], 50),
        ([(12.0, 13.0), (14.0, 15.0)], 20),
        ([(15.0, 100.0)], 50),
        ([(20.0, 30.0)], 0),
        ([(0.0, 10.0)], 0),
        ([], 0),
    ):
        assert _not_sent(lost, time_ns, 0.1, spans) == count, spans
    short = np.array([0, 9], np.int32)  # 0.9 s: a loss, whoever had the power off
    assert _not_sent(short, np.array([10, 11]) * 10**9, 0.1, [(0.0, 100.0)]) == 0


def test_more_lost_samples_than_32_bits_count_are_told_as_the_most_they_count(tmp_path, fake):
    class Leaping(fake.Decoder):
        """A counter of 40 bits that goes 2**33 a frame, as if so many samples were lost between two."""

        def __init__(self):
            super().__init__(modulo=128 << 33, rate_hz=100.0 * 2**33)

        def feed(self, data):
            batch = super().feed(data)
            batch.columns["counter"] = batch.columns["counter"] << 33
            return batch

    fake.record(tmp_path, range(300), 0.01)
    decode_stream(tmp_path, fake.source(decoder=Leaping))
    lost = read_table(tmp_path / "gyro_fog.parquet", ["lost_before"])["lost_before"]
    assert set(lost[1:].tolist()) == {2**31 - 1}


@pytest.mark.parametrize("rate_hz", [1.0, 10.0])
@pytest.mark.parametrize("off", [-0.01, 0.0, 0.01])
def test_the_rate_of_a_slow_stream_is_found_too(rate_hz, off):
    period_s = (1.0 + off) / rate_hz
    timer = StreamTimer(1 << 16, 1.0, rate_hz)
    count = np.arange(500)
    marks = np.column_stack((8 * (count + 1), np.rint((3.0 + count * period_s) * 1e9).astype(np.int64)))
    timer.feed(count, 8 * (count + 1), marks)
    timing = timer.fit()
    assert timing.period_s == pytest.approx(period_s, rel=1e-9)
    assert timing.start_s == pytest.approx(3.0, abs=1e-6)
    assert timing.clock_error_ppm == pytest.approx((1.0 / (1.0 + off) - 1.0) * 1e6, abs=1e-3)
    assert bool(timing.warnings) is bool(off)


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ({"counter": np.arange(300, dtype=np.int32)}, "counter is int32, rebuilt int64"),
        (
            {"counter": np.where(np.arange(300) == 7, 99, np.arange(300))},
            "differs from row 7 on: 99, rebuilt 7",
        ),
        ({"counter": np.arange(299)}, "has 299 rows, rebuilt 300"),
        ({"counter": np.arange(300), "more": np.arange(300)}, "has columns"),
    ],
)
def test_a_table_that_is_not_what_the_bytes_give_is_named_with_both(tmp_path, columns, words):
    run = tmp_path / "run"
    run.mkdir()
    write_manifest(run, manifest())
    log = EventLog(run)
    log.event(1.0, Outcome("completed"))
    log.close()
    write(run, "gyro_fog", **columns)
    seal(run, manifest(outcome="completed"))
    report = verify(run, lambda folder, out: write(out, "gyro_fog", counter=np.arange(300)))
    (problem,) = report.problems
    assert problem.path == "gyro_fog.parquet" and words in str(problem)


def test_a_truth_known_at_whole_seconds_has_its_means_between_them(folder):
    np.savez(folder / "truth_fog.npz", bias_dph=np.arange(11.0) ** 2, other=np.zeros((2, 2)))
    run = Run.open(folder)
    assert run.true_means("fog", "bias_dph", 2, 5).tolist() == [6.5, 12.5, 20.5]
    assert run.true_means("fog", "bias_dph", 2, 11) is None and run.true_means("fog", "other", 0, 1) is None
    assert run.true_means("fog", "none", 2, 5) is None and run.true_means("can", "bias_dph", 2, 5) is None


def test_a_table_that_would_not_fit_in_memory_is_refused(monkeypatch):
    """16 MiB of memory: 2**20 numbers of 8 bytes, once in Arrow and once as numpy."""
    pages = {"SC_PAGE_SIZE": 4096, "SC_PHYS_PAGES": 4096}
    monkeypatch.setattr("os.sysconf", pages.__getitem__)
    reading.check_room("a table", 1 << 18, 4)
    with pytest.raises(RecordError, match="larger than this machine's memory") as refused:
        reading.check_room("a table", (1 << 18) + 1, 4)
    assert refused.value.found == "262145 rows of 4 columns, memory of 16 MiB"
    monkeypatch.delattr("os.sysconf")
    reading.check_room("a table", 1 << 40, 4)  # nobody tells how much there is


MEASURED = {"name": "azimuth_error", "value": 5.0, "unit": "deg", "low": None, "high": None, "passed": None}


@pytest.mark.parametrize(
    ("changes", "problem"),
    [
        ({}, None),
        ({"outcome": "aborted"}, "its outcome or reason is not that of the events"),
        ({"reason": "it rained"}, "its outcome or reason is not that of the events"),
        ({"measurements": (MEASURED | {"value": 5.5},)}, "its measurements are not those of the events"),
        ({"measurements": ()}, "its measurements are not those of the events"),
        ({"measurements": (), "imported": {"log": "log.csv", "mapping": "map.toml"}}, None),
    ],
)
def test_a_sealed_manifest_is_held_against_the_events(folder, changes, problem):
    log = EventLog(folder)
    log.event(1.0, Measured(**MEASURED))
    log.event(2.0, Outcome("completed", "", True))
    log.close()
    seal(folder, manifest(**{"outcome": "completed", "measurements": (MEASURED,)} | changes))
    found = [(found.path, found.text) for found in verify(folder, lambda *_: None).problems]
    assert found == ([] if problem is None else [("manifest.json", problem)])


def test_events_that_say_invalid_are_held_against_a_manifest_that_does_not(folder):
    log = EventLog(folder)
    log.event(1.0, Invalid("slow", "the shock was slower than asked for", {}))
    log.event(2.0, Outcome("completed", "", True))
    log.close()
    seal(folder, manifest(outcome="completed"))
    (problem,) = verify(folder, lambda *_: None).problems
    assert problem.text == "says completed, the events do not"


def test_a_seal_that_was_taken_off_is_told(folder):
    log = EventLog(folder)
    log.event(2.0, Outcome("completed", "", True))
    log.close()
    write_manifest(folder, seal(folder, manifest(outcome="completed")).model_copy(update={"seal": ""}))
    report = verify(folder, lambda *_: None)
    assert [problem.text for problem in report.problems] == ["its seal was taken off"] and not report.sealed


@pytest.mark.parametrize("size", [99, 101])
def test_a_file_of_another_size_is_told_without_being_summed(folder, size, monkeypatch):
    port = PortJournal(folder, "fog")
    port.received(bytes(100), 1.0)
    port.flush(sync=False)
    log = EventLog(folder)
    log.event(2.0, Outcome("completed", "", True))
    log.close()
    seal(folder, manifest(outcome="completed"))
    (folder / "raw" / "fog.bin").write_bytes(bytes(size))
    first = verify(folder, lambda *_: None).problems[0]
    assert first.path == "raw/fog.bin"
    assert first.text == f"differs from the manifest: {size} bytes, expected 100"
