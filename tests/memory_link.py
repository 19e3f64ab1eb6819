"""A gyro's driver without a port: a link in memory that is its own clock, with a device at its other end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import cast

import numpy as np

from drivers.clock import Clock, Readable
from drivers.link import Link
from simulators.interfaces import Emulator, GyroSignal, Reply, StreamingEmulator


@dataclass
class TurningPlant:
    """A unit turning at 10 deg/s about its axis at 30 degC."""

    axes: str = "x"

    def measure(self, start_s: float, count: int, period_s: float) -> GyroSignal:
        angle = np.full((count, len(self.axes)), np.radians(10.0) * period_s)
        return GyroSignal(self.axes, angle, np.full(count, 30.0))

    def case_reading_c(self, now_s: float) -> float:
        return 28.0


class MemoryLink(Link):
    """A link with a device at its other end instead of a port; it is its own clock, in steps of 10 ms."""

    def __init__(self, device: Emulator) -> None:
        self.url, self.name, self.tap = "memory", "gyro", None
        self.clock = cast(Clock, self)
        self.streaming = False
        self.bytes_received = self.bytes_sent = 0
        self._buffer = bytearray()
        self.device = device
        self.now_s = 0.0
        self.due: list[Reply] = []
        self.sent = b""
        self.raw = b""

    def write(self, data: bytes) -> None:
        self.sent += data
        self.due += self.device.receive(data, self.now_s)

    def deliver(self, data: bytes, arrival_s: float) -> None:
        self.raw += data
        super().deliver(data, arrival_s)

    def now(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        self.advance(self.now_s + duration_s)

    def wait_for(self, port: Readable, deadline_s: float) -> bool:
        while self.now_s < deadline_s:
            before = len(self.raw)
            self.advance(min(deadline_s, self.now_s + 0.01))
            if len(self.raw) > before:
                return True
        return False

    def attach(self, port: Readable) -> None:
        raise AssertionError("not called")

    detach = attach

    def advance(self, to_s: float) -> None:
        self.now_s = to_s
        if hasattr(self.device, "stream"):
            block = cast(StreamingEmulator, self.device).stream(to_s)
            if block is not None:
                self.deliver(block.data, int(block.marks[-1, 1]) * 1e-9)
        for reply in [reply for reply in self.due if reply.at_s <= to_s]:
            self.due.remove(reply)
            self.deliver(reply.data, reply.at_s)


class Fake:
    """Something on the port that answers each line by a function."""

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        self.answer = answer
        self.lines: list[bytes] = []

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        self.lines.append(data)
        return [Reply(now_s + 0.01, self.answer(data))]
