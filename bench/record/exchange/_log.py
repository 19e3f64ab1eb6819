"""Foreign logs read by a mapping: columns as arrays in the bench's units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

from bench.record.exchange._mapping import Column, Columns
from bench.record.recording import check_room
from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K
from drivers.base.errors import ConfigurationError

_RATES = {
    "deg/s": 1.0,
    "deg/h": 1.0 / 3600.0,
    "rad/s": math.degrees(1.0),
    "rad/h": math.degrees(1.0) / 3600.0,
}
_TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0}
_ANGLES = {"deg": 1.0, "rad": math.degrees(1.0)}
_TEMPERATURES = {"degC": (1.0, 0.0), "K": (1.0, -ZERO_CELSIUS_K), "degF": (5.0 / 9.0, -160.0 / 9.0)}
_KNOWN: dict[str, Mapping[str, Any]] = {
    "time": _TIMES,
    "output": _RATES,
    "table_rate": _RATES,
    "angle": _ANGLES,
    "elevation": _ANGLES,
    "t_in": _TEMPERATURES,
    "t_out": _TEMPERATURES,
    "air": _TEMPERATURES,
    "set_point": _TEMPERATURES,
    "valid": {"": 1.0},
}
_MDF = (".mf4", ".mdf", ".dat")
_PACKED = (".gz", ".bz2", ".zst", ".lz4", ".br")
LONGEST_S = 3.2e7
"""A year: a run's time grid has a point each second."""


@dataclass(frozen=True)
class Log:
    """A log, rows in time order, shape (n,) each; `time_s` grows from row to row as it was recorded.

    `columns` has `output` and `table_rate` in deg/s, `angle` (unwrapped) and `elevation` in deg, `t_in`, `t_out`,
    `air` and `set_point` in degC, `valid` as it stood; only those that the mapping names. NaN where a value is
    missing.
    """

    time_s: Array
    columns: Mapping[str, Array]


def read_log(file: Path, columns: Columns) -> Log:
    """Read a CSV, Parquet or MDF file.

    ConfigurationError for a file that cannot be read, columns that are not there, are no numbers or have a unit
    that is not known, and times that do not grow.
    """
    wanted = {name: _source(name, column, file) for name, column in columns if column is not None}
    time_s, raw = (_read_mdf if file.suffix.lower() in _MDF else _read_table)(file, wanted)
    _check_time(time_s, file)
    values = {name: column * wanted[name].factor + wanted[name].offset for name, column in raw.items()}
    if "angle" in values:
        values["angle"] = _unwrapped(values["angle"])
    return Log(time_s, values)


class _Source(NamedTuple):
    """A column's name in the log, and what makes the bench's unit of its values."""

    name: str
    factor: float
    offset: float


def _source(name: str, column: Column, file: Path) -> _Source:
    known = _KNOWN[name]
    if column.unit not in known:
        raise ConfigurationError(
            "a column's unit is not known",
            where=f"{file.name}: {name} ({column.name})",
            found=column.unit or "none",
            expected=", ".join(known) or "no unit",
        )
    scale = known[column.unit]
    return _Source(column.name, *(scale if isinstance(scale, tuple) else (scale, 0.0)))


def _read_table(file: Path, wanted: Mapping[str, _Source]) -> tuple[Array, dict[str, Array]]:
    if "time" not in wanted:
        raise ConfigurationError(
            "the mapping file is not complete",
            where=file.name,
            found="without columns.time",
            expected="a time",
        )
    table = _open_table(file, list(dict.fromkeys(source.name for source in wanted.values())))
    raw = {name: _numbers(table, source.name, file) for name, source in wanted.items()}
    return raw.pop("time") * wanted["time"].factor, raw


def _open_table(file: Path, names: list[str]) -> pa.Table:
    try:
        if file.suffix.lower() in (".parquet", ".pq"):
            with pyarrow.parquet.ParquetFile(file) as parquet:
                present, rows = parquet.schema_arrow.names, parquet.metadata.num_rows
            _check_names(names, present, file)
            check_room(str(file), rows, len(names) + 1)
            return pyarrow.parquet.read_table(file, columns=names)
        if file.suffix.lower() in _PACKED:
            raise OSError("it is packed, and a packed file can be of any size")
        options = pyarrow.csv.ConvertOptions(include_columns=names)
        with pyarrow.csv.open_csv(file) as reader:
            _check_names(names, reader.schema.names, file)
        return pyarrow.csv.read_csv(file, convert_options=options)
    except (OSError, MemoryError, pa.ArrowException) as error:
        raise ConfigurationError(
            "the log cannot be read",
            where=str(file),
            found=str(error).splitlines()[0] if str(error) else type(error).__name__,
            expected="CSV with one line of names, Parquet, or MDF (.mf4, .mdf)",
        ) from error


def _check_names(names: list[str], present: list[str], file: Path) -> None:
    if missing := [name for name in names if name not in present]:
        shown = ", ".join(present[:20]) + (f" and {len(present) - 20} more" if len(present) > 20 else "")
        raise ConfigurationError(
            "the file has no such column",
            where=str(file),
            found=", ".join(missing),
            expected=shown or "columns",
        )


def _numbers(table: pa.Table, name: str, file: Path) -> Array:
    try:
        column = table[name].cast(pa.float64())
    except (pa.ArrowInvalid, pa.ArrowNotImplementedError) as error:
        raise ConfigurationError(
            "a column is not one of numbers",
            where=f"{file}: {name}",
            found=str(error).splitlines()[0],
            expected="numbers; times as a count of s, ms, us or ns",
        ) from error
    return np.asarray(column.to_numpy(), np.float64)


def _read_mdf(file: Path, wanted: Mapping[str, _Source]) -> tuple[Array, dict[str, Array]]:
    """Read channels onto the times of the output's; others are interpolated, angles without their jumps."""
    asammdf = load_asammdf()
    channels = {name: source.name for name, source in wanted.items() if name != "time"}
    try:
        with asammdf.MDF(file) as mdf:
            _check_names(list(channels.values()), sorted(mdf.channels_db), file)
            signals = {name: mdf.get(channel) for name, channel in channels.items()}
            read = {
                name: (np.asarray(signal.timestamps, np.float64), np.asarray(signal.samples, np.float64))
                for name, signal in signals.items()
            }
    except ConfigurationError:
        raise
    except Exception as error:  # whatever asammdf raises on a damaged file
        raise ConfigurationError(
            "the log cannot be read",
            where=str(file),
            found=f"{type(error).__name__}: {error}",
            expected="an MDF file in which each channel is in one group",
        ) from error
    time_s = read["output"][0]
    raw: dict[str, Array] = {}
    for name, (own_s, values) in read.items():
        if name == "angle":
            values = _unwrapped(values * wanted[name].factor) / wanted[name].factor
        same = len(own_s) == len(time_s) and bool((own_s == time_s).all())
        raw[name] = values if same or not len(own_s) else np.interp(time_s, own_s, values)
    return time_s, raw


def load_asammdf() -> Any:
    """Return the module that reads and writes MDF files; ConfigurationError without it."""
    try:
        import asammdf
    except ImportError as error:
        raise ConfigurationError(
            "MDF files need the package asammdf",
            found="it is not installed",
            remedy="install gyrobench with its extra 'exchange'",
        ) from error
    return asammdf


def _check_time(time_s: Array, file: Path) -> None:
    if len(time_s) < 2:
        raise ConfigurationError(
            "the log is too short", where=str(file), found=f"{len(time_s)} rows", expected="at least 2"
        )
    wrong = np.flatnonzero(~(np.diff(time_s) > 0.0))
    if len(wrong):
        at = int(wrong[0])
        raise ConfigurationError(
            "the time column does not grow from row to row",
            where=str(file),
            found=f"{time_s[at]:.9g} s, then {time_s[at + 1]:.9g} s in row {at + 2} ({len(wrong)} such rows)",
            expected="ascending times without repeats",
        )
    if not time_s[-1] - time_s[0] <= LONGEST_S:
        raise ConfigurationError(
            "the times are none of a recording",
            where=str(file),
            found=f"{time_s[0]:.9g} s to {time_s[-1]:.9g} s",
            expected="a year at most from first to last",
            remedy="see the time's unit in the mapping",
        )


def _unwrapped(angle_deg: Array) -> Array:
    known = np.isfinite(angle_deg)
    result = angle_deg.copy()
    result[known] = np.unwrap(angle_deg[known], period=360.0)
    return result
