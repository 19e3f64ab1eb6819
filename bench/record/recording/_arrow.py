"""numpy columns to Arrow and back through their buffers.

pyarrow's own conversions import pandas when it is installed: more than a second of start-up that writing or
reading a run does not need.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray


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
