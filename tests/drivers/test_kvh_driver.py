"""KvhGyro against the emulated unit over a link in memory, and against devices that are not one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from drivers.base.errors import BenchError, ConfigurationError, DeviceRefused, DeviceSilent, WrongDevice
from drivers.kvh import Kvh1750, KvhDecoder, encode_frames, rate_dps
from drivers.kvh._driver import KvhGyro
from simulators.emulators.kvh import KvhEmulator
from simulators.interfaces import Emulator
from tests.memory_link import Fake, MemoryLink, OpenConnection, TurningPlant

FRAMES = encode_frames("A", np.full((50, 3), 1e-4), counter=np.arange(50), temp_c=20.0)


def connected(
    rate_hz: float = 100.0, *, device: Emulator | None = None, **keywords: object
) -> tuple[KvhGyro, MemoryLink]:
    link = MemoryLink(device or KvhEmulator(TurningPlant(), serial_number="0140-17", streaming=True))
    keys: dict[str, Any] = {
        "name": "g",
        "driver": "kvh1750",
        "unit": "1",
        "axis": "x",
        "rate_hz": rate_hz,
        **keywords,
    }
    return KvhGyro(Kvh1750.config(**keys), OpenConnection(link)), link


def test_a_query_whose_answer_was_damaged_is_asked_again() -> None:
    answers = {b"=CONFIG,1": b"CONFIG,1", b"?IS": b"IS,0140", b"?WS": b"WS,2.1", b"?DR": b"DR,100"}
    answers[b"?OUTPUTFMT"] = b"OUTPUTFMT,A"
    asked: list[bytes] = []

    def damaged_once(line: bytes) -> bytes:
        asked.append(line.strip())
        answer = answers[line.strip()]
        return (answer.replace(b"WS", b"WQ") if asked.count(b"?WS") == 1 else answer) + b"\r\n"

    gyro, _ = connected(device=Fake(damaged_once))
    assert gyro.identify().firmware == "2.1"
    assert asked.count(b"?WS") == 2 and asked.count(b"?IS") == 1


def test_identify_finds_the_replies_among_streaming_messages() -> None:
    gyro, link = connected()
    link.sleep(0.055)
    identity = gyro.identify()
    assert len(link.raw) > 55 * 36  # It did stream.
    assert (identity.maker, identity.serial_number, identity.firmware) == ("KVH", "0140-17", "GYROBENCH 1.0")
    assert identity.details["DR"] == "1000"
    quiet = len(link.raw)
    link.sleep(1.0)
    assert len(link.raw) == quiet


def test_start_configures_and_streams_and_stop_stops() -> None:
    gyro, link = connected()
    gyro.identify()
    asked = len(link.sent)
    gyro.start()
    assert link.sent[asked:].split(b"\r\n") == [
        b"=CONFIG,1",
        b"=MSYNC,IMU",
        b"=DR,100",
        b"=OUTPUTFMT,A",
        b"=ROTFMT,DELTA",
        b"=ROTUNITS,RAD",
        b"=TEMPUNITS,C_100",
        b"=CONFIG,0",
        b"",
    ]
    assert link.streaming
    begin, begin_s = len(link.raw), link.now()
    link.sleep(3.0)
    assert not link._buffer
    assert len(link.raw) - begin == pytest.approx(300 * 36, abs=36)
    decoder = KvhDecoder(nominal_rate_hz=100.0)
    columns = decoder.feed(link.raw[begin:]).columns
    rate = rate_dps(columns["rot_x"], "delta", "RAD", 100.0)
    np.testing.assert_allclose(rate[columns["valid"]], 10.0, rtol=1e-6)
    assert columns["valid"].tolist() == [False, False] + [True] * (len(rate) - 2)
    np.testing.assert_allclose(columns["temp_c"], 30.0, rtol=1e-6)
    gyro.stop()
    assert not link.streaming
    stopped = len(link.raw)
    link.sleep(1.0)
    assert len(link.raw) == stopped
    assert link.now() - begin_s == pytest.approx(4.0, abs=0.1)


@pytest.mark.parametrize("frame_format", ["A", "B", "C"])
def test_decoder_reads_what_start_configured(frame_format: str) -> None:
    unit = KvhEmulator(TurningPlant(axes="xz"), serial_number="1", axes="xz")
    gyro, link = connected(250, device=unit, frame_format=frame_format, axes="xz")
    gyro.start()
    begin = len(link.raw)
    link.sleep(1.0)
    decoder = KvhDecoder(nominal_rate_hz=250.0, frame_format=frame_format, axes="xz")  # type: ignore[arg-type]  # a word of the parameters
    assert (decoder.counter_modulo, decoder.counter_step, decoder.nominal_rate_hz) == (128, 1.0, 250.0)
    columns = decoder.feed(link.raw[begin:]).columns
    assert len(columns["counter"]) == pytest.approx(250, abs=2)
    for axis in "xz":
        rate = rate_dps(columns[f"rot_{axis}"], "delta", "RAD", 250.0)
        np.testing.assert_allclose(rate[2:], 10.0, rtol=1e-6)
    sent = columns["temp_c"][columns["counter"] % 4 == 0]
    np.testing.assert_allclose(sent, 30.0, atol=1e-3)


def test_unit_that_echoes_every_line_is_understood() -> None:
    unit = KvhEmulator(TurningPlant(), serial_number="7", settings={"ECHO": "1"})
    gyro, _ = connected(device=unit)
    assert gyro.identify().serial_number == "7"
    gyro.start()


def test_half_a_line_left_in_the_unit_is_overcome() -> None:
    unit = KvhEmulator(TurningPlant(), serial_number="7")
    unit.receive(b"=DR,2", 0.0)
    gyro, link = connected(device=unit)
    assert gyro.identify().serial_number == "7"
    assert link.sent.count(b"=CONFIG,1") == 2


def test_nothing_on_the_line_is_silence_and_takes_a_bounded_time() -> None:
    gyro, link = connected(device=Fake(lambda line: b""))
    with pytest.raises(DeviceSilent, match="nothing on the line"):
        gyro.identify()
    assert link.now() < 5.0


def test_gyro_that_streams_but_does_not_listen_is_named_so() -> None:
    gyro, link = connected(device=Fake(lambda line: FRAMES))
    with pytest.raises(DeviceSilent, match="streams but does not answer =CONFIG,1"):
        gyro.identify()
    assert link.now() < 5.0


def test_other_device_is_wrong_and_shown() -> None:
    gyro, _ = connected(device=Fake(lambda line: b"STIM300 rev C\r\n"))
    with pytest.raises(WrongDevice, match="STIM300 rev C"):
        gyro.identify()


def test_line_echo_alone_is_no_answer() -> None:
    """A loop-back plug returns the command with its '='."""
    gyro, _ = connected(device=Fake(lambda line: line))
    with pytest.raises(WrongDevice, match="=CONFIG,1"):
        gyro.identify()


def test_empty_serial_number_is_not_a_kvh_gyro() -> None:
    gyro, _ = connected(
        device=Fake(lambda line: line[1:].replace(b"\r\n", b",\r\n") if line[:1] == b"?" else line[1:])
    )
    with pytest.raises(WrongDevice, match="serial number"):
        gyro.identify()


@pytest.mark.parametrize("refusal", [b"INVALID,=TEMPUNITS,C_100", b"USAGE,=TEMPUNITS,<C|F>", b"ERROR,no"])
def test_refusal_is_reported_in_the_unit_s_words(refusal: bytes) -> None:
    gyro, link = connected(device=Fake(lambda line: refusal + b"\r\n" if b"TEMP" in line else line[1:]))
    with pytest.raises(DeviceRefused) as caught:
        gyro.start()
    assert refusal.decode() in str(caught.value)
    assert "=TEMPUNITS,C_100" in str(caught.value)
    assert not link.streaming


def test_wrong_echo_is_not_a_confirmation() -> None:
    """A unit that answers another rate than the one demanded."""
    gyro, _ = connected(device=Fake(lambda line: line[1:].replace(b"DR,100", b"DR,1000")))
    with pytest.raises(BenchError, match="=DR,100"):
        gyro.start()


def test_reply_behind_binary_bytes_without_a_line_end_is_found() -> None:
    told = {
        b"=CONFIG,1": b"CONFIG,1\r",
        b"?IS": b"IS,9\r",
        b"?WS": b"WS,2.1\n",
        b"?DR": b"DR,5\r",
        b"?OUTPUTFMT": b"OUTPUTFMT,A\r",
    }
    gyro, _ = connected(device=Fake(lambda line: FRAMES[:100] + told[line.strip()]))
    identity = gyro.identify()
    assert dict(identity.details) == {"IS": "9", "WS": "2.1", "DR": "5", "OUTPUTFMT": "A"}


def test_data_rate_that_the_baud_rate_does_not_carry_is_refused() -> None:
    unit = KvhEmulator(TurningPlant(), serial_number="1", baudrate=115200)
    with pytest.raises(DeviceRefused, match="1000 HZ DOES NOT FIT 115200 BD"):
        connected(1000, device=unit)[0].start()


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"rate_hz": 200}, "DR,200"),
        ({"rate_hz": 99.5}, "DR,99.5"),
        ({"frame_format": "D"}, "OUTPUTFMT,D"),
    ],
)
def test_impossible_configuration_is_refused_before_a_byte_is_sent(
    wrong: dict[str, object], named: str
) -> None:
    with pytest.raises(ConfigurationError, match=named):
        connected(**wrong)  # type: ignore[arg-type]  # kinds vary


def test_kind_decodes_and_converts_what_the_driver_configures() -> None:
    """The bench decodes a record without a port: its decoder must mean what the driver's settings mean."""
    section = Kvh1750.config(
        name="g",
        driver="kvh1750",
        unit="1",
        rate_hz=250.0,
        frame_format="B",
        axes="xz",
        axis="z",
    )
    unit = KvhEmulator(TurningPlant(axes="xz"), serial_number="1", axes="xz", clock_error_ppm=10000.0)
    gyro, link = connected(250.0, device=unit, frame_format="B", axes="xz")
    gyro.start()
    begin = len(link.raw)
    link.sleep(2.0)
    decoder = Kvh1750.decoder(section)
    assert (decoder.counter_modulo, decoder.counter_step, decoder.nominal_rate_hz) == (128, 1.0, 250.0)
    columns = decoder.feed(link.raw[begin:]).columns
    rates = Kvh1750.rates(section, columns, 250.0 * 1.01)
    assert set(rates) == {"x", "z"}
    np.testing.assert_allclose(rates["z"][columns["valid"]], 10.0, rtol=1e-6)
    np.testing.assert_allclose(columns["temp_c"], 30.0, atol=1e-3)
