"""A streaming unit switched off and on again: it falls silent, then begins anew as it does at switch-on."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from simulators.faults import DeviceFault, Fault, WireShape
from simulators.interfaces import GyroSignal, Reply, StreamBlock, StreamingEmulator
from simulators.plant.lab_plant import Unit


class Since:
    """A unit whose time counts from `since_s` of lab time, when it was switched on (`GyroPlant`)."""

    def __init__(self, unit: Unit, since_s: float) -> None:
        self.axes = unit.axes
        self._unit = unit
        self._since_s = since_s

    def measure(self, start_s: float, count: int, period_s: float) -> GyroSignal:
        """Return samples (see `GyroPlant`)."""
        return self._unit.measure(self._since_s + start_s, count, period_s)

    def case_reading_c(self, now_s: float) -> float:
        """Return the reading of the sensor on the case."""
        return self._unit.case_reading_c(self._since_s + now_s)


class PowerCycled:
    """An emulator up to `off_s`, silence, and another from `on_s` of lab time (`StreamingEmulator`).

    `after` counts its time from its own switch-on. What the bench writes while the unit is off is lost.
    """

    def __init__(
        self, before: StreamingEmulator, after: StreamingEmulator, *, off_s: float, on_s: float
    ) -> None:
        self._before: StreamingEmulator | None = before
        self._off_s, self._on_s = off_s, on_s
        self.after = after

    @property
    def wire(self) -> WireShape | None:
        """How its messages look from outside."""
        return getattr(self.after, "wire", None)

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """Faults of the unit that is on again."""
        faults: Mapping[str, DeviceFault] = getattr(self.after, "faults", {})
        return {kind: self._later(strike) for kind, strike in faults.items()}

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take what the bench wrote."""
        if now_s < self._on_s:
            return []
        replies = self.after.receive(data, now_s - self._on_s)
        return [Reply(reply.at_s + self._on_s, reply.data) for reply in replies]

    def stream(self, until_s: float) -> StreamBlock | None:
        """Return what was sent before the unit went off, and since it is on."""
        parts: list[StreamBlock | None] = []
        if self._before is not None:
            parts.append(self._before.stream(min(until_s, self._off_s)))
            if until_s >= self._off_s:
                self._before = None
        if until_s > self._on_s and (block := self.after.stream(until_s - self._on_s)) is not None:
            later = np.array([0, round(self._on_s * 1e9)], np.int64)
            parts.append(StreamBlock(block.data, block.marks + later))
        return StreamBlock.joined([part for part in parts if part is not None])

    def _later(self, strike: DeviceFault) -> DeviceFault:
        def struck(fault: Fault, now_s: float) -> None:
            strike(fault, max(0.0, now_s - self._on_s))

        return struck
