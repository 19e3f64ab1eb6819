"""What a description may not say, mistake by mistake, and what its rules make of bytes packed by hand."""

import copy
import math
import struct
import zlib
from types import SimpleNamespace

import numpy as np
import pytest

from drivers.base.errors import ConfigurationError
from drivers.frames import FrameDecoder, reader_of, vector_mistakes
from drivers.frames._load import family_from, is_path
from drivers.frames._units import UNITS

BINARY = {
    "schema": 1,
    "name": "unit",
    "title": "a unit of a test",
    "frame": {
        "endian": "big",
        "sync": "A55A",
        "length": 12,
        "checksum": {"kind": "sum8", "ranges": [[0, 11]], "at": 11},
    },
    "field": [
        {"name": "rate_x", "axis": "x", "at": 2, "type": "i32", "unit": "deg/s", "role": "rate",
         "scale": {"div": 1000.0}},
        {"name": "count", "at": 6, "type": "u8"},
        {"name": "heat", "at": 7, "type": "i16", "unit": "degC", "role": "temp", "scale": {"div": 100.0}},
        {"name": "status", "at": 9, "type": "u16"},
    ],
    "counter": {"field": "count"},
}  # fmt: skip


def changed(*changes, base=BINARY):
    """The description with values put at paths like ("field", 0, "at"); None takes a key away."""
    data = copy.deepcopy(base)
    for path, value in changes:
        place = data
        for key in path[:-1]:
            place = place.setdefault(key, {}) if isinstance(place, dict) else place[key]
        if value is None:
            del place[path[-1]]
        elif isinstance(place, list) and path[-1] == len(place):
            place.append(value)
        else:
            place[path[-1]] = value
    return data


def field(**keys):
    return ("field", 4), {"name": "more", "at": 9, "type": "u16", **keys}


def last(**keys):
    return ("field", 3), {"name": "more", "at": 9, "type": "u16", **keys}


RATE, HEAT, FRAME = ("field", 0), ("field", 2), ("frame",)
BY_LENGTH = [((*FRAME, "length"), None), ((*FRAME, "length_field"), {"at": 2, "type": "u8"})]
TABLE = {"kind": "table", "xs": [0.0, 1.0], "ys": [0.0, 2.0]}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ([((*FRAME, "sync"), None)], ["frame.sync", "nothing"]),
        ([((*FRAME, "sync"), ["A55A", "A5"])], ["syncs of [1, 2] bytes"]),
        ([((*FRAME, "sync_mask"), "FF")], ["syncs of [2] bytes and a mask of 1"]),
        ([((*FRAME, "sync_mask"), "0000")], ["no bit that counts"]),
        ([((*FRAME, "match"), [{"at": 10, "equals": "0102", "mask": "FF"}])], ["1 bytes of mask"]),
        ([((*FRAME, "match"), [{"at": 11, "equals": "0102"}])], ["bytes 11 to 12"]),
        ([((*FRAME, "length"), None)], ["frame.length", "nothing"]),
        ([((*FRAME, "length_field"), {"at": 2, "type": "u8"})], ["length and length_field", "one of the two"]),
        (BY_LENGTH, ["frame.max_length", "Found: nothing", "where a field gives the length"]),
        ([*BY_LENGTH, ((*FRAME, "max_length"), 5)], ["frame.max_length", "Found: 5"]),
        ([((*FRAME, "checksum", "kind"), "crc8")], ["checksum[0].poly", "polynomial"]),
        (
            [((*FRAME, "checksum", "kind"), "crc8"), ((*FRAME, "checksum", "poly"), "1FF")],
            ["more than 8 bits"],
        ),
        ([((*FRAME, "checksum", "poly"), "07")], ["is no CRC"]),
        ([((*FRAME, "checksum", "pad_to"), 2)], ["is no CRC"]),
        ([((*FRAME, "checksum", "pad_to"), 65)], ["pad_to"]),
        ([((*FRAME, "checksum", "at"), 12)], ["checksum[0].at"]),
        ([((*FRAME, "checksum", "ranges"), [[5, 5]])], ["[5, 5]", "a range within the frame's 12 bytes"]),
        ([((*FRAME, "checksum", "ranges"), [[0, 12]])], ["ranges without it"]),
        (
            [((*FRAME, "checksum"), {"kind": "sum16_words", "ranges": [[0, 9]], "at": 10}), (("field", 3), None)],
            ["9 bytes", "16-bit words"],
        ),
        ([((*RATE, "at"), 1)], ["bytes 1 to 4", "the sync or match bytes"]),
        ([((*RATE, "at"), 4)], ["bytes of its own", "'rate_x' is there"]),
        ([((*HEAT, "at"), -1)], ["field 'heat'.at", "a place within the frame's 12 bytes"]),
        ([((*FRAME, "terminator"), "0D"), ((*FRAME, "checksum"), None), (("field", 3, "at"), 10)],
         ["the terminator is there"]),
        ([field(bits=[0, 0])], ["field 'more'.bits", "[0, 0] of u16"]),
        ([field(bits=[-1, 2])], ["bits that an unsigned type has"]),
        ([field(bits=[9, 8])], ["bits that an unsigned type has"]),
        ([field(bits=[0, 4], type="i16")], ["bits that an unsigned type has"]),
        ([field(bits=[0, 4]), (("field", 3, "bits"), [3, 4])], ["bytes of its own"]),
        ([((*RATE, "axis"), None)], ["field 'rate_x'.axis"]),
        ([((*RATE, "unit"), "deg")], ["a unit of rate: deg/s, deg/h, rad/s, mdeg/s, arcsec/s"]),
        ([last(type="text:2", role="temp", unit="degC")], ["'aux' for a text"]),
        ([((*HEAT, "sentinel"), ["10000"])], ["field 'heat'.sentinel", "10000"]),
        ([((*HEAT, "valid"), {"field": "nobody", "bit": 0})], ["heat'.valid.field", "'nobody'"]),
        ([((*HEAT, "when"), {"field": "count", "equals": 1})], ["either mod or mask"]),
        ([((*HEAT, "when"), {"field": "count", "equals": 1, "mod": 2, "mask": "1"})], ["either mod or mask"]),
        ([((*HEAT, "transform"), TABLE | {"xs": [0.0]})], ["1 xs and 2 ys"]),
        ([((*HEAT, "transform"), TABLE | {"xs": [1.0], "ys": [1.0]})], ["two or more"]),
        ([((*HEAT, "transform"), TABLE | {"xs": [1.0, 1.0]})], ["rising raw values"]),
        ([((*HEAT, "transform"), {"kind": "polynomial"})], ["at least one coefficient"]),
        ([((*HEAT, "transform"), {"kind": "thermistor"})], ["Steinhart-Hart"]),
        ([((*HEAT, "transform"), {"kind": "thermistor", "a": 1.0}), ((*HEAT, "unit"), "K")], ["'degC'"]),
        ([((*RATE, "role"), "aux")], ["no gyro channel"]),
        ([last(role="temp", unit="degC")], []),
        ([last(axis="x", role="rate", unit="deg/s")],
         ["a channel of its own", "'rate_x' is this one"]),
        ([(("counter", "field"), "nobody")], ["counter.field", "one of count, heat, rate_x, status"]),
        ([(("counter", "modulo"), 257)], ["counter.modulo", "at most 256"]),
        ([(("counter", "modulo"), 256)], []),
        ([(("status",), [{"name": "bad", "field": "status", "bit": 16}])], ["0 to 15"]),
        ([(("status",), [{"name": "bad", "field": "status", "bit": 15}])], []),
        ([(("status",), [{"name": "bad", "field": "nobody", "bit": 0}])], ["status[0] 'bad'.field"]),
        ([(("message",), "nobody")], ["message", "'nobody'", "one of unit"]),
        ([field(name="rate_x", type="u8", at=1)], ["2 of that name"]),
    ],
)  # fmt: skip
def test_a_mistake_is_named_with_what_was_found_and_expected(changes, words):
    data = changed(*changes)
    if not words:
        family_from(data, "here")
        return
    with pytest.raises(ConfigurationError) as refused:
        family_from(data, "here")
    assert all(word in str(refused.value) for word in words), str(refused.value)


@pytest.mark.parametrize(
    ("transform", "unit"), [(TABLE, "K"), ({"kind": "polynomial", "coefficients": [1.0]}, "K")]
)
def test_only_a_thermistor_gives_degrees_celsius(transform, unit):
    family_from(changed(((*HEAT, "transform"), transform), ((*HEAT, "unit"), unit)), "here")


def frame(rate, count, heat, status):
    body = b"\xa5\x5a" + struct.pack(">iBhH", rate, count, heat, status)
    return body + bytes([sum(body) & 0xFF])


def decoded(data, stream, **options):
    return FrameDecoder(family_from(data, "here"), **({"rate_hz": 100.0, "axes": "x"} | options)).feed(stream)


def test_rates_counter_and_temperature_of_frames_packed_by_hand():
    rows = [(-1_500_000, 254, -4000, 7), (2_000, 255, 2512, 0), (0, 0, 0, 65535)]
    batch = decoded(BINARY, b"".join(frame(*row) for row in rows))
    assert batch.columns["rate_x"].tolist() == [-1500.0, 2.0, 0.0]
    assert batch.columns["temp_c"].tolist() == pytest.approx([-40.0, 25.12, 0.0])
    assert batch.columns["counter"].tolist() == [254, 255, 0]
    assert batch.end_offset.tolist() == [12, 24, 36]


@pytest.mark.parametrize(
    ("keys", "stored", "value"),
    [
        ({"bits": [4, 3]}, 0b0101_0000, 0b101),
        ({"bits": [0, 16]}, 0xFFFF, 0xFFFF),
        ({"scale": {"mul": 3.0, "div": 4.0, "pow2": 2}, "offset": -1.0}, 10, 29.0),
        ({"sentinel": ["FFFF"]}, 0xFFFF, math.nan),
        ({"sentinel": ["FFFF"]}, 0xFFFE, 65534.0),
        ({"transform": TABLE | {"xs": [0.0, 100.0], "ys": [10.0, 20.0]}}, 25, 12.5),
        ({"transform": TABLE | {"xs": [10.0, 20.0], "ys": [10.0, 20.0]}}, 5, 10.0),
        ({"transform": {"kind": "polynomial", "coefficients": [1.0, 2.0, 3.0]}}, 4, 57.0),
        ({"valid": {"field": "count", "bit": 1}}, 5, math.nan),
        ({"valid": {"field": "count", "bit": 0}}, 5, 5.0),
        ({"valid": {"field": "count", "bit": 1, "value": 0}}, 5, 5.0),
        ({"when": {"field": "count", "mod": 4, "equals": 1}}, 5, 5.0),
        ({"when": {"field": "count", "mod": 4, "equals": 2}}, 5, math.nan),
        ({"when": {"field": "count", "mask": "3", "equals": 1}}, 5, 5.0),
        ({"when": {"field": "count", "mask": "3", "equals": 0}}, 5, math.nan),
    ],
)
def test_a_field_is_worth_what_its_rule_says(keys, stored, value):
    """The count is 0b10001 = 17."""
    data = changed((("field", 3), {"name": "more", "at": 9, "type": "u16", **keys}))
    reader = reader_of(family_from(data, "here"))
    columns = reader.feed(frame(0, 17, 0, stored))[0].columns()
    assert columns["more"].tolist() == pytest.approx([value], nan_ok=True)


def test_a_thermistor_follows_steinhart_and_hart():
    """10 kOhm at 25 degC (a = 1.129148e-3, b = 2.34125e-4, d = 8.76741e-8: the usual NTC of that value)."""
    rule = {
        "kind": "thermistor", "k": 10_000.0, "full": 4096.0, "a": 1.129148e-3, "b": 2.34125e-4, "d": 8.76741e-8,
    }  # fmt: skip
    data = changed((("field", 2), {"name": "heat", "at": 7, "type": "u16", "unit": "degC", "role": "temp",
                                   "transform": rule}))  # fmt: skip
    batch = decoded(data, frame(0, 0, 2048, 0))
    assert batch.columns["temp_c"].tolist() == pytest.approx([25.0], abs=0.02)


@pytest.mark.parametrize("order", ["big", "little"])
@pytest.mark.parametrize(
    ("kind", "value"),
    [("u8", 200), ("i8", -100), ("u16", 40_000), ("i16", -30_000), ("u24", 10_000_000), ("i24", -5_000_000),
     ("u32", 4_000_000_000), ("i32", -2_000_000_000), ("u64", 1 << 40), ("f32", -1.5), ("f64", 1e-300)],
)  # fmt: skip
@pytest.mark.parametrize("at", [2, -1])
def test_a_number_of_every_type_and_order_at_both_ends_of_a_frame(order, kind, value, at):
    """`at` counts from the end of the frame where it is negative: the last byte is at -1."""
    size = int(kind[1:]) // 8
    number = (
        struct.pack((">" if order == "big" else "<") + {4: "f", 8: "d"}[size], value)
        if kind[0] == "f"
        else value.to_bytes(size, order, signed=value < 0)
    )
    spec = {"name": "rate_x", "axis": "x", "type": kind, "unit": "deg/s", "role": "rate"}
    data = {
        "schema": 1, "name": "one", "title": "one number",
        "frame": {"endian": order, "sync": "A55A", "length": 2 + size + 4},
        "field": [spec | {"at": 2 if at > 0 else -size}],
    }  # fmt: skip
    body = number + b"\x11\x22\x33\x44" if at > 0 else b"\x11\x22\x33\x44" + number
    batch = decoded(data, (b"\xa5\x5a" + body) * 3)
    assert batch.columns["rate_x"].tolist() == [value] * 3


def test_frames_whose_length_stands_in_them_little_endian_in_words():
    """Length field 0x0003: 3 words of 2 bytes and 4 more."""
    data = {
        "schema": 1, "name": "long", "title": "frames of stated length",
        "frame": {
            "endian": "little", "sync": "A55A", "max_length": 600,
            "length_field": {"at": 2, "type": "u16", "times": 2, "add": 4},
            "checksum": {"kind": "crc32", "poly": "04C11DB7", "init": "FFFFFFFF", "reflected": True,
                         "xorout": "FFFFFFFF", "ranges": [[0, -4]], "at": -4},
        },
        "field": [
            {"name": "rate_x", "axis": "x", "at": 4, "type": "i16", "unit": "deg/s", "role": "rate"},
            {"name": "last", "at": -5, "type": "u8"},
        ],
    }  # fmt: skip
    frames = []
    for rate, words in ((-5, 4), (7, 260), (9, 4)):
        body = b"\xa5\x5a" + struct.pack("<Hh", words, rate) + bytes(2 * words - 7) + b"\x2a"
        frames.append(body + struct.pack("<I", zlib.crc32(body)))
        assert len(frames[-1]) == 2 * words + 4
    stream = b"rubbish\xa5" + b"".join(frames)
    batch = decoded(data, stream)
    assert batch.columns["rate_x"].tolist() == [-5, 7, 9]
    assert batch.end_offset.tolist() == [8 + 12, 8 + 12 + 524, 8 + 12 + 524 + 12]
    messages = reader_of(family_from(data, "here")).feed(stream)
    assert [value for message in messages for value in message.columns()["last"].tolist()] == [42, 42, 42]


@pytest.mark.parametrize("kind", ["u16", "u32"])
def test_a_rate_in_some_bits_is_scaled_without_the_others(kind):
    """Ten bits from bit 4 on, 0.5 deg/s a step and 100 deg/s less."""
    rate = {"name": "rate_x", "axis": "x", "at": 7, "type": kind, "bits": [4, 10], "unit": "deg/s",
            "role": "rate", "scale": {"div": 2.0}, "offset": -100.0}  # fmt: skip
    data = changed((("field",), [rate, BINARY["field"][1]]))
    words = [(raw << 4) | 0xC00F for raw in (0, 200, 1023)]
    rows = []
    for count, word in enumerate(words):
        body = b"\xa5\x5a" + bytes(4) + bytes([count])
        body += struct.pack(">HH" if kind == "u16" else ">I", *([word, 0] if kind == "u16" else [word]))
        rows.append(body + bytes([sum(body) % 256]))
    assert decoded(data, b"".join(rows)).columns["rate_x"].tolist() == [-100.0, 0.0, 411.5]


def test_a_line_may_have_one_column():
    data = {**LINE, "line": {"start": "$A,", "columns": 1}, "field": [LINE["field"][0]]}
    (message,) = reader_of(family_from(data, "here")).feed(b"$A,1.5\r\n$A,-2\r\n")
    assert message.columns()["rate_z"].tolist() == [1.5, -2.0]


def test_a_counter_in_some_bits_wraps_where_they_do():
    data = changed((("field", 1, "bits"), [2, 3]))
    decoder = FrameDecoder(family_from(data, "here"), rate_hz=100.0, axes="x")
    assert decoder.counter_modulo == 8 and decoder.counter_step == 1.0
    assert decoder.feed(frame(0, 0b11101, 0, 0)).columns["counter"].tolist() == [7]


def test_without_a_counter_damage_leaves_a_gap_whatever_comes_together():
    data = changed((("counter",), None))
    frames = [frame(number, 0, 0, 0) for number in range(8)]
    stream = b"".join(frames[:3]) + b"\0" * 24 + b"".join(frames[5:])
    whole = decoded(data, stream).columns["counter"].tolist()
    assert whole == [0, 1, 2, 5, 6, 7]
    decoder = FrameDecoder(family_from(data, "here"), rate_hz=100.0, axes="x")
    assert decoder.has_counter is False
    parts = [decoder.feed(stream[at : at + 25]).columns["counter"] for at in range(0, len(stream), 25)]
    assert np.concatenate(parts).tolist() == whole


def test_a_cumulative_angle_becomes_what_was_turned_in_a_sample_over_its_wrap():
    """A 16-bit angle, 0.01 deg a step, counts on over its end; after two lost samples a third of the turn."""
    angle = {"name": "angle_x", "axis": "x", "at": 9, "type": "u16", "unit": "deg", "role": "cumulative_angle",
             "scale": {"div": 100.0}}  # fmt: skip
    data = changed((("field", 3), angle), (("field", 0), {"name": "spare", "at": 2, "type": "i32"}))
    rows = [(10, 65_500), (11, 14), (12, 65_514), (15, 65_364)]
    stream = b"".join(frame(0, count, 0, value) for count, value in rows)
    for size in (12, 24, 48):
        decoder = FrameDecoder(family_from(data, "here"), rate_hz=100.0, axes="x")
        batches = [decoder.feed(stream[at : at + size]) for at in range(0, 48, size)]
        turned = np.concatenate([batch.columns["angle_x"] for batch in batches])
        assert turned.tolist() == pytest.approx([math.nan, 0.5, -0.36, -0.5], nan_ok=True)
        valid = np.concatenate([batch.columns["valid"] for batch in batches])
        assert valid.tolist() == [False, True, True, True]


def test_a_cumulative_angle_in_some_bits_wraps_where_they_do():
    """Ten bits of 0.1 deg from bit 4 on, whatever the other six hold: 1020, 1023 and 2 are 0.3 deg apart."""
    angle = {"name": "angle_x", "axis": "x", "at": 9, "type": "u16", "bits": [4, 10], "unit": "deg",
             "role": "cumulative_angle", "scale": {"div": 10.0}}  # fmt: skip
    data = changed((("field", 3), angle), (("field", 0), {"name": "spare", "at": 2, "type": "i32"}))
    rows = [(10, 1020 << 4 | 0xC00F), (11, 1023 << 4), (12, 2 << 4 | 0x8001), (13, 1021 << 4)]
    stream = b"".join(frame(0, count, 0, value) for count, value in rows)
    turned = decoded(data, stream).columns["angle_x"]
    assert turned.tolist() == pytest.approx([math.nan, 0.3, 0.3, -0.5], nan_ok=True)


@pytest.mark.parametrize("cut", range(1, 12))
def test_a_length_behind_other_bytes_is_waited_for(cut):
    """The fourth byte says the length, eight bytes; the stream stops anywhere for a while."""
    data = {
        "schema": 1, "name": "far", "title": "a length in the fourth byte",
        "frame": {
            "endian": "big", "sync": "A55A", "max_length": 64, "length_field": {"at": 3, "type": "u8"},
            "checksum": {"kind": "sum8", "ranges": [[0, -1]], "at": -1},
        },
        "field": [
            {"name": "rate_x", "axis": "x", "at": 4, "type": "i16", "unit": "deg/s", "role": "rate"},
            {"name": "kind", "at": 2, "type": "u8"},
        ],
    }  # fmt: skip
    frames = []
    for rate in (1, -2):
        body = b"\xa5\x5a\x77\x08" + struct.pack(">hB", rate, 0)
        frames.append(body + bytes([sum(body) % 256]))
    stream = b"".join(frames)
    decoder = FrameDecoder(family_from(data, "here"), rate_hz=100.0, axes="x")
    batches = [decoder.feed(part) for part in (stream[:cut], stream[cut:])]
    assert np.concatenate([batch.columns["rate_x"] for batch in batches]).tolist() == [1, -2]
    assert decoder.counts.bytes_skipped == 0 and decoder.counts.rejected == {}


@pytest.mark.parametrize(
    ("change", "key", "found", "expected"),
    [
        (
            (("frame", "checksum", "knid"), "x"),
            "frame.checksum[0].knid",
            "an unknown key",
            "did you mean 'kind'",
        ),
        ((("frame", "cheksum"), {}), "frame.cheksum", "an unknown key", "did you mean 'checksum'"),
        ((("field", 1, "tipe"), "u8"), "field[1] 'count'.tipe", "an unknown key", "did you mean 'type'"),
        ((("title",), None), "title", "nothing", ""),
        ((("frame", "checksum", "kind"), None), "frame.checksum[0].kind", "nothing", ""),
    ],
)
def test_a_mistake_says_which_key_what_stands_there_and_what_could(change, key, found, expected):
    with pytest.raises(ConfigurationError) as refused:
        family_from(changed(change), "here")
    text = str(refused.value)
    assert key in text and found in text and expected in text


def test_a_counter_that_wraps_at_no_power_of_two():
    angle = {
        "name": "angle_x",
        "axis": "x",
        "at": 9,
        "type": "u16",
        "unit": "deg",
        "role": "cumulative_angle",
    }
    data = changed(
        (("field", 3), angle),
        (("field", 0), {"name": "spare", "at": 2, "type": "i32"}),
        (("counter", "modulo"), 100),
    )
    stream = b"".join(frame(0, count, 0, value) for count, value in ((98, 5), (99, 7), (0, 9), (2, 15)))
    turned = decoded(data, stream).columns["angle_x"]
    assert turned.tolist() == pytest.approx([math.nan, 2.0, 2.0, 3.0], nan_ok=True)


def test_units_are_worth_what_the_brochure_of_the_si_and_nist_sp_811_say():
    """By quantity, in the bench's own unit (BIPM SI brochure, NIST SP 811 appendix B)."""
    turn_deg, foot_m, g_mps2 = 360.0, 0.3048, 9.80665
    known = {
        "deg/s": 1.0, "deg/h": 1 / 3600, "rad/s": turn_deg / (2 * math.pi), "mdeg/s": 0.001,
        "arcsec/s": 1 / 3600, "deg": 1.0, "arcsec": 1 / 3600, "rad": turn_deg / (2 * math.pi),
        "m/s2": 1.0, "g": g_mps2, "mg": g_mps2 / 1000, "ft/s2": foot_m, "m/s": 1.0, "g*s": g_mps2,
        "ft/s": foot_m, "s": 1.0, "ms": 0.001, "us": 1e-6, "Pa": 1.0, "hPa": 100.0, "kPa": 1000.0,
        "uT": 1.0, "gauss": 100.0, "V": 1.0, "A": 1.0, "Hz": 1.0, "%": 0.01, "1": 1.0,
    }  # fmt: skip
    for unit, value in known.items():
        assert UNITS[unit][1:] == (pytest.approx(value, rel=1e-12), 0.0), unit
    water = {"degC": (0.0, 100.0), "K": (273.15, 373.15), "degF": (32.0, 212.0)}
    for unit, (freezes, boils) in water.items():
        _, factor, constant = UNITS[unit]
        assert [freezes * factor + constant, boils * factor + constant] == pytest.approx([0.0, 100.0])
    assert set(UNITS) == set(known) | set(water)


@pytest.mark.parametrize(
    ("text", "path"), [("kvh", False), ("mine.toml", True), ("folder/mine", True), ("a/mine.toml", True)]
)
def test_a_path_has_a_slash_or_the_suffix(text, path):
    assert is_path(text) is path


LINE = {
    "schema": 1, "name": "lines", "title": "lines of a test", "frame": {},
    "line": {"start": "$A,", "columns": 3, "checksum": {"kind": "xor8"}},
    "field": [
        {"name": "rate_z", "axis": "z", "at": 0, "type": "f64", "unit": "deg/s", "role": "rate"},
        {"name": "count", "at": 1, "type": "i32"},
    ],
}  # fmt: skip


def line(body):
    total = 0
    for byte in body.encode():
        total ^= byte
    return f"${body}*{total:02X}"


def test_vectors_of_lines_are_decoded_and_damaged():
    vector = {"text": line("A,1.5,-7,0"), "expect": {"rate_z": 1.5, "count": -7}}
    assert list(vector_mistakes(family_from(LINE | {"vector": [vector]}, "here"))) == []
    wrong = LINE | {"vector": [vector | {"expect": {"rate_z": 1.5, "count": 7}}]}
    assert [mistake.key for mistake in vector_mistakes(family_from(wrong, "here"))] == [
        "vector[0].expect.count"
    ]
    cut = LINE | {"vector": [vector, vector | {"text": vector["text"][:-1] + "?"}]}
    (mistake,) = vector_mistakes(family_from(cut, "here"))
    assert (mistake.key, mistake.found) == ("vector[1].text", "a line refused for its checksum")
    assert mistake.expected == "a line of this description"


def test_a_check_that_leaves_characters_out_is_named_by_the_vectors():
    loose = copy.deepcopy(LINE) | {"vector": [{"text": line("A,1.5,-7,0"), "expect": {"count": -7}}]}
    loose["line"]["checksum"] = {"kind": "xor8", "skip": 6}
    body = "A,1.5,-7,0"
    total = 0
    for byte in body[5:].encode():
        total ^= byte
    loose["vector"][0]["text"] = f"${body}*{total:02X}"
    (mistake,) = vector_mistakes(family_from(loose, "here"))
    assert mistake.key == "vector[0].text" and "changed passes" in mistake.found


def test_numbers_of_a_line_that_are_not_written_like_those_before_are_still_themselves():
    """Numbers with as many decimals are read together; "5." and "12" in between mean 5 and 12."""
    section = {"separators": ",", "columns": 2}
    data = {**LINE, "line": section, "field": [LINE["field"][0], {**LINE["field"][0], "name": "r", "axis": "x",
                                                                  "at": 1}]}  # fmt: skip
    lines = ["1.500,2.250"] * 40 + ["5.,12", "-3.125,+4.000", ".500,-.5", "12345678901234567,1e3"]
    (message,) = reader_of(family_from(data, "here")).feed("".join(f"{text}\r\n" for text in lines).encode())
    columns = message.columns()
    pairs = list(zip(columns["rate_z"].tolist(), columns["r"].tolist(), strict=True))
    assert pairs[:40] == [(1.5, 2.25)] * 40
    assert pairs[40:] == [(5.0, 12.0), (-3.125, 4.0), (0.5, -0.5), (12345678901234567.0, 1000.0)]


def test_the_axis_whose_temperature_is_asked_for_is_the_one_named():
    channels = [
        {"name": f"{what}_{axis}", "axis": axis, "at": at + 2 * n, "type": "i16", "unit": unit, "role": role}
        for what, at, unit, role in (("rate", 2, "deg/s", "rate"), ("heat", 6, "degC", "temp"))
        for n, axis in enumerate("xy")
    ]
    data = {"schema": 1, "name": "two", "title": "two axes", "frame": {"sync": "A55A", "length": 10},
            "field": channels}  # fmt: skip
    stream = (b"\xa5\x5a" + struct.pack(">4h", 1, 2, 30, 40)) * 2
    for options, temp_c in (({}, 30.0), ({"axis": "x"}, 30.0), ({"axis": "y"}, 40.0)):
        columns = decoded(data, stream, axes="xy", **options).columns
        assert columns["temp_c"].tolist() == [temp_c, temp_c], SimpleNamespace(**options)
