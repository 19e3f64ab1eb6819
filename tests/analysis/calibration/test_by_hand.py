"""Calibration of a unit turned by hand: a drawn unit's errors come back within what is said of them."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from bench.analysis.calibration import HandRecord, ImuCompensation, calibrate_by_hand, load_hand_record
from bench.analysis.calibration._by_hand import _Move, _turned
from bench.present.cli._app import app
from drivers.base.errors import ConfigurationError, RecordError

PERIOD_S, GRAVITY, REST_S, TURN_S = 0.01, 9.81, 4.0, 2.0
EPS_DPS = np.array([0.4, -0.7, 0.2])
KG = np.array([[0.012, -0.006, 0.004], [0.007, -0.009, 0.003], [-0.005, 0.008, 0.006]])
NABLA = np.array([0.15, -0.1, 0.25])
KA = np.array([[0.008, 0.0, 0.0], [0.004, -0.006, 0.0], [-0.003, 0.005, 0.011]])
TURNS = [
    (axis, angle)
    for axis, angle in (
        ("x", 90), ("y", 90), ("z", 120), ("x", 90), ("y", -120), ("x", 60), ("z", -90), ("y", 75), ("x", -100),
        ("z", 80), ("y", 90), ("x", 110), ("z", 95), ("y", -85), ("x", 90), ("z", 70), ("y", 65), ("x", -75),
    )
]  # fmt: skip


def record(seed: int, turns=TURNS, rest_s: float = REST_S, start=(10.0, -20.0, 30.0)) -> HandRecord:
    """An IMU with the errors above, turned about its own axes, each turn with a smooth rate."""
    rng = np.random.default_rng(seed)
    attitude = Rotation.from_euler("xyz", start, degrees=True)
    rates, forces = [], []
    for number in range(len(turns) + 1):
        count = round(rest_s / PERIOD_S)
        rates.append(np.zeros((count, 3)))
        forces.append(np.tile(attitude.inv().apply([0.0, 0.0, GRAVITY]), (count, 1)))
        if number == len(turns):
            break
        axis, angle_deg = turns[number]
        count = round(TURN_S / PERIOD_S)
        shape = 1.0 - np.cos(2.0 * np.pi * (np.arange(count) + 0.5) / count)
        rate = np.zeros((count, 3))
        rate[:, "xyz".index(axis)] = angle_deg / TURN_S * shape
        gravity = []
        for step in rate:
            attitude = attitude * Rotation.from_rotvec(np.radians(step) * PERIOD_S)
            gravity.append(attitude.inv().apply([0.0, 0.0, GRAVITY]))
        rates.append(rate)
        forces.append(np.array(gravity))
    rate, force = np.concatenate(rates), np.concatenate(forces)
    rate = rate @ (np.eye(3) + KG).T + EPS_DPS + 0.05 * rng.standard_normal(rate.shape)
    force = force @ (np.eye(3) + KA).T + NABLA + 0.01 * rng.standard_normal(force.shape)
    return HandRecord("imu", PERIOD_S, rate, force, np.zeros(len(rate), bool))


def parts(found):
    values, sigma = found.compensation.parameters, found.compensation.sigma
    return {
        "eps": (np.degrees(values[:3]), np.degrees(sigma[:3]), EPS_DPS),
        "nabla": (values[3:6], sigma[3:6], NABLA),
        "kg": (values[6:15], sigma[6:15], KG.ravel(order="F")),
        "ka": (values[15:21], sigma[15:21], KA[np.tril_indices(3)][[0, 1, 3, 2, 4, 5]]),
    }


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_drawn_unit_s_errors_come_back_within_their_sigma(seed):
    found = calibrate_by_hand(record(seed), gravity_mps2=GRAVITY)
    for name, (value, sigma, truth) in parts(found).items():
        assert (np.abs(value - truth) < 4.0 * sigma).all(), name
    assert (parts(found)["kg"][1] < 2e-3).all() and (parts(found)["ka"][1] < 1e-3).all()
    assert found.rests == len(TURNS) + 1 and found.turns == len(TURNS) and not found.left_out
    assert found.gravity_rms_mps2[0] > 0.1 and found.gravity_rms_mps2[1] < 2e-3
    assert found.direction_rms_deg[0] > 0.5 and found.direction_rms_deg[1] < 0.1
    assert math.isnan(found.angle_rms_deg[0])


def test_the_compensation_corrects_a_record_that_it_was_not_fitted_on():
    compensation = calibrate_by_hand(record(1), gravity_mps2=GRAVITY).compensation
    other = record(9, [("z", 40), ("x", 130), ("y", -50)])
    rate, force = compensation.apply("imu", PERIOD_S, other.rate_dps, other.force_mps2)
    rest = slice(50, 350)
    assert np.linalg.norm(force[rest].mean(axis=0)) == pytest.approx(GRAVITY, abs=5e-3)
    assert np.abs(rate[rest].mean(axis=0)).max() < 0.02
    turn = slice(400, 600)  # about z by 40 deg
    assert rate[turn, 2].sum() * PERIOD_S == pytest.approx(40.0, abs=0.1)


@pytest.mark.parametrize("angle_deg", [90.0, -35.0, 200.0])
def test_a_turn_is_scipy_s(angle_deg):
    rng = np.random.default_rng(4)
    rates = rng.standard_normal((37, 3)) + np.array([0.0, 0.2, np.radians(angle_deg)])
    whole = Rotation.identity()
    for step in rates:
        whole = whole * Rotation.from_rotvec(step * 0.02)
    up = np.array([0.3, -0.5, math.sqrt(1.0 - 0.34)])
    turned = _turned(_Move(0, 1, 0.02, rates), up, np.zeros(3), np.zeros(9))
    np.testing.assert_allclose(turned, whole.inv().apply(up), atol=1e-12)


def test_a_told_angle_gives_the_scale_factor_where_gravity_does_not():
    """Turned about z by 360 deg while z is up, as on a plain turning table, and about x and y only after that."""
    about_xy = [
        ("xy"[k % 2], angle) for k, angle in enumerate((90, 60, 80, -70, 100, 85, -65, 95, 75, -80, 90, 70))
    ]
    turned = record(6, [("z", 360.0), ("z", 360.0), *about_xy], start=(0.0, 0.0, 0.0))
    free, told = (calibrate_by_hand(turned, gravity_mps2=GRAVITY, turn_deg=turn) for turn in (None, 360.0))
    zz = 8  # Kg_zz
    assert "Kg_zz" in free.compensation.declared[0] and "Kg_zz" not in told.compensation.declared[0]
    value, sigma, truth = (part[zz] for part in parts(told)["kg"])
    assert value == pytest.approx(truth, abs=4.0 * sigma) and sigma < 2e-3 < parts(free)["kg"][1][zz]
    assert told.angle_rms_deg[0] > 1.0 and told.angle_rms_deg[1] < 0.6


def test_a_hand_that_shakes_is_no_rest():
    """Stretches that scatter 25 times as much as the rests, and in which the hand accelerates the unit."""
    still, rng = record(1), np.random.default_rng(8)
    rows = [slice(k * 600 + 100, k * 600 + 300) for k in range(8)]  # of eight rests
    force = np.concatenate([still.force_mps2[own] * 1.06 for own in rows])
    rate = np.concatenate([still.rate_dps[own] for own in rows])
    force += 0.25 * rng.standard_normal(force.shape)
    rate += 1.25 * rng.standard_normal(rate.shape)
    longer = replace(
        still,
        force_mps2=np.concatenate((still.force_mps2, force)),
        rate_dps=np.concatenate((still.rate_dps, rate)),
        saturated=np.zeros(len(still.saturated) + len(force), bool),
    )
    found = calibrate_by_hand(longer, gravity_mps2=GRAVITY)
    assert found.rests == len(TURNS) + 1
    for value, sigma, truth in parts(found).values():
        assert (np.abs(value - truth) < 4.0 * sigma).all()


def test_turns_at_the_end_of_the_range_and_with_gaps_are_left_out_and_counted():
    whole = record(1)
    saturated, rate = whole.saturated.copy(), whole.rate_dps.copy()
    saturated[450], rate[1650] = True, np.nan
    found = calibrate_by_hand(replace(whole, saturated=saturated, rate_dps=rate), gravity_mps2=GRAVITY)
    assert found.left_out == 2 and found.turns == len(TURNS) - 2
    for value, sigma, truth in parts(found).values():
        assert (np.abs(value - truth) < 4.0 * sigma).all()


def test_too_few_rests_or_attitudes_are_refused():
    with pytest.raises(RecordError, match="too few rests"):
        calibrate_by_hand(record(1, TURNS[:6]), gravity_mps2=GRAVITY)
    with pytest.raises(RecordError, match="too few attitudes"):
        calibrate_by_hand(record(1, [("z", 2.0)] * 12), gravity_mps2=GRAVITY)


def test_what_a_record_did_not_show_is_declared():
    turned_about_x = [("x", angle) for angle in (40, 35, 30, 45, 38, 42, 33, 47, 36, 41, 39)]
    found = calibrate_by_hand(record(1, turned_about_x), gravity_mps2=GRAVITY)
    (unseen, k2) = found.compensation.declared
    assert unseen.startswith("not seen: ") and "Kg_yy" in unseen and "Kg_xx" not in unseen and "K2" in k2


MAPPING = """format = 1
unit_id = "imu 7"
latitude_deg = 48.0
[columns]
time = { name = "t", unit = "s" }
gyros.x = { name = "g0", unit = "deg/s" }
gyros.y = { name = "g1", unit = "deg/s" }
gyros.z = { name = "g2", unit = "deg/s" }
accelerometers.x = { name = "a0", unit = "m/s^2" }
accelerometers.y = { name = "a1", unit = "m/s^2" }
accelerometers.z = { name = "a2", unit = "m/s^2" }
[[run]]
file = "log.csv"
"""


def test_the_command_takes_a_mapping_and_writes_what_corrects_the_unit(tmp_path):
    drawn = record(1)
    rate = drawn.rate_dps.copy()
    rate[450:455, 0] = rate[:, 0].max() + 1.0  # five samples at the end of the range, in one turn
    table = np.column_stack([PERIOD_S * np.arange(len(rate)), rate, drawn.force_mps2])
    kept = np.delete(np.arange(len(rate)), [1650])  # a lost row in another
    np.savetxt(tmp_path / "log.csv", table[kept], "%.9g", ",", header="t,g0,g1,g2,a0,a1,a2", comments="")
    (tmp_path / "map.toml").write_text(MAPPING)
    given, latitude_deg, log = load_hand_record(tmp_path / "map.toml")
    assert (given.unit_id, latitude_deg, log.name) == ("imu 7", 48.0, "log.csv")
    assert np.flatnonzero(given.saturated).tolist() == [450, 451, 452, 453, 454]
    assert np.flatnonzero(np.isnan(given.rate_dps).any(axis=1)).tolist() == [1650]
    told = CliRunner().invoke(
        app,
        ["fit", "calibration", str(tmp_path / "map.toml"), "--by-hand", "--gravity-mps2", str(GRAVITY), "--out",
         str(tmp_path / "out"), "--json"],
    )  # fmt: skip
    assert told.exit_code == 0, told.output
    result = json.loads(told.output.splitlines()[-1])
    assert (result["rests"], result["turns"], result["left_out"]) == (len(TURNS) + 1, len(TURNS) - 2, 2)
    compensation = ImuCompensation.load(tmp_path / "out" / "compensation.gyrocomp")
    assert np.degrees(compensation.parameters[:3]) == pytest.approx(EPS_DPS, abs=0.02)
    assert result["rms"]["gravity_mps2"][1] < 2e-3 and result["rms"]["turn_deg"] is None
    (tmp_path / "map.toml").write_text(MAPPING.replace("accelerometers.z", "# accelerometers.z"))
    with pytest.raises(ConfigurationError, match="three gyros and three accelerometers"):
        load_hand_record(tmp_path / "map.toml")
