"""Logs of strangers: short ones, unknown time since power-on, and a second look at what a model was fitted on."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import closed_model, diagnose, parse_model, read_recordings
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._remarks import of_noise, white_arw
from drivers.base.errors import ConfigurationError
from simulators.effects import Stimulus

RATE_HZ, ARW = 100.0, 0.3
MODEL = parse_model(f"format = 1\n[noise]\narw_deg_per_sqrt_h = {ARW}\nbias_instability_dph = 1.0\n", "test")


def log(folder: Path, name: str, rate_dph: np.ndarray, more: str = "") -> Path:
    time_s = np.arange(len(rate_dph)) / RATE_HZ
    np.savetxt(
        folder / f"{name}.csv",
        np.column_stack([time_s, rate_dph / 3600.0]),
        "%.9g",
        ",",
        header="t,rate",
        comments="",
    )
    file = folder / f"{name}.toml"
    file.write_text(
        'format = 1\nunit_id = "u"\nlatitude_deg = 0\n[columns]\ntime = { name = "t", unit = "s" }\n'
        f'output = {{ name = "rate", unit = "deg/s" }}\n[[run]]\nfile = "{name}.csv"\n{more}'
    )
    return file


def noise(seconds: float, seed: int) -> np.ndarray:
    return (
        60.0
        * ARW
        * math.sqrt(RATE_HZ)
        * np.random.default_rng(seed).standard_normal(round(seconds * RATE_HZ))
    )


@pytest.mark.parametrize("seconds", [20, 100, 208])
def test_a_short_log_is_one_of_shorter_steps_and_noise_is_no_gap(tmp_path, seconds):
    for seed in range(4):
        given = read_recordings([log(tmp_path, f"n{seed}", noise(seconds, seed))])
        (run,) = given.runs
        assert 512 <= len(run.stimulus) <= 700
        assert run.stimulus.period_s * RATE_HZ == pytest.approx(round(run.stimulus.period_s * RATE_HZ))
        # means over so many rows have the noise of their own length
        sigma = 60.0 * ARW / math.sqrt(run.stimulus.period_s)
        assert np.nanstd(run.output_dph) == pytest.approx(sigma, rel=0.15)
        found = diagnose(given.runs, MODEL)
        assert found.verdict in ("no gap", "nothing to identify") and not found.causes


def test_a_log_of_fewer_rows_than_time_scales_need_is_refused(tmp_path):
    with pytest.raises(ConfigurationError, match="too short"):
        diagnose(read_recordings([log(tmp_path, "n", noise(2.5, 1))]).runs, MODEL)


def test_a_run_that_was_aborted_early_is_left_out_and_said_to_be(tmp_path):
    """Seconds of rows at 100 Hz; 40 s of rows a second are 40 samples."""
    files = [log(tmp_path, f"n{seed}", noise(300, seed)) for seed in range(3)]
    aborted = log(tmp_path, "aborted", noise(300, 9)[:: round(RATE_HZ)])
    text = (tmp_path / "aborted.csv").read_text().splitlines()
    rows = [text[0], *(f"{k},{line.split(',')[1]}" for k, line in enumerate(text[1:42]))]
    (tmp_path / "aborted.csv").write_text("\n".join(rows) + "\n")
    given = read_recordings([*files, aborted])
    for runs, held_out in ((given.runs, ()), (given.runs[:2], given.runs[2:])):
        found = diagnose(runs, MODEL, held_out)
        assert found.verdict in ("no gap", "nothing to identify")
        (said,) = [text for text in found.rate.warnings if "left out" in text]
        assert "aborted" in said and "40 samples" in said and "64" in said
    with pytest.raises(ConfigurationError, match="too short") as refused:
        diagnose(given.runs[3:], MODEL)
    assert "rows a second" in refused.value.remedy


@pytest.mark.parametrize(("told", "warned"), [("", True), ("power_on_s = 0.0\n", False)])
def test_a_warm_up_is_any_drift_that_settles_where_nobody_told_the_power_on(tmp_path, told, warned):
    time_s = np.arange(round(1500 * RATE_HZ)) / RATE_HZ
    rate = noise(1500, 3) + 120.0 * np.exp(-time_s / 300.0)
    found = diagnose(read_recordings([log(tmp_path, "w", rate, told)]).runs, MODEL).rate
    assert [cause.name for cause in found.causes] == ["warm_up"]
    assert any("switched on is not told" in warning for warning in found.warnings) is warned


def test_what_is_found_in_runs_of_a_closed_model_says_what_it_rests_on(tmp_path):
    time_s = np.arange(round(1500 * RATE_HZ)) / RATE_HZ
    file = log(tmp_path, "w", noise(1500, 4) + 120.0 * np.exp(-time_s / 300.0), "power_on_s = 0.0\n")
    given = read_recordings([file])
    first = diagnose(given.runs, MODEL)
    again = diagnose(given.runs, closed_model(first)).rate
    assert not again.causes and any("was fitted on w" in warning for warning in again.warnings)
    other = log(tmp_path, "v", noise(1500, 5) + 120.0 * np.exp(-time_s / 300.0), "power_on_s = 0.0\n")
    elsewhere = diagnose(read_recordings([other]).runs, closed_model(first)).rate
    assert not any("was fitted on" in warning for warning in elsewhere.warnings)


def test_what_comes_back_fewer_than_eight_times_is_no_line(tmp_path):
    time_s = np.arange(round(100 * RATE_HZ)) / RATE_HZ
    for period_s, lines in ((20.0, 0), (5.0, 1)):
        rate = noise(100, 6) + 60.0 * np.sin(2.0 * math.pi * time_s / period_s)
        found = diagnose(read_recordings([log(tmp_path, f"p{period_s:.0f}", rate)]).runs, MODEL).rate
        assert ("vibration_or_mains_line" in found.stochastic) is bool(lines)


@pytest.mark.parametrize("period_s", [1.0, 4.0])
def test_white_noise_of_slow_logs_is_read_off_their_samples(period_s):
    count = 40_000
    still = np.full(count, 25.0)
    stimulus = Stimulus(
        period_s * np.arange(1.0, count + 1.0),
        still,
        still,
        np.zeros(count + 1),
        np.zeros(count),
        0.0,
        period_s,
    )
    drawn = 60.0 * ARW / math.sqrt(period_s) * np.random.default_rng(8).standard_normal(count)
    drawn[100:140] = np.nan
    run = GapRun("r", "u", "p", "0", stimulus, stimulus.input_rate_dph + drawn, np.full(count, "run"))
    assert white_arw(run) == pytest.approx(ARW, rel=0.05)
    (said,) = of_noise(MODEL, [run])
    assert f"the model has {ARW}" in said and f"as of {white_arw(run):.3g} deg/sqrt(h)" in said
