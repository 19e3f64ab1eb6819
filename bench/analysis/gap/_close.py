"""How far the gap shrinks: fitted effects applied to runs that took no part in choice or fit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from bench.analysis.gap._cells import BANDS, Cell, band_slices, group_cells, power_in, rescaled
from bench.analysis.gap._data import GapRun, check_runs, group_runs
from bench.analysis.gap._disturbed import without_disturbances
from bench.analysis.gap._findings import SIGNIFICANT, Shrinkage, refuse_judges
from bench.analysis.gap._fit import Floor, counts
from bench.analysis.gap._model_file import Model
from bench.analysis.gap._stack import stacked, transformed
from bench.analysis.gap._where import holm, in_time
from drivers.base.arrays import Array

_CHANGED = 1.0
"""Standard deviations of a cell's noise energy by which two models must differ for it to count."""
_LEAST_SIGMA = 0.05
"""Relative uncertainty of a band's floor, however many coefficients of the repeats it rests on."""
_TWO_SIDED = 1.96
_SEEN = 25.0
"""Energy that a term must add to held-out runs for them to say whether it is there."""
_DIFFERENCE = (np.array([1.0, -1.0]), np.array([1.0, -1.0]))
_LEAST_OF_GAP = 0.02
"""Part of the whole gap from which a phase has a share of its own."""


def shrinkage(before: Model, after: Model, runs: Sequence[GapRun], floor: Floor) -> Shrinkage:
    """Return how much of the gap of `before` is gone with `after` on held-out `runs`.

    Both are used as they are, nothing is fitted but each run's bias; impulses and lines are taken out. The floor
    of a band is never known better than to a few per cent. ConfigurationError if a run was used for the fit.
    """
    check_runs(runs)
    refuse_judges(((run.run_id, run.checksum) for run in runs), after.fitted_on.items())
    floor = replace(floor, sigma=np.maximum(floor.sigma, _LEAST_SIGMA))
    runs = without_disturbances(runs, before).runs
    cells = rescaled(judged_cells((before, after), runs), floor.ratio)
    number = counts(cells)
    products = np.stack([cell.products(np.arange(2)) for cell in cells])
    first, then, changed = (
        products[:, 0, 0],
        products[:, 1, 1],
        np.einsum("cij,i,j->c", products, *_DIFFERENCE),
    )
    bands = np.array([cell.band for cell in cells])
    deviation = np.sqrt(2.0 * number + (number * floor.sigma[bands]) ** 2)
    # by what the models predict, so that no cell is chosen for its noise; and what is clear beside that
    clear = holm(chi2.sf(first / (1.0 + 2.0 * floor.sigma[bands]), number)) < SIGNIFICANT
    active = (changed > _CHANGED * deviation) | clear
    share, low, high = _interval(
        first[active], then[active], changed[active], number[active], bands[active], floor
    )
    profiles = np.array([cell.profile for cell in cells])
    half = _TWO_SIDED * _jackknife(first[active] - then[active], (then - number)[active], profiles[active])
    low, high = share - math.hypot(share - low, half), min(share + math.hypot(high - share, half), 1.0)
    return Shrinkage(
        share,
        low,
        high,
        _rms(cells, first, active),
        _rms(cells, then, active),
        "",
        _shares_by([cell.profile for cell in cells], active, first, then, number),
        _shares_by([cell.parity for cell in cells], active, first, then, number),
        _shares_by_phase(before, after, runs, floor, cells, active),
        tuple((active & math.isfinite(share)).tolist()),
    )


def _interval(
    first: Array, then: Array, changed: Array, number: Array, bands: NDArray[np.int64], floor: Floor
) -> tuple[float, float, float]:
    """Return the share of the gap that is gone, gone / (gone + left), and its 95 % interval.

    What is gone, `first - then`, has the noise of 2 e.d, d what the models differ by, `changed` = |d|^2; what is
    left has each cell's noise and the floor's, which a band's cells share, and is not negative.
    """
    gone, left = float((first - then).sum()), float((then - number).sum())
    common = np.bincount(bands, number, len(BANDS)) * floor.sigma
    own = float((2.0 * number + 4.0 * np.maximum(then - number, 0.0)).sum())
    sigma_left = math.sqrt(own + float((common**2).sum()))
    sigma_gone = 2.0 * math.sqrt(float(changed.sum()))
    whole = gone + max(left, 0.0)
    if not len(first) or whole <= math.hypot(sigma_left, sigma_gone):
        return math.nan, math.nan, math.nan
    at = gone / whole
    # gone / (gone + left) by its two errors; what was there before does not vanish with them
    half = math.hypot((1.0 - at) * sigma_gone, at * sigma_left) * _TWO_SIDED / whole
    return at, at - half, min(at + half, 1.0)


def _jackknife(gone: Array, left: Array, profiles: NDArray[np.str_]) -> float:
    """Return the standard deviation of the share by leaving out one profile at a time; 0 for one profile.

    How well a formula holds differs from profile to profile by more than noise (Efron, 1982, section 3).
    """
    names = np.unique(profiles)
    shares = []
    for name in names:
        kept = profiles != name
        whole = float(gone[kept].sum()) + max(float(left[kept].sum()), 0.0)
        if whole > 0.0:
            shares.append(float(gone[kept].sum()) / whole)
    count = len(shares)
    return math.sqrt((count - 1.0) * float(np.var(shares))) if shares else 0.0


def _shares_by(
    of: Sequence[str], active: NDArray[np.bool_], first: Array, then: Array, number: Array
) -> dict[str, float]:
    shares = {}
    for name in dict.fromkeys(of):
        at = active & np.array([each == name for each in of])
        gone, left = float((first - then)[at].sum()), float((then - number)[at].sum())
        whole = gone + max(left, 0.0)
        shares[name] = gone / whole if whole > 0.0 else math.nan
    return shares


def _shares_by_phase(
    before: Model,
    after: Model,
    runs: Sequence[GapRun],
    floor: Floor,
    cells: Sequence[Cell],
    active: NDArray[np.bool_],
) -> dict[str, float]:
    """Return shares of energy above the floor by phase, in the bands with a gap of each profile."""
    bands: dict[str, set[int]] = {}
    for cell, on in zip(cells, active, strict=True):
        if on:
            bands.setdefault(cell.profile, set()).add(cell.band)
    excess: dict[str, Array] = {}
    for group in group_runs(runs):
        for run in group.flat:
            n, period_s = len(run.stimulus), run.stimulus.period_s
            power = power_in(group, after.noise)
            own = transformed(run, left_by(run, (before, after)), after.noise) / np.sqrt(power)
            for band in bands.get(group.profile, set()):
                part = band_slices(n, period_s)[band]
                expected = (part.stop - part.start) / n
                energy = [in_time(row[None], part) / floor.ratio[band] - expected for row in own]
                for phase in dict.fromkeys(run.phase.tolist()):
                    at = (run.phase == phase) & ~run.missing
                    key = f"{group.profile}: {phase}"
                    excess[key] = excess.get(key, np.zeros(2)) + [each[at].sum() for each in energy]
    total = sum(max(float(each[0]), 0.0) for each in excess.values()) or 1.0
    return {
        key: float(1.0 - each[1] / each[0]) if each[0] > _LEAST_OF_GAP * total else math.nan
        for key, each in excess.items()
    }


def holding(closed: Model, without: Sequence[Model], runs: Sequence[GapRun], floor: Floor) -> list[float]:
    """Return which part of what a model adds to each of others is there in some runs: 1 for all of it.

    Below one half the runs come nearer with the other model. NaN where both say the same. What both leave in a
    cell beyond its noise is something else, and makes the cell count less.
    """
    runs = without_disturbances(runs, closed).runs
    cells = rescaled(judged_cells((closed, *without), runs), floor.ratio)
    products = np.stack([cell.products(np.arange(1 + len(without))) for cell in cells])
    number, own = counts(cells), products[:, 0, 0]
    parts = []
    for place in range(1, 1 + len(without)):
        other = products[:, place, place]
        weight = 1.0 / np.maximum(np.minimum(own, other) / number, 1.0)
        added = float(weight @ (own + other - 2.0 * products[:, 0, place]))
        gone = float(weight @ (other - own))
        parts.append(0.5 + 0.5 * gone / added if added > _SEEN else math.nan)
    return parts


def judged_cells(models: Sequence[Model], runs: Sequence[GapRun]) -> list[Cell]:
    """Return cells of what models leave of runs, Gram (m, m)."""
    cells = []
    noise = models[-1].noise
    for group in group_runs(runs):
        stack = stacked(group.flat, lambda run: [left_by(run, models)], [False], noise)
        cells += group_cells(group, stack, noise)
    return cells


def left_by(run: GapRun, models: Sequence[Model]) -> Array:
    """Return what models leave of a run's output, (models, n)."""
    return run.output_dph - np.stack([model.predict(run.stimulus) for model in models])


def _rms(cells: Sequence[Cell], energy: Array, active: NDArray[np.bool_]) -> float:
    """Return the rms over the runs of what is above the floor in the active cells, deg/h."""
    samples = {(cell.profile, cell.parity, cell.repeatable): cell.samples for cell in cells}
    power = np.array([cell.power for cell in cells])
    excess = (np.maximum(energy - counts(cells), 0.0) * power)[active].sum()
    return math.sqrt(float(excess) / sum(samples.values()))
