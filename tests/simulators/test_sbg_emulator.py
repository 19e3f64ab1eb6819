"""The emulated Ellipse and its adapter: bytes against cantools, times in closed form, the adapter's manners."""

from __future__ import annotations

import math
from pathlib import Path

import cantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.base.errors import ConfigurationError
from drivers.can_dbc import CanDecoder
from drivers.sbg import ellipse_layout
from simulators.emulators.can_dbc import CanEmulator
from simulators.emulators.slcan import SlcanAdapter
from simulators.interfaces import GyroSignal

VENDOR_DBC = Path(__file__).parents[2] / ".." / "shared" / "data" / "dbc" / "sbg_ellipse.dbc"
OPEN = b"C\rS6\rO\r"
SENT_AFTER_S = (111 + 95) / 500_000
"""8- and 6-byte standard frames with interframe space: 47 + 8 n bits each (ISO 11898-1), no stuff bits."""


class Plant:
    """A rate that is a known function of time, and a record of what was asked."""

    def __init__(self, axes: str = "xyz", scale: float = 1.0) -> None:
        self.axes = axes
        self.scale = scale
        self.asked: list[tuple[float, int, float]] = []

    def measure(self, start_s: float, count: int, period_s: float) -> GyroSignal:
        self.asked.append((start_s, count, period_s))
        # By sample number, as the lab's plant does, so that a sample has the same bits however it is asked for.
        end_s = period_s * (round(start_s / period_s) + np.arange(1, count + 1))
        rates = self.scale * np.column_stack([np.sin(end_s), np.cos(end_s), 0.1 * end_s])[:, : len(self.axes)]
        return GyroSignal(self.axes, rates * period_s, 20.0 + end_s)


def opened(plant: Plant, **options: float) -> CanEmulator:
    emulator = CanEmulator(plant, ellipse_layout(), **{"rate_hz": 100.0, **options})
    emulator.receive(OPEN, 0.0)
    return emulator


def decoded_by_cantools(data: bytes) -> list[dict]:
    path = (
        VENDOR_DBC if VENDOR_DBC.exists() else Path(__file__).parents[2] / "drivers" / "sbg" / "ellipse.dbc"
    )
    database = cantools.database.load_file(path, encoding="cp1252")
    return [
        database.decode_message(int(text[1:4], 16), bytes.fromhex(text[5:]))
        for text in data.decode("ascii").split("\r")[:-1]
    ]


def test_bytes_say_what_the_plant_measured() -> None:
    plant = Plant()
    block = opened(plant).stream(2.0)
    assert block is not None
    messages = decoded_by_cantools(block.data)
    assert len(messages) == 2 * 199  # the frames of the sample complete at 2 s end after it
    for number, (info, gyro) in enumerate(zip(messages[::2], messages[1::2], strict=True), start=1):
        t = number / 100.0
        assert info["TIME_STAMP"] == number * 10_000
        assert info["STATUS"] == 0x3FF
        assert info["TEMPERATURE"] == pytest.approx(20.0 + t, abs=0.0051)
        rates = [gyro["GYRO_X"], gyro["GYRO_Y"], gyro["GYRO_Z"]]
        assert rates == pytest.approx([math.sin(t), math.cos(t), 0.1 * t], abs=0.000501)


def test_the_makers_example_bytes() -> None:
    class Still(Plant):
        def measure(self, start_s: float, count: int, period_s: float) -> GyroSignal:
            rates = np.array([[0.1, -0.25, 1.0]]) * period_s
            return GyroSignal("xyz", np.repeat(rates, count, axis=0), np.full(count, -12.345))

    block = opened(Still()).stream(0.011)
    assert block is not None
    # 10000 us = 0x2710; 0x03FF; -1234.5 rounds away from zero to -1235 = 0xFB2D
    assert block.data == b"t120810270000FF032DFB\rt1226640006FFE803\r"


@pytest.mark.parametrize(("scale", "ends"), [(1e6, (32767, -32768)), (0.0, (0, 0))])
def test_rates_saturate(scale: float, ends: tuple[int, int]) -> None:
    block = opened(Plant(scale=scale)).stream(7.0)
    assert block is not None
    x = [round(message["GYRO_X"] * 1000) for message in decoded_by_cantools(block.data)[1::2]]
    assert (max(x), min(x)) == ends


def test_a_single_axis_unit_reads_zero_on_the_others() -> None:
    block = opened(Plant(axes="x")).stream(1.0)
    assert block is not None
    gyros = decoded_by_cantools(block.data)[1::2]
    assert gyros[49]["GYRO_X"] == pytest.approx(math.sin(0.5), abs=0.000501)
    assert {(message["GYRO_Y"], message["GYRO_Z"]) for message in gyros} == {(0, 0)}


@pytest.mark.parametrize("ppm", [0.0, 150.0, -40_000.0])
def test_times_follow_the_units_clock(ppm: float) -> None:
    """Marks are the ends of IMU_GYRO on the bus; the unit's own time runs at its own pace."""
    plant = Plant()
    block = opened(plant, clock_error_ppm=ppm).stream(100.0)
    assert block is not None
    period_s = 0.01 / (1.0 + ppm * 1e-6)
    numbers, odd = np.divmod(block.marks[:, 0], 40)
    assert not odd.any()
    expected_ns = (numbers * period_s + SENT_AFTER_S) * 1e9
    np.testing.assert_allclose(block.marks[:, 1], expected_ns, rtol=0.0, atol=0.51)
    assert np.diff(block.marks[:, 1], prepend=0).max() <= 1e9
    assert block.marks[-1, 0] == len(block.data)
    assert block.marks[-1, 1] <= 100.0e9 < block.marks[-1, 1] + period_s * 1e9
    batch = CanDecoder(ellipse_layout(), 100.0).feed(block.data)
    np.testing.assert_array_equal(batch.columns["counter"], 10_000 * np.arange(1, len(batch) + 1))
    np.testing.assert_allclose(
        np.radians(batch.columns["rate_x_dps"]), np.sin(period_s * np.arange(1, len(batch) + 1)), atol=0.00051
    )


def test_unit_time_wraps() -> None:
    emulator = opened(Plant(), rate_hz=1.0)
    emulator.stream(4294.5)
    block = emulator.stream(4296.5)
    assert block is not None
    assert [message["TIME_STAMP"] for message in decoded_by_cantools(block.data)[::2]] == [
        4_295_000_000 % 2**32,
        4_296_000_000 % 2**32,
    ]


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.floats(0.0, 3.0), max_size=30),
    st.sampled_from([0.5, 3.0, 100.0, 333.0, 1000.0]),
    st.floats(-1e4, 1e4),
)
def test_call_chunking_changes_nothing(cuts: list[float], rate_hz: float, ppm: float) -> None:
    whole_plant, plant = Plant(), Plant()
    whole = opened(whole_plant, rate_hz=rate_hz, clock_error_ppm=ppm).stream(3.0)
    emulator = opened(plant, rate_hz=rate_hz, clock_error_ppm=ppm)
    data, marks = b"", []
    for until_s in [*sorted(cuts), 3.0]:
        block = emulator.stream(until_s)
        if block is not None:
            marks += [(len(data) + int(count), int(time_ns)) for count, time_ns in block.marks]
            data += block.data
            assert block.marks[-1].tolist()[0] == len(block.data)
            assert block.marks[-1, 1] <= until_s * 1e9 + 1
    assert data == (b"" if whole is None else whole.data)
    if whole is not None:
        assert {(int(count), int(time_ns)) for count, time_ns in whole.marks} <= set(marks)
    assert marks == sorted(marks)
    ends = [start + count * period for start, count, period in plant.asked]
    assert [start for start, _, _ in plant.asked[1:]] == pytest.approx(ends[:-1])


def test_nothing_passes_until_opened_and_a_closing_channel_hands_on_the_rest() -> None:
    plant = Plant()
    emulator = CanEmulator(plant, ellipse_layout(), rate_hz=100.0)
    assert emulator.stream(1.0) is None
    assert plant.asked == []
    answers = emulator.receive(OPEN, 5.005)
    assert b"".join(answer.data for answer in answers) == b"\a\r\r"
    block = emulator.stream(5.025)
    assert block is not None
    first = decoded_by_cantools(block.data)
    assert [message["TIME_STAMP"] for message in first[::2]] == [5_010_000, 5_020_000]
    rest, answer = emulator.receive(b"C\r", 5.045)
    assert [message["TIME_STAMP"] for message in decoded_by_cantools(rest.data)[::2]] == [
        5_030_000,
        5_040_000,
    ]
    assert answer.data == b"\r"
    assert emulator.stream(9.0) is None
    emulator.receive(b"O\r", 10.0)
    block = emulator.stream(10.015)
    assert block is not None
    assert decoded_by_cantools(block.data)[0]["TIME_STAMP"] == 10_000_000  # it ends after 10 s


def test_wrong_bit_rate_is_a_silent_bus() -> None:
    emulator = CanEmulator(Plant(), ellipse_layout(), rate_hz=100.0)
    assert [answer.data for answer in emulator.receive(b"S5\rO\r", 0.0)] == [b"\r", b"\r"]
    assert emulator.stream(1.0) is None


def test_a_rate_that_does_not_fit_the_bus_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="2427 Hz"):
        CanEmulator(Plant(), ellipse_layout(), rate_hz=2500.0)


@pytest.mark.parametrize(
    ("sent", "answered"),
    [
        (b"O\r", b"\a"),  # no bit rate set yet
        (b"C\r", b"\a"),  # not open
        (b"t1230\r", b"\a"),  # not open
        (b"S6\rO\rS6\rO\r", b"\r\r\a\a"),  # neither while open
        (b"S6\rO\rC\rS8\rO\r", b"\r\r\r\r\r"),
        (b"S9\rSx\r\x00\r", b"\a\a\a"),
        (b"V\rN\r", b"V1013\rNGB01\r"),
        (b"\r", b"\r"),
        (b"S6\rO\rF\rt1232AABB\rT123456781AA\rr1234\rR123456780\r", b"\r\rF00\r\r\r\r\r"),
        (b"S6\rO\rt1232AA\rtxyz\r", b"\r\r\a\a"),
        (b"C\rS6\r\rO\rO\r", b"\a\r\r\r\a"),  # what python-can 4.6.1 sends
    ],
)
def test_adapter_answers(sent: bytes, answered: bytes) -> None:
    for size in (len(sent), 1):
        adapter = SlcanAdapter(500_000)
        chunks = [sent[at : at + size] for at in range(0, len(sent), size)]
        replies = [reply for chunk in chunks for reply in adapter.receive(chunk, 3.0)]
        assert b"".join(reply.data for reply in replies) == answered
        assert {reply.at_s for reply in replies} == {3.0}
