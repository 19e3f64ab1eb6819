"""Rows of a log gathered in equal steps: whole rows, so that noise stays white, and the angle over just them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array

_PAUSE = 1.5
"""Times the usual time between rows from which on rows are missing."""
_UNCOVERED = 0.25
"""Part of a row that a step may lack: jitter of time stamps."""
_INSTANT_S = 1e-6
_FINEST = 6
"""Digits of a second down to which stamps are rounded; a double holds the time of a year no finer."""
_ROUNDED = 0.75
"""Times the last digit of the stamps by which even rows may be off their grid."""
_ENOUGH, _BESIDE_GRID = 16, 0.4
"""Rows that say whether stamps are true, and how far off a grid even ones are, in steps."""
_OUTLYING, _FAR_BETTER, _OFTEN = 6.0, 12.0, 2.0
"""Scatter of a row that neither explains; log likelihood, and standard deviations of its sum, that tell."""
_LEAST_DPS = 1e-7
"""Noise from row to row that every gyro has: a simulation has none, and a coarse output at rest seems so."""
_MASKED, _STEADY = 3, 0.003
"""Steps of a masked move; part of a rate by which it may change from step to step and be steady."""
_HALF = 0.6
"""Part of a step up to which a row counts as half of it: rows of jittered stamps are not quite of one length."""
_FINER = 8
"""Rows a step that are kept of a log."""
_TICKS = 1.05
"""Time of a row against the median one from which rows beat with the ticks of a clock."""
_BEATS, _OFTEN_MISSING, _PASSES, _GAIN, _NEAREST = 64, 0.03, 3, 0.1, 0.6
"""Rows over which ticks of a clock average out; part of the rows that seem to miss one before them, above which
there may be ticks; passes, gain of the loop that follows rows, and how far off its place a row may be, in rows.
"""
_FEW, _ODD = 0.02, 2.0
"""An odd time between rows deviates this many times as much from multiples of the usual one as all but few do."""
_TWO_ROUNDED, _COARSEST = 1.5, 2
"""Last digits by which the time between two rounded stamps may deviate, of a digit of 0.01 s or finer."""


@dataclass(frozen=True)
class Steps:
    """Equal steps of `period_s` for rows at `time_s` (m,), from 0 s on, each of which covers the time before it.

    A row belongs to the step that its middle lies in; after a pause it covers the usual time between rows, and
    what lies before it is missing. `use` (m,) are the rows with a value; `starts_s`, `stops_s` (count,) what
    those of a step cover, `whole` (count,) whether that is all of it. `time_sigma_s`: standard deviation of
    `time_s` where it is stamps that are rounded; 0 on a grid.
    """

    time_s: Array
    covers_s: Array
    owner: NDArray[np.int64]
    use: NDArray[np.bool_]
    starts_s: Array
    stops_s: Array
    whole: NDArray[np.bool_]
    usual_s: float
    period_s: float
    time_sigma_s: float = 0.0

    @classmethod
    def of(
        cls, time_s: Array, use: NDArray[np.bool_], least_s: float = 1.0, *, stamped: bool = False
    ) -> Steps:
        """Return steps of as many whole rows as make up `least_s` or more.

        Rows that are on an even grid but for rounded stamps are put on it, unless stamps are known to be true.
        """
        odd = _odd(time_s)
        grid_s, even = _evened(time_s, odd, stamped=stamped)
        apart = np.diff(grid_s)
        usual_s = float(np.median(apart)) if len(apart) else 1.0
        on = _by_median(grid_s) if stamped else _rows_on(grid_s)
        pause = np.concatenate(([False], (on > 1.0) | odd))
        if len(apart):
            # their mean, in which jitter of time stamps cancels: runs of one rate have one period
            usual_s = float(apart[~pause[1:]].mean())
        period_s = round(usual_s * max(math.ceil(least_s / usual_s - 0.05), 1), _FINEST if even else 3)
        time_s = time_s if stamped else grid_s
        covers = np.concatenate(([0.0], np.where(pause[1:], usual_s, np.diff(time_s))))
        count = math.floor((time_s[-1] + _INSTANT_S + _UNCOVERED * usual_s) / period_s)
        owner = np.floor((time_s - 0.5 * covers) / period_s).astype(np.int64)
        owner[(owner >= count) | (covers == 0.0)] = -1
        # where a row after a pause, or one of an odd length, began, the table's angle is not known
        use = use & (owner >= 0) & ~pause
        own, covered = owner[use], np.zeros(count)
        np.add.at(covered, own, covers[use])
        starts, stops = np.full(count, np.inf), np.full(count, -np.inf)
        np.minimum.at(starts, own, time_s[use] - covers[use])
        np.maximum.at(stops, own, time_s[use])
        slack = _UNCOVERED * usual_s
        whole = (covered > period_s - slack) & (stops - starts < covered + slack)
        sigma_s = 0.0 if even and not stamped else 10.0 ** -_digits(time_s) / math.sqrt(12.0)
        return cls(time_s, covers, owner, use, starts, stops, whole, usual_s, period_s, sigma_s)

    @property
    def count(self) -> int:
        """How many steps there are."""
        return len(self.whole)

    @property
    def edges_s(self) -> Array:
        """Borders of the steps, (count + 1,)."""
        return np.asarray(self.period_s * np.arange(self.count + 1.0))

    def means(self, values: Array, use: NDArray[np.bool_] | None = None) -> Array:
        """Return means of rows' values (m,) by step, (count,), NaN for a step without any."""
        kept = (self.owner >= 0) & ~np.isnan(values) & (True if use is None else use)
        sums = np.bincount(self.owner[kept], (values * self.covers_s)[kept], self.count)
        covered = np.bincount(self.owner[kept], self.covers_s[kept], self.count)
        return np.where(covered > 0.0, sums / np.maximum(covered, 1e-12), np.nan)

    def angles(self, angle_deg: Array) -> tuple[Array, Array | None]:
        """Return the angle at the borders and the rate there in deg/s, (count + 1,) each, from rows' angles (m,).

        In a whole step the angle grows as over the rows that are in it. Elsewhere it is interpolated: between
        rows that are missing nobody knows it. No rate for rows less than two to a step.
        """

        def at(times_s: Array) -> Array:
            return np.interp(times_s, self.time_s, angle_deg)

        starts = np.where(self.whole, self.starts_s, self.edges_s[:-1])
        stops = np.where(self.whole, self.stops_s, self.edges_s[1:])
        first, last = at(starts), at(stops)
        grown = (last - first) * self.period_s / (stops - starts)
        angle = at(self.edges_s)
        for step in np.flatnonzero(self.whole).tolist():
            if not step or not self.whole[step - 1]:
                angle[step] = first[step]
            angle[step + 1] = angle[step] + grown[step]
        if self.usual_s > _HALF * self.period_s:
            return angle, None
        inner = at(stops - self.usual_s), at(starts + self.usual_s)
        before, after = (last - inner[0]) / self.usual_s, (inner[1] - first) / self.usual_s
        # a row further off: where the rate ramps, the mean of the two rows beside a border is not the rate there
        further = (inner[0] - at(stops - 2.0 * self.usual_s), at(starts + 2.0 * self.usual_s) - inner[1])
        rate = np.zeros(self.count + 1)
        known = np.zeros(self.count + 1)
        for values, part in ((before, slice(1, None)), (after, slice(None, -1))):
            rate[part] += np.where(self.whole, values, 0.0)
            known[part] += self.whole
        rate = np.where(known > 0.0, rate / np.maximum(known, 1.0), np.gradient(angle) / self.period_s)
        both = self.whole[:-1] & self.whole[1:]
        far = (further[0][:-1] + further[1][1:]) / self.usual_s
        rate[1:-1] = np.where(both, (7.0 * (before[:-1] + after[1:]) - far) / 12.0, rate[1:-1])
        return angle, rate


def finer_rows(steps: Steps, angle_deg: Array) -> tuple[Array, Array] | None:
    """Return times (k,) and angles of a log's rows (m,), at most eight a step; None if steps are rows."""
    if steps.usual_s > _HALF * steps.period_s:
        return None
    if len(angle_deg) <= _FINER * steps.count:
        return steps.time_s, angle_deg
    times_s = np.asarray(np.arange(_FINER * steps.count + 1) * (steps.period_s / _FINER))
    return times_s, np.interp(times_s, steps.time_s, angle_deg)


def true_times(time_s: Array, rate_dps: Array, angle_deg: Array) -> tuple[Array, bool]:
    """Return the times of rows (m,), as stamped or on an even grid, and whether the stamps are known to be true.

    Stamps of a logger that reads an even stream when it has time are uneven; those of one that polls are true,
    even on the ticks of its clock. What the gyro saw where the table turned decides: `rate_dps` is the output,
    NaN where it is missing, `angle_deg` the table's angle at the stamps. Where it cannot, the stamps stay.
    """
    apart = np.diff(time_s)
    if len(apart) < _ENOUGH or not (apart > 0.0).all():
        return time_s, False
    odd = _odd(time_s)
    on = _rows_on(time_s)
    grid_s, row_s = _grid(time_s, odd, on), float(time_s[-1] - time_s[0]) / float(on.sum())
    most = _NEAREST if row_s > _TICKS * float(np.median(apart)) else _BESIDE_GRID
    if not 0.0 < np.abs(grid_s - time_s).max() < most * row_s:
        return time_s, False

    def scatter(times_s: Array) -> Array:
        rest = np.where(odd, np.nan, rate_dps[1:] - np.diff(angle_deg) / np.diff(times_s))
        return np.abs(np.diff(rest))

    even, stamped = scatter(grid_s), scatter(time_s)
    usual = max(min(_median(even), _median(stamped)), _LEAST_DPS)
    # neither explains a move that comes late, or an impulse
    better = (even - stamped)[np.fmin(even, stamped) < _OUTLYING * usual]
    size = math.sqrt(float((better**2).sum()))
    often = float(better.sum()) / size if size > 0.0 else 0.0
    if abs(often) < _OFTEN or abs(float(better.sum())) < _FAR_BETTER * usual:
        return time_s, False
    # true stamps of rows that beat with the ticks lie on the ticks' own grid
    own_s = _evened(time_s, odd, stamped=True)[0] if row_s > _TICKS * float(np.median(apart)) else time_s
    return (own_s, True) if often > 0.0 else (grid_s, False)


def _median(values: Array) -> float:
    """Return the median of values (m,) that are known, 0 of none."""
    known = values[~np.isnan(values)]
    return float(np.median(known)) if len(known) else 0.0


def _odd(time_s: Array) -> NDArray[np.bool_]:
    """Return which times between rows (m - 1,) are odd: the clock was set, or a stamp is late; none if many are.

    At 12 deg/s a clock that is set by 0.1 s within a row of 1 s gives it a rate of 4000 deg/h that no gyro had.
    """
    apart = np.diff(time_s)
    if len(apart) < 2 or not (apart > 0.0).all():
        return np.zeros(len(apart), dtype=bool)
    usual_s = float(np.median(apart))
    off = np.abs(apart - usual_s * np.maximum(np.rint(apart / usual_s), 1.0))
    rounded_s = _TWO_ROUNDED * 10.0 ** -max(_digits(time_s), _COARSEST)
    return np.asarray(off > max(_ODD * float(np.quantile(off, 1.0 - _FEW)), rounded_s))


def _evened(time_s: Array, odd: NDArray[np.bool_], *, stamped: bool = False) -> tuple[Array, bool]:
    """Return the times of rows (m,) on an even grid, and True, if they are on one but for rounded stamps.

    At 12 deg/s a stamp that is wrong by 0.5 us in 1 s is a rate wrong by 0.02 deg/h. Rows may be missing; each
    stretch between `odd` times (m - 1,) has a grid of its own, of the same step.
    """
    apart = np.diff(time_s)
    if len(apart) < 2 or not (apart > 0.0).all():
        return time_s, False
    grid_s = _grid(time_s, odd, _by_median(time_s) if stamped else _rows_on(time_s))
    if np.abs(grid_s - time_s).max() > _ROUNDED * 10.0 ** -_digits(time_s):
        return time_s, False
    return grid_s - grid_s[0], True


def _rows_on(time_s: Array) -> Array:
    """Return by how many rows each row, at times (m,), is on from the one before, (m - 1,): 1 if none is missing.

    By the usual time between rows. Where many seem to be missing, the clock may have ticks as long as a row: at
    50 Hz on ticks of 64 Hz most rows are 15.6 ms apart, some 31.2. Then each is the nearest to where it must be.
    """
    number = _by_median(time_s)
    if len(number) < 4 * _BEATS or np.mean(number > 1.0) < _OFTEN_MISSING:
        return number
    at_s, first_s = time_s - time_s.mean(), float(np.median(time_s[_BEATS:] - time_s[:-_BEATS])) / _BEATS
    # none missing, or those that a loop which follows the rows finds
    for on in (np.ones(len(number)), _followed(time_s, first_s)):
        for _ in range(_PASSES):
            place = np.concatenate(([0.0], np.cumsum(on)))
            place -= place.mean()
            step_s = float((place * at_s).sum()) / float((place * place).sum())
            if np.abs(at_s - step_s * place).max() < _NEAREST * step_s:
                return np.asarray(on)
            # by the line through all rows the first ones lie where they must be, too
            on = np.maximum(np.diff(np.rint(at_s / step_s - place[0])), 1.0)
    return number


def _by_median(time_s: Array) -> Array:
    """Return the same by the median time between rows, (m - 1,)."""
    apart = np.diff(time_s)
    return np.asarray(np.maximum(np.rint(apart / np.median(apart)), 1.0) if len(apart) else apart)


def _followed(time_s: Array, step_s: float) -> Array:
    """Return how many steps each time (m,) is on from the one before it, followed by a slow loop, (m - 1,)."""
    on, expected_s = [], float(time_s[0])
    for at_s in time_s[1:].tolist():
        number = max(round((at_s - expected_s) / step_s), 1)
        expected_s += number * step_s
        expected_s += _GAIN * (at_s - expected_s)
        on.append(float(number))
    return np.array(on)


def _grid(time_s: Array, odd: NDArray[np.bool_], on: Array) -> Array:
    """Return times of rows (m,) on a grid, another in each stretch between odd ones, by `_rows_on` (m - 1,)."""
    number = np.concatenate(([0.0], np.cumsum(on)))
    stretch = np.concatenate(([0], np.cumsum(odd)))
    size = np.bincount(stretch)
    from_middle = number - (np.bincount(stretch, number) / size)[stretch]
    middle_s = (np.bincount(stretch, time_s) / size)[stretch]
    # no product of BLAS: its threads would wait for each other
    step_s = float((from_middle * (time_s - middle_s)).sum()) / max(float((from_middle**2).sum()), 1e-12)
    return np.asarray(middle_s + step_s * from_middle)


def _digits(time_s: Array) -> int:
    """Return to how many digits of a second stamps are rounded."""
    return next((k for k in range(_FINEST) if _multiples(time_s, 10.0**-k)), _FINEST)


def _multiples(time_s: Array, unit_s: float) -> bool:
    return bool(np.abs(time_s / unit_s - np.rint(time_s / unit_s)).max() < 1e-3 + _INSTANT_S / unit_s)


def steady_beside(angle_deg: Array, missing: NDArray[np.bool_]) -> Array:
    """Return the angle at the borders of steps (n + 1,), steady rates going on into stretches that are missing.

    Moves are masked with what is steady on both sides; a rate that changes at the border of the mask would
    change inside the step that was kept. As far as it turns in the stretch, so far it turns there still.
    """
    turned = np.diff(angle_deg)
    edges = np.flatnonzero(np.diff(np.concatenate(([False], missing, [False])).astype(np.int8)))
    for start, stop in edges.reshape(-1, 2).tolist():
        if stop - start < _MASKED:
            continue
        whole = float(turned[start:stop].sum())
        if start >= 2 and abs(turned[start - 1] - turned[start - 2]) <= _STEADY * abs(turned[start - 1]):
            turned[start] = turned[start - 1]
        if stop + 1 < len(turned) and abs(turned[stop] - turned[stop + 1]) <= _STEADY * abs(turned[stop]):
            turned[stop - 1] = turned[stop]
        turned[start + 1 : stop - 1] += (whole - turned[start:stop].sum()) / (stop - start - 2)
    return np.asarray(angle_deg[0] + np.concatenate(([0.0], np.cumsum(turned))))
