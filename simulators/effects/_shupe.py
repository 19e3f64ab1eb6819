"""The fibre coil's answer to a change of temperature: Shupe's effect, how it depends on temperature, gradient."""

from __future__ import annotations

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._effect import DPH, Curve, Effect, Input, Parameter, Shape
from simulators.effects._polynomial import SPAN_K
from simulators.effects._stimulus import REFERENCE_C, Stimulus

_LAGS: tuple[Shape, ...] = tuple({"lag_s": lag} for lag in (0.0, 60.0, 180.0, 400.0, 800.0))
_STIFFENING: tuple[Shape, ...] = tuple(
    {"lag_s": lag, "glass_c": glass, "width_k": width}
    for lag in (0.0, 180.0, 400.0)
    for glass in (-35.0, -25.0, -15.0, -5.0)
    for width in (5.0, 12.0)
)
_PER_WARMING = DPH.per("(K/min)")


def _shupe(s: Stimulus, shape: Shape) -> tuple[Array, ...]:
    """Mohr's integral in two terms: the coil warms as a whole, and unequally to what holds the fibre's ends."""
    lag_s = shape["lag_s"]
    return s.lagged(s.warming_k_per_min, lag_s), s.lagged(s.gradient_rate_k_per_min, lag_s)


def _cross(s: Stimulus, shape: Shape) -> Array:
    lag_s = shape["lag_s"]
    return s.lagged(s.warm_k, lag_s) / SPAN_K * s.lagged(s.warming_k_per_min, lag_s)


def _cold_stress(s: Stimulus, shape: Shape) -> Array:
    lag_s = shape["lag_s"]
    above = (s.lagged(s.warm_k, lag_s) + REFERENCE_C - shape["glass_c"]) / shape["width_k"]
    return s.lagged(s.warming_k_per_min, lag_s) / (1.0 + np.exp(np.minimum(np.maximum(above, -50.0), 50.0)))


SHUPE_EFFECTS = (
    Effect(
        "shupe",
        (
            Parameter("bias_dph_per_k_per_min", -100.0, 100.0, _PER_WARMING),
            Parameter("gradient_dph_per_k_per_min", -100.0, 100.0, _PER_WARMING),
        ),
        _shupe,
        Input.WARMING | Input.GRADIENT,
        "dT_in/dt and d(T_in - T_out)/dt",
        "Shupe 1980; Mohr 1996",
        "Bias follows the coil's rate of temperature change.",
        _LAGS,
    ),
    Effect(
        "shupe_cross",
        (Parameter("bias_dph_per_50k_k_per_min", -100.0, 100.0, _PER_WARMING.per("50K")),),
        _cross,
        Input.T_IN | Input.WARMING,
        "T_in times dT_in/dt",
        "stepwise regression of laser gyros: terms T dT/dt",
        "The sensitivity to the rate of temperature change grows with temperature.",
        _LAGS,
    ),
    Effect(
        "cold_stress",
        (Parameter("bias_dph_per_k_per_min", -100.0, 100.0, _PER_WARMING),),
        _cold_stress,
        Input.T_IN | Input.WARMING,
        "dT_in/dt below a temperature",
        "potting stiffens below its glass transition",
        "Stress in the winding follows the rate of temperature change, in the cold only.",
        _STIFFENING,
        curve=Curve(Input.WARMING),
    ),
    Effect(
        "gradient",
        (Parameter("bias_dph_per_k", -50.0, 50.0, DPH.per("K")),),
        lambda s, shape: s.lagged(s.gradient_k, shape["lag_s"]),
        Input.GRADIENT,
        "T_in - T_out",
        "usual dynamic temperature model",
        "Bias follows the temperature difference between inside and case.",
        ({"lag_s": 0.0}, {"lag_s": 400.0}),
        curve=Curve(Input.GRADIENT),
    ),
)
