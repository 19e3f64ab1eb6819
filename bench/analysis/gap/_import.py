"""Recordings of other software as the diagnosis sees them: by a mapping file, without making run folders."""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._data import GapRun, stand_ins
from bench.record.exchange import LogEntry, Mapping, read_log, read_mapping
from bench.record.recording import Run, names_at
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS
from drivers.base.errors import ConfigurationError
from simulators.effects import Stimulus

_PAUSE = 1.5
"""Times the usual time between rows from which on rows are missing."""
_UNCOVERED = 0.02
"""Part of a step that rows may leave uncovered: jitter of time stamps."""
_INSTANT_S = 1e-6
_FINE = 0.5
"""Part of the values that differ from which on a repeated value is no chance."""


def read_mapped_runs(path: Path) -> list[GapRun]:
    """Return the runs that a mapping file lists (see `bench.record.exchange.read_mapping`), as means over 1 s
    or, where rows are further apart, over the time between rows.

    A temperature that is not recorded is taken to equal the other one: the diagnosis says what is then not seen.
    ConfigurationError says what a mapping or file lacks.
    """
    mapping = read_mapping(path)
    return [_run(entry, mapping, path.parent / entry.file) for entry in mapping.run]


def read_imported_run(run: Run) -> GapRun:
    """Return a run made by `gyrobench import`, from the log and the mapping that it keeps."""
    imported = run.manifest.imported
    if imported is None:
        raise ConfigurationError("this run was not imported", where=str(run.place))
    mapping, log = read_mapping(run.file(imported.mapping)), run.file(imported.log)
    made = _run(mapping.entry_for(log, log), mapping, log)
    return replace(made, run_id=run.manifest.run_id, checksum=run.checksum)


def _run(entry: LogEntry, mapping: Mapping, file: Path) -> GapRun:
    log = read_log(file, mapping.columns)
    time_s = log.time_s - log.time_s[0]
    grid = _Grid.of(time_s)

    def means(key: str) -> Array:
        return grid.means(log.columns[key])

    t_in, t_out = (_bridged(means(key)) if key in log.columns else None for key in ("t_in", "t_out"))
    t_in, t_out = stand_ins(t_in, t_out, grid.count)
    rows = log.columns["output"]
    held = held_rows(rows)
    edges, output = grid.edges_s, DPH_PER_DPS * grid.means(np.where(held, np.nan, rows))
    angle, edge_rate = np.full(grid.count + 1, entry.angle_deg or 0.0), None
    if "angle" in log.columns:
        angle = np.interp(edges, time_s, log.columns["angle"])
        edge_rate = grid.edge_rates(log.columns["angle"])
        output[grid.in_pause(edges[:-1]) | grid.in_pause(edges[1:])] = np.nan
    elevation = np.full(grid.count, entry.elevation_deg)
    if "elevation" in log.columns:
        elevation = _bridged(means("elevation"))
    stimulus = Stimulus(
        edges[1:] + entry.power_on_s,
        t_in,
        t_out,
        angle,
        elevation,
        mapping.latitude_deg,
        grid.period_s,
        edge_rate,
    )
    return GapRun(
        entry.run_id or file.stem,
        mapping.unit_id,
        entry.profile or file.stem,
        entry.condition,
        stimulus,
        output,
        _phases(entry, edges[1:] - grid.period_s + 1.0),
        _checksum(file),
        float(held.mean()),
    )


def held_rows(values: Array) -> NDArray[np.bool_]:
    """Return which rows only repeat the one before, (n,): a logger does that where a sample is lost.

    None of a signal so coarse that neighbours are often equal by themselves: there repeats say nothing.
    """
    same = np.concatenate(([False], values[1:] == values[:-1]))
    known = values[~np.isnan(values)]
    if len(np.unique(known)) < _FINE * len(known):
        same[:] = False
    return same


@dataclass(frozen=True)
class _Grid:
    """Equal steps of `period_s` for rows at `time_s` (m,), each of which covers the time since the one before.
    `pauses_s` (2, p) are where rows are missing.

    A row after a pause covers the usual time between rows, no more: what lies before it is missing. A step counts
    only if rows cover all of it: a mean over part of a step is off by whatever the rate did in the rest.
    """

    time_s: Array
    covers_s: Array
    pauses_s: Array
    usual_s: float
    period_s: float
    count: int

    @classmethod
    def of(cls, time_s: Array) -> _Grid:
        """Return steps of 1 s, or as long as the time between rows where that is more, for rows from 0 s on."""
        apart = np.diff(time_s)
        usual_s = float(np.median(apart)) if len(apart) else 1.0
        period_s = max(1.0, round(usual_s, 3))
        pause = apart > _PAUSE * usual_s
        covers = np.concatenate(([0.0], np.where(pause, usual_s, apart)))
        pauses = np.stack((time_s[:-1][pause], time_s[1:][pause]))
        return cls(
            time_s, covers, pauses, usual_s, period_s, math.floor((time_s[-1] + _INSTANT_S) / period_s)
        )

    @property
    def edges_s(self) -> Array:
        """Borders of the steps, (count + 1,)."""
        return np.asarray(self.period_s * np.arange(self.count + 1.0))

    def in_pause(self, times_s: Array) -> NDArray[np.bool_]:
        """Return whether times lie between two rows where rows are missing: no angle is known there."""
        starts, stops = self.pauses_s
        if not len(starts):
            return np.zeros(len(times_s), dtype=bool)
        at = np.searchsorted(starts, times_s - _INSTANT_S, side="right") - 1
        return np.asarray((at >= 0) & (times_s < stops[np.maximum(at, 0)] - _INSTANT_S))

    def edge_rates(self, angle_deg: Array) -> Array | None:
        """Return the rate at the borders, (count + 1,), from rows at most half a step apart; None for others."""
        if self.usual_s > 0.5 * self.period_s:
            return None
        around = self.edges_s + 0.5 * self.usual_s * np.array([[-1.0], [1.0]])
        before, after = np.interp(around, self.time_s, angle_deg)
        return np.asarray((after - before) / self.usual_s)

    def means(self, values: Array) -> Array:
        """Return means of rows' values (m,) over the steps, (count,), NaN where rows do not cover a step."""
        known = ~np.isnan(values)
        covered = self._over_steps(np.where(known, 1.0, 0.0))
        sums = self._over_steps(np.where(known, values, 0.0))
        whole = covered > (1.0 - _UNCOVERED) * self.period_s
        return np.where(whole, sums / np.maximum(covered, 1e-9), np.nan)

    def _over_steps(self, values: Array) -> Array:
        """Return the integral of rows' values over each step, nothing where no row is, (count,)."""
        starts = self.time_s - self.covers_s
        times = np.stack((starts, self.time_s), axis=1).ravel()
        before = np.concatenate(([0.0], np.cumsum(values * self.covers_s)))
        sums = np.stack((before[:-1], before[1:]), axis=1).ravel()
        return np.diff(np.interp(self.edges_s, times, sums))


def _checksum(file: Path) -> str:
    with file.open("rb") as log:
        return hashlib.file_digest(log, "sha256").hexdigest()


def _bridged(values: Array) -> Array:
    """Return temperatures with missing steps interpolated; all NaN stays so and is refused later."""
    known = ~np.isnan(values)
    at = np.arange(len(values))
    return np.asarray(np.interp(at, at[known], values[known])) if known.any() else values


def _phases(entry: LogEntry, times_s: Array) -> NDArray[np.str_]:
    starts, names = [phase.start_s for phase in entry.phases], [phase.name for phase in entry.phases]
    return names_at(starts or [0.0], names or ["run"], times_s - 0.5)
