"""Ideal Aerosmith table language (ATL): three letters and a number, an answer line, a prompt. No I/O.

No manual of the maker is public. Sources: actigraph/RateTableSweepGUI, a GM script for an IMU test suite and
a GUI for the 1270VS, which agree on what is used here: `>` ends an answer, `?` in it says no.
"""

from __future__ import annotations

import math
import re

from drivers.base.errors import ProtocolError

END = b"\r\n"
PROMPT = b">"
POSITION, RATE, STATUS = b"PPO", b"PVE", b"STA"
_NUMBER = re.compile(r"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
_REPLY = re.compile(rb"[\r\n]*([^>]*)>")


def encode(mnemonic: str, value: float | None = None, *, signed: bool = False) -> bytes:
    """Return a command line; numbers have six decimals, those of a sense (`signed`) always a sign."""
    number = "" if value is None else f"{value:+.6f}" if signed else f"{value:.6f}"
    return f"{mnemonic}{number}".encode("ascii") + END


def split_reply(buffer: bytes) -> tuple[bytes, int] | None:
    """Return the first answer in `buffer`, without line ends, and the bytes it takes; None while incomplete."""
    found = _REPLY.match(buffer)
    return None if found is None else (found[1].strip(), found.end())


def decode_number(answer: bytes) -> float:
    """Return the number an answer consists of; raises ProtocolError."""
    text = answer.decode("latin-1").strip()
    if not _NUMBER.fullmatch(text) or not math.isfinite(float(text)):
        raise ProtocolError(
            "an answer is not a number",
            found=repr(text[:60]),
            expected="a number and the prompt >",
            remedy="check the line for lost bytes and that the port belongs to an Ideal Aerosmith table",
        )
    return float(text)
