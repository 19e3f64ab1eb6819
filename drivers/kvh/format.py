"""KVH Format A, B and C messages: layout, check, status and units, decoder and encoder.

Source: KVH 56-0298 Rev B, "1775 IMU Interface Control Document", tables 5-1 to 5-9 (the same formats come out of
the DSP-1750 and DSP-1760, where unused axes and accelerometers are reserved bytes).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.kit.framing import Crc, FrameSplitter, PositionalCrc
from drivers.kit.instruments import FrameBatch

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


class KvhDecoder:
    """Incremental decoder (`drivers.kit.instruments.StreamDecoder`) of one KVH gyro's stream.

    Columns, each of shape (n,): `counter` int64 0..127; `status` uint8 as sent; `valid` bool, all the unit's
    own gyros valid; `rot_<axis>` float32 as sent for each of `axes`; `temp_c` float32 (Format C sends it every
    fourth message: NaN elsewhere); Format B also `timestamp_us` int64, wrapping at 2**32. `rate_dps` of this
    package converts `rot_<axis>`. Bytes of axes the unit does not have are not looked at. Built-in-test messages
    in the stream count as bytes skipped.
    """

    counter_modulo: int = COUNTER_MODULO
    counter_step: float = 1.0

    def __init__(
        self,
        *,
        nominal_rate_hz: float,
        frame_format: Format = "A",
        axes: str = "x",
        temp_units: TempUnits = "C_100",
    ) -> None:
        self.nominal_rate_hz = nominal_rate_hz
        self.axes = axes
        self._format = frame_format
        self._temp_units = temp_units
        self._dtype = layout(frame_format).dtype
        self._mask = np.uint8(valid_mask(axes))
        self._axes = [(f"rot_{axis}", AXES.index(axis)) for axis in axes]
        self._splitter = FrameSplitter(
            layout(frame_format).sync, layout(frame_format).length, layout(frame_format).sound
        )
        self.counts = self._splitter.counts

    def feed(self, data: bytes) -> FrameBatch:
        """Decode the next bytes of the stream; an incomplete message is kept for the next call."""
        rows, ends = self._splitter.feed(data)
        frames = rows.view(self._dtype)[:, 0]
        status = frames["status"].copy()
        columns: dict[str, NDArray[Any]] = {
            "counter": frames["counter"].astype(np.int64),
            "status": status,
            "valid": (status & self._mask) == self._mask,
        }
        rot = frames["rot"]
        for name, at in self._axes:
            columns[name] = rot[:, at].astype(np.float32)
        columns["temp_c"] = celsius(frames["temp"], self._temp_units)
        if self._format == "B":
            columns["timestamp_us"] = frames["timestamp_us"].astype(np.int64)
        if self._format == "C":
            columns["temp_c"][columns["counter"] % TEMP_EVERY != 0] = np.nan
        return FrameBatch(columns, ends)


def encode_frames(
    frame_format: Format,
    rot: NDArray[np.floating],
    *,
    counter: ArrayLike,
    temp_c: ArrayLike,
    temp_units: TempUnits = "C_100",
    status: ArrayLike = ALL_VALID,
    acc_g: ArrayLike = 0.0,
    timestamp_us: ArrayLike = 0,
) -> bytes:
    """Return the messages for `rot`, shape (n, 3), in the unit to be sent; the rest (n,) or one value for all.

    The counter is taken modulo 128, the timestamp (Format B) modulo 2**32; an integer temperature is rounded and
    saturates. Format C carries the temperature where the counter is a multiple of 4 and zero (no magnetic
    field) elsewhere.
    """
    form = layout(frame_format)
    frames = np.empty(len(rot), form.dtype)
    frames["sync"] = np.void(form.sync)
    frames["rot"] = rot
    frames["acc"] = acc_g
    frames["status"] = status
    numbers = np.asarray(counter) & 0x7F
    frames["counter"] = numbers
    field = temperature_field(temp_c, temp_units)
    if frame_format == "C":
        frames["temp"] = np.where(numbers % TEMP_EVERY == 0, field, 0.0)
    else:
        frames["temp"] = np.rint(field).clip(-32768, 32767)
    if frame_format == "B":
        frames["timestamp_us"] = np.asarray(timestamp_us) & 0xFFFFFFFF
    rows = frames.view(np.uint8).reshape(len(rot), form.length)
    frames["crc"] = form.crc(rows[:, len(form.sync) : -4])
    return frames.tobytes()


def encode_bit(results: bytes) -> bytes:
    """Return the built-in-test message: 6 bytes of `results` (?BIT) or 8 (?BIT,2), and their sum modulo 256.

    KVH 56-0298 Rev B, section 5.3. The technical manual's example of 8 bytes has the header of 6.
    """
    message = bytes.fromhex("FE8100AA" if len(results) == 6 else "FE8100AB") + results
    return message + bytes([sum(message) & 0xFF])
