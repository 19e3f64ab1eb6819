"""Values to bytes: data messages of Format A, B and C, and the built-in-test message."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.kvh.format import ALL_VALID, TEMP_EVERY, Format, TempUnits, layout, temperature_field


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
