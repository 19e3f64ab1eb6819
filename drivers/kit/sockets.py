"""Ports as sockets: a device at `socket://host:port`, and any port where only sockets can be waited on (Windows).

There a serial port is pumped by two threads; untried on Windows itself, the tests run it elsewhere.
"""

from __future__ import annotations

import contextlib
import socket
import threading
from typing import Any

import serial

from drivers.kit.places import is_serial, socket_address

_BLOCK = 65536
_CONNECT_S = 5.0
_LOOK_S = 0.2
"""How long a thread waits for bytes of a port before it looks whether the port is wanted still."""


class NearEnd:
    """The bench's end of a port that is a socket: what a link reads and writes."""

    _near: socket.socket

    def fileno(self) -> int:
        """Return the socket's descriptor."""
        return self._near.fileno()

    def read(self, count: int) -> bytes:
        """Return what has arrived, empty at its end; BlockingIOError if nothing has."""
        return self._near.recv(count)

    def write(self, data: memoryview) -> int:
        """Send what fits and return how much that was; BlockingIOError if nothing does."""
        return self._near.send(data)

    def close(self) -> None:
        """Close it; threads behind it end by themselves."""
        self._near.close()


class SocketPort(NearEnd):
    """A device at `socket://host:port`, or at a serial port `place`, whose `settings` are pyserial's.

    Raises OSError or serial.SerialException when it cannot be opened, ValueError for what is no host and port.
    """

    def __init__(self, place: str, **settings: Any) -> None:
        self._serial: serial.Serial | None = None
        if not is_serial(place):
            self._near = socket.create_connection(socket_address(place), timeout=_CONNECT_S)
            self._near.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        else:
            self._serial = serial.Serial(place, **{**settings, "timeout": _LOOK_S})
            self._near, self._far = socket.socketpair()
            for work in (self._to_bench, self._to_device):
                threading.Thread(target=work, name=f"pumps {place}", daemon=True).start()
        self._near.setblocking(False)

    @property
    def is_open(self) -> bool:
        """Whether it was not closed yet."""
        return self._near.fileno() >= 0

    def _to_bench(self) -> None:
        assert self._serial is not None
        with contextlib.suppress(OSError, serial.SerialException, TypeError):
            while self.is_open:
                if data := self._serial.read(max(1, min(self._serial.in_waiting, _BLOCK))):
                    self._far.sendall(data)
        self._end()

    def _to_device(self) -> None:
        assert self._serial is not None
        with contextlib.suppress(OSError, serial.SerialException, TypeError):
            while data := self._far.recv(_BLOCK):
                self._serial.write(data)
        self._end()

    def _end(self) -> None:
        """Let go of both sides: whoever reads meets the end of it."""
        assert self._serial is not None
        with contextlib.suppress(OSError):
            self._far.shutdown(socket.SHUT_RDWR)
        self._far.close()
        with contextlib.suppress(OSError, serial.SerialException):
            self._serial.close()
