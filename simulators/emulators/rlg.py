"""The two-temperature ring laser on its serial port: streams from switch-on and takes no commands."""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from drivers.errors import ConfigurationError
from drivers.rlg import LENGTH, encode_frames
from simulators.faults import WireShape
from simulators.interfaces import GyroPlant, Reply, StreamBlock

_BITS = 10
_MARKS_PER_S = 2.0


class TwoSensorPlant(GyroPlant, Protocol):
    """A gyro whose electronics also read a sensor on the case."""

    def case_reading_c(self, now_s: float) -> float:
        """Return the reading of the sensor on the case, held from the last tick."""
        ...


class RlgEmulator:
    """One unit (`simulators.interfaces.StreamingEmulator`).

    Its clock is fast by `clock_error_ppm`: sample k is complete at (k + 1) / rate / (1 + clock_error_ppm * 1e-6),
    and its frame is out one transmission time later.
    """

    def __init__(
        self, plant: TwoSensorPlant, *, rate_hz: float, baudrate: int, clock_error_ppm: float = 0.0
    ) -> None:
        self._plant = plant
        self._period_s = 1.0 / (rate_hz * (1.0 + clock_error_ppm * 1e-6))
        self._send_s = LENGTH * _BITS / baudrate
        self._samples_per_mark = max(1, int(rate_hz / _MARKS_PER_S))
        self._sent = 0
        if self._send_s > self._period_s:
            raise ConfigurationError(
                "a frame takes longer than a sample",
                where="emulated ring laser",
                found=f"{rate_hz:g} Hz at {baudrate} Bd",
                expected=f"at most {1.0 / self._send_s:.0f} Hz",
            )

    @property
    def wire(self) -> WireShape:
        """How a frame looks from outside."""
        return WireShape(frame_bytes=LENGTH, check_bytes=2)

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Ignore what the bench writes."""
        return []

    def stream(self, until_s: float) -> StreamBlock | None:
        """Return the frames whose last byte is out by `until_s`; None if there are none."""
        first = self._sent
        due = max(0, math.floor((until_s - self._send_s + 1e-9) / self._period_s))
        count = due - first
        if count <= 0:
            return None
        self._sent = due
        signal = self._plant.measure(first * self._period_s, count, self._period_s)
        numbers = np.arange(first + 1, due + 1)
        # Read just before the sample ends, so that a sample that ends on a tick is not rounded past it.
        case = [self._plant.case_reading_c(number * self._period_s - 1e-6) for number in numbers]
        data = encode_frames(
            np.degrees(signal.angle_increment_rad[:, 0]) * 3600.0,
            case_temp_c=case,
            block_temp_c=signal.temp_c,
            counter=numbers - 1,
        )
        return StreamBlock(data, self._marks(first, due))

    def _marks(self, first: int, due: int) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
        step = self._samples_per_mark
        ends = np.append(np.arange((first // step + 1) * step, due, step), due)
        marks = np.empty((len(ends), 2), np.int64)
        marks[:, 0] = (ends - first) * LENGTH
        marks[:, 1] = np.rint((ends * self._period_s + self._send_s) * 1e9)
        return marks
