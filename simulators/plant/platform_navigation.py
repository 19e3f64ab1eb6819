"""The navigation of a space-stable platform INS: inertial axes, gravity computed, altitude aided.

What is integrated is the deviation of the computed position from the true one, so that rounding and step
errors scale with the error and not with the Earth's radius: d'' = (R(phi) - 1) f + G(r + d) - G(r) - 2 zeta w
(d' - Earth x d), by Runge-Kutta of fourth order.
"""

from __future__ import annotations

import math

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_RAD, EARTH_AXIS_M, EARTH_RATE_RAD_S, SCHULER_RAD_S

_LONGEST_STEP_S = 60.0


class PlatformNavigator:
    """A platform INS that stands still on a ball of the Earth's radius, advanced in steps of `step_s`.

    `latitude_deg` is geocentric. `damping` is the ratio zeta with the reference velocity zero. It starts without
    misalignment at the true position.
    """

    def __init__(self, latitude_deg: float, angle_rad: float, step_s: float, *, damping: float = 0.0) -> None:
        self._parts = math.ceil(step_s / _LONGEST_STEP_S)
        self._step_s = step_s / self._parts
        self._damping = damping
        latitude = math.radians(latitude_deg)
        geocentric = math.atan2(math.sin(latitude), math.cos(latitude))  # -90 to 90 deg
        self._level, self._up = EARTH_AXIS_M * math.cos(geocentric), EARTH_AXIS_M * math.sin(geocentric)
        self._angle = angle_rad
        self._phi = np.zeros(3)
        self._state = np.zeros(6)

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
            rotation(tilt * ARCSEC_RAD) - np.eye(3) for tilt in (self._phi, 0.5 * (self._phi + phi), phi)
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
        place = np.array([self._level * math.cos(angle), self._level * math.sin(angle), self._up])
        deviation, velocity = state[:3], state[3:]
        turning = np.array([-(EARTH_RATE_RAD_S**2) * place[0], -(EARTH_RATE_RAD_S**2) * place[1], 0.0])
        # Altitude is given from outside: the spring holds the computed radius to the true one.
        force = turning + SCHULER_RAD_S**2 * place
        damp = 2.0 * self._damping * SCHULER_RAD_S
        against = velocity - EARTH_RATE_RAD_S * np.array([-deviation[1], deviation[0], 0.0])
        return np.concatenate([velocity, turn @ force - SCHULER_RAD_S**2 * deviation - damp * against])

    def _errors(self) -> tuple[float, float]:
        # In local axes of the true place, where small differences keep their digits.
        sine, cosine = math.sin(self._angle), math.cos(self._angle)
        x, y, z = self._state[:3].tolist()
        outward, side = x * cosine + y * sine, -x * sine + y * cosine
        level, up = self._level, self._up
        longitude = math.atan2(side, level + outward)
        computed_level = math.hypot(level + outward, side)
        # tan(a - b) of the geocentric latitudes; level' - level by its own small terms.
        gained = (2.0 * level * outward + outward**2 + side**2) / (computed_level + level)
        change = math.atan2(z * level - up * gained, computed_level * level + (up + z) * up)
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
