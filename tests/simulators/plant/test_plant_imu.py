"""The simulated IMU against closed forms and integrals of its own definition."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks._turned_imu import ImuRecord, Rest, Turn, measure_motion
from drivers.base.errors import ConfigurationError
from simulators.plant.imu import ImuErrors, ImuNoise

EARTH = 7.292115e-5
G = 9.81
X, Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def measure(
    legs: list[Rest | Turn], errors: ImuErrors, noise: ImuNoise | None = None, **more: float
) -> ImuRecord:
    return measure_motion(
        np.eye(3),
        legs,
        errors,
        noise or ImuNoise(),
        latitude_deg=30.0,
        gravity_mps2=G,
        **more,  # type: ignore[arg-type]
    )


def test_at_rest_it_measures_earth_and_gravity_with_its_errors() -> None:
    kg, ka = np.diag([1e-3, 2e-3, 3e-3]), np.zeros((3, 3))
    kg[0, 2], ka[1, 2] = 1e-2, 1e-3
    errors = ImuErrors(np.array([1e-6, 0, 0]), np.array([0, 1e-3, 0]), kg, ka, np.array([0, 0, 1e-5]))
    record = measure([Rest(2.0)], errors)
    up, north = EARTH * 0.5, EARTH * math.sqrt(0.75)
    np.testing.assert_allclose(
        record.angle_rad[7] / 0.01, [1e-6 + 1e-2 * up, north * 1.002, up * 1.003], rtol=1e-12
    )
    np.testing.assert_allclose(
        record.velocity_mps[7] / 0.01, [0.0, 1e-3 + 1e-3 * G, G + 1e-5 * G**2], rtol=1e-12
    )
    assert len(record.angle_rad) == 200


@pytest.mark.parametrize("profile", ["constant", "smooth"])
def test_a_turn_about_the_vertical_adds_up_to_its_angle(profile: str) -> None:
    record = measure([Rest(1.0), Turn(Z, math.pi / 2, 9.0, profile), Rest(1.0)], ImuErrors())  # type: ignore[arg-type]
    assert record.angle_rad[:, 2].sum() == pytest.approx(math.pi / 2 + EARTH * 0.5 * 11.0, rel=1e-12)
    # North swings from y through to x: its share along x is the integral of sin(angle).
    assert record.angle_rad[-1, 0] / 0.01 == pytest.approx(EARTH * math.sqrt(0.75), rel=1e-9)


def test_specific_force_of_a_turn_about_a_horizontal_axis() -> None:
    record = measure([Turn(X, math.pi / 2, 9.0, "constant")], ImuErrors())
    rate = math.pi / 18.0
    # f_y = g sin(rate t), f_z = g cos(rate t): their integrals over the quarter turn are g / rate.
    np.testing.assert_allclose(record.velocity_mps.sum(axis=0), [0.0, G / rate, G / rate], atol=1e-8)


def test_a_lever_arm_feels_the_turn_and_its_velocity_ends_at_rest() -> None:
    lever = np.zeros((3, 3))
    lever[0] = [0.0, 0.1, 0.0]
    plain = measure([Turn(Z, math.pi / 2, 9.0)], ImuErrors())
    with_arm = measure([Turn(Z, math.pi / 2, 9.0)], ImuErrors(lever_m=lever))
    felt = (with_arm.velocity_mps - plain.velocity_mps)[:, 0]
    # x feels -w' r_y: minus the change of rate, which is zero over the whole turn and largest at half of it.
    peak = 2.0 * (math.pi / 2) / 9.0
    assert felt.sum() == pytest.approx(0.0, abs=1e-9)
    assert felt[:450].sum() == pytest.approx(-0.1 * peak, rel=1e-4)
    with pytest.raises(ConfigurationError, match="smooth"):
        measure([Turn(Z, 1.0, 9.0, "constant")], ImuErrors(lever_m=lever))


def test_a_lag_shows_the_force_of_a_moment_ago() -> None:
    now = measure([Turn(X, math.pi / 2, 9.0, "constant")], ImuErrors())
    late = measure([Turn(X, math.pi / 2, 9.0, "constant")], ImuErrors(lag_s=0.01))
    # At 100 Hz a lag of 10 ms is one sample; what is left is of second order, (rate x lag)^2 / 2.
    np.testing.assert_allclose(late.velocity_mps[1:], now.velocity_mps[:-1], atol=G * 0.01 * 2e-6)


def test_noise_has_its_size_and_comes_again() -> None:
    noise = ImuNoise(arw_rad_per_sqrt_s=1e-5, vrw_mps_per_sqrt_s=1e-3)
    first, again = (measure([Rest(200.0)], ImuErrors(), noise) for _ in range(2))
    np.testing.assert_array_equal(first.angle_rad, again.angle_rad)
    assert first.angle_rad.std(axis=0) == pytest.approx(1e-5 * 0.1, rel=0.03)
    assert first.velocity_mps.std(axis=0) == pytest.approx(1e-3 * 0.1, rel=0.03)


def test_bias_wander_is_stationary_from_the_start() -> None:
    noise = ImuNoise(wander_rad_s=1e-6, wander_time_s=0.5)
    starts = [measure([Rest(0.02)], ImuErrors(), noise, seed=seed).angle_rad for seed in range(300)]
    plain = measure([Rest(0.02)], ImuErrors()).angle_rad
    assert np.std([(each - plain)[0] for each in starts]) == pytest.approx(1e-6 * 0.01, rel=0.08)
    long = measure([Rest(400.0)], ImuErrors(), noise).angle_rad[:, 0]
    lagged = np.corrcoef(long[:-50], long[50:])[0, 1]
    assert lagged == pytest.approx(math.exp(-1.0), abs=0.08)


def test_a_leg_must_be_whole_samples() -> None:
    with pytest.raises(ConfigurationError, match="whole number"):
        measure([Rest(0.015)], ImuErrors())
