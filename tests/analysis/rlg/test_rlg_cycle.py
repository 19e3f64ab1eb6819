"""What a regression gains on the held-out leg of a chamber cycle: a made one of known kind, and a real one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from asammdf import MDF, Signal
from markupsafe import escape
from scipy.signal import lfilter
from typer.testing import CliRunner

from bench.analysis.rlg import load_chamber_cycle, study_chamber_cycle
from bench.present.cli._app import app
from drivers.base.errors import ConfigurationError, RecordError

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
    assert axis.before.sigma == pytest.approx(np.std(last, ddof=1), rel=0.02)
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


def test_an_offset_between_legs_counts_in_the_rms_and_is_said() -> None:
    """1 sigma is blind to it: rms^2 = sigma^2 + offset^2, and a compensation would be wrong by the offset."""
    temp, rates = made()
    moved = rates["y"] + np.where(np.arange(6000) >= 3000, 5e-3, 0.0)
    plain, offset = study_chamber_cycle(temp, {"y": rates["y"], "moved": moved}).axes
    assert offset.after_static.sigma < 2e-4
    assert plain.after_static.rms < 2.0 * plain.after_static.sigma and "apart" not in plain.verdict
    assert offset.after_static.rms == pytest.approx(5e-3, rel=0.1)
    assert "the legs lie 0.00497 apart" in offset.verdict


def test_an_axis_that_fails_leaves_the_others_alone() -> None:
    temp, rates = made()
    rates |= {"x": np.full(6000, 0.25), "z": np.full(6000, np.nan)}
    study = study_chamber_cycle(temp, rates, block=50)
    assert [axis.axis for axis in study.axes] == ["y"] and study.axes[0].static_pct > 95.0
    assert len(study.temp_c) == 120 and dict(study.failed).keys() == {"x", "z"}
    assert "0.25 in all rows" in dict(study.failed)["x"]
    with pytest.raises(RecordError, match="no axis can be judged"):
        study_chamber_cycle(temp, {"x": rates["x"]})


def test_a_mapping_says_which_columns_in_any_format(tmp_path: Path) -> None:
    temp, rates = made()
    with MDF(version="4.10") as mdf:
        time_s = np.arange(6000) / 10.0
        columns = {"rate_y": np.radians(rates["y"]), "oven": temp + 273.15}
        mdf.append([Signal(values, time_s, name=name) for name, values in columns.items()])
        mdf.save(tmp_path / "log.mf4")
    (tmp_path / "map.toml").write_text(
        'format = 1\nunit_id = "U"\nlatitude_deg = 40\n'
        '[columns]\nt_out = { name = "oven", unit = "K" }\n'
        '[columns.gyros]\ny = { name = "rate_y", unit = "rad/s" }\n'
    )
    heat, read = load_chamber_cycle(tmp_path / "log.mf4", tmp_path / "map.toml")
    np.testing.assert_allclose(heat, temp)
    np.testing.assert_allclose(read["y"], rates["y"])
    words = ["fit", "chamber-cycle", str(tmp_path / "log.mf4"), "--mapping", str(tmp_path / "map.toml")]
    result = CliRunner().invoke(app, [*words, "--block", "50", "--out", str(tmp_path / "cycle.html")])
    assert result.exit_code == 0 and "Means of 50 rows" in (tmp_path / "cycle.html").read_text()


def test_what_is_no_cycle_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="no cycle"):
        study_chamber_cycle(np.linspace(0, 50, 3000), {"x": np.zeros(3000) + np.arange(3000) % 7 * 1e-6})
    (tmp_path / "other.csv").write_text("time\tgyro\n1\t2\n")
    with pytest.raises(ConfigurationError, match="no such column"):
        load_chamber_cycle(tmp_path / "other.csv")


def test_the_command_writes_a_table_and_a_report(tmp_path: Path) -> None:
    temp, rates = made()
    table = np.column_stack([temp, rates["x"], rates["y"], rates["z"]])
    heads = "imu.temperature\timu.gyro.x\timu.gyro.y\timu.gyro.z"
    log, out = tmp_path / "cycle.csv", tmp_path / "cycle.html"
    np.savetxt(log, table, delimiter="\t", header=heads, comments="")
    result = CliRunner().invoke(app, ["fit", "chamber-cycle", str(log), "--out", str(out)])
    assert result.exit_code == 0, result.output
    study, page, said = study_chamber_cycle(temp, rates), out.read_text(), " ".join(result.output.split())
    for axis in study.axes:
        assert f"{axis.static_pct:.1f}" in result.output and axis.verdict in said
        assert (
            f"{axis.dynamic_pct:.1f}".replace("-", "\N{MINUS SIGN}") in page and escape(axis.verdict) in page
        )
    assert "held out" in page and "2 of 3 axes gain" in page and ONE_WAY in page
    missing = CliRunner().invoke(app, ["fit", "chamber-cycle", str(tmp_path / "none.csv")])
    assert isinstance(missing.exception, ConfigurationError) and "no such file" in str(missing.exception)


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


@pytest.mark.parametrize(("up", "down"), [(9, 60), (60, 8)])
def test_a_leg_of_less_than_ten_means_is_no_leg(up: int, down: int) -> None:
    temp = np.concatenate([np.linspace(0.0, 50.0, up + 1), np.linspace(50.0, 0.0, down + 1)[1:]])
    rate = np.random.default_rng(0).normal(size=len(temp))
    with pytest.raises(RecordError, match="the recording is no cycle"):
        study_chamber_cycle(temp, {"x": rate}, 1)


def test_an_axis_that_moves_on_the_held_out_leg_only_is_refused() -> None:
    temp, rates = made()
    rates["x"] = np.where(np.arange(6000) > 3100, rates["y"], rates["y"][3100])
    study = study_chamber_cycle(temp, rates, block=50)
    assert [axis.axis for axis in study.axes] == ["y", "z"] and len(study.temp_c) == 120
    assert "does not change" in dict(study.failed)["x"]
    coarse = study_chamber_cycle(temp, {"y": np.round(rates["y"], 3)}, block=50)  # ten times the noise
    assert len(coarse.temp_c) == 120 and coarse.axes[0].static_pct > 80.0


def test_a_recording_without_a_turn_says_that_it_has_none() -> None:
    with pytest.raises(RecordError, match="the last turn of temperature at 0"):
        study_chamber_cycle(np.linspace(0, 50, 3000), {"x": np.arange(3000) % 7 * 1e-6})
