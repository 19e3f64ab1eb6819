"""Descriptions of frames, lines and CAN messages: what is refused at the border; bytes read by hand."""

from __future__ import annotations

import copy
import struct

import pytest

from drivers.base.errors import ConfigurationError
from drivers.can_dbc import CanConfig, CanDecoder, _read_dbc, can_kind, layout_from_mapping
from drivers.can_dbc._kind import CanGyro
from drivers.frames import FrameDecoder, Frames, vector_mistakes
from drivers.frames._load import family_from
from drivers.kit.slcan_codec import BITRATE_COMMANDS
from drivers.kvh.format import RATES_HZ
from tests.drivers.test_can_dbc_decoder import TEST_DBC, line
from tests.drivers.test_decoders_by_hand import FRAME, described, hearing

SIZES = {
    "u8": 1, "i8": 1, "u16": 2, "i16": 2, "u24": 3, "i24": 3, "u32": 4, "i32": 4, "u64": 8, "f32": 4, "f64": 8,
    "text:3": 3, "text:12": 12,
}  # fmt: skip


def refusal(make) -> str:
    with pytest.raises(ConfigurationError) as refused:
        make()
    return str(refused.value)


@pytest.mark.parametrize("kind", SIZES)
def test_a_field_takes_the_bytes_of_its_type_and_no_more(kind):
    """One byte behind it there is another field; one byte nearer they would share one; the frame ends with it."""
    size = SIZES[kind]
    frame = FRAME["frame"] | {"length": 9 + size}
    one = {"name": "one", "at": 8, "type": kind}
    described(one, {"name": "next", "at": 8 + size, "type": "u8"}, frame=frame)
    if size > 1:
        said = refusal(lambda: described(one, {"name": "next", "at": 7 + size, "type": "u8"}, frame=frame))
        assert "field 'next'.at" in said and "field 'one' is there" in said
    said = refusal(lambda: described(one | {"at": 10}, frame=frame))
    assert f"bytes 10 to {10 + size}" in said and f"the frame's {9 + size} bytes" in said
    described(one | {"at": 9}, frame=frame)
    described(one | {"at": -size}, frame=frame)
    if size > 1:
        assert "a place within" in refusal(lambda: described(one | {"at": -size + 1}, frame=frame))


@pytest.mark.parametrize("kind", ["u8", "u16", "u24", "u32"])
def test_no_field_lies_in_the_bytes_that_tell_the_length(kind):
    size = SIZES[kind]

    def with_field(at):
        data = copy.deepcopy(FRAME)
        data["frame"] = {
            "endian": "big",
            "sync": "A55A",
            "length_field": {"at": 2, "type": kind},
            "max_length": 40,
        }
        data["field"] = [data["field"][0] | {"at": 10}, {"name": "more", "at": at, "type": "u8"}]
        del data["counter"]
        return family_from(data, "unit")

    for at in range(2, 2 + size):
        assert "length_field is there" in refusal(lambda at=at: with_field(at))
    with_field(2 + size)


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(
    ("one", "other", "apart"),
    [
        ([0, 4], [4, 4], True),
        ([0, 4], [3, 4], False),
        ([1, 3], [4, 2], True),
        ([1, 4], [4, 2], False),
        ([5, 1], [6, 2], True),
        ([2, 5], [3, 1], False),
        ([7, 1], [0, 7], True),
        ([7, 1], [0, 8], False),
    ],
)
def test_two_names_for_bits_of_one_number_have_bits_of_their_own(one, other, apart, order):
    fields = [
        {"name": name, "at": 8, "type": "u8", "bits": bits}
        for name, bits in zip("ab", (one, other)[::order], strict=True)
    ]
    if apart:
        described(*fields)
    else:
        assert "bytes of its own" in refusal(lambda: described(*fields))


def test_a_status_word_shares_its_bytes_with_names_for_its_bits_and_multiplexed_fields_with_each_other():
    word = {"name": "word", "at": 8, "type": "u16"}
    bit = {"name": "bit", "at": 8, "type": "u16", "bits": [3, 2]}
    described(word, bit)
    described(bit, word)
    assert "bytes of its own" in refusal(lambda: described(word, {"name": "same", "at": 8, "type": "u16"}))
    even = {"name": "even", "at": 8, "type": "u16", "when": {"field": "count", "mod": 2, "equals": 0}}
    odd = {"name": "odd", "at": 9, "type": "u16", "when": {"field": "count", "mod": 2, "equals": 1}}
    described(even, odd)
    described(odd, even)


@pytest.mark.parametrize("key", ["length", "max_length"])
def test_a_frame_has_from_2_to_65535_bytes(key):
    for size, right in ((2, True), (65_535, True), (1, False), (65_536, False)):
        data = {"length": size} if key == "length" else {"length": 12, "max_length": size}
        try:
            described(frame=FRAME["frame"] | data)
            said = ""
        except ConfigurationError as error:
            said = str(error)
        assert (f"frame.{key}" in said) != right, (size, said)


@pytest.mark.parametrize("value", [0, 1])
def test_a_rate_counts_when_its_bit_says_so(value):
    data = copy.deepcopy(FRAME)
    data["field"][0]["valid"] = {"field": "flags", "bit": 3, "value": value}
    data["field"].append({"name": "flags", "at": 8, "type": "u8"})
    frames = [b"\xa5\x5a" + struct.pack(">iHB3x", 7, k, flags) for k, flags in enumerate((0, 8, 247, 255))]
    found = FrameDecoder(family_from(data, "unit"), rate_hz=100.0, axes="x").feed(b"".join(frames)).columns
    assert found["valid"].tolist() == [on == bool(value) for on in (False, True, False, True)]


TEXT = {"name": "model", "at": 8, "type": "text:3"}


@pytest.mark.parametrize(
    ("sent", "wanted", "right"),
    [
        (b"AB\0", "AB", True),
        (b"ABC", "ABC", True),
        (b"ABA", "ABC", False),
        (b"ABD", "ABC", False),
        (b"AB ", "AB", True),
    ],
)
def test_a_text_of_a_vector_is_that_text(sent, wanted, right):
    frame = b"\xa5\x5a" + struct.pack(">iH", 7, 1) + sent + b"\0"
    data = FRAME | {"field": [*FRAME["field"], TEXT]}
    data["vector"] = [{"hex": frame.hex(), "expect": {"model": wanted, "rate_x": 7, "count": 1}}]
    mistakes = [each for each in vector_mistakes(family_from(data, "unit")) if "expect" in each.key]
    assert [each.key for each in mistakes] == ([] if right else ["vector[0].expect.model"])
    if not right:
        assert mistakes[0].expected == repr(wanted)


@pytest.mark.parametrize(
    ("wanted", "tolerance", "right"),
    [
        (7, 0.0, True),
        (7.001, 1e-4, False),
        (7.0005, 1e-4, True),
        (-7, 0.0, False),
        (float("nan"), 0.0, False),
    ],
)
def test_a_number_of_a_vector_is_met_within_its_tolerance(wanted, tolerance, right):
    frame = b"\xa5\x5a" + struct.pack(">iH4x", 7, 1)
    vector = {"hex": frame.hex(), "expect": {"rate_x": wanted}, "tolerance": tolerance}
    mistakes = [
        each
        for each in vector_mistakes(family_from(FRAME | {"vector": [vector]}, "unit"))
        if "expect" in each.key
    ]
    assert bool(mistakes) != right
    assert [each.found for each in mistakes] == ([] if right else ["7"])


def test_a_vector_names_a_field_that_the_message_has_and_the_message_that_it_is():
    frame = (b"\xa5\x5a" + struct.pack(">iH4x", 7, 1)).hex()

    def mistakes(**vector):
        found = vector_mistakes(family_from(FRAME | {"vector": [{"expect": {}, **vector}]}, "unit"))
        return {each.key: each.found for each in found if "flipped" not in each.found}

    assert "one of count, rate_x" in refusal(lambda: mistakes(hex=frame, expect={"rate_y": 1.0}))
    assert mistakes(hex=frame) == {}
    assert mistakes(hex=frame[:-2]) == {"vector[0].hex": "11 bytes, the beginning of a longer frame"}
    assert mistakes(hex=frame + "00") == {
        "vector[0].hex": "13 bytes that do not begin as one frame does and end with it"
    }
    assert mistakes(hex=frame * 2) == {
        "vector[0].hex": "24 bytes that do not begin as one frame does and end with it"
    }
    assert mistakes(hex="00" + frame[2:]) == {
        "vector[0].hex": "12 bytes that do not begin as one frame does and end with it"
    }


def config(description, **more):
    keys = {"name": "g", "driver": "frames", "unit": "1", "axis": "x", "axes": "x", "rate_hz": 100.0,
            "port": "/dev/p", "baudrate": 115200, "description": description}  # fmt: skip
    return Frames.config(**keys | more)


def test_one_sensor_is_the_case_temperature_and_several_have_their_names():
    one = {"name": "inner", "at": 8, "type": "i16", "unit": "degC", "role": "temp", "scale": {"div": 10}}
    other = {"name": "outer", "at": 10, "type": "i16", "unit": "K", "role": "temp"}
    for fields, expected in (([one], {}), ([one, other], {"inner_c": 25.5, "outer_c": 20.0 - 0.15})):
        data = FRAME | {"field": [*FRAME["field"], *fields]}
        rows = b"\xa5\x5a" + struct.pack(">iHhh", 7, 1, 255, 293)
        kind = config(data)
        found = Frames.temperatures(kind, Frames.decoder(kind).feed(rows).columns, 100.0)
        assert {name: float(values[0]) for name, values in found.items()} == pytest.approx(expected, rel=1e-6)


def test_of_several_messages_the_one_whose_columns_came_tells_what_they_mean():
    """Without a name the bench reads the first message it hears; here they say the same name in other units."""
    data = {
        "schema": 1, "name": "unit", "title": "two messages", "frame": {"endian": "big", "length": 8},
        "variant": [
            {"name": "short", "sync": "A501", "field": [
                {"name": "rate_x", "axis": "x", "at": 2, "type": "i16", "unit": "deg/s", "role": "rate"}]},
            {"name": "long", "sync": "A502", "field": [
                {"name": "rate_x", "axis": "x", "at": 2, "type": "i16", "unit": "deg/h", "role": "rate"},
                {"name": "accel_x", "axis": "x", "at": 4, "type": "i16", "unit": "m/s2", "role": "accel"}]},
        ],
    }  # fmt: skip
    rows = {
        name: b"\xa5" + bytes([number]) + struct.pack(">hh2x", 36, 5)
        for name, number in (("short", 1), ("long", 2))
    }
    for name, rate, accel in (("short", 36.0, {}), ("long", 0.01, {"x": 5.0})):
        kind = config(data)
        columns = Frames.decoder(kind).feed(rows[name] * 3).columns
        assert Frames.rates(kind, columns, 100.0)["x"].tolist() == pytest.approx([rate] * 3)
        found = Frames.accelerations(kind, columns, 100.0)
        assert {axis: float(values[0]) for axis, values in found.items()} == accel


def test_of_messages_in_turn_what_all_have_is_a_column():
    """The first has two sensors, the second none: there are rates of both, and no temperatures."""
    sensors = [
        {"name": f"t{k}", "at": 2 * k + 2, "type": "i16", "unit": "degC", "role": "temp"} for k in (1, 2)
    ]
    data = {
        "schema": 1, "name": "unit", "title": "messages in turn", "frame": {"endian": "big", "length": 10},
        "message": ["one", "two"],
        "field": [{"name": "rate_x", "axis": "x", "at": 2, "type": "i16", "unit": "deg/s", "role": "rate"}],
        "variant": [{"name": "one", "sync": "A501", "field": sensors}, {"name": "two", "sync": "A502"}],
    }  # fmt: skip
    for order in (1, -1):
        kind = config(data | {"message": data["message"][::order]})
        rows = b"".join(b"\xa5" + bytes([1 + k % 2]) + struct.pack(">hhh2x", k, 20, 30) for k in range(4))
        columns = Frames.decoder(kind).feed(rows).columns
        assert Frames.rates(kind, columns, 100.0)["x"].tolist() == [0, 1, 2, 3]
        assert Frames.temperatures(kind, columns, 100.0) == {}


def line_description(**field):
    return {
        "schema": 1, "name": "lines", "title": "lines of a test", "frame": {},
        "line": {"start": "$A", "columns": 3},
        "field": [{"name": "rate_z", "axis": "z", "at": 1, "type": "f64", "unit": "deg/s", "role": "rate"}
                  | field],
    }  # fmt: skip


def test_a_number_of_a_line_has_a_column_of_it_and_a_type_that_lines_have():
    for at in (0, 1, 2):
        family_from(line_description(at=at), "here")
    for at in (3, 4, -1):
        said = refusal(lambda at=at: family_from(line_description(at=at), "here"))
        assert "a column from 0 to 2" in said and str(at) in said
    for kind in ("f64", "i32", "u32"):
        family_from(line_description(type=kind), "here")
    for kind in ("u8", "f32", "text:4", "u64"):
        assert "f64, i32 or u32" in refusal(
            lambda kind=kind: family_from(line_description(type=kind), "here")
        )


def test_the_commands_for_bit_rates_are_those_of_the_adapters_manual():
    """LAWICEL CANUSB manual, command Sn[CR]: S0 to S8."""
    kbit_s = (10, 20, 50, 100, 125, 250, 500, 800, 1000)
    assert {1000 * rate: f"S{n}\r".encode() for n, rate in enumerate(kbit_s)} == BITRATE_COMMANDS


def test_the_message_rates_are_those_of_the_units_manual():
    """KVH 56-0298, =DR: 1 to 1000 Hz, and 3600 and 5000 Hz of the 1775."""
    assert set(RATES_HZ) == {1, 5, 10, 25, 50, 100, 250, 500, 750, 1000, 3600, 5000}


def test_why_a_dbc_file_cannot_be_read_is_told_in_the_words_of_its_format():
    error = ValueError("outer words")
    assert _read_dbc._why(error, 1 << 28) == "outer words"
    error.e_dbc = KeyError("the DBC's own")
    assert "the DBC's own" in _read_dbc._why(error, 1 << 28) and "outer" not in _read_dbc._why(error, 1 << 28)
    assert _read_dbc._why(ValueError(), 1) == "ValueError"
    assert len(_read_dbc._why(ValueError("x" * 5000), 1)) == 1000
    error.e_dbc = MemoryError()
    assert _read_dbc._why(error, 3 << 20) == "more than 3 MiB of memory to read it"


def test_a_dbc_file_is_read_in_either_of_the_character_sets_of_such_files():
    for text, encoding in (("°C", "utf-8"), ("°C", "utf-8-sig"), ("°C", "cp1252")):
        content = TEST_DBC.replace('"K"', f'"{text}"').encode(encoding)
        (slow,) = (each for each in _read_dbc.messages_in(content) if each["name"] == "SLOW")
        assert (slow["frame_id"], slow["length"], slow["is_extended_frame"]) == (17, 4, False)
        temp, ok = slow["signals"]
        assert temp["unit"] == "°C" and (temp["start"], temp["length"], temp["scale"]) == (0, 16, 0.1)
        assert temp["is_signed"] and not ok["is_signed"] and temp["byte_order"] == "little_endian"


ANGLES = """VERSION ""
BU_: A
BO_ 16 IMU: 8 A
 SG_ N : 0|16@1+ (1,0) [0|0] "" A
 SG_ DX : 16|16@1- (0.001,0) [0|0] "deg" A
 SG_ DY : 32|16@1- (0.01,0) [0|0] "deg" A
"""


@pytest.fixture
def angles(tmp_path):
    (tmp_path / "imu.dbc").write_text(ANGLES, encoding="utf-8")
    mapping = {
        "format": 1, "dbc": "imu.dbc", "sample": ["IMU"],
        "signal": [
            {"role": "counter", "message": "IMU", "signal": "N"},
            {"role": "delta_angle", "axis": "x", "message": "IMU", "signal": "DX"},
            {"role": "delta_angle", "axis": "y", "message": "IMU", "signal": "DY"},
        ],
    }  # fmt: skip
    return layout_from_mapping(mapping, tmp_path, "map.toml", "imu")


def test_an_angle_of_a_sample_times_the_sample_rate_is_a_rate(angles):
    kind = can_kind(CanConfig, lambda _: angles)
    said = CanConfig(name="g", driver="any", unit="1", axis="x", axes="xy", interface="socketcan", channel="can0",
                     rate_hz=100.0)  # fmt: skip
    rows = b"".join(line(16, struct.pack("<Hhh2x", k, angle, 250)) for k, angle in enumerate((20, -3)))
    columns = kind.decoder(said).feed(rows).columns
    found = kind.rates(said, columns, 97.5)
    assert found["x"].tolist() == pytest.approx([0.02 * 97.5, -0.003 * 97.5], rel=1e-6)
    assert found["y"].tolist() == pytest.approx([2.5 * 97.5] * 2, rel=1e-6)


J1939 = """VERSION ""
BU_: A
BO_ 2565875968 RATES: 8 A
 SG_ W : 0|16@1- (0.01,0) [0|0] "deg/s" A
"""


@pytest.mark.parametrize(("source", "said"), [(None, ""), (0x0B, " from address 0x0B")])
def test_who_sends_something_else_is_told_what_was_expected_of_whom(tmp_path, source, said):
    (tmp_path / "unit.dbc").write_text(J1939, encoding="utf-8")
    mapping = {"format": 1, "dbc": "unit.dbc", "j1939": True, "sample": ["RATES"],
               "signal": [{"role": "rate", "axis": "x", "message": "RATES", "signal": "W"}]}  # fmt: skip
    layout = layout_from_mapping(mapping, tmp_path, "map.toml", "unit")
    gyro = CanGyro(None, hearing(line(0x123, b"\0") + line(0x00F00321, b"\1", extended=True)),
                   CanDecoder(layout, 100.0, "x", source))  # fmt: skip
    with pytest.raises(Exception, match="not a unit of kind") as met:
        gyro.identify()
    assert met.value.found == "identifiers 0x123, 0x00F00321"
    assert met.value.expected.endswith(f"{said} (RATES)") and met.value.expected.startswith(
        "identifiers 0x18F02900"
    )
    if source is not None:
        for address, right in ((0x0B, True), (0x0C, False)):
            sent = line(0x18F02900 | address, b"\0" * 8, extended=True)
            heard = CanGyro(None, hearing(sent), CanDecoder(layout, 100.0, "x", source))
            if right:
                assert heard.identify().details["identifiers"].endswith("0B")
            else:
                with pytest.raises(Exception, match="not a unit of kind"):
                    heard.identify()
