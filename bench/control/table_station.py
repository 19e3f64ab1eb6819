"""The table as a procedure works at it: axes, limits, demands that return when telemetry shows them settled."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from bench.control.history import History
from bench.control.mounting import Mountings, Turning
from bench.control.station import Session, Station
from bench.control.ways import (
    STILL_DPS,
    Way,
    a_turn,
    check_stops,
    require_between_stops,
    require_no_stops,
    way_to,
)
from bench.record.events.run import AngleDemand, Demand, HomeDemand, RateDemand, Sense
from bench.record.events.safe import LastSeen
from drivers.base.errors import DeviceRefused, LimitExceeded, RunAborted
from drivers.kit.config import AxisConfig
from drivers.kit.instruments import TableState, Turntable, alarms_in_words

_SETTLED_POLLS = 3
_STAYS = 10.0
"""A settled table may be off by this many times what counted as settled before it has left its demand."""


@dataclass
class _Arrival:
    """A motion that nobody waits for: it has until `until_s` to settle."""

    settled: Callable[[], bool]
    stays: Callable[[dict[str, float]], bool]
    until_s: float
    timeout_s: float
    what: str


class TableStation(Station):
    """The rate table. Verbs return when telemetry shows that the motion has settled; with `settle` False at once,
    and the polls see to it that it settles.

    A verb's `axis` is a name of the bench file's `[[table.axes]]`; "" is the axis that carries the unit, whose
    telemetry is `angle_deg` and `rate_dps` in the history. The others' is `<name>_angle_deg`, `<name>_rate_dps`.
    """

    name = "table"

    def __init__(self, device: Turntable, session: Session, axes: Sequence[AxisConfig]) -> None:
        self.device = device
        self.axes = {axis.name: axis for axis in axes}
        self.mountings = Mountings(axes, session.file.gyro)
        self._carrier = axes[-1].name
        outer = [self._columns(axis.name) for axis in axes[:-1]]
        super().__init__(
            session, History(("angle_deg", "rate_dps", *(name for pair in outer for name in pair)))
        )
        self.demands: dict[str, Demand | None] = dict.fromkeys(self.axes)
        """What was asked of each axis last; None: nothing yet, it is at rest."""
        self._turn_dps = dict.fromkeys(self.axes, math.inf)
        self._stays: dict[str, Callable[[dict[str, float]], bool]] = {}
        self._arriving: dict[str, _Arrival] = {}

    @property
    def rates_dps(self) -> tuple[float, ...]:
        """The newest rate of every axis."""
        return tuple(self.history.last[self._columns(name)[1]] for name in self.axes)

    def _seen(self, row: dict[str, float], ago_s: float) -> LastSeen:
        return LastSeen(ago_s, {name: row[self._columns(name)[1]] for name in self.axes})

    def take(self, time_s: float, state: TableState) -> None:
        """Keep telemetry."""
        outer = [state.outer[name] for name in self.axes if name != self._carrier]
        self.history.append(
            time_s,
            state.angle_deg,
            state.rate_dps,
            *(value for axis in outer for value in (axis.angle_deg, axis.rate_dps)),
        )

    def angle_deg(self, axis: str = "") -> float:
        """Return the newest angle of an axis."""
        return self.history.last[self._columns(axis or self._carrier)[0]]

    def fastest_dps(self, besides: str = "") -> float:
        """Return the fastest that any axis turns, or will by what is demanded of it, without sign.

        `besides`: an axis that does not count.
        """
        pairs = zip(self.axes, self.rates_dps, strict=True)
        rates = [max(abs(rate), self._demanded_dps(name)) for name, rate in pairs if name != besides]
        return max(rates, default=0.0)

    def way_deg(self) -> Way:
        """Return the way of the axis that carries the unit by the demand in force, deg, turns counted."""
        name = self._carrier
        demand, now = self.demands[name], self._now(name)
        moves = self._demanded_dps(name) > 0.0
        if moves and isinstance(demand, AngleDemand) and demand.sense == "shortest":
            return self._way_to(name, demand.angle_deg)
        return a_turn(now) if moves or now is None or abs(now[1]) > STILL_DPS else (now[0], now[0])

    def _demanded_dps(self, name: str) -> float:
        """Return how fast an axis turns by the demand in force; 0 where it has settled at an angle."""
        demand = self.demands[name]
        if isinstance(demand, RateDemand):
            return abs(demand.rate_dps)
        settled = demand is None or name in self._stays
        return 0.0 if settled else min(self._turn_dps[name], self._max_rate_dps(name))

    def _way_to(self, name: str, angle_deg: float, by_deg: float | None = None) -> Way:
        return way_to(self.axes[name], self._now(name), angle_deg, by_deg)

    def _now(self, name: str) -> tuple[float, float] | None:
        """Return the newest angle and rate of an axis, None before the first telemetry."""
        angle, rate = self._columns(name)
        last = self.history.last
        return (last[angle], last[rate]) if angle in last else None

    def check(self, max_rate_dps: float, axis: str = "") -> None:
        """Raise LimitExceeded if `max_rate_dps` is beyond the bench file's or the table's own limit."""
        allowed = self._max_rate_dps(axis or self._carrier)
        if max_rate_dps > allowed:
            raise LimitExceeded(
                f"a table rate of {max_rate_dps:g} deg/s is not allowed",
                where=self._where(axis or self._carrier),
                found=f"{max_rate_dps:g} deg/s",
                expected=f"at most {allowed:g} deg/s (bench file and table limits)",
                remedy="lower the rate parameter, or raise limits.max_rate_dps if the bench really allows it",
            )

    def confine(self, max_rate_dps: float | None = None) -> None:
        """Have the table itself keep turns to an angle within the bench file's limits and its own.

        `max_rate_dps`: turns slower than that, for a procedure that wants a rate of its own.
        """
        for name, axis in self.axes.items():
            rate_dps = self._max_rate_dps(name)
            if max_rate_dps is not None:
                self.check(max_rate_dps, name)
                rate_dps = max_rate_dps
            self._turn_dps[name] = rate_dps
            self.device.limit_turns(rate_dps, self._named(name), axis.max_acceleration_dps2)

    @property
    def mounting_text(self) -> str:
        """What an operator who mounts units must be told of the outer axes, empty on a table of one."""
        outer = list(self.axes)[:-1]
        return f"With {' and '.join(outer)} at 0 deg: " if outer else ""

    def engage(self) -> None:
        """Close the servo, and bring the axes outside of the one that carries the unit to 0 deg."""
        self.device.servo_on()
        for name in list(self.axes)[:-1]:
            self.point(0.0, name)

    def home(self, *, timeout_s: float = 300.0) -> None:
        """Bring every axis to its reference position, outermost first, each settled before the next."""
        for name in self.axes:
            way_deg = self._way_to(name, 0.0)
            self._allow(name, "go home", self._turn_dps[name], way_deg)
            self._begin(name, HomeDemand(self.name, name))
            self.device.home(self._named(name))
            self._settle_angle(name, 0.0, 0.002, timeout_s + self._lasts_s(name, way_deg))

    def point(
        self,
        angle_deg: float,
        axis: str = "",
        *,
        sense: Sense = "shortest",
        tolerance_deg: float = 0.002,
        timeout_s: float = 300.0,
        settle: bool = True,
    ) -> None:
        """Turn to `angle_deg` and wait until three polls in a row are within `tolerance_deg`.

        `sense`: "shortest", or "positive" or "negative" for the way round; an axis that is there already then
        makes a whole turn. DeviceRefused if it does not settle there `timeout_s` after the time that the way
        takes at the rate of turns, LimitExceeded beyond its stops.
        """
        name = axis or self._carrier
        by_deg = None if sense == "shortest" else self._way_round(name, angle_deg, sense, tolerance_deg)
        way_deg = self._way_to(name, angle_deg, by_deg)
        require_between_stops(self.axes[name], angle_deg, way_deg, self._where(name))
        self._allow(name, f"point to {angle_deg:g} deg", self._turn_dps[name], way_deg)
        self._begin(name, AngleDemand(self.name, name, angle_deg, sense))
        if by_deg is None:
            self.device.point(angle_deg, self._named(name))
        else:
            self.device.turn(by_deg, self._named(name))
        timeout_s += self._lasts_s(name, way_deg)
        self._settle_angle(name, angle_deg, tolerance_deg, timeout_s, by_deg, wait=settle)

    def spin(
        self,
        rate_dps: float,
        axis: str = "",
        *,
        acceleration_dps2: float | None = None,
        tolerance_share: float = 1e-3,
        timeout_s: float = 300.0,
        across: bool = False,
        settle: bool = True,
    ) -> None:
        """Turn at `rate_dps` and wait until three polls in a row are near it.

        Near is within `tolerance_share` of the rate + 0.002 deg/s: more for a table whose rate ripples.
        `across`: the axes under test need not lie along the rotation, as for misalignment or the whirl of an
        IMU. Otherwise ConfigurationError if they do not, as far as their mounting was told. LimitExceeded for an
        axis with stops: it would turn into one.
        """
        name = axis or self._carrier
        self.check(abs(rate_dps), name)
        if rate_dps != 0.0:  # coming to rest is always allowed
            require_no_stops(self.axes[name], rate_dps, self._where(name))
            if not across:
                self.mountings.require_along(name, rate_dps, self.angle_deg)
            self._allow(name, f"spin at {rate_dps:g} deg/s", rate_dps, a_turn(self._now(name)))
        self._begin(name, RateDemand(self.name, name, rate_dps, acceleration_dps2))
        self.device.spin(rate_dps, self._named(name), acceleration_dps2)
        tolerance, column = tolerance_share * abs(rate_dps) + 0.002, self._columns(name)[1]
        what = f"reaching {rate_dps:g} deg/s"
        self._settle(name, lambda row: abs(row[column] - rate_dps), tolerance, what, timeout_s, wait=settle)
        if rate_dps != 0.0:
            self.mountings.turnings.append(Turning(name, rate_dps, across, self._session.now_s))

    def stop(self, axis: str = "") -> None:
        """Come to rest."""
        self.spin(0.0, axis)

    def watch(self) -> None:
        """Raise RunAborted if telemetry shows that the table has left what it had settled at, or its stops."""
        self.check_step(self.device)
        last = self.history.last
        for name, axis in self.axes.items():
            check_stops(axis, self.angle_deg(name), self._where(name))
        for name, arrival in list(self._arriving.items()):
            if arrival.settled():
                del self._arriving[name]
                self._stays[name] = arrival.stays
            elif self._session.now_s > arrival.until_s:
                raise self._unsettled(name, arrival.timeout_s, arrival.what)
        if any(not stays(last) for stays in self._stays.values()):
            self._look_again()
            last = self.history.last
        for name, stays in list(self._stays.items()):
            if stays(last):
                continue
            del self._stays[name]
            angle, rate = self._columns(name)
            raise RunAborted(
                "the table has left its demand",
                where=self._where(name),
                found=f"{last[angle]:.3f} deg, {last[rate]:.4f} deg/s; " + alarms_in_words(self.device),
                expected=str(self.demands[name]),
                remedy="check interlock, emergency stop and the controller's error queue",
            )

    def _look_again(self) -> None:
        """Read telemetry once more, at once: on a line without a check value one digit of it may be damaged."""
        last = self.history.last
        seen = ", ".join(f"{last[column]:g}" for name in self.axes for column in self._columns(name))
        named = len(self.axes) > 1
        demands = ", ".join(
            f"{name} {demand}" if named else str(demand) for name, demand in self.demands.items()
        )
        self.repeats(f"{seen} (deg, deg/s) though it had settled at {demands}")
        self.device.request_state()
        state = self.device.read_state()
        self.take(self._session.now_s, state)

    def _allow(self, name: str, what: str, rate_dps: float, way_deg: Way) -> None:
        """Ask the rules of the bench file; other axes go on as they do."""
        if not self._session.file.limits.forbid:
            return
        where = f"{self._where(name)}: {what}" if len(self.axes) > 1 else what
        fastest = max(abs(rate_dps), self.fastest_dps(besides=name))
        self._session.limits.allow(
            where, rate_dps=fastest, way_deg=way_deg if name == self._carrier else None
        )

    def _lasts_s(self, name: str, way_deg: Way) -> float:
        """Return how long a way takes at the rate of turns."""
        return (way_deg[1] - way_deg[0]) / min(self._turn_dps[name], self._max_rate_dps(name))

    def _columns(self, name: str) -> tuple[str, str]:
        prefix = "" if name == self._carrier else f"{name}_"
        return f"{prefix}angle_deg", f"{prefix}rate_dps"

    def _named(self, name: str) -> str:
        """Return the axis argument of a demand: nothing for the axis that carries the unit."""
        return "" if name == self._carrier else name

    def _where(self, name: str) -> str:
        return "table" if len(self.axes) == 1 else f"table, {name} axis"

    def _max_rate_dps(self, name: str) -> float:
        own = self.axes[name].max_rate_dps or math.inf
        device = self.device.limits(self._named(name)).max_rate_dps
        return min(self._session.file.limits.max_rate_dps, own, device)

    def _way_round(self, name: str, angle_deg: float, sense: Sense, tolerance_deg: float) -> float:
        self._session.poll()
        ahead = (angle_deg - self.angle_deg(name)) % 360.0
        if sense == "negative":
            ahead -= 360.0
        if abs(ahead) <= tolerance_deg:
            ahead += math.copysign(360.0, 1.0 if sense == "positive" else -1.0)
        return ahead

    def _begin(self, name: str, demand: Demand) -> None:
        self._session.event(demand)
        self.mountings.ends(name, self._session.now_s)
        self.demands[name] = demand
        self._stays.pop(name, None)
        self._arriving.pop(name, None)

    def _settle_angle(
        self,
        name: str,
        angle_deg: float,
        tolerance_deg: float,
        timeout_s: float,
        by_deg: float | None = None,
        *,
        wait: bool = True,
    ) -> None:
        """Wait for an angle and, with `by_deg`, for telemetry to have gone that way: polls are half a turn apart
        at most.
        """
        column = self._columns(name)[0]
        before, travel = self.history.last.get(column, 0.0), 0.0

        def error(row: dict[str, float]) -> float:
            return abs(math.remainder(row[column] - angle_deg, 360.0))

        def went_round(row: dict[str, float]) -> bool:
            nonlocal before, travel
            travel += math.remainder(row[column] - before, 360.0)
            before = row[column]
            return by_deg is None or abs(travel - by_deg) < 180.0

        what = f"pointing to {angle_deg:.3f} deg" + (f" by {by_deg:+.1f} deg" if by_deg is not None else "")
        self._settle(name, error, tolerance_deg, what, timeout_s, went_round, wait=wait)

    def _settle(
        self,
        name: str,
        error: Callable[[dict[str, float]], float],
        tolerance: float,
        what: str,
        timeout_s: float,
        went_round: Callable[[dict[str, float]], bool] = lambda row: True,
        *,
        wait: bool,
    ) -> None:
        in_a_row = 0

        def settled() -> bool:
            nonlocal in_a_row
            row = self.history.last
            in_a_row = in_a_row + 1 if went_round(row) and error(row) <= tolerance else 0
            return in_a_row >= _SETTLED_POLLS

        def stays(row: dict[str, float]) -> bool:
            return error(row) <= _STAYS * tolerance

        if not wait:
            self._arriving[name] = _Arrival(settled, stays, self._session.now_s + timeout_s, timeout_s, what)
            return
        if not self._session.wait_until(settled, timeout_s=timeout_s, what=what):
            raise self._unsettled(name, timeout_s, what)
        self._stays[name] = stays

    def _unsettled(self, name: str, timeout_s: float, what: str) -> DeviceRefused:
        return DeviceRefused(
            f"the table did not settle within {timeout_s:g} s while {what}",
            where=self._where(name),
            found=f"{self.history.last}, {alarms_in_words(self.device)}",
            expected=str(self.demands[name]),
            remedy="check interlock, load balance and the axis limits",
        )
