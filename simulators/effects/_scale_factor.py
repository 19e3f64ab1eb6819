"""The scale factor: its error, its curve over rate, and how it follows temperature."""

from __future__ import annotations

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._effect import PPM, Curve, Effect, Input, Parameter, Shape
from simulators.effects._stimulus import Stimulus
from simulators.effects._thermal import LAGS, RELAXATIONS_S, SPAN_K, bent, late, power

_AT_DPS = 100.0
_NEARLY = 0.8
"""Power of e by which its slope grows in 50 K, up to which a scale factor counts as straight over temperature."""


def _both_ways(s: Stimulus, _: Shape) -> Array:
    """Half of the rate's magnitude as a part of the rate: its sign, more in a sample in which the rate turns."""
    rate = s.input_rate_dph
    return np.asarray(0.5 * s.mean_speed_dph / np.where(rate == 0.0, 1.0, rate))


def _nearly_straight(s: Stimulus, shape: Shape) -> Array:
    """Return T_in above 25 degC, late by `lag_s`, with a slope that is e^bend times as large at 75 degC."""
    return SPAN_K * bent(s.lagged(s.warm_k, shape.get("lag_s", 0.0)), shape.get("bend", 0.0))


SCALE_FACTOR_OVER_TEMPERATURE = (
    Effect(
        "scale_factor_temperature",
        (Parameter("sf_ppm_per_k", -500.0, 500.0, PPM.per("K")),),
        _nearly_straight,
        Input.T_IN,
        "rate times T_in, or what grows with it and bends a little",
        "IEEE Std 952, scale-factor temperature sensitivity",
        "Scale factor is proportional to temperature, or nearly so.",
        (
            *({**lag, "bend": 0.0} for lag in LAGS),
            *({"lag_s": 0.0, "bend": bend} for bend in (-_NEARLY, _NEARLY)),
        ),
        unit=PPM,
        curve=Curve(Input.T_IN, of_rate=True),
    ),
    Effect(
        "scale_factor_quadratic",
        (Parameter("sf_ppm_per_50k2", -50000.0, 50000.0, PPM.per("(50K)^2")),),
        power(2),
        Input.T_IN,
        "rate times T_in squared",
        "IEEE Std 952, scale-factor temperature sensitivity",
        "Scale factor bends with temperature.",
        LAGS,
        unit=PPM,
        curve=Curve(Input.T_IN, of_rate=True),
    ),
    Effect(
        "scale_factor_lag",
        (Parameter("sf_ppm_per_k", -500.0, 500.0, PPM.per("K")),),
        late,
        Input.T_IN | Input.HISTORY,
        "rate times T_in's slow follower, or T_in less it",
        "scale-factor hysteresis over a cycle",
        "Scale factor follows the temperature late.",
        tuple(
            {"lag_s": lag_s, "static": static}
            for static, shortest_s in ((0.0, 300.0), (1.0, 800.0))
            for lag_s in (shortest_s, *RELAXATIONS_S)
        ),
        unit=PPM,
        whole=("static",),
    ),
)
SCALE_FACTOR_OVER_RATE = (
    Effect(
        "scale_factor",
        (Parameter("sf_ppm", -1e5, 1e5, PPM),),
        lambda s, _: 1.0,
        Input.NONE,
        "rate",
        "IEEE Std 952, scale factor",
        "Scale factor differs from the model's.",
        unit=PPM,
    ),
    Effect(
        "scale_factor_nonlinearity",
        (Parameter("sf_ppm_at_100dps", -1e5, 1e5, PPM),),
        lambda s, shape: np.asarray(np.abs(s.axis_rate_dps / _AT_DPS) ** (shape.get("power", 3.0) - 1.0)),
        Input.RATE,
        "power of rate",
        "IEEE Std 952, scale-factor nonlinearity",
        "Scale factor changes with the size of rate, alike in both directions.",
        tuple({"power": power} for power in (3.0, 1.5, 2.0, 5.0)),
        unit=PPM,
    ),
    Effect(
        "scale_factor_asymmetry",
        (Parameter("asymmetry_ppm", -1e5, 1e5, PPM),),
        _both_ways,
        Input.RATE,
        "magnitude of rate",
        "IEEE Std 952, scale-factor asymmetry",
        "Scale factors of positive and negative rates differ.",
        unit=PPM,
    ),
)
