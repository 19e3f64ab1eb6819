"""CAN gyros in a bench file: layouts by name, by file and in place; what is kept with the run; mistakes."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.record.benchfile import bench_file_from, bench_file_text, load_bench_file
from drivers.base.errors import ConfigurationError
from drivers.kit.registry import load_kind

BENCH = """
[bench]
name = "b"
latitude_deg = 40.0
[table]
driver = "acutrol3000"
port = "/dev/ttyUSB0"
[chamber]
driver = "weiss"
port = "socket://192.0.2.1:2049"
[[gyro]]
name = "mti"
driver = "can_dbc"
interface = "gyrobench_slcan"
channel = "/dev/ttyACM0"
axes = "xyz"
axis = "z"
unit = "MTI-1"
"""
DBC = 'VERSION ""\nBU_: A\nBO_ 7 GYRO: 2 A\n SG_ W : 7|16@0- (0.01,0) [0|0] "deg/s" A\n'
MAPPING = """
format = 1
dbc = "unit.dbc"
sample = ["GYRO"]
signal = [{ role = "rate", axis = "z", message = "GYRO", signal = "W" }]
"""


def write(folder: Path, text: str) -> Path:
    (folder / "lab.toml").write_text(text, encoding="utf-8")
    return folder / "lab.toml"


def test_a_run_keeps_what_it_was_decoded_by(tmp_path: Path) -> None:
    """The mapping and the DBC file may go: what the manifest and a written bench file hold is enough."""
    (tmp_path / "unit.dbc").write_text(DBC, encoding="utf-8")
    (tmp_path / "map.toml").write_text(MAPPING, encoding="utf-8")
    text = BENCH.replace('"xyz"', '"z"')
    by_file = load_bench_file(write(tmp_path, text + 'layout = "map.toml"\n'))
    in_place = text + "layout = { " + ", ".join(MAPPING.strip().splitlines()) + " }\n"
    for file in (by_file, load_bench_file(write(tmp_path, in_place))):
        kept = file.model_dump(mode="json")
        written = bench_file_text(file)
        (tmp_path / "elsewhere").mkdir(exist_ok=True)
        for other in (bench_file_from(kept), load_bench_file(write(tmp_path / "elsewhere", written))):
            assert other.gyro[0].layout == file.gyro[0].layout
            decoder = load_kind("gyro", other.gyro[0].driver).decoder(other.gyro[0])
            assert decoder.feed(b"t0072FF9C\r").columns["rate_z_dps"].tolist() == [-1.0]


def test_shipped_layouts_by_name(tmp_path: Path) -> None:
    file = load_bench_file(write(tmp_path, BENCH + 'layout = "xsens_mti"\n'))
    assert file.gyro[0].on_can and file.gyro[0].layout["model"] == "MTi"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"gyro\[0\].layout cannot be used. Found: nothing"),
        ('layout = "no_such"\n', r"gyro\[0\].layout .*no_such.*xsens_mti"),
        ("layout = 3\n", r"gyro\[0\].layout"),
        ('layout = { format = 1, dbc = "x.dbc", sample = ["A"] }\n', "signal: field required"),
        ('layout = "xsens_mti"\nsource_address = 300\n', "source_address"),
    ],
)
def test_mistakes(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        load_bench_file(write(tmp_path, BENCH + text))


def test_an_axis_that_the_layout_lacks(tmp_path: Path) -> None:
    (tmp_path / "unit.dbc").write_text(DBC, encoding="utf-8")
    (tmp_path / "map.toml").write_text(MAPPING, encoding="utf-8")
    with pytest.raises(ConfigurationError, match="lacks an axis"):
        load_bench_file(write(tmp_path, BENCH + 'layout = "map.toml"\n'))


def test_two_units_may_share_a_bus_that_several_can_open(tmp_path: Path) -> None:
    one = BENCH + 'layout = "openimu300"\nsource_address = 128\n'
    two = one + "[[gyro]]" + one.split("[[gyro]]")[1].replace('"mti"', '"imu"').replace("128", "129")
    with pytest.raises(ConfigurationError, match="a port of its own"):
        load_bench_file(write(tmp_path, two))
    shared = two.replace("gyrobench_slcan", "socketcan").replace("/dev/ttyACM0", "can0")
    assert len(load_bench_file(write(tmp_path, shared)).gyro) == 2
    clash = shared.replace('channel = "can0"', 'channel = "/dev/ttyUSB0"', 1)
    with pytest.raises(ConfigurationError, match="table is on this one"):
        load_bench_file(write(tmp_path, clash))
