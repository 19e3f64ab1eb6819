"""How a lab in a process of its own is driven: in lock-step by a bench's messages, or by the wall clock."""

from __future__ import annotations

import select
import socket
import sys
from typing import Any

from drivers.base.clock import WallClock
from drivers.base.errors import BenchError
from drivers.base.lab_time import FULL, Codec
from drivers.base.system import READABLE, poller
from drivers.base.virtual_clock import share_cpu
from simulators.lab._control_channel import ControlChannel
from simulators.lab._core import Lab
from simulators.lab._door import Door
from simulators.lab._lock_step import LockStep
from simulators.lab._ports import STALL_MS

_TICK_S = 0.02
"""Wall-clock cadence of a lab on the wall clock; about an FTDI adapter's 16 ms latency timer."""


class VirtualService:
    """Serves a lab's clock to one bench at a time."""

    def __init__(
        self,
        lab: Lab,
        channel: ControlChannel,
        cpu: int | None = None,
        emulated: dict[str, Any] | None = None,
    ) -> None:
        self._lab = LockStep(lab, cpu, emulated)
        self._channel = channel
        self._cpu = cpu
        self._codec = Codec(len(lab.ports))
        self._door = Door()
        self.url = self._door.url

    def run(self) -> None:
        """Serve benches until the control channel closes."""
        share_cpu(self._cpu)
        try:
            while self._await_bench():
                if (connection := self._door.accept()) is None:
                    continue
                with connection:
                    self._serve(connection)
                self._lab.leave()
        finally:
            self._door.close()

    def _await_bench(self) -> bool:
        while True:
            waiting: list[Any] = [self._door, self._channel]
            ready, _, _ = select.select(waiting, [], [])
            if self._channel in ready and not self._channel.answer():
                return False
            if self._door in ready:
                return True

    def _serve(self, connection: socket.socket) -> None:
        connection.sendall(self._lab.greeting.to_line())
        poll = poller()
        poll.register(connection.fileno(), READABLE)
        poll.register(self._channel.fileno(), READABLE)
        pending = b""
        while True:
            for descriptor, _ in poll.poll():
                if descriptor == self._channel.fileno():
                    if not self._channel.answer():
                        return
                    continue
                data = connection.recv(65536)
                if not data:
                    return
                pending += data
            while len(pending) >= self._codec.request_size:
                request = self._codec.unpack_request(pending[: self._codec.request_size])
                pending = pending[self._codec.request_size :]
                try:
                    reply = self._codec.pack_reply(self._lab.step(request, _Room(connection)))
                except BenchError as error:
                    reply = self._codec.pack_error(str(error))
                connection.sendall(reply)


class _Room:
    """Waits for room on a port while the bench at the other end of a connection reads (`MakeRoom`)."""

    def __init__(self, connection: socket.socket) -> None:
        self._connection = connection
        self._told = False

    def __call__(self, descriptor: int, events: int) -> bool:
        if not self._told:  # once a request
            self._told = True
            self._connection.sendall(FULL)
        poll = poller()
        poll.register(descriptor, events)
        if not poll.poll(STALL_MS):
            raise BenchError("the bench has a port open but does not read it")
        return True


def run_on_wall_clock(lab: Lab, channel: ControlChannel) -> None:
    """Let lab time follow the host's clock until the control channel closes."""
    clock = WallClock()
    for port in lab.ports:
        if port.url.startswith("/"):
            port.open()
    while True:
        waiting: list[Any] = [channel, *(port for port in lab.ports if port.fileno() >= 0)]
        ready, _, _ = select.select(waiting, [], [], _TICK_S)
        if channel in ready and not channel.answer():
            return
        for index, port in enumerate(lab.ports):
            if port in ready:
                if not port.is_open:
                    port.open()
                data = port.read()
                if data:
                    lab.take_input(index, data)
        try:
            now_ns = round(clock.now() * 1e9)
            while lab.now_ns < now_ns:
                lab.advance(now_ns)
                lab.settle()
        except BenchError as error:
            sys.stderr.write(f"{error}\n")
        for port in lab.ports:  # a terminal that came back does not say when it is opened
            if port.url.startswith("/") and port.fileno() >= 0 and not port.is_open:
                port.open()
