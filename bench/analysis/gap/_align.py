"""Time alignment before any fit: whole samples by which the gyro's clock is off the table's, and parts of one.

A part of a sample is the catalogue's effect `time_offset`, which is in proportion to the offset. Where the table
swings, what is of second order is more than noise: then the effect's column is what the offset that the runs show
does, over that offset.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from bench.analysis.gap._data import SIGMA_OF_SECOND_DIFFERENCES, GapRun
from bench.analysis.gap._model_file import Model
from drivers.base.arrays import Array
from simulators.effects import Effect, catalogue

_TIME_OFFSET = "time_offset"
_MOST = 5
_LEAST_CHANGE_DPS = 0.5
_CLEAR = 0.5
"""A shift must leave at most this part of the energy that no shift leaves."""
_PASSES, _NEAR_MS = 8, 1e-3
"""Steps to the offset, and how small the last one is."""
_DOUBT = 0.1
"""Part of what an offset does at a corner of the rate that its unknown course within a row may be."""
_THIRD, _CODES = 3, 25.0
"""Order of the differences that tell a corner; three sigma of them where codes of the angle have a sigma of 1."""
_SHOWS = 9.0
"""Energy of what is of second order, and of what is left, in variances of the noise, from which it counts."""


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
    """Return by how much the gyro is early against the table, ms, as runs show it; 0 where first order will do.

    Other effects that act where the rate changes can make it wrong by some ms, which is of second order then.
    """
    swings = [_Swing(run) for run in runs]
    found = _found_ms(swings, model)
    noises = (swing.sigma_dph(found * swing.over(found)) for swing in swings)
    quietest = min((sigma for sigma in noises if sigma > 0.0), default=0.0)
    return found if sum(swing.bend(found) for swing in swings) > _SHOWS * quietest**2 else 0.0


def without_corners(runs: Sequence[GapRun], model: Model) -> list[GapRun]:
    """Return the runs without the rows at corners of the rate that show less than an offset leaves in doubt.

    Where the model has an offset, its size is known and no gap; how a table goes round a corner within a row is
    not, and moves that row by a tenth of what the offset does. Without one in the model every row is kept: it is
    looked for.
    """
    if all(term.name != _TIME_OFFSET for term in model.terms):
        return list(runs)
    swings = [_Swing(run) for run in runs]
    found = _found_ms(swings, model)
    result = []
    for swing in swings:
        doubt = _DOUBT * abs(found) * swing.corners
        hidden = doubt > swing.sigma_dph(found * swing.over(found))
        run = swing.run
        result.append(
            replace(run, output_dph=np.where(hidden, np.nan, run.output_dph)) if hidden.any() else run
        )
    return result


def _found_ms(swings: Sequence[_Swing], model: Model) -> float:
    """Return the offset that runs show, with what the model says of it, ms."""
    known = [term for term in model.terms if term.name == _TIME_OFFSET]
    said_ms = sum(term.values[0] for term in known)
    told = 1.0 / sum(term.sigmas[0] ** 2 for term in known) if known else 0.0
    fit, found = _fitted(swings, [swing.at_once for swing in swings]), said_ms
    for _ in range(_PASSES):
        if not fit.weight + told:
            return 0.0
        # what the model says is one more reading of the offset
        before, found = found, (fit.weight * fit.offset_ms + told * said_ms) / (fit.weight + told)
        fit = _fitted(swings, [swing.over(found) for swing in swings])
        if abs(found - before) < _NEAR_MS:
            break
    return found


def over_offset(runs: Sequence[GapRun], early_ms: float) -> list[GapRun]:
    """Return the runs with what an offset does over one of so many ms and not at once; 0: as they are.

    As they are, too, where the effect's forms fit clearly better: between samples of a second nobody knows how a
    table goes round a corner, and they try it.
    """
    if not early_ms:
        return list(runs)
    forms = _effect().variants()
    result = []
    for run in runs:
        swing = _Swing(run)
        over = swing.over(early_ms)
        least = min(swing.left(early_ms * form.columns(run.stimulus)[0]) for form in forms)
        variance = least / max(len(swing.jumps(swing.error_dph)), 1)
        worse = swing.left(early_ms * over) > least + _SHOWS * variance
        result.append(run if worse else replace(run, stimulus=replace(run.stimulus, over_offset_dph=over)))
    return result


@dataclass(frozen=True, eq=False)
class _Swing:
    """What a run shows of an offset between the clocks of its gyro and its table."""

    run: GapRun

    @cached_property
    def error_dph(self) -> Array:
        """The output less the input rate, deg/h (n,)."""
        return np.asarray(self.run.output_dph - self.run.stimulus.input_rate_dph)

    @cached_property
    def at_once(self) -> Array:
        """What the first ms of an offset does, deg/h (n,)."""
        return np.asarray(
            _effect().columns(replace(self.run.stimulus, over_offset_dph=None), {"side": 0.0})[0]
        )

    @cached_property
    def corners(self) -> Array:
        """How much each ms of an offset does within a row where the rate changes at once, deg/h (n,).

        By third differences of the rate between the log's own rows, less what codes of the angle make: of a
        motion that rows resolve they are small.
        """
        s, noise = self.run.stimulus, self.run.rounding_noise
        rows_s, angle_deg = self.rows
        row_s = np.diff(rows_s)
        # the code that is usual: at a corner what is read of it is no code
        code_deg = 0.0 if noise is None else float(np.median(noise.sigma_deg))
        bent_dps = np.pad(np.abs(np.diff(np.diff(angle_deg) / row_s, _THIRD)), (2, 1), mode="edge")
        bent_dps = np.maximum(bent_dps - _CODES * code_deg / row_s, 0.0)
        near = np.pad(bent_dps, 1, mode="edge")
        bent_dps = np.maximum.reduce([near[:-2], bent_dps, near[2:]]) / _THIRD
        # each sample has the sharpest corner of its rows
        ends_s = s.period_s * np.arange(len(s) + 1.0)
        row = np.clip(np.searchsorted(rows_s, ends_s + 1e-6 * s.period_s, "right") - 1, 0, len(row_s) - 1)
        last = np.clip(np.searchsorted(rows_s, ends_s[1:] - 1e-6 * s.period_s) - 1, row[:-1], len(row_s) - 1)
        pairs = np.column_stack((row[:-1], last + 1)).ravel()
        corner_dps = np.maximum.reduceat(np.append(bent_dps, 0.0), pairs)[::2]
        along = np.abs(np.sin(np.radians(s.elevation_deg)))
        return np.asarray(3.6 / s.period_s * along * corner_dps)

    @cached_property
    def rows(self) -> tuple[Array, Array]:
        """Times from the run's start, s, and the table's angle, deg, (m,) each, at the log's own rows."""
        s = self.run.stimulus
        return self.run.table_rows or (s.period_s * np.arange(len(s) + 1.0), s.angle_deg)

    @cached_property
    def between(self) -> CubicSpline:
        """The table's angle, deg, over time from the run's start, s."""
        return CubicSpline(*self.rows)

    def angle_at(self, times_s: Array) -> Array:
        """Return the table's angle, deg (k,), at times from the run's start; beyond the log it turns on."""
        rows_s, angle_deg = self.rows
        inside_s = np.clip(times_s, rows_s[0], rows_s[-1])
        steady_dps = (np.diff(angle_deg) / np.diff(rows_s))[[0, -1]]
        beyond_s = times_s - inside_s
        return np.asarray(self.between(inside_s) + np.where(beyond_s < 0.0, *steady_dps) * beyond_s)

    def over(self, early_ms: float) -> Array:
        """Return what each ms of an offset does on the way to that one, deg/h (n,)."""
        if not early_ms:
            return self.at_once
        s = self.run.stimulus
        edges_s = s.period_s * np.arange(len(s) + 1.0)
        later_deg, now_deg = (self.angle_at(edges_s + late_s) for late_s in (1e-3 * early_ms, 0.0))
        along = 3600.0 / s.period_s * np.sin(np.radians(s.elevation_deg))
        return np.asarray(along * np.diff(later_deg - now_deg) / early_ms)

    def jumps(self, values_dph: Array) -> Array:
        """Return second differences of values (n,) where the output is known, less what a scale factor does.

        Slow effects hardly move them. Of a table that swings, the second order of an offset is in proportion to
        the rate.
        """
        known = ~np.isnan(np.diff(self.error_dph, 2))
        jumps, rate = (np.diff(each, 2)[known] for each in (values_dph, self.run.stimulus.input_rate_dph))
        return np.asarray(jumps - rate * float(rate @ jumps) / max(float(rate @ rate), 1e-300))

    def left(self, does_dph: Array) -> float:
        """Return the energy that what an offset does leaves, in second differences."""
        return float(np.square(self.jumps(self.error_dph - does_dph)).sum())

    def bend(self, early_ms: float) -> float:
        """Return the energy of what is of second order in an offset where the output is known, (deg/h)^2."""
        bent = 0.5e-3 * early_ms**2 * np.gradient(self.at_once, self.run.stimulus.period_s)
        return float(np.square(bent[~np.isnan(self.error_dph)]).sum())

    def sigma_dph(self, does_dph: Array) -> float:
        """Return the noise from sample to sample beside what an offset does; 0 where none is seen."""
        jumps = np.abs(self.jumps(self.error_dph - does_dph))
        return SIGMA_OF_SECOND_DIFFERENCES * float(np.median(jumps)) if len(jumps) else 0.0


def _effect() -> Effect:
    effect = catalogue()[_TIME_OFFSET]
    assert isinstance(effect, Effect)
    return effect


class _Fit(NamedTuple):
    """An offset fitted to runs, ms, and its weight, 1/ms^2."""

    offset_ms: float
    weight: float


def _fitted(swings: Sequence[_Swing], columns: Sequence[Array]) -> _Fit:
    """Fit what an offset does to what runs show."""
    crossed = squared = energy = 0.0
    count = 0
    for swing, column in zip(swings, columns, strict=True):
        error, change = swing.jumps(swing.error_dph), swing.jumps(column)
        crossed += float(error @ change)
        squared += float(change @ change)
        energy += float(error @ error)
        count += len(error)
    if not squared:
        return _Fit(0.0, 0.0)
    return _Fit(crossed / squared, squared * count / max(energy - crossed**2 / squared, 1e-300))


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
