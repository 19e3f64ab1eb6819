"""Ideal Aerosmith table language (ATL): three letters and a number, an answer line, a prompt. No I/O.

No manual of the maker is public. Sources: actigraph/RateTableSweepGUI, a GM script for an IMU test suite and
a GUI for the 1270VS, which agree on what is used here: `>` ends an answer, `?` in it says no. Lines end in CR,
LF or both, and a command may be echoed before its answer.
"""

from __future__ import annotations

import math
import re

from drivers.base.errors import ProtocolError

END = b"\r\n"
PROMPT = b">"
POSITION, RATE, STATUS = b"PPO", b"PVE", b"STA"
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_REPLY = re.compile(rb"([^>]*)>")
_ECHO = re.compile(rb"[A-Z]{3}(?:[-+]?\d+(?:\.\d*)?)?")


def encode(mnemonic: str, value: float | None = None, *, signed: bool = False) -> bytes:
    """Return a command line; numbers have six decimals, those of a sense (`signed`) always a sign."""
    number = "" if value is None else f"{value:+.6f}" if signed else f"{value:.6f}"
    return f"{mnemonic}{number}".encode("ascii") + END


def split_reply(buffer: bytes) -> tuple[bytes, int] | None:
    """Return the first answer in `buffer`, without line ends and echoes, and the bytes it takes; None while
    incomplete."""
    found = _REPLY.match(buffer)
    if found is None:
        return None
    lines = [line.strip() for line in found[1].splitlines()]
    answer = b"\n".join(line for line in lines if line and not _ECHO.fullmatch(line))
    return answer, found.end()


def is_number(answer: bytes) -> bool:
    """Return whether an answer is one number."""
    text = answer.decode("latin-1").strip()
    return _NUMBER.fullmatch(text) is not None and math.isfinite(float(text))


def decode_number(answer: bytes) -> float:
    """Return the number an answer consists of; raises ProtocolError."""
    if not is_number(answer):
        raise ProtocolError(
            "an answer is not a number",
            found=repr(answer[:60].decode("latin-1")),
            expected="a number and the prompt >",
            remedy="check the line for lost bytes and that the port belongs to an Ideal Aerosmith table",
        )
    return float(answer)
