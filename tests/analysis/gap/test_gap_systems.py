"""Runs of other procedures as the diagnosis sees them: attitude and Earth rate of a gyro in a rehearsed run."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from bench.analysis.gap._recordings import load_channels
from bench.analysis.gap._run_folder import load_gap_runs
from bench.present.cli._app import app

BENCH = Path(__file__).parents[3] / "examples" / "demo.toml"


@pytest.fixture(scope="module")
def rotation(tmp_path_factory: pytest.TempPathFactory) -> Path:
    runs = tmp_path_factory.mktemp("runs")
    pairs = [part for each in ("turns=4", "rest_s=30", "rate_dps=6") for part in ("--set", each)]
    command = ["rehearse", "constant-rotation", "--bench", str(BENCH), "--runs", str(runs), "--seed", "3"]
    result = CliRunner().invoke(app, [*command, *pairs])
    assert result.exit_code == 0, result.output
    (folder,) = runs.iterdir()
    return folder


def test_a_level_axis_on_a_turning_table_sees_the_earth_and_not_the_table(rotation: Path) -> None:
    (run,) = load_gap_runs(rotation)
    assert run.condition == "+6"
    assert not run.stimulus.elevation_deg.any()
    turning = run.stimulus.table_rate_dps > 5.9
    level_dph = 15.041067 * math.cos(math.radians(39.10))
    angle = np.radians(run.stimulus.angle_deg)
    middle = 0.5 * (angle[1:] + angle[:-1])[turning]
    columns = np.stack((np.cos(middle), np.sin(middle), np.ones(turning.sum())), axis=1)
    north, west, _ = np.linalg.lstsq(columns, run.output_dph[turning], rcond=None)[0]
    # azimuth error of the mount up to 0.5 deg; ARW 0.004 deg/sqrt(h) on 240 s
    assert north == pytest.approx(level_dph, abs=0.3)
    assert west == pytest.approx(0.0, abs=0.4)
    assert np.std(run.output_dph - run.stimulus.input_rate_dph) < 1.0


def test_what_the_run_lacks_is_said_by_channel(rotation: Path) -> None:
    series, missing = load_channels(rotation)
    assert {each.channel for each in series} >= {"case_temperature", "gyro_temperature", "table_rate"}
    assert "not started" in missing["chamber_air"]
    rate = next(each for each in series if each.channel == "table_rate")
    assert np.all(rate.inputs.drive == 6.0)
    assert rate.values == pytest.approx(6.0, abs=1e-3)
