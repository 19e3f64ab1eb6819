"""Files of arrays: MAT and HDF5, and the columns that arrays have."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from bench.record.recording import check_room
from drivers.base.plugins import from_extra


def columns_of(file: Path, name: str, array: Any, words: Any) -> dict[str, Any]:
    """Return the columns of one array: fields of records, a vector, or a matrix upright or lying."""
    if array.dtype.names:
        parts = {key: np.squeeze(array[key]) for key in array.dtype.names}
        parts = {
            key: part for key, part in parts.items() if part.dtype.kind in "iufb" and len(part) == len(array)
        }
        columns: dict[str, Any] = {}
        for key, part in parts.items():
            columns |= {key: part} if part.ndim == 1 else columns_of(file, key, part, ())
        return columns
    if array.ndim == 1:
        return {name or "c1": array}
    upright = array if array.shape[0] >= array.shape[1] else array.T
    check_room(str(file), *upright.shape)
    width = upright.shape[1]
    if len(words) == width and len({str(word) for word in words}) == width:
        return {".".join(filter(None, (name, str(words[k])))): upright[:, k] for k in range(width)}
    return {f"{name or 'c'}{k + 1}": upright[:, k] for k in range(width)}


def is_text(file: Path) -> bool:
    """Return whether a file is text whatever its name's ending says: a table saved as .mat or .dat, say."""
    with file.open("rb") as source:
        head = source.read(1024)
    return b"\0" not in head and not head.startswith((b"MATLAB", b"MDF", b"\x89HDF"))


def mat_arrays(file: Path) -> dict[str, Any]:
    """Return the arrays of a MAT file by name, fields of structs as STRUCT.FIELD."""
    from scipy.io import loadmat

    try:
        content = loadmat(file, squeeze_me=True, struct_as_record=True)
    except NotImplementedError:  # MATLAB 7.3 writes HDF5
        return hdf5_arrays(file)
    arrays: dict[str, Any] = {}
    for name, value in content.items():
        if not isinstance(value, np.ndarray):
            continue
        if value.dtype.names and value.ndim == 0:  # a struct: its fields
            arrays |= {f"{name}.{key}": np.asarray(value[key].item()) for key in value.dtype.names}
        else:
            arrays[name] = value
    return arrays


def hdf5_arrays(file: Path) -> dict[str, Any]:
    """Return the data sets of an HDF5 file by their path."""
    h5py = from_extra("h5py", "exchange", "reading HDF5 files (MATLAB 7.3 too)")
    arrays: dict[str, Any] = {}
    with h5py.File(file) as content:
        content.visititems(
            lambda name, node: arrays.update({name: node[()]}) if isinstance(node, h5py.Dataset) else None
        )
    return {name: value for name, value in arrays.items() if isinstance(value, np.ndarray)}
