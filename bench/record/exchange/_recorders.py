"""Columns that another recorder wrote beside a log, such as a chamber's temperatures: put on the log's rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.record.exchange._mapping import Mapping, Recorder
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
            expected='a file; "*" stands for what it stands for in the file of [[run]], or for the log\'s name',
        )
    return file


def shifted(
    recorder: Recorder, file: Path, time_s: Array, dated: bool, log_time_s: Array, log_dated: bool
) -> Array:
    """Return a recorder's times (m,) on the clock of the log; ConfigurationError where they do not meet."""
    if recorder.starts_s is not None:
        time_s = time_s - time_s[0] + log_time_s[0] + recorder.starts_s
    elif dated != log_dated:
        raise ConfigurationError(
            "the recorder's clock and the log's cannot be compared",
            where=str(file),
            found=("date-times, the log has seconds" if dated else "seconds, the log has date-times"),
            expected="times of one kind",
            remedy="say starts_s of the recorder: how long after the log's first row its own was written",
        )
    time_s = time_s + recorder.shift_s
    if time_s[-1] < log_time_s[0] or time_s[0] > log_time_s[-1]:
        raise ConfigurationError(
            "the recorder wrote nothing while the log was written",
            where=str(file),
            found=f"{time_s[0]:.9g} to {time_s[-1]:.9g} s, the log {log_time_s[0]:.9g} to {log_time_s[-1]:.9g} s",
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
