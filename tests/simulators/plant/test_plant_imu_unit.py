"""The IMU on a table of several axes, against navigation, the closed-form turns, and its own truth."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest

from bench.analysis.calibration import Site
from bench.analysis.calibration._navigation import Increments, align, navigate
from benchmarks._turned_imu import Rest, Turn, measure_motion
from drivers.base.constants import gravity_mps2
from drivers.base.errors import ConfigurationError
from simulators.plant.imu import ImuErrors, ImuNoise, ImuUnit, imu_errors, imu_noise
from simulators.plant.lab_plant import LabPlant, PlantConfig, UnitConfig
from simulators.plant.noise import NoiseSource
from simulators.plant.table import TableAxis, TableParameters

STILL = TableParameters(ripple_once_ppm=0.0, ripple_twice_ppm=0.0)
LATITUDE = 45.0


def made(directions, errors=None, noise=None, ticks=260, **options):
    table = [(direction, TableAxis(STILL)) for direction in directions]
    for _, axis in table:
        axis.servo(0.0, True)
    unit = ImuUnit(
        errors or ImuErrors(), noise or ImuNoise(), table, LATITUDE, NoiseSource(1, "imu"), **options
    )
    unit.start(25.0)
    for _ in range(ticks):
        unit.tick(25.0)
    return unit, [axis for _, axis in table]


def record(unit, duration_s, block_s=4.0, rate_hz=100.0):
    count = round(block_s * rate_hz)
    parts = [unit.measure(k * block_s, count, 1.0 / rate_hz) for k in range(round(duration_s / block_s))]
    return Increments(
        1.0 / rate_hz,
        np.concatenate([part.angle_increment_rad for part in parts]),
        np.concatenate([part.velocity_increment_mps for part in parts]),
    )


@pytest.mark.parametrize("directions", [("east", "up"), ("up", "north"), ("up", "east", "up")])
def test_a_perfect_imu_stays_at_rest_through_the_turns_of_any_table(directions):
    unit, axes = made(directions)
    for number, axis in enumerate(axes):
        axis.demand_turn(60.0 + 40.0 * number, (90.0, -180.0, 270.0)[number], 10.0)
    data = record(unit, 200.0)
    track = navigate(data, align(data, 50.0), Site(LATITUDE))
    assert np.abs(track.velocity).max() < 1e-6
    # the turns are there: the attitude is not what it was
    assert np.abs(track.attitude[-1] - track.attitude[0]).max() > 0.5


def test_two_axes_at_once_are_followed_by_navigation():
    unit, (outer, inner) = made(("east", "up"))
    outer.demand_turn(60.0, 90.0, 10.0)
    inner.demand_turn(62.0, 90.0, 10.0)
    data = record(unit, 120.0)
    track = navigate(data, align(data, 50.0), Site(LATITUDE))
    assert np.abs(track.velocity).max() < 5e-4


def test_errors_are_those_of_the_closed_form_turn():
    errors = imu_errors(5, full=True)
    unit, (outer, _) = made(("east", "up"), errors)
    outer.demand_turn(20.0, 90.0, 10.0)
    ours = record(unit, 60.0)
    # a lab whose mounting is exact: read the unit's own askew mounting off its truth
    home = unit._askew
    axis = home.T @ np.array([1.0, 0.0, 0.0])
    theirs = measure_motion(
        home,
        [Rest(20.0), Turn(axis, math.radians(90.0), 9.5), Rest(30.5)],
        errors,
        ImuNoise(),
        latitude_deg=LATITUDE,
        gravity_mps2=gravity_mps2(LATITUDE),
    )
    for found, expected in ((ours.angle_rad, theirs.angle_rad), (ours.velocity_mps, theirs.velocity_mps)):
        np.testing.assert_allclose(found[:1998], expected[:1998], rtol=0, atol=1e-12)
        np.testing.assert_allclose(found[-2000:], expected[-2000:], rtol=0, atol=1e-10)
    # the whole turn; the Earth turned along under two profiles, 1 s apart at most
    np.testing.assert_allclose(ours.angle_rad.sum(axis=0), theirs.angle_rad.sum(axis=0), rtol=0, atol=8e-5)


def test_any_chunking_gives_the_same_samples():
    def whole(cuts):
        unit, (outer, _) = made(("east", "up"), imu_errors(1, True), imu_noise(True), ticks=40)
        outer.demand_turn(10.0, 90.0, 10.0)
        parts = [unit.measure(a * 0.01, b - a, 0.01) for a, b in pairwise([0, *cuts, 3000])]
        return np.concatenate([np.hstack([p.angle_increment_rad, p.velocity_increment_mps]) for p in parts])

    np.testing.assert_allclose(whole([1000, 1001, 2500]), whole([]), rtol=0, atol=1e-12)


def test_noise_is_as_large_as_said():
    unit, _ = made(("east", "up"), noise=imu_noise(False), ticks=260)
    data = record(unit, 256.0)
    arw = math.radians(0.001) / 60.0 * 0.1
    assert data.angle_rad.std(axis=0) == pytest.approx([arw] * 3, rel=0.03)
    summed = np.cumsum(data.velocity_mps - data.velocity_mps.mean(axis=0), axis=0)
    shaken = np.diff(summed[::100], axis=0).std(axis=0)
    vrw = 10 * 9.7803267715e-6
    assert shaken == pytest.approx([math.sqrt(2e-6 + vrw**2)] * 3, rel=0.2)


def test_a_lab_has_an_imu_on_two_axes_and_refuses_there_what_it_cannot_turn():
    axes = (("outer", "east"), ("inner", "up"))
    lab = LabPlant(PlantConfig(axes=axes, units=(UnitConfig("imu", model="imu", unit_seed=3),)))
    lab.advance(10.0)
    lab.mount_at("imu", [[0, 1, 0], [0, 0, 1], [1, 0, 0]])
    lab.advance(20.0)
    signal = lab.unit("imu").measure(12.0, 100, 0.01)
    # x of the unit points up now
    assert signal.velocity_increment_mps.sum(axis=0)[0] == pytest.approx(9.80, abs=0.03)
    assert set(lab.true_drift("imu")) >= {"kg", "ka", "eps_rad_s"}
    lying = LabPlant(PlantConfig(units=(UnitConfig("imu", model="imu", axis="y", mounting="axis_up"),)))
    lying.advance(2.0)
    force = lying.unit("imu").measure(0.0, 100, 0.01).velocity_increment_mps.sum(axis=0)
    assert force[1] == pytest.approx(9.80, abs=0.03)
    with pytest.raises(ConfigurationError, match="needs a table of one axis that points up"):
        LabPlant(PlantConfig(axes=axes, units=(UnitConfig("ins", model="ins_triad"),)))
