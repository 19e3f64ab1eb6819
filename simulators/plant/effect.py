"""What a plant is the sum of: named effects on a gyro's bias and scale factor, each with source and meaning."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass, replace
from typing import Any, Generic, Literal, TypeVar

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects import SamplePath
from simulators.plant.noise import NoiseParameters

StateT = TypeVar("StateT", contravariant=True)


@dataclass(frozen=True)
class StateEffect(Generic[StateT]):
    """One contribution to a channel as a function of the unit's thermal state, evaluated once a tick."""

    name: str
    channel: Literal["bias_dph", "sf_error_ppm"]
    value: Callable[[StateT], float]
    source: str
    meaning: str


@dataclass(frozen=True)
class RateEffect:
    """One contribution to the scale-factor error in ppm as a function of rate in deg/s, float64 (n,) -> (n,)."""

    name: str
    value: Callable[[Array], Array]
    source: str
    meaning: str


@dataclass(frozen=True)
class SampleEffect:
    """One contribution to the angle increments themselves, rad, float64 (n,), from the way of the axis."""

    name: str
    value: Callable[[SamplePath], Array]
    source: str
    meaning: str


@dataclass(frozen=True)
class AxisModel:
    """One sensitive axis: its effects, and its noise ("angle_random_walk", "bias_instability", ...)."""

    effects: tuple[StateEffect[Any], ...]
    rate_effects: tuple[RateEffect, ...]
    noise: NoiseParameters
    turn_on_bias_dph: float
    turn_on_sf_ppm: float
    sample_effects: tuple[SampleEffect, ...] = ()


@dataclass(frozen=True)
class UnitModel:
    """A gyro unit: its axes, its thermal step (see `thermal.tick_matrix`) and how to read the outputs.

    `state` makes the object that effects take from the outputs of a tick, named in `outputs`. Two of these are
    `sensor_temp_c` (the unit's own sensor) and `case_temp_c` (a sensor on its case), read with noise and
    rounded to the LSB; `truth` names the outputs that are recorded beside them.
    """

    axes: str
    axis_models: tuple[AxisModel, ...]
    step: Array
    state: Callable[..., Any]
    outputs: tuple[str, ...]
    truth: tuple[str, ...]
    sensor_noise_c: float
    sensor_lsb_c: float


_NOISE_NAMES = frozenset({"angle_random_walk", "bias_instability", "quantisation", "turn_on"})


def effect_names(model: UnitModel) -> tuple[str, ...]:
    """Return every name that `leave_out` understands for this unit, sorted."""
    names = set(_NOISE_NAMES)
    for axis in model.axis_models:
        names.update(effect.name for effect in axis.effects)
        names.update(effect.name for effect in axis.rate_effects)
        names.update(effect.name for effect in axis.sample_effects)
    return tuple(sorted(names))


def leave_out(model: UnitModel, names: Collection[str]) -> UnitModel:
    """Return the unit without the named effects; ConfigurationError for a name it does not have."""
    unknown = sorted(set(names) - set(effect_names(model)))
    if unknown:
        raise ConfigurationError(
            "an effect to leave out is not one of this unit's",
            where="plant",
            found=", ".join(unknown),
            expected="any of " + ", ".join(effect_names(model)),
        )
    return replace(model, axis_models=tuple(_axis_without(axis, names) for axis in model.axis_models))


def _axis_without(axis: AxisModel, names: Collection[str]) -> AxisModel:
    noise = axis.noise
    kept = 0.0 if "turn_on" in names else 1.0
    return AxisModel(
        tuple(effect for effect in axis.effects if effect.name not in names),
        tuple(effect for effect in axis.rate_effects if effect.name not in names),
        NoiseParameters(
            0.0 if "angle_random_walk" in names else noise.arw_deg_per_sqrt_h,
            0.0 if "bias_instability" in names else noise.bias_instability_dph,
            0.0 if "quantisation" in names else noise.quantum_arcsec,
        ),
        axis.turn_on_bias_dph * kept,
        axis.turn_on_sf_ppm * kept,
        tuple(effect for effect in axis.sample_effects if effect.name not in names),
    )
