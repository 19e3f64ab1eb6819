"""Logs of other benches as records of a scheme: stamps of a host, lost rows, single values, a mapping's units."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.analysis.calibration._calibrate import load_record
from bench.analysis.calibration._whole import whole
from bench.analysis.common.even_rows import row_places
from bench.record.exchange import import_log
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError, RecordError

PERIOD_S = 0.02
REST_S, TURN_S = 20.0, 10.0


def unit(seed: int = 0) -> tuple[Array, Array]:
    """20 s at rest, 10 s of 9 deg/s about y, 20 s at rest, at 50 Hz; biases of 0.3 deg/s, x up at first."""
    rng = np.random.default_rng(seed)
    time_s = PERIOD_S * np.arange(1, round((2 * REST_S + TURN_S) / PERIOD_S) + 1)
    turning = (time_s > REST_S) & (time_s <= REST_S + TURN_S)
    angle = np.radians(9.0 * np.clip(time_s - REST_S, 0.0, TURN_S))
    rates = np.array([0.3, -0.3, 0.2]) + np.outer(turning, [0.0, 9.0, 0.0])
    forces = 9.81 * np.column_stack((np.cos(angle), np.zeros(len(angle)), np.sin(angle)))
    return rates + rng.normal(0.0, 0.01, rates.shape), forces + rng.normal(0.0, 1e-3, forces.shape)


def at(time_s: float) -> int:
    return round(time_s / PERIOD_S) - 1


def test_a_record_without_holes_is_as_it_was() -> None:
    rates, forces = unit()
    found = whole(rates.copy(), forces.copy(), PERIOD_S, "log")
    assert np.array_equal(found[0], rates) and np.array_equal(found[1], forces) and not found[2]


def test_holes_and_single_values_at_rest_are_filled() -> None:
    rates, forces = unit()
    broken, odd = rates.copy(), forces.copy()
    broken[at(5.0) : at(7.0)] = odd[at(5.0) : at(7.0)] = np.nan
    broken[at(12.0), 1] = 5.0  # as much as a tenth of a degree a second over the second
    odd[at(15.0), 2] = -19.6
    filled, forced, (remark,) = whole(broken, odd, PERIOD_S, "log")
    assert "samples missing 100, first at 4.98 s" in remark
    assert "gyro y 1, up to +5.31 deg/s off, first at 11.98 s" in remark and "accelerometer z 1" in remark
    assert filled[at(5.0) : at(7.0)].mean(axis=0) == pytest.approx([0.3, -0.3, 0.2], abs=0.004)
    assert filled[at(12.0)].tolist() == pytest.approx([0.3, -0.3, 0.2], abs=0.03)
    assert forced[at(15.0), 2] == pytest.approx(0.0, abs=1e-3)
    turn = slice(at(REST_S), at(REST_S + TURN_S))
    assert np.array_equal(filled[turn], rates[turn])


@pytest.mark.parametrize(
    ("first_s", "last_s", "found"),
    [(24.0, 24.02, "1 of them, while the unit turns"), (5.0, 11.0, "300 of them, at rest")],
)
def test_what_nobody_knows_is_refused(first_s: float, last_s: float, found: str) -> None:
    rates, forces = unit()
    rates[at(first_s) : at(last_s)] = np.nan
    with pytest.raises(RecordError, match="samples are missing") as wrong:
        whole(rates, forces, PERIOD_S, "log")
    assert wrong.value.found == found


@pytest.mark.parametrize(("tilt_deg", "refused"), [(0.5, False), (2.0, True)])
def test_a_unit_that_turned_in_a_hole_was_not_at_rest(tilt_deg: float, refused: bool) -> None:
    """At rest before a hole of 2 s and after it, and tilted in it."""
    rates, forces = (each[: at(REST_S)] for each in unit())
    forces[at(10.0) :, ::2] = 9.81 * np.array([np.cos(np.radians(tilt_deg)), np.sin(np.radians(tilt_deg))])
    rates[at(9.0) : at(11.0)] = forces[at(9.0) : at(11.0)] = np.nan
    if not refused:
        assert whole(rates, forces, PERIOD_S, "log")[2]
        return
    with pytest.raises(RecordError, match="samples are missing") as wrong:
        whole(rates, forces, PERIOD_S, "log")
    assert wrong.value.found == "100 of them, while the unit turns"


def test_a_value_far_off_in_a_turn_is_left() -> None:
    rates, forces = unit()
    rates[at(24.0), 1] += 5.0
    kept, _, remarks = whole(rates.copy(), forces, PERIOD_S, "log")
    assert np.array_equal(kept, rates) and not remarks


@given(
    seed=st.integers(0, 1000),
    lost=st.lists(
        st.tuples(st.integers(0, 38), st.integers(1, 6)), max_size=8, unique_by=lambda each: each[0]
    ),
    jitter=st.floats(0.0, 0.45),
)
def test_rows_have_their_places_however_their_stamps_scatter(
    seed: int, lost: list[tuple[int, int]], jitter: float
) -> None:
    """Lost rows at least 25 apart; stamps off by up to 0.45 of a step; a period of 20.0003 ms, not 20."""
    places = np.arange(1000)
    gone = [25 * place + 10 + k for place, many in lost for k in range(many)]
    places = np.delete(places, gone)
    stamps_s = 0.0200003 * (places + np.random.default_rng(seed).uniform(-jitter, jitter, len(places)) / 2.0)
    found, period_s = row_places(stamps_s)
    assert (found == places).mean() > 0.97  # beside a gap a late stamp may be taken for it
    assert found[-1] == places[-1]
    assert period_s == pytest.approx(0.0200003, rel=1e-3)


def test_a_log_that_is_mostly_pause_is_refused(tmp_path: Path) -> None:
    rows = np.zeros((100, 7))
    rows[:, 0] = 0.02 * np.arange(100.0)
    rows[50:, 0] += 1e6
    names = [
        "time_s",
        *(f"gyro_{axis}_dps" for axis in "xyz"),
        *(f"accelerometer_{axis}_mps2" for axis in "xyz"),
    ]
    np.savetxt(tmp_path / "imu.csv", rows, "%.3f", ",", header=",".join(names), comments="")
    with pytest.raises(RecordError, match="most of the record is missing"):
        load_record(tmp_path / "imu.csv", scheme="19-position", latitude_deg=47.0)


MAPPING = """
format = 1
unit_id = "IMU-5"
latitude_deg = 47.0
[columns]
time = { name = "t", unit = "ms" }
[columns.gyros]
x = { name = "wx", unit = "rad/s" }
y = { name = "wy", unit = "rad/s" }
z = { name = "wz", unit = "rad/s" }
[columns.accelerometers]
x = { name = "ax", unit = "mg" }
y = { name = "ay", unit = "mg" }
z = { name = "az", unit = "mg" }
"""


def test_a_mapping_and_an_imported_run_are_records(tmp_path: Path) -> None:
    rates, forces = unit()
    t_ms = 1000.0 * PERIOD_S * np.arange(1, len(rates) + 1) + np.random.default_rng(1).integers(
        -3, 4, len(rates)
    )
    rows = np.column_stack((t_ms, np.radians(rates), forces / 9.80665e-3))
    np.savetxt(tmp_path / "imu.csv", rows, "%.9f", ",", header="t,wx,wy,wz,ax,ay,az", comments="")
    (tmp_path / "map.toml").write_text(MAPPING)
    folder = import_log(tmp_path / "imu.csv", tmp_path / "map.toml", tmp_path / "runs")
    for record in (tmp_path / "map.toml", folder):
        run = load_record(record, scheme="19-position")
        assert (run.unit_id, run.run_id, run.latitude_deg) == ("IMU-5", "imu", 47.0) and not run.remarks
        assert run.increments.period_s == pytest.approx(PERIOD_S, rel=1e-4)
        assert np.degrees(run.increments.angle_rad) / PERIOD_S == pytest.approx(rates, abs=1e-3)
        assert run.increments.velocity_mps / PERIOD_S == pytest.approx(forces, abs=2e-3)
        assert load_record(record, scheme="19-position", latitude_deg=10.0).latitude_deg == 10.0
        with pytest.raises(ConfigurationError, match="what was turned where") as wrong:
            load_record(record)
        assert "latitude" not in wrong.value.expected
    (tmp_path / "map.toml").write_text(MAPPING.replace('z = { name = "wz", unit = "rad/s" }\n', ""))
    with pytest.raises(ConfigurationError, match="three gyros and three accelerometers"):
        load_record(tmp_path / "map.toml", scheme="19-position")
