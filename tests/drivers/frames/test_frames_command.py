"""`gyrobench frames` as somebody types it, with good and bad input."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from bench.present.cli._frames import check, list_
from drivers.base.errors import ConfigurationError
from drivers.frames import FrameEncoder, load_family, shipped


def test_list_shows_every_description(capsys: pytest.CaptureFixture[str]) -> None:
    list_()
    shown = capsys.readouterr().out
    assert all(name in shown for name in shipped())


@pytest.mark.parametrize("parquet", [False, True])
def test_a_capture_becomes_a_table_and_a_plot(tmp_path: Path, parquet: bool) -> None:
    data = FrameEncoder(load_family("fg333")).encode(
        50, {"rate_z": np.arange(50.0), "counter": np.arange(50)}
    )
    (tmp_path / "line.bin").write_bytes(b"\xeb" + data[:-3])
    check("fg333", tmp_path / "line.bin", tmp_path, parquet)
    path = tmp_path / f"line_fg333.{'parquet' if parquet else 'csv'}"
    table = pd.read_parquet(path) if parquet else pd.read_csv(path)
    assert table["rate_z"].tolist() == pytest.approx(list(range(49)), rel=1e-12)
    assert table["end_offset"].tolist() == list(range(20, 951, 19))
    assert (tmp_path / "line.png").read_bytes().startswith(b"\x89PNG")


def test_a_capture_of_another_device_and_an_empty_one_are_named(tmp_path: Path) -> None:
    (tmp_path / "other.bin").write_bytes(b"$GPGGA,1,2*33\r\n" * 40)
    (tmp_path / "empty.bin").write_bytes(b"")
    for name, found in (
        ("other.bin", "24 47 50 47"),
        ("empty.bin", "an empty file"),
        ("no.bin", "No such file"),
    ):
        with pytest.raises(ConfigurationError, match=found):
            check("stim300", tmp_path / name, tmp_path, False)


def test_the_description_that_fits_is_named(tmp_path: Path) -> None:
    data = FrameEncoder(load_family("openimu")).encode(20, {"time": np.arange(20)})
    (tmp_path / "other.bin").write_bytes(data[30:])
    with pytest.raises(ConfigurationError, match="frames check openimu` fits"):
        check("stim300", tmp_path / "other.bin", tmp_path, False)


FIELD = '[[field]]\nname = "rate_z"\naxis = "z"\nat = 2'


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("at = 2\n", "at = 17\n"), "field 'rate_z'.at: found bytes 17"),
        (("at = 2\n", "at = 40\n"), "a place within the frame's 19 bytes"),
        (('unit = "deg/s"', 'unit = "degC"'), "a unit of rate: deg/s"),
        (('unit = "deg/s"', 'unit = "dps"'), "field[0] 'rate_z'.unit"),
        (('role = "rate"', 'rolle = "rate"'), "did you mean 'role'"),
        (('sync = "EB 90"', 'sync = "EB 9"'), "whole bytes in hexadecimal"),
        (("ranges = [[0, 18]]", "ranges = [[0, 30]]"), "checksum[0].ranges"),
        (("ranges = [[0, 18]]", "ranges = [[0, 19]]"), "ranges without it"),
        (('kind = "sum8"', 'kind = "crc16"'), "checksum[0].poly"),
        (('[counter]\nfield = "counter"', '[counter]\nfield = "conter"'), "counter.field"),
        (("length = 19\n", ""), "frame.length"),
        (("rate_z = 1.0", "rate_z = 2.0"), "vector[0].expect.rate_z"),
        (("00 01 AF", "00 01 AE"), "refused for their checksum"),
        (('role = "rate"', 'role = "aux"'), "no gyro channel"),
        (('name = "optical_temp_2"', 'name = "optical_temp_1"'), "optical_temp_1"),
    ],
)
def test_a_mistake_in_a_description_is_named_by_its_key(tmp_path: Path, change, words: str) -> None:
    text = shipped()["fg333"].read_text()
    assert change[0] in text and FIELD in text
    path = tmp_path / "mine.toml"
    path.write_text(text.replace(*change, 1))
    with pytest.raises(ConfigurationError) as caught:
        check(str(path), None, tmp_path, False)
    shown = str(caught.value)
    assert (
        words.split(": found ")[0] in shown and words.split(": found ")[-1] in shown and "mine.toml" in shown
    )


def test_variants_that_begin_alike_are_refused(tmp_path: Path) -> None:
    text = shipped()["kvh"].read_text().replace('"FE 81 FF 56"', '"FE 81 FF 55"')
    (tmp_path / "mine.toml").write_text(text)
    with pytest.raises(ConfigurationError, match="tells the two apart"):
        load_family(str(tmp_path / "mine.toml"))
