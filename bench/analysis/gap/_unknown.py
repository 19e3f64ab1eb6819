"""What a set of effects leaves: more than noise and a formula's misfit? And whose name does it put in doubt?"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._cells import Cell
from bench.analysis.gap._fit import MISFIT, Floor, Products, Solution, counts
from drivers.base.arrays import Array

_PENALTY = 7.0
"""Log odds that one cell must show before it counts: a few hundred cells are looked at."""
_LEAST_SHARE = 0.10
_MISFIT_OF_FLOOR = 0.03
_ACTIVE = 4.0
_BEYOND = 2.0
"""Standard deviations of the noise in a cell below which nothing is left there that speaks against a name."""
CREDIBLE = 0.75
PREVALENT = 0.6
_UNDONE = 4.0
"""Times the gap's energy that an effect of its own may do in a profile beside others that act against it."""


@dataclass(frozen=True)
class Remainder:
    """Evidence that something is left, by cell (cells,) and pooled; how much, and the part of each cell's gap.

    `energy` and `share` count only what is left beyond twice the noise's standard deviation.
    """

    log_evidence: Array
    pooled: float
    energy: Array
    share: Array

    @property
    def total(self) -> float:
        """Log evidence over all cells, the better of single cells and the cells with a gap together."""
        return max(float(self.log_evidence.sum()), self.pooled)


def remainder(
    cells: Sequence[Cell], variance: Array, gap: Array, left: Array, floor: Floor, action: Array
) -> Remainder:
    """Compare what is left (cells,) with noise and tolerance, `variance`; `gap` is the energy before.

    A cell with x times its variance left supports a free variance by 0.5 n (x - 1 - ln x). `action` (cells,) is
    the energy that formulas have in each cell: what they may miss of it in all bands of a profile and parity
    together speaks for nothing.
    """
    number = counts(cells)
    band = np.array([cell.band for cell in cells])
    excess = left - number
    whole = np.maximum(np.maximum(gap - number, excess), 1e-12)
    share = excess / whole
    expected = number * variance * (1.0 + _MISFIT_OF_FLOOR + 2.0 * floor.sigma[band])
    repeatable = np.array([cell.repeatable for cell in cells])
    deviation = np.sqrt(2.0 * number) + number * floor.sigma[band]
    sure = np.maximum(excess - _BEYOND * deviation, 0.0)
    of_form = _of_form(cells, np.where(repeatable, sure, 0.0), np.minimum(action, np.maximum(gap, left)))
    evidence = np.where(repeatable & (share > _LEAST_SHARE) & ~of_form, _support(left, expected, number), 0.0)
    clear = active(cells, gap) & ~of_form
    own = number[clear].sum()
    ratio = (left[clear] / expected[clear] * number[clear]).sum()
    pooled = float(_support(np.array([ratio]), np.array([own]), np.array([own]))[0]) if own else 0.0
    return Remainder(evidence, pooled, sure, sure / whole)


def _of_form(cells: Sequence[Cell], sure: Array, action: Array) -> NDArray[np.bool_]:
    """Return in which cells what is left is no more than the form of the effects that act there, (cells,).

    A step that comes a little late leaves a short pulse: all of its energy is in bands where the step has little.
    Over all bands of a profile and parity it is little beside the step.
    """
    place = _places(cells)
    return np.asarray(np.bincount(place, sure) < MISFIT**2 * np.bincount(place, action))[place]


def _places(cells: Sequence[Cell]) -> NDArray[np.int64]:
    """Return the number of each cell's profile and parity, (cells,)."""
    return np.unique([f"{cell.profile}\n{cell.parity}" for cell in cells], return_inverse=True)[1]


def active(cells: Sequence[Cell], gap: Array) -> NDArray[np.bool_]:
    """Return which cells have a gap that all repeats share, clear of their noise, (cells,)."""
    number = counts(cells)
    repeatable = np.array([cell.repeatable for cell in cells])
    return np.asarray(repeatable & (gap - number > _ACTIVE * np.sqrt(2.0 * number)))


def _support(left: Array, expected: Array, number: Array) -> Array:
    above = np.maximum(left / expected, 1.0)
    return np.asarray(np.maximum(0.5 * number * (above - 1.0 - np.log(above)) - _PENALTY, 0.0))


def credibility(
    cells: Sequence[Cell], variance: Array, solution: Solution, columns: Sequence[int], rest: Remainder
) -> float:
    """Return the part of the gap that is explained in the cells where an effect acts, weighted by its action.

    An effect of the catalogue that is really there explains the cells in which it acts; one that another effect
    imitates leaves a good part of them.
    """
    action = _action(cells, solution, columns) / variance
    return float(1.0 - (action * rest.share).sum() / max(float(action.sum()), 1e-12))


def prevalence(cells: Sequence[Cell], gap: Array, acting: Solution, rest: Remainder) -> float:
    """Return which part of what is there and no noise an effect does, in the profiles and parities where it acts.

    Weighted by what it does, `acting`, the nominal model fitted to it; `gap` is the energy before, (cells,). What
    nothing explains there may do in one band what looks like the effect: a cycling compressor's mean follows its
    chamber, and a servo that hunts starts to do so where the rate steps. What is even in the rate does not look
    like a scale factor. An effect that does more than the whole gap is undone by others in its set.
    """
    repeatable = np.array([cell.repeatable for cell in cells])
    action = np.where(repeatable, _action(cells, acting, acting.indices.tolist()), 0.0)
    left = np.where(repeatable, rest.energy, 0.0)
    place = _places(cells)
    whole = np.bincount(place, np.where(repeatable, np.maximum(gap - counts(cells), 0.0), 0.0))
    own, others = np.bincount(place, action), np.bincount(place, left)
    part = np.minimum(own, _UNDONE * whole) / np.maximum(own + others, 1e-12)
    return float((own * part).sum() / max(float(own.sum()), 1e-12))


def _action(cells: Sequence[Cell], solution: Solution, columns: Sequence[int]) -> Array:
    """Return the energy that some of a solution's columns have in each cell, (cells,)."""
    at = np.isin(solution.indices, columns)
    own = Solution(solution.indices[at], solution.values[at], np.zeros((0, 0)))
    return Products.of(cells, own.indices.tolist()).action(own)
