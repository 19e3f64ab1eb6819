"""Holds the limits of the bench file against what is about to be demanded, and against every poll."""

from __future__ import annotations

from bench.control.chamber_station import ChamberStation
from bench.control.limits import (
    RAMP_WINDOW_S,
    Interval,
    Reach,
    between,
    check_ramp,
    check_rules,
    check_telemetry,
)
from bench.control.table_station import TableStation
from bench.record.benchfile import LimitsSection
from drivers.base.clock import Clock


class LimitWatch:
    """The limits of one bench, with the stations whose telemetry and demands they speak of."""

    def __init__(
        self, limits: LimitsSection, clock: Clock, table: TableStation, chamber: ChamberStation
    ) -> None:
        self._limits, self._clock = limits, clock
        self._table, self._chamber = table, chamber
        self._with_door = any(rule.door for rule in limits.forbid)

    def allow(
        self,
        what: str,
        *,
        rate_dps: float | None = None,
        angle_deg: float | None = None,
        set_point_c: float | None = None,
    ) -> None:
        """Raise LimitExceeded if a demand, on top of the state and the demands in force, may break a rule.

        Of a quantity that is demanded its new value counts, and for the air the way to it.
        """
        if not self._limits.forbid:
            return
        fastest_dps = max(map(abs, self._table.rates_dps)) if rate_dps is None else abs(rate_dps)
        target_c = self._chamber.set_point_c if set_point_c is None else set_point_c
        reach = self._reach(fastest_dps, between(self._table.angle_deg(), angle_deg), target_c)
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
        reach = self._reach(abs(rate_dps), between(angle_deg), None)
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
            aux_temp_c=tuple(between(value, target_c) for value in self._chamber.auxiliary_c),
            door_open=self._with_door and self._chamber.look_at_door(),
        )
