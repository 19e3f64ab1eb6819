"""Checks of frames and lines written against sums made by hand."""

import copy
import struct

import pytest

from drivers.base.errors import ConfigurationError
from drivers.frames import LineEncoder, reader_of
from drivers.frames._load import family_from

FRAME = {
    "schema": 1,
    "name": "unit",
    "title": "a unit of a test",
    "frame": {"endian": "big", "sync": "A55A", "length": 10},
    "field": [
        {"name": "rate_x", "axis": "x", "at": 2, "type": "i32", "unit": "deg/s", "role": "rate"},
        {"name": "count", "at": 6, "type": "u16"},
    ],
    "counter": {"field": "count"},
}
LINE = {
    "schema": 1,
    "name": "unit",
    "title": "a unit of a test",
    "frame": {},
    "line": {"start": "$A,", "columns": 3, "separators": ","},
    "field": [
        {"name": "rate_x", "axis": "x", "at": 0, "type": "f64", "unit": "deg/s", "role": "rate"},
        {"name": "rate_y", "axis": "y", "at": 1, "type": "f64", "unit": "deg/s", "role": "rate"},
    ],
}


def described(base, **frame):
    data = copy.deepcopy(base)
    data["line" if "line" in data else "frame"] |= frame
    return family_from(data, "unit")


def by_hand(kind, covered, init):
    """Return a check's value by its definition."""
    if kind == "xor8":
        value = init & 0xFF
        for byte in covered:
            value ^= byte
        return value
    if kind == "neg8":
        return -(sum(covered) + init) % 256
    if kind == "sum16_words":
        return (sum(struct.unpack(">4H", covered)) + init) % 65536
    return (sum(covered) + init) % (65536 if kind == "sum16" else 256)


@pytest.mark.parametrize("init", [0, 1, 0x0F, 0xFF, 0x1FF])
@pytest.mark.parametrize("kind", ["sum8", "neg8", "xor8", "sum16", "sum16_words"])
def test_a_check_is_what_its_definition_gives_whatever_it_starts_from(kind, init):
    check = {"kind": kind, "ranges": [[0, 8]], "at": 8, "init": f"{init:X}"}
    reader = reader_of(described(FRAME, checksum=check))
    covered = b"\xa5\x5a" + struct.pack(">iH", 123457, 0x8FFF)
    right = by_hand(kind, covered, init)
    wide = kind.startswith("sum16")
    tail = struct.pack(">H", right) if wide else bytes([right, 0])
    assert sum(len(message.columns()["count"]) for message in reader.feed(covered + tail)) == 1
    wrong = struct.pack(">H", right ^ 1) if wide else bytes([right ^ 1, 0])
    assert sum(len(message.columns()["count"]) for message in reader.feed(covered + wrong)) == 0


@pytest.mark.parametrize(("times", "sound"), [(0, False), (1, True), (2, True), (8, True), (9, False)])
def test_a_units_length_is_counted_in_up_to_eight_bytes(times, sound):
    data = copy.deepcopy(FRAME)
    del data["frame"]["length"]
    data["frame"] |= {"length_field": {"at": 8, "type": "u8", "times": times}, "max_length": 64}
    if not sound:
        with pytest.raises(ConfigurationError, match="times"):
            family_from(data, "unit")
        return
    reader = reader_of(family_from(data, "unit"))
    size = 16
    frame = b"\xa5\x5a" + struct.pack(">iHBB", 7, 3, size // times, 0) + bytes(size - 10)
    found = [message.columns() for message in reader.feed(frame * 2)]
    assert [count for columns in found for count in columns["count"].tolist()] == [3, 3]


@pytest.mark.parametrize("separators", [",", ";,"])
def test_a_line_without_an_example_is_written_plainly(separators):
    encoder = LineEncoder(described(LINE, separators=separators))
    text = encoder.encode(2, {"rate_x": [1.5, -2.25], "rate_y": [0.0, 1e-9]}).decode()
    first = separators[0]
    assert text.splitlines() == [
        f"$A,1.500000000{first}0.000000000{first}0",
        f"$A,-2.250000000{first}0.000000001{first}0",
    ]
    assert text.endswith("\r\n") and text.count("\r\n") == 2
