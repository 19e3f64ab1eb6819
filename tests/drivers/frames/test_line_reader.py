"""Lines read all at once against lines read one by one, on sound, broken and random text in any chunks."""

from __future__ import annotations

import struct
import zlib
from functools import reduce
from operator import xor

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.frames import reader_of
from drivers.frames._lines import LineDescription
from drivers.frames._load import family_from

HEAD = {"schema": 1, "name": "lines", "title": "lines of a test", "frame": {}}
RATE = {"name": "rate_z", "axis": "z", "at": 0, "type": "f64", "unit": "deg/s", "role": "rate"}
COUNT = {"name": "count", "at": 1, "type": "i32"}
FLAG = {"name": "flag", "at": 2, "type": "u32", "base": 16}
KINDS = {
    "spaces": {"line": {"separators": " ", "columns": 3}, "field": [RATE, COUNT, FLAG]},
    "xor8": {
        "line": {"start": "$A,", "columns": 3, "checksum": {"kind": "xor8"}},
        "field": [RATE, COUNT, FLAG],
    },
    "crc32": {
        "line": {"start": "%B,", "separators": ",;", "columns": 4, "checksum": {"kind": "crc32"}},
        "field": [RATE, COUNT, FLAG],
    },
    "start_and_spaces": {"line": {"start": "w=", "separators": " ", "columns": 2}, "field": [RATE, COUNT]},
}


def one_by_one(text: bytes, about: LineDescription) -> tuple[list[tuple[int, bytes]], list[str]]:
    """(offset just past it, its row) of each sound line; why others were refused. Plain Python, line by line."""
    found, reasons, end = [], [], 0
    for whole in text.split(b"\n")[:-1]:
        end += len(whole) + 1
        row = row_of(whole.rstrip(b"\r"), about)
        if isinstance(row, bytes):
            found.append((end, row))
        elif row:
            reasons.append(row)
    return found, reasons


def row_of(line: bytes, about: LineDescription) -> bytes | str:
    start, section = about.line.start.encode(), about.line
    at = line.rfind(start) if start else 0
    if at < 0 or not line:
        return ""
    body = line[at:]
    if section.checksum is not None:
        body, _, digits = body.rpartition(b"*")
        covered = body[1:]
        if section.checksum.kind == "xor8":
            wanted = b"%02X" % reduce(xor, covered, 0)
        else:
            wanted = b"%08X" % (zlib.crc32(covered, 0xFFFFFFFF) ^ 0xFFFFFFFF)
        if digits.upper() != wanted:
            return "checksum"
    body = body[len(start) :]
    for other in section.separators[1:]:
        body = body.replace(other.encode(), section.separators[0].encode())
    cells = body.split() if " " in section.separators else body.split(section.separators[0].encode())
    if len(cells) != section.columns:
        return "length"
    row = bytearray(8 * len(cells))
    for spec, code in zip(about.field, ("<d", "<i", "<I"), strict=False):
        text = cells[spec.at]
        if b"_" in text:
            return "text"
        try:
            number = float(text) if code == "<d" else int(text, spec.base)
            struct.pack_into(code, row, 8 * spec.at, number)
        except (ValueError, struct.error):
            return "text"
    return bytes(row)


def sealed(kind: str, columns: list[bytes]) -> bytes:
    section = KINDS[kind]["line"]
    body = section.get("start", "").encode() + section.get("separators", ",")[-1:].encode().join(columns)
    match section.get("checksum", {}).get("kind"):
        case "xor8":
            body += b"*%02X" % reduce(xor, body[1:], 0)
        case "crc32":
            body += b"*%08x" % (zlib.crc32(body[1:], 0xFFFFFFFF) ^ 0xFFFFFFFF)
    return body


numbers = st.one_of(
    st.floats(allow_nan=False).map(lambda value: repr(value).encode()),
    st.decimals(-(10**7), 10**7, places=9).map(lambda value: f"{value:+.9f}".encode()),
    st.integers(-(2**33), 2**33).map(lambda value: str(value).encode()),
    st.sampled_from(
        [b"", b"-", b"+.5", b"5.", b".", b"1.2.3", b"0x1", b"1_0", b" 7 ", b"-0", b"-0.0", b"1e999", b"nan"]
    ),
    st.sampled_from(
        [b"123456789012345", b"9007199254740993", b"0.1234567890123456789", b"00000000000000000001.5"]
    ),
)
hexadecimals = st.one_of(st.integers(0, 2**34).map(lambda value: b"%x" % value), numbers)


@st.composite
def streams(draw: st.DrawFn, kind: str) -> bytes:
    parts = []
    for _ in range(draw(st.integers(0, 24))):
        columns = [draw(numbers), draw(numbers), draw(hexadecimals), draw(numbers)][
            : KINDS[kind]["line"]["columns"]
        ]
        line = sealed(kind, columns)
        fault = draw(st.integers(0, 9))
        if fault == 0 and line:
            at = draw(st.integers(0, len(line) - 1))
            line = line[:at] + bytes([line[at] ^ draw(st.integers(1, 255))]) + line[at + 1 :]
        elif fault == 1:
            line = draw(st.binary(max_size=9)) + line
        elif fault == 2:
            line = line[: draw(st.integers(0, len(line)))]
        parts.append(line + draw(st.sampled_from([b"\r\n", b"\n", b"\r\r\n", b" \r\n"])))
    return b"".join(parts)


@pytest.mark.parametrize("kind", list(KINDS))
@given(data=st.data())
@settings(max_examples=120, deadline=None)
def test_all_at_once_is_one_by_one(kind: str, data: st.DataObject) -> None:
    family = family_from(HEAD | KINDS[kind], "a test")
    text = data.draw(streams(kind))
    sizes = data.draw(st.lists(st.integers(1, 300), min_size=1, max_size=4))
    assert isinstance(family.description, LineDescription)
    reader, found, at = reader_of(family), [], 0
    while at < len(text):
        size = sizes[at % len(sizes)]
        for messages in reader.feed(text[at : at + size]):
            rows = [row.tobytes() for row in messages.rows]
            found += list(zip(messages.end_offset.tolist(), rows, strict=True))
        at += size
    wanted, reasons = one_by_one(text, family.description)
    assert found == wanted
    assert {why: reasons.count(why) for why in set(reasons)} == reader.counts.rejected


def test_rubbish_of_any_length_in_front_of_a_line_costs_nothing() -> None:
    family = family_from(HEAD | KINDS["xor8"], "a test")
    line = sealed("xor8", [b"1.5", b"-2", b"ff"]) + b"\r\n"
    text = bytes([1, 2, 3]) * 1000 + line + line
    for size in (7, 500, 1 << 20):
        reader = reader_of(family)
        found = [m for at in range(0, len(text), size) for m in reader.feed(text[at : at + size])]
        assert np.concatenate([m.end_offset for m in found]).tolist() == [
            3000 + len(line),
            3000 + 2 * len(line),
        ]
        assert reader.counts.bytes_skipped == 3000 and reader.counts.rejected == {}
        assert found[0].columns()["flag"][0] == 255


def test_check_digits_are_two_hexadecimal_ones() -> None:
    """int("+6", 16) is six, and so is int(" 6", 16)."""
    family = family_from(HEAD | KINDS["xor8"], "a test")
    lines = (sealed("xor8", [b"0.5", b"-1", b"%x" % n]) for n in range(9999))
    body = next(line[:-2] for line in lines if line.endswith(b"*06"))
    for digits, sound in ((b"06", 1), (b"+6", 0), (b" 6", 0), (b"6 ", 0), (b"6", 0), (b"_6", 0), (b"006", 0)):
        reader = reader_of(family)
        assert len(reader.feed(body + digits + b"\r\n")) == sound
