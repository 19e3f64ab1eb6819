"""Weighted least squares from Gram matrices: nominal columns with priors, energies of cells, tolerance.

Index 0 of a Gram matrix is the data, 1 .. q the nominal model's columns, the rest the candidates'.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray
from scipy.linalg.blas import daxpy

from bench.analysis.gap._cells import BANDS, Cell
from drivers.base.arrays import Array

TOLERANCE = 0.35
"""Part of an effect's amplitude that a catalogue's formula may miss of the real one."""
MISFIT = 0.25
"""The same as far as it goes without another effect being suspected; the rest is for choosing between effects."""
DIRECTIONS = 8.0
"""Coefficients of one cell that a formula's misfit fills; it has a form and is not noise over all of them."""
_LEAK = 0.4
_FLOOR_PRIOR = 40.0
_JITTER = 1e-10


@dataclass(frozen=True)
class Solution:
    """Parameters of the nominal columns' corrections and of chosen columns, with covariance, in that order."""

    indices: NDArray[np.int64]
    values: Array
    covariance: Array


def weighted_gram(cells: Sequence[Cell], variance: Array) -> Array:
    """Return the sum of the cells' Gram matrices of [data, columns] over their variance (cells,)."""
    total = np.zeros((cells[0].columns,) * 2)
    # cells of one group and band have the same columns: added up first, put into place once
    for _, alike in groupby(zip(cells, variance.tolist(), strict=True), key=lambda each: id(each[0].at)):
        pairs = list(alike)
        own = pairs[0][0].at
        part = np.zeros(len(own) ** 2)
        for cell, each in pairs:
            part = daxpy(cell.whitened.ravel(), part, a=1.0 / (cell.floor * each))
        total[np.ix_(own, own)] += part.reshape(len(own), -1)
    return total


def solve(gram: Array, prior_sigmas: Array, chosen: Sequence[int]) -> Solution:
    """Fit nominal corrections (prior sigma (q,)) and the columns `chosen` (indices into `gram`) together."""
    q = len(prior_sigmas)
    indices = np.array([*range(1, q + 1), *chosen], dtype=np.int64)
    if not len(indices):
        return Solution(indices, np.zeros(0), np.zeros((0, 0)))
    normal = gram[np.ix_(indices, indices)].copy()
    normal[np.arange(q), np.arange(q)] += 1.0 / prior_sigmas**2
    power = np.diag(normal)
    scale = np.sqrt(np.where(power > 0.0, power, 1.0))  # a column that is zero in these runs gets zero
    normal = normal / np.outer(scale, scale) + _JITTER * np.eye(len(scale))
    covariance = np.linalg.inv(normal) / np.outer(scale, scale)
    return Solution(indices, covariance @ gram[indices, 0], covariance)


def beside_nominal(gram: Array, prior_sigmas: Array, fitted: Solution, columns: Sequence[int]) -> Solution:
    """Return what some columns of a fit do that the nominal columns, fitted to it with their priors, do not."""
    nominal, at = np.arange(1, 1 + len(prior_sigmas)), np.isin(fitted.indices, columns)
    own, values = fitted.indices[at], fitted.values[at]
    normal = gram[np.ix_(nominal, nominal)] + np.diag(1.0 / prior_sigmas**2)
    taken = np.linalg.solve(normal, gram[np.ix_(nominal, own)] @ values)
    return Solution(np.concatenate((nominal, own)), np.concatenate((-taken, values)), np.zeros((0, 0)))


@dataclass(frozen=True)
class Products:
    """Products of the data, 0, and some columns (u,), ascending, in every cell, (cells, u, u)."""

    columns: NDArray[np.int64]
    values: Array

    @classmethod
    def of(cls, cells: Sequence[Cell], columns: Iterable[int]) -> Products:
        """Return the products of the data and `columns` in `cells`."""
        at = np.array(sorted({0, *columns}), dtype=np.int64)
        return cls(at, np.stack([cell.products(at) for cell in cells]))

    def left(self, solution: Solution) -> Array:
        """Return the energy of the whitened data that a solution leaves in each cell, (cells,)."""
        return self._energies(np.append(solution.indices, 0), np.append(-solution.values, 1.0))

    def action(self, solution: Solution, first: int = 0) -> Array:
        """Return the energy that a solution's columns from `first` on have in each cell, (cells,)."""
        return self._energies(solution.indices[first:], solution.values[first:])

    def _energies(self, columns: NDArray[np.int64], weights: Array) -> Array:
        at = np.searchsorted(self.columns, columns)
        return np.asarray(self.values[:, at[:, None], at] @ weights @ weights)


def energies(cells: Sequence[Cell], solution: Solution) -> Array:
    """Return the energy of the whitened data that a solution leaves in each cell, (cells,)."""
    return Products.of(cells, solution.indices.tolist()).left(solution)


def counts(cells: Sequence[Cell]) -> Array:
    """Return the cells' numbers of coefficients, (cells,)."""
    return np.array([float(cell.count) for cell in cells])


def nominal_solution(cells: Sequence[Cell], prior_sigmas: Array) -> Solution:
    """Return the nominal columns fitted alone to all cells."""
    own = np.arange(1 + len(prior_sigmas))
    return solve(np.sum([cell.products(own) for cell in cells], axis=0), prior_sigmas, ())


def nominal_energies(cells: Sequence[Cell], prior_sigmas: Array) -> Array:
    """Return the cells' energies under the re-fitted nominal model, (cells,)."""
    return energies(cells, nominal_solution(cells, prior_sigmas))


def tolerated(
    cells: Sequence[Cell], left: Array, tolerance: float = TOLERANCE, directions: float = np.inf
) -> Array:
    """Return each cell's variance in units of noise, (cells,): 1 + tolerance^2 times the gap found there.

    A catalogue's formula never is the real effect; without this the misfit of a strong effect buys false further
    ones. Part of a cell's gap counts in the neighbouring bands, where the misfit may lie. A misfit has a form: it
    fills at most `directions` of a cell's coefficients.
    """
    gap = np.maximum(left - counts(cells), 0.0)
    at = {(cell.profile, cell.parity, cell.repeatable, cell.band): k for k, cell in enumerate(cells)}
    spread = gap.copy()
    for k, cell in enumerate(cells):
        for band in (cell.band - 1, cell.band + 1):
            near = at.get((cell.profile, cell.parity, cell.repeatable, band))
            if near is not None:
                spread[k] += _LEAK * gap[near]
    return np.asarray(1.0 + tolerance**2 * spread / np.minimum(counts(cells), directions))


@dataclass(frozen=True)
class Floor:
    """Noise floor against the noise model in each band, variance ratio and its relative uncertainty, (bands,)."""

    ratio: Array
    sigma: Array
    from_repeats: bool


def floor_from_repeats(cells: Sequence[Cell], prior_sigmas: Array, solution: Solution | None = None) -> Floor:
    """Return the floor that the differences of repeats show; the noise model's own where there are none.

    The model counts as 40 coefficients in each band. What the repeats differ in by their stimulus is taken out:
    with `solution` if there is one already, else with the nominal columns.
    """
    difference = [cell for cell in cells if not cell.repeatable]
    total, number = np.full(len(BANDS), _FLOOR_PRIOR), np.full(len(BANDS), _FLOOR_PRIOR)
    if difference:
        left = energies(difference, solution) if solution else nominal_energies(difference, prior_sigmas)
        bands = [cell.band for cell in difference]
        np.add.at(total, bands, left)
        np.add.at(number, bands, counts(difference))
    return Floor(total / number, np.sqrt(2.0 / number), bool(difference))
