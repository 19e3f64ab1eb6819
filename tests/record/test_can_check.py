"""`gyrobench can` as somebody types it: real captures, and input that cannot be used."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cantools
import numpy as np
import pandas as pd
import pytest

from bench.present.cli._can import check, list_
from drivers.base.errors import ConfigurationError
from drivers.can_dbc import shipped_layouts

DATA = Path(__file__).parents[2] / ".." / "shared" / "data"
CANMOD = DATA / "can_canmod_gps"
MAPPING = """
format = 1
dbc = "{dbc}"
maker = "CSS"
model = "CANmod.gps"
sample = ["gnss_imu"]
signal = [
    {{ role = "rate", axis = "x", message = "gnss_imu", signal = "AngularRateX" }},
    {{ role = "rate", axis = "z", message = "gnss_imu", signal = "AngularRateZ" }},
]
"""
DBC = """VERSION ""
BU_: A
BO_ 16 IMU: 3 A
 SG_ N : 0|8@1+ (1,0) [0|0] "" A
 SG_ W : {start}|16@1- (0.01,0) [0|0] "deg/s" A
"""
SMALL = """
format = 1
dbc = "small.dbc"
sample = ["IMU"]
signal = [
    { role = "counter", message = "IMU", signal = "N" },
    { role = "rate", axis = "z", message = "IMU", signal = "W" },
]
"""


def small(folder: Path, start: int = 8) -> Path:
    (folder / "small.dbc").write_text(DBC.format(start=start))
    (folder / "small.toml").write_text(SMALL)
    return folder / "small.toml"


def test_list_shows_every_layout(capsys: pytest.CaptureFixture[str]) -> None:
    list_()
    shown = capsys.readouterr().out
    assert all(name in shown for name in shipped_layouts())


@pytest.mark.skipif(not CANMOD.exists(), reason="the capture in shared/data/can_canmod_gps is not here")
def test_a_real_log_becomes_a_table_and_a_plot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    dbc = (CANMOD / "canmod-gps.dbc").absolute()
    (tmp_path / "canmod.toml").write_text(MAPPING.format(dbc=dbc.as_posix()))
    check(str(tmp_path / "canmod.toml"), CANMOD / "00000005-60FEB5A8.log", tmp_path, False)
    shown = capsys.readouterr().out
    table = pd.read_csv(tmp_path / "00000005-60FEB5A8_canmod.csv")
    # candump's own lines, by cantools: (time) channel 009#payload
    message = cantools.database.load_file(dbc).get_message_by_name("gnss_imu")
    lines = [line.split() for line in (CANMOD / "00000005-60FEB5A8.log").read_text().splitlines()]
    own = [(float(at[1:-1]), text[4:]) for at, _, text, *_ in lines if text.startswith("009#")]
    values = [message.decode(bytes.fromhex(text), decode_choices=False) for _, text in own]
    np.testing.assert_allclose(table["rate_z_dps"], [row["AngularRateZ"] for row in values], atol=1e-5)
    np.testing.assert_allclose(np.diff(table["time_s"]), np.diff([at for at, _ in own]), atol=2e-6)
    assert (tmp_path / "00000005-60FEB5A8.png").read_bytes().startswith(b"\x89PNG")
    for words in ("5477 CAN frames", "631 unknown id", "101.296 samples a second", "0x7E8 (541)"):
        assert words in shown.replace("\n", " ")


@pytest.mark.skipif(not CANMOD.exists(), reason="the capture in shared/data/can_canmod_gps is not here")
def test_a_loggers_own_file_has_the_samples_of_its_candump_log(tmp_path: Path) -> None:
    """The maker gives the recording in both forms; they count time from other instants."""
    dbc = (CANMOD / "canmod-gps.dbc").absolute()
    (tmp_path / "canmod.toml").write_text(MAPPING.format(dbc=dbc.as_posix()))
    tables = []
    for name in ("00000005-60FEB5A8.log", "00000005-60FEB5A8.MF4"):
        check(str(tmp_path / "canmod.toml"), CANMOD / name, tmp_path / name, True)
        tables.append(pd.read_parquet(tmp_path / name / "00000005-60FEB5A8_canmod.parquet"))
    log, logger = tables
    assert len(log) > 4000 and list(log) == list(logger)
    np.testing.assert_allclose(logger.pop("time_s"), log.pop("time_s"), atol=2e-6)
    pd.testing.assert_frame_equal(logger, log)


WRITER = """
import sys
import asammdf  # before python-can: it looks for it when it is imported
import can
with can.io.mf4.MF4Writer(sys.argv[1]) as writer:
    for k in range(10):
        kinds = [(False, False, [k, k, 0]), (True, False, [9, 9, 9]), (False, True, [8] * 12)]
        for j, (extended, fd, data) in enumerate(kinds):
            at_s = 1e9 + k + 0.2 * j
            writer.on_message_received(
                can.Message(at_s, arbitration_id=16, is_extended_id=extended, is_fd=fd, data=data)
            )
"""


def test_of_a_loggers_file_only_classic_frames_of_the_right_kind_are_samples(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Written by python-can: three bytes of 64 are the frame's, an extended 16 is another identifier."""
    subprocess.run([sys.executable, "-c", WRITER, str(tmp_path / "bus.mf4")], check=True)
    check(str(small(tmp_path)), tmp_path / "bus.mf4", tmp_path, False)
    table = pd.read_csv(tmp_path / "bus_small.csv")
    np.testing.assert_allclose(table["rate_z_dps"], 0.01 * np.arange(10), atol=1e-9)
    np.testing.assert_allclose(table["time_s"], np.arange(10.0), atol=1e-6)
    shown = capsys.readouterr().out
    assert "20 CAN frames, 10 fd left out" in shown and "10 unknown id" in shown


@pytest.mark.parametrize(
    ("scale", "unit", "factor"), [(0.02, "deg/s", 0.02), (-1e-6, "rad/s", -180e-6 / np.pi)]
)
def test_raw_counts_are_scaled_by_the_mapping(tmp_path: Path, scale: float, unit: str, factor: float) -> None:
    (tmp_path / "small.dbc").write_text(
        DBC.format(start=8).replace('(0.01,0) [0|0] "deg/s"', '(1,0) [0|0] ""')
    )
    signal = f'signal = "W", unit = "{unit}", scale = {scale}'
    (tmp_path / "small.toml").write_text(SMALL.replace('signal = "W"', signal))
    lines = [b"t0103%02X%02X00\r" % (n, n) for n in range(100)]
    (tmp_path / "line.bin").write_bytes(b"".join(lines))
    check(str(tmp_path / "small.toml"), tmp_path / "line.bin", tmp_path, False)
    table = pd.read_csv(tmp_path / "line_small.csv")
    np.testing.assert_allclose(table["rate_z_dps"], factor * np.arange(100), rtol=1e-6)


@pytest.mark.parametrize(("signal", "scale"), [("W", "0"), ("W", "nan"), ("N", "2")])
def test_a_scale_that_cannot_be_is_refused(tmp_path: Path, signal: str, scale: str) -> None:
    path = small(tmp_path)
    path.write_text(SMALL.replace(f'signal = "{signal}"', f'signal = "{signal}", scale = {scale}'))
    with pytest.raises(ConfigurationError, match="scale"):
        check(str(path), None, tmp_path, False)


def test_slcan_text_shows_rate_and_losses(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    layout = small(tmp_path)
    numbers = [number for number in range(300) if number % 100 != 50]
    lines = [b"t0103%02X%04X\r" % (n % 256, int.from_bytes(n.to_bytes(2, "little"), "big")) for n in numbers]
    (tmp_path / "line.bin").write_bytes(b"\xff9\r" + lines[0] + b"\xff9\r" + b"".join(lines[1:]))
    check(str(layout), tmp_path / "line.bin", tmp_path, True)
    table = pd.read_parquet(tmp_path / "line_small.parquet")
    np.testing.assert_allclose(table["rate_z_dps"], np.array(numbers) * 0.01, atol=1e-6)
    assert table["end_offset"].iloc[-1] == (tmp_path / "line.bin").stat().st_size
    shown = capsys.readouterr().out
    assert "3 samples lost, 0 repeated" in shown and "2 unknown" in shown


def test_what_cannot_be_used_is_named(tmp_path: Path) -> None:
    layout = str(small(tmp_path))
    (tmp_path / "empty.bin").write_bytes(b"")
    (tmp_path / "other.bin").write_bytes(b"t7E8100\r" * 40)
    (tmp_path / "bad.log").write_bytes(b"no log at all\n" * 30)
    (tmp_path / "log.MF4").write_bytes(b"MDF")
    for name, found in (
        ("empty.bin", "no CAN frame"),
        ("other.bin", "40 CAN frames with identifiers 0x7E8"),
        ("bad.log", "the capture cannot be read"),
        ("log.MF4", "MDF 4 file with logged CAN frames"),
        ("none.log", "No such file"),
    ):
        with pytest.raises(ConfigurationError, match=found):
            check(layout, tmp_path / name, tmp_path, False)
    (tmp_path / "overlapping").mkdir()
    layout = str(small(tmp_path / "overlapping", start=4))
    with pytest.raises(ConfigurationError, match="overlap") as refused:
        check(layout, None, tmp_path, False)
    assert "N" in str(refused.value) and "W" in str(refused.value) and "IMU" in str(refused.value)
    with pytest.raises(ConfigurationError, match="sbg_ellipse"):
        check("sbg_elipse", None, tmp_path, False)
