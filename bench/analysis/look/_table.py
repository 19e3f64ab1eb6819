"""A log of any common format as columns of numbers, with what was guessed on the way."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet

from bench.analysis.look._text import read_text
from bench.record.exchange import load_asammdf
from bench.record.recording import check_room
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

TEXT, MDF = "text", (".mf4", ".mdf", ".dat")
TIME_OF_FILE = "time of the file"
"""Name of the times, in s, that an MDF file has beside its channels."""


@dataclass(frozen=True, eq=False)
class Table:
    """Columns of a log, name -> shape (n,), NaN where a value is missing or no number.

    `remarks` say what was guessed or left out; `units` and `rate_hz` are what the file says of units and of the
    sample rate.
    """

    columns: dict[str, Array]
    remarks: list[str] = field(default_factory=list)
    units: dict[str, str] = field(default_factory=dict)
    rate_hz: float | None = None


def read_table(
    file: Path, *, separator: str = "", skip: int | None = None, group: str = "", dbc: Sequence[Path] = ()
) -> Table:
    """Read a log: text, Parquet, MAT, NPY, NPZ, HDF5 or MDF, by the ending of its name.

    `separator` and `skip` (lines before the first row of numbers) are for text, `group` names the array of an
    NPZ, MAT or HDF5 file with several tables, `dbc` decode the CAN frames of an MDF file. ConfigurationError for
    a file that cannot be read.
    """
    if not file.is_file():
        raise ConfigurationError("no such log", where=str(file), expected="a file")
    ending = file.suffix.lower()
    try:
        if ending in (".parquet", ".pq"):
            return _parquet(file)
        if ending in (".npy", ".npz"):
            loaded = np.load(file, mmap_mode="r" if ending == ".npy" else None, allow_pickle=False)
            return _arrays(file, {file.stem: loaded} if ending == ".npy" else dict(loaded), group)
        if ending == ".mat":
            return _mat(file, group)
        if ending in (".h5", ".hdf5", ".hdf"):
            return _hdf5(file, group)
        if ending in MDF:
            return _mdf(file, dbc)
        columns, remarks, units, rate_hz = read_text(file, separator, skip)
        return Table(columns, remarks, units, rate_hz)
    except ConfigurationError:
        raise
    except (OSError, MemoryError, ValueError, KeyError, pa.ArrowException) as error:
        raise ConfigurationError(
            "the log cannot be read",
            where=str(file),
            found=str(error).splitlines()[0] if str(error) else type(error).__name__,
            expected="columns of numbers as text, Parquet, MAT, NPY, NPZ, HDF5 or MDF",
            remedy="say the separator, or the lines to skip, if it is text",
        ) from error


def _parquet(file: Path) -> Table:
    with pyarrow.parquet.ParquetFile(file) as parquet:
        check_room(str(file), parquet.metadata.num_rows, parquet.metadata.num_columns)
        frame = parquet.read().to_pandas()
    return _frame(frame)


def _frame(frame: pd.DataFrame) -> Table:
    """Return the columns of a frame: numbers as they are, date-times as s since 1970, others left out."""
    columns: dict[str, Array] = {}
    left_out = []
    for name in frame.columns:
        values = frame[name]
        if pd.api.types.is_datetime64_any_dtype(values):
            columns[str(name)] = np.asarray(values.to_numpy("datetime64[ns]").astype(np.int64) * 1e-9)
        elif pd.api.types.is_numeric_dtype(values):
            columns[str(name)] = values.to_numpy(np.float64, na_value=np.nan)
        else:
            left_out.append(str(name))
    return Table(columns, [f"left out, no numbers: {', '.join(left_out)}"] if left_out else [])


def _arrays(file: Path, arrays: dict[str, Any], group: str) -> Table:
    """Return the columns of a file's arrays: vectors by their names, columns of matrices by number."""
    tables = {name: np.atleast_1d(np.squeeze(array)) for name, array in arrays.items()}
    tables = {
        name: array
        for name, array in tables.items()
        if array.dtype.names or (array.dtype.kind in "iufb" and array.ndim in (1, 2))
    }
    if group and group not in tables:
        raise ConfigurationError(
            "no such table in the file", where=str(file), found=group, expected=", ".join(tables) or "arrays"
        )
    if group:
        tables = {group: tables[group]}
    rows = max((max(array.shape) for array in tables.values()), default=0)
    columns: dict[str, Array] = {}
    left_out = []
    for name, array in tables.items():
        if max(array.shape) != rows:
            left_out.append(name)
        elif array.dtype.names:
            columns |= {field: np.array(array[field], np.float64).ravel() for field in array.dtype.names}
        elif array.ndim == 1:
            columns[name] = np.array(array, np.float64)
        else:
            upright = array if array.shape[0] == rows else array.T
            check_room(str(file), *upright.shape)
            prefix = name if len(tables) > 1 else "c"
            columns |= {f"{prefix}{k + 1}": np.array(row, np.float64) for k, row in enumerate(upright.T)}
    return Table(columns, [f"left out, of another length: {', '.join(left_out)}"] if left_out else [])


def _mat(file: Path, group: str) -> Table:
    from scipy.io import loadmat

    try:
        content = loadmat(file, squeeze_me=True, struct_as_record=True)
    except NotImplementedError:  # MATLAB 7.3 writes HDF5
        return _hdf5(file, group)
    arrays: dict[str, Any] = {}
    for name, value in content.items():
        if name.startswith("__") or not isinstance(value, np.ndarray):
            continue
        if value.dtype.names and value.ndim == 0:  # a struct: its fields
            arrays |= {f"{name}.{key}": value[key].item() for key in value.dtype.names}
        else:
            arrays[name] = value
    return _arrays(
        file, {name: value for name, value in arrays.items() if isinstance(value, np.ndarray)}, group
    )


def _hdf5(file: Path, group: str) -> Table:
    try:
        import h5py
    except ImportError as error:
        raise ConfigurationError(
            "HDF5 files (MATLAB 7.3 too) need the package h5py",
            where=str(file),
            found="it is not installed",
            remedy="install h5py, or save the log as Parquet or CSV",
        ) from error
    arrays: dict[str, Any] = {}
    with h5py.File(file) as content:
        content.visititems(
            lambda name, node: arrays.update({name: node[()]}) if isinstance(node, h5py.Dataset) else None
        )
    return _arrays(file, arrays, group)


def _mdf(file: Path, dbc: Sequence[Path]) -> Table:
    """Return the channels of the group with the most angular rates, else with the most rows, on its own times."""
    asammdf = load_asammdf()
    try:
        with asammdf.MDF(file) as mdf:
            decoded = mdf.extract_bus_logging({"CAN": [(str(path), 0) for path in dbc]}) if dbc else mdf
            frames = [frame for frame in decoded.iter_groups(time_from_zero=False) if len(frame) > 1]
    except Exception as error:  # whatever asammdf raises on a damaged file
        raise ConfigurationError(
            "the log cannot be read", where=str(file), found=f"{type(error).__name__}: {error}"
        ) from error
    tables = []
    for frame in frames:
        units = {}
        table = _frame(frame.rename(columns=lambda name: str(name).rpartition(".")[2]))
        for name, channel in zip(table.columns, frame.columns, strict=False):
            if unit := str(getattr(decoded.get(channel), "unit", "") if channel in decoded else ""):
                units[name] = unit
        table.columns[TIME_OF_FILE] = frame.index.to_numpy(np.float64)
        table.units.update(units)
        tables.append(table)
    if not tables:
        raise ConfigurationError(
            "the MDF file has no channels of numbers",
            where=str(file),
            expected="signals, or CAN frames and a DBC file",
            remedy="say --dbc",
        )
    from bench.analysis.look._channels import gyros_among

    best = max(tables, key=lambda table: (gyros_among(table.columns), len(table.columns[TIME_OF_FILE])))
    best.remarks.append(f"the group of {len(best.columns) - 1} channels, one of {len(tables)} in the file")
    return best
