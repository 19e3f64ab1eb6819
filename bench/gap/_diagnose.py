"""The diagnosis: runs and a nominal model in, where, which and what is left out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from bench.gap._candidates import candidate_variants, candidates_of, possible_candidates
from bench.gap._cells import Cell, mixed_whitened
from bench.gap._data import GapRun
from bench.gap._evidence import SetPosterior, reduced, search
from bench.gap._fit import (
    MISFIT,
    Floor,
    Solution,
    energies,
    nominal_energies,
    solve,
    tolerated,
    weighted_gram,
)
from bench.gap._model_file import Model, Term
from bench.gap._noise import Noise
from bench.gap._prepare import Prepared, gathered, noise_beside, prepare
from bench.gap._stochastic import NoiseVerdict
from bench.gap._unknown import CREDIBLE, Remainder, credibility, remainder
from bench.gap._where import PhasePlace, Place, phase_map, places
from simulators.effects import Variant

Array = NDArray[np.float64]
AMBIGUOUS = 0.02
_UNKNOWN_PRIOR = 5.0
_SHOWN = 12.0
_LOST_FRACTION = 1e-4


@dataclass(frozen=True)
class Cause:
    """An effect that explains (part of) the gap, fitted; `alternatives` maps rivals to their probability."""

    name: str
    probability: float
    term: Term
    alternatives: Mapping[str, float]
    credibility: float
    meaning: str


@dataclass(frozen=True)
class Diagnosis:
    """Everything the diagnosis found; `model` is the nominal with corrected parameters, without the causes.

    `causes` are named; `resembles` are catalogue effects that fit part of what is called unknown.
    `unidentifiable` maps effects that these runs cannot show to the reason. `noise` is the floor;
    `stochastic` maps the noise effects named to their probability.
    """

    unit_id: str
    model: Model
    causes: tuple[Cause, ...]
    resembles: tuple[Cause, ...]
    unknown_probability: float
    null_probability: float
    set_probabilities: Mapping[frozenset[str], float]
    stochastic: Mapping[str, float]
    noise: NoiseVerdict
    floor: Floor
    places: tuple[Place, ...]
    phases: tuple[PhasePlace, ...]
    left_places: tuple[Place, ...]
    unidentifiable: Mapping[str, str]
    warnings: tuple[str, ...]
    run_checksums: Mapping[str, str]

    @property
    def verdict(self) -> str:
        """One of "no gap", "explained", "explained in part", "unknown"."""
        named = bool(self.causes or self.stochastic)
        if self.unknown_probability > 0.5:
            return "explained in part" if named else "unknown"
        return "explained" if named else "no gap"


def diagnose(runs: Sequence[GapRun], model: Model) -> Diagnosis:
    """Diagnose the gap between runs of one unit and its nominal model."""
    variants = candidate_variants(model)
    found = _found(prepare(runs, model, variants), model, variants)
    if found.best.members:
        # what an effect does differently in each repeat is no noise
        noise = noise_beside(found.data, found.best.solution, model)
        again = gathered(found.data.groups, found.data.stacks, noise, model, found.best.solution)
        found = _found(again, model, variants)
    return _reported(found, runs, model, variants)


@dataclass(frozen=True)
class _Judged:
    names: frozenset[str]
    members: frozenset[int]
    log_evidence: float
    solution: Solution
    left: Array
    rest: Remainder
    rival: float

    @property
    def log_total(self) -> float:
        """Log evidence of the set, with or without something unknown beside it, on one footing for all sets."""
        return float(np.logaddexp(self.log_evidence, self.log_evidence + self.rival - _UNKNOWN_PRIOR))

    @property
    def unknown(self) -> float:
        """Probability that something is missing beside this set."""
        return float(expit(self.rest.total - _UNKNOWN_PRIOR))


@dataclass(frozen=True)
class _Found:
    data: Prepared
    before: Array
    variance: Array
    posterior: SetPosterior
    judged: list[_Judged]
    best: _Judged
    hidden: dict[str, str]


def _found(data: Prepared, model: Model, variants: Sequence[Variant]) -> _Found:
    sigmas, cells = model.sigmas, data.cells
    before = nominal_energies(cells, sigmas)
    variance = tolerated(cells, before)
    gram = weighted_gram(cells, variance)
    system = reduced(gram, sigmas)
    candidates = candidates_of(variants)
    possible, hidden = possible_candidates(system, gram, candidates, variants, len(sigmas))
    posterior = search(system, candidates, possible)
    judged = _judge_sets(posterior, data, gram, variance, before, sigmas)
    best = max(judged, key=lambda each: each.log_total)
    return _Found(data, before, variance, posterior, judged, best, hidden)


def _reported(found: _Found, runs: Sequence[GapRun], model: Model, variants: Sequence[Variant]) -> Diagnosis:
    data, best, judged, cells = found.data, found.best, found.judged, found.data.cells
    causes, resembles = _causes(best, judged, found.posterior, variants, data, found.variance, model)
    weights = _normalised(judged)
    unknown = sum(both[1] for both in weights.values())
    stochastic = _stochastic(data.noise, runs) if unknown < 0.5 else {}
    return Diagnosis(
        runs[0].unit_id,
        _corrected(model, best.solution, data.noise.noise),
        causes,
        resembles,
        unknown,
        weights.get(frozenset(), (0.0, 0.0))[0],
        {names: both[0] + both[1] for names, both in weights.items() if sum(both) > 1e-4},
        stochastic,
        data.noise,
        data.floor,
        tuple(places(cells, found.before, data.floor)),
        tuple(_phases(data, cells, model.sigmas)),
        tuple(places(cells, best.left, data.floor)),
        found.hidden,
        _warnings(data),
        {run.run_id: run.checksum for run in runs},
    )


def _judge_sets(
    posterior: SetPosterior, data: Prepared, gram: Array, variance: Array, before: Array, sigmas: Array
) -> list[_Judged]:
    by_effects = posterior.by_effects()
    highest = max(by_effects.values())
    kept = [names for names, value in by_effects.items() if value > highest - _SHOWN or not names]
    kept = sorted(kept, key=lambda names: -by_effects[names])[:60]
    if frozenset() not in kept:
        kept.append(frozenset())
    strict = tolerated(data.cells, before, MISFIT)
    judged = []
    for names in kept:
        members = posterior.best_variant(names)
        columns = _columns(posterior, members, len(sigmas))
        solution = solve(gram, sigmas, columns)
        left = energies(data.cells, solution)
        rest = remainder(data.cells, strict, before, left, data.floor)
        rival = remainder(data.cells, variance, before, left, data.floor).total
        judged.append(_Judged(names, members, by_effects[names], solution, left, rest, rival))
    return judged


def _columns(posterior: SetPosterior, members: frozenset[int], q: int) -> list[int]:
    """Return places of a set's columns in the full Gram matrix; those in `system` count without the nominal."""
    return [column + q for each in sorted(members) for column in posterior.candidates[each].columns]


def _normalised(judged: Sequence[_Judged]) -> dict[frozenset[str], tuple[float, float]]:
    """Return the probability of each set being all there is, and of it with something unknown beside it."""
    highest = max(each.log_total for each in judged)
    raw = {each.names: (math.exp(each.log_total - highest), each.unknown) for each in judged}
    total = sum(weight for weight, _ in raw.values())
    return {names: (weight / total * (1 - odd), weight / total * odd) for names, (weight, odd) in raw.items()}


def _causes(
    best: _Judged,
    judged: Sequence[_Judged],
    posterior: SetPosterior,
    variants: Sequence[Variant],
    data: Prepared,
    variance: Array,
    model: Model,
) -> tuple[tuple[Cause, ...], tuple[Cause, ...]]:
    weights = _normalised(judged)
    q = len(model.sigmas)
    named: list[Cause] = []
    doubtful: list[Cause] = []
    for member in sorted(best.members):
        candidate = posterior.candidates[member]
        own = [column + q for column in candidate.columns]
        at = [int(np.flatnonzero(best.solution.indices == column)[0]) for column in own]
        values = best.solution.values[at]
        deviations = np.sqrt(np.diag(best.solution.covariance)[at])
        trust = credibility(data.cells, variance, best.solution, own, best.rest)
        cause = Cause(
            candidate.effect,
            sum(sum(both) for names, both in weights.items() if candidate.effect in names),
            Term(variants[member], tuple(values.tolist()), tuple(deviations.tolist())),
            _rivals(candidate.effect, best.names, weights),
            trust,
            variants[member].effect.meaning,
        )
        (doubtful if best.unknown > 0.5 and trust < CREDIBLE else named).append(cause)
    return tuple(named), tuple(doubtful)


def _rivals(
    name: str, names: frozenset[str], weights: Mapping[frozenset[str], tuple[float, float]]
) -> dict[str, float]:
    """Return what could stand in an effect's place, the others kept, with probability among those places."""
    others = names - {name}
    places_ = {
        next(iter(each - others)): sum(both)
        for each, both in weights.items()
        if others <= each and len(each) == len(names)
    }
    total = sum(places_.values())
    rivals = {rival: value / total for rival, value in places_.items() if rival != name}
    return {rival: value for rival, value in sorted(rivals.items(), key=lambda x: -x[1]) if value > AMBIGUOUS}


def _stochastic(verdict: NoiseVerdict, runs: Sequence[GapRun]) -> dict[str, float]:
    found = {verdict.named: verdict.probabilities[verdict.named]} if verdict.named else {}
    if max(run.lost_fraction for run in runs) > _LOST_FRACTION:
        found["lost_frames"] = 1.0
    return found


def _corrected(model: Model, solution: Solution, noise: Noise) -> Model:
    """Return the model with its parameters re-fitted beside the best set, and with the noise that was found."""
    terms, at = [], 0
    deviations = np.sqrt(np.diag(solution.covariance))
    for term in model.terms:
        k = len(term.values)
        values = tuple(float(v + d) for v, d in zip(term.values, solution.values[at : at + k], strict=True))
        terms.append(Term(term.variant, values, tuple(deviations[at : at + k].tolist())))
        at += k
    return Model(model.name, tuple(terms), noise, model.fitted_on)


def _phases(data: Prepared, cells: Sequence[Cell], sigmas: Array) -> list[PhasePlace]:
    solution = solve(weighted_gram(cells, np.ones(len(cells))), sigmas, ())
    residuals = []
    for group, stack in zip(data.groups, data.stacks, strict=True):
        own = stack[:, : 1 + len(sigmas)].astype(np.float64)
        left = own[:, :1] - np.tensordot(own[:, 1:], solution.values, axes=(1, 0))[:, None]
        residuals.append(mixed_whitened(group, left, data.noise.noise)[:, 0])
    return phase_map(data.groups, residuals, data.floor)


def _warnings(data: Prepared) -> tuple[str, ...]:
    notes = []
    if not data.floor.from_repeats:
        notes.append("no repeated runs: the noise floor rests on " + data.noise.source)
    if data.noise.source == "data sheet":
        notes.append("no repeats and no quiet run: a wrong data sheet would look like a gap")
    if all(np.ptp(run.stimulus.warm_k) < 2.0 for group in data.groups for each in group.runs for run in each):
        notes.append("temperature hardly changes in these runs: no effect of temperature can be seen")
    return tuple(notes)
