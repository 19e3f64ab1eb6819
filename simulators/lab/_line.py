"""The line between an emulator and its port: where bytes get lost, doubled, late and wrong."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from simulators.faults import COMMAND_FAULTS, VANISH, WIRE_FAULTS, DeviceFault, Fault, WireShape
from simulators.interfaces import Reply, StreamBlock
from simulators.plant.noise import NoiseSource

_NS = 1e-9
"""Lab time counts whole ns: an instant less than one ahead has come."""


class Schedule:
    """The instants of one fault in lab time, in order; independent of the bytes and of other faults."""

    def __init__(self, fault: Fault, source: NoiseSource) -> None:
        self._fault = fault
        self._listed = sorted(fault.at_s)
        self._generator = source.generator(0)
        self._next_s = fault.start_s
        self._step()

    @property
    def next_s(self) -> float:
        """The next instant, inf if there is none."""
        return self._next_s

    def take_until(self, time_s: float) -> float | None:
        """Pass every instant up to `time_s` and return the first, None if there was none."""
        if self._next_s > time_s:
            return None
        first = self._next_s
        while self._next_s <= time_s:
            self._step()
        return first

    def _step(self) -> None:
        fault = self._fault
        if fault.rate_per_h:
            self._next_s += float(self._generator.exponential(3600.0 / fault.rate_per_h))
            if self._next_s > fault.end_s:
                self._next_s = math.inf
        else:
            self._next_s = self._listed.pop(0) if self._listed else math.inf


class Line:
    """One port's line with its faults.

    Everything random comes from (`seed`, port, place of the fault in the list), so the same lab driven the same
    way gives the same bytes. `struck` lists what happened: time in s, port, kind, and what it did.
    """

    def __init__(
        self,
        port: str,
        faults: Sequence[Fault],
        *,
        seed: int,
        wire: WireShape | None,
        device_faults: Mapping[str, DeviceFault],
        texts: Mapping[str, Collection[str]] | None = None,
    ) -> None:
        self.port = port
        self.active = False
        """Whether there is any fault on it."""
        self.struck: list[dict[str, Any]] = []
        self._seed = seed
        self._wire = wire or WireShape()
        self.device_faults = dict(device_faults)
        self._texts = texts
        self._on_wire: list[tuple[Fault, Schedule, np.random.Generator]] = []
        self._on_command: list[tuple[Fault, Schedule, np.random.Generator]] = []
        self._on_device: list[tuple[Fault, Schedule]] = []
        self._quiet_until_s = self._late_until_s = -math.inf
        self._still_to_lose = 0
        self._held = b""
        self._number = 0
        for fault in faults:
            self.add(fault)

    def add(self, fault: Fault) -> None:
        """Put one more fault on the line; ConfigurationError if the port cannot have it."""
        fault.check(self.device_faults, self._wire, self._texts)
        self.active = True
        source = NoiseSource(self._seed, f"fault of {self.port}", 2 * self._number)
        self._number += 1
        schedule = Schedule(fault, source)
        if fault.kind in WIRE_FAULTS or fault.kind in COMMAND_FAULTS:
            where = source.substream(source.stream + 1).generator(0)
            faults = self._on_wire if fault.kind in WIRE_FAULTS else self._on_command
            faults.append((fault, schedule, where))
        else:
            self._on_device.append((fault, schedule))

    # The device itself and its port

    @property
    def next_event_s(self) -> float:
        """When the device or its port, rather than a message, is struck next; inf if never."""
        return min((schedule.next_s for _, schedule in self._on_device), default=math.inf)

    def strike(self, now_s: float) -> float:
        """Let the device have what is due at `now_s`; return how long its port vanishes, 0 if it stays."""
        gone_s = 0.0
        for fault, schedule in self._on_device:
            if schedule.take_until(now_s + _NS) is None:
                continue
            if fault.kind == VANISH:
                gone_s = max(gone_s, fault.duration_s)
                self._say(now_s, fault, f"for {fault.duration_s:g} s")
            else:
                self.device_faults[fault.kind](fault, now_s)
                self._say(now_s, fault, fault.text)
        return gone_s

    # What the bench writes

    def command(self, data: bytes, now_s: float) -> bytes:
        """Return what the bench wrote at `now_s` as the device gets it."""
        for fault, schedule, where in self._on_command:
            if schedule.take_until(now_s) is not None:
                data = self._edited(fault, data, where, now_s)
        return data

    # Replies

    def reply(self, reply: Reply) -> Reply | None:
        """Return a reply as it comes out of the line, None if nothing does. Nothing overtakes."""
        data, at_s = reply.data, max(reply.at_s, self._late_until_s)
        if self._still_to_lose:
            self._still_to_lose -= 1
            data = b""
        for fault, schedule, where in self._on_wire:
            struck_s = schedule.take_until(at_s)
            if struck_s is None:
                continue
            if self._lasting(fault, struck_s, reply.at_s):
                at_s = max(at_s, self._late_until_s)
            else:
                data = self._edited(fault, data, where, reply.at_s)
        if reply.at_s < self._quiet_until_s or not data:
            return None
        return Reply(at_s, data)

    # Streams

    def block(self, block: StreamBlock | None, since_s: float, now_s: float) -> StreamBlock | None:
        """Return what a stream delivers at `now_s` of what the device sent since `since_s`."""
        if block is not None and block.data:
            block = self._struck_block(block, since_s)
        return self._late(block, now_s)

    def pass_over(self, now_s: float) -> None:
        """Nobody has the port open: what would have struck up to `now_s` strikes nothing."""
        for _, schedule, _ in (*self._on_wire, *self._on_command):
            schedule.take_until(now_s)
        self._held = b""
        self._still_to_lose = 0

    def _struck_block(self, block: StreamBlock, since_s: float) -> StreamBlock:
        ends = self._frame_ends(block.data)
        counts = np.concatenate(([0], block.marks[:, 0]))
        sent_s = np.interp(ends, counts, np.concatenate(([since_s], block.marks[:, 1] * 1e-9)))
        starts = np.concatenate(([0], ends[:-1]))
        edits: dict[int, bytes] = {}

        def frame(at: int) -> bytes:
            return edits.get(at, block.data[starts[at] : ends[at]])

        self._lose_from(0, len(ends), edits)
        edits |= dict.fromkeys(np.flatnonzero(sent_s < self._quiet_until_s).tolist(), b"")
        for fault, schedule, where in self._on_wire:
            at = 0
            while at < len(ends) and (struck_s := schedule.next_s) <= sent_s[-1]:
                at = int(np.searchsorted(sent_s, struck_s))
                schedule.take_until(float(sent_s[at]))
                if self._lasting(fault, struck_s, float(sent_s[at])):
                    if fault.kind == "silence":
                        quiet = (sent_s >= struck_s) & (sent_s < self._quiet_until_s)
                        edits |= dict.fromkeys(np.flatnonzero(quiet).tolist(), b"")
                    continue
                edits[at] = self._edited(fault, frame(at), where, float(sent_s[at]))
                if self._still_to_lose:
                    self._lose_from(at + 1, len(ends), edits)
        return _rebuilt(block, ends, edits) if edits else block

    def _lose_from(self, first: int, count: int, edits: dict[int, bytes]) -> None:
        lost = range(first, min(count, first + self._still_to_lose))
        self._still_to_lose -= len(lost)
        edits |= dict.fromkeys(lost, b"")

    def _late(self, block: StreamBlock | None, now_s: float) -> StreamBlock | None:
        """Hold back what a delay holds; release it, with its true time, at the first delivery after it."""
        fresh = block if block is not None and block.data else None
        if now_s < self._late_until_s:
            self._held += b"" if fresh is None else fresh.data
            return None
        if not self._held and (fresh is None or fresh.marks[0, 1] * 1e-9 >= self._late_until_s):
            return fresh
        late_ns = round(self._late_until_s * 1e9)
        marks = np.array([[len(self._held), late_ns]], np.int64) if self._held else np.empty((0, 2), np.int64)
        data = self._held
        if fresh is not None:
            behind = np.column_stack((fresh.marks[:, 0] + len(data), np.maximum(fresh.marks[:, 1], late_ns)))
            marks, data = np.concatenate((marks, behind)), data + fresh.data
        self._held = b""
        return StreamBlock(data, marks)

    def _frame_ends(self, data: bytes) -> NDArray[np.int64]:
        """Return where frames end, int64 (n,), the last at the end of `data`."""
        length = self._wire.frame_bytes
        if length:  # counted from the end: a message of another length may come first
            return np.arange(len(data), 0, -length, dtype=np.int64)[::-1]
        mark = self._wire.terminator
        if not mark:
            return np.array([len(data)], np.int64)
        ends, at = [], data.find(mark)
        while at >= 0:
            ends.append(at + len(mark))
            at = data.find(mark, at + len(mark))
        if not ends or ends[-1] < len(data):
            ends.append(len(data))
        return np.array(ends, np.int64)

    # What is done to a message

    def _lasting(self, fault: Fault, struck_s: float, sent_s: float) -> bool:
        """Begin a silence at `struck_s`, or a delay with the message of `sent_s`; False for other kinds."""
        if fault.kind == "delay":
            self._late_until_s = max(self._late_until_s, sent_s + fault.duration_s)
        elif fault.kind == "silence":
            self._quiet_until_s = max(self._quiet_until_s, struck_s + fault.duration_s)
        else:
            return False
        self._say(sent_s if fault.kind == "delay" else struck_s, fault, f"for {fault.duration_s:g} s")
        return True

    def _edited(self, fault: Fault, data: bytes, where: np.random.Generator, sent_s: float) -> bytes:
        if not data:
            return data
        count = min(fault.count, len(data))
        at = int(where.integers(len(data) - count + 1))
        match fault.kind.removesuffix("_command"):
            case "drop":
                changed, what = data[:at] + data[at + count :], f"{count} bytes at {at}"
            case "repeat":
                changed = data[: at + count] + data[at : at + count] + data[at + count :]
                what = f"{count} bytes at {at}"
            case "flip":
                bits = where.choice(8 * len(data), min(fault.count, 8 * len(data)), replace=False)
                changed, what = _flipped(data, bits.tolist()), f"bits {sorted(bits.tolist())}"
            case "noise":
                stray = where.integers(256, size=fault.count, dtype=np.uint8).tobytes()
                changed, what = stray + data, stray.hex(" ")
            case "truncate":
                keep = int(where.integers(len(data)))
                changed, what = data[:keep], f"{keep} of {len(data)} bytes left"
            case "bad_check":
                last = len(data) - self._wire.tail_bytes
                byte = last - 1 - int(where.integers(min(self._wire.check_bytes, last)))
                changed, what = _flipped(data, [8 * byte + int(where.integers(4))]), f"byte {byte}"
            case "double":
                changed, what = data + data, f"{len(data)} bytes"
            case _:
                self._still_to_lose = fault.count - 1
                changed, what = b"", f"{fault.count} messages"
        self._say(sent_s, fault, what)
        return changed

    def _say(self, time_s: float, fault: Fault, what: str) -> None:
        self.struck.append({"time_s": time_s, "port": self.port, "kind": fault.kind, "what": what})


def _flipped(data: bytes, bits: Sequence[int]) -> bytes:
    changed = bytearray(data)
    for bit in bits:
        changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def _rebuilt(block: StreamBlock, ends: NDArray[np.int64], edits: Mapping[int, bytes]) -> StreamBlock:
    """Return the block with frames replaced, its marks moved to where the same frames now end."""
    parts, done = [], 0
    lengths = np.diff(ends, prepend=0)
    for at in sorted(edits):
        start = int(ends[at] - lengths[at])
        parts += [block.data[done:start], edits[at]]
        done = int(ends[at])
    for at, data in edits.items():
        lengths[at] = len(data)
    parts.append(block.data[done:])
    new_ends = np.concatenate(([0], np.cumsum(lengths)))
    counts = new_ends[np.searchsorted(ends, block.marks[:, 0], side="right")]
    rises = np.diff(counts, prepend=0) > 0
    marks = np.column_stack((counts, block.marks[:, 1]))[rises]
    return dataclasses.replace(block, data=b"".join(parts), marks=marks)
