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
    """

    mounting: Mounting
    azimuth_error_deg: float = 0.0
    tilt_deg: float = 0.0
    axis: str = "x"

    def axes_in_table(self) -> Array:
        """Return the axes x, y, z as rows in the table frame, float64 (3, 3)."""
        sin, cos = math.sin(math.radians(self.tilt_deg)), math.cos(math.radians(self.tilt_deg))
        if self.mounting == "axis_up":
            rows = [[sin, 0.0, cos], [cos, 0.0, -sin], [0.0, 1.0, 0.0]]
        else:
            rows = [[cos, 0.0, sin], [0.0, 1.0, 0.0], [-sin, 0.0, cos]]
        under_test = _AXES.index(self.axis)
        return np.roll(np.array(rows), 0 if self.mounting == "z_up" else under_test, axis=0)


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
