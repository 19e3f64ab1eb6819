"""A unit whose errors are a model's effects: the catalogue's formulas in causal form, tick by tick.

A diagnosis sees a whole run and smooths over a minute about each sample; a plant knows the past only. Its
temperatures are free of noise, so it takes backward differences and does not smooth. What differs from the
catalogue's columns: changes come up to half a minute later there and are rounded off; for lags of minutes this is
below a few per cent. Each run's turn-on bias is not part of a model and is zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Protocol

import numpy as np

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects import REFERENCE_C, Stimulus, catalogue
from simulators.effects import Effect as Formula
from simulators.plant.disturbances import Impulses, Line
from simulators.plant.effect import AxisModel, Effect, RateEffect, SampleEffect, SamplePath, UnitModel
from simulators.plant.modelled_channels import check_channels, with_heat
from simulators.plant.noise import NoiseParameters, NoiseSource

_SPAN_K = 50.0
_AT_DPS = 100.0
_SOURCE = "model file"


class Temperatures(Protocol):
    """What every unit's state holds: its own sensor and that on its case."""

    @property
    def sensor_temp_c(self) -> float:
        """Inside, degC."""

    @property
    def case_temp_c(self) -> float:
        """On the case, degC."""


@dataclass(frozen=True)
class ModelledTerm:
    """An effect of the catalogue with the values of its parameters, in their order, and its shape."""

    effect: str
    values: tuple[float, ...]
    shape: Mapping[str, float]


@dataclass(frozen=True)
class ModelledErrors:
    """All errors of a unit as a model has them; noise coefficients as in IEEE Std 952.

    `channels`: what the model says beside the gyro's rate, effect to values (see `modelled_channels`).
    """

    terms: tuple[ModelledTerm, ...]
    noise: NoiseParameters
    rate_random_walk_dph_per_sqrt_h: float = 0.0
    channels: Mapping[str, tuple[float, ...]] = field(default_factory=dict)

    @classmethod
    def from_json(cls, data: Mapping[str, Any]) -> ModelledErrors:
        """Restore from plain JSON values: `terms`, and `noise` as the model file has it."""
        noise = dict(data["noise"])
        walk = noise.pop("rate_random_walk_dph_per_sqrt_h", 0.0)
        terms = tuple(
            ModelledTerm(each["effect"], tuple(each["values"]), dict(each["shape"])) for each in data["terms"]
        )
        channels = {name: tuple(values) for name, values in data.get("channels", {}).items()}
        return cls(terms, NoiseParameters(**noise), walk, channels)


class _Follower:
    """First-order follower at steps of 1 s, settled at its first value; the value itself for lag 0."""

    def __init__(self, lag_s: float) -> None:
        self._gain = 1.0 - math.exp(-1.0 / lag_s) if lag_s > 0.0 else 1.0
        self._value = math.nan

    def __call__(self, value: float) -> float:
        if math.isnan(self._value):
            self._value = value
        self._value += self._gain * (value - self._value)
        return self._value


class _Change:
    """Backward difference at steps of 1 s, per minute; 0 at first."""

    def __init__(self) -> None:
        self._last = math.nan

    def __call__(self, value: float) -> float:
        change = 0.0 if math.isnan(self._last) else 60.0 * (value - self._last)
        self._last = value
        return change


class _Clock:
    """Seconds since power-on: counts its calls, one a tick."""

    def __init__(self) -> None:
        self._time_s = -1.0

    def __call__(self) -> float:
        self._time_s += 1.0
        return self._time_s


_Value = Callable[[Temperatures], float]


def _warm_k(state: Temperatures) -> float:
    return state.sensor_temp_c - REFERENCE_C


def _gradient_k(state: Temperatures) -> float:
    return state.sensor_temp_c - state.case_temp_c


def _power(order: int) -> Callable[[ModelledTerm], _Value]:
    def made(term: ModelledTerm) -> _Value:
        lag = _Follower(term.shape.get("lag_s", 0.0))
        return lambda state: term.values[0] * (lag(_warm_k(state)) / _SPAN_K) ** order

    return made


def _shupe(term: ModelledTerm) -> _Value:
    changes = (_Change(), _Change())
    lags = (_Follower(term.shape["lag_s"]), _Follower(term.shape["lag_s"]))
    whole, unequal = term.values
    return lambda state: (
        whole * lags[0](changes[0](_warm_k(state))) + unequal * lags[1](changes[1](_gradient_k(state)))
    )


def _cross(term: ModelledTerm) -> _Value:
    change, warm, warming = _Change(), _Follower(term.shape["lag_s"]), _Follower(term.shape["lag_s"])
    return lambda state: term.values[0] * warm(_warm_k(state)) / _SPAN_K * warming(change(_warm_k(state)))


def _cold_stress(term: ModelledTerm) -> _Value:
    change, warm, warming = _Change(), _Follower(term.shape["lag_s"]), _Follower(term.shape["lag_s"])
    glass_c, width_k = term.shape["glass_c"], term.shape["width_k"]

    def value(state: Temperatures) -> float:
        above = (warm(_warm_k(state)) + REFERENCE_C - glass_c) / width_k
        return (
            term.values[0] * warming(change(_warm_k(state))) / (1.0 + math.exp(min(max(above, -50.0), 50.0)))
        )

    return value


def _gradient(term: ModelledTerm) -> _Value:
    lag = _Follower(term.shape["lag_s"])
    return lambda state: term.values[0] * lag(_gradient_k(state))


def _behind(term: ModelledTerm) -> _Value:
    lag = _Follower(term.shape["lag_s"])
    return lambda state: term.values[0] * (_warm_k(state) - lag(_warm_k(state)))


def _play(term: ModelledTerm) -> _Value:
    half, followed = term.shape["half_width_k"], math.nan

    def value(state: Temperatures) -> float:
        nonlocal followed
        warm = _warm_k(state)
        followed = warm if math.isnan(followed) else min(max(followed, warm - half), warm + half)
        return term.values[0] * (followed - warm)

    return value


def _mode_hop(term: ModelledTerm) -> _Value:
    lag, at_c, width_k = _Follower(term.shape["lag_s"]), term.shape["at_c"], term.shape["width_k"]
    return lambda state: (
        term.values[0] * 0.5 * math.tanh((lag(_warm_k(state)) + REFERENCE_C - at_c) / width_k)
    )


def _warm_up(term: ModelledTerm) -> _Value:
    clock = _Clock()
    return lambda _: term.values[0] * math.exp(-clock() / term.shape["time_constant_s"])


def _ramp(term: ModelledTerm) -> _Value:
    clock = _Clock()
    return lambda _: term.values[0] * clock() / 3600.0


_BIAS: dict[str, Callable[[ModelledTerm], _Value]] = {
    "bias_linear": _power(1),
    "bias_quadratic": _power(2),
    "bias_cubic": _power(3),
    "shupe": _shupe,
    "shupe_cross": _cross,
    "cold_stress": _cold_stress,
    "gradient": _gradient,
    "thermal_lag": _behind,
    "relaxation": _behind,
    "hysteresis": _play,
    "mode_hop": _mode_hop,
    "warm_up": _warm_up,
    "bias_ramp": _ramp,
}
_SCALE: dict[str, Callable[[ModelledTerm], _Value]] = {
    "scale_factor": lambda term: lambda _: term.values[0],
    "scale_factor_temperature": lambda term: lambda state: term.values[0] * _warm_k(state),
    "scale_factor_quadratic": _power(2),
    "scale_factor_lag": _behind,
}


def _ppm_of(term: ModelledTerm, output_dps: Callable[[Array], Array]) -> RateEffect:
    """Return the scale-factor error that turns rates into an output, or into a part of the way to it."""

    def value(dps: Array) -> Array:
        wrong = output_dps(dps) - dps
        return np.asarray(1e6 * term.values[0] * wrong / np.where(dps == 0.0, 1.0, dps))

    return RateEffect(term.effect, value, _SOURCE, "")


def _saturation(term: ModelledTerm) -> RateEffect:
    limit = term.shape["limit_dps"]
    return _ppm_of(term, lambda dps: np.clip(dps, -limit, limit))


def _dead_zone(term: ModelledTerm) -> RateEffect:
    band = term.shape["band_dph"] / 3600.0
    return _ppm_of(term, lambda dps: np.where(np.abs(dps) < band, 0.0, dps))


def _lock_in(term: ModelledTerm) -> RateEffect:
    lock = term.shape["lock_dph"] / 3600.0
    return _ppm_of(term, lambda dps: np.sign(dps) * np.sqrt(np.maximum(dps**2 - lock**2, 0.0)))


_RATE: dict[str, Callable[[ModelledTerm], RateEffect]] = {
    "scale_factor_nonlinearity": lambda term: RateEffect(
        term.effect, lambda dps: term.values[0] * (dps / _AT_DPS) ** 2, _SOURCE, ""
    ),
    "scale_factor_asymmetry": lambda term: RateEffect(
        term.effect, lambda dps: 0.5 * term.values[0] * np.sign(dps), _SOURCE, ""
    ),
    "saturation": _saturation,
    "dead_zone": _dead_zone,
    "lock_in": _lock_in,
}


def _by_angle(term: ModelledTerm) -> Callable[[SamplePath], Array]:
    """Return an effect of angle and attitude: it has no memory, so that the catalogue's columns are causal."""
    formula = catalogue()[term.effect]
    assert isinstance(formula, Formula)

    def increments_rad(path: SamplePath) -> Array:
        n = len(path.edges_s) - 1
        room = np.full(n, REFERENCE_C)
        elevation = np.full(n, path.elevation_deg)
        s = Stimulus(
            path.edges_s[1:], room, room, path.angle_deg, elevation, path.latitude_deg, path.period_s
        )
        total = np.zeros(n)
        for value, column in zip(term.values, formula.columns(s, term.shape), strict=True):
            total += value * column
        return total * (math.radians(path.period_s) / 3600.0)

    return increments_rad


_ANGLE = (
    "azimuth_error",
    "table_tilt",
    "axis_misalignment",
    "heading_sensitivity",
    "table_wobble_once",
    "table_wobble_twice",
    "acceleration_sensitivity",
    "acceleration_squared",
    "vibration_rectification",
)
_DISTURBANCES: dict[str, Callable[[float, float, NoiseSource], Callable[[SamplePath], Array]]] = {
    "impulses": Impulses,
    "vibration_or_mains_line": Line,
}
CAUSAL = (*_BIAS, *_SCALE, *_RATE, *_ANGLE, *_DISTURBANCES)
"""Effects of the catalogue that a plant can have."""


def _sample_effects(terms: Sequence[ModelledTerm], seed: tuple[int, ...]) -> tuple[SampleEffect, ...]:
    effects = []
    for number, term in enumerate(terms):
        if term.effect in _ANGLE:
            effects.append(SampleEffect(term.effect, _by_angle(term), _SOURCE, ""))
        elif term.effect in _DISTURBANCES:
            source = NoiseSource(seed[0], f"disturbance {seed[1:]}", 10 * number)
            made = _DISTURBANCES[term.effect](term.values[0], term.values[1], source)
            effects.append(SampleEffect(term.effect, made, _SOURCE, ""))
    return tuple(effects)


def modelled(unit: UnitModel, errors: ModelledErrors, seed: tuple[int, ...]) -> UnitModel:
    """Return a single-axis unit with its thermal network kept and its errors those of a model.

    `seed` draws the rate random walk, phases and times. ConfigurationError for a unit of several axes or without
    a temperature on its case, and for effects without a causal form.
    """
    if len(unit.axes) != 1 or not {"sensor_temp_c", "case_temp_c"} <= set(unit.outputs):
        raise ConfigurationError(
            "a model's effects act on a single-axis unit",
            where="plant",
            found=f"axes {unit.axes}",
            expected="a unit of the model fog_mid, fog_nav or rlg",
        )
    _check(errors.terms)
    check_channels(errors.channels)
    effects = [
        Effect(term.effect, "bias_dph", _BIAS[term.effect](term), _SOURCE, "")
        for term in errors.terms
        if term.effect in _BIAS
    ]
    effects += [
        Effect(term.effect, "sf_error_ppm", _SCALE[term.effect](term), _SOURCE, "")
        for term in errors.terms
        if term.effect in _SCALE
    ]
    if errors.rate_random_walk_dph_per_sqrt_h:
        walk = _walk(errors.rate_random_walk_dph_per_sqrt_h, seed)
        effects.append(Effect("rate_random_walk", "bias_dph", walk, _SOURCE, ""))
    rates = tuple(_RATE[term.effect](term) for term in errors.terms if term.effect in _RATE)
    axis = AxisModel(tuple(effects), rates, errors.noise, 0.0, 0.0, _sample_effects(errors.terms, (*seed, 0)))
    return replace(with_heat(unit, errors.channels), axis_models=(axis,))


def _walk(coefficient: float, seed: tuple[int, ...]) -> _Value:
    rng, value = np.random.default_rng(seed), 0.0

    def walked(_: Temperatures) -> float:
        nonlocal value
        value += coefficient / 60.0 * float(rng.standard_normal())
        return value

    return walked


def _check(terms: Sequence[ModelledTerm]) -> None:
    without = [term.effect for term in terms if term.effect not in CAUSAL]
    if without:
        raise ConfigurationError(
            "a plant cannot have an effect of the model",
            where="plant",
            found=", ".join(without),
            expected="any of " + ", ".join(CAUSAL),
            remedy="take the effect out of the model file; its other effects can be rehearsed without it",
        )
