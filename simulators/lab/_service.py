"""How a lab is driven: in lock-step by a virtual clock's client, or by the wall clock."""

from __future__ import annotations

import json
import select
import shutil
import socket
import sys
import tempfile
from pathlib import Path
from typing import Any

from drivers.base.clock import WallClock
from drivers.base.errors import BenchError, ConfigurationError
from drivers.base.virtual_clock import FULL, NOT_OPEN, PROTOCOL, VERSION, Codec, Request, share_cpu
from simulators.lab._control_channel import ControlChannel
from simulators.lab._core import Lab

_TICK_S = 0.02
"""Wall-clock cadence of a lab on the wall clock; about an FTDI adapter's 16 ms latency timer."""


def _listen(path: Path) -> socket.socket:
    """Return a listening socket at `path`: half the cost of a turn over TCP, and closed to other users."""
    listener = socket.socket(socket.AF_UNIX)
    try:
        listener.bind(str(path))
    except OSError as error:
        listener.close()
        raise ConfigurationError(
            "the lab's clock has no place to be reached at",
            where=str(path),
            found=str(error),
            expected="a folder for temporary files with a name of less than 80 characters",
            remedy="set TMPDIR to another one",
        ) from error
    listener.listen()
    return listener


class VirtualService:
    """Serves a lab's clock to one bench at a time."""

    def __init__(
        self,
        lab: Lab,
        channel: ControlChannel,
        cpu: int | None = None,
        emulated: dict[str, Any] | None = None,
    ) -> None:
        self._lab = lab
        self._channel = channel
        self._cpu = cpu
        self._emulated = emulated
        self._said_full = False
        self._codec = Codec(len(lab.ports))
        self._folder = Path(tempfile.mkdtemp(prefix="gyrobench-"))  # for this user only
        self._listener = _listen(self._folder / "clock")
        self.url = f"virtual://{self._folder}/clock"

    def run(self) -> None:
        """Serve benches until the control channel closes."""
        share_cpu(self._cpu)
        try:
            while self._await_bench():
                connection, _ = self._listener.accept()
                with connection:
                    self._serve(connection)
                for port in self._lab.ports:
                    port.shut()
        finally:
            self._listener.close()
            shutil.rmtree(self._folder, ignore_errors=True)

    def _await_bench(self) -> bool:
        while True:
            waiting: list[Any] = [self._listener, self._channel]
            ready, _, _ = select.select(waiting, [], [])
            if self._channel in ready and not self._channel.answer():
                return False
            if self._listener in ready:
                return True

    def _serve(self, connection: socket.socket) -> None:
        names = [port.name for port in self._lab.ports]
        greeting = {
            "protocol": PROTOCOL,
            "version": VERSION,
            "ports": names,
            "now_ns": self._lab.now_ns,
            "cpu": self._cpu,
            "emulated": self._emulated,
        }
        connection.sendall(json.dumps(greeting).encode() + b"\n")
        for port in self._lab.ports:
            port.on_full = lambda: self._say_full(connection)
        poll = select.poll()
        poll.register(connection, select.POLLIN)
        poll.register(self._channel, select.POLLIN)
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
                self._said_full = False
                connection.sendall(self._answer(request))

    def _say_full(self, connection: socket.socket) -> None:
        """Tell the bench, once a request, to read its ports before the reply."""
        if not self._said_full:
            self._said_full = True
            connection.sendall(FULL)

    def _answer(self, request: Request) -> bytes:
        lab = self._lab
        try:
            gone = lab.settle()
            marks = []
            while lab.now_ns < request.at_ns:
                marks += lab.advance(request.at_ns)
            for index, (port, sent) in enumerate(zip(lab.ports, request.sent, strict=True)):
                if index in gone:
                    continue
                if sent == NOT_OPEN:
                    if port.is_open:
                        port.shut()
                    continue
                if not port.is_open:
                    self._lab.open(index)
                while port.received < sent and port.fileno() >= 0:
                    data = port.read()
                    if data:
                        lab.take_input(index, data)
                    elif not port.is_open:
                        break
                    else:  # written, but not yet through the kernel
                        select.select([port], [], [])
            # a bench that holds a port which is gone is told before anything else happens
            held = any(request.sent[index] != NOT_OPEN for index in gone)
            if not held:
                marks += lab.advance(request.to_ns, request.stop_port)
        except BenchError as error:
            return self._codec.pack_error(str(error))
        written = [NOT_OPEN if index in gone else port.written for index, port in enumerate(lab.ports)]
        return self._codec.pack_reply(lab.now_ns, written, marks)


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
