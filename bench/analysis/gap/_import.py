"""Recordings of other software as the diagnosis sees them: by a mapping file, without making run folders."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._data import GapRun, stand_ins
from bench.record.exchange import LogEntry, Mapping, read_log, read_mapping
from bench.record.recording import Run, names_at, row_means
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS
from drivers.base.errors import ConfigurationError
from simulators.effects import Stimulus


def read_mapped_runs(path: Path) -> list[GapRun]:
    """Return the runs that a mapping file lists (see `bench.record.exchange.read_mapping`), as 1 s means.

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
    count = math.floor(time_s[-1])
    row = np.ceil(time_s).astype(np.int64) - 1

    def means(key: str) -> Array:
        return row_means(log.columns[key], row, count)

    t_in, t_out = (_bridged(means(key)) if key in log.columns else None for key in ("t_in", "t_out"))
    t_in, t_out = stand_ins(t_in, t_out, count)
    edges = np.arange(count + 1.0)
    angle = np.full(count + 1, entry.angle_deg or 0.0)
    if "angle" in log.columns:
        angle = np.interp(edges, time_s, log.columns["angle"])
    elevation = np.full(count, entry.elevation_deg)
    if "elevation" in log.columns:
        elevation = _bridged(means("elevation"))
    stimulus = Stimulus(
        edges[1:] + entry.power_on_s,
        t_in,
        t_out,
        angle,
        elevation,
        mapping.latitude_deg,
    )
    return GapRun(
        entry.run_id or file.stem,
        mapping.unit_id,
        entry.profile or file.stem,
        entry.condition,
        stimulus,
        DPH_PER_DPS * means("output"),
        _phases(entry, edges[1:]),
    )


def _bridged(values: Array) -> Array:
    """Return temperatures with missing seconds interpolated; all NaN stays so and is refused later."""
    known = ~np.isnan(values)
    at = np.arange(len(values))
    return np.asarray(np.interp(at, at[known], values[known])) if known.any() else values


def _phases(entry: LogEntry, times_s: Array) -> NDArray[np.str_]:
    starts, names = [phase.start_s for phase in entry.phases], [phase.name for phase in entry.phases]
    return names_at(starts or [0.0], names or ["run"], times_s - 0.5)
