"""ESPEC P-300 and SCP-220: command lines and replies, without any I/O.

Source: ESPEC North America's own ChamberConnectLibrary (MIT). Lines end in CR LF both ways; on RS-485 a command
begins with the chamber's address. A refusal is `NA:` and a reason.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from drivers.base.errors import ProtocolError

END = b"\r\n"
RESOLUTION_C = 0.1

REFUSALS: Mapping[str, str] = {
    "CMD ERR": "the command is not known",
    "ADDR ERR": "the address is not this chamber's",
    "CONT NOT READY-1": "the chamber has no product temperature control or humidity",
    "CONT NOT READY-2": "no program is running",
    "CONT NOT READY-3": "this controller has no such command",
    "CONT NOT READY-4": "keys cannot be locked while the controller is off",
    "CONT NOT READY-5": "that time signal is not enabled",
    "DATA NOT READY": "there is no such program",
    "PARA ERR": "a parameter is missing or not understood",
    "DATA OUT OF RANGE": "a value is outside its range",
    "PROTECT ON": "changes are locked at the chamber's panel",
    "INVALID REQ": "the function is not supported",
    "CHB NOT READY": "the chamber cannot do that now",
}
"""What follows `NA:`, in words; PRGM WRITE ERR-1 to -15 come from editing programs, which this driver never
does."""


@dataclass(frozen=True)
class Temperatures:
    """The answer to `TEMP?`: measured, set point in force, upper and lower limit, all in degC."""

    measured_c: float
    set_point_c: float
    upper_c: float
    lower_c: float


def encode_line(text: str, address: int | None = None) -> bytes:
    """Return a command or query as it goes on the line."""
    return (text if address is None else f"{address},{text}").encode("ascii") + END


def set_temperature_text(set_point_c: float) -> str:
    """Return the command for the constant set point."""
    return f"TEMP, S{set_point_c:.1f}"


def ramp_minutes(start_c: float, end_c: float, k_per_min: float) -> int:
    """Return how long a ramp lasts: whole minutes, rounded up so that it is never faster than asked for."""
    return max(1, math.ceil(round(abs(end_c - start_c) / k_per_min, 6)))


def ramp_text(start_c: float, end_c: float, k_per_min: float) -> str:
    """Return the remote program of one step that ramps from `start_c` to `end_c`."""
    hours, minutes = divmod(ramp_minutes(start_c, end_c, k_per_min), 60)
    return f"RUN PRGM, TEMP{start_c:.1f} TIME{hours}:{minutes:02d} GOTEMP{end_c:.1f}"


def decode_temperatures(reply: str) -> Temperatures:
    """Return the values of a reply to `TEMP?`; raises ProtocolError."""
    fields = reply.split(",")
    try:
        values = [float(field) for field in fields]
    except ValueError:
        values = []
    if len(values) != 4 or not all(map(math.isfinite, values)):
        raise ProtocolError(
            "not a reply to TEMP?",
            found=repr(reply[:60]),
            expected="four numbers: measured, set point, upper and lower limit",
            remedy="check that the port belongs to an ESPEC chamber and that no byte was lost",
        )
    return Temperatures(*values)


def decode_alarms(reply: str) -> list[int]:
    """Return the codes of a reply to `ALARM?`, which begins with their number; raises ProtocolError."""
    fields = reply.split(",")
    if not all(field.strip().isdecimal() for field in fields) or int(fields[0]) != len(fields) - 1:
        raise ProtocolError(
            "not a reply to ALARM?", found=repr(reply[:60]), expected="a number and so many alarm codes"
        )
    return [int(field) for field in fields[1:]]


def refusal_words(text: str) -> str:
    """Return a refusal's reason with what it means."""
    meaning = REFUSALS.get(text.strip())
    return f"{text.strip()} ({meaning})" if meaning else text.strip()
