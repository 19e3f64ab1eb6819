"""Any gyro on a CAN bus behind an slcan adapter, by its layout: the one that its driver decodes by."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.base.errors import ConfigurationError
from drivers.can_dbc import (
    CanConfig,
    CanDbcConfig,
    CanLayout,
    MessageLayout,
    SignalUse,
    Slot,
    ValidRule,
    layout_of,
)
from drivers.kit.slcan_codec import FRAME_DTYPE, encode_frames
from drivers.sbg import ellipse_layout
from simulators.emulators.slcan import SlcanAdapter
from simulators.faults import WireShape
from simulators.interfaces import GyroPlant, GyroSignal, Installation, Reply, StreamBlock

_MARKS_PER_S = 2.0
_AXES = "xyz"


class CanEmulator:
    """One unit and its adapter on a port (`simulators.interfaces.StreamingEmulator`).

    The unit's clock is fast by `clock_error_ppm`: sample k is complete at
    (k + 1) / rate / (1 + clock_error_ppm * 1e-6) of lab time, and says (k + 1) / rate, or counts k + 1. The
    frames of a sample follow at once, one after the other at `bitrate`; the adapter hands on a frame when it has
    ended. Messages whose values are held come before each sample. A cycle passes whole or not at all. While the
    adapter passes nothing the plant is not asked. Axes that the plant has no gyro for show what they truly turn
    through, signals without a meaning raw 0.
    `source_address`: of a J1939 unit, default that of the DBC file. `adapter`: one that is there
    already, as it is when only the unit is switched off and on.
    """

    def __init__(
        self,
        plant: GyroPlant,
        layout: CanLayout,
        *,
        rate_hz: float,
        bitrate: int = 500_000,
        clock_error_ppm: float = 0.0,
        serial_number: str = "GB01",
        source_address: int | None = None,
        adapter: SlcanAdapter | None = None,
    ) -> None:
        self._plant = plant
        self._layout = layout
        self._source = source_address
        self._slots = [*_held_slots(layout), *layout.sample]
        self.adapter = adapter or SlcanAdapter(bitrate, serial_number=serial_number)
        self._rate_hz = rate_hz
        self._period_s = 1.0 / (rate_hz * (1.0 + clock_error_ppm * 1e-6))
        messages = [layout.messages[slot.message] for slot in self._slots]
        self._send_s = sum(_frame_bits(message) for message in messages) / bitrate
        if self._send_s > self._period_s:
            raise ConfigurationError(
                "the messages of one sample take longer than the sample",
                where=f"emulated {layout.maker} {layout.model}",
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
        was_passing = self.adapter.passing
        answers = self.adapter.receive(data, now_s)
        if was_passing and not self.adapter.passing:
            unsent = self._send(now_s)
            return answers if unsent is None else [Reply(now_s, unsent.data), *answers]
        if not was_passing:
            self._next = max(self._next, self._due(now_s))
        return answers

    def stream(self, until_s: float) -> StreamBlock | None:
        """Return the frames of samples whose last frame has ended by `until_s`; None if there are none."""
        if self.adapter.passing:
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
        """Return the frames of each sample; `numbers` count samples from 1 at switch-on."""
        count = len(numbers)
        frames = np.zeros((count, len(self._slots)), FRAME_DTYPE)
        for at, slot in enumerate(self._slots):
            message = self._layout.messages[slot.message]
            frames["id"][:, at] = self._identifier(message)
            frames["extended"][:, at] = message.extended
            frames["dlc"][:, at] = frames["length"][:, at] = message.length
            frames["data"][:, at] = message.pack(self._values(slot, signal, numbers), count)
        return frames.ravel()

    def _identifier(self, message: MessageLayout) -> int:
        if self._source is None or not message.extended:
            return message.identifier
        return message.identifier & ~0xFF | self._source

    def _values(self, slot: Slot, signal: GyroSignal, numbers: NDArray[np.int64]) -> dict[str, ArrayLike]:
        """Return the raw values of one frame of each sample by signal name."""
        values: dict[str, ArrayLike] = {}
        for rule in self._layout.valid:
            if rule.message == slot.message:
                values[rule.signal] = int(np.asarray(values.get(rule.signal, 0))) | rule.equals
        for use in self._layout.uses:
            if use.message == slot.message and (value := self._value(use, signal, numbers)) is not None:
                values[use.signal] = value
        own = self._layout.messages[slot.message].signals
        values = {name: value for name, value in values.items() if _carries(own[name].selectors, slot)}
        selector = self._layout.selector(slot)
        if selector is not None and slot.selection is not None:
            values[selector.name] = slot.selection
        return values

    def _value(self, use: SignalUse, signal: GyroSignal, numbers: NDArray[np.int64]) -> ArrayLike | None:
        """Return the raw values of one signal, None for a status that the rules of validity give."""
        layout = self._layout.signal(use)
        if use.role == "status":
            return use.healthy or None
        if use.role == "time":
            ticks = np.rint(numbers * (1.0 / use.factor / self._rate_hz)).astype(np.int64)
            return np.asarray(ticks % use.modulo)
        if use.role == "counter":
            return np.asarray(numbers * use.step % use.modulo)
        if use.role in ("temperature", "case_temperature"):
            return layout.quantise((signal.temp_c - use.zero) / use.factor)
        if use.role == "accel":
            velocity = signal.velocity_increment_mps
            force = np.zeros(len(numbers)) if velocity is None else velocity[:, _AXES.index(use.axis)]
            return layout.quantise(force / self._period_s / use.factor)
        angle_rad = signal.angle_rad(use.axis)
        if use.role == "delta_angle":
            return layout.quantise(np.degrees(angle_rad) / use.factor)
        if use.factor == math.degrees(1.0):
            return layout.quantise(angle_rad / self._period_s)
        return layout.quantise(np.degrees(angle_rad / self._period_s) / use.factor)

    def _marks(self, first: int, count: int, bytes_each: int) -> NDArray[np.int64]:
        """Return the end of every sample whose number is a multiple of half a second's, and of the last."""
        step, last = self._samples_per_mark, first + count
        numbers = [*range((first // step + 1) * step, last, step), last]
        ends_ns = [round((number * self._period_s + self._send_s) * 1e9) for number in numbers]
        counts = [(number - first) * bytes_each for number in numbers]
        return np.array([counts, ends_ns], np.int64).T


def _held_slots(layout: CanLayout) -> list[Slot]:
    """Return the frames that carry signals which are not part of a sample."""
    slots: list[Slot] = []
    used: list[SignalUse | ValidRule] = [*layout.uses, *layout.valid]
    for use in used:
        if layout.slot_of(use) is None:
            selectors = layout.signal(use).selectors
            slot = Slot(use.message, selectors[0][1][0] if selectors else None)
            if slot not in slots:
                slots.append(slot)
    return slots


def _carries(selectors: tuple[tuple[object, tuple[int, ...]], ...], slot: Slot) -> bool:
    return not selectors or slot.selection is None or slot.selection in selectors[0][1]


def _frame_bits(message: MessageLayout) -> int:
    """Return the length of a data frame with the space after it, without stuff bits (ISO 11898-1)."""
    return (67 if message.extended else 47) + 8 * message.length


def emulator(config: CanDbcConfig, plant: GyroPlant, installed: Installation) -> CanEmulator:
    """Make the emulator of a bench file's unit on CAN."""
    return _emulator(config, layout_of(config), plant, installed)


def ellipse(config: CanConfig, plant: GyroPlant, installed: Installation) -> CanEmulator:
    """Make the emulator of a bench file's SBG Ellipse."""
    return _emulator(config, ellipse_layout(), plant, installed)


def _emulator(config: CanConfig, layout: CanLayout, plant: GyroPlant, installed: Installation) -> CanEmulator:
    before = installed.before
    return CanEmulator(
        plant,
        layout,
        source_address=config.source_address,
        rate_hz=config.rate_hz,
        bitrate=config.bitrate,
        clock_error_ppm=installed.clock_error_ppm,
        adapter=before.adapter if isinstance(before, CanEmulator) else None,
    )
