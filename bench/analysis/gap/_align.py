"""Time alignment before any fit: whole samples by which the gyro's clock is off the table's, and parts of one.

A part of a sample is the catalogue's effect `time_offset`, of first order in the offset: where the table swings,
what is of second order is no gap. A model with that effect says that the clocks of its bench are apart; its runs
are then read at the offset that they show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from bench.analysis.gap._data import GapRun
from bench.analysis.gap._model_file import Model, Term
from drivers.base.arrays import Array

TIME_OFFSET = "time_offset"
_MOST = 5
_LEAST_CHANGE_DPS = 0.5
_CLEAR = 0.5
"""A shift must leave at most this part of the energy that no shift leaves."""
_PASSES, _NEAR_MS = 8, 1e-3
"""Newton's steps to the offset, and how small the last one is."""
_BETTER = 0.98
"""Part of what the effect's column leaves that is left at the offset where the column is not enough."""


def aligned(runs: Sequence[GapRun]) -> tuple[list[GapRun], list[str]]:
    """Return the runs with their table angles shifted by whole samples where needed, and what was shifted.

    What is left of a sample is the catalogue's effect `time_offset`. A run at constant rate, or one whose changes
    of rate are missing, shows no shift; where all that show one show the same, it has that.
    """
    shown = [_shift(run) for run in runs]
    seconds = {
        shift * run.stimulus.period_s for run, shift in zip(runs, shown, strict=True) if shift is not None
    }
    common_s = seconds.pop() if len(seconds) == 1 else 0.0
    result, notes = [], []
    for run, own in zip(runs, shown, strict=True):
        shift = round(common_s / run.stimulus.period_s) if own is None else own
        result.append(_shifted(run, shift) if shift else run)
        if shift:
            word = "late" if shift > 0 else "early"
            notes.append(
                f"{run.run_id}: the gyro's samples are {abs(shift) * run.stimulus.period_s:g} s {word} against "
                f"the table{', as in the other runs' if own is None else ''}; aligned before the fit, a "
                "remaining part of a sample shows as time_offset"
            )
    return result, notes


def offset_ms(runs: Sequence[GapRun], model: Model) -> float:
    """Return by how much a model's gyro is early against its table, ms, as the runs show it.

    0 for a model that says nothing of it, and where the effect's own column does as well. Other effects that act
    where the rate changes can make it wrong by some ms: the column takes the rest.
    """
    known = [term for term in model.terms if term.name == TIME_OFFSET]
    if not known:
        return 0.0
    said_ms = sum(term.values[0] for term in known)
    told = 1.0 / sum(term.sigmas[0] ** 2 for term in known)
    alone, found = _fitted(runs, 0.0), said_ms
    for _ in range(_PASSES):
        fit = _fitted(runs, found)
        # what the model says is one more reading of the offset
        change = (fit.weight * fit.step_ms + told * (said_ms - found)) / (fit.weight + told)
        found += change
        if abs(change) < _NEAR_MS:
            break
    return found if fit.left < _BETTER * alone.left else 0.0


def read_at(runs: Sequence[GapRun], early_ms: float) -> list[GapRun]:
    """Return the runs with the table's angle as it was when the gyro's samples were taken, `early_ms` later."""
    return [_moved(run, early_ms) for run in runs] if early_ms else list(runs)


def read_with(model: Model, early_ms: float) -> Model:
    """Return the model of runs that are read at an offset, what is left of which it has; 0 for as they are."""
    if not early_ms:
        return model
    return replace(
        model,
        terms=tuple(
            replace(term, values=(0.0,)) if term.name == TIME_OFFSET else term for term in model.terms
        ),
    )


def with_offset(terms: Sequence[Term], early_ms: float) -> tuple[Term, ...]:
    """Return terms of which the first time offset has that more, at which the runs were read."""
    first = next((term for term in terms if term.name == TIME_OFFSET), None)
    return tuple(
        replace(term, values=(term.values[0] + early_ms,)) if term is first else term for term in terms
    )


def _change(run: GapRun) -> Array:
    """Return how much the input rate grows in each sample by its period, deg/h a ms: what an offset adds."""
    s = run.stimulus
    at_s = s.time_s - s.time_s[0]
    return np.asarray(1e-3 * np.gradient(s.input_rate_dph, at_s))


class _Fit(NamedTuple):
    """The change of an offset that runs ask for, ms, its weight, 1/ms^2, and the energy that it leaves."""

    step_ms: float
    weight: float
    left: float


def _fitted(runs: Sequence[GapRun], early_ms: float) -> _Fit:
    """Fit the effect's column to runs read at an offset, in second differences: slow effects hardly move them."""
    crossed = squared = energy = 0.0
    count = 0
    for run in read_at(runs, early_ms):
        error = np.diff(run.output_dph - run.stimulus.input_rate_dph, 2)
        change = np.diff(_change(run), 2)
        known = ~np.isnan(error)
        crossed += float(error[known] @ change[known])
        squared += float(change[known] @ change[known])
        energy += float(error[known] @ error[known])
        count += int(known.sum())
    if not squared:
        return _Fit(0.0, 0.0, energy)
    left = max(energy - crossed**2 / squared, 1e-300)
    return _Fit(crossed / squared, squared * count / left, left)


def _moved(run: GapRun, early_ms: float) -> GapRun:
    """Return a run with its table's angle some time later, between its log's rows where these are at hand."""
    s = run.stimulus
    edges_s = s.period_s * np.arange(len(s) + 1.0)
    times_s, rows_deg = run.table_rows or (edges_s, s.angle_deg)
    between = CubicSpline(times_s, rows_deg)
    turning = between.derivative()
    now_s = np.clip(edges_s, times_s[0], times_s[-1])
    later_s = np.clip(edges_s + 1e-3 * early_ms, times_s[0], times_s[-1])
    rate = s.edge_rate_dps
    if rate is not None:
        rate = rate + turning(later_s) - turning(now_s)
    angle = s.angle_deg + between(later_s) - between(now_s)
    return replace(run, stimulus=replace(s, angle_deg=angle, edge_rate_dps=rate))


def _shift(run: GapRun) -> int | None:
    """Return by how many samples the table's angle must be moved later to fit the output; None without a sign."""
    rate = run.stimulus.input_rate_dph
    at = np.arange(_MOST, len(rate) - _MOST)
    # a shift by this much must not reach what is missing: nothing is known of the table there
    near = np.convolve(run.missing, np.ones(2 * _MOST + 1), mode="valid") > 0.0
    at = at[~near[: len(at)]]
    if len(at) < 4 * _MOST or np.ptp(run.stimulus.axis_rate_dps[at]) < _LEAST_CHANGE_DPS:
        return None
    output = run.output_dph[at]
    left = {}
    for shift in range(-_MOST, _MOST + 1):
        columns = np.stack((np.ones(len(at)), rate[at - shift]))
        fit = np.linalg.lstsq(columns.T, output, rcond=None)[0]
        left[shift] = float(np.square(output - fit @ columns).sum())
    best = min(left, key=lambda each: left[each])
    if left[best] < _CLEAR * left[0]:
        return best
    return 0 if left[0] < _CLEAR * max(left.values()) else None


def _shifted(run: GapRun, shift: int) -> GapRun:
    s = run.stimulus
    edges = np.clip(np.arange(len(s) + 1) - shift, 0, len(s))
    rate = None if s.edge_rate_dps is None else s.edge_rate_dps[edges]
    noise = None if run.rounding_noise is None else run.rounding_noise.moved(edges)
    rows = run.table_rows
    if rows is not None:
        rows = rows[0] + shift * s.period_s, rows[1]
    stimulus = replace(s, angle_deg=s.angle_deg[edges], edge_rate_dps=rate)
    return replace(run, stimulus=stimulus, rounding_noise=noise, table_rows=rows)
