"""The thermal chamber as a procedure works at it: limits, demands that return at once, a watch over its air."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

from bench.control.history import History
from bench.control.station import Session, Station
from bench.record.events.run import AirDemand, Alarm, ConditioningDemand
from bench.record.events.safe import LastSeen
from drivers.base.errors import LimitExceeded
from drivers.kit.instruments import Chamber, ChamberState, require_ramp

_JUMP_C, _FASTEST_C_PER_S = 5.0, 1.0
"""Air, and what is in it, never moves by more than so much and so much a second: fast chambers reach 30 K/min."""
WINDOW_S = 900.0
FAR_K = 2.0
_SLOWEST_K_PER_MIN = 1.0
"""What any chamber manages of a step or a fast ramp."""
_SHARE = 0.1


@dataclass(frozen=True)
class Stall:
    """Air that stands away from its set point and came nearer by `nearer_k` only in `window_s`."""

    air_temp_c: float
    set_point_c: float
    nearer_k: float
    window_s: float

    def __str__(self) -> str:
        off_k = abs(self.air_temp_c - self.set_point_c)
        return (
            f"the air stands at {self.air_temp_c:.1f} degC, {off_k:.1f} K from its set point "
            f"{self.set_point_c:g} degC, and came {self.nearer_k:.1f} K nearer in "
            f"{self.window_s / 60.0:.0f} min: look at the chamber's panel, door and refrigeration"
        )


class StallDetector:
    """Watches one demand after the other; says once a demand that the air stands away from it.

    It stands when it is more than `FAR_K` off and came nearer in `WINDOW_S` by less than a tenth of what the ramp
    makes of that time, or of 1 K/min where the ramp is faster or there is none.
    """

    def __init__(self) -> None:
        self._since_s = math.inf
        self._set_point_c, self._ramp_k_per_min = math.nan, math.inf
        self._running = False

    def demand(self, time_s: float, set_point_c: float, ramp_k_per_min: float | None) -> None:
        """Take a new set point."""
        self._set_point_c = set_point_c
        self._ramp_k_per_min = ramp_k_per_min or math.inf
        self._since_s = time_s

    def run(self, time_s: float, running: bool) -> None:
        """Take that conditioning was started or stopped."""
        self._running, self._since_s = running, time_s

    def due(self, time_s: float) -> bool:
        """Return whether there is anything to judge yet."""
        return self._running and time_s - self._since_s >= WINDOW_S and math.isfinite(self._set_point_c)

    def look(self, air_c: float, before_c: float) -> Stall | None:
        """Judge the air now and `WINDOW_S` before; None if it comes nearer or is there."""
        off_k = abs(air_c - self._set_point_c)
        nearer_k = abs(before_c - self._set_point_c) - off_k
        wanted_k = min(self._ramp_k_per_min, _SLOWEST_K_PER_MIN) * WINDOW_S / 60.0
        if off_k <= FAR_K or nearer_k >= _SHARE * wanted_k:
            return None
        self._since_s = math.inf
        return Stall(air_c, self._set_point_c, max(nearer_k, 0.0), WINDOW_S)


@dataclass(frozen=True)
class SoftwareRamp:
    """A ramp of a chamber that cannot be told one: its set point is moved with every poll."""

    from_c: float
    to_c: float
    k_per_min: float
    since_s: float

    def set_point_c(self, time_s: float) -> float:
        """Return where the set point belongs at a bench time."""
        way_k = self.k_per_min * max(0.0, time_s - self.since_s) / 60.0
        return self.from_c + math.copysign(min(way_k, abs(self.to_c - self.from_c)), self.to_c - self.from_c)


class ChamberStation(Station):
    """The thermal chamber. Demands return at once; procedures wait on telemetry.

    A chamber that cannot be told a ramp has its set point moved in steps of its own resolution while it runs.
    """

    name = "chamber"

    def __init__(self, device: Chamber, session: Session, auxiliary: tuple[int, ...]) -> None:
        columns = ("air_temp_c", "set_point_c", *(f"aux_{n}_temp_c" for n in auxiliary))
        super().__init__(session, History(columns))
        self.device = device
        self.auxiliary = auxiliary
        self.set_point_c: float | None = None
        self._stall = StallDetector()
        self._running = False
        self._ramp: SoftwareRamp | None = None
        self._told_c = math.nan

    def check(self, min_temp_c: float, max_temp_c: float, max_ramp_k_per_min: float = 0.0) -> None:
        """Raise LimitExceeded if the demands are beyond the bench file's or the chamber's own limits."""
        limits, own, can = self._session.file.limits, self.device.limits(), self.device.capabilities()
        low, high = max(limits.min_temp_c, own.min_temp_c), min(limits.max_temp_c, own.max_temp_c)
        if min_temp_c < low or max_temp_c > high:
            raise LimitExceeded(
                "a chamber set point outside the allowed range",
                where="chamber",
                found=f"{min_temp_c:g} .. {max_temp_c:g} degC",
                expected=f"{low:g} .. {high:g} degC (bench file and chamber limits)",
                remedy="change the temperature parameters, or the limits if chamber and unit really allow it",
            )
        if max_ramp_k_per_min and can.ramp_k_per_min is not None:
            require_ramp(can, max_temp_c, max_ramp_k_per_min, "chamber")
        if max_ramp_k_per_min > limits.max_ramp_k_per_min:
            raise LimitExceeded(
                "a chamber ramp faster than allowed",
                where="chamber",
                found=f"{max_ramp_k_per_min:g} K/min",
                expected=f"at most {limits.max_ramp_k_per_min:g} K/min (bench file)",
                remedy="lower the ramp parameter, or raise limits.max_ramp_k_per_min if the unit allows it",
            )

    def take(self, air: ChamberState) -> None:
        """Keep telemetry that has come just now."""
        auxiliary = (air.auxiliary_c[number] for number in self.auxiliary)
        self.history.append(self._session.now_s, air.air_temp_c, air.set_point_c, *auxiliary)

    def read_state(self) -> ChamberState:
        """Read telemetry; once more if air or a sensor seems to have moved as none does: a digit was damaged.

        Few chamber protocols have a check value. The second answer is believed, whatever it says.
        """
        state, last = self.device.read_state(), self.history.last
        if not last:
            return state
        elapsed_s = self._session.now_s - last["time_s"]
        read = {"air": (last["air_temp_c"], state.air_temp_c)}
        read |= {f"sensor {n}": (last[f"aux_{n}_temp_c"], state.auxiliary_c[n]) for n in self.auxiliary}
        jumps = [
            f"{name} {now_c:g} degC {elapsed_s:.1f} s after {before_c:g} degC"
            for name, (before_c, now_c) in read.items()
            if abs(now_c - before_c) > _JUMP_C + _FASTEST_C_PER_S * elapsed_s
        ]
        if not jumps:
            return state
        self.repeats(f"{', '.join(jumps)}, which none does")
        self.device.request_state()
        return self.device.read_state()

    def watch(self) -> None:
        """Move the set point on a ramp; write an alarm, once a demand, when the air gets no nearer to it."""
        self.check_step(self.device)
        now_s = self._session.now_s
        self._follow(now_s)
        if not self._stall.due(now_s) or not (before := self.history.row_at(now_s - WINDOW_S)):
            return
        if stall := self._stall.look(self.history.last["air_temp_c"], before["air_temp_c"]):
            self._session.event(Alarm(self.name, str(stall), "air_stalled", asdict(stall)))

    def _seen(self, row: dict[str, float], ago_s: float) -> LastSeen:
        return LastSeen(ago_s, air_temp_c=row["air_temp_c"], set_point_c=row["set_point_c"])

    @property
    def auxiliary_c(self) -> list[float]:
        """What the auxiliary sensors said last, degC."""
        return [self.history.last[f"aux_{number}_temp_c"] for number in self.auxiliary]

    def alarms(self) -> list[str]:
        """Return the chamber's alarms and warnings but for the one that says that its door is open."""
        return [text for text in self.device.alarms() if not self._tells_door(text)]

    def look_at_door(self) -> bool:
        """Ask whether the door is open, as `chamber.door_message` of the bench file tells it."""
        return any(self._tells_door(text) for text in self.device.alarms())

    def _tells_door(self, text: str) -> bool:
        words = self._session.file.chamber.door_message
        return words is not None and words.casefold() in text.casefold()

    def check_sensors(self) -> None:
        """Raise LimitExceeded if the bench file names a sensor that the chamber does not have."""
        have = self.device.capabilities().auxiliary
        missing = [] if have is None else [number for number in self.auxiliary if number not in have]
        if missing:
            raise LimitExceeded(
                "the chamber has no such auxiliary sensor",
                where="chamber",
                found=", ".join(str(number) for number in missing),
                expected="one of " + ", ".join(str(number) for number in have or ()) if have else "none",
                remedy="correct auxiliary in the bench file, and case_sensor of the gyros with it",
            )

    def go_to(self, set_point_c: float, ramp_k_per_min: float | None = None) -> None:
        """Demand a set point, approached at `ramp_k_per_min` (None: as fast as the chamber can)."""
        self.check(set_point_c, set_point_c, ramp_k_per_min or 0.0)
        self._session.limits.allow(f"go to {set_point_c:g} degC", set_point_c=set_point_c)
        self._session.event(AirDemand(self.name, set_point_c, ramp_k_per_min))
        self.set_point_c = set_point_c
        self._stall.demand(self._session.now_s, set_point_c, ramp_k_per_min)
        self._ramp = None
        if ramp_k_per_min is None or self.device.capabilities().ramp_k_per_min is not None:
            self.device.set_temperature(set_point_c, ramp_k_per_min)
        else:
            self._begin(set_point_c, ramp_k_per_min)

    def _begin(self, to_c: float, k_per_min: float) -> None:
        """Begin a ramp where the air is."""
        self._ramp = SoftwareRamp(self.read_air_c(), to_c, k_per_min, self._session.now_s)
        self._told_c = math.nan
        self._follow(self._session.now_s)

    def _follow(self, now_s: float) -> None:
        ramp = self._ramp
        if ramp is None or not (self._running or math.isnan(self._told_c)):
            return
        wanted_c = ramp.set_point_c(now_s)
        step_c = self.device.capabilities().temp_resolution_c
        if wanted_c == ramp.to_c:
            self._ramp = None
        elif abs(wanted_c - self._told_c) < step_c:
            return
        self._told_c = wanted_c if self._ramp is None else round(wanted_c / step_c) * step_c
        self.device.set_temperature(self._told_c)

    def read_air_c(self) -> float:
        """Return the newest air temperature, read now if there is none yet."""
        if not self.history.last:
            self.device.request_state()
            return self.device.read_state().air_temp_c
        return self.history.last["air_temp_c"]

    def start(self) -> None:
        """Start conditioning."""
        self._session.event(ConditioningDemand(self.name, True))
        if self._ramp is not None:
            self._begin(self._ramp.to_c, self._ramp.k_per_min)
        self.device.start()
        self._running = True
        self._stall.run(self._session.now_s, True)

    def stop(self) -> None:
        """Stop conditioning."""
        self._session.event(ConditioningDemand(self.name, False))
        self._stall.run(self._session.now_s, False)
        self._running, self._ramp = False, None
        self.device.stop()
