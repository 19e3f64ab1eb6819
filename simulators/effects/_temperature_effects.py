"""Effects that temperature drives, on bias and on scale factor."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._effect import Effect, Parameter
from simulators.effects._stimulus import REFERENCE_C, Stimulus

Shape = Mapping[str, float]
_SHORT_LAGS: tuple[Shape, ...] = tuple({"lag_s": lag} for lag in (0.0, 60.0, 180.0, 400.0, 800.0))
_COIL_LAGS: tuple[Shape, ...] = tuple({"lag_s": lag} for lag in (0.0, 150.0, 400.0))
_STIFFENING: tuple[Shape, ...] = tuple(
    {"lag_s": lag, "glass_c": glass, "width_k": width}
    for lag in (0.0, 180.0, 400.0)
    for glass in (-35.0, -25.0, -15.0, -5.0)
    for width in (5.0, 12.0)
)
_RELAXATIONS: tuple[Shape, ...] = tuple({"lag_s": lag} for lag in (1500.0, 2700.0, 5400.0))
_SPAN_K = 50.0


def _one(column: Callable[[Stimulus, Shape], Array]) -> Callable[[Stimulus, Shape], Array]:
    return lambda stimulus, shape: column(stimulus, shape)[None, :]


def _power(order: int) -> Callable[[Stimulus, Shape], Array]:
    def column(s: Stimulus, shape: Shape) -> Array:
        relative = s.lagged(s.warm_k, shape.get("lag_s", 0.0)) / _SPAN_K
        return np.asarray(np.prod([relative] * order, axis=0))

    return _one(column)


def _shupe(s: Stimulus, shape: Shape) -> Array:
    """Mohr's integral in two terms: the coil warms as a whole, and unequally to what holds the fibre's ends."""
    both = (s.warming_k_per_min, s.gradient_rate_k_per_min)
    return np.stack([s.lagged(each, shape["lag_s"]) for each in both])


def _cross(s: Stimulus, shape: Shape) -> Array:
    lag = shape["lag_s"]
    return s.lagged(s.warm_k, lag) / _SPAN_K * s.lagged(s.warming_k_per_min, lag)


def _cold_stress(s: Stimulus, shape: Shape) -> Array:
    lag = shape["lag_s"]
    above = (s.lagged(s.warm_k, lag) + REFERENCE_C - shape["glass_c"]) / shape["width_k"]
    return s.lagged(s.warming_k_per_min, lag) / (1.0 + np.exp(np.clip(above, -50.0, 50.0)))


def _behind(s: Stimulus, shape: Shape) -> Array:
    return s.warm_k - s.lagged(s.warm_k, shape["lag_s"])


def _play(s: Stimulus, shape: Shape) -> Array:
    """Play operator of half width r: follows T only when pushed; less T itself (Visintin 1994, ch. III)."""
    half = shape["half_width_k"]
    temperature = s.warm_k[::10]
    followed = np.empty(len(temperature))
    value = float(temperature[0])
    for index, upper in enumerate((temperature + half).tolist()):
        value = min(max(value, upper - 2.0 * half), upper)
        followed[index] = value
    every = np.arange(len(s.warm_k), dtype=np.float64)
    return np.asarray(np.interp(every, every[::10], followed - temperature))


def _warm_up(s: Stimulus, shape: Shape) -> Array:
    return np.asarray(np.exp(-s.time_s / shape["time_constant_s"]))


def _mode_hop(s: Stimulus, shape: Shape) -> Array:
    warm_k = s.lagged(s.warm_k, shape["lag_s"])
    return np.asarray(0.5 * np.tanh((warm_k + REFERENCE_C - shape["at_c"]) / shape["width_k"]))


def _ppm_of_rate(column: Callable[[Stimulus, Shape], Array]) -> Callable[[Stimulus, Shape], Array]:
    return lambda s, shape: (1e-6 * s.input_rate_dph * column(s, shape))[None, :]


def _dph(name: str, bound: float) -> tuple[Parameter, ...]:
    return (Parameter(name, -bound, bound),)


TEMPERATURE_EFFECTS = (
    Effect(
        "bias_linear",
        _dph("bias_dph_per_50k", 500.0),
        _power(1),
        "T_in",
        "IEEE Std 952, bias temperature sensitivity",
        "Bias is proportional to temperature.",
    ),
    Effect(
        "bias_quadratic",
        _dph("bias_dph_per_50k2", 500.0),
        _power(2),
        "T_in",
        "usual static temperature model",
        "Bias bends with temperature.",
        _COIL_LAGS,
    ),
    Effect(
        "bias_cubic",
        _dph("bias_dph_per_50k3", 500.0),
        _power(3),
        "T_in",
        "usual static temperature model",
        "Bias follows the cube of temperature: it bends one way in the cold, the other in the warm.",
        _COIL_LAGS,
    ),
    Effect(
        "shupe",
        (*_dph("bias_dph_per_k_per_min", 100.0), *_dph("gradient_dph_per_k_per_min", 100.0)),
        _shupe,
        "dT_in/dt and d(T_in - T_out)/dt",
        "Shupe 1980; Mohr 1996",
        "Bias follows the coil's rate of temperature change.",
        _SHORT_LAGS,
    ),
    Effect(
        "shupe_cross",
        _dph("bias_dph_per_50k_k_per_min", 100.0),
        _one(_cross),
        "T_in times dT_in/dt",
        "stepwise regression of laser gyros: terms T dT/dt",
        "The sensitivity to the rate of temperature change grows with temperature.",
        _SHORT_LAGS,
    ),
    Effect(
        "cold_stress",
        _dph("bias_dph_per_k_per_min", 100.0),
        _one(_cold_stress),
        "dT_in/dt below a temperature",
        "potting stiffens below its glass transition",
        "Stress in the winding follows the rate of temperature change, in the cold only.",
        _STIFFENING,
    ),
    Effect(
        "gradient",
        _dph("bias_dph_per_k", 50.0),
        _one(lambda s, shape: s.lagged(s.gradient_k, shape["lag_s"])),
        "T_in - T_out",
        "usual dynamic temperature model",
        "Bias follows the temperature difference between inside and case.",
        ({"lag_s": 0.0}, {"lag_s": 400.0}),
    ),
    Effect(
        "thermal_lag",
        _dph("bias_dph_per_k", 50.0),
        _one(_behind),
        "T_in less its slow follower",
        "heat flow between sensor and coil",
        "What sets the bias follows the temperature sensor late.",
        tuple({"lag_s": lag} for lag in (60.0, 200.0, 500.0)),
    ),
    Effect(
        "relaxation",
        _dph("bias_dph_per_k", 50.0),
        _one(_behind),
        "T_in less its slow follower",
        "slow tail after a shock; hysteresis in lag form",
        "Bias relaxes slowly after the temperature has settled.",
        _RELAXATIONS,
    ),
    Effect(
        "hysteresis",
        _dph("bias_dph_per_k", 50.0),
        _one(_play),
        "direction of the last change of T_in",
        "play operator, Visintin, Differential Models of Hysteresis, 1994",
        "Bias differs between cooling and warming at the same temperature, however slow.",
        tuple({"half_width_k": half} for half in (3.0, 8.0, 16.0, 28.0)),
    ),
    Effect(
        "mode_hop",
        _dph("bias_step_dph", 100.0),
        _one(_mode_hop),
        "T_in crossing a threshold",
        "step of laser mode or of a control loop at a temperature",
        "Bias steps where the temperature crosses a threshold.",
        tuple(
            {"at_c": at, "lag_s": lag, "width_k": width}
            for lag in (0.0, 300.0)
            for at in np.arange(-35.0, 20.0, 5.0).tolist()
            for width in (0.8, 2.5)
        ),
    ),
    Effect(
        "warm_up",
        _dph("bias_dph", 500.0),
        _one(_warm_up),
        "time since power-on",
        "self-heating of the electronics",
        "Bias settles after power-on.",
        tuple({"time_constant_s": tau} for tau in (300.0, 900.0, 1800.0, 3600.0)),
    ),
    Effect(
        "scale_factor_temperature",
        _dph("sf_ppm_per_k", 500.0),
        _ppm_of_rate(lambda s, _: s.warm_k),
        "rate times T_in",
        "IEEE Std 952, scale-factor temperature sensitivity",
        "Scale factor is proportional to temperature.",
    ),
    Effect(
        "scale_factor_quadratic",
        _dph("sf_ppm_per_50k2", 50000.0),
        _ppm_of_rate(lambda s, _: (s.warm_k / _SPAN_K) ** 2),
        "rate times T_in squared",
        "IEEE Std 952, scale-factor temperature sensitivity",
        "Scale factor bends with temperature.",
    ),
    Effect(
        "scale_factor_lag",
        _dph("sf_ppm_per_k", 500.0),
        _ppm_of_rate(_behind),
        "rate times T_in less its slow follower",
        "scale-factor hysteresis over a cycle",
        "Scale factor follows the temperature late.",
        ({"lag_s": 300.0}, *_RELAXATIONS),
    ),
)
