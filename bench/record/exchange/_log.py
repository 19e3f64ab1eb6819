"""Foreign logs read by a mapping: columns as arrays in the bench's units."""

from __future__ import annotations

from collections import abc
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from bench.record.exchange._mapping import Column, Mapping
from bench.record.exchange._recorders import Times, existing_file, on_rows, shifted
from bench.record.exchange._row_times import Values, check_time, in_order, mean_step_s, turns_back
from bench.record.exchange._table import TIME_OF_FILE, Dated, Table, has_own_times, read_table
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
_TURN_DEG, _ROUNDED_DEG = 360.0, 1.0
"""A turn, and by how much more than one an angle that does not count turns may span: 0 to 6.2832 rad do."""
_DAY_S = 86_400.0
_UNIX_S = 1e9, 4e9
"""Numbers that can only be Unix times: 2001 to 2096."""
_VALID_RATES = ("output", "rate_x", "rate_y", "rate_z")
"""What `valid` is said of."""


@dataclass(frozen=True)
class Log:
    """A log, rows in time order, shape (n,) each; `time_s` grows from row to row as it was recorded.

    `columns` has `output` and `table_rate` in deg/s, `angle` (unwrapped) and `elevation` in deg, `t_in`,
    `t_out`, `air` and `set_point` in degC, `heater` in W, `door` from 0 to 1; only those that the mapping names.
    NaN where a value is missing; rates, too, where the column `valid` is zero or missing. `remarks` say which
    rows were put into order or were there twice, and what was done about a clock that was set back. `other_rows`
    has the columns of other recorders, and of an MDF file's other groups, at the rows that they were written in,
    shape (m,) each. `since_1970`:
    the times are those of a calendar, in s since 1970.
    """

    time_s: Array
    columns: abc.Mapping[str, Array]
    remarks: tuple[str, ...] = ()
    other_rows: abc.Mapping[str, Array] = field(default_factory=dict)
    since_1970: bool = False


def read_log(file: Path, mapping: Mapping) -> Log:
    """Read a log of any format that `read_table` knows, and what other recorders wrote beside it.

    ConfigurationError for a file that cannot be read, columns that are not there, are no numbers or have a unit
    that is not known, times that do not grow, and recorders whose times do not meet the log's.
    """
    named = mapping.named()
    own = {n: c for n, c in named.items() if not c.recorder}
    log, dated = _read(file, own, mapping.rate_hz, mapping.separator)
    columns, remarks, other_rows = dict(log.columns), list(log.remarks), dict(log.other_rows)
    for name, recorder in mapping.recorder.items():
        other_file = existing_file(name, mapping, file)
        wanted = {n: c for n, c in named.items() if c.recorder == name}
        if recorder.time is not None:
            wanted["time"] = recorder.time
        other, other_dated = _read(other_file, wanted, recorder.rate_hz, recorder.separator)
        times = Times(other_file, other.time_s, other_dated), Times(file, log.time_s, dated)
        time_s = shifted(name, mapping, *times)
        other_rows |= other.columns
        columns |= {n: on_rows(n, log.time_s, time_s, values) for n, values in other.columns.items()}
        remarks += [f"{name}: {remark}" for remark in other.remarks]
    if "valid" in columns:
        invalid = ~(np.nan_to_num(columns.pop("valid")) != 0.0)
        columns |= {n: np.where(invalid, np.nan, columns[n]) for n in _VALID_RATES if n in columns}
    # a time of day has no date
    since_1970 = bool((dated and log.time_s[0] > _DAY_S) or _UNIX_S[0] <= log.time_s[0] < _UNIX_S[1])
    return Log(log.time_s, columns, tuple(remarks), other_rows, since_1970)


def _read(file: Path, wanted: dict[str, Column], rate_hz: float | None, separator: str) -> tuple[Log, bool]:
    """Return the columns of one file, and whether its times are date-times."""
    wanted = dict(wanted)
    scales = {name: _scale(name, column, file) for name, column in wanted.items()}
    own_times = has_own_times(file)
    if own_times:
        wanted.pop("time", None)
    elif "time" not in wanted and rate_hz is None:
        raise ConfigurationError(
            "the mapping file is not complete",
            where=file.name,
            found="without columns.time",
            expected="a time, or rate_hz",
        )
    names = sorted(
        wanted, key=lambda name: name != "output"
    )  # on whose rows an MDF file's other channels come
    words = {column.name: column.missing_words for column in wanted.values()}
    columns = [wanted[name].name for name in names]
    table = read_table(file, columns, separator=separator, missing=words, apart=True)
    _check_words(file, wanted, table)
    values = {name: _numbers(table.columns[column.name], column, name) for name, column in wanted.items()}
    dated = "time" in wanted and wanted["time"].name in table.dated
    if own_times:
        time_s = table.columns[TIME_OF_FILE]
    elif "time" not in values:
        time_s = np.arange(len(next(iter(values.values()), ()))) / (rate_hz or 1.0)
    else:
        if not dated and not wanted["time"].unit:
            raise unit_error(TIME, "", f"{file.name}: time ({wanted['time'].name})")
        # date-times are s already
        time_s = values.pop("time") * (1.0 if dated else scales["time"].factor)
    apart = {name: table.times[column.name] for name, column in wanted.items() if column.name in table.times}
    stamps = table.dated[wanted["time"].name] if dated else Dated(local=False, guessed="")
    together = {name: own for name, own in values.items() if name not in apart}
    log = _arranged(file, time_s, together, scales, dated=dated, local=stamps.local)
    rows = {}
    for name, own_s in apart.items():
        other = _arranged(file, own_s, {name: values[name]}, scales, dated=False, local=False)
        rows[name] = other.columns[name]
        together[name] = on_rows(name, log.time_s, other.time_s, rows[name])
    remarks = (stamps.guessed,) if stamps.guessed else ()
    return replace(
        log, columns={**together, **log.columns}, other_rows=rows, remarks=remarks + log.remarks
    ), dated


def _check_words(file: Path, wanted: abc.Mapping[str, Column], table: Table) -> None:
    """Raise ConfigurationError for cells that are no numbers, and for dates where there must be none."""
    for name, column in wanted.items():
        if name != "time" and column.name in table.dated:
            raise ConfigurationError(
                "a column is not one of numbers",
                where=f"{file}: {column.name}, which is mapped as {name}",
                found="dates or times of day",
                expected="numbers; of times also date-times",
                remedy="write angles in decimal degrees, numbers without marks between thousands",
            )
    words = {column.name: table.words.get(column.name, "") for column in wanted.values()}
    for name, word in (("", table.words.get("", "")), *words.items()):
        if word:
            raise ConfigurationError(
                "a column is not one of numbers" if name else "the log's rows are not all alike",
                where=f"{file}: {name}" if name else str(file),
                found=word,
                expected="numbers; of times also date-times",
                remedy="a word for a missing value is said in the mapping, missing = 'OVLD' of the column"
                if name
                else "",
            )


def _arranged(
    file: Path, time_s: Array, values: Values, scales: abc.Mapping[str, Scale], *, dated: bool, local: bool
) -> Log:
    """Return rows in the order of their times, in the bench's units; `dated`, `local`: see `in_order`."""
    time_s, values, remarks = in_order(time_s, values, dated=dated, local=local)
    check_time(time_s, file)
    values = {name: _scaled(column, scales[name], time_s) for name, column in values.items()}
    if "angle" in values:
        values["angle"] = _unwrapped(values["angle"])
    return Log(time_s, values, remarks)


def _scale(name: str, column: Column, file: Path) -> Scale:
    if name == "valid":
        return Scale(1.0)
    quantity = _QUANTITIES[name.rpartition("_")[0] if name[-2:] in ("_x", "_y", "_z") else name]
    # a door's opening is a part; whether a time is a date-time is not known before it is read
    scale = scale_of(quantity, column.unit or (BASE_UNITS[quantity] if quantity in (OPENING, TIME) else ""))
    if scale is None:
        raise unit_error(quantity, column.unit, f"{file.name}: {name} ({column.name})")
    return scale


def _numbers(values: Array, column: Column, name: str) -> Array:
    """Return values (n,): NaN where a log has its number for a missing one, a counter that begins anew going on.

    Of times it only goes up; anything else may count down, too, and changes by less than half of its range.
    """
    values = np.where(np.isin(values, column.missing_numbers), np.nan, values)
    if column.wraps is None:
        return values
    known = np.isfinite(values)
    step = np.diff(values[known], prepend=values[known][:1])
    turns = turns_back(step, column.wraps) if name == "time" else np.rint(step / column.wraps)
    result = values.copy()
    result[known] -= column.wraps * np.cumsum(turns)
    return result


def _scaled(values: Array, scale: Scale, time_s: Array) -> Array:
    """Return values (n,) of rows at times in the bench's unit.

    Of what is counted up from row to row it is the mean rate since the row before, and NaN where a row is missing
    between them: nobody knows how the rate went there.
    """
    if not scale.counted:
        per_s = 1.0 / mean_step_s(time_s) if scale.per_sample else 1.0
        return np.asarray(values * (scale.factor * per_s) + scale.offset)
    step_s = mean_step_s(time_s)
    apart = np.rint(np.diff(time_s) / step_s)
    rate = np.where(apart == 1.0, np.diff(values) * (scale.factor / step_s), np.nan)
    return np.append(np.nan, rate)


def _unwrapped(angle_deg: Array) -> Array:
    """Return an angle (n,) without its jumps by a turn; one of more than a turn counts them, and has none."""
    known = np.isfinite(angle_deg)
    if known.any() and float(np.ptp(angle_deg[known])) > _TURN_DEG + _ROUNDED_DEG:
        return angle_deg
    result = angle_deg.copy()
    result[known] = np.unwrap(angle_deg[known], period=_TURN_DEG)
    return result
