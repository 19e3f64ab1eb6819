"""An SBG Ellipse on a CAN bus behind an slcan adapter."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ConfigurationError
from drivers.sbg import ALL_GOOD, COUNTER_MODULO, load_ellipse
from drivers.slcan import FRAME_DTYPE, encode_frames
from simulators.emulators.slcan import SlcanAdapter
from simulators.faults import WireShape
from simulators.interfaces import GyroPlant, GyroSignal, Reply, StreamBlock

_MARKS_PER_S = 2.0


class SbgEmulator:
    """One unit and its adapter on a port (`simulators.interfaces.StreamingEmulator`).

    The unit's clock is fast by `clock_error_ppm`: sample k is complete at
    (k + 1) / rate / (1 + clock_error_ppm * 1e-6) of lab time, and says (k + 1) / rate in us. IMU_INFO and
    IMU_GYRO follow at once, one after the other at `bitrate`; the adapter hands on a frame when it has ended.
    A cycle passes whole or not at all. While the adapter passes nothing the plant is not asked. Axes that the
    plant does not have read 0.
    """

    def __init__(
        self,
        plant: GyroPlant,
        *,
        rate_hz: float,
        bitrate: int = 500_000,
        clock_error_ppm: float = 0.0,
        serial_number: str = "GB01",
    ) -> None:
        ellipse = load_ellipse()
        self._plant = plant
        self._info, self._gyro = ellipse.info, ellipse.gyro
        self._adapter = SlcanAdapter(bitrate, serial_number=serial_number)
        self._rate_hz = rate_hz
        self._period_s = 1.0 / (rate_hz * (1.0 + clock_error_ppm * 1e-6))
        self._send_s = (_frame_bits(self._info.length) + _frame_bits(self._gyro.length)) / bitrate
        if self._send_s > self._period_s:
            raise ConfigurationError(
                "the messages of one sample take longer than the sample",
                where="emulated SBG Ellipse",
                found=f"{rate_hz:g} Hz at {bitrate} bit/s",
                expected=f"at most {1.0 / self._send_s:.0f} Hz",
            )
        self._samples_per_mark = max(1, int(rate_hz / _MARKS_PER_S))
        self._next = 0

    @property
    def wire(self) -> WireShape:
        """A CAN frame is a line of slcan text; the adapter has checked and dropped its CRC."""
        return WireShape(terminator=b"\r")

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take commands to the adapter; a channel that closes first hands on what had come by then."""
        was_passing = self._adapter.passing
        answers = self._adapter.receive(data, now_s)
        if was_passing and not self._adapter.passing:
            rest = self._send(now_s)
            return answers if rest is None else [Reply(now_s, rest.data), *answers]
        if not was_passing:
            self._next = max(self._next, self._due(now_s))
        return answers

    def stream(self, until_s: float) -> StreamBlock | None:
        """Return the frames of samples whose IMU_GYRO has ended by `until_s`; None if there are none."""
        if self._adapter.passing:
            return self._send(until_s)
        self._next = max(self._next, self._due(until_s))
        return None

    def _due(self, until_s: float) -> int:
        """Return how many samples of the unit's life have been sent by `until_s`, to a ns."""
        return max(0, math.floor((until_s - self._send_s + 1e-9) / self._period_s))

    def _send(self, until_s: float) -> StreamBlock | None:
        first, count = self._next, self._due(until_s) - self._next
        if count <= 0:
            return None
        self._next += count
        signal = self._plant.measure(first * self._period_s, count, self._period_s)
        data = encode_frames(self._frames(signal, np.arange(first + 1, first + count + 1)))
        return StreamBlock(data, self._marks(first, count, len(data) // count))

    def _frames(self, signal: GyroSignal, numbers: NDArray[np.int64]) -> NDArray[np.void]:
        """Return IMU_INFO and IMU_GYRO of each sample; `numbers` count samples from 1 at switch-on."""
        count = len(numbers)
        info, gyro = self._info.signals, self._gyro.signals
        time_us = np.rint(numbers * (1e6 / self._rate_hz)).astype(np.int64) % COUNTER_MODULO
        temperature = info["TEMPERATURE"].quantise(signal.temp_c)
        rate_rad_s = signal.angle_increment_rad / self._period_s
        rates = {}
        for column, axis in enumerate(signal.axes):
            name = f"GYRO_{axis.upper()}"
            rates[name] = gyro[name].quantise(rate_rad_s[:, column])
        frames = np.zeros((count, 2), FRAME_DTYPE)
        frames["id"] = self._info.identifier, self._gyro.identifier
        frames["dlc"] = self._info.length, self._gyro.length
        values = {"TIME_STAMP": time_us, "STATUS": ALL_GOOD, "TEMPERATURE": temperature}
        frames["data"][:, 0] = self._info.pack(values, count)
        frames["data"][:, 1] = self._gyro.pack(rates, count)
        return frames.ravel()

    def _marks(self, first: int, count: int, bytes_each: int) -> NDArray[np.int64]:
        """Return the end of every sample whose number is a multiple of half a second's, and of the last."""
        step, last = self._samples_per_mark, first + count
        numbers = [*range((first // step + 1) * step, last, step), last]
        ends_ns = [round((number * self._period_s + self._send_s) * 1e9) for number in numbers]
        counts = [(number - first) * bytes_each for number in numbers]
        return np.array([counts, ends_ns], np.int64).T


def _frame_bits(data_bytes: int) -> int:
    """Return the length of a standard data frame with the space after it, without stuff bits (ISO 11898-1)."""
    return 47 + 8 * data_bytes
