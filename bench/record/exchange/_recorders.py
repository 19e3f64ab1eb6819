"""Columns that another recorder wrote beside a log, such as a chamber's temperatures: put on the log's rows."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from bench.record.exchange._mapping import Mapping
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

_HELD = ("set_point", "rate_demand", "angle_demand", "heater", "door", "valid")
"""In force from their row to the next; of all others values lie between rows."""
_BRIDGED = ("t_in", "t_out", "air")
"""Slow enough to lie between the rows beside a gap, too."""
_NEXT = 2.5
"""Usual times between the recorder's rows over which values are looked for between two, or beyond the last."""


def existing_file(name: str, mapping: Mapping, log: Path) -> Path:
    """Return the file that a recorder wrote beside a log; ConfigurationError where there is none."""
    file = mapping.recorder_file(name, log)
    if not file.is_file():
        raise ConfigurationError(
            "a recorder's log is not there",
            where=f"recorder.{name} beside {log.name}",
            found=str(file),
            expected='a file; "*" is what it is in the file of [[run]], or how the log\'s name begins',
        )
    return file


class Times(NamedTuple):
    """Times of a file's rows, (n,), s, since 1970 where they are date-times."""

    file: Path
    time_s: Array
    dated: bool


def shifted(name: str, mapping: Mapping, own: Times, log: Times) -> Array:
    """Return a recorder's times (m,) on the clock of a log; ConfigurationError where nothing says how."""
    recorder, entry = mapping.recorder[name], mapping.entry_of(log.file)
    starts_s = recorder.starts_s if entry is None else entry.starts_s.get(name, recorder.starts_s)
    time_s = own.time_s
    if starts_s is not None:
        time_s = time_s - time_s[0] + log.time_s[0] + starts_s
    elif own.dated != log.dated or (not own.dated and recorder.shift_s is None):
        raise ConfigurationError(
            "what the clocks of a recorder and of the log have in common is not known",
            where=f"{own.file} beside {log.file.name}",
            found=" and ".join("date-times" if each.dated else "numbers" for each in (own, log)),
            expected="date-times of both, or numbers of which the mapping says how to compare them",
            remedy=f"say in [recorder.{name}] starts_s, how long after the log's first row its own was written "
            f"(in [[run]]: starts_s = {{ {name} = 0.0 }})"
            + ("" if own.dated or log.dated else ", or shift_s = 0 if both numbers have one zero"),
        )
    time_s = time_s + (recorder.shift_s or 0.0)
    if time_s[-1] < log.time_s[0] or time_s[0] > log.time_s[-1]:
        raise ConfigurationError(
            "the recorder wrote nothing while the log was written",
            where=str(own.file),
            found=f"{time_s[0]:.9g} to {time_s[-1]:.9g} s, the log {log.time_s[0]:.9g} to {log.time_s[-1]:.9g} s",
            expected="times that overlap",
            remedy="see the unit of its time, or say its starts_s or shift_s",
        )
    return time_s


def on_rows(name: str, rows_s: Array, time_s: Array, values: Array) -> Array:
    """Return a recorder's column (m,) at the times of a log's rows (n,); NaN where it says nothing of them."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(len(rows_s), np.nan)
    at_s, values = time_s[known], values[known]
    reach_s = _NEXT * float(np.median(np.diff(time_s))) if len(time_s) > 1 else 0.0
    after = np.searchsorted(at_s, rows_s, side="right")
    before = np.clip(after - 1, 0, len(at_s) - 1)
    if name in _HELD:
        found = values[before]
        return np.where(after > 0, found, np.nan)
    found = np.interp(rows_s, at_s, values)
    beyond = (rows_s < at_s[0] - reach_s) | (rows_s > at_s[-1] + reach_s)
    if name in _BRIDGED:
        return np.where(beyond, np.nan, found)
    gap = at_s[np.minimum(after, len(at_s) - 1)] - at_s[before] > reach_s
    return np.where(beyond | (gap & (rows_s != at_s[before])), np.nan, found)
