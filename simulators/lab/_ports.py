"""The ports of an emulated lab: pseudo-terminals and loopback TCP, counted byte by byte.

In virtual time a full port has the bench make room; on the wall clock it loses what does not fit, as a UART that
nobody reads does.
"""

from __future__ import annotations

import contextlib
import os
import socket
import struct
import tempfile
from abc import ABC, abstractmethod
from pathlib import Path

from drivers.base.lab_time import MakeRoom
from drivers.base.system import WRITABLE

_BLOCK = 65536
_TCGETS2 = 0x802C542A
_TERMIOS2 = struct.Struct("=4IB19sII")
"""Linux's struct termios2: flags, line discipline, control characters, baud rates in and out as numbers."""
STALL_MS = 20_000
"""Wall time after which a bench that has a port open but does not read it is taken for hung."""


class Port(ABC):
    """One port a bench can open. `returns`: whether it can come back under its name after it was unplugged."""

    url: str

    def __init__(self, name: str, *, returns: bool) -> None:
        self.name = name
        self.returns = returns
        self.make_room: MakeRoom | None = None
        """Has the bench read what fills the port; None where nobody can, and what does not fit is lost."""
        self.received = 0
        self.written = 0
        self.is_open = False

    @abstractmethod
    def fileno(self) -> int:
        """Return the descriptor the lab reads, -1 while nobody can write to it."""

    def open(self) -> None:
        """Start counting from zero for a bench that has just opened the port."""
        self.received = 0
        self.written = 0
        self.is_open = True

    def baudrate(self) -> int:
        """Return what the bench has set, in bit/s; 0 where there is nothing to set."""
        return 0

    def shut(self) -> None:
        """Forget the bench that closed the port."""
        self.is_open = False

    @abstractmethod
    def read(self) -> bytes:
        """Return what the bench wrote, empty if nothing."""

    def write(self, data: bytes) -> None:
        """Write to an open port; a closed one swallows it. A full one waits for room, or loses the rest."""
        if not self.is_open:
            return
        view = memoryview(data)
        while view:
            try:
                view = view[self._send(view) :]
            except BlockingIOError:
                if self.make_room is None:
                    break
                while not self.make_room(self.fileno(), WRITABLE):
                    pass
            except ConnectionError:  # reset by the bench while an answer was on its way
                self.shut()
                return
        self.written += len(data) - len(view)

    @abstractmethod
    def _send(self, data: memoryview) -> int:
        """Send what fits to the bench and return how much that was; BlockingIOError if nothing does."""

    @abstractmethod
    def unplug(self) -> None:
        """Take the port away from whoever has it open; it cannot be opened until `plug`."""

    @abstractmethod
    def plug(self) -> None:
        """Bring the port back under the same name."""

    @abstractmethod
    def close(self) -> None:
        """Remove the port."""


class PtyPort(Port):
    """A serial port: the bench opens the slave side of a pseudo-terminal.

    A terminal's name cannot be had twice: one that `returns` after it was unplugged is reached by a link.
    """

    def __init__(self, name: str, *, returns: bool = False) -> None:
        super().__init__(name, returns=returns)
        self._link = Path(tempfile.mkdtemp(prefix="gyrobench-")) / name if returns else None
        self._master = self._slave = -1
        self.plug()
        self.url = os.ttyname(self._slave) if self._link is None else str(self._link)

    def fileno(self) -> int:
        """Return the master's descriptor, -1 while unplugged."""
        return self._master

    def baudrate(self) -> int:
        """Return what the bench has set on its side of the terminal."""
        import fcntl  # a system without it has no pseudo-terminals, either

        told = fcntl.ioctl(self._master, _TCGETS2, bytes(_TERMIOS2.size))
        return int(_TERMIOS2.unpack(told)[-1])

    def plug(self) -> None:
        """Make the terminal."""
        import tty

        self._master, self._slave = os.openpty()
        # Raw before anybody knows the name: the line discipline would echo and translate. The slave stays open
        # here, else the master reads EIO when the bench closes.
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        if self._link is not None:
            self._link.symlink_to(os.ttyname(self._slave))

    def unplug(self) -> None:
        """Hang up: what the bench has not read is lost, as with a pulled adapter."""
        self.is_open = False
        if self._link is not None:
            self._link.unlink(missing_ok=True)
        for descriptor in (self._master, self._slave):
            with contextlib.suppress(OSError):
                os.close(descriptor)
        self._master = self._slave = -1

    def read(self) -> bytes:
        """Return what the bench wrote."""
        try:
            data = os.read(self._master, _BLOCK)
        except BlockingIOError:
            return b""
        self.received += len(data)
        return data

    def _send(self, data: memoryview) -> int:
        return os.write(self._master, data)

    def close(self) -> None:
        """Remove both sides, and the link."""
        self.unplug()
        if self._link is not None:
            with contextlib.suppress(OSError):
                self._link.parent.rmdir()


class TcpPort(Port):
    """A device server on loopback; one bench at a time."""

    def __init__(self, name: str) -> None:
        super().__init__(name, returns=True)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._connection: socket.socket | None = None
        self._unplugged = False
        self.url = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"

    def fileno(self) -> int:
        """Return the connection's descriptor, the listener's while nobody is connected, -1 while unplugged."""
        if self._unplugged:
            return -1
        return self._listener.fileno() if self._connection is None else self._connection.fileno()

    def open(self) -> None:
        """Accept the connection that the bench has made."""
        if self._connection is None:
            self._listener.settimeout(STALL_MS / 1e3)
            self._connection, _ = self._listener.accept()
            self._connection.setblocking(False)
            self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        super().open()

    def shut(self) -> None:
        """Drop the connection."""
        super().shut()
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

    def _send(self, data: memoryview) -> int:
        if self._connection is None:
            raise ConnectionError("nobody is connected")
        return self._connection.send(data)

    def unplug(self) -> None:
        """Hang up and refuse connections; the port's number stays taken."""
        self.shut()
        address = self._listener.getsockname()
        self._listener.close()
        self._listener = socket.socket()
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.bind(address)
        self._unplugged = True

    def plug(self) -> None:
        """Listen again."""
        self._listener.listen()
        self._unplugged = False

    def close(self) -> None:
        """Stop listening."""
        self.shut()
        self._listener.close()
