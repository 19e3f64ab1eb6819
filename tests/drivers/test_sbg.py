"""SBG Ellipse: layouts against cantools and the maker's DBC file, pairing, loss, and a driver that listens."""

from __future__ import annotations

import itertools
import os
import pty
import tty
from collections.abc import Iterator
from pathlib import Path

import cantools
import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.record.recording import PortJournal, StreamSource, decode_stream
from drivers.base.clock import WallClock
from drivers.base.errors import ConfigurationError, DeviceSilent, WrongDevice
from drivers.can_dbc import CanConfig, CanDecoder, MessageLayout
from drivers.can_dbc._dbc import compile_message, find_message
from drivers.can_dbc._kind import CanGyro
from drivers.kit.kinds import Connection
from drivers.sbg import ALL_GOOD, ELLIPSE_DBC, SbgEllipse, ellipse_layout
from drivers.slcan import BufferedSlcanBus
from tests.ptys import read_exactly


def sbg_decoder(rate_hz: float, axes: str = "xyz", dbc: Path = ELLIPSE_DBC) -> CanDecoder:
    return CanDecoder(ellipse_layout(dbc), rate_hz, axes)


def sbg_message(name: str) -> MessageLayout:
    return compile_message(find_message(ELLIPSE_DBC, name))


DATA = Path(__file__).parents[2] / ".." / "shared" / "data"
VENDOR_DBC = DATA / "dbc" / "sbg_ellipse.dbc"
OTHER_DBCS = (VENDOR_DBC, DATA / "dbc" / "xsens_mti.dbc", DATA / "can_canmod_gps" / "canmod-gps.dbc")
OURS = cantools.database.load_file(ELLIPSE_DBC)
ODD = cantools.database.load_string(
    """VERSION ""
BU_: A
BO_ 2566844926 MIXED: 8 A
 SG_ LE_S13 : 3|13@1- (0.25,-7) [0|0] "" A
 SG_ BE_S11 : 20|11@0- (-0.5,3) [0|0] "" A
 SG_ BE_U5 : 37|5@0+ (1,0) [0|0] "" A
 SG_ LE_U1 : 40|1@1+ (1,0) [0|0] "" A
 SG_ LE_U22 : 42|22@1+ (1E-3,100) [0|0] "" A
"""
)
DEG = 57.29577951308232

# The example of the maker's layout: 0.1, -0.25, 1.0 rad/s.
GYRO = b"t1226640006FFE803\r"


def info(time_us: int, status: int = ALL_GOOD, centi_c: int = 2500) -> bytes:
    body = (
        time_us.to_bytes(4, "little")
        + status.to_bytes(2, "little")
        + centi_c.to_bytes(2, "little", signed=True)
    )
    return b"t1208" + body.hex().upper().encode() + b"\r"


def gyro(x: int, y: int = 0, z: int = 0) -> bytes:
    return b"t1226" + np.array([x, y, z], "<i2").tobytes().hex().upper().encode() + b"\r"


def assert_equal_to_cantools(message: object, payloads: np.ndarray) -> None:
    layout = compile_message(message)
    expected = [
        message.decode(p.tobytes()[: message.length], decode_choices=False, scaling=True) for p in payloads
    ]
    raw = [
        message.decode(p.tobytes()[: message.length], decode_choices=False, scaling=False) for p in payloads
    ]
    for name, signal in layout.signals.items():
        assert signal.raw(payloads).tolist() == [values[name] for values in raw]
        np.testing.assert_allclose(
            signal.physical(payloads), [values[name] for values in expected], rtol=1e-15, atol=0.0
        )


@settings(deadline=None, max_examples=40)
@given(st.lists(st.binary(min_size=8, max_size=8), min_size=1, max_size=20))
@pytest.mark.parametrize("database", [OURS, ODD], ids=["ellipse", "odd"])
def test_decoding_equals_cantools(database: object, payloads: list[bytes]) -> None:
    table = np.frombuffer(b"".join(payloads), np.uint8).reshape(-1, 8)
    for message in database.messages:
        assert_equal_to_cantools(message, table)


@settings(deadline=None, max_examples=40)
@given(st.lists(st.binary(min_size=8, max_size=8), min_size=1, max_size=20))
@pytest.mark.parametrize("database", [OURS, ODD], ids=["ellipse", "odd"])
def test_packing_equals_cantools(database: object, payloads: list[bytes]) -> None:
    for message in database.messages:
        layout = compile_message(message)
        assert layout.extended == message.is_extended_frame
        raw = [message.decode(p[: message.length], scaling=False, decode_choices=False) for p in payloads]
        columns = {name: [values[name] for values in raw] for name in layout.signals}
        packed = layout.pack(columns, len(payloads))
        expected = [message.encode(values, scaling=False).ljust(8, b"\0") for values in raw]
        assert [row.tobytes() for row in packed] == expected


@pytest.mark.parametrize("path", OTHER_DBCS, ids=lambda path: path.stem)
def test_every_message_of_real_dbc_files(path: Path) -> None:
    if not path.exists():
        pytest.skip(f"{path.name} is not here")
    payloads = np.random.default_rng(1).integers(0, 256, (20, 8), np.uint8)
    payloads[0], payloads[1] = 0, 255
    for message in cantools.database.load_file(path, encoding="cp1252").messages:
        assert_equal_to_cantools(message, payloads)


@pytest.mark.skipif(not VENDOR_DBC.exists(), reason="the maker's DBC file is not here")
def test_our_layout_is_the_makers() -> None:
    theirs = cantools.database.load_file(VENDOR_DBC, encoding="cp1252")
    for ours in OURS.messages:
        message = theirs.get_message_by_name(ours.name)
        assert (ours.frame_id, ours.is_extended_frame, ours.length) == (
            message.frame_id,
            message.is_extended_frame,
            message.length,
        )
        wanted = compile_message(message).signals
        for name, signal in compile_message(ours).signals.items():
            other = wanted[name]
            assert (signal.shift, signal.bits, signal.big_endian, signal.signed) == (
                other.shift,
                other.bits,
                other.big_endian,
                other.signed,
            )
            assert (signal.scale, signal.offset) == (other.scale, other.offset)
        assert len(wanted) == len(ours.signals)
    decoder = sbg_decoder(100.0, dbc=VENDOR_DBC)
    assert len(decoder.feed(info(1) + GYRO)) == 1


def test_quantising_rounds_halves_away_from_zero_and_saturates() -> None:
    temperature = sbg_message("SBG_ECAN_MSG_IMU_INFO").signals["TEMPERATURE"]
    rate = sbg_message("SBG_ECAN_MSG_IMU_GYRO").signals["GYRO_X"]
    assert rate.quantise([0.0004, 0.0006, -0.0006, 40.0, -40.0]).tolist() == [0, 1, -1, 32767, -32768]
    assert temperature.quantise([0.125, 0.375, -0.125, 1e9]).tolist() == [13, 38, -13, 32767]
    time = sbg_message("SBG_ECAN_MSG_IMU_INFO").signals["TIME_STAMP"]
    assert time.quantise([-1.0, 2.0**40]).tolist() == [0, 2**32 - 1]


def test_bytes_of_the_makers_example() -> None:
    decoder = sbg_decoder(200.0)
    batch = decoder.feed(info(4_294_967_295, 0x0123, -1234) + GYRO)
    assert {name: column.dtype.name for name, column in batch.columns.items()} == {
        "counter": "int64",
        "status": "uint16",
        "rate_x_dps": "float32",
        "rate_y_dps": "float32",
        "rate_z_dps": "float32",
        "temp_c": "float32",
        "valid": "bool",
    }
    row = {name: column[0] for name, column in batch.columns.items()}
    assert (row["counter"], row["status"], bool(row["valid"])) == (4_294_967_295, 0x0123, False)
    rates = [row[f"rate_{axis}_dps"] for axis in "xyz"]
    np.testing.assert_allclose(rates, np.array([0.1, -0.25, 1.0]) * DEG, rtol=1e-6)
    assert row["temp_c"] == np.float32(-12.34)
    assert batch.end_offset.tolist() == [40]
    assert (decoder.counter_modulo, decoder.counter_step, decoder.nominal_rate_hz) == (2**32, 5000.0, 200.0)


@pytest.mark.parametrize(
    ("axes", "cleared", "valid"),
    [
        ("xyz", 0, False),  # link
        ("xyz", 1, False),  # self-test
        ("xyz", 2, True),  # accelerometer x
        ("xyz", 8, True),  # accelerometers in range
        ("xyz", 5, False),
        ("xyz", 7, False),
        ("xyz", 9, False),  # gyros in range
        ("z", 5, True),
        ("z", 6, True),
        ("z", 7, False),
    ],
)
def test_valid_by_status_bits(axes: str, cleared: int, valid: bool) -> None:
    batch = sbg_decoder(100.0, axes).feed(info(0, ALL_GOOD & ~(1 << cleared)) + GYRO + info(1) + GYRO)
    assert batch.columns["valid"].tolist() == [valid, True]
    assert [name for name in batch.columns if name.startswith("rate")] == [
        f"rate_{axis}_dps" for axis in axes
    ]


@pytest.mark.parametrize(
    ("stream", "counters", "rejected"),
    [
        (GYRO + info(1) + GYRO, [1], {"unpaired": 1}),
        (info(1) + GYRO + GYRO, [1], {"unpaired": 1}),
        (info(1) + info(2) + GYRO, [2], {}),
        (info(1) + b"t1216000000000000\r" + b"t1008" + b"0" * 16 + b"\r" + GYRO, [1], {}),
        (info(1) + b"t1230\r" + b"T000001206000000000000\r" + GYRO, [1], {"unknown_id": 2}),
        (info(1) + b"t1224640006FF\r" + info(2) + GYRO, [2], {"short_message": 1}),
        (b"t12061234567890AB\r" + GYRO + info(2) + GYRO, [2], {"short_message": 1, "unpaired": 1}),
        (info(1) + b"t12061234567890AB\r" + GYRO, [], {"short_message": 1, "unpaired": 1}),
        (info(1) + b"t1228640006FFE803ABCD\r", [1], {}),
        (info(1) + b"r1226\r" + GYRO, [], {"short_message": 1, "unpaired": 1}),
        (info(1) + b"\xff\r" + GYRO + info(2) + GYRO, [2], {"unknown": 1, "unpaired": 1}),
        (info(1) + b"\r\x07z\rF00\r" + GYRO, [1], {}),
        # A bit of a T or t, and a frame reads like an answer: no less lost than if it did not.
        (info(1) + b"V" + GYRO[1:] + info(2)[:-1] + b"\xff\r" + GYRO, [], {"text": 1, "unpaired": 1}),
        (info(1) + b"N" + GYRO[1:] + b"V" + info(2)[1:] + GYRO + info(3) + GYRO, [3], {"unpaired": 1}),
    ],
)
def test_pairing(stream: bytes, counters: list[int], rejected: dict[str, int]) -> None:
    for size in (len(stream), 7, 1):
        decoder = sbg_decoder(100.0)
        batches = [decoder.feed(stream[at : at + size]) for at in range(0, len(stream), size)]
        assert [int(c) for batch in batches for c in batch.columns["counter"]] == counters
        assert decoder.counts.rejected == rejected
        assert decoder.counts.frames == len(counters)


@pytest.mark.parametrize("seed", range(4))
def test_no_valid_row_of_a_record_with_lost_frames_was_never_sent(tmp_path: Path, seed: int) -> None:
    """Whole lines lost at random, runs of them too: what is left side by side may be of two samples."""
    rng = np.random.default_rng(seed)
    count = 400
    lines = [line for k in range(count) for line in (info(10_000 * k), gyro(k, -k))]
    lost = rng.random(2 * count) < 0.04
    lost |= np.roll(lost, 1) & (rng.random(2 * count) < 0.8)
    port = PortJournal(tmp_path, "imu")
    for at, line in enumerate(lines):
        if not lost[at]:
            port.received(line, 1.0 + 0.01 * (at // 2 + 1))
    port.flush(sync=False)
    source = StreamSource(
        "gyro", "imu", lambda: sbg_decoder(100.0), lambda columns, _: {"rate_dps": columns["rate_x_dps"]}
    )
    report = decode_stream(tmp_path, source)
    table = pq.read_table(tmp_path / "gyro_imu.parquet")
    numbers = np.rint(table["rate_dps"].to_numpy() / DEG * 1000.0).astype(int)
    valid, sent = table["valid"].to_numpy(), table["counter"].to_numpy() // 10_000
    assert (numbers[valid] == sent[valid]).all()
    assert (numbers != sent).any()  # there were some to be found
    whole = ~(lost[0::2] | lost[1::2])
    beside = whole[:-1] & ~whole[1:]
    assert report.lost > 0 and valid.sum() >= whole.sum() - beside.sum() - 1
    assert report.invalid == (~valid).sum()


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.integers(-32768, 32767), min_size=1, max_size=40),
    st.lists(st.integers(0, 2000), max_size=20),
    st.lists(st.tuples(st.integers(0, 1599), st.integers(1, 255)), max_size=4),
)
def test_any_chunking_and_damage_gives_the_same_rows(
    values: list[int], cuts: list[int], damage: list[tuple[int, int]]
) -> None:
    """Flipped bits: the same rows however cut, and every row that was not hit is there and in its own cycle."""
    stream = bytearray(b"".join(info(number) + gyro(value) for number, value in enumerate(values)))
    hit = set()
    for at, flip in damage:
        stream[at % len(stream)] ^= flip
        hit |= {at % len(stream) // 40 + step for step in (-1, 0, 1)}
    whole = sbg_decoder(100.0).feed(bytes(stream))
    decoder = sbg_decoder(100.0)
    edges = [0, *sorted(cut % len(stream) for cut in cuts), len(stream)]
    parts = [decoder.feed(bytes(stream[a:b])) for a, b in itertools.pairwise(edges)]
    for name, column in whole.columns.items():
        np.testing.assert_array_equal(np.concatenate([part.columns[name] for part in parts]), column)
    np.testing.assert_array_equal(np.concatenate([part.end_offset for part in parts]), whole.end_offset)
    rows = dict(zip(whole.end_offset.tolist(), range(len(whole)), strict=True))
    for number, value in enumerate(values):
        if number not in hit:
            row = rows[40 * (number + 1)]
            assert whole.columns["counter"][row] == number
            assert whole.columns["rate_x_dps"][row] == pytest.approx(value * 0.001 * DEG, rel=1e-6)


@pytest.mark.parametrize(("rate_hz", "axes"), [(0.0, "xyz"), (float("nan"), "x"), (100.0, ""), (100.0, "xx")])
def test_impossible_settings_are_refused(rate_hz: float, axes: str) -> None:
    with pytest.raises(ConfigurationError):
        sbg_decoder(rate_hz, axes)


def test_unusable_dbc_files_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="cannot be read"):
        sbg_decoder(100.0, dbc=tmp_path / "missing.dbc")
    (tmp_path / "rubbish.dbc").write_text("not a DBC file")
    with pytest.raises(ConfigurationError, match="cannot be read"):
        sbg_decoder(100.0, dbc=tmp_path / "rubbish.dbc")
    (tmp_path / "other.dbc").write_text(
        'VERSION ""\nBU_: A\nBO_ 1 M: 64 A\n SG_ S : 0|64@1+ (1,0) [0|0] "" A\n'
    )
    with pytest.raises(ConfigurationError, match="no message SBG_ECAN_MSG"):
        sbg_decoder(100.0, dbc=tmp_path / "other.dbc")
    with pytest.raises(ConfigurationError, match="not supported"):
        compile_message(find_message(tmp_path / "other.dbc", "M"))


class StillClock(WallClock):
    """A clock that moves only when somebody waits."""

    time_s = 0.0

    def now(self) -> float:
        return self.time_s

    def wait_for(self, port: object, deadline_s: float) -> bool:
        self.time_s = deadline_s
        return False


class Terminal:
    """The far end of a pseudo-terminal."""

    def __init__(self) -> None:
        self.master, self.slave = pty.openpty()
        tty.setraw(self.slave)
        self.path = os.ttyname(self.slave)


class Recorder:
    def __init__(self) -> None:
        self.blocks: list[tuple[bytes, float]] = []

    def received(self, data: bytes, arrival_s: float) -> None:
        self.blocks.append((data, arrival_s))

    def sent(self, data: bytes, time_s: float) -> None:
        pass


@pytest.fixture
def terminal() -> Iterator[Terminal]:
    terminal = Terminal()
    yield terminal
    os.close(terminal.slave)
    os.close(terminal.master)


@pytest.fixture
def unit(terminal: Terminal) -> Iterator[CanGyro]:
    clock = StillClock()
    bus = BufferedSlcanBus(terminal.path, clock=clock, name="gyro")
    yield CanGyro(bus, bus.link, CanDecoder(ellipse_layout(), 100.0))
    bus.shutdown()
    clock.close()


@pytest.mark.concurrent
def test_identify_hears_the_unit(unit: CanGyro) -> None:
    unit.link.deliver(b"\r\r6FFE803\r" + info(1) + GYRO, 0.0)
    identity = unit.identify()
    assert (identity.maker, identity.model) == ("SBG Systems", "Ellipse")
    assert identity.details["identifiers"] == "0x120, 0x122"


@pytest.mark.concurrent
def test_identify_names_what_it_hears_instead(unit: CanGyro) -> None:
    unit.link.deliver(b"t0051AA\rT18F009000\r" + info(1), 0.0)
    with pytest.raises(WrongDevice, match="identifiers 0x005, 0x120, 0x18F00900") as caught:
        unit.identify()
    assert "0x120, 0x122" in caught.value.expected
    assert unit.link.clock.now() == 5.0


@pytest.mark.concurrent
def test_identify_of_a_silent_bus(unit: CanGyro) -> None:
    with pytest.raises(DeviceSilent, match="nothing"):
        unit.identify()
    unit.link.deliver(b"\x07\r", 5.0)
    with pytest.raises(DeviceSilent, match="x07"):
        unit.identify()


@pytest.mark.concurrent
def test_start_hands_the_link_to_the_stream(unit: CanGyro) -> None:
    unit.link.deliver(info(1) + GYRO, 0.0)
    unit.start()
    unit.link.deliver(info(2) + GYRO, 0.0)
    assert unit.link.streaming
    assert unit.link.discard() == b""
    unit.stop()


@pytest.mark.concurrent
def test_the_kind_that_a_bench_file_names(terminal: Terminal) -> None:
    section = CanConfig.adapter().validate_python(
        {
            "name": "mems_1",
            "driver": "sbg_ellipse",
            "unit": "1",
            "axis": "z",
            "interface": "gyrobench_slcan",
            "channel": terminal.path,
            "bitrate": 250_000,
            "rate_hz": 50.0,
            "axes": "xz",
        }
    )
    clock, tap = StillClock(), Recorder()
    gyro_device = SbgEllipse.open(section, Connection("mems_1", clock, tap))
    assert read_exactly(terminal.master, 7) == b"C\rS5\rO\r"
    gyro_device.start()
    gyro_device.link.deliver(info(20_000) + GYRO, 1.5)
    assert tap.blocks == [(info(20_000) + GYRO, 1.5)]
    decoder = SbgEllipse.decoder(section)
    assert decoder.counter_step == 20_000.0
    columns = decoder.feed(tap.blocks[0][0]).columns
    rates = SbgEllipse.rates(section, columns, 49.9)
    assert list(rates) == ["x", "z"]
    assert rates["z"][0] == pytest.approx(DEG)
    gyro_device.link.close()
    clock.close()
