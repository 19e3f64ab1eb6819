"""From run folders to thermal runs: 1 s means of the gyro's output and of the two temperatures."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.common.state_file import read_arrays
from bench.analysis.thermal._scale_factor import RateRun, scale_factor_group
from bench.analysis.thermal._types import ThermalRun
from bench.record.recording import Phase, Run, second_rows, seconds
from drivers.base.arrays import Array
from drivers.base.constants import earth_rate_north_dph
from drivers.base.errors import ConfigurationError

_BLOCK_S = 3600.0


def load_thermal_runs(folder: Path, gyro: str | None = None) -> list[ThermalRun]:
    """Return what a cold-shock run folder gives for fitting: a bias run, or one run per scale-factor group.

    `gyro` defaults to the first of the bench file. Rows cover whole seconds, (t - 1, t]; NaN where a second has
    no valid sample. A bias run starts with the phase `equilibrium`, a section of a scale-factor group with its
    `reference`. ConfigurationError names what a folder lacks.
    """
    run = Run.open(folder)
    name = gyro or next(iter(run.manifest.units), "")
    if name not in run.manifest.units:
        raise ConfigurationError(
            "the run has no such gyro",
            where=str(folder),
            found=name,
            expected=", ".join(run.manifest.units),
        )
    if any(event["kind"] == "section" for event in run.events):
        return _scale_factor_runs(run, name)
    return [_bias_run(run, name)]


def _bias_run(run: Run, gyro: str) -> ThermalRun:
    phases = run.phases()
    reference = _phase(run, phases, "reference")
    start = math.floor(_phase(run, phases, "equilibrium").start_s)
    end = math.floor(_end_s(phases))
    output, gyro_temp = _second_means(run, gyro, start, end)
    truth = _truth(run, gyro, start, end)
    earth = _earth_rate_dph(run, start, end)
    return ThermalRun(
        run_id=run.manifest.run_id,
        unit_id=run.manifest.unit(gyro),
        time_s=np.arange(start + 1.0, end + 1.0),
        gyro_temp_c=gyro_temp,
        case_temp_c=_case_temp(run, gyro, start, end),
        bias_dph=3600.0 * output - earth,
        sf_error_ppm=None,
        reference=(reference.start_s, reference.end_s),
        checksum=run.checksum,
        phases=[(phase.start_s, phase.name) for phase in phases if phase.end_s > start],
        true_bias_dph=truth.get("bias_dph"),
        meta={"gyro": gyro, "outcome": run.manifest.outcome},
    )


def _scale_factor_runs(run: Run, gyro: str) -> list[ThermalRun]:
    sections = [event for event in run.events if event["kind"] == "section"]
    ends = [float(event["time_s"]) for event in sections[1:]] + [_end_s(run.phases())]
    groups: dict[int, list[RateRun]] = {}
    for section, end_s in zip(sections, ends, strict=True):
        rate_run = _rate_run(run, gyro, float(section["rate_dps"]), float(section["time_s"]), end_s)
        groups.setdefault(int(section["group"]), []).append(rate_run)
    return [_named(run, gyro, number if len(groups) > 1 else None, rows) for number, rows in groups.items()]


def _named(run: Run, gyro: str, group: int | None, rows: list[RateRun]) -> ThermalRun:
    """Return the group's thermal run under the name and checksum of the folder that its sections share."""
    name = run.manifest.run_id if group is None else f"{run.manifest.run_id} group {group}"
    meta = {"gyro": gyro, "outcome": run.manifest.outcome}
    return replace(scale_factor_group(rows).run, run_id=name, checksum=run.checksum, meta=meta)


def _rate_run(run: Run, gyro: str, rate_dps: float, start_s: float, end_s: float) -> RateRun:
    phases = [phase for phase in run.phases() if start_s <= phase.start_s < end_s]
    reference = _phase(run, phases, "reference")
    start, end = math.floor(reference.start_s), math.floor(end_s)
    output, gyro_temp = _second_means(run, gyro, start, end)
    return RateRun(
        run_id=run.manifest.run_id,
        unit_id=run.manifest.unit(gyro),
        rate_dps=rate_dps,
        time_s=np.arange(1.0, end - start + 1.0),
        gyro_temp_c=gyro_temp,
        case_temp_c=_case_temp(run, gyro, start, end),
        output_dps=output,
        reference=(0.0, reference.end_s - start),
        checksum=run.checksum,
        phases=[(phase.start_s - start, phase.name) for phase in phases if phase.end_s > start],
        true_sf_error_ppm=_truth(run, gyro, start, end).get("sf_error_ppm"),
    )


def _end_s(phases: Sequence[Phase]) -> float:
    """Return where the test ends: after it, table and chamber are brought to rest."""
    return next((phase.start_s for phase in phases if phase.name == "close"), phases[-1].end_s)


def _phase(run: Run, phases: tuple[Phase, ...] | list[Phase], name: str) -> Phase:
    for phase in phases:
        if phase.name == name:
            return phase
    raise ConfigurationError(
        f"the run has no phase {name!r}: it cannot be fitted",
        where=str(run.folder),
        found=", ".join(phase.name for phase in phases) or "no phases",
        expected="a cold-shock run that got beyond its reference window",
        remedy=f"the run is marked {run.manifest.outcome}: {run.manifest.reason or 'no reason given'}",
    )


def _second_means(run: Run, gyro: str, start: int, end: int) -> tuple[Array, Array]:
    """Return 1 s means of rate (deg/s) and temperature (degC), (end - start,), read an hour at a time."""
    count = end - start
    sums = np.zeros((2, count))
    samples = np.zeros((2, count))
    for table in _hours(run, gyro, start, end):
        row = second_rows(table, start)
        for index, column in enumerate(("rate_dps", "temp_c")):
            values = table[column].astype(np.float64)
            use = (row >= 0) & (row < count) & ~np.isnan(values)
            if index == 0:
                use &= table["valid"].astype(bool)
            sums[index] += np.bincount(row[use], values[use], count)
            samples[index] += np.bincount(row[use], minlength=count)
    with np.errstate(invalid="ignore"):
        means = np.where(samples > 0, sums / np.maximum(samples, 1.0), np.nan)
    return means[0], means[1]


def _hours(run: Run, gyro: str, start: int, end: int) -> Iterator[dict[str, Any]]:
    columns = ("time_ns", "rate_dps", "temp_c", "valid")
    edges = np.append(np.arange(float(start), float(end), _BLOCK_S), float(end) + 1e-9)
    for low, high in pairwise(edges):
        yield run.gyro(gyro, columns, float(low), float(high))


def _case_temp(run: Run, gyro: str, start: int, end: int) -> Array:
    """Return the case temperature at the middle of every second, shape (end - start,)."""
    sensor = run.manifest.device(gyro).case_sensor
    if sensor is None:
        imported = run.manifest.imported is not None
        raise ConfigurationError(
            "the gyro has no case temperature sensor",
            where=str(run.folder),
            found=f"{gyro}: no column t_out" if imported else f"{gyro}: no case_sensor in the bench file",
            expected="a record of the temperature on the unit's case",
            remedy="map a column to t_out and import the log again"
            if imported
            else "set case_sensor for this gyro and auxiliary for the chamber, and run again",
        )
    table = run.chamber(("time_ns", f"aux_{sensor}_temp_c"))
    middle = np.arange(start + 0.5, end)
    return np.asarray(np.interp(middle, seconds(table), table[f"aux_{sensor}_temp_c"]))


def _earth_rate_dph(run: Run, start: int, end: int) -> Array:
    """Return the Earth rate along the axis from table angle and measured azimuth error, (end - start,)."""
    error_deg = run.manifest.measured("azimuth_error") or 0.0
    table = run.turntable(("time_ns", "angle_deg"), start - 2.0, end + 2.0)
    unwrapped = np.unwrap(table["angle_deg"], period=360.0)
    angle = np.interp(np.arange(start + 0.5, end), seconds(table), unwrapped)
    return np.asarray(earth_rate_north_dph(run.manifest.latitude_deg) * np.cos(np.radians(angle + error_deg)))


def _truth(run: Run, gyro: str, start: int, end: int) -> dict[str, Array]:
    """Return the emulated unit's true drift as 1 s means; empty on a real one."""
    path = run.folder / f"truth_{gyro}.npz"
    if not path.exists():
        return {}
    arrays = read_arrays(path)
    ticks = {name: arrays[name] for name in ("bias_dph", "sf_error_ppm")}
    return {
        name: 0.5 * (values[start:end] + values[start + 1 : end + 1])
        for name, values in ticks.items()
        if values.ndim == 1 and len(values) > end
    }
