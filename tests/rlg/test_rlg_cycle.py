"""What a regression gains on the held-out leg of a chamber cycle: a made one of known kind, and a real one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from bench.rlg import load_chamber_cycle, study_chamber_cycle
from drivers.errors import RecordError

RECORDING = (
    Path(__file__).parents[2]
    / ".."
    / "shared"
    / "data"
    / "mems_chamber_cycle"
    / "imu_raw_data_first_legs.csv"
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
    assert y.static_pct > 95.0 and "adds nothing" in y.verdict
    assert x.dynamic_pct > x.static_pct + 20.0 and "past" in x.verdict
    assert max(z.static_pct, z.dynamic_pct) < 50.0
    assert study.remarks == ()  # the warming leg stays within the cooling leg


def test_odd_rows_are_left_out_and_named() -> None:
    temp, rates = made()
    rates["y"][1] = 5.0
    rates["x"][700] = np.nan
    study = study_chamber_cycle(temp, rates)
    assert study.remarks == (
        "1 rows without a value left out",
        "1 outlying rows left out, the first at row 1",
    )
    assert study.axes[1].static_pct > 95.0


def test_what_is_no_cycle_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecordError, match="no cycle"):
        study_chamber_cycle(np.linspace(0, 50, 3000), {"x": np.zeros(3000) + np.arange(3000) % 7 * 1e-6})
    (tmp_path / "other.csv").write_text("time\tgyro\n1\t2\n")
    with pytest.raises(RecordError, match="lacks columns"):
        load_chamber_cycle(tmp_path / "other.csv")


@pytest.mark.skipif(not RECORDING.exists(), reason="the recording of a real chamber cycle is not there")
def test_the_real_cycle_is_told_honestly() -> None:
    study = study_chamber_cycle(*load_chamber_cycle(RECORDING))
    x, y, z = study.axes
    assert "row 0" in study.remarks[0]
    # y is a clean function of temperature, x depends on its past, z does not come back.
    assert y.static_pct > 85.0
    assert x.static_pct < 30.0 and x.dynamic_pct > x.static_pct + 15.0
    assert z.static_pct < 0.0 and z.verdict.startswith("hardly reproducible")
