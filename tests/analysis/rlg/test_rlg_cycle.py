"""What a regression gains on the held-out leg of a chamber cycle: a made one of known kind, and a real one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from markupsafe import escape
from scipy.signal import lfilter
from typer.testing import CliRunner

from bench.analysis.rlg import load_chamber_cycle, study_chamber_cycle
from bench.present.cli._app import app
from drivers.base.errors import RecordError

RECORDING = (
    Path(__file__).parents[3]
    / ".."
    / "shared"
    / "data"
    / "mems_chamber_cycle"
    / "imu_raw_data_first_legs.csv"
)


ONE_WAY = (
    "the fitted leg goes one way only: what depends on rate and past looks there as if it depended on "
    "temperature"
)


def made() -> tuple[np.ndarray, dict[str, np.ndarray]]:
    rng = np.random.default_rng(0)
    temp = np.concatenate([np.linspace(50, -20, 3000), np.linspace(-20, 48, 3000)])
    noise = [rng.normal(0, 1e-4, 6000) for _ in range(3)]
    past = temp - lfilter([1 / 300], [1, -1 + 1 / 300], temp - temp[0]) - temp[0]
    walk = np.cumsum(rng.normal(0, 2e-4, 6000))
    return temp, {
        "x": 1e-4 * temp + 5e-4 * past + noise[0],
        "y": 2e-4 * temp + noise[1],
        "z": walk + noise[2],
    }


def test_a_static_a_hysteretic_and_a_wandering_axis_are_told_apart() -> None:
    temp, rates = made()
    study = study_chamber_cycle(temp, rates)
    x, y, z = study.axes
    assert y.static_pct > 95.0 and y.verdict.startswith("follows temperature;")
    assert x.dynamic_pct > x.static_pct + 20.0 and "rate (" in x.verdict and "lag T" in x.verdict
    assert z.best_pct < 50.0
    assert study.remarks == (ONE_WAY,)  # the warming leg stays within the cooling leg


def test_the_leg_after_the_last_turn_is_held_out() -> None:
    temp = np.concatenate([np.linspace(50, -20, 2000), np.linspace(-20, 70, 2000), np.linspace(70, 20, 2000)])
    rng = np.random.default_rng(1)
    # on the first two legs z is a function of temperature, on the last one of nothing
    z = np.where(np.arange(6000) < 4025, 1e-4 * temp, 1e-3 * np.sin(np.arange(6000) / 150))
    study = study_chamber_cycle(temp, {"z": z + rng.normal(0, 1e-4, 6000)})
    assert study.turn == 4000 // 25 and study.remarks == ()
    (axis,) = study.axes
    last = axis.means[study.turn + 1 :]
    assert axis.before == pytest.approx(np.std(last, ddof=1), rel=0.02)
    assert not axis.gains and axis.terms_static == ("T",)
    assert np.std(axis.left_static[: study.turn]) < 1e-4 < np.std(axis.left_static[study.turn :])


def test_odd_rows_are_left_out_and_named() -> None:
    temp, rates = made()
    rates["y"][1] = 5.0
    rates["x"][700] = np.nan
    study = study_chamber_cycle(temp, rates)
    assert study.remarks == (
        "1 rows without a value left out",
        "1 outlying rows left out, the first at row 1",
        ONE_WAY,
    )
    assert study.axes[1].static_pct > 95.0


def test_what_is_no_cycle_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="no cycle"):
        study_chamber_cycle(np.linspace(0, 50, 3000), {"x": np.zeros(3000) + np.arange(3000) % 7 * 1e-6})
    (tmp_path / "other.csv").write_text("time\tgyro\n1\t2\n")
    with pytest.raises(RecordError, match="lacks columns"):
        load_chamber_cycle(tmp_path / "other.csv")


def test_the_command_writes_a_table_and_a_report(tmp_path: Path) -> None:
    temp, rates = made()
    table = np.column_stack([temp, rates["x"], rates["y"], rates["z"]])
    heads = "imu.temperature\timu.gyro.x\timu.gyro.y\timu.gyro.z"
    log, out = tmp_path / "cycle.csv", tmp_path / "cycle.html"
    np.savetxt(log, table, delimiter="\t", header=heads, comments="")
    result = CliRunner().invoke(app, ["fit", "chamber-cycle", str(log), "--out", str(out)])
    assert result.exit_code == 0, result.output
    study, page = study_chamber_cycle(temp, rates), out.read_text()
    for axis in study.axes:
        assert f"{axis.static_pct:.1f}" in result.output and axis.verdict in result.output.replace("\n", " ")
        assert (
            f"{axis.dynamic_pct:.1f}".replace("-", "\N{MINUS SIGN}") in page and escape(axis.verdict) in page
        )
    assert "held out" in page and "2 of 3 axes gain" in page and ONE_WAY in page
    missing = CliRunner().invoke(app, ["fit", "chamber-cycle", str(tmp_path / "none.csv")])
    assert isinstance(missing.exception, RecordError) and "no such recording" in str(missing.exception)


@pytest.mark.skipif(not RECORDING.exists(), reason="the recording of a real chamber cycle is not there")
def test_the_real_cycle_is_told_honestly() -> None:
    study = study_chamber_cycle(*load_chamber_cycle(RECORDING))
    x, y, z = study.axes
    assert "row 0" in study.remarks[0] and ONE_WAY in study.remarks
    # y is a clean function of temperature, x depends on its past too, which one leg cannot show, z does not
    # come back.
    assert y.static_pct > 85.0 and y.verdict.startswith("follows temperature;")
    assert x.static_pct < 30.0 and x.dynamic_pct > x.static_pct + 15.0
    assert x.verdict.startswith("follows temperature in part")
    assert z.static_pct < 0.0 and z.verdict.startswith("hardly reproducible")
