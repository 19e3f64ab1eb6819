"""The ports of an emulated lab: pseudo-terminals and loopback TCP, counted byte by byte.

A patient port (virtual time) waits for the bench to make room; an impatient one (wall clock) loses what does not
fit, as a UART nobody reads does.
"""

from __future__ import annotations

import contextlib
import os
import select
import socket
import tty
from collections.abc import Callable
from typing import Protocol

from drivers.errors import BenchError

_BLOCK = 65536
_STALL_MS = 20_000
"""Wall time after which a bench that has a port open but does not read it is taken for hung."""


def _nothing() -> None:
    """Whoever serves the lab puts something in its place."""


class Port(Protocol):
    """One port a bench can open."""

    name: str
    url: str
    received: int
    written: int
    is_open: bool
    on_full: Callable[[], None]
    """Called before a patient port waits for room."""

    def fileno(self) -> int:
        """Return the descriptor the lab reads, -1 while nobody is connected."""
        ...

    def open(self) -> None:
        """Start counting for a bench that has just opened the port."""
        ...

    def shut(self) -> None:
        """Forget the bench that closed the port."""
        ...

    def read(self) -> bytes:
        """Return what the bench wrote, empty if nothing."""
        ...

    def write(self, data: bytes) -> None:
        """Put `data` on the port."""
        ...

    def close(self) -> None:
        """Remove the port."""
        ...


class PtyPort:
    """A serial port: the bench opens the slave side of a pseudo-terminal."""

    def __init__(self, name: str, *, patient: bool) -> None:
        self.name = name
        self.patient = patient
        self.on_full: Callable[[], None] = _nothing
        self._master, self._slave = os.openpty()
        # Raw before anybody knows the name: the line discipline would echo and translate. The slave stays open
        # here, else the master reads EIO when the bench closes.
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.url = os.ttyname(self._slave)
        self.received = 0
        self.written = 0
        self.is_open = False

    def fileno(self) -> int:
        """Return the master's descriptor."""
        return self._master

    def open(self) -> None:
        """Start counting from zero."""
        self.received = 0
        self.written = 0
        self.is_open = True

    def shut(self) -> None:
        """Stop sending."""
        self.is_open = False

    def read(self) -> bytes:
        """Return what the bench wrote."""
        try:
            data = os.read(self._master, _BLOCK)
        except BlockingIOError:
            return b""
        self.received += len(data)
        return data

    def write(self, data: bytes) -> None:
        """Write to an open port; a closed one swallows it."""
        if self.is_open:
            self.written += _write(self._master, data, self)

    def close(self) -> None:
        """Close both sides: what the bench has not read is lost, as with a pulled adapter."""
        for descriptor in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(descriptor)


class TcpPort:
    """A device server on loopback; one bench at a time."""

    def __init__(self, name: str, *, patient: bool) -> None:
        self.name = name
        self.patient = patient
        self.on_full: Callable[[], None] = _nothing
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._connection: socket.socket | None = None
        self.url = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"
        self.received = 0
        self.written = 0
        self.is_open = False

    def fileno(self) -> int:
        """Return the connection's descriptor, or the listener's while nobody is connected."""
        return self._listener.fileno() if self._connection is None else self._connection.fileno()

    def open(self) -> None:
        """Accept the connection that the bench has made."""
        if self._connection is None:
            self._listener.settimeout(_STALL_MS / 1e3)
            self._connection, _ = self._listener.accept()
            self._connection.setblocking(False)
            self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.received = 0
        self.written = 0
        self.is_open = True

    def shut(self) -> None:
        """Drop the connection."""
        self.is_open = False
        if self._connection is not None:
            self._connection.close()
            self._connection = None

    def read(self) -> bytes:
        """Return what the bench wrote; a hung-up bench shuts the port."""
        if self._connection is None:
            return b""
        try:
            data = self._connection.recv(_BLOCK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self.shut()
        self.received += len(data)
        return data

    def write(self, data: bytes) -> None:
        """Write to an open port; a closed one swallows it."""
        if self.is_open and self._connection is not None:
            self.written += _write(self._connection.fileno(), data, self)

    def close(self) -> None:
        """Stop listening."""
        self.shut()
        self._listener.close()


def _write(descriptor: int, data: bytes, port: PtyPort | TcpPort) -> int:
    """Write `data`; a full port makes a patient lab wait, an impatient one lose the rest as a UART would."""
    view = memoryview(data)
    while view:
        try:
            view = view[os.write(descriptor, view) :]
        except BlockingIOError:
            if not port.patient:
                break
            port.on_full()
            poll = select.poll()
            poll.register(descriptor, select.POLLOUT)
            if not poll.poll(_STALL_MS):
                raise BenchError(f"the bench has {port.name} open but does not read it") from None
    return len(data) - len(view)
