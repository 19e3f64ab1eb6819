"""Thermotron 8200, 8800 and 3800: command lines and answers, without any I/O.

Sources. 8800: Thermotron's list of interface commands (thermotron.com, Commands.html, its beginning) and two
public programs that quote its manual, in C# (RemoteTempChamber) and Python (ThermotronChamber). 8200: a firmware
that quotes its manual (TC_THERMOTRON_8200.c), a Python class on TCP (Thermotron8200Controller: MRMP, STAT?).
3800: pymeasure's Thermotron3800 (MIT) and a Python class on TCP (Termotron3800).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from drivers.base.errors import ProtocolError

CR = b"\r"
RESOLUTION_C = 0.1
AIR, SET_POINT, IDENTITY = "PVAR1?", "SETP1?", "IDEN?"
CELSIUS, PRODUCT_CONTROL = 0, 1
"""Of `TMPS?`; a bit of `OPTN?`: the air then follows a product sensor, not its own set point."""
CHANNELS = (*range(2, 9), *range(13, 29))
"""Process variables beside the air, and the monitor channels."""
TEMPERATURE_TYPES = (1, 10, 14, 15)
"""Of `DTYPn?`: a temperature, an average, minimum or maximum of some."""
ALARM_BITS: Mapping[int, str] = {
    0: "low deviation alarm",
    1: "high deviation alarm",
    4: "low process alarm",
    5: "high process alarm",
}
MANUAL = 16
"""Run manual mode, of `STAT?` and of `MODE?`."""
RUNNING_CODE = 1
STOP_CODES: Mapping[int, str] = {
    0: "cold boot",
    2: "stop key pressed",
    3: "end of test",
    4: "an external input defined as stop",
    5: "stopped by the computer interface",
    6: "open thermocouple or analog input",
    7: "process alarm",
    8: "system monitor trip",
    9: "recovered from a power failure",
    10: "Therm-Alarm trip",
    12: "compressor fault",
    18: "invalid program",
    24: "AST module lost",
    26: "open door",
    27: "humidity sensors diverge",
    28: "humidity sensors failed",
    30: "deviation alarm",
    31: "remote set point input",
    32: "humidity sensor open",
    35: "controlled stop completed",
    36: "air pressure of the shaker exceeded",
}
"""Of `SCOD?`: why it went to stop last; 1 while it runs."""

Name = Literal["8200", "8800", "3800"]
_NUMBER = re.compile(r"[+-]?\d{1,6}(\.\d{1,6})?")
_PREFIX = b"\xff#"


@dataclass(frozen=True)
class Controller:
    """What is public of a controller's commands.

    `status` tells by the bits `running` that it conditions, by `MANUAL` in which mode. `tells_all`: unit,
    options, limits, alarms and the demand. `loads_on_run`: a set point counts from the next RUNM on.
    `channels`: what it reads beside the air.
    """

    status: str
    running: int
    tells_all: bool = False
    ramps: bool = True
    tells_stop: bool = False
    loads_on_run: bool = False
    channels: tuple[int, ...] = CHANNELS


CONTROLLERS: Mapping[Name, Controller] = {
    "8800": Controller("STAT?", 1 | 2 | 4 | MANUAL | 32, tells_all=True, tells_stop=True),
    "8200": Controller("STAT?", 1 | 2 | 4 | MANUAL | 32),
    "3800": Controller("MODE?", 1 | MANUAL, ramps=False, tells_stop=True, loads_on_run=True, channels=()),
}


def encode_line(text: str, address: int | None = None) -> bytes:
    """Return a command or query as it goes on the line; `address`: on RS-485."""
    return _prefix(address) + text.encode("ascii") + CR


def set_point_text(temp_c: float) -> str:
    """Return the command for the set point of the air."""
    return f"SETP1,{temp_c:.3f}"


def ramp_text(k_per_min: float) -> str:
    """Return the command for the ramp of the air in manual mode."""
    return f"MRMP1,{k_per_min:.1f}"


def decode_line(line: bytes, address: int | None = None) -> str:
    """Return the text of an answer, its line end included or not; ProtocolError if it is another's."""
    _, found, data = line.rpartition(_prefix(address)) if address is not None else (b"", b"", line)
    if address is not None and not found:
        raise ProtocolError(
            "not an answer of this address", found=repr(line[:60]), expected=f"0xFF, # and address {address}"
        )
    return data.decode("latin-1").strip()


def decode_text(reply: str) -> str:
    """Return an answer in words; raises ProtocolError."""
    if not reply or not reply.isascii() or not reply.isprintable():
        raise ProtocolError("not a text of a Thermotron", found=repr(reply[:60]), expected="a line of ASCII")
    return reply


def decode_identity(reply: str) -> str:
    """Return the answer to `IDEN?`, which alone has letters; raises ProtocolError."""
    text = decode_text(reply)
    if not any(character.isalpha() for character in text):
        raise ProtocolError(
            "not an answer to IDEN?", found=repr(reply[:60]), expected="words, e.g. 8800 Chamber Controller"
        )
    return text


def decode_number(reply: str) -> float:
    """Return the value of an answer such as 22.000; raises ProtocolError."""
    if not _NUMBER.fullmatch(reply):
        raise ProtocolError(
            "not a value of a Thermotron",
            found=repr(reply[:60]),
            expected="a number, e.g. 22.000",
            remedy="check that the port belongs to a Thermotron and that no byte was lost",
        )
    return float(reply)


def decode_code(reply: str) -> int:
    """Return a coded integer, a full stop at its end included or not; raises ProtocolError."""
    digits = reply.removesuffix(".")
    if not digits.isascii() or not digits.isdecimal() or len(digits) > 6:
        raise ProtocolError(
            "not a code of a Thermotron", found=repr(reply[:60]), expected="a whole number, e.g. 16"
        )
    return int(digits)


def stop_words(code: int) -> str:
    """Return what a stop code means."""
    return f"stopped, code {code}: {STOP_CODES.get(code, 'see the stop codes in the manual')}"


def _prefix(address: int | None) -> bytes:
    return b"" if address is None else _PREFIX + bytes([address])


class Readings:
    """Puts the answers of a poll together: air, auxiliary channels, and the set point, which ends it."""

    def __init__(self) -> None:
        self._row: dict[str, float] = {}

    def take(self, asked: str, value: float) -> dict[str, float] | None:
        """Take an answer; return a row when it completes one."""
        if asked == AIR:
            self._row = {"air_temp_c": value}
        elif asked == SET_POINT and self._row:
            row, self._row = self._row, {}
            return {**row, "set_point_c": value}
        elif self._row and (found := re.fullmatch(r"PVAR(\d{1,3})\?", asked)):
            self._row[f"aux_{found[1]}_temp_c"] = value
        return None
