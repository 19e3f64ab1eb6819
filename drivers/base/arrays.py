"""The array type of all rooms, and arrays from files of strangers: nothing is executed, nothing grows unseen."""

from __future__ import annotations

import zipfile
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
"""Real numbers in double precision; a docstring gives shape and unit."""

ARCHIVE_DAMAGE = (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile, zlib.error, RecursionError)
"""What reading a damaged archive raises."""
_MOST_BYTES = 256 << 20


def read_archive(path: Path) -> dict[str, bytes]:
    """Return the entries of a zip by name; ValueError if they unpack to more than 256 MiB."""
    with zipfile.ZipFile(path) as archive:
        sizes = {entry.filename: entry.file_size for entry in archive.infolist()}
        if sum(sizes.values()) > _MOST_BYTES:
            raise ValueError(f"more than {_MOST_BYTES >> 20} MiB unpacked")
        return {name: _unpacked(archive, name, size) for name, size in sizes.items()}


def _unpacked(archive: zipfile.ZipFile, name: str, size: int) -> bytes:
    """Return an entry, and never more than the directory says: a damaged one may unpack to gigabytes."""
    with archive.open(name) as file:
        return file.read(size)


def array_of(data: bytes) -> NDArray[Any]:
    """Return the array of an .npy text.

    Made from the bytes that are there, never with room for what the header claims: numpy refuses objects, and a
    shape that does not fit.
    """
    buffer = BytesIO(data)
    if np.lib.format.read_magic(buffer) != (1, 0):
        raise ValueError("an array of another format than 1.0")
    shape, column_order, kind = np.lib.format.read_array_header_1_0(buffer)
    array = np.frombuffer(data[buffer.tell() :], kind).reshape(shape, order="F" if column_order else "C")
    return array.copy()
