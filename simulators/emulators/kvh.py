"""Emulated KVH DSP-1750/1760/1775: configuration mode, free-running stream, built-in test.

Source: KVH 56-0298 Rev B, "1775 IMU Interface Control Document"; the two invalid messages after a change of the
data rate are from ESA's DSP-1760 driver. Texts after USAGE and ERROR, and what reserved bytes and the status bits
of axes a unit does not have contain (here: zero, and valid), are not documented.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import cast

import numpy as np
from numpy.typing import NDArray

from drivers.base.constants import STANDARD_GRAVITY_MPS2
from drivers.base.errors import ConfigurationError
from drivers.kvh import KvhConfig, encode_bit, encode_frames
from drivers.kvh.commands import FACTORY, SETTINGS
from drivers.kvh.format import (
    ALL_VALID,
    AXES,
    COUNTER_MODULO,
    RATES_HZ,
    Format,
    TempUnits,
    layout,
    temperature_field,
)
from simulators.faults import DeviceFault, Fault, WireShape
from simulators.interfaces import GyroPlant, Installation, Reply, StreamBlock

_BITS = 10  # A byte on a line set to 8N1.
_BIT_GOOD = 0x7F  # Every result of the built-in test passed.
_REPLY_DELAY_S = 1e-3
_RESTART_S = 1.0
_INVALID_AFTER_RATE_CHANGE = 2
_MARKS_PER_S = 2.0
_LINE_LIMIT = 256
_FILTERS = (b"CHEBY", b"BUTTER", b"AVE")


class KvhEmulator:
    """One gyro unit on its port (`simulators.interfaces.StreamingEmulator`).

    The sensor clock is fast by `clock_error_ppm`: sample k of a stream begun at t0 is complete at
    t0 + (k + 1) / rate / (1 + clock_error_ppm * 1e-6), and its message is out one transmission time later.
    `streaming` is how the lab finds the unit: False, left in configuration mode; True, switched on at time 0 with
    `settings` in its memory, so a built-in-test message and then data. Without `settings` it is as delivered,
    slowed to what the baud rate carries.
    """

    def __init__(
        self,
        plant: GyroPlant,
        *,
        serial_number: str,
        axes: str = "x",
        baudrate: int = 921600,
        clock_error_ppm: float = 0.0,
        firmware: str = "GYROBENCH 1.0",
        streaming: bool = False,
        settings: dict[str, str] | None = None,
    ) -> None:
        """Raise ConfigurationError for axes the plant does not have and settings the unit does not know."""
        self._plant = plant
        self._serial_number = serial_number
        self._firmware = firmware
        self._settings = _delivered(baudrate) | (settings or {})
        for name, value in self._settings.items():
            if value not in SETTINGS.get(name, ()):
                raise _unusable(f"{name},{value}", ", ".join(SETTINGS.get(name, SETTINGS)))
        if streaming and (misfit := _misfit(self._settings)):
            raise _unusable(misfit.decode("ascii"), "a data rate that the baud rate carries")
        if not set(axes) <= set(plant.axes):
            raise _unusable(f"axes {axes}", f"axes of the plant's unit, {plant.axes}")
        self._columns = [AXES.index(axis) for axis in axes]
        self._own = [plant.axes.index(axis) for axis in axes]
        self._clock = 1.0 / (1.0 + clock_error_ppm * 1e-6)
        self._filter = {b"A": b"BUTTER", b"G": b"BUTTER"}
        self._line = b""
        self._free_s = 0.0  # When the last reply is out.
        self._counter = 0
        self._invalid = 0
        self._temp_c: float | None = None
        self._measured_s = 0.0  # To where the plant was asked.
        self._bit: bytes | None = None  # Test result to send when `_bit_after` samples of the stream are out.
        self._bit_after = 0
        self._refusals, self._refusal = 0, b""
        self._begin(0.0)
        self._configuring = not streaming
        if streaming:
            self._switch_on(0.0)

    @property
    def settings(self) -> dict[str, str]:
        """What the unit keeps in its memory when it is switched off."""
        return dict(self._settings)

    @property
    def wire(self) -> WireShape:
        """A message of the format in force ends in its CRC-32."""
        return WireShape(frame_bytes=layout(_format(self._settings)).length, check_bytes=4)

    @property
    def faults(self) -> Mapping[str, DeviceFault]:
        """`invalid`: `count` messages are flagged bad. `refuse`: `count` commands are answered ERROR, `text`.

        `counter_jump`: the sequence number skips `count` though nothing is lost.
        """
        return {"invalid": self._flag, "counter_jump": self._jump, "refuse": self._refuse}

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take command bytes (lines end in CR, LF or both) and return the replies they cause."""
        *lines, self._line = (self._line + data).replace(b"\r", b"\n").split(b"\n")
        self._line = self._line[-_LINE_LIMIT:]
        replies: list[Reply] = []
        for line in filter(None, lines):
            replies += self._command(line, now_s) if self._configuring else self._listen(line, now_s)
        return replies

    def stream(self, until_s: float) -> StreamBlock | None:
        """Return the messages whose last byte is out by `until_s`; None if there are none."""
        if self._configuring or self._settings["MSYNC"] == "EXT":
            return None
        due = self._complete(until_s - self._send_s)
        parts: list[StreamBlock] = []
        if self._bit is not None and due >= self._bit_after:
            self._data(parts, self._bit_after)
            out_s = self._out_s(self._bit_after) + self._seconds(len(self._bit))
            if out_s <= until_s:  # `_misfit` keeps room for it before the next message.
                parts.append(StreamBlock(self._bit, np.array([[len(self._bit), round(out_s * 1e9)]])))
                self._bit = None
        self._data(parts, due)
        return StreamBlock.joined(parts)

    def _flag(self, fault: Fault, now_s: float) -> None:
        self._invalid = fault.count

    def _jump(self, fault: Fault, now_s: float) -> None:
        self._counter = (self._counter + fault.count) % COUNTER_MODULO

    def _refuse(self, fault: Fault, now_s: float) -> None:
        self._refusals, self._refusal = fault.count, (fault.text or "BUSY").encode("latin-1", "replace")

    # The line in normal mode.

    def _listen(self, line: bytes, now_s: float) -> list[Reply]:
        """Normal mode knows =CONFIG,1 and ?BIT and ignores all else (section 5.1)."""
        command = line.upper()
        if command == b"=CONFIG,1":
            tail = self._last_messages(now_s)
            self._configuring = True
            self._bit = None
            return [*tail, self._reply(b"CONFIG,1\r\n", now_s)]
        if command in (b"?BIT", b"?BIT,2"):
            self._bit = encode_bit(bytes([_BIT_GOOD] * (6 if command == b"?BIT" else 8)))
            self._bit_after = self._complete(now_s) + 1  # It follows the next data message (section 8.5).
        return []

    def _last_messages(self, now_s: float) -> list[Reply]:
        """Finish what is complete or on its way out when configuration mode stops the output."""
        due = self.stream(now_s + self._send_s)
        if due is None:
            return []
        self._free_s = int(due.marks[-1, 1]) * 1e-9
        return [Reply(self._free_s, due.data)]

    # The line in configuration mode.

    def _command(self, line: bytes, now_s: float) -> list[Reply]:
        echo = line + b"\r\n" if self._settings["ECHO"] == "1" else b""
        name, *values = line.upper().split(b",")
        text = name[1:].decode("latin-1")
        if self._refusals:
            self._refusals -= 1
            answer = b"ERROR," + self._refusal
        elif name[:1] == b"=" and text in SETTINGS:
            answer = self._set(text, b",".join(values).decode("latin-1"))
        elif name[:1] == b"?" and text in SETTINGS and not values:
            answer = f"{text},{self._settings[text]}".encode("ascii")
        else:
            answer = self._other(name, values, line, now_s)
        reply = self._reply(echo + answer + b"\r\n", now_s)
        if answer == b"CONFIG,0":
            self._begin(self._free_s)
        elif answer == b"RESTART":
            self._switch_on(self._free_s + _RESTART_S)
        return [reply]

    def _set(self, name: str, value: str) -> bytes:
        if value not in SETTINGS[name]:
            return f"USAGE,={name},<{'|'.join(SETTINGS[name])}>".encode("ascii")
        wanted = self._settings | {name: value}
        if name in ("DR", "BAUD", "OUTPUTFMT") and (misfit := _misfit(wanted)):
            return misfit
        self._adopt(wanted)
        return f"{name},{value}".encode("ascii")

    def _adopt(self, settings: dict[str, str]) -> None:
        if settings["DR"] != self._settings["DR"]:
            self._invalid = _INVALID_AFTER_RATE_CHANGE
        self._settings = settings

    def _other(self, name: bytes, values: list[bytes], line: bytes, now_s: float) -> bytes:
        """Answer the commands that are not plain settings."""
        if name == b"=CONFIG":
            if values not in ([b"0"], [b"1"]):
                return b"USAGE,=CONFIG,<0|1>"
            return (values == [b"0"] and _misfit(self._settings)) or line.upper()[1:]
        if name == b"=FILTTYPE":
            if len(values) != 2 or values[0] not in self._filter or values[1] not in _FILTERS:
                return b"USAGE,=FILTTYPE,<A|G>,<CHEBY|BUTTER|AVE>"
            self._filter[values[0]] = values[1]
            return line.upper()[1:]
        if name == b"?FILTTYPE":
            known = self._filter.get(b",".join(values))
            return b"USAGE,?FILTTYPE,<A|G>" if known is None else b",".join([name[1:], *values, known])
        if name == b"?BIT" and values in ([], [b"2"]):
            return encode_bit(bytes([_BIT_GOOD] * (8 if values else 6)))
        if values:
            return b"INVALID," + line
        if name == b"?IS":
            return f"IS,{self._serial_number}".encode("ascii", "replace")
        if name == b"?WS":
            return f"WS,{self._firmware}".encode("ascii")
        if name == b"?TEMP":
            return self._temperature(now_s)
        if name == b"=RSTCFG":
            self._adopt(FACTORY | {"BAUD": self._settings["BAUD"]})
            return b"RSTCFG"
        if name == b"=RESTART":
            return _misfit(self._settings) or b"RESTART"
        return b"INVALID," + line

    def _temperature(self, now_s: float) -> bytes:
        begin_s = max(self._measured_s, now_s - self._period_s)
        if begin_s < now_s:
            self._temp_c = float(self._plant.measure(begin_s, 1, now_s - begin_s).temp_c[0])
            self._measured_s = now_s
        if self._temp_c is None:
            return b"ERROR,NO TEMPERATURE YET"
        field = temperature_field(self._temp_c, _temp_units(self._settings))
        return f"TEMP,{float(field):.0f}".encode("ascii")

    def _reply(self, data: bytes, now_s: float) -> Reply:
        self._free_s = max(now_s + _REPLY_DELAY_S, self._free_s) + self._seconds(len(data))
        return Reply(self._free_s, data)

    # The stream.

    def _switch_on(self, at_s: float) -> None:
        """Normal mode with a built-in-test message first (section 5.1)."""
        self._counter = 0
        self._bit, self._bit_after = encode_bit(bytes([_BIT_GOOD] * 6)), 0
        self._begin(at_s)

    def _begin(self, at_s: float) -> None:
        """Start sampling at `at_s` as the settings say."""
        self._configuring = False
        self._start_s = at_s
        self._sent = 0
        self._rate_hz = int(self._settings["DR"])
        self._period_s = self._clock / self._rate_hz
        self._mark_every = max(1, int(self._rate_hz / _MARKS_PER_S))
        self._send_s = self._seconds(layout(_format(self._settings)).length)

    def _seconds(self, count: int) -> float:
        return count * _BITS / int(self._settings["BAUD"])

    def _complete(self, at_s: float) -> int:
        """Count the samples complete at `at_s`, by the same float arithmetic that stamps them."""
        count = max(0, math.floor((at_s - self._start_s) / self._period_s) + 1)
        while count and self._start_s + count * self._period_s > at_s:
            count -= 1
        return count

    def _out_s(self, count: int) -> float:
        """When the last byte of the first `count` messages of this stream is out."""
        return self._start_s + count * self._period_s + (self._send_s if count else 0.0)

    def _data(self, parts: list[StreamBlock], until: int) -> None:
        """Append the data messages still to send of the first `until` of this stream."""
        count = until - self._sent
        if count <= 0:
            return
        sent = np.append(np.arange(self._mark_every, count, self._mark_every), count)
        out_s = self._start_s + (self._sent + sent) * self._period_s + self._send_s
        data = self._messages(count)
        marks = np.empty((len(sent), 2), np.int64)
        marks[:, 0] = sent * (len(data) // count)
        marks[:, 1] = np.rint(out_s * 1e9)
        parts.append(StreamBlock(data, marks))

    def _messages(self, count: int) -> bytes:
        """Measure and encode the next `count` samples."""
        begin_s = self._start_s + self._sent * self._period_s
        signal = self._plant.measure(begin_s, count, self._period_s)
        rot = np.zeros((count, len(AXES)))
        rot[:, self._columns] = signal.angle_increment_rad[:, self._own] * self._rotation_scale()
        status = np.full(count, ALL_VALID)
        if self._invalid:
            bad = min(self._invalid, count)
            rot[:bad], status[:bad] = 0.0, 0
            self._invalid -= bad
        force_g: NDArray[np.float64] | float = 0.0  # reserved bytes of a DSP-1750; a 1775 has all three axes
        if signal.velocity_increment_mps is not None and len(self._columns) == len(AXES):
            force_g = signal.velocity_increment_mps / (self._period_s * STANDARD_GRAVITY_MPS2)
        numbers = np.arange(1, count + 1)
        data = encode_frames(
            _format(self._settings),
            rot,
            counter=self._counter + numbers - 1,
            temp_c=signal.temp_c,
            temp_units=_temp_units(self._settings),
            status=status,
            acc_g=force_g,
            timestamp_us=self._device_time_us(numbers),
        )
        self._counter = (self._counter + count) % COUNTER_MODULO
        self._sent += count
        self._temp_c = float(signal.temp_c[-1])
        self._measured_s = begin_s + count * self._period_s
        return data

    def _device_time_us(self, numbers: NDArray[np.int64]) -> NDArray[np.int64]:
        """Time since switch-on by the unit's own clock."""
        own_s = (self._start_s + (self._sent + numbers) * self._period_s) / self._clock
        time_us: NDArray[np.int64] = np.rint(own_s * 1e6).astype(np.int64)
        return time_us

    def _rotation_scale(self) -> float:
        scale = 1.0 if self._settings["ROTFMT"] == "DELTA" else 1.0 / self._period_s
        return scale if self._settings["ROTUNITS"] == "RAD" else scale * 180.0 / math.pi


def _unusable(found: str, expected: str) -> ConfigurationError:
    return ConfigurationError("no such KVH unit", where="emulated gyro", found=found, expected=expected)


def _delivered(baudrate: int) -> dict[str, str]:
    """Return the settings of a new unit at `baudrate`, at the highest data rate up to the usual one that fits."""
    slower = [str(rate) for rate in RATES_HZ if rate <= int(FACTORY["DR"])]
    all_rates = [FACTORY | {"BAUD": str(baudrate), "DR": rate} for rate in slower]
    return next((settings for settings in reversed(all_rates) if not _misfit(settings)), all_rates[0])


def _misfit(settings: dict[str, str]) -> bytes:
    """Return the refusal of a data rate that leaves no room for a built-in-test message, empty if it fits."""
    bits = (layout(_format(settings)).length + len(encode_bit(bytes(8)))) * _BITS
    if bits * int(settings["DR"]) <= int(settings["BAUD"]):
        return b""
    return f"ERROR,{settings['DR']} HZ DOES NOT FIT {settings['BAUD']} BD".encode("ascii")


def _format(settings: dict[str, str]) -> Format:
    return cast(Format, settings["OUTPUTFMT"])


def _temp_units(settings: dict[str, str]) -> TempUnits:
    return cast(TempUnits, settings["TEMPUNITS"])


def emulator(config: KvhConfig, plant: GyroPlant, installed: Installation) -> KvhEmulator:
    """Make the emulator of a bench file's gyro, which streams, with what it had saved before a power cycle."""
    before = installed.before
    return KvhEmulator(
        plant,
        serial_number=config.unit,
        axes=config.axes,
        baudrate=config.baudrate,
        clock_error_ppm=installed.clock_error_ppm,
        streaming=True,
        settings=before.settings if isinstance(before, KvhEmulator) else None,
    )
