"""CTS chambers: frames, commands and answers, without any I/O.

Sources: CTS's pages on its interface (cts-umweltsimulation.de and cts-bayern.de: construction of the protocol,
reading analog values, gradients, digital channels, text of error), ppudo/labtoys_python (MIT: TCP without frames)
and cts-chamber (GPL-3.0, tried by its author on a chamber: the status, the form of values).

A frame is STX, address, data, check value, ETX; bit 7 of all between STX and ETX is set, the check value is the
exclusive or of address and data. On TCP port 1080 the data go bare, and nothing says where they end.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import reduce
from operator import xor

from drivers.base.errors import ProtocolError

STX, ETX = 0x02, 0x03
RESOLUTION_C = 0.1
FASTEST_K_PER_MIN = 999.9
"""The gradient that means a step."""
AIR, GRADIENTS, STATUS, ERROR_TEXT, CHANNELS = "A0", "U1", "S", "F", "O"
START, STOP = "s1 1", "s1 0"
REPLY_BYTES: Mapping[str, int] = {"A": 14, "U": 14, "S": 10, "F": 33, "a": 1, "u": 1, "d": 1, "s": 2}
"""How long a bare answer is, by its first letter; that of `O` depends on the chamber."""
COMMAND = re.compile(r"A\d|a\d [\d.-]{5}|U\d|[ud]\d [\d.]{5}|s[\d:;] [01]|[ER]\d|[SFOP]|p\d{3}|o\d\d [01]")
"""What a command looks like where nothing ends it."""
_VALUE = r"(-\d\d\.\d|\d{3}\.\d)"
_ANALOG = re.compile(rf"A(\d) {_VALUE} {_VALUE}")
_GRADIENTS = re.compile(r"U(\d) (\d{3}\.\d|\d\d\.\d\d) (\d{3}\.\d|\d\d\.\d\d)")
_STATUS = re.compile(r"S([01]{8}).", re.DOTALL)


@dataclass(frozen=True)
class Analog:
    """The answer to `An`: actual value and set point, of temperatures in degC."""

    actual: float
    set_point: float


@dataclass(frozen=True)
class Status:
    """The answer to `S`, as far as a chamber without humidity needs it."""

    running: bool
    error: bool
    paused: bool


def encode_frame(address: int, text: str) -> bytes:
    """Return a frame with the address 1 to 32 and some data."""
    content = bytes(byte | 0x80 for byte in (address, *text.encode("ascii")))
    return bytes([STX, *content, reduce(xor, content) | 0x80, ETX])


def decode_frame(frame: bytes) -> tuple[int, str]:
    """Return address and data of a frame, what is before its STX passed over; raises ProtocolError."""
    content = frame[frame.rfind(STX) + 1 : -1]
    whole = frame[-1:] == bytes([ETX]) and frame.rfind(STX) >= 0 and len(content) >= 3
    if not whole or any(byte < 0x80 for byte in content) or reduce(xor, content[:-1]) | 0x80 != content[-1]:
        raise ProtocolError(
            "not a frame of a CTS chamber",
            found=frame[:40].hex(" "),
            expected="STX, address, data with bit 7 set, their check value, ETX",
            remedy="check that the port belongs to a CTS chamber and that its line has odd parity",
        )
    return content[0] & 0x7F, bytes(byte & 0x7F for byte in content[1:-1]).decode("ascii")


def set_text(temp_c: float) -> str:
    """Return the command for the temperature's set point: 023.5, -14.5."""
    return f"a0 {temp_c:05.1f}"


def gradient_text(up: bool, k_per_min: float) -> str:
    """Return the command for the temperature's gradient: two decimals below 100 K/min, where they fit."""
    value = f"{k_per_min:05.2f}" if k_per_min < 99.995 else f"{k_per_min:05.1f}"
    return f"{'u' if up else 'd'}1 {value}"


def decode_analog(reply: str, channel: int = 0) -> Analog:
    """Return the values of a channel; raises ProtocolError."""
    found = _ANALOG.fullmatch(reply)
    if not found or int(found[1]) != channel:
        raise _misfit(reply, f"A{channel}", "actual value and set point, e.g. A0 -14.5 -13.8")
    return Analog(float(found[2]), float(found[3]))


def decode_gradients(reply: str) -> tuple[float, float]:
    """Return the temperature's gradients up and down, K/min; raises ProtocolError."""
    found = _GRADIENTS.fullmatch(reply)
    if not found or found[1] != "1":
        raise _misfit(reply, GRADIENTS, "gradients up and down, e.g. U1 002.5 999.9")
    return float(found[2]), float(found[3])


def decode_status(reply: str) -> Status:
    """Return the state; what comes behind the error's number is passed over. Raises ProtocolError."""
    found = _STATUS.match(reply)
    if not found:
        raise _misfit(reply, STATUS, "S, eight of 0 or 1, and an error's number")
    running, error, goes_on = (flag == "1" for flag in found[1][:3])
    return Status(running, error, not goes_on)


def decode_error_text(reply: str) -> str:
    """Return the text of the error, which is padded to 32 characters; raises ProtocolError."""
    if not reply.startswith("F") or len(reply) != REPLY_BYTES["F"] or not reply.isprintable():
        raise _misfit(reply, ERROR_TEXT, "F and 32 characters")
    return reply[1:].strip()


def decode_channels(reply: str) -> str:
    """Return the digital channels as characters 0 and 1, counted from 0; raises ProtocolError."""
    if not re.fullmatch("O[01]{3,99}", reply):
        raise _misfit(reply, CHANNELS, "O and a 0 or 1 for each digital channel")
    return reply[1:]


def _misfit(reply: str, question: str, expected: str) -> ProtocolError:
    return ProtocolError(f"not an answer to {question}", found=repr(reply[:60]), expected=expected)
