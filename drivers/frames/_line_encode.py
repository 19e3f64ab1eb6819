"""Columns to ASCII lines: what a unit with this description would send, for emulators and tests."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import reduce
from operator import xor

import numpy as np
from numpy.typing import ArrayLike

from drivers.frames._encode import FrameEncoder
from drivers.frames._lines import CELL, LINE_CRC, LineDescription, number_parts
from drivers.frames._load import FrameFamily

END = b"\r\n"
_DECIMALS = 9


class LineEncoder:
    """Makes lines of a description, numbers and separators written as in its first vector, else plainly."""

    def __init__(self, family: FrameFamily) -> None:
        description = family.description
        assert isinstance(description, LineDescription)
        self._numbers = FrameEncoder(family)
        self.form = self._numbers.form
        self._line = description.line
        self._parts = {at: (base, dtype) for at, base, dtype in number_parts(description)}
        spaced = " " in self._line.separators
        between = r"(\s+)" if spaced else f"([{re.escape(self._line.separators)}])"
        text = description.vector[0].text if description.vector else ""
        if text and self._line.checksum is not None:
            text = text.rpartition(self._line.checksum.after)[0]
        pieces = re.split(between, text[len(self._line.start) :]) if text else []
        # Blanks that the line begins with belong to the first column's width.
        pieces = pieces[1:] if spaced and pieces and not pieces[0] else ["", *pieces]
        columns = self._line.columns
        if len(pieces) != 2 * columns:
            pieces = [
                piece for at in range(columns) for piece in (self._line.separators[0] if at else "", "0")
            ]
        self._spaced = spaced
        self._before, self._samples = pieces[0::2], pieces[1::2]

    def encode(self, count: int, values: Mapping[str, ArrayLike]) -> bytes:
        """Return `count` lines with CR LF. `values` and fields not given: see FrameEncoder.encode."""
        cells = self._numbers.encode(count, values)
        size = CELL * self._line.columns
        return b"".join(self._text(cells[at : at + size]) for at in range(0, len(cells), size))

    def _text(self, row: bytes) -> bytes:
        line = self._line.start
        for at, (before, sample) in enumerate(zip(self._before, self._samples, strict=True)):
            text = sample
            if at in self._parts:
                base, dtype = self._parts[at]
                number = np.frombuffer(row, dtype, 1, CELL * at)[0].item()
                text = _written(number, base, sample)
            line += text.rjust(len(before) + len(sample)) if self._spaced else before + text
        check = self._line.checksum
        data = line.encode("latin-1")
        if check is not None:
            covered = data[check.skip :]
            digits = (
                f"{reduce(xor, covered, 0):02X}" if check.kind == "xor8" else f"{LINE_CRC.of(covered):08x}"
            )
            data += (check.after + digits).encode("latin-1")
        return data + END


def _written(number: float, base: int, sample: str) -> str:
    """Return a number with the sign, width and decimals of `sample`."""
    if isinstance(number, int):
        return f"{number:0{len(sample)}x}" if base == 16 else str(number)
    if sample == "0":
        return f"{number:.{_DECIMALS}f}"
    decimals = len(sample.partition(".")[2])
    signed = sample[0] in "+-"
    padded = signed and sample[1:2] == "0"
    return f"{number:{'+' if signed else ''}{f'0{len(sample)}' if padded else ''}.{decimals}f}"
