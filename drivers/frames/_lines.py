"""Gyros that send ASCII lines, the sibling of binary frames: a line becomes a row of numbers."""

from __future__ import annotations

from collections.abc import Iterator
from functools import reduce
from operator import xor
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, ConfigDict, Field

from drivers.frames._form import Form
from drivers.frames._model import Description, FieldSection, FrameSection, _listed
from drivers.frames._verify import Mistake
from drivers.framing import Crc
from drivers.instruments import StreamCounts

CELL = 8
"""Bytes of a column's number in a row."""
_LONGEST = 1024
LINE_CRC = Crc(32, 0x04C11DB7, 0, reflected=True)
_TABLE = [LINE_CRC.of(bytes([byte])) for byte in range(256)]
_TYPES = {"f64": "<f8", "i32": "<i4", "u32": "<u4"}


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


class LineCheck(_Part):
    """`[line.checksum]`: hexadecimal digits behind the columns. crc32: reflected, from 0 (NovAtel)."""

    kind: Literal["xor8", "crc32"] = Field(description="'xor8' or 'crc32'")
    after: str = Field(default="*", min_length=1, max_length=1, description="the character before the digits")
    skip: int = Field(
        default=1, ge=0, le=8, description="characters at the line's start that are not covered"
    )


class LineSection(_Part):
    """`[line]`: what makes a line. `start` comes before the first column and belongs to none."""

    start: str = Field(default="", max_length=64, description="the text that a line begins with")
    separators: str = Field(
        default=",",
        min_length=1,
        max_length=4,
        description="characters between columns; ' ' means any white space",
    )
    columns: int = Field(ge=1, le=100, description="how many columns there are, the check not counted")
    checksum: LineCheck | None = Field(default=None, description="a [line.checksum] section")


class LineField(FieldSection):
    """`[[field]]` of a line: `at` is the column, 0 the first; `type` f64, i32 or u32; `base` 16: hexadecimal."""

    base: Literal[10, 16] = Field(default=10, description="10 or 16")


class LineVector(_Part):
    """`[[vector]]`: a line with known content."""

    text: str = Field(min_length=1, description="the line without its end")
    expect: dict[str, float | int] = Field(default_factory=dict, description="field = value")
    tolerance: float = Field(default=1e-6, ge=0, description="relative tolerance of numbers")
    origin: str = Field(default="", description="who says so")
    variant: None = Field(default=None, description="nothing: there is one kind of line")


class LineDescription(Description):
    """A description of ASCII lines: [line] in place of [frame]."""

    frame: FrameSection = FrameSection()
    line: LineSection = Field(description="a [line] section with columns")
    field: tuple[LineField, ...] = Field(default=(), description="[[field]] entries")
    vector: Annotated[tuple[LineVector, ...], BeforeValidator(_listed)] = Field(  # type: ignore[assignment]
        default=(), description="[[vector]] entries"
    )


class LineForm(Form):
    """The one kind of line of a description, its numbers laid out as a row of 8-byte cells."""

    @property
    def false_per_byte(self) -> float:
        """Return how often a place in random bytes passes for such a line at most: columns are not counted."""
        assert isinstance(self.section, LineSection)
        digits = 0 if self.section.checksum is None else {"xor8": 8, "crc32": 32}[self.section.checksum.kind]
        return 2.0 ** -(8 * len(self.section.start) + digits + 8)

    section: LineSection | None = None


def line_form(description: LineDescription) -> LineForm:
    """Return the form that a line's numbers are kept in."""
    groups = [each for group in description.field for each in group.each()]
    fields = tuple(
        FieldSection.model_validate({**each.model_dump(exclude={"base", "axes"}), "at": CELL * at})
        for each, at in zip(groups, _columns(description), strict=True)
    )
    form = LineForm(
        name=description.name,
        endian="little",
        syncs=(b"",),
        mask=b"",
        match=(),
        length=CELL * description.line.columns,
        length_field=None,
        max_length=0,
        terminator=b"",
        checksums=(),
        fields=fields,
        key="line",
    )
    form.section = description.line
    return form


def _columns(description: LineDescription) -> list[int]:
    """Return the column of each field; those of `axes` follow one another."""
    return [group.at + n for group in description.field for n, _ in enumerate(group.each())]


def number_parts(description: LineDescription) -> list[tuple[int, int, np.dtype[Any]]]:
    """Return column, base and type of each field's number."""
    groups = [each for group in description.field for each in group.each()]
    return [
        (at, getattr(spec, "base", 10), np.dtype(_TYPES[spec.type]))
        for spec, at in zip(groups, _columns(description), strict=True)
    ]


def verify_lines(description: LineDescription) -> Iterator[Mistake]:
    """Yield what the checks of binary frames cannot see."""
    groups = [each for group in description.field for each in group.each()]
    for spec, at in zip(groups, _columns(description), strict=True):
        if not 0 <= at < description.line.columns:
            yield Mistake(
                f"field {spec.name!r}.at", str(at), f"a column from 0 to {description.line.columns - 1}"
            )
        if spec.type not in _TYPES:
            yield Mistake(f"field {spec.name!r}.type", repr(spec.type), "f64, i32 or u32")


class LineReader:
    """Lines to rows, incrementally; never raises on bytes.

    A line counts when its start, number of columns, every described number and its check are right.
    """

    def __init__(self, description: LineDescription, form: LineForm) -> None:
        self.forms: list[Form] = [form]
        self.counts = StreamCounts()
        self._line = description.line
        self._start = description.line.start.encode("latin-1")
        self._parts = number_parts(description)
        self._pending = b""
        self._offset = 0
        self._lines = 0

    @property
    def by_form(self) -> dict[str, int]:
        """Lines so far, by name."""
        return {self.forms[0].name: self.counts.frames}

    @property
    def pending(self) -> int:
        """Bytes that wait for more."""
        return len(self._pending)

    def read(self, data: bytes) -> tuple[NDArray[np.uint8], NDArray[np.int64], NDArray[np.int64]]:
        """Return rows (n, 8 x columns), the offsets just past the lines, and the lines' numbers in the stream."""
        *lines, self._pending = (self._pending + data).split(b"\n")
        rows, ends, numbers = [], [], []
        for line in lines:
            self._offset += len(line) + 1
            row, reason = self._row(line.rstrip(b"\r"))
            if row is not None:
                rows.append(row)
                ends.append(self._offset)
                numbers.append(self._lines)
                self.counts.frames += 1
            else:
                self.counts.bytes_skipped += len(line) + 1
                if reason:
                    self.counts.rejected[reason] = self.counts.rejected.get(reason, 0) + 1
            self._lines += bool(row is not None or reason)
        if len(self._pending) > _LONGEST:
            self._offset += len(self._pending)
            self.counts.bytes_skipped += len(self._pending)
            self._pending = b""
        table = np.frombuffer(b"".join(rows), np.uint8).reshape(len(rows), CELL * self._line.columns)
        return table, np.array(ends, np.int64), np.array(numbers, np.int64)

    def _row(self, line: bytes) -> tuple[bytes | None, str]:
        """Return the numbers of a line as bytes, or why there are none ("" for a line of another kind)."""
        begin = line.rfind(self._start) if self._start else 0
        if begin < 0 or not line:
            return None, ""
        line, check = line[begin:], self._line.checksum
        if check is not None:
            line, _, digits = line.rpartition(check.after.encode("latin-1"))
            if not _matches(check.kind, line[check.skip :], digits):
                return None, "checksum"
        columns = _split(line[len(self._start) :], self._line.separators)
        if len(columns) != self._line.columns:
            return None, "length"
        row = bytearray(CELL * len(columns))
        try:
            for at, base, dtype in self._parts:
                text = columns[at].strip()
                if b"_" in text:
                    return None, "text"
                number = float(text) if dtype.kind == "f" else int(text, base)
                row[CELL * at : CELL * at + dtype.itemsize] = np.array(number, dtype).tobytes()
        except (ValueError, OverflowError):
            return None, "text"
        return bytes(row), ""


def _split(text: bytes, separators: str) -> list[bytes]:
    if " " in separators:
        return text.split()
    for other in separators[1:]:
        text = text.replace(other.encode("latin-1"), separators[0].encode("latin-1"))
    return text.split(separators[0].encode("latin-1"))


def _matches(kind: str, covered: bytes, digits: bytes) -> bool:
    """Return whether the digits are those of the check: compared as text, for int() also takes "+6" and "_"."""
    if kind == "xor8":
        return digits.upper() == b"%02X" % reduce(xor, covered, 0)
    register = 0
    for byte in covered:
        register = register >> 8 ^ _TABLE[(register ^ byte) & 0xFF]
    return digits.upper() == b"%08X" % register
