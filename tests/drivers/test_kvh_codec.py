"""KVH codec against the published message, an independent struct decoder, and damage of every kind."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.kit.instruments import FrameBatch
from drivers.kvh import KvhDecoder, encode_bit, encode_frames, rate_dps
from drivers.kvh.format import CRC, Format, layout, valid_mask

# KVH 56-0298 Rev B, section 5.2.1, sample output of Format A, and table 5-10, its breakdown.
PUBLISHED = bytes.fromhex(
    "FE81FF55 37A96A6E 38586C1F B75BF862 BF803E78 BB650D28 3B0A37AC 77 3D 0028 4BFA34D8"
)
LENGTHS: dict[Format, int] = {"A": 36, "B": 40, "C": 38}
HEADERS: dict[Format, str] = {"A": "FE81FF55", "B": "FE81FF56", "C": "FE81FF57"}
TAILS: dict[Format, str] = {"A": "BBh", "B": "IBBh", "C": "fBB"}


def crc32(message: bytes) -> int:
    """CRC-32/MPEG-2 by the textbook shift register, independent of the code under test."""
    register = 0xFFFFFFFF
    for byte in message:
        register ^= byte << 24
        for _ in range(8):
            register = ((register << 1) ^ 0x04C11DB7 if register & 0x80000000 else register << 1) & 0xFFFFFFFF
    return register


def message(fmt: Format, counter: int, rot: float, *, temp: float = 25, status: int = 0x77) -> bytes:
    """One message made by struct; timestamp 4,000,000,000 us in Format B."""
    tail: dict[Format, tuple[float, ...]] = {
        "A": (status, counter, int(temp)),
        "B": (4_000_000_000, status, counter, int(temp)),
        "C": (temp, status, counter),
    }
    body = bytes.fromhex(HEADERS[fmt]) + struct.pack(
        ">6f" + TAILS[fmt], rot, 2 * rot, -rot, 0, 0, 1, *tail[fmt]
    )
    return body + struct.pack(">I", crc32(body))


def decode(data: bytes, **keywords: object) -> tuple[FrameBatch, KvhDecoder]:
    decoder = KvhDecoder(nominal_rate_hz=100.0, **{"temp_units": "C", **keywords})  # type: ignore[arg-type]  # kinds vary
    return decoder.feed(data), decoder


def in_chunks(decoder: KvhDecoder, data: bytes, cuts: list[int]) -> tuple[list[int], list[int], list[float]]:
    """Feed in chunks of the sizes given, again and again: counters, end offsets, rotations."""
    counters: list[int] = []
    ends: list[int] = []
    rot: list[float] = []
    at = turn = 0
    while at < len(data):
        size = cuts[turn % len(cuts)]
        batch = decoder.feed(data[at : at + size])
        counters += batch.columns["counter"].tolist()
        ends += batch.end_offset.tolist()
        rot += batch.columns["rot_x"].tolist()
        at, turn = at + size, turn + 1
    return counters, ends, rot


def test_published_message_decodes_to_the_published_values() -> None:
    batch, decoder = decode(PUBLISHED, axes="xyz")
    assert len(batch) == 1
    assert batch.end_offset.tolist() == [36]
    assert batch.columns["rot_x"].tolist() == pytest.approx([2.019593e-5], rel=1e-6)
    assert batch.columns["rot_y"].tolist() == pytest.approx([5.159911e-5], rel=1e-6)
    assert batch.columns["rot_z"].tolist() == pytest.approx([-1.3111248e-5], rel=1e-6)
    assert batch.columns["temp_c"].tolist() == [40.0]
    assert batch.columns["counter"].tolist() == [61]
    assert batch.columns["status"].tolist() == [0x77]
    assert batch.columns["valid"].tolist() == [True]
    assert decoder.counts.frames == 1
    assert decoder.counts.bytes_skipped == 0
    assert not decoder.counts.rejected


def test_published_message_is_what_the_encoder_sends() -> None:
    words = struct.unpack(">6f", PUBLISHED[4:28])
    sent = encode_frames(
        "A", np.array([words[:3]]), acc_g=[words[3:]], counter=61, temp_c=40.0, temp_units="C"
    )
    assert sent == PUBLISHED


def test_whole_published_message_has_no_crc_residue() -> None:
    assert CRC.of(PUBLISHED) == 0
    assert crc32(PUBLISHED) == 0


def test_every_single_bit_flip_of_the_published_message_is_rejected() -> None:
    for bit in range(8 * len(PUBLISHED)):
        flipped = bytearray(PUBLISHED)
        flipped[bit // 8] ^= 1 << bit % 8
        batch, decoder = decode(bytes(flipped))
        assert len(batch) == 0, f"bit {bit}"
        assert decoder.counts.rejected.get("checksum", 0) == (bit >= 32)


@pytest.mark.parametrize("fmt", ["A", "B", "C"])
def test_columns_and_types_of_each_format(fmt: Format) -> None:
    assert layout(fmt).length == LENGTHS[fmt]
    data = b"".join(message(fmt, counter, 1e-5 * counter, temp=-12) for counter in range(9))
    batch, _ = decode(data, frame_format=fmt, axes="xz")
    columns = batch.columns
    assert batch.end_offset.tolist() == [LENGTHS[fmt] * (n + 1) for n in range(9)]
    assert columns["counter"].dtype == np.int64
    assert columns["counter"].tolist() == list(range(9))
    assert columns["rot_x"].dtype == np.float32
    np.testing.assert_array_equal(columns["rot_x"], np.array(1e-5 * np.arange(9), np.float32))
    np.testing.assert_array_equal(columns["rot_z"], -np.array(1e-5 * np.arange(9), np.float32))
    assert "rot_y" not in columns
    assert columns["temp_c"].dtype == np.float32
    expected = [-12.0 if fmt != "C" or n % 4 == 0 else np.nan for n in range(9)]
    np.testing.assert_array_equal(columns["temp_c"], np.array(expected, np.float32))
    assert ("timestamp_us" in columns) == (fmt == "B")
    if fmt == "B":
        assert columns["timestamp_us"].tolist() == [4_000_000_000] * 9


@pytest.mark.parametrize(
    ("units", "sent", "temp_c"),
    [("C", 71, 71.0), ("C_100", -1234, -12.34), ("F", 212, 100.0), ("F_100", 5000, 10.0)],
)
def test_temperature_units(units: str, sent: int, temp_c: float) -> None:
    batch, _ = decode(message("A", 0, 0.0, temp=sent), temp_units=units)
    assert batch.columns["temp_c"][0] == pytest.approx(temp_c, abs=1e-5)


def test_valid_looks_at_the_unit_s_own_gyros_only() -> None:
    data = b"".join(
        message("A", n, 0.0, status=status) for n, status in enumerate([0x77, 0x01, 0x76, 0x05, 0x00])
    )
    assert decode(data, axes="x")[0].columns["valid"].tolist() == [True, True, False, True, False]
    assert decode(data, axes="xz")[0].columns["valid"].tolist() == [True, False, False, True, False]
    assert valid_mask("xyz") == 0x07


def test_reserved_bytes_have_no_meaning() -> None:
    """A single-axis unit sends anything in place of y and z; signalling NaN and infinities included."""
    body = PUBLISHED[:8] + bytes.fromhex("7FA00001 FF800000") + PUBLISHED[16:32]
    batch, _ = decode(body + struct.pack(">I", crc32(body)), axes="x")
    assert batch.columns["rot_x"].tolist() == pytest.approx([2.019593e-5], rel=1e-6)
    assert set(batch.columns) == {"counter", "status", "valid", "rot_x", "temp_c"}


def test_signalling_nan_as_temperature_does_not_raise() -> None:
    body = message("C", 0, 1.0)[:28] + bytes.fromhex("7FA00001 77 00")
    batch, _ = decode(body + struct.pack(">I", crc32(body)), frame_format="C", temp_units="F_100")
    assert np.isnan(batch.columns["temp_c"]).tolist() == [True]


def test_rate_from_delta_angle_takes_the_sample_rate_and_from_rate_does_not() -> None:
    rot = np.array([0.0, np.pi / 180.0], np.float32)
    np.testing.assert_allclose(rate_dps(rot, "delta", "RAD", 962.4), [0.0, 962.4], rtol=1e-7)
    np.testing.assert_allclose(rate_dps(rot, "rate", "RAD", 962.4), [0.0, 1.0], rtol=1e-7)
    np.testing.assert_allclose(
        rate_dps(np.array([0.25], np.float32), "delta", "DEG", 100.0), [25.0], rtol=1e-12
    )
    assert rate_dps(rot, "delta", "RAD", 100.0).dtype == np.float64


@pytest.mark.parametrize("fmt", ["A", "B", "C"])
def test_encoder_writes_what_struct_writes(fmt: Format) -> None:
    rot = np.array([[1e-5 * n, 2e-5 * n, -1e-5 * n] for n in range(200)])
    sent = encode_frames(
        fmt,
        rot,
        acc_g=[0.0, 0.0, 1.0],
        counter=np.arange(200),
        temp_c=25.0,
        temp_units="C",
        timestamp_us=4_000_000_000,
    )
    expected = [
        message(fmt, n % 128, 1e-5 * n, temp=25 if fmt != "C" or n % 4 == 0 else 0) for n in range(200)
    ]
    assert sent == b"".join(expected)


def test_encoder_rounds_and_saturates_the_integer_temperature() -> None:
    sent = encode_frames("A", np.zeros((4, 3)), counter=0, temp_c=[20.006, -20.006, 400.0, -400.0])
    raw = [struct.unpack(">h", sent[36 * n + 30 : 36 * n + 32])[0] for n in range(4)]
    assert raw == [2001, -2001, 32767, -32768]


def test_built_in_test_message() -> None:
    """KVH 54-0938, "Extended BIT": FE 81 00 AA 7F 7F 7F 7F 7F 7F 23 when all is well."""
    assert encode_bit(b"\x7f" * 6) == bytes.fromhex("FE8100AA 7F7F7F7F7F7F 23")
    extended = encode_bit(b"\x7f" * 8)
    assert extended[:4] == bytes.fromhex("FE8100AB")
    assert extended[-1] == sum(extended[:-1]) % 256
    batch, decoder = decode(PUBLISHED + extended + PUBLISHED)
    assert batch.end_offset.tolist() == [36, 36 + 13 + 36]
    assert decoder.counts.bytes_skipped == 13


def test_sync_word_inside_the_payload_does_not_start_a_message() -> None:
    """0xFE81FF55 as a float is about -8.6e37: put it in every word, aligned and not."""
    body = bytes.fromhex("FE81FF55" * 4) + b"\x00" + bytes.fromhex("FE81FF55" * 3 + "FE81FF")
    frame = body + struct.pack(">I", crc32(body))
    assert len(frame) == 36
    batch, decoder = decode(frame * 5 + frame[:20] + frame)
    assert batch.end_offset.tolist() == [36, 72, 108, 144, 180, 236]
    assert decoder.counts.bytes_skipped == 20


def test_lost_last_byte_is_completed_by_the_next_header() -> None:
    """A message whose last byte is FE may share it with the header that follows."""
    frame = next(
        made for made in (message("A", n % 128, 1e-6 * n) for n in range(5000)) if made.endswith(b"\xfe")
    )
    batch, decoder = decode(frame[:-1] + PUBLISHED)
    assert batch.end_offset.tolist() == [36, 71]
    assert decoder.counts.bytes_skipped == 0
    one_by_one = KvhDecoder(nominal_rate_hz=100.0)
    assert in_chunks(one_by_one, frame + frame[:-1] + PUBLISHED, [1])[1] == [36, 72, 107]
    assert one_by_one.counts.bytes_skipped == 0


def test_later_call_goes_on_in_the_stream() -> None:
    decoder = KvhDecoder(nominal_rate_hz=100.0)
    assert decoder.feed(b"12345" + PUBLISHED[:30]).end_offset.tolist() == []
    assert decoder.feed(PUBLISHED[30:] + PUBLISHED).end_offset.tolist() == [41, 77]
    assert decoder.feed(b"").end_offset.tolist() == []
    assert decoder.feed(PUBLISHED * 1000).end_offset.tolist() == list(range(113, 113 + 36000, 36))
    assert decoder.counts.frames == 1002
    assert decoder.counts.bytes_skipped == 5


STREAM: dict[Format, list[bytes]] = {
    fmt: [message(fmt, n % 128, 1e-5 * n) for n in range(40)] for fmt in ("A", "B", "C")
}
cuts = st.lists(st.integers(1, 150), min_size=1, max_size=6)


@given(fmt=st.sampled_from(["A", "B", "C"]), cuts=cuts)
@settings(max_examples=50, deadline=None)
def test_any_chunks_give_the_same_messages(fmt: Format, cuts: list[int]) -> None:
    decoder = KvhDecoder(nominal_rate_hz=100.0, frame_format=fmt)
    counters, ends, _ = in_chunks(decoder, b"".join(STREAM[fmt]), cuts)
    assert counters == list(range(40))
    assert ends == [LENGTHS[fmt] * (n + 1) for n in range(40)]
    assert (decoder.counts.bytes_skipped, decoder.counts.rejected) == (0, {})


junk = st.one_of(
    st.binary(max_size=60),
    st.integers(0, 36).map(lambda size: STREAM["A"][0][:size]),  # Cut short.
    st.integers(1, 35).map(lambda size: STREAM["A"][1][size:]),  # Begun late.
    st.sampled_from([b"\xfe", b"\xfe\x81\xff", b"\xfe\x81\xff\x55" * 3, STREAM["B"][0], b"CONFIG,1\r\n"]),
)


@given(garbage=st.lists(junk, min_size=8, max_size=8), cuts=cuts)
@settings(max_examples=150, deadline=None)
def test_every_intact_message_between_garbage_is_found_and_nothing_else(
    garbage: list[bytes], cuts: list[int]
) -> None:
    data, ends = garbage[0], []
    for frame, rubbish in zip(STREAM["A"][2:9], garbage[1:], strict=True):
        data += frame
        ends.append(len(data))
        data += rubbish
    decoder = KvhDecoder(nominal_rate_hz=100.0)
    counters, found, _ = in_chunks(decoder, data, cuts)
    truncated_head = [end for end in found if end not in ends]
    assert set(ends) <= set(found)
    # A whole message among the rubbish is genuine too; nothing else may appear.
    assert all(data[end - 36 : end] in STREAM["A"][:2] for end in truncated_head)
    assert decoder.counts.frames == len(found)
    assert [data[end - 36 : end][29] for end in found] == counters
    once, at_once = decode(data)
    assert once.end_offset.tolist() == found
    assert at_once.counts == decoder.counts


def damaged(probability: float, seed: int) -> tuple[bytes, set[int]]:
    """A stream with bytes changed and bytes lost, half and half; also which messages stayed intact."""
    rng = np.random.default_rng(seed)
    count = 4000
    rot = np.arange(count)[:, None] * np.ones(3)
    clean = np.frombuffer(encode_frames("A", rot, counter=np.arange(count), temp_c=20.0), np.uint8)
    changed = rng.random(clean.size) < probability / 2
    lost = rng.random(clean.size) < probability / 2
    broken = clean ^ np.where(changed, rng.integers(1, 256, clean.size), 0).astype(np.uint8)
    intact = ~(changed | lost).reshape(count, 36).any(axis=1)
    return broken[~lost].tobytes(), set(np.flatnonzero(intact).tolist())


@pytest.mark.parametrize("probability", [1e-4, 1e-3, 1e-2, 5e-2])
def test_damaged_stream_gives_every_intact_message_and_only_genuine_ones(probability: float) -> None:
    """A genuine message is one that was sent: its rotation is its number, and its counter that number's."""
    data, intact = damaged(probability, seed=round(1e5 * probability))
    batch, decoder = decode(data)
    number = batch.columns["rot_x"].astype(np.int64)
    assert intact <= set(number.tolist())
    assert (np.diff(number) > 0).all()
    np.testing.assert_array_equal(batch.columns["rot_x"], number)
    np.testing.assert_array_equal(batch.columns["counter"], number % 128)
    assert len(batch) - len(intact) <= 3  # Damage that undid itself, a shared last byte for one.
    assert decoder.counts.frames == len(batch)
    covered = np.zeros(len(data) + 1, bool)
    for end in batch.end_offset.tolist():
        covered[end - 36 : end] = True
    undecided = decoder._splitter._splitter.pending
    assert decoder.counts.bytes_skipped == np.count_nonzero(~covered[: len(data) - undecided])


@given(data=st.binary(max_size=400), fmt=st.sampled_from(["A", "B", "C"]), cuts=cuts)
@settings(max_examples=100, deadline=None)
def test_no_bytes_raise(data: bytes, fmt: Format, cuts: list[int]) -> None:
    decoder = KvhDecoder(nominal_rate_hz=1.0, frame_format=fmt)
    counters, ends, _ = in_chunks(decoder, data.replace(b"\x00", bytes.fromhex(HEADERS[fmt])), cuts)
    assert len(counters) == len(ends) == decoder.counts.frames
    assert decoder._splitter._splitter.pending < LENGTHS[fmt]
