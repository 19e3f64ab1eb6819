"""Error equations, extraction window: published numbers, closed forms and naive refits (checks C1, C3 to
C7)."""

from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.heading import PlatformLog
from bench.analysis.heading._frames import earth_rotation_deg, gravitation_latitude_deg, position_error
from bench.analysis.heading._log import Site, log_from_positions, settled
from bench.analysis.heading._window import check_window, design, extract
from benchmarks._heading_plants import position_error_finite
from drivers.base.constants import EARTH_RATE_RAD_S, SIDEREAL_DAY_S
from drivers.base.errors import ConfigurationError, RecordError

LATITUDE = 40.0


def log_of(
    time_s: np.ndarray,
    phi_as: np.ndarray,
    noise: float = 0.0,
    angle0: float = 2.0,
    latitude: float = LATITUDE,
) -> PlatformLog:
    angle = angle0 + EARTH_RATE_RAD_S * time_s
    north, east = position_error(phi_as, angle, latitude)
    random = np.random.default_rng(1)
    north, east = (each + noise * random.standard_normal(len(time_s)) for each in (north, east))
    return PlatformLog(
        time_s, angle, north, east, np.full(len(time_s), 45.0), np.zeros(len(time_s)), latitude
    )


def test_error_equations_give_the_published_example() -> None:
    north, east = position_error(np.array([[10.0, -6.0, 4.0]]), np.radians([30.0]), 40.0)
    assert north[0] == pytest.approx(10.196152, abs=1e-6)
    assert east[0] / np.cos(np.radians(40.0)) == pytest.approx(-0.749517, abs=1e-5)


def test_finite_rotation_leaves_half_the_square() -> None:
    angle = np.linspace(0.0, 6.0, 50)
    size = np.radians(0.1) / np.sqrt(3.0) * 206264.806
    phi = np.full((50, 3), size)
    small = np.stack(position_error(phi, angle, 40.0))
    finite = np.stack(position_error_finite(phi, angle, 40.0))
    assert np.abs(finite - small).max() == pytest.approx(0.4, abs=0.2)
    tiny = np.stack(position_error_finite(phi * 1e-4, angle, 40.0))
    np.testing.assert_allclose(tiny, small * 1e-4, atol=1e-8)


def test_earth_rotation_angle_at_j2000() -> None:
    """ERA at 2000-01-01 12:00 UT1 is 280.4606 deg; a turn takes 86164.0989 s (IERS)."""
    assert earth_rotation_deg(946728000.0) == pytest.approx(280.46061837, abs=1e-6)
    assert earth_rotation_deg(946728000.0 + 86164.09890369) == pytest.approx(280.46061837, abs=1e-6)


def test_gravitation_latitude() -> None:
    """Half of WGS 84's difference between geodetic and geocentric latitude, 11.545 arcmin at 45 deg.

    Against the direction of J2's gravitation itself: atan2 of its components at the surface.
    """
    assert 120.0 * (45.0 - float(gravitation_latitude_deg(45.0))) == pytest.approx(11.5458, abs=1e-3)
    geodetic = np.radians(50.0)
    geocentric = np.arctan(np.tan(geodetic) * (1.0 - 6.69437999014e-3))
    sine2, factor = np.sin(geocentric) ** 2, 1.5 * 1.08262982131e-3 * (6378.137 / 6365.6) ** 2
    shape = (1.0 + factor * (3.0 - 5.0 * sine2)) / (1.0 + factor * (1.0 - 5.0 * sine2))
    direction = np.degrees(np.arctan(np.tan(geocentric) * shape))
    assert float(gravitation_latitude_deg(50.0)) == pytest.approx(direction, abs=0.003)
    assert float(gravitation_latitude_deg(0.0)) == 0.0


def test_design_condition_and_sigmas() -> None:
    time_s = np.arange(0.0, SIDEREAL_DAY_S, 60.0)
    angle = np.radians(116.3) + EARTH_RATE_RAD_S * time_s
    rows = design(time_s, angle, LATITUDE, 0.5 * time_s[-1], False).reshape(-1, 6)
    assert np.linalg.cond(rows) == pytest.approx(6.199, abs=0.05)
    sigma = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    np.testing.assert_allclose(sigma, [0.0367, 0.0329, 0.0378, 0.1213, 0.1356, 0.1627], atol=2e-4)


@pytest.mark.parametrize("delay_s", [0.0, 807.0])
def test_constant_drift_is_found_exactly(delay_s: float) -> None:
    time_s = np.arange(0.0, SIDEREAL_DAY_S, 60.0)
    drift = np.array([3e-4, -5e-4, 8e-4])
    phi = np.array([10.0, -6.0, 4.0]) + drift * (time_s - delay_s)[:, None]
    log = log_of(time_s, phi)
    shown = PlatformLog(
        time_s,
        log.sidereal_rad + delay_s * EARTH_RATE_RAD_S,
        log.north_as,
        log.east_as,
        log.temp_c,
        log.heading_deg,
        LATITUDE,
        delay_s,
    )
    found = extract(shown, window_s=SIDEREAL_DAY_S)
    assert found is not None and found.published
    np.testing.assert_allclose(found.eps_dph, drift, rtol=1e-9)
    np.testing.assert_allclose(found.phi_as, phi[-1] + drift * delay_s, atol=1e-9)


@pytest.mark.parametrize(("fraction", "expected"), [(0.25, 0.15625), (0.5, 0.5), (0.75, 0.84375)])
def test_drift_step_enters_as_a_cubic(fraction: float, expected: float) -> None:
    time_s = np.arange(0.0, SIDEREAL_DAY_S, 60.0)
    since = np.clip(time_s - (1.0 - fraction) * SIDEREAL_DAY_S, 0.0, None)
    found = extract(log_of(time_s, np.outer(since, [0.0, 0.0, 1.0])), window_s=SIDEREAL_DAY_S)
    assert found is not None
    assert found.eps_dph[2] == pytest.approx(expected, abs=0.01)


@pytest.mark.parametrize(
    ("days", "periodic", "worst", "tolerance"),
    [(1.0, False, 0.513, 0.02), (1.5, False, 0.031, 0.02), (1.5, True, 0.0, 1e-3)],
)
def test_leak_of_a_daily_drift(days: float, periodic: bool, worst: float, tolerance: float) -> None:
    time_s = np.arange(0.0, days * SIDEREAL_DAY_S, 300.0)
    largest = 0.0
    for angle0 in np.arange(0.0, 2.0 * np.pi, np.pi / 6.0):
        angle = angle0 + EARTH_RATE_RAD_S * time_s
        for swing in (np.sin(angle), -np.cos(angle)):  # integrals of cos and sin
            for axis in range(3):
                phi = np.zeros((len(time_s), 3))
                phi[:, axis] = (swing - swing[0]) / EARTH_RATE_RAD_S
                log = log_of(time_s, phi, angle0=angle0)
                found = extract(log, window_s=days * SIDEREAL_DAY_S, periodic=periodic)
                assert found is not None
                largest = max(largest, float(np.abs(found.eps_dph).max()))
    assert largest == pytest.approx(worst, abs=tolerance)


def test_gap_at_the_edge_withholds_the_estimate() -> None:
    time_s = np.arange(0.0, SIDEREAL_DAY_S, 60.0)
    log = log_of(time_s, np.zeros((len(time_s), 3)), noise=1.0)
    log.north_as[: 12 * 60] = np.nan
    found = extract(log, window_s=SIDEREAL_DAY_S)
    assert found is not None
    assert not found.published


def test_short_window_is_refused() -> None:
    log = log_of(np.arange(0.0, SIDEREAL_DAY_S, 600.0), np.zeros((144, 3)))
    with pytest.raises(ConfigurationError, match=r"too short.*12\.00 h.*23\.93 h"):
        extract(log, window_s=12 * 3600.0)
    with pytest.raises(ConfigurationError, match="with periodic regressors"):
        extract(log, window_s=SIDEREAL_DAY_S, periodic=True)


def test_positions_across_the_date_line() -> None:
    log = log_from_positions(
        np.array([0.0, 60.0]),
        np.array([40.0, 40.001]),
        np.array([-179.999, 179.999]),
        np.array([45.0, 45.0]),
        np.zeros(2),
        Site(40.0, 180.0),
    )
    level = np.cos(0.5 * (np.radians(40.0) + np.arctan(np.tan(np.radians(40.0)) * (1.0 - 6.69437999014e-3))))
    np.testing.assert_allclose(log.east_as, [3.6 * level, -3.6 * level], rtol=1e-6)
    assert log.north_as[1] == pytest.approx(3.6, rel=4e-3)
    with pytest.raises(RecordError, match="increasing"):
        PlatformLog(np.array([1.0, 1.0]), *[np.zeros(2)] * 5, 40.0)


def test_settled_after_a_turn() -> None:
    time_s = np.arange(0.0, 100 * 3600.0, 600.0)
    log = log_of(time_s, np.zeros((len(time_s), 3)))
    log.heading_deg[time_s >= 50 * 3600.0] = 90.0
    calm = settled(log, 20 * 3600.0)
    expected = (time_s < 50 * 3600.0) | (time_s >= 70 * 3600.0)
    np.testing.assert_array_equal(calm, expected)


def test_the_sidereal_day_as_it_is_printed_is_long_enough() -> None:
    check_window(3600.0 * 23.93447, periodic=False)
    check_window(3600.0 * 35.90171, periodic=True)
    with pytest.raises(ConfigurationError, match="too short"):
        check_window(3600.0 * 23.93, periodic=False)
