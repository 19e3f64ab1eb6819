"""Jumps: what steps in one repeat of a run and not in another, too sharp for any noise of a gyro.

A random walk has the spectrum of a level that steps now and then; in time they are unlike. Its differences from
block to block are normal, those of a level that steps are nothing but now and then.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.fft import dct, idct
from scipy.ndimage import median_filter

from bench.analysis.gap._cells import power_in
from bench.analysis.gap._fit import Solution
from bench.analysis.gap._prepare import Prepared
from bench.analysis.gap._stochastic import is_quiet
from bench.analysis.gap._which import left_of_runs
from drivers.base.arrays import Array
from simulators.effects import STEADY_DPS, Stimulus

_BLOCKS_S = (20.0, 60.0, 200.0)
_LEVEL = 3
"""Blocks before and after a jump, whose means are its levels; one block between them holds it."""
_SHARP = 6.5
"""Standard deviations: 8e-11 of normal differences whose size is known; a campaign has some ten thousand."""
_APART_S, _SAME = 600.0, 0.5
"""Time by which an event may come earlier or later in another repeat, and its least part of the size there."""
_LEVEL_DEG = 0.01
_NEAR = 61
"""Blocks about a difference that say how large differences are there: repeats differ more where it warms."""


@dataclass(frozen=True)
class Jumps:
    """How many jumps there are, and the sharpest: in which run, how long after its start, by how much.

    `repeated`: that run has repeats, which do not jump there.
    """

    number: int
    run_id: str
    at_s: float
    size_dph: float
    repeated: bool


def find_jumps(data: Prepared, solution: Solution, *, alone: bool) -> Jumps | None:
    """Return the jumps in what a solution leaves of runs that have repeats; None where there are none.

    `alone`: also in runs without repeats, where temperature and table stand still.
    """
    number, sharpest, result = 0, _SHARP, None
    for group, left in zip(data.groups, left_of_runs(data, solution), strict=True):
        if len(group.flat) == len(group.runs) and not alone:
            continue
        period_s, n = group.flat[0].stimulus.period_s, left.shape[1] + 1
        coefficients = np.zeros((len(left), n))
        coefficients[:, 1:] = left * np.sqrt(power_in(group, data.noise.noise))
        curves = idct(coefficients, norm="ortho", axis=-1)
        power = power_in(group, data.noise.sheet)
        first = 0
        for repeats in group.runs:
            own = curves[first : first + len(repeats)]
            first += len(repeats)
            if len(repeats) == 1 and not (alone and is_quiet(repeats[0])):
                continue
            known = ~np.any([run.missing for run in repeats], axis=0)
            for ratio, at_s, width_s in _places_s(
                own - own.mean(axis=0) * (len(own) > 1), known, _moves(repeats[0].stimulus), power, period_s
            ):
                sizes = _steps(own, round(width_s / period_s), round(at_s / period_s))
                run = int(np.abs(sizes).argmax())
                others = np.delete(own, run, axis=0)
                reach = round(_APART_S / period_s)
                if _later(
                    others, round(width_s / period_s), round(at_s / period_s), reach, float(sizes[run])
                ):
                    continue
                number += 1
                if ratio > sharpest:
                    sharpest = ratio
                    result = (repeats[run].run_id, at_s, float(sizes[run]), len(repeats) > 1)
    return None if result is None else Jumps(number, *result)


def _moves(s: Stimulus) -> NDArray[np.bool_]:
    """Return the samples, (n,), at which rate or attitude change: a scale factor makes a step of that."""
    rate, level = s.table_rate_dps, s.elevation_deg
    changes = (np.abs(np.diff(rate)) > STEADY_DPS) | (np.abs(np.diff(level)) > _LEVEL_DEG)
    return np.concatenate(([False], changes))


def _places_s(
    apart: Array, known: NDArray[np.bool_], moves: NDArray[np.bool_], power: Array, period_s: float
) -> list[tuple[float, float, float]]:
    """Return sharpness, place and length of blocks, s, of each jump in repeats (m, n) less their mean.

    Only levels count of which half is `known` (n,), and not bridged, without `moves` (n,) from the one to the
    other. A few blocks may differ little by chance: they count as no quieter than noise of `power` (n - 1,). The
    sharpest comes first; where blocks of several lengths show the same jump, it is the sharpest.
    """
    found: list[tuple[float, float, float]] = []
    for length_s in _BLOCKS_S:
        width = max(1, round(length_s / period_s))
        if apart.shape[1] // width < 8 * _LEVEL:
            continue
        before, after = _levels(apart, width)
        seen = np.minimum(*_levels(known[None].astype(np.float64), width))[0] > 0.5
        ends = width * np.arange(len(seen) + 2 * _LEVEL + 1)
        turns = np.concatenate(([0], np.cumsum(moves)))[ends]
        seen &= turns[2 * _LEVEL + 1 :] == turns[: -2 * _LEVEL - 1]
        if not seen.any():
            continue
        steps = np.abs(after - before)
        usual = np.median(steps[:, seen], axis=1, keepdims=True)
        near = median_filter(np.where(seen, steps, usual), (1, _NEAR), mode="reflect")
        usual = np.maximum(
            usual, 0.6745 * math.sqrt(1.0 - 1.0 / max(len(apart), 2)) * _of_noise(power, width)
        )
        ratio = 0.6745 * (steps / np.maximum(np.maximum(usual, near), 1e-300)).max(axis=0)
        block_s = width * period_s
        found += [
            (float(ratio[k]), (k + _LEVEL + 0.5) * block_s, block_s)
            for k in np.flatnonzero(seen & (ratio > _SHARP)).tolist()
        ]
    kept: list[tuple[float, float, float]] = []
    for ratio, at_s, length_s in sorted(found, reverse=True):
        if all(abs(at_s - other_s) > (_LEVEL + 1) * max(length_s, own_s) for _, other_s, own_s in kept):
            kept.append((ratio, at_s, length_s))
    return kept


def _of_noise(power: Array, width: int) -> float:
    """Return one standard deviation of a step in noise of some power (n - 1,) of coefficients."""
    n, half = len(power) + 1, _LEVEL * width
    weights, middle = np.zeros(n), (n - width) // 2
    weights[middle - half : middle] = -1.0 / half
    weights[middle + width : middle + width + half] = 1.0 / half
    return float(np.sqrt(np.sum(dct(weights, norm="ortho")[1:] ** 2 * power)))


def _levels(curves: Array, width: int) -> tuple[Array, Array]:
    """Return the means of three blocks of `width` samples before each block, and of three after it, (m, k)."""
    blocks = curves.shape[1] // width
    means = curves[:, : blocks * width].reshape(len(curves), blocks, width).mean(axis=2)
    total = np.concatenate((np.zeros((len(means), 1)), np.cumsum(means, axis=1)), axis=1)
    before = total[:, _LEVEL : -_LEVEL - 1] - total[:, : -2 * _LEVEL - 1]
    after = total[:, 2 * _LEVEL + 1 :] - total[:, _LEVEL + 1 : -_LEVEL]
    return before / _LEVEL, after / _LEVEL


def _later(curves: Array, width: int, at: int, reach: int, size: float) -> bool:
    """Return whether another curve steps as far somewhat earlier or later: the same event at another time."""
    places = range(at - reach, at + reach + 1, max(1, width // 2))
    inside = [k for k in places if (_LEVEL + 1) * width <= k < curves.shape[1] - (_LEVEL + 1) * width]
    steps = np.array([_steps(curves, width, k) for k in inside])
    return bool(steps.size and (np.sign(size) * steps).max() > _SAME * abs(size))


def _steps(curves: Array, width: int, at: int) -> Array:
    """Return by how much each curve steps about a sample, (m,)."""
    half = width // 2
    after = curves[:, at + half : at + half + _LEVEL * width].mean(axis=1)
    before = curves[:, max(at - half - _LEVEL * width, 0) : at - half].mean(axis=1)
    return np.asarray(after - before)
