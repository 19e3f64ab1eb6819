"""Parts that effects of the nuclear resonance gyros share: Earth's field, slow signals, angles."""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._nuclear_bench import LATITUDE_DEG, gyro
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

DECLINATION_RAD = math.radians(8.0)
DIP_RAD = math.radians(52.0)
_COARSE_S = 5.0


def coarse(stage: Stage, values: Array) -> tuple[Array, Array]:
    """Return times, s, and values of a slow signal some seconds apart, (k,) each."""
    stride = round(_COARSE_S / stage.step_s)
    return stage.time_s[::stride], values[::stride]


def turn_rad(stage: Stage) -> Array:
    """Return the table's angle in the middle of the fine steps, (m,)."""
    return np.asarray(np.radians(0.5 * (stage.angle_deg[1:] + stage.angle_deg[:-1])))


def true_dph(stage: Stage) -> Array:
    """Return the rate that the axis senses, (m,)."""
    return sensed_dph(stage, LATITUDE_DEG)


def former_ahead_k(stage: Stage) -> Array:
    """Return how much the former is warmer than in a long soak at the inner thermistor's reading, (m,)."""
    at_zero_c, slope = _soaked_former()
    return np.asarray(stage.body("former") - at_zero_c - slope * stage.t_in_c)


@cache
def _soaked_former() -> tuple[float, float]:
    """Return the former's temperature in a soak at a reading of 0 degC, and its change with the reading."""
    soaks = [gyro(np.full(1, air), None, 1.0) for air in (-10.0, 40.0)]
    cold, warm = (0.6 * float(soak["frame"][0]) + 0.4 * float(soak["shield_a"][0]) for soak in soaks)
    formers = [float(soak["former"][0]) for soak in soaks]
    slope = (formers[1] - formers[0]) / (warm - cold)
    return formers[0] - slope * cold, slope
