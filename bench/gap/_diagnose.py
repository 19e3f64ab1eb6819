"""The diagnosis: runs and a nominal model in, where, which and what is left out."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from bench.gap._align import aligned
from bench.gap._candidates import candidate_variants, candidates_of, possible_candidates
from bench.gap._cells import BANDS, mixing
from bench.gap._data import GapRun, Group, check_runs
from bench.gap._describe import UnknownPart, curve_part, line_part, remaining_part
from bench.gap._evidence import SetPosterior, reduced, search
from bench.gap._fit import (
    DIRECTIONS,
    MISFIT,
    Floor,
    Solution,
    energies,
    nominal_energies,
    solve,
    tolerated,
    weighted_gram,
)
from bench.gap._generic import PREFIX, absorbed
from bench.gap._lines import SpectralLine, strongest_line
from bench.gap._model_file import Model, Term
from bench.gap._noise import Noise, spectrum
from bench.gap._prepare import Prepared, gathered, narrowed, noise_beside, prepare
from bench.gap._refine import best_of_each, between_grid_points, members_of_note
from bench.gap._stochastic import NoiseVerdict
from bench.gap._unknown import CREDIBLE, Remainder, credibility, remainder
from bench.gap._where import SIGNIFICANT, PhasePlace, Place, RegimePlace, phase_map, places, regime_map
from simulators.effects import Variant

Array = NDArray[np.float64]
AMBIGUOUS = 0.02
_UNKNOWN_PRIOR = 5.0
_SHOWN = 12.0
_LONG_S = 3600.0
_LOST_FRACTION = 1e-4


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
    regimes: tuple[RegimePlace, ...]
    left_places: tuple[Place, ...]
    unidentifiable: Mapping[str, str]
    warnings: tuple[str, ...]
    run_checksums: Mapping[str, str]
    unknown_parts: tuple[UnknownPart, ...]
    constant: bool

    @property
    def verdict(self) -> str:
        """One of "no gap", "explained", "explained in part", "unknown", "nothing to identify"."""
        named = bool(self.causes or self.stochastic)
        if self.constant and not named:
            return "nothing to identify"
        if self.unknown_probability > 0.5:
            return "explained in part" if named else "unknown"
        return "explained" if named else "no gap"


def diagnose(runs: Sequence[GapRun], model: Model) -> Diagnosis:
    """Diagnose the gap between runs of one unit and its nominal model."""
    check_runs(runs)
    runs, notes = aligned(runs)
    variants = candidate_variants(model, runs)
    found = _found(prepare(runs, model, variants), model, variants)
    if found.best.members:
        variants, again = _second_look(found, model, variants)
        found = _found(again, model, variants, found.hidden)
    return _reported(found, runs, model, variants, notes)


def _second_look(found: _Found, model: Model, variants: Sequence[Variant]) -> tuple[list[Variant], Prepared]:
    """Return the variants and data again: noise beside the best set, its effects between the grid's points."""
    # what an effect does differently in each repeat is no noise
    noise = noise_beside(found.data, found.best.solution, model)
    posterior = found.posterior
    known = [each for each in found.judged if not each.curved]
    closest = max(known, key=lambda each: each.log_evidence)
    kept = best_of_each(posterior)
    note = members_of_note(posterior, (found.best.members, closest.members))
    fresh = between_grid_points([variants[each] for each in note])
    few, data = narrowed(found.data, model, variants, kept, fresh)
    taken = Solution(*_renumbered(found, kept, len(model.sigmas)))
    return few, gathered(data.groups, data.stacks, noise, model, taken)


def _renumbered(found: _Found, kept: Sequence[int], q: int) -> tuple[NDArray[np.int64], Array, Array]:
    """Return the best solution with its columns at their places among those kept."""
    solution = found.best.solution
    columns = [column + q for each in kept for column in found.posterior.candidates[each].columns]
    places_ = {column: 1 + q + index for index, column in enumerate(columns)}
    indices = np.array([places_.get(int(each), int(each)) for each in solution.indices], dtype=np.int64)
    return indices, solution.values, solution.covariance


@dataclass(frozen=True)
class _Judged:
    names: frozenset[str]
    members: frozenset[int]
    log_evidence: float
    solution: Solution
    left: Array
    rest: Remainder
    line: float = 0.0

    @property
    def curved(self) -> bool:
        """Whether a free curve is a member."""
        return any(name.startswith(PREFIX) for name in self.names)

    @property
    def unknown(self) -> float:
        """Probability that something is missing beside the effects of this set."""
        if self.curved:
            return 1.0
        return float(expit(self.rest.total + self.line - _UNKNOWN_PRIOR))


@dataclass(frozen=True)
class _Found:
    data: Prepared
    before: Array
    variance: Array
    posterior: SetPosterior
    judged: list[_Judged]
    best: _Judged
    hidden: dict[str, str]
    line: SpectralLine | None


def _found(
    data: Prepared, model: Model, variants: Sequence[Variant], hidden: dict[str, str] | None = None
) -> _Found:
    sigmas, cells = model.sigmas, data.cells
    before = nominal_energies(cells, sigmas)
    variance = tolerated(cells, before)
    gram = weighted_gram(cells, tolerated(cells, before, directions=DIRECTIONS))
    system = reduced(gram, sigmas)
    candidates = candidates_of(variants)
    possible, reasons = possible_candidates(system, gram, candidates, variants, len(sigmas))
    posterior = search(system, candidates, possible)
    judged = _judge_sets(posterior, data, gram, before, sigmas)
    best = max(judged, key=lambda each: each.log_evidence)
    gaps = dict.fromkeys((cell.profile for cell in cells), 0.0)
    for cell, own in zip(cells, before, strict=True):
        gaps[cell.profile] += max(own - cell.count, 0.0) if cell.repeatable else 0.0
    line = strongest_line(data.groups, _residuals(data, best.solution), data.noise.noise, gaps)
    turning = any("a turn" in variants[each].effect.follows for each in best.members)
    if line is not None and not (line.harmonic and turning):
        # harmonics of a ripple that is named already are its waveform, no effect of their own
        judged = [replace(each, line=line.log_evidence) for each in judged]
        best = replace(best, line=line.log_evidence)
    return _Found(
        data, before, variance, posterior, judged, best, reasons if hidden is None else hidden, line
    )


def _reported(
    found: _Found, runs: Sequence[GapRun], model: Model, variants: Sequence[Variant], notes: Sequence[str]
) -> Diagnosis:
    data, best, judged, cells = found.data, found.best, found.judged, found.data.cells
    causes, resembles = _causes(best, judged, found.posterior, variants, data, found.variance, model)
    weights = _normalised(judged)
    unknown = sum(both[1] for both in weights.values())
    stochastic = _stochastic(data.noise, runs) if unknown < 0.5 else {}
    where = places(cells, found.before, data.floor)
    active: dict[str, set[int]] = {}
    for place in where:
        if place.p_value < SIGNIFICANT:
            active.setdefault(place.profile, set()).add(BANDS.index(place.band))
    left_places = places(cells, best.left, data.floor)
    noise = data.noise.noise
    nominal = _residuals(data, solve(weighted_gram(cells, np.ones(len(cells))), model.sigmas, ()))
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
        tuple(where),
        tuple(phase_map(data.groups, _mixed(data.groups, nominal), data.floor, noise)),
        tuple(regime_map(data.groups, nominal, data.floor, noise, active)),
        tuple(left_places),
        found.hidden,
        (*notes, *_warnings(data)),
        {run.run_id: run.checksum for run in runs},
        tuple(_unknown_parts(found, variants, left_places, active)) if unknown > 0.5 else (),
        _constant(runs),
    )


def _judge_sets(
    posterior: SetPosterior, data: Prepared, gram: Array, before: Array, sigmas: Array
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
        judged.append(_Judged(names, members, by_effects[names], solution, left, rest))
    return _curves_that_matter(judged, before)


def _curves_that_matter(judged: Sequence[_Judged], before: Array) -> list[_Judged]:
    """Return the sets less those whose free curves take away no more than a formula's misfit would leave."""
    known = [each for each in judged if not each.curved]
    closest = max(known, key=lambda each: each.log_evidence)
    left = float(closest.left.sum())
    misfit = MISFIT**2 * (float(before.sum()) - left)
    return [*known, *(each for each in judged if each.curved and left - float(each.left.sum()) > misfit)]


def _columns(posterior: SetPosterior, members: frozenset[int], q: int) -> list[int]:
    """Return places of a set's columns in the full Gram matrix; those in `system` count without the nominal."""
    return [column + q for each in sorted(members) for column in posterior.candidates[each].columns]


def _normalised(judged: Sequence[_Judged]) -> dict[frozenset[str], tuple[float, float]]:
    """Return the probability of each set being all there is, and of it with something unknown beside it."""
    highest = max(each.log_evidence for each in judged)
    raw = {each.names: (math.exp(each.log_evidence - highest), each.unknown) for each in judged}
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
            _fitted(member, best, posterior, variants, q),
            alternatives,
            trust,
            variants[member].effect.meaning,
            _fitted_rivals(candidate.effect, alternatives, best, judged, posterior, variants, q),
        )
        doubt = best.unknown > 0.5 and trust < CREDIBLE
        (doubtful if doubt or absorbed(variants[member].effect, curves) else named).append(cause)
    return tuple(named), tuple(doubtful)


def _fitted(
    member: int, judged: _Judged, posterior: SetPosterior, variants: Sequence[Variant], q: int
) -> Term:
    """Return a member of a judged set as a term with its fitted values."""
    columns = [column + q for column in posterior.candidates[member].columns]
    at = [int(np.flatnonzero(judged.solution.indices == column)[0]) for column in columns]
    deviations = np.sqrt(np.diag(judged.solution.covariance)[at])
    return Term(variants[member], tuple(judged.solution.values[at].tolist()), tuple(deviations.tolist()))


def _fitted_rivals(
    name: str,
    rivals: Mapping[str, float],
    best: _Judged,
    judged: Sequence[_Judged],
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
        terms[rival] = _fitted(member, instead, posterior, variants, q)
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


def _residuals(data: Prepared, solution: Solution) -> list[Array]:
    """Return what a solution leaves of each run, whitened coefficients (runs, n - 1) by group."""
    result = []
    for group, stack in zip(data.groups, data.stacks, strict=True):
        chosen = stack[:, solution.indices].astype(np.float64)
        left = stack[:, 0] - np.tensordot(chosen, solution.values, axes=(1, 0))
        n = left.shape[1] + 1
        power = spectrum(data.noise.noise, np.arange(1, n) / n, group.runs[0][0].stimulus.period_s)
        result.append(left / np.sqrt(power))
    return result


def _mixed(groups: Sequence[Group], residuals: Sequence[Array]) -> list[Array]:
    """Return the parity runs of each run's whitened coefficients."""
    return [mixing(group)[2] @ own for group, own in zip(groups, residuals, strict=True)]


def _unknown_parts(
    found: _Found, variants: Sequence[Variant], left: Sequence[Place], bands: Mapping[str, set[int]]
) -> list[UnknownPart]:
    best, q = found.best, found.best.solution.indices.size
    parts: list[UnknownPart] = []
    nominal = q - sum(len(found.posterior.candidates[each].columns) for each in best.members)
    at = nominal
    for each in sorted(best.members):
        k = len(found.posterior.candidates[each].columns)
        if variants[each].effect.name.startswith(PREFIX):
            parts.append(curve_part(variants[each], best.solution.values[at : at + k].tolist()))
        at += k
    if found.line is not None and best.line:
        parts.append(line_part(found.line))
    if not parts:
        residuals = _residuals(found.data, best.solution)
        regimes = regime_map(found.data.groups, residuals, found.data.floor, found.data.noise.noise, bands)
        rest = remaining_part(left, regimes)
        parts += [] if rest is None else [rest]
    return parts


def _constant(runs: Sequence[GapRun]) -> bool:
    """Return whether neither temperature, nor rate, nor angle, nor attitude changes in or between the runs."""
    spans = (
        (2.0, [run.stimulus.warm_k for run in runs]),
        (0.01, [run.stimulus.table_rate_dps for run in runs]),
        (0.5, [run.stimulus.elevation_deg for run in runs]),
        (1.0, [run.stimulus.angle_deg % 360.0 for run in runs]),
    )
    return all(np.ptp(np.concatenate(values)) < least for least, values in spans)


def _warnings(data: Prepared) -> tuple[str, ...]:
    notes = []
    if not data.floor.from_repeats:
        notes.append("no repeated runs: the noise floor rests on " + data.noise.source)
    if data.noise.source == "data sheet":
        notes.append("no repeats and no quiet run: a wrong data sheet would look like a gap")
    if all(np.ptp(run.stimulus.warm_k) < 2.0 for group in data.groups for each in group.runs for run in each):
        notes.append("temperature hardly changes in these runs: no effect of temperature can be seen")
    longest = max(len(each.runs[0][0].stimulus) * each.runs[0][0].stimulus.period_s for each in data.groups)
    if longest < _LONG_S:
        notes.append(
            f"the longest run has {longest:.0f} s: what takes longer than {longest / 2.0:.0f} s (thermal lags, "
            "relaxation, bias instability) is not told from the run's own bias"
        )
    return tuple(notes)
