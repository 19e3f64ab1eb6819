"""A platform INS on a serial port: bytes as `drivers.platform` defines them, physics asked of a plant."""

from __future__ import annotations

import math

import numpy as np

from drivers.kit.config import PlatformConfig
from drivers.platform import BAUDRATE
from drivers.platform.codec import NAVIGATING, POSITION_VALID, REGULATED, encode_position, parse, sentence
from simulators.interfaces import Installation, Reply, StreamBlock
from simulators.plant.lab_platform import LabPlatform

_ANSWER_S = 0.02
_BITS_A_BYTE = 10
_LONGEST = 256


class PlatformEmulator:
    """One unit (`simulators.interfaces.StreamingEmulator`), quiet until $PINSQ,START.

    Sentence k stands for lab time k x period and ends when its bytes have passed at `baudrate`.
    """

    def __init__(
        self,
        plant: LabPlatform,
        *,
        serial_number: str = "PINS-01",
        period_s: int = 60,
        baudrate: int = BAUDRATE,
    ) -> None:
        self._plant = plant
        self._serial_number = serial_number
        self._period_s, self._byte_s = period_s, _BITS_A_BYTE / baudrate
        self._streaming = self._navigating = self._force = False
        self._next_s = 0.0
        self._counter = 0
        self._line = b""

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes from the bench; a whole line is answered, noise is dropped."""
        *lines, unfinished = (self._line + data).split(b"\n")
        self._line = unfinished[-_LONGEST:]
        replies = []
        for line in lines:
            fields = parse(line[max(0, line.rfind(b"$")) :].rstrip(b"\r"))
            if fields is None or fields[0] != "PINSQ":
                continue
            answer = self._answer(fields[1:], now_s)
            replies.append(Reply(now_s + _ANSWER_S + self._byte_s * len(answer), answer))
        return replies

    def stream(self, until_s: float) -> StreamBlock | None:
        """Return the sentences that are out by `until_s`."""
        if not self._streaming or self._next_s > until_s:
            return None
        count = math.floor((until_s - self._next_s) / self._period_s) + 1
        times = np.asarray(self._next_s + self._period_s * np.arange(count), dtype=np.float64)
        signal = self._plant.measure(times)
        status = POSITION_VALID | REGULATED | (NAVIGATING if self._navigating else 0)
        parts, marks, sent = [], [], 0
        for at in range(count):
            text = encode_position(
                self._counter,
                signal.latitude_deg[at],
                signal.longitude_deg[at],
                signal.temp_c[at],
                signal.cabinet_temp_c[at],
                status,
                signal.force_mps2[at] if self._force else (),
            )
            self._counter += 1
            parts.append(text)
            sent += len(text)
            marks.append((sent, round((times[at] + self._byte_s * len(text)) * 1e9)))
        self._next_s = float(times[-1]) + self._period_s
        return StreamBlock(b"".join(parts), np.array(marks, dtype=np.int64))

    def _answer(self, command: list[str], now_s: float) -> bytes:
        name = command[0] if command else ""
        if name == "ID":
            return sentence("PINSA", "ID", "gyrobench", "emulated platform INS", self._serial_number, "1.0")
        if name == "PERIOD":
            text = command[1] if len(command) > 1 else ""
            if not (text.isascii() and text.isdigit() and 1 <= int(text) <= 60):
                return sentence("PINSE", "PERIOD is whole seconds from 1 to 60")
            self._period_s = int(text)
            return sentence("PINSA", "PERIOD", str(self._period_s))
        if name == "FORCE":
            if command[1:] not in (["0"], ["1"]):
                return sentence("PINSE", "FORCE is 0 or 1")
            self._force = command[1] == "1"
            return sentence("PINSA", *command)
        if name == "START":
            self._streaming = True
            self._next_s = self._period_s * math.ceil((now_s + _ANSWER_S) / self._period_s)
            return sentence("PINSA", "START")
        if name == "STOP":
            self._streaming = False
            return sentence("PINSA", "STOP")
        if name == "NAVIGATE":
            if not self._navigating:
                self._plant.align(now_s)
            self._navigating = True
            return sentence("PINSA", "NAVIGATE")
        return sentence("PINSE", "unknown command")


def emulator(config: PlatformConfig, plant: LabPlatform, installed: Installation) -> PlatformEmulator:
    """Make the emulator of a bench file's platform INS."""
    return PlatformEmulator(
        plant, serial_number=config.unit, period_s=config.period_s, baudrate=config.baudrate
    )
