"""Gravity and vibration on the bias."""

from __future__ import annotations

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._effect import DPH, Effect, Input, Parameter, Shape
from simulators.effects._stimulus import Stimulus

_AT_DPS = 100.0


def _acceleration(s: Stimulus, _: Shape) -> Array:
    elevation = np.radians(s.elevation_deg)
    return np.stack((np.sin(elevation), np.cos(elevation)))


ACCELERATION_EFFECTS = (
    Effect(
        "acceleration_sensitivity",
        tuple(Parameter(f"bias_dph_per_g_{way}", -100.0, 100.0, DPH.per("g")) for way in ("axial", "cross")),
        _acceleration,
        Input.ATTITUDE,
        "attitude against gravity",
        "IEEE Std 952, acceleration sensitivity",
        "Bias depends on the direction of gravity.",
    ),
    Effect(
        "acceleration_squared",
        (Parameter("bias_dph_per_g2", -100.0, 100.0, DPH.per("g^2")),),
        lambda s, _: np.asarray(np.sin(np.radians(s.elevation_deg)) ** 2),
        Input.ATTITUDE,
        "attitude against gravity, squared",
        "IEEE Std 952, acceleration-squared sensitivity",
        "Bias depends on the square of gravity along the axis.",
    ),
    Effect(
        "vibration_rectification",
        (Parameter("bias_dph_at_100dps", -1000.0, 1000.0, DPH),),
        lambda s, _: np.asarray((s.table_rate_dps / _AT_DPS) ** 2),
        Input.TABLE_RATE,
        "square of the table's rate",
        "IEEE Std 952, vibration rectification; bearing vibration grows with speed, its power with the square",
        "Bias shifts while the table turns, by the power of its vibration.",
    ),
)
