"""Ways of a table's axis: which angles it passes on its way to another one, and its stops."""

from __future__ import annotations

import math

from drivers.base.errors import LimitExceeded
from drivers.kit.config import AxisConfig

ANGLE_MARGIN_DEG = 0.5
STILL_DPS = 0.05
"""A table that turns slower is taken to be at rest: which way it goes to an angle is known then."""

Way = tuple[float, float]
"""The lowest and the highest angle that are passed, deg, turns counted: from 350 to 370 it passes 0."""


def a_turn(now: tuple[float, float] | None) -> Way:
    """Return the way of an axis that passes every angle, from its newest angle and rate."""
    start_deg = 0.0 if now is None else now[0]
    return start_deg, start_deg + 360.0


def way_to(
    axis: AxisConfig, now: tuple[float, float] | None, angle_deg: float, by_deg: float | None = None
) -> Way:
    """Return the way of an axis to an angle; a whole turn where it is not known.

    `now`: its newest angle, deg, and rate, deg/s. `by_deg`: how far it is told to turn; without, one with stops
    stays between them, and others go the shorter way.
    """
    if now is None:
        return a_turn(now)
    start_deg, rate_dps = now
    low, high = axis.min_angle_deg, axis.max_angle_deg
    if low is not None and high is not None:
        middle = 0.5 * (low + high)
        start_deg = middle + math.remainder(start_deg - middle, 360.0)
        by_deg = angle_deg - start_deg if by_deg is None else by_deg
    elif by_deg is None:
        by_deg = math.remainder(angle_deg - start_deg, 360.0)
        if abs(rate_dps) > STILL_DPS or abs(by_deg) > 180.0 - ANGLE_MARGIN_DEG:
            return a_turn(now)
    return min(start_deg, start_deg + by_deg), max(start_deg, start_deg + by_deg)


def require_between_stops(axis: AxisConfig, angle_deg: float, way_deg: Way, where: str) -> None:
    """Raise LimitExceeded for an angle beyond an axis's stops, or a way round through them."""
    low, high = axis.min_angle_deg, axis.max_angle_deg
    if low is None or high is None:
        return
    within = low - ANGLE_MARGIN_DEG <= way_deg[0] and way_deg[1] <= high + ANGLE_MARGIN_DEG
    beyond = not low <= angle_deg <= high
    if beyond or not (within or way_deg == a_turn(None)):
        raise LimitExceeded(
            "an angle beyond the stops of the axis",
            where=where,
            found=f"{angle_deg:g} deg" if beyond else f"a way from {way_deg[0]:.3f} to {way_deg[1]:.3f} deg",
            expected=f"{low:g} .. {high:g} deg (bench file)",
            remedy="mount the unit another way, or take another scheme",
        )


def require_no_stops(axis: AxisConfig, rate_dps: float, where: str) -> None:
    """Raise LimitExceeded for an axis with stops that is told to spin."""
    if axis.min_angle_deg is None and axis.max_angle_deg is None:
        return
    raise LimitExceeded(
        "an axis with stops cannot spin: it would turn into one",
        where=where,
        found=f"{rate_dps:g} deg/s",
        expected="turns to angles (bench file: min_angle_deg, max_angle_deg)",
        remedy="point it, or spin another axis",
    )


def check_stops(axis: AxisConfig, angle_deg: float, where: str) -> None:
    """Raise LimitExceeded if an axis of limited motion is found beyond its stops, by more than half a degree."""
    low, high = axis.min_angle_deg, axis.max_angle_deg
    if low is None or high is None:
        return
    span = high - low + 2.0 * ANGLE_MARGIN_DEG
    if span < 360.0 and (angle_deg - low + ANGLE_MARGIN_DEG) % 360.0 > span:
        raise LimitExceeded(
            "the axis is beyond its stops",
            where=where,
            found=f"{angle_deg:.3f} deg",
            expected=f"{low:g} .. {high:g} deg (bench file)",
            remedy="the bench is being made safe; check cables before the axis is turned back",
        )
