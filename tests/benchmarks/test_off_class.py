"""The off-class plants do what they are said to do; each check is a closed form or a property of the physics."""

from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.calibration import Task
from benchmarks._turned_imu import ImuRecord, Rest, Turn
from benchmarks.off_class import _bearings, _imu_noise, _ring_lasers, _thermal_plants
from benchmarks.off_class._heading_plants import FAMILIES as PLATFORMS
from benchmarks.off_class._heading_plants import fly
from benchmarks.off_class._profiles import Truth, air_of, campaign, measured, names
from drivers.base.constants import EARTH_RATE_DPH


@pytest.mark.parametrize("family", ["convection, frost, play", "regulated source"])
def test_a_gyro_in_a_steady_room_comes_to_rest(family: str) -> None:
    air = np.pad(air_of((-45, 12, 40, 25)), (0, 9000), mode="edge")[:, None]
    truth = _thermal_plants.FAMILIES[family](0)(air)[0]
    for series in (truth.t_in_c, truth.t_out_c, truth.bias_dph, truth.sf_error_ppm):
        moving, settled = np.ptp(series), np.ptp(series[-1800:])
        assert settled < max(0.15 * moving, 0.05)


def test_relays_remember_from_where_a_temperature_was_reached() -> None:
    air = np.concatenate([np.linspace(20, -40, 8000), np.linspace(-40, 20, 8000)])[:, None]
    truth = _thermal_plants.relays(0)(air)[0]
    half = len(air) // 2
    down, up = (np.argmin(np.abs(part - -10.0)) for part in (truth.t_in_c[:half], truth.t_in_c[half:]))
    assert abs(truth.bias_dph[down] - truth.bias_dph[half + up]) > 0.02


def test_noise_of_the_runs_is_that_of_the_gyro_named() -> None:
    quiet = np.zeros(60_000)
    truth = Truth(quiet, quiet, quiet, quiet)
    run = measured(truth, "nominal", "bias", np.random.default_rng(3))
    assert run.bias_dph is not None
    blocks = (run.bias_dph - truth.bias_dph)[: len(truth.bias_dph) // 100 * 100].reshape(-1, 100).mean(axis=1)
    # 6 N of white noise and 0.664 B of flicker: 0.0243 deg/h between neighbours of 100 s.
    assert np.sqrt(np.mean(np.diff(blocks) ** 2) / 2.0) == pytest.approx(0.0243, rel=0.1)


def test_a_campaign_has_the_runs_of_the_design() -> None:
    quiet = np.zeros(6000)
    made = campaign(dict.fromkeys(names(), Truth(quiet, quiet, quiet, quiet)), 1)
    assert [len(part) for part in (made.training, made.validation, made.tests)] == [7, 2, 12]
    assert {run.run_id for run in made.tests} >= {"slow bias", "double bias", "slow scale"}


@pytest.mark.parametrize("family", ["seen, exponential", "friction and magnet"])
def test_a_platform_that_does_not_turn_keeps_the_misalignment_of_its_alignment(family: str) -> None:
    stays = ((0.0, 24.0), (120.0, 24.0))
    still = fly(PLATFORMS[family], 0, 5, stays, turned=False)
    run = fly(PLATFORMS[family], 0, 5, stays)
    before = run.log.heading_deg == 0.0
    assert np.allclose(run.log.north_as[before], still.log.north_as[before])
    assert np.abs(run.thermal_as[-1]).max() > 3.0 * np.abs(still.thermal_as[-1]).max()


def test_a_still_bearing_shows_the_earth_and_the_table_only() -> None:
    record, tilt = _bearings.record(lambda t, a, rng: np.zeros(len(a), np.complex128), 1, stretches=1)
    up = EARTH_RATE_DPH * np.sin(np.radians(_bearings.LATITUDE_DEG)) / 3600.0
    assert not tilt.any()
    assert record.rate_dps[:, 2].mean() == pytest.approx(_bearings.SPEED_DPS + up, abs=1e-4)
    level = np.hypot(
        *(np.abs(np.fft.rfft(record.rate_dps[:, k])[4]) * 2 / len(record.rate_dps) for k in (0, 1))
    )
    north = EARTH_RATE_DPH * np.cos(np.radians(_bearings.LATITUDE_DEG)) / 3600.0
    assert level == pytest.approx(np.sqrt(2.0) * north, rel=0.02)


def test_play_is_crossed_while_the_table_turns_back_by_the_travel() -> None:
    angle = np.radians(np.concatenate([np.arange(0.0, 20.0, 0.1), np.arange(20.0, 0.0, -0.1)]))
    bearing = _bearings.played(3.0, 1.0 + 0j)
    jump = bearing(angle, angle, np.random.default_rng(0)) - _bearings.usual(
        angle, angle, np.random.default_rng(0)
    )
    assert jump[199].real == pytest.approx(-0.5) and jump[-1].real == pytest.approx(0.5)
    half_way = 200 + 15
    assert jump[half_way].real == pytest.approx(0.0, abs=0.05)


def test_imu_noise_is_what_it_says() -> None:
    count, period = 200_000, 0.01
    record = ImuRecord(period, np.zeros((count, 3)), np.zeros((count, 3)))
    level = np.broadcast_to(np.eye(3), (count, 3, 3))
    angle, velocity, _ = _imu_noise.white(2.0)(record, level, np.random.default_rng(1))
    assert angle.std() == pytest.approx(2.0 * Task().noise.arw * period**0.5, rel=0.01)
    assert velocity.std() == pytest.approx(Task().noise.vrw * period**0.5, rel=0.01)


def test_a_pier_that_sways_gains_no_velocity_while_the_unit_turns() -> None:
    """In level axes the increments add up to the difference of velocities at the ends, whatever the turns."""
    legs = [Rest(20.0), Turn(np.array([1.0, 0.0, 0.0]), np.pi / 2.0, 9.0), Rest(20.0)]
    attitude = _imu_noise.attitudes(np.eye(3), legs, 100.0)
    record = ImuRecord(0.01, np.zeros((4900, 3)), np.zeros((4900, 3)))
    swing = _imu_noise.swaying(3e-3, 0.15)
    seen = swing(record, attitude, np.random.default_rng(4))[1]
    quiet = _imu_noise.white()(record, attitude, np.random.default_rng(4))[1]
    level = np.einsum("nij,nj->ni", attitude, seen - quiet).cumsum(axis=0)
    assert level.std(axis=0) == pytest.approx(3e-3 * np.ones(3), rel=0.5)
    assert np.abs(np.einsum("nij,nj->ni", attitude[-1:], seen - quiet).sum(axis=0)).max() > 3e-3
    assert attitude[-1] @ [0.0, 1.0, 0.0] == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)


def test_runs_of_a_ring_laser_without_spread_differ_by_noise_and_a_constant() -> None:
    effects = _ring_lasers.FAMILIES["mode hops"]
    first, second = _ring_lasers.unit_runs(effects, 1, 0.0, ("train", "repeat"))
    assert first.true_bias_dph is not None and second.true_bias_dph is not None
    assert np.ptp(first.true_bias_dph - second.true_bias_dph) < 1e-9
    third = _ring_lasers.unit_runs(effects, 1, 0.2, ("train",))[0]
    assert third.true_bias_dph is not None
    assert np.ptp(first.true_bias_dph - third.true_bias_dph) > 1e-3
