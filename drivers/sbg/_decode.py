"""slcan lines of an SBG Ellipse to samples."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import ConfigurationError
from drivers.instruments import FrameBatch, StreamCounts
from drivers.sbg._layout import MessageLayout
from drivers.sbg._messages import AXES, COUNTER_MODULO, ELLIPSE_DBC, load_ellipse, valid_mask
from drivers.slcan import FRAME_DTYPE, SlcanParser


class SbgDecoder:
    """One row for every IMU_GYRO that directly follows its IMU_INFO, other messages and answers aside.

    Columns, shape (n,): `counter` (int64, us modulo 2**32), `status` (uint16), `rate_<axis>_dps` (float32) for
    each of `axes`, `temp_c` (float32), `valid` (bool, see `valid_mask`). `counts.frames` are rows;
    `counts.rejected` has slcan lines by `SlcanParser`'s reasons, and messages by `short_message` (DLC below the
    message's length; a longer one is read as far as it is known), `unpaired` (IMU_GYRO without IMU_INFO just
    before it) and `unknown_id` (no message of the Ellipse). A damaged line between the two parts them, since it
    may have been the IMU_INFO that belongs to this IMU_GYRO.
    """

    def __init__(self, rate_hz: float, axes: str = AXES, dbc: Path = ELLIPSE_DBC) -> None:
        """Raises ConfigurationError for a rate or axes that cannot be, or a DBC file without the messages."""
        if not rate_hz > 0.0 or not axes or len(set(axes)) < len(axes) or not set(axes) <= set(AXES):
            raise ConfigurationError(
                "these settings cannot be an SBG Ellipse's",
                found=f"rate_hz = {rate_hz!r}, axes = {axes!r}",
                expected="a positive rate, and axes out of x, y, z",
            )
        self.counts = StreamCounts()
        self.counter_modulo = COUNTER_MODULO
        self.counter_step = 1e6 / rate_hz
        self.nominal_rate_hz = rate_hz
        self._axes = axes
        self._messages = load_ellipse(dbc)
        self._valid_mask = np.uint16(valid_mask(axes))
        self._lines = SlcanParser()
        self._own_rejected: dict[str, int] = {}
        self._waiting = np.empty(0, FRAME_DTYPE)

    def feed(self, data: bytes) -> FrameBatch:
        """Decode the next bytes; an IMU_INFO whose IMU_GYRO is still to come is kept for the next call."""
        info, gyro = self._take_pairs(self._lines.feed(data))
        self.counts.frames += len(gyro)
        self.counts.bytes_skipped = self._lines.counts.bytes_skipped
        self.counts.rejected = self._lines.counts.rejected | self._own_rejected
        return FrameBatch(self._columns(info["data"], gyro["data"]), gyro["end_offset"].copy())

    def _take_pairs(self, frames: NDArray[np.void]) -> tuple[NDArray[np.void], NDArray[np.void]]:
        """Return the IMU_INFO and IMU_GYRO frames that belong together, shape (n,) each."""
        messages = self._messages
        is_cycle = _is(messages.info, frames) | _is(messages.gyro, frames)
        known = is_cycle | _is(messages.accel, frames) | _is(messages.status, frames)
        self._reject("unknown_id", len(frames) - np.count_nonzero(known))
        cycle = np.concatenate((self._waiting, frames[is_cycle]))
        is_info = _is(messages.info, cycle)
        whole = cycle["length"] >= np.where(is_info, messages.info.length, messages.gyro.length)
        damage = cycle["rejected_before"]
        paired = np.zeros(len(cycle), np.bool_)
        paired[1:] = whole[1:] & whole[:-1] & is_info[:-1] & ~is_info[1:] & (damage[1:] == damage[:-1])
        seen_before = len(self._waiting)
        self._reject("short_message", np.count_nonzero(~whole[seen_before:]))
        self._reject("unpaired", np.count_nonzero(whole & ~is_info & ~paired))
        self._waiting = cycle[-1:] if len(cycle) and is_info[-1] else cycle[:0]
        second = np.flatnonzero(paired)
        return cycle[second - 1], cycle[second]

    def _columns(self, info: NDArray[np.uint8], gyro: NDArray[np.uint8]) -> dict[str, NDArray[Any]]:
        signals = self._messages.info.signals
        status = signals["STATUS"].raw(info).astype(np.uint16)
        columns: dict[str, NDArray[Any]] = {"counter": signals["TIME_STAMP"].raw(info), "status": status}
        for axis in self._axes:
            rate_rad_s = self._messages.gyro.signals[f"GYRO_{axis.upper()}"].physical(gyro)
            columns[f"rate_{axis}_dps"] = np.degrees(rate_rad_s).astype(np.float32)
        columns["temp_c"] = signals["TEMPERATURE"].physical(info).astype(np.float32)
        columns["valid"] = (status & self._valid_mask) == self._valid_mask
        return columns

    def _reject(self, reason: str, count: int | np.intp) -> None:
        if count:
            self._own_rejected[reason] = self._own_rejected.get(reason, 0) + int(count)


def _is(message: MessageLayout, frames: NDArray[np.void]) -> NDArray[np.bool_]:
    """Return which frames carry `message`'s identifier, remote frames among them (they are too short)."""
    same: NDArray[np.bool_] = (frames["id"] == message.identifier) & (frames["extended"] == message.extended)
    return same
