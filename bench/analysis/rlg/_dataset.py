"""From run folders to ramp runs, one for each gyro of a run."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.state_file import read_arrays
from bench.analysis.rlg._rows import RampRun, ramp_run
from bench.record.recording import Run, second_rows, seconds
from drivers.base.arrays import Array
from drivers.base.constants import earth_rate_north_dph
from drivers.base.errors import ConfigurationError

_MOVING = ("ramp_1", "ramp_2")
_FEW_LOST = 1e-3
"""Part of the samples that may be missing without a remark."""
_KEPT = (*_MOVING, "dwell_1", "dwell_2")


def load_ramp_runs(folder: Path, gyros: tuple[str, ...] = ()) -> list[RampRun]:
    """Return the rows of every gyro (or those named) of a `thermal-ramp` run folder.

    Rows are those of the ramps and dwells: before and after, the unit goes somewhere else fast. T1 is the
    gyro's own case sensor if its stream carries one, else the chamber's sensor on its case; T2 is the gyro's own
    temperature.
    ConfigurationError names what a folder lacks.
    """
    run = Run.open(folder)
    phases = {phase.name: phase for phase in run.phases()}
    if "ramp_1" not in phases:
        raise ConfigurationError(
            "the run has no ramp: it cannot be fitted",
            where=str(folder),
            found=f"{run.manifest.procedure}, {run.manifest.outcome}: " + (", ".join(phases) or "no phases"),
            expected="a thermal-ramp run that got as far as its first ramp",
            remedy=run.manifest.reason or "run thermal-ramp",
        )
    unknown = [name for name in gyros if name not in run.manifest.units]
    if unknown:
        raise ConfigurationError(
            "the run has no such gyro",
            where=str(folder),
            found=", ".join(unknown),
            expected=", ".join(run.manifest.units),
        )
    start = math.ceil(phases["ramp_1"].start_s)
    end = math.floor(max(phases[name].end_s for name in _KEPT if name in phases))
    ramps = [(phases[name].start_s, phases[name].end_s) for name in _MOVING if name in phases]
    return [_ramp_run(run, name, start, end, ramps) for name in gyros or tuple(run.manifest.units)]


def _ramp_run(run: Run, gyro: str, start: int, end: int, ramps: list[tuple[float, float]]) -> RampRun:
    table = run.gyro(gyro, None, float(start), float(end) + 1e-6)
    parameters = run.manifest.parameters
    direction = "down first" if parameters.get("downwards") else "up first"
    made = ramp_run(
        run.manifest.run_id,
        run.manifest.unit(gyro),
        np.arange(start + 1.0, end + 1.0),
        _case(run, gyro, table, start, end),
        _second_means(table, "temp_c", start, end),
        3600.0 * _second_means(table, "rate_dps", start, end) - _earth_rate_dph(run, start, end),
        true_bias_dph=_truth(run, gyro, start, end),
        ramps=ramps,
        checksum=run.checksum,
        kind=f"{_text(parameters.get('low_c'))} to {_text(parameters.get('high_c'))} °C, {direction}",
    )
    return replace(made, remarks=(*_lost(run, gyro, table, end - start), *made.remarks))


def _lost(run: Run, gyro: str, table: dict[str, NDArray[Any]], seconds_long: int) -> list[str]:
    """Return a remark if samples are missing: means of what is left carry more of the angle's resolution."""
    rate_hz = run.manifest.stream.get(gyro, {}).get("sample_rate_hz")
    if not rate_hz:
        return []
    expected = round(rate_hz * seconds_long)
    missing = expected - int(np.count_nonzero(table["valid"]))
    if missing <= _FEW_LOST * expected:
        return []
    return [f"{missing} of {expected} samples are missing or not valid: the means are noisier than usual"]


def _text(value: Any) -> str:
    return f"{value:g}" if isinstance(value, int | float) else "?"


def _second_means(table: dict[str, NDArray[Any]], column: str, start: int, end: int) -> Array:
    """Return 1 s means of a column, (end - start,), NaN where a second has no valid sample."""
    count = end - start
    row = second_rows(table, start)
    values = table[column].astype(np.float64)
    use = (row >= 0) & (row < count) & np.isfinite(values) & table["valid"].astype(np.bool_)
    total = np.bincount(row[use], values[use], count)
    number = np.bincount(row[use], minlength=count)
    return np.where(number > 0, total / np.maximum(number, 1), np.nan)


def _case(run: Run, gyro: str, table: dict[str, NDArray[Any]], start: int, end: int) -> Array:
    if "case_temp_c" in table:
        return _second_means(table, "case_temp_c", start, end)
    sensor = run.manifest.device(gyro).case_sensor
    if sensor is None:
        raise ConfigurationError(
            "the regression needs two temperatures",
            where=f"{run.folder}, {gyro}",
            found="the gyro's own temperature only",
            expected="a frame with two temperatures, or a sensor of the chamber on the gyro's case",
            remedy="set case_sensor for this gyro and auxiliary for the chamber, and run again",
        )
    chamber = run.chamber(("time_ns", f"aux_{sensor}_temp_c"))
    middle = np.arange(start + 0.5, end)
    return np.asarray(np.interp(middle, seconds(chamber), chamber[f"aux_{sensor}_temp_c"]))


def _earth_rate_dph(run: Run, start: int, end: int) -> Array:
    """Return the Earth rate along the axis, which the table turned east by the measured azimuth error."""
    error_deg = run.manifest.measured("azimuth_error") or 0.0
    table = run.turntable(("time_ns", "angle_deg"), start - 2.0, end + 2.0)
    angle = np.interp(
        np.arange(start + 0.5, end), seconds(table), np.unwrap(table["angle_deg"], period=360.0)
    )
    horizontal = earth_rate_north_dph(run.manifest.latitude_deg)
    return np.asarray(horizontal * np.cos(np.radians(angle + error_deg)))


def _truth(run: Run, gyro: str, start: int, end: int) -> Array | None:
    path = run.folder / f"truth_{gyro}.npz"
    if not path.exists():
        return None
    ticks = read_arrays(path)["bias_dph"]
    if ticks.ndim != 1 or len(ticks) <= end:
        return None
    return np.asarray(0.5 * (ticks[start:end] + ticks[start + 1 : end + 1]))
