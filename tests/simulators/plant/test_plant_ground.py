"""A ground that turns: angles against exact rotations, and that units on it measure what such a ground makes."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.analysis.calibration._conventions import Noise
from bench.analysis.calibration._navigation import Increments, align
from bench.analysis.calibration._record_noise import rest_noise
from drivers.base.constants import EARTH_RATE_RAD_S, gravity_mps2
from simulators.config import Ground
from simulators.plant.ground import MovingGround
from simulators.plant.imu import ImuErrors, ImuNoise, ImuUnit, imu_noise
from simulators.plant.lab_plant import LabPlant, PlantConfig, UnitConfig
from simulators.plant.model import UnitModel
from simulators.plant.noise import NoiseParameters, NoiseSource
from simulators.plant.table import TableAxis, TableParameters
from simulators.plant.wobble import Wobble

ARCSEC = math.pi / 648_000.0
SHIP = Ground(
    rock_arcsec=(900.0, 500.0, 300.0), rock_hz=0.3, engine_arcsec=2.0, engine_hz=11.0, sun_arcsec=600.0
)
LATITUDE = 40.0


def ground(parameters: Ground) -> MovingGround:
    return MovingGround(parameters, NoiseSource(4, "ground"))


def test_each_part_turns_by_what_it_says() -> None:
    time_s = np.arange(0.0, 40_000.0, 0.25)
    rock = ground(Ground(rock_arcsec=(30.0, 20.0, 0.0), rock_hz=0.2)).turned_rad(time_s) / ARCSEC
    assert rock.std(axis=0) == pytest.approx([30.0, 20.0, 0.0], rel=0.1)
    assert abs(np.corrcoef(rock[:, 0], rock[:, 1])[0, 1]) < 0.2
    spectrum = np.abs(np.fft.rfft(rock[:, 0])) ** 2
    frequency = np.fft.rfftfreq(len(time_s), 0.25)
    assert (spectrum * frequency).sum() / spectrum.sum() == pytest.approx(0.2, rel=0.03)
    engine = ground(Ground(engine_arcsec=3.0, engine_hz=2.0)).turned_rad(0.2 * time_s) / ARCSEC
    assert engine.std(axis=0) == pytest.approx([3.0 / math.sqrt(2.0)] * 3, rel=1e-3)
    np.testing.assert_allclose(engine[10:], engine[:-10], atol=1e-8)  # a period of 0.5 s
    half_day = ground(Ground(sun_arcsec=5.0)).turned_rad(np.array([0.0, 43_200.0, 86_400.0])) / ARCSEC
    np.testing.assert_allclose(half_day[[0, 2]], 0.0, atol=1e-9)
    assert 0.0 < np.abs(half_day[1, :2]).max() <= 10.0 and half_day[1, 2] == 0.0
    for still in (Ground(), Ground(sway_mps=1.0), Ground(step_arcsec=9.0), Ground(steps_per_min=9.0)):
        assert not still.rocks
    assert SHIP.rocks and not SHIP.moves and Ground(step_arcsec=1.0, steps_per_min=1.0).rocks


def test_a_step_tips_the_floor_the_way_it_pushes() -> None:
    floor = ground(Ground(step_mps=1.0, step_arcsec=1.0, steps_per_min=3.0, step_hz=2.0))
    time_s = np.arange(0.0, 300.0, 0.01)
    pushed, tipped = floor.velocity_mps(time_s), floor.turned_rad(time_s) / ARCSEC
    up = np.cross(tipped, [0.0, 0.0, 1.0])  # where the floor's up leans to
    assert np.abs(up).max() > 0.3
    np.testing.assert_allclose(up[:, :2], pushed[:, :2], atol=1e-9)
    np.testing.assert_allclose(tipped[:, 2], 0.0, atol=1e-12)


def quiet(model: UnitModel) -> UnitModel:
    none = NoiseParameters(0.0, 0.0, 0.0)
    axes = tuple(
        replace(axis, noise=none, bias_dph={}, sf_error_ppm={}, turn_on_bias_dph=0.0, turn_on_sf_ppm=0.0)
        for axis in model.axis_models
    )
    return replace(model, axis_models=axes)


def lab(parameters: Ground, **unit: object) -> LabPlant:
    """A quiet triad beside a table that stands for 10 s, turns by a quarter and comes back."""
    config = UnitConfig(
        "u", model="ins_triad", unit_seed=1, change=quiet, mount_azimuth_error_deg=20.0, **unit
    )  # type: ignore[arg-type]
    exact = TableParameters(ripple_once_ppm=0.0, ripple_twice_ppm=0.0)
    plant = LabPlant(
        PlantConfig(latitude_deg=LATITUDE, seed=3, ground=parameters, table=exact, units=(config,))
    )
    plant.advance(1.0)
    plant.mount("u", "z_up")
    plant.advance(10.0)
    plant.table.servo(10.0, True)
    plant.table.demand_turn(10.0, 40.0, 10.0)
    plant.advance(20.0)
    plant.table.demand_turn(20.0, -40.0, 10.0)
    plant.advance(40.0)
    return plant


def attitudes(plant: LabPlant, edges_s: np.ndarray, turns: bool) -> Rotation:
    """Axes of the unit in inertial space that stood east, north, up at time 0: Earth, ground, mount, table."""
    latitude = math.radians(LATITUDE)
    earth = EARTH_RATE_RAD_S * np.array([0.0, math.cos(latitude), math.sin(latitude)])
    carried = Rotation.from_rotvec(np.outer(edges_s, earth))
    carried = carried * Rotation.from_rotvec(plant._ground.turned_rad(edges_s))
    angle_deg = np.zeros(len(edges_s))
    if turns:
        angle_deg = np.array([plant.table.total_angle_deg(time) for time in edges_s])
    return carried * Rotation.from_euler("z", (90.0 + 20.0 + angle_deg)[:, None], degrees=True)


@pytest.mark.parametrize("turns", [True, False])
def test_gyros_and_accelerometers_follow_the_ground(turns: bool) -> None:
    plant = lab(SHIP, wobble=Wobble(), on_ground=not turns)
    signal = plant.unit("u").measure(0.0, 3900, 0.01)
    assert signal.velocity_increment_mps is not None
    edges_s = 0.01 * np.arange(3901)
    attitude = attitudes(plant, edges_s, turns)
    expected = (attitude[:-1].inv() * attitude[1:]).as_rotvec()
    assert np.degrees(np.abs(expected[2000:2200, 2]).max()) > (0.05 if turns else 0.0)
    np.testing.assert_allclose(signal.angle_increment_rad[200:], expected[200:], atol=2e-12)
    middle_s = edges_s[:-1] + 0.005
    leaning = Rotation.from_rotvec(
        -EARTH_RATE_RAD_S * np.outer(middle_s, [0.0, math.cos(math.radians(40)), 0])
    )
    up = attitudes(plant, middle_s, turns).inv().apply(np.tile([0.0, 0.0, 1.0], (3900, 1)))
    force = signal.velocity_increment_mps[200:] / 0.01 / gravity_mps2(LATITUDE)
    # the Earth turns by 0.16 deg meanwhile, and up with it
    np.testing.assert_allclose(np.linalg.norm(force, axis=1), 1.0, atol=1e-6)
    np.testing.assert_allclose(force, up[200:], atol=np.abs(leaning.as_rotvec()).max() + 1e-5)
    assert np.abs(force[:, :2]).max() > 2e-3


def test_a_ground_that_hardly_turns_is_one_at_rest() -> None:
    """Play is taken up across chunks and after a mounting anew, as on a floor that stands."""
    bearing = Wobble({2.0: 8.0 + 3.0j}, play_arcsec=50.0, play_travel_deg=2.0, misalignment_arcsec=(9.0, 4.0))
    found = []
    for rock, cuts in ((0.0, []), (1e-6, []), (1e-6, [700, 1503, 2306])):
        plant = lab(Ground(rock_arcsec=(rock, rock, rock)), wobble=bearing)
        parts = [plant.unit("u").measure(0.01 * a, b - a, 0.01) for a, b in pairwise([0, *cuts, 3900])]
        found.append(np.concatenate([part.angle_increment_rad for part in parts]))
    np.testing.assert_allclose(found[1:], [found[0]] * 2, atol=1e-10)
    assert np.abs(found[0][:, 0]).max() > 1e-6


def test_an_imu_on_two_axes_feels_the_ground_turn() -> None:
    """Gyros give the exact attitude back; specific force is gravity in it, at rest and while the table turns."""
    errors = ImuErrors(kg=np.diag([1e-3, 0.0, -2e-3]))
    tables = [
        TableAxis(TableParameters(ripple_once_ppm=0.0, ripple_twice_ppm=0.0), NoiseSource(1, name))
        for name in ("outer", "inner")
    ]
    floor = ground(SHIP)
    axes = list(zip(("east", "up"), tables, strict=True))
    unit = ImuUnit(errors, ImuNoise(), axes, LATITUDE, NoiseSource(2, "imu"), ground=floor)
    unit.start(25.0)
    for _ in range(41):
        unit.tick(25.0)
    tables[0].servo(10.0, True)
    tables[0].demand_turn(10.0, 30.0, 10.0)
    signal = unit.measure(0.0, 4000, 0.01)
    assert signal.velocity_increment_mps is not None
    edges_s = 0.01 * np.arange(4001)
    latitude = math.radians(LATITUDE)
    earth = EARTH_RATE_RAD_S * np.array([0.0, math.cos(latitude), math.sin(latitude)])
    angle = np.array([tables[0].total_angle_deg(time) for time in edges_s])
    home = Rotation.from_matrix(unit._askew)
    ground_turn = Rotation.from_rotvec(floor.turned_rad(edges_s))
    local = ground_turn * Rotation.from_euler("x", angle[:, None], degrees=True) * home
    whole = Rotation.from_rotvec(np.outer(edges_s, earth)) * local
    expected = (whole[:-1].inv() * whole[1:]).as_rotvec() * [1.001, 1.0, 0.998]
    # the turns of table and ground are summed: what they do to each other within 10 ms is second order
    np.testing.assert_allclose(signal.angle_increment_rad, expected, atol=3e-9)
    middle_s = edges_s[:-1] + 0.005
    between = Rotation.from_rotvec(floor.turned_rad(middle_s))
    middle_deg = np.array([tables[0].total_angle_deg(time) for time in middle_s])
    at = between * Rotation.from_euler("x", middle_deg[:, None], degrees=True) * home
    force = signal.velocity_increment_mps / 0.01
    np.testing.assert_allclose(force, at.inv().apply([0.0, 0.0, gravity_mps2(LATITUDE)]), atol=1e-4)


def test_an_imu_is_aligned_on_a_ground_that_rocks() -> None:
    """By 48 s of a rock whose ends alone would put north off by degrees, to the attitude of the first sample."""
    floor = ground(Ground(rock_arcsec=(60.0, 60.0, 10.0), rock_hz=0.15))
    table = [("up", TableAxis(TableParameters(), NoiseSource(1, "table")))]
    unit = ImuUnit(ImuErrors(), ImuNoise(), table, LATITUDE, NoiseSource(2, "imu"), ground=floor)
    unit.start(25.0)
    for _ in range(50):
        unit.tick(25.0)
    signal = unit.measure(0.0, 4800, 0.01)
    assert signal.velocity_increment_mps is not None
    data = Increments(0.01, signal.angle_increment_rad, signal.velocity_increment_mps)
    mean = signal.angle_increment_rad.mean(axis=0) / 0.01
    at_first = floor.attitude(np.zeros(1))[0] @ unit._askew
    north = np.cross([0.0, 0.0, 1.0], np.cross(at_first @ mean, [0.0, 0.0, 1.0]))
    assert abs(math.degrees(math.atan2(north[0], north[1]))) > 1.0
    off = Rotation.from_matrix(align(data, 48.0) @ at_first.T).as_rotvec() / ARCSEC
    assert np.abs(off[:2]).max() < 0.1 and abs(off[2]) < 30.0


def test_rocking_is_not_read_as_gyro_noise() -> None:
    """White noise of 0.001 deg/sqrt(h) on a pier that rocks by 3 arcsec; means of 1 s show 20 times as much."""
    told = Noise()
    noise = imu_noise(False)
    found = []
    for rock in (0.0, 3.0):
        floor = ground(Ground(rock_arcsec=(rock, rock, rock / 10.0), rock_hz=0.15))
        table = [("up", TableAxis(TableParameters(), NoiseSource(1, "table")))]
        unit = ImuUnit(ImuErrors(), noise, table, LATITUDE, NoiseSource(2, "imu"), ground=floor)
        unit.start(25.0)
        for _ in range(302):
            unit.tick(25.0)
        signal = unit.measure(0.0, 30_000, 0.01)
        assert signal.velocity_increment_mps is not None
        data = Increments(0.01, signal.angle_increment_rad, signal.velocity_increment_mps)
        found.append(rest_noise(data, np.ones(300, np.bool_), told).arw_deg_per_sqrt_h)
        seconds = np.diff(data.sums(100, 300)[0][1:-1], axis=0)
    crude = math.degrees(float(np.sqrt((seconds[:, :2] ** 2).mean() / 2.0))) * 60.0
    assert crude > 0.02
    assert found == pytest.approx([0.001, 0.001], rel=0.15)
