"""CAN layouts: printed vectors, samples of several frames, held values, real captures, wrong mappings."""

from __future__ import annotations

import itertools
import json
import math
import struct
from pathlib import Path

import can
import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base.errors import ConfigurationError
from drivers.can_dbc import CanConfig, CanDecoder, can_kind, layout_from_mapping, load_layout, shipped_layouts
from drivers.can_dbc._layout import layout_from_plain, layout_to_plain
from drivers.slcan import from_messages
from simulators.emulators.can_dbc import CanEmulator
from simulators.interfaces import GyroSignal

DATA = Path(__file__).parents[2] / ".." / "shared" / "data"
CANMOD, RAV4 = DATA / "can_canmod_gps", DATA / "can_rav4_comma2k19"

TEST_DBC = """VERSION ""
BU_: A
BO_ 16 PAGED: 8 A
 SG_ PAGE M : 0|8@1+ (1,0) [0|0] "" A
 SG_ COUNT m0 : 8|4@1+ (1,0) [0|0] "" A
 SG_ X m0 : 16|32@1- (1,0) [0|0] "deg/s" A
 SG_ Y m1 : 23|24@0- (0.001,0) [0|0] "deg/h" A
BO_ 17 SLOW: 4 A
 SG_ TEMP : 0|16@1- (0.1,0) [0|0] "K" A
 SG_ OK : 16|1@1+ (1,0) [0|0] "" A
BO_ 18 OTHER: 8 A

SIG_VALTYPE_ 16 X : 1;
"""
PAGED = {
    "format": 1,
    "dbc": "unit.dbc",
    "sample": ["PAGED[0]", "PAGED[1]"],
    "signal": [
        {"role": "counter", "message": "PAGED", "signal": "COUNT", "modulo": 15},
        {"role": "rate", "axis": "x", "message": "PAGED", "signal": "X"},
        {"role": "rate", "axis": "y", "message": "PAGED", "signal": "Y"},
        {"role": "temperature", "message": "SLOW", "signal": "TEMP"},
    ],
    "valid": [{"message": "SLOW", "signal": "OK", "equals": 1}],
}


def line(identifier: int, data: bytes, extended: bool = False) -> bytes:
    head = b"T%08X" % identifier if extended else b"t%03X" % identifier
    return head + b"%d" % len(data) + data.hex().encode() + b"\r"


@pytest.fixture
def paged(tmp_path: Path):
    (tmp_path / "unit.dbc").write_text(TEST_DBC, encoding="utf-8")
    return lambda **changes: layout_from_mapping(PAGED | changes, tmp_path, "map.toml", "paged")


def sample(count: int, x: float, y_raw: int) -> bytes:
    zero = np.array([0, count], np.uint8).tobytes() + np.float32(x).tobytes() + b"\0\0"
    one = b"\1\0" + y_raw.to_bytes(3, "big", signed=True) + b"\0\0\0"
    return line(16, zero) + line(16, one)


def slow(deci_k: int, ok: int = 1) -> bytes:
    return line(17, deci_k.to_bytes(2, "little", signed=True) + bytes([ok, 0]))


def test_a_sample_of_multiplexed_frames_with_held_values(paged) -> None:
    decoder = CanDecoder(paged(), 100.0)
    stream = (
        sample(13, 1.5, -7200_000) + slow(2531) + sample(14, -2.0, 3600) + slow(2631, 0) + sample(0, 0.0, 0)
    )
    columns = decoder.feed(stream + line(18, b"") + line(99, b"")).columns
    assert columns["counter"].tolist() == [13, 14, 0]
    assert decoder.counter_modulo == 15
    assert columns["rate_x_dps"].tolist() == [1.5, -2.0, 0.0]
    np.testing.assert_allclose(columns["rate_y_dps"], [-2.0, 1e-3, 0.0], rtol=1e-6)
    np.testing.assert_allclose(columns["temp_c"], [np.nan, -20.05, -10.05], rtol=1e-6)
    assert columns["valid"].tolist() == [False, True, False]  # not known yet; good; said to be bad
    assert decoder.counts.rejected == {"unknown_id": 1}


def test_of_a_multiplexed_message_the_last_of_every_page_is_held(tmp_path: Path) -> None:
    dbc = TEST_DBC.replace(
        "BO_ 18 OTHER",
        "BO_ 19 HOUSE: 4 A\n"
        ' SG_ P M : 0|8@1+ (1,0) [0|0] "" A\n'
        ' SG_ CHIP m0 : 8|16@1- (0.1,0) [0|0] "degC" A\n'
        ' SG_ CASE m1 : 8|16@1- (0.1,0) [0|0] "degC" A\n'
        "BO_ 18 OTHER",
    )
    (tmp_path / "unit.dbc").write_text(dbc, encoding="utf-8")
    signals = [
        *PAGED["signal"][:3],
        {"role": "temperature", "message": "HOUSE", "signal": "CHIP"},
        {"role": "case_temperature", "message": "HOUSE", "signal": "CASE"},
    ]
    mapping = {key: value for key, value in PAGED.items() if key != "valid"} | {"signal": signals}
    decoder = CanDecoder(layout_from_mapping(mapping, tmp_path, "map.toml", "paged"), 100.0)

    def house(page: int, deci_c: int) -> bytes:
        return line(19, bytes([page]) + deci_c.to_bytes(2, "little", signed=True) + b"\0")

    decoder.feed(house(0, 200) + house(1, 300) + house(1, 310) + house(0, 210) + house(0, -5))
    columns = decoder.feed(sample(1, 0.0, 0) + house(1, 320) + sample(2, 0.0, 0)).columns
    assert columns["temp_c"].tolist() == pytest.approx([-0.5, -0.5])
    assert columns["case_temp_c"].tolist() == pytest.approx([31.0, 32.0])


def test_accelerations_in_a_sample_and_held(tmp_path: Path) -> None:
    """x in the sample, in g; z in a message of its own, in m/s2: against cantools, there and back."""
    (tmp_path / "imu.dbc").write_text(
        """VERSION ""
BU_: A
BO_ 16 IMU: 8 A
 SG_ N : 0|16@1+ (1,0) [0|0] "" A
 SG_ W : 16|16@1- (0.01,0) [0|0] "deg/s" A
 SG_ AX : 32|24@1- (0.0001,0) [0|0] "g" A
BO_ 17 UP: 4 A
 SG_ AZ : 7|32@0- (0.00001,0) [0|0] "m/s2" A
"""
    )
    mapping = {
        "format": 1,
        "dbc": "imu.dbc",
        "sample": ["IMU"],
        "signal": [
            {"role": "counter", "message": "IMU", "signal": "N"},
            {"role": "rate", "axis": "z", "message": "IMU", "signal": "W"},
            {"role": "accel", "axis": "x", "message": "IMU", "signal": "AX"},
            {"role": "accel", "axis": "z", "message": "UP", "signal": "AZ"},
        ],
    }
    layout = layout_from_mapping(mapping, tmp_path, "map.toml")
    database = cantools.database.load_file(tmp_path / "imu.dbc")
    stream, forces = b"", []
    for n in range(5):
        x, z = 0.1 * n - 0.2, 9.8 + n
        forces.append((x * 9.80665, z))
        stream += line(17, database.encode_message("UP", {"AZ": z}))
        stream += line(16, database.encode_message("IMU", {"N": n, "W": 1.0, "AX": x}))
    columns = CanDecoder(layout, 100.0).feed(stream).columns
    np.testing.assert_allclose(columns["accelerometer_x_mps2"], [x for x, _ in forces], atol=1e-6)
    np.testing.assert_allclose(columns["accelerometer_z_mps2"], [z for _, z in forces], rtol=1e-6)
    kind = can_kind(CanConfig, lambda config: layout)
    assert kind.accelerations is not None
    assert set(kind.accelerations(CanConfig(name="g", driver="any", unit="1", axis="x"), columns, 100.0)) == {
        "x",
        "z",
    }
    with pytest.raises(ConfigurationError, match="one of m/s2"):
        bad = [*mapping["signal"][:3], {**mapping["signal"][3], "unit": "deg/s"}]
        layout_from_mapping({**mapping, "signal": bad}, tmp_path, "map.toml")

    class Falling:
        axes = "z"

        def measure(self, start_s: float, count: int, period_s: float) -> GyroSignal:
            velocity = np.tile([0.5, 0.0, -2.0], (count, 1)) * period_s
            return GyroSignal("z", np.zeros((count, 1)), np.full(count, 20.0), velocity)

    unit = CanEmulator(Falling(), layout, rate_hz=100.0)
    unit.receive(b"C\rS6\rO\r", 0.0)
    block = unit.stream(1.0)
    assert block is not None
    sent = CanDecoder(layout, 100.0).feed(block.data).columns
    np.testing.assert_allclose(sent["accelerometer_x_mps2"], 0.5, atol=0.0001 * 9.80665 / 2)
    np.testing.assert_allclose(sent["accelerometer_z_mps2"], -2.0, atol=1e-5)


def test_a_rate_that_is_no_number_is_not_valid(paged) -> None:
    columns = (
        CanDecoder(paged(), 100.0).feed(slow(2931) + sample(1, float("nan"), 0) + sample(2, 1.0, 0)).columns
    )
    assert columns["valid"].tolist() == [False, True]


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.sampled_from(["sample", "first", "second", "slow", "other", "noise", "short"]), max_size=25),
    st.lists(st.integers(0, 2000), max_size=12),
)
def test_any_chunking_gives_the_same_rows(tmp_path_factory, kinds: list[str], cuts: list[int]) -> None:
    folder = tmp_path_factory.mktemp("dbc")
    (folder / "unit.dbc").write_text(TEST_DBC, encoding="utf-8")
    layout = layout_from_mapping(PAGED, folder, "map.toml")
    stream = b""
    for number, kind in enumerate(kinds):
        whole = sample(number % 15, number, number)
        stream += {
            "sample": whole,
            "first": whole[: len(whole) // 2],
            "second": whole[len(whole) // 2 :],
            "slow": slow(2731 + number, number % 2),
            "other": line(18, b"12345678"),
            "noise": b"t10\xff\r",
            "short": line(17, b"1"),
        }[kind]
    whole = CanDecoder(layout, 100.0).feed(stream)
    decoder = CanDecoder(layout, 100.0)
    edges = [0, *sorted(cut % (len(stream) + 1) for cut in cuts), len(stream)]
    parts = [decoder.feed(stream[a:b]) for a, b in itertools.pairwise(edges)]
    for name, column in whole.columns.items():
        np.testing.assert_array_equal(np.concatenate([part.columns[name] for part in parts]), column)
    assert len(whole) >= kinds.count("sample")


@settings(deadline=None, max_examples=100)
@given(st.binary(max_size=400))
def test_random_bytes_never_raise(data: bytes) -> None:
    for name in ("xsens_mti", "openimu300"):
        CanDecoder(load_layout(name), 100.0).feed(data)


def test_the_printed_vectors_of_xsens() -> None:
    """1 rad/s about z, then (0.1, -0.25, 2.5) rad/s; temperature below zero; a DLC below 6 is refused."""
    decoder = CanDecoder(load_layout("xsens_mti"), 100.0)
    head = line(5, (10_000).to_bytes(4, "big")) + line(17, (3).to_bytes(4, "big"))
    stream = line(0x51, bytes.fromhex("F680")) + head + line(0x32, bytes.fromhex("000000000200"))
    stream += (
        head + line(0x32, bytes.fromhex("0033FF800500")) + head + line(0x32, bytes.fromhex("0033FF8005"))
    )
    columns = decoder.feed(stream).columns
    rates = np.radians([columns[f"rate_{axis}_dps"] for axis in "xyz"]).T
    np.testing.assert_allclose(rates, [[0.0, 0.0, 1.0], [51 / 512, -0.25, 2.5]], rtol=1e-6)
    np.testing.assert_allclose(columns["temp_c"], -9.5)
    assert columns["counter"].tolist() == [10_000, 10_000]
    assert columns["valid"].all() and (decoder.counter_modulo, decoder.counter_step) == (2**32, 10_000.0)
    assert decoder.counts.rejected == {"short_message": 1}
    clipped = CanDecoder(load_layout("xsens_mti"), 100.0, "z")
    words = [0x1, 0x2001, 0x0801, 0x0]  # good; gyro z clipped; gyro x clipped; self-test failed
    stream = b"".join(
        line(5, bytes(4)) + line(17, word.to_bytes(4, "big")) + line(0x32, bytes(6)) for word in words
    )
    assert clipped.feed(stream).columns["valid"].tolist() == [True, False, True, False]


def test_the_printed_vectors_of_j1939() -> None:
    """0 deg/s is 0x7D00, +10 deg/s 0x8200; 0xFExx is an error, 0xFFFF not available; any priority, one source."""
    zero, ten = bytes.fromhex("007D"), bytes.fromhex("0082")
    stream = line(0x0CF02A80, ten + zero + zero + b"\0\0", True) + line(0x18F02A80, zero * 3 + b"\0\0", True)
    stream += line(0x0CF02A80, zero + b"\xff\xfe" + b"\xff\xff" + b"\0\0", True) + line(
        0x0CF02D80, bytes(8), True
    )
    other = line(0x0CF02A81, zero * 3 + b"\0\0", True)
    columns = (
        (decoder := CanDecoder(load_layout("openimu300"), 100.0, source_address=0x80))
        .feed(stream + other)
        .columns
    )
    assert columns["rate_x_dps"].tolist() == [10.0, 0.0, 0.0]
    assert columns["valid"].tolist() == [True, True, False]
    assert np.isnan(columns["rate_y_dps"][2]) and np.isnan(columns["rate_z_dps"][2])
    assert columns["counter"].tolist() == [0, 1, 2] and np.isnan(columns["temp_c"]).all()
    assert decoder.counts.rejected == {}  # another node's message of the same group is known, not foreign
    assert len(CanDecoder(load_layout("openimu300"), 100.0).feed(other)) == 1


def test_accelerations_of_the_shipped_layouts() -> None:
    """By the makers: PGN 61485 0.01 m/s2 - 320, 0xFExx an error; HiPNUC 0.00048828 g, 1 mg; SBG 0.01 m/s2."""
    force = struct.pack("<3H2x", 32981, 32000, 0xFE00)  # 9.81, 0, error
    zero = struct.pack("<3H2x", 32000, 32000, 32000)
    for name, source in (("openimu300", 0x80), ("j1939_rate20", 0x00)):
        rates = bytes.fromhex("00D0070000A00F00") if name == "j1939_rate20" else zero
        stream = line(0x0CF02A00 | source, rates, True) + line(0x0CF02D00 | source, force, True)
        stream += line(0x0CF02900 | source, bytes(8), True) + line(0x0CF02A00 | source, rates, True)
        decoder = CanDecoder(load_layout(name), 100.0)
        columns = decoder.feed(stream).columns
        found = np.array([columns[f"accelerometer_{axis}_mps2"] for axis in "xyz"])
        np.testing.assert_allclose(found[:, 0], np.nan)  # none yet
        np.testing.assert_allclose(found[:, 1], [9.81, 0.0, np.nan], rtol=1e-6, atol=1e-6)
        assert columns["valid"].all()
    held = {
        "hipnuc_j1939": (0x0CFF3408, 0x0CFF3708, struct.pack("<4h", 2048, 0, -2048, 0), bytes(8), 9.80665),
        "hipnuc_canopen": (
            0x188,
            0x288,
            struct.pack("<3h", 1000, 0, -1000),
            struct.pack("<3h", 10, 0, 0),
            9.80665,
        ),
        "xsens_mti": (0x34, 0x32, struct.pack(">3h", 2511, 0, -2511), bytes(6), 2511 / 256),
        "sbg_ellipse_imu": (0x121, 0x122, struct.pack("<3h", 981, 0, -981), bytes(6), 9.81),
    }
    before = {"xsens_mti": line(5, bytes(4)) + line(17, bytes(4)), "sbg_ellipse_imu": line(0x120, bytes(8))}
    for name, (acceleration, gyro, force, rate, expected) in held.items():
        extended = gyro > 0x7FF
        stream = line(acceleration, force, extended) + before.get(name, b"") + line(gyro, rate, extended)
        columns = CanDecoder(load_layout(name), 100.0).feed(stream).columns
        found = [columns[f"accelerometer_{axis}_mps2"][0] for axis in "xyz"]
        np.testing.assert_allclose(found, [expected, 0.0, -expected], rtol=2e-5)
        assert columns["rate_x_dps"][0] == (1.0 if name == "hipnuc_canopen" else 0.0)


def test_one_parameter_group_in_two_layouts() -> None:
    """-4000 + 1/128 deg/s steps in 20 bits; the same bytes mean something else in 16."""
    raws = [(4000 + rate) * 128 for rate in (10, -20, 0)]
    payload = (raws[0] | raws[1] << 20 | raws[2] << 40).to_bytes(8, "little")
    columns = CanDecoder(load_layout("j1939_rate20"), 100.0).feed(line(0x0CF02A00, payload, True)).columns
    assert [columns[f"rate_{axis}_dps"][0] for axis in "xyz"] == [10.0, -20.0, 0.0]


class Plant:
    def measure(self, start_s: float, count: int, period_s: float) -> GyroSignal:
        end_s = period_s * (round(start_s / period_s) + np.arange(1, count + 1))
        rates = np.column_stack([np.sin(end_s), -np.cos(end_s), 0.02 * end_s])
        return GyroSignal("xyz", rates * period_s, -20.0 + end_s)


@pytest.mark.parametrize("name", shipped_layouts())
def test_emulated_units_send_what_cantools_reads(name: str) -> None:
    layout = load_layout(name)
    emulator = CanEmulator(Plant(), layout, rate_hz=100.0, clock_error_ppm=200.0)
    emulator.receive(b"C\rS6\rO\r", 0.0)
    block = emulator.stream(3.0)
    assert block is not None
    dbc = Path(load_layout.__code__.co_filename).parent / layout.dbc
    path = dbc if dbc.exists() else dbc.parents[1] / "sbg" / layout.dbc
    database = cantools.database.load_file(path, encoding="utf-8")
    number, period_s = 0, 0.01 / (1 + 200e-6)
    for text in block.data.decode("ascii").split("\r")[:-1]:
        digits = 3 if text[0] == "t" else 8
        identifier, data = int(text[1 : 1 + digits], 16), bytes.fromhex(text[2 + digits :])
        message = database.get_message_by_frame_id(identifier)
        values = message.decode(data, decode_choices=False)
        number += message.name == layout.sample[0].message
        t = (number or 1) * period_s
        rates = {"x": math.sin(t), "y": -math.cos(t), "z": 0.02 * t}
        for use in layout.uses:
            if use.message == message.name and use.role == "rate":
                step = message.get_signal_by_name(use.signal).scale * use.factor
                assert values[use.signal] * use.factor == pytest.approx(
                    math.degrees(rates[use.axis]), abs=0.501 * step
                )
            elif use.message == message.name and use.role == "temperature":
                assert values[use.signal] == pytest.approx(-20.0 + t, abs=0.0151)
            elif use.message == message.name and use.role == "time":
                assert values[use.signal] == number * 10_000
    assert number == len(CanDecoder(layout, 100.0).feed(block.data)) >= 298
    assert CanDecoder(layout, 100.0).feed(block.data).columns["valid"].all()


@pytest.mark.parametrize("name", shipped_layouts())
def test_layouts_survive_the_record(name: str) -> None:
    layout = load_layout(name)
    assert layout_from_plain(json.loads(json.dumps(layout_to_plain(layout)))) == layout
    with pytest.raises(ConfigurationError, match="cannot be used"):
        layout_from_plain({"messages": 1})


def test_a_real_capture_against_cantools() -> None:
    """44 s of a CANmod.gps at 100 Hz: every row is a message 9 as cantools reads it."""
    if not CANMOD.exists():
        pytest.skip("the capture in shared/data/can_canmod_gps is not here")
    mapping = {
        "format": 1,
        "dbc": "canmod-gps.dbc",
        "sample": ["gnss_imu"],
        "signal": [
            {"role": "rate", "axis": axis, "message": "gnss_imu", "signal": f"AngularRate{axis.upper()}"}
            for axis in "xyz"
        ],
        "valid": [{"message": "gnss_imu", "signal": "ImuValid", "equals": 1}],
    }
    layout = layout_from_mapping(mapping, CANMOD, "canmod.toml")
    messages = list(can.LogReader(CANMOD / "00000005-60FEB5A8.log"))
    frames, times_s, left_out = from_messages(messages)
    assert len(frames) == 5477 and not left_out
    decoder = CanDecoder(layout, 100.0)
    batch = decoder.feed_frames(frames)
    database = cantools.database.load_file(CANMOD / "canmod-gps.dbc")
    imu = [
        database.decode_message(9, each.data, decode_choices=False)
        for each in messages
        if each.arbitration_id == 9 and not each.is_extended_id
    ]
    assert len(batch) == len(imu) > 4400
    for axis in "xyz":
        np.testing.assert_allclose(
            batch.columns[f"rate_{axis}_dps"], [row[f"AngularRate{axis.upper()}"] for row in imu], rtol=1e-6
        )
    assert batch.columns["valid"].tolist() == [row["ImuValid"] == 1 for row in imu]
    rate_hz = (len(batch) - 1) / np.ptp(times_s[batch.end_offset - 1])
    assert rate_hz == pytest.approx(100.0, rel=0.02)


def test_a_car_turns_as_the_phone_in_it_does() -> None:
    """Yaw rate of a RAV4 (10 bits, big-endian, scale not published) against a phone's gyro over the same 30 s."""
    if not RAV4.exists():
        pytest.skip("the capture in shared/data/can_rav4_comma2k19 is not here")
    mapping = {
        "format": 1,
        "dbc": "toyota_2017_excerpt.dbc",
        "sample": ["KINEMATICS"],
        "signal": [
            {"role": "rate", "axis": "z", "message": "KINEMATICS", "signal": "YAW_RATE", "unit": "deg/s"}
        ],
    }
    layout = layout_from_mapping(mapping, RAV4, "rav4.toml")
    frames, times_s, _ = from_messages(can.LogReader(RAV4 / "can_bus0.log.gz"))
    batch = CanDecoder(layout, 80.0).feed_frames(frames)
    assert len(batch) > 2000
    phone = np.genfromtxt(RAV4 / "phone_gyro.csv", delimiter=",", names=True)
    at_s = times_s[batch.end_offset - 1]
    use = (at_s > phone["t_s"][0]) & (at_s < phone["t_s"][-1])
    width = 40
    smooth = np.convolve(batch.columns["rate_z_dps"][use], np.ones(width) / width, "valid")
    best = max(
        abs(
            np.corrcoef(
                smooth,
                np.convolve(np.interp(at_s[use], phone["t_s"], phone[axis]), np.ones(width) / width, "valid"),
            )[0, 1]
        )
        for axis in ("gx_uncal_rad_s", "gy_uncal_rad_s", "gz_uncal_rad_s")
    )
    assert best > 0.9


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": 2}, "format"),
        ({"colour": "red"}, "colour"),
        ({"dbc": "none.dbc"}, "cannot be read"),
        ({"sample": ["PAGE"]}, "no message PAGE"),
        ({"sample": ["SLOW[1]", "PAGED[0]", "PAGED[1]"]}, "SLOW has no multiplexer"),
        ({"sample": ["PAGED[0]"]}, r"PAGED.Y \(rate\) is in none"),
        ({"sample": ["PAGED[0]", "PAGED[0]", "PAGED[1]"]}, "every frame of a sample once"),
        ({"sample": []}, "sample"),
        ({"signal": [{"role": "rate", "message": "PAGED", "signal": "X"}]}, "axis cannot be used"),
        ({"signal": [{"role": "rate", "axis": "x", "message": "PAGED", "signal": "RATE"}]}, "no signal RATE"),
        (
            {"signal": [{"role": "rate", "axis": "x", "message": "PAGED", "signal": "X", "unit": "turns"}]},
            "unit cannot be used. Found: 'turns'",
        ),
        (
            {"signal": [{"role": "rate", "axis": "x", "message": "PAGED", "signal": "COUNT"}]},
            "unit cannot be used",
        ),
        ({"signal": [{"role": "speed", "message": "PAGED", "signal": "X"}]}, "signal.0.role"),
        ({"signal": [PAGED["signal"][0] | {"signal": "X"}]}, "integer of at most 62 bits"),
        ({"signal": [PAGED["signal"][0] | {"modulo": 17}]}, "modulo to 16"),
        ({"signal": [PAGED["signal"][0]]}, "a rate for each axis"),
        ({"signal": [PAGED["signal"][1], PAGED["signal"][1]]}, "a rate for each axis"),
        ({"valid": [{"message": "SLOW", "signal": "OK"}]}, r"bits = \[...\] or equals"),
        ({"valid": [{"message": "SLOW", "signal": "OK", "bits": [1]}]}, "bits 0 to 0"),
    ],
)
def test_mappings_that_are_wrong_name_the_key(paged, changes: dict, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        paged(**changes)


def test_a_layout_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="xsens_mti"):
        load_layout("xsens", tmp_path)
    (tmp_path / "broken.toml").write_text("format =")
    with pytest.raises(ConfigurationError, match="not TOML"):
        load_layout("broken.toml", tmp_path)


def test_pages_the_other_way_round_are_paired_as_they_were_sent(paged) -> None:
    """Without the first frame every page 1 stands before a page 0 that belongs to the next sample."""
    frames = b"".join(sample(k, float(k), 1000 * k) for k in range(1, 9)).split(b"\r")[1:-1]
    decoder = CanDecoder(paged(valid=[]), 100.0)
    columns = decoder.feed(b"\r".join(frames[:-1]) + b"\r").columns
    assert columns["counter"].tolist() == [2, 3, 4, 5, 6, 7]
    assert columns["rate_x_dps"].tolist() == [2, 3, 4, 5, 6, 7]
    np.testing.assert_allclose(columns["rate_y_dps"] * 3600, np.arange(2, 8), rtol=1e-6)


def test_a_rate_above_zero_however_low_will_do(paged) -> None:
    CanDecoder(paged(), 0.25)
    for rate_hz in (0.0, -1.0, math.nan):
        with pytest.raises(ConfigurationError, match="positive rate"):
            CanDecoder(paged(), rate_hz)
