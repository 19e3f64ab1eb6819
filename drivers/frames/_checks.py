"""Checksums of many frames of one length at once: computed, compared, written."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.frames._model import Checksum, Endian
from drivers.framing import Crc, PositionalCrc

Bytes = NDArray[np.uint8]
_SIZES = {"sum8": 1, "xor8": 1, "neg8": 1, "crc8": 1, "sum16": 2, "sum16_words": 2, "crc16": 2, "crc32": 4}


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

    def of(self, rows: Bytes) -> NDArray[np.uint32]:
        """Return the check of each row."""
        first, end = self._ranges[0]
        covered = rows[:, first:end]
        if len(self._ranges) > 1:
            covered = np.concatenate([rows[:, first:end] for first, end in self._ranges], axis=1)
        if self._crc is not None:
            return self._crc(covered)
        if self._kind == "xor8":
            folded = np.bitwise_xor.reduce(covered.T, axis=0) if covered.shape[1] else rows[:, 0] * 0
            return folded.astype(np.uint32) ^ np.uint32(self._init)
        if self._kind == "sum16_words":
            words = np.ascontiguousarray(covered).view(self._words)
            return _sum(words, self._init) & np.uint32(0xFFFF)
        total = _sum(covered, self._init)
        if self._kind == "neg8":
            return (np.uint32(0) - total) & np.uint32(0xFF)
        return total & np.uint32(0xFFFF if self._kind == "sum16" else 0xFF)


def _sum(columns: NDArray[Any], init: int) -> NDArray[np.uint32]:
    """Return the sum of each row, column after column: rows are short and many."""
    total = np.full(len(columns), init, np.uint32)
    for at in range(columns.shape[1]):
        total += columns[:, at]
    return total


def stored_number(dtype: str, at: int, length: int) -> np.dtype[np.void]:
    """Return the dtype that views a row of `length` bytes as the one number `value` at `at`."""
    return np.dtype({"names": ["value"], "formats": [dtype], "offsets": [at], "itemsize": length})
