"""A bias that changes by itself: it settles after power-on, or drifts steadily."""

from __future__ import annotations

import numpy as np

from simulators.effects._effect import DPH, Effect, Input, Parameter

WARM_UP = Effect(
    "warm_up",
    (Parameter("bias_dph", -500.0, 500.0, DPH),),
    lambda s, shape: np.asarray(np.exp(-s.time_s / shape["time_constant_s"])),
    Input.TIME,
    "time since power-on",
    "self-heating of the electronics",
    "Bias settles after power-on.",
    tuple({"time_constant_s": tau} for tau in (300.0, 900.0, 1800.0, 3600.0)),
)
BIAS_RAMP = Effect(
    "bias_ramp",
    (Parameter("bias_dph_per_h", -100.0, 100.0, DPH.per("h")),),
    lambda s, _: s.time_s / 3600.0,
    Input.TIME,
    "time in the run",
    "IEEE Std 952, rate ramp",
    "Bias drifts steadily with time.",
)
