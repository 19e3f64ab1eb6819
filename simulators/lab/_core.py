"""The lab itself: ports, emulators and plant moved together through lab time, one event at a time."""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from typing import Protocol

from simulators.interfaces import Emulator, StreamBlock, StreamingEmulator
from simulators.lab._ports import Port

Mark = tuple[int, int, int]
"""(port index, bytes written to it so far, lab time in ns of the last of them)."""


class Plant(Protocol):
    """The physics behind the emulators."""

    def advance(self, to_s: float) -> None:
        """Move the physics to lab time `to_s`."""
        ...


class Lab:
    """Devices on ports, moved through lab time.

    Replies leave at the instant their emulator says; streams are delivered every `delivery_s` seconds (an
    adapter hands over blocks, not bytes), with marks that carry the exact times.
    """

    def __init__(
        self,
        plant: Plant,
        ports: Sequence[Port],
        emulators: Mapping[str, Emulator],
        streams: Mapping[str, StreamingEmulator],
        *,
        delivery_s: float,
    ) -> None:
        self.now_ns = 0
        self.ports = list(ports)
        self._plant = plant
        self._emulators = [emulators[port.name] for port in ports]
        self._streams = [(i, streams[port.name]) for i, port in enumerate(ports) if port.name in streams]
        self._delivery_ns = round(delivery_s * 1e9)
        self._replies: list[tuple[int, int, int, bytes]] = []
        self._sequence = 0

    def take_input(self, index: int, data: bytes) -> None:
        """Give a device what the bench wrote, now; its replies are put on the calendar."""
        for reply in self._emulators[index].receive(data, self.now_ns / 1e9):
            at_ns = max(self.now_ns, round(reply.at_s * 1e9))
            heapq.heappush(self._replies, (at_ns, self._sequence, index, reply.data))
            self._sequence += 1

    def advance(self, to_ns: int, stop_port: int = -1) -> list[Mark]:
        """Move to `to_ns`, or to the first byte written to port `stop_port`; return what was written when."""
        marks: list[Mark] = []
        while True:
            next_delivery = (self.now_ns // self._delivery_ns + 1) * self._delivery_ns
            next_reply = self._replies[0][0] if self._replies else to_ns
            self.now_ns = min(to_ns, next_delivery, next_reply)
            self._plant.advance(self.now_ns / 1e9)
            stop = False
            if self.now_ns == next_delivery:
                for index, emulator in self._streams:
                    block = emulator.stream(self.now_ns / 1e9)
                    if block is not None and block.data:
                        self._deliver(index, block, marks)
                        stop = stop or index == stop_port
            while self._replies and self._replies[0][0] <= self.now_ns:
                _, _, index, data = heapq.heappop(self._replies)
                port = self.ports[index]
                if port.is_open:
                    port.write(data)
                    marks.append((index, port.written, self.now_ns))
                    stop = stop or index == stop_port
            if stop or self.now_ns >= to_ns:
                return marks

    def _deliver(self, index: int, block: StreamBlock, marks: list[Mark]) -> None:
        port = self.ports[index]
        if not port.is_open:
            return
        before = port.written
        port.write(block.data)
        marks.extend((index, before + int(count), int(time_ns)) for count, time_ns in block.marks)
