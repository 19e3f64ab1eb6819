"""The nominal model: effects with parameters and priors, and the gyro's noise, as a TOML file."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._noise import NAMES, Noise
from bench.analysis.gap._simulation import Simulation, read_simulation
from drivers.base.errors import ConfigurationError
from drivers.base.files import SETTINGS_BYTES, parse_toml, read_bounded
from simulators.effects import (
    CHANNEL_UNITS,
    ChannelEffect,
    Disturbance,
    Effect,
    Stimulus,
    Variant,
    catalogue,
    effect_named,
)

FORMAT = 1
_KNOWN = 1e-9
"""Standard deviation of a parameter that a file leaves out."""


@dataclass(frozen=True)
class Term:
    """An effect in a model: its shape, the values of its parameters and their uncertainties (1 sigma)."""

    variant: Variant
    values: tuple[float, ...]
    sigmas: tuple[float, ...]

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.variant.effect.name

    @property
    def effect(self) -> Effect:
        """The effect, of which the term has one shape."""
        return self.variant.effect

    def fitted(self, coarseness: float, plus_minus: str) -> str:
        """Return name, value and uncertainty of every parameter; in words where the runs do not bound it.

        `coarseness`: the gyro's, see `Noise`.
        """
        parts = []
        for parameter, value, sigma in zip(
            self.variant.effect.parameters, self.values, self.sigmas, strict=True
        ):
            low, high = parameter.bounds(coarseness)
            seen = sigma < high - low
            parts.append(
                f"{parameter.name} = {value:.4g} {plus_minus} {sigma:.2g}"
                if seen
                else f"{parameter.name} not to be seen in these runs"
            )
        return ", ".join(parts)


OtherT = TypeVar("OtherT", ChannelEffect, Disturbance)


@dataclass(frozen=True)
class _OtherTerm(Generic[OtherT]):
    effect: OtherT
    values: tuple[float, ...]
    sigmas: tuple[float, ...]

    @property
    def name(self) -> str:
        """The effect's name."""
        return self.effect.name


class ChannelTerm(_OtherTerm[ChannelEffect]):
    """An effect of another channel in a model: values of its parameters and their uncertainties (1 sigma)."""


class DisturbanceTerm(_OtherTerm[Disturbance]):
    """A disturbance in a model: values of its parameters and their uncertainties (1 sigma)."""


AnyTerm = Term | ChannelTerm | DisturbanceTerm


def by_parameter(term: AnyTerm, values: Sequence[float]) -> dict[str, float]:
    """Return values of a term's parameters by their names."""
    return dict(zip((parameter.name for parameter in term.effect.parameters), values, strict=True))


@dataclass(frozen=True)
class Model:
    """A nominal model; `fitted_on` maps run ids to checksums if a diagnosis wrote it.

    `channel_terms` are of the channels beside the gyro's rate; `accuracy` (channel's name to a value in its
    unit) is the tolerance of a channel's model: deviations below it are not reported. No column
    predicts `disturbances`. `simulation` is a user's own; the terms are then what it lacks.
    """

    name: str
    terms: tuple[Term, ...]
    noise: Noise
    fitted_on: Mapping[str, str] = field(default_factory=dict)
    channel_terms: tuple[ChannelTerm, ...] = ()
    accuracy: Mapping[str, float] = field(default_factory=dict)
    disturbances: tuple[DisturbanceTerm, ...] = ()
    simulation: Simulation | None = None

    def predict(self, stimulus: Stimulus) -> NDArray[np.float64]:
        """Return the output in deg/h that the model expects, without noise, (n,)."""
        total = stimulus.input_rate_dph.copy()
        for term in self.terms:
            total += np.asarray(term.values) @ term.variant.columns(stimulus)
        return total

    def columns(self, stimulus: Stimulus) -> NDArray[np.float64]:
        """Return the columns of all terms, (q, n)."""
        blocks = [term.variant.columns(stimulus) for term in self.terms]
        return np.concatenate(blocks) if blocks else np.zeros((0, len(stimulus)))

    @property
    def sigmas(self) -> NDArray[np.float64]:
        """Prior standard deviations of all parameters, (q,)."""
        return np.array([sigma for term in self.terms for sigma in term.sigmas])

    def moved(self, change: NDArray[np.float64], sigmas: NDArray[np.float64]) -> Model:
        """Return the model with its parameters changed by the first (q,) of `change`, with new deviations."""
        terms, start = [], 0
        for term in self.terms:
            own = slice(start, start + len(term.values))
            values = np.asarray(term.values) + change[own]
            terms.append(Term(term.variant, tuple(values.tolist()), tuple(sigmas[own].tolist())))
            start = own.stop
        return replace(self, terms=tuple(terms))


def read_model(path: Path) -> Model:
    """Read a model file; ConfigurationError says what is wrong with it."""
    try:
        text = read_bounded(path, SETTINGS_BYTES).decode("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigurationError(
            "the model file cannot be read", where=str(path), found=str(error), expected="a TOML file"
        ) from error
    return parse_model(text, str(path))


def parse_model(text: str, where: str) -> Model:
    """Return the model that a file's text describes; ConfigurationError names `where`."""
    try:
        data = parse_toml(text.encode())
    except ValueError as error:
        raise ConfigurationError(
            "the model is not TOML", where=where, found=str(error), expected="a TOML file"
        ) from error
    if data.get("format") != FORMAT:
        raise ConfigurationError(
            "not a model file of this version",
            where=where,
            found=f"format = {data.get('format')}",
            expected=f"format = {FORMAT}",
        )
    effects = catalogue()
    noise = _noise(data, where)
    terms = [_term(each, effects, noise.coarseness, where) for each in data.get("effect", [])]
    return Model(
        str(data.get("name", "nominal")),
        tuple(term for term in terms if isinstance(term, Term)),
        noise,
        dict(data.get("fitted_on", {})),
        tuple(term for term in terms if isinstance(term, ChannelTerm)),
        _accuracy(data.get("accuracy", {}), where),
        tuple(term for term in terms if isinstance(term, DisturbanceTerm)),
        read_simulation(data.get("simulation", {}), where),
    )


def _accuracy(table: Mapping[str, Any], where: str) -> dict[str, float]:
    wrong = sorted(set(table) - set(CHANNEL_UNITS))
    wrong += [name for name, value in table.items() if name not in wrong and not float(value) >= 0.0]
    if wrong:
        raise ConfigurationError(
            "the model's [accuracy] cannot be used",
            where=where,
            found=", ".join(f"{name} = {table[name]}" for name in wrong),
            expected="numbers from 0 up for " + ", ".join(f"{k} ({v})" for k, v in CHANNEL_UNITS.items()),
        )
    return {name: float(value) for name, value in table.items()}


def _noise(data: Mapping[str, Any], where: str) -> Noise:
    table = data.get("noise", {})
    unknown = sorted(set(table) - set(NAMES))
    if unknown or not table.get("arw_deg_per_sqrt_h", 0.0) > 0.0:
        raise ConfigurationError(
            "the model's [noise] cannot be used",
            where=where,
            found=", ".join(unknown) or f"arw_deg_per_sqrt_h = {table.get('arw_deg_per_sqrt_h')}",
            expected="arw_deg_per_sqrt_h > 0 and optionally " + ", ".join(NAMES[1:]),
            remedy="take angle random walk and bias instability from the data sheet",
        )
    return Noise(**{name: float(value) for name, value in table.items()})


def _term(table: Mapping[str, Any], effects: Mapping[str, object], coarseness: float, where: str) -> AnyTerm:
    name = table.get("name")
    effect = effect_named(str(name), table.get("shape", {})) or effects.get(str(name))
    if not isinstance(effect, (Effect, ChannelEffect, Disturbance)):
        kinds = (Effect, ChannelEffect, Disturbance)
        known = sorted(key for key, value in effects.items() if isinstance(value, kinds))
        raise ConfigurationError(
            "the model has an effect that the catalogue lacks",
            where=where,
            found=str(name),
            expected=", ".join(known),
        )
    shapes: Mapping[str, float] = effect.shapes[0] if isinstance(effect, Effect) else {}
    shape = dict(shapes) | table.get("shape", {})  # what is left out has its usual value
    absent = {parameter.name for parameter in effect.parameters if parameter.optional}
    given = dict.fromkeys(absent, 0.0) | table.get("parameters", {})
    sigma = dict.fromkeys(absent, _KNOWN) | table.get("sigma", {})
    wanted = {parameter.name for parameter in effect.parameters}
    tables = {"parameters": (given, wanted), "sigma": (sigma, wanted), "shape": (shape, set(shapes))}
    odd = [f"{key} in {part}" for part, (own, keys) in tables.items() for key in sorted(set(own) - keys)]
    missing = [
        f"no {key} in {part}" for part, (own, keys) in tables.items() for key in sorted(keys - set(own))
    ]
    if odd or missing:
        raise ConfigurationError(
            "an effect of the model does not have its parameters and shapes",
            where=f"{where}: {name}",
            found=", ".join(odd + missing),
            expected=f"parameters and sigma {sorted(wanted)}, shape {sorted(shapes)}",
        )
    for parameter in effect.parameters:
        value = float(given[parameter.name])
        low, high = parameter.bounds(coarseness)
        if not low <= value <= high or not float(sigma[parameter.name]) > 0.0:
            raise ConfigurationError(
                "a parameter is out of bounds",
                where=f"{where}: {name}.{parameter.name}",
                found=f"{value} +- {sigma[parameter.name]}",
                expected=f"{low:g} to {high:g}, sigma > 0",
            )
    values = tuple(float(given[parameter.name]) for parameter in effect.parameters)
    sigmas = tuple(float(sigma[parameter.name]) for parameter in effect.parameters)
    if isinstance(effect, ChannelEffect):
        return ChannelTerm(effect, values, sigmas)
    if isinstance(effect, Disturbance):
        return DisturbanceTerm(effect, values, sigmas)
    return Term(Variant(effect, {key: float(value) for key, value in shape.items()}), values, sigmas)


def model_text(model: Model) -> str:
    """Return a model as the text of its file; `read_model` reads it back to the last bit."""
    lines = [f"format = {FORMAT}", f"name = {json.dumps(model.name)}", "", "[noise]"]
    lines += [f"{name} = {getattr(model.noise, name)!r}" for name in NAMES]
    if model.simulation is not None:
        lines += [
            "",
            "[simulation]",
            *(f"{key} = {_toml(value)}" for key, value in model.simulation.settings.items()),
        ]
    if model.accuracy:
        lines += ["", "[accuracy]", *(f"{name} = {value!r}" for name, value in model.accuracy.items())]
    terms: tuple[AnyTerm, ...] = (*model.terms, *model.disturbances, *model.channel_terms)
    for term in terms:
        lines += ["", "[[effect]]", f"name = {json.dumps(term.name)}"]
        lines.append(_inline("parameters", by_parameter(term, term.values)))
        lines.append(_inline("sigma", by_parameter(term, term.sigmas)))
        if isinstance(term, Term) and term.variant.shape:
            lines.append(_inline("shape", term.variant.shape))
    if model.fitted_on:
        lines += ["", "[fitted_on]"]
        lines += [f"{json.dumps(run)} = {json.dumps(text)}" for run, text in model.fitted_on.items()]
    return "\n".join(lines) + "\n"


def _toml(value: Any) -> str:
    """Return a setting as TOML: a table inline."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{json.dumps(key)} = {_toml(own)}" for key, own in value.items()) + " }"
    return json.dumps(value)


def _inline(key: str, values: Mapping[str, float]) -> str:
    return f"{key} = {{ " + ", ".join(f"{name} = {float(value)!r}" for name, value in values.items()) + " }"
