"""ACUTROL3000 bytes: command lines, framed replies and status words, without any I/O.

Sources: TM-8004-C "ACUTROL3000 Command Language (ACL) Programming Manual" (commands, Appendix B status bits),
TM-9374A section 3.4.2 (reply layout: error code, length, text), TM-9389 release notes, and a public TCP driver
(AcutronicRobotics/acutrol) that skips eight bytes and expects `OK`.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass

from drivers.base.errors import ProtocolError

TERMINATOR = b"\r\n"
HEADER_BYTES = 8
MAX_TEXT_BYTES = 32768
"""Longest ACL message the manual allows; a longer length in a header is not a length."""

STATE_BITS: Mapping[int, str] = {
    4: "axis servoed",
    5: "normal unservo",
    6: "software abort",
    7: "hardware abort",
    8: "status latched",
    9: "data freeze active",
}
"""Register A<n>STATE; bits 0-3 are the mode number."""

SOFTWARE_FAULT_BITS: Mapping[int, str] = {
    0: "software abort initiated",
    1: "rate trip",
    2: "position tracking error",
    3: "frame time error",
    4: "program error",
    5: "miscorrelation error",
    6: "AIM calibration constants CRC error",
    7: "fine transducer feedback loss",
    8: "coarse transducer feedback loss",
    9: "self-test failure",
    12: "position tracking error (old firmware)",
}
"""Register A<n>SWFLT; release notes #119: old firmware reports the tracking error in bit 12."""

INTERLOCK_BITS: Mapping[int, str] = {
    **{bit: f"interlock input {bit}" for bit in range(6)},
    6: "power amplifier acknowledge",
    7: "auxiliary servo interlock 1",
    8: "auxiliary servo interlock 2",
    9: "master interlock",
    10: "DMA sync error",
    11: "software watchdog",
    12: "10 kHz clock watchdog",
    13: "serial data link fault",
    14: "servo interlock link",
    15: "10 kHz lock fault",
}
"""Register A<n>INTLK."""

ERROR_BITS: Mapping[int, str] = {
    0: "floating point exception",
    1: "segmentation fault",
    2: "servo not enabled",
    3: "DMA interrupt not enabled",
    4: "divide by zero",
    5: "drive not enabled",
    6: "NaN detected",
    7: "general axis error",
}
"""Register A<n>ERR."""

_DIAGNOSED = (
    *("temperature", "+5 V analog", "reference 2", "reference 1"),
    *("-12 V", "+12 V", "+5 V digital", "second temperature"),
)
DIAGNOSTIC_BITS: Mapping[int, str] = {
    2 * pair + bit: f"{what} {word}"
    for pair, what in enumerate(_DIAGNOSED)
    for bit, word in enumerate(("fault", "warning"))
}
"""Register A<n>DIAG; the manual names bits 14 and 15 as it does 0 and 1."""


@dataclass(frozen=True)
class Reply:
    """What the device answered: its error code (0 = done) and text without padding."""

    error: int
    text: str


def encode_command(header: str, *arguments: int | float | str) -> bytes:
    """Return one command line: header, space, comma-separated arguments, CR LF. Floats get six decimals."""
    fields = [f"{value:.6f}" if isinstance(value, float) else str(value) for value in arguments]
    line = f"{header} {','.join(fields)}" if fields else header
    return line.encode("ascii") + TERMINATOR


def encode_reply(error: int, text: str) -> bytes:
    """Return a framed reply as a little-endian controller (Intel) sends it."""
    data = text.encode("latin-1")
    return struct.pack("<II", error, len(data)) + data


def decode_header(header: bytes) -> tuple[int, int]:
    """Return (error code, text length in bytes) of eight header bytes in either byte order.

    The manuals give the layout and not the byte order. A length above 32768 cannot be one, so at most one order
    fits unless the length is 0; then the smaller error code is taken. Raises ProtocolError if neither fits.
    """
    orders: list[tuple[int, int]] = [struct.unpack("<II", header), struct.unpack(">II", header)]
    plausible = [pair for pair in orders if pair[1] <= MAX_TEXT_BYTES]
    if not plausible:
        raise ProtocolError(
            "reply header without a plausible length",
            found=header.hex(" "),
            expected=f"error code and length (at most {MAX_TEXT_BYTES}), 32 bits each",
            remedy="check that the port belongs to an ACUTROL3000 and that no byte was lost on the line",
        )
    return min(plausible)


def decode_text(data: bytes) -> str:
    """Return the text of a reply without the NUL, CR and LF some firmware pads it with."""
    return data.decode("latin-1").strip("\0\r\n ")


def split_reply(buffer: bytes) -> tuple[Reply, int] | None:
    """Return the first reply in `buffer` and the bytes it takes; None while incomplete; raises ProtocolError."""
    if len(buffer) < HEADER_BYTES:
        return None
    error, length = decode_header(buffer[:HEADER_BYTES])
    end = HEADER_BYTES + length
    if len(buffer) < end:
        return None
    return Reply(error, decode_text(buffer[HEADER_BYTES:end])), end


def encode_state_query(*axes: int, marked: bool = False) -> bytes:
    """Return the one line that polls angle and rate of axes (TM-8004-C 4.10.5, joined reads).

    `marked`: the first angle once more at the end. Every other poll asks so: its answer cannot be taken for that
    to the poll before.
    """
    reads = ";".join(f"pos? {axis};rate? {axis}" for axis in axes) + (f";pos? {axes[0]}" if marked else "")
    return f":read:{reads}".encode("ascii") + TERMINATOR


def decode_numbers(text: str, count: int) -> tuple[float, ...]:
    """Return the `count` numbers of a reply, separated by `;` or `,`; raises ProtocolError."""
    try:
        values = tuple(float(field) for field in text.replace(",", ";").split(";"))
    except ValueError:
        values = ()
    if len(values) != count or not all(math.isfinite(value) for value in values):
        raise ProtocolError(
            "a reply does not hold the numbers asked for",
            found=repr(text),
            expected=f"{count} numbers",
            remedy="check the axis number and that the controller answers in FLOAT format",
        )
    return values


def bits_in_words(word: int, names: Mapping[int, str]) -> list[str]:
    """Return the names of the bits set in a status word, lowest first; an unnamed bit is called by its number."""
    return [names.get(bit, f"bit {bit}") for bit in range(16) if word >> bit & 1]
