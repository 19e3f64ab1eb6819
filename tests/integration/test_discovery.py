"""`ports --identify` on emulated labs: every device is found for what it is, and nothing in it has moved."""

import pytest

from bench.control.discovery import identify_port
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file
from drivers.base.virtual_clock import VirtualClock

BENCH = """
[bench]
name = "bench"
latitude_deg = 39.10
[table]
driver = "{table}"
port = "/dev/ttyUSB0"
[chamber]
driver = "{chamber}"
port = "{chamber_port}"
[[gyro]]
name = "gyro_1"
driver = "{gyro}"
port = "/dev/ttyUSB1"
rate_hz = 100
axis = "x"
unit = "G-1"
{extra}
"""


@pytest.mark.parametrize(
    ("table", "chamber", "chamber_port", "gyro", "extra"),
    [
        ("ideal_atl", "espec_p300", "socket://10.0.0.1:10001", "rlg2t", "baudrate = 115200"),
        ("acutrol3000", "watlow_f4t", "socket://10.0.0.1:502", "kvh1750", ""),
    ],
)
def test_every_device_is_found_for_what_it_is(tmp_path, table, chamber, chamber_port, gyro, extra):
    path = tmp_path / "lab.toml"
    path.write_text(
        BENCH.format(table=table, chamber=chamber, chamber_port=chamber_port, gyro=gyro, extra=extra)
    )
    with EmulatedLab(load_bench_file(path), Plant(delivery_s=0.5)) as lab:
        clock = VirtualClock(lab.clock_url)
        found = {
            name: identify_port(url, clock, lambda text: None, name).driver for name, url in lab.ports.items()
        }
        clock.close()
    assert found == {"table": table, "chamber": chamber, "gyro_1": gyro}


def test_a_port_that_cannot_be_opened_is_said(tmp_path):
    with EmulatedLab(_plain(tmp_path), Plant()) as lab:
        clock = VirtualClock(lab.clock_url)
        found = identify_port(str(tmp_path / "ttyNONE"), clock, lambda text: None, "table")
        clock.close()
    assert found.driver == "" and "cannot be opened" in found.text and "No such file" in found.text


def _plain(tmp_path):
    path = tmp_path / "lab.toml"
    path.write_text(
        BENCH.format(
            table="acutrol3000", chamber="weiss", chamber_port="/dev/ttyUSB2", gyro="kvh1750", extra=""
        )
    )
    return load_bench_file(path)
