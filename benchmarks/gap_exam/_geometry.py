"""The rate that an input axis senses on a turntable on the turning Earth, by rotation of vectors."""

from __future__ import annotations

import math

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array
from drivers.base.constants import earth_rate_north_dph, earth_rate_up_dph


def sensed_dph(
    stage: Stage,
    latitude_deg: float,
    *,
    lean_rad: tuple[float, float] = (0.0, 0.0),
    azimuth_rad: float = 0.0,
    tilt_rad: tuple[float, float] = (0.0, 0.0),
) -> Array:
    """Return the rate along the input axis, deg/h, (m,): axes north, west, up; angles counter-clockwise.

    `lean_rad`: the axis leans in its case. In an upright case the first angle points along the table's zero, in a
    level one upwards; the second is to the left of the table's zero. `azimuth_rad` turns the case on the table.
    `tilt_rad` turns the whole table about north and about east.
    """
    elevation = np.radians(stage.elevation_deg)
    up, level = np.sin(elevation), np.cos(elevation)
    axis = np.stack(
        (level + lean_rad[0] * np.abs(up), np.full(stage.steps, lean_rad[1]), up + lean_rad[0] * level)
    )
    axis /= np.linalg.norm(axis, axis=0)
    middle = np.radians(0.5 * (stage.angle_deg[1:] + stage.angle_deg[:-1])) + azimuth_rad
    cosine, sine = np.cos(middle), np.sin(middle)
    # a level component turns on while a step lasts
    blur = np.sinc(np.diff(stage.angle_deg) / 360.0)
    turned = np.stack(
        (blur * (cosine * axis[0] - sine * axis[1]), blur * (sine * axis[0] + cosine * axis[1]), axis[2])
    )
    earth = np.array([earth_rate_north_dph(latitude_deg), 0.0, earth_rate_up_dph(latitude_deg)])
    tilt = Rotation.from_rotvec([tilt_rad[0], -tilt_rad[1], 0.0])
    return np.asarray(tilt.inv().apply(earth) @ turned + 3600.0 * stage.rate_dps * axis[2])


def lean_of(angle_rad: float, towards_rad: float) -> tuple[float, float]:
    """Return the two angles of a lean of some size towards some direction."""
    return angle_rad * math.cos(towards_rad), angle_rad * math.sin(towards_rad)
