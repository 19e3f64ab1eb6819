"""A gyro made from its frame description: streams from switch-on, in the bytes that the description says."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.base.constants import ZERO_CELSIUS_K
from drivers.base.errors import ConfigurationError
from drivers.frames import (
    FrameEncoder,
    FrameFamily,
    FramesConfig,
    LineDescription,
    LineEncoder,
    bits_a_byte,
    channels,
    messages_of,
    to_bench_unit,
)
from drivers.rlg import RlgConfig
from simulators.faults import WireShape
from simulators.interfaces import GyroPlant, GyroSignal, Installation, Reply, StreamBlock

_MARKS_PER_S = 2.0
_AXES = "xyz"


class FrameEmulator:
    """One unit (`simulators.interfaces.StreamingEmulator`).

    Its clock is fast by `clock_error_ppm`: sample k is complete (k + 1) / rate / (1 + clock_error_ppm * 1e-6)
    after `start_s`, and its frame is out one transmission time later. Gyro channels, accelerations,
    temperatures, counter and time are filled from the plant; every other field has its usual value. Axes that
    the plant has no gyro for show what they truly turn through. Pulses reach its trigger input at whole multiples
    of `pulse_interval_s` of lab time; it tells by its own clock how long ago the last was.
    """

    def __init__(
        self,
        plant: GyroPlant,
        family: FrameFamily,
        *,
        axes: str,
        rate_hz: float,
        baudrate: int,
        message: str | None = None,
        clock_error_ppm: float = 0.0,
        start_s: float = 0.0,
        pulse_interval_s: float = 1.0,
    ) -> None:
        """Raise ConfigurationError for a rate the line cannot carry, and axes that the plant does not have."""
        self._plant = plant
        self._lines = isinstance(family.description, LineDescription)
        self._line_check = 0
        self._encoder: FrameEncoder | LineEncoder
        if isinstance(family.description, LineDescription):
            self._encoder = LineEncoder(family)
            if (check := family.description.line.checksum) is not None:
                self._line_check = 2 if check.kind == "xor8" else 8
            self._length = len(self._encoder.encode(1, {}))  # A minus sign more or less is left out.
        else:
            sent = messages_of(family, message)
            self._encoder = FrameEncoder(family, sent[0].name if sent else None)
            self._length = self._encoder.layout.length
        self._form = self._encoder.form
        self._counter = self._form.counter
        self._rate_hz = rate_hz
        self._period_s = 1.0 / (rate_hz * (1.0 + clock_error_ppm * 1e-6))
        self._send_s = self._length * bits_a_byte(family) / baudrate
        self._samples_per_mark = max(1, int(rate_hz / _MARKS_PER_S))
        self._start_s = start_s
        self._pulse_interval_s = pulse_interval_s
        self._sent = 0
        self._turned: dict[str, float] = {}
        channels(family, self._form, axes)
        if not set(axes) <= set(plant.axes):
            raise ConfigurationError(
                "the emulated unit has fewer axes than the bench file says",
                where="emulated gyro",
                found=f"axes {axes}",
                expected=f"axes of the plant's unit, {plant.axes}",
                remedy="choose another model in the plant file",
            )
        if self._send_s > self._period_s:
            raise ConfigurationError(
                "a frame takes longer than a sample",
                where="emulated gyro",
                found=f"{rate_hz:g} Hz of {self._length} bytes at {baudrate} Bd",
                expected=f"at most {1.0 / self._send_s:.0f} Hz",
            )

    @property
    def send_s(self) -> float:
        """How long a frame is on the line."""
        return self._send_s

    @property
    def wire(self) -> WireShape:
        """How a frame looks from outside."""
        if self._lines:
            return WireShape(terminator=b"\r\n", check_bytes=self._line_check, tail_bytes=2)
        checks = [check for check in self._form.checksums if check.at < 0]
        tail = len(self._form.terminator)
        size = -checks[-1].at - tail if checks else 0
        return WireShape(frame_bytes=self._length, check_bytes=size, tail_bytes=tail)

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Ignore what the bench writes."""
        return []

    def stream(self, until_s: float) -> StreamBlock | None:
        """Return the frames whose last byte is out by `until_s`; None if there are none."""
        first = self._sent
        due = max(0, math.floor((until_s - self._start_s - self._send_s + 1e-9) / self._period_s))
        count = due - first
        if count <= 0:
            return None
        self._sent = due
        signal = self._plant.measure(self._start_s + first * self._period_s, count, self._period_s)
        numbers = np.arange(first + 1, due + 1)
        data = self._encoder.encode(count, self._values(signal, numbers))
        return StreamBlock(data, self._marks(first, due, data))

    def _values(self, signal: GyroSignal, numbers: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
        """Return the fields of the frames with these numbers (1 for the first), in their units."""
        values: dict[str, NDArray[Any]] = {}
        for spec in self._form.fields:
            unit, axis = to_bench_unit(spec.unit), spec.axis or ""
            if self._counter is not None and spec.name == self._counter.field:
                ticks = self._counter.ticks_per_s
                step = float(self._counter.step) if ticks is None else ticks / self._rate_hz
                count = np.rint((numbers - 1) * step)
                if spec.type[0] == "f" and ticks is not None:  # A clock in s.
                    count = count / ticks
                values[spec.name] = count * spec.scale.factor + spec.offset
            elif spec.role == "counter" and spec.bits is not None:  # a few bits of a status word
                values[spec.name] = (numbers - 1) % (1 << spec.bits[1])
            elif spec.role == "time" and spec.usual is None:  # a latency is no clock: it has its usual value
                values[spec.name] = numbers / self._rate_hz / unit
            elif spec.role == "since_pulse":
                since_s = np.mod(self._start_s + numbers * self._period_s, self._pulse_interval_s)
                values[spec.name] = since_s / (self._rate_hz * self._period_s) / unit
            elif spec.role in ("rate", "delta_angle", "cumulative_angle") and axis:
                angle_deg = np.degrees(signal.angle_rad(axis))
                if spec.role == "rate":
                    angle_deg = angle_deg / self._period_s
                elif spec.role == "cumulative_angle":
                    angle_deg = self._turned.get(axis, 0.0) + np.cumsum(angle_deg)
                    self._turned[axis] = float(angle_deg[-1])
                values[spec.name] = angle_deg / unit
            elif spec.role in ("accel", "delta_velocity") and signal.velocity_increment_mps is not None:
                velocity = signal.velocity_increment_mps[:, _AXES.index(axis)]
                values[spec.name] = velocity / (self._period_s if spec.role == "accel" else 1.0) / unit
            elif spec.role == "temp" and spec.unit in _TEMPERATURES:
                values[spec.name] = _TEMPERATURES[spec.unit](signal.temp_c)
            elif spec.role == "case_temp" and spec.unit in _TEMPERATURES:
                # Read just before the sample ends, so that a sample that ends on a tick is not rounded past it.
                times = self._start_s + numbers * self._period_s - 1e-6
                case = np.array([self._plant.case_reading_c(time_s) for time_s in times.tolist()])
                values[spec.name] = _TEMPERATURES[spec.unit](case)
        return values

    def _marks(self, first: int, due: int, data: bytes) -> np.ndarray[tuple[int, int], np.dtype[np.int64]]:
        step = self._samples_per_mark
        ends = np.append(np.arange((first // step + 1) * step, due, step), due)
        marks = np.empty((len(ends), 2), np.int64)
        sizes = np.arange(due - first + 1) * self._length
        if self._lines:
            sizes = np.append(0, np.flatnonzero(np.frombuffer(data, np.uint8) == ord("\n")) + 1)
        marks[:, 0] = sizes[ends - first]
        marks[:, 1] = np.rint((self._start_s + ends * self._period_s + self._send_s) * 1e9)
        return marks


_TEMPERATURES: dict[str, Any] = {
    "degC": lambda temp_c: temp_c,
    "K": lambda temp_c: temp_c + ZERO_CELSIUS_K,
    "degF": lambda temp_c: temp_c * 1.8 + 32.0,
}


def emulator(config: FramesConfig, plant: GyroPlant, installed: Installation) -> FrameEmulator:
    """Make the emulator of a bench file's described gyro."""
    return FrameEmulator(
        plant,
        config.family,
        axes=config.axes,
        rate_hz=config.rate_hz,
        baudrate=config.baudrate,
        message=config.frame_format,
        clock_error_ppm=installed.clock_error_ppm,
        pulse_interval_s=config.pulse_interval_s,
    )


def ring_laser(config: RlgConfig, plant: GyroPlant, installed: Installation) -> FrameEmulator:
    """Make the emulator of a bench file's ring-laser gyro."""
    return emulator(config.described, plant, installed)
