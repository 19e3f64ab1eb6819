"""What follows the table's angle: a bias by direction, and a table that does not turn as its telemetry says."""

from __future__ import annotations

import math

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._effect import DPH, PPM, Curve, Effect, Formula, Input, Parameter, Unit
from simulators.effects._stimulus import Stimulus


def _pair(name: str, bound: float, unit: Unit) -> tuple[Parameter, ...]:
    return tuple(Parameter(f"{name}_{part}", -bound, bound, unit) for part in ("cos", "sin"))


def _ripple(order: int, s: Stimulus) -> Array:
    """Mean over each sample of rate times cos and sin of the angle: exact differences of sin and -cos."""
    angle = np.radians(order * s.angle_deg)
    swing = np.stack((np.diff(np.sin(angle)), -np.diff(np.cos(angle))))
    per_rate = math.degrees(1.0) / order / s.period_s * 3600.0
    return np.asarray(1e-6 * per_rate * swing * np.sin(np.radians(s.elevation_deg)))


def _wobble(order: int) -> Formula:
    """A ripple with its first odd overtone: bearings and encoders seldom give a pure sine."""
    return lambda s, _: np.concatenate((_ripple(order, s), _ripple(3 * order, s)))


_RIPPLES = (*_pair("ripple_ppm", 1e5, PPM), *_pair("overtone_ppm", 1e5, PPM))
_WOBBLE_INPUTS = Input.ANGLE | Input.TABLE_RATE | Input.ATTITUDE | Input.TURN
TABLE_ANGLE_EFFECTS = (
    Effect(
        "heading_sensitivity",
        _pair("bias_dph", 100.0, DPH),
        lambda s, _: s.harmonic(1),
        Input.ANGLE,
        "table angle",
        "magnetic sensitivity, IEEE Std 952",
        "Bias depends on the direction in which the unit points, as in a magnetic field.",
        curve=Curve(Input.ANGLE),
    ),
    Effect(
        "table_wobble_once",
        _RIPPLES,
        _wobble(1),
        _WOBBLE_INPUTS,
        "once a turn, proportional to rate",
        "table axis wobble and eccentric encoder",
        "The table's rate varies once a turn beside its telemetry.",
        curve=Curve(Input.ANGLE, of_rate=True),
    ),
    Effect(
        "table_wobble_twice",
        _RIPPLES,
        _wobble(2),
        _WOBBLE_INPUTS,
        "twice a turn, proportional to rate",
        "oval encoder disc, bearing",
        "The table's rate varies twice a turn beside its telemetry.",
        curve=Curve(Input.ANGLE, of_rate=True),
    ),
)
