"""Effects on the curve of output against input: what the gyro does at its limit and about zero."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._effect import Effect, Parameter
from simulators.effects._stimulus import Stimulus

Shape = Mapping[str, float]
_SHARE = 1.2
"""Bound of the part of the formula that is there; 1 is all of it."""


def _saturation(s: Stimulus, shape: Shape) -> Array:
    limit_dph = 3600.0 * shape["limit_dps"]
    return np.asarray(np.clip(s.input_rate_dph, -limit_dph, limit_dph) - s.input_rate_dph)[None, :]


def _dead_zone(s: Stimulus, shape: Shape) -> Array:
    rate = s.input_rate_dph
    return np.where(np.abs(rate) < shape["band_dph"], -rate, 0.0)[None, :]


def _lock_in(s: Stimulus, shape: Shape) -> Array:
    rate = s.input_rate_dph
    beat = np.sqrt(np.maximum(rate**2 - shape["lock_dph"] ** 2, 0.0))
    return np.asarray(np.sign(rate) * beat - rate)[None, :]


RESPONSE_EFFECTS = (
    Effect(
        "saturation",
        (Parameter("cut_share", 0.0, _SHARE),),
        _saturation,
        "rate beyond a limit",
        "IEEE Std 952, maximum input rate",
        "Output stays at a limit however fast the unit turns.",
        ({"limit_dps": 100.0},),
        proposed=True,
    ),
    Effect(
        "dead_zone",
        (Parameter("lost_share", 0.0, _SHARE),),
        _dead_zone,
        "rate about zero",
        "IEEE Std 528, dead band",
        "Small rates give no output.",
        ({"band_dph": 10.0},),
        proposed=True,
    ),
    Effect(
        "lock_in",
        (Parameter("locked_share", 0.0, _SHARE),),
        _lock_in,
        "rate about zero",
        "Aronowitz, The Laser Gyro, 1971: the beat of two coupled beams is the root of rate^2 - lock-in^2",
        "Small rates give no output and those a little larger too little: the beams lock.",
        ({"lock_dph": 10.0},),
        proposed=True,
    ),
)
