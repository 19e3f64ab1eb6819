"""Recordings of other software as the diagnosis sees them: by a mapping file, without making run folders."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._data import GapRun, interpolated, stand_ins
from bench.analysis.gap._fast_data import FastRows
from bench.analysis.gap._fast_spectrum import FastSpectrum
from bench.analysis.gap._log_rows import even_rows, finest_angle_deg, held_rows
from bench.analysis.gap._mapped import MappedLog, imported_log, mapped_logs
from bench.analysis.gap._other_axes import OtherAxes, other_axes
from bench.analysis.gap._rounding_noise import rounding_noise, step_deg
from bench.analysis.gap._rows import Steps, finer_rows, steady_beside, true_times
from bench.record.exchange import Log, LogEntry, Mapping
from bench.record.recording import Run, names_at
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS
from drivers.base.errors import ConfigurationError
from simulators.effects import Stimulus

_BENT_DEG = 0.5
"""Second difference of a row's elevation from which on nobody knows what it was within the row."""
_ENOUGH_STEPS = 256
"""Steps of a second that a log must have; one of fewer and of many rows is cut more finely."""
_WHOLE, _ROWS, _MOST_STEPS = 0.65, 1.5, 50_000
"""Steps that are whole against rows that are there, parts of all, below which steps are halved; rows that a step
keeps, and steps that are enough.
"""


def read_mapped_runs(path: Path, gyro: str | None = None) -> list[GapRun]:
    """Return the runs that a mapping file lists (see `bench.record.exchange.read_mapping`), as means over
    as many rows as make up 1 s or more; `gyro`: the axis of another of its gyros than that of test.

    A temperature that is not recorded is taken to equal the other one: the diagnosis says what is then not seen.
    ConfigurationError says what a mapping or file lacks.
    """
    return [rate_of(made, gyro) for made in mapped_logs(path)]


def read_imported_run(run: Run) -> GapRun:
    """Return a run made by `gyrobench import`, from the log and the mapping that it keeps."""
    return rate_of(imported_log(run))


def axes_of(mapping: Mapping) -> list[str]:
    """Return the axes whose gyros a mapping names, that of test first; it alone where it names one output."""
    named = sorted(mapping.columns.gyros, key=lambda axis: (axis != mapping.axis, axis))
    return [mapping.axis] if mapping.columns.output is not None or mapping.axis not in named else list(named)


def rate_of(made: MappedLog, gyro: str | None = None) -> GapRun:
    """Return the rate of a log's gyro: that of test, by its name in the mapping, too, or that of an axis.

    ConfigurationError for a log without such a gyro.
    """
    entry, mapping = made.entry, made.mapping
    axis = mapping.axis if gyro in (None, mapping.gyro) else str(gyro)
    log = _of_axis(made.log, mapping, axis, made.file.name)
    rows = log.columns["output"]
    held = held_rows(rows)
    steps, turned_deg = _steps(log, held)
    stimulus, around = _stimulus(entry, mapping, log, steps, axis, turned_deg)
    output = np.where(steps.whole, DPH_PER_DPS * steps.means(rows, steps.use), np.nan)
    left_rows, simulated = rows, "foretold" in log.columns
    if simulated:
        left_rows = rows - log.columns["foretold"]
        left = steps.means(left_rows, steps.use)
        output = np.where(steps.whole, DPH_PER_DPS * left + stimulus.input_rate_dph, np.nan)
    output = np.where(around.moving, np.nan, output - around.apart_dph)
    phases = _phases(entry, steps.edges_s[1:] - steps.period_s + 1.0)
    even, owner = even_rows(steps, np.where(held, np.nan, left_rows))
    span_s = np.where(steps.whole, steps.stops_s - steps.starts_s, steps.period_s)
    fast: tuple[FastSpectrum, ...] = ()
    if even is not None:
        owner = np.where(np.isin(owner, np.flatnonzero(~np.isnan(output))), owner, -1)
        finer = FastRows(np.where(owner < 0, np.nan, even), steps.usual_s, owner, stimulus, phases)
        fast, output = finer.spectra, output - finer.alias_dph
    logged_deg = log.other_rows.get("angle", log.columns.get("angle", np.empty(0)))
    return GapRun(
        made.run_id,
        mapping.unit_id if axis == mapping.axis else f"{mapping.unit_id} {axis}",
        entry.profile or made.file.stem,
        entry.condition,
        stimulus,
        output,
        phases,
        made.checksum,
        lost_fraction=float(held.mean()),
        finest_arcsec=3600.0 * finest_angle_deg(rows, log.time_s, steps.usual_s),
        simulated=simulated,
        rows_dps=even,
        row_s=steps.usual_s,
        remarks=(*log.remarks, *around.remarks),
        fast=fast,
        unknown_dph=around.unknown_dph,
        unknown_time_s=around.rest_s,
        power_on_told=entry.power_on_s is not None,
        rounding_noise=None
        if turned_deg is None
        else rounding_noise(stimulus.angle_deg, step_deg(logged_deg), steps.time_sigma_s, span_s),
        table_rows=None if turned_deg is None else finer_rows(steps, turned_deg),
    )


def _of_axis(log: Log, mapping: Mapping, axis: str, where: str) -> Log:
    """Return a log with an axis' gyro as its output; ConfigurationError if the mapping names none."""
    if "output" not in log.columns:
        raise ConfigurationError(
            "the mapping file names no gyro",
            where=where,
            found=", ".join(log.columns),
            expected="output, or gyros with the axis of test: the gap is looked for in its rate",
        )
    if axis not in axes_of(mapping):
        raise ConfigurationError(
            "the mapping file names no such gyro",
            where=where,
            found=axis,
            expected=", ".join([mapping.gyro, *axes_of(mapping)]),
        )
    if axis == mapping.axis:
        return log
    columns = dict(log.columns)
    columns |= {f"rate_{mapping.axis}": columns["output"], "output": columns.pop(f"rate_{axis}")}
    columns.pop("foretold", None)  # of the axis of test
    return replace(log, columns=columns)


def _steps(log: Log, held: NDArray[np.bool_]) -> tuple[Steps, Array | None]:
    """Return the steps that rows are averaged in, and the table's angle at the rows, bridged; None if unknown."""
    rows = log.columns["output"]
    use, time_s, stamped = ~np.isnan(rows) & ~held, log.time_s - log.time_s[0], False
    turned_deg = log.columns.get("angle")
    if "elevation" in log.columns:
        bent = (
            np.abs(np.diff(_within(log.columns["elevation"]), 2, prepend=np.nan, append=np.nan)) > _BENT_DEG
        )
        # of a jump within a row only the rows beside it are bent
        use &= ~(bent | np.append(bent[1:], False) | np.append(False, bent[:-1]))
    if turned_deg is not None:
        # without the angle at both ends of a row nobody knows how far the table turned in it
        known = ~np.isnan(turned_deg)
        use &= known & np.append(True, known[:-1])
        turned_deg = interpolated(turned_deg)
        time_s, stamped = true_times(time_s, np.where(use, rows, np.nan), turned_deg)
    least_s = 1.0
    if time_s[-1] < _ENOUGH_STEPS and len(time_s) >= 2 * _ENOUGH_STEPS:
        least_s = float(np.median(np.diff(time_s))) * (len(time_s) // (2 * _ENOUGH_STEPS))
    steps = Steps.of(time_s, use, least_s, stamped=stamped)
    # where single rows are missing here and there, few long steps have all of theirs
    while (
        steps.whole.mean() < _WHOLE * use.mean()
        and steps.period_s > _ROWS * steps.usual_s
        and steps.count < _MOST_STEPS
    ):
        steps = Steps.of(time_s, use, 0.5 * steps.period_s, stamped=stamped)
    return steps, turned_deg


def _within(ends_deg: Array) -> Array:
    """Return an angle within each row of its values at the rows' ends, (n,)."""
    return np.append(ends_deg[:1], 0.5 * (ends_deg[1:] + ends_deg[:-1]))


def _stimulus(
    entry: LogEntry, mapping: Mapping, log: Log, steps: Steps, axis: str, turned_deg: Array | None
) -> tuple[Stimulus, OtherAxes]:
    """Return what acted on an axis, and what its unit's other axes tell of it."""
    angle, edge_rate = entry.table_angle_deg(steps.edges_s), None
    guided = angle is not None or bool({"angle", "table_rate", "elevation", "foretold"} & set(log.columns))
    around = other_axes(log.columns, steps, axis, latitude_deg=mapping.latitude_deg, guided=guided)
    told = angle is not None or turned_deg is not None
    if angle is None:
        # where a unit that was turned by hand points nobody knows: east, where its axis feels no level Earth rate
        angle = np.full(steps.count + 1, 90.0 if around.moving.any() else 0.0)
    if turned_deg is not None:
        angle, edge_rate = steps.angles(turned_deg)
        unknown = ~steps.whole | np.isnan(steps.means(log.columns["output"], steps.use))
        angle = angle if edge_rate is not None else steady_beside(angle, unknown)
    if told:
        angle = angle + entry.azimuth_error_deg
    elevation = np.full(steps.count, entry.elevation_deg)
    if around.elevation_deg is not None:
        elevation = around.elevation_deg
    if "elevation" in log.columns:
        elevation = interpolated(steps.means(_within(log.columns["elevation"]), steps.use))
    t_in, t_out = (
        interpolated(steps.means(log.columns[key])) if key in log.columns else None
        for key in ("t_in", "t_out")
    )
    t_in, t_out = stand_ins(t_in, t_out, steps.count)
    return Stimulus(
        steps.edges_s[1:] + (entry.power_on_s or 0.0),
        t_in,
        t_out,
        angle,
        elevation,
        mapping.latitude_deg,
        steps.period_s,
        edge_rate,
        around.force_g,
        around.cross_rate_dph,
    ), around


def _phases(entry: LogEntry, times_s: Array) -> NDArray[np.str_]:
    starts, names = [phase.start_s for phase in entry.phases], [phase.name for phase in entry.phases]
    return names_at(starts or [0.0], names or ["run"], times_s - 0.5)
