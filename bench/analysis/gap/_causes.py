"""Causes: the members of the best set as fitted effects, with probability and what could stand in their place."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence, Set
from dataclasses import replace

import numpy as np
from scipy.special import expit

from bench.analysis.gap._data import GapRun
from bench.analysis.gap._findings import Cause, rivals_of
from bench.analysis.gap._fit import Solution, beside_nominal, weighted_gram
from bench.analysis.gap._generic import absorbed
from bench.analysis.gap._judged import same_driver
from bench.analysis.gap._model_file import Model, Term
from bench.analysis.gap._unknown import CREDIBLE, PREVALENT, credibility, prevalence
from bench.analysis.gap._which import Found, set_weights
from drivers.base.arrays import Array
from simulators.effects import Input, Variant

_GENUINE = np.array([1.1, 1.7, -0.9, -0.5])
"""Log odds that what looks like an effect is one: at ten standard deviations with a hundredth left where it acts;
for e times as many; for ten times as much left; beside something unknown. Fitted to 662 claims of the exams."""
_FEWEST_SIGMAS, _MOST_SIGMAS, _LEAST_LEFT = 3.0, 20.0, 1e-3
"""Standard deviations, and the part left, beyond which those claims are no more and no less often true."""
_LEAST_GENUINE = 0.5
"""Probability below which a cause beside something unknown only resembles one."""
_SURE = 0.8
"""Probability that a cause beside something unknown needs: the unknown often resembles several effects a bit.

Where a free curve stands for the unknown it is that of the cause or of what may stand in its place.
"""

_EXPONENTIAL, _ALIKE = 0.97, 2.0
"""Least stretch of what settles, and ratio of its time constant and a lag, that are a body's own start."""
_CROWD = 3
"""Mechanisms that follow the rate from which on it is a function of rate that has no name in the catalogue."""
_FEW = 2
"""Effects that may share a name beside something unknown that nothing describes."""
_LEAST_NAMED = 0.8
"""Probability that one of a set acts, below which nothing is named."""
_MOST_ALIKE = 4
"""Effects of a set that is named as one cause: where more could stand in a place, none is."""
_AT_REST = 0.1
"""Part of a code by which a cause may turn the output while the table rests: of the samples beside its moves."""
_SEVERAL = 3
"""Motions, each of another profile or condition, whose codes do not all make the same wave over the angle.

Counted are those in which a cause turns the output by half of the most that it does, or more.
"""
_SURE_SET = 0.9
"""Probability from which an effect, or a set of those that these runs cannot tell apart, is left as it is."""


def within_codes(causes: Sequence[Cause[Term]], runs: Sequence[GapRun]) -> tuple[Cause[Term], ...]:
    """Return the causes that turn the output by less than a code of the table's angle, where that is read.

    Codes are no noise: a table that stands at the edge of one is off by half of it in a move, as a late gyro is.
    Where it rests an angle in codes says as much as any, and what a cause does there is its own. What follows the
    table's angle comes again with each turn, codes with each code: of several motions they do not make the same.
    """
    step_arcsec = max((run.code_arcsec for run in runs), default=0.0)
    return tuple(cause for cause in causes if _within(cause, runs, step_arcsec))


def _within(cause: Cause[Term], runs: Sequence[GapRun], step_arcsec: float) -> bool:
    moving = [_turned(cause, run, at_rest=False) for run in runs]
    if not 0.0 < max(moving) < step_arcsec:
        return False
    if max(_turned(cause, run, at_rest=True) for run in runs) >= _AT_REST * step_arcsec:
        return False
    motions = {
        (run.profile, run.condition) for run, by in zip(runs, moving, strict=True) if by >= 0.5 * max(moving)
    }
    return not cause.term.effect.inputs & Input.TURN or len(motions) < _SEVERAL


def _turned(cause: Cause[Term], run: GapRun, *, at_rest: bool) -> float:
    """Return by how much a cause turns a run back and forth, arcsec: deg/h times s, in a part of its samples."""
    own = run.reads_codes != at_rest
    if not own.any():
        return 0.0
    added = [np.asarray(term.values) @ term.variant.columns(run.stimulus) for term in cause.terms]
    dph = np.sum(added, axis=0)[own]
    # a rate of the whole run is its bias, which is nobody's
    return float(np.ptp(np.cumsum(dph if at_rest else dph - np.mean(dph)))) * run.stimulus.period_s


def causes_of(
    found: Found, variants: Sequence[Variant], model: Model
) -> tuple[tuple[Cause[Term], ...], tuple[Cause[Term], ...]]:
    """Return the best set's effects as causes, and those that only resemble a part of something unknown."""
    best, posterior = found.best, found.posterior
    weights = set_weights(found.judged)
    q, gram = len(model.sigmas), weighted_gram(found.data.cells, found.variance)
    unknown = sum(both[1] for both in weights.values())
    curves = [variants[each].effect for each in best.members if posterior.candidates[each].curve]
    named: list[Cause[Term]] = []
    does: dict[str, float] = {}
    real: dict[str, float] = {}
    doubtful: list[Cause[Term]] = []
    for member in sorted(best.members):
        candidate = posterior.candidates[member]
        if candidate.curve:
            continue
        own = [column + q for column in candidate.columns]
        alternatives = _rivals(candidate.effect, best.names, weights, posterior.curves)
        trust = credibility(found.data.cells, found.variance, best.solution, own, best.rest)
        cause = Cause(
            candidate.effect,
            variants[member].effect.meaning,
            sum(sum(both) for names, both in weights.items() if candidate.effect in names),
            _fitted(member, best.solution, found, variants, q),
            alternatives,
            {rival: _instead(candidate.effect, rival, found, variants, q) for rival in alternatives},
            trust,
        )
        one_of = _one_of(candidate.effect, alternatives, weights)
        real[candidate.effect] = _genuine(cause.term, trust, unknown)
        # a curve in the set competes for the effect's place; what nothing in the set describes does not
        place = _of_any(weights, set(one_of[:_FEW]))
        if best.curved and not best.remains:
            place = _of_any(weights, {candidate.effect, *alternatives})
        stated = replace(
            cause,
            probability=real[candidate.effect] * cause.probability,
            one_of=one_of,
            set_probability=real[candidate.effect] * _of_any(weights, set(one_of)),
        )
        acting = beside_nominal(gram, model.sigmas, best.solution, own)
        does[candidate.effect] = _energy(acting, gram)
        common = prevalence(found.data.cells, found.before, acting, best.rest)
        doubt = unknown > 0.5 and (trust < CREDIBLE or common < PREVALENT or place < _SURE)
        doubt |= unknown > 0.5 and stated.set_probability < _LEAST_GENUINE
        doubt |= not _nameable(one_of, weights)
        if doubt or absorbed(variants[member].effect, curves):
            # fitted beside a curve it would not stand alone
            alone = _fitted(member, best.without_curves, found, variants, q)
            doubtful.append(replace(stated, term=alone))
        else:
            named.append(stated)
    return _mechanisms(named, weights, does, real), tuple(doubtful)


def crowded(causes: Sequence[Cause[Term]], resembling: Sequence[Cause[Term]]) -> list[Cause[Term]]:
    """Return the causes that follow rate alone where, with those `resembling`, they only draw a curve together.

    Two real effects of the rate happen. Three formulas of it are what a series needs to draw a function that none
    of them is: an edge at one rate of one sense, a resonance.
    """
    own = [cause for cause in causes if follows_rate(cause)]
    return own if own and len(own) + sum(map(follows_rate, resembling)) >= _CROWD else []


def follows_rate(cause: Cause[Term]) -> bool:
    """Return whether a cause is a function of the rate, of the input or of the table, and of nothing else."""
    inputs = cause.term.variant.effect.inputs
    return bool(inputs) and not inputs & ~(Input.RATE | Input.TABLE_RATE)


def _energy(solution: Solution, gram: Array) -> float:
    """Return the weighted energy of what a solution's columns do."""
    return float(solution.values @ gram[np.ix_(solution.indices, solution.indices)] @ solution.values)


def _mechanisms(
    causes: Sequence[Cause[Term]],
    weights: Mapping[frozenset[str], tuple[float, float]],
    does: Mapping[str, float],
    real: Mapping[str, float],
) -> tuple[Cause[Term], ...]:
    """Return causes with those of one driver as one, the strongest, which has the others' terms as its form.

    `does` is the energy that each takes away: the named one's probability is the part that it has of it. Two
    effects that both follow the rate of temperature change, or both are even in the rate, draw together what
    neither formula has alone: one mechanism of another form is likelier than two. What could stand in a form's
    place is in the set, by name only. What settles with the lag of something late is the start of its body.
    """
    made: list[Cause[Term]] = []
    starts = {each.name for each in causes if any(_starts(each.term, late.term) for late in causes)}
    for cause in sorted(causes, key=lambda each: (each.name in starts, -does[each.name])):
        for place, main in enumerate(made):
            if _starts(cause.term, main.term):
                made[place] = replace(main, form=(*main.form, cause.term))
                break
            one_of = tuple(dict.fromkeys((*main.one_of, *cause.one_of)))
            effects = [each.term.variant.effect for each in (main, cause)]
            if len(one_of) <= _MOST_ALIKE and same_driver(*effects):
                form = (*main.form, cause.term)
                part = does[main.name] / sum(does[term.name] for term in (main.term, *form))
                one_acts = real[main.name] * _of_any(weights, set(one_of))
                made[place] = replace(
                    main,
                    probability=min(main.probability, part * one_acts),
                    one_of=one_of,
                    set_probability=one_acts,
                    form=form,
                )
                break
        else:
            made.append(cause)
    order = [cause.name for cause in causes]
    return tuple(sorted(made, key=lambda cause: order.index(cause.name)))


def _genuine(term: Term, trust: float, unknown: float) -> float:
    """Return the probability that what looks like an effect is one, and does not only resemble it.

    `trust` is the part of the gap that is explained where it acts, `unknown` the probability of something unknown
    beside it. The standard deviations count what formulas of the other effects may miss.
    """
    sigmas = max(
        abs(value) / max(sigma, 1e-300) for value, sigma in zip(term.values, term.sigmas, strict=True)
    )
    return float(expit(_GENUINE @ evidence(sigmas, 1.0 - trust, unknown=unknown > 0.5)))


def evidence(sigmas: float, left: float, *, unknown: bool) -> Array:
    """Return what the log odds of a claim are linear in: constant, size, part left, something unknown; (4,)."""
    size = math.log(min(max(sigmas, _FEWEST_SIGMAS), _MOST_SIGMAS) / 10.0)
    return np.array([1.0, size, math.log10(max(left, _LEAST_LEFT) / 0.01), float(unknown)])


def _starts(own: Term, late: Term) -> bool:
    """Return whether one effect is how the body of another starts, which is late by a lag.

    A first-order follower takes its first temperature for settled. A body that warms itself, or starts elsewhere
    than its thermometer, comes there exponentially, with that very lag.
    """
    time_s, lag_s = own.variant.shape.get("time_constant_s", 0.0), late.variant.shape.get("lag_s", 0.0)
    if own.effect.unit != late.effect.unit or own.variant.shape.get("stretch", 1.0) < _EXPONENTIAL:
        return False
    return time_s > 0.0 and lag_s / _ALIKE <= time_s <= lag_s * _ALIKE


def models_with_and_without(
    found: Found, variants: Sequence[Variant], model: Model, gone: Sequence[Set[str]], among: Set[str]
) -> list[Model]:
    """Return the nominal model with those of the best set that are `among`, then without each lot of `gone` ones.

    Effects and curves have the values of the best set, the nominal parameters are fitted again beside each.
    """
    posterior, best, q = found.posterior, found.best, len(model.sigmas)
    terms = {
        posterior.candidates[member].effect: _fitted(member, best.solution, found, variants, q)
        for member in sorted(best.members)
        if posterior.candidates[member].effect in among
    }
    models = []
    for names in (frozenset[str](), *gone):
        kept = {name: term for name, term in terms.items() if name not in names}
        moved = model.moved(nominal_beside(found, model, kept.keys()), model.sigmas)
        models.append(replace(moved, terms=(*moved.terms, *kept.values()), noise=found.data.noise.noise))
    return models


def nominal_beside(found: Found, model: Model, names: Set[str]) -> Array:
    """Return the nominal parameters' corrections (q,) beside some effects of the best set, the others left out.

    What a curve of the scale factor took of it, the nominal scale factor has where the curve is not there.
    """
    posterior, solution, q = found.posterior, found.best.solution, len(model.sigmas)
    if not q or names == found.best.names:
        return solution.values[:q]
    own = [
        column + q
        for member in found.best.members
        if posterior.candidates[member].effect in names
        for column in posterior.candidates[member].columns
    ]
    gram = weighted_gram(found.data.cells, found.variance)
    taken = np.where(np.isin(solution.indices, own), solution.values, 0.0)[q:]
    nominal, others = np.arange(1, 1 + q), solution.indices[q:]
    normal = gram[np.ix_(nominal, nominal)] + np.diag(1.0 / model.sigmas**2)
    return np.asarray(np.linalg.solve(normal, gram[nominal, 0] - gram[np.ix_(nominal, others)] @ taken))


def _one_of(
    name: str,
    alternatives: Mapping[str, float],
    weights: Mapping[frozenset[str], tuple[float, float]],
) -> tuple[str, ...]:
    """Return an effect alone if it is sure, else with its likeliest alternatives until one surely acts."""
    names = [name]
    for other in alternatives:
        if _of_any(weights, set(names)) >= _SURE_SET:
            break
        names.append(other)
    return tuple(names)


def _nameable(one_of: Sequence[str], weights: Mapping[frozenset[str], tuple[float, float]]) -> bool:
    """Return whether effects of which one acts are few enough, and probable enough, to be named as a cause."""
    return len(one_of) <= _MOST_ALIKE and _of_any(weights, set(one_of)) >= _LEAST_NAMED


def _of_any(weights: Mapping[frozenset[str], tuple[float, float]], names: Set[str]) -> float:
    """Return the probability that at least one of some effects acts."""
    return sum(sum(both) for own, both in weights.items() if own & names)


def _fitted(member: int, solution: Solution, found: Found, variants: Sequence[Variant], q: int) -> Term:
    """Return a member of a judged set as a term with its values in a solution.

    Of a parameter that the runs do not bound no more is known than its bounds: it is as near to nothing as the
    others allow.
    """
    columns = [column + q for column in found.posterior.candidates[member].columns]
    at = [int(np.flatnonzero(solution.indices == column)[0]) for column in columns]
    values, covariance = solution.values[at], solution.covariance[np.ix_(at, at)]
    coarseness = found.data.noise.noise.coarseness
    both = [parameter.bounds(coarseness) for parameter in variants[member].effect.parameters]
    spans = np.array([high - low for low, high in both])
    hidden = np.sqrt(np.diag(covariance)) >= spans
    if hidden.any():
        gain = np.linalg.solve(covariance + np.diag(spans**2), np.diag(spans**2)).T
        values, covariance = gain @ values, gain @ covariance
    deviations = np.where(hidden, spans, np.sqrt(np.diag(covariance)))
    return Term(variants[member], tuple(values.tolist()), tuple(deviations.tolist()))


def _instead(name: str, rival: str, found: Found, variants: Sequence[Variant], q: int) -> Term:
    """Return a rival fitted in an effect's place."""
    wanted = (found.best.names - {name}) | {rival}
    judged = next(each for each in found.judged if each.names == wanted)
    member = next(each for each in judged.members if variants[each].effect.name == rival)
    return _fitted(member, judged.solution, found, variants, q)


def _rivals(
    name: str,
    names: frozenset[str],
    weights: Mapping[frozenset[str], tuple[float, float]],
    curves: frozenset[str],
) -> dict[str, float]:
    """Return what could stand in an effect's place, the most probable first; free curves do not count."""
    others = names - {name}
    known = {each: sum(both) for each, both in weights.items() if not (each - others) & curves}
    return dict(sorted(rivals_of(name, names, known).items(), key=lambda each: -each[1]))
