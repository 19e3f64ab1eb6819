"""Emulated KVH gyro: its bytes read by a struct decoder of this file, its times and texts by the document."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base.errors import ConfigurationError
from simulators.emulators.kvh import KvhEmulator
from simulators.interfaces import GyroSignal

SLOW_PPM = 1e6 * (1.0 / 1.01 - 1.0)
"""A clock that takes 1.01 s to count a second."""


@dataclass
class RampPlant:
    """A gyro whose rate is its time: sample k of any chunking is the integral of t rad/s over its interval."""

    axes: str = "x"
    temp_c: float = 21.37
    calls: list[tuple[float, int, float]] = field(default_factory=list)

    def measure(self, start_s: float, count: int, period_s: float) -> GyroSignal:
        self.calls.append((start_s, count, period_s))
        middle_s = start_s + (np.arange(count) + 0.5) * period_s
        angle = np.outer(middle_s * period_s, 1.0 + np.arange(len(self.axes)))
        return GyroSignal(self.axes, angle, np.full(count, self.temp_c))


@dataclass(frozen=True)
class Message:
    """One message taken apart by struct, its CRC checked bit by bit."""

    rot: tuple[float, ...]
    status: int
    counter: int
    temp: float
    timestamp_us: int = 0


def crc_residue(data: bytes) -> int:
    register = 0xFFFFFFFF
    for byte in data:
        register ^= byte << 24
        for _ in range(8):
            register = ((register << 1) ^ (0x104C11DB7 if register >> 31 else 0)) & 0xFFFFFFFF
    return register


def parse(data: bytes) -> list[Message]:
    """Messages end to end, any format; built-in-test messages between them are checked and left out."""
    found: list[Message] = []
    while data:
        head = data[:4].hex().upper()
        if head in ("FE8100AA", "FE8100AB"):
            size = 11 if head == "FE8100AA" else 13
            assert data[size - 1] == sum(data[: size - 1]) % 256
            data = data[size:]
            continue
        size = {"FE81FF55": 36, "FE81FF56": 40, "FE81FF57": 38}[head]
        assert crc_residue(data[:size]) == 0
        rot = struct.unpack(">3f", data[4:16])
        if size == 36:
            status, counter, temp = struct.unpack(">BBh", data[28:32])
            found.append(Message(rot, status, counter, temp))
        elif size == 40:
            timestamp, status, counter, temp = struct.unpack(">IBBh", data[28:36])
            found.append(Message(rot, status, counter, temp, timestamp))
        else:
            temp, status, counter = struct.unpack(">fBB", data[28:34])
            found.append(Message(rot, status, counter, temp))
        data = data[size:]
    return found


def made(plant: RampPlant | None = None, **keywords: object) -> KvhEmulator:
    return KvhEmulator(plant or RampPlant(), **{"serial_number": "0140-17", **keywords})  # type: ignore[arg-type]  # kinds vary


def say(gyro: KvhEmulator, text: str, now_s: float = 0.0) -> str:
    """Send one line; return the replies as text, line end left out."""
    return b"".join(reply.data for reply in gyro.receive(text.encode() + b"\r\n", now_s)).decode().rstrip()


def started(plant: RampPlant | None = None, *commands: str, **keywords: object) -> tuple[KvhEmulator, float]:
    """A unit configured with `commands` and let loose at 1 s: it, and when its sampling began."""
    gyro = made(plant, **keywords)
    for command in ("=DR,100", *commands):
        assert say(gyro, command) == command[1:]
    (reply,) = gyro.receive(b"=CONFIG,0\r\n", 1.0)
    assert reply.data == b"CONFIG,0\r\n"
    return gyro, reply.at_s


def test_a_stream_is_what_struct_says_it_is() -> None:
    plant = RampPlant()
    gyro, begin_s = started(plant, "=TEMPUNITS,C_100")
    block = gyro.stream(4.0)
    assert block is not None
    messages = parse(block.data)
    assert len(messages) == 299  # Samples complete from begin + 0.01 s on; begin is just after 1 s.
    assert [message.counter for message in messages] == [n % 128 for n in range(299)]
    assert {message.temp for message in messages} == {2137}
    for n, message in enumerate(messages[2:], 2):
        angle = (begin_s + (n + 0.5) * 0.01) * 0.01
        assert message.rot == pytest.approx((angle, 0.0, 0.0), rel=1e-6)
        assert message.status == 0x77


def test_two_messages_after_a_change_of_rate_are_invalid() -> None:
    gyro, _ = started()
    block = gyro.stream(2.0)
    assert block is not None
    assert [message.status for message in parse(block.data)][:4] == [0, 0, 0x77, 0x77]
    say(gyro, "=CONFIG,1", 2.0)
    assert say(gyro, "=DR,100", 2.1) == "DR,100"  # No change.
    say(gyro, "=CONFIG,0", 2.1)
    block = gyro.stream(3.0)
    assert block is not None
    assert {message.status for message in parse(block.data)} == {0x77}


def test_marks_are_the_times_of_last_bytes() -> None:
    gyro, begin_s = started(baudrate=115200, clock_error_ppm=SLOW_PPM)
    block = gyro.stream(4.5)
    assert block is not None
    count, time_ns = block.marks[:, 0], block.marks[:, 1]
    assert block.marks.dtype == np.int64
    assert count[-1] == len(block.data)
    assert (count % 36 == 0).all()
    assert (np.diff(time_ns, prepend=round(begin_s * 1e9)) <= 1_000_000_000).all()
    expected_s = begin_s + count / 36 * 0.0101 + 360 / 115200  # 1 % slow clock, then 36 bytes of 10 bits.
    np.testing.assert_allclose(time_ns * 1e-9, expected_s, atol=2e-9)
    assert time_ns[-1] <= 4.5e9 < time_ns[-1] + 0.0101e9


def test_slow_clock_measures_longer_intervals() -> None:
    plant = RampPlant()
    gyro, begin_s = started(plant, "=ROTFMT,RATE", "=ROTUNITS,DEG", clock_error_ppm=SLOW_PPM)
    block = gyro.stream(3.0)
    assert block is not None
    assert plant.calls[0] == pytest.approx((begin_s, len(parse(block.data)), 0.0101), rel=1e-12)
    assert parse(block.data)[10].rot[0] == pytest.approx(np.degrees(begin_s + 10.5 * 0.0101), rel=1e-6)


@given(steps=st.lists(st.floats(0.0, 0.3), min_size=1, max_size=40))
@settings(max_examples=40, deadline=None)
def test_stream_does_not_depend_on_how_it_is_asked_for(steps: list[float]) -> None:
    def run(times: list[float]) -> tuple[bytes, dict[int, int]]:
        gyro, begin_s = started(None, "=OUTPUTFMT,B")
        gyro.receive(b"?BIT\r\n", begin_s)
        data = b""
        marks: dict[int, int] = {}
        for time in times:
            block = gyro.stream(time)
            if block is not None:
                assert block.marks[-1, 1] <= time * 1e9 + 1
                assert block.marks[-1, 0] == len(block.data)
                marks |= {len(data) + int(at): int(when) for at, when in block.marks}
                data += block.data
        return data, marks

    times = (1.0 + np.cumsum(steps)).tolist()
    data, marks = run(times)
    whole, whole_marks = run(times[-1:])
    assert data == whole
    assert all(marks[at] == when for at, when in whole_marks.items() if at in marks)


def test_unit_s_own_axes_go_to_their_places() -> None:
    gyro, begin_s = started(RampPlant(axes="xyz"), axes="xyz")
    block = gyro.stream(2.0)
    assert block is not None
    angle = (begin_s + 5.5 * 0.01) * 0.01
    assert parse(block.data)[5].rot == pytest.approx((angle, 2 * angle, 3 * angle), rel=1e-6)
    only_y, begin_s = started(RampPlant(axes="xyz"), axes="y")
    block = only_y.stream(2.0)
    assert block is not None
    assert parse(block.data)[5].rot == pytest.approx((0.0, 2 * angle, 0.0), rel=1e-6)


def test_format_b_stamps_with_its_own_clock() -> None:
    gyro, begin_s = started(None, "=OUTPUTFMT,B", clock_error_ppm=SLOW_PPM)
    block = gyro.stream(3.0)
    assert block is not None
    stamps = np.array([message.timestamp_us for message in parse(block.data)])
    assert set(np.diff(stamps).tolist()) == {10000}  # The unit believes in its clock.
    assert stamps[0] == pytest.approx(begin_s / 1.01 * 1e6 + 10000, abs=1)


def test_format_c_sends_temperature_every_fourth_message() -> None:
    gyro, _ = started(None, "=OUTPUTFMT,C", "=TEMPUNITS,F")
    block = gyro.stream(2.0)
    assert block is not None
    for message in parse(block.data):
        fahrenheit = 21.37 * 1.8 + 32 if message.counter % 4 == 0 else 0.0
        assert message.temp == pytest.approx(fahrenheit, rel=1e-6)


def test_configuration_mode_stops_the_output_behind_what_is_on_its_way() -> None:
    gyro, begin_s = started()
    stop_s = begin_s + 0.1 + 1e-4  # Sample 10 is complete and still being sent.
    tail, answer = gyro.receive(b"=config,1\r", stop_s)
    assert len(parse(tail.data)) == 10
    assert tail.at_s == pytest.approx(begin_s + 0.1 + 360 / 921600, abs=2e-9)
    assert answer.data == b"CONFIG,1\r\n"
    assert answer.at_s > tail.at_s
    assert gyro.stream(5.0) is None
    gyro.receive(b"=CONFIG,0\r\n", 6.0)
    block = gyro.stream(7.0)
    assert block is not None
    assert parse(block.data)[0].counter == 10


def test_normal_mode_ignores_all_but_configuration_and_built_in_test() -> None:
    gyro, begin_s = started()
    for line in (
        b"=DR,10\r\n",
        b"?IS\r\n",
        b"nonsense\r\n",
        b"\xff\x00\r\n",
        b"=CONFIG,0\r\n",
        b"=RESTART\r\n",
    ):
        assert gyro.receive(line, begin_s) == []
    assert gyro.receive(b"?BIT\r\n", begin_s + 0.035) == []
    assert gyro.receive(b"", begin_s + 0.036) == []
    block = gyro.stream(2.0)
    assert block is not None
    bit = bytes.fromhex("FE8100AA 7F7F7F7F7F7F 23")
    assert block.data.index(bit) == 4 * 36  # Behind the first message completed after the question.
    assert block.data[-1:] != b""
    assert len(parse(block.data)) == 99


def test_switched_on_it_streams_behind_a_built_in_test_message() -> None:
    gyro = made(streaming=True, settings={"DR": "250"})
    block = gyro.stream(1.0)
    assert block is not None
    assert block.data[:11] == bytes.fromhex("FE8100AA 7F7F7F7F7F7F 23")
    assert [message.status for message in parse(block.data)] == [0x77] * 249
    assert block.marks[0].tolist() == [11, round(110 / 921600 * 1e9)]
    assert made().stream(1.0) is None
    slow = made(baudrate=115200, streaming=True)
    block = slow.stream(1.0)
    assert block is not None
    assert len(parse(block.data)) == 99  # At 250 Hz 36 + 13 bytes of 10 bits are 122,500 bit/s.


def test_restart_goes_to_normal_mode() -> None:
    gyro = made()
    assert say(gyro, "=RESTART") == "RESTART"
    block = gyro.stream(3.0)
    assert block is not None
    assert block.data[:4] == bytes.fromhex("FE8100AA")
    assert parse(block.data)[0].counter == 0


def test_external_synchronisation_without_a_signal_is_silence() -> None:
    gyro, _ = started(None, "=MSYNC,EXT")
    assert gyro.stream(10.0) is None


@pytest.mark.parametrize(
    ("line", "reply"),
    [
        ("=CONFIG,1", "CONFIG,1"),
        ("=config,2", "USAGE,=CONFIG,<0|1>"),
        ("?is", "IS,0140-17"),
        ("?WS", "WS,GYROBENCH 1.0"),
        ("?DR", "DR,1000"),
        ("=DR,250", "DR,250"),
        ("=DR,200", "USAGE,=DR,<1|5|10|25|50|100|250|500|750|1000|3600|5000>"),
        ("=DR", "USAGE,=DR,<1|5|10|25|50|100|250|500|750|1000|3600|5000>"),
        ("=DR,5000", "ERROR,5000 HZ DOES NOT FIT 921600 BD"),
        ("=BAUD,9600", "ERROR,1000 HZ DOES NOT FIT 9600 BD"),
        ("=BAUD,4147200", "BAUD,4147200"),
        ("=ROTFMT,RESET", "ROTFMT,RESET"),
        ("=rotunits,deg", "ROTUNITS,DEG"),
        ("=TEMPUNITS,K", "USAGE,=TEMPUNITS,<C|C_100|F|F_100>"),
        ("=OUTPUTFMT,B", "OUTPUTFMT,B"),
        ("=FILTTYPE,G,AVE", "FILTTYPE,G,AVE"),
        ("=FILTTYPE,G", "USAGE,=FILTTYPE,<A|G>,<CHEBY|BUTTER|AVE>"),
        ("?FILTTYPE,A", "FILTTYPE,A,BUTTER"),
        ("?FILTTYPE", "USAGE,?FILTTYPE,<A|G>"),
        ("=RSTCFG", "RSTCFG"),
        ("Hello,You", "INVALID,Hello,You"),
        ("?IS,3", "INVALID,?IS,3"),
    ],
)
def test_configuration_mode_replies(line: str, reply: str) -> None:
    assert say(made(), line) == reply


def test_settings_are_kept_and_reset_but_for_the_baud_rate() -> None:
    gyro = made()
    for command in ("=DR,500", "=BAUD,460800", "=FILTTYPE,A,CHEBY", "=ECHO,1"):
        say(gyro, command)
    assert say(gyro, "?FILTTYPE,A") == "?FILTTYPE,A\r\nFILTTYPE,A,CHEBY"
    assert say(gyro, "=RSTCFG").endswith("RSTCFG")
    assert say(gyro, "?DR") == "DR,1000"
    assert say(gyro, "?BAUD") == "BAUD,460800"
    assert say(gyro, "=CONFIG,0") == "ERROR,1000 HZ DOES NOT FIT 460800 BD"
    assert gyro.stream(10.0) is None


def test_temperature_query_asks_the_plant() -> None:
    plant = RampPlant(temp_c=-12.3456)
    gyro = made(plant)
    assert say(gyro, "?TEMP") == "ERROR,NO TEMPERATURE YET"
    assert say(gyro, "?TEMP", 7.0) == "TEMP,-12"
    say(gyro, "=TEMPUNITS,C_100", 7.0)
    assert say(gyro, "?TEMP", 8.0) == "TEMP,-1235"
    say(gyro, "=CONFIG,0", 9.0)
    gyro.stream(9.9995)
    say(gyro, "=CONFIG,1", 9.9995)
    assert say(gyro, "?TEMP", 9.9998) == "TEMP,-1235"
    spans = np.array([(start, start + count * period) for start, count, period in plant.calls])
    assert len(spans) == 4
    assert (np.diff(spans.ravel()) > -1e-9).all()  # Time never goes back for the plant, no interval twice.
    assert spans[0, 0] >= 0.0
    assert spans[-1, 1] == pytest.approx(9.9998)


def test_replies_take_time_and_come_one_behind_the_other() -> None:
    gyro = made(baudrate=9600, settings={"DR": "1"})
    replies = gyro.receive(b"?IS\r\n?DR\r?WS\n", 5.0)
    assert [reply.data for reply in replies] == [b"IS,0140-17\r\n", b"DR,1\r\n", b"WS,GYROBENCH 1.0\r\n"]
    times = [reply.at_s for reply in replies]
    assert times[0] >= 5.0 + 120 / 9600
    assert np.diff(times).tolist() == pytest.approx([60 / 9600, 180 / 9600])


@given(data=st.binary(max_size=200), cuts=st.lists(st.integers(1, 30), min_size=1, max_size=5))
@settings(max_examples=60, deadline=None)
def test_command_bytes_may_come_in_any_chunks(data: bytes, cuts: list[int]) -> None:
    text = data.replace(b"\x01", b"\r").replace(b"\x02", b"=DR,50\r\n") + b"\r\n?DR\r\n"
    whole = b"".join(reply.data for reply in made().receive(text, 0.0))
    gyro, got, at, turn = made(), b"", 0, 0
    while at < len(text):
        size = cuts[turn % len(cuts)]
        got += b"".join(reply.data for reply in gyro.receive(text[at : at + size], 0.0))
        at, turn = at + size, turn + 1
    assert got == whole


@pytest.mark.parametrize(
    "wrong",
    [
        {"baudrate": 1234},
        {"axes": "z"},
        {"settings": {"DR": "7"}},
        {"settings": {"X": ""}},
        {"baudrate": 9600, "settings": {"DR": "100"}, "streaming": True},
    ],
)
def test_a_unit_that_does_not_exist_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigurationError, match="no such KVH unit"):
        made(**wrong)  # type: ignore[arg-type]  # kinds vary


def test_built_in_test_message_waits_until_it_is_out() -> None:
    gyro, begin_s = started()
    gyro.receive(b"?BIT,2\r\n", begin_s + 0.005)
    first = gyro.stream(begin_s + 0.01 + 361 / 921600)  # 36 bytes of 10 bits are out, 13 more are not.
    second = gyro.stream(begin_s + 0.01 + 491 / 921600)
    assert first is not None
    assert second is not None
    assert len(first.data) == 36
    assert second.data == bytes.fromhex("FE8100AB 7F7F7F7F7F7F7F7F 22")
    assert second.marks.tolist() == [[13, pytest.approx((begin_s + 0.01 + 490 / 921600) * 1e9, abs=2)]]
