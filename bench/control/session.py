"""A bench in use: devices opened, telemetry flowing, every step in the record, and a safe state at the end."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Literal

from bench.control.chamber_station import ChamberStation
from bench.control.displays import Display, Displays
from bench.control.instrument_station import Instruments
from bench.control.limits import LimitWatch
from bench.control.live import Live
from bench.control.progress import Progress, air_rate_k_per_min, gyro_progress
from bench.control.questions import Operator, Question, Reply, agreed
from bench.control.run_record import RunRecord
from bench.control.safe_state import Reading, bring_to_rest
from bench.control.station import Station
from bench.control.stream_stations import GyroStation, PlatformStation, StreamStation
from bench.control.stream_watchdog import Reconnect, StreamWatchdog
from bench.control.table_station import TableStation
from bench.control.time_watch import TimeWatch
from bench.record.benchfile import BenchFile, require_quantities
from bench.record.events import Event
from bench.record.events.run import (
    Alarm,
    Basis,
    Invalid,
    Measured,
    Note,
    Paused,
    PhaseBegun,
    Prompt,
    Requested,
    Resumed,
    Step,
    UnitsOff,
    UnitsOn,
)
from bench.record.events.safe import Cause, NotSafe, SafeState
from drivers.base.clock import Clock, host_seconds
from drivers.base.errors import BenchError, ConfigurationError, RunAborted
from drivers.kit.instruments import Chamber, Gyro, Instrument, Turntable

_POLL_S = 1.0
_RESOLUTION_S = 1e-9
"""The clock counts whole nanoseconds: anything closer than this counts as reached."""
_ALARMS_S = 60.0
_DISPLAY_S = 0.1
_KEPT_LINES = 20


class Bench:
    """What a procedure drives. All waiting goes through `wait` and `wait_until`, where telemetry is polled,
    limits are watched and the record is flushed."""

    def __init__(
        self,
        file: BenchFile,
        clock: Clock,
        record: RunRecord,
        operator: Operator,
        displays: Sequence[Display] = (),
        steering: Live | None = None,
        tests: Literal["gyro", "platform"] = "gyro",
    ) -> None:
        self.file = file
        self.clock = clock
        self.operator = operator
        self.invalid_reasons: list[Invalid] = []
        self.safe: tuple[SafeState, ...] = ()
        """What became of table and chamber when they were last made safe."""
        self.measurements: list[Measured] = []
        self.gyros: dict[str, GyroStation] = {}
        self.platforms: dict[str, PlatformStation] = {}
        self.table: TableStation
        self.chamber: ChamberStation
        self.instruments = Instruments()
        self.limits: LimitWatch
        self.phase_name = ""
        self._stream_watchdog = StreamWatchdog(tests, self.event, self._invalid, file.safe.last_unit_s)
        self._reconnect = Reconnect(
            clock, self._lose, lambda unit: self._stream_watchdog.back(unit, clock.now()), self.note
        )
        self._record, self._displays, self._steering = record, Displays(displays, self.note), steering
        self._standing_s = 0.0
        self._standing_from_s: float | None = None
        self._paused, self._resumed_by = False, ""
        self._alarms: deque[Mapping[str, Any]] = deque(maxlen=_KEPT_LINES)
        self._log: deque[Mapping[str, Any]] = deque(maxlen=_KEPT_LINES)
        self._step = self._doing = ""
        self._next_poll_s, self._next_alarms_s = clock.now(), clock.now() + _ALARMS_S
        self._poll_s, self._shown_at = _POLL_S, 0.0
        self._time_watch = TimeWatch(clock, self.alert)

    def install(self, table: Turntable, chamber: Chamber, auxiliary: tuple[int, ...]) -> None:
        """Put the polled instruments in place."""
        self.table = TableStation(table, self, self.file.table.all_axes)
        self.chamber = ChamberStation(chamber, self, auxiliary)
        self.limits = LimitWatch(self.file.limits, self.clock, self.table, self.chamber, self.instruments)
        for station in (self.table, self.chamber):
            station.device.link.on_retry = station.repeats

    # What a procedure says

    @contextmanager
    def step(self, code: str, title: str) -> Iterator[None]:
        """Name what follows after the test plan's own step; a pause that was asked for comes before it."""
        self._pause(title)
        self._step = f"{code} {title}"
        self.event(Step(code, title))
        yield

    def phase(self, name: str) -> None:
        """Begin a phase; it lasts until the next one."""
        self.phase_name = name
        self.event(PhaseBegun(name))

    def note(self, text: str) -> None:
        """Write a remark to the record."""
        self.event(Note(text))

    def measure(
        self, name: str, value: float, unit: str, *, low: float | None = None,
        high: float | None = None, gyro: str | None = None, basis: Basis | None = None,
    ) -> bool:  # fmt: skip
        """Record a value against optional limits, `gyro`'s or (None) every unit's; return whether it is inside.
        Without limits `passed` of the record is None, never a pass. `basis`: what its uncertainty follows from.
        ConfigurationError for a gyro not there, or for an input of the basis that no bench has."""
        if gyro is not None and gyro not in self.gyros:
            raise ConfigurationError("no gyro to measure that of", where=name, found=repr(gyro))
        require_quantities(basis.inputs if basis else (), name)
        self.measurements.append(measured := Measured.against(name, value, unit, low, high, gyro, basis))
        self.event(measured)
        return measured.passed is not False

    def invalidate(self, text: str, code: str = "procedure", **facts: Any) -> None:
        """Mark the run invalid for its purpose; it goes on and its data are kept.

        `text` says why to people; `code` and `facts`, numbers with units in their names, to programs.
        """
        self._invalid(Invalid(code, text, facts))

    def _invalid(self, reason: Invalid) -> None:
        self.invalid_reasons.append(reason)
        self.event(reason)

    def alert(self, event: Alarm | Invalid) -> None:
        """Write down what concerns the bench itself, and show it before the next poll."""
        if isinstance(event, Invalid):
            self._invalid(event)
        else:
            self.event(event)
        with suppress(BenchError, OSError):
            self._show(self._doing)

    def ask(self, question: str, *, picture: Path | None = None, **act: Any) -> str:
        """Put a question to the operator, with a PNG or JPEG, and wait, telemetry running, for a yes."""
        self.table.mountings.require_known(act)  # before anybody is asked
        asked = Question(question, act, self._record.keep_picture(picture, self.note))
        reply = agreed(asked, self._reply, self.note)
        self.table.mountings.tell(act)
        return reply.answer

    def _reply(self, asked: Question) -> Reply:
        self.event(Prompt(asked.text, asked.picture))
        answered = self.operator.ask(asked)
        with self._standing():
            while (reply := answered()) is None:
                self._stream_watchdog.excuse_until(self.clock.now() + 1.0)
                self.wait(0.2, f"operator: {asked.text}")
        self.event(asked.answered(reply))
        return reply

    @contextmanager
    def _standing(self) -> Iterator[None]:
        """Count the bench time meanwhile as waiting for a human."""
        self._standing_from_s = self.clock.now()
        try:
            yield
        finally:
            self._standing_s += self.clock.now() - self._standing_from_s
            self._standing_from_s = None

    @contextmanager
    def polling(self, every_s: float) -> Iterator[None]:
        """Take telemetry every `every_s` (default 1 s) meanwhile: for stays of days, where nothing moves."""
        self._poll_s = every_s
        try:
            yield
        finally:
            self._poll_s = _POLL_S
            self._next_poll_s = min(self._next_poll_s, self.clock.now() + _POLL_S)

    def wait(self, duration_s: float, doing: str = "") -> None:
        """Let bench time pass with telemetry running."""
        end = self.clock.now() + duration_s
        while end - self.clock.now() > _RESOLUTION_S:
            self._tick(end, doing)

    def wait_until(
        self, condition: Callable[[], bool], *, timeout_s: float, what: str, every_s: float = _POLL_S
    ) -> bool:
        """Wait until `condition` holds after a poll (True) or `timeout_s` passed (False)."""
        end, check_at = self.clock.now() + timeout_s, self.clock.now()
        while end - self.clock.now() > _RESOLUTION_S:
            self._tick(end, what)
            if self.clock.now() >= check_at:
                check_at += every_s
                if condition():
                    return True
        return False

    @property
    def now_s(self) -> float:
        """Bench time in s."""
        return self.clock.now()

    # What happens meanwhile

    def event(self, event: Event) -> None:
        """Write one line to the event log, at bench time now."""
        time_s = self.clock.now()
        self._record.event(time_s, event)
        row = event.row(round(time_s, 3))
        self._log.append(row)
        if event.alarms:
            self._alarms.append(row)

    def poll(self) -> None:
        """Ask both instruments, then collect: their answers travel at the same time."""
        self._time_watch.look(self._poll_s)
        table, chamber = self.table, self.chamber
        table.device.request_state()
        chamber.device.request_state()
        self.instruments.request()
        chamber.take(chamber.read_state())
        turned = table.device.read_state()  # the quicker device: its answer has come meanwhile
        table.take(self.clock.now(), turned)
        self.instruments.collect()
        self.limits.look()
        table.watch()
        chamber.watch()
        self._reconnect.look()
        self._stream_watchdog.check(self.units, self.clock.now())

    @property
    def units(self) -> list[StreamStation]:
        """What streams: gyros and platforms."""
        return [*self.gyros.values(), *self.platforms.values()]

    def listen(self, device: Gyro, station: StreamStation) -> None:
        """Take the stream of a unit from here on; when its port goes away it is looked for with every poll."""
        station.listen(self.clock.now())
        self._reconnect.watch(device, station)

    def _lose(self, unit: StreamStation, error: BenchError) -> None:
        self._stream_watchdog.lose(unit, self.clock.now(), error)
        self._stream_watchdog.require_one(self.units, self.clock.now())

    @property
    def judge(self) -> GyroStation:
        """The gyro that equilibrium and east are judged by: the first of the bench that still speaks.

        When it is lost the next one takes its place, and the record says so: ask anew after every wait.
        """
        return self._stream_watchdog.judge(self.gyros.values())

    @contextmanager
    def units_off(self) -> Iterator[None]:
        """Take what the units do not send meanwhile for intended: they are switched off and on again.

        Neither their silence nor the gap in their streams counts against them; two events tell the decoder."""
        for unit in self.units:
            unit.power_off()
        self.event(UnitsOff())
        self._stream_watchdog.units_off = True
        try:
            yield
        finally:
            self._stream_watchdog.units_off = False
            self._stream_watchdog.excuse_until(self.clock.now())
            for unit in self.units:
                unit.power_on()
            self.event(UnitsOn())

    def check_alarms(self) -> None:
        """Ask the instruments for alarms; any goes to the record and raises RunAborted."""
        own = {"table": self.table.device.alarms(), "chamber": self.chamber.alarms()}
        for name, found in (own | self.instruments.alarms()).items():
            for text in found:
                self.event(Alarm(name, text, "device"))
            if found:
                raise RunAborted(
                    f"the {name} reports a fault",
                    where=name,
                    found="; ".join(found),
                    expected="no alarm",
                    remedy="the bench is being made safe; clear the cause before starting again",
                )

    def _tick(self, end_s: float, doing: str) -> None:
        self.clock.idle(min(end_s, self._next_poll_s) - self.clock.now())
        if self._next_poll_s - self.clock.now() <= _RESOLUTION_S:
            self.poll()
            self._next_poll_s = max(self._next_poll_s + self._poll_s, self.clock.now())
            if self.clock.now() >= self._next_alarms_s:
                self._next_alarms_s = self.clock.now() + _ALARMS_S
                self.check_alarms()
            for hole in self._record.check():
                self.alert(hole)
            self._note_requests()
        if host_seconds() - self._shown_at >= _DISPLAY_S:
            self._shown_at, self._doing = host_seconds(), doing
            self._show(doing)

    def _show(self, doing: str) -> None:
        if self._displays:
            self._displays.show(self.progress(doing))

    def progress(self, doing: str) -> Progress:
        """Return what a display shows now."""
        now = self.clock.now()
        air, turned = self.chamber.history.last, self.table.history.last
        nan = float("nan")
        return Progress(
            time_s=now,
            step=self._step,
            doing=doing,
            phase=self.phase_name,
            air_temp_c=air.get("air_temp_c", nan),
            set_point_c=air.get("set_point_c", nan),
            air_rate_k_per_min=air_rate_k_per_min(self.chamber.history, now),
            auxiliary_c={str(n): air.get(f"aux_{n}_temp_c", nan) for n in self.chamber.auxiliary},
            angle_deg=turned.get("angle_deg", nan),
            rate_dps=turned.get("rate_dps", nan),
            demands={
                name: demand.fields() if demand else None for name, demand in self.table.demands.items()
            },
            gyros={name: gyro_progress(station, now) for name, station in self.gyros.items()},
            air_age_s=now - air.get("time_s", nan),
            table_age_s=now - turned.get("time_s", nan),
            poll_s=self._poll_s,
            standing_s=self._standing_s
            + (0.0 if (since_s := self._standing_from_s) is None else now - since_s),
            readings={name: station.readings for name, station in self.instruments.items()},
            paused=self._paused,
            alarms=tuple(self._alarms),
            log=tuple(self._log),
        )

    def _pause(self, before: str) -> None:
        """Stand still, telemetry running, as long as somebody wants a pause."""
        if (steering := self._steering) is None or not (by := steering.pause_wanted):
            return
        self._note_requests()
        self.event(Paused(by))
        self._paused = True
        with self._standing():
            while steering.pause_wanted:
                steering.wait()
                self.wait(0.2, f"paused by {by} before: {before}")
        self._paused = False
        self._note_requests()
        self.event(Resumed(self._resumed_by))

    def _note_requests(self) -> None:
        """Write to the record what has been asked of the session."""
        for request in self._steering.take() if self._steering is not None else ():
            self.event(request)
            if isinstance(request, Requested):
                self._resumed_by = request.by

    # How it ends

    def make_safe(self, why: str, cause: Cause = "trouble") -> bool:
        """Stop the table, bring chamber and supplies to their safe states; return whether all read back so.

        `why` is told to people.
        """
        devices: dict[str, Instrument] = {"table": self.table.device, "chamber": self.chamber.device}
        devices |= {name: station.device for name, station in self.instruments.items() if station.made_safe}
        stations: dict[str, Station] = {"table": self.table, "chamber": self.chamber} | self.instruments
        self.safe = tuple(Reading(code="cut_off").fact(name, cause, why) for name in devices)
        reported: set[str] = set()

        def away(name: str, code: NotSafe) -> None:
            with suppress(BenchError, OSError):  # whatever is wrong with record or display, the way goes on
                state = SafeState(
                    name, "pending", cause, why, code=code, last_seen=stations[name].last_seen()
                )
                if name not in reported:
                    reported.add(name)
                    self.event(state)
                self._show(f"making the bench safe, {state}")

        with self.clock.interrupt.ignored():
            found = bring_to_rest(devices, self.clock, away=away)
            self.safe = tuple(
                reading.fact(name, cause, why, stations[name].last_seen()) for name, reading in found.items()
            )
        self._note_requests()
        for state in self.safe:
            self.event(state)
        return all(state.confirmed for state in self.safe)
