"""Foreign logs read by a mapping: columns as arrays in the bench's units."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.record.exchange._mapping import Column, Mapping
from bench.record.exchange._table import MDF_ENDINGS, TIME_OF_FILE, read_table
from bench.record.exchange._units import ANGLE, FORCE, RATE, TEMPERATURE, TIME, Scale, scale_of, unit_error
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

_QUANTITIES = {
    "time": TIME, "output": RATE, "rate": RATE, "accelerometer": FORCE, "table_rate": RATE, "rate_demand": RATE,
    "foretold": RATE, "angle": ANGLE, "angle_demand": ANGLE, "elevation": ANGLE,
    "t_in": TEMPERATURE, "t_out": TEMPERATURE, "air": TEMPERATURE, "set_point": TEMPERATURE,
}  # fmt: skip
LONGEST_S = 3.2e7
"""A year: a run's time grid has a point each second."""


@dataclass(frozen=True)
class Log:
    """A log, rows in time order, shape (n,) each; `time_s` grows from row to row as it was recorded.

    `columns` has `output` and `table_rate` in deg/s, `angle` (unwrapped) and `elevation` in deg, `t_in`,
    `t_out`, `air` and `set_point` in degC, `valid` as it stood; only those that the mapping names. NaN where a
    value is missing.
    """

    time_s: Array
    columns: abc.Mapping[str, Array]


def read_log(file: Path, mapping: Mapping) -> Log:
    """Read a log of any format that `read_table` knows.

    ConfigurationError for a file that cannot be read, columns that are not there, are no numbers or have a unit
    that is not known, and times that do not grow.
    """
    wanted = mapping.named()
    scales = {name: _scale(name, column, file) for name, column in wanted.items()}
    own_times = file.suffix.lower() in MDF_ENDINGS
    if own_times:
        wanted.pop("time", None)
    elif "time" not in wanted and mapping.rate_hz is None:
        raise ConfigurationError(
            "the mapping file is not complete",
            where=file.name,
            found="without columns.time",
            expected="a time, or rate_hz",
        )
    periods = {wanted["angle"].name: 360.0 / scales["angle"].factor} if "angle" in wanted else {}
    names = sorted(wanted, key=lambda name: name != "output")  # whose times an MDF file's other channels take
    table = read_table(file, [wanted[name].name for name in names], periods=periods)
    for name in ("", *(column.name for column in wanted.values())):
        if word := table.words.get(name, ""):
            raise ConfigurationError(
                "a column is not one of numbers" if name else "the log's rows are not all alike",
                where=f"{file}: {name}" if name else str(file),
                found=word,
                expected="numbers; of times also date-times",
            )
    values = {name: table.columns[column.name] for name, column in wanted.items()}
    if own_times:
        time_s = table.columns[TIME_OF_FILE]
    elif "time" not in values:
        time_s = np.arange(len(next(iter(values.values()), ()))) / (mapping.rate_hz or 1.0)
    else:
        dated = wanted["time"].name == table.time  # date-times are s already
        time_s = values.pop("time") * (1.0 if dated else scales["time"].factor)
    _check_time(time_s, file)
    per_s = 1.0 / float(np.median(np.diff(time_s)))
    for name, scale in scales.items():
        if name in values:
            values[name] = values[name] * (scale.factor * (per_s if scale.per_sample else 1.0)) + scale.offset
    if "angle" in values:
        values["angle"] = _unwrapped(values["angle"])
    return Log(time_s, values)


def _scale(name: str, column: Column, file: Path) -> Scale:
    if name == "valid":
        return Scale(1.0)
    quantity = _QUANTITIES[name.rpartition("_")[0] if name[-2:] in ("_x", "_y", "_z") else name]
    scale = scale_of(quantity, column.unit)
    if scale is None:
        raise unit_error(quantity, column.unit, f"{file.name}: {name} ({column.name})")
    return scale


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
