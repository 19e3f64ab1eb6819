"""Bearing wobble of a table or of an INS's own mechanism, as motion of a rigid body: rotation matrices, no
formula.

A bearing with errors tips what it carries by a small angle that depends on the table angle psi (synchronous
error, its harmonics), on a ball cage's slower turn (non-synchronous), and on the sense of rotation (play).
The tilt is kept in the axes of the bearing's body b as lines: tilt = sum a_m exp(j m psi), real part about
x_b, imaginary part about y_b; m need not be whole. The carried frame s' is then C_b^s' = C_b^s(psi)
exp(-[tilt x]).

The unit that turns in the wobbling bearing is `WhirlingUnit`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_RAD, earth_rate_north_dph, earth_rate_up_dph
from drivers.base.errors import ConfigurationError
from drivers.kit.config import Mounting
from simulators.plant.gimbals import NORTH_WEST_UP, about_up, rotations, turned_rad
from simulators.plant.ground import MovingGround
from simulators.plant.model import UnitModel
from simulators.plant.mounting import Mount
from simulators.plant.noise import NoiseSource
from simulators.plant.table import TableAxis
from simulators.plant.unit import GyroUnit


@dataclass(frozen=True)
class Wobble:
    """A bearing's wobble. `lines_arcsec`: line m (turns of the tilt a turn of the table) -> a_m.

    `play_arcsec` is the tilt that is added once the table has turned back by `play_travel_deg` after turning
    in the positive sense, in proportion before that. `misalignment_arcsec` are the small angles of the
    sensors' x and y axes towards z, which let them see the table's own rate.
    """

    lines_arcsec: Mapping[float, complex] = field(default_factory=dict)
    play_arcsec: complex = 0.0
    play_travel_deg: float = 0.5
    misalignment_arcsec: tuple[float, float] = (0.0, 0.0)

    def tilt_rad(self, angle_rad: Array, slack: Array) -> NDArray[np.complex128]:
        """Return the tilt in body axes, complex (n,), at table angles and `slack` in 0 .. 1 (see `play`)."""
        tilt = self.play_arcsec * slack.astype(np.complex128)
        for line, amplitude in self.lines_arcsec.items():
            tilt += amplitude * np.exp(1j * line * angle_rad)
        return np.asarray(tilt * ARCSEC_RAD)


PATENT_CLASS = {-1.0: 5.0 - 3.0j, 2.0: -9.0 + 8.0j, 3.0: 4.0 + 4.4j}
"""Lines that a second-order Fourier series in rotating axes can hold, 10.4 arcsec rms an axis."""
CONSTANT_TILT = {1.0: 3.0 + 2.0j}
BACKWARD_LINE = {-2.0: 0.9 - 0.6j}
CAGE_LINE = {0.4287: 1.2 + 0.9j}


def nominal_wobble(unit_seed: int) -> Wobble:
    """Return the bearing of a unit; seed 0 is the nominal one, others turn its phases and vary its amplitudes."""
    lines = {**PATENT_CLASS, **CONSTANT_TILT, **BACKWARD_LINE}
    if unit_seed == 0:
        return Wobble(lines)
    rng = np.random.default_rng((unit_seed, 71))
    return Wobble(
        {
            line: complex(value * rng.uniform(0.8, 1.2) * np.exp(2j * math.pi * rng.random()))
            for line, value in lines.items()
        }
    )


def play(angle_rad: Array, travel_rad: float, start: float) -> Array:
    """Return how far the slack is taken up, 0 .. 1, float64 (n,), at successive angles, `start` at the first.

    0 while turning in the positive sense, 1 after turning back by `travel_rad` (the play operator of
    hysteresis). Between turning points the answer is the clipped distance, so that only turning points are
    stepped through.
    """
    slack = np.empty(len(angle_rad))
    step = np.diff(angle_rad)
    turning = np.flatnonzero(np.diff(np.sign(step))) + 1
    value = start
    for first, last in zip(
        np.concatenate(([0], turning)), np.append(turning, len(angle_rad) - 1), strict=True
    ):
        part = value - (angle_rad[first : last + 1] - angle_rad[first]) / travel_rad
        slack[first : last + 1] = np.clip(part, 0.0, 1.0)
        value = float(slack[last])
    return slack


def body_to_carried(angle_rad: Array, tilt_rad: NDArray[np.complex128]) -> Array:
    """Return C_b^s' as float64 (n, 3, 3): the turn about z after the tilt, both exact rotations."""
    tilt = np.stack([tilt_rad.real, tilt_rad.imag, np.zeros(len(tilt_rad))], axis=1)
    return np.asarray(_about_z(angle_rad) @ rotations(-tilt))


class WhirlingUnit(GyroUnit):
    """A three-axis unit on the table axis, z up, in a bearing that wobbles (see
    `simulators.interfaces.GyroPlant`).

    Body axes b are those of the table at angle zero: x at the mount's azimuth error from north on the table's
    scale, y 90 deg counter-clockwise, z up, then tilted by the mount.
    """

    def __init__(
        self,
        model: UnitModel,
        mount: Mount,
        table: TableAxis,
        latitude_deg: float,
        source: NoiseSource,
        wobble: Wobble,
        *,
        ground: MovingGround | None = None,
    ) -> None:
        super().__init__(model, mount, table, latitude_deg, source, ground=ground)
        self._wobble = wobble
        self._earth = _earth_in_body(mount, latitude_deg)
        self._slack = 0.0

    def mount(self, now_s: float, mounting: Mounting, roll_deg: float = 0.0) -> None:
        """Refuse, as an INS on its mechanism is not turned on a bracket, any mounting but z up."""
        if mounting != "z_up":
            raise ConfigurationError(
                "a unit in a wobbling bearing stays z up", found=mounting, expected="z_up"
            )
        super().mount(now_s, mounting, roll_deg)

    def _turned(self, edges_s: Array, middle_s: Array, period_s: float) -> Array:
        """Return the true angle each axis turned through in each interval, rad, float64 (3, n)."""
        return self._misaligned(turned_rad(self._in_bearing(edges_s), self._earth, period_s))

    def _rocked(self, times_s: Array, period_s: float) -> tuple[Array, Array]:
        turned, velocity = super()._rocked(times_s, period_s)
        return self._misaligned(turned), velocity

    def _attitude(self, times_s: Array) -> Array:
        mount = self._mounts[0][1]
        to_level = about_up(mount.azimuth_error_deg) @ NORTH_WEST_UP @ mount.axes_in_table().T
        return np.asarray(to_level @ self._in_bearing(times_s).transpose(0, 2, 1))

    def _sensed(self, matrix: Array) -> Array:
        return np.eye(3)

    def _in_bearing(self, times_s: Array) -> Array:
        """Return C_b^s' at times that do not go back, (n, 3, 3)."""
        angles = np.radians(self._table.total_angles_deg(times_s))
        if len(angles) != len(times_s):  # a table at rest answers with two equal angles
            angles = np.full(len(times_s), angles[0])
        slack = play(angles, math.radians(self._wobble.play_travel_deg), self._slack)
        self._slack = float(slack[-1])
        return body_to_carried(angles, self._wobble.tilt_rad(angles, slack))

    def _misaligned(self, turned: Array) -> Array:
        for axis, angle_arcsec in enumerate(self._wobble.misalignment_arcsec):
            turned[axis] += angle_arcsec * ARCSEC_RAD * turned[2]
        return turned


def _earth_in_body(mount: Mount, latitude_deg: float) -> Array:
    """Return Earth rate in body axes, rad/s, float64 (3,)."""
    azimuth = math.radians(mount.azimuth_error_deg)
    north, up = earth_rate_north_dph(latitude_deg), earth_rate_up_dph(latitude_deg)
    level = np.array([north * math.cos(azimuth), -north * math.sin(azimuth), up])
    return np.asarray(mount.axes_in_table() @ level * ARCSEC_RAD)


def _about_z(angle_rad: Array) -> Array:
    """Return the coordinate change to axes turned by an angle about z, float64 (n, 3, 3)."""
    sin, cos = np.sin(angle_rad), np.cos(angle_rad)
    zero, one = np.zeros_like(sin), np.ones_like(sin)
    return np.moveaxis(np.array([[cos, sin, zero], [-sin, cos, zero], [zero, zero, one]]), -1, 0)
