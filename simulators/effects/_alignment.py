"""Misaligned axes: what Earth rate and the table's own rate add when an axis is not where it should be."""

from __future__ import annotations

import math

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import earth_rate_north_dph, earth_rate_up_dph
from simulators.effects._effect import Effect, Input, Parameter, Shape, Unit
from simulators.effects._stimulus import Stimulus

_DEG = Unit("deg")


def _angle(name: str) -> Parameter:
    return Parameter(name, -10.0, 10.0, _DEG)


def _azimuth(s: Stimulus, _: Shape) -> Array:
    level = earth_rate_north_dph(s.latitude_deg) * np.cos(np.radians(s.elevation_deg))
    return np.asarray(-math.radians(1.0) * level * s.harmonic(1)[1])


def _tilt(s: Stimulus, _: Shape) -> Array:
    """Earth rate on an axis that leans with the whole table: (turn x axis) . Earth rate for a turn of 1 deg.

    Turned about north, an axis to the side of it rises; turned about east, one to the north rises and one that
    points up leans to the south. The table's own rate stays along its axis.
    """
    elevation = np.radians(s.elevation_deg)
    vertical = earth_rate_up_dph(s.latitude_deg)
    cosine, sine = s.harmonic(1) * np.cos(elevation)
    leaned = -earth_rate_north_dph(s.latitude_deg) * np.sin(elevation)
    return np.asarray(math.radians(1.0) * np.stack((vertical * sine, vertical * cosine + leaned)))


def _misalignment(s: Stimulus, _: Shape) -> Array:
    """Sensitive axis leaning in its frame: an upright one picks up level Earth rate, a level one the table's."""
    upright, level = np.sin(np.radians(s.elevation_deg)), np.cos(np.radians(s.elevation_deg))
    cosine, sine = s.harmonic(1) * earth_rate_north_dph(s.latitude_deg) * np.abs(upright)
    vertical = earth_rate_up_dph(s.latitude_deg) + 3600.0 * s.table_rate_dps
    return np.asarray(math.radians(1.0) * np.stack((cosine + level * vertical, sine)))


ALIGNMENT_EFFECTS = (
    Effect(
        "azimuth_error",
        (_angle("azimuth_deg"),),
        _azimuth,
        Input.ANGLE | Input.ATTITUDE,
        "table angle with the axis level",
        "Earth-rate projection",
        "The axis does not point where the table's angle says: Earth rate enters differently.",
    ),
    Effect(
        "table_tilt",
        (_angle("about_north_deg"), _angle("about_east_deg")),
        _tilt,
        Input.ANGLE | Input.ATTITUDE,
        "table angle with the axis level, and the axis level against upright",
        "Earth-rate projection; IEEE Std 952, test-table alignment",
        "The table's axis is not plumb: the unit leans with it and sees Earth rate otherwise in every direction.",
    ),
    Effect(
        "axis_misalignment",
        (_angle("lean_deg_cos"), _angle("lean_deg_sin")),
        _misalignment,
        Input.ANGLE | Input.ATTITUDE | Input.TABLE_RATE,
        "table angle with the axis upright",
        "IEEE Std 952, input-axis misalignment",
        "The sensitive axis leans against its mounting and picks up other components of rate.",
    ),
)
