"""Times of a log's rows: late, doubled and out of order; a clock that was set back; the time between rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

_OFF_PLACE, _NEAR = 0.3, 10.0
"""Parts of the usual time between rows: how far off its place a late row may be, and how far from the next."""
_HALF_HOUR_S = 1800.0
"""Local clocks are set by multiples of it when daylight time begins or ends."""
_DAY_S, _SUNDAY = 86_400.0, 3.0
"""A day, and which of seven since 1970, a Thursday, is a Sunday."""
_SMALL_HOURS_S, _MOST_FORWARD_S = 4.0 * 3600.0, 3600.0
_UNKNOWN = 1.5
"""Usual times to the first row of a clock that was set back: no whole number, so that the row is not used."""
_STAYS = 5
"""Rows that a clock that was set back stays behind, at least."""
_MOST_SET, _MOST_BACK = 3, 100
"""Times that a clock is set back in a run, and that rows come so late; those of rows in any order are more."""
_LONGEST_S = 3.2e7
"""A year: a run's time grid has a point each second."""
Values = dict[str, Array]


def in_order(
    time_s: Array, values: Values, *, dated: bool, local: bool = False
) -> tuple[Array, Values, tuple[str, ...]]:
    """Return rows that a logger wrote late at their place, and rows that it wrote twice once; what was done.

    A clock of the day (`dated`) that was set back goes on from the row before, and so does a `local` one that was
    set forward for daylight time. As they stand where that does not give one row after the other, or where a
    counter of seconds began anew.
    """
    going, remarks = _going_on(time_s)
    if local:
        going, more = _without_daylight_time(time_s, going)
        remarks += more
    found = _ordered(going, values) if dated or not remarks else None
    return (time_s, values, ()) if found is None else (found[0], found[1], (*remarks, *found[2]))


def _ordered(time_s: Array, values: Values) -> tuple[Array, Values, tuple[str, ...]] | None:
    """Return late rows at their place and doubled ones once; None where that is not one row after the other."""
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
        return None
    counts = ((int(moved.sum()), "written late, put in their place"), (int(same.sum()), "twice, taken once"))
    remarks = tuple(f"{count} of {len(time_s)} rows {what}" for count, what in counts if count)
    return time_s[kept], {name: column[kept] for name, column in values.items()}, remarks


def _going_on(time_s: Array) -> tuple[Array, tuple[str, ...]]:
    """Return times of a clock that was set back, going on; what was done.

    Rows that stay behind and fill a hole between rows before them, or precede them all and are followed by what
    goes on from these, came late; else the clock was set back. Half hours are daylight time, which is known to
    the row; by how much another clock was set nobody knows.
    """
    apart = np.diff(time_s)
    usual_s = float(np.median(apart[apart > 0.0])) if (apart > 0.0).any() else 0.0
    result, remarks = time_s.copy(), []
    back = np.flatnonzero(apart < -_NEAR * usual_s)
    for at in back.tolist() if usual_s and len(back) <= _MOST_BACK else ():
        row, before_s = at + 1, float(result[at])
        behind = time_s[row:] < time_s[at]
        block = time_s[row : row + (len(behind) if behind.all() else int(np.argmin(behind)))]
        first, last = np.searchsorted(np.sort(time_s[:row]), (block.min(), block.max()))
        returns = not behind.all() and block.max() < time_s[at] - _NEAR * usual_s
        if len(block) < _STAYS or (first == last and (first > 0 or returns)):
            continue
        half_hours = np.rint((usual_s - apart[at]) / _HALF_HOUR_S)
        step_s = apart[at] + half_hours * _HALF_HOUR_S
        if not (0.0 < step_s < _NEAR * usual_s and half_hours):
            step_s = _UNKNOWN * usual_s
        by_s = before_s + step_s - float(result[row])
        result[row:] += by_s
        remarks.append(f"the clock was set back by {by_s:.6g} s before row {row + 1}, taken as going on")
    return (result, tuple(remarks)) if len(remarks) <= _MOST_SET else (time_s, ())


def _without_daylight_time(time_s: Array, going: Array) -> tuple[Array, tuple[str, ...]]:
    """Return times `going` on over the hour, or half, that local stamps (n,) lack where daylight time begins.

    That is in the small hours of a Sunday, at a full hour or half, to the row.
    """
    apart = np.diff(time_s)
    usual_s = float(np.median(apart)) if len(apart) else 0.0
    result, remarks = going.copy(), []
    for at in np.flatnonzero(apart > _HALF_HOUR_S).tolist():
        set_s = _HALF_HOUR_S * np.rint((apart[at] - usual_s) / _HALF_HOUR_S)
        day, of_day_s = divmod(float(time_s[at]) + 1.5 * usual_s, _DAY_S)
        to_the_row = abs(apart[at] - usual_s - set_s) < _OFF_PLACE * usual_s
        begins = of_day_s % _HALF_HOUR_S < usual_s and of_day_s < _SMALL_HOURS_S and day % 7.0 == _SUNDAY
        if set_s <= _MOST_FORWARD_S and to_the_row and begins and usual_s < _HALF_HOUR_S:
            result[at + 1 :] -= set_s
            remarks.append(
                f"the clock was set forward by {set_s:.6g} s (daylight time) before row {at + 2}, taken as "
                "going on"
            )
    return result, tuple(remarks)


def turns_back(step: Array, wraps: float) -> Array:
    """Return -1 where a time that wraps begins anew and 0 elsewhere, (n,).

    A row that comes late steps back by little, and would come after a long pause if the time had begun anew.
    """
    usual = float(np.median(np.mod(step, wraps))) if len(step) else 0.0
    late = (step > -_NEAR * usual) & (step + wraps > _NEAR * usual)
    return np.where((step < 0.0) & ~late, -1.0, 0.0)


def mean_step_s(time_s: Array) -> float:
    """Return the time between rows, s: the mean of steps that are about the usual one, stamps being rounded."""
    steps = np.diff(time_s)
    usual_s = float(np.median(steps))
    near = np.abs(steps / usual_s - 1.0) < 0.5
    return float(steps[near].mean())


def check_time(time_s: Array, file: Path) -> None:
    """Raise ConfigurationError for times that are none of a recording."""
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
            remedy="a counter that begins anew: say where (`wraps`); rows that come evenly and whose stamps only "
            "repeat: leave `time` out of the mapping and give rate_hz",
        )
    if not time_s[-1] - time_s[0] <= _LONGEST_S:
        raise ConfigurationError(
            "the times are none of a recording",
            where=str(file),
            found=f"{time_s[0]:.9g} s to {time_s[-1]:.9g} s",
            expected="a year at most from first to last",
            remedy="see the time's unit in the mapping",
        )
