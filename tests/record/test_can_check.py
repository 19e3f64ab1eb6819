"""`gyrobench can` as somebody types it: real captures, and input that cannot be used."""

from __future__ import annotations

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
        ("log.MF4", "an MF4 log"),
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
