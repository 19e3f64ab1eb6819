"""How the time of an emulated lab is moved: by a call where the lab is in this process, else by messages.

Wire format of the messages (Unix socket, little-endian; without Unix sockets TCP on loopback, where the bench
first says the word that ends the URL, and a line feed). The lab greets with one JSON line: {"protocol":
"gyrobench-clock", "version": 1, "ports": [names], "now_ns": t, "cpu": n or null, "emulated": {"seed": n,
"model": text} or null}. Then lock-step:

    request  int64 at_ns, int64 advance_to_ns, int16 stop_port (index, or -1), int64 sent[n_ports]
    reply    int64 now_ns, int64 written[n_ports], uint32 n_marks,
             n_marks x (int16 port, int64 written, int64 t_ns)
    error    int64 -1, uint32 length, UTF-8 text
    full     int64 -2: a port is full, read your ports until the reply comes

`sent` is what the bench wrote to the port since it opened it, -1 for a port that it has not open. The lab
moves time to `at_ns` first, when those bytes were written, reads them, then moves time to `advance_to_ns`, or
less: to the first byte that it writes to `stop_port`. `written` counts what it put on the port since the bench
opened it, -1 for a port that is gone; the marks say when.
"""

from __future__ import annotations

import itertools
import json
import os
import socket
import struct
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, Protocol

from drivers.base.errors import BenchError, ConfigurationError, LinkLost
from drivers.base.system import READABLE

PROTOCOL = "gyrobench-clock"
VERSION = 1
NOT_OPEN = -1
WATCHDOG_S = 60.0
"""Wall time after which a lab that says nothing is taken for hung."""
_SCHEME = "virtual://"
FULL = struct.pack("<q", -2)
_MARK = struct.Struct("<hqq")
_ERROR = struct.Struct("<qI")

Mark = tuple[int, int, int]
"""(port, bytes written to it so far, lab time in ns of the last of them)"""
Request = tuple[int, int, int, Sequence[int]]
"""(at_ns, to_ns, stop_port, sent of every port)"""
Reply = tuple[int, list[int], list[Mark]]
"""(lab time in ns, written to every port, marks in order of time per port)"""
MakeRoom = Callable[[int, int], bool]
"""Waits until a descriptor is ready for events of `select.poll` (True), or the bench has read bytes (False)."""


@dataclass(frozen=True)
class Greeting:
    """What a lab says of itself: names of its ports, its time, the processor it shares, what it emulates."""

    ports: tuple[str, ...]
    now_ns: int
    cpu: int | None = None
    emulated: dict[str, Any] | None = None

    def to_line(self) -> bytes:
        """Return the line that a lab greets with."""
        return json.dumps({"protocol": PROTOCOL, "version": VERSION, **asdict(self)}).encode() + b"\n"

    @classmethod
    def from_line(cls, line: bytes, url: str) -> Greeting:
        """Read the line that something at `url` greeted with; ConfigurationError if it is no lab of ours."""
        try:
            said = dict(json.loads(line))
        except (ValueError, TypeError):
            said = {}
        if said.get("protocol") != PROTOCOL or said.get("version") != VERSION:
            raise ConfigurationError(
                "what answers at the clock URL is not an emulated lab of this version",
                where=url,
                found=repr(line[:80]),
                expected=f"{PROTOCOL} version {VERSION}",
                remedy="check the port, and that lab and bench are the same release",
            )
        return cls(tuple(said["ports"]), int(said["now_ns"]), said.get("cpu"), said.get("emulated"))


class LabTime(Protocol):
    """A lab as the bench's clock knows it: it has ports, and moves when it is asked."""

    @property
    def greeting(self) -> Greeting:
        """What the lab says of itself now."""

    def step(self, request: Request, make_room: MakeRoom) -> Reply:
        """Take what the bench wrote, move time, write what the devices sent.

        `make_room` is called while a port is full. BenchError: what the lab failed of; LinkLost: it is gone.
        """

    def leave(self) -> None:
        """Let go of the lab: its ports are shut, the next bench may come."""


_here: dict[str, Callable[[], LabTime]] = {}
"""Labs of this process by their clock URL."""
_numbers = itertools.count(1)


def offer(enter: Callable[[], LabTime]) -> str:
    """Return the clock URL by which a lab of this process is found; `enter` is called for each bench."""
    url = f"{_SCHEME}/process-{os.getpid()}/{next(_numbers)}/clock"
    _here[url] = enter
    return url


def withdraw(url: str) -> None:
    """Take a lab of this process back."""
    _here.pop(url, None)


def connect(url: str) -> LabTime:
    """Return the lab at a clock URL; ConfigurationError if there is none, or it is no lab of this version."""
    return _here[url]() if url in _here else _MessagedLab(url)


def lab_lost(url: str, cause: object) -> LinkLost:
    """Return the error that says that the lab is gone."""
    return LinkLost(
        "the emulated lab is gone",
        where=url,
        found=str(cause),
        expected="a lab that answers every step",
        remedy="look at the lab's own output and start it again",
    )


def lab_failed(text: str) -> BenchError:
    """Return the error that says what the lab failed of."""
    return BenchError(f"the emulated lab failed: {text}")


class Codec:
    """Packs and unpacks the messages for a given number of ports."""

    def __init__(self, n_ports: int) -> None:
        self._request = struct.Struct(f"<qqh{n_ports}q")
        self._head = struct.Struct(f"<q{n_ports}qI")
        self.request_size = self._request.size
        self.head_size = self._head.size

    def pack_request(self, request: Request) -> bytes:
        """Return the bytes of a request."""
        at_ns, to_ns, stop_port, sent = request
        return self._request.pack(at_ns, to_ns, stop_port, *sent)

    def unpack_request(self, data: bytes) -> Request:
        """Return the request in `data` (exactly `request_size` bytes)."""
        at_ns, to_ns, stop_port, *sent = self._request.unpack(data)
        return at_ns, to_ns, stop_port, sent

    def pack_reply(self, reply: Reply) -> bytes:
        """Return the bytes of a reply."""
        now_ns, written, marks = reply
        head = self._head.pack(now_ns, *written, len(marks))
        return head + b"".join(_MARK.pack(*mark) for mark in marks)

    def unpack_reply(self, data: bytes) -> Reply | None:
        """Return the reply in `data`, or None while incomplete; BenchError on an error reply."""
        if len(data) >= _ERROR.size and data[:8] == b"\xff" * 8:
            _, length = _ERROR.unpack_from(data)
            if len(data) < _ERROR.size + length:
                return None
            raise lab_failed(data[_ERROR.size :].decode(errors="replace"))
        if len(data) < self.head_size:
            return None
        now_ns, *written, n_marks = self._head.unpack_from(data)
        if len(data) < self.head_size + n_marks * _MARK.size:
            return None
        marks = list(_MARK.iter_unpack(data[self.head_size : self.head_size + n_marks * _MARK.size]))
        return int(now_ns), written, marks

    @staticmethod
    def pack_error(text: str) -> bytes:
        """Return the bytes of an error reply."""
        encoded = text.encode()
        return _ERROR.pack(-1, len(encoded)) + encoded


class _MessagedLab:
    """A lab of another process, at the Unix socket `virtual://PATH` or at `virtual://HOST:PORT/WORD`."""

    def __init__(self, url: str) -> None:
        self.url = url
        place = url.removeprefix(_SCHEME)
        by_path = place.startswith("/")
        try:
            self._socket = _at_path(place) if by_path else _at_port(place)
        except (OSError, ValueError) as error:
            raise ConfigurationError(
                "no emulated lab answers at the clock URL",
                where=url,
                found=str(error),
                expected="virtual:///... as printed by `gyrobench lab --virtual`",
                remedy="start the lab first, or remove `clock` from the bench file to use the wall clock",
            ) from error
        try:
            self.greeting = Greeting.from_line(self._line(), url)
        except BaseException:
            self._socket.close()
            raise
        self._codec = Codec(len(self.greeting.ports))
        if not by_path:  # the time-out of the socket is the watchdog
            return
        # One blocking read a step; the kernel's own time-out is the watchdog.
        self._socket.settimeout(None)
        watchdog = struct.pack("@ll", int(WATCHDOG_S), 0)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, watchdog)

    def step(self, request: Request, make_room: MakeRoom) -> Reply:
        """Send a request and wait for its reply (see `LabTime`)."""
        try:
            self._socket.send(self._codec.pack_request(request))
        except OSError as error:
            raise lab_lost(self.url, error) from error
        reply = self._receive()
        if reply.startswith(FULL):
            reply = reply[len(FULL) :]
            while not reply:
                reply = self._receive() if make_room(self._socket.fileno(), READABLE) else b""
        while (unpacked := self._codec.unpack_reply(reply)) is None:
            reply += self._receive()
        return unpacked

    def leave(self) -> None:
        """Hang up."""
        self._socket.close()

    def _line(self) -> bytes:
        line = b""
        while not line.endswith(b"\n"):
            data = self._socket.recv(1)
            if not data:
                break
            line += data
        return line

    def _receive(self) -> bytes:
        try:
            data = self._socket.recv(65536)
        except (BlockingIOError, TimeoutError):
            raise lab_lost(self.url, f"it said nothing for {WATCHDOG_S:g} s") from None
        except OSError as error:
            raise lab_lost(self.url, error) from error
        if not data:
            raise lab_lost(self.url, "it hung up")
        return data


def _at_path(place: str) -> socket.socket:
    if not hasattr(socket, "AF_UNIX"):
        raise OSError("this system has no Unix sockets")
    connection = socket.socket(socket.AF_UNIX)
    connection.settimeout(WATCHDOG_S)
    try:
        connection.connect(place)
    except BaseException:
        connection.close()
        raise
    return connection


def _at_port(place: str) -> socket.socket:
    address, _, word = place.partition("/")
    host, _, port = address.rpartition(":")
    connection = socket.create_connection((host, int(port)), timeout=WATCHDOG_S)
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.sendall(word.encode() + b"\n")
    return connection
