"""ASCII-2 of Weiss and Vötsch chambers: `$01I`, `$01E`, `$01U` lines and their replies, without any I/O.

Sources: the protocol text chambers print themselves on `$01?` (VC3 7060, VT3 7060 and two dynamic
configurations), the manufacturer's C sample and public drivers. Numbers are six characters wide with one decimal.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

from drivers.base.errors import ProtocolError

CR = b"\r"
_NUMBER = re.compile(r"-?\d+\.\d+")
_DIGITAL = re.compile(r"[01]+[A-Z]?")


@dataclass(frozen=True)
class Values:
    """A reply to `$ddI`: numbers in the chamber's own order and the digital block as characters `0` and `1`."""

    numbers: tuple[float, ...]
    digital: str


def format_number(value: float) -> str:
    """Return a number as ASCII-2 writes it: 0023.5, -075.0."""
    return f"{value:06.1f}"


def encode_read(address: int) -> bytes:
    """Return `$ddI`, which asks for all values."""
    return f"${address:02d}I".encode("ascii") + CR


def encode_configuration_query(address: int) -> bytes:
    """Return `$dd?`, which asks for the configuration text."""
    return f"${address:02d}?".encode("ascii") + CR


def encode_set(address: int, numbers: Sequence[float], digital: str) -> bytes:
    """Return `$ddE` with the set values and the digital block."""
    fields = [*(format_number(value) for value in numbers), digital]
    return f"${address:02d}E {' '.join(fields)}".encode("ascii") + CR


def encode_gradient(address: int, up_k_per_min: float, down_k_per_min: float) -> bytes:
    """Return `$ddU` with temperature gradients in K/min (0 = as fast as possible), humidity gradients 0.

    Only one of up and down may differ from 0.
    """
    gradients = (up_k_per_min, down_k_per_min, 0.0, 0.0)
    return f"${address:02d}U {' '.join(format_number(value) for value in gradients)}".encode("ascii") + CR


def encode_values(numbers: Sequence[float], digital: str) -> bytes:
    """Return a reply to `$ddI`."""
    return " ".join([*(format_number(value) for value in numbers), digital]).encode("ascii") + CR


def decode_values(reply: bytes) -> Values:
    """Return the values of a reply to `$ddI` without the letter some firmware appends; raises ProtocolError."""
    text = reply.decode("latin-1").strip()
    *numbers, digital = text.split() or [""]
    if not numbers or not _DIGITAL.fullmatch(digital) or not all(map(_NUMBER.fullmatch, numbers)):
        raise ProtocolError(
            "not a reply to $ddI",
            found=repr(text[:80]),
            expected="numbers like 0023.5 and a block of 0 and 1",
            remedy="check that the port belongs to a Weiss or Vötsch chamber and that its address is right",
        )
    return Values(tuple(float(number) for number in numbers), digital.rstrip("ABCDEFGHIJKLMNOPQRSTUVWXYZ"))
