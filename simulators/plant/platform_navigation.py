"""The navigation of a space-stable platform INS: inertial axes, gravity computed, altitude aided.

What is integrated is the deviation of the computed position from the true one, so that rounding and step
errors scale with the error and not with the Earth's radius: d'' = (R(phi) - 1) f + G(r + d) - G(r) - 2 zeta w
(d' - Earth x d), by Runge-Kutta of fourth order.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import (
    ARCSEC_RAD,
    EARTH_AXIS_M,
    EARTH_ECCENTRICITY_SQUARED,
    EARTH_MU_M3PS2,
    EARTH_RATE_RAD_S,
    SCHULER_RAD_S,
)

Gravity = Literal["spherical", "ellipsoid"]

_J2 = 1.08262982131e-3
_LONGEST_STEP_S = 60.0


class PlatformNavigator:
    """A platform INS that stands still on the Earth, advanced in steps of `step_s`.

    `latitude_deg` is geocentric for "spherical" and geodetic for "ellipsoid" gravity (J2). `damping` is the
    ratio zeta with the reference velocity zero; `started_turned` starts on R(phi) r, which excites no Schuler
    motion, instead of on the true position.
    """

    def __init__(
        self,
        latitude_deg: float,
        angle_rad: float,
        step_s: float,
        *,
        damping: float = 0.0,
        gravity: Gravity = "spherical",
        start_phi_as: Array | None = None,
        started_turned: bool = False,
    ) -> None:
        self._parts = math.ceil(step_s / _LONGEST_STEP_S)
        self._step_s = step_s / self._parts
        self._damping, self._ellipsoid = damping, gravity == "ellipsoid"
        geodetic = math.radians(latitude_deg)
        shrink = 1.0 - EARTH_ECCENTRICITY_SQUARED if self._ellipsoid else 1.0
        self._geocentric = math.atan2(shrink * math.sin(geodetic), math.cos(geodetic))
        self._latitude = geodetic
        self._angle = angle_rad
        self._radius = _radius(self._geocentric) if self._ellipsoid else EARTH_AXIS_M
        self._phi = np.zeros(3) if start_phi_as is None else np.asarray(start_phi_as, dtype=np.float64)
        self._state = np.zeros(6)
        if started_turned:
            position = self._true(angle_rad)
            velocity = EARTH_RATE_RAD_S * np.array([-position[1], position[0], 0.0])
            turn = rotation(self._phi * ARCSEC_RAD) - np.eye(3)
            self._state = np.concatenate([turn @ position, turn @ velocity])

    def advance(self, phi_as: Array) -> tuple[Array, Array]:
        """Go on to misalignments (n, 3), one a step; return (latitude, longitude) errors, arcsec, (n,)."""
        north, east = np.empty(len(phi_as)), np.empty(len(phi_as))
        for at, phi in enumerate(phi_as):
            before = self._phi
            for part in range(1, self._parts + 1):
                self._step(before + (phi - before) * (part / self._parts))
            north[at], east[at] = self._errors()
        return north, east

    def _step(self, phi: Array) -> None:
        step, state = self._step_s, self._state
        turns = [
            rotation(each * ARCSEC_RAD) - np.eye(3) for each in (self._phi, 0.5 * (self._phi + phi), phi)
        ]
        k1 = self._rate(state, self._angle, turns[0])
        half = self._angle + 0.5 * step * EARTH_RATE_RAD_S
        k2 = self._rate(state + 0.5 * step * k1, half, turns[1])
        k3 = self._rate(state + 0.5 * step * k2, half, turns[1])
        self._angle += step * EARTH_RATE_RAD_S
        k4 = self._rate(state + step * k3, self._angle, turns[2])
        self._state = state + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        self._phi = phi

    def _rate(self, state: Array, angle: float, turn: Array) -> Array:
        place = self._true(angle)
        deviation, velocity = state[:3], state[3:]
        own = self._gravity(place)
        force = np.array([-(EARTH_RATE_RAD_S**2) * place[0], -(EARTH_RATE_RAD_S**2) * place[1], 0.0]) - own
        pull = -(SCHULER_RAD_S**2) * deviation  # the ball's, without the rounding of a difference
        if self._ellipsoid:
            pull = self._gravity(place + deviation) - own
        damp = 2.0 * self._damping * SCHULER_RAD_S
        against = velocity - EARTH_RATE_RAD_S * np.array([-deviation[1], deviation[0], 0.0])
        return np.concatenate([velocity, turn @ force + pull - damp * against])

    def _gravity(self, place: Array) -> Array:
        """Gravitation with the altitude given from outside: the spring holds the computed radius to it."""
        if not self._ellipsoid:
            return -(SCHULER_RAD_S**2) * place
        distance = math.sqrt(float(place @ place))
        radius = _radius(math.asin(place[2] / distance))
        aided = place * (radius / distance)
        sine2 = (place[2] / distance) ** 2
        factor = 1.5 * _J2 * (EARTH_AXIS_M / radius) ** 2
        shape = np.array([1.0 + factor * (1.0 - 5.0 * sine2)] * 2 + [1.0 + factor * (3.0 - 5.0 * sine2)])
        field: Array = -EARTH_MU_M3PS2 / radius**3 * aided * shape - SCHULER_RAD_S**2 * (place - aided)
        return field

    def _true(self, angle: float) -> Array:
        level = self._radius * math.cos(self._geocentric)
        up = self._radius * math.sin(self._geocentric)
        return np.array([level * math.cos(angle), level * math.sin(angle), up])

    def _errors(self) -> tuple[float, float]:
        # In local axes of the true place, where small differences keep their digits.
        sine, cosine = math.sin(self._angle), math.cos(self._angle)
        x, y, z = self._state[:3].tolist()
        outward, side = x * cosine + y * sine, -x * sine + y * cosine
        level = self._radius * math.cos(self._geocentric)
        longitude = math.atan2(side, level + outward)
        up = self._radius * math.sin(self._geocentric)
        computed_level = math.hypot(level + outward, side)
        # tan(a - b) of the geocentric latitudes; level' - level by its own small terms.
        gained = (2.0 * level * outward + outward**2 + side**2) / (computed_level + level)
        change = math.atan2(z * level - up * gained, computed_level * level + (up + z) * up)
        if self._ellipsoid:
            shrink = 1.0 - EARTH_ECCENTRICITY_SQUARED
            geodetic = math.atan2(math.tan(self._geocentric + change), shrink)
            change = geodetic - self._latitude
        return change / ARCSEC_RAD, longitude / ARCSEC_RAD


def rotation(turn_rad: Array) -> Array:
    """Return the matrix R(turn) of a rotation vector (3,): Rodrigues' formula."""
    x, y, z = turn_rad.tolist()
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = math.sqrt(x * x + y * y + z * z)
    if angle < 1e-12:
        small: Array = np.eye(3) + cross
        return small
    half = math.sin(0.5 * angle) / (0.5 * angle)
    matrix: Array = np.eye(3) + math.sin(angle) / angle * cross + 0.5 * half**2 * (cross @ cross)
    return matrix


def _radius(geocentric_rad: float) -> float:
    """Geocentric radius of the WGS 84 ellipsoid."""
    ratio = EARTH_ECCENTRICITY_SQUARED / (1.0 - EARTH_ECCENTRICITY_SQUARED)
    return EARTH_AXIS_M / math.sqrt(1.0 + ratio * math.sin(geocentric_rad) ** 2)
