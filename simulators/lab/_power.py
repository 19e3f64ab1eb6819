"""Streaming units switched off and on: they fall silent, then begin anew as they do at switch-on."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from drivers.base.errors import ConfigurationError
from simulators.config import GyroInLab
from simulators.faults import DeviceFault, Fault, WireShape
from simulators.interfaces import GyroSignal, Reply, StreamBlock, StreamingEmulator
from simulators.plant.lab_plant import LabPlant, Unit


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


class Switched:
    """A unit's emulator (`StreamingEmulator`) whose power goes off and comes back; each time it begins anew.

    What the bench writes while the unit is off is lost. Times never decrease; what is on until a time is known
    beforehand may be told beforehand. An emulator counts its time from its own switch-on.
    """

    def __init__(self, emulator: StreamingEmulator) -> None:
        self.last = emulator
        """The emulator that is on, or was or will be the last to be."""
        self._spans: list[tuple[StreamingEmulator, float, float]] = [(emulator, 0.0, math.inf)]

    @property
    def is_on(self) -> bool:
        """Whether nothing ends the last span."""
        return bool(self._spans) and self._spans[-1][2] == math.inf

    def off(self, at_s: float) -> None:
        """Switch it off at a lab time."""
        emulator, on_s, _ = self._spans[-1]
        self._spans[-1] = (emulator, on_s, at_s)

    def on(self, emulator: StreamingEmulator, at_s: float) -> None:
        """Switch it on at a lab time, as another emulator."""
        self.last = emulator
        self._spans.append((emulator, at_s, math.inf))

    @property
    def wire(self) -> WireShape | None:
        """How its messages look from outside."""
        return getattr(self.last, "wire", None)

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """Faults of the unit that is on, or on again."""
        faults: Mapping[str, DeviceFault] = getattr(self.last, "faults", {})
        return {kind: self._later(strike) for kind, strike in faults.items()}

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take what the bench wrote."""
        for emulator, on_s, off_s in self._spans:
            if on_s <= now_s < off_s:
                replies = emulator.receive(data, now_s - on_s)
                return [Reply(reply.at_s + on_s, reply.data) for reply in replies]
        return []

    def stream(self, until_s: float) -> StreamBlock | None:
        """Return what was sent while the unit was on."""
        parts: list[StreamBlock] = []
        for emulator, on_s, off_s in self._spans:
            end_s = min(until_s, off_s)
            if end_s > on_s and (block := emulator.stream(end_s - on_s)) is not None:
                later = np.array([0, round(on_s * 1e9)], np.int64)
                parts.append(StreamBlock(block.data, block.marks + later))
        self._spans = [span for span in self._spans if span[2] > until_s]
        return StreamBlock.joined(parts)

    def _later(self, strike: DeviceFault) -> DeviceFault:
        def struck(fault: Fault, now_s: float) -> None:
            strike(fault, max(0.0, now_s - (self._spans[-1][1] if self._spans else now_s)))

        return struck


class Power:
    """Who switches units in the lab: the emulated operator, and supplies."""

    def __init__(
        self,
        plant: LabPlant,
        gyros: Mapping[str, GyroInLab],
        streams: Mapping[str, StreamingEmulator],
        anew: Callable[[GyroInLab, Since, StreamingEmulator], StreamingEmulator],
    ) -> None:
        self._plant, self._gyros, self._anew = plant, gyros, anew
        self.units = {name: Switched(streams[name]) for name in gyros}
        self.exchange: Callable[[str, StreamingEmulator], None] = lambda name, emulator: None
        """Puts an emulator on a port; the lab's own, once there is one."""

    def switch(self, name: str, on: bool, at_s: float) -> None:
        """Switch a gyro on or off at a lab time; nothing happens to one that is already."""
        if name not in self.units or on is (unit := self.units[name]).is_on:
            return
        self._plant.switch(name, on, at_s)
        if on:
            unit.on(self._anew(self._gyros[name], Since(self._plant.unit(name), at_s), unit.last), at_s)
        else:
            unit.off(at_s)
        self.exchange(name, unit)

    def cycle(self, request: dict[str, Any], now_s: float) -> dict[str, Any]:
        """Switch gyros (`unit`, `units`, default all) off now, and on again after `off_s` (default 60)."""
        off_s = float(request.get("off_s", 60.0))
        if not 1.0 <= off_s <= 86400.0:
            raise ConfigurationError(
                "a unit cannot be off for that long", found=f"off_s {off_s:g}", expected="1 s to a day"
            )
        names = [request["unit"]] if "unit" in request else request.get("units", list(self.units))
        for name in names:
            if name not in self.units:
                raise ConfigurationError(
                    f"the emulated lab has no gyro {name!r}", expected="one of " + ", ".join(self.units)
                )
            self.switch(name, False, now_s)
            self.switch(name, True, now_s + off_s)
        return {}
