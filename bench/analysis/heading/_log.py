"""What a platform INS recorded on its table, and the stretches at one heading in it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.statistics import stretches
from bench.analysis.heading._frames import gravitation_latitude_deg, sidereal_rad, wrap_deg
from drivers.base.arrays import Array
from drivers.base.constants import SCHULER_RAD_S
from drivers.base.errors import RecordError

_SAME_HEADING_DEG = 2.0
_SHORTEST_STAY_S = 600.0
_SLOW_S = 30.0
"""Time before and after a row over which a slow turn is seen: by 2 deg in a minute and more."""
_COLUMNS = ("time_s", "sidereal_rad", "north_as", "east_as", "temp_c", "heading_deg")
_FURTHER = ("second_c", "force_mps2")


@dataclass(frozen=True, eq=False)
class WarmUp:
    """Temperature at one heading from power-on, or from a turn, on: arrays of shape (n,), times increasing."""

    time_s: Array
    sidereal_rad: Array
    temp_c: Array


@dataclass(frozen=True, eq=False)
class PlatformLog:
    """A platform INS at a known, fixed place. Arrays of shape (n,), times increasing.

    `north_as`, `east_as`: latitude error and cos(latitude) times longitude error, arcsec, NaN where the
    position is missing. `temp_c`: the platform's own temperature, NaN where missing. `latitude_deg`: see
    `gravitation_latitude_deg`. `delay_s`: by how much a velocity-damped INS shows its misalignment late, 2 zeta
    / Schuler frequency. `warm_up`: what was recorded from power-on to the reference, where that is no part of
    the log. Of further sensors, where there are any: `second_c` (n,), another temperature; `force_mps2` (n, 3),
    specific force in the platform's axes.
    """

    time_s: Array
    sidereal_rad: Array
    north_as: Array
    east_as: Array
    temp_c: Array
    heading_deg: Array
    latitude_deg: float
    delay_s: float = 0.0
    warm_up: WarmUp | None = None
    second_c: Array | None = None
    force_mps2: Array | None = None

    def __post_init__(self) -> None:
        sizes = {len(column) for column in self._columns().values()}
        if len(sizes) != 1 or len(self.time_s) < 2 or not (np.diff(self.time_s) > 0).all():
            backwards = np.count_nonzero(np.diff(self.time_s) <= 0)
            raise RecordError(
                "a platform log that cannot be used",
                found=f"column lengths {sorted(sizes)}, {backwards} steps back in time",
                expected="columns of one length, at least two rows, times increasing",
                remedy="sort the rows by time and remove those that came twice",
            )

    def part(self, start: int, stop: int) -> PlatformLog:
        """Return rows `start` to `stop`."""
        return replace(self, **{name: column[start:stop] for name, column in self._columns().items()})

    def _columns(self) -> dict[str, Any]:
        every = {name: getattr(self, name) for name in (*_COLUMNS, *_FURTHER)}
        return {name: column for name, column in every.items() if column is not None}


@dataclass(frozen=True)
class Stay:
    """Rows `start` to `stop` of a log, at one heading; `duration_s` between the first and the last."""

    start: int
    stop: int
    heading_deg: float
    duration_s: float


@dataclass(frozen=True)
class Site:
    """Where the platform stood, geodetic, and how its clock and navigation are.

    `sidereal_zero_deg`: Earth rotation angle at time 0 of the log (`earth_rotation_deg`); None, when the log's
    clock is its own, counts from Greenwich at time 0, which serves for one run but not for a compensation that is
    to be used in another. `damping`: ratio of the velocity damping, 0 without.
    """

    latitude_deg: float
    longitude_deg: float
    sidereal_zero_deg: float | None = None
    damping: float = 0.0


def log_from_positions(
    time_s: Array, latitude_deg: Array, longitude_deg: Array, temp_c: Array, heading_deg: Array, site: Site
) -> PlatformLog:
    """Return the log of an INS that put out geodetic positions, deg, while it stood at `site`."""
    effective_deg = float(gravitation_latitude_deg(site.latitude_deg))
    level = np.cos(np.radians(effective_deg))
    zero_deg = (site.sidereal_zero_deg or 0.0) + site.longitude_deg
    return PlatformLog(
        time_s=np.asarray(time_s, dtype=np.float64),
        sidereal_rad=sidereal_rad(time_s, zero_deg),
        north_as=3600.0 * (gravitation_latitude_deg(latitude_deg) - effective_deg),
        east_as=3600.0 * level * wrap_deg(np.asarray(longitude_deg) - site.longitude_deg),
        temp_c=np.asarray(temp_c, dtype=np.float64),
        heading_deg=np.asarray(heading_deg, dtype=np.float64),
        latitude_deg=effective_deg,
        delay_s=2.0 * site.damping / SCHULER_RAD_S,
    )


def stays(log: PlatformLog) -> list[Stay]:
    """Return the stretches of at least 10 min during which the heading stayed within 2 deg, in order.

    Two stays in succession at the same heading (a gap between, a turn and back) are one.
    """
    found: list[tuple[int, int]] = []
    heading = log.heading_deg
    start = 0
    for turn in [*(np.flatnonzero(np.abs(wrap_deg(np.diff(heading))) > _SAME_HEADING_DEG) + 1), len(heading)]:
        for first, last in _between_slow_turns(log, start, int(turn)):
            if log.time_s[last - 1] - log.time_s[first] >= _SHORTEST_STAY_S:
                found.append((first, last))
        start = int(turn)
    joined: list[tuple[int, int]] = []
    for first, last in found:
        same = joined and abs(wrap_deg(heading[last - 1] - heading[joined[-1][1] - 1])) <= _SAME_HEADING_DEG
        joined[-1:] = [(joined[-1][0], last)] if same else [*joined[-1:], (first, last)]
    return [
        Stay(first, last, float(heading[last - 1]) % 360.0, float(log.time_s[last - 1] - log.time_s[first]))
        for first, last in joined
    ]


def _between_slow_turns(log: PlatformLog, start: int, stop: int) -> list[tuple[int, int]]:
    """Return the parts of rows `start` to `stop`, which are without a jump, in which the heading is one."""
    time_s = log.time_s[start:stop]
    heading = np.unwrap(log.heading_deg[start:stop], period=360.0)
    if np.ptp(heading) <= _SAME_HEADING_DEG:
        return [(start, stop)]
    turned = np.interp(time_s + _SLOW_S, time_s, heading) - np.interp(time_s - _SLOW_S, time_s, heading)
    parts = []
    for first, last in stretches(np.abs(turned) <= _SAME_HEADING_DEG).tolist():
        near = np.abs(heading[first:last] - np.median(heading[first:last])) <= _SAME_HEADING_DEG
        parts += [(start + first + own, start + first + end) for own, end in stretches(near).tolist()]
    return parts


def settled(log: PlatformLog, after_s: float) -> NDArray[np.bool_]:
    """Return where the heading has not changed for `after_s`, shape (n,).

    What a window of W says is transient for W plus twice the core's time constant after a turn. The
    first stay is taken to have begun long before the log.
    """
    calm = np.ones(len(log.time_s), dtype=np.bool_)
    for stay in stays(log)[1:]:
        begun_s = log.time_s[stay.start]
        calm &= (log.time_s < begun_s) | (log.time_s >= begun_s + after_s)
    return calm
