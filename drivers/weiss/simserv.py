"""SimServ of Weiss and Vötsch chambers: numbered commands with fields separated by byte B6, without any I/O.

Source: "S!MPAC simserv" communication protocol as quoted by public drivers (IzaakWN/ClimateChamberMonitor,
SengerM/VotschTechnik-climate-chamber-Python, SiLab-Bonn/basil).
"""

from __future__ import annotations

import enum
from collections.abc import Mapping
from dataclasses import dataclass

from drivers.base.errors import ProtocolError

SEPARATOR = "¶"
"""Byte B6, which is this character in Latin-1."""

REQUEST_END = b"\r"
REPLY_END = b"\r\n"

OK = 1
NOT_AVAILABLE = -4
UNKNOWN_COMMAND = -5
WRONG_PARAMETERS = -6
NOT_READABLE = -8

STATUS_TEXTS: Mapping[int, str] = {
    OK: "done",
    NOT_AVAILABLE: "test system not available",
    UNKNOWN_COMMAND: "unknown command",
    WRONG_PARAMETERS: "wrong or too few parameters",
    NOT_READABLE: "data could not be read",
}


class Number(enum.IntEnum):
    """Command numbers."""

    CHAMBER_STATUS = 10012
    SET_SET_POINT = 11001
    GET_SET_POINT = 11002
    GET_ACTUAL = 11004
    GET_INPUT_MINIMUM = 11007
    GET_INPUT_MAXIMUM = 11009
    GET_VARIABLE_COUNT = 11018
    GET_UNIT = 11023
    GET_NAME = 11026
    GET_GRADIENT_UP = 11066
    SET_GRADIENT_UP = 11068
    GET_GRADIENT_DOWN = 11070
    SET_GRADIENT_DOWN = 11072
    GET_MEASURED = 12002
    SET_DIGITAL_OUT = 14001
    GET_DIGITAL_OUT = 14003
    GET_DIGITAL_OUT_NAME = 14010
    MESSAGE_COUNT = 17002
    MESSAGE_TYPE = 17005
    MESSAGE_TEXT = 17007
    MESSAGE_ACTIVE = 17009
    RESET_ERRORS = 17012
    CHAMBER_INFO = 99997


class ChamberStatus(enum.IntFlag):
    """Bits of the chamber status (10012)."""

    AVAILABLE = 1
    RUNNING = 2
    WARNING = 4
    ALARM = 8


MESSAGE_TYPES: Mapping[int, str] = {1: "alarm", 2: "warning", 4: "info"}


@dataclass(frozen=True)
class SimServReply:
    """Status of the command (1 = done) and the fields after it."""

    status: int
    fields: tuple[str, ...] = ()


def encode_request(number: int, *arguments: object, chamber: int = 1) -> bytes:
    """Return a request: number, chamber index, arguments. The index is irrelevant and always 1 in practice."""
    return SEPARATOR.join(map(str, (int(number), chamber, *arguments))).encode("latin-1") + REQUEST_END


def encode_simserv_reply(status: int, *fields: object) -> bytes:
    """Return a reply: status, fields, CR LF."""
    return SEPARATOR.join(map(str, (status, *fields))).encode("latin-1") + REPLY_END


def decode_simserv_reply(reply: bytes) -> SimServReply:
    """Return the reply of one line; raises ProtocolError if it does not begin with a status."""
    status, *fields = reply.decode("latin-1").strip("\r\n").split(SEPARATOR)
    try:
        return SimServReply(int(status), tuple(fields))
    except ValueError:
        raise ProtocolError(
            "not a SimServ reply",
            found=repr(reply[:60]),
            expected="a status number, fields separated by byte B6, CR LF",
            remedy="check that the chamber's controller speaks SimServ, else configure simserv = false",
        ) from None
