"""CAN buses by the names of a bench file, each with a link whose bytes are the messages as slcan lines."""

from __future__ import annotations

import contextlib
import socket
import threading
from collections.abc import Callable
from typing import Any

import numpy as np

from drivers.base.clock import Clock
from drivers.base.errors import ConfigurationError, ProtocolError
from drivers.base.system import SELECTS_FILES
from drivers.kit.link import Link, Opening, Tap
from drivers.kit.python_can import can
from drivers.kit.slcan_codec import SlcanParser
from drivers.slcan._bus import INTERFACE, BufferedSlcanBus
from drivers.slcan._python_can import encode_message, to_messages, unsupported_kind

BUS_ERRORS = (can.CanError, NotImplementedError, OSError, ValueError, TypeError)
"""What python-can's interfaces raise when a bus cannot be opened, or is gone."""
_AT_ONCE = 1000
"""Messages taken from a bus in one go."""
_POLL_S = 0.1
"""How long the reading thread may take to notice that it should stop."""


def open_can(
    interface: str,
    channel: str,
    bitrate: int,
    clock: Clock,
    name: str,
    *,
    tap: Tap | None = None,
    **options: Any,
) -> tuple[can.BusABC, Link]:
    """Return an open bus and the link that its messages can be recorded from.

    `interface` and `channel` are python-can's (`gyrobench_slcan`: an slcan adapter on a serial port or URL);
    `bitrate` in bit/s; `name` names the port, `tap` gets its bytes; `options` go to the interface. Closing the
    link closes the bus.
    Raises ConfigurationError when the interface is unknown or the bus cannot be opened.
    """

    def opened() -> can.BusABC:
        try:
            return can.Bus(
                interface=interface, channel=channel, bitrate=bitrate, ignore_config=True, **options
            )
        except (AttributeError, ImportError, NameError) as error:  # what some lead to without their library
            text = f"the library of interface {interface!r} is not here ({error})"
            raise can.CanInterfaceNotImplementedError(text) from error

    try:
        if interface == INTERFACE:
            adapter = BufferedSlcanBus(channel, bitrate, clock, name, tap=tap, **options)
            return adapter, adapter.link
        bus = opened()
    except BUS_ERRORS as error:
        raise ConfigurationError(
            "the CAN bus cannot be opened",
            where=f"{name} ({interface}, {channel})",
            found=str(error),
            expected=f"{INTERFACE}, or another interface that python-can knows, and its channel",
            remedy="check interface, channel and options in the bench file, that the adapter is plugged in, and "
            "that its maker's library is installed",
        ) from error
    return bus, MessageLink(bus, clock, name=name, tap=tap, opener=opened)


class MessageLink(Link):
    """A `Link` over a python-can bus, so that recording and decoding know one format only.

    What it reads are the received messages as slcan lines; slcan lines written to it are sent as messages. A bus
    that has no descriptor to select on (python-can's virtual bus) is read by a thread into a pair of sockets, as
    is every bus where only sockets can be waited for (Windows, untried). Error frames
    and CAN FD messages, for which slcan has no lines, are counted in `left_out`. The link owns the bus: `close`
    shuts it down. `opener` makes the bus anew after it was lost.
    """

    def __init__(
        self,
        bus: can.BusABC,
        clock: Clock,
        *,
        name: str,
        tap: Tap | None = None,
        opener: Callable[[], can.BusABC] | None = None,
    ) -> None:
        # Not Link's own constructor, which opens a serial port: here the bus is the port.
        self.url = str(bus.channel_info)
        self.name = name
        self.clock = clock
        self.tap = tap
        self.streaming = False
        self.bytes_received = 0
        self.bytes_sent = 0
        self.left_out: dict[str, int] = {}
        self._buffer = bytearray()
        self._closed = False
        self._opener = opener
        self._opening = None
        self._reader: _Reader | None = None
        self._take_bus(bus)
        clock.attach(self)

    def receive(self) -> bytes:
        """Read what has arrived as slcan lines, empty if nothing; raises LinkLost when the bus is gone."""
        try:
            data = self._take_lines(0.0) if self._reader is None else self._reader.read()
        except (can.CanError, OSError) as error:
            raise self._lost(error) from error
        self.bytes_received += len(data)
        return data

    def write(self, data: bytes) -> None:
        """Send the slcan lines in `data` as messages.

        Raises ProtocolError for bytes that are not whole slcan frames, LinkLost when the bus is gone.
        """
        now = self.clock.now()
        parser = SlcanParser()
        frames = parser.feed(data)
        if parser.counts.rejected or not data.endswith(b"\r"):
            raise ProtocolError(
                "only slcan frames can be written to a CAN bus",
                where=self.where,
                found=repr(data[:60]),
                expected="lines such as t1232AABB that end in CR",
            )
        try:
            for message in to_messages(frames, np.zeros(len(frames))):
                self._bus.send(message)
        except (can.CanError, OSError) as error:
            raise self._lost(error) from error
        self.bytes_sent += len(data)
        if self.tap is not None:
            self.tap.sent(data, now)

    def _open(self, *, in_background: bool = True) -> Opening:
        if self._opener is None:
            raise self._not_opened("a bus that somebody else opened")
        return Opening(self._opener, BUS_ERRORS, in_background=True)

    def _take_port(self, opening: Opening) -> None:
        try:
            self._take_bus(opening.result())
        except BUS_ERRORS as error:
            raise self._not_opened(str(error)) from error
        self._closed = False

    def close(self) -> None:
        """Stop reading and shut the bus down; may be called again."""
        self._let_go()
        if self._opening is not None and self._opening.over(0.0):
            with contextlib.suppress(*BUS_ERRORS):
                self._opening.result().shutdown()
        self._opening = None

    def _take_bus(self, bus: can.BusABC) -> None:
        self._bus = bus
        self._fd = _descriptor(bus)
        self._reader = None
        if self._fd < 0:
            self._reader = _Reader(self._take_lines)
            self._fd = self._reader.fileno()

    def _let_go(self) -> None:
        """Shut the bus down, once; one that is gone may complain."""
        if self._closed:
            return
        self._closed = True
        self.clock.detach(self)
        if self._reader is not None:
            self._reader.close()
        with contextlib.suppress(*BUS_ERRORS):
            self._bus.shutdown()

    def _take_lines(self, timeout_s: float) -> bytes:
        """Return the messages that wait in the bus as lines; wait up to `timeout_s` for the first."""
        lines: list[bytes] = []
        message = self._bus.recv(timeout_s)
        while message is not None:
            kind = unsupported_kind(message)
            if kind:
                self.left_out[kind] = self.left_out.get(kind, 0) + 1
            else:
                lines.append(encode_message(message))
            message = self._bus.recv(0.0) if len(lines) < _AT_ONCE else None
        return b"".join(lines)


def _descriptor(bus: can.BusABC) -> int:
    """Return the descriptor that tells when the bus has something, -1 for a bus without one."""
    if not SELECTS_FILES:  # what it has need not be a socket
        return -1
    try:
        return int(bus.fileno())
    except (NotImplementedError, can.CanError):
        return -1


class _Reader:
    """A thread that moves the lines of a bus into a pair of sockets, whose near end can be selected on."""

    def __init__(self, take_lines: Callable[[float], bytes]) -> None:
        self._take_lines = take_lines
        self._stopping = threading.Event()
        self._failure: Exception | None = None
        self._near, self._far = socket.socketpair()
        self._near.setblocking(False)
        self._thread = threading.Thread(target=self._run, name="CAN reader", daemon=True)
        self._thread.start()

    def fileno(self) -> int:
        """Return the descriptor to select on."""
        return self._near.fileno()

    def read(self) -> bytes:
        """Return what the thread has moved so far; OSError when it has ended."""
        try:
            data = self._near.recv(65536)
        except BlockingIOError:
            return b""
        if not data:
            raise OSError(str(self._failure or "end of stream"))
        return data

    def close(self) -> None:
        """Stop the thread: the closed socket ends a write that waits, the event ends the loop."""
        if not self._stopping.is_set():
            self._stopping.set()
            self._near.close()
            self._thread.join()

    def _run(self) -> None:
        try:
            while not self._stopping.is_set():
                lines = self._take_lines(_POLL_S)
                if lines:
                    self._far.sendall(lines)
        except ConnectionError:
            pass
        except Exception as error:  # whatever a bus raises ends the stream; `read` says so
            self._failure = error
        finally:
            self._far.close()
