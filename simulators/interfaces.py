"""The seams of the emulated lab: what an emulator is to the lab, and what the plant is to an emulator.

All times are lab time in s since the lab was switched on. An emulator holds no physics: it asks a plant. The
plant holds no bytes. Times passed to one object never decrease.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Reply:
    """Bytes a device puts on its port at `at_s` (the time the last byte is out)."""

    at_s: float
    data: bytes


@dataclass(frozen=True)
class StreamBlock:
    """Bytes a streaming device sent by itself, in order, with arrival marks.

    `marks`: int64 (m, 2), rows (bytes of this block sent so far, lab time in ns of the last of them); the last
    row covers the whole block. At least one mark a second of streaming.
    """

    data: bytes
    marks: NDArray[np.int64]


class Emulator(Protocol):
    """A device on a port."""

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote (any chunking) and return the replies they cause, in time order."""


class StreamingEmulator(Emulator, Protocol):
    """A device that also sends by itself."""

    def stream(self, until_s: float) -> StreamBlock | None:
        """Return what it sent since the last call for samples complete by `until_s`; None while it is quiet."""


class ChamberPlant(Protocol):
    """Air, refrigeration and the unit's surroundings."""

    def demand(
        self, now_s: float, *, set_point_c: float, ramp_up: float, ramp_down: float, running: bool
    ) -> None:
        """Set the controller's target; ramps in K/min, 0 = as fast as the chamber can."""

    def air_temp_c(self, now_s: float) -> float:
        """Air temperature at the chamber's control sensor."""

    def set_point_c(self, now_s: float) -> float:
        """Set point in force (the ramp's momentary value)."""

    def auxiliary_c(self, number: int, now_s: float) -> float:
        """Auxiliary sensor `number` (1-based), e.g. glued to the case of a unit under test."""


class TablePlant(Protocol):
    """One servoed table axis."""

    max_rate_dps: float
    max_acceleration_dps2: float

    def servo(self, now_s: float, on: bool) -> None:
        """Close (True) or open the servo loop; opening lets the axis coast to rest."""

    def demand_rate(self, now_s: float, rate_dps: float, acceleration_limit_dps2: float = math.inf) -> None:
        """Rate mode: go to `rate_dps` within the axis' own and the given acceleration limit."""

    def demand_angle(
        self,
        now_s: float,
        angle_deg: float,
        rate_limit_dps: float = math.inf,
        acceleration_limit_dps2: float = math.inf,
    ) -> None:
        """Position mode: go to `angle_deg` by the shortest path within own and given limits."""

    def demand_turn(
        self,
        now_s: float,
        by_deg: float,
        rate_limit_dps: float = math.inf,
        acceleration_limit_dps2: float = math.inf,
    ) -> None:
        """Position mode: turn by a signed angle from where the axis would stop, within own and given limits."""

    def angle_deg(self, now_s: float) -> float:
        """Encoder angle in [0, 360)."""

    def rate_dps(self, now_s: float) -> float:
        """Axis rate."""

    def settled(self, now_s: float) -> bool:
        """Whether the demanded profile is complete."""


@dataclass(frozen=True)
class GyroSignal:
    """What a gyro's electronics measured over consecutive sample intervals, shape (n,) each.

    `angle_increment_rad`: float64, one entry an axis in the order of `axes`, shape (n, len(axes)).
    `temp_c`: the gyro's own temperature sensor at the end of each interval. `velocity_increment_mps`: float64,
    shape (n, 3), of the accelerometers x, y, z of an IMU; None for a unit that has none.
    """

    axes: str
    angle_increment_rad: NDArray[np.float64]
    temp_c: NDArray[np.float64]
    velocity_increment_mps: NDArray[np.float64] | None = None


class GyroPlant(Protocol):
    """One gyro unit mounted on the table in the chamber."""

    axes: str
    """Axes the unit has, e.g. "x" (single-axis FOG) or "xyz"."""

    def measure(self, start_s: float, count: int, period_s: float) -> GyroSignal:
        """Return `count` consecutive samples of `period_s`, the first interval starting at `start_s`.

        Intervals of successive calls are contiguous; the plant has been advanced past their end.
        """


@dataclass(frozen=True)
class Installation:
    """What an emulator is told beside its configuration and its plant.

    `clock_error_ppm`: how fast a unit's sample clock is. `before`: a unit's emulator until it was switched off,
    for what outlasts that.
    """

    clock_error_ppm: float = 0.0
    before: Emulator | None = None


EmulatorMaker = Callable[[Any, Any, Installation], Emulator]
"""Makes an emulator of its driver's configuration and a plant; an entry point of group `gyrobench.emulators`.

The plant of a table is a `TablePlant` for each axis by name, outermost first; that of a chamber a `ChamberPlant`,
of a gyro a `GyroPlant`, of a platform a `simulators.platform_interface.PlatformPlant`. Gyros and platforms are
`StreamingEmulator`s.
"""
