"""Recordings of other software as the diagnosis sees them: by a mapping file, without making run folders."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._data import GapRun, stand_ins
from bench.record.exchange import LogEntry, Mapping, read_log, read_mapping
from bench.record.recording import checksum, read_manifest
from bench.record.run_folder import MANIFEST_FILE
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects import Stimulus

_DPH = 3600.0


def read_mapped_runs(path: Path) -> list[GapRun]:
    """Return the runs that a mapping file lists (see `bench.record.exchange.read_mapping`), as 1 s means.

    A temperature that is not recorded is taken to equal the other one: the diagnosis says what is then not seen.
    ConfigurationError says what a mapping or file lacks.
    """
    mapping = read_mapping(path)
    return [_run(entry, mapping, path.parent / entry.file) for entry in mapping.run]


def read_imported_run(folder: Path) -> GapRun:
    """Return a run folder made by `gyrobench import`, from the log and the mapping that it keeps."""
    manifest = read_manifest(folder)
    if manifest.imported is None:
        raise ConfigurationError("this run was not imported", where=str(folder))
    mapping = read_mapping(folder / manifest.imported.mapping)
    log = folder / manifest.imported.log
    run = _run(mapping.entry_for(log, log), mapping, log)
    return replace(run, run_id=manifest.run_id, checksum=checksum(folder / MANIFEST_FILE).sha256)


def _run(entry: LogEntry, mapping: Mapping, file: Path) -> GapRun:
    log = read_log(file, mapping.columns)
    time_s = log.time_s - log.time_s[0]
    count = math.floor(time_s[-1])
    row = np.ceil(time_s).astype(np.int64) - 1

    def means(key: str) -> Array:
        return _second_means(log.columns[key], row, count)

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
        _DPH * means("output"),
        _phases(entry, edges[1:]),
    )


def _second_means(values: Array, row: NDArray[np.int64], count: int) -> Array:
    """Return means over each second, (count,), NaN where there is no value."""
    use = (row >= 0) & (row < count) & ~np.isnan(values)
    sums = np.bincount(row[use], values[use], count)
    samples = np.bincount(row[use], minlength=count)
    return np.where(samples > 0, sums / np.maximum(samples, 1), np.nan)


def _bridged(values: Array) -> Array:
    """Return temperatures with missing seconds interpolated; all NaN stays so and is refused later."""
    known = ~np.isnan(values)
    at = np.arange(len(values))
    return np.asarray(np.interp(at, at[known], values[known])) if known.any() else values


def _phases(entry: LogEntry, times_s: Array) -> NDArray[np.str_]:
    starts = np.array([phase.start_s for phase in entry.phases] or [0.0])
    names = np.array([phase.name for phase in entry.phases] or ["run"])
    return np.asarray(names[np.maximum(np.searchsorted(starts, times_s - 0.5, side="right") - 1, 0)])
