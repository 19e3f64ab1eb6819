"""The plant's nonlinear navigation against closed forms, and the extraction against it (checks C2, C10,
C11)."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.analysis.heading import PlatformLog
from bench.analysis.heading._log import Site, log_from_positions
from bench.analysis.heading._window import extract
from benchmarks._heading_plants import position_error_finite
from drivers.base.constants import (
    ARCSEC_RAD,
    EARTH_AXIS_M,
    EARTH_ECCENTRICITY_SQUARED,
    EARTH_MU_M3PS2,
    EARTH_RATE_RAD_S,
    SCHULER_RAD_S,
    SIDEREAL_DAY_S,
)
from simulators.plant.platform_navigation import PlatformNavigator, rotation

LATITUDE = 40.0
LEVEL, UP = np.cos(np.radians(LATITUDE)), np.sin(np.radians(LATITUDE))
PHI = np.array([8.0, -7.0, 5.0])


class MisalignedNavigator(PlatformNavigator):
    """It starts with a misalignment, on the true position or (`turned`) on R(phi) r, which excites no Schuler
    motion.
    """

    def __init__(
        self, step_s: float, phi_as: np.ndarray, *, turned: bool = False, damping: float = 0.0
    ) -> None:
        super().__init__(LATITUDE, 0.3, step_s, damping=damping)
        self._phi = phi_as
        if turned:
            position = np.array([self._level * math.cos(0.3), self._level * math.sin(0.3), self._up])
            velocity = EARTH_RATE_RAD_S * np.array([-position[1], position[0], 0.0])
            turn = rotation(phi_as * ARCSEC_RAD) - np.eye(3)
            self._state = np.concatenate([turn @ position, turn @ velocity])


class EllipsoidNavigator(MisalignedNavigator):
    """On the WGS 84 ellipsoid, its gravitation with J2; the latitude is geodetic."""

    def __init__(self, step_s: float, phi_as: np.ndarray, damping: float) -> None:
        super().__init__(step_s, phi_as, damping=damping)
        self._latitude = math.radians(LATITUDE)
        shrink = 1.0 - EARTH_ECCENTRICITY_SQUARED
        self._geocentric = math.atan2(shrink * math.sin(self._latitude), math.cos(self._latitude))
        radius = _radius(self._geocentric)
        self._level, self._up = radius * math.cos(self._geocentric), radius * math.sin(self._geocentric)

    def _gravity(self, place: np.ndarray) -> np.ndarray:
        distance = math.sqrt(float(place @ place))
        radius = _radius(math.asin(place[2] / distance))
        aided = place * (radius / distance)
        sine2 = (place[2] / distance) ** 2
        factor = 1.5 * 1.08262982131e-3 * (EARTH_AXIS_M / radius) ** 2
        shape = np.array([1.0 + factor * (1.0 - 5.0 * sine2)] * 2 + [1.0 + factor * (3.0 - 5.0 * sine2)])
        return -EARTH_MU_M3PS2 / radius**3 * aided * shape - SCHULER_RAD_S**2 * (place - aided)

    def _rate(self, state: np.ndarray, angle: float, turn: np.ndarray) -> np.ndarray:
        place = np.array([self._level * math.cos(angle), self._level * math.sin(angle), self._up])
        deviation, velocity = state[:3], state[3:]
        gravity = self._gravity(place)
        force = -(EARTH_RATE_RAD_S**2) * place * [1.0, 1.0, 0.0] - gravity
        pull = self._gravity(place + deviation) - gravity
        against = velocity - EARTH_RATE_RAD_S * np.array([-deviation[1], deviation[0], 0.0])
        damp = 2.0 * self._damping * SCHULER_RAD_S
        return np.concatenate([velocity, turn @ force + pull - damp * against])

    def _errors(self) -> tuple[float, float]:
        north_as, east_as = super()._errors()
        geocentric = math.tan(self._geocentric + north_as * ARCSEC_RAD)
        geodetic = math.atan2(geocentric, 1.0 - EARTH_ECCENTRICITY_SQUARED)
        return (geodetic - self._latitude) / ARCSEC_RAD, east_as


def _radius(geocentric_rad: float) -> float:
    """Geocentric radius of the WGS 84 ellipsoid."""
    ratio = EARTH_ECCENTRICITY_SQUARED / (1.0 - EARTH_ECCENTRICITY_SQUARED)
    return EARTH_AXIS_M / math.sqrt(1.0 + ratio * math.sin(geocentric_rad) ** 2)


def log_of(
    navigator: PlatformNavigator, phi: np.ndarray, step_s: float, latitude: float, delay_s: float
) -> PlatformLog:
    north, longitude = navigator.advance(phi)
    time_s = step_s * np.arange(1, len(phi) + 1)
    empty = np.zeros(len(phi))
    level = np.cos(np.radians(latitude))
    return PlatformLog(
        time_s, 0.3 + EARTH_RATE_RAD_S * time_s, north, level * longitude, empty, empty, latitude, delay_s
    )


def test_started_on_the_turned_position_a_constant_turn_makes_no_schuler_motion() -> None:
    navigator = MisalignedNavigator(30.0, PHI, turned=True)
    north, longitude = navigator.advance(np.tile(PHI, (2880, 1)))
    angle = 0.3 + EARTH_RATE_RAD_S * 30.0 * np.arange(1, 2881)
    expected = position_error_finite(np.tile(PHI, (2880, 1)), angle, LATITUDE)
    assert np.abs(north - expected[0]).max() < 1e-5
    assert np.abs(longitude * LEVEL - expected[1]).max() < 1e-5


def test_schuler_period_and_sidereal_day() -> None:
    assert 2.0 * np.pi / SCHULER_RAD_S / 60.0 == pytest.approx(84.48906, abs=1e-4)
    assert pytest.approx(23.93447, abs=1e-5) == SIDEREAL_DAY_S / 3600.0


def test_started_on_the_true_position_the_swing_is_the_closed_form() -> None:
    """d = R r - r less the free swing of an isotropic oscillator from d(0), d'(0) of that turn."""
    navigator = MisalignedNavigator(10.0, PHI)
    north, longitude = navigator.advance(np.tile(PHI, (2600, 1)))
    time_s = 10.0 * np.arange(1, 2601)
    angle = 0.3 + EARTH_RATE_RAD_S * time_s

    def place(at: np.ndarray) -> np.ndarray:
        return np.stack([LEVEL * np.cos(at), LEVEL * np.sin(at), np.full_like(at, UP)], axis=1)

    start = np.array([0.3])
    moving = EARTH_RATE_RAD_S * LEVEL * np.stack([-np.sin(start), np.cos(start), 0.0 * start], axis=1)
    swing = np.cross(PHI, place(start)) * np.cos(SCHULER_RAD_S * time_s)[:, None]
    swing = swing + np.cross(PHI, moving) * np.sin(SCHULER_RAD_S * time_s)[:, None] / SCHULER_RAD_S
    error = np.cross(PHI, place(angle)) - swing
    east = np.stack([-np.sin(angle), np.cos(angle), 0.0 * angle], axis=1)
    up_north = np.stack([-UP * np.cos(angle), -UP * np.sin(angle), np.full_like(angle, LEVEL)], axis=1)
    np.testing.assert_allclose(north, np.sum(error * up_north, axis=1), atol=2e-3)
    np.testing.assert_allclose(longitude * LEVEL, np.sum(error * east, axis=1), atol=2e-3)
    assert np.abs(np.sum(swing * east, axis=1)).max() > 5.0


def test_damped_navigation_is_late_by_807_s() -> None:
    step_s = 60.0
    navigator = PlatformNavigator(LATITUDE, 0.3, step_s, damping=0.5)
    count = round(2.5 * SIDEREAL_DAY_S / step_s)
    log = log_of(navigator, np.tile(PHI, (count, 1)), step_s, LATITUDE, 0.0)
    delay_s = 2.0 * 0.5 / SCHULER_RAD_S
    assert delay_s == pytest.approx(806.8, abs=0.5)
    late = PlatformLog(
        log.time_s,
        log.sidereal_rad,
        log.north_as,
        log.east_as,
        log.temp_c,
        log.heading_deg,
        LATITUDE,
        delay_s,
    )
    naive, right = (extract(each, window_s=SIDEREAL_DAY_S) for each in (log, late))
    assert naive is not None and right is not None
    wrong = np.linalg.norm((naive.phi_as - PHI)[:2]) / np.linalg.norm(PHI[:2])
    assert 0.02 < wrong < 0.07
    assert np.abs((right.phi_as - PHI)[:2]).max() / np.linalg.norm(PHI[:2]) < 0.003


def test_on_the_ellipsoid_the_gravitation_latitude_counts() -> None:
    step_s, drift = 60.0, np.array([0.4, -0.7, 0.6]) * 1.3e-5
    count = round(2.5 * SIDEREAL_DAY_S / step_s)
    start = np.array([7.0, -7.0, 6.5])
    phi = start + np.outer(step_s * np.arange(1, count + 1), drift)
    navigator = EllipsoidNavigator(step_s, start, 0.5)
    north, longitude = navigator.advance(phi)
    time_s, empty = step_s * np.arange(1, count + 1), np.zeros(count)
    own = log_from_positions(
        time_s,
        LATITUDE + north / 3600.0,
        longitude / 3600.0,
        empty,
        empty,
        Site(LATITUDE, 0.0, float(np.degrees(0.3)), damping=0.5),
    )
    geodetic = PlatformLog(
        time_s, own.sidereal_rad, north, longitude * LEVEL, empty, empty, LATITUDE, 1.0 / SCHULER_RAD_S
    )
    a_day = np.linalg.norm(start) / SIDEREAL_DAY_S
    error = []
    for log in (own, geodetic):
        found = extract(log, window_s=SIDEREAL_DAY_S)
        assert found is not None
        error.append(np.linalg.norm(found.eps_dph - drift) / a_day)
    assert error[0] < 5e-4
    assert error[1] == pytest.approx(5e-3, rel=0.4)
