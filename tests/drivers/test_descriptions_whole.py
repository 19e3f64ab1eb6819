"""What one part of a description says of another, told apart, written and read: by hand."""

from __future__ import annotations

import copy
import struct

import numpy as np
import pytest

from drivers.frames import FrameDecoder, FrameEncoder, reader_of
from drivers.frames._load import family_from
from drivers.frames._model import FieldSection
from drivers.frames._read import FieldCodec
from drivers.kvh.format import temperature_field
from tests.drivers.test_decoders_by_hand import FRAME, described
from tests.drivers.test_descriptions_by_hand import SIZES, refusal


@pytest.mark.parametrize(
    ("changes", "found", "expected"),
    [
        ({"field": {"sentinel": ["80000000"]}}, None, None),
        ({"field": {"sentinel": ["100000000"]}}, "100000000", "4 bytes, as the field has"),
        ({"field": {"valid": {"field": "count", "bit": 1}}}, None, None),
        ({"field": {"valid": {"field": "rate", "bit": 1}}}, "'rate'", "a whole-number field"),
        ({"field": {"valid": {"field": "clock", "bit": 1}}}, "'clock'", "a whole-number field"),
        ({"field": {"when": {"field": "count", "mod": 2, "equals": 0}}}, None, None),
        ({"field": {"when": {"field": "count", "mod": 2, "mask": "1", "equals": 0}}}, "mod and mask", "either"),
        ({"field": {"when": {"field": "count", "equals": 0}}}, "mod and mask", "either mod or mask"),
        ({"counter": {"field": "count", "modulo": 65536}}, None, None),
        ({"counter": {"field": "count", "modulo": 65537}}, "65537", "at most 65536, for u16"),
        ({"counter": {"field": "clock", "ticks_per_s": 2.0, "modulo": 9}}, None, None),
        ({"counter": {"field": "clock", "ticks_per_s": 2.0}}, "nothing", "wraps, in ticks"),
        ({"counter": {"field": "clock"}}, "'clock'", "one of count"),
        ({"counter": {"field": "nobody", "ticks_per_s": 2.0}}, "'nobody'", "one of count"),
        ({"status": [{"field": "count", "bit": 15, "name": "bad"}]}, None, None),
        ({"status": [{"field": "count", "bit": 16, "name": "bad"}]}, "16", "0 to 15"),
        ({"status": [{"field": "clock", "bit": 1, "name": "bad"}]}, "'clock'", "one of count"),
        ({"vector": [{"hex": "00", "variant": "unit", "expect": {}}]}, None, None),
        ({"vector": [{"hex": "00", "variant": "units", "expect": {}}]}, "'units'", "one of unit"),
        ({"vector": [{"hex": "00", "expect": {"clock": 1.0, "counts": 1}}]}, "'counts'", "one of clock, count"),
        ({"message": "unit"}, None, None),
        ({"message": "other"}, "'other'", "one of unit"),
    ],
)  # fmt: skip
def test_what_one_part_of_a_description_says_of_another_is_there(changes, found, expected):
    data = copy.deepcopy(FRAME)
    data["field"] += [{"name": "clock", "at": 8, "type": "f32", "unit": "s"}]
    data["field"][0] |= changes.get("field", {})
    data |= {key: value for key, value in changes.items() if key != "field"}
    if found is None:
        family_from(data, "unit")
    else:
        said = refusal(lambda: family_from(data, "unit"))
        assert found in said and expected in said


@pytest.mark.parametrize(
    ("transform", "expected"),
    [
        ({"kind": "table", "xs": [1, 2], "ys": [3, 4]}, None),
        ({"kind": "table", "xs": [1, 2, 3], "ys": [3, 4]}, "3 xs and 2 ys"),
        ({"kind": "table", "xs": [1], "ys": [3]}, "two or more of each"),
        ({"kind": "table", "xs": [1, 1], "ys": [3, 4]}, "rising raw values"),
        ({"kind": "polynomial", "coefficients": [1]}, None),
        ({"kind": "polynomial"}, "at least one coefficient"),
        ({"kind": "thermistor", "full": 65536, "b": 1e-4}, None),
        ({"kind": "thermistor", "full": 65536, "a": 1e-4}, None),
        ({"kind": "thermistor", "full": 65536, "c": 1e-4}, "Steinhart-Hart"),
    ],
)
def test_a_transform_has_what_it_needs(transform, expected):
    field = {"name": "t", "at": 8, "type": "u16", "unit": "degC", "transform": transform}
    if expected is None:
        described(field)
    else:
        assert expected in refusal(lambda: described(field))


@pytest.mark.parametrize(
    ("kind", "sentinel", "numbers"),
    [
        ("i16", "8000", [(-32768, None), (-32767, -32767.0), (32767, 32767.0)]),
        ("i16", "7FFF", [(32767, None), (-1, -1.0)]),
        ("u16", "8000", [(32768, None), (0, 0.0)]),
        ("i32", "FFFFFFFF", [(-1, None), (2147483647, 2147483647.0)]),
        ("u8", "FF", [(255, None), (127, 127.0)]),
    ],
)
def test_a_number_that_means_not_available_is_that_pattern_of_bits(kind, sentinel, numbers):
    size = SIZES[kind]
    field = {"name": "more", "at": 8, "type": kind, "sentinel": [sentinel]}
    rows = [
        b"\xa5\x5a"
        + struct.pack(">iH", 1, k)
        + number.to_bytes(size, "big", signed=kind[0] == "i")
        + bytes(4 - size)
        for k, (number, _) in enumerate(numbers)
    ]  # fmt: skip
    (message,) = reader_of(described(field)).feed(b"".join(rows))
    found = [None if value != value else value for value in message.columns()["more"].tolist()]
    assert found == [expected for _, expected in numbers]


@pytest.mark.parametrize(
    ("units", "field"), [("C", -40.0), ("C_100", -4000.0), ("F", -40.0), ("F_100", -4000.0)]
)
def test_a_temperature_as_sent(units, field):
    """Minus forty is minus forty; and 100 degC are 212 degF."""
    assert temperature_field(-40.0, units) == pytest.approx(field)
    assert temperature_field([100.0, 0.0], units).tolist() == pytest.approx(
        {"C": [100, 0], "C_100": [10000, 0], "F": [212, 32], "F_100": [21200, 3200]}[units]
    )


@pytest.mark.parametrize("order", ["big", "little"])
@pytest.mark.parametrize(("times", "add"), [(1, 0), (2, 6), (4, -8)])
def test_a_frame_that_says_its_length_is_written_with_it(order, times, add):
    data = copy.deepcopy(FRAME)
    data["frame"] = {
        "endian": order, "sync": "A55A", "max_length": 600,
        "length_field": {"at": 2, "type": "u16", "times": times, "add": add},
    }  # fmt: skip
    data["field"] = [data["field"][0] | {"at": 4}]
    del data["counter"]
    family = family_from(data, "unit")
    (form,) = family.forms
    for length in (8, 24, 520):
        (row,) = form.layout(length).blank(1)
        assert row[:2].tobytes() == b"\xa5\x5a"
        assert int.from_bytes(row[2:4].tobytes(), order) * times + add == length
        assert not row[4:].any()
        (message,) = reader_of(family).feed(row.tobytes() + b"\0")
        assert message.rows.shape == (1, length)


@pytest.mark.parametrize(("mine", "found"), [(["a"], "a"), (["b"], "b"), ([], "a, b")])
def test_a_variant_goes_without_some_fields_of_the_description(mine, found):
    data = {
        "schema": 1, "name": "unit", "title": "two messages", "frame": {"endian": "big", "length": 8},
        "field": [{"name": name, "at": at, "type": "u8"} for at, name in ((4, "a"), (5, "b"))],
        "variant": [
            {"name": "one", "sync": "A501", "without": ["a", "b"], "field": [
                {"name": "rate_x", "axis": "x", "at": 2, "type": "i16", "unit": "deg/s", "role": "rate"}]},
            {"name": "two", "sync": "A502", "without": [name for name in "ab" if mine and name not in mine]},
        ],
    }  # fmt: skip
    one, two = family_from(data, "unit").forms
    assert [spec.name for spec in one.fields] == ["rate_x"]
    assert ", ".join(spec.name for spec in two.fields) == found
    data["variant"][1]["without"] = ["c"]
    assert "variant 'two'.without" in refusal(lambda: family_from(data, "unit"))


@pytest.mark.parametrize(
    ("sync", "mask", "apart"),
    [("A502", None, True), ("A501", None, False), ("A511", "FFEF", False), ("A503", "FFFE", True),
     ("A5", None, False)],
)  # fmt: skip
def test_messages_begin_so_that_each_is_told_from_the_others(sync, mask, apart):
    rate = {"name": "rate_x", "axis": "x", "at": 2, "type": "i16", "unit": "deg/s", "role": "rate"}
    other = {"name": "two", "sync": sync} | ({} if mask is None else {"sync_mask": mask})
    if mask is not None:
        other["sync"] = f"{int(sync, 16) & int(mask, 16):04X}"
    data = {
        "schema": 1, "name": "unit", "title": "two messages", "frame": {"endian": "big", "length": 8},
        "field": [rate], "variant": [{"name": "one", "sync": "A501"}, other],
    }  # fmt: skip
    if apart:
        assert len(family_from(data, "unit").forms) == 2
    else:
        said = refusal(lambda: family_from(data, "unit"))
        assert "variant 'two'" in said and "the beginning of variant 'one'" in said


def test_a_mistake_in_a_list_is_told_by_number_and_name():
    data = copy.deepcopy(FRAME)
    data["field"][1]["at"] = "here"
    said = refusal(lambda: family_from(data, "unit"))
    assert "field[1] 'count'.at" in said and "'here'" in said and "offset in the frame" in said
    data["field"][1] = {"name": "count", "at": 6, "type": "u16", "tpye": "u8"}
    said = refusal(lambda: family_from(data, "unit"))
    assert "field[1] 'count'.tpye" in said and "did you mean 'type'?" in said
    data["field"][1] = {"name": "count", "at": 6}
    said = refusal(lambda: family_from(data, "unit"))
    assert "field[1] 'count'.type" in said and "Found: nothing" in said and "u8 i8 u16" in said
    data["field"] = [data["field"][0]]
    data["frame"]["checksum"] = {"kind": "crc99", "ranges": [[0, -2]], "at": -2}
    assert "frame.checksum" in refusal(lambda: family_from(data, "unit"))


def test_the_status_of_a_frame_is_its_status_field():
    data = copy.deepcopy(FRAME)
    data["field"] += [
        {"name": "spare", "at": 8, "type": "u8"},
        {"name": "word", "at": 9, "type": "u16", "role": "status"},
    ]
    frames = [
        b"\xa5\x5a" + struct.pack(">iHBHx", 1, k, 99, word) for k, word in enumerate((0x1234, 0, 0xFFFF))
    ]
    found = FrameDecoder(family_from(data, "unit"), rate_hz=100.0, axes="x").feed(b"".join(frames)).columns
    assert found["status"].tolist() == [0x1234, 0, 0xFFFF]


@pytest.mark.parametrize("value", [0, 1])
def test_an_angle_that_goes_on_counts_when_its_bit_says_so(value):
    angle = {"name": "angle", "axis": "x", "at": 2, "type": "u32", "unit": "deg", "role": "cumulative_angle",
             "valid": {"field": "flags", "bit": 6, "value": value}}  # fmt: skip
    data = FRAME | {"field": [angle, FRAME["field"][1], {"name": "flags", "at": 8, "type": "u8"}]}
    frames = [
        b"\xa5\x5a" + struct.pack(">IHB3x", 5 * k * k, k, flags)
        for k, flags in enumerate((0, 0, 64, 191, 64))
    ]
    found = FrameDecoder(family_from(data, "unit"), rate_hz=100.0, axes="x").feed(b"".join(frames)).columns
    assert found["angle"][1:].tolist() == [5, 15, 25, 35]
    good = [False, True, False, True, False] if value == 0 else [False, False, True, False, True]
    assert found["valid"].tolist() == good  # of the first nobody knows what was turned


def test_a_clock_in_seconds_is_written_as_it_is_and_goes_round():
    clock = {"name": "clock", "at": 8, "type": "f32", "unit": "s"}
    data = FRAME | {
        "field": [*FRAME["field"], clock],
        "counter": {"field": "clock", "ticks_per_s": 100, "modulo": 1000},
    }
    family = family_from(data, "unit")
    sent = FrameEncoder(family, "unit").encode(3, {"clock": [1.25, 9.75, 10.5], "rate_x": 1.0})
    assert [struct.unpack_from(">f", sent, 12 * k + 8)[0] for k in range(3)] == [1.25, 9.75, 0.5]


@pytest.mark.parametrize("falling", [False, True])
def test_a_transform_of_one_bit_is_turned_round(falling):
    curve = {"kind": "table", "xs": [0, 1], "ys": [7.0, 5.0] if falling else [5.0, 7.0]}
    field = FieldSection(name="f", at=0, type="u8", bits=(3, 1), transform=curve)
    codec = FieldCodec(field, 8, "big")
    assert codec.unphysical(np.array([5.0, 7.0])).tolist() == ([1, 0] if falling else [0, 1])


def test_every_field_out_of_its_frame_is_named():
    data = copy.deepcopy(FRAME)
    data["field"] += [
        {"name": "before", "at": -13, "type": "u8"},
        {"name": "beyond", "at": 12, "type": "u8"},
        {"name": "on_another", "at": 6, "type": "u8"},
    ]
    said = refusal(lambda: family_from(data, "unit"))
    for name in ("before", "beyond", "on_another"):
        assert f"field {name!r}.at" in said
    assert "bytes -1 to 0" in said and "bytes 12 to 13" in said
    described({"name": "last", "at": -1, "type": "u8"}, {"name": "earlier", "at": -4, "type": "u8"})


@pytest.mark.parametrize(("div", "right"), [(0.5, True), (0, False), (-0.5, False), (1e300, True)])
def test_numbers_are_divided_by_something_above_zero(div, right):
    field = {"name": "more", "at": 8, "type": "u8", "scale": {"div": div}}
    if right:
        described(field)
    else:
        assert "scale.div" in refusal(lambda: described(field))


@pytest.mark.parametrize(("columns", "right"), [(1, True), (100, True), (0, False), (101, False)])
def test_a_line_has_from_1_to_100_columns(columns, right):
    data = {
        "schema": 1, "name": "lines", "title": "lines of a test", "frame": {},
        "line": {"start": "$A", "columns": columns},
        "field": [{"name": "rate_z", "axis": "z", "at": 0, "type": "f64", "unit": "deg/s", "role": "rate"}],
    }  # fmt: skip
    if right:
        family_from(data, "here")
    else:
        assert "line.columns" in refusal(lambda: family_from(data, "here"))


def test_of_a_line_without_an_end_the_last_1024_bytes_are_kept():
    data = {
        "schema": 1, "name": "lines", "title": "lines of a test", "frame": {},
        "line": {"start": "$A", "columns": 1},
        "field": [{"name": "rate_z", "axis": "z", "at": 0, "type": "f64", "unit": "deg/s", "role": "rate"}],
    }  # fmt: skip
    reader = reader_of(family_from(data, "here"))
    for size in (1000, 24, 1, 5000):
        reader.feed(b"x" * size)
        assert reader.pending == min(1024, reader.counts.bytes_skipped + reader.pending)
    assert reader.pending == 1024 and reader.counts.bytes_skipped == 6025 - 1024
    (message,) = reader.feed(b"\n$A1.5\n")
    assert message.columns()["rate_z"].tolist() == [1.5]
    assert reader.counts.bytes_skipped == 6026 and reader.pending == 0


def test_a_frame_told_by_its_last_byte_is_there_with_it():
    data = copy.deepcopy(FRAME)
    data["frame"]["match"] = [{"at": 11, "equals": "7F"}]
    reader = reader_of(family_from(data, "unit"))
    (message,) = reader.feed(b"\xa5\x5a" + struct.pack(">iH3x", 7, 1) + b"\x7f")
    assert message.rows.shape == (1, 12)
    assert reader.feed(b"\xa5\x5a" + struct.pack(">iH3x", 7, 1) + b"\x7e") == []


@pytest.mark.parametrize("kind", ["sum8", "sum16", "crc32"])
@pytest.mark.parametrize("at", [8, 9, 10, 13])
def test_a_check_has_bytes_of_its_own_within_the_frame(kind, at):
    size = {"sum8": 1, "sum16": 2, "crc32": 4}[kind]
    check = {"kind": kind, "ranges": [[2, 8]], "at": at} | ({"poly": "04C11DB7"} if kind == "crc32" else {})

    def with_field(place, **changes):
        return described(
            {"name": "more", "at": place, "type": "u8"},
            frame=FRAME["frame"] | {"length": 20, "checksum": [check | changes]},
        )

    for place in range(at, at + size):
        assert "checksum[0] is there" in refusal(lambda place=place: with_field(place))
    with_field(at + size)
    if at > 8:
        with_field(at - 1)
    for ranges in ([[-21, -13]], [[2, 21]], [[5, 5]], [[6, 4]]):
        said = refusal(lambda ranges=ranges: with_field(at + size, ranges=ranges))
        assert "checksum[0].ranges" in said and "a range within the frame's 20 bytes" in said
    assert "ranges without it" in refusal(lambda: with_field(at + size, ranges=[[2, at + 1]]))
    with_field(at + size, ranges=[[-20, at]])
    for place in (-21, 21 - size):
        assert "checksum[0].at" in refusal(lambda place=place: with_field(at + size, at=place))
    with_field(8, at=20 - size, ranges=[[0, 20 - size]])
