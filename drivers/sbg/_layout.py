"""Messages of a DBC file compiled to shifts and masks over batches of frames.

cantools reads the file; decoding with it costs some 10 us a message, so that its description is turned once into
operations on 64-bit words. DBC bit numbering: Vector, DBC File Format, section 7 (signal definitions).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cantools
import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.errors import ConfigurationError


@dataclass(frozen=True)
class SignalLayout:
    """One signal: `bits` bits at `shift` of the payload read as one little- or big-endian 64-bit word.

    Physical value = raw * `scale` + `offset`, in `unit`.
    """

    name: str
    shift: int
    bits: int
    big_endian: bool
    signed: bool
    scale: float
    offset: float
    unit: str

    def raw(self, data: NDArray[np.uint8]) -> NDArray[np.int64]:
        """Return the raw values in payloads `data`, shape (n, 8) to (n,)."""
        words = np.ascontiguousarray(data).view(">u8" if self.big_endian else "<u8")[:, 0]
        left = np.uint64(64 - self.bits - self.shift)
        right = np.uint64(64 - self.bits)
        # To the top of the word, then back: the signed shift repeats the sign bit on its way.
        top = words.astype(np.uint64) << left
        return top.view(np.int64) >> right.view(np.int64) if self.signed else (top >> right).view(np.int64)

    def physical(self, data: NDArray[np.uint8]) -> NDArray[np.float64]:
        """Return the physical values in payloads `data`, shape (n, 8) to (n,)."""
        return self.raw(data).astype(np.float64) * self.scale + self.offset

    def quantise(self, physical: ArrayLike) -> NDArray[np.int64]:
        """Return the nearest raw values, halves away from zero, saturated at the ends of the signal's range."""
        steps = (np.asarray(physical, np.float64) - self.offset) / self.scale
        low, high = (
            (-(1 << self.bits - 1), (1 << self.bits - 1) - 1) if self.signed else (0, (1 << self.bits) - 1)
        )
        nearest = np.trunc(steps + np.copysign(0.5, steps))
        return np.minimum(np.maximum(nearest, low), high).astype(np.int64)


@dataclass(frozen=True)
class MessageLayout:
    """One message: its identifier, least payload length in bytes, and signals by name."""

    name: str
    identifier: int
    extended: bool
    length: int
    signals: Mapping[str, SignalLayout]

    def pack(self, raw: Mapping[str, ArrayLike], count: int) -> NDArray[np.uint8]:
        """Return payloads, shape (count, 8), with raw values by signal name, (count,) or scalar."""
        words = {False: np.zeros(count, np.int64), True: np.zeros(count, np.int64)}
        for name, values in raw.items():
            signal = self.signals[name]
            words[signal.big_endian] |= (np.asarray(values) & (1 << signal.bits) - 1) << signal.shift
        payload: NDArray[np.int64] = words[False].astype("<i8") | words[True].astype(">i8").view("<i8")
        return payload.view(np.uint8).reshape(-1, 8)


def load_message(path: Path, name: str) -> MessageLayout:
    """Return the layout of message `name` of a DBC file.

    Raises ConfigurationError for a file that cannot be read, one without the message, and a message with
    multiplexed or floating-point signals, signals of more than 53 bits or more than 8 bytes.
    """
    try:
        return compile_message(_database(path).get_message_by_name(name))
    except KeyError as error:
        raise ConfigurationError(
            f"the DBC file has no message {name}",
            where=str(path),
            expected="a DBC file with the maker's message names",
        ) from error


@lru_cache
def _database(path: Path) -> Any:
    try:
        return cantools.database.load_file(path, database_format="dbc", encoding="cp1252")
    except (OSError, ValueError, cantools.Error) as error:
        raise ConfigurationError(
            "the DBC file cannot be read",
            where=str(path),
            found=str(error),
            expected="a DBC file that describes the unit's messages",
        ) from error


def compile_message(message: Any) -> MessageLayout:
    """Return the layout of one cantools message; raises ConfigurationError for what is not supported."""
    odd_signal = any(signal.is_float or signal.length > 53 for signal in message.signals)
    if message.length > 8 or message.is_multiplexed() or odd_signal:
        raise ConfigurationError(
            f"message {message.name} has a layout that is not supported",
            found="more than 8 bytes, or multiplexed, floating-point or very wide signals",
            expected="integer signals of at most 53 bits in at most 8 bytes",
        )
    return MessageLayout(
        name=message.name,
        identifier=message.frame_id,
        extended=message.is_extended_frame,
        length=message.length,
        signals={signal.name: _compile_signal(signal) for signal in message.signals},
    )


def _compile_signal(signal: Any) -> SignalLayout:
    big_endian = signal.byte_order == "big_endian"
    if big_endian:  # `start` is the most significant bit; bit 7 of byte 0 is the top of the word
        top = 8 * (signal.start // 8) + 7 - signal.start % 8
        shift = 64 - top - signal.length
    else:
        shift = signal.start
    return SignalLayout(
        name=signal.name,
        shift=shift,
        bits=signal.length,
        big_endian=big_endian,
        signed=signal.is_signed,
        scale=float(signal.scale),
        offset=float(signal.offset),
        unit=signal.unit or "",
    )
