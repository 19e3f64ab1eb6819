"""Decoded tables: Parquet with units, packed for noise-like numbers, complete or not there; means over seconds.

Floats are byte-stream-split, integers delta-packed, both under zstd level 1: 40 % smaller than Parquet's defaults
for gyro data and four times as quick to write. Columns go to Arrow and back through their buffers: pyarrow's own
conversions import pandas when it is installed, more than a second of start-up.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from drivers.base.arrays import Array

ROW_GROUP = 65536

Columns = Mapping[str, NDArray[Any]]

_UNITS = (
    ("_ns", "ns"),
    ("_dps", "deg/s"),
    ("_mps2", "m/s2"),
    ("_deg", "deg"),
    ("_c", "degC"),
    ("_v", "V"),
    ("_a", "A"),
)


class TableWriter:
    """Takes blocks of a table and writes them in row groups of one size."""

    def __init__(self, path: Path, description: str) -> None:
        self._path = path
        self._description = description
        self._writer: pq.ParquetWriter | None = None
        self._waiting: list[Columns] = []
        self._waiting_rows = 0

    def write(self, columns: Columns) -> None:
        """Append rows, every column of shape (n,)."""
        self._waiting.append(columns)
        self._waiting_rows += len(next(iter(columns.values())))
        while self._waiting_rows >= ROW_GROUP:
            self._write_group(ROW_GROUP)

    def close(self) -> None:
        """Write what waits; a table without rows, too, if it has columns."""
        if self._waiting_rows or self._writer is None:
            self._write_group(self._waiting_rows)
        if self._writer is not None:
            self._writer.close()

    def _write_group(self, rows: int) -> None:
        if not self._waiting:
            return
        joined = {name: np.concatenate([block[name] for block in self._waiting]) for name in self._waiting[0]}
        arrays = [to_arrow(column[:rows]) for column in joined.values()]
        if self._writer is None:
            types = {name: array.type for name, array in zip(joined, arrays, strict=True)}
            self._writer = _open(self._path, types, self._description)
        table = pa.Table.from_arrays(arrays, schema=self._writer.schema)
        self._writer.write_table(table, row_group_size=ROW_GROUP)
        self._waiting_rows -= rows
        self._waiting = (
            [{name: column[rows:] for name, column in joined.items()}] if self._waiting_rows else []
        )


def _open(path: Path, types: Mapping[str, pa.DataType], description: str) -> pq.ParquetWriter:
    fields = [
        pa.field(name, kind, nullable=False, metadata={"unit": unit_of(name)}) for name, kind in types.items()
    ]
    encoding = {
        field.name: "BYTE_STREAM_SPLIT" if pa.types.is_floating(field.type) else "DELTA_BINARY_PACKED"
        for field in fields
        if not pa.types.is_boolean(field.type)
    }
    return pq.ParquetWriter(
        path,
        pa.schema(
            fields, metadata={"table": description, "time": "time_ns is bench time, see manifest.json"}
        ),
        compression="zstd",
        compression_level=1,
        use_dictionary=False,
        column_encoding=encoding | {field.name: "PLAIN" for field in fields if field.name not in encoding},
    )


def unit_of(column: str) -> str:
    """Return the unit that a column's name ends in, "1" for counts and flags."""
    return next((unit for ending, unit in _UNITS if column.endswith(ending)), "1")


@contextmanager
def table_writer(path: Path, description: str) -> Iterator[TableWriter]:
    """Write a table in blocks; the file takes its name only when it is complete."""
    part = path.with_suffix(".part")
    writer = TableWriter(part, description)
    try:
        yield writer
        writer.close()
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    if part.exists():
        part.replace(path)
    else:
        path.unlink(missing_ok=True)


def to_arrow(column: NDArray[Any]) -> pa.Array:
    """Return a numeric or bool column, shape (n,), as an Arrow array without nulls (no copy of numbers)."""
    bits = column.dtype == np.bool_
    data = np.packbits(column, bitorder="little") if bits else np.ascontiguousarray(column)
    kind = pa.bool_() if bits else pa.from_numpy_dtype(column.dtype)
    return pa.Array.from_buffers(kind, len(column), [None, pa.py_buffer(data)])


def from_arrow(column: pa.ChunkedArray | pa.Array) -> NDArray[Any]:
    """Return an Arrow column without nulls, numeric or bool, as an array of shape (n,)."""
    chunks = column.chunks if isinstance(column, pa.ChunkedArray) else [column]
    parts = [_chunk(chunk) for chunk in chunks]
    if len(parts) == 1:
        return parts[0]
    return np.concatenate(parts) if parts else np.empty(0, _numpy_type(column.type))


def _chunk(chunk: pa.Array) -> NDArray[Any]:
    if chunk.null_count:
        raise ValueError(f"{chunk.null_count} nulls in a column that has none")
    if not len(chunk):
        return np.empty(0, _numpy_type(chunk.type))
    data = chunk.buffers()[1]
    if pa.types.is_boolean(chunk.type):
        bits = np.unpackbits(np.frombuffer(data, np.uint8), bitorder="little")
        return bits[chunk.offset : chunk.offset + len(chunk)].astype(np.bool_)
    dtype = _numpy_type(chunk.type)
    return np.frombuffer(data, dtype, count=len(chunk), offset=chunk.offset * dtype.itemsize)


def _numpy_type(kind: pa.DataType) -> np.dtype[Any]:
    if pa.types.is_integer(kind) or pa.types.is_floating(kind):
        names = {"halffloat": "float16", "float": "float32", "double": "float64"}
        return np.dtype(names.get(str(kind), str(kind)))
    if pa.types.is_boolean(kind):
        return np.dtype(np.bool_)
    raise ValueError(f"a column of {kind}, not of numbers")


@dataclass(frozen=True, eq=False)
class SecondMeans:
    """A gyro's means over whole seconds, (n,), NaN without a valid sample; `lost`: part of the samples."""

    rate_dps: Array
    temp_c: Array
    lost: float


def seconds(table: Columns) -> Array:
    """Return the time column of a table in s of bench time, shape (n,)."""
    return np.asarray(table["time_ns"] * 1e-9, dtype=np.float64)


def second_rows(table: Columns, start_s: int) -> NDArray[np.int64]:
    """Return the row of each sample's second, shape (n,): row k holds start_s + k < time <= start_s + k + 1.

    In integers: 15_000_000_000 ns times 1e-9 is more than 15 s.
    """
    return np.asarray(-(-table["time_ns"] // 1_000_000_000) - start_s - 1, dtype=np.int64)


def row_means(
    values: NDArray[Any], row: NDArray[np.int64], count: int, use: NDArray[np.bool_] | None = None
) -> Array:
    """Return the means of the values of each row, (count,), NaN for a row without any.

    Left out: NaN, values of rows outside, and those that `use` (n,) says.
    """
    values = values.astype(np.float64)
    kept = (row >= 0) & (row < count) & ~np.isnan(values)
    if use is not None:
        kept &= use
    sums = np.bincount(row[kept], values[kept], count)
    samples = np.bincount(row[kept], minlength=count)
    return np.where(samples > 0, sums / np.maximum(samples, 1), np.nan)


def names_at(starts_s: Sequence[float], names: Sequence[str], times_s: Array) -> NDArray[np.str_]:
    """Return the name that holds at every time, (n,): each from its start on, the first one before it, too."""
    row = np.searchsorted(np.array(starts_s), times_s, side="right") - 1
    return np.asarray(np.array(names)[np.maximum(row, 0)])
