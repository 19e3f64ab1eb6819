"""Which run next makes parameters known best: the uncertainty to expect after each run that a bench could make.

With prior sigmas s and the whitened columns X of the effects, what the nominal model can imitate taken out, the
covariance C of k parameters is (diag(s)^-2 + sum of X' X over the runs)^-1. Runs are compared by det(C)^(1/k),
the mean variance as D-optimal designs have it (Kiefer and Wolfowitz, Can. J. Math. 12, 1960), times the hours:
repeats of a run lower the variance as their number.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.analysis.gap._candidates import effects_beside
from bench.analysis.gap._columns import Columns, usual_variant
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._designs import Design
from bench.analysis.gap._heat import heat_of
from bench.analysis.gap._model_file import Model
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects import Parameter, Variant


@dataclass(frozen=True)
class ForetoldSigmas:
    """How well parameters are known: `sigmas` by "effect.parameter", each in its unit; `units` likewise.

    After a run of `design`; None before any. `hours`: of so many repeats of it as make them known as well as the
    best single run does.
    """

    design: Design | None
    sigmas: Mapping[str, float]
    units: Mapping[str, str]
    hours: float = math.nan


def foretell(
    model: Model, names: Sequence[str], recorded: Sequence[GapRun], designs: Sequence[Design]
) -> list[ForetoldSigmas]:
    """Return how well the parameters of some effects are known, then the runs, those that take least hours first.

    An effect of the model is known as well as the model says, another as its bounds; `recorded` are runs that
    the model was not fitted to. ConfigurationError for no effect, and for one that the catalogue has not.
    """
    variants, prior = _asked(model, names)
    rest = replace(model, terms=tuple(term for term in model.terms if term.name not in names))
    columns = Columns(rest, variants)
    own = [columns.usual(name) for name in names]
    wanted = np.concatenate([np.arange(part.start, part.stop) for part in own])
    parameters = [(name, p) for name in names for p in variants[name].effect.parameters]
    scale = np.array([prior[name][at] for name in names for at in range(len(prior[name]))])
    scales = np.outer(scale, scale)

    def told(runs: Sequence[GapRun]) -> Array:
        return np.asarray(columns.gram(runs)[np.ix_(wanted, wanted)] * scales)

    known = np.eye(len(scale)) + (told(recorded) if recorded else np.zeros_like(scales))
    heat = heat_of(recorded)
    then = [
        known + told(design.runs() if heat is None else [heat.on(run) for run in design.runs()])
        for design in designs
    ]
    volumes = [float(np.linalg.slogdet(each)[1]) / len(scale) for each in then]
    best = max(volumes, default=0.0)
    hours = [design.hours * math.exp(best - own) for design, own in zip(designs, volumes, strict=True)]
    after = [
        _of_information(design, information, scale, parameters, needed)
        for design, information, needed in zip(designs, then, hours, strict=True)
    ]
    after.sort(key=lambda each: each.hours)
    return [_of_information(None, known, scale, parameters, math.nan), *after]


def _asked(model: Model, names: Sequence[str]) -> tuple[dict[str, Variant], dict[str, tuple[float, ...]]]:
    """Return the form of each effect, and the sigmas of its parameters before the runs."""
    inside = {term.name: term for term in model.terms}
    beside = effects_beside(model)
    unknown = [name for name in names if name not in inside and name not in beside]
    if unknown or not names:
        raise ConfigurationError(
            "no such effect" if unknown else "no effect whose parameters should be known better",
            found=", ".join(unknown) or "none",
            expected="effects of the model or of the catalogue: " + ", ".join(sorted({*inside, *beside})),
        )
    variants, prior = {}, {}
    for name in names:
        if name in inside:
            variants[name], prior[name] = inside[name].variant, inside[name].sigmas
            continue
        variants[name] = usual_variant(beside[name])
        bounds = [p.bounds(model.noise.coarseness) for p in beside[name].parameters]
        prior[name] = tuple(max(abs(low), abs(high)) for low, high in bounds)
    return variants, prior


def _of_information(
    design: Design | None,
    information: Array,
    scale: Array,
    parameters: Sequence[tuple[str, Parameter]],
    hours: float,
) -> ForetoldSigmas:
    sigmas = scale * np.sqrt(np.diag(np.linalg.inv(information)))
    keys = [f"{name}.{parameter.name}" for name, parameter in parameters]
    units = {key: parameter.unit.symbol for key, (_, parameter) in zip(keys, parameters, strict=True)}
    return ForetoldSigmas(design, dict(zip(keys, sigmas.tolist(), strict=True)), units, hours)
