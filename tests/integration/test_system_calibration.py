"""From bench file to calibration: the procedure drives an emulated two-axis table by bytes, the fit reads it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from bench.analysis.calibration import ImuCompensation, Task, load_calibration_run, load_scheme, plan_turns
from bench.analysis.calibration._estimator import Options, estimate
from bench.analysis.gap._run_folder import load_gap_runs
from bench.present.cli._app import app
from bench.present.cli.fit._unit import calibration
from bench.record.recording import Run
from drivers.base.errors import ConfigurationError, RecordError

BENCH = Path("examples/two_axis.toml")
SCHEME, DWELL_S = "t10", 40.0


CERTIFICATE = """
[[calibration]]
quantity = "time_base_ppm"
instrument = "house clock"
certificate = "K-77"
date = 2026-05-04
due = 2030-05-04
error = 3.0
uncertainty = 1.0
"""


def rehearse(runs, *settings, bench=BENCH):
    pairs = [part for setting in settings for part in ("--set", setting)]
    command = ["rehearse", "system-calibration", "--bench", str(bench), "--runs", str(runs), "--seed", "3"]
    return CliRunner().invoke(app, [*command, *pairs])


@pytest.fixture(scope="module")
def run(tmp_path_factory) -> Path:
    runs = tmp_path_factory.mktemp("runs")
    bench = Path(
        shutil.copytree(BENCH.parent, tmp_path_factory.mktemp("bench"), dirs_exist_ok=True), BENCH.name
    )
    bench.write_text(bench.read_text() + CERTIFICATE)
    settings = (f"scheme={SCHEME}", f"dwell_s={DWELL_S:g}", "warm_up_min=0", "rate_dps=20")
    result = rehearse(runs, *settings, bench=bench)
    assert result.exit_code == 0, result.output
    (folder,) = runs.iterdir()
    return folder


def test_the_run_holds_the_scheme_turned_by_the_table(run):
    scheme = load_scheme(SCHEME)
    found = load_calibration_run(run)
    assert [str(move) for move in found.schedule.moves] == [str(move) for move in scheme.moves]
    np.testing.assert_allclose(found.schedule.home[2], scheme.home[2], atol=1e-9)
    assert found.table == "two-axis-horizontal" and found.unit_id == "IMU-001"
    (certificate,) = found.certificates
    assert (certificate.quantity, certificate.certificate, certificate.error) == (
        "time_base_ppm",
        "K-77",
        3.0,
    )
    assert found.mounting == Run.open(run).manifest.mounting != ""
    # The telemetry of both axes at the end of every dwell is the plan's.
    recorded = Run.open(run)
    table = recorded.turntable()
    seconds = table["time_ns"] / 1e9
    turns = [row for row in recorded.events if row["kind"] == "turn"]
    dwells = [phase for phase in recorded.phases() if phase.name == "dwell"][1:]
    for turn, dwell in zip(turns, dwells, strict=True):
        column = "angle_deg" if turn["axis"] == "inner" else "outer_angle_deg"
        at = np.searchsorted(seconds, dwell.end_s) - 1
        assert (table[column][at] - turn["to_deg"] + 180.0) % 360.0 - 180.0 == pytest.approx(0.0, abs=0.002)
    turned = np.abs(table["outer_rate_dps"]).max(), np.abs(table["rate_dps"]).max()
    assert turned == pytest.approx((20.0, 20.0), rel=1e-3)


def test_a_gap_diagnosis_sees_each_position_at_its_attitude(run):
    (seen,) = load_gap_runs(run)
    still = ~np.isnan(seen.output_dph)
    earth = seen.stimulus.input_rate_dph[still]
    assert np.ptp(earth) > 15.0
    assert len(set(seen.phase.tolist())) == load_scheme(SCHEME).positions
    # what is left is the unit's bias and the lean of its axes, up to 0.1 deg of 15 deg/h
    slope, _ = np.polyfit(earth, seen.output_dph[still], 1)
    assert slope == pytest.approx(1.0, abs=0.02)


def test_the_fit_finds_the_units_errors_within_their_sigma(run, tmp_path, capsys):
    calibration(run, out=tmp_path)
    printed = capsys.readouterr().out
    assert "truth" in printed and "innovations rms" in printed
    saved = ImuCompensation.load(tmp_path / "compensation.gyrocomp")
    truth = load_calibration_run(run).truth
    assert truth is not None
    z = (saved.parameters - truth) / saved.sigma
    assert np.sqrt(np.mean(z**2)) < 1.7 and np.abs(z).max() < 4.5
    assert 0.9 < saved.innovation_rms < 1.1
    assert saved.unit_id == "IMU-001" and list(saved.runs) == [run.name]
    page = (tmp_path / "report.html").read_text()
    assert "NEES" in page and "Beside the classical schemes" in page


def test_the_file_takes_the_errors_out_of_the_run(run, tmp_path):
    """At rest a corrected unit reads gravity and Earth rate whichever way up; the raw one does not."""
    calibration(run, out=tmp_path)
    saved = ImuCompensation.load(tmp_path / "compensation.gyrocomp")
    recorded = load_calibration_run(run)
    data = recorded.increments
    rate, force = np.degrees(data.angle_rad) / data.period_s, data.velocity_mps / data.period_s
    gravity = Task().site.gravity_mps2

    def spread(rate, force):
        starts = [p.start_s for p in Run.open(run).phases() if p.name == "dwell"]
        rests = [slice(round((s - starts[0] + 2) * 100), round((s - starts[0] + 38) * 100)) for s in starts]
        up = np.array([np.linalg.norm(force[rest].mean(axis=0)) for rest in rests])
        earth = np.array([np.linalg.norm(rate[rest].mean(axis=0)) for rest in rests])
        return np.abs(up - gravity).max(), np.abs(earth * 3600.0 - 15.041067).max()

    raw = spread(rate, force)
    corrected = spread(*saved.apply("IMU-001", data.period_s, rate, force))
    assert corrected[0] < 1e-4 < 5e-3 < raw[0]  # 10 ug against half a mg
    assert corrected[1] < 0.04 < 0.08 < raw[1]  # deg/h


def test_a_heading_that_the_table_forces_is_noted_with_its_cost(run):
    notes = [row["text"] for row in Run.open(run).events if row["kind"] == "note"]
    forced = not np.allclose(load_calibration_run(run).schedule.home, load_scheme(SCHEME).home)
    costly = [text for text in notes if "worst sigma over target" in text]
    assert len(costly) == (1 if forced else 0), notes


def broken(run: Path, tmp_path: Path) -> Path:
    copy = tmp_path / "copy"
    shutil.copytree(run, copy)
    return copy


def rewrite(folder: Path, **columns) -> None:
    path = folder / "gyro_imu_1.parquet"
    table = pq.read_table(path)
    for name, change in columns.items():
        at = table.column_names.index(name)
        values = table.column(name).to_numpy().copy()
        table = table.set_column(at, name, pa.array(change(values)))
    pq.write_table(table, path)


def test_lost_and_faulty_samples_are_named(run, tmp_path):
    copy = broken(run, tmp_path)

    def lose(values):
        values[20000] = 3
        return values

    rewrite(copy, lost_before=lose)
    with pytest.raises(
        RecordError,
        match=r"s: samples are missing or marked as faulty. Found: 3 of them, while the unit turns",
    ):
        load_calibration_run(copy)

    def fault(values):
        values[10000:10005] = False
        return values

    rewrite(copy, lost_before=lambda values: values * 0, valid=fault)
    (remark,) = load_calibration_run(copy).remarks
    assert "at rest" in remark and "samples missing 5" in remark


def test_a_missing_position_is_named(run, tmp_path):
    copy = broken(run, tmp_path)
    events = [json.loads(line) for line in (copy / "events.jsonl").read_text().splitlines()]
    last = max(at for at, row in enumerate(events) if row.get("phase") == "dwell")
    del events[last]
    (copy / "events.jsonl").write_text("".join(json.dumps(row) + "\n" for row in events))
    with pytest.raises(RecordError, match=r"positions are missing.*Found: 10 dwells. Expected: 11"):
        load_calibration_run(copy)


def test_a_run_that_stopped_or_of_another_procedure_is_refused(run, tmp_path):
    copy = broken(run, tmp_path)
    text = (copy / "manifest.json").read_text()
    (copy / "manifest.json").write_text(text.replace('"completed"', '"aborted"'))
    with pytest.raises(RecordError, match="system-calibration, aborted"):
        load_calibration_run(copy)
    (copy / "manifest.json").write_text(text.replace("system-calibration", "constant-rotation"))
    with pytest.raises(RecordError, match="constant-rotation, completed"):
        load_calibration_run(copy)


def test_a_wrong_latitude_is_named_before_a_number(run, tmp_path):
    with pytest.raises(RecordError, match="as at latitude 45"):
        calibration(run, out=tmp_path / "out", latitude_deg=46.5)
    assert not (tmp_path / "out").exists()


def test_a_scheme_that_the_table_cannot_turn_is_refused_before_anything_moves(tmp_path):
    assert rehearse(tmp_path, "scheme=o22").exit_code == 3
    (folder,) = tmp_path.iterdir()
    manifest = json.loads((folder / "manifest.json").read_text())
    assert "cannot make turn" in manifest["reason"]
    sent = (folder / "raw" / "table.sent.bin").read_bytes()
    assert b"interlock:close" not in sent and b"demand" not in sent.lower()


@pytest.mark.parametrize(
    ("scheme", "match"), [("24-position", "one of"), ("23-position-d", "does not come back")]
)
def test_no_such_scheme_and_one_that_does_not_close(tmp_path, scheme, match):
    error = rehearse(tmp_path, f"scheme={scheme}").exception
    assert isinstance(error, ConfigurationError) and match in str(error)


def test_an_axis_of_the_plan_is_one_of_the_bench_files(run):
    from bench.analysis.calibration import TableAxis

    recorded = load_calibration_run(run)
    axes = [TableAxis("outer", "east"), TableAxis("inner", "up")]
    plan = plan_turns(load_scheme(SCHEME), axes)
    np.testing.assert_array_equal(plan.schedule.home, recorded.schedule.home)
    found = estimate(recorded.increments, Task(), Options(passes=2, alignment_s=30.0), plan.schedule)
    assert len(found.course) == plan.schedule.positions


def test_a_rehearsal_in_the_field_of_a_unit_with_large_errors(tmp_path):
    """Wind, people and errors ten times as large, from a plant file; the fit is told of the errors alone."""
    field = tmp_path / "field.toml"
    field.write_text(
        "imu_error_scale = 10.0\n[ground]\nsway_mps = 3e-3\nstep_mps = 2e-3\nsteps_per_min = 20\n"
    )
    command = ["rehearse", "system-calibration", "--bench", str(BENCH), "--plant", str(field), "--seed", "3"]
    pairs = ["--set", f"scheme={SCHEME}", "--set", f"dwell_s={DWELL_S:g}", "--set", "warm_up_min=0"]
    result = CliRunner().invoke(app, [*command, *pairs, "--runs", str(tmp_path / "runs")])
    assert result.exit_code == 0, result.output
    (folder,) = (tmp_path / "runs").iterdir()
    with pytest.raises(RecordError, match="needs --prior-scale"):
        calibration(folder, out=tmp_path / "no")
    calibration(folder, out=tmp_path / "fit", prior_scale=10.0)
    found, truth = (
        ImuCompensation.load(tmp_path / "fit/compensation.gyrocomp"),
        load_calibration_run(folder).truth,
    )
    error = found.parameters - truth
    assert error @ np.linalg.solve(found.covariance, error) / 24.0 < 2.0
    assert np.abs(truth[6]) > 1e-3  # a scale factor of 2000 ppm
    page = (tmp_path / "fit/report.html").read_text(encoding="utf-8")
    assert "The table moves" in page and "This table" in page
