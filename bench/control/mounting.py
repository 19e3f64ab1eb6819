"""How the units lie on the table, as was told, and whether their axes under test feel what it turns.

Directions are east, north, up. With all table axes at 0 an axis under test points as its mounting says. Turning
the axes inside of the one that spins changes its part along the rotation; turning those outside does not.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from math import cos, inf, isfinite, radians, sin
from typing import Any, get_args

import numpy as np

from bench.record.events.run import Invalid
from drivers.base.arrays import Array
from drivers.base.constants import DIRECTIONS
from drivers.base.errors import ConfigurationError
from drivers.kit.config import AxisConfig, GyroConfig, Mounting

_LEVEL = {"x": "north", "y": "west", "z": "up"}
"""Where the axes of a unit with z up point."""
_ALONG = cos(radians(5.0))
"""An axis nearer to the rotation than this feels all of it but 0.4 %."""
_LEAST_SHARE = 0.5
"""An axis along the rotation feels all of it but scale-factor errors; half of it is no such error."""
_LEAST_RATE_DPS = 0.1
"""Below it Earth rate and bias are no small part of the output."""
_WITHIN = 0.9


@dataclass
class Turning:
    """A stretch at one rate; `across`: the procedure says that the axes under test need not lie along it."""

    axis: str
    rate_dps: float
    across: bool
    from_s: float
    until_s: float = inf
    told: set[str] = field(default_factory=set)

    def covers(self, start_s: float, end_s: float) -> bool:
        """Return whether the table turned so for nearly all of an interval."""
        common_s = min(end_s, self.until_s) - max(start_s, self.from_s)
        return common_s > _WITHIN * (end_s - start_s)


@dataclass
class Mountings:
    """What was told of the units, and what the table turned."""

    axes: Sequence[AxisConfig]
    gyros: Sequence[GyroConfig]
    turnings: list[Turning] = field(default_factory=list)
    _level: dict[str, Array] = field(default_factory=dict)

    def require_known(self, act: Mapping[str, Any]) -> None:
        """Raise ConfigurationError for a `mount` act without a mounting that there is: nobody is asked that.

        Likewise for a `roll_deg` that is no number, or with a mounting that does not tell where the axis under
        test is.
        """
        mounting, roll_deg = act.get("mounting"), act.get("roll_deg", 0.0)
        if act.get("act") != "mount" or "attitude" in act:
            return
        if mounting in get_args(Mounting):
            if (
                not isinstance(roll_deg, int | float)
                or not isfinite(roll_deg)
                or (roll_deg and mounting == "z_up")
            ):
                raise ConfigurationError(
                    "a unit cannot be turned so about its axis under test",
                    where='bench.ask(..., act="mount")',
                    found=f"mounting={mounting!r}, roll_deg={roll_deg!r}",
                    expected="a number of degrees, with axis_horizontal or axis_up",
                )
            return
        raise ConfigurationError(
            "there is no such mounting"
            if "mounting" in act
            else "a question to mount a unit does not say how",
            where='bench.ask(..., act="mount")',
            found=repr(mounting) if "mounting" in act else "",
            expected=f"mounting= one of {', '.join(get_args(Mounting))}",
            remedy="docs/own_procedure.md says where each has the axis under test point",
        )

    def tell(self, act: Mapping[str, Any]) -> None:
        """Note what a `mount` act says; ConfigurationError for a mounting that there is not."""
        if act.get("act") != "mount":
            return
        self.require_known(act)
        mounting, attitude = act.get("mounting"), act.get("attitude")
        for gyro in self.gyros:
            if act.get("unit", gyro.name) != gyro.name:
                continue
            if attitude is not None:
                self._level[gyro.name] = np.array(attitude, dtype=float)[:, "xyz".index(gyro.axis)]
                continue
            pointing = {"axis_up": "up", "axis_horizontal": "north", "z_up": _LEVEL[gyro.axis]}[str(mounting)]
            self._level[gyro.name] = np.array(DIRECTIONS[pointing], dtype=float)

    def ends(self, axis: str, now_s: float) -> None:
        """Note that an axis is told something else from now on."""
        for turning in self.turnings:
            if turning.axis == axis:
                turning.until_s = min(turning.until_s, now_s)

    def part_along(self, gyro: str, axis: str, angle_deg: Callable[[str], float]) -> float | None:
        """Return the cosine between a gyro's axis under test and a table axis; None if no mounting was told."""
        if gyro not in self._level:
            return None
        pointing = self._level[gyro]
        for inner in reversed(self.axes):
            direction = np.array(DIRECTIONS[inner.direction], dtype=float)
            if inner.name == axis:
                return float(direction @ pointing)
            angle = radians(angle_deg(inner.name))
            pointing = (
                cos(angle) * pointing
                + sin(angle) * np.cross(direction, pointing)
                + (1.0 - cos(angle)) * (direction @ pointing) * direction
            )
        raise KeyError(axis)

    def require_along(self, axis: str, rate_dps: float, angle_deg: Callable[[str], float]) -> None:
        """Raise ConfigurationError if the table is to turn a unit about another axis than the one under test."""
        for gyro in self.gyros:
            part = self.part_along(gyro.name, axis, angle_deg)
            if part is not None and abs(part) < _ALONG:
                raise ConfigurationError(
                    f"{gyro.name} would be turned at {rate_dps:g} deg/s across its axis under test",
                    where=f"table, {axis} axis",
                    found=f"as it is mounted, its axis {gyro.axis} feels {part:+.3f} of the rotation",
                    expected="an axis under test along the rotation",
                    remedy='mount it "axis_up" where the table turns about the vertical, name another axis under '
                    "test in the bench file, or write spin(..., across=True) if it is meant to lie across",
                )

    def not_felt(self, gyro: str, start_s: float, end_s: float, mean_dps: float) -> Invalid | None:
        """Return why a mean output says nothing of a rotation that went on meanwhile; None if it does."""
        for turning in self.turnings:
            if turning.across or abs(turning.rate_dps) < _LEAST_RATE_DPS or gyro in turning.told:
                continue
            share = mean_dps / turning.rate_dps
            if share < _LEAST_SHARE and turning.covers(start_s, end_s):
                turning.told.add(gyro)
                text = (
                    f"{gyro} felt {share:.4f} of the rotation at {turning.rate_dps:g} deg/s: its axis under test "
                    "does not lie along it"
                )
                facts = {"device": gyro, "share": share, "rate_dps": turning.rate_dps}
                return Invalid("rotation_not_felt", text, facts)
        return None
