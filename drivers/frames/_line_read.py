"""ASCII lines to rows of numbers, all lines of a piece of a stream at once."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.frames._form import Form, Messages
from drivers.frames._lines import CELL, LINE_CRC, LineCheck, LineDescription, number_parts
from drivers.kit.framing import PositionalCrc
from drivers.kit.instruments import StreamCounts
from drivers.kit.patterns import Bytes, Ints, find_sync, windows

Bools = NDArray[np.bool_]
Part = tuple[int, int, np.dtype[Any]]
"""Column, base and type of a number."""
_LONGEST = 1024
"""Bytes of a line that are looked at, its last ones: what came before is rubbish in front of its start."""
_BEFORE = b"\n" * _LONGEST  # So that every line can be looked at from its end backwards.
_FEW = 32  # So few numbers are read one by one.
_PASSES = 20
_DIGITS = 15  # A whole number of so many, and it over a power of ten, are right to the last bit of a double.
_WIDEST = 24
_SOUND, _OTHER, _CHECKSUM, _LENGTH, _TEXT = range(5)
_REASONS = {_CHECKSUM: "checksum", _LENGTH: "length", _TEXT: "text"}
_WHITE = b" \t\n\r\x0b\x0c"
_VALUES = {base: np.full(256, 255, np.uint8) for base in (10, 16)}
for _base, _table in _VALUES.items():
    for _digit in range(_base):
        _table[[ord(f"{_digit:x}"), ord(f"{_digit:X}")]] = _digit


@dataclass
class _Lines:
    """Lines of `text` by their borders (n,): [begin, end) without line end, and what was found of each."""

    text: Bytes
    begin: Ints
    end: Ints
    verdict: NDArray[np.uint8]

    def refuse(self, which: Bools, verdict: int) -> None:
        """Give a verdict to lines that have none yet."""
        self.verdict[which & (self.verdict == _SOUND)] = verdict


class LineReader:
    """Lines to rows, incrementally; never raises on bytes.

    A line counts when its start, number of columns, every described number and its check are right. What stands
    in front of the last start in a line is passed over.
    """

    def __init__(self, description: LineDescription, form: Form) -> None:
        self.forms: list[Form] = [form]
        self.counts = StreamCounts()
        self._line = description.line
        self._start = description.line.start.encode("latin-1")
        self._parts = number_parts(description)
        spaced = " " in self._line.separators
        self._spaced = spaced
        borders = _WHITE if spaced else self._line.separators.encode("latin-1")
        self._border = bytes(byte in borders for byte in range(256))
        self._pending = b""
        self._cut = False  # Whether the pending line has lost its first bytes.
        self._offset = 0  # In the stream, of the first pending byte.
        self._lines = 0

    @property
    def by_form(self) -> dict[str, int]:
        """Lines so far, by name."""
        return {self.forms[0].name: self.counts.frames}

    @property
    def pending(self) -> int:
        """Bytes that wait for more."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[Messages]:
        """Return the lines completed by `data`, as one entry; none if there is none."""
        text = np.frombuffer(b"".join((_BEFORE, self._pending, data)), np.uint8)
        base = self._offset - len(_BEFORE)
        stops = np.flatnonzero(text[len(_BEFORE) :] == ord("\n")) + len(_BEFORE)
        if not len(stops):
            self._keep(text, len(_BEFORE))
            return []
        begin = np.empty_like(stops)
        begin[0], begin[1:] = len(_BEFORE), stops[:-1] + 1
        rows, lines, heads = self._rows(text, begin, stops)
        sound = lines.verdict == _SOUND
        self.counts.frames += len(rows)
        self.counts.bytes_skipped += int((np.where(sound, heads, stops + 1) - begin).sum())
        for verdict, reason in _REASONS.items():
            self.counts.reject(reason, int(np.count_nonzero(lines.verdict == verdict)))
        numbers = self._lines + np.cumsum(lines.verdict != _OTHER)
        self._lines = int(numbers[-1])
        ends = stops[sound] + (base + 1)
        self._offset = base + int(stops[-1]) + 1
        self._cut = False
        self._keep(text, int(stops[-1]) + 1)
        form = self.forms[0]
        return [Messages(form.layout(form.shortest), rows, ends, numbers[sound] - 1)] if len(rows) else []

    def _keep(self, text: Bytes, at: int) -> None:
        """Keep the unfinished line from `at` on, of a very long one the last bytes."""
        dropped = max(0, len(text) - at - _LONGEST)
        self._cut |= dropped > 0
        self._offset += dropped
        self.counts.bytes_skipped += dropped
        self._pending = text[at + dropped :].tobytes()

    def _rows(self, text: Bytes, begin: Ints, stops: Ints) -> tuple[Bytes, _Lines, Ints]:
        """Return the rows of the sound lines, the verdicts on all, and where in each its start is."""
        end = stops.copy()
        while (ended := (end > begin) & (text[end - 1] == ord("\r"))).any():
            end -= ended
        lines = _Lines(text, begin, end, np.zeros(len(end), np.uint8))
        long = stops - begin > _LONGEST
        long[0] |= self._cut
        if self._start:
            heads = self._heads(lines)
        else:
            lines.verdict[end == begin] = _OTHER
            lines.refuse(long, _LENGTH)
            heads = begin
        tails = end if self._line.checksum is None else _checked(lines, heads, self._line.checksum)
        live = np.flatnonzero(lines.verdict == _SOUND)
        live, first, last = self._cells(lines, live, heads[live] + len(self._start), tails[live])
        rows = np.zeros((len(live), self._line.columns, CELL), np.uint8)
        good = np.ones(len(live), np.bool_)
        for parts in self._alike(text, first, last):
            at = [column for column, _, _ in parts]
            base, kind = parts[0][1], parts[0][2].kind
            values, right = _numbers(text, first[at].ravel(), last[at].ravel(), base, kind == "f")
            good &= right.reshape(len(at), -1).all(axis=0)
            for (column, _, dtype), value in zip(parts, values.reshape(len(at), -1), strict=True):
                number = value
                if kind != "f":
                    limits = np.iinfo(dtype)
                    fits = (value >= limits.min) & (value <= limits.max)
                    good &= fits
                    number = np.where(fits, value, 0.0)
                stored = number.astype(dtype).view(np.uint8)
                rows[:, column, : dtype.itemsize] = stored.reshape(len(live), dtype.itemsize)
        lines.verdict[live[~good]] = _TEXT
        rows = rows if good.all() else rows[good]
        return rows.reshape(len(rows), CELL * self._line.columns), lines, heads

    def _alike(self, text: Bytes, first: Ints, last: Ints) -> list[list[Part]]:
        """Return the described columns in groups that can be read together: as the first line has them."""
        groups: dict[tuple[int, str, int], list[Part]] = {}
        if first.shape[1]:
            for part in self._parts:
                at, base, dtype = part
                cell = text[first[at, 0] : last[at, 0]].tobytes()
                key = (base, dtype.kind, len(cell.partition(b".")[2]))
                groups.setdefault(key, []).append(part)
        return list(groups.values())

    def _heads(self, lines: _Lines) -> Ints:
        """Return where each line's last start is; lines without one are of another kind."""
        found = find_sync(lines.text, self._start)
        last = np.searchsorted(found, lines.end - len(self._start), side="right") - 1
        heads = found[last] if len(found) else lines.begin - 1
        absent = (last < 0) | (heads < lines.begin) | (lines.end - heads > _LONGEST)
        lines.verdict[absent] = _OTHER
        return np.where(absent, lines.begin, heads)

    def _cells(self, lines: _Lines, live: Ints, begin: Ints, end: Ints) -> tuple[Ints, Ints, Ints]:
        """Return those of the lines `live` that have the right number of columns, and the borders (columns, n).

        `begin` and `end` are the borders of all columns of a line together.
        """
        columns = self._line.columns
        border = np.frombuffer(lines.text.tobytes().translate(self._border), np.bool_)
        if self._spaced:
            inside = ~border
            inside[begin - 1], inside[end] = False, False
            edges = np.flatnonzero(inside[1:] != inside[:-1]) + 1
            firsts, lasts = edges[0::2], edges[1::2]
            low = np.searchsorted(firsts, begin)
            right = np.searchsorted(firsts, end) - low == columns
        else:
            places = np.flatnonzero(border)
            low = np.searchsorted(places, begin)
            right = np.searchsorted(places, end) - low == columns - 1
        lines.verdict[live[~right]] = _LENGTH
        live, low = live[right], low[right]
        which = low + np.arange(columns)[:, None]
        if self._spaced:
            return live, _at(firsts, which), _at(lasts, which)
        first, last = np.empty(which.shape, np.int64), np.empty(which.shape, np.int64)
        last[:-1], last[-1] = _at(places, which[:-1]), end[right]
        first[0], first[1:] = begin[right], last[:-1] + 1
        return live, first, last


def _at(places: Ints, which: Ints) -> Ints:
    return places[which] if which.size else which


def _checked(lines: _Lines, heads: Ints, check: LineCheck) -> Ints:
    """Refuse the lines whose check is wrong; return where the columns of each end."""
    digits = {"xor8": 2, "crc32": 8}[check.kind]
    marks = np.flatnonzero(lines.text == ord(check.after))
    last = np.searchsorted(marks, lines.end) - 1
    tails = marks[last] if len(marks) else heads - 1
    right = (last >= 0) & (tails >= heads) & (lines.end - tails == digits + 1)
    live = np.flatnonzero(right & (lines.verdict == _SOUND))
    if len(live):
        stop = tails[live]
        values = _VALUES[16][windows(lines.text, stop + 1, digits)]
        stated = np.zeros(len(live), np.uint32)
        for place in values.T:
            stated = stated << np.uint32(4) | place
        first = np.minimum(heads[live] + check.skip, stop)
        same = _check_of(lines.text, first, stop, check.kind) == stated
        right[live] = same & ~(values == 255).any(axis=1)
    lines.refuse(~right, _CHECKSUM)
    return tails


def _check_of(text: Bytes, first: Ints, stop: Ints, kind: str) -> NDArray[np.uint32]:
    """Return the check over [first, stop) of each: zeros in front of them change neither kind."""
    size = stop - first
    width = max(32, -(-int(size.max()) // 32) * 32)
    covered = windows(text, stop - width, width)
    covered *= np.arange(width, dtype=np.int16) >= (width - size).astype(np.int16)[:, None]
    if kind == "crc32":
        return _line_crc(width)(covered)
    folded: NDArray[np.uint64] = np.bitwise_xor.reduce(covered.view(np.uint64), axis=1)
    for shift in (32, 16, 8):
        folded ^= folded >> np.uint64(shift)
    return (folded & np.uint64(0xFF)).astype(np.uint32)


@cache
def _line_crc(width: int) -> PositionalCrc:
    return PositionalCrc(LINE_CRC, b"", width)


def _numbers(
    text: Bytes, first: Ints, last: Ints, base: int, decimals: bool
) -> tuple[NDArray[np.float64], Bools]:
    """Return the numbers that stand in the cells [first, last) of `text`, and which of these are numbers.

    Cells with as many decimals are read together; what is not plain digits, one by one.
    """
    values = np.zeros(len(first), np.float64)
    odd = np.arange(len(first))
    for _ in range(_PASSES if len(first) >= _FEW else 0):
        if not len(odd):
            break
        value, done = _plain(text, first[odd], last[odd], base, decimals)
        values[odd[done]] = value[done]
        stuck = not done[0]  # Nothing is like the first: it is no plain number.
        odd = odd[~done]
        if stuck:
            break
    good = np.ones(len(first), np.bool_)
    for at in odd.tolist():
        found = _number(text[first[at] : last[at]].tobytes(), base, decimals)
        good[at] = found is not None
        values[at] = 0.0 if found is None else found
    return values, good


def _plain(
    text: Bytes, first: Ints, last: Ints, base: int, decimals_allowed: bool
) -> tuple[NDArray[np.float64], Bools]:
    """Return the numbers of the cells that have as many decimals as the first, and which these are."""
    size = last - first
    width = min(_WIDEST, max(8, -(-int(size.max()) // 8) * 8))
    lead = text[first]
    signed = (lead == ord("-")) | (lead == ord("+")) if base == 10 else np.zeros(len(first), np.bool_)
    _, dot, decimals = text[first[0] : last[0]].tobytes().partition(b".")
    dotted = bool(dot) and decimals_allowed and base == 10 and len(decimals) < width
    digits = size - signed - dotted
    usable = (size <= width) & (digits > 0) & (digits <= _DIGITS)
    number = _VALUES[base][windows(text, last - width, width)]
    inside = np.arange(width, dtype=np.int8) >= (width - size + signed).astype(np.int8)[:, None]
    bad = (number == 255) & inside
    number *= inside
    weights = float(base) ** np.arange(width - 1, -1, -1)
    if dotted:
        place = width - 1 - len(decimals)
        bad[:, place] = text[last - 1 - len(decimals)] != ord(".")
        bad[:, place] |= size - signed <= len(decimals)
        weights[:place] /= 10.0
        weights[place] = 0.0
    usable &= ~(bad.view(np.uint64) != 0).any(axis=1)
    value = number.astype(np.float64) @ weights
    if dotted:
        value /= 10.0 ** len(decimals)
    return np.where(lead == ord("-"), -value, value), usable


def _number(cell: bytes, base: int, decimals: bool) -> float | None:
    """Return the number in a cell, None if there is none."""
    if b"_" in cell:
        return None
    try:
        return float(cell) if decimals else float(int(cell, base))
    except (ValueError, OverflowError):
        return None
