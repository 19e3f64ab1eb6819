"""Limits of the bench file on what is about to be demanded and on what telemetry says.

A rule of `[[limits.forbid]]` names a state that must not be: all its conditions together. Before a command it is
asked whether the state may come about: every quantity is then an interval, from what telemetry says to what has
been demanded (air that is on its way to -50 degC will pass -40). On telemetry the intervals are points.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from bench.record.benchfile import Band, ForbiddenState, LimitsSection
from drivers.base.errors import LimitExceeded
from drivers.kit.config import AxisConfig

OVERSPEED = 1.05
AIR_MARGIN_K = 10.0
RAMP_MARGIN = 1.2
RAMP_WINDOW_S = 60.0
ANGLE_MARGIN_DEG = 0.5

Interval = tuple[float, float]


@dataclass(frozen=True)
class Reach:
    """What may be: intervals of rate (its magnitude, deg/s), angle (deg), air and set point (degC), door open."""

    rate_dps: Interval
    angle_deg: Interval
    air_temp_c: Interval
    set_point_c: Interval
    aux_temp_c: tuple[Interval, ...]
    door_open: bool


def between(*values: float | None) -> Interval:
    """Return the interval that holds all values that are given."""
    known = [value for value in values if value is not None]
    return min(known), max(known)


def breaks(rule: ForbiddenState, reach: Reach) -> bool:
    """Return whether everything the rule names can be true at once."""
    return (
        (rule.door is None or reach.door_open is (rule.door == "open"))
        and _may_be(rule.rate_dps, [reach.rate_dps])
        and _may_be(rule.angle_deg, [reach.angle_deg])
        and _may_be(rule.air_temp_c, [reach.air_temp_c])
        and _may_be(rule.set_point_c, [reach.set_point_c])
        and _may_be(rule.aux_temp_c, reach.aux_temp_c)
    )


def check_rules(limits: LimitsSection, reach: Reach, found: str, remedy: str) -> None:
    """Raise LimitExceeded with the name of the first rule that `reach` breaks."""
    for rule in limits.forbid:
        if breaks(rule, reach):
            raise LimitExceeded(
                f"forbidden on this bench: {rule.name}",
                where="limits.forbid",
                found=found,
                expected=f"never together: {rule.text}",
                remedy=remedy,
            )


def check_telemetry(limits: LimitsSection, rate_dps: float, air_temp_c: float) -> None:
    """Raise LimitExceeded if a rate or the air is outside what the bench allows, with a margin."""
    if abs(rate_dps) > limits.max_rate_dps * OVERSPEED:
        raise LimitExceeded(
            "the table turns faster than the bench allows",
            where="table",
            found=f"{rate_dps:.3f} deg/s",
            expected=f"at most {limits.max_rate_dps:g} deg/s (limits.max_rate_dps)",
            remedy="the bench is being made safe; check the table's controller before starting again",
        )
    if not limits.min_temp_c - AIR_MARGIN_K <= air_temp_c <= limits.max_temp_c + AIR_MARGIN_K:
        raise LimitExceeded(
            "the chamber's air is outside the allowed range",
            where="chamber",
            found=f"{air_temp_c:.1f} degC",
            expected=f"{limits.min_temp_c:g} .. {limits.max_temp_c:g} degC within {AIR_MARGIN_K:g} K",
            remedy="the bench is being made safe; check the chamber before starting again",
        )


def check_ramp(limits: LimitsSection, change_k: float, window_s: float) -> None:
    """Raise LimitExceeded if the air changed by `change_k` in `window_s`, faster than allowed by a fifth."""
    ramp = abs(change_k) / window_s * 60.0
    if ramp > limits.max_ramp_k_per_min * RAMP_MARGIN:
        raise LimitExceeded(
            "the chamber's air changes faster than the bench allows",
            where="chamber",
            found=f"{ramp:.1f} K/min over {window_s:.0f} s",
            expected=f"at most {limits.max_ramp_k_per_min:g} K/min (limits.max_ramp_k_per_min)",
            remedy="the bench is being made safe; give set points a ramp, or raise the limit",
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


def _may_be(band: Band | None, intervals: Iterable[Interval]) -> bool:
    """Return whether any value of any interval is in the band; without a band anything is."""
    if band is None:
        return True
    return any(
        (band.above is None or high > band.above) and (band.below is None or low < band.below)
        for low, high in intervals
    )
