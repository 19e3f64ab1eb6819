"""The adapter between an emulated CAN bus and a serial port, as LAWICEL's CAN232/CANUSB manual describes it."""

from __future__ import annotations

from drivers.kit.slcan_codec import BITRATE_COMMANDS, SlcanParser
from simulators.interfaces import Reply

_OK, _REFUSED = b"\r", b"\a"
_LINE_LIMIT = 64
_BITRATE_OF = {command.rstrip(): bitrate for bitrate, command in BITRATE_COMMANDS.items()}


class SlcanAdapter:
    """Commands in, answers out; frames of the bus pass while the channel is open at the bus's own bit rate.

    It answers C, S, O, L, V, N, F, t, T, r and R, each ended by CR; CR says yes, BEL no (unknown command, a
    channel that is open or closed at the wrong time). An adapter set to another bit rate than the bus opens its
    channel and receives nothing. Frames sent to the bus are acknowledged and go nowhere: nobody there listens.
    """

    def __init__(self, bus_bitrate: int, *, serial_number: str = "GB01") -> None:
        self._bus_bitrate = bus_bitrate
        self._serial_number = serial_number
        self._bitrate: int | None = None
        self._open = False
        self._line = b""

    @property
    def passing(self) -> bool:
        """Whether frames of the bus reach the port."""
        return self._open and self._bitrate == self._bus_bitrate

    def receive(self, data: bytes, now_s: float) -> list[Reply]:
        """Take bytes the bench wrote, any chunking, and return one answer a line."""
        *lines, self._line = (self._line + data).split(b"\r")
        self._line = self._line[-_LINE_LIMIT:]
        return [Reply(now_s, self._answer(line)) for line in lines]

    def _answer(self, line: bytes) -> bytes:
        command = line[:1]
        if not line:
            return _OK
        if command == b"V" and len(line) == 1:
            return b"V1013" + _OK
        if command == b"N" and len(line) == 1:
            return b"N" + self._serial_number.encode("ascii") + _OK
        if line in _BITRATE_OF and not self._open:
            self._bitrate = _BITRATE_OF[line]
            return _OK
        if line in (b"O", b"L") and not self._open and self._bitrate is not None:
            self._open = True
            return _OK
        if line == b"C" and self._open:
            self._open = False
            return _OK
        if line == b"F" and self._open:
            return b"F00" + _OK
        if command in (b"t", b"T", b"r", b"R") and self._open and len(SlcanParser().feed(line + b"\r")):
            return _OK
        return _REFUSED
