"""The report, the calibration file and the command from a record to both."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.calibration import (
    PARAMETER_NAMES,
    PARAMETERS,
    UNIT_SIZE,
    ImuCompensation,
    Schedule,
    Task,
    evaluate,
    load_scheme,
)
from bench.analysis.calibration._calibrate import load_record
from bench.analysis.calibration._conventions import unpack
from bench.analysis.common.uncertainty import Budget, Contribution
from bench.present.cli import _scheme as commands
from bench.present.cli.fit._unit import calibration
from bench.present.report import CalibrationContent, calibration_page, render_page
from benchmarks._turned_imu import ImuRecord, Rest, Turn, measure_motion
from drivers.base.errors import ConfigurationError, RecordError
from simulators.plant.imu import ImuErrors, ImuNoise

TASK = Task()
HEADER = (
    "time_s,gyro_x_dps,gyro_y_dps,gyro_z_dps,accelerometer_x_mps2,accelerometer_y_mps2,accelerometer_z_mps2"
)


def simulated(schedule: Schedule, errors: ImuErrors, rate_hz: float) -> ImuRecord:
    legs: list[Rest | Turn] = [Rest(schedule.dwell_s)]
    for move in schedule.moves:
        legs += [
            Turn(np.eye(3)[move.axis], math.radians(move.angle_deg), schedule.turn_s(move)),
            Rest(schedule.dwell_s),
        ]
    noise = ImuNoise(TASK.noise.arw, TASK.noise.vrw)
    site = TASK.site
    return measure_motion(
        schedule.home,
        legs,
        errors,
        noise,
        latitude_deg=site.latitude_deg,
        gravity_mps2=site.gravity_mps2,
        rate_hz=rate_hz,
        seed=1,
    )


def written(path: Path, record: ImuRecord) -> Path:
    time = record.period_s * np.arange(1, len(record.angle_rad) + 1)
    rate, force = np.degrees(record.angle_rad) / record.period_s, record.velocity_mps / record.period_s
    np.savetxt(path, np.column_stack([time, rate, force]), "%.12g", ",", header=HEADER, comments="")
    return path


def test_a_record_becomes_a_calibration_file_and_a_page(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    schedule = load_scheme("o8").with_(dwell_s=60.0)
    truth = np.random.default_rng(3).standard_normal(24) * TASK.prior_sigma[PARAMETERS]
    path = written(tmp_path / "record.csv", simulated(schedule, ImuErrors(*unpack(truth)), 50.0))
    calibration(
        path,
        "o8",
        out=tmp_path / "out",
        dwell_s=60.0,
        latitude_deg=TASK.site.latitude_deg,
    )
    assert "eps_x" in capsys.readouterr().out
    saved = ImuCompensation.load(tmp_path / "out" / "compensation.gyrocomp")
    assert saved.unit_id == "record" and saved.scheme == "o8" and len(saved.runs["record"]) == 64
    file = json.loads((tmp_path / "out" / "calibration.json").read_text())
    z = []
    for name, true in zip(PARAMETER_NAMES, truth / UNIT_SIZE[PARAMETERS], strict=True):
        row = file["parameters"][name]
        z.append((row["value"] - true) / row["sigma"])
    assert np.sqrt(np.mean(np.square(z))) < 1.6 and np.abs(z).max() < 4.0
    page = (tmp_path / "out" / "report.html").read_text()
    # the sigma that was reached, not the one that was predicted
    target = dict(zip(PARAMETER_NAMES, TASK.target_sigma / UNIT_SIZE[PARAMETERS], strict=True))
    over = {name: row["sigma"] / target[name] for name, row in file["parameters"].items()}
    missed = sorted((name for name in over if over[name] > 1.0), key=lambda name: -over[name])
    assert missed and f": {', '.join(f'{name} {over[name]:.2f} x' for name in missed)}." in page
    assert (
        "Calibration by o8" in page and "Estimate" in page and page.count("<svg") == 2 + 24
    )  # and the course of each parameter


def test_a_csv_record_needs_scheme_and_latitude(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="--scheme and --latitude-deg"):
        calibration(tmp_path / "record.csv", out=tmp_path / "out")


def test_unreadable_records_are_named(tmp_path: Path) -> None:
    def refused(text: str, match: str) -> None:
        path = tmp_path / "bad.csv"
        path.write_text(text)
        with pytest.raises((ConfigurationError, RecordError), match=match):
            load_record(path, scheme="19-position", latitude_deg=48.0)

    refused("time_s,gyro_x_dps\n0,1\n", "no such column")
    refused(f"{HEADER}\n", "cannot be read")
    refused(f"{HEADER}\n0,a,b,c,d,e,f\n", "cannot be read")
    refused(f"{HEADER}\n0,0,0,0,0,0,9.8\n", "empty")
    refused(f"{HEADER}\n0,0,0,0,0,0,9.8\n0.01,0,zz,0,0,0,9.8\n", "not one of numbers")
    refused(f"{HEADER}\n0.01,0,0,0,0,0,9.8\n0.00,0,0,0,0,0,9.8\n", "do not grow")
    with pytest.raises(ConfigurationError, match="cannot be read"):
        load_record(tmp_path / "none.csv", scheme="19-position", latitude_deg=48.0)


def test_the_page_of_a_scheme_shows_every_state_against_its_target(tmp_path: Path) -> None:
    commands.evaluate("19-position-z-up", json=True, out=tmp_path / "scheme.html")
    page = (tmp_path / "scheme.html").read_text()
    evaluation = evaluate(TASK, load_scheme("19-position-z-up"))
    missed = int(np.sum(evaluation.sigma[PARAMETERS] > TASK.target_sigma))
    assert f"{missed} targets missed" in page
    assert all(f">{name}</" in page for name in PARAMETER_NAMES)
    assert "Kg_zz" in page.rpartition("Poorly seen combinations")[2]
    assert "http" not in page.replace("http-equiv", "")


def test_the_heat_map_has_a_cell_for_every_state_and_position() -> None:
    evaluation = evaluate(TASK, load_scheme("t10"))
    page = render_page(calibration_page(CalibrationContent(evaluation)))
    heat = page[page.index("Gain of every state") :]
    assert heat.count("fill-opacity") + heat.count("opacity:") >= 30 * 11 - 60


def test_the_page_has_what_noise_and_bench_make_of_every_parameter() -> None:
    """3 ppm of noise beside 4 ppm of the time base: 5 ppm, 9.8 ppm for 95 %, of which noise makes 36 %."""
    noise = Contribution("noise", 3.0, kind="A", origin="filter")
    time_base = Contribution("time_base_ppm", 4.0, origin="C-7")
    small = Contribution("latitude_deg", 1e-3, origin="assumed")
    content = CalibrationContent(
        evaluate(TASK, load_scheme("t10")), budgets={"Kg_xx": Budget(12.0, (noise, time_base, small))}
    )
    page = render_page(calibration_page(content)).rpartition("Uncertainty of the parameters")[2]
    cells = re.findall(r"<td[^>]*>(?:<[^>]*>)*([^<]*)", page.partition("Kg_xx")[2])[:5]
    assert cells == ["12.00", "9.8", "ppm", "36.0", "time base 64.0 %, C-7"]
