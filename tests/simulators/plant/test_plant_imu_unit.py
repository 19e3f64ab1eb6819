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
from simulators.config import Ground
from simulators.plant.ground import MovingGround
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


FIELD = Ground(sway_mps=3e-3, sway_hz=0.2, step_mps=2e-3, steps_per_min=6.0)


def test_what_accelerometers_gain_in_the_field_is_the_grounds_velocity():
    """Turned back into level axes by the table's own angle, increments add up to what the ground moves at."""
    pier = MovingGround(FIELD, NoiseSource(4, "ground"))
    records = []
    for ground in (pier, None):
        unit, (outer, _) = made(("east", "up"), ground=ground)
        outer.demand_turn(60.0, 90.0, 10.0)
        records.append(record(unit, 200.0).velocity_mps)
    gained = records[0] - records[1]
    level = np.cumsum(gained[:6000], axis=0)  # at rest, but for 0.05 deg of mounting
    ends = 0.01 * np.arange(6001)
    moved = pier.velocity_mps(ends)
    np.testing.assert_allclose(level, moved[1:] - moved[0], atol=5e-5)
    # after a quarter turn about east, north lies along -z of the unit and up along its y
    part = slice(10_000, 20_000)
    turned = np.cumsum(gained[part], axis=0)
    moved = pier.velocity_mps(0.01 * np.arange(10_000, 20_001))
    later = moved[1:] - moved[0]
    np.testing.assert_allclose(turned, np.column_stack([later[:, 0], later[:, 2], -later[:, 1]]), atol=5e-5)


def test_a_pier_sways_at_its_frequency_and_a_still_one_not_at_all():
    wind = MovingGround(Ground(sway_mps=3e-3, sway_hz=0.2), NoiseSource(4, "ground"))
    times = 0.5 * np.arange(40_000)
    velocity = wind.velocity_mps(times)
    assert velocity[:, :2].std(axis=0) == pytest.approx(3e-3, rel=0.1)
    assert not velocity[:, 2].any()
    power = np.abs(np.fft.rfft(velocity[:, 0])) ** 2
    frequency = np.fft.rfftfreq(len(times), 0.5)
    near = np.abs(frequency - 0.2) < 0.03
    assert power[near].sum() > 0.95 * power.sum()
    assert not Ground().moves and not Ground(step_mps=1.0).moves and FIELD.moves
    # velocity is a function of time, however it is asked for
    np.testing.assert_array_equal(wind.velocity_mps(times[100:110]), velocity[100:110])


def test_steps_come_as_often_as_told_and_ring_down():
    people = MovingGround(Ground(step_mps=2e-3, steps_per_min=3.0, step_hz=5.0), NoiseSource(9, "ground"))
    times = 0.01 * np.arange(600_000)
    up = people.velocity_mps(times)[:, 2]
    ring_s = 20.0 / (2.0 * math.pi * 5.0)
    # each push has the energy of its ringing: a^2 ring / 4, a quarter of it upwards by half the velocity
    energy = (1e-3) ** 2 * ring_s / 4.0
    assert 0.01 * np.sum(up**2) / energy == pytest.approx(3.0 * 100.0, rel=0.25)
    parts = np.concatenate([people.velocity_mps(times[k : k + 777])[:, 2] for k in range(0, 30_000, 777)])
    np.testing.assert_allclose(parts, up[: len(parts)], atol=1e-9)


def test_larger_errors_are_the_same_ones_times_the_scale():
    one, ten = imu_errors(5, False), imu_errors(5, False, 10.0)
    for name in ("eps_rad_s", "nabla_mps2", "kg", "ka", "k2_s2pm"):
        np.testing.assert_allclose(getattr(ten, name), 10.0 * getattr(one, name), rtol=1e-12)
