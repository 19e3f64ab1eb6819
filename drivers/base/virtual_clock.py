"""The clock of an emulated lab: lab time moves only when the bench asks, and only after every byte was read."""

from __future__ import annotations

import contextlib
import os
from collections import deque

from drivers.base.clock import Interrupt, OnLoss, Readable, tell_failures
from drivers.base.errors import BenchError, ConfigurationError
from drivers.base.lab_time import NOT_OPEN, WATCHDOG_S, Mark, connect, lab_lost
from drivers.base.system import READABLE, poller

_LONGEST_STEP_NS = 64_000_000_000
"""Longer sleeps are cut, so that the bytes of one step stay few."""


def share_cpu(cpu: int | None) -> set[int]:
    """Run the calling thread on processor `cpu` alone; return where it ran before, empty if nothing was changed.

    Bench and lab take turns and never work at the same time: on one processor a turn costs a context switch, on
    two the waking of an idle one, several times as much.
    """
    before = os.sched_getaffinity(0) if hasattr(os, "sched_getaffinity") else set()
    if cpu is None or cpu not in before:
        return set()
    os.sched_setaffinity(0, {cpu})
    return before


class VirtualClock:
    """Bench time served by the emulated lab at a clock URL (`drivers.base.lab_time`)."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._lab = connect(url)
        greeting = self._lab.greeting
        self.interrupt = Interrupt()
        self._names = list(greeting.ports)
        self.emulated = greeting.emulated
        """What the lab says it emulates: seed and model."""
        self._affinity = share_cpu(greeting.cpu)
        self._origin_ns = greeting.now_ns
        """Lab time at which this bench came; its own time begins at 0, however long the lab has been served."""
        self._now_ns = 0
        self._lab_ns = 0
        """Bench time that the lab has reached: behind while the bench idles."""
        self._ports: list[Readable | None] = [None] * len(self._names)
        self._pending: list[bytearray] = [bytearray() for _ in self._names]
        self._by_descriptor: dict[int, int] = {}
        self._released: set[int] = set()
        """Ports closed since the last request."""
        self._failures: deque[tuple[BenchError, OnLoss | None]] = deque()
        self._lost_calls: dict[int, OnLoss | None] = {}
        self._left: dict[int, tuple[Readable, bytearray]] = {}
        """Ports that went away in this step, and what came before it."""
        self._poll = poller()

    def now(self) -> float:
        """Return bench time in s."""
        return self._now_ns / 1e9

    def sleep(self, duration_s: float) -> None:
        """Let the lab run for `duration_s` seconds of bench time."""
        end_ns = self._now_ns + max(0, round(duration_s * 1e9))
        while True:
            self.interrupt.check()
            self._advance(min(end_ns, self._now_ns + _LONGEST_STEP_NS), -1)
            if self._now_ns >= end_ns:
                return

    def idle(self, duration_s: float) -> None:
        """Let bench time pass; the lab follows with the next wait, which saves a round trip."""
        if duration_s * 1e9 > _LONGEST_STEP_NS or self._lab_ns < self._now_ns:
            self.sleep(duration_s)
            return
        self.interrupt.check()
        self._now_ns += max(0, round(duration_s * 1e9))

    def wait_for(self, port: Readable, deadline_s: float) -> bool:
        """Let the lab run until it has sent something on `port` (True) or bench time `deadline_s`."""
        index = self._index(port.name)
        # a deadline less than half a ns ahead is still ahead: whoever loops until it would never arrive
        least_ns = self._now_ns + int(deadline_s > self.now())
        deadline_ns = max(least_ns, round(deadline_s * 1e9))
        while True:
            self.interrupt.check()
            before = port.bytes_received
            self._advance(min(deadline_ns, self._now_ns + _LONGEST_STEP_NS), index)
            if port.bytes_received > before:
                return True
            if self._now_ns >= deadline_ns:
                return False

    def attach(self, port: Readable) -> None:
        """Open lab port `port.name` for this bench."""
        index = self._index(port.name)
        if index in self._released:  # the lab must hear that it was closed before it is opened again
            self._advance(self._now_ns, -1)
        self._ports[index] = port
        self._by_descriptor[port.fileno()] = index
        self._poll.register(port.fileno(), READABLE)

    def stream(self, port: Readable, lost: OnLoss | None = None) -> None:
        """Note whom to tell of its loss: every step of the clock reads every port."""
        self._lost_calls[self._index(port.name)] = lost

    def detach(self, port: Readable) -> None:
        """Close lab port `port.name` for this bench."""
        index = self._index(port.name)
        if self._ports[index] is None:
            return
        if self._lab_ns < self._now_ns and not self._failures:
            with contextlib.suppress(BenchError):  # the lab may be what is being left
                self._advance(self._now_ns, -1)
        self._ports[index] = None
        self._released.add(index)
        self._pending[index].clear()
        del self._by_descriptor[port.fileno()]
        with contextlib.suppress(KeyError):
            self._poll.unregister(port.fileno())

    def close(self) -> None:
        """Let go of the lab, and run on any processor again."""
        if self._affinity:
            os.sched_setaffinity(0, self._affinity)
        self._lab.leave()
        self.interrupt.close()

    def _index(self, name: str) -> int:
        try:
            return self._names.index(name)
        except ValueError:
            raise ConfigurationError(
                f"the emulated lab has no port {name!r}",
                where=self.url,
                found=", ".join(self._names),
                expected="a lab started for this bench file",
                remedy="start `gyrobench lab` with the same bench file",
            ) from None

    def _advance(self, to_ns: int, stop_port: int) -> None:
        self._released.clear()
        sent = [NOT_OPEN if port is None else port.bytes_sent for port in self._ports]
        origin_ns = self._origin_ns
        request = (self._now_ns + origin_ns, to_ns + origin_ns, stop_port, sent)
        now_ns, written, marks = self._lab.step(request, self._read_or_wait)
        for index, port in enumerate(self._ports):
            while port is not None and port is self._ports[index] and port.bytes_received < written[index]:
                if not self._take(index):
                    self._read_or_wait()
            if port is not None and port is self._ports[index] and written[index] == NOT_OPEN:
                self._take(index)  # meets the end of it: LinkLost, once this step is over
                if port is self._ports[index]:
                    raise lab_lost(self.url, f"it says that port {port.name} is gone, which still reads")
        self._now_ns = self._lab_ns = now_ns - origin_ns
        self._hand_over(marks)
        tell_failures(self._failures)

    def _read_or_wait(self, descriptor: int = -1, events: int = 0) -> bool:
        """Wait for any byte and read the ports that have some; say whether a descriptor of the lab is ready."""
        if descriptor >= 0:
            self._poll.register(descriptor, events)
        try:
            ready = self._poll.poll(WATCHDOG_S * 1e3)
        finally:
            if descriptor >= 0:
                self._poll.unregister(descriptor)
        if not ready:
            raise lab_lost(self.url, f"it said nothing for {WATCHDOG_S:g} s")
        for found, _ in ready:
            if found != descriptor:
                self._take(self._by_descriptor[found])
        return any(found == descriptor for found, _ in ready)

    def _take(self, index: int) -> bool:
        """Read a port once; say whether it had something."""
        port = self._ports[index]
        if port is None:
            return False
        try:
            data = port.receive()
        except BenchError as error:  # raised when this step is over: the lock-step must not lose its place
            self._failures.append((error, self._lost_calls.pop(index, None)))
            last = bytearray(self._pending[index])
            self.detach(port)
            self._left[index] = (port, last)
            return False
        self._pending[index] += data
        return bool(data)

    def _hand_over(self, marks: list[Mark]) -> None:
        for index, until, time_ns in marks:
            port, pending = self._ports[index], self._pending[index]
            if port is None and index in self._left:
                port, pending = self._left[index]
            if port is None:
                continue
            count = len(pending) - (port.bytes_received - until)
            if count > 0:
                data = bytes(pending[:count])
                del pending[:count]
                port.deliver(data, (time_ns - self._origin_ns) / 1e9)
        for port, rest in self._left.values():
            port.deliver(bytes(rest), self.now())
        self._left.clear()
