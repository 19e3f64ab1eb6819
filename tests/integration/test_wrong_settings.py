"""Devices set otherwise than the bench file says: what notices it, and the sentence that says what to set."""

from pathlib import Path

import numpy as np
import pytest
import serial

from bench.control.discovery import identify_port
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file
from drivers.base.errors import BenchError, ConfigurationError
from drivers.base.virtual_clock import VirtualClock
from drivers.kit.kinds import Connection
from drivers.kit.registry import DRIVERS, registered
from simulators.config import SerialFormat
from simulators.interfaces import StreamBlock
from simulators.lab._uart import block_to_bench, to_bench, to_device

BENCH = """
[bench]
name = "bench"
latitude_deg = 39.10
[table]
driver = "{table}"
port = "/dev/ttyUSB0"
[chamber]
driver = "{chamber}"
port = "/dev/ttyUSB2"
{chamber_keys}
[[gyro]]
name = "gyro_1"
driver = "{gyro}"
port = "/dev/ttyUSB1"
rate_hz = 125
axis = "x"
unit = "G-1"
{gyro_keys}
[[supply]]
name = "supply"
driver = "{supply}"
port = "/dev/ttyUSB3"
[[supply.outputs]]
number = 1
voltage_v = 5.0
current_limit_a = 1.0
[[logger]]
name = "logger"
driver = "{logger}"
port = "/dev/ttyUSB4"
sensors = {{ 101 = "case" }}
"""
DOCUMENT = Path(__file__).parents[2] / "docs" / "instruments.md"
TABLES = ("acutrol3000", "ideal_atl")
CHAMBERS = {
    "weiss": "",
    "cts": "",
    "espec_p300": "address = 1",
    "espec_scp220": "address = 1",
    "thermotron_8200": "address = 1",
    "watlow_f4": "baudrate = 19200",
    "watlow_f4t": "",
}
GYROS = {"kvh1750": "", "stim300": "baudrate = 460800", "frames": 'description = "stim210"'}
SUPPLIES = ("rs_hmp",)  # the others have no serial line
LOGGERS = ("keysight_34970a",)
USUAL = {
    "table": "acutrol3000",
    "chamber": "weiss",
    "gyro": "kvh1750",
    "supply": "rs_hmp",
    "logger": "keysight_34970a",
}


def bench_file(tmp_path, **drivers):
    path = tmp_path / "lab.toml"
    named = USUAL | drivers
    gyro = named["gyro"]
    text = BENCH.format(**named, chamber_keys=CHAMBERS[named["chamber"]], gyro_keys=GYROS[gyro])
    path.write_text(text.replace("rate_hz = 125", "rate_hz = 100") if gyro == "kvh1750" else text)
    return load_bench_file(path)


def noticed(tmp_path, port, actual, **drivers):
    """Return the error of the driver's first question to a device that is set otherwise."""
    file = bench_file(tmp_path, **drivers)
    with EmulatedLab(file, Plant(delivery_s=0.5, actual={port: actual})) as lab:
        sections = {
            "table": lab.file.table,
            "chamber": lab.file.chamber,
            "gyro_1": lab.file.gyro[0],
            **{name: section for name, (_, section) in lab.file.all_instruments.items()},
        }
        role = "gyro" if port == "gyro_1" else port
        section = sections[port]
        clock = VirtualClock(lab.clock_url)
        device = registered(DRIVERS, role)[section.driver].load().open(section, Connection(port, clock, None))
        try:
            with pytest.raises(BenchError) as noticed:
                device.identify()
        finally:
            device.link.close()
            clock.close()
    return noticed.value


CASES = [
    *(("table", name, {"baudrate": 19200}) for name in TABLES),
    *(("table", name, {"parity": "E"}) for name in TABLES),
    *(("chamber", name, {"baudrate": 38400}) for name in CHAMBERS),
    *(("chamber", name, {"parity": "N" if name == "cts" else "O"}) for name in CHAMBERS),
    *(("chamber", name, {"address": 3}) for name in CHAMBERS),
    *(("gyro", name, {"baudrate": 115200, "rate_hz": 100 if name == "kvh1750" else 125}) for name in GYROS),
    *(("gyro", name, {"parity": "E"}) for name in GYROS),
    *(("supply", name, {"baudrate": 19200}) for name in SUPPLIES),
    *(("supply", name, {"parity": "E"}) for name in SUPPLIES),
    *(("logger", name, {"baudrate": 9600}) for name in LOGGERS),
    *(("logger", name, {"parity": "E"}) for name in LOGGERS),
]


@pytest.mark.parametrize(("role", "driver", "actual"), CASES)
def test_a_wrong_setting_is_noticed_and_the_error_says_what_to_set(tmp_path, role, driver, actual):
    port = "gyro_1" if role == "gyro" else role
    error = noticed(tmp_path, port, actual, **{role: driver})
    assert f"Bd, {'8O1' if driver == 'cts' else '8N1'}" in error.remedy and "--thorough" in error.remedy, (
        error
    )
    setting = ", ".join(f"{key} {value}" for key, value in actual.items() if key != "rate_hz")
    row = f"| `{driver}` | {setting} | {type(error).__name__}: {error.what} |"
    assert row in DOCUMENT.read_text().splitlines(), f"docs/instruments.md lacks: {row}"


@pytest.mark.parametrize(
    ("role", "driver"),
    [("table", "ideal_atl"), ("chamber", "watlow_f4"), ("chamber", "weiss"), ("chamber", "cts")],
)
def test_the_same_settings_are_understood(tmp_path, role, driver):
    file = bench_file(tmp_path, **{role: driver})
    with EmulatedLab(file, Plant(actual={role: {}})) as lab:
        clock = VirtualClock(lab.clock_url)
        assert identify_port(lab.ports[role], clock, lambda text: None, role).driver == driver
        clock.close()


@pytest.mark.parametrize(
    ("role", "driver", "actual", "said"),
    [
        ("table", "ideal_atl", {"baudrate": 38400}, "(38400 Bd)"),
        ("chamber", "weiss", {"baudrate": 19200}, "(19200 Bd)"),
        ("chamber", "weiss", {"address": 3}, "address = 3"),
        ("chamber", "espec_p300", {"address": 2}, "address = 2"),
        ("chamber", "thermotron_8200", {"address": 2}, "address = 2"),
        ("chamber", "cts", {"baudrate": 9600}, "(9600 Bd, framed = true)"),
        ("chamber", "cts", {"address": 5}, "address = 5"),
        ("chamber", "watlow_f4", {"address": 5}, "address = 5"),
        ("chamber", "watlow_f4t", {"baudrate": 38400}, "(38400 Bd)"),
    ],
)
def test_ports_thorough_finds_what_to_set(tmp_path, role, driver, actual, said):
    file = bench_file(tmp_path, **{role: driver})
    with EmulatedLab(file, Plant(actual={role: actual})) as lab:
        clock = VirtualClock(lab.clock_url)
        plain = identify_port(lab.ports[role], clock, lambda text: None, role)
        found = identify_port(lab.ports[role], clock, lambda text: None, role, thorough=True)
        clock.close()
    assert plain.driver == ""
    assert found.driver == driver and said in found.text


def test_what_no_device_has_is_refused(tmp_path):
    for actual in ({"oven": {}}, {"chamber": {"colour": 1}}, {"table": {"parity": "mark"}}):
        with pytest.raises(ConfigurationError):
            EmulatedLab(bench_file(tmp_path), Plant(actual=actual))


# The line itself: figures worked out on paper

SLOW, FAST = SerialFormat(9600), SerialFormat(19200)
EVEN = SerialFormat(9600, parity="E")


def test_a_byte_read_at_double_speed_shows_each_bit_twice():
    # 0x55 on the line: start 0, then 1 0 1 0 1 0 1 0, stop 1. At double speed from the start bit on:
    # 0 (start) 0 1 1 0 0 1 1 0 | stop 0 (unsound); next edge at bit 6: 0 0 | 1 1 0 0 1 1 ...
    assert to_bench(b"\x55", FAST, SLOW)[:1] == bytes([0b01100110])


def test_a_break_of_zeros_is_read_at_half_speed_as_one_longer_byte():
    # 0xFF at 19200: one start bit, half of one of 9600: no start bit at all where its middle is looked at.
    assert to_device(b"\xff\xff", FAST, SLOW) == b""


def test_even_parity_read_as_none_is_whole_where_the_parity_bit_is_one():
    # "C" = 0x43 has three ones: parity 1, seen as a stop bit. "A" = 0x41 has two: parity 0, a wrong stop bit,
    # which is taken for a start bit; eight idle bits follow.
    assert to_bench(b"CC", SLOW, EVEN) == b"CC"
    assert to_bench(b"A", SLOW, EVEN) == b"A\xff"
    assert to_device(b"A", EVEN, SLOW) == b"\xff"


def test_two_percent_of_clock_error_does_no_harm():
    data = bytes(range(256))
    assert to_bench(data, SerialFormat(9600), SerialFormat(9800)) == data


def test_marks_of_a_garbled_stream_cover_what_is_read():
    marks = np.array([[50, 10], [100, 20]], np.int64)
    block = block_to_bench(StreamBlock(bytes(range(100)), marks), FAST, SLOW)
    assert block is not None and block.marks[-1].tolist() == [len(block.data), 20]
    assert 0 < block.marks[0, 0] < len(block.data)


def test_the_lab_reads_what_was_set_on_the_terminal():
    from simulators.lab._ports import PtyPort

    port = PtyPort("chamber")
    try:
        for baudrate in (9600, 115200, 374400):
            with serial.Serial(port.url, baudrate):
                assert port.baudrate() == baudrate
    finally:
        port.close()
