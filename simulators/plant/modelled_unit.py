"""A unit whose errors are a model's effects: the catalogue's formulas, executed by the second or by the sample.

Each run's turn-on bias is not part of a model and is zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects import (
    PPM,
    REFERENCE_C,
    AnyEffect,
    Causal,
    Disturbance,
    Effect,
    SamplePath,
    Stimulus,
    Variant,
    effect_named,
)
from simulators.plant.model import EFFECTS, AxisModel, UnitModel
from simulators.plant.modelled_channels import check_channels, with_heat
from simulators.plant.noise import NoiseParameters, NoiseSource


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
            ModelledTerm(term["effect"], tuple(term["values"]), dict(term["shape"])) for term in data["terms"]
        )
        channels = {name: tuple(values) for name, values in data.get("channels", {}).items()}
        return cls(terms, NoiseParameters(**noise), walk, channels)


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
    check_channels(errors.channels)
    effects: dict[str, dict[str, Callable[[Any], Any]]] = {kind: {} for kind in EFFECTS}
    for number, term in enumerate(errors.terms):
        source = NoiseSource(seed[0], f"disturbance {(*seed, 0)[1:]}", 10 * number)
        effect = effect_named(term.effect, term.shape)
        if effect is None:
            raise ConfigurationError("the catalogue lacks an effect of a model", found=term.effect)
        kind, value = _executed(effect, term, source)
        effects[kind][f"{term.effect} {number}"] = value
    if errors.rate_random_walk_dph_per_sqrt_h:
        effects["bias_dph"]["rate_random_walk"] = _walk(errors.rate_random_walk_dph_per_sqrt_h, seed)
    axis = AxisModel(noise=errors.noise, turn_on_bias_dph=0.0, turn_on_sf_ppm=0.0, **effects)
    return replace(with_heat(unit, errors.channels), axis_models=(axis,))


def _executed(effect: AnyEffect, term: ModelledTerm, source: NoiseSource) -> tuple[str, Callable[[Any], Any]]:
    """Return what a term adds to, as an `AxisModel` calls it, and the function that gives it."""
    if isinstance(effect, Disturbance):
        return "sample_rad", effect.emulate(term.values, source)
    assert isinstance(effect, Effect)
    variant = Variant(effect, term.shape)
    if effect.causal is Causal.TICK:
        step = variant.stepper(term.values)
        kind = "sf_error_ppm" if effect.unit == PPM else "bias_dph"
        return kind, lambda state: step(state.sensor_temp_c, state.case_temp_c)
    if effect.causal is Causal.RATE:
        return "rate_ppm", partial(_rate_ppm, variant, term.values)
    return "sample_rad", partial(_sample_rad, variant, term.values)


def _rate_ppm(variant: Variant, values: Sequence[float], rate_dps: Array) -> Array:
    """Return the scale-factor error that adds to the output what an effect does at a rate."""
    rate_dph = 3600.0 * rate_dps
    added = variant.response_dph(values, rate_dph)
    return np.asarray(1e6 * added / np.where(rate_dph == 0.0, 1.0, rate_dph))


def _sample_rad(variant: Variant, values: Sequence[float], path: SamplePath) -> Array:
    """Return what an effect adds to the angle increments on the way of the axis."""
    n = len(path.edges_s) - 1
    room, elevation = np.full(n, REFERENCE_C), np.full(n, path.elevation_deg)
    s = Stimulus(path.edges_s[1:], room, room, path.angle_deg, elevation, path.latitude_deg, path.period_s)
    total = np.zeros(n)
    for value, column in zip(values, variant.columns(s), strict=True):
        total += value * column
    return total * (math.radians(path.period_s) / 3600.0)


def _walk(coefficient: float, seed: tuple[int, ...]) -> Callable[[Any], float]:
    rng, value = np.random.default_rng(seed), 0.0

    def walked(_: Any) -> float:
        nonlocal value
        value += coefficient / 60.0 * float(rng.standard_normal())
        return value

    return walked
