"""Several units of a type at once: which missing effects are common to all, and which are one unit's own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal

from scipy.special import chdtrc

from bench.analysis.gap._candidates import effects_beside
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._diagnose import Diagnosis, diagnose
from bench.analysis.gap._model_file import Model, Term
from bench.record.shown import Shown
from drivers.base.errors import ConfigurationError

Alike = tuple[str, ...]
_ASTRAY = 1e-3
"""Probability that the diagnosis of one unit says nothing of it."""
_MOST_COMMON = 3
"""Most effects that all units have."""
_SURE = 0.8
"""Probability from which something is said, as in a diagnosis of one unit."""


@dataclass(frozen=True, repr=False)
class BatchEffect(Shown):
    """An effect that acts in at least one unit of a batch.

    `one_of` are the effects that the runs cannot tell apart, the most probable first. `in_all` is the probability
    that it acts in every unit, `by_unit` that it acts in each. `kind`: "common" to all, "own" of `units` with the
    others surely without it, "some" where that is not decided for all. `terms` are the fitted ones by unit, of
    those in whose own diagnosis it is named. `one_value` maps each parameter to the probability that values which
    are the same in all units come out so different (chi squared); empty for fewer than two terms, and for those
    of different effects. `unseen` has the units whose runs cannot show the effect, and why.
    """

    one_of: tuple[str, ...]
    in_all: float
    by_unit: Mapping[str, float]
    kind: Literal["common", "own", "some"]
    terms: Mapping[str, Term]
    one_value: Mapping[str, float]
    unseen: Mapping[str, str]

    @property
    def name(self) -> str:
        """The most probable of the effects that it may be."""
        return self.one_of[0]

    @property
    def units(self) -> tuple[str, ...]:
        """The units in which it surely acts."""
        return tuple(unit for unit, probability in self.by_unit.items() if probability >= _SURE)

    def shown(self) -> dict[str, object]:
        """Return what it is called, whose it is and how probable that is."""
        return {"effect": self.name, "kind": self.kind, "in all": self.in_all, "units": list(self.units)}


@dataclass(frozen=True, repr=False)
class Batch(Shown):
    """The diagnosis of every unit by itself, by its id, and the effects over all, the most probable first."""

    units: Mapping[str, Diagnosis]
    effects: tuple[BatchEffect, ...]

    def shown(self) -> dict[str, object]:
        """Return the verdict on every unit, and whose each effect is."""
        effects = {effect.name: f"{effect.kind}: {', '.join(effect.units)}" for effect in self.effects}
        return {**{unit: found.verdict for unit, found in self.units.items()}, **effects}


def diagnose_batch(runs: Sequence[GapRun], model: Model) -> Batch:
    """Diagnose runs of several units of one type against its nominal model: each by itself, then all at once.

    ConfigurationError for runs of fewer than two units.
    """
    by_unit: dict[str, list[GapRun]] = {}
    for run in runs:
        by_unit.setdefault(run.unit_id, []).append(run)
    if len(by_unit) < 2:
        raise ConfigurationError(
            "these are no runs of a batch",
            found=f"one unit, {next(iter(by_unit))}" if by_unit else "no run of a gyro",
            expected="runs of at least two units of one type, told apart by their serial numbers",
            remedy="`gyrobench gap diagnose` takes the runs of one unit",
        )
    return _compared(
        {unit: diagnose(each, model) for unit, each in by_unit.items()}, list(effects_beside(model))
    )


def _compared(units: Mapping[str, Diagnosis], catalogue: Sequence[str]) -> Batch:
    """Say of every effect that a diagnosis of a unit holds for possible whether it is the type's or the unit's.

    Every unit has the type's effects, and effects of its own. Each effect is as probable before the runs as the
    next, in either place; a unit's diagnosis counts by what it says for a set of effects over what was to be
    expected of it. Effects that a unit's runs cannot show are neither for nor against.
    """
    alike = _alike_in(units, catalogue)
    weights = {unit: _sets(found, alike) for unit, found in units.items()}
    hidden = {
        unit: frozenset(
            each for each in alike.values() if all(name in found.rate.unidentifiable for name in each)
        )
        for unit, found in units.items()
    }
    in_all, by_unit = _shared(weights, hidden, 0.5 / max(len(catalogue), 1))
    effects = [_effect(each, in_all[each], by_unit[each], units, hidden) for each in in_all]
    shown = [effect for effect in effects if max(effect.by_unit.values()) >= _SURE]
    return Batch(dict(units), tuple(sorted(shown, key=lambda effect: -sum(effect.by_unit.values()))))


def _alike_in(units: Mapping[str, Diagnosis], catalogue: Sequence[str]) -> dict[str, Alike]:
    """Return for each effect of the catalogue those that some unit's runs cannot tell from it, itself among them.

    Several units do not tell them apart either: what a formula misses of the real effect it misses in all.
    """
    alike = {name: {name} for name in catalogue}
    for found in units.values():
        for cause in found.rate.causes:
            joined = set().union(*(alike[name] for name in (cause.name, *cause.one_of)))
            for name in joined:
                alike[name] = joined
    return {name: tuple(sorted(each)) for name, each in alike.items()}


def _sets(found: Diagnosis, alike: Mapping[str, Alike]) -> dict[frozenset[Alike], float]:
    """Return the probability of each set of effects; curves for what is unknown are left out."""
    weights: dict[frozenset[Alike], float] = {}
    for names, probability in found.rate.set_probabilities.items():
        those = frozenset(alike[name] for name in names if name in alike)
        weights[those] = weights.get(those, 0.0) + probability
    return weights


def _effect(
    alike: Alike,
    in_all: float,
    by_unit: Mapping[str, float],
    units: Mapping[str, Diagnosis],
    hidden: Mapping[str, frozenset[Alike]],
) -> BatchEffect:
    causes = {
        unit: cause for unit, found in units.items() for cause in found.rate.causes if cause.name in alike
    }
    often = dict.fromkeys(alike, 0.0)
    for cause in causes.values():
        often[cause.name] += cause.probability
    one_of = tuple(sorted(alike, key=lambda name: -often[name]))
    unseen = {
        unit: found.rate.unidentifiable[one_of[0]] for unit, found in units.items() if alike in hidden[unit]
    }
    decided = all(max(each, 1.0 - each) >= _SURE for each in by_unit.values())
    kind: Literal["common", "own", "some"] = "own" if decided else "some"
    terms = {unit: cause.term for unit, cause in causes.items()}
    return BatchEffect(
        one_of, in_all, by_unit, "common" if in_all >= _SURE else kind, terms, _one_value(terms), unseen
    )


def _shared(
    weights: Mapping[str, Mapping[frozenset[Alike], float]],
    hidden: Mapping[str, frozenset[Alike]],
    one: float,
) -> tuple[dict[Alike, float], dict[Alike, dict[str, float]]]:
    """Return by effect the probability that it is in all units, and by effect and unit that it is in that one.

    `weights` are probabilities of sets of effects by unit, `hidden` effects that a unit cannot show, `one` is the
    prior odds of one effect.
    """
    names = frozenset[Alike]().union(*(each for sets in weights.values() for each in sets))
    common = {
        frozenset(some)
        for sets in weights.values()
        for each in sets
        for size in range(min(len(each), _MOST_COMMON) + 1)
        for some in combinations(sorted(each), size)
    }
    total = 0.0
    in_all = dict.fromkeys(names, 0.0)
    by_unit = {name: dict.fromkeys(weights, 0.0) for name in names}
    for type_has in common:
        evidence = one ** len(type_has)
        here: dict[str, dict[Alike, float]] = {}
        for unit, sets in weights.items():
            seen = type_has - hidden[unit]
            # of a set that has the type's effects the rest is the unit's own, as probable as before the runs
            possible = {each: value * one ** -len(seen) for each, value in sets.items() if seen <= each}
            sum_of = _ASTRAY + sum(possible.values())
            evidence *= sum_of
            here[unit] = {
                name: 1.0
                if name in type_has
                else sum(value for each, value in possible.items() if name in each) / sum_of
                for name in names
            }
        total += evidence
        for name in names:
            in_all[name] += evidence * math.prod(each[name] for each in here.values())
            for unit in weights:
                by_unit[name][unit] += evidence * here[unit][name]
    return (
        {name: value / total for name, value in in_all.items()},
        {name: {unit: value / total for unit, value in units.items()} for name, units in by_unit.items()},
    )


def _one_value(terms: Mapping[str, Term]) -> dict[str, float]:
    """Return for each parameter how probable so large a scatter between units is if they share its value."""
    if len(terms) < 2 or len({term.name for term in terms.values()}) > 1:
        return {}
    probabilities = {}
    for number, parameter in enumerate(next(iter(terms.values())).effect.parameters):
        weights = [term.sigmas[number] ** -2 for term in terms.values()]
        values = [term.values[number] for term in terms.values()]
        mean = sum(w * value for w, value in zip(weights, values, strict=True)) / sum(weights)
        scatter = sum(w * (value - mean) ** 2 for w, value in zip(weights, values, strict=True))
        probabilities[parameter.name] = float(chdtrc(len(values) - 1, scatter))
    return probabilities
