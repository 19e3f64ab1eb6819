"""A record by the second: single values far off, and logs with seconds between their rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.analysis.common.seconds import since_last
from bench.analysis.rlg import load_ramp_runs
from bench.analysis.thermal import load_runs
from bench.record.exchange import import_log
from bench.record.recording import Run
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

MAPPING = """
format = 1
unit_id = "G-1"
latitude_deg = 0.0
[columns]
time = { name = "t", unit = "s" }
output = { name = "rate", unit = "deg/h" }
t_in = { name = "inside", unit = "degC" }
t_out = { name = "case", unit = "degC" }
[[run]]
angle_deg = 0.0
elevation_deg = 90.0
phases = [ { name = "equilibrium", start_s = 0.0 }, { name = "reference", start_s = 600.0 },
    { name = "ramp_1", start_s = 1200.0 }, { name = "dwell_1", start_s = 2400.0 },
    { name = "close", start_s = 3600.0 } ]
"""


def bias_dph(t_s: Array) -> Array:
    """A drift of 2 deg/h over an hour."""
    return np.asarray(2.0 * t_s / 3600.0)


def imported(folder: Path, period_s: float, spike_dph: float = 0.0, mapping: str = MAPPING) -> Path:
    """A log of means over the time since the row before; of one row the output is far off."""
    t_s = period_s * np.arange(round(3700.0 / period_s) + 1)
    output = bias_dph(t_s - 0.5 * period_s) + np.random.default_rng(3).normal(0.0, 0.01, len(t_s))
    output[round(1800.0 / period_s)] += spike_dph
    rows = np.column_stack((t_s, output, 20.0 - t_s / 100.0, 20.0 - t_s / 90.0))
    np.savetxt(folder / "log.csv", rows, "%.5f", ",", header="t,rate,inside,case", comments="")
    (folder / "map.toml").write_text(mapping)
    return import_log(folder / "log.csv", folder / "map.toml", folder / "runs")


@pytest.mark.parametrize("period_s", [1.0, 2.0, 2.5, 5.0])
def test_a_row_of_a_slow_log_is_of_every_second_since_the_last(tmp_path: Path, period_s: float) -> None:
    folder = imported(tmp_path, period_s)
    (run,) = load_runs([folder])
    assert run.bias_dph is not None and not run.remarks
    known = np.isfinite(run.bias_dph)
    assert known[round(period_s) :].all()
    late_s = np.abs(run.bias_dph - bias_dph(run.time_s - 0.5))[known] * 1800.0
    assert late_s.mean() < 18.0 + period_s  # 0.01 deg/h are 18 s of the drift
    (ramp,) = load_ramp_runs(folder)
    assert len(ramp.time_s) == 24 and not ramp.remarks
    assert ramp.bias_dph == pytest.approx(bias_dph(ramp.time_s - 0.5), abs=0.006)
    assert ramp.block_rate == pytest.approx(-0.6, abs=0.02)


@pytest.mark.parametrize("period_s", [0.1, 1.0, 5.0])
def test_one_row_far_off_is_left_out_and_said(tmp_path: Path, period_s: float) -> None:
    folder = imported(tmp_path, period_s, spike_dph=20_000.0)
    (run,) = load_runs([folder])
    assert run.bias_dph is not None
    assert np.nanmax(np.abs(run.bias_dph - bias_dph(run.time_s - 0.5))) < 0.1
    (remark,) = run.remarks
    assert "1 of 3600 s left out" in remark and "first at 1800 s" in remark
    (ramp,) = load_ramp_runs(folder)
    assert any("1 of 2400 s left out" in each for each in ramp.remarks)
    assert ramp.bias_dph == pytest.approx(bias_dph(ramp.time_s - 0.5), abs=0.02)


@given(st.integers(2, 40), st.integers(1, 30))
def test_each_second_has_the_next_rows_value(period_s: int, rows: int) -> None:
    values = np.full(period_s * rows, np.nan)
    values[period_s - 1 :: period_s] = np.arange(rows)
    assert since_last(values, float(period_s)).tolist() == np.repeat(np.arange(rows), period_s).tolist()
    lost = values.copy()
    lost[period_s - 1] = np.nan
    assert np.isnan(since_last(lost, float(period_s))[:period_s]).all()
    assert np.isnan(since_last(values, 1.0)).sum() == period_s * rows - rows


@pytest.mark.parametrize(
    ("latitude_deg", "elevation_deg", "angle_deg", "earth_dph"),
    [(0.0, 90.0, 0.0, 0.0), (30.0, 90.0, 45.0, 7.5205), (30.0, -90.0, 0.0, -7.5205), (0.0, 0.0, 0.0, 15.0411),
     (60.0, 0.0, 60.0, 3.7603), (60.0, 30.0, 180.0, 0.0)],
)  # fmt: skip
def test_the_earths_rate_is_that_along_the_axis(
    tmp_path: Path, latitude_deg: float, elevation_deg: float, angle_deg: float, earth_dph: float
) -> None:
    """15.0411 deg/h (WGS 84): up by the sine of the latitude, north by the cosine."""
    text = MAPPING.replace("latitude_deg = 0.0", f"latitude_deg = {latitude_deg}")
    text = text.replace("elevation_deg = 90.0", f"elevation_deg = {elevation_deg}")
    text = text.replace("angle_deg = 0.0", f"angle_deg = {angle_deg}")
    run = Run.open(imported(tmp_path, 5.0, mapping=text))
    assert run.earth_rate_dph(np.array([5.0, 900.0])) == pytest.approx(earth_dph, abs=2e-4)


def test_an_axis_that_points_nobody_knows_where_is_said(tmp_path: Path) -> None:
    upright = MAPPING.replace("angle_deg = 0.0\n", "")
    (run,) = load_runs([imported(tmp_path, 5.0, mapping=upright)])
    assert run.bias_dph is not None
    level = upright.replace("elevation_deg = 90.0\n", 'elevation_deg = 0.0\nrun_id = "level"\n')
    folder = imported(tmp_path, 5.0, mapping=level)
    with pytest.raises(ConfigurationError, match="nothing says which way the axis points") as wrong:
        load_runs([folder])
    assert "angle_deg in [[run]]" in wrong.value.remedy


def test_a_column_says_the_elevation(tmp_path: Path) -> None:
    text = MAPPING.replace("[[run]]", 'elevation = { name = "case", unit = "deg" }\n[[run]]', 1)
    folder = imported(tmp_path, 5.0, mapping=text)
    run = Run.open(folder)
    assert run.manifest.imported is not None and run.manifest.imported.elevation_deg == pytest.approx(
        -0.56, abs=0.1
    )
    assert run.manifest.mounting == "axis_horizontal"
