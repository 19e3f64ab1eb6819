"""Foreign logs read by a mapping: columns as arrays in the bench's units."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.record.exchange._mapping import Column, Mapping
from bench.record.exchange._table import MDF_ENDINGS, TIME_OF_FILE, read_table
from bench.record.exchange._units import (
    ANGLE,
    BASE_UNITS,
    FORCE,
    OPENING,
    POWER,
    RATE,
    TEMPERATURE,
    TIME,
    Scale,
    scale_of,
    unit_error,
)
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

_QUANTITIES = {
    "time": TIME, "output": RATE, "rate": RATE, "accelerometer": FORCE, "table_rate": RATE, "rate_demand": RATE,
    "foretold": RATE, "angle": ANGLE, "angle_demand": ANGLE, "elevation": ANGLE,
    "t_in": TEMPERATURE, "t_out": TEMPERATURE, "air": TEMPERATURE, "set_point": TEMPERATURE, "heater": POWER,
    "door": OPENING,
}  # fmt: skip
_OFF_PLACE, _NEAR = 0.3, 10.0
"""Parts of the usual time between rows: how far off its place a late row may be, and how far from the next."""
LONGEST_S = 3.2e7
"""A year: a run's time grid has a point each second."""


@dataclass(frozen=True)
class Log:
    """A log, rows in time order, shape (n,) each; `time_s` grows from row to row as it was recorded.

    `columns` has `output` and `table_rate` in deg/s, `angle` (unwrapped) and `elevation` in deg, `t_in`,
    `t_out`, `air` and `set_point` in degC, `heater` in W, `door` from 0 to 1, `valid` as it stood; only those
    that the mapping names. NaN where a value is missing. `remarks` say which rows were put into order or were
    there twice.
    """

    time_s: Array
    columns: abc.Mapping[str, Array]
    remarks: tuple[str, ...] = ()


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
    time_s, values, remarks = _in_order(time_s, values)
    _check_time(time_s, file)
    per_s = 1.0 / float(np.median(np.diff(time_s)))
    for name, scale in scales.items():
        if name in values:
            values[name] = values[name] * (scale.factor * (per_s if scale.per_sample else 1.0)) + scale.offset
    if "angle" in values:
        values["angle"] = _unwrapped(values["angle"])
    return Log(time_s, values, remarks)


def _scale(name: str, column: Column, file: Path) -> Scale:
    if name == "valid":
        return Scale(1.0)
    quantity = _QUANTITIES[name.rpartition("_")[0] if name[-2:] in ("_x", "_y", "_z") else name]
    scale = scale_of(quantity, column.unit or (BASE_UNITS[OPENING] if quantity == OPENING else ""))
    if scale is None:
        raise unit_error(quantity, column.unit, f"{file.name}: {name} ({column.name})")
    return scale


def _in_order(time_s: Array, values: dict[str, Array]) -> tuple[Array, dict[str, Array], tuple[str, ...]]:
    """Return rows that a logger wrote late at their place, and rows that it wrote twice once; what was done.

    As they stand where that does not give one row after the other: a clock that was set back is no late row.
    """
    apart = np.diff(time_s)
    if len(apart) < 2 or (apart > 0.0).all() or not np.isfinite(time_s).all():
        return time_s, values, ()
    late = time_s < np.maximum.accumulate(time_s)
    order = np.argsort(time_s, kind="stable")
    sorted_s = time_s[order]
    same = np.append(False, np.diff(sorted_s) == 0.0)
    for column in values.values():
        ordered = column[order]
        same[1:] &= (ordered[1:] == ordered[:-1]) | (np.isnan(ordered[1:]) & np.isnan(ordered[:-1]))
    kept = order[~same]
    apart = np.diff(time_s[kept])
    usual_s = float(np.median(apart)) if len(apart) else 0.0
    moved = late[kept]
    beside = apart[moved[1:] | moved[:-1]] / max(usual_s, 1e-12)
    places = np.clip(np.rint(beside), 1.0, _NEAR)
    if not (apart > 0.0).all() or not (np.abs(beside - places) < _OFF_PLACE).all():
        return time_s, values, ()
    counts = ((int(moved.sum()), "written late, put in their place"), (int(same.sum()), "twice, taken once"))
    remarks = tuple(f"{count} of {len(time_s)} rows {what}" for count, what in counts if count)
    return time_s[kept], {name: column[kept] for name, column in values.items()}, remarks


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
