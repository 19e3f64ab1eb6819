"""Causes: the members of the best set as fitted effects, with probability and what could stand in their place."""

from __future__ import annotations

from collections.abc import Mapping, Sequence, Set
from dataclasses import dataclass, replace

import numpy as np

from bench.analysis.gap._evidence import SetPosterior
from bench.analysis.gap._fit import Solution
from bench.analysis.gap._generic import PREFIX, absorbed
from bench.analysis.gap._model_file import Model, Term
from bench.analysis.gap._prepare import Prepared
from bench.analysis.gap._unknown import CREDIBLE, credibility
from bench.analysis.gap._which import Judged, set_weights
from drivers.base.arrays import Array
from simulators.effects import Variant

AMBIGUOUS = 0.02
_MIMICRY = 0.05
"""Probability that what looks like an effect only resembles it: 26 of 388 sure claims of the exams before."""
_SURE = 0.8
"""Probability that a cause beside something unknown needs: the unknown often resembles several effects a bit.

Where a free curve stands for the unknown it is that of the cause or of what may stand in its place.
"""


@dataclass(frozen=True)
class Cause:
    """An effect that explains (part of) the gap, fitted; `alternatives` maps rivals to their probability.

    `rivals` are the alternatives fitted in its place.
    """

    name: str
    probability: float
    term: Term
    alternatives: Mapping[str, float]
    credibility: float
    meaning: str
    rivals: Mapping[str, Term]


def causes_of(
    best: Judged,
    judged: Sequence[Judged],
    posterior: SetPosterior,
    variants: Sequence[Variant],
    data: Prepared,
    variance: Array,
    model: Model,
) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    weights = set_weights(judged)
    q = len(model.sigmas)
    unknown = sum(both[1] for both in weights.values())
    curves = [
        variants[each].effect for each in best.members if posterior.candidates[each].effect.startswith(PREFIX)
    ]
    named: list[Cause] = []
    doubtful: list[Cause] = []
    for member in sorted(best.members):
        candidate = posterior.candidates[member]
        if candidate.effect.startswith(PREFIX):
            continue
        own = [column + q for column in candidate.columns]
        alternatives = _rivals(candidate.effect, best.names, weights)
        trust = credibility(data.cells, variance, best.solution, own, best.rest)
        cause = Cause(
            candidate.effect,
            sum(sum(both) for names, both in weights.items() if candidate.effect in names),
            _fitted(member, best.solution, posterior, variants, q),
            alternatives,
            trust,
            variants[member].effect.meaning,
            _fitted_rivals(candidate.effect, alternatives, best, judged, posterior, variants, q),
        )
        # a curve in the set competes for the effect's place; what nothing in the set describes does not
        place = cause.probability
        if best.curved and not best.remains:
            place = _of_any(weights, {candidate.effect, *alternatives})
        doubt = unknown > 0.5 and (trust < CREDIBLE or place < _SURE)
        stated = replace(cause, probability=(1.0 - _MIMICRY) * cause.probability)
        if doubt or absorbed(variants[member].effect, curves):
            # fitted beside a curve it would not stand alone
            alone = _fitted(member, best.without_curves, posterior, variants, q)
            doubtful.append(replace(stated, term=alone))
        else:
            named.append(stated)
    return tuple(named), tuple(doubtful)


def _of_any(weights: Mapping[frozenset[str], tuple[float, float]], names: Set[str]) -> float:
    """Return the probability that at least one of some effects acts."""
    return sum(sum(both) for own, both in weights.items() if own & names)


def _fitted(
    member: int, solution: Solution, posterior: SetPosterior, variants: Sequence[Variant], q: int
) -> Term:
    """Return a member of a judged set as a term with its values in a solution."""
    columns = [column + q for column in posterior.candidates[member].columns]
    at = [int(np.flatnonzero(solution.indices == column)[0]) for column in columns]
    deviations = np.sqrt(np.diag(solution.covariance)[at])
    return Term(variants[member], tuple(solution.values[at].tolist()), tuple(deviations.tolist()))


def _fitted_rivals(
    name: str,
    rivals: Mapping[str, float],
    best: Judged,
    judged: Sequence[Judged],
    posterior: SetPosterior,
    variants: Sequence[Variant],
    q: int,
) -> dict[str, Term]:
    """Return the alternatives to an effect, each fitted in its place."""
    terms = {}
    for rival in rivals:
        wanted = (best.names - {name}) | {rival}
        instead = next(each for each in judged if each.names == wanted)
        member = next(each for each in instead.members if posterior.candidates[each].effect == rival)
        terms[rival] = _fitted(member, instead.solution, posterior, variants, q)
    return terms


def _rivals(
    name: str, names: frozenset[str], weights: Mapping[frozenset[str], tuple[float, float]]
) -> dict[str, float]:
    """Return what could stand in an effect's place, the others kept, with probability among those places."""
    others = names - {name}
    places_ = {
        next(iter(each - others)): sum(both)
        for each, both in weights.items()
        if others <= each and len(each) == len(names) and not next(iter(each - others)).startswith(PREFIX)
    }
    total = sum(places_.values())
    rivals = {rival: value / total for rival, value in places_.items() if rival != name}
    return {rival: value for rival, value in sorted(rivals.items(), key=lambda x: -x[1]) if value > AMBIGUOUS}
