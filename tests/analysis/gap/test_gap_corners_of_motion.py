"""Rows in which a table turns, tilts or goes round a corner, logged as they come: a perfect gyro has no gap."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap._align import _Swing, without_corners
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._diagnose import diagnose
from bench.analysis.gap._fit import nominal_solution
from bench.analysis.gap._import import read_mapped_runs
from bench.analysis.gap._jumps import find_jumps
from bench.analysis.gap._model_file import Model, parse_model
from bench.analysis.gap._noise import Noise
from bench.analysis.gap._prepare import prepare
from bench.analysis.gap._rounding_noise import RoundingNoise
from drivers.base.arrays import Array
from tests.analysis.gap.conftest import made_run, stimulus

EARTH_DPH, LATITUDE = 15.0411, np.radians(48.0)
MAPPING = """
format = 1
unit_id = "M"
latitude_deg = 48.0
[columns]
time = { name = "t", unit = "s" }
output = { name = "rate", unit = "deg/h" }
angle = { name = "az", unit = "deg" }
elevation = { name = "el", unit = "deg" }
[[run]]
file = "run_*.csv"
profile = "moves"
"""
SHEET = """
format = 1
[noise]
arw_deg_per_sqrt_h = 0.003
bias_instability_dph = 0.003
[[effect]]
name = "scale_factor"
parameters = { sf_ppm = 0.0 }
sigma = { sf_ppm = 100.0 }
"""
OFFSET = """
[[effect]]
name = "time_offset"
parameters = { offset_ms = 0.0 }
sigma = { offset_ms = 40.0 }
"""


def tilt_deg(t_s: Array) -> Array:
    """45 deg every 100 s, in 9 s each (quintic)."""
    x = [np.clip((t_s - 90.4 - 100.0 * k) / 9.0, 0.0, 1.0) for k in range(7)]
    return np.asarray(45.0 * sum(each**3 * (10.0 - 15.0 * each + 6.0 * each**2) for each in x))


def turned_deg(t_s: Array) -> Array:
    """60, -60, 30 and 0 deg/s; each change takes 1.3 s at constant acceleration."""
    angle, rate = np.zeros_like(t_s), 0.0
    for k, own in enumerate((60.0, -60.0, 30.0, 0.0)):
        since = t_s - 100.7 - 151.3 * k
        begun = np.clip(since, 0.0, 1.3)
        angle += (own - rate) * (begun**2 / 2.6 + np.clip(since - 1.3, 0.0, None))
        rate = own
    return angle


def logs(folder: Path, row_s: float, kind: str, offset_s: float = 0.0) -> list[GapRun]:
    """Four logs of means over rows; angles are those at their ends."""
    count = round(800.0 / row_s)
    ends_s = row_s * np.arange(1, count + 1)
    fine_s = (row_s * (np.arange(50 * count) + 0.5) / 50.0).reshape(count, 50)
    for number in range(4):
        tilts = tilt_deg(fine_s) if kind == "tilts" else np.full(fine_s.shape, 90.0)
        up = np.radians(tilts)
        rate = EARTH_DPH * (np.cos(LATITUDE) * np.cos(up) + np.sin(LATITUDE) * np.sin(up)).mean(axis=1)
        late_s = np.concatenate(([0.0], ends_s)) - offset_s
        turned = turned_deg(ends_s) if kind == "turns" else np.zeros(count)
        if kind == "turns":
            rate += 3600.0 * np.diff(turned_deg(late_s)) / row_s
        rate += np.random.default_rng(number).normal(0.0, 0.003 * 60.0 / np.sqrt(row_s), count)
        elevation = tilt_deg(ends_s) if kind == "tilts" else np.full(count, 90.0)
        rows = np.column_stack((ends_s, rate, turned, elevation))
        np.savetxt(folder / f"run_{number}.csv", rows, "%.6f", ",", header="t,rate,az,el", comments="")
    (folder / "map.toml").write_text(MAPPING)
    return read_mapped_runs(folder / "map.toml")


@pytest.mark.parametrize(("row_s", "most_dph"), [(0.25, 0.02), (0.5, 0.02), (1.0, 0.01), (5.0, 0.01)])
def test_the_earths_rate_is_that_of_the_attitude_within_rows(
    tmp_path: Path, row_s: float, most_dph: float
) -> None:
    run = logs(tmp_path, row_s, "tilts")[0]
    count = len(run.stimulus)
    fine_s = (run.stimulus.period_s * (np.arange(50 * count) + 0.5) / 50.0).reshape(count, 50)
    fine_s += row_s  # a run begins at the first row's stamp
    up = np.radians(tilt_deg(fine_s))
    exact = EARTH_DPH * (np.cos(LATITUDE) * np.cos(up) + np.sin(LATITUDE) * np.sin(up)).mean(axis=1)
    known = np.isfinite(run.output_dph)
    assert known.mean() > 0.7
    assert np.abs(run.stimulus.input_rate_dph - exact)[known].max() < most_dph


@pytest.mark.parametrize("row_s", [1.0, 5.0])
def test_a_tumble_that_is_logged_through_its_moves_is_no_gap(tmp_path: Path, row_s: float) -> None:
    runs = logs(tmp_path, row_s, "tilts")
    found = diagnose(runs[:3], parse_model(SHEET + OFFSET, "sheet"), runs[3:]).rate
    assert found.verdict in ("no gap", "nothing to identify") and not found.causes


@pytest.mark.parametrize("row_s", [1.0, 4.0])
def test_an_offset_that_the_model_has_hides_the_corners(tmp_path: Path, row_s: float) -> None:
    runs = logs(tmp_path, row_s, "turns", offset_s=0.016)
    model = parse_model(SHEET + OFFSET, "sheet")
    kept = without_corners(runs, model)
    hidden = [
        np.isnan(run.output_dph).sum() - np.isnan(own.output_dph).sum()
        for run, own in zip(kept, runs, strict=True)
    ]
    assert min(hidden) >= 4 and max(hidden) <= 30
    found = diagnose(runs[:3], model, runs[3:]).rate
    assert found.verdict == "no gap" and not found.causes


def test_without_one_in_the_model_it_is_found_at_the_corners(tmp_path: Path) -> None:
    runs = logs(tmp_path, 1.0, "turns", offset_s=0.016)
    model = parse_model(SHEET, "sheet")
    assert without_corners(runs, model) == runs
    found = diagnose(runs[:3], model, runs[3:]).rate
    assert [cause.name for cause in found.causes] == ["time_offset"]
    assert abs(found.causes[0].terms[0].values[0]) == pytest.approx(16.0, abs=0.2)


def test_a_motion_that_rows_resolve_keeps_them(tmp_path: Path) -> None:
    (run, *_) = logs(tmp_path, 0.5, "turns")
    s = run.stimulus
    times_s = s.period_s * np.arange(len(s) + 1.0)
    smooth = replace(s, angle_deg=60.0 * 6.4 * np.sin(times_s / 6.4), edge_rate_dps=None)
    late = 3600.0 * np.diff(60.0 * 6.4 * np.sin((times_s - 0.02) / 6.4)) / s.period_s
    noise = np.random.default_rng(2).normal(0.0, 3.0, len(s))
    swing = replace(run, stimulus=smooth, output_dph=late + noise, table_rows=None)
    model = parse_model(SHEET + OFFSET, "sheet")
    assert without_corners([swing], model) == [swing]


@pytest.mark.parametrize("codes_deg", [0.0, 0.01])
def test_fine_rows_of_a_log_tell_corners_from_resolved_motion(codes_deg: float) -> None:
    """Samples of 1 s, a log of 0.1 s: a swing that samples do not resolve is no corner of its rows."""
    s = replace(stimulus(600), elevation_deg=np.full(600, 90.0), edge_rate_dps=None)
    rows_s = 0.1 * np.arange(6001.0)
    angle_deg = 20.0 * np.sin(2.0 * np.pi * rows_s / 8.0) * (rows_s < 240.0)
    angle_deg += 30.0 * np.clip(rows_s - 400.35, 0.0, None)
    if codes_deg:
        angle_deg = codes_deg * np.round(angle_deg / codes_deg)
    s = replace(s, angle_deg=angle_deg[::10])
    noise = None
    if codes_deg:
        every = np.full(601, codes_deg / np.sqrt(12.0))
        noise = RoundingNoise(np.zeros(601), every, np.ones(600), np.zeros(601, np.bool_), False)
    run = made_run("fine", s, np.random.default_rng(1), np.zeros(600))
    swing = _Swing(replace(run, table_rows=(rows_s, angle_deg), rounding_noise=noise))
    # where the table starts to turn its rate changes by 30 deg/s
    # within a row: its third differences are half of that, and a third of them is in doubt
    assert swing.corners[400] == pytest.approx(3.6 * 15.0 / 3.0, rel=0.1)
    assert np.delete(swing.corners, [239, 240, 399, 400]).max() < 0.1 * swing.corners[400]


@pytest.mark.parametrize("early_ms", [-20.0, 20.0])
def test_a_table_that_turns_turns_on_beyond_the_log(early_ms: float) -> None:
    """At steady rate an offset does nothing, at the log's ends neither."""
    s = replace(stimulus(100), angle_deg=20.0 * np.arange(101.0), edge_rate_dps=None)
    swing = _Swing(made_run("steady", s, np.random.default_rng(1), np.zeros(100)))
    assert np.abs(swing.over(early_ms)).max() < 1e-6


def test_corners_of_held_out_runs_are_hidden_too(tmp_path: Path) -> None:
    """The model's offset is known but for a corner's course within its row: no share of a gap."""
    runs = logs(tmp_path, 4.0, "turns", offset_s=0.016)
    bent = [replace(run, output_dph=run.output_dph + 2e-4 * abs(run.stimulus.input_rate_dph)) for run in runs]
    found = diagnose(bent[:3], parse_model(SHEET + OFFSET, "sheet"), bent[3:]).rate
    assert [cause.name for cause in found.causes] == ["scale_factor_asymmetry"]
    (share,) = found.held_out
    assert share.share > 0.99 and share.rms_after < 0.1


def still(seed: int, level_dph: Array) -> GapRun:
    """A run at rest at one temperature whose level is what is given, with white noise of 0.2 deg/h."""
    s = stimulus(len(level_dph), cold=False)
    run = made_run(f"soak {seed}", s, np.random.default_rng(seed), level_dph, profile=f"soak {seed}")
    return replace(run, phase=np.full(len(s), "run"))


def test_a_level_that_steps_is_no_random_walk() -> None:
    """One run of each profile: nothing to compare it with, but the walk of a gyro does not stand in between."""
    number = np.arange(7200)
    model = Model("m", (), Noise(0.004, 0.01))
    telegraph = still(1, 2.0 * ((number // 1300) % 2))
    found = diagnose([telegraph, still(2, 0.0 * number)], model, []).rate
    assert found.verdict == "unknown" and not found.stochastic
    (part,) = [each for each in found.unknown_parts if "steps" in each.sentence]
    assert "while temperature and table stand still" in part.sentence and "soak 1" in part.sentence
    walk = np.cumsum(np.random.default_rng(3).normal(0.0, 0.02, 7200))
    found = diagnose([still(1, walk), still(2, 0.0 * number)], model, []).rate
    assert "rate_random_walk" in found.stochastic


def test_runs_alone_are_looked_at_where_that_is_asked() -> None:
    model = Model("m", (), Noise(0.004, 0.01))
    runs = [still(1, 2.0 * (np.arange(7200) > 4000))]
    data = prepare(runs, model, [])
    solution = nominal_solution(data.cells, model.sigmas)
    assert find_jumps(data, solution, alone=False) is None
    warm = replace(runs[0].stimulus, t_in_c=np.linspace(25.0, 45.0, 7200))
    moving = prepare([replace(runs[0], stimulus=warm)], model, [])
    assert find_jumps(moving, nominal_solution(moving.cells, model.sigmas), alone=True) is None
    jumps = find_jumps(data, solution, alone=True)
    assert jumps is not None and not jumps.repeated
    assert jumps.size_dph == pytest.approx(2.0, abs=0.1) and jumps.at_s == pytest.approx(4000.0, abs=120.0)
