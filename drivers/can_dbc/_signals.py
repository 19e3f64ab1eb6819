"""Signals and messages of classic CAN compiled to shifts and masks over batches of payloads.

DBC bit numbering: Vector, DBC File Format, section 7 (signal definitions). A payload is eight bytes, the unused
ones zero; a signal is a bit field of the payload read as one little- or big-endian 64-bit word.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Bytes = NDArray[np.uint8]
Flags = NDArray[np.bool_]

_WHOLE_BYTES = (8, 16, 32, 64)


@dataclass(frozen=True)
class SignalLayout:
    """One signal: `bits` bits at `shift` of the payload read as one little- or big-endian 64-bit word.

    Physical value = raw * `scale` + `offset`, in `unit`; raw is IEEE 754 if `is_float`. `selectors`: the signal
    is in a payload only if each of these multiplexers has one of its values there (outermost first).
    """

    name: str
    shift: int
    bits: int
    big_endian: bool
    signed: bool
    scale: float
    offset: float
    unit: str
    is_float: bool = False
    selectors: tuple[tuple[SignalLayout, tuple[int, ...]], ...] = ()

    def raw(self, data: Bytes) -> NDArray[Any]:
        """Return the raw values in payloads `data`, shape (n, 8) to (n,).

        int64; uint64 for unsigned signals of 64 bits, float64 for floating-point ones.
        """
        values = self._field(data)
        if self.is_float:
            return values.astype(np.float64)
        return values if values.dtype == np.uint64 and self.bits == 64 else values.astype(np.int64)

    def physical(self, data: Bytes) -> NDArray[np.float64]:
        """Return the physical values in payloads `data`, shape (n, 8) to (n,)."""
        values = self._field(data).astype(np.float64)
        if self.scale != 1.0:
            values *= self.scale
        if self.offset:
            values += self.offset
        return values

    def present(self, data: Bytes) -> Flags:
        """Return in which payloads the signal is, shape (n, 8) to (n,): all, unless it is multiplexed."""
        found = np.ones(len(data), np.bool_)
        for multiplexer, values in self.selectors:
            found &= np.isin(multiplexer.raw(data), values)
        return found

    def quantise(self, physical: ArrayLike) -> NDArray[Any]:
        """Return the nearest raw values, halves away from zero, saturated at the ends of the signal's range.

        The bit pattern for a floating-point signal. int64, uint64 for unsigned signals of 64 bits.
        """
        steps = (np.asarray(physical, np.float64) - self.offset) / self.scale
        if self.is_float:
            return steps.astype(f"f{self.bits // 8}").view(f"u{self.bits // 8}").astype(np.uint64)
        low, high = -(1 << self.bits - 1) if self.signed else 0, (1 << self.bits - self.signed) - 1
        kind: type[np.int64] | type[np.uint64] = np.uint64 if self._wide else np.int64
        nearest = np.trunc(steps + np.copysign(0.5, steps))
        inside = np.clip(nearest, float(low), np.nextafter(float(high) + 1.0, 0.0)).astype(kind)
        return np.asarray(np.where(nearest >= float(high), kind(high), inside))

    @property
    def _wide(self) -> bool:
        return self.bits == 64 and not self.signed

    @cached_property
    def _in_place(self) -> tuple[int, np.dtype[Any]] | None:
        """First byte and type of a signal of whole bytes, None for one that has to be shifted."""
        if self.bits not in _WHOLE_BYTES or self.shift % 8 or (self.is_float and self.bits == 8):
            return None
        first = 8 - (self.shift + self.bits) // 8 if self.big_endian else self.shift // 8
        kind = "f" if self.is_float else "i" if self.signed else "u"
        return first, np.dtype(f"{'>' if self.big_endian else '<'}{kind}{self.bits // 8}")

    def _field(self, data: Bytes) -> NDArray[Any]:
        """Return the values in the narrowest type at hand; a view of `data` if the signal is of whole bytes."""
        if self._in_place is not None:
            first, kind = self._in_place
            return data[:, first : first + kind.itemsize].view(kind)[:, 0]
        words = data.view(">u8" if self.big_endian else "<u8")[:, 0]
        right = np.uint64(64 - self.bits)
        # To the top of the word, then back: the signed shift repeats the sign bit on its way.
        top: NDArray[Any] = words.astype(np.uint64) << np.uint64(64 - self.bits - self.shift)
        if self.is_float:
            return (top >> right).astype(f"u{self.bits // 8}").view(f"f{self.bits // 8}")
        return top.view(np.int64) >> right.view(np.int64) if self.signed else top >> right


@dataclass(frozen=True)
class MessageLayout:
    """One message: its identifier, least payload length in bytes, and signals by name.

    `identifier_mask`: the bits of the identifier that tell the message; a J1939 message is told by its parameter
    group alone, whoever sends it and at whatever priority.
    """

    name: str
    identifier: int
    extended: bool
    length: int
    signals: Mapping[str, SignalLayout]
    identifier_mask: int = 0x1FFF_FFFF

    def sent_by(self, identifiers: NDArray[np.uint32], extended: Flags) -> Flags:
        """Return which frames are this message, shape (n,); remote frames among them (they are too short)."""
        if self.identifier_mask == 0x1FFF_FFFF:
            return np.asarray((identifiers == self.identifier) & (extended == self.extended))
        mask = np.uint32(self.identifier_mask)
        return np.asarray(((identifiers & mask) == (self.identifier & mask)) & (extended == self.extended))

    def pack(self, raw: Mapping[str, ArrayLike], count: int) -> Bytes:
        """Return payloads, shape (count, 8), with raw values (see `quantise`) by name, (count,) or scalar."""
        words = {False: np.zeros(count, np.uint64), True: np.zeros(count, np.uint64)}
        for name, values in raw.items():
            signal = self.signals[name]
            mask = np.uint64((1 << signal.bits) - 1)
            bits = np.asarray(values)
            bits = bits if bits.dtype == np.uint64 else bits.astype(np.int64).view(np.uint64)
            words[signal.big_endian] |= (bits & mask) << np.uint64(signal.shift)
        payload = words[False].astype("<u8") | words[True].astype(">u8").view("<u8")
        return np.asarray(payload.astype("<u8").view(np.uint8).reshape(-1, 8))
