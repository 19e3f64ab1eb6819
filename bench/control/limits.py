"""Limits of the bench file on what is about to be demanded and on what telemetry says.

A rule of `[[limits.forbid]]` names a state that must not be: all its conditions together. Before a command it is
asked whether the state may come about: every quantity is then an interval, from what telemetry says to what has
been demanded (air that is on its way to -50 degC will pass -40; a table that spins passes every angle). On
telemetry the intervals are points, that of the angle is the way since the poll before.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from bench.control.chamber_station import ChamberStation
from bench.control.instrument_station import InstrumentStation
from bench.control.table_station import TableStation
from bench.record.benchfile import Band, ForbiddenState, LimitsSection
from drivers.base.clock import Clock
from drivers.base.errors import LimitExceeded

OVERSPEED = 1.05
AIR_MARGIN_K = 10.0
RAMP_MARGIN = 1.2
RAMP_WINDOW_S = 60.0

Interval = tuple[float, float]


@dataclass(frozen=True)
class Reach:
    """What may be: intervals of rate (its magnitude, deg/s), angle (deg), air and set point (degC), door open.

    That of the angle is the way of the table, turns counted: from 350 to 370 it passes 0.
    """

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
        and _may_pass(rule.angle_deg, reach.angle_deg)
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


def _may_be(band: Band | None, intervals: Iterable[Interval]) -> bool:
    """Return whether any value of any interval is in the band; without a band anything is."""
    if band is None:
        return True
    return any(
        (band.above is None or high > band.above) and (band.below is None or low < band.below)
        for low, high in intervals
    )


def _may_pass(band: Band | None, way_deg: Interval) -> bool:
    """Return whether a way on the circle, turns counted, leads through the band; without a band any does."""
    if band is None:
        return True
    low, high = way_deg
    begin_deg, width_deg = band.arc_deg
    ahead = (begin_deg - low) % 360.0
    return ahead < high - low or ahead + width_deg > 360.0


class LimitWatch:
    """The limits of one bench, with the stations whose telemetry and demands they speak of."""

    def __init__(
        self,
        limits: LimitsSection,
        clock: Clock,
        table: TableStation,
        chamber: ChamberStation,
        instruments: Mapping[str, InstrumentStation],
    ) -> None:
        self._limits, self._clock = limits, clock
        self._table, self._chamber, self._instruments = table, chamber, instruments
        self._with_door = any(rule.door for rule in limits.forbid)
        self._was_at_deg: float | None = None

    def allow(
        self,
        what: str,
        *,
        rate_dps: float | None = None,
        way_deg: Interval | None = None,
        set_point_c: float | None = None,
    ) -> None:
        """Raise LimitExceeded if a demand, on top of the state and the demands in force, may break a rule.

        Of a quantity that is demanded its new value counts, and the way to it: the table's from angle to angle,
        and the air's.
        """
        if not self._limits.forbid:
            return
        fastest_dps = self._table.fastest_dps() if rate_dps is None else abs(rate_dps)
        target_c = self._chamber.set_point_c if set_point_c is None else set_point_c
        reach = self._reach(fastest_dps, way_deg or self._table.way_deg(), target_c)
        remedy = "the command was not sent; change the order of steps or the rule"
        check_rules(self._limits, reach, what, remedy)

    def look(self) -> None:
        """Raise LimitExceeded if the newest telemetry is beyond a limit or in a forbidden state."""
        limits, air, angle_deg = self._limits, self._chamber.history.last, self._table.angle_deg()
        rate_dps = max(self._table.rates_dps, key=abs)
        check_telemetry(limits, rate_dps, air["air_temp_c"])
        before = self._chamber.history.row_at(self._clock.now() - RAMP_WINDOW_S)
        if before:
            check_ramp(limits, air["air_temp_c"] - before["air_temp_c"], air["time_s"] - before["time_s"])
        if not limits.forbid:
            return
        was_deg = angle_deg if self._was_at_deg is None else self._was_at_deg
        self._was_at_deg = angle_deg
        since_deg = math.remainder(angle_deg - was_deg, 360.0)
        reach = self._reach(abs(rate_dps), between(angle_deg - since_deg, angle_deg), None)
        found = (
            f"{rate_dps:.3f} deg/s at {angle_deg:.2f} deg, air {air['air_temp_c']:.1f} degC, "
            f"set point {air['set_point_c']:.1f} degC, door {'open' if reach.door_open else 'closed'}"
        )
        check_rules(
            limits, reach, found, "the bench is being made safe; clear the cause before starting again"
        )

    def _reach(self, rate_dps: float, angle_deg: Interval, target_c: float | None) -> Reach:
        """Return what may be on the way of air, set point and sensors to `target_c`, None where they are."""
        air = self._chamber.history.last
        return Reach(
            rate_dps=between(rate_dps),
            angle_deg=angle_deg,
            air_temp_c=between(air["air_temp_c"], target_c),
            set_point_c=between(air["set_point_c"], target_c),
            aux_temp_c=tuple(between(value, target_c) for value in self._auxiliary_c()),
            door_open=self._with_door and self._chamber.look_at_door(),
        )

    def _auxiliary_c(self) -> Iterator[float]:
        """Yield what the sensors of chamber and loggers said last, degC; an open one says nothing."""
        yield from self._chamber.auxiliary_c
        for station in self._instruments.values():
            for column, value in station.readings.items():
                if column.startswith("aux_") and not math.isnan(value):
                    yield value
