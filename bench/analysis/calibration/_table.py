"""What a table can turn one gimbal at a time: two-axis tables by their outer axis, three-axis tables, hands.

On the 90 deg grid a table is a graph. Two axes: the outer axis is fixed in n, the inner axis is a body axis at a
right angle to it; possible turns are about the inner axis and about the body axis that lies along the outer one.
Three axes: the outer axis is vertical, the middle one horizontal and carried by the outer, the inner one a body
axis at a right angle to the middle; with inner and outer in line (gimbal lock) either makes a turn about up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from bench.analysis.calibration._conventions import AXES
from bench.analysis.calibration._schedule import Schedule
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

Table = Literal["by-hand", "two-axis-horizontal", "two-axis-vertical", "three-axis"]
TABLES: tuple[str, ...] = get_args(Table)
_EAST, _NORTH, _UP = 0, 1, 2


@dataclass(frozen=True)
class Gimbals:
    """One way an IMU sits on a table: `inner` body axis, and the direction (0 east, 1 north, 2 up) of the
    outer axis of a two-axis table or, at this moment, of the middle axis of a three-axis one.
    """

    inner: int
    line: int


def mountings(table: Table, attitude: Array, outer: str | None = None) -> list[Gimbals]:
    """Return all ways to mount an IMU whose attitude at the start is C (3, 3), on the 90 deg grid.

    `outer`: where the horizontal outer axis of a two-axis table points; None: it may point east or north.
    """
    lines = {"two-axis-vertical": (_UP,), "by-hand": ()}.get(table, (_EAST, _NORTH))
    if outer is not None and table == "two-axis-horizontal":
        lines = (_EAST if outer in ("east", "west") else _NORTH,)
    return [
        Gimbals(inner, line)
        for line in lines
        for inner in range(3)
        if inner != _body_axis_along(attitude, line)
    ]


def turned(table: Table, gimbals: Gimbals, attitude: Array, axis: int) -> list[Gimbals]:
    """Return what a turn by an odd number of quarters about body `axis` may leave; empty if it cannot be made."""
    if table == "by-hand":
        return [gimbals]
    carried = axis in (gimbals.inner, _body_axis_along(attitude, gimbals.line))
    found = [gimbals] if carried else []
    if table == "three-axis" and axis == _body_axis_along(attitude, _UP):
        found.append(Gimbals(gimbals.inner, _NORTH if gimbals.line == _EAST else _EAST))
    return found


def first_impossible(table: Table, schedule: Schedule) -> int | None:
    """Return the index of the first turn at which no way of mounting is left; None if all can be made."""
    if table == "by-hand":
        return None
    attitudes = schedule.attitudes()
    ways: set[Gimbals] = set(mountings(table, attitudes[0]))
    for number, move in enumerate(schedule.moves):
        # An even number of quarters brings the middle axis of a three-axis table back to its line.
        odd = move.angle_deg // 90 % 2
        ways = {
            left if odd else way for way in ways for left in turned(table, way, attitudes[number], move.axis)
        }
        if not ways:
            return number
    return None


def require_possible(table: Table, schedule: Schedule) -> None:
    """Raise ConfigurationError, naming the turn, if the table cannot run the schedule."""
    if table not in TABLES:
        raise ConfigurationError("no such table", found=table, expected=" or ".join(TABLES))
    number = first_impossible(table, schedule)
    if number is not None:
        raise ConfigurationError(
            f"a {table} table cannot make turn {number + 1} of this scheme with one gimbal",
            where=f"scheme {schedule.name}",
            found=f"{schedule.moves[number]} from an attitude with {schedule.up_axes()[number]} up",
            expected="a turn about the inner axis or about the body axis that lies along another gimbal",
            remedy="choose a scheme for this table, or let `gyrobench scheme search` find one",
        )


def _body_axis_along(attitude: Array, line: int) -> int:
    found = int(np.argmax(np.abs(attitude[line])))
    if abs(attitude[line, found]) < 0.999:
        raise ConfigurationError(
            "tables are checked on the 90 deg grid only",
            found=f"body axis {AXES[found]} {abs(attitude[line, found]):.3f} along a direction of the table",
            expected="a home attitude whose body axes point east, north, up or their opposites",
        )
    return found
