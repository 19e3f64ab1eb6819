"""The reader of foreign logs, on files written by pandas, h5py, scipy and asammdf."""

from __future__ import annotations

from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest
from asammdf import MDF, Signal
from asammdf.signal import InvalidationArray
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import savemat

from bench.record.exchange import Mapping, read_log, read_table, scale_of
from drivers.base.errors import ConfigurationError

T = np.arange(200) / 100.0
RATES = {"gyro_x": np.sin(T), "gyro_y": np.cos(T)}


def test_units_of_an_mdf_file_stay_with_their_channels(tmp_path: Path) -> None:
    """A channel of text before the others must not move their units by one."""
    text = Signal(np.array([b"ok"] * 200), T, name="note", encoding="utf-8")
    valid = Signal(
        np.ones(200, np.uint8), T, name="valid", conversion={"val_0": 1, "text_0": b"yes", "default": b"no"}
    )
    rates = [Signal(RATES["gyro_x"], T, name="gyro_x", unit="rad/s"), Signal(T, T, name="acc_x", unit="g")]
    with MDF(version="4.10") as mdf:
        mdf.append([text, valid, *rates])
        mdf.save(tmp_path / "log.mf4")
    table = read_table(tmp_path / "log.mf4")
    assert table.units == {"gyro_x": "rad/s", "acc_x": "g"}
    assert (
        list(table.columns) == [table.time, "valid", "gyro_x", "acc_x"]
        and (table.columns["valid"] == 1).all()
    )
    assert table.words == {"note": "text"}


def test_invalid_samples_of_an_mdf_file_are_missing(tmp_path: Path) -> None:
    bad = InvalidationArray(np.arange(200) % 50 == 7)
    with MDF(version="4.10") as mdf:
        mdf.append([Signal(RATES["gyro_x"], T, name="gyro_x", invalidation_bits=bad)])
        mdf.append([Signal(T[::10], T[::10], name="temp")])
        mdf.save(tmp_path / "log.mf4")
    table = read_table(tmp_path / "log.mf4", ["gyro_x", "temp"])
    assert np.flatnonzero(np.isnan(table.columns["gyro_x"])).tolist() == [7, 57, 107, 157]
    np.testing.assert_allclose(table.columns["temp"][:191], T[:191])


def test_hdf5_and_matlab_73(tmp_path: Path) -> None:
    """MATLAB 7.3 files are HDF5 files with a header of their own; matrices lie on their side."""
    with h5py.File(tmp_path / "log.h5", "w") as file:
        file["imu/time_s"], file["imu/gyro"] = T, np.column_stack([*RATES.values()])
        file["imu/maker"] = "nobody"
    matlab = tmp_path / "log.mat"
    with h5py.File(matlab, "w", userblock_size=512) as file:
        file["t"], file["gyro"] = T[None, :], np.stack([*RATES.values()])
    with matlab.open("r+b") as raw:
        raw.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    savemat(tmp_path / "old.mat", {"t": T, "gyro": np.column_stack([*RATES.values()]), "fs": 100.0})
    for name, columns in (
        ("log.h5", ["imu/gyro1", "imu/gyro2"]), ("log.mat", ["gyro1", "gyro2"]), ("old.mat", ["gyro1", "gyro2"]),
    ):  # fmt: skip
        table = read_table(tmp_path / name, columns)
        for column, rates in zip(columns, RATES.values(), strict=True):
            np.testing.assert_array_equal(table.columns[column], rates)
    with pytest.raises(ConfigurationError, match=r"no such column\. Found: gyro9\. Expected: gyro1"):
        read_table(matlab, ["gyro9"])


def test_times_of_parquet_index_missing_and_elapsed(tmp_path: Path) -> None:
    stamps = pd.to_datetime(1.7e9 + T, unit="s")
    pd.DataFrame(RATES, index=stamps).to_parquet(tmp_path / "index.parquet")
    table = read_table(tmp_path / "index.parquet")
    np.testing.assert_allclose(table.columns[table.time], 1.7e9 + T, atol=1e-6)
    frame = pd.DataFrame({"when": stamps, "elapsed": pd.to_timedelta(T, unit="s"), **RATES})
    frame.loc[20, "when"] = pd.NaT
    frame.to_parquet(tmp_path / "log.parquet")
    table = read_table(tmp_path / "log.parquet")
    assert table.time == "when" and np.flatnonzero(np.isnan(table.columns["when"])).tolist() == [20]
    np.testing.assert_allclose(table.columns["elapsed"], T, atol=1e-9)


@pytest.mark.parametrize("form", ["%d/%m/%Y %H:%M:%S.%f", "%m/%d/%Y %H:%M:%S.%f", "%d.%m.%Y %H:%M:%S.%f"])
def test_days_and_months_are_not_taken_for_each_other(tmp_path: Path, form: str) -> None:
    """From the 12th to the 13th a parser that decides cell by cell jumps by ten months."""
    stamps = pd.Series(pd.date_range("2024-02-12 23:00", periods=200, freq="1min"))
    pd.DataFrame({"time": stamps.dt.strftime(form), **RATES}).to_csv(tmp_path / "log.csv", index=False)
    time_s = read_table(tmp_path / "log.csv").columns["time"]
    np.testing.assert_allclose(np.diff(time_s), 60.0, atol=1e-6)
    assert time_s[0] == pd.Timestamp("2024-02-12 23:00").timestamp()


def rows(header: str, *, end: str = "\n", middle: str = "") -> str:
    lines = [f"{t:.2f};{x:.4f};{y:.4f}{end}" for t, x, y in zip(T, *RATES.values(), strict=True)]
    return header + "".join(lines[:100]) + middle + "".join(lines[100:])


def test_text_in_latin_1_with_a_separator_at_the_end_of_rows(tmp_path: Path) -> None:
    text = rows("t [s];gyro_x [°/s];gyro_y [°/s]\n", end=";\n")
    (tmp_path / "log.csv").write_bytes(text.encode("latin-1"))
    table = read_table(tmp_path / "log.csv")
    assert table.units == {"t": "s", "gyro_x": "°/s", "gyro_y": "°/s"}
    np.testing.assert_allclose(table.columns["gyro_y"], RATES["gyro_y"], atol=1e-4)
    whole = read_table(tmp_path / "log.csv", ["gyro_y [°/s]", "t"])  # a mapping may name either
    assert list(whole.columns) == ["gyro_y [°/s]", "t"]


def test_a_word_is_a_missing_value_and_is_said(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    path.write_text(rows("t;gyro_x;gyro_y\n", middle="1.00;ERR;0.5\n"))
    table = read_table(path)
    assert np.isnan(table.columns["gyro_x"][100]) and table.words == {"gyro_x": "'ERR' in row 101"}
    assert any("gyro_x ('ERR' in row 101)" in remark for remark in table.remarks)
    columns: dict[str, object] = {
        "time": {"name": "t", "unit": "s"},
        "output": {"name": "gyro_x", "unit": "deg/s"},
    }
    with pytest.raises(ConfigurationError, match=r"not one of numbers.*ERR"):
        read_log(path, Mapping(format=1, unit_id="U", latitude_deg=0.0, columns=columns))


@pytest.mark.parametrize(
    ("line", "rate_hz"),
    [("Fs,100", 100.0), ("# sampling rate [Hz]: 200", 200.0), ("# Sample rate = 1.5 kHz", 1500.0),
     ("% data rate: 50", 50.0), ("# Number of samples: 6000", None), ("# gyro rate: 2.5 dps", None),
     ("# sample 17 of 20", None), ("# Sample rate: 1,000 Hz", 1000.0), ("# Sample rate (kHz): 2", 2000.0),
     ("# Sampling rate = 1e3", 1000.0), ("# Output rate: 10 ms", None), ("# data rate: 600 samples/min", None),
     ("# Data rate: 115200 baud, sampling 100 Hz", 100.0), ("# Sample rate: 50 samples per second", 50.0),
     ("# sampling frequency 2 MHz / 10000 = 200 Hz", None), ("# rate: 3.5e2 sps", 350.0)],
)  # fmt: skip
def test_the_sample_rate_is_only_read_where_it_is_said(
    tmp_path: Path, line: str, rate_hz: float | None
) -> None:
    (tmp_path / "log.csv").write_text(rows(f"{line}\nt;gyro_x;gyro_y\n"))
    assert read_table(tmp_path / "log.csv").rate_hz == rate_hz


@pytest.mark.parametrize(
    ("quantity", "unit", "raw", "value"),
    [("rate", "°/s", 2.0, 2.0), ("rate", "0.0305 deg/s", 100, 3.05), ("rate", "-1e-3 rad/s", 1000, -57.29578),
     ("temperature", "0.00294118 degC + 36.53", -340, 35.53), ("temperature", "K", 300.0, 26.85),
     ("temperature", "degF", 212.0, 100.0), ("specific force", "0.061 mg", 16384, 9.80100),
     ("time", "us", 5e6, 5.0), ("specific force", "m/s²", 9.8, 9.8)],
)  # fmt: skip
def test_units_with_factor_and_offset(quantity: str, unit: str, raw: float, value: float) -> None:
    """Factors and zero of an MPU-6050's data sheet; freezing and boiling points."""
    scale = scale_of(quantity, unit)
    assert scale is not None and scale.factor * raw + scale.offset == pytest.approx(value, rel=1e-5)


@given(st.text())
def test_a_unit_is_known_or_none(text: str) -> None:
    scale = scale_of("rate", text)
    assert scale is None or np.isfinite(scale.factor)


@pytest.mark.parametrize(("separator", "odd"), [(";", "1.00;0.5"), (" ", "line 103")])
def test_rows_of_another_length_are_said_and_not_imported(tmp_path: Path, separator: str, odd: str) -> None:
    """A logger that lost or doubled a cell moves the others by one column; comments between rows are none."""
    path = tmp_path / "log.csv"
    wrong = "1.00;0.5" if separator == ";" else "1.0 0.5 0.25 4.0"
    text = rows("t;gyro_x;gyro_y\n", middle=f"# a pause\n{wrong}\n")
    path.write_text(text.replace(";", separator))
    table = read_table(path)
    assert len(table.columns["t"]) == 200
    assert table.remarks[-1] == f"1 rows with another number of cells left out, the first {odd!r}"
    columns: dict[str, object] = {
        "time": {"name": "t", "unit": "s"},
        "output": {"name": "gyro_x", "unit": "deg/s"},
    }
    with pytest.raises(ConfigurationError, match="rows are not all alike"):
        read_log(path, Mapping(format=1, unit_id="U", latitude_deg=0.0, columns=columns))
