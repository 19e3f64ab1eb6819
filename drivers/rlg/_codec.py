"""The two-temperature frame: values to bytes and bytes to values; the layout is in the package's docstring."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.framing import Crc, FrameSplitter, PositionalCrc
from drivers.instruments import FrameBatch

SYNC = bytes.fromhex("EB90")
LSB_ARCSEC = 1e-3
TEMP_LSB_C = 0.01
COUNTER_MODULO = 1 << 16
GOOD = 0b11
"""Status bits of a valid frame."""
_DTYPE = np.dtype(
    [
        ("sync", "V2"),
        ("increment", ">i4"),
        ("case", ">i2"),
        ("block", ">i2"),
        ("counter", ">u2"),
        ("status", "u1"),
        ("crc", ">u2"),
    ]
)
LENGTH = _DTYPE.itemsize
_COVERED = slice(len(SYNC), LENGTH - 2)
_CRC = PositionalCrc(Crc(16, 0x1021, 0xFFFF), b"", LENGTH - len(SYNC) - 2)


def encode_frames(
    increment_arcsec: NDArray[np.floating[Any]],
    *,
    case_temp_c: ArrayLike,
    block_temp_c: ArrayLike,
    counter: ArrayLike,
    status: ArrayLike = GOOD,
) -> bytes:
    """Return the frames of `increment_arcsec`, shape (n,); the rest (n,) or one value for all.

    Values are rounded to their LSB and saturate; the counter is taken modulo 65536.
    """
    frames = np.empty(len(increment_arcsec), _DTYPE)
    frames["sync"] = np.void(SYNC)
    limit = 2**31 - 1
    frames["increment"] = np.rint(np.asarray(increment_arcsec) / LSB_ARCSEC).clip(-limit - 1, limit)
    for name, temp_c in (("case", case_temp_c), ("block", block_temp_c)):
        frames[name] = np.rint(np.asarray(temp_c) / TEMP_LSB_C).clip(-32768, 32767)
    frames["counter"] = np.asarray(counter) % COUNTER_MODULO
    frames["status"] = status
    rows = frames.view(np.uint8).reshape(len(frames), LENGTH)
    frames["crc"] = _CRC(rows[:, _COVERED])
    return frames.tobytes()


def _sound(rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
    good: NDArray[np.bool_] = _CRC(rows[:, _COVERED]) == rows.view(_DTYPE)["crc"][:, 0]
    return good


class RlgDecoder:
    """Incremental decoder (`drivers.instruments.StreamDecoder`).

    Columns, shape (n,): `counter` int64; `status` uint8; `valid` bool; `increment_arcsec` float64; `temp_c` the
    cavity block (T2) and `case_temp_c` the case (T1), float32.
    """

    counter_modulo: int = COUNTER_MODULO
    counter_step: float = 1.0

    def __init__(self, nominal_rate_hz: float) -> None:
        self.nominal_rate_hz = nominal_rate_hz
        self._splitter = FrameSplitter(SYNC, LENGTH, _sound)
        self.counts = self._splitter.counts

    def feed(self, data: bytes) -> FrameBatch:
        """Decode the next bytes of the stream; an incomplete frame is kept for the next call."""
        rows, ends = self._splitter.feed(data)
        frames = rows.view(_DTYPE)[:, 0]
        status = frames["status"].copy()
        columns: dict[str, NDArray[Any]] = {
            "counter": frames["counter"].astype(np.int64),
            "status": status,
            "valid": (status & GOOD) == GOOD,
            "increment_arcsec": frames["increment"] * LSB_ARCSEC,
            "temp_c": (frames["block"] * TEMP_LSB_C).astype(np.float32),
            "case_temp_c": (frames["case"] * TEMP_LSB_C).astype(np.float32),
        }
        return FrameBatch(columns, ends)
