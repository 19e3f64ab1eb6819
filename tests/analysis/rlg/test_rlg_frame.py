"""The ring laser's frame: bytes written out by hand, CRC by the standard library, driver and emulator on them."""

from __future__ import annotations

import binascii
import dataclasses
import os
import pty
import struct
import tty
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base.clock import WallClock
from drivers.base.errors import ConfigurationError, DeviceSilent, WrongDevice
from drivers.frames import FrameEncoder, load_family
from drivers.frames._kind import FrameGyro
from drivers.kit.kinds import Connection
from drivers.rlg import Rlg2t
from simulators.emulators.frames import FrameEmulator
from simulators.interfaces import GyroSignal
from tests.memory_link import OpenConnection

LENGTH = 15
SECTION = Rlg2t.config(name="rlg_1", driver="rlg2t", unit="1", axis="x", rate_hz=10.0, baudrate=115200)


def frame(increment: int, case: int, block: int, counter: int, status: int = 3) -> bytes:
    """EB 90, i32 0.001 arcsec, i16 and i16 0.01 degC, u16, u8, CRC-CCITT from FFFF: by struct and binascii."""
    body = struct.pack(">ihhHB", increment, case, block, counter, status)
    return b"\xeb\x90" + body + struct.pack(">H", binascii.crc_hqx(body, 0xFFFF))


def test_the_frame_is_the_documented_one() -> None:
    # 15.041067 deg/h over 0.1 s is 1.504107 arcsec.
    values = {
        "increment": [1.5041067, -0.5],
        "case_temp": [-40.0, 65.0],
        "block_temp": [25.13, -0.01],
        "counter": [65535, 65536],
    }
    sent = FrameEncoder(load_family("rlg2t")).encode(2, values)
    assert sent == frame(1504, -4000, 2513, 65535) + frame(-500, 6500, -1, 0)
    assert frame(0, 0, 0, 0)[:2].hex() == "eb90" and binascii.crc_hqx(b"123456789", 0xFFFF) == 0x29B1
    assert len(sent) == 2 * LENGTH == 30


def test_what_does_not_fit_saturates() -> None:
    values = {"increment": 1e9, "case_temp": 400.0, "block_temp": -400.0, "counter": 1}
    sent = FrameEncoder(load_family("rlg2t")).encode(1, values)
    assert sent == frame(2**31 - 1, 32767, -32768, 1)


@settings(max_examples=60, deadline=None)
@given(st.data())
def test_any_chunks_noise_and_damage_give_the_sound_frames(data: st.DataObject) -> None:
    count = data.draw(st.integers(1, 8))
    values = data.draw(st.lists(st.integers(-(2**31), 2**31 - 1), min_size=count, max_size=count))
    frames = [frame(value, 100 * k, -k, k) for k, value in enumerate(values)]
    broken = data.draw(st.sets(st.integers(0, count - 1)))
    stream = b""
    for k, sound in enumerate(frames):
        if k in broken:
            bit = data.draw(st.integers(16, 8 * LENGTH - 1))  # one flipped bit behind the sync word
            number = int.from_bytes(sound, "big") ^ (1 << (8 * LENGTH - 1 - bit))
            sound = number.to_bytes(LENGTH, "big")
        stream += data.draw(st.binary(max_size=4).filter(lambda noise: b"\xeb" not in noise)) + sound
    decoder, counters = Rlg2t.decoder(SECTION), []
    while stream:
        size = data.draw(st.integers(1, 40))
        batch = decoder.feed(stream[:size])
        counters += list(zip(batch.columns["counter"], batch.columns["increment"], strict=True))
        stream = stream[size:]
    expected = [(k, values[k] * 1e-3) for k in range(count) if k not in broken]
    assert [k for k, _ in counters] == [k for k, _ in expected]
    assert np.allclose([value for _, value in counters], [value for _, value in expected], rtol=1e-12)


def test_columns_and_rates() -> None:
    decoder = Rlg2t.decoder(SECTION)
    batch = decoder.feed(frame(1504, -4000, 2513, 7) + frame(0, 0, 0, 8, status=1))
    assert batch.columns["case_temp_c"].tolist() == pytest.approx([-40.0, 0.0])
    assert batch.columns["temp_c"].tolist() == pytest.approx([25.13, 0.0], abs=1e-5)
    assert batch.columns["valid"].tolist() == [True, False]
    rate = Rlg2t.rates(SECTION, batch.columns, 10.0)["x"]
    assert 3600 * rate[0] == pytest.approx(15.04, abs=1e-9)  # arcsec/s is deg/h


class Plant:
    """Turns at 3.6 deg/h (1e-3 deg/s); both temperatures tell the time."""

    axes = "x"

    def measure(self, start_s: float, count: int, period_s: float) -> GyroSignal:
        end_s = start_s + period_s * np.arange(1, count + 1)
        return GyroSignal("x", np.full((count, 1), np.radians(1e-3) * period_s), 20.0 + end_s)

    def case_reading_c(self, now_s: float) -> float:
        return -now_s


def emulated(**settings: float) -> FrameEmulator:
    return FrameEmulator(Plant(), load_family("rlg2t"), axes="x", **settings)  # type: ignore[arg-type]


def test_the_emulator_sends_samples_when_they_are_out() -> None:
    emulator = emulated(rate_hz=10.0, baudrate=9600, clock_error_ppm=100.0)
    period_s, send_s = 0.1 / (1 + 1e-4), LENGTH * 10 / 9600
    assert emulator.stream(period_s + send_s - 1e-6) is None
    block = emulator.stream(2.0)
    assert block is not None
    count = len(block.data) // LENGTH
    assert count == int((2.0 - send_s) / period_s)
    assert block.marks[-1].tolist() == [len(block.data), round((count * period_s + send_s) * 1e9)]
    assert (np.diff(block.marks[:, 1]) > 0).all() and len(block.marks) >= 4
    first = frame(round(3.6 * period_s * 1e3), -10, 2010, 0)
    assert block.data.startswith(first)
    batch = Rlg2t.decoder(SECTION).feed(block.data)
    assert batch.columns["counter"].tolist() == list(range(count))
    assert batch.columns["case_temp_c"][-1] == pytest.approx(-count * period_s, abs=0.006)


def test_cuts_of_time_do_not_change_the_bytes() -> None:
    whole = emulated(rate_hz=10.0, baudrate=9600).stream(9.0)
    other = emulated(rate_hz=10.0, baudrate=9600)
    parts = [other.stream(until) for until in (0.05, 1.3, 1.31, 4.0, 9.0)]
    assert whole is not None and whole.data == b"".join(part.data for part in parts if part)


class StillClock(WallClock):
    """A clock that moves only when somebody waits."""

    time_s = 0.0

    def now(self) -> float:
        return self.time_s

    def wait_for(self, port: object, deadline_s: float) -> bool:
        self.time_s = deadline_s
        return False


class Recorder:
    def received(self, data: bytes, arrival_s: float) -> None: ...

    def sent(self, data: bytes, time_s: float) -> None: ...


@pytest.fixture
def unit() -> Iterator[FrameGyro]:
    master, slave = pty.openpty()
    tty.setraw(slave)
    clock = StillClock()
    unit = Rlg2t.open(
        dataclasses.replace(SECTION, port=os.ttyname(slave)), Connection("rlg_1", clock, Recorder())
    )
    assert isinstance(unit, FrameGyro)
    yield unit
    unit.close()
    clock.close()
    os.close(slave)
    os.close(master)


@pytest.mark.concurrent
def test_identify_hears_the_unit(unit: FrameGyro) -> None:
    unit.link.deliver(b"\x00" + frame(1, 2, 3, 4) + frame(1, 2, 3, 5), 0.0)
    assert unit.identify().model == "two-temperature ring laser"


@pytest.mark.concurrent
def test_identify_names_silence_and_strangers(unit: FrameGyro) -> None:
    with pytest.raises(DeviceSilent, match="no byte within"):
        unit.identify()
    unit.link.deliver(b"$GPGGA,1,2*33\r\n" * 9, 0.0)
    with pytest.raises(WrongDevice, match="24 47 50 47"):
        unit.identify()


@pytest.mark.concurrent
def test_a_line_that_is_too_slow_is_refused(unit: FrameGyro) -> None:
    fast = dataclasses.replace(SECTION, rate_hz=1000.0, baudrate=115200)
    with pytest.raises(ConfigurationError, match="768"):
        Rlg2t.open(fast, OpenConnection(unit.link))
    with pytest.raises(ConfigurationError, match="longer than a sample"):
        emulated(rate_hz=100.0, baudrate=9600)
