"""Recordings of other software: CSV or Parquet files and a mapping file (TOML) that says what is in them."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from bench.gap._data import GapRun
from drivers.errors import ConfigurationError
from simulators.effects import Stimulus

Array = NDArray[np.float64]
FORMAT = 1
_TO_DPH = {"deg/h": 1.0, "deg/s": 3600.0, "rad/s": math.degrees(3600.0)}
_TO_S = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
_TO_DEG = {"deg": 1.0, "rad": math.degrees(1.0)}
_ZERO_C = {"degC": 0.0, "K": 273.15}


def read_mapped_runs(path: Path) -> list[GapRun]:
    """Return the runs that a mapping file lists, as 1 s means.

    The mapping names `unit_id`, `latitude_deg`, for each of `time`, `output`, `t_in` and optionally `t_out`,
    `angle` and `elevation` a column and its unit, and for each run its file, profile, condition, phases and,
    without those columns, the constants `elevation_deg` and `angle_deg`. Without `t_out` it is taken to equal
    `t_in`: effects of temperature differences are then not seen. ConfigurationError says what a mapping or file
    lacks.
    """
    try:
        mapping = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, tomllib.TOMLDecodeError) as error:
        raise ConfigurationError(
            "the mapping file cannot be read", where=str(path), found=str(error)
        ) from error
    missing = [key for key in ("unit_id", "latitude_deg", "columns", "run") if key not in mapping]
    columns = mapping.get("columns", {})
    missing += [f"columns.{key}" for key in ("time", "output", "t_in") if key not in columns]
    if mapping.get("format") != FORMAT or missing:
        raise ConfigurationError(
            "the mapping file is not complete",
            where=str(path),
            found="without " + ", ".join(missing) if missing else f"format = {mapping.get('format')}",
            expected=f"format = {FORMAT}, unit_id, latitude_deg, columns time, output, t_in, and runs",
        )
    return [_run(entry, mapping, path.parent) for entry in mapping["run"]]


def _run(entry: Mapping[str, Any], mapping: Mapping[str, Any], folder: Path) -> GapRun:
    file = folder / str(entry.get("file", ""))
    table = _table(file)
    columns = mapping["columns"]
    time_s = _column(table, columns["time"], file) * _unit(columns["time"], _TO_S, file)
    if len(time_s) < 2 or not (np.diff(time_s) > 0.0).all():
        raise ConfigurationError(
            "the time column does not grow from row to row", where=str(file), expected="ascending times"
        )
    start, count = time_s[0], math.floor(time_s[-1] - time_s[0])
    row = np.ceil(time_s - start).astype(np.int64) - 1

    def means(key: str) -> Array:
        return _second_means(_column(table, columns[key], file), row, count)

    output = means("output") * _unit(columns["output"], _TO_DPH, file)
    t_in = _bridged(means("t_in") - _unit(columns["t_in"], _ZERO_C, file))
    t_out = t_in
    if "t_out" in columns:
        t_out = _bridged(means("t_out") - _unit(columns["t_out"], _ZERO_C, file))
    edges = np.arange(count + 1.0)
    angle = np.full(count + 1, float(entry.get("angle_deg", 0.0)))
    if "angle" in columns:
        turned = _column(table, columns["angle"], file) * _unit(columns["angle"], _TO_DEG, file)
        angle = np.interp(edges, time_s - start, np.unwrap(turned, period=360.0))
    elevation = np.full(count, float(entry.get("elevation_deg", 0.0)))
    if "elevation" in columns:
        elevation = _bridged(means("elevation") * _unit(columns["elevation"], _TO_DEG, file))
    since_s = edges[1:] + float(entry.get("power_on_s", 0.0))
    stimulus = Stimulus(since_s, t_in, t_out, angle, elevation, float(mapping["latitude_deg"]))
    return GapRun(
        str(entry.get("run_id", file.stem)),
        str(mapping["unit_id"]),
        str(entry.get("profile", file.stem)),
        str(entry.get("condition", "0")),
        stimulus,
        output,
        _phases(entry, edges[1:]),
    )


def _table(file: Path) -> pa.Table:
    try:
        if file.suffix == ".parquet":
            return pyarrow.parquet.read_table(file)
        return pyarrow.csv.read_csv(file)
    except (OSError, pa.ArrowInvalid) as error:
        raise ConfigurationError(
            "the file of a run cannot be read",
            where=str(file),
            found=str(error).splitlines()[0],
            expected="CSV with one line of names, or Parquet",
        ) from error


def _column(table: pa.Table, column: Mapping[str, Any], file: Path) -> Array:
    name = str(column.get("name", ""))
    if name not in table.column_names:
        raise ConfigurationError(
            "the file has no such column", where=str(file), found=name, expected=", ".join(table.column_names)
        )
    return np.array(table[name].cast(pa.float64()).to_pylist(), dtype=np.float64)


def _unit(column: Mapping[str, Any], known: Mapping[str, float], file: Path) -> float:
    unit = str(column.get("unit", ""))
    if unit not in known:
        raise ConfigurationError(
            "a column's unit is not known",
            where=f"{file.name}: {column.get('name')}",
            found=unit or "none",
            expected=", ".join(known),
        )
    return known[unit]


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


def _phases(entry: Mapping[str, Any], times_s: Array) -> NDArray[np.str_]:
    listed = entry.get("phases") or [{"name": "run", "start_s": 0.0}]
    starts = np.array([float(phase["start_s"]) for phase in listed])
    names = np.array([str(phase["name"]) for phase in listed])
    return np.asarray(names[np.maximum(np.searchsorted(starts, times_s - 0.5, side="right") - 1, 0)])
