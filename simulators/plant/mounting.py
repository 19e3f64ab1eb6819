"""How a unit sits on the table, and the exact angle its axes turn through between two times.

Table frame: first axis horizontal at the scale angle (table angle + mount azimuth error) from north, second
90 deg counter-clockwise from it, third up.

Sign convention of the whole plant. The table axis points up and its angle is counter-clockwise positive seen
from above (right-handed about up), so a unit with its axis up reads +20 deg/s at a table rate of +20 deg/s. A
horizontal sensitive axis points `scale angle = table angle + mount azimuth error` from north on that same scale;
its azimuth in the navigator's sense (clockwise) is minus the scale angle. The Earth-rate projection
w_ie cos(latitude) cos(scale angle) is the same for either sense; 90 and 270 deg are the east-west line.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import get_args

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_RAD, earth_rate_north_dph, earth_rate_up_dph
from drivers.base.errors import ConfigurationError
from drivers.kit.config import Mounting

MOUNTINGS: tuple[Mounting, ...] = get_args(Mounting)
_AXES = "xyz"


@dataclass(frozen=True)
class Mount:
    """A mounting with its errors: azimuth on the table's scale, tilt that raises (or tips) the axis under test.

    `axis` is the one under test; the two others follow it in the order x, y, z, x. With it horizontal, it points
    along the first table axis, the next one along the second, the last one up; with it up, the next one points
    along the first and the last one along the second. "z_up" lays x along the first table axis and z up,
    whichever axis is under test. Tilt raises a level axis above the horizon, and tips an upward one towards the
    first table axis.

    `roll_deg` turns the unit in its fixture, right-handed about the axis under test: azimuth error and tilt are
    the fixture's and stay. `lean_deg` is the unit's own and turns with it: angles by which what it senses as that
    axis lies towards the next one and towards the last one (IEEE Std 952, input-axis misalignment).
    ConfigurationError for a roll with "z_up", whose axis under test is not told.
    """

    mounting: Mounting
    azimuth_error_deg: float = 0.0
    tilt_deg: float = 0.0
    axis: str = "x"
    roll_deg: float = 0.0
    lean_deg: tuple[float, float] = (0.0, 0.0)

    def __post_init__(self) -> None:
        if self.mounting == "z_up" and self.roll_deg:
            raise ConfigurationError(
                "a unit with z up is not turned about its axis under test",
                where="mounting",
                found=f"roll_deg = {self.roll_deg:g}",
                expected="axis_horizontal or axis_up, or no roll_deg",
            )

    def axes_in_table(self) -> Array:
        """Return what is sensed as x, y, z as unit rows in the table frame, float64 (3, 3)."""
        sin, cos = math.sin(math.radians(self.tilt_deg)), math.cos(math.radians(self.tilt_deg))
        if self.mounting == "axis_up":
            rows = [[sin, 0.0, cos], [cos, 0.0, -sin], [0.0, 1.0, 0.0]]
        else:
            rows = [[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]
        # what is not turned and does not lean keeps its bits
        body = np.array(rows)
        if self.roll_deg:
            roll = math.radians(self.roll_deg)
            turn = np.array([[math.cos(roll), math.sin(roll)], [-math.sin(roll), math.cos(roll)]])
            body[1:] = turn @ body[1:]
        if any(self.lean_deg):
            to_next, to_last = (math.sin(math.radians(angle)) for angle in self.lean_deg)
            body[0] = (
                math.sqrt(1.0 - to_next**2 - to_last**2) * body[0] + to_next * body[1] + to_last * body[2]
            )
        return np.roll(body, 0 if self.mounting == "z_up" else _AXES.index(self.axis), axis=0)


def turned_rad(axes_in_table: Array, scale_angles_deg: Array, latitude_deg: float, period_s: float) -> Array:
    """Return the angle in rad each axis turns through between successive edges, float64 (axes, n).

    `scale_angles_deg`: at the ends of n intervals of `period_s`, turns counted, float64 (n + 1,). Within an
    interval the table's rate is taken as constant, which makes the integral of the turning horizontal
    component cos(middle) sin(half turn) / half turn.
    """
    edges = np.radians(scale_angles_deg)
    half_turn = 0.5 * (edges[1:] - edges[:-1])
    up = 2.0 * half_turn + earth_rate_up_dph(latitude_deg) * ARCSEC_RAD * period_s
    turned = up * axes_in_table[:, 2:]
    if axes_in_table[:, :2].any():
        middle = edges[:-1] + half_turn
        # far below any turn that matters, and far above the smallest float: no division by zero
        apart = half_turn + 1e-150
        north = earth_rate_north_dph(latitude_deg) * ARCSEC_RAD * period_s * (np.sin(apart) / apart)
        # products term by term: a matrix product may round differently for another number of samples
        turned += (north * np.cos(middle)) * axes_in_table[:, :1]
        turned -= (north * np.sin(middle)) * axes_in_table[:, 1:2]
    return np.asarray(turned)
