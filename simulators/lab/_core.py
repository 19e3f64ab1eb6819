"""The lab itself: ports, emulators and plant moved together through lab time, one event at a time."""

from __future__ import annotations

import heapq
import math
from collections.abc import Mapping, Sequence, Set
from typing import Protocol

from drivers.base.errors import ConfigurationError
from drivers.kit.config import Parity
from simulators.config import SerialFormat
from simulators.faults import VANISH, Fault
from simulators.interfaces import Emulator, StreamingEmulator
from simulators.lab._adapter import Adapter
from simulators.lab._line import Line
from simulators.lab._ports import Port
from simulators.lab._uart import block_to_bench, to_bench, to_device

_NEVER_NS = 1 << 62
_NOBODY: frozenset[int] = frozenset()

Mark = tuple[int, int, int]
"""(port index, bytes written to it so far, lab time in ns of the last of them)."""


class Plant(Protocol):
    """The physics behind the emulators."""

    def advance(self, to_s: float) -> None:
        """Move the physics to lab time `to_s`."""


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
        lines: Mapping[str, Line] | None = None,
        formats: Mapping[str, SerialFormat] | None = None,
        parities: Mapping[str, Parity] | None = None,
        adapters: Mapping[str, Adapter] | None = None,
    ) -> None:
        self.now_ns = 0
        self.ports = list(ports)
        self.lines = dict(lines or {})
        self._formats = dict(formats or {})
        """Devices, by port, that understand only what is sent with their own serial settings."""
        self._parities = dict(parities or {})
        """What the bench's drivers set, by port: a terminal does not know."""
        self._adapters = dict(adapters or {})
        """Adapters, by port, that hand streams over in batches."""
        self._active = self._active_lines()
        self._plant = plant
        self._emulators = [emulators[port.name] for port in ports]
        self._streams = [(i, streams[port.name]) for i, port in enumerate(ports) if port.name in streams]
        self._delivery_ns = round(delivery_s * 1e9)
        self._delivered_s = [0.0] * len(self.ports)
        self._replies: list[tuple[int, int, int, bytes]] = []
        self._sequence = 0
        self._gone: dict[int, int] = {}
        """Ports that have vanished: index -> lab time in ns at which they come back."""
        self._to_unplug: list[int] = []

    def take_input(self, index: int, data: bytes) -> None:
        """Give a device what the bench wrote, now; its replies are put on the calendar."""
        if index in self._gone:
            return
        line = self._active.get(index)
        if line is not None:
            data = line.command(data, self.now_ns / 1e9)
        if (ends := self._ends(index)) and not (data := to_device(data, *ends)):
            return
        for reply in self._emulators[index].receive(data, self.now_ns / 1e9):
            passed = reply if line is None else line.reply(reply)
            if passed is not None:
                at_ns = max(self.now_ns, round(passed.at_s * 1e9))
                heapq.heappush(self._replies, (at_ns, self._sequence, index, passed.data))
                self._sequence += 1

    def open(self, index: int) -> None:
        """Let the bench have a port from now on: what its device streamed while it was shut is gone."""
        for streaming, emulator in self._streams:
            if streaming == index:
                self._deliver(index, emulator, [])
        self.ports[index].open()

    def advance(self, to_ns: int, stop_port: int = -1) -> list[Mark]:
        """Move to `to_ns`, or to the first byte written to port `stop_port`, or to where a port vanishes.

        Returns what was written when.
        """
        marks: list[Mark] = []
        while True:
            next_delivery = (self.now_ns // self._delivery_ns + 1) * self._delivery_ns
            next_reply = self._replies[0][0] if self._replies else to_ns
            next_event = self._next_event_ns() if self._active else _NEVER_NS
            self.now_ns = max(self.now_ns, min(to_ns, next_delivery, next_reply, next_event))
            now_ns = self.now_ns
            self._plant.advance(now_ns / 1e9)
            stop = False
            if next_event <= now_ns:
                stop = self._strike(marks)
            if now_ns == next_delivery:
                for index, emulator in self._streams:
                    if self._deliver(index, emulator, marks):
                        stop = stop or index == stop_port
            while self._replies and self._replies[0][0] <= now_ns:
                _, _, index, data = heapq.heappop(self._replies)
                port = self.ports[index]
                if port.is_open and index not in self._gone:
                    if (ends := self._ends(index)) and not (data := to_bench(data, *ends)):
                        continue
                    port.write(data)
                    marks.append((index, port.written, now_ns))
                    if (adapter := self._adapters.get(port.name)) is not None:
                        adapter.answered(now_ns / 1e9)
                    stop = stop or index == stop_port
            if stop or now_ns >= to_ns:
                return marks

    def inject(self, fault: Fault) -> None:
        """Put a fault on a line while the lab runs; ConfigurationError if there is no such port."""
        if fault.port not in self.lines:
            raise ConfigurationError(
                "the lab has no such port", found=repr(fault.port), expected="one of " + ", ".join(self.lines)
            )
        port = next(port for port in self.ports if port.name == fault.port)
        if fault.kind == VANISH and not port.returns:
            raise ConfigurationError(
                "a serial port that vanishes must be known to do so before the lab starts",
                where=fault.port,
                found="a fault put in while the lab runs",
                expected="a [[fault]] of kind 'vanish' for this port in the plant file",
            )
        self.lines[fault.port].add(fault)
        self._active = self._active_lines()

    def exchange(self, name: str, emulator: StreamingEmulator) -> None:
        """Put another streaming emulator on a port, from now on."""
        index = next(index for index, port in enumerate(self.ports) if port.name == name)
        self._emulators[index] = emulator
        self._streams = [(at, emulator if at == index else other) for at, other in self._streams]
        if name in self.lines:
            self.lines[name].device_faults.update(getattr(emulator, "faults", {}))

    def settle(self) -> Set[int]:
        """Hang up the ports that vanished in the last step, now that the bench has read what came before.

        Returns the ports that nobody can have open at the moment, those hung up just now included.
        """
        if not self._gone and not self._to_unplug:
            return _NOBODY
        hung_up = set(self._to_unplug) | set(self._gone)
        for index in self._to_unplug:
            self.ports[index].unplug()
        self._to_unplug.clear()
        self._plug_again()
        return hung_up

    def _ends(self, index: int) -> tuple[SerialFormat, SerialFormat] | None:
        """Return how bench and device have set a port, None where any setting does.

        A terminal tells the bench's baud rate only; the driver's parity is known, the rest is 8 bits, 1 stop bit.
        """
        port = self.ports[index]
        device = self._formats.get(port.name)
        baudrate = port.baudrate() if device is not None and port.is_open else 0
        if device is None or not baudrate:
            return None
        return SerialFormat(baudrate, parity=self._parities.get(port.name, "N")), device

    def _active_lines(self) -> dict[int, Line]:
        lines = ((index, self.lines.get(port.name)) for index, port in enumerate(self.ports))
        return {index: line for index, line in lines if line is not None and line.active}

    def _next_event_ns(self) -> int:
        """Return when a device or port is struck, or a port comes back; far away if never."""
        times = [line.next_event_s for line in self._active.values()]
        soonest = min(times, default=math.inf)
        events = [back_ns for index, back_ns in self._gone.items() if index not in self._to_unplug]
        if soonest < math.inf:
            events.append(math.ceil(soonest * 1e9))
        return min(events, default=_NEVER_NS)

    def _strike(self, marks: list[Mark]) -> bool:
        """Carry out what is due on devices and ports; say whether a port vanished, which ends the step."""
        vanished = False
        now_s = self.now_ns / 1e9
        for index, line in self._active.items():
            if line.next_event_s == math.inf or math.ceil(line.next_event_s * 1e9) > self.now_ns:
                continue
            for streaming, emulator in self._streams:
                if streaming == index:  # what was sent before was sent by a sound device
                    self._deliver(index, emulator, marks)
            gone_s = line.strike(now_s)
            if gone_s and index not in self._gone:
                self._gone[index] = self.now_ns + round(gone_s * 1e9)
                self._to_unplug.append(index)
                vanished = True
        self._plug_again()
        return vanished

    def _plug_again(self) -> None:
        for index, back_ns in list(self._gone.items()):
            if back_ns <= self.now_ns and index not in self._to_unplug:
                del self._gone[index]
                self.ports[index].plug()

    def _deliver(self, index: int, emulator: StreamingEmulator, marks: list[Mark]) -> bool:
        """Write what a device has streamed to its port; say whether anything came."""
        port, line, now_s = self.ports[index], self._active.get(index), self.now_ns / 1e9
        block = emulator.stream(now_s)
        is_open = port.is_open and index not in self._gone
        since_s, self._delivered_s[index] = self._delivered_s[index], now_s
        if line is not None:
            if is_open:
                block = line.block(block, since_s, now_s)
            else:
                line.pass_over(now_s)
        if is_open and block is not None and block.data and (ends := self._ends(index)):
            block = block_to_bench(block, *ends)
        if (adapter := self._adapters.get(port.name)) is not None:
            if is_open:
                block = adapter.block(block, since_s, now_s)
            else:
                adapter.clear()
        if not is_open or block is None or not block.data:
            return False
        before = port.written
        port.write(block.data)
        marks.extend((index, before + int(count), int(time_ns)) for count, time_ns in block.marks)
        return True
