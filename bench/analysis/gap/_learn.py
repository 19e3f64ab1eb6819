"""Closing what has no name: forms learned from the runs, chosen and judged by leaving out one profile at a time.

A form that fits repeats of the runs it was fitted on proves nothing: nearly any does. Here its parameters come
from all profiles but one, and what they take away from that one counts (Stone, J. R. Statist. Soc. B 36, 1974).
Forms join one after the other as long as the profiles left out come nearer and none moves away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from bench.analysis.gap._cells import Cell, group_cells, rescaled
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._fit import solve
from bench.analysis.gap._generic import INPUTS
from bench.analysis.gap._model_file import Model, Term
from bench.analysis.gap._prepare import Prepared, with_columns
from drivers.base.arrays import Array
from simulators.effects import FORMS, REFERENCE_C, Input, Variant, learned_shape

_MOST_FORMS = 4
_LOOSE = (1.0, 0.1, 0.01)
"""Prior variance of a column's share in units of the whole gap: a freer and a stiffer fit."""
_LEAST_GAIN = 0.03
"""Part of the gap that a further form must take away, and may add to a profile."""
_HARDLY = 0.1
"""Part of a form's largest column from which one is shrunk as if it were larger."""
_LEAST_SHARE = 0.2
"""Part of the gap, over the profiles left out, from which a learned term is offered."""
_SURE = 3.0
_TURNING_DPS = 1.0


@dataclass(frozen=True)
class Learned:
    """What was learned for a gap without a name; without `terms` the `reason` says why none is offered.

    `share` is the part of the unnamed gap that is gone in profiles left out of the fit, `by_profile` in each with
    a gap. `nominal` are the model's own parameters as fitted beside the terms. `valid` is the range of inputs
    that the terms were fitted over: input with unit to lowest and highest value.
    """

    terms: tuple[Term, ...] = ()
    nominal: tuple[Term, ...] = ()
    share: float = 0.0
    by_profile: Mapping[str, float] = field(default_factory=dict)
    valid: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    reason: str = ""


def learned(data: Prepared, model: Model, named: Sequence[Term]) -> Learned:
    """Learn what a model with `named` effects leaves of the runs, the model's own parameters fitted beside."""
    runs = [run for group in data.groups for run in group.flat]
    forms = _forms(runs)
    problem = _Problem.of(data, model, named, forms)
    if len(problem.profiles) < 2:
        return Learned(reason="one profile only: nothing could be judged on another")
    chosen: list[int] = []
    loose, gone = _LOOSE[0], problem.gone_left_out([], _LOOSE[0])
    while len(chosen) < _MOST_FORMS:
        tried = {
            (form, scale): problem.gone_left_out([*chosen, form], scale)
            for form in range(len(forms))
            if form not in chosen
            for scale in _LOOSE
        }
        best = max(tried, key=lambda key: float(tried[key].sum()))
        gain = tried[best] - gone
        least = max(_LEAST_GAIN * float(problem.gap.sum()), 12.0)
        if gain.sum() < least or (gain < -np.maximum(_LEAST_GAIN * problem.gap.sum(), problem.noise)).any():
            break
        chosen, loose, gone = [*chosen, best[0]], best[1], tried[best]
    clear = problem.gap > problem.noise
    whole = float(problem.gap[clear].sum())
    share = float(gone[clear].sum()) / whole if whole else 0.0
    shares = {
        name: float(part / gap)
        for name, part, gap, seen in zip(problem.profiles, gone, problem.gap, clear, strict=True)
        if seen
    }
    if not chosen or share < _LEAST_SHARE:
        return Learned(
            by_profile=shares if chosen else {},
            reason="no form that was learned on the other profiles took away what a profile left out shows",
        )
    values, sigmas, nominal = problem.fitted(chosen, loose)
    terms, at = [], 0
    for form in chosen:
        count = len(forms[form].effect.parameters)
        own = slice(at, at + count)
        terms.append(Term(forms[form], tuple(values[own].tolist()), tuple(sigmas[own].tolist())))
        at += count
    return Learned(tuple(terms), model.moved(nominal, model.sigmas).terms, share, shares, _ranges(runs))


@dataclass(frozen=True)
class _Problem:
    """Products of [rest, nominal columns, forms' columns] by profile, (profiles, m, m); what is to be closed."""

    profiles: tuple[str, ...]
    grams: Array
    sigmas: Array
    columns: tuple[tuple[int, ...], ...]
    before: Array
    gap: Array
    noise: Array

    @classmethod
    def of(cls, data: Prepared, model: Model, named: Sequence[Term], forms: Sequence[Variant]) -> _Problem:
        """Return the products of all repeatable cells; the named effects are taken out with their values."""
        q, k = len(model.sigmas), sum(len(term.values) for term in named)
        fresh = [*(term.variant for term in named), *forms]
        cells: list[Cell] = []
        for group, stack in zip(data.groups, with_columns(data, range(1 + q), fresh), strict=True):
            cells += group_cells(group, stack, data.noise.noise)
        cells = [cell for cell in rescaled(cells, data.floor.ratio) if cell.repeatable]
        size = cells[0].columns
        kept = np.array([*range(1 + q), *range(1 + q + k, size)])
        rest = np.zeros((len(kept), size))
        rest[np.arange(len(kept)), kept] = 1.0
        rest[0, 1 + q : 1 + q + k] = [-value for term in named for value in term.values]
        profiles = tuple(dict.fromkeys(cell.profile for cell in cells))
        grams = np.zeros((len(profiles), size, size))
        counts, sigma = np.zeros(len(profiles)), np.zeros(len(profiles))
        for cell in cells:
            at = profiles.index(cell.profile)
            grams[at][np.ix_(cell.at, cell.at)] += cell.block
            counts[at] += cell.count
            sigma[at] += (cell.count * float(data.floor.sigma[cell.band])) ** 2 + 2.0 * cell.count
        reduced = rest @ grams @ rest.T
        starts = np.cumsum([1 + q, *(len(form.effect.parameters) for form in forms)])
        columns = tuple(tuple(range(a, b)) for a, b in pairwise(starts.tolist()))
        nominal = solve(reduced.sum(axis=0), model.sigmas, ()).values
        weights = np.concatenate(([1.0], -nominal, np.zeros(len(kept) - 1 - q)))
        before = np.einsum("i,gij,j->g", weights, reduced, weights)
        gap = np.maximum(before - counts, 0.0)
        return cls(profiles, reduced, model.sigmas, columns, before, gap, _SURE * np.sqrt(sigma))

    def gone_left_out(self, forms: Sequence[int], loose: float) -> Array:
        """Return the energy gone from every profile with the forms fitted to the others, (profiles,)."""
        if not forms:
            return np.zeros(len(self.profiles))
        whole = self.grams.sum(axis=0)
        result = []
        for place, gram in enumerate(self.grams):
            values, _ = self._ridge(whole - gram, forms, loose)
            weights = self._weights(values, forms, whole)
            result.append(float(self.before[place] - weights @ gram @ weights))
        return np.array(result)

    def fitted(self, forms: Sequence[int], loose: float) -> tuple[Array, Array, Array]:
        """Return the forms' parameters, their sigmas and the nominal ones' change, fitted to all profiles."""
        whole = self.grams.sum(axis=0)
        values, sigmas = self._ridge(whole, forms, loose)
        return values, sigmas, -self._weights(values, forms, whole)[1 : 1 + len(self.sigmas)]

    def _ridge(self, gram: Array, forms: Sequence[int], loose: float) -> tuple[Array, Array]:
        q = len(self.sigmas)
        own = [column for form in forms for column in self.columns[form]]
        at = np.array([*range(1, 1 + q), *own])
        size = np.sqrt(np.maximum(np.diag(self.grams.sum(axis=0))[at], 1e-30))
        normal = gram[np.ix_(at, at)] / np.outer(size, size)
        # where a form hardly shows, it is not far larger than where it does
        largest = [size[q:][np.isin(own, self.columns[form])].max() for form in forms]
        most = np.repeat(largest, [len(self.columns[form]) for form in forms])
        unseen = np.concatenate((np.ones(q), np.maximum(_HARDLY * most / size[q:], 1.0)))
        prior = unseen**2 / (loose * max(float(self.gap.sum()), 1.0))
        prior[:q] = 1.0 / (self.sigmas * size[:q]) ** 2
        normal[np.arange(len(at)), np.arange(len(at))] += prior + 1e-12
        inverse = np.linalg.inv(normal)
        values = inverse @ (gram[at, 0] / size) / size
        return values[q:], (np.sqrt(np.diag(inverse)) / size)[q:]

    def _weights(self, values: Array, forms: Sequence[int], whole: Array) -> Array:
        """Return the weights of what is left with the forms' values, the nominal parameters fitted to all."""
        q = len(self.sigmas)
        own = [column for form in forms for column in self.columns[form]]
        weights = np.zeros(len(whole))
        weights[0] = 1.0
        weights[own] = -values
        nominal = np.arange(1, 1 + q)
        normal = whole[np.ix_(nominal, nominal)] + np.diag(1.0 / self.sigmas**2)
        weights[nominal] = -np.linalg.solve(normal, whole[nominal] @ weights) if q else 0.0
        return weights


def _forms(runs: Sequence[GapRun]) -> list[Variant]:
    """Return the learned forms over what changes in these runs, with nodes, lags and orders that suit them."""
    spans = {over: _span(runs, over) for over in INPUTS}
    seen = {over for over, (low, high) in spans.items() if high - low >= INPUTS[over].least_span}
    rates = np.concatenate([run.stimulus.axis_rate_dps for run in runs])
    turning = float(np.abs(rates).max()) > _TURNING_DPS
    settling_s = (100.0, 300.0, 1000.0, 3000.0, 10000.0)
    shapes: dict[str, Sequence[float]] = {"time since power-on": settling_s}

    def nodes(over: Input, count: int) -> list[float]:
        low, high = spans[over]
        return [float(node) for node in np.linspace(low, high, count)]

    if Input.T_IN in seen:
        lags = (60.0, 200.0, 600.0, 2000.0, 6000.0)
        shapes |= {
            "bias over T_in": nodes(Input.T_IN, 30),
            "bias over late T_in": nodes(Input.T_IN, 30),
            "memory of T_in": lags,
            "loops of T_in": (2.0, 5.0, 10.0, 20.0, 35.0),
            "memory of temperature changes": (60.0, 200.0, 600.0, 2000.0),
        }
        if turning:
            shapes |= {"scale factor over T_in": nodes(Input.T_IN, 9), "scale factor's memory of T_in": lags}
    if Input.T_OUT in seen and Input.GRADIENT in seen:
        shapes |= {
            "bias over T_out": nodes(Input.T_OUT, 12),
            "memory of T_out": (60.0, 200.0, 600.0, 2000.0, 6000.0),
        }
    if Input.WARMING in seen:
        shapes |= {"bias over dT_in/dt": nodes(Input.WARMING, 9)}
    if Input.GRADIENT in seen:
        shapes |= {"bias over T_in - T_out": nodes(Input.GRADIENT, 9)}
    if turning:
        shapes |= {
            "bias over rate": _levels(rates),
            "scale factor since power-on": settling_s,
            "rate over table angle": [order for order in range(1, 37) for _ in "cs"],
            "heat of turning": (30.0, 100.0, 300.0, 1000.0),
            "answer to changes of rate": tuple(float(delay) for delay in range(12)),
        }
    angles = [run.stimulus.angle_deg for run in runs]
    if turning or max(float(np.ptp(angle)) for angle in angles) > 1.0:
        shapes |= {"bias over table angle": [order for order in range(1, 7) for _ in "cs"]}
    if any(np.ptp(run.stimulus.elevation_deg) > 1.0 for run in runs):
        shapes |= {"bias over direction": (0.0, 1.0, 2.0, 3.0)}
    result = []
    for name, at in shapes.items():
        shape = learned_shape(at)
        result.append(Variant(FORMS[name].effect(shape), shape))
    return result


def _span(runs: Sequence[GapRun], over: Input) -> tuple[float, float]:
    values = [INPUTS[over].values(run.stimulus) for run in runs]
    return min(float(value.min()) for value in values), max(float(value.max()) for value in values)


def _levels(rates_dps: Array) -> list[float]:
    """Return nodes over the rate, close about zero, out to the highest on both sides."""
    most = float(np.abs(rates_dps).max())
    side = [most * part for part in (0.005, 0.02, 0.06, 0.15, 0.3, 0.5, 0.7, 0.85, 1.0)]
    return [*(-rate for rate in reversed(side)), 0.0, *side]


def _ranges(runs: Sequence[GapRun]) -> dict[str, tuple[float, float]]:
    low, high = _span(runs, Input.T_IN)
    slow, fast = _span(runs, Input.WARMING)
    rates = np.concatenate([run.stimulus.axis_rate_dps for run in runs])
    return {
        "T_in, degC": (low + REFERENCE_C, high + REFERENCE_C),
        "dT_in/dt, K/min": (slow, fast),
        "rate, deg/s": (float(rates.min()), float(rates.max())),
    }
