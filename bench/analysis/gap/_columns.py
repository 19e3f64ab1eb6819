"""Columns of effects and fitted terms over runs: what is foretold and what is recorded, as products."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._cells import Cell, group_cells
from bench.analysis.gap._data import GapRun, group_runs
from bench.analysis.gap._evidence import reduced
from bench.analysis.gap._fit import weighted_gram
from bench.analysis.gap._model_file import Model, Term
from bench.analysis.gap._predictions import tolerant_gram
from bench.analysis.gap._prepare import stack_of
from drivers.base.arrays import Array
from simulators.effects import Effect, Variant


class Columns:
    """Columns of the effects that a model lacks, each in its usual form, and of fitted terms after them."""

    def __init__(self, model: Model, usual: Mapping[str, Variant], fitted: Sequence[Variant] = ()) -> None:
        self._model, self._usual = model, usual
        self.variants = [*usual.values(), *fitted]
        ends = np.cumsum([0, *(len(each.effect.parameters) for each in self.variants)]).tolist()
        self._places = [slice(start, end) for start, end in pairwise(ends)]
        self.count = int(ends[-1])

    def usual(self, name: str) -> slice:
        """Return where the columns of an effect's usual form are."""
        return self._places[list(self._usual).index(name)]

    def place(self, variant: Variant) -> slice:
        """Return where the columns of a fitted term are."""
        return next(place for place, own in zip(self._places, self.variants, strict=True) if own is variant)

    def with_terms(self, terms: Iterable[Term]) -> Columns:
        """Return the columns with those of fitted terms."""
        fitted = {id(term.variant): term.variant for term in terms}
        return Columns(self._model, self._usual, list(fitted.values()))

    def values(self, terms: Sequence[Term]) -> Array:
        """Return the coefficients (p,) of some fitted terms."""
        values = np.zeros(self.count)
        for term in terms:
            values[self.place(term.variant)] += np.array(term.values)
        return values

    def bounds(self, coarseness: float) -> Array:
        """Return the largest size of each coefficient, (p,)."""
        every = [parameter for variant in self.variants for parameter in variant.effect.parameters]
        return np.array([max(map(abs, parameter.bounds(coarseness))) for parameter in every])

    def indices(self, places: Sequence[slice]) -> NDArray[np.int64]:
        """Return the indices among [nominal, effects' columns] of the nominal ones and those at some places."""
        q = len(self._model.sigmas)
        return np.unique(np.concatenate([np.arange(q), *(q + np.arange(p.start, p.stop) for p in places)]))

    def gram(self, runs: Sequence[GapRun]) -> Array:
        """Return the whitened columns' products in some runs, (p, p), what the nominal model can imitate out."""
        return reduced(self.products(runs, np.zeros(self.count))[0], self._model.sigmas)[1:, 1:]

    def products(
        self, runs: Sequence[GapRun], acting: Array, before: Array | None = None
    ) -> tuple[Array, Array]:
        """Return products of whitened [data, nominal, effects' columns], and the same on the effects' misfit.

        `acting` (p,): the coefficients of what acts; `before`: the products before. Zero without runs.
        """
        cells: list[Cell] = []
        for group in group_runs(runs):
            cells += group_cells(group, stack_of(group, self._model, self.variants), self._model.noise)
        if not cells:
            size = 1 + len(self._model.sigmas) + self.count
            return np.zeros((size, size)), np.zeros((size, size))
        plain = weighted_gram(cells, np.ones(len(cells)))
        every = plain if before is None else plain + before
        return plain, tolerant_gram(cells, every, self._model.sigmas, acting)


def usual_variant(effect: Effect) -> Variant:
    """Return the point of an effect's grid of shapes nearest to the middle of each; of equals the last."""
    variants = effect.variants()
    ranks = [
        {value: rank for rank, value in enumerate(sorted({each.shape[name] for each in variants}))}
        for name in variants[0].shape
    ]

    def off(variant: Variant) -> float:
        places = zip(ranks, variant.shape.values(), strict=True)
        return sum(abs(2.0 * rank[value] / max(len(rank) - 1, 1) - 1.0) for rank, value in places)

    return min(reversed(variants), key=off)
