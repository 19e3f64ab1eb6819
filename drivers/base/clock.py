"""Time: the only module that may read or wait on the host's clock.

Bench time is seconds since the clock was made, monotonic. Everything that waits takes a `Clock`; whether an
hour lasts an hour (`WallClock`) or milliseconds (`drivers.base.virtual_clock`) is not its business.
"""

from __future__ import annotations

import contextlib
import datetime
import select
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, Protocol

from drivers.base.errors import BenchError, LinkLost, RunAborted
from drivers.base.system import Wake


class Readable(Protocol):
    """What a clock needs of a port to wait on it."""

    name: str
    bytes_sent: int
    bytes_received: int

    def fileno(self) -> int:
        """Return the descriptor to select on."""

    def receive(self) -> bytes:
        """Read whatever has arrived, at most one system call, empty if nothing."""

    def deliver(self, data: bytes, arrival_s: float) -> None:
        """Take bytes that arrived at `arrival_s` (bench time of the last byte)."""


OnLoss = Callable[[BenchError], None]
"""Takes the LinkLost of a streaming port that has gone away; what it raises is raised in whoever waits."""


class Interrupt:
    """A request to stop that wakes whoever waits on the clock; safe to raise from a signal handler."""

    def __init__(self) -> None:
        self._reason: str | None = None
        self._ignored = False
        self._wake = Wake()

    def fileno(self) -> int:
        """Return a descriptor that is readable while a request stands."""
        return self._wake.fileno()

    def request(self, reason: str) -> None:
        """Ask the waiting thread to stop; a full pipe means that it has been asked already."""
        if self._ignored:
            return
        self._reason = reason
        self.wake()

    def wake(self) -> None:
        """Make the descriptor readable without asking anybody to stop."""
        self._wake.wake()

    def check(self) -> None:
        """Raise RunAborted if a request stands."""
        if self._reason is not None:
            raise RunAborted(self._reason)

    @contextlib.contextmanager
    def ignored(self) -> Iterator[None]:
        """Drop the request and those to come: a bench that is being made safe is not interrupted again."""
        self._ignored = True
        self.clear()
        try:
            yield
        finally:
            self._ignored = False

    def clear(self) -> None:
        """Drop the request."""
        self._reason = None
        self._wake.clear()

    def close(self) -> None:
        """Release what waits are woken by."""
        self._wake.close()


class Clock(Protocol):
    """Bench time. Every wait raises RunAborted as soon as `interrupt` is requested."""

    interrupt: Interrupt

    def now(self) -> float:
        """Return bench time in s."""

    def sleep(self, duration_s: float) -> None:
        """Let `duration_s` seconds of bench time pass."""

    def idle(self, duration_s: float) -> None:
        """Let time pass as `sleep` does; what arrives meanwhile may be delivered by the next wait only."""

    def wait_for(self, port: Readable, deadline_s: float) -> bool:
        """Let time pass until bytes on `port` were delivered (True), or until `deadline_s` (False)."""

    def attach(self, port: Readable) -> None:
        """Make the clock aware of an open port."""

    def stream(self, port: Readable, lost: OnLoss | None = None) -> None:
        """Take bytes off `port` from now on whether or not anybody waits for them.

        When the port goes away, `lost` is called by whoever waits next; without it, the LinkLost is raised there.
        """

    def detach(self, port: Readable) -> None:
        """Forget a port that is about to be closed."""

    def close(self) -> None:
        """Release what the clock holds."""


def utc_now() -> str:
    """Return the host's date and time, ISO 8601 in UTC with milliseconds."""
    return datetime.datetime.now(datetime.UTC).isoformat(timespec="milliseconds")


def epoch_seconds() -> float:
    """Return the host's time as seconds since 1970-01-01 UTC."""
    return time.time()


def host_seconds() -> float:
    """Return the host's monotonic time in s, for timing work and pacing displays, never bench time."""
    return time.perf_counter()


def host_offsets() -> tuple[float, float]:
    """Return how far the host's date, and its time since boot with what it was suspended, are ahead of the
    monotonic time, s. The second is 0 on hosts without such a clock.
    """
    for _ in range(_TRIES):  # whoever loses the processor between the readings reads again
        before_s = time.monotonic()
        date_s, boot_s = time.time(), time.clock_gettime(_BOOT) if _BOOT is not None else before_s
        after_s = time.monotonic()
        if after_s - before_s < _READ_S:
            break
    return date_s - before_s, boot_s - before_s


_TRIES, _READ_S = 20, 0.01
_BOOT: int | None = getattr(time, "CLOCK_BOOTTIME", None)
_PULSE_S = 0.5


def _nothing() -> None:
    """Nobody listens."""


def tell_failures(failures: deque[tuple[BenchError, OnLoss | None]]) -> None:
    """Tell of ports that failed, first come first: a loss to whoever asked to know, all else is raised."""
    while failures:
        failure, lost = failures.popleft()
        if lost is None or not isinstance(failure, LinkLost):
            raise failure
        lost(failure)


class Ticker:
    """A thread that makes a call every `period_s` of host time, and soon after `wake`, until `stop`."""

    def __init__(self, period_s: float, call: Callable[[], None], name: str) -> None:
        self._period_s = period_s
        self._call = call
        self._woken = threading.Event()
        self._running = True
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def wake(self) -> None:
        """Make a call now rather than at the next tick."""
        self._woken.set()

    def stop(self) -> None:
        """End the thread, after the call it is in."""
        self._running = False
        self._woken.set()
        self._thread.join()

    def _run(self) -> None:
        while True:
            self._woken.wait(self._period_s)
            self._woken.clear()
            if not self._running:
                return
            self._call()


class WallClock:
    """The real clock: bench time is host time, monotonic, since construction.

    Streaming ports are read by one thread of the clock's own, so that a busy procedure loses no byte; an error
    there is raised in whoever waits next. Every wait reads the other ports too, whichever it is for: one that
    goes away is known at once. `pulse` is called in every wait, twice a second at least: whoever hears it knows
    that the thread which drives the bench is well.
    """

    def __init__(self) -> None:
        self.interrupt = Interrupt()
        self.pulse: Callable[[], None] = _nothing
        self._start = time.monotonic()
        self._reader: _StreamReader | None = None
        self._polled: dict[Readable, None] = {}
        """Ports that are open and do not stream."""

    def now(self) -> float:
        """Return bench time in s."""
        return time.monotonic() - self._start

    def sleep(self, duration_s: float) -> None:
        """Wait; a negative duration returns at once."""
        self._select([], self.now() + duration_s)

    def idle(self, duration_s: float) -> None:
        """Sleep."""
        self.sleep(duration_s)

    def wait_for(self, port: Readable, deadline_s: float) -> bool:
        """Wait until bytes arrived on `port` (delivered before returning True) or the deadline passed."""
        if not self._select([port], deadline_s):
            return False
        data = port.receive()
        port.deliver(data, self.now())
        return bool(data)

    def attach(self, port: Readable) -> None:
        """Read the port in every wait from here on."""
        self._polled[port] = None

    def stream(self, port: Readable, lost: OnLoss | None = None) -> None:
        """Hand the port to the reader thread."""
        self._polled.pop(port, None)
        if self._reader is None:
            self._reader = _StreamReader(self)
        self._reader.add(port, lost)

    def detach(self, port: Readable) -> None:
        """Take the port back from the reader thread, and out of every wait."""
        self._polled.pop(port, None)
        if self._reader is not None:
            self._reader.remove(port)

    def interrupt_waiters(self) -> None:
        """Wake a waiting thread without asking it to stop, so that it sees the reader's failure."""
        self.interrupt.wake()

    def close(self) -> None:
        """Stop the reader thread."""
        if self._reader is not None:
            self._reader.stop()
        self.interrupt.close()

    def _select(self, ports: list[Any], deadline_s: float) -> bool:
        """Wait until one of `ports` can be read (True), or the deadline passed or somebody wakes us (False)."""
        while True:
            self._check()
            self.pulse()
            remaining_s = max(0.0, deadline_s - self.now())
            others = [port for port in self._polled if port not in ports]
            waiting = [*ports, *others, self.interrupt]
            ready, _, _ = select.select(waiting, [], [], min(remaining_s, _PULSE_S))
            if self.interrupt in ready:
                self._check()
            for port in others:
                if port in ready:
                    self._take(port)
            if any(port in ready for port in ports):
                return True
            if self.interrupt in ready or remaining_s == 0.0 or (remaining_s <= _PULSE_S and not ready):
                return False

    def _take(self, port: Readable) -> None:
        try:
            port.deliver(port.receive(), self.now())
        except LinkLost:
            self._polled.pop(port, None)  # once is enough: whoever goes on has other ports
            raise

    def _check(self) -> None:
        self.interrupt.check()
        if self._reader is not None:
            tell_failures(self._reader.failures)


class _StreamReader:
    """The thread that reads streaming ports on the wall clock."""

    def __init__(self, clock: WallClock) -> None:
        self.failures: deque[tuple[BenchError, OnLoss | None]] = deque()
        self._clock = clock
        self._ports: dict[Readable, OnLoss | None] = {}
        self._lock = threading.Lock()
        self._wake = Wake()
        self._running = True
        self._thread = threading.Thread(target=self._run, name="stream reader", daemon=True)
        self._thread.start()

    def add(self, port: Readable, lost: OnLoss | None) -> None:
        with self._lock:
            self._ports[port] = lost
        self._wake.wake()

    def remove(self, port: Readable) -> None:
        with self._lock:
            self._ports.pop(port, None)
        self._wake.wake()

    def stop(self) -> None:
        self._running = False
        self._wake.wake()
        self._thread.join()
        self._wake.close()

    def _run(self) -> None:
        while self._running:
            with self._lock:
                ports = list(self._ports)
            waiting: list[Any] = [self._wake, *ports]
            try:
                ready, _, _ = select.select(waiting, [], [])
            except (OSError, ValueError):  # a port was closed between the copy and the call
                continue
            for port in ready:
                if port is self._wake:
                    self._wake.clear()
                    continue
                with self._lock:
                    if port in self._ports:
                        self._take(port)

    def _take(self, port: Readable) -> None:
        try:
            data = port.receive()
            port.deliver(data, self._clock.now())
        except BenchError as error:
            self.failures.append((error, self._ports.pop(port)))
            self._clock.interrupt_waiters()
