"""The seams of the emulated lab: what an emulator is to the lab, and what a gyro is to its emulator.

All times are lab time in s since the lab was switched on. An emulator holds no physics: it asks a plant. The
plant holds no bytes. Times passed to one object never decrease.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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

    @staticmethod
    def joined(parts: Sequence[StreamBlock]) -> StreamBlock | None:
        """Return consecutive blocks as one, None if there are none."""
        if len(parts) < 2:
            return parts[0] if parts else None
        starts = np.cumsum([0, *(len(part.data) for part in parts[:-1])])
        marks = [part.marks + np.array([start, 0]) for start, part in zip(starts, parts, strict=True)]
        return StreamBlock(b"".join(part.data for part in parts), np.concatenate(marks))


class Emulator(Protocol):
    """A device on a port."""

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote (any chunking) and return the replies they cause, in time order."""


class StreamingEmulator(Emulator, Protocol):
    """A device that also sends by itself."""

    def stream(self, until_s: float) -> StreamBlock | None:
        """Return what it sent since the last call for samples complete by `until_s`; None while it is quiet."""


@dataclass(frozen=True)
class GyroSignal:
    """What a gyro's electronics measured over consecutive sample intervals, shape (n,) each.

    `angle_increment_rad`: float64, one entry an axis in the order of `axes`, shape (n, len(axes)).
    `temp_c`: the gyro's own temperature sensor at the end of each interval. `velocity_increment_mps`: float64,
    shape (n, 3), of the accelerometers x, y, z: the time integral of specific force, which at rest points up.
    `turned_rad`: float64, shape (n, 3), what x, y, z truly turned through in inertial space. Both are None where
    the plant does not say.
    """

    axes: str
    angle_increment_rad: NDArray[np.float64]
    temp_c: NDArray[np.float64]
    velocity_increment_mps: NDArray[np.float64] | None = None
    turned_rad: NDArray[np.float64] | None = None

    def angle_rad(self, axis: str) -> NDArray[np.float64]:
        """Return increments about x, y or z, (n,): as measured, and the true ones where the unit has no gyro."""
        if axis in self.axes:
            return self.angle_increment_rad[:, self.axes.index(axis)]
        return (
            np.zeros(len(self.temp_c)) if self.turned_rad is None else self.turned_rad[:, "xyz".index(axis)]
        )


class GyroPlant(Protocol):
    """One gyro unit mounted on the table in the chamber."""

    axes: str
    """Axes the unit has, e.g. "x" (single-axis FOG) or "xyz"."""

    def measure(self, start_s: float, count: int, period_s: float) -> GyroSignal:
        """Return `count` consecutive samples of `period_s`, the first interval starting at `start_s`.

        Intervals of successive calls are contiguous; the plant has been advanced past their end.
        """

    def case_reading_c(self, now_s: float) -> float:
        """Return the reading of the sensor on the case, held from the last tick."""


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

The plant of a table is a `TableAxis` for each axis by name, outermost first; that of a chamber a `LabChamber`, of
a gyro a `GyroPlant`, of a platform a `LabPlatform` (`simulators.plant`). Gyros and platforms stream.
"""
