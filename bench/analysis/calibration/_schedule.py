"""The language of schedules: turns about body axes, a home attitude, a dwell after each turn, a turn profile.

A move is a sign, an axis and, unless it is 90, an angle: `+y`, `-x180`, `+z360`. A home names where body axes
point: `x up, y south`. A scheme file (TOML) holds name, source, home, moves, and optionally notes.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np

from bench.analysis.calibration._conventions import AXES, rotation
from drivers.base.arrays import Array
from drivers.base.constants import DIRECTIONS
from drivers.base.errors import ConfigurationError
from drivers.base.files import SETTINGS_BYTES, parse_toml, read_bounded

SCHEMES_FOLDER = Path(__file__).parent / "schemes"
Profile = Literal["constant", "smooth"]
"""`constant` rate, or `smooth`: angle = A (s - sin(2 pi s) / 2 pi) over the same time."""

_MOVE = re.compile(r"([+-])([xyz])(\d*)")
_ALIASES = {"optimised": "t22"}
ANGLES = (90, 180, 270, 360)


@dataclass(frozen=True)
class Move:
    """A turn about body axis `axis` (0, 1, 2) by a signed multiple of 90 deg."""

    axis: int
    angle_deg: int

    def __str__(self) -> str:
        size = abs(self.angle_deg)
        return f"{'+' if self.angle_deg > 0 else '-'}{AXES[self.axis]}{'' if size == 90 else size}"


@dataclass(frozen=True, eq=False)
class Schedule:
    """Positions and the turns between them. `home`: C at the start, shape (3, 3); a dwell comes first."""

    name: str
    moves: tuple[Move, ...]
    home: Array
    dwell_s: float = 180.0
    rate_dps: float = 10.0
    profile: Profile = "smooth"
    source: str = ""
    notes: str = ""

    @property
    def positions(self) -> int:
        """Number of dwells."""
        return len(self.moves) + 1

    @property
    def duration_s(self) -> float:
        """Dwells and turns together."""
        return self.positions * self.dwell_s + sum(self.turn_s(move) for move in self.moves)

    @property
    def closes(self) -> bool:
        """Whether the last attitude is home."""
        return bool(np.allclose(self.attitudes()[-1], self.home, atol=1e-9))

    @property
    def net_turns(self) -> tuple[float, ...]:
        """Whole turns about body x, y, z that are left at the end."""
        return tuple(
            sum(move.angle_deg for move in self.moves if move.axis == axis) / 360.0 for axis in range(3)
        )

    def turn_s(self, move: Move) -> float:
        """Duration of a move: its angle at the mean rate."""
        return abs(move.angle_deg) / self.rate_dps

    def attitudes(self) -> Array:
        """Return C of every dwell, shape (positions, 3, 3)."""
        found = [self.home]
        for turn in turn_matrices(self.moves):
            found.append(found[-1] @ turn)
        return np.array(found)

    def up_axes(self) -> list[str]:
        """Return which body axis points up at every dwell: `+z`, `-x`, ...; `-` where none does."""
        return [_up_axis(attitude) for attitude in self.attitudes()]

    def with_(self, **changes: Any) -> Schedule:
        """Return the schedule with fields replaced."""
        return replace(self, **changes)


def turn_matrices(moves: Sequence[Move]) -> Array:
    """Return the matrix of every move, shape (n, 3, 3)."""
    axes = np.array([move.axis for move in moves], dtype=int)
    return rotation(np.eye(3)[axes], np.radians([move.angle_deg for move in moves]))


def moves_text(moves: Sequence[Move]) -> str:
    """Return moves as they are written."""
    return " ".join(str(move) for move in moves)


def parse_moves(text: str, where: str = "moves") -> tuple[Move, ...]:
    """Read moves; blanks and commas are ignored. ConfigurationError names what is not a move."""
    compact = re.sub(r"[\s,]", "", text)
    moves, at = [], 0
    while at < len(compact):
        found = _MOVE.match(compact, at)
        if found is None or (found[3] and int(found[3]) not in ANGLES):
            raise ConfigurationError(
                "not a move",
                where=where,
                found=repr(compact[at : at + 8]),
                expected="sign, body axis and one of 90, 180, 270, 360 (90 when left out), such as +y or -x180",
            )
        moves.append(Move(AXES.index(found[2]), int(found[1] + (found[3] or "90"))))
        at = found.end()
    return tuple(moves)


def home_attitude(text: str, where: str = "home") -> Array:
    """Return C (3, 3) of a home such as `x up, y south`; two axes suffice, a third must agree (right-handed)."""
    rows = dict(part.split() for part in text.split(",") if len(part.split()) == 2)
    columns: dict[int, Array] = {
        AXES.index(axis): np.array(DIRECTIONS[to], dtype=float)
        for axis, to in rows.items()
        if axis in AXES and to in DIRECTIONS
    }
    first, second = (*columns.values(), np.zeros(3), np.zeros(3))[:2]
    if len(columns) < 2 or len(columns) != len(text.split(",")) or abs(first @ second) > 0.5:
        raise _bad_home(where, text, "two body axes at a right angle, e.g. 'x up, y south'")
    for axis in range(3):
        after, last = (axis + 1) % 3, (axis + 2) % 3
        if axis not in columns:
            columns[axis] = np.cross(columns[after], columns[last])
    attitude = np.column_stack([columns[axis] for axis in range(3)])
    if np.linalg.det(attitude) < 0.5:
        raise _bad_home(where, text, "right-handed body axes (x right, y forward, z up): z = x cross y")
    return attitude


def home_text(attitude: Array) -> str:
    """Return a home attitude in words; axes off the grid are named by the nearest direction."""
    names = list(DIRECTIONS)
    table = np.array(list(DIRECTIONS.values()), dtype=float)
    nearest = [names[int(np.argmax(table @ attitude[:, axis]))] for axis in range(3)]
    return ", ".join(f"{AXES[axis]} {name}" for axis, name in enumerate(nearest))


def scheme_names() -> list[str]:
    """Return the names of the schemes that come with the package."""
    return sorted(path.stem for path in SCHEMES_FOLDER.glob("*.toml"))


def load_scheme(name: str) -> Schedule:
    """Return a scheme by name or from a TOML file; ConfigurationError if there is none or it cannot be used."""
    name = _ALIASES.get(name, name)
    path = Path(name) if name.endswith(".toml") else SCHEMES_FOLDER / f"{name}.toml"
    try:
        content = parse_toml(read_bounded(path, SETTINGS_BYTES))
        moves, home = str(content["moves"]), str(content["home"])
    except (OSError, ValueError, KeyError) as error:
        raise ConfigurationError(
            "the scheme cannot be read",
            where=str(path),
            found=f"{type(error).__name__}: {error}",
            expected="a TOML file with name, home and moves, or one of " + ", ".join(scheme_names()),
        ) from error
    return Schedule(
        name=str(content.get("name", path.stem)),
        moves=parse_moves(moves, str(path)),
        home=home_attitude(home, str(path)),
        source=str(content.get("source", "")),
        notes=str(content.get("notes", "")),
    )


def scheme_file(schedule: Schedule) -> str:
    """Return a scheme as the text of a scheme file."""
    quoted = {
        "name": schedule.name,
        "source": schedule.source,
        "home": home_text(schedule.home),
        "moves": moves_text(schedule.moves),
        "notes": schedule.notes,
    }
    return "".join(f'{key} = "{value}"\n' for key, value in quoted.items() if value)


def _up_axis(attitude: Array) -> str:
    up = attitude[2]
    axis = int(np.argmax(np.abs(up)))
    return f"{'+' if up[axis] > 0 else '-'}{AXES[axis]}" if abs(up[axis]) > 0.999 else "-"


def _bad_home(where: str, text: str, expected: str) -> ConfigurationError:
    return ConfigurationError("not a home attitude", where=where, found=repr(text), expected=expected)
