"""Closing what has no name: forms learned from the runs, chosen and judged by leaving out one profile at a time.

A form that fits repeats of the runs it was fitted on proves nothing: nearly any does. Here its parameters come
from all profiles but one, and what they take away from that one counts (Stone, J. R. Statist. Soc. B 36, 1974).
Forms join one after the other as long as the profiles left out come nearer and none moves away.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.linalg import block_diag

from bench.analysis.gap._cells import repeatable_rows, run_rows, shared_noise
from bench.analysis.gap._data import GapRun, Group
from bench.analysis.gap._fit import counts
from bench.analysis.gap._learned_forms import Candidate, candidates_for, span_of
from bench.analysis.gap._model_file import Model, Term
from bench.analysis.gap._prepare import Prepared
from bench.analysis.gap._stack import Stack, stacked
from drivers.base.arrays import Array
from simulators.effects import REFERENCE_C, Input

_MOST_FORMS = 4
_LOOSE = (3.0, 0.3, 0.03)
"""Prior energy of a form in units of the whole gap: freer and stiffer fits."""
_SCREENED = 6
"""Forms that are fitted with every prior; they are those that do best with a middling one."""
_LEAST_GAIN = 0.03
"""Part of the gap that a further form must take away, and may add to a profile."""
_LEAST_ENERGY = 12.0
_HARDLY = 0.1
"""Part of a form's largest column from which one is shrunk as if it were larger."""
_LEAST_SHARE = 0.2
"""Part of the gap, over the profiles left out, from which a learned term is offered."""
_SURE = 3.0


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


@dataclass(frozen=True)
class _Fitted:
    """A form as it is to be fitted: which candidate, which of its priors, and how much it may do."""

    place: int
    prior: int
    loose: float


def learned(data: Prepared, model: Model, named: Sequence[Term]) -> Learned:
    """Learn what a model with `named` effects leaves of the runs, the model's own parameters fitted beside."""
    problem = _Problem(data, model, named)
    if len(problem.profiles) < 2:
        return Learned(reason="one profile only: nothing could be judged on another")
    chosen, gone = _chosen(problem)
    harmed: list[str] = []
    while chosen and (found := problem.harmed(chosen)):
        harmed, chosen = harmed or found, chosen[:-1]
        gone = problem.gone_left_out(chosen)
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
            reason=f"what was learned moves {', '.join(harmed)} further away"
            if harmed
            else "no form that was learned on the other profiles took away what a profile left out shows",
        )
    values, nominal = problem.fitted(chosen)
    terms = tuple(
        Term(problem.candidates[one.place].variant, tuple(at.tolist()), tuple(sigmas.tolist()))
        for one, (at, sigmas) in zip(chosen, values, strict=True)
    )
    runs = [run for group in data.groups for run in group.flat]
    return Learned(terms, model.moved(nominal, model.sigmas).terms, share, shares, _ranges(runs))


def _chosen(problem: _Problem) -> tuple[list[_Fitted], Array]:
    """Return the forms that profiles left out ask for, and the energy gone from each of these, (profiles,)."""
    chosen: list[_Fitted] = []
    gone = np.zeros(len(problem.profiles))
    whole = float(problem.gap.sum())
    while len(chosen) < _MOST_FORMS:
        free = [k for k in range(len(problem.candidates)) if all(one.place != k for one in chosen)]
        first = {
            k: float(
                problem.gone_left_out([*chosen, _Fitted(k, len(problem.roots(k)) // 2, _LOOSE[1])]).sum()
            )
            for k in free
        }
        tried = {
            one: problem.gone_left_out([*chosen, one])
            for k in sorted(free, key=lambda k: -first[k])[:_SCREENED]
            for prior in range(len(problem.roots(k)))
            for one in (_Fitted(k, prior, loose) for loose in _LOOSE)
        }
        if not tried:
            break
        best = max(tried, key=lambda one: float(tried[one].sum()))
        gain = tried[best] - gone
        least = max(_LEAST_GAIN * whole, _LEAST_ENERGY)
        if gain.sum() < least or (gain < -np.maximum(_LEAST_GAIN * whole, problem.noise)).any():
            break
        if chosen and (gain > least).sum() < 2:  # a profile always has some form that suits it alone
            break
        chosen, gone = [*chosen, best], tried[best]
    return chosen, gone


class _Problem:
    """What is to be closed in the repeatable part of each profile, and candidates for it, as whitened rows.

    `before` and `gap` (profiles,) are the energies that the nominal model leaves and that above the noise;
    `noise` is what noise may make of the latter.
    """

    def __init__(self, data: Prepared, model: Model, named: Sequence[Term]) -> None:
        self._data, self._named = data, named
        runs = [run for group in data.groups for run in group.flat]
        self.candidates = candidates_for(runs)
        self.profiles = tuple(dict.fromkeys(group.profile for group in data.groups))
        self.sigmas = model.sigmas
        self._rows: list[list[Array]] = [[] for _ in range(1 + len(self.candidates))]
        self._profile_of = [self.profiles.index(group.profile) for group in data.groups]
        for group, stack in zip(data.groups, data.stacks, strict=True):
            floor = data.floor.ratio * shared_noise(group, data.noise.noise)[0]
            rows = repeatable_rows(group, stack.filled_for, data.noise.noise, floor)
            self._rows[0].append(rows(self._beside_named(group, stack)))
            for place, candidate in enumerate(self.candidates, 1):
                fresh = stacked(group.flat, _columns_of(candidate), [candidate.slow], stack.filled_for)
                self._rows[place].append(
                    rows(fresh.slow if candidate.slow else fresh.full).astype(np.float32)
                )
        self._products: dict[tuple[int, int], Array] = {}
        self._scaled: dict[int, list[Array]] = {}
        nominal = self._product(0, 0)
        weights = np.append(1.0, -self._nominal(nominal.sum(axis=0)[:, 0]))
        self.before = np.asarray(nominal @ weights @ weights)
        cells = [cell for cell in data.cells if cell.repeatable]
        number, sigma = np.zeros(len(self.profiles)), np.zeros(len(self.profiles))
        at = [self.profiles.index(cell.profile) for cell in cells]
        np.add.at(number, at, counts(cells))
        of_floor = counts(cells) * data.floor.sigma[[cell.band for cell in cells]]
        np.add.at(sigma, at, of_floor**2 + 2.0 * counts(cells))
        self.gap = np.maximum(self.before - number, 0.0)
        self.noise = _SURE * np.sqrt(sigma)

    def roots(self, place: int) -> list[Array]:
        """Return a candidate's priors by their roots (k, m), of energy one over all profiles."""
        if place not in self._scaled:
            gram = self._product(1 + place, 1 + place).sum(axis=0)
            priors = self.candidates[place].priors
            if not priors:
                size = np.sqrt(np.maximum(np.diag(gram), 1e-30))
                # where a form hardly shows, it is not far larger than where it does
                priors = (np.diag(1.0 / np.maximum(size, _HARDLY * size.max())),)
            energies = [float(np.einsum("ij,ij->", root, gram @ root)) for root in priors]
            self._scaled[place] = [
                root / math.sqrt(max(energy, 1e-30)) for root, energy in zip(priors, energies, strict=True)
            ]
        return self._scaled[place]

    def gone_left_out(self, forms: Sequence[_Fitted]) -> Array:
        """Return the energy gone from every profile with the forms fitted to the others, (profiles,)."""
        system = self._system(forms)
        weights = self._left_out(forms, system)
        return np.asarray(self.before - np.einsum("pi,pij,pj->p", weights, system, weights))

    def harmed(self, forms: Sequence[_Fitted]) -> list[str]:
        """Return the runs that forms fitted to all profiles leave with more than noise may add.

        What the repeats of a profile have in common may come nearer while one of them, which stands a little
        otherwise, is moved away.
        """
        system = self._system(forms).sum(axis=0)
        done = block_diag(*self._roots_of(forms)) @ self._weights(system)
        found = []
        for group, stack in zip(self._data.groups, self._data.stacks, strict=True):
            rows = run_rows(group, stack.filled_for, self._data.noise.noise, self._data.floor.ratio)
            own = self._beside_named(group, stack)
            columns = [_columns_of(self.candidates[one.place]) for one in forms]
            fresh = stacked(group.flat, _together(columns), [False] * len(forms), stack.filled_for)
            whole = rows(np.concatenate((own, fresh.full), axis=1))
            for run, part in zip(group.flat, whole.transpose(1, 0, 2), strict=True):
                before, after = float(part[0] @ part[0]), float(np.sum((done @ part) ** 2))
                noise = _SURE * math.sqrt(2.0 * part.shape[1])
                if after > before + noise + _LEAST_GAIN * float(self.gap.sum()):
                    found.append(run.run_id)
        return found

    def _beside_named(self, group: Group, stack: Stack) -> Array:
        """Return the coefficients of [data less named effects, nominal columns], (runs, 1 + q, m)."""
        own = stack.chosen(range(1 + len(self.sigmas)))
        if self._named:
            done = stacked(group.flat, lambda run: [_done(self._named, run)], [False], stack.filled_for)
            own[:, 0] -= done.full[:, 0]
        return own

    def _left_out(self, forms: Sequence[_Fitted], system: Array) -> Array:
        """Return what leaves [data, nominal columns, forms] of each profile left out, (profiles, m)."""
        whole, q = system.sum(axis=0), len(self.sigmas)
        normal, right = (whole - system)[:, 1:, 1:] + self._prior(len(whole) - 1), (whole - system)[:, 1:, :1]
        weights = np.zeros((len(system), len(whole)))
        weights[:, 0] = 1.0
        weights[:, 1 + q :] = -np.linalg.solve(normal, right)[:, q:, 0]
        # the nominal parameters are fitted to all profiles beside what the others say of the forms
        weights[:, 1 : 1 + q] = -np.stack([self._nominal(own) for own in weights @ whole[:, : 1 + q]])
        return weights

    def fitted(self, forms: Sequence[_Fitted]) -> tuple[list[tuple[Array, Array]], Array]:
        """Return each form's values and sigmas, and the nominal ones' change, fitted to all profiles."""
        system, q = self._system(forms).sum(axis=0), len(self.sigmas)
        inverse = np.linalg.inv(system[1:, 1:] + self._prior(len(system) - 1))
        weights, result, at = self._weights(system), [], q
        for one in forms:
            root = math.sqrt(self._energy(one)) * self.roots(one.place)[one.prior]
            basis = self.candidates[one.place].basis
            values = root if basis is None else basis @ root
            own = slice(at, at + root.shape[1])
            variances = np.einsum("ij,jk,ik->i", values, inverse[own, own], values)
            result.append((-values @ weights[1:][own], np.sqrt(np.maximum(variances, 0.0))))
            at += root.shape[1]
        return result, -weights[1 : 1 + q]

    def _weights(self, system: Array) -> Array:
        """Return what leaves [data, nominal columns, forms] fitted to all profiles together, (m,)."""
        q = len(self.sigmas)
        scores = np.linalg.solve(system[1:, 1:] + self._prior(len(system) - 1), system[1:, 0])
        weights = np.concatenate(([1.0], np.zeros(q), -scores[q:]))
        weights[1 : 1 + q] = -self._nominal((system @ weights)[: 1 + q])
        return weights

    def _energy(self, one: _Fitted) -> float:
        return one.loose * max(float(self.gap.sum()), 1.0)

    def _prior(self, size: int) -> Array:
        """Return the prior's part of the normal equations, the nominal parameters first, (size, size)."""
        return np.diag(np.concatenate((1.0 / self.sigmas**2, np.ones(size - len(self.sigmas)))))

    def _nominal(self, across: Array) -> Array:
        """Return the nominal parameters from their products with what is to be explained, (1 + q,) -> (q,)."""
        nominal = self._product(0, 0).sum(axis=0)[1:, 1:] + np.diag(1.0 / self.sigmas**2)
        return np.asarray(np.linalg.solve(nominal, across[1:])) if len(nominal) else np.zeros(0)

    def _system(self, forms: Sequence[_Fitted]) -> Array:
        """Return the products of [data, nominal columns, the forms' priors] by profile, (profiles, m, m)."""
        roots, places = self._roots_of(forms), [0, *(1 + one.place for one in forms)]
        return np.block(
            [
                [left.T @ self._product(a, b) @ right for b, right in zip(places, roots, strict=True)]
                for a, left in zip(places, roots, strict=True)
            ]
        )

    def _roots_of(self, forms: Sequence[_Fitted]) -> list[Array]:
        """Return the roots of the priors: of data and nominal columns one by one, and of the forms."""
        own = [math.sqrt(self._energy(one)) * self.roots(one.place)[one.prior] for one in forms]
        return [np.eye(1 + len(self.sigmas)), *own]

    def _product(self, one: int, other: int) -> Array:
        """Return the products of two candidates' rows by profile; 0: the data and the nominal columns."""
        if (other, one) in self._products:
            return np.asarray(self._products[other, one].transpose(0, 2, 1))
        if (one, other) not in self._products:
            size = (len(self.profiles), len(self._rows[one][0]), len(self._rows[other][0]))
            total = np.zeros(size)
            for at, left, right in zip(self._profile_of, self._rows[one], self._rows[other], strict=True):
                m = min(left.shape[2], right.shape[2])
                rows = (np.float64(own[:, :, :m]).reshape(len(own), -1) for own in (left, right))
                total[at] += np.matmul(next(rows), next(rows).T)
            self._products[one, other] = total
        return self._products[one, other]


def _together(columns: Sequence[Callable[[GapRun], list[Array]]]) -> Callable[[GapRun], list[Array]]:
    """Return what gives the blocks of several candidates' columns."""
    return lambda run: [block for each in columns for block in each(run)]


def _done(terms: Sequence[Term], run: GapRun) -> Array:
    """Return what terms do in a run, (1, n)."""
    parts = [np.array([term.values]) @ term.variant.columns(run.stimulus) for term in terms]
    return np.asarray(np.sum(parts, axis=0))


def _columns_of(candidate: Candidate) -> Callable[[GapRun], list[Array]]:
    """Return what gives a candidate's columns in its basis, (k, n)."""

    def columns(run: GapRun) -> list[Array]:
        whole = candidate.variant.columns(run.stimulus)
        return [whole if candidate.basis is None else candidate.basis.T @ whole]

    return columns


def _ranges(runs: Sequence[GapRun]) -> dict[str, tuple[float, float]]:
    low, high = span_of(runs, Input.T_IN)
    slow, fast = span_of(runs, Input.WARMING)
    rates = np.concatenate([run.stimulus.axis_rate_dps for run in runs])
    return {
        "T_in, degC": (low + REFERENCE_C, high + REFERENCE_C),
        "dT_in/dt, K/min": (slow, fast),
        "rate, deg/s": (float(rates.min()), float(rates.max())),
    }
