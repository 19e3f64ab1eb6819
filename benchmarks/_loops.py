"""The loops that people write for frames and lines: find the head, check in Python, unpack with struct or split.

One for each description that comes along, as plain as its device allows: a CRC by one table a byte, sums by
Python's own `sum`, numbers by `struct`, columns by `split`. Each returns all numbers of a sound frame, else None.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from dataclasses import dataclass

Numbers = tuple[float, ...]
Read = Callable[[bytes], Numbers | None]


def crc_table(width: int, poly: int) -> list[int]:
    """Return the table of a CRC that takes bytes most significant bit first."""
    top, mask = 1 << (width - 1), (1 << width) - 1
    table = []
    for byte in range(256):
        value = byte << (width - 8)
        for _ in range(8):
            value = (value << 1 ^ (poly if value & top else 0)) & mask
        table.append(value)
    return table


_CRC8, _CRC16, _CRC32 = crc_table(8, 0x07), crc_table(16, 0x1021), crc_table(32, 0x04C11DB7)
_REFLECTED = []
for _byte in range(256):
    for _ in range(8):
        _byte = _byte >> 1 ^ (0xEDB88320 if _byte & 1 else 0)
    _REFLECTED.append(_byte)


def crc8(data: bytes, register: int = 0xFF) -> int:
    """CRC-8 by one table, byte after byte."""
    for byte in data:
        register = _CRC8[register ^ byte]
    return register


def crc16(data: bytes, register: int) -> int:
    """CRC-16 of polynomial 1021, likewise."""
    for byte in data:
        register = (register << 8 & 0xFFFF) ^ _CRC16[register >> 8 ^ byte]
    return register


def crc32(data: bytes) -> int:
    """CRC-32/MPEG-2, likewise."""
    register = 0xFFFFFFFF
    for byte in data:
        register = (register << 8 & 0xFFFFFFFF) ^ _CRC32[register >> 24 ^ byte]
    return register


def _kvh(frame: bytes) -> Numbers | None:
    return struct.unpack(">4x6fBBh4x", frame) if crc32(frame) == 0 else None


def _stim300(frame: bytes) -> Numbers | None:
    if crc32(frame[:-4] + b"\0\0") != int.from_bytes(frame[-4:], "big"):  # 34 bytes, padded to 36
        return None
    numbers = [
        int.from_bytes(frame[at : at + 3], "big", signed=True) for at in (1, 4, 7, 11, 14, 17, 21, 24, 27)
    ]
    return (*numbers, frame[10], frame[20], frame[30], frame[31], int.from_bytes(frame[32:34], "big"))


def _stim210(frame: bytes) -> Numbers | None:
    if crc8(frame[:-1]) != frame[-1]:
        return None
    numbers = [int.from_bytes(frame[at : at + 3], "big", signed=True) for at in (1, 4, 7)]
    return (*numbers, *struct.unpack(">B3hBH", frame[10:-1]))


def _openimu(frame: bytes) -> Numbers | None:
    if crc16(frame[2:-2], 0x1D0F) != int.from_bytes(frame[-2:], "big"):
        return None
    return struct.unpack("<5xI9f2x", frame)


def _vectornav(frame: bytes) -> Numbers | None:
    return struct.unpack("<4xQ6f2x", frame) if crc16(frame[1:], 0) == 0 else None


def _hipnuc(frame: bytes) -> Numbers | None:
    if crc16(frame[:4] + frame[6:], 0) != int.from_bytes(frame[4:6], "little"):
        return None
    return struct.unpack("<7xHbfI16f", frame)


def _rlg2t(frame: bytes) -> Numbers | None:
    if crc16(frame[2:-2], 0xFFFF) != int.from_bytes(frame[-2:], "big"):
        return None
    return struct.unpack(">2xihhHB2x", frame)


def _hg4930(frame: bytes) -> Numbers | None:
    words = struct.unpack("<10H", frame)
    return struct.unpack("<2x6h2H2x", frame) if sum(words[:-1]) & 0xFFFF == words[-1] else None


def _astrix(frame: bytes) -> Numbers | None:
    words = struct.unpack("<13H", frame)
    return struct.unpack("<2x4IHI2x", frame) if sum(words[:-1]) & 0xFFFF == words[-1] else None


def _fg333(frame: bytes) -> Numbers | None:
    return struct.unpack(">2xi3H4xBBx", frame) if sum(frame[:-1]) & 0xFF == frame[-1] else None


def _rawimusa(line: bytes) -> Numbers | None:
    body, _, digits = line.partition(b"*")
    register = 0
    for byte in body[1:]:
        register = register >> 8 ^ _REFLECTED[(register ^ byte) & 0xFF]
    if int(digits, 16) != register:
        return None
    week, seconds, status, *counts = body.partition(b";")[2].split(b",")
    return (int(week), float(seconds), int(status, 16), *map(int, counts))


def _vnymr(line: bytes) -> Numbers | None:
    body, _, digits = line.partition(b"*")
    check = 0
    for byte in body[1:]:
        check ^= byte
    if int(digits, 16) != check:
        return None
    return tuple(map(float, body.split(b",")[1:]))


def _dsp3000(line: bytes) -> Numbers | None:
    rate, flag = line.split()
    return float(rate), int(flag)


@dataclass(frozen=True)
class Loop:
    """What reads one message of a description: where a frame begins, its bytes, and what reads it."""

    message: str | None
    sync: bytes
    length: int
    read: Read

    def __call__(self, data: bytes) -> list[Numbers]:
        """Decode frame after frame."""
        found = []
        at = data.find(self.sync)
        while 0 <= at <= len(data) - self.length:
            numbers = self.read(data[at : at + self.length])
            if numbers is not None:
                found.append(numbers)
                at += self.length
            else:
                at += 1
            at = data.find(self.sync, at)
        return found


@dataclass(frozen=True)
class LineLoop:
    """What reads the lines of a description."""

    start: bytes
    read: Read

    def __call__(self, data: bytes) -> list[Numbers]:
        """Decode line after line; a broken one is passed over."""
        found = []
        for line in data.split(b"\r\n")[:-1]:
            if not line.startswith(self.start):
                continue
            try:
                numbers = self.read(line)
            except ValueError:
                continue
            if numbers is not None:
                found.append(numbers)
        return found


LOOPS = {
    "kvh": Loop("a", bytes.fromhex("FE81FF55"), 36, _kvh),
    "stim300": Loop("rate_acc_incl", b"\x93", 38, _stim300),
    "stim210": Loop("rate_temp_counter_latency", b"\xa8", 21, _stim210),
    "openimu": Loop(None, bytes.fromhex("55557A3128"), 47, _openimu),
    "vectornav": Loop("imu", bytes.fromhex("FA010102"), 38, _vectornav),
    "hipnuc": Loop(None, bytes.fromhex("5AA54C00"), 82, _hipnuc),
    "rlg2t": Loop(None, bytes.fromhex("EB90"), 15, _rlg2t),
    "hg4930": Loop("control", b"\x0e\x01", 20, _hg4930),
    "astrix_ns": Loop("filtered", b"\x87\x14", 26, _astrix),
    "fg333": Loop(None, bytes.fromhex("EB90"), 19, _fg333),
}
"""Description -> loop. The last three check a sum, which Python's `sum` adds up without a loop of its own."""

LINE_LOOPS = {
    "novatel_rawimusa": LineLoop(b"%RAWIMUSA,", _rawimusa),
    "vectornav_ymr": LineLoop(b"$VNYMR,", _vnymr),
    "kvh_dsp3000": LineLoop(b"", _dsp3000),
}
