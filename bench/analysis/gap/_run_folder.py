"""Runs of this project as the diagnosis sees them: 1 s means of output, temperatures and table angle."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from bench.analysis.calibration import load_calibration_run
from bench.analysis.common.statistics import on_grid
from bench.analysis.gap._data import SIGMA_OF_SECOND_DIFFERENCES, GapRun, interpolated, stand_ins
from bench.analysis.gap._fast_data import FastRows
from bench.analysis.gap._import import read_imported_run
from bench.control.procedure import load_procedures
from bench.record.recording import Run, second_rows, seconds
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS, earth_rate_north_dph
from drivers.base.errors import ConfigurationError
from simulators.effects import Stimulus

_TURNING_DPS = 0.05
_SETTLING_S = 5
_UNSURE = 3.0
"""Standard deviations of a second's noise that the table's telemetry may be off by."""
AXES = "xyz"
CALIBRATION = "system-calibration"


def gyros_of(run: Run) -> list[str]:
    """Return the names of a run's gyros in the order of the bench file; ConfigurationError for none."""
    units = [unit for unit in run.manifest.units if run.manifest.device(unit).role == "gyro"]
    if not units:
        raise ConfigurationError(
            "the run has no gyro",
            where=str(run.place),
            found=f"{run.manifest.procedure} of "
            + (", ".join(f"{n} ({each.role})" for n, each in run.manifest.devices.items()) or "no device"),
            expected="a run with a gyro: the gap is looked for in its rate",
            remedy="runs of a platform INS are diagnosed by themselves, without runs of a gyro among them",
        )
    return units


def named_gyro(run: Run, gyro: str | None) -> str:
    """Return a gyro of a run, None for its first; ConfigurationError where the run has no such gyro."""
    units = gyros_of(run)
    if gyro is not None and gyro not in units:
        raise ConfigurationError(
            "the run has no such gyro", where=str(run.place), found=gyro, expected=", ".join(units)
        )
    return gyro or units[0]


def load_gap_runs(folder: Path, gyro: str | None = None) -> list[GapRun]:
    """Return the stretches of a run folder: one, or one for each section of a scale-factor group.

    `gyro` defaults to the first of the bench file. A stretch starts with the first phase after the table took its
    position (`equilibrium`, or a section's `reference`) and covers whole seconds. ConfigurationError names what a
    folder lacks.
    """
    run = Run.open(folder)
    name = named_gyro(run, gyro)
    if run.manifest.imported is not None:
        return [read_imported_run(run)]
    if run.manifest.procedure == CALIBRATION:
        return [_positions(run, name)]
    sections = [float(event["time_s"]) for event in run.events if event["kind"] == "section"]
    phases = run.phases()
    if not phases:
        raise ConfigurationError(
            "the run has no phases", where=str(folder), expected="a run that got beyond its first phase"
        )
    if run.manifest.procedure == "standard-test":
        rates = [phase for phase in phases if phase.name == "scale_factor"]
        if not rates:
            raise ConfigurationError(
                "the run did not get to its rates",
                where=str(folder),
                expected="phase scale_factor; the other parts are at rest and mounted otherwise",
            )
        return [_stretch(run, name, rates[0].start_s, rates[-1].end_s, "", upright=True)]
    ends = [*sections[1:], phases[-1].end_s]
    if not sections:
        start = next((phase.start_s for phase in phases if phase.name == "equilibrium"), phases[0].start_s)
        return [_stretch(run, name, start, ends[-1], "")]
    stretches = []
    for number, (start, end) in enumerate(zip(sections, ends, strict=True), 1):
        own = [phase for phase in phases if start <= phase.start_s < end and phase.name == "reference"]
        stretches.append(_stretch(run, name, own[0].start_s if own else start, end, f" {number}"))
    return stretches


def _stretch(
    run: Run, gyro: str, start_s: float, end_s: float, suffix: str, *, upright: bool = False
) -> GapRun:
    start, end = math.ceil(start_s), math.floor(end_s)
    means = run.second_means(gyro, start, end, from_start=True)
    edges = np.arange(float(start), end + 1.0)
    angle = run.table_angle_deg(edges) + run.azimuth_error_deg
    turning = float(np.median(np.diff(angle)))
    upright = upright or _upright(run, gyro, abs(turning) > _TURNING_DPS)
    elevation = np.full(end - start, 90.0 if upright else 0.0)
    t_in, t_out = _temperatures(run, means.temp_c, _case_temp(run, gyro, edges[:-1] + 0.5))
    stimulus = Stimulus(edges[1:], t_in, t_out, angle, elevation, run.manifest.latitude_deg)
    output = DPH_PER_DPS * means.rate_dps
    output[_between_polls(run, edges, output - stimulus.input_rate_dph, upright)] = np.nan
    condition = f"{round(float(np.median(angle))) % 360} deg"
    if upright or abs(turning) > _TURNING_DPS:
        condition = f"{round(turning):+d}"
    phases = run.phase_at(edges[1:] - 0.5)
    rows_dps, row_s, owner = _rows(run, gyro, start, end)
    finer = FastRows(rows_dps, row_s, owner, stimulus, phases)
    return GapRun(
        run.manifest.run_id + suffix,
        run.manifest.unit(gyro),
        _profile(run),
        condition,
        stimulus,
        output - finer.alias_dph,
        phases,
        run.checksum,
        means.lost,
        fast=finer.spectra,
    )


def _rows(run: Run, gyro: str, start_s: int, end_s: int) -> tuple[Array, float, NDArray[np.int64]]:
    """Return a gyro's samples, deg/s, on their grid, (rows,), NaN for lost and invalid ones, and its step in s.

    The third are the seconds that the samples count into, (rows,), below zero for none.
    """
    table = run.gyro(gyro, ("time_ns", "rate_dps", "valid", "lost_before"), start_s, end_s)
    count = len(table["time_ns"])
    if count < 2:
        return np.zeros(0), 1.0, np.zeros(0, dtype=np.int64)
    place = np.arange(count) + np.cumsum(table["lost_before"]) - int(table["lost_before"][0])
    at_s = seconds(table)
    row_s = float((at_s[-1] - at_s[0]) / place[-1])
    place += max(round((float(at_s[0]) - start_s) / row_s) - 1, 0)
    rows = on_grid(place, np.where(table["valid"], table["rate_dps"], np.nan))
    owner = np.full(len(rows), -1)
    owner[place] = np.maximum(second_rows(table, start_s), 0)
    return rows, row_s, owner


def _between_polls(run: Run, edges: Array, error_dph: Array, upright: bool) -> NDArray[np.bool_]:
    """Return the seconds in which the table's telemetry is too coarse for the unit's noise, (n,).

    Between two polls the rate may have changed at once: the straight line between their angles is then off by up
    to change (t - t0)(t1 - t)/(t1 - t0). Where it stands or turns evenly nothing is. An upright axis feels the
    angle itself, a level one by how much its part of the Earth's rate changes over it.
    """
    seconds_lost = np.zeros(len(edges) - 1, dtype=np.bool_)
    dph_per_deg = DPH_PER_DPS if upright else math.radians(earth_rate_north_dph(run.manifest.latitude_deg))
    polls = run.turntable(("time_ns", "angle_deg"), edges[0] - 3.0, edges[-1] + 3.0)
    at, angle = seconds(polls), np.unwrap(polls["angle_deg"], period=360.0)
    if len(at) < 4:
        return seconds_lost
    rates = np.diff(angle) / np.diff(at)
    jumps = np.abs(np.diff(rates, prepend=rates[0], append=rates[-1]))
    change = np.maximum(jumps[:-1], jumps[1:])
    place = np.clip(np.searchsorted(at, edges) - 1, 0, len(change) - 1)
    before, after = np.maximum(edges - at[place], 0.0), np.maximum(at[place + 1] - edges, 0.0)
    off_deg = change[place] * before * after / np.diff(at)[place]
    known = error_dph[np.isfinite(error_dph)]
    noise_dph = float(np.median(np.abs(np.diff(known, 2)))) * SIGMA_OF_SECOND_DIFFERENCES
    bad = dph_per_deg * off_deg > _UNSURE * noise_dph
    return np.asarray(bad[:-1] | bad[1:])


def _profile(run: Run) -> str:
    """Return the procedure with those parameters that are not its defaults: repeats agree in both."""
    known = load_procedures().get(run.manifest.procedure)
    if known is None:
        return run.manifest.procedure
    usual = known.parse({}).model_dump(mode="json")
    own = [
        f"{name} {value:g}" if isinstance(value, float) else f"{name} {value}"
        for name, value in run.manifest.parameters.items()
        if name != "repeats" and value != usual.get(name)
    ]
    return ", ".join([run.manifest.procedure, *own])


def _upright(run: Run, gyro: str, turning: bool) -> bool:
    """Return whether the axis under test is up; where no mounting was told, a turning unit's is."""
    mounting, axis = run.manifest.mounting, run.manifest.device(gyro).axis
    if mounting == "z_up":
        return axis == "z"
    return mounting == "axis_up" or (turning and mounting != "axis_horizontal")


def _positions(run: Run, gyro: str) -> GapRun:
    """Return the dwells of a system calibration, one behind the other, each at its attitude, without turns."""
    schedule = load_calibration_run(run.place, gyro).schedule
    axis = AXES.index(str(run.manifest.device(gyro).axis or "x"))
    parts = []
    dwells = [phase for phase in run.phases() if phase.name == "dwell"]
    for number, (phase, attitude) in enumerate(zip(dwells, schedule.attitudes(), strict=True), 1):
        start, end = math.ceil(phase.start_s) + _SETTLING_S, math.floor(phase.end_s)
        means = run.second_means(gyro, start, end, from_start=True)
        means.rate_dps[-1] = np.nan  # in it the angle jumps to that of the next position
        east, north, up = attitude[:, axis]
        full = np.full(end - start, 1.0)
        parts.append(
            (
                np.arange(start + 1.0, end + 1.0),
                means.rate_dps,
                means.temp_c,
                _case_temp(run, gyro, np.arange(float(start), float(end)) + 0.5),
                math.degrees(math.atan2(-east, north)) * full,
                math.degrees(math.asin(max(min(up, 1.0), -1.0))) * full,
                np.full(end - start, f"position {number}"),
                means.lost * full,
            )
        )
    times, output, temp_c, case_c, angle, elevation, phases, losses = (
        np.concatenate(each) for each in zip(*parts, strict=True)
    )
    t_in, t_out = _temperatures(run, temp_c, case_c)
    angle = np.append(angle, angle[-1:])
    stimulus = Stimulus(times, t_in, t_out, angle, elevation, run.manifest.latitude_deg)
    return GapRun(
        run.manifest.run_id,
        run.manifest.unit(gyro),
        run.manifest.procedure,
        schedule.name,
        stimulus,
        DPH_PER_DPS * output,
        phases,
        run.checksum,
        float(losses.mean()),
    )


def _filled(values: Array, run: Run, what: str) -> Array | None:
    """Bridge single missing seconds; None if there is no value, ConfigurationError if a fifth is missing."""
    known = ~np.isnan(values)
    if not known.any():
        return None
    if known.mean() < 0.8:
        raise ConfigurationError(
            f"{what} is missing",
            where=str(run.place),
            found=f"{100 * (1 - known.mean()):.0f} % of the seconds without a value",
            expected="a temperature for every second",
            remedy="without it no effect of temperature can be told",
        )
    return interpolated(values)


def _temperatures(run: Run, temp_c: Array, case_c: Array) -> tuple[Array, Array]:
    inside = _filled(temp_c, run, "the gyro's temperature")
    return stand_ins(inside, _filled(case_c, run, "the case's temperature"), len(temp_c))


def _case_temp(run: Run, gyro: str, times_s: Array) -> Array:
    """Return the case temperature, NaN without a record of it."""
    case_c = run.case_temp_c(gyro, times_s) if "chamber" in run.tables else None
    return np.full(len(times_s), np.nan) if case_c is None else case_c
