"""Decoders and encoders against bytes packed by hand: frames, CAN samples, slcan lines, messages of a KVH."""

from __future__ import annotations

import copy
import math
import struct
import zlib
from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.base.errors import ConfigurationError, DeviceSilent, WrongDevice
from drivers.can_dbc import CanConfig, CanDecoder, _kind, can_kind, layout_from_mapping
from drivers.can_dbc._dbc import _compile_into
from drivers.can_dbc._layout import ValidRule
from drivers.can_dbc._values import merged
from drivers.frames import FrameDecoder, Frames, reader_of, vector_mistakes
from drivers.frames._checks import crcs_hold
from drivers.frames._form import forms_of
from drivers.frames._kind import FrameGyro
from drivers.frames._load import _shown, family_from
from drivers.frames._model import Checksum, FieldSection
from drivers.frames._read import FieldCodec
from drivers.frames._settings import choices_of
from drivers.kit.slcan_codec import SlcanParser
from drivers.kvh import encode_frames
from tests.drivers.test_can_dbc_decoder import PAGED, TEST_DBC, line, sample
from tests.drivers.test_kvh_driver import connected
from tests.memory_link import Fake, OpenConnection

FRAME = {
    "schema": 1,
    "name": "unit",
    "title": "a unit of a test",
    "frame": {"endian": "big", "sync": "A55A", "length": 12},
    "field": [
        {"name": "rate_x", "axis": "x", "at": 2, "type": "i32", "unit": "deg/s", "role": "rate"},
        {"name": "count", "at": 6, "type": "u16"},
    ],
    "counter": {"field": "count"},
}


def described(*fields, **keys):
    data = copy.deepcopy(FRAME) | keys
    data["field"] += fields
    return family_from(data, "unit")


def rates(family, *frames):
    return FrameDecoder(family, rate_hz=100.0, axes="x").feed(b"".join(frames)).columns


@pytest.mark.parametrize("order", ["big", "little"])
@pytest.mark.parametrize("at", [2, 5, 9])
@pytest.mark.parametrize("kind", ["i24", "u24"])
@pytest.mark.parametrize("beside", [b"\x00", b"\xff", b"\x80"])
def test_three_bytes_are_a_number_whatever_stands_beside_them(order, at, kind, beside):
    """Scaled as it comes and read by itself, at the frame's head, in its middle and at its end."""
    field = {"name": "rate_x", "axis": "x", "at": at, "type": kind, "unit": "deg/s", "role": "rate",
             "scale": {"div": 8.0}}  # fmt: skip
    data = FRAME | {"field": [field], "frame": FRAME["frame"] | {"endian": order}}
    del data["counter"]
    numbers = [1, 8388607, 66051, *([-1, -8388608, -66051] if kind == "i24" else [8388608, 16777215])]
    frames = []
    for number in numbers:
        stored = number.to_bytes(3, order, signed=kind == "i24")
        frames.append(b"\xa5\x5a" + beside * (at - 2) + stored + beside * (9 - at))
    family = family_from(data, "unit")
    assert rates(family, *frames)["rate_x"].tolist() == [number / 8.0 for number in numbers]
    (message,) = reader_of(family).feed(b"".join(frames))
    assert message.columns()["rate_x"].tolist() == [number / 8.0 for number in numbers]


@pytest.mark.parametrize("order", ["big", "little"])
@pytest.mark.parametrize(("head", "at", "size"), [("A5", 1, 4), ("A5", 1, 5), ("A55A", 2, 5), ("A55A", 2, 6)])
def test_three_bytes_are_a_number_in_the_shortest_frames(order, head, at, size):
    field = {"name": "rate_x", "axis": "x", "at": at, "type": "i24", "unit": "deg/s", "role": "rate"}
    frame = {"endian": order, "sync": head, "length": size}
    for scale in ({}, {"scale": {"div": 8.0}}):
        data = FRAME | {"field": [field | scale], "frame": frame}
        del data["counter"]
        sent = bytes.fromhex(head) + (-66051).to_bytes(3, order, signed=True) + b"\x80" * (size - at - 3)
        found = rates(family_from(data, "unit"), sent)["rate_x"].tolist()
        assert found == [-66051 / (8.0 if scale else 1.0)]


def test_a_whole_number_that_is_not_scaled_stays_one_and_a_rate_that_is_none_is_invalid():
    whole = rates(described(), b"\xa5\x5a" + struct.pack(">iH4x", -7, 1))
    assert whole["rate_x"].tolist() == [-7] and whole["rate_x"].dtype.kind == "i"
    field = {"name": "rate_x", "axis": "x", "at": 2, "type": "f32", "unit": "deg/s", "role": "rate"}
    data = FRAME | {"field": [field, FRAME["field"][1]]}
    frames = [
        b"\xa5\x5a" + struct.pack(">fH4x", rate, k) for k, rate in enumerate((1.5, math.nan, math.inf, -2.0))
    ]
    found = rates(family_from(data, "unit"), *frames)
    assert found["valid"].tolist() == [True, False, False, True]


def test_a_clock_that_is_no_number_counts_nothing():
    clock = {"name": "clock", "at": 8, "type": "f32", "unit": "s"}
    family = described(clock, counter={"field": "clock", "ticks_per_s": 0.5, "modulo": 1000})
    frames = [
        b"\xa5\x5a" + struct.pack(">iHf", 1, 0, seconds) for seconds in (8.0, math.inf, -math.inf, math.nan)
    ]
    assert rates(family, *frames)["counter"].tolist() == [4, 0, 0, 0]


@pytest.mark.parametrize(
    ("keys", "value"),
    [
        ({"counter": {"field": "count", "ticks_per_s": 0}}, "ticks_per_s"),
        ({"status": [{"field": "count", "bit": -1, "name": "bad"}]}, "bit"),
        ({"status": [{"field": "count", "bit": 64, "name": "bad"}]}, "bit"),
    ],
)
def test_what_counts_nothing_and_a_bit_that_no_number_has_are_refused(keys, value):
    with pytest.raises(ConfigurationError) as refused:
        described(**keys)
    assert value in str(refused.value)
    described(
        status=[{"field": "count", "bit": 0, "name": "bad"}, {"field": "count", "bit": 15, "name": "worse"}]
    )
    described(counter={"field": "count", "ticks_per_s": 1.0})


def test_a_mistake_is_told_with_what_the_key_is_for():
    with pytest.raises(ConfigurationError) as refused:
        described(counter={"field": "count", "step": 0})
    assert "how much it rises a frame" in str(refused.value)
    with pytest.raises(ConfigurationError) as refused:
        described({"name": "more", "at": 8, "type": "u8", "sentinel": ["0"] * 65})
    assert "raw values that mean 'not available'" in str(refused.value) and "a list of 65" in str(
        refused.value
    )
    described({"name": "more", "at": 8, "type": "u8", "sentinel": ["0"] * 64})


def test_what_was_found_is_shown_up_to_200_characters_and_16_entries():
    assert _shown("x" * 198) == repr("x" * 198) and _shown("x" * 199) == "'" + "x" * 199 + " ..."
    assert _shown([1] * 16) == repr([1] * 16) and _shown((1,) * 17) == "a list of 17"


def test_a_description_cannot_be_changed_behind_the_back_of_others():
    family = described()
    with pytest.raises(ValidationError):
        family.description.frame.length = 11


@pytest.mark.parametrize(
    "change",
    [{"offset": 1.0}, {"transform": {"kind": "polynomial", "coefficients": [0, 1]}}, {"type": "text:4"}],
)
def test_an_angle_that_goes_on_is_a_number_as_sent(change):
    field = {"name": "angle", "axis": "y", "at": 8, "type": "u32", "unit": "deg", "role": "cumulative_angle"}
    described(field)
    with pytest.raises(ConfigurationError) as refused:
        described(field | change)
    assert "a number, without offset or transform" in str(refused.value)


def test_a_frame_whose_length_stands_behind_its_head_has_at_least_that():
    """Head and length are four bytes, the rate counted from the end another four."""
    data = copy.deepcopy(FRAME)
    data["frame"] = {
        "endian": "big",
        "sync": "A55A",
        "length_field": {"at": 3, "type": "u8"},
        "max_length": 20,
    }
    data["field"] = [data["field"][0] | {"at": -4}]
    del data["counter"]
    family = family_from(data, "unit")
    (form,) = forms_of(family.description)
    assert form.shortest == 8
    frames = [
        b"\xa5\x5a\x00" + bytes([8 + more]) + bytes(more) + struct.pack(">i", 5 + more) for more in range(4)
    ]
    found = [
        value for message in reader_of(family).feed(b"".join(frames)) for value in message.columns()["rate_x"]
    ]
    assert sorted(found) == [5, 6, 7, 8]


@pytest.mark.parametrize("pad_to", [1, 4, 8])
def test_a_crc_of_frames_of_any_lengths_counts_zeros_up_to_whole_words(pad_to):
    """Ethernet's CRC-32, by zlib."""
    spec = Checksum(kind="crc32", ranges=[(0, -4)], at=-4, poly="04C11DB7", init="FFFFFFFF", reflected=True,
                    xorout="FFFFFFFF", pad_to=pad_to)  # fmt: skip
    frames = []
    for size in range(1, 20):
        body = bytes(range(size))
        frames.append(body + zlib.crc32(body + bytes(-size % pad_to)).to_bytes(4, "little"))
    assert crcs_hold(spec, "little", frames).all()
    damaged = [bytes([frame[0] ^ 1]) + frame[1:] for frame in frames]
    assert not crcs_hold(spec, "little", damaged).any()


def codec(kind, **keys):
    return FieldCodec(FieldSection(name="f", at=0, type=kind, **keys), 8, "big")


@pytest.mark.parametrize(
    ("kind", "keys", "numbers", "stored"),
    [
        ("i16", {}, [40000, -40000, 7], [32767, -32768, 7]),
        ("i24", {}, [10**8, -(10**8)], [8388607, -8388608]),
        ("u8", {}, [300, -1], [255, 0]),
        ("u8", {"bits": [2, 3]}, [9, -1, 5], [7, 0, 5]),
        ("u64", {}, [-5, 7], [0, 7]),
        ("u64", {}, np.array([2**64 - 1, 2**63 + 5], np.uint64), [2**64 - 1, 2**63 + 5]),
        ("i32", {}, [3e9, -3e9, math.nan], [2**31 - 1, -(2**31), 0]),
    ],
)
def test_numbers_that_a_field_cannot_hold_are_its_nearest(kind, keys, numbers, stored):
    rows = np.zeros((len(stored), 8), np.uint8)
    one = codec(kind, **keys)
    one.write(rows, np.asarray(numbers))
    assert one.raw(rows).tolist() == stored


@pytest.mark.parametrize("kind", ["i8", "u8", "i16"])
def test_the_inverse_of_a_transform_gives_every_number_back(kind):
    one = codec(kind, transform={"kind": "polynomial", "coefficients": [3.0, -2.0]})
    low, high = one.limits()
    numbers = np.arange(low, high + 1)
    assert one.unphysical(3.0 - 2.0 * numbers).tolist() == numbers.tolist()
    assert one.unphysical(np.array([3.0 - 2.0 * 5.4, 3.0 - 2.0 * 5.6])).tolist() == [5, 6]


def test_every_choice_is_tried_once():
    words = "".join(["a", "b"])  # equal, and not the same object
    settings = {"s": SimpleNamespace(choice={"ab": None, "c": None}, default=words)}
    assert list(choices_of(SimpleNamespace(setting=settings))) == [{}, {"s": "c"}]


@pytest.mark.parametrize("skip", [3, 4, 8])
def test_the_first_character_that_a_check_leaves_out_is_named(skip):
    """The start is read for itself; behind it, characters up to the `skip`ped ones may be any."""
    body = "$A12345678,1.5"
    total = 0
    for byte in body[skip:].encode():
        total ^= byte
    data = {
        "schema": 1, "name": "lines", "title": "lines of a test", "frame": {},
        "line": {"start": "$A", "columns": 2, "checksum": {"kind": "xor8", "skip": skip}},
        "field": [{"name": "rate_z", "axis": "z", "at": 1, "type": "f64", "unit": "deg/s", "role": "rate"}],
        "vector": [{"text": f"{body}*{total:02X}", "expect": {"rate_z": 1.5}}],
    }  # fmt: skip
    (mistake,) = vector_mistakes(family_from(data, "here"))
    assert mistake.found == "a line with character 2 changed passes"
    data["line"]["checksum"]["skip"] = 9
    with pytest.raises(ConfigurationError, match="skip"):
        family_from(data, "here")


@pytest.fixture
def paged(tmp_path):
    (tmp_path / "unit.dbc").write_text(TEST_DBC, encoding="utf-8")
    mapping = PAGED | {"valid": []}
    return lambda: CanDecoder(layout_from_mapping(mapping, tmp_path, "map.toml", "paged"), 100.0, "xy", None)


@pytest.mark.parametrize("at", [0, 1, 2, 3, 4])
@pytest.mark.parametrize("chunks", [False, True])
def test_what_has_come_between_two_messages_parts_them(paged, at, chunks):
    """Two samples of two messages; a damaged line between those of one may be a message of another sample."""
    lines = [part + b"\r" for part in (sample(1, 0.5, 100) + sample(2, 0.25, 200)).split(b"\r")[:-1]]
    assert len(lines) == 4
    lines.insert(at, b"t0108zz\r")
    decoder = paged()
    parts = lines if chunks else [b"".join(lines)]
    counts = [count for part in parts for count in decoder.feed(part).columns["counter"].tolist()]
    assert counts == {1: [2], 3: [1]}.get(at, [1, 2])


@pytest.mark.parametrize("cut", range(1, 5))
def test_messages_that_are_not_the_head_of_a_sample_are_let_go_once(tmp_path, cut):
    """Of three messages the second is lost: the third is alone, wherever the bytes were cut."""
    more = ' SG_ Z m2 : 23|24@0- (0.001,0) [0|0] "deg/h" A\nBO_ 17'
    (tmp_path / "unit.dbc").write_text(TEST_DBC.replace("BO_ 17", more, 1), encoding="utf-8")
    mapping = PAGED | {
        "sample": ["PAGED[0]", "PAGED[1]", "PAGED[2]"],
        "signal": [*PAGED["signal"][:3], {"role": "rate", "axis": "z", "message": "PAGED", "signal": "Z"}],
        "valid": [],
    }
    decoder = CanDecoder(layout_from_mapping(mapping, tmp_path, "map.toml", "paged"), 100.0, "xyz", None)
    first, second = (part + b"\r" for part in sample(3, 0.5, 100).split(b"\r")[:-1])
    third = line(16, b"\2\0" + (700).to_bytes(3, "big") + b"\0\0\0")
    lines = [first, third, first, second, third]
    counts = []
    for part in (b"".join(lines[:cut]), b"".join(lines[cut:])):
        counts += decoder.feed(part).columns["counter"].tolist()
    assert counts == [3] and decoder.counts.rejected == {"unpaired": 1}


@pytest.mark.parametrize("order", [1, -1])
@pytest.mark.parametrize(
    ("values", "together"),
    [
        (((1, 1), (1, 0)), 2),
        (((1, 1), (2, 2)), 1),
        (((3, 1), (2, 0)), 1),
        (((3, 1), (2, 2)), 2),
        (((1, 0), (1, 0)), 1),
    ],
)
def test_rules_about_one_signal_are_one_unless_they_contradict_each_other(order, values, together):
    """A mask and what stands under it, twice."""
    rules = [ValidRule(message="M", signal="S", mask=mask, equals=equals) for mask, equals in values][::order]
    found = merged(rules)
    assert len(found) == together
    if together == 1:
        ((_, mask, equals),) = found
        assert mask == values[0][0] | values[1][0] and equals == values[0][1] | values[1][1]
    other = ValidRule(message="M", signal="T", mask=1, equals=1)
    assert len(merged([*rules, other])) == together + 1


@pytest.mark.parametrize(
    ("scale", "offset"), [(math.inf, 0.0), (1.0, math.nan), (math.nan, math.inf), (-math.inf, 1.0)]
)
def test_a_signal_without_a_finite_scale_and_offset_is_refused(scale, offset):
    signal = SimpleNamespace(
        name="X", scale=scale, offset=offset, multiplexer_ids=None, byte_order="little_endian", start=0, length=8,
        is_signed=False, is_float=False, unit="deg/s",
    )  # fmt: skip
    with pytest.raises(ConfigurationError):
        _compile_into({}, signal, {"X": signal})


@pytest.mark.parametrize(
    ("text", "reason"),
    [(b"t123\r", "length"), (b"t12\r", "length"), (b"T12345678\r", "length"), (b"t1239\r", "dlc"),
     (b"t8000\r", "identifier"), (b"F01\r", None), (b"F0\r", "unknown"), (b"F011\r", "unknown")],
)  # fmt: skip
def test_why_a_line_is_no_frame(text, reason):
    parser = SlcanParser()
    assert not len(parser.feed(text))
    expected = {} if reason is None else {reason: 1}
    assert parser.counts.rejected == expected


def test_a_sent_time_goes_round_after_32_bits():
    times = [0, 1, 2**32 - 1, 2**32 + 3]
    data = encode_frames("B", np.zeros((4, 3)), counter=np.arange(4), temp_c=20.0, timestamp_us=times)
    size = len(data) // 4
    rows = [data[k * size : (k + 1) * size] for k in range(4)]
    (at,) = {
        k
        for k in range(size - 3)
        if [struct.unpack_from(">I", row, k)[0] for row in rows] == [0, 1, 2**32 - 1, 3]
    }
    assert at > 0


def test_a_device_that_answers_otherwise_is_told_with_what_was_asked():
    gyro, _ = connected(device=Fake(lambda line: b"HELLO\r\n"))
    with pytest.raises(WrongDevice) as met:
        gyro.identify()
    assert met.value.expected == "CONFIG,1" and "HELLO" in met.value.found


def hearing(*heard):
    """A link on which these bytes come, one after the other, a second each, and nothing after them."""
    left, seconds = list(heard), iter(range(1000))
    clock = SimpleNamespace(now=lambda: float(next(seconds)))
    read = lambda _: left.pop(0) if left else b""  # noqa: E731
    return SimpleNamespace(name="g", where="port p", set_alike="; or its like", clock=clock, read_some=read)


def test_a_port_on_which_something_else_sends_is_told_with_what_to_check():
    keys = {"name": "g", "driver": "frames", "unit": "1", "axis": "x", "rate_hz": 100.0, "port": "/dev/p",
            "baudrate": 115200, "description": FRAME}  # fmt: skip
    gyro = FrameGyro(Frames.config(**keys), OpenConnection(hearing(b"HELLO" * 20)))
    with pytest.raises(WrongDevice) as met:
        gyro.identify()
    assert met.value.remedy == "check port, description and frame_format in the bench file; or its like"
    assert met.value.found.startswith(b"HELLO".hex(" ")) and "a5 5a" in met.value.expected
    right = b"".join(b"\xa5\x5a" + struct.pack(">iH4x", 5, k) for k in range(3))
    assert FrameGyro(Frames.config(**keys), OpenConnection(hearing(right))).identify().model == FRAME["title"]
    silent = FrameGyro(Frames.config(**keys), OpenConnection(hearing()))
    with pytest.raises(DeviceSilent) as met:
        silent.identify()
    assert met.value.found == "nothing"


def test_a_bus_is_opened_as_the_bench_file_has_it(monkeypatch, tmp_path):
    (tmp_path / "unit.dbc").write_text(TEST_DBC, encoding="utf-8")
    layout = layout_from_mapping(PAGED, tmp_path, "map.toml", "paged")
    asked = []

    def opened(interface, channel, bitrate, clock, name, tap):
        asked.append((interface, channel, bitrate, name))
        return "bus", hearing()

    monkeypatch.setattr(_kind, "open_can", opened)
    config = CanConfig(
        name="g", driver="any", unit="1", axis="x", interface="socketcan", channel="can0", rate_hz=100.0
    )
    connection = SimpleNamespace(clock=None, name="g", tap=None)
    gyro = can_kind(CanConfig, lambda _: layout).open(config, connection)
    assert asked == [("socketcan", "can0", config.bitrate, "g")] and gyro.bus == "bus"
    with pytest.raises(DeviceSilent):
        gyro.identify()
