"""Static temperature model of the bias: a polynomial in T_in."""

from __future__ import annotations

from drivers.base.arrays import Array
from simulators.effects._effect import DPH, Curve, Effect, Formula, Input, Parameter, Shape, Unit
from simulators.effects._stimulus import Stimulus

SPAN_K = 50.0
"""Temperatures count in this many kelvins, so that the coefficients of all powers are of one size."""
_LAGS: tuple[Shape, ...] = tuple({"lag_s": lag} for lag in (0.0, 150.0, 400.0))


def power(order: int) -> Formula:
    """Return the formula (T_in above 25 degC, late by `lag_s`, over 50 K) ** order."""

    def formula(s: Stimulus, shape: Shape) -> Array:
        relative = s.lagged(s.warm_k, shape.get("lag_s", 0.0)) / SPAN_K
        result = relative
        for _ in range(order - 1):
            result = result * relative
        return result

    return formula


def _bias(name: str, unit: Unit) -> tuple[Parameter, ...]:
    return (Parameter(name, -500.0, 500.0, unit),)


_CURVE = Curve(Input.T_IN)
POLYNOMIAL_EFFECTS = (
    Effect(
        "bias_linear",
        _bias("bias_dph_per_50k", DPH.per("50K")),
        power(1),
        Input.T_IN,
        "T_in",
        "IEEE Std 952, bias temperature sensitivity",
        "Bias is proportional to temperature.",
        curve=_CURVE,
    ),
    Effect(
        "bias_quadratic",
        _bias("bias_dph_per_50k2", DPH.per("(50K)^2")),
        power(2),
        Input.T_IN,
        "T_in",
        "usual static temperature model",
        "Bias bends with temperature.",
        _LAGS,
        curve=_CURVE,
    ),
    Effect(
        "bias_cubic",
        _bias("bias_dph_per_50k3", DPH.per("(50K)^3")),
        power(3),
        Input.T_IN,
        "T_in",
        "usual static temperature model",
        "Bias follows the cube of temperature: it bends one way in the cold, the other in the warm.",
        _LAGS,
        curve=_CURVE,
    ),
)
