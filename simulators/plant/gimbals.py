"""The axes of a table together: the attitude of what its inner axis carries, and the angle it turns through.

    C = R_1(angle_1) ... R_n(angle_n) C_mount,    R_k a turn about the direction of axis k with all axes at 0

in east, north, up of the table's base, axis 1 the outermost.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import DIRECTIONS, EARTH_RATE_DPH
from simulators.plant.table import TableAxis

NORTH_WEST_UP = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Columns: the directions that a mounting is told in (`simulators.plant.mounting`), in east, north, up."""


def earth_rate_rad_s(latitude_deg: float) -> Array:
    """Return Earth rate in east, north, up, rad/s, float64 (3,)."""
    latitude = math.radians(latitude_deg)
    earth = math.radians(EARTH_RATE_DPH / 3600.0)
    return earth * np.array([0.0, math.cos(latitude), math.sin(latitude)])


def turned_about(axis: Array, angle: Array) -> Array:
    """Return turns about a unit vector by angles (n,) in rad, (n, 3, 3)."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    a = angle[:, None, None]
    return np.asarray(np.eye(3) + np.sin(a) * skew + (1.0 - np.cos(a)) * (skew @ skew))


def about_up(angle_deg: float) -> Array:
    """Return the turn by an angle about up, float64 (3, 3)."""
    return np.asarray(turned_about(np.array([0.0, 0.0, 1.0]), np.array([math.radians(angle_deg)]))[0])


def rotations(vectors: Array) -> Array:
    """Return the turns exp([v x]) of rotation vectors (n, 3), float64 (n, 3, 3) (Rodrigues)."""
    x, y, z = vectors.T
    size = np.sqrt(x * x + y * y + z * z)
    small = size < 1e-12
    safe = np.where(small, 1.0, size)
    first = np.where(small, 1.0, np.sin(safe) / safe)
    second = np.where(small, 0.5, 2.0 * (np.sin(0.5 * safe) / safe) ** 2)
    zero = np.zeros_like(x)
    cross = np.moveaxis(np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]), -1, 0)
    return np.asarray(np.eye(3) + first[:, None, None] * cross + second[:, None, None] * (cross @ cross))


def turned_rad(attitude: Array, earth_rad_per_s: Array, period_s: float) -> Array:
    """Return the rotation vector of b in inertial space over each interval, rad, float64 (3, n).

    `attitude`: C_n^b at n + 1 edges; `earth_rad_per_s`: the inertial rate of n in its own axes, (3,).
    """
    change = attitude[1:] @ rotations(-earth_rad_per_s[None, :] * period_s) @ attitude[:-1].transpose(0, 2, 1)
    twice = np.stack(
        [
            change[:, 1, 2] - change[:, 2, 1],
            change[:, 2, 0] - change[:, 0, 2],
            change[:, 0, 1] - change[:, 1, 0],
        ]
    )
    sine = np.minimum(0.5 * np.sqrt((twice**2).sum(axis=0)), 1.0)
    stretch = np.arcsin(sine) / np.where(sine > 0.0, sine, 1.0)
    return np.asarray(0.5 * twice * np.where(sine > 0.0, stretch, 1.0))


def simpson(values: Array) -> Array:
    """Return means over samples, (n, ...), of values at ends and middles, (2 n + 1, ...)."""
    return np.asarray((values[:-2:2] + 4.0 * values[1::2] + values[2::2]) / 6.0)


class Gimbals:
    """Axes of a table, (direction, axis) each, outermost first; the last one carries the unit."""

    def __init__(self, axes: Sequence[tuple[str, TableAxis]]) -> None:
        self._directions = [np.array(DIRECTIONS[direction], dtype=float) for direction, _ in axes]
        self._carrier_up = axes[-1][0] == "up"
        self._axes = [axis for _, axis in axes]

    def angles_rad(self, times_s: Array) -> list[Array]:
        """Return the angles of every axis at times (n,), turns counted: (n,) each, or (1,) if all stand still."""
        angles = [np.radians(axis.total_angles_deg(times_s)) for axis in self._axes]
        if all(len(angle) == 2 for angle in angles):  # two equal angles each
            return [angle[:1] for angle in angles]
        return [np.repeat(angle[:1], len(times_s)) if len(angle) == 2 else angle for angle in angles]

    def upright(self, times_s: Array) -> bool:
        """Return whether the axis that carries the unit points up at all these times, the others at 0 deg."""
        outer = self._axes[:-1]
        return self._carrier_up and not any(axis.total_angles_deg(times_s).any() for axis in outer)

    def attitude(self, angles_rad: Sequence[Array], mount: Array) -> Array:
        """Return directions of the unit in east, north, up, (n, 3, m), at the axes' angles (n,).

        `mount` (3, m): the same directions as columns, with all axes at 0.
        """
        c = np.broadcast_to(np.eye(3), (len(angles_rad[0]), 3, 3))
        for direction, angle in zip(self._directions, angles_rad, strict=True):
            c = c @ turned_about(direction, angle)
        return np.asarray(c @ mount)

    def lines(self, angles_rad: Sequence[Array], mount: Array) -> list[Array]:
        """Return the direction of every axis along those of the unit, (n, m): turned back by the axes inside of
        it.
        """
        inner = np.broadcast_to(mount, (len(angles_rad[0]), *mount.shape))
        found = []
        for direction, angle in zip(reversed(self._directions), reversed(angles_rad), strict=True):
            found.append(np.einsum("nij,i->nj", inner, direction))
            inner = turned_about(direction, angle) @ inner
        return found[::-1]

    def turned_rad(self, times_s: Array, mount: Array, latitude_deg: float) -> Array:
        """Return the angle that each direction of the unit turns through in inertial space, rad, (n, m).

        `times_s`: ends and middles of n samples of one length, (2 n + 1,). Exact for one axis at a time, whose
        line in the unit stands; of several that turn together each one's line in the middle counts.
        """
        samples = len(times_s) // 2
        period_s = (times_s[-1] - times_s[0]) / samples
        angles = self.angles_rad(times_s)
        earth = np.einsum("nij,i->nj", self.attitude(angles, mount), earth_rate_rad_s(latitude_deg))
        if len(earth) == 1:
            return np.repeat(earth * period_s, samples, axis=0)
        turned: Array = simpson(earth) * period_s
        for line, angle in zip(self.lines(angles, mount), angles, strict=True):
            turned += line[1::2] * np.diff(angle[::2])[:, None]
        return turned
