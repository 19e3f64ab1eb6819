"""Gyros that send ASCII lines, the sibling of binary frames: a line becomes a row of numbers."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field

from drivers.frames._form import Form
from drivers.frames._model import MOST_PARTS, Description, FieldSection, FrameSection, Known, Part, listed
from drivers.kit.config import Mistake
from drivers.kit.framing import Crc

CELL = 8
"""Bytes of a column's number in a row."""
LINE_CRC = Crc(32, 0x04C11DB7, 0, reflected=True)
_TYPES = {"f64": "<f8", "i32": "<i4", "u32": "<u4"}


class LineCheck(Part):
    """`[line.checksum]`: hexadecimal digits behind the columns. crc32: reflected, from 0 (NovAtel)."""

    kind: Literal["xor8", "crc32"] = Field(description="'xor8' or 'crc32'")
    after: str = Field(default="*", min_length=1, max_length=1, description="the character before the digits")
    skip: int = Field(
        default=1, ge=0, le=8, description="characters at the line's start that are not covered"
    )


class LineSection(Part):
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


class LineVector(Known):
    """`[[vector]]`: a line with known content."""

    text: str = Field(min_length=1, description="the line without its end")
    expect: dict[str, float | int] = Field(default_factory=dict, description="field = value")
    variant: None = Field(default=None, description="nothing: there is one kind of line")


class LineDescription(Description):
    """A description of ASCII lines: [line] in place of [frame]."""

    frame: FrameSection = FrameSection()
    line: LineSection = Field(description="a [line] section with columns")
    field: tuple[LineField, ...] = Field(default=(), max_length=MOST_PARTS, description="[[field]] entries")
    vector: Annotated[tuple[LineVector, ...], BeforeValidator(listed)] = Field(  # type: ignore[assignment]
        default=(), max_length=MOST_PARTS, description="[[vector]] entries"
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
    fields = tuple(
        FieldSection.model_validate({**spec.model_dump(exclude={"base", "axes"}), "at": CELL * at})
        for spec, at in _columns(description)
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
        counter=description.counter,
    )
    form.section = description.line
    return form


def _columns(description: LineDescription) -> list[tuple[FieldSection, int]]:
    """Return each field with its column; those of `axes` follow one another."""
    return [(spec, group.at + n) for group in description.field for n, spec in enumerate(group.each())]


def number_parts(description: LineDescription) -> list[tuple[int, int, np.dtype[Any]]]:
    """Return column, base and type of each field's number."""
    return [
        (at, getattr(spec, "base", 10), np.dtype(_TYPES[spec.type])) for spec, at in _columns(description)
    ]


def verify_lines(description: LineDescription) -> Iterator[Mistake]:
    """Yield what the checks of binary frames cannot see."""
    for spec, at in _columns(description):
        if not 0 <= at < description.line.columns:
            yield Mistake(
                f"field {spec.name!r}.at", str(at), f"a column from 0 to {description.line.columns - 1}"
            )
        if spec.type not in _TYPES:
            yield Mistake(f"field {spec.name!r}.type", repr(spec.type), "f64, i32 or u32")
