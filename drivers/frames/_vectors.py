"""The self-test inside a description: its vectors decoded, encoded again, and damaged."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from drivers.frames._decode import MessageReader, reader_of
from drivers.frames._line_read import LineReader
from drivers.frames._lines import LineDescription, LineVector
from drivers.frames._load import FrameFamily
from drivers.frames._model import Vector
from drivers.kit.config import Mistake


def vector_mistakes(family: FrameFamily) -> Iterator[Mistake]:
    """Yield every vector that does not decode to what it says, or whose damage goes unnoticed."""
    for number, vector in enumerate(family.description.vector):
        yield from _mistakes(family.set_up(vector.settings), vector, f"vector[{number}]")


def _mistakes(family: FrameFamily, vector: Vector | LineVector, key: str) -> Iterator[Mistake]:
    is_line = isinstance(vector, LineVector)
    data = vector.text.encode("latin-1") if isinstance(vector, LineVector) else vector.hex
    key_of_data = f"{key}.text" if is_line else f"{key}.hex"
    reader = reader_of(family)
    messages = reader.feed(data + b"\r\n" if is_line else data)
    alone = len(messages) == 1 and len(messages[0].rows) == 1
    if not alone or not (is_line or messages[0].rows.size == len(data)):
        expected = "a line of this description" if is_line else "one whole frame whose check is right"
        yield Mistake(key_of_data, _why(reader, len(data), is_line), expected)
        return
    if vector.variant is not None and messages[0].form.name != vector.variant:
        yield Mistake(f"{key}.variant", repr(messages[0].form.name), repr(vector.variant))
        return
    columns = messages[0].columns()
    for name, wanted in vector.expect.items():
        if name not in columns:
            yield Mistake(f"{key}.expect.{name}", "no such field in this message", repr(wanted))
        elif not _agrees(columns[name][0], wanted, vector.tolerance):
            yield Mistake(f"{key}.expect.{name}", repr(columns[name][0].item()), repr(wanted))
    if not isinstance(family.description, LineDescription):
        if (bit := _unnoticed(family, data, b"", range(8))) is not None:
            yield Mistake(key_of_data, f"a frame with bit {bit} flipped passes", "a check that covers it")
        return
    unnoticed = None
    if family.description.line.checksum is not None:
        unnoticed = _unnoticed(family, data, b"\r\n", range(1))
    if unnoticed is not None:
        missed = f"a line with character {unnoticed // 8} changed passes"
        yield Mistake(key_of_data, missed, "a check that sees it")


def _why(reader: MessageReader | LineReader, size: int, is_line: bool) -> str:
    """Return why what was read is not one message."""
    reasons = ", ".join(reader.counts.rejected)
    if is_line:
        return f"a line refused for its {reasons or 'start'}"
    if reasons:
        return f"{size} bytes refused for their {reasons}"
    if reader.pending:
        return f"{size} bytes, the beginning of a longer frame"
    return f"{size} bytes that do not begin as one frame does and end with it"


def _agrees(found: Any, wanted: float | int | bool | str, tolerance: float) -> bool:
    if isinstance(wanted, str):
        return bytes(found).rstrip(b"\0 ").decode("latin-1") == wanted
    if isinstance(wanted, float) and math.isnan(wanted):
        return bool(np.isnan(found))
    return math.isclose(float(found), float(wanted), rel_tol=tolerance, abs_tol=1e-12)


def _unnoticed(family: FrameFamily, data: bytes, end: bytes, bits: range) -> int | None:
    """Return the first bit, of these `bits` of each byte, whose flip leaves a message of the same length."""
    for number in (8 * at + bit for at in range(len(data)) for bit in bits):
        flipped = bytearray(data)
        flipped[number // 8] ^= 1 << number % 8
        messages = reader_of(family).feed(bytes(flipped) + end)
        if any(end or message.rows.size == len(data) for message in messages):
            return number
    return None
