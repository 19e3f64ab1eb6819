"""Which effects: posterior over sets of candidates by a mixture of g-priors, from one weighted Gram matrix.

Evidence of a set with k columns that lowers the cost by `gain` under Zellner's g-prior:
0.5 g/(1+g) gain - 0.5 k ln(1+g), averaged over a grid of g (Liang et al., JASA 103, 2008, eq. 5).
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array

_G = np.array([30.0, 300.0, 3e3, 3e4, 3e5])
_G_TERMS = tuple(zip((_G / (1.0 + _G)).tolist(), np.log1p(_G).tolist(), strict=True))
_FURTHER_MEMBER = 3.0
"""Extra log odds against each effect after the first."""
_FURTHER_TERM = math.log(2.0)
"""Log odds against a further term of a power series: a real dependence is as likely bent as not."""
_BEAM = 6
_LARGEST = 4
_CLOSE = 8.0
_UNSEEN_COLUMN = 1e-6
"""Part of an effect's largest column below which a column of it shows nothing in these runs and costs nothing."""


@dataclass(frozen=True)
class Candidate:
    """A variant of an effect: its columns' places in the Gram matrix, prior log odds against other effects.

    `curve`: it is a free curve, no effect of the catalogue. `series` is the same for formulas that are terms of
    one power series, and None for others.
    """

    effect: str
    variant: int
    columns: tuple[int, ...]
    variants: int
    log_odds: float = 0.0
    curve: bool = False
    series: Hashable = None


VariantSet = frozenset[int]


@dataclass(frozen=True)
class SetPosterior:
    """Log evidence of every set of candidates looked at (indices into the candidates), priors included."""

    candidates: tuple[Candidate, ...]
    log_evidence: Mapping[VariantSet, float]

    @cached_property
    def curves(self) -> frozenset[str]:
        """Names of the free curves among the candidates."""
        return frozenset(candidate.effect for candidate in self.candidates if candidate.curve)

    def best(self) -> VariantSet:
        """Return the set of variants with the highest evidence."""
        return max(self.log_evidence, key=lambda each: self.log_evidence[each])

    def by_effects(self) -> dict[frozenset[str], float]:
        """Return the log evidence of sets of effects, variants summed over."""
        gathered: dict[frozenset[str], list[float]] = {}
        for members, value in self.log_evidence.items():
            gathered.setdefault(self.effects(members), []).append(value)
        return {names: _log_sum(values) for names, values in gathered.items()}

    def best_variants(self) -> dict[frozenset[str], VariantSet]:
        """Return the best set of variants for every set of effects."""
        result: dict[frozenset[str], VariantSet] = {}
        for members in sorted(self.log_evidence, key=lambda each: self.log_evidence[each]):
            result[self.effects(members)] = members
        return result

    def effects(self, members: VariantSet) -> frozenset[str]:
        """Return the names of a set's effects."""
        return frozenset(self.candidates[member].effect for member in members)


def reduced(gram: Array, prior_sigmas: Array) -> Array:
    """Project the nominal columns (with their priors) out of data and candidates, (1 + p, 1 + p)."""
    q = len(prior_sigmas)
    rest = np.array([0, *range(q + 1, len(gram))])
    if q == 0:
        return np.asarray(gram[np.ix_(rest, rest)])
    inner = np.arange(1, q + 1)
    normal = gram[np.ix_(inner, inner)] + np.diag(1.0 / prior_sigmas**2)
    across = gram[np.ix_(inner, rest)]
    scale = np.sqrt(np.diag(normal))
    solved = np.linalg.solve(normal / np.outer(scale, scale), across / scale[:, None])
    return np.asarray(gram[np.ix_(rest, rest)] - (across / scale[:, None]).T @ solved)


def log_bayes(gain: float, columns: int) -> float:
    """Return the log evidence ratio of a fit against none, a mixture over g."""
    terms = [0.5 * each * gain - 0.5 * columns * log for each, log in _G_TERMS]
    highest = max(terms)
    return float(highest + math.log(sum(math.exp(term - highest) for term in terms) / len(terms)))


def _log_sum(values: Sequence[float]) -> float:
    highest = max(values)
    return highest + math.log(sum(math.exp(value - highest) for value in values))


def search(system: Array, candidates: Sequence[Candidate], possible: Iterable[int]) -> SetPosterior:
    """Search the sets: every single, then the best sets extended by every candidate, members exchanged in turn.

    `system` is `reduced`'s matrix, `possible` the candidates that these runs can tell from nothing.
    """
    usable = tuple(possible)
    sizes = [np.diag(system)[list(candidate.columns)] for candidate in candidates]
    ranks = tuple(max(int((size > _UNSEEN_COLUMN * size.max()).sum()), 1) for size in sizes)
    effects = len({candidates[each].effect for each in usable})
    found: dict[VariantSet, float] = {frozenset(): math.log(0.5)}
    state = _Search(system, tuple(candidates), ranks, usable, effects, found)
    level: list[VariantSet] = [frozenset()]
    for _ in range(_LARGEST):
        for base in level:
            state.extend(base)
        size = len(level[0]) + 1
        level = state.top(size)
        if not level:
            break
        for members in level[:2]:
            for member in members:
                state.extend(members - {member})
        level = state.top(size)
        if found[level[0]] < max(found.values()) - _CLOSE:
            break
    return SetPosterior(tuple(candidates), found)


@dataclass
class _Search:
    system: Array
    candidates: tuple[Candidate, ...]
    ranks: tuple[int, ...]
    usable: tuple[int, ...]
    effects: int
    found: dict[VariantSet, float]

    def extend(self, base: VariantSet) -> None:
        """Evaluate `base` with every candidate of another effect added."""
        columns = [column for each in base for column in self.candidates[each].columns]
        left, base_gain = _without(self.system, columns)
        names = {self.candidates[each].effect for each in base}
        fresh: dict[int, list[int]] = {}
        for each in self.usable:
            candidate = self.candidates[each]
            if candidate.effect not in names and base | {each} not in self.found:
                fresh.setdefault(len(candidate.columns), []).append(each)
        for own in fresh.values():
            at = np.array([self.candidates[each].columns for each in own])
            for each, gain in zip(own, _gains(left, self.system, at).tolist(), strict=True):
                members = base | {each}
                bayes = log_bayes(base_gain + gain, sum(self.ranks[member] for member in members))
                self.found[members] = bayes + self._log_prior(members)

    def top(self, size: int) -> list[VariantSet]:
        """Return the best sets of a size, one of each combination of effects."""
        ranked = sorted((each for each in self.found if len(each) == size), key=lambda s: -self.found[s])
        kept: list[VariantSet] = []
        seen: set[frozenset[str]] = set()
        for each in ranked:
            names = frozenset(self.candidates[one].effect for one in each)
            if names not in seen:
                seen.add(names)
                kept.append(each)
            if len(kept) == _BEAM:
                break
        return kept

    def _log_prior(self, members: VariantSet) -> float:
        one = math.log(0.5 / max(self.effects, 1))
        variants = sum(math.log(self.candidates[member].variants) for member in members)
        own = sum(self.candidates[member].log_odds for member in members)
        series = [self.candidates[member].series for member in members]
        further = len(series) - series.count(None) - len({*series} - {None})
        mechanisms = len(members) - further
        own -= further * _FURTHER_TERM
        return mechanisms * one - (mechanisms - 1) * _FURTHER_MEMBER - variants + own


def _without(system: Array, columns: Sequence[int]) -> tuple[Array, float]:
    """Return the system with columns projected out, and the cost that they take away."""
    if not columns:
        return system, 0.0
    at = np.array(columns)
    inner = system[np.ix_(at, at)]
    scale = np.sqrt(np.maximum(np.diag(inner), 1e-300))
    inner = inner / np.outer(scale, scale) + 1e-9 * np.eye(len(at))
    across = system[at] / scale[:, None]
    left = system - across.T @ np.linalg.solve(inner, across)
    return left, float(system[0, 0] - left[0, 0])


def _gains(left: Array, system: Array, at: NDArray[np.int64]) -> Array:
    """Return by how much each group of columns, `at` (m, k), lowers the cost, (m,).

    What is left of a column below 1e-6 of it is rounding.
    """
    scale = np.sqrt(np.maximum(np.diag(system)[at], 1e-300))
    inner = left[at[:, :, None], at[:, None, :]] / (scale[:, :, None] * scale[:, None, :])
    inner += 1e-6 * np.eye(at.shape[1])
    data = left[at, 0] / scale
    return np.asarray((data * np.linalg.solve(inner, data[:, :, None])[:, :, 0]).sum(axis=1))
