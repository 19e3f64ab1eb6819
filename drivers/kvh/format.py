"""What is on the wire: layout, check, status and units of KVH Format A, B and C messages.

Source: KVH 56-0298 Rev B, "1775 IMU Interface Control Document", tables 5-1 to 5-9 (the same formats come out of
the DSP-1750 and DSP-1760, where unused axes and accelerometers are reserved bytes).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.kit.framing import Crc, PositionalCrc

Format = Literal["A", "B", "C"]
Rotation = Literal["delta", "rate"]
RotationUnits = Literal["RAD", "DEG"]
TempUnits = Literal["C", "C_100", "F", "F_100"]

AXES = "xyz"
COUNTER_MODULO = 128
ALL_VALID = 0x77
RATES_HZ = (1, 5, 10, 25, 50, 100, 250, 500, 750, 1000, 3600, 5000)
CRC = Crc(width=32, poly=0x04C11DB7, init=0xFFFFFFFF)
TEMP_EVERY = 4
"""Format C carries the temperature where the counter is a multiple of this, a magnetometer axis elsewhere."""

_HEAD = [("sync", "V4"), ("rot", ">f4", (3,)), ("acc", ">f4", (3,))]
_TAIL = [("status", "u1"), ("counter", "u1")]
_LAYOUTS: dict[Format, tuple[bytes, list[Any]]] = {
    "A": (bytes.fromhex("FE81FF55"), [*_HEAD, *_TAIL, ("temp", ">i2"), ("crc", ">u4")]),
    "B": (
        bytes.fromhex("FE81FF56"),
        [*_HEAD, ("timestamp_us", ">u4"), *_TAIL, ("temp", ">i2"), ("crc", ">u4")],
    ),
    "C": (bytes.fromhex("FE81FF57"), [*_HEAD, ("temp", ">f4"), *_TAIL, ("crc", ">u4")]),
}


@dataclass(frozen=True)
class FrameLayout:
    """One of the three data messages: header, numpy layout (packed, big-endian), CRC of all but itself."""

    sync: bytes
    dtype: np.dtype[np.void]
    crc: PositionalCrc

    @property
    def length(self) -> int:
        """Bytes a message."""
        return self.dtype.itemsize

    def sound(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        """Return which of `rows`, uint8 (n, length), each beginning with the header, carry their own CRC."""
        sent = rows.view(self.dtype)["crc"][:, 0]
        good: NDArray[np.bool_] = self.crc(rows[:, len(self.sync) : -4]) == sent
        return good


@cache
def layout(frame_format: Format) -> FrameLayout:
    """Return the layout of a format (made once a process)."""
    sync, fields = _LAYOUTS[frame_format]
    dtype = np.dtype(fields)
    return FrameLayout(sync, dtype, PositionalCrc(CRC, sync, dtype.itemsize - len(sync) - 4))


def valid_mask(axes: str) -> int:
    """Return the status bits that are 1 when the gyros of `axes` deliver valid data (table 5-8)."""
    return sum(1 << AXES.index(axis) for axis in axes)


def rate_dps(
    rot: NDArray[Any], fmt: Rotation, units: RotationUnits, sample_rate_hz: float
) -> NDArray[np.float64]:
    """Return the angular rate of `rot` as sent under =ROTFMT `fmt` and =ROTUNITS `units`, any shape.

    A delta angle is the rotation over one sample interval, so its rate takes the true `sample_rate_hz`
    (measured, not the one asked for); with =ROTFMT,RATE the rate itself is sent and the sample rate is not used.
    """
    scale = 1.0 if units == "DEG" else 180.0 / np.pi
    if fmt == "delta":
        scale *= sample_rate_hz
    rate: NDArray[np.float64] = np.multiply(rot, scale, dtype=np.float64)
    return rate


def celsius(raw: NDArray[Any], units: TempUnits) -> NDArray[np.float32]:
    """Return degrees Celsius, float32, from the temperature field under =TEMPUNITS `units`."""
    with np.errstate(invalid="ignore"):  # A signalling NaN is only a pattern of bits to a decoder.
        temp = raw.astype(np.float32) * np.float32(0.01 if units.endswith("_100") else 1.0)
        if units.startswith("F"):
            temp = (temp - np.float32(32.0)) * np.float32(5.0 / 9.0)
    return temp


def temperature_field(temp_c: ArrayLike, units: TempUnits) -> NDArray[np.float64]:
    """Return what the temperature field says for `temp_c` under =TEMPUNITS `units`, not yet rounded."""
    temp = np.asarray(temp_c, np.float64)
    if units.startswith("F"):
        temp = temp * 1.8 + 32.0
    return temp * 100.0 if units.endswith("_100") else temp
