"""Emulated ring lasers through their bytes: ramps, regression, its equation on other runs; the standards."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from typer.testing import CliRunner

from bench.analysis.common.state_file import read_state
from bench.analysis.compensations import load_compensation
from bench.analysis.figures import standard_figures
from bench.analysis.figures._record import Record
from bench.analysis.rlg import RampRun, RlgCompensation, load_ramp_runs
from bench.control.procedure import find_procedure
from bench.control.progress import Progress
from bench.lab.emulated import Plant, unit_seed
from bench.lab.rehearsal import rehearse_procedure
from bench.present.cli._app import app
from bench.record.benchfile import load_bench_file
from bench.record.events.run import Interval, Prompt, RateDemand, Series
from bench.record.recording import Run, read_manifest
from drivers.base.errors import ConfigurationError
from procedures._by_noise import AtRest
from simulators.plant.rlg import RLG_NOISE, rlg_coefficients

BENCH = """
[bench]
name = "ring lasers"
latitude_deg = 39.1
[table]
driver = "acutrol3000"
port = "/dev/ttyUSB0"
[chamber]
driver = "weiss"
port = "/dev/ttyUSB9"
"""
GYRO = """
[[gyro]]
name = "rlg_{n}"
driver = "rlg2t"
port = "/dev/ttyUSB{n}"
baudrate = 115200
rate_hz = 2
axes = "x"
axis = "x"
unit = "RLG-00{n}"
"""
UNITS = ("RLG-001", "RLG-002")
PROFILE = {"low_c": "15", "high_c": "45", "ramp_k_per_min": "1.5", "dwell_min": "8", "warm_up_min": "0"}
RAMPS = {
    "train": {"east_dwell_s": "60"},
    "repeat": {},
    "reverse": {"downwards": "true"},
    "faster": {"ramp_k_per_min": "3"},
    "partial": {"low_c": "20", "high_c": "40"},
}
VARIABLES = ("T1", "T2", "dT1", "T1*dT1", "dT1^2", "T1-T2")


def record(
    bench: SimpleNamespace,
    home: Path,
    name: str,
    gyros: int,
    seed: int,
    settings: dict[str, str],
    display=None,
    **plant,
) -> Path:
    """Run a procedure on an emulated lab of so many ring lasers and return its folder, truth beside it."""
    path = home / f"{gyros}.toml"
    path.write_text(BENCH + "".join(GYRO.format(n=n) for n in range(1, gyros + 1)))
    procedure = find_procedure(name)
    result = rehearse_procedure(
        procedure,
        procedure.parse(settings),
        load_bench_file(path),
        Plant(seed=seed, **plant),
        home,
        display,
        run_id=f"{name}-{seed}",
    )
    assert result.outcome == "completed", result.reason
    return result.folder


@pytest.fixture(scope="module")
def ramps(bench: SimpleNamespace, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Run folders by kind, each with noise, turn-on and settling of its own."""
    home = tmp_path_factory.mktemp("ramps")
    quick = {"search_east": "false"}
    return {
        kind: record(
            bench, home, "thermal-ramp", 2, seed, PROFILE | (changed if kind == "train" else changed | quick)
        )
        for seed, (kind, changed) in enumerate(RAMPS.items(), start=1)
    }


@pytest.fixture(scope="module")
def fitted(ramps: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("fit")
    tests = [part for kind in ("repeat", "reverse", "faster", "partial") for part in ("--test", ramps[kind])]
    words = ["fit", "stepwise", ramps["train"], *tests, "--out", out, "--variables", ",".join(VARIABLES)]
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, f"{result.output}\n{result.exception}"
    assert all(f"unit {unit}" in result.output for unit in UNITS)
    return out


def by_unit(folder: Path) -> dict[str, RampRun]:
    return {run.unit_id: run for run in load_ramp_runs(folder)}


def test_the_rows_hold_what_the_plant_did(ramps: dict[str, Path]) -> None:
    for unit, run in by_unit(ramps["train"]).items():
        assert run.unit_id == unit and run.remarks == () and (run.segment == 0).all()
        # 30 K at 1.5 K/min twice, 8 min twice; the ramps end when the air is within a degree
        assert len(run.time_s) == pytest.approx((2 * 30 / 1.5 + 16) * 60 / 100, abs=2)
        noise = run.bias_dph - run.true_bias_dph
        # white noise of 6 N in means of 100 s, and an angle quantum of 0.3 arcsec read at both ends of them
        floor = np.hypot(6.0 * RLG_NOISE.arw_deg_per_sqrt_h, RLG_NOISE.quantum_arcsec / np.sqrt(6.0) / 100.0)
        assert np.std(noise, ddof=1) == pytest.approx(floor, rel=0.5)
        # east is known to about 0.3 min of arc after four dwells of a minute
        assert abs(noise.mean()) < 5e-3
        assert np.ptp(run.case_c) > 15.0 and run.case_rate.max() > 0.8 and run.case_rate.min() < -0.8
        # 2 W into a block of 350 J/K, 0.30 W/K from it to the case
        assert np.allclose(run.block_c - run.case_c, (2.0 - 350.0 * run.block_rate / 60.0) / 0.30, atol=0.3)
    runs = by_unit(ramps["train"])
    assert not np.array_equal(runs[UNITS[0]].bias_dph, runs[UNITS[1]].bias_dph)


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("kind", ["repeat", "reverse", "faster", "partial"])
def test_the_equation_of_one_run_takes_the_drift_off_another(
    ramps: dict[str, Path], fitted: Path, unit: str, kind: str
) -> None:
    path = fitted / unit / "compensation.gyrocomp"
    said = read_state(path)
    run = by_unit(ramps[kind])[unit]
    t1, t2, rate = run.case_c, run.block_c, run.case_rate
    terms = dict(zip(VARIABLES, (t1, t2, rate, t1 * rate, rate**2, t1 - t2), strict=True))
    pairs = zip(said["variables"], said["coefficients"], strict=True)
    drift = said["intercept_dph"] + sum(value * terms[name] for name, value in pairs)
    compensation = load_compensation(path)
    assert isinstance(compensation, RlgCompensation)
    alone = replace(compensation, smooth=None, smooth_share=0.0)
    assert np.allclose(alone.drift_dph(run), drift, rtol=0, atol=1e-12)
    before = np.std(run.bias_dph, ddof=1)
    after = np.std(run.bias_dph - compensation.drift_dph(run), ddof=1)
    assert 1.0 - after / before > 0.65  # the paper's figure
    page = (fitted / unit / "report.html").read_text()
    assert f"{before:.5f}" in page and f"{after:.5f}" in page
    other = UNITS[1 - UNITS.index(unit)]
    with pytest.raises(ConfigurationError, match="another unit"):
        compensation.drift_dph(by_unit(ramps[kind])[other])


STANDARD = {
    "grade": "rlg",
    "warm_up_min": "10",
    "bias_min": "10",
    "power_cycles": "1",
    "noise_h": "0.5",
    "step_dwell_s": "60",
    "east_dwell_s": "60",
    "smallest_step_dph": "0.3",
    "rates_per_sign": "2",
    "sequences": "1",
    "rate_dwell_s": "10",
    "temperatures": "false",
}


def test_a_ring_laser_through_the_test_plan_of_the_standards(bench: SimpleNamespace, tmp_path: Path) -> None:
    shown: list[Progress] = []
    skew = {"mount_tilt_deg": 0.2, "lean_deg": {"rlg_1": (-0.05, 0.03)}}
    folder = record(bench, tmp_path, "standard-test", 1, 5, STANDARD, shown.append, **skew)
    figures = standard_figures(folder)
    # nobody lays hands on a table that turns
    told = [event for _, event in Run.open(folder).of(Prompt | RateDemand)]
    asked = [k for k, event in enumerate(told) if isinstance(event, Prompt) and "unit" in event.question]
    assert len(asked) == 6  # two mountings, three turns, a power cycle
    before = [[e for e in told[:k] if isinstance(e, RateDemand)][-1:] for k in asked]
    assert all(each[0].rate_dps == 0.0 for each in before if each)
    assert sum(map(len, before)) >= 4
    # turned over in its fixture the unit shows what is its own; a milliradian of 0.2 deg is 0.0002 deg
    for way, true in (("along", 0.03), ("across", -0.05)):
        name = f"input-axis misalignment, component {way} the table"
        assert figures.value(name) == pytest.approx(true, abs=2e-3)
    assert figures.value("input-axis elevation, unit in its fixture") == pytest.approx(0.23, abs=2e-3)
    assert [what for what, _ in figures.missing] == ["temperature sensitivity"]
    assert figures.unit_id == "RLG-001"
    unit = rlg_coefficients(unit_seed("RLG-001"), 5)
    n = RLG_NOISE.arw_deg_per_sqrt_h
    assert figures.value("scale factor") == pytest.approx(1.0 + 1e-6 * unit.sf_offset_ppm, abs=3e-6)
    assert figures.value("threshold") == figures.value("resolution") == pytest.approx(0.3)
    walk = next(figure for figure in figures.figures if figure.name == "angle random walk")
    assert walk.low <= n <= walk.high
    # The power cycle is no loss, neither of the samples of its minute nor of nearly 65 536; also while it runs.
    lost = read_manifest(folder).stream["rlg_1"]["lost"]
    assert lost == 0
    assert shown[-1].gyros["rlg_1"].lost == pytest.approx(lost, abs=5)
    assert max(progress.gyros["rlg_1"].lost for progress in shown) <= lost + 5


def test_dwells_and_repeats_follow_from_the_noise_that_the_test_has_measured(
    bench: SimpleNamespace, tmp_path: Path
) -> None:
    settings = {
        name: value for name, value in STANDARD.items() if name not in ("step_dwell_s", "power_cycles")
    }
    settings |= {"power_cycles": "0", "steps_h": "0.5", "smallest_step_dph": "0.01"}
    folder = record(bench, tmp_path, "standard-test", 1, 6, settings)
    run = Run.open(folder)
    (told,) = (event for _, event in run.of(Series))
    inputs, dwells, repeats, errors = told.columns.values()
    (noise,) = (row for _, row in run.of(Interval) if row.test == "noise")
    means = Record(run, "rlg_1", 0.0).seconds_dph(noise)
    for dwell_s, count, error in zip(dwells, repeats, errors, strict=True):
        single = AtRest.of_means(means).difference_dph(dwell_s, 30.0)
        expected = single * math.sqrt((4.0 * count - 1.0) / (3.0 * count**2))
        assert error == pytest.approx(expected, rel=0.2)  # bytes come four seconds at a time
    # 7.2 standard errors of an input are enough; those that half an hour has no time for are left out
    shown = run.manifest.measured("smallest_input_shown")
    assert shown == inputs[0] and 7.2 * errors[0] <= shown
    for test in ("threshold", "resolution"):
        rows = [row for _, row in run.of(Interval) if row.test == test]
        assert sum(row.end_s - row.start_s for row in rows) <= 1800.0
        for step, (size, dwell_s, count) in enumerate(
            zip(inputs, dwells, repeats, strict=True), 5 - len(inputs)
        ):
            own = [row for row in rows if row.step == step]
            assert [row.input_dph for row in own] == pytest.approx([0.0, -size] * int(count) + [0.0])
            assert [row.end_s - row.start_s for row in own] == pytest.approx([dwell_s] * len(own), abs=0.1)
    assert standard_figures(folder).value("threshold") == pytest.approx(shown)
