"""From a scheme to what a table is told: how to mount the unit, where the axes start, which axis turns when.

    C = R_1(angle_1) ... R_n(angle_n) C_mount,    R_k a turn about the direction of axis k with all axes at 0

A move about a body axis is made by a table axis that lies along it at that moment. Which way the outer axis
points may force another heading on the scheme's home. Half a turn of heading changes nothing; a quarter costs the
published schemes up to 16 % of their worst sigma, short searched ones up to 75 % (60 s dwell): it is taken only
if it must be.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bench.analysis.calibration._conventions import rotation
from bench.analysis.calibration._schedule import Schedule, home_text
from bench.analysis.calibration._table import Table
from drivers.base.arrays import Array
from drivers.base.constants import DIRECTIONS
from drivers.base.errors import ConfigurationError

if TYPE_CHECKING:
    from drivers.kit.config import TableConfig

_ALONG = 1e-6
_TURNS_LIMIT_DEG = 3600.0


@dataclass(frozen=True)
class TableAxis:
    """One axis: its name, its direction with all axes at 0 (`east`, ..., `down`), its stops if it has any."""

    name: str
    direction: str
    min_angle_deg: float | None = None
    max_angle_deg: float | None = None

    def reaches(self, angle_deg: float) -> bool:
        """Whether the axis can stand at an angle, turns counted."""
        if self.min_angle_deg is None or self.max_angle_deg is None:
            return abs(angle_deg) <= _TURNS_LIMIT_DEG
        return self.min_angle_deg <= angle_deg <= self.max_angle_deg


@dataclass(frozen=True)
class TableTurn:
    """A move as the table makes it: this axis by this angle, to this angle (turns counted)."""

    axis: str
    by_deg: int
    to_deg: int


@dataclass(frozen=True, eq=False)
class TurningPlan:
    """What the table is told. `mount` (3, 3): the unit's attitude with all axes at 0; `start_deg` by axis name.

    `schedule` has the home that is really taken, whose heading may differ from the scheme's.
    """

    schedule: Schedule
    mount: Array
    start_deg: dict[str, int]
    turns: tuple[TableTurn, ...]

    @property
    def mount_text(self) -> str:
        """The mounting in words: where each body axis points with all axes at 0."""
        return home_text(self.mount)


def table_axes(section: TableConfig) -> list[TableAxis]:
    """Return the axes of a bench file's `[table]`, outermost first."""
    return [
        TableAxis(axis.name, axis.direction, axis.min_angle_deg, axis.max_angle_deg)
        for axis in section.all_axes
    ]


def table_type(axes: Sequence[TableAxis]) -> Table:
    """Return the type of table that the axes make; ConfigurationError for one axis."""
    if len(axes) < 2:
        raise ConfigurationError(
            "a calibration needs a table of two or three axes",
            where="bench file, [table]",
            found=f"{len(axes)} axis",
            expected="[[table.axes]] with name, number and direction of each axis, outermost first",
            remedy="with one axis the scale factors and angles of the other two gyros cannot be seen",
        )
    if len(axes) == 3:
        return "three-axis"
    return "two-axis-vertical" if axes[0].direction in ("up", "down") else "two-axis-horizontal"


def plan_turns(schedule: Schedule, axes: Sequence[TableAxis]) -> TurningPlan:
    """Return how the table runs a schedule, the simplest mounting first.

    ConfigurationError if the schedule does not close, or naming the turn at which no mounting is left.
    """
    table = table_type(axes)
    require_closed(schedule)
    furthest = -1
    for heading, start in sorted(_starts(axes), key=_effort):
        home = rotation(np.array([0.0, 0.0, 1.0]), np.array([math.radians(heading)]))[0] @ schedule.home
        mount = _axes_turned(axes, start).T @ home
        turns, reached = _follow(schedule, axes, mount, start)
        if turns is not None:
            named = {axis.name: angle for axis, angle in zip(axes, start, strict=True)}
            return TurningPlan(schedule.with_(home=_clean(home)), _clean(mount), named, turns)
        furthest = max(furthest, reached)
    raise ConfigurationError(
        f"the {table} table cannot make turn {furthest + 1} of this scheme with one axis",
        where=f"scheme {schedule.name}",
        found=f"{schedule.moves[furthest]} from an attitude with {schedule.up_axes()[furthest]} up",
        expected="a turn about a body axis that lies along an axis of the table, between its stops",
        remedy="choose a scheme for this table, or let `gyrobench scheme search` find one",
    )


def require_closed(schedule: Schedule) -> None:
    """Raise ConfigurationError for a schedule that does not come back to its home."""
    if schedule.closes:
        return
    raise ConfigurationError(
        "this scheme does not come back to where it starts",
        where=f"scheme {schedule.name}",
        found=f"{home_text(schedule.attitudes()[-1])} at the end",
        expected=f"its home, {home_text(schedule.home)}",
        remedy="add turns that close it: cables stay wound up, and the next run cannot start where this one ends",
    )


def _starts(axes: Sequence[TableAxis]) -> list[tuple[int, tuple[int, ...]]]:
    """Return (heading, start angles); the innermost starts at 0, since the mounting can make up for it."""
    quarters = [[q for q in (0, 90, -90, 180) if axis.reaches(q)] for axis in axes[:-1]]
    return [(heading, (*start, 0)) for heading in (0, 90, 180, 270) for start in itertools.product(*quarters)]


def _effort(start: tuple[int, tuple[int, ...]]) -> tuple[bool, int, int, int]:
    heading, angles = start
    moved = sum(angle != 0 for angle in angles)
    return heading % 180 != 0, moved, heading, sum(abs(angle) for angle in angles)


def _axes_turned(axes: Sequence[TableAxis], angles_deg: Sequence[int]) -> Array:
    c = np.eye(3)
    for axis, angle in zip(axes, angles_deg, strict=True):
        c = c @ rotation(np.array(DIRECTIONS[axis.direction], float), np.array([math.radians(angle)]))[0]
    return c


def _follow(
    schedule: Schedule, axes: Sequence[TableAxis], mount: Array, start: tuple[int, ...]
) -> tuple[tuple[TableTurn, ...] | None, int]:
    """Return the turns from a start, or None; and the number of moves that could be made."""
    furthest = 0
    seen: set[tuple[int, tuple[int, ...]]] = set()
    stack: list[tuple[tuple[int, ...], tuple[TableTurn, ...]]] = [(start, ())]
    while stack:
        angles, turns = stack.pop()
        number = len(turns)
        furthest = max(furthest, number)
        if number == len(schedule.moves):
            return turns, number
        if (number, angles) in seen:
            continue
        seen.add((number, angles))
        move = schedule.moves[number]
        body = (_axes_turned(axes, angles) @ mount)[:, move.axis]
        for at, axis in enumerate(axes):
            line = _axes_turned(axes[:at], angles[:at]) @ np.array(DIRECTIONS[axis.direction], float)
            along = float(line @ body)
            if abs(abs(along) - 1.0) > _ALONG:
                continue
            by = move.angle_deg if along > 0 else -move.angle_deg
            if axis.reaches(angles[at] + by):
                after = (*angles[:at], angles[at] + by, *angles[at + 1 :])
                stack.append((after, (*turns, TableTurn(axis.name, by, angles[at] + by))))
    return None, furthest


def _clean(attitude: Array) -> Array:
    """Return an attitude on the 90 deg grid without rounding errors."""
    return np.asarray(np.rint(attitude) + 0.0)
