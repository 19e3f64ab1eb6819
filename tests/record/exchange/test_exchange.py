"""Foreign logs in and runs out, against files written and read by pandas, asammdf and python-can themselves."""

from __future__ import annotations

import json
import math
import warnings
from pathlib import Path

import can
import numpy as np
import pandas as pd
import pytest
from asammdf import MDF, Signal

from bench.analysis.gap._import import read_mapped_runs
from bench.analysis.gap._recordings import load_channels
from bench.analysis.gap._run_folder import load_gap_runs
from bench.analysis.thermal import load_runs
from bench.control.run_record import decode_run
from bench.present.report import render_page, run_content, run_page
from bench.record.events.run import AirDemand
from bench.record.exchange import export_run, import_log
from bench.record.recording import Run, checksum, read_manifest, verify, write_manifest
from drivers.base.errors import ConfigurationError
from drivers.kit.slcan_codec import encode_frame

MAPPING = """
format = 1
unit_id = "G7"
latitude_deg = 48.0
gyro = "fog"
[columns]
time = { name = "t_ms", unit = "ms" }
output = { name = "rate", unit = "rad/s" }
t_in = { name = "temp_K", unit = "K" }
t_out = { name = "case", unit = "degF" }
angle = { name = "table", unit = "rad" }
air = { name = "air", unit = "degC" }
[[run]]
file = "log.*"
profile = "shock"
elevation_deg = 90.0
azimuth_error_deg = 0.25
started_utc = "2026-10-05T08:00:00+00:00"
phases = [{ name = "equilibrium", start_s = 0.0 }, { name = "reference", start_s = 60.0 },
          { name = "shock", start_s = 200.0 }]
"""
SECONDS = 600


def frame(seconds: int = SECONDS) -> pd.DataFrame:
    """5 Hz; a table at 3 deg/s; a gyro whose rate falls with its temperature; two seconds lost at 100 s."""
    t = np.arange(0.0, seconds + 0.1, 0.2)
    t = t[(t < 100.0) | (t >= 102.0)]
    rate_dps = 3.0 + 1e-3 * np.exp(-t / 300.0)
    return pd.DataFrame(
        {
            "t_ms": 1000.0 * t + 7e6,
            "rate": np.radians(rate_dps),
            "temp_K": 293.15 - 0.05 * t,
            "case": (20.0 - 0.06 * t) * 9.0 / 5.0 + 32.0,
            "table": np.radians(np.mod(3.0 * t, 360.0)),
            "air": 20.0 - 0.07 * t,
            "note": ["x"] * len(t),
        }
    )


def write(folder: Path, kind: str, table: pd.DataFrame, mapping: str = MAPPING) -> tuple[Path, Path]:
    (folder / "map.toml").write_text(mapping, encoding="utf-8")
    log = folder / f"log.{kind}"
    if kind == "csv":
        table.to_csv(log, index=False)
    elif kind == "parquet":
        table.to_parquet(log)
    else:
        with warnings.catch_warnings(), MDF() as mdf:
            warnings.simplefilter("ignore")
            time_s = table["t_ms"].to_numpy() / 1e3
            for name in table.columns.drop(["t_ms", "note"]):
                mdf.append([Signal(table[name].to_numpy(), time_s, name=name)], common_timebase=True)
            mdf.save(log)
    return log, folder / "map.toml"


@pytest.mark.parametrize("kind", ["csv", "parquet", "mf4"])
def test_a_foreign_log_becomes_a_run(tmp_path: Path, kind: str) -> None:
    log, mapping = write(tmp_path, kind, frame())
    folder = import_log(log, mapping, tmp_path / "runs")
    run = Run.open(folder)
    manifest = run.manifest
    assert (folder.name, manifest.procedure, manifest.mounting) == ("log", "shock", "axis_up")
    assert manifest.units == {"fog": "G7"} and manifest.started_utc == "2026-10-05T08:00:00+00:00"
    t = (frame()["t_ms"].to_numpy() - 7e6) / 1e3
    table = run.gyro("fog")
    np.testing.assert_allclose(table["time_ns"] * 1e-9, t, atol=2e-9)
    np.testing.assert_allclose(table["rate_dps"], 3.0 + 1e-3 * np.exp(-t / 300.0), rtol=2e-7)
    np.testing.assert_allclose(table["temp_c"], 20.0 - 0.05 * t, atol=1e-5)
    assert table["valid"].all() and table["lost_before"].sum() == 10
    assert manifest.stream["fog"]["lost"] == 10
    assert manifest.stream["fog"]["sample_rate_hz"] == pytest.approx(5.0)
    assert manifest.ended_utc == "2026-10-05T08:10:00.000+00:00"
    chamber = run.chamber()
    at = chamber["time_ns"] * 1e-9
    np.testing.assert_allclose(chamber["aux_1_temp_c"], 20.0 - 0.06 * at, atol=1e-6)
    np.testing.assert_allclose(chamber["air_temp_c"], 20.0 - 0.07 * at, atol=1e-6)
    turntable = run.turntable()
    np.testing.assert_allclose(turntable["rate_dps"], 3.0, rtol=1e-6)
    difference = np.mod(turntable["angle_deg"] - 3.0 * turntable["time_ns"] * 1e-9 + 180.0, 360.0) - 180.0
    assert np.abs(difference).max() < 1e-5
    assert [phase.name for phase in run.phases()] == ["equilibrium", "reference", "shock"]
    report = verify(folder, decode_run)
    assert report.passed and report.tables == 3
    assert (folder / "raw" / log.name).read_bytes() == log.read_bytes()


def test_stamps_that_are_rounded_and_rows_that_are_not_valid(tmp_path: Path) -> None:
    """Rows of eight ticks of a PC's clock, stamped to 10 ms; a flag says which are none."""
    table = frame()
    table["t_ms"] = 10.0 * np.round(43.9403 * np.arange(len(table)))
    table["locked"] = (np.arange(len(table)) >= 100).astype(float)
    text = MAPPING.replace("[columns]", '[columns]\nvalid = { name = "locked" }')
    run = Run.open(import_log(*write(tmp_path, "csv", table, text), tmp_path / "runs"))
    assert run.manifest.stream["fog"]["sample_rate_hz"] == pytest.approx(1.0 / 0.439403, rel=1e-5)
    assert run.manifest.stream["fog"]["invalid"] == 100
    assert (run.gyro("fog")["valid"] == (np.arange(len(table)) >= 100)).all()


def test_a_log_without_air_or_case_temperature(tmp_path: Path) -> None:
    """The gap's channels name what cannot be seen; a fit says which column is missing, not what to wire up."""
    text = MAPPING.replace('air = { name = "air", unit = "degC" }', "")
    folder = import_log(*write(tmp_path, "csv", frame(), text), tmp_path / "runs")
    found, missing = load_channels(folder)
    assert [series.channel for series in found] == ["gyro_temperature"]
    assert "no column air" in missing["case_temperature"] and missing["chamber_air"] == "no column air"
    text = text.replace('t_out = { name = "case", unit = "degF" }', "").replace("log.*", "other.*")
    log, mapping = write(tmp_path, "csv", frame(), text)
    folder = import_log(log.rename(tmp_path / "other.csv"), mapping, tmp_path / "runs")
    with pytest.raises(ConfigurationError, match=r"no column t_out.*map a column to t_out"):
        load_runs([folder])


def test_methods_work_on_an_imported_run(tmp_path: Path) -> None:
    """Fitting, report and gap diagnosis take the run; the gap's own way of reading the mapping agrees."""
    log, mapping = write(tmp_path, "csv", frame())
    folder = import_log(log, mapping, tmp_path / "runs")
    (thermal,) = load_runs([folder])
    assert thermal.unit_id == "G7" and thermal.reference == (60.0, 200.0)
    earth = 15.041067 * math.sin(math.radians(48.0))  # the axis is upright
    t = frame()["t_ms"].to_numpy() / 1e3 - 7e3
    row = np.ceil(t - 1e-9).astype(int) - 1
    for second in (5, 300, 550):
        mean = (3.0 + 1e-3 * np.exp(-t[row == second] / 300.0)).mean()
        assert thermal.bias_dph[second] == pytest.approx(3600.0 * mean - earth, abs=0.01)
        assert thermal.case_temp_c[second] == pytest.approx(20.0 - 0.06 * (second + 0.5), abs=1e-3)
    (gap,) = load_gap_runs(folder)
    text = MAPPING.replace("log.*", "log.csv")
    (tmp_path / "map.toml").write_text(text, encoding="utf-8")
    (direct,) = read_mapped_runs(tmp_path / "map.toml")
    count = len(gap.stimulus)
    assert gap.unit_id == direct.unit_id and gap.profile == direct.profile and count > 590
    np.testing.assert_allclose(gap.output_dph, direct.output_dph[:count], atol=2e-3)
    np.testing.assert_allclose(
        gap.stimulus.t_in_c, direct.stimulus.t_in_c[:count], atol=0.011
    )  # a sample on a border
    page = render_page(run_page(run_content(Run.open(folder))))
    assert "G7" in page and "shock" in page


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('name = "rate"', 'name = "rat"'), "no such column. Found: rat. Expected: t_ms"),
        (('name = "rate"', 'name = "note"'), "not one of numbers"),
        (('unit = "rad/s"', 'unit = "turns"'), "unit is not known. Found: turns"),
        (('unit = "ms"', 'unit = "degC"'), "unit is not known"),
        (('unit_id = "G7"', ""), "not complete. Found: without unit_id"),
        (("latitude_deg = 48.0", "latitude_deg = 480.0"), "latitude_deg"),
        (("latitude_deg = 48.0", "latitude_deg = 48.0\ncolour = 1"), "colour"),
        (('file = "log.*"', 'file = "other.csv"'), "no entry for this log"),
        (("2026-10-05T08:00:00+00:00", "yesterday"), "no date and time"),
        (("[columns]", "[columns"), "is not TOML"),
    ],
)
def test_a_mapping_that_cannot_be_used_leaves_nothing(
    tmp_path: Path, change: tuple[str, str], message: str
) -> None:
    log, mapping = write(tmp_path, "csv", frame(20), MAPPING.replace(*change))
    with pytest.raises(ConfigurationError, match=message):
        import_log(log, mapping, tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("kind", ["csv", "parquet", "mf4"])
@pytest.mark.parametrize("damage", ["repeat", "back", "short", "nan"])
def test_times_that_do_not_grow_leave_nothing(tmp_path: Path, kind: str, damage: str) -> None:
    table = frame(20)
    if damage == "short":
        table = table[:1]
    else:
        row = {"repeat": table["t_ms"][40], "back": 0.0, "nan": math.nan}[damage]
        table.loc[41, "t_ms"] = row
    log, mapping = write(tmp_path, kind, table)
    with pytest.raises(
        ConfigurationError, match="too short" if damage == "short" else "does not grow.*row|row 42"
    ):
        import_log(log, mapping, tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


@pytest.mark.parametrize("suffix", ["csv", "parquet", "mf4"])
def test_logs_that_are_none(tmp_path: Path, suffix: str) -> None:
    _, mapping = write(tmp_path, "csv", frame(20))
    (tmp_path / f"log.{suffix}").write_bytes(b"\x00\xff" * 50)
    with pytest.raises(ConfigurationError, match=r"cannot be read|no such column"):
        import_log(tmp_path / f"log.{suffix}", mapping, tmp_path / "runs")
    with pytest.raises(ConfigurationError, match=r"cannot be read|no entry"):
        import_log(tmp_path / f"log.x.{suffix}", mapping, tmp_path / "runs")
    assert not (tmp_path / "runs").exists()


def test_a_run_is_never_overwritten(tmp_path: Path) -> None:
    log, mapping = write(tmp_path, "csv", frame(20))
    folder = import_log(log, mapping, tmp_path / "runs")
    before = checksum(folder / "manifest.json")
    with pytest.raises(ConfigurationError, match="a run of that name"):
        import_log(log, mapping, tmp_path / "runs")
    assert checksum(folder / "manifest.json") == before
    assert [path.name for path in (tmp_path / "runs").iterdir()] == ["log"]


IMU = """
format = 1
unit_id = "G7"
latitude_deg = 48.0
axis = "z"
[columns]
time = { name = "t", unit = "s" }
t_in = { name = "counts", unit = "0.00294118 degC + 36.53" }
set_point = { name = "set", unit = "degC" }
[columns.gyros]
x = { name = "gx", unit = "0.01 deg/s" }
z = { name = "gz", unit = "rad/s" }
[columns.accelerometers]
y = { name = "ay", unit = "g" }
[[run]]
file = "day_*.csv"
phases = [{ name = "rest", start_s = 0 }, { name = "turning", start_s = 129, rate_dps = 20 },
          { name = "back", start_s = 189, rate_dps = -20 }]
"""


def test_an_imu_with_counts_turns_and_set_point(tmp_path: Path) -> None:
    """All axes are in the table of the unit; phases say how the table turned, the set point is a demand."""
    t = np.arange(2501) / 10.0
    rows = {"t": t, "counts": -340.0, "set": np.where(t < 50, 20.0, -5.0), "gx": 3.0, "gz": 0.1, "ay": 1.0}
    for name in ("day_1", "day_2"):
        pd.DataFrame(rows).to_csv(tmp_path / f"{name}.csv", index=False)
    (tmp_path / "map.toml").write_text(IMU)
    run = Run.open(import_log(tmp_path / "day_1.csv", tmp_path / "map.toml", tmp_path / "runs"))
    table = run.gyro("gyro")
    for column, value in {"rate_dps": math.degrees(0.1), "rate_x_dps": 0.03, "accelerometer_y_mps2": 9.80665,
                          "temp_c": 35.53}.items():  # fmt: skip
        np.testing.assert_allclose(table[column], value, rtol=1e-6)
    turned = run.table_angle_deg(np.array([100.0, 144.0, 189.0, 190.5]))
    np.testing.assert_allclose(turned - turned[0], [0.0, 300.0, 1200.0, 1170.0], atol=1e-6)
    assert [(time_s, event.set_point_c) for time_s, event in run.of(AirDemand)] == [(0.0, 20.0), (50.0, -5.0)]
    assert "G7" in render_page(run_page(run_content(run)))
    first, second = read_mapped_runs(tmp_path / "map.toml")  # the pattern fits two files
    assert (first.run_id, second.run_id) == ("day_1", "day_2")
    assert first.stimulus.table_rate_dps[
        np.searchsorted(first.stimulus.time_s, [100.5, 150.5, 200.5])
    ] == pytest.approx([0.0, 20.0, -20.0])
    assert verify(tmp_path / "runs" / "day_1", decode_run).passed
    (tmp_path / "map.toml").write_text(IMU.replace("day_", "night_"))
    with pytest.raises(ConfigurationError, match=r"no log fits the pattern\. Found: night_"):
        read_mapped_runs(tmp_path / "map.toml")


def test_a_chambers_log_alone(tmp_path: Path) -> None:
    """Without a gyro the run has a chamber table and a report; the diagnosis and fits say what is missing."""
    text = IMU.split("axis =")[0] + '\nrate_hz = 2\n[columns]\nair = { name = "air", unit = "degC" }\n'
    (tmp_path / "map.toml").write_text(text)
    pd.DataFrame({"air": 20.0 + 0.01 * np.arange(600), "x": 0}).to_csv(tmp_path / "log.csv", index=False)
    folder = import_log(tmp_path / "log.csv", tmp_path / "map.toml", tmp_path / "runs")
    run = Run.open(folder)
    assert run.tables == ("chamber",) and run.gyros == () and run.manifest.duration_s == 299.5
    chamber = run.chamber()
    np.testing.assert_allclose(chamber["air_temp_c"], 20.0 + 0.02e-9 * chamber["time_ns"])
    assert verify(folder, decode_run).passed and "<svg" in render_page(run_page(run_content(run)))
    for read in (read_mapped_runs, load_gap_runs):
        with pytest.raises(ConfigurationError, match="no gyro"):
            read(tmp_path / "map.toml" if read is read_mapped_runs else folder)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    log, mapping = write(tmp_path, "csv", frame())
    return import_log(log, mapping, tmp_path / "runs")


def test_csv_and_parquet_are_read_by_pandas(run: Path, tmp_path: Path) -> None:
    kept = Run.open(run)
    for kind, read in (("csv", pd.read_csv), ("parquet", pd.read_parquet)):
        out = export_run(run, kind, tmp_path / kind)
        for name, table in {
            "gyro_fog": kept.gyro("fog"),
            "turntable": kept.turntable(),
            "chamber": kept.chamber(),
        }.items():
            found = read(out / f"{name}.{kind}")
            assert list(found.columns) == list(table)
            for column, values in table.items():
                np.testing.assert_array_equal(found[column].to_numpy().astype(values.dtype), values)
        events = read(out / f"events.{kind}")
        rows = [{"time_s": a, "kind": b} | json.loads(c) for a, b, c in events.itertuples(index=False)]
        assert rows == [dict(row) for row in kept.events]


def test_mdf4_is_read_by_asammdf(run: Path, tmp_path: Path) -> None:
    kept = Run.open(run).gyro("fog")
    out = export_run(run, "mdf4", tmp_path / "log.mf4")
    with warnings.catch_warnings(), MDF(out) as mdf:
        warnings.simplefilter("ignore")
        signal = mdf.get("gyro_fog.rate_dps")
        assert signal.unit == "deg/s" and mdf.get("gyro_fog.temp_c").unit == "degC"
        np.testing.assert_array_equal(signal.samples, kept["rate_dps"])
        np.testing.assert_allclose(signal.timestamps, kept["time_ns"] * 1e-9, rtol=0, atol=1e-9)
        assert mdf.get("phase").samples.tolist() == [b"equilibrium", b"reference", b"shock"]
        assert mdf.start_time.isoformat() == "2026-10-05T08:00:00+00:00"


def test_blf_is_read_by_python_can(run: Path, tmp_path: Path) -> None:
    """Two units: frames of 11 and 29 bits with noise between, times on the line between arrivals."""
    lines = [encode_frame(5 + k, bytes([k] * (k % 9)), extended=bool(k % 2)) for k in range(40)]
    stream = b"\r\r" + b"".join(lines[:20]) + b"t1\xff\r" + b"".join(lines[20:])
    end_s = np.array([1.0, 3.0])
    for name, shift_s in (("can_a", 0.0), ("can_b", 0.5)):
        (run / "raw" / f"{name}.bin").write_bytes(stream)
        marks = np.array([[0, (end_s[0] + shift_s) * 1e9], [len(stream), (end_s[1] + shift_s) * 1e9]], "<i8")
        (run / "raw" / f"{name}.idx").write_bytes(marks.tobytes())
    manifest = read_manifest(run)
    gyros = [{"name": name, "interface": "socketcan", "channel": "can0"} for name in ("can_a", "can_b")]
    write_manifest(run, manifest.model_copy(update={"bench": {**manifest.bench, "gyro": gyros}}))
    out = export_run(run, "blf", tmp_path / "log.blf")
    with can.BLFReader(out) as reader:
        messages = list(reader)
    assert len(messages) == 80
    started_s = pd.Timestamp("2026-10-05T08:00:00Z").timestamp()
    times = [message.timestamp - started_s for message in messages]
    assert times == sorted(times)
    for channel, shift_s in ((0, 0.0), (1, 0.5)):
        own = [message for message in messages if message.channel == channel]
        ends = np.cumsum([2, *[len(line) for line in lines[:20]], 4 + len(lines[20]), *map(len, lines[21:])])[
            1:
        ]
        for k, (message, end) in enumerate(zip(own, ends, strict=True)):
            assert (message.arbitration_id, message.is_extended_id) == (5 + k, bool(k % 2))
            assert bytes(message.data) == bytes([k] * (k % 9))
            expected_s = end_s[0] + shift_s + 2.0 * end / len(stream)
            assert message.timestamp - started_s == pytest.approx(expected_s, abs=2e-6)


@pytest.mark.parametrize(("kind", "message"), [("xlsx", "no such export format"), ("blf", "no gyro on CAN")])
def test_exports_that_cannot_be_leave_nothing(run: Path, tmp_path: Path, kind: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        export_run(run, kind, tmp_path / "out" / "log")
    assert not (tmp_path / "out" / "log").exists()
    (tmp_path / "there").mkdir()
    with pytest.raises(ConfigurationError, match="of that name"):
        export_run(run, "csv", tmp_path / "there")
