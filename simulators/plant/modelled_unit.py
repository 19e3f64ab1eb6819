"""A unit whose errors are a model's effects: the catalogue's formulas, executed by the second or by the sample.

Each run's turn-on bias is not part of a model and is zero.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Protocol

import numpy as np

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects import (
    PPM,
    REFERENCE_C,
    Causal,
    Disturbance,
    Effect,
    SamplePath,
    Stimulus,
    Variant,
    catalogue,
)
from simulators.plant.effect import AxisModel, RateEffect, SampleEffect, StateEffect, UnitModel
from simulators.plant.modelled_channels import check_channels, with_heat
from simulators.plant.noise import NoiseParameters, NoiseSource

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


def _by_tick(term: ModelledTerm, variant: Variant) -> StateEffect[Temperatures]:
    step = variant.stepper(term.values)
    part: Literal["bias_dph", "sf_error_ppm"] = "sf_error_ppm" if variant.effect.unit == PPM else "bias_dph"
    return StateEffect(
        term.effect, part, lambda state: step(state.sensor_temp_c, state.case_temp_c), _SOURCE, ""
    )


def _by_rate(term: ModelledTerm, variant: Variant) -> RateEffect:
    """Return the scale-factor error that adds to the output what the effect does at a rate."""

    def error_ppm(rate_dps: Array) -> Array:
        rate_dph = 3600.0 * rate_dps
        added = variant.response_dph(term.values, rate_dph)
        return np.asarray(1e6 * added / np.where(rate_dph == 0.0, 1.0, rate_dph))

    return RateEffect(term.effect, error_ppm, _SOURCE, "")


def _by_sample(term: ModelledTerm, variant: Variant) -> SampleEffect:
    def increments_rad(path: SamplePath) -> Array:
        n = len(path.edges_s) - 1
        room = np.full(n, REFERENCE_C)
        elevation = np.full(n, path.elevation_deg)
        s = Stimulus(
            path.edges_s[1:], room, room, path.angle_deg, elevation, path.latitude_deg, path.period_s
        )
        total = np.zeros(n)
        for value, column in zip(term.values, variant.columns(s), strict=True):
            total += value * column
        return total * (math.radians(path.period_s) / 3600.0)

    return SampleEffect(term.effect, increments_rad, _SOURCE, "")


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
    effects: list[StateEffect[Any]] = []
    rates: list[RateEffect] = []
    samples: list[SampleEffect] = []
    known = catalogue()
    for number, term in enumerate(errors.terms):
        effect = known[term.effect]
        if isinstance(effect, Disturbance):
            source = NoiseSource(seed[0], f"disturbance {(*seed, 0)[1:]}", 10 * number)
            samples.append(SampleEffect(term.effect, effect.emulate(term.values, source), _SOURCE, ""))
            continue
        assert isinstance(effect, Effect)
        variant = Variant(effect, term.shape)
        if effect.causal is Causal.TICK:
            effects.append(_by_tick(term, variant))
        elif effect.causal is Causal.RATE:
            rates.append(_by_rate(term, variant))
        else:
            samples.append(_by_sample(term, variant))
    if errors.rate_random_walk_dph_per_sqrt_h:
        walk = _walk(errors.rate_random_walk_dph_per_sqrt_h, seed)
        effects.append(StateEffect("rate_random_walk", "bias_dph", walk, _SOURCE, ""))
    axis = AxisModel(tuple(effects), tuple(rates), errors.noise, 0.0, 0.0, tuple(samples))
    return replace(with_heat(unit, errors.channels), axis_models=(axis,))


def _walk(coefficient: float, seed: tuple[int, ...]) -> Callable[[Temperatures], float]:
    rng, value = np.random.default_rng(seed), 0.0

    def walked(_: Temperatures) -> float:
        nonlocal value
        value += coefficient / 60.0 * float(rng.standard_normal())
        return value

    return walked
