"""Recordings of other software as the diagnosis sees them: by a mapping file, without making run folders."""

from __future__ import annotations

import hashlib
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import poisson

from bench.analysis.gap._data import GapRun, interpolated, stand_ins
from bench.analysis.gap._rows import Steps, steady_beside, true_times
from bench.record.exchange import LogEntry, Mapping, read_log, read_mapping
from bench.record.recording import Run, names_at
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS
from drivers.base.errors import ConfigurationError
from simulators.effects import Stimulus

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


def read_mapped_runs(path: Path) -> list[GapRun]:
    """Return the runs that a mapping file lists (see `bench.record.exchange.read_mapping`), as means over
    as many rows as make up 1 s or more.

    A temperature that is not recorded is taken to equal the other one: the diagnosis says what is then not seen.
    ConfigurationError says what a mapping or file lacks.
    """
    mapping = read_mapping(path)
    logs = mapping.logs(path)
    runs = [_run(entry, mapping, file) for entry, file in logs]
    same = Counter(entry.run_id for entry, _ in logs)
    return [
        replace(run, run_id=file.stem) if same[entry.run_id] > 1 else run
        for run, (entry, file) in zip(runs, logs, strict=True)
    ]


def read_imported_run(run: Run) -> GapRun:
    """Return a run made by `gyrobench import`, from the log and the mapping that it keeps."""
    imported = run.manifest.imported
    if imported is None:
        raise ConfigurationError("this run was not imported", where=str(run.place))
    mapping, log = read_mapping(run.file(imported.mapping)), run.file(imported.log)
    made = _run(mapping.entry_for(log, log), mapping, log)
    return replace(made, run_id=run.manifest.run_id, checksum=run.checksum)


def _run(entry: LogEntry, mapping: Mapping, file: Path) -> GapRun:
    log = read_log(file, mapping)
    if "output" not in log.columns:
        raise ConfigurationError(
            "the mapping file names no gyro",
            where=file.name,
            found=", ".join(log.columns),
            expected="output, or gyros with the axis of test: the gap is looked for in its rate",
        )
    rows = log.columns["output"]
    held = held_rows(rows)
    use, time_s = ~np.isnan(rows) & ~held, log.time_s - log.time_s[0]
    turned_deg = log.columns.get("angle")
    if turned_deg is not None:
        # without the angle at both ends of a row nobody knows how far the table turned in it
        known = ~np.isnan(turned_deg)
        use &= known & np.append(True, known[:-1])
        turned_deg = interpolated(turned_deg)
        time_s = true_times(time_s, np.where(use, rows, np.nan), turned_deg)
    steps = Steps.of(time_s, use)

    def means(key: str) -> Array:
        return steps.means(log.columns[key])

    t_in, t_out = (interpolated(means(key)) if key in log.columns else None for key in ("t_in", "t_out"))
    t_in, t_out = stand_ins(t_in, t_out, steps.count)
    output = np.where(steps.whole, DPH_PER_DPS * steps.means(rows, steps.use), np.nan)
    angle, edge_rate = entry.table_angle_deg(steps.edges_s), None
    angle = np.zeros(steps.count + 1) if angle is None else angle
    if turned_deg is not None:
        angle, edge_rate = steps.angles(turned_deg)
        angle = angle if edge_rate is not None else steady_beside(angle, np.isnan(output))
    elevation = np.full(steps.count, entry.elevation_deg)
    if "elevation" in log.columns:
        elevation = interpolated(means("elevation"))
    ends_s = steps.edges_s[1:]
    time_s, latitude_deg = ends_s + entry.power_on_s, mapping.latitude_deg
    stimulus = Stimulus(time_s, t_in, t_out, angle, elevation, latitude_deg, steps.period_s, edge_rate)
    simulated = "foretold" in log.columns
    if simulated:
        left = steps.means(rows - log.columns["foretold"], steps.use)
        output = np.where(steps.whole, DPH_PER_DPS * left + stimulus.input_rate_dph, np.nan)
    return GapRun(
        entry.run_id or file.stem,
        mapping.unit_id,
        entry.profile or file.stem,
        entry.condition,
        stimulus,
        output,
        _phases(entry, ends_s - steps.period_s + 1.0),
        _checksum(file),
        float(held.mean()),
        3600.0 * _finest_angle_deg(rows, log.time_s, steps.usual_s),
        simulated,
        _even_rows(steps, rows),
        steps.usual_s,
        log.remarks,
    )


def _even_rows(steps: Steps, rows: Array) -> Array | None:
    """Return the rows of a log (m,) on their grid, NaN where one is missing; None for uneven or slow ones."""
    place = np.rint((steps.time_s - steps.time_s[0]) / steps.usual_s).astype(np.int64)
    off = np.abs(steps.time_s - steps.time_s[0] - place * steps.usual_s).max(initial=0.0)
    if (
        off > _UNEVEN * steps.usual_s
        or place[-1] > _MOST_PLACES * len(rows)
        or steps.usual_s > 0.5 * steps.period_s
    ):
        return None
    even = np.full(int(place[-1]) + 1, np.nan)
    even[place] = rows
    return even


def _finest_angle_deg(rows: Array, time_s: Array, usual_s: float) -> float:
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
    expected = 0.0
    for start in range(0, len(values), _BLOCK):
        block = values[start : start + _BLOCK]
        block = block[~np.isnan(block)]
        own, at, often = np.unique(block, return_inverse=True, return_counts=True)
        begins = np.append(True, at[1:] != at[:-1])
        often = often[np.bincount(at[begins], minlength=len(own)) > 1] if len(block) else often
        expected += float((often * (often - 1)).sum()) / max(len(block), 1)
    return expected


def _checksum(file: Path) -> str:
    with file.open("rb") as log:
        return hashlib.file_digest(log, "sha256").hexdigest()


def _phases(entry: LogEntry, times_s: Array) -> NDArray[np.str_]:
    starts, names = [phase.start_s for phase in entry.phases], [phase.name for phase in entry.phases]
    return names_at(starts or [0.0], names or ["run"], times_s - 0.5)
