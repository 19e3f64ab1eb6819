"""A bias that remembers temperature: it follows late, relaxes slowly, or lags by hysteresis."""

from __future__ import annotations

from drivers.base.arrays import Array
from simulators.effects._effect import DPH, Effect, Input, Parameter, Shape
from simulators.effects._stimulus import Stimulus

RELAXATIONS: tuple[Shape, ...] = tuple({"lag_s": lag} for lag in (1500.0, 2700.0, 5400.0))
_BIAS = (Parameter("bias_dph_per_k", -50.0, 50.0, DPH.per("K")),)


def behind(s: Stimulus, shape: Shape) -> Array:
    """T_in less its slow follower."""
    return s.warm_k - s.lagged(s.warm_k, shape["lag_s"])


MEMORY_EFFECTS = (
    Effect(
        "thermal_lag",
        _BIAS,
        behind,
        Input.T_IN | Input.HISTORY,
        "T_in less its slow follower",
        "heat flow between sensor and coil",
        "What sets the bias follows the temperature sensor late.",
        tuple({"lag_s": lag} for lag in (60.0, 200.0, 500.0)),
    ),
    Effect(
        "relaxation",
        _BIAS,
        behind,
        Input.T_IN | Input.HISTORY,
        "T_in less its slow follower",
        "slow tail after a shock; hysteresis in lag form",
        "Bias relaxes slowly after the temperature has settled.",
        RELAXATIONS,
    ),
    Effect(
        "hysteresis",
        _BIAS,
        lambda s, shape: s.slack(s.warm_k, shape["half_width_k"]),
        Input.T_IN | Input.HISTORY,
        "direction of the last change of T_in",
        "play operator, Visintin, Differential Models of Hysteresis, 1994",
        "Bias differs between cooling and warming at the same temperature, however slow.",
        tuple({"half_width_k": half} for half in (3.0, 8.0, 16.0, 28.0)),
    ),
)
