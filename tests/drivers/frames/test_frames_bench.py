"""A gyro known only by its description, through the whole bench: emulated, recorded, decoded, verified."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from bench.control.procedure import Demands, Parameters, Procedure, parameter
from bench.control.questions import AssumeYes
from bench.control.run_record import decode_run
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.present.cli._app import app
from bench.present.report import report_run
from bench.record.benchfile import bench_file_text, load_bench_file
from bench.record.recording import read_manifest, verify
from drivers.base.errors import ConfigurationError
from drivers.frames import shipped
from tests.benches import BENCH

STIM = """
[[gyro]]
name = "stim"
driver = "frames"
description = "stim300"
frame_format = "rate_acc_temp"
port = "/dev/ttyUSB1"
rate_hz = 125
axes = "xyz"
axis = "z"
unit = "STIM-1"
"""


class SpinParameters(Parameters):
    hold_s: float = parameter(30.0, "time at rate", "s", ge=0)


def spin(bench, p) -> None:
    bench.table.device.servo_on()
    bench.chamber.go_to(25.0)
    bench.chamber.start()
    bench.table.spin(5.0)
    bench.phase("spin")
    bench.wait(p.hold_s, "turning")
    bench.table.stop()


SPIN = Procedure(
    name="spin",
    title="A turn",
    source="tests",
    parameters=SpinParameters,
    run=spin,
    expected_duration_s=lambda p: p.hold_s,
    demands=lambda p: Demands(5.0, 25.0, 25.0, 0.0),
)


def bench_file(folder: Path, gyros: str):
    (folder / "lab.toml").write_text(BENCH + gyros)
    return load_bench_file(folder / "lab.toml")


def run(file, folder: Path, **plant):
    with EmulatedLab(file, Plant(seed=3, **plant)) as lab:
        request = RunRequest(SPIN, SPIN.parse({}), lab.file, folder, AssumeYes(), None, "run")
        return run_procedure(request)


def test_a_described_gyro_is_a_gyro_like_any_other(tmp_path: Path) -> None:
    file = bench_file(tmp_path, STIM)
    assert file.gyro[0].baudrate == 921600  # the description's, as the bench file has none
    result = run(file, tmp_path / "runs", clock_error_ppm={"stim": 50.0})
    assert result.outcome == "completed", result.reason
    table = pq.read_table(result.folder / "gyro_stim.parquet").to_pandas()
    assert table["lost_before"].sum() == 0 and table["valid"].all()
    # 2000 counts a second, 16 a sample; the fitted clock is the emulated one's.
    assert set(np.diff(table["counter"])) == {16}
    assert np.median(np.diff(table["time_ns"])) == pytest.approx(8e6 / (1 + 50e-6), abs=1)
    stream = read_manifest(result.folder).stream["stim"]
    assert stream["clock_error_ppm"] == pytest.approx(50.0, abs=20.0)
    turning = table.iloc[len(table) // 2 : len(table) // 2 + 500]
    up = 15.041 / 3600 * math.sin(math.radians(39.10))
    assert turning["rate_y_dps"].mean() == pytest.approx(5.0 + up, abs=0.1)  # z lies level, so y is up
    temps = [name for name in table.columns if "_temp_" in name and name.endswith("_c")]
    assert temps == [f"{part}_temp_{axis}_c" for part in ("gyro", "acc") for axis in "xyz"]
    assert {f"accelerometer_{axis}_mps2" for axis in "xyz"} <= set(table.columns)
    assert table["temp_c"].between(15, 45).all()
    problems = verify(result.folder, decode_run).problems
    assert [str(problem) for problem in problems] == []


STIM300 = """
[[gyro]]
name = "unit"
driver = "stim300"
port = "/dev/ttyUSB1"
frame_format = "rate_acc_pps"
baudrate = 460800
rate_hz = 500
axis = "z"
axes = "xyz"
unit = "S-1"
"""
VECTORNAV = """
[[gyro]]
name = "unit"
driver = "frames"
description = "vectornav"
frame_format = "rate_accel_sync"
port = "/dev/ttyUSB1"
rate_hz = 100
axis = "z"
axes = "xyz"
unit = "V-1"
pulse_interval_s = 0.5
"""


@pytest.mark.parametrize(("gyro", "interval_s"), [(STIM300, 1.0), (VECTORNAV, 0.5)])
def test_the_clock_of_a_unit_with_pulses_is_told_against_them(tmp_path: Path, gyro, interval_s) -> None:
    result = run(bench_file(tmp_path, gyro), tmp_path / "runs", clock_error_ppm={"unit": 70.0})
    assert result.outcome == "completed", result.reason
    pulses = read_manifest(result.folder).stream["unit"]["pulses"]
    assert pulses["missed"] == 0 and pulses["interval_s"] == interval_s
    table = pq.read_table(result.folder / "gyro_unit.parquet").to_pandas()
    span_s = np.ptp(table["time_ns"]) * 1e-9
    assert pulses["pulses"] == pytest.approx(span_s / interval_s, abs=1.01)
    # the emulated unit's clock is 70 ppm fast; the bench runs on the lab's own time
    assert pulses["unit_clock_error_ppm"] == pytest.approx(70.0, abs=0.05)
    assert abs(pulses["bench_clock_error_ppm"]) < 3.0 * pulses["bench_clock_uncertainty_ppm"] + 1.0
    assert table["since_pulse_s"].between(0.0, interval_s * 1.0001).all()
    # sample times that the record states, less the time since the pulse, lie on whole intervals of the lab's time
    off_s = np.remainder(table["time_ns"] * 1e-9 - table["since_pulse_s"] + 0.5 * interval_s, interval_s)
    assert np.abs(off_s - 0.5 * interval_s).max() < 0.1 / 100.0
    assert not [text for text in result.warnings if "pulse" in text]
    said = CliRunner().invoke(app, ["runs", "show", str(result.folder)], env={"COLUMNS": "200"}).output
    assert f"{pulses['unit_clock_error_ppm']:+.4f} ± {pulses['unit_clock_uncertainty_ppm']:.1g}" in said
    page = report_run(result.folder).read_text()
    assert f"{pulses['pulses']}" in page and "Clocks against the pulses" in page


def test_pulses_at_another_interval_are_missing_ones(tmp_path: Path) -> None:
    plant = {"actual": {"unit": {"pulse_interval_s": 2.0}}}
    result = run(bench_file(tmp_path, STIM300), tmp_path / "runs", **plant)
    assert any("pulses at the unit's input are missing" in text for text in result.warnings)


def test_a_unit_that_tells_of_no_pulses_has_no_interval(tmp_path: Path) -> None:
    gyro = STIM300.replace('"stim300"', '"kvh1750"').replace('frame_format = "rate_acc_pps"\n', "")
    with pytest.raises(ConfigurationError, match="pulse_interval_s"):
        bench_file(tmp_path, gyro + "pulse_interval_s = 0.5\n")


def test_a_description_of_ones_own_travels_with_the_run(tmp_path: Path) -> None:
    text = shipped()["stim300"].read_text().replace('name = "stim300"', 'name = "ours"')
    (tmp_path / "ours.toml").write_text(text)
    gyro = STIM.replace('description = "stim300"', 'description = "ours.toml"')
    file = bench_file(tmp_path, gyro)
    written = tmp_path / "again.toml"
    written.write_text(bench_file_text(file))
    (tmp_path / "ours.toml").unlink()
    assert load_bench_file(written).gyro == file.gyro
    result = run(load_bench_file(written), tmp_path / "runs")
    assert result.outcome == "completed", result.reason
    assert decode_run(result.folder, tmp_path)["stim"].frames > 1000


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('"stim300"', '"stim30"'), "did you mean 'stim300'"),
        (('"stim300"', '"absent.toml"'), "absent.toml"),
        (('description = "stim300"\n', ""), "description"),
        (('"frames"', '"rlg2t"'), "description"),
        (('"stim300"\nframe_format = "rate_acc_temp"', '"fg333"'), "no gyro channel x"),
        (('"rate_acc_temp"', '"rate_acc_tmp"'), "did you mean 'rate_acc_temp'"),
    ],
)
def test_bad_descriptions_are_refused_before_anything_is_opened(tmp_path, change, message) -> None:
    with pytest.raises(ConfigurationError, match=message):
        bench_file(tmp_path, STIM.replace(*change))
