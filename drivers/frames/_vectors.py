"""The self-test inside a description: its vectors decoded, encoded again, and damaged."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from drivers.frames._decode import MessageReader, reader_of
from drivers.frames._lines import LineDescription
from drivers.frames._load import FrameFamily
from drivers.frames._model import Vector
from drivers.kit.config import Mistake


def vector_mistakes(family: FrameFamily) -> Iterator[Mistake]:
    """Yield every vector that does not decode to what it says, or whose damage goes unnoticed."""
    if isinstance(family.description, LineDescription):
        yield from _line_mistakes(family, family.description)
        return
    given = family
    for number, vector in enumerate(family.description.vector):
        key = f"vector[{number}]"
        family = given.set_up(vector.settings)
        found = MessageReader(family).feed(vector.hex)
        if len(found) != 1 or found[0].rows.size != len(vector.hex):
            yield Mistake(f"{key}.hex", _why(family, vector), "one whole frame whose check is right")
            continue
        if vector.variant is not None and found[0].form.name != vector.variant:
            yield Mistake(f"{key}.variant", repr(found[0].form.name), repr(vector.variant))
            continue
        columns = found[0].columns()
        for name, wanted in vector.expect.items():
            if name not in columns:
                yield Mistake(f"{key}.expect.{name}", "no such field in this message", repr(wanted))
            elif not _agrees(columns[name][0], wanted, vector.tolerance):
                yield Mistake(f"{key}.expect.{name}", repr(_plain(columns[name][0])), repr(wanted))
        if (missed := _unnoticed(family, vector)) is not None:
            yield Mistake(f"{key}.hex", f"a frame with bit {missed} flipped passes", "a check that covers it")


def _line_mistakes(family: FrameFamily, description: LineDescription) -> Iterator[Mistake]:
    given = family
    for number, vector in enumerate(description.vector):
        key = f"vector[{number}]"
        family = given.set_up(vector.settings)
        line = vector.text.encode("latin-1")
        reader = reader_of(family)
        found = reader.feed(line + b"\r\n")
        if len(found) != 1:
            why = ", ".join(reader.counts.rejected) or "start"
            yield Mistake(f"{key}.text", f"a line refused for its {why}", "a line of this description")
            continue
        columns = found[0].columns()
        for name, wanted in vector.expect.items():
            if not _agrees(columns[name][0], wanted, vector.tolerance):
                yield Mistake(f"{key}.expect.{name}", repr(_plain(columns[name][0])), repr(wanted))
        if description.line.checksum is not None:
            for at in range(len(line)):
                flipped = line[:at] + bytes([line[at] ^ 1]) + line[at + 1 :]
                if reader_of(family).feed(flipped + b"\r\n"):
                    yield Mistake(
                        f"{key}.text", f"a line with character {at} changed passes", "a check that sees it"
                    )
                    break


def _why(family: FrameFamily, vector: Vector) -> str:
    reader = MessageReader(family)
    reader.feed(vector.hex)
    if reader.counts.rejected:
        return f"{len(vector.hex)} bytes refused for their {', '.join(reader.counts.rejected)}"
    if reader.pending:
        return f"{len(vector.hex)} bytes, the beginning of a longer frame"
    return f"{len(vector.hex)} bytes that do not begin as one frame does and end with it"


def _agrees(found: Any, wanted: float | int | bool | str, tolerance: float) -> bool:
    if isinstance(wanted, str):
        return bytes(found).rstrip(b"\0 ").decode("latin-1") == wanted
    if isinstance(wanted, float) and math.isnan(wanted):
        return bool(np.isnan(found))
    return math.isclose(float(found), float(wanted), rel_tol=tolerance, abs_tol=1e-12)


def _plain(value: Any) -> Any:
    return value.item() if hasattr(value, "item") else value


def _unnoticed(family: FrameFamily, vector: Vector) -> int | None:
    """Return the first bit whose flip leaves a frame of the same length, None if there is none."""
    for bit in range(8 * len(vector.hex)):
        flipped = bytearray(vector.hex)
        flipped[bit // 8] ^= 1 << bit % 8
        if any(each.rows.size == len(flipped) for each in MessageReader(family).feed(bytes(flipped))):
            return bit
    return None
