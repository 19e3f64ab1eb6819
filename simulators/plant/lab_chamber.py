"""The lab's chamber as a device sees it: demands at any time, values at any time, ticks in between."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from drivers.base.arrays import Array
from simulators.plant.chamber import ChamberAir, ChamberDemand
from simulators.plant.imu import ImuUnit
from simulators.plant.unit import GyroUnit


class LabChamber:
    """Chamber of a lab: what an emulated controller acts on.

    `advance` is the lab's: a question about a time first moves the lab there. `glued` maps numbers of auxiliary
    sensors to the units on whose case they sit.
    """

    def __init__(
        self, air: ChamberAir, advance: Callable[[float], None], glued: Mapping[int, GyroUnit | ImuUnit]
    ) -> None:
        self._air = air
        self._advance = advance
        self._glued = glued
        self._pending: list[ChamberDemand] = []
        self._record = np.empty((4096, 2))
        self._ticks = -1
        self._keep()

    def demand(
        self, now_s: float, *, set_point_c: float, ramp_up: float, ramp_down: float, running: bool
    ) -> None:
        """Set the target; the controller takes it up at its next tick. Ramps in K/min, 0 = as fast as it can."""
        self._pending.append(ChamberDemand(now_s, set_point_c, ramp_up, ramp_down, running))

    def weaken(self, now_s: float, factor: float) -> None:
        """Leave the heater and the refrigeration `factor` of their strength from now on; 1 repairs them."""
        self._advance(now_s)
        self._air.strength = factor

    def air_temp_c(self, now_s: float) -> float:
        """Return the air temperature at the control sensor, linear between ticks."""
        return self._between(now_s, 0)

    def set_point_c(self, now_s: float) -> float:
        """Return the set point in force, linear between ticks; of a stopped chamber, the one it would run to."""
        return self._between(now_s, 1)

    def auxiliary_c(self, number: int, now_s: float) -> float:
        """Return the sensor on the case of the unit it is glued to, held from the last tick; else the air's."""
        unit = self._glued.get(number)
        if unit is None:
            return self.air_temp_c(now_s)
        self._advance(now_s)
        return unit.case_reading_c(now_s)

    def tick(self) -> float:
        """Advance by 1 s and return the air temperature around the units."""
        while self._pending and self._pending[0].time_s <= self._ticks:
            self._air.apply(self._pending.pop(0))
        self._air.tick()
        self._keep()
        return self._air.unit_air_c(self._ticks)

    def record(self) -> Mapping[str, Array]:
        """Return `air_temp_c` and `set_point_c`, float64 (ticks,), tick k at k s."""
        kept = self._record[: self._ticks + 1]
        return {"air_temp_c": kept[:, 0].copy(), "set_point_c": kept[:, 1].copy()}

    def _keep(self) -> None:
        self._ticks += 1
        if self._ticks == len(self._record):
            self._record = np.concatenate((self._record, np.empty_like(self._record)))
        self._record[self._ticks] = self._air.air_c, self._air.set_point_c

    def _between(self, now_s: float, column: int) -> float:
        self._advance(now_s)
        before = int(now_s)
        low = float(self._record[before, column])
        high = float(self._record[min(before + 1, self._ticks), column])
        return low + (high - low) * (now_s - before)
