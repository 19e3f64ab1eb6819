"""Which effects: sets judged by evidence and by what they leave, over the grid and then between its points."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from bench.analysis.gap._candidates import candidates_of, possible_candidates
from bench.analysis.gap._cells import cells_in, power_in, whitened_rows
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._evidence import SetPosterior, reduced, search
from bench.analysis.gap._fit import (
    DIRECTIONS,
    MISFIT,
    TOLERANCE,
    Products,
    Solution,
    counts,
    nominal_energies,
    solve,
    tolerated,
    weighted_gram,
)
from bench.analysis.gap._generic import FreeCurve, absorbed
from bench.analysis.gap._judged import (
    Judged,
    correcting,
    curves_that_matter,
    instead_of,
    less_forms,
    missed_beside,
    told_by_form,
)
from bench.analysis.gap._lines import SpectralLine, strongest_line
from bench.analysis.gap._model_file import Model
from bench.analysis.gap._prepare import Prepared, gathered, narrowed, noise_beside
from bench.analysis.gap._refine import best_of_each, between_grid_points, sets_of_note
from bench.analysis.gap._stack import stacked
from bench.analysis.gap._unknown import Remainder, remainder
from drivers.base.arrays import Array
from simulators.effects import Input, Variant

_UNSEEN = 0.05
"""Probability of something unknown where nothing of it was found: 25 of 448 claims of the exams before."""
_SHOWN = 12.0
_REFINED = 3
"""Sets of catalogue effects whose shapes are looked at between the grid's points."""


@dataclass(frozen=True)
class Found:
    """What a search found: sets judged, the best of them, cells' energies before (cells,) and their tolerance.

    `hidden` maps effects that these runs cannot show to the reason.
    """

    data: Prepared
    before: Array
    variance: Array
    posterior: SetPosterior
    judged: list[Judged]
    best: Judged
    hidden: dict[str, str]
    line: SpectralLine | None


def second_look(found: Found, model: Model, variants: Sequence[Variant]) -> tuple[list[Variant], Prepared]:
    """Return the variants and data again: noise beside the best set, its effects between the grid's points."""
    # what an effect does differently in each repeat is no noise
    noise = noise_beside(found.data, found.best.solution, model)
    posterior = found.posterior
    kept = sorted({*best_of_each(posterior), *found.best.members})
    gram = _gram_of(found, model)
    fresh: dict[tuple[str, tuple[float, ...]], Variant] = {}
    for members in sets_of_note(posterior, _SHOWN, _REFINED):
        for moved in between_grid_points([variants[index] for index in sorted(members)], gram):
            if not isinstance(moved.effect, FreeCurve) or moved.effect.local:
                fresh[moved.effect.name, tuple(moved.shape.values())] = moved
    for variant in variants:
        fresh.pop((variant.effect.name, tuple(variant.shape.values())), None)
    few, data = narrowed(found.data, model, variants, kept, list(fresh.values()))
    taken = _renumbered(found, kept, len(model.sigmas))
    return few, gathered(data.groups, data.stacks, noise, model, taken)


_Place = tuple[int, tuple[tuple[str, float], ...]]


def _place(variant: Variant) -> _Place:
    """Return which effect a variant is of, and where its shapes are."""
    return id(variant.effect), tuple(sorted((key, float(value)) for key, value in variant.shape.items()))


def _gram_of(found: Found, model: Model) -> Callable[[Sequence[Variant]], Array]:
    """Return what gives the weighted products of [data, variants' columns], nominal columns projected out."""
    data, nominal = found.data, range(1 + len(model.sigmas))
    variance = tolerated(data.cells, found.before, directions=DIRECTIONS)
    variance *= [cell.floor for cell in data.cells]
    whiten, own, start = [], [], 0
    for group, stack in zip(data.groups, data.stacks, strict=True):
        stop = start + cells_in(group)
        whiten.append(whitened_rows(group, stack, data.noise.noise, variance[start:stop]))
        own.append(whiten[-1](stack.chosen(nominal)))
        start = stop
    before: dict[_Place, list[Array]] = {}
    """By group the rows of the variants that were asked for the last time: most stay where they were."""

    def rows_of(variants: Sequence[Variant]) -> Iterator[list[Array]]:
        """Yield by group the rows (k, coefficients) of each variant, all at once for few calls."""

        def columns(run: GapRun) -> list[Array]:
            return [variant.columns(run.stimulus) for variant in variants]

        ends = np.cumsum([len(variant.effect.parameters) for variant in variants])[:-1]
        for group, stack, weighted in zip(data.groups, data.stacks, whiten, strict=True):
            fresh = stacked(group.flat, columns, [False] * len(variants), stack.filled_for)
            yield np.split(weighted(fresh.full), ends)

    def gram(variants: Sequence[Variant]) -> Array:
        places = [_place(variant) for variant in variants]
        fresh = {place: each for place, each in zip(places, variants, strict=True) if place not in before}
        parts = zip(*rows_of([*fresh.values()]), strict=True) if fresh else ()
        known = before | dict(zip(fresh, map(list, parts), strict=True))
        before.clear()
        before.update({place: known[place] for place in places})
        size = len(nominal) + sum(len(variant.effect.parameters) for variant in variants)
        total = np.zeros((size, size))
        for index, fixed in enumerate(own):
            rows = np.concatenate((fixed, *(before[place][index] for place in places)))
            total += rows @ rows.T
        return reduced(total, model.sigmas)

    return gram


def _renumbered(found: Found, kept: Sequence[int], q: int) -> Solution:
    """Return the best solution with its columns at their places among those kept."""
    solution = found.best.solution
    columns = [column + q for each in kept for column in found.posterior.candidates[each].columns]
    places = {column: 1 + q + index for index, column in enumerate(columns)} | {k: k for k in range(1, 1 + q)}
    indices = np.array([places[each] for each in solution.indices.tolist()], dtype=np.int64)
    return Solution(indices, solution.values, solution.covariance)


def judged_sets(
    data: Prepared,
    model: Model,
    variants: Sequence[Variant],
    hidden: dict[str, str] | None = None,
    lines_hz: Sequence[float] = (),
) -> Found:
    """Weigh the sets; `hidden`: what the look before said cannot be seen, `lines_hz` are named lines."""
    sigmas, cells = model.sigmas, data.cells
    before = nominal_energies(cells, sigmas)
    variance = tolerated(cells, before)
    # formulas between their grid's points come closer
    tolerance = TOLERANCE if hidden is None else MISFIT
    gram = weighted_gram(cells, tolerated(cells, before, tolerance, DIRECTIONS))
    system = reduced(gram, sigmas)
    candidates = candidates_of(variants)
    possible, reasons = possible_candidates(
        system, gram, candidates, variants, len(sigmas), model.noise.coarseness
    )
    posterior = search(system, candidates, possible)
    judged = _judge_sets(posterior, variants, data, gram, before, sigmas)
    best = max(judged, key=lambda each: each.log_evidence)
    gaps = dict.fromkeys((cell.profile for cell in cells), 0.0)
    for cell, own in zip(cells, before, strict=True):
        gaps[cell.profile] += max(own - cell.count, 0.0) if cell.repeatable else 0.0
    left = left_of_runs(data, best.in_form)
    line = strongest_line(data.groups, left, data.noise.noise, gaps, lines_hz)
    turning = any(Input.TURN in variants[member].effect.inputs for member in best.members)
    if line is not None and not (line.harmonic and turning):
        # harmonics of a ripple that is named already are its waveform, no effect of their own
        judged = [replace(each, line=line.log_evidence) for each in judged]
        best = replace(best, line=line.log_evidence)
    return Found(data, before, variance, posterior, judged, best, reasons if hidden is None else hidden, line)


def _judge_sets(
    posterior: SetPosterior,
    variants: Sequence[Variant],
    data: Prepared,
    gram: Array,
    before: Array,
    sigmas: Array,
) -> list[Judged]:
    by_effects = posterior.by_effects()
    highest = max(by_effects.values())
    kept = [names for names, value in by_effects.items() if value > highest - _SHOWN or not names]
    kept = sorted(kept, key=lambda names: -by_effects[names])[:60]
    effect_of = {candidate.effect: variants[candidate.variant].effect for candidate in posterior.candidates}
    # without them nothing says whether a member only corrects the form of another
    simpler = (names - gone for names in kept for gone in correcting(names, effect_of))
    kept += [names for names in dict.fromkeys(simpler) if names in by_effects and names not in kept]
    instead = (instead_of(curve, names, by_effects, posterior.curves) for names in kept for curve in names)
    kept = list(dict.fromkeys([*kept, *(names for names in instead if names is not None), frozenset()]))
    best = posterior.best_variants()
    solutions = {names: solve(gram, sigmas, _columns(posterior, best[names], len(sigmas))) for names in kept}
    kept = [
        names for names in kept if _possible(posterior, best[names], solutions[names], variants, len(sigmas))
    ]
    curves = [
        next(iter(members))
        for names, members in best.items()
        if len(names) == 1 and names <= posterior.curves
    ]
    used = _columns(posterior, frozenset(curves), len(sigmas))
    used += [column for each in solutions.values() for column in each.indices.tolist()]
    products = Products.of(data.cells, used)
    number = counts(data.cells)

    def rest_of(solution: Solution, left: Array) -> Remainder:
        """Return what a fit leaves; its effects' formulas may miss a part of what they do in a cell, no more."""
        action = products.action(solution, len(sigmas))
        misfit = np.minimum(action, np.maximum(np.maximum(before, left) - number, 0.0))
        tolerance = tolerated(data.cells, number + misfit, MISFIT)
        return remainder(data.cells, tolerance, before, left, data.floor, action)

    judged = []
    for names in kept:
        members, solution = best[names], solutions[names]
        left = products.left(solution)
        rest = rest_of(solution, left)
        known = frozenset(member for member in members if not posterior.candidates[member].curve)
        alone = solve(gram, sigmas, _columns(posterior, known, len(sigmas))) if known != members else solution
        judged.append(
            Judged(names, members, by_effects[names], solution, left, rest, alone, solution, posterior.curves)
        )

    def left_without(one: Judged, names: frozenset[str]) -> Array:
        rest = frozenset(member for member in one.members if posterior.candidates[member].effect not in names)
        return products.left(solve(gram, sigmas, _columns(posterior, rest, len(sigmas))))

    def in_form(one: Judged) -> Judged:
        """Take out what curves over the very inputs of a set's effects take away, if that may be their form."""
        members = set(one.members)
        for name in sorted(one.names):
            theirs = float((left_without(one, frozenset([name])) - one.left).sum())
            for curve in curves:
                if not absorbed(effects[name], [variants[curve].effect]):
                    continue
                solution = solve(gram, sigmas, _columns(posterior, one.members | {curve}, len(sigmas)))
                gained = float(one.left.sum()) - float(products.left(solution).sum())
                if gained <= missed_beside(effects[posterior.candidates[curve].effect]) ** 2 * theirs:
                    members.add(curve)
        if members == one.members:
            return one
        solution = solve(gram, sigmas, _columns(posterior, frozenset(members), len(sigmas)))
        return replace(one, rest=rest_of(solution, products.left(solution)), in_form=solution)

    effects = {candidate.effect: variants[candidate.variant].effect for candidate in posterior.candidates}
    matter = curves_that_matter(judged, left_without, effects)
    matter = less_forms(matter, left_without, effects)
    matter = told_by_form(matter, left_without, data.cells, effects)
    # a line may be what a ripple's formula leaves
    turning = {name for name, effect in effects.items() if Input.TURN in effect.inputs}
    return [
        in_form(one) if (one.rest.total or one.names & turning) and not one.curved else one for one in matter
    ]


def _possible(
    posterior: SetPosterior, members: frozenset[int], solution: Solution, variants: Sequence[Variant], q: int
) -> bool:
    """Return whether each effect of a set may have the parameters that fit, within what they are known to."""
    place = {index: at for at, index in enumerate(solution.indices.tolist())}
    for member in members:
        at = [place[column + q] for column in posterior.candidates[member].columns]
        known = solution.covariance[np.ix_(at, at)]
        if not variants[member].effect.possible(solution.values[at], known):
            return False
    return True


def _columns(posterior: SetPosterior, members: frozenset[int], q: int) -> list[int]:
    """Return places of a set's columns in the full Gram matrix; those in `system` count without the nominal."""
    return [column + q for member in sorted(members) for column in posterior.candidates[member].columns]


def set_weights(judged: Sequence[Judged]) -> dict[frozenset[str], tuple[float, float]]:
    """Return the probability of each set being all there is, and of it with something unknown beside it."""
    highest = max(each.log_evidence for each in judged)
    raw = {
        each.names: (math.exp(each.log_evidence - highest), _UNSEEN + (1.0 - _UNSEEN) * each.unknown)
        for each in judged
    }
    total = sum(weight for weight, _ in raw.values())
    return {names: (weight / total * (1 - odd), weight / total * odd) for names, (weight, odd) in raw.items()}


def left_of_runs(data: Prepared, solution: Solution) -> list[Array]:
    """Return what a solution leaves of each run, whitened coefficients (runs, n - 1) by group."""
    result = []
    for group, stack in zip(data.groups, data.stacks, strict=True):
        left = stack.chosen([0])[:, 0] - np.tensordot(
            stack.chosen(solution.indices), solution.values, axes=(1, 0)
        )
        result.append(left / np.sqrt(power_in(group, data.noise.noise)))
    return result
