"""Recordings of other software, written here with numpy and csv, read by a mapping."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from bench.analysis.gap import Model, Noise, diagnose
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._import import read_mapped_runs
from bench.analysis.gap._log_rows import held_rows
from bench.analysis.gap._recordings import load_channels
from bench.analysis.gap._run_folder import _profile, load_gap_runs
from bench.control.procedure import find_procedure
from bench.record.exchange import import_log
from bench.record.recording import Run
from drivers.base.errors import ConfigurationError
from tests.analysis.gap.conftest import made_run, stimulus

MAPPING = """
format = 1
unit_id = "G7"
latitude_deg = 48.0
[columns.time]
name = "t_ms"
unit = "ms"
[columns.output]
name = "rate"
unit = "rad/s"
[columns.t_in]
name = "temp_K"
unit = "K"
[columns.angle]
name = "table"
unit = "deg"
[[run]]
file = "a.csv"
profile = "ramp"
condition = "+20"
elevation_deg = 90.0
phases = [{ name = "room", start_s = 0.0 }, { name = "ramp", start_s = 30.0 }]
"""


def _write(folder: Path, mapping: str = MAPPING) -> Path:
    """10 Hz for a minute, 20 deg/s, the rate's mean growing by 0.1 rad/s a second, one second missing."""
    time_s = np.round(np.arange(0.1, 60.05, 0.1), 1)
    time_s = time_s[(time_s <= 20.0) | (time_s > 21.0)]
    rows = np.stack(
        (1000.0 * time_s + 5000.0, 0.1 * np.ceil(time_s - 1e-9), 300.0 + 0 * time_s, (20.0 * time_s) % 360.0)
    )
    lines = ["t_ms,rate,temp_K,table", *(",".join(f"{value:.6f}" for value in row) for row in rows.T)]
    (folder / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "map.toml").write_text(mapping, encoding="utf-8")
    return folder / "map.toml"


def test_columns_units_and_gaps(tmp_path: Path) -> None:
    (run,) = read_mapped_runs(_write(tmp_path))
    assert (run.run_id, run.unit_id, run.profile, run.condition) == ("a", "G7", "ramp", "+20")
    assert run.stimulus.latitude_deg == 48.0
    # a minute is short: a step a row, from the first on, which is 0.1 s after the file's own beginning
    assert run.stimulus.period_s == pytest.approx(0.1)
    assert run.stimulus.t_in_c == pytest.approx(np.full(599, 26.85))
    assert run.stimulus.table_rate_dps == pytest.approx(np.full(599, 20.0), abs=1e-6)
    expected = np.degrees(0.1 * np.ceil(0.1 * np.arange(2, 601) - 1e-9)) * 3600.0
    known = ~np.isnan(run.output_dph)
    assert run.output_dph[known] == pytest.approx(expected[known], rel=1e-6)
    # of the row after the missing second nobody knows when it began
    assert np.flatnonzero(~known).tolist() == list(range(199, 210))
    assert list(run.phase[[0, 289, 299, 598]]) == ["room", "room", "ramp", "ramp"]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (('name = "rate"', 'name = "rat"'), "no such column"),
        (('unit = "rad/s"', 'unit = "turns"'), "unit is not known"),
        (('unit_id = "G7"', ""), "not complete"),
        (('file = "a.csv"', 'file = "b.csv"'), "cannot be read"),
    ],
)
def test_mistakes_are_named(tmp_path: Path, change: tuple[str, str], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        read_mapped_runs(_write(tmp_path, MAPPING.replace(*change)))


def test_a_temperature_that_was_not_recorded_is_stood_in_for(tmp_path: Path) -> None:
    without = MAPPING.replace('[columns.t_in]\nname = "temp_K"\nunit = "K"\n', "")
    (run,) = read_mapped_runs(_write(tmp_path, without))
    assert run.stimulus.t_in_c == pytest.approx(np.full(599, 25.0))
    case_only = MAPPING.replace("[columns.t_in]", "[columns.t_out]")
    (run,) = read_mapped_runs(_write(tmp_path, case_only))
    assert run.stimulus.t_in_c == pytest.approx(np.full(599, 26.85))
    assert np.array_equal(run.stimulus.t_in_c, run.stimulus.t_out_c)


def test_the_diagnosis_says_what_missing_temperatures_hide() -> None:
    s = stimulus(2000)
    warm = replace(s, t_out_c=s.t_in_c)
    rng = np.random.default_rng(5)
    model = Model("nominal", (), Noise(0.004))
    one = diagnose([made_run(name, warm, rng) for name in "ab"], model)
    assert any("one temperature only" in text for text in one.rate.warnings)
    assert "gradient" in one.rate.unidentifiable
    flat = replace(s, t_in_c=np.full(2000, 25.0), t_out_c=np.full(2000, 25.0))
    turning = replace(flat, angle_deg=np.concatenate((np.zeros(1001), 10.0 * np.arange(1.0, 1001.0))))
    none = diagnose([made_run(name, turning, rng) for name in "ab"], model)
    assert any("no temperature was recorded" in text for text in none.rate.warnings)


def test_noise_that_is_higher_than_the_data_sheet_is_named_with_its_size() -> None:
    still = stimulus(3000, cold=False)
    rng = np.random.default_rng(6)
    found = diagnose([made_run(name, still, rng) for name in "ab"], Model("nominal", (), Noise(0.001)))
    assert set(found.rate.stochastic) == {"noise_level"}
    text = found.rate.noise.risen("noise_level")  # the runs have 0.004
    assert text.startswith("arw_deg_per_sqrt_h = 0.00") and text.endswith("the model has 0.001")
    assert found.rate.noise.rises["noise_level"] == pytest.approx(0.004, rel=0.05)


def test_a_run_folder_made_by_import_is_the_mapped_recording(tmp_path: Path) -> None:
    time_s = np.arange(0.1, 400.0, 0.1)
    rows = np.stack((time_s, 9.0 + np.sin(time_s), 25.0 + 0.01 * time_s), axis=1)
    lines = ["t,rate,temp", *(",".join(f"{value:.6f}" for value in row) for row in rows)]
    (tmp_path / "log.csv").write_text("\n".join(lines), encoding="utf-8")
    (tmp_path / "map.toml").write_text(
        """
format = 1
unit_id = "G7"
latitude_deg = 39.1
[columns]
time = { name = "t", unit = "s" }
output = { name = "rate", unit = "deg/h" }
t_in = { name = "temp", unit = "degC" }
[[run]]
file = "log.csv"
profile = "slow"
elevation_deg = 90.0
""",
        encoding="utf-8",
    )
    mapping = tmp_path / "map.toml"
    folder = import_log(tmp_path / "log.csv", mapping, tmp_path / "runs")
    (mapped,), (imported,) = read_mapped_runs(mapping), load_gap_runs(folder)
    assert imported.run_id == folder.name
    assert imported.checksum
    assert imported.output_dph == pytest.approx(mapped.output_dph)
    assert imported.stimulus.t_in_c == pytest.approx(mapped.stimulus.t_in_c)
    series, missing = load_channels(folder)
    assert not series
    assert missing["chamber_air"] == "no column air"
    assert "no column air" in missing["case_temperature"] and "arrival times" in missing["time_stamps"]


def test_runs_of_one_procedure_are_repeats_only_with_the_same_parameters() -> None:
    usual = find_procedure("zero-bias-cold-shock").parse({}).model_dump(mode="json")

    def profile(procedure: str, **changed: object) -> str:
        manifest = SimpleNamespace(procedure=procedure, parameters={**usual, **changed})
        return _profile(cast(Run, SimpleNamespace(manifest=manifest)))

    assert profile("zero-bias-cold-shock") == profile("zero-bias-cold-shock", repeats=7)
    assert profile("zero-bias-cold-shock", soak_min=20.0) == "zero-bias-cold-shock, soak_min 20"
    assert profile("a-procedure-of-somebody", soak_min=20.0) == "a-procedure-of-somebody"


def _log(folder: Path, time_s: np.ndarray, rate_dps: np.ndarray, angle_deg: np.ndarray) -> GapRun:
    """A log of a gyro without errors, axis upright: mean rate since the row before, NaN where it is missing."""
    rows = [
        f"{1000.0 * t + 5000.0:.3f},{np.radians(rate):.12f},300,{angle % 360.0:.9f}"
        if not np.isnan(rate)
        else f"{1000.0 * t + 5000.0:.3f},,300,{angle % 360.0:.9f}"
        for t, rate, angle in zip(time_s, rate_dps, angle_deg, strict=True)
    ]
    _write(folder)
    (folder / "a.csv").write_text("\n".join(["t_ms,rate,temp_K,table", *rows]) + "\n", encoding="utf-8")
    (run,) = read_mapped_runs(folder / "map.toml")
    return run


def _stairs(time_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rates 0, 40, -40, 0 deg/s with ramps of 20 deg/s^2: angle at the rows, mean rate since the row before."""
    fine = np.arange(0.0, 600.0, 1e-3)
    target = np.select([fine < 150.0, fine < 300.0, fine < 450.0], [0.0, 40.0, -40.0], 0.0)
    rate = np.zeros(len(fine))
    for k in range(1, len(fine)):
        rate[k] = rate[k - 1] + np.clip(target[k] - rate[k - 1], -0.02, 0.02)
    angle = np.interp(time_s, fine, np.cumsum(rate) * 1e-3)
    return angle, np.diff(angle, prepend=0.0) / np.diff(time_s, prepend=-1.0)


@pytest.mark.parametrize("lost", ["value", "row"])
def test_a_change_of_rate_that_is_masked_or_lost_leaves_nothing_beside(tmp_path: Path, lost: str) -> None:
    """Steps half covered would be off by hundreds of deg/h: the mean is of one half, the angle of both."""
    time_s = np.arange(0.0, 600.0, 0.2)
    angle, rate = _stairs(time_s)
    changing = np.abs(np.gradient(np.gradient(angle, time_s), time_s)) > 0.5
    changing &= np.random.default_rng(1).random(len(changing)) < 0.7
    kept = np.ones(len(time_s), dtype=bool) if lost == "value" else ~changing
    if lost == "value":
        rate = np.where(changing, np.nan, rate)
    run = _log(tmp_path, time_s[kept], rate[kept], angle[kept])
    rest = run.output_dph - 3600.0 * run.stimulus.table_rate_dps
    assert 0 < np.isnan(rest).sum() < 30
    assert np.nanmax(np.abs(rest)) < 1.0


@pytest.mark.parametrize(("row_s", "step_s"), [(2.0, 2.0), (0.8, 1.6), (0.25, 1.0), (1.0, 1.0)])
def test_steps_are_whole_rows(tmp_path: Path, row_s: float, step_s: float) -> None:
    time_s = np.arange(0.0, 599.0, row_s)
    angle, rate = _stairs(time_s)
    run = _log(tmp_path, time_s, rate, angle)
    assert run.stimulus.period_s == step_s
    rest = run.output_dph - 3600.0 * run.stimulus.table_rate_dps
    assert not np.isnan(rest).any()
    assert np.abs(rest).max() < 1.0


def test_rows_that_a_logger_repeats_are_left_out() -> None:
    values = np.random.default_rng(2).normal(size=2000)
    values[700:703] = values[699]
    assert np.flatnonzero(held_rows(values)).tolist() == [700, 701, 702]
    assert not held_rows(np.round(values)).any()


def test_rows_of_a_coarse_signal_that_are_equal_by_chance_are_kept() -> None:
    """A slow swing in steps of 0.04 under noise of 0.2: one row in twenty or so equals its neighbour."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        swing = 30.0 * np.sin(np.arange(1448) / 30.0)
        coarse = np.round((swing + rng.normal(0.0, 0.2, 1448)) / 0.04) * 0.04
        assert (np.diff(coarse) == 0.0).sum() > 1
        assert not held_rows(coarse).any()


def test_noughts_of_a_counter_read_at_uneven_times_are_kept() -> None:
    """Pulses over the time between two readings: one or two never give the same rate again, none always does."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        counts = np.diff(np.floor(np.cumsum(rng.normal(0.4, 0.5, 3000))))
        rate = counts / (0.8 + rng.uniform(-2e-3, 2e-3, 2999))
        assert (np.diff(rate) == 0.0).sum() > 100
        assert not held_rows(rate).any()


def test_stamps_that_are_rounded_to_a_microsecond_make_no_rate(tmp_path: Path) -> None:
    """Rows every 16/15 s, the table to and fro at 12 deg/s: rounded stamps are 0.02 deg/h."""
    time_s = np.arange(600) * 16.0 / 15.0
    angle = 12.0 * np.abs((time_s + 4.0) % 16.0 - 8.0)
    rate = np.diff(angle, prepend=angle[0]) / (16.0 / 15.0)
    kept = np.ones(600, dtype=bool)
    kept[[200, 201, 417]] = False
    run = _log(tmp_path, time_s[kept], rate[kept], angle[kept])
    assert run.stimulus.period_s == pytest.approx(16.0 / 15.0, abs=1e-6)
    rest = run.output_dph - 3600.0 * run.stimulus.table_rate_dps
    assert np.isnan(rest).sum() <= 5
    assert np.nanmax(np.abs(rest)) < 2e-3


def _shaken_out(folder: Path, lost: float, row_s: float, turns: float) -> GapRun:
    """40 deg/s, rows of `row_s` of which some are missing here and there; `turns`: 360 where the angle jumps."""
    rng, time_s = np.random.default_rng(3), np.arange(1.0, 20_001.0) * row_s
    kept = rng.random(len(time_s)) >= lost
    rows = np.stack(
        (1000.0 * time_s, np.full(len(time_s), np.radians(40.0)), 300.0 + 0 * time_s, 40.0 * time_s)
    )
    rows[3] = np.mod(rows[3], turns) if turns else rows[3]
    lines = ["t_ms,rate,temp_K,table", *(",".join(f"{value:.6f}" for value in row) for row in rows.T[kept])]
    (folder / "a.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (folder / "map.toml").write_text(MAPPING, encoding="utf-8")
    return read_mapped_runs(folder / "map.toml")[0]


@pytest.mark.parametrize(("lost", "period_s"), [(0.0, 1.0), (0.001, 1.0), (0.05, 0.14)])
def test_steps_are_as_short_as_rows_that_are_missing_ask_for(
    tmp_path: Path, lost: float, period_s: float
) -> None:
    """Fifty rows are all there in 95 of 100 steps of 1 s if one of 1000 is missing, in 8 if it is one of 20."""
    run = _shaken_out(tmp_path, lost, 0.02, 360.0)
    assert run.stimulus.period_s == pytest.approx(period_s, abs=1e-6)
    assert float(run.missing.mean()) < 0.35
    assert np.nanmax(np.abs(run.output_dph / 3600.0 - 40.0)) < 1e-3


def test_an_angle_of_more_than_a_turn_has_no_jumps_to_take_out(tmp_path: Path) -> None:
    """Rows of 5 s turn by 200 deg each: -160 in an angle that jumps, and nobody could tell."""
    turned = _shaken_out(tmp_path, 0.0, 5.0, 0.0)
    assert turned.stimulus.table_rate_dps == pytest.approx(40.0)
    jumping = _shaken_out(tmp_path, 0.0, 5.0, 360.0)
    assert jumping.stimulus.table_rate_dps == pytest.approx(-32.0, abs=0.1)
