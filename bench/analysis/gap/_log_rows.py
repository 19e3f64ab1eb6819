"""The rows of a log: which only repeat the one before, how fine they are, and their even grid."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.stats import poisson

from bench.analysis.common.statistics import on_grid
from bench.analysis.gap._rows import Steps
from drivers.base.arrays import Array

_NEXT_TO_NONE = 20
"""Smallest steps between rows that say how often a step would be none by chance."""
_TIMES_CHANCE = 2.0
_BY_CHANCE = 1e-6
"""Probability below which rows are not equal by chance, where that is as many times as frequent as estimated."""
_BLOCK = 64
"""Rows in which a value occurs about as often all the time."""
_FUZZ = 1e-6
"""Part of a usual step below which two values differ by the rounding of their text."""
_UNEVEN, _MOST_PLACES = 0.3, 2
"""Part of a step by which rows may be off an even grid; places of the grid a row."""
_FINEST_OF, _FINEST_PART = 100_000, 0.1
"""Rows looked at for the finest step, and the part of all steps that are finer still: rounding of text."""
_MOST_HELD = 0.2
"""Part of the rows that a logger may have held."""


def even_rows(steps: Steps, rows: Array) -> tuple[Array | None, NDArray[np.int64]]:
    """Return the rows of a log (m,) on their grid, NaN where one is missing, and the step each is averaged in.

    None for uneven or slow ones.
    """
    place = np.rint((steps.time_s - steps.time_s[0]) / steps.usual_s).astype(np.int64)
    off = np.abs(steps.time_s - steps.time_s[0] - place * steps.usual_s).max(initial=0.0)
    if (
        off > _UNEVEN * steps.usual_s
        or place[-1] > _MOST_PLACES * len(rows)
        or steps.usual_s > 0.5 * steps.period_s
    ):
        return None, place
    owner = np.full(int(place[-1]) + 1, -1)
    owner[place] = steps.owner
    return on_grid(place, rows), owner


def finest_angle_deg(rows: Array, time_s: Array, usual_s: float) -> float:
    """Return the finest step of angle, deg, between rows of a log (m,), deg/s; NaN for one that never changes.

    A counter's whole pulses over rows of uneven length are no steps of rate: rows times their length are looked
    at, too.
    """
    lengths_s = np.diff(time_s)
    # a row after one that is missing is not as long as the time since the one before
    angles = np.where(lengths_s < 1.5 * usual_s, rows[1:] * lengths_s, np.nan)
    return float(np.fmax(usual_s * _finest_step(rows), _finest_step(angles)))


def _finest_step(values: Array) -> float:
    """Return the finest step that values (m,) show again and again; NaN for ones that never change."""
    known = values[np.isfinite(values)][:_FINEST_OF]
    apart, changes = np.diff(np.unique(known)), np.abs(np.diff(known))
    # steps that only the rounding of a product or a text makes
    apart = apart[apart > _FUZZ * float(np.median(changes[changes > 0.0]))] if changes.any() else apart[:0]
    return float(np.quantile(apart, _FINEST_PART)) if len(apart) else np.nan


def held_rows(values: Array) -> NDArray[np.bool_]:
    """Return which rows only repeat the one before, (n,): a logger does that where a sample is lost.

    None where as many could be equal by chance, as steps next to none say of a coarse signal, rows two apart that
    are equal, and how often a value occurs in the rows about it (a counter's nought); none of one without noise,
    where most rows are equal.
    """
    steps = np.abs(np.diff(values))
    same = np.concatenate(([False], steps == 0.0))
    others = np.sort(steps[steps > 0.0])
    if not same.any() or len(others) < _NEXT_TO_NONE or same.mean() > _MOST_HELD:
        return np.zeros_like(same)
    apart = np.diff(np.unique(values[~np.isnan(values)]))
    quantum = float(apart[apart > _FUZZ * float(np.median(others))].min())
    near = float(others[_NEXT_TO_NONE - 1]) * (1.0 + _FUZZ)
    again = int(((values[2:] == values[:-2]) & (values[1:-1] != values[2:])).sum())
    by_chance = max(0.5 * int(np.searchsorted(others, near)) * quantum / near, again, _in_blocks(values))
    if poisson.sf(int(same.sum()) - 1, _TIMES_CHANCE * by_chance) > _BY_CHANCE:
        same[:] = False
    return same


def _in_blocks(values: Array) -> float:
    """Return how many rows would equal the one before if those of each block stood in any order.

    A value that stands in one place of the block only says nothing: that may be a row that is held.
    """
    rows = np.full(-(-len(values) // _BLOCK) * _BLOCK, np.nan)
    rows[: len(values)] = values
    blocks = rows.reshape(-1, _BLOCK)
    # those that are missing are none of the block's rows; what is left of it keeps its order
    blocks = np.take_along_axis(blocks, np.argsort(np.isnan(blocks), axis=1, kind="stable"), axis=1)
    begins = np.ones(blocks.shape, dtype=bool)
    begins[:, 1:] = blocks[:, 1:] != blocks[:, :-1]
    order = np.argsort(blocks, axis=1, kind="stable")
    ordered, begins = (np.take_along_axis(each, order, axis=1) for each in (blocks, begins))
    fresh = np.ones(ordered.shape, dtype=bool)
    fresh[:, 1:] = ordered[:, 1:] != ordered[:, :-1]
    value = np.cumsum(fresh) - 1  # each missing row one by itself
    often, places = np.bincount(value), np.bincount(value, begins.ravel())
    counted = np.where(places > 1.0, often * (often - 1.0), 0.0)
    sizes = np.maximum((~np.isnan(blocks)).sum(axis=1), 1)
    return float((counted / sizes[(np.flatnonzero(fresh)) // _BLOCK]).sum())
