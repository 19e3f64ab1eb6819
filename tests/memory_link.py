"""A driver without a port: a link in memory that is its own clock, with a device at its other end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from drivers.base.clock import Clock, Readable
from drivers.kit.kinds import Connection, Exchange
from drivers.kit.link import Link
from simulators.interfaces import Emulator, GyroSignal, Reply, StreamingEmulator

Answer = Callable[[bytes, float], list[tuple[float, bytes]]]
"""(bytes written, now in s) -> (time in s, bytes) of what comes back."""


@dataclass
class TurningPlant:
    """A unit turning at 10 deg/s about its axis at 30 degC."""

    axes: str = "x"

    def measure(self, start_s: float, count: int, period_s: float) -> GyroSignal:
        angle = np.full((count, len(self.axes)), np.radians(10.0) * period_s)
        return GyroSignal(self.axes, angle, np.full(count, 30.0))

    def case_reading_c(self, now_s: float) -> float:
        return 28.0


class ChamberPlant:
    """A chamber that reaches every set point at once while it runs."""

    def __init__(self) -> None:
        self.demands: list[tuple[float, float, float, bool]] = []
        self.set_point = 23.0
        self.air = 21.98765

    def demand(
        self, now_s: float, *, set_point_c: float, ramp_up: float, ramp_down: float, running: bool
    ) -> None:
        self.demands.append((set_point_c, ramp_up, ramp_down, running))
        self.set_point = set_point_c
        self.air = set_point_c if running else self.air

    def air_temp_c(self, now_s: float) -> float:
        return self.air

    def set_point_c(self, now_s: float) -> float:
        return self.set_point

    def auxiliary_c(self, number: int, now_s: float) -> float:
        return 10.0 * number + 0.1234


class OpenConnection(Connection):
    """A connection whose link is open already."""

    def __init__(self, link: Link, safe_set_point_c: float = 23.0) -> None:
        super().__init__(link.name, link.clock, None, safe_set_point_c)
        vars(self)["opened"] = link

    def link(self, port: str | None, baudrate: int, **serial: Any) -> Link:
        return cast(Link, vars(self)["opened"])


class MemoryLink(Link):
    """A link with a device at its other end instead of a port; it is its own clock.

    `device`: an emulator, or a function that answers. Time goes from one reply to the next, with a streaming
    device in steps of `step_s`. `pending`: replies on their way; `exchanges`: all bytes of both directions.
    """

    def __init__(self, device: Emulator | Answer, name: str = "port", step_s: float = 0.01) -> None:
        self.url, self.name, self.tap = "memory", name, None
        self.clock = cast(Clock, self)
        self.streaming = False
        self.bytes_received = self.bytes_sent = 0
        self._buffer = bytearray()
        self.device = device if hasattr(device, "receive") else None
        self.answer: Answer = self._emulated if hasattr(device, "receive") else device
        self.now_s = 0.0
        self._step_s = step_s if hasattr(device, "stream") else float("inf")
        self.pending: list[tuple[float, bytes]] = []
        self.exchanges: list[Exchange] = []
        self.sent = self.raw = b""

    def _emulated(self, data: bytes, now_s: float) -> list[tuple[float, bytes]]:
        replies: list[Reply] = cast(Emulator, self.device).receive(data, now_s)
        return [(reply.at_s, reply.data) for reply in replies]

    def write(self, data: bytes) -> None:
        self.sent += data
        self.exchanges.append((round(self.now_s * 1e9), "sent", data))
        self.pending += self.answer(data, self.now_s)

    def deliver(self, data: bytes, arrival_s: float) -> None:
        self.raw += data
        self.exchanges.append((round(arrival_s * 1e9), "received", data))
        super().deliver(data, arrival_s)

    def discard(self) -> bytes:
        self.advance(self.now_s)
        return super().discard()

    def now(self) -> float:
        return self.now_s

    def sleep(self, duration_s: float) -> None:
        self.advance(self.now_s + duration_s)

    def wait_for(self, port: Readable, deadline_s: float) -> bool:
        before = len(self.raw)
        self.advance(self.now_s)
        while len(self.raw) == before and self.now_s < deadline_s:
            due_s = min((at_s for at_s, _ in self.pending), default=deadline_s)
            self.advance(min(deadline_s, max(due_s, self.now_s), self.now_s + self._step_s))
        return len(self.raw) > before

    def attach(self, port: Readable) -> None:
        raise AssertionError("not called")

    detach = attach

    def advance(self, to_s: float) -> None:
        self.now_s = to_s
        if hasattr(self.device, "stream"):
            block = cast(StreamingEmulator, self.device).stream(to_s)
            if block is not None and block.data:
                self.deliver(block.data, int(block.marks[-1, 1]) * 1e-9)
        for at_s, data in [reply for reply in self.pending if reply[0] <= to_s]:
            self.pending.remove((at_s, data))
            self.deliver(data, max(at_s, self._discarded_s))


def scripted(*replies: bytes, delay_s: float = 0.01) -> MemoryLink:
    """Return a link to a device that answers the n-th write with the n-th entry, whatever was asked; nothing is
    asked again there.
    """
    queue = list(replies)
    link = MemoryLink(lambda data, now_s: [(now_s + delay_s, queue.pop(0))] if queue else [])
    link.retries = 0
    return link


class Fake:
    """Something on the port that answers each line by a function."""

    def __init__(self, answer: Callable[[bytes], bytes]) -> None:
        self.answer = answer
        self.lines: list[bytes] = []

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        self.lines.append(data)
        return [Reply(now_s + 0.01, self.answer(data))]
