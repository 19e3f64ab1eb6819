"""A checked description made ready: forms (one for each variant) and their layouts (one for each length)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.frames._checks import Check, check_bytes, crcs_hold
from drivers.frames._model import (
    GYRO_ROLES,
    Checksum,
    Counter,
    Description,
    Endian,
    FieldSection,
    FrameSection,
    LengthField,
    Match,
    Variant,
)
from drivers.frames._read import FieldCodec
from drivers.kit.patterns import Bytes, Ints, Pattern
from drivers.kit.splitting import Kind

Array = NDArray[Any]


@dataclass
class Form:
    """One kind of message: everything of [frame] and its variant put together, offsets still as written."""

    name: str
    endian: Endian
    syncs: tuple[bytes, ...]
    mask: bytes
    match: tuple[Match, ...]
    length: int | None
    length_field: LengthField | None
    max_length: int
    terminator: bytes
    checksums: tuple[Checksum, ...]
    fields: tuple[FieldSection, ...]
    key: str
    """Where it stands in the file, for errors."""
    counter: Counter | None = None
    _layouts: dict[int, Layout] = field(default_factory=dict)

    @cached_property
    def measures(self) -> bool:
        """Whether it carries a gyro channel, so that a row of the table comes of it."""
        return any(each.role in GYRO_ROLES for each in self.fields)

    @property
    def false_per_byte(self) -> float:
        """Return how often a place in random bytes passes for such a message: head, checks and terminator."""
        checks = sum(8 * check_bytes(check.kind) for check in self.checksums) + 8 * len(self.terminator)
        heads = (sum(bits.bit_count() for _, _, bits in self.places(sync)) for sync in self.syncs)
        return sum(2.0 ** -(bits + checks) for bits in heads)

    @property
    def shortest(self) -> int:
        """Return the fewest bytes that hold the head, every field and the checks."""
        return self.length if self.length is not None else _least_length(self)

    @property
    def longest(self) -> int:
        """Return the most bytes such a message has."""
        return self.length if self.length is not None else self.max_length

    def places(self, sync: bytes) -> list[tuple[int, int, int]]:
        """Return (offset, value, mask) of every byte that tells it from others; masks of 0 left out."""
        head: list[tuple[int, int, int]] = [
            (at, byte & bits, bits) for at, (byte, bits) in enumerate(zip(sync, self.mask, strict=True))
        ]
        for rule in self.match:
            bits = rule.mask or b"\xff" * len(rule.equals)
            head += [(rule.at + n, value & bits[n], bits[n]) for n, value in enumerate(rule.equals)]
        return [place for place in head if place[2]]

    def layout(self, length: int) -> Layout:
        """Return the layout of frames of `length` bytes (made once)."""
        if length not in self._layouts:
            self._layouts[length] = Layout(self, length)
        return self._layouts[length]

    def kind(self) -> Kind:
        """Return what the splitter needs."""
        rule = self.length_field
        span = 1 if rule is None else rule.at + rule.bytes
        patterns = tuple(Pattern(self.places(sync), span) for sync in self.syncs)
        read = None if rule is None else _length_reader(rule, self.endian)
        crcs = all(check.kind.startswith("crc") for check in self.checksums)
        few = self._crcs_hold if rule is not None and crcs and self.checksums else None
        return Kind(patterns, lambda n: self.layout(n).sound, self.shortest, self.longest, read, few)

    def _crcs_hold(self, frames: Sequence[bytes]) -> NDArray[np.bool_]:
        """Return which of frames of several lengths pass every check."""
        good = np.array([frame.endswith(self.terminator) for frame in frames])
        for check in self.checksums:
            good &= crcs_hold(check, self.endian, frames)
        return good


class Layout:
    """Frames of one form and one length: check, fields, and the writing of both."""

    def __init__(self, form: Form, length: int) -> None:
        self.form = form
        self.length = length
        self.codecs = {spec.name: FieldCodec(spec, length, form.endian) for spec in form.fields}
        self._tail = np.frombuffer(form.terminator, np.uint8)
        only = form.syncs[0] if len(form.syncs) == 1 and set(form.mask) == {0xFF} else b""
        if only and form.length_field is not None and form.length_field.at == len(only):
            only = self.blank(1)[0, : len(only) + form.length_field.bytes].tobytes()
        self.checks = [Check(spec, length, form.endian, only) for spec in form.checksums]

    def sound(self, rows: Bytes) -> NDArray[np.bool_]:
        """Return which of `rows`, uint8 (n, length), pass every check."""
        good = np.ones(len(rows), np.bool_)
        for check in self.checks:
            good &= check.sound(rows)
        if len(self._tail):
            good &= (rows[:, -len(self._tail) :] == self._tail).all(axis=1)
        return good

    def raw(self, rows: Bytes) -> dict[str, Array]:
        """Return the raw numbers of every field, (n,) each."""
        return {name: codec.raw(rows) for name, codec in self.codecs.items()}

    def physical(self, raw: Mapping[str, Array]) -> dict[str, Array]:
        """Return every field in its own unit, (n,) each."""
        return {name: codec.physical(raw[name], raw) for name, codec in self.codecs.items()}

    def blank(self, count: int) -> Bytes:
        """Return `count` frames with head and terminator in place and zeros elsewhere."""
        rows = np.zeros((count, self.length), np.uint8)
        sync = self.form.syncs[0]
        rows[:, : len(sync)] = np.frombuffer(sync, np.uint8)
        for at, value, mask in self.form.places(sync):
            rows[:, at] = (rows[:, at] & (0xFF ^ mask)) | value
        if rule := self.form.length_field:
            order = ">" if (rule.endian or self.form.endian) == "big" else "<"
            size = rule.bytes
            stated = ((self.length - rule.add) // rule.times).to_bytes(8, "big")[-size:]
            rows[:, rule.at : rule.at + size] = np.frombuffer(
                stated if order == ">" else stated[::-1], np.uint8
            )
        if len(self._tail):
            rows[:, -len(self._tail) :] = self._tail
        return rows

    def seal(self, rows: Bytes) -> None:
        """Write the checks, in the order of the file."""
        for check in self.checks:
            check.write(rows)


@dataclass
class Messages:
    """Sound messages of one form and length, in order: rows uint8 (n, length), ends of them in the stream."""

    layout: Layout
    rows: NDArray[np.uint8]
    end_offset: NDArray[np.int64]
    numbers: NDArray[np.int64] | None = None
    """Which message of the stream each is, damaged ones counted, where that is known."""

    @property
    def form(self) -> Form:
        """Which message it is."""
        return self.layout.form

    def columns(self) -> dict[str, Array]:
        """Return every field in its own unit, (n,) each."""
        return self.layout.physical(self.layout.raw(self.rows))


def forms_of(description: Description) -> list[Form]:
    """Return the description's messages: its variants, or the one that [frame] describes."""
    if not description.variant:
        return [_form(description, description.frame, "frame")]
    return [_form(description, each, f"variant {each.name!r}") for each in description.variant]


def _form(description: Description, own: FrameSection, key: str) -> Form:
    base = description.frame
    fields = {each.name: each for group in description.field for each in group.each()}
    name = description.name
    if isinstance(own, Variant):
        name = own.name
        groups = {group.name: [each.name for each in group.each()] for group in description.field}
        for gone in own.without:
            for each in groups.get(gone, [gone]):
                fields.pop(each, None)
        fields |= {each.name: each for group in own.field for each in group.each()}
    syncs = tuple(dict.fromkeys(own.sync if own.sync is not None else base.sync or ()))
    mask = own.sync_mask or (base.sync_mask if own.sync is None else None)
    fixed = own.length is not None or own.length_field is not None
    terminator = own.terminator if own.terminator is not None else base.terminator
    checksums = own.checksum if own.checksum is not None else base.checksum
    return Form(
        name=name,
        endian=own.endian or base.endian or "big",
        syncs=syncs,
        mask=mask or b"\xff" * (len(syncs[0]) if syncs else 0),
        match=(*base.match, *own.match) if own is not base else own.match,
        length=own.length if fixed else base.length,
        length_field=own.length_field if fixed else base.length_field,
        max_length=own.max_length or base.max_length or 0,
        terminator=terminator or b"",
        checksums=checksums or (),
        fields=tuple(fields.values()),
        key=key,
        counter=own.counter if isinstance(own, Variant) and own.counter else description.counter,
    )


def _least_length(form: Form) -> int:
    """Return the fewest bytes of a frame of stated length: what stands at its head, and what at its end."""
    front = max(at + 1 for sync in form.syncs for at, _, _ in form.places(sync))
    rule = form.length_field
    if rule is not None:
        front = max(front, rule.at + rule.bytes)
    back = len(form.terminator)
    for spec in form.fields:
        front = max(front, spec.at + spec.bytes if spec.at >= 0 else 0)
        back = max(back, -spec.at)
    for check in form.checksums:
        front = max([front, *(end for _, end in check.ranges), *(first for first, _ in check.ranges)])
        back = max([back, -check.at, *(-first for first, _ in check.ranges)])
    return front + back


def _length_reader(rule: LengthField, endian: Endian) -> Any:
    size = rule.bytes
    offsets = range(size) if (rule.endian or endian) == "big" else range(size - 1, -1, -1)

    def read(data: Bytes, starts: Ints) -> Ints:
        number = np.zeros(len(starts), np.int64)
        for offset in offsets:
            number = number << 8 | data[starts + (rule.at + offset)]
        return number * rule.times + rule.add

    return read
