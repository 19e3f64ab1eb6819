"""The descriptions that come with gyrobench: vectors, a real capture, fuzz, and encoder against decoder."""

from __future__ import annotations

import binascii
import math
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.frames import (
    GYRO_ROLES,
    FrameDecoder,
    FrameEncoder,
    MessageReader,
    load_family,
    shipped,
    vector_mistakes,
)
from simulators.emulators.frames import FrameEmulator
from tests.memory_link import TurningPlant

CAPTURE = Path(__file__).parents[3] / ".." / "shared" / "data" / "serial_openimu" / "z1.raw"
EXPECTED = {
    "aceinna_dmu", "astrix_ns", "fg333", "hg4930", "hipnuc", "kvh", "openimu", "rlg2t", "stim210", "stim300",
    "vectornav",
}  # fmt: skip


def test_all_are_there() -> None:
    assert set(shipped()) >= EXPECTED


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_vectors_decode_and_every_flipped_bit_is_noticed(name: str) -> None:
    assert [str(mistake) for mistake in vector_mistakes(load_family(name))] == []


def test_the_openimu_capture_whole() -> None:
    if not CAPTURE.exists():
        pytest.skip("no ../shared/data: the real OpenIMU capture is not here")
    data = CAPTURE.read_bytes()
    decoder = FrameDecoder(load_family("openimu"), rate_hz=100.0, axes="xyz")
    batches = [decoder.feed(data[at : at + 1009]) for at in range(0, len(data), 1009)]
    assert decoder.counts.frames == 2127 and decoder.counts.bytes_skipped == 0 and not decoder.counts.rejected
    rates = np.concatenate([np.column_stack([b.columns[f"rate_{axis}"] for axis in "xyz"]) for b in batches])
    by_hand = [struct.unpack_from("<3f", data, 47 * n + 21) for n in range(2127)]
    np.testing.assert_array_equal(rates, np.array(by_hand, np.float32))
    # Without its first bytes and with one lost in the middle: all the others, and no more.
    decoder = FrameDecoder(load_family("openimu"), rate_hz=100.0, axes="xyz")
    damaged = data[20:50_000] + data[50_001:]
    batch = decoder.feed(damaged)
    assert len(batch) == 2125
    assert decoder.counts.rejected == {"checksum": 1}


def crc32_mpeg(data: bytes) -> int:
    """CRC-32/MPEG-2 by zlib's reflected one on mirrored bytes: another implementation than ours."""
    mirrored = bytes(int(f"{byte:08b}"[::-1], 2) for byte in data)
    return int(f"{zlib.crc32(mirrored) ^ 0xFFFFFFFF:032b}"[::-1], 2)


@given(
    st.lists(
        st.tuples(st.integers(-(2**23), 2**23 - 1), st.integers(-(2**23), 2**23 - 1)), min_size=1, max_size=9
    )
)
@settings(max_examples=40, deadline=None)
def test_stim300_against_frames_packed_by_hand(values: list[tuple[int, int]]) -> None:
    stream = b""
    for number, (rate, acc) in enumerate(values):
        body = b"\x91" + b"".join(v.to_bytes(3, "big", signed=True) for v in (rate, 0, -1)) + b"\0"
        body += b"".join(v.to_bytes(3, "big", signed=True) for v in (acc, 1, 2)) + b"\0"
        body += bytes([16 * number % 256]) + b"\x01\xf4"
        assert len(body) == 24  # a multiple of 4: nothing is padded
        stream += body + crc32_mpeg(body).to_bytes(4, "big")
    batch = FrameDecoder(load_family("stim300"), rate_hz=125.0, axes="xyz").feed(stream)
    assert (batch.columns["rate_x"] * 2**14).tolist() == [rate for rate, _ in values]
    assert (batch.columns["acc_x"] * 2**19).tolist() == [acc for _, acc in values]
    assert set((batch.columns["rate_z"] * 2**14).tolist()) == {-1}
    assert batch.columns["counter"].tolist() == [16 * n % 256 for n in range(len(values))]
    encoder = FrameEncoder(load_family("stim300"), "rate_acc")
    again = {"rate_x": batch.columns["rate_x"], "rate_z": -(2.0**-14), "acc_x": batch.columns["acc_x"]}
    again |= {"acc_y": 2.0**-19, "acc_z": 2.0**-18, "counter": 16 * np.arange(len(values))}
    assert encoder.encode(len(values), again) == stream


def test_an_emulated_stim300_says_its_latency_and_not_the_time() -> None:
    """TS1524, table 5-18: the time from the sample to the datagram, some 500 us with the counter beside it."""
    family = load_family("stim300")
    unit = FrameEmulator(
        TurningPlant("xyz"), family, axes="xyz", rate_hz=125.0, baudrate=921_600, message="rate"
    )
    block = unit.stream(10.0)
    assert block is not None
    frames = np.frombuffer(block.data, np.uint8).reshape(-1, 18)
    assert set(map(tuple, frames[:, 12:14].tolist())) == {(0x01, 0xF4)}


def test_an_emulated_hg4930_counts_its_samples_in_two_bits() -> None:
    """Bits 0 and 1 of status word 1: hg4930_status_word_1_t of Honeywell's HGuide API."""
    family = load_family("hg4930")
    unit = FrameEmulator(TurningPlant("xyz"), family, axes="xyz", rate_hz=600.0, baudrate=1_000_000)
    words: list[int] = []
    for until_s in (0.5, 1.0):  # the count goes on from block to block
        block = unit.stream(until_s)
        assert block is not None
        words += np.frombuffer(block.data, np.uint8).reshape(-1, 20)[:, 14].tolist()
    assert words == [number % 4 for number in range(599)]


def test_status_bits_make_rates_invalid() -> None:
    encoder = FrameEncoder(load_family("kvh"), "a")
    data = encoder.encode(4, {"status": [0x77, 0x76, 0x70, 0x07], "counter": np.arange(4)})
    both = {
        axes: FrameDecoder(load_family("kvh"), rate_hz=1000, axes=axes).feed(data) for axes in ("x", "yz")
    }
    assert both["x"].columns["valid"].tolist() == [True, False, False, True]
    assert both["yz"].columns["valid"].tolist() == [True, True, False, True]


def test_a_multiplexed_field_is_there_when_its_turn_comes() -> None:
    data = FrameEncoder(load_family("kvh"), "c").encode(
        8, {"counter": np.arange(8), "temp": 25.0, "mag_y": 0.5}
    )
    columns = MessageReader(load_family("kvh")).feed(data)[0].columns()
    assert np.isnan(columns["temp"]).tolist() == [n % 4 != 0 for n in range(8)]
    assert columns["mag_y"][2::4].tolist() == [0.5, 0.5]
    assert columns["temp"][::4].tolist() == [25.0, 25.0]


def test_cumulative_angles_become_increments_across_the_wrap_and_gaps() -> None:
    encoder = FrameEncoder(load_family("astrix_ns"), "filtered")
    lsb_arcsec, step = 0.00153, 1000
    count = (2**32 - 3 * step) + step * np.arange(8)
    data = encoder.encode(8, {"angle_x": (count % 2**32) * lsb_arcsec, "time_tag": 20 * np.arange(8)})
    frames = [data[at : at + 26] for at in range(0, len(data), 26)]
    del frames[4]
    decoder = FrameDecoder(load_family("astrix_ns"), rate_hz=100.0, axes="x")
    found = [decoder.feed(frame) for frame in frames]
    angle = np.concatenate([batch.columns["angle_x"] for batch in found])
    assert np.isnan(angle[0]) and not found[0].columns["valid"][0]
    np.testing.assert_allclose(
        angle[1:], step * lsb_arcsec, rtol=1e-12
    )  # the gap's angle shared by two samples


def test_frames_without_a_counter_count_the_bytes_that_went_by() -> None:
    data = FrameEncoder(load_family("hg4930"), "control").encode(6, {})
    broken = bytearray(data)
    broken[2 * 20 + 5] ^= 1
    decoder = FrameDecoder(load_family("hg4930"), rate_hz=600.0, axes="xyz")
    counters = [
        n for at in range(0, 120, 7) for n in decoder.feed(bytes(broken[at : at + 7])).columns["counter"]
    ]
    assert counters == [0, 1, 3, 4, 5]


def hg4930(
    kind: int, raws: tuple[int, ...], status: tuple[int, int], increments: tuple[int, ...] = ()
) -> bytes:
    """A message packed as Honeywell's manual has it (pages 14 and 15)."""
    body = struct.pack("<BB6h2H", 0x0E, kind, *raws, *status) + struct.pack(
        f"<{len(increments)}i", *increments
    )
    return body + struct.pack("<H", sum(struct.unpack(f"<{len(body) // 2}H", body)) & 0xFFFF)


def test_hg4930_by_the_makers_manual() -> None:
    """Five control messages and an inertial one are six samples; a velocity counts 0.3048 * 2**-27 m/s."""
    control = hg4930(1, (1, 2, 3, 4, 5, 6), (0, 0x80E7))  # 0xE7 is -25 degC: temperatures are signed
    inertial = hg4930(2, (7, 8, 9, 10, 11, 12), (0, 0x0003), (1 << 20, 2, 3, 1 << 27, 5, 6))
    stream = (control * 5 + inertial) * 3
    family = load_family("hg4930")
    for size in (1, 7, 20, 1000):
        decoder = FrameDecoder(family, rate_hz=600.0, axes="xyz")
        parts = [decoder.feed(stream[at : at + size]).columns for at in range(0, len(stream), size)]
        columns = {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
        assert columns["counter"].tolist() == list(range(18)) and columns["valid"].all()
        np.testing.assert_allclose(columns["rate_x"][[4, 5]], np.array([-2, -8]) * 600 / 2**20, rtol=1e-6)
        np.testing.assert_allclose(
            columns["acc_y"][[4, 5]], np.array([6, 12]) * 600 * 0.3048 / 2**14, rtol=1e-6
        )
        assert columns["temp_c"][0] == -25.0 and np.isnan(columns["temp_c"][5])
    damaged = bytearray(stream)
    damaged[3] ^= 1
    damaged[5 * 20 + 3] ^= 1  # the first control and the first inertial message
    counter = FrameDecoder(family, rate_hz=600.0, axes="x").feed(bytes(damaged)).columns["counter"]
    assert counter[:5].tolist() == [0, 1, 2, 3, 6]  # 44 bytes are taken for two of 20
    chosen = load_family("hg4930", {"output": "increments"})
    columns = FrameDecoder(chosen, rate_hz=100.0, axes="xyz").feed(stream).columns
    assert len(columns["turn_z"]) == 3 and columns["turn_z"][0] == -(2.0**-13)
    np.testing.assert_allclose(columns["velocity_z"], -0.3048, rtol=1e-6)
    failed = hg4930(1, (0,) * 6, (1 << 9, 0))  # gyro y
    for axes, good in (("xz", True), ("y", False)):
        assert FrameDecoder(family, rate_hz=600.0, axes=axes).feed(failed).columns["valid"][0] == good
    s_class = hg4930(0xCA, (0, -32768, 0, 0, 0, -32768), (0, 0))
    (messages,) = MessageReader(family).feed(s_class)
    assert messages.columns()["rate_x"][0] == 499.0
    assert messages.columns()["acc_y"][0] == pytest.approx(-21 * 9.805989024)


def test_openimu_packets_by_their_descriptions() -> None:
    """Acceleration, rate and temperature of s1, a1, a2, e1, e2 where python-openimu has them."""
    layouts = {
        b"s1": ("<Id10f", (7, 0.007, 1, 2, 3, 4, 5, 6, 7, 8, 9, 25.5), "m/s2"),
        b"a1": ("<Id8f3B", (7, 0.007, 0, 0, 4, 5, 6, 1, 2, 3, 0, 0, 0), "m/s2"),
        b"a2": ("<Id9f", (7, 0.007, 0, 0, 0, 4, 5, 6, 1, 2, 3), "m/s2"),
        b"e1": ("<Id15f3B", (7, 0.007, 0, 0, 0, 1, 2, 3, 4, 5, 6, *[0] * 6, 0, 0, 0), "g"),
        b"e2": (
            "<Id21f3d3B",
            (7, 0.007, 0, 0, 0, 1, 2, 3, 0, 0, 0, 4, 5, 6, *[0] * 9, 0, 0, 0, 0, 0, 0),
            "g",
        ),
    }
    for name, (layout, values, unit) in layouts.items():
        payload = struct.pack(layout, *values)
        body = name + bytes([len(payload)]) + payload
        frame = b"UU" + body + binascii.crc_hqx(body, 0x1D0F).to_bytes(2, "big")
        decoder = FrameDecoder(load_family("openimu"), rate_hz=100.0, axes="xyz", message=name.decode())
        columns = decoder.feed(frame).columns
        assert [columns[f"rate_{axis}"][0] for axis in "xyz"] == [4.0, 5.0, 6.0]
        assert [columns[f"acc_{axis}"][0] for axis in "xyz"] == [1.0, 2.0, 3.0]
        spec = next(
            each for each in load_family("openimu").form(name.decode()).fields if each.name == "acc_x"
        )
        assert spec.unit == unit and columns["counter"][0] == 7 and decoder.counter_step == 10.0
        assert columns["temp_c"][0] == 25.5 if name == b"s1" else np.isnan(columns["temp_c"][0])


@pytest.mark.parametrize("name", sorted(EXPECTED))
def test_random_bytes_never_raise_and_frames_have_sound_checks(name: str) -> None:
    """10^6 bytes of noise seeded with beginnings of frames, in uneven chunks, for each description."""
    family = load_family(name)
    rng = np.random.default_rng(len(name))
    heads = [sync for form in family.forms for sync in form.syncs]
    noise = bytearray(rng.bytes(300_000))
    for at in rng.integers(0, len(noise) - 8, 20_000):
        head = heads[int(rng.integers(len(heads)))]
        noise[at : at + len(head)] = head
    reader = MessageReader(family)
    axis = next(str(spec.axis) for form in family.forms for spec in form.fields if spec.role in GYRO_ROLES)
    decoder = FrameDecoder(family, rate_hz=100.0, axes=axis)
    at = 0
    while at < len(noise):
        chunk = bytes(noise[at : at + int(rng.integers(1, 5000))])
        at += len(chunk)
        for messages in reader.feed(chunk):
            assert messages.layout.sound(messages.rows).all()
        decoder.feed(chunk)
    longest = max(form.longest for form in family.forms)
    assert reader.pending <= longest
    assert reader.counts.bytes_skipped + sum(
        reader.by_form[form.name] * form.shortest for form in family.forms
    ) <= len(noise)


def test_thermistors_of_the_astrix_by_the_user_guides_formula() -> None:
    """A frame packed by hand; sensors that are open or shorted have no temperature."""
    raws = (8000, 16000, 32767, 0)  # board, SIA, organizer, interface
    body = struct.pack("<BBI6I2H9h4HI", 0x87, 0x16, 7, *range(6), 1, 2, *[0] * 9, *raws, 1 << 31)
    data = body + struct.pack("<H", sum(struct.unpack("<32H", body)) & 0xFFFF)
    (messages,) = MessageReader(load_family("astrix_ns")).feed(data)
    columns = messages.columns()
    log = math.log(10000 / 15000 * 16000 / (32767 - 16000))
    sia = 0.003354002877286514 + 0.00027882899576731036 * log + 3.3862644724025175e-6 * log**2
    sia_c = 1.0 / (sia + 1.6298342537466100e-7 * log**3) - 273.15
    assert columns["sia_temp"][0] == pytest.approx(sia_c, abs=1e-9) and 30.0 < sia_c < 40.0
    assert 50.0 < columns["board_temp"][0] < 60.0
    assert np.isnan([columns["organizer_temp"][0], columns["interface_temp"][0]]).all()


def test_one_false_frame_in_1e9_random_bytes_is_promised_but_for_the_ones_named() -> None:
    """docs/frames.md names these; `frames check` prints the figures."""
    weak = {}
    for name in shipped():
        false = 1e9 * sum(form.false_per_byte for form in load_family(name).forms if form.measures)
        if false > 1.0:
            weak[name] = false
    assert set(weak) == {"fg333", "stim210", "astrix_ns", "kvh_dsp3000"}
    assert weak["fg333"] == pytest.approx(1e9 / 2**24)  # two bytes of head, one of check
    assert weak["stim210"] == pytest.approx(9e9 / 2**16)  # nine messages, one byte of each
    assert weak["astrix_ns"] == pytest.approx(7e9 / 2**32)
