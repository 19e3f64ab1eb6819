"""Coefficients of the data and of every column, run by run; smooth columns are kept to a period of 20 s only."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct

from bench.analysis.gap._bridge import bridge
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._noise import Noise
from drivers.base.arrays import Array

_SHORTEST_S = 20.0
_CONSTANT = 1e-12
"""Part of its mean by which a row without a signal changes."""
_ROWS = 24
"""Rows that are bridged and averaged together."""


@dataclass(frozen=True)
class Stack:
    """Orthonormal DCT-II coefficients 1 .. n-1 of a group's runs, condition-major.

    `full` (runs, a, n - 1) and `slow` (runs, b, m), the first m coefficients of columns that have nothing beyond,
    hold [data - model, model's columns, effects' columns] in any order; `place` (a + b,) says where each is,
    those of `slow` after those of `full`. Gaps were bridged for noise `filled_for`.
    """

    full: NDArray[Any]
    slow: NDArray[Any]
    place: NDArray[np.int64]
    filled_for: Noise

    def part(self, columns: Sequence[int] | NDArray[np.int64], part: slice) -> Array:
        """Return some columns' coefficients, float64 (runs, k, part)."""
        place = self.place[np.asarray(columns, dtype=np.int64)]
        fast = place < self.full.shape[1]
        result = np.zeros((len(self.full), len(place), part.stop - part.start))
        result[:, fast] = self.full[:, place[fast], part]
        own = self.slow[:, place[~fast] - self.full.shape[1], part]
        result[:, ~fast, : own.shape[2]] = own
        return result

    def chosen(self, columns: Sequence[int] | NDArray[np.int64]) -> Array:
        """Return some columns' coefficients, float64 (runs, k, n - 1)."""
        return self.part(columns, slice(0, self.full.shape[2]))

    def energies(self, part: slice) -> Array:
        """Return every column's energy in a part of the coefficients, (a + b,)."""
        own = [each[:, :, part] for each in (self.full, self.slow)]
        return np.concatenate([np.einsum("rik,rik->i", each, each) for each in own])[self.place]

    def narrowed(self, columns: Sequence[int], fresh: NDArray[Any]) -> Stack:
        """Return some columns, and after them `fresh` ones in full, (runs, c, n - 1)."""
        place = self.place[np.asarray(columns, dtype=np.int64)]
        a, c = self.full.shape[1], fresh.shape[1]
        fast = place < a
        full = np.concatenate((self.full[:, place[fast]], fresh), axis=1)
        slow = self.slow[:, place[~fast] - a]
        new = np.empty(len(place) + c, dtype=np.int64)
        new[: len(place)][fast] = np.arange(fast.sum())
        new[: len(place)][~fast] = full.shape[1] + np.arange((~fast).sum())
        new[len(place) :] = fast.sum() + np.arange(c)
        return Stack(full, slow, new, self.filled_for)


def stacked(
    runs: Sequence[GapRun], rows: Callable[[GapRun], Sequence[Array]], smooth: Sequence[bool], noise: Noise
) -> Stack:
    """Return the coefficients of runs' rows, in blocks (k, n) of which `smooth` ones have nothing under 20 s.

    Gaps are bridged for `noise`.
    """
    full, slow = [], []
    places: list[NDArray[np.int64]] = []
    for run in runs:
        blocks = rows(run)
        full.append(_full(run, [own for own, few in zip(blocks, smooth, strict=True) if not few], noise))
        slow.append(_slow(run, [own for own, few in zip(blocks, smooth, strict=True) if few], noise))
        if not places:
            few = np.repeat(np.array(smooth, dtype=bool), [len(own) for own in blocks])
            place = np.empty(len(few), dtype=np.int64)
            place[~few], place[few] = np.arange((~few).sum()), (~few).sum() + np.arange(few.sum())
            places.append(place)
    return Stack(np.stack(full), np.stack(slow), places[0], noise)


def transformed(run: GapRun, rows: Array, noise: Noise) -> Array:
    """Return the orthonormal DCT-II of rows (p, n) less coefficient 0, the run's free bias; (p, n - 1)."""
    filled = bridge(run.missing, run.stimulus.period_s, noise)
    return np.asarray(dct(filled.over(rows), norm="ortho", axis=-1)[:, 1:])


def _full(run: GapRun, blocks: Sequence[Array], noise: Noise) -> NDArray[np.float32]:
    """Return `transformed` of blocks of rows, single precision."""
    filled = bridge(run.missing, run.stimulus.period_s, noise)
    held = np.empty((sum(len(own) for own in blocks), len(run.stimulus)), dtype=np.float32)
    at = 0
    for block in _gathered(blocks):
        own = _centred(filled.over(block))
        held[at : at + len(own)] = own
        at += len(own)
    return np.asarray(dct(held, norm="ortho", axis=-1, overwrite_x=True)[:, 1:])


def _slow(run: GapRun, blocks: Sequence[Array], noise: Noise) -> NDArray[np.float32]:
    """Return `transformed` of blocks of smooth rows down to periods of about 20 s, (columns, m), from means.

    The transform of means over b samples lacks the factor b sqrt(b) sin x / sin(b x), x = pi k / 2n, at number k.
    """
    filled = bridge(run.missing, run.stimulus.period_s, noise)
    n = len(run.stimulus)
    longest = max(int(0.5 * _SHORTEST_S / run.stimulus.period_s), 1)
    b = next(each for each in range(longest, 0, -1) if n % each == 0)
    means = np.empty((sum(len(own) for own in blocks), n // b))
    at = 0
    for block in _gathered(blocks):
        own = filled.over(block).reshape(len(block), n // b, b).mean(axis=2)
        means[at : at + len(own)] = _centred(own)
        at += len(own)
    angle = 0.5 * np.pi * np.arange(1, n // b) / n
    factor = b * np.sqrt(b) * np.sin(angle) / np.sin(b * angle)
    return np.asarray(dct(means, norm="ortho", axis=-1)[:, 1:] * factor, dtype=np.float32)


def _centred(rows: Array) -> Array:
    """Return rows (p, n) less their means, which would cost digits and are no coefficient.

    What rounding leaves of a constant row is no signal: a fit would take it for one and give it any size.
    """
    means = rows.mean(axis=1, keepdims=True)
    left = rows - means
    left[np.abs(left).max(axis=1) <= _CONSTANT * np.abs(means[:, 0])] = 0.0
    return np.asarray(left)


def _gathered(blocks: Sequence[Array]) -> Iterator[Array]:
    """Yield the rows of blocks some at a time: few calls, and little memory."""
    held: list[Array] = []
    for block in blocks:
        held.append(block)
        if sum(map(len, held)) >= _ROWS:
            yield np.concatenate(held)
            held = []
    if held:
        yield np.concatenate(held)
