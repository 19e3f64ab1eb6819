"""Checksums of many frames of one length at once: computed, compared, written."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.frames._model import Checksum, Endian
from drivers.kit.framing import Crc, PositionalCrc, crc_of_each

Bytes = NDArray[np.uint8]
_SIZES = {"sum8": 1, "xor8": 1, "neg8": 1, "crc8": 1, "sum16": 2, "sum16_words": 2, "crc16": 2, "crc32": 4}

_BLOCK = 8192  # Rows put together at once: they stay in the second-level cache.


def check_bytes(kind: str) -> int:
    """Return how many bytes a check of this kind takes."""
    return _SIZES[kind]


def places(spec: Checksum, length: int) -> tuple[list[tuple[int, int]], int]:
    """Return the covered ranges and the check's own place as plain offsets in a frame of `length` bytes."""
    ranges = [
        (first + length if first < 0 else first, end + length if end <= 0 else end)
        for first, end in spec.ranges
    ]
    return ranges, spec.at + length if spec.at < 0 else spec.at


class Check:
    """One check of frames of `length` bytes; `known`: first bytes that every such frame has."""

    def __init__(self, spec: Checksum, length: int, endian: Endian, known: bytes) -> None:
        self._kind = spec.kind
        self._ranges, at = places(spec, length)
        size = check_bytes(spec.kind)
        order = ">" if (spec.endian or endian) == "big" else "<"
        self._stored = stored_number(f"{order}u{size}", at, length)
        self._words = ">u2" if (spec.words or endian) == "big" else "<u2"
        self._init = spec.init
        self._crc: PositionalCrc | None = None
        if spec.kind.startswith("crc"):
            assert spec.poly is not None
            first, end = self._ranges[0]
            prefix = known[: end - first] if first == 0 else b""
            self._ranges[0] = (first + len(prefix), end)
            if len(prefix) == end and len(self._ranges) > 1:
                del self._ranges[0]
            covered = sum(end - first for first, end in self._ranges)
            padding = -(covered + len(prefix)) % spec.pad_to
            crc = Crc(8 * size, spec.poly, spec.init, spec.reflected, spec.xorout)
            self._crc = PositionalCrc(crc, prefix, covered, padding)

    def sound(self, rows: Bytes) -> NDArray[np.bool_]:
        """Return which of `rows`, uint8 (n, length), carry their own check."""
        good: NDArray[np.bool_] = self.of(rows) == rows.view(self._stored)["value"][:, 0]
        return good

    def write(self, rows: Bytes) -> None:
        """Put the check into `rows`."""
        rows.view(self._stored)["value"][:, 0] = self.of(rows)

    def of(self, rows: Bytes) -> NDArray[Any]:
        """Return the check of each row, unsigned integers (n,)."""
        first, end = self._ranges[0]
        covered = rows[:, first:end]
        if len(self._ranges) > 1:
            covered = np.concatenate([rows[:, first:end] for first, end in self._ranges], axis=1)
        if self._crc is not None:
            return self._crc(covered)
        if self._kind == "sum16_words":
            return _folded(np.add, covered.view(self._words), np.uint16) + np.uint16(self._init & 0xFFFF)
        if self._kind == "xor8":
            return _folded(np.bitwise_xor, covered, np.uint8) ^ np.uint8(self._init & 0xFF)
        size = np.uint16 if self._kind == "sum16" else np.uint8
        total = _folded(np.add, covered, size) + size(self._init & np.iinfo(size).max)
        return size(0) - total if self._kind == "neg8" else total


def crcs_hold(spec: Checksum, endian: Endian, frames: Sequence[bytes]) -> NDArray[np.bool_]:
    """Return which frames, of any lengths, carry their own CRC (n,): as Check.sound, with no layout for each."""
    assert spec.poly is not None
    size = check_bytes(spec.kind)
    messages: list[bytes] = []
    stored: list[int] = []
    for frame in frames:
        ranges, at = places(spec, len(frame))
        message = b"".join(frame[first:end] for first, end in ranges)
        messages.append(message + bytes(-len(message) % spec.pad_to))
        stored.append(int.from_bytes(frame[at : at + size], spec.endian or endian))
    crc = Crc(8 * size, spec.poly, spec.init, spec.reflected, spec.xorout)
    good: NDArray[np.bool_] = crc_of_each(crc, messages) == np.array(stored, np.uint32)
    return good


def _folded(how: np.ufunc, columns: NDArray[Any], dtype: type[np.unsignedinteger[Any]]) -> NDArray[Any]:
    """Return all columns of each row put together, modulo `dtype`; many short rows are turned round first."""
    result = np.empty(len(columns), dtype)
    for at in range(0, len(columns), _BLOCK):
        turned = columns[at : at + _BLOCK].T.astype(dtype, order="C")
        how.reduce(turned, axis=0, out=result[at : at + _BLOCK])
    return result


def stored_number(dtype: str, at: int, length: int) -> np.dtype[np.void]:
    """Return the dtype that views a row of `length` bytes as the one number `value` at `at`."""
    return np.dtype({"names": ["value"], "formats": [dtype], "offsets": [at], "itemsize": length})
