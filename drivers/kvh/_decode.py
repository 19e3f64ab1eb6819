"""Bytes to values: the incremental decoder of Format A, B and C streams."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.kit.framing import FrameSplitter
from drivers.kit.instruments import FrameBatch
from drivers.kvh.format import (
    AXES,
    COUNTER_MODULO,
    TEMP_EVERY,
    Format,
    TempUnits,
    celsius,
    layout,
    valid_mask,
)


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
