"""What the watchdog does: miss a beat, end the runner, bring the bench to rest, write it down.

Everything is imported and every setting checked before it says that it is ready: nothing can fail later but the
devices themselves.
"""

from __future__ import annotations

import json
import os
import select
import signal
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from io import FileIO
from pathlib import Path
from shlex import quote
from typing import Any, Literal

from bench.control.devices import made_safe, open_chamber, open_instrument, open_table
from bench.control.lease import Lease, device_at, take_lease
from bench.control.safe_state import Reading, bring_to_rest
from bench.control.watchdog import ARMED, DISMISSED, FOLDER, READY, sent_s
from bench.control.watchdog._other import SPARE_S, Other, set_aside, sign_of_life
from bench.control.watchdog._silence import HUNG_S, UNARMED_S, SilenceTimeout, runqueue_wait_s
from bench.record.benchfile import bench_file_from
from bench.record.events import Event
from bench.record.events.run import Alarm
from bench.record.events.safe import SafeState, Takeover, TakeoverEnded
from bench.record.recording import EventLog, Journal
from drivers.base.clock import Clock, WallClock, host_seconds, utc_now
from drivers.base.errors import BenchError, BenchInUse, RecordError
from drivers.base.locks import INHERITED
from drivers.base.pipes import pumped_in, pumped_out
from drivers.base.system import SELECTS_FILES
from drivers.kit.instruments import Instrument
from drivers.kit.link import Tap

_PORTS_TIMEOUT_S = 60.0
"""How long a port that cannot be opened is tried again: a gone adapter may come back."""

_OVERSLEPT_S = 1.0
"""A watchdog that wakes so much later was stopped, its runner perhaps too: that is given its time anew, once. It
tells of the gap itself (`bench.control.time_watch`)."""

_FIRST_BEAT_S = 0.8
"""So long one that has come up waits for a beat, whatever lay in the pipe: it may have been stopped on its way,
and its runner with it. Beats come twice a second at least."""

_LEASE_S = 1.0
"""How long the lease is tried that the runner's end has freed, where no process inherits it: a table may turn."""

_FIRST_TRY_S = 1.0
_AGAIN_S = 0.02
_SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")


_Opener = Callable[[Clock, Tap | None], Instrument]


class _Replaced(BenchError):
    """Another device has the name of one that is no more."""


@dataclass(frozen=True)
class Order:
    """What the runner wants guarded; `armed`: from the beginning, beside or in place of another watchdog.

    `take_lease`: takes the lease once the runner has ended; None where this process has inherited it.
    `first`: the watchdog to which this one leaves the bench as long as that one does something.
    """

    run_folder: Path
    runner: int
    lease: tuple[int, ...]
    openers: dict[str, _Opener]
    armed: bool = False
    take_lease: Callable[[], Lease] | None = None
    first: int | None = None


def main() -> int:
    """Guard one runner; 0 when it was not needed or the bench is at rest, 1 when that could not be confirmed."""
    for number in (getattr(signal, name) for name in _SIGNALS if hasattr(signal, name)):
        signal.signal(number, signal.SIG_IGN)  # whoever stops the runner must not stop what guards it
    order = _read_order()
    runner, first = Other.of(order.runner), None if order.first is None else Other.of(order.first)
    hung_s = HUNG_S if first is None else HUNG_S + SPARE_S
    source, read, write = _runner_pipes()
    with suppress(ConnectionError):  # dismissed as it came up, or the runner has ended: both are read below
        write(READY + b"\n")
    armed, unread = order.armed, b""
    up_s = host_seconds()
    timeout = SilenceTimeout(up_s, runqueue_wait_s(order.runner), hung_s if armed else UNARMED_S)
    excused = False
    while True:
        waited_s, began_s = runqueue_wait_s(order.runner), host_seconds()
        left_s = timeout.left_s(began_s, waited_s)
        ready, _, _ = select.select([source], [], [], left_s)
        said = read(4096) if ready else b""
        *lines, unread = (unread + said).split(b"\n")
        if DISMISSED in lines or (ready and not said and not armed):
            return 0
        if ready and not said:
            silent_s = None  # the runner's process has ended
            break
        now_s = host_seconds()
        overslept = not excused and now_s - began_s > left_s + _OVERSLEPT_S
        if lines:
            armed = armed or ARMED in lines
            with suppress(OSError):
                write(lines[-1] + b"\n")
            heard_s = now_s if overslept or lines[-1] == ARMED else sent_s(lines[-1])
            if order.armed:
                heard_s = max(heard_s, up_s + _FIRST_BEAT_S - hung_s)
            timeout = SilenceTimeout(heard_s, waited_s, hung_s if armed else UNARMED_S)
            excused = overslept
        elif overslept:
            timeout, excused = replace(timeout, heard_s=now_s), True
        elif not timeout.left_s(now_s, runqueue_wait_s(order.runner)):
            silent_s = now_s - timeout.heard_s
            break
    if armed:
        begins_within_s = SPARE_S if silent_s is None else 0.0  # it has waited so much longer already
        if first is not None and first.has_done_it(order.run_folder / FOLDER, begins_within_s):
            return 0
        confirmed = _take_over(order, runner, silent_s)
    else:
        confirmed = True
        runner.end()
        _tell(f"the runner stood still for {silent_s:.0f} s before its first command: it was ended")
    for descriptor in order.lease:
        with suppress(OSError):
            Path(f"/proc/self/fd/{descriptor}").readlink().unlink()
    return 0 if confirmed else 1


def _runner_pipes() -> tuple[int, Callable[[int], bytes], Callable[[bytes], int]]:
    """Return what to wait for and how to hear and to speak: by standard input and output, or sockets."""
    if SELECTS_FILES:
        return 0, partial(os.read, 0), partial(os.write, 1)
    source, sink = pumped_in(FileIO(0, closefd=False)), pumped_out(FileIO(1, "w", closefd=False))
    sink.setblocking(False)  # a runner that does not read must not stop its watchdog
    return source.fileno(), source.recv, sink.send


def _read_order() -> Order:
    line = b""
    while not line.endswith(b"\n"):
        line += os.read(0, 1) or b"\n"
    data: dict[str, Any] = json.loads(line)
    file, folder = bench_file_from(data["bench"]), Path(data["run_folder"])
    return Order(
        run_folder=folder,
        runner=int(data["runner"]),
        lease=tuple(data["lease"]),
        armed=bool(data["armed"]),
        first=data["first"],
        take_lease=None if INHERITED else partial(take_lease, file, f"the watchdog of run {folder.name}"),
        openers={
            "table": _of(file.table.port, partial(open_table, file)),
            "chamber": _of(file.chamber.port, partial(open_chamber, file)),
        }
        | {name: _of(file.ports[name], partial(open_instrument, file, name)) for name in made_safe(file)},
    )


def _of(port: str, opener: _Opener) -> _Opener:
    """Return what opens a port as long as it leads to the device that it leads to now.

    The numbers of a killed emulated lab's terminals are taken by the next one, whose run is not ours to stop.
    """
    device = device_at(port)

    def opened(clock: Clock, tap: Tap | None) -> Instrument:
        if device_at(port) != device:
            raise _Replaced("the device is no more", where=port, found="nothing, or another of its name")
        return opener(clock, tap)

    return opened


def _take_over(order: Order, runner: Other, silent_s: float | None) -> bool:
    """End the runner and bring the bench to rest; return whether all of it confirmed that.

    `silent_s`: for how long the runner gave no sign of life; None: its process has ended.
    """
    runner.end()
    clock = WallClock()
    clock.pulse = partial(sign_of_life, order.run_folder / FOLDER)
    notes = _Notes(order.run_folder / FOLDER, clock)
    cause: Literal["runner_ended", "runner_silent"] = "runner_ended" if silent_s is None else "runner_silent"
    takeover = Takeover(cause, utc_now(), order.runner, silent_s)
    notes.say(takeover)
    lease = _lease(order, clock)
    if isinstance(lease, Exception):
        text = f"its lease could not be taken, the bench is stopped all the same: {lease}"
        notes.say(Alarm("bench", text, "unleased"))
    found = _Ports(order, clock, notes, str(takeover)).stop()
    for state in found.values():
        if not state.confirmed:
            notes.say(state)
    ended = TakeoverEnded(all(state.confirmed for state in found.values()))
    notes.say(ended)
    notes.close()
    if isinstance(lease, Lease):
        lease.release()
    return ended.confirmed


def _lease(order: Order, clock: Clock) -> Lease | Exception | None:
    """Return the lease that the runner's end has freed, or why we have not got it; None for an inherited one."""
    while order.take_lease is not None:
        try:
            return order.take_lease()
        except BenchInUse as error:  # locks are freed a moment after their process
            if clock.now() >= _LEASE_S:
                return error
            clock.sleep(_AGAIN_S)
        except (BenchError, OSError) as error:  # whatever it is, the bench is to be stopped
            return error
    return None


class _Ports:
    """Table and chamber, taken over port by port as these can be opened."""

    def __init__(self, order: Order, clock: Clock, notes: _Notes, why: str) -> None:
        self._closed = dict(order.openers)
        self._clock, self._notes, self._why = clock, notes, why
        self._found: dict[str, SafeState] = {}
        self._told: set[str] = set()
        self._first_until_s = clock.now() + _FIRST_TRY_S

    def stop(self) -> dict[str, SafeState]:
        """Bring to rest what can be opened, all that is there first; return what became of each device."""
        while self._closed and (opened := self._open()):
            for name, reading in bring_to_rest(opened, self._clock).items():
                state = self._found[name] = reading.fact(name, "takeover", self._why)
                if state.confirmed:
                    self._notes.say(state)
        return self._found

    def _open(self) -> dict[str, Instrument]:
        """Return what is open: all, or after a second what is there; nothing once the ports were tried enough."""
        opened: dict[str, Instrument] = {}
        while self._closed and not (opened and self._clock.now() >= self._first_until_s):
            for name in list(self._closed):
                try:
                    opened[name] = self._closed[name](self._clock, self._notes.tap(name))
                    del self._closed[name]
                except _Replaced as error:
                    self._found[name] = Reading(None, "replaced", error).fact(name, "takeover", self._why)
                    del self._closed[name]
                except BenchError as error:
                    self._found[name] = Reading.of(error).fact(name, "takeover", self._why)
            if self._closed:
                if self._clock.now() >= _PORTS_TIMEOUT_S:
                    break
                if self._clock.now() >= self._first_until_s:
                    self._tell_of_closed()
                self._clock.sleep(_AGAIN_S)
        return opened

    def _tell_of_closed(self) -> None:
        """Say once of each port that it cannot be opened so far."""
        for name in self._closed.keys() - self._told:
            self._told.add(name)
            self._notes.say(replace(self._found[name], state="pending"))


class _Notes:
    """The watchdog's own record in the run folder: events and raw bytes; a folder that is gone stops nothing."""

    def __init__(self, folder: Path, clock: Clock) -> None:
        self._clock, self._run = clock, folder.parent
        self._taps: dict[str, Tap | None] = {}
        self._journal: Journal | None = None
        self._events: EventLog | None = None
        try:
            set_aside(folder)
            folder.mkdir(exist_ok=True)
            self._journal, self._events = Journal(folder, 1.0), EventLog(folder)
            self._journal.adopt(self._events)
        except (OSError, RecordError) as error:
            _tell(str(error))

    def tap(self, port: str) -> Tap | None:
        """Return the journal of a port, None for a run folder that can no longer be written."""
        if port not in self._taps and self._journal is not None:
            self._taps[port] = None
            with suppress(RecordError):
                self._taps[port] = self._journal.port(port)
        return self._taps.get(port)

    def say(self, event: Event) -> None:
        if self._events is not None:
            self._events.event(self._clock.now(), event)
        _tell(_words(event, self._run))

    def close(self) -> None:
        for part in (self._journal, self._events):
            if part is not None:
                with suppress(BenchError):
                    part.close()


def _words(event: Event, run: Path) -> str:
    """Return an event in words for whoever sits at the terminal, where the runner says nothing any more."""
    if isinstance(event, Takeover):
        return f"{event}: the table and the chamber are being stopped"
    if isinstance(event, Alarm):
        return event.text
    if isinstance(event, TakeoverEnded):
        after = "" if event.confirmed else ", go and look before anything else"
        return (
            f"{event}{after}. What had come is kept: `gyrobench runs recover {quote(str(run))}` completes it"
        )
    if isinstance(event, SafeState) and event.state == "pending":
        tried = f"its port is tried for {_PORTS_TIMEOUT_S:.0f} s"
        return f"not stopped yet, STOP IT BY HAND; {tried}: {event}"
    confirmed = isinstance(event, SafeState) and event.confirmed
    return str(event) if confirmed else f"not confirmed safe: {event}"


def _tell(text: str) -> None:
    """Say it on the runner's terminal, if there is one still."""
    with suppress(OSError):
        os.write(2, f"watchdog: {text}\n".encode())
