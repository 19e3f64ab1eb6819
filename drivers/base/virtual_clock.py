"""The clock of an emulated lab: lab time moves only when the bench asks, and only after every byte was read.

Wire format (TCP, little-endian). The lab greets with one JSON line: {"protocol": "gyrobench-clock",
"version": 1, "ports": [names], "now_ns": t, "cpu": n or null, "emulated": {"seed": n, "model": text} or null}.
Then lock-step:

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

import contextlib
import json
import os
import select
import socket
import struct
from collections import deque
from dataclasses import dataclass
from typing import Any

from drivers.base.clock import Interrupt, OnLoss, Readable, tell_failures
from drivers.base.errors import BenchError, ConfigurationError, LinkLost

PROTOCOL = "gyrobench-clock"
VERSION = 1
NOT_OPEN = -1
_SCHEME = "virtual://"
FULL = struct.pack("<q", -2)
_MARK = struct.Struct("<hqq")
_ERROR = struct.Struct("<qI")
_WATCHDOG_S = 60.0
"""Wall time after which a lab that says nothing is taken for hung."""
_LONGEST_STEP_NS = 64_000_000_000
"""Longer sleeps are cut, so that the bytes of one step stay few."""


@dataclass(frozen=True)
class Request:
    """One request of the bench."""

    at_ns: int
    to_ns: int
    stop_port: int
    sent: tuple[int, ...]


class Codec:
    """Packs and unpacks the messages for a given number of ports."""

    def __init__(self, n_ports: int) -> None:
        self._request = struct.Struct(f"<qqh{n_ports}q")
        self._head = struct.Struct(f"<q{n_ports}qI")
        self.request_size = self._request.size
        self.head_size = self._head.size

    def pack_request(self, at_ns: int, to_ns: int, stop_port: int, sent: list[int]) -> bytes:
        """Return the bytes of a request."""
        return self._request.pack(at_ns, to_ns, stop_port, *sent)

    def unpack_request(self, data: bytes) -> Request:
        """Return the request in `data` (exactly `request_size` bytes)."""
        at_ns, to_ns, stop_port, *sent = self._request.unpack(data)
        return Request(at_ns, to_ns, stop_port, tuple(sent))

    def pack_reply(self, now_ns: int, written: list[int], marks: list[tuple[int, int, int]]) -> bytes:
        """Return the bytes of a reply; marks are (port, written, t_ns) in time order per port."""
        head = self._head.pack(now_ns, *written, len(marks))
        return head + b"".join(_MARK.pack(*mark) for mark in marks)

    def unpack_reply(self, data: bytes) -> tuple[int, list[int], list[tuple[int, int, int]]] | None:
        """Return (now_ns, written, marks), or None while incomplete; BenchError on an error reply."""
        if len(data) >= _ERROR.size and data[:8] == b"\xff" * 8:
            _, length = _ERROR.unpack_from(data)
            if len(data) < _ERROR.size + length:
                return None
            raise BenchError(f"the emulated lab failed: {data[_ERROR.size :].decode(errors='replace')}")
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
    """Bench time served by an emulated lab at `virtual://PATH`, a Unix socket."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(_WATCHDOG_S)
        try:
            self._socket.connect(url.removeprefix(_SCHEME))
        except OSError as error:
            self._socket.close()
            raise ConfigurationError(
                "no emulated lab answers at the clock URL",
                where=url,
                found=str(error),
                expected="virtual:///... as printed by `gyrobench lab --virtual`",
                remedy="start the lab first, or remove `clock` from the bench file to use the wall clock",
            ) from error
        try:
            greeting = self._greeting()
        except BaseException:
            self._socket.close()
            raise
        self.interrupt = Interrupt()
        self._names: list[str] = list(greeting["ports"])
        self.emulated: dict[str, Any] | None = greeting.get("emulated")
        """What the lab says it emulates: seed and model."""
        self._affinity = share_cpu(greeting.get("cpu"))
        self._origin_ns = int(greeting["now_ns"])
        """Lab time at which this bench came; its own time begins at 0, however long the lab has been served."""
        self._now_ns = 0
        self._lab_ns = 0
        """Bench time that the lab has reached: behind while the bench idles."""
        self._codec = Codec(len(self._names))
        self._ports: list[Readable | None] = [None] * len(self._names)
        self._pending: list[bytearray] = [bytearray() for _ in self._names]
        self._by_descriptor: dict[int, int] = {}
        self._released: set[int] = set()
        """Ports closed since the last request."""
        self._failures: deque[tuple[BenchError, OnLoss | None]] = deque()
        self._lost_calls: dict[int, OnLoss | None] = {}
        self._left: dict[int, tuple[Readable, bytearray]] = {}
        """Ports that went away in this step, and what came before it."""
        # One blocking read a step; the kernel's own time-out is the watchdog.
        self._socket.settimeout(None)
        watchdog = struct.pack("@ll", int(_WATCHDOG_S), 0)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, watchdog)
        self._poll = select.poll()
        self._poll.register(self._socket, select.POLLIN)

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
        self._poll.register(port.fileno(), select.POLLIN)

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
        """Hang up, and run on any processor again."""
        if self._affinity:
            os.sched_setaffinity(0, self._affinity)
        self._socket.close()
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

    def _greeting(self) -> dict[str, Any]:
        line = b""
        while not line.endswith(b"\n"):
            data = self._socket.recv(1)
            if not data:
                break
            line += data
        try:
            greeting = dict(json.loads(line))
        except (ValueError, TypeError):
            greeting = {}
        if greeting.get("protocol") != PROTOCOL or greeting.get("version") != VERSION:
            raise ConfigurationError(
                "what answers at the clock URL is not an emulated lab of this version",
                where=self.url,
                found=repr(line[:80]),
                expected=f"{PROTOCOL} version {VERSION}",
                remedy="check the port, and that lab and bench are the same release",
            )
        result: dict[str, Any] = greeting
        return result

    def _advance(self, to_ns: int, stop_port: int) -> None:
        self._released.clear()
        sent = [NOT_OPEN if port is None else port.bytes_sent for port in self._ports]
        try:
            at_ns = self._now_ns + self._origin_ns
            self._socket.send(self._codec.pack_request(at_ns, to_ns + self._origin_ns, stop_port, sent))
        except OSError as error:
            raise self._lost(error) from error
        now_ns, written, marks = self._collect()
        for index, port in enumerate(self._ports):
            while port is not None and port is self._ports[index] and port.bytes_received < written[index]:
                if not self._take(index):
                    self._await_bytes()
            if port is not None and port is self._ports[index] and written[index] == NOT_OPEN:
                self._take(index)  # meets the end of it: LinkLost, once this step is over
                if port is self._ports[index]:
                    raise self._lost(f"it says that port {port.name} is gone, which still reads")
        self._now_ns = self._lab_ns = now_ns - self._origin_ns
        self._hand_over(marks)
        tell_failures(self._failures)

    def _collect(self) -> tuple[int, list[int], list[tuple[int, int, int]]]:
        """Wait for the lab's reply. The ports are read after it, or meanwhile if the lab finds one full."""
        reply = self._receive()
        if reply.startswith(FULL):
            reply = reply[len(FULL) :]
            while not reply:
                reply = self._receive() if self._await_bytes() else b""
        while (unpacked := self._codec.unpack_reply(reply)) is None:
            reply += self._receive()
        return unpacked

    def _receive(self) -> bytes:
        try:
            data = self._socket.recv(65536)
        except BlockingIOError:
            raise self._lost(f"it said nothing for {_WATCHDOG_S:g} s") from None
        except OSError as error:
            raise self._lost(error) from error
        if not data:
            raise self._lost("it hung up")
        return data

    def _await_bytes(self) -> bool:
        """Wait for any byte; read the ports that have some; say whether the lab's reply has come."""
        ready = self._poll.poll(_WATCHDOG_S * 1e3)
        if not ready:
            raise self._lost(f"it said nothing for {_WATCHDOG_S:g} s")
        replied = False
        for descriptor, _ in ready:
            index = self._by_descriptor.get(descriptor)
            if index is None:
                replied = True
            else:
                self._take(index)
        return replied

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

    def _hand_over(self, marks: list[tuple[int, int, int]]) -> None:
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

    def _lost(self, cause: object) -> LinkLost:
        return LinkLost(
            "the emulated lab is gone",
            where=self.url,
            found=str(cause),
            expected="a lab that answers every step",
            remedy="look at the lab's own output and start it again",
        )
