"""A bias that follows temperature or time: static, by the rate of change, with memory, after power-on."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._effect import DPH, Curve, Effect, Formula, Input, Parameter, Shape, Unit
from simulators.effects._stimulus import REFERENCE_C, Stimulus

SPAN_K = 50.0
"""Temperatures count in this many kelvins, so that the coefficients of all powers are of one size."""
_BENT_BY = (-4.0, -2.0, 2.0, 4.0)
"""Growth in 50 K of a bend on one side, as tried."""
LAGS: tuple[Shape, ...] = tuple({"lag_s": lag} for lag in (0.0, 150.0, 400.0))


def power(order: int) -> Formula:
    """Return the formula (T_in above 25 degC, late by `lag_s`, over 50 K) ** order."""

    def formula(s: Stimulus, shape: Shape) -> Array:
        relative = s.lagged(s.warm_k, shape.get("lag_s", 0.0)) / SPAN_K
        result = relative
        for _ in range(order - 1):
            result = result * relative
        return result

    return formula


def _bend(s: Stimulus, shape: Shape) -> Array:
    """Return the square of (T_in above 25 degC, late by `lag_s`, over 50 K), or what grows e^growth in 50 K.

    An exponential, 0 at 25 degC, where it bends as the square does.
    """
    relative, growth = s.lagged(s.warm_k, shape.get("lag_s", 0.0)) / SPAN_K, shape.get("growth", 0.0)
    if not growth:
        return relative * relative
    return 2.0 * np.expm1(growth * relative) / growth**2


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
        _bend,
        Input.T_IN,
        "T_in",
        "usual static temperature model; Arrhenius 1889 (growth)",
        "Bias bends with temperature, or on one side of room temperature only.",
        (
            *({**lag, "growth": 0.0} for lag in LAGS),
            *({"lag_s": 0.0, "growth": each} for each in _BENT_BY),
        ),
        curve=_CURVE,
        whole=("growth",),
    ),
    Effect(
        "bias_cubic",
        _bias("bias_dph_per_50k3", DPH.per("(50K)^3")),
        power(3),
        Input.T_IN,
        "T_in",
        "usual static temperature model",
        "Bias follows the cube of temperature: it bends one way in the cold, the other in the warm.",
        LAGS,
        curve=_CURVE,
    ),
)


_SHUPE_LAGS: tuple[Shape, ...] = tuple({"lag_s": lag} for lag in (0.0, 60.0, 180.0, 400.0, 800.0))
_STIFFENING: tuple[Shape, ...] = tuple(
    {"lag_s": lag, "glass_c": glass, "width_k": width}
    for lag in (0.0, 180.0, 400.0)
    for glass in (-35.0, -25.0, -15.0, -5.0)
    for width in (5.0, 12.0)
)
_PER_WARMING = DPH.per("(K/min)")
_STRAIGHT = 1e-4
"""Growth in 50 K below which a sensitivity is a straight line."""


def _shupe(s: Stimulus, shape: Shape) -> tuple[Array, ...]:
    """Mohr's integral in two terms: the coil warms as a whole, and unequally to what holds the fibre's ends."""
    lag_s = shape["lag_s"]
    return s.lagged(s.warming_k_per_min, lag_s), s.lagged(s.gradient_rate_k_per_min, lag_s)


def _cross(s: Stimulus, shape: Shape) -> Array:
    """Return the rate of temperature change times a sensitivity that is 0 at 25 degC: a line there, or bent."""
    lag_s = shape["lag_s"]
    return bent(s.lagged(s.warm_k, lag_s), shape.get("growth", 0.0)) * s.lagged(s.warming_k_per_min, lag_s)


def bent(above_k: Array, growth: float) -> Array:
    """Return temperatures above 25 degC in 50 K, bent: of slope 1 there, e^growth times as steep at 75 degC."""
    relative = above_k / SPAN_K
    return relative if abs(growth) < _STRAIGHT else np.expm1(growth * relative) / growth


def _across(s: Stimulus, shape: Shape) -> Array:
    """Return the temperature difference, a `share` of it late: below 0 it is stress, and that share relaxes."""
    share = shape.get("share", 1.0)
    return (1.0 - share) * s.gradient_k + share * s.lagged(s.gradient_k, shape["lag_s"])


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
        _SHUPE_LAGS,
    ),
    Effect(
        "shupe_cross",
        (Parameter("bias_dph_per_50k_k_per_min", -100.0, 100.0, _PER_WARMING.per("50K")),),
        _cross,
        Input.T_IN | Input.WARMING,
        "T_in times dT_in/dt",
        "stepwise regression of laser gyros: terms T dT/dt; Arrhenius 1889 (growth)",
        "The sensitivity to the rate of temperature change grows with temperature, or towards the cold.",
        (
            *({**lag, "growth": 0.0} for lag in _SHUPE_LAGS),
            *({"lag_s": lag_s, "growth": growth} for growth in (-3.0, 3.0) for lag_s in (0.0, 180.0, 800.0)),
        ),
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
        _across,
        Input.GRADIENT,
        "T_in - T_out",
        "usual dynamic temperature model",
        "Bias follows the temperature difference between inside and case.",
        (
            *({"lag_s": lag, "share": 1.0} for lag in (0.0, 400.0, 1200.0)),
            {"lag_s": 1800.0, "share": -0.5},
        ),
        curve=Curve(Input.GRADIENT),
    ),
)


RELAXATIONS_S = (1200.0, 2500.0, 5400.0)
_BENT = 2.0
"""Logarithm of what the slope of a bent bias grows by in 50 K, as tried."""
_SPREAD = 1.5
"""Logarithm of the outer lags of a spectrum over its middle, as tried: a factor of twenty from end to end."""
_FARTHEST = 0.6
"""Part of the way from thermometer to case up to which something late is: beyond, it resembles the gradient."""
_PER_KELVIN = (Parameter("bias_dph_per_k", -50.0, 50.0, DPH.per("K")),)


def _loop(s: Stimulus, shape: Shape) -> Array:
    """Return a curve of plays, with what there would be without loops (`static` 1) or less it (0).

    The mean of five plays, `spread` is that of their widths; straight, or flat far from `centre_c` (`curl`).
    Relays of one width whose middles lie about a temperature are such a curve (Mayergoyz, Mathematical Models of
    Hysteresis, 1991).
    """
    half, spread, static = shape["half_width_k"], shape.get("spread", 0.0), shape.get("static", 0.0)
    parts = (0.0,) if spread <= 0.0 else (-1.0, -0.5, 0.0, 0.5, 1.0)
    halves = [half * (1.0 + spread * part) for part in parts]
    off = s.slacks(s.warm_k, halves, partial(_flat, shape=shape))
    return off + static * _flat(s.warm_k, shape) if static else off


def _flat(above_k: Array, shape: Shape) -> Array:
    """Return temperatures above 25 degC, the less steep the further they are from `centre_c`."""
    curl = shape.get("curl", 0.0)
    if curl < _STRAIGHT:
        return above_k
    flat_k = SPAN_K / curl
    return np.asarray(flat_k * np.tanh((above_k + REFERENCE_C - shape["centre_c"]) / flat_k))


def late(s: Stimulus, shape: Shape) -> Array:
    """Return, in K, a slow follower of a temperature where it acts by itself (`static` 1), else that less it.

    The temperature is T_in, or nearer to the case by a part `toward_case`. With a `spread` there are five lags of
    one weight, even in their logarithm, the outer ones e^spread times as short and as long as `lag_s`: creep by a
    power of time is such a spectrum (Ferry, Viscoelastic Properties of Polymers, 1980, ch. 3). With a `growth`
    the difference is bent over temperature, where it follows T_in.
    """
    part, spread = shape.get("toward_case", 0.0), shape.get("spread", 0.0)
    body_k = s.warm_k - part * s.gradient_k if part else s.warm_k
    apart = (0.0,) if spread < _STRAIGHT else (-1.0, -0.5, 0.0, 0.5, 1.0)
    followers_k = [s.lagged(body_k, shape["lag_s"] * math.exp(spread * each)) for each in apart]
    follower_k = sum(followers_k[1:], start=followers_k[0]) / len(apart)
    if shape.get("static", 0.0):
        return follower_k
    growth = shape.get("growth", 0.0)
    return body_k - follower_k if part else SPAN_K * (bent(body_k, growth) - bent(follower_k, growth))


def _slow(
    lag_s: float, *, growth: float = 0.0, static: float = 0.0, spread: float = 0.0, toward_case: float = 0.0
) -> Shape:
    return {"lag_s": lag_s, "growth": growth, "static": static, "spread": spread, "toward_case": toward_case}


MEMORY_EFFECTS = (
    Effect(
        "thermal_lag",
        _PER_KELVIN,
        late,
        Input.T_IN | Input.HISTORY,
        "slow follower of T_in or nearer the case, or that less it",
        "heat flow between sensor and coil",
        "What sets the bias follows the temperature sensor late.",
        (
            *(_slow(lag) for lag in (60.0, 200.0, 500.0, 1200.0)),
            *(_slow(lag, growth=growth) for lag in (150.0, 600.0) for growth in (-_BENT, _BENT)),
            *(_slow(lag, static=1.0) for lag in (400.0, 1200.0)),
            *(_slow(lag, spread=_SPREAD) for lag in (200.0, 600.0)),
            *(_slow(lag, toward_case=_FARTHEST) for lag in (200.0, 700.0)),
        ),
        whole=("static",),
        also=Input.GRADIENT,
    ),
    Effect(
        "relaxation",
        _PER_KELVIN,
        late,
        Input.T_IN | Input.HISTORY,
        "slow follower of T_in or nearer the case, or that less it",
        "slow tail after a shock; hysteresis in lag form",
        "Bias relaxes slowly after the temperature has settled.",
        (
            *(_slow(lag) for lag in RELAXATIONS_S),
            *(_slow(2500.0, growth=growth) for growth in (-_BENT, _BENT)),
            *(_slow(lag, static=1.0) for lag in (2500.0, 5400.0)),
            *(_slow(lag, spread=_SPREAD) for lag in (1200.0, 3000.0)),
            _slow(1800.0, toward_case=_FARTHEST),
        ),
        whole=("static",),
        also=Input.GRADIENT,
    ),
    Effect(
        "hysteresis",
        _PER_KELVIN,
        _loop,
        Input.T_IN | Input.HISTORY,
        "direction of the last change of T_in",
        "play operators, Visintin, Differential Models of Hysteresis, 1994; with an envelope, Al Janaideh and "
        "others, Mechatronics 19, 656, 2009",
        "Bias differs between cooling and warming at the same temperature, however slow.",
        (
            *(
                {"half_width_k": half, "spread": spread, "curl": 0.0, "centre_c": 10.0, "static": 0.0}
                for spread in (0.0, 0.8)
                for half in (3.0, 8.0, 16.0, 28.0)
            ),
            *(
                {"half_width_k": half, "spread": 0.8, "curl": curl, "centre_c": centre, "static": 1.0}
                for half in (6.0, 14.0)
                for curl, centre in ((0.0, 10.0), (1.2, -20.0), (1.2, 10.0), (1.2, 40.0))
            ),
        ),
        whole=("static",),
    ),
)


def _settling(s: Stimulus, shape: Shape) -> Array:
    """Kohlrausch's function of time: with `stretch` 1 an exponential, below it many time constants at once."""
    since = np.maximum(s.time_s, 0.0) / shape["time_constant_s"]
    return np.asarray(np.exp(-(since ** shape.get("stretch", 1.0))))


WARM_UP = Effect(
    "warm_up",
    (Parameter("bias_dph", -500.0, 500.0, DPH),),
    _settling,
    Input.TIME,
    "time since power-on",
    "self-heating of the electronics; Williams and Watts, Trans. Faraday Soc. 66, 80, 1970 (stretched)",
    "Bias settles after power-on.",
    tuple(
        {"time_constant_s": tau, "stretch": stretch}
        for stretch, taus in ((1.0, (300.0, 900.0, 1800.0, 3600.0)), (0.5, (100.0, 400.0, 1600.0)))
        for tau in taus
    ),
    curve=Curve(Input.TIME),
)
BIAS_RAMP = Effect(
    "bias_ramp",
    (Parameter("bias_dph_per_h", -100.0, 100.0, DPH.per("h")),),
    lambda s, _: s.time_s / 3600.0,
    Input.TIME,
    "time in the run",
    "IEEE Std 952, rate ramp",
    "Bias drifts steadily with time.",
    curve=Curve(Input.TIME),
)
