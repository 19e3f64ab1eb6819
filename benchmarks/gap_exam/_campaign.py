"""A lab's campaign as a list of sorts of runs: what chamber, table and mount are asked to do, and when."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

Rates = Sequence[tuple[float, float]]
"""A table's rates: from second on, deg/s."""


@dataclass(frozen=True)
class Sort:
    """A sort of run: name, place of the axis, minutes, chamber (minute, degC); how often, how many held out.

    `turns` gives the table's rates, `elevation` the axis above the horizon from second on; `masks`: moves have
    no output. `grid`: a fine step, s, and how many make a row. `powered_s`: since when the unit is on.
    """

    code: str
    profile: str
    condition: str
    minutes: float
    chamber: Sequence[tuple[float, float]]
    repeats: int = 3
    held_out: int = 1
    turns: Callable[[], Rates] = tuple
    start_deg: float = 0.0
    elevation: Sequence[tuple[float, float]] = ((0.0, 90.0),)
    grid: tuple[float, int] = (0.1, 1)
    masks: bool = False
    powered_s: tuple[float, float] = (5400.0, 7200.0)

    def elevations(self, time_s: Array) -> tuple[Array, Array]:
        """Return when the mount changes, s, and the elevation at times (m,), deg."""
        begins, values = (np.array(column) for column in zip(*self.elevation, strict=True))
        return begins[1:], values[np.searchsorted(begins, time_s, side="right") - 1]


def in_rounds(sorts: Sequence[Sort], make: Callable[[Sort, int, int], Stage]) -> list[Stage]:
    """Return all runs, sort by sort; a lab does one of each sort, then the second of each.

    `make` gets sort, repeat and the run's number in the order of work.
    """
    most = max(sort.repeats for sort in sorts)
    order = [(sort, k) for k in range(most) for sort in sorts if k < sort.repeats]
    made = {(sort.code, k): make(sort, k, number) for number, (sort, k) in enumerate(order)}
    return [made[sort.code, k] for sort in sorts for k in range(sort.repeats)]


def demands(points: Sequence[tuple[float, float]], seconds: float, step_s: float) -> Array:
    """Return a chamber's demand between points (minute, degC), (n,)."""
    at = (np.arange(round(seconds / step_s)) + 0.5) * step_s / 60.0
    return np.asarray(np.interp(at, [minute for minute, _ in points], [value for _, value in points]))


def to_and_fro(start_s: float, end_s: float, rate_dps: float, sector_deg: float) -> list[tuple[float, float]]:
    """Return rates that sweep a sector to and fro."""
    leg_s = sector_deg / rate_dps
    legs = int((end_s - start_s) / leg_s)
    sweeps = [(start_s + k * leg_s, rate_dps if k % 2 == 0 else -rate_dps) for k in range(legs - legs % 2)]
    return [*sweeps, (start_s + (legs - legs % 2) * leg_s, 0.0)]


def motor_deg(rates: Rates, edges_s: Array, start_deg: float, dps2: float) -> Array:
    """Return a motor's angle, in degrees of the table, at edges (m + 1,): rates by ramps.

    A rate must be reached before the next begins.
    """
    knots, speed = [(0.0, 0.0)], 0.0
    for begin, rate in rates:
        knots += [(begin, speed), (begin + abs(rate - speed) / dps2, rate)]
        speed = rate
    knots.append((max(edges_s[-1], knots[-1][0]) + 1.0, speed))
    times, speeds = (np.array(column) for column in zip(*knots, strict=True))
    turned = np.concatenate(([0.0], np.cumsum(0.5 * (speeds[1:] + speeds[:-1]) * np.diff(times))))
    piece = np.clip(np.searchsorted(times, edges_s, side="right") - 1, 0, len(times) - 2)
    into, length = edges_s - times[piece], np.diff(times)[piece]
    bend = np.where(length > 0.0, np.diff(speeds)[piece] / np.maximum(length, 1e-12), 0.0)
    return np.asarray(start_deg + turned[piece] + into * (speeds[piece] + 0.5 * bend * into))


def at_rest(rates: Rates, mounted_s: Array, edges_s: Array, settles_s: float) -> NDArray[np.bool_]:
    """Return the rows outside moves (a rate, then 0) and changes of the mount, (n,): they are blanked."""
    spans = [(begin, end) for (begin, _), (end, _) in zip(rates[::2], rates[1::2], strict=True)]
    spans += [(at - 40.0, at + 20.0) for at in mounted_s.tolist()]
    rest = np.ones(len(edges_s) - 1, bool)
    for begin, end in spans:
        rest &= (edges_s[1:] <= begin) | (edges_s[:-1] >= end + settles_s)
    return rest
