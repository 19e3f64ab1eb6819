"""Fields of many frames of one length at once: raw numbers, physical values, and back."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.base.constants import ZERO_CELSIUS_K
from drivers.frames._checks import stored_number
from drivers.frames._model import Endian, FieldSection, Transform, When

Bytes = NDArray[np.uint8]
Array = NDArray[Any]
_SIZES = {"u8": 1, "i8": 1, "u16": 2, "i16": 2, "u32": 4, "i32": 4, "u64": 8, "f32": 4, "f64": 8}
_EXACT = ("u8", "i8", "u16", "i16", "u24", "i24", "u32", "i32")  # A float64 holds any of them.


def record_of(codecs: Mapping[str, FieldCodec], length: int) -> np.dtype[np.void]:
    """Return the dtype that views a row of `length` bytes as what each of `codecs` reads; they may overlap."""
    return np.dtype(
        {
            "names": list(codecs),
            "formats": [codec.dtype for codec in codecs.values()],
            "offsets": [codec.place for codec in codecs.values()],
            "itemsize": length,
        }
    )


class FieldCodec:
    """One field of frames of `length` bytes."""

    def __init__(self, spec: FieldSection, length: int, endian: Endian) -> None:
        self.spec = spec
        self.at = spec.at + length if spec.at < 0 else spec.at
        self._length = length
        self._big = (spec.endian or endian) == "big"
        order = ">" if self._big else "<"
        self._shift = 0
        self._text = spec.type.startswith("text:")
        self.place = self.at
        """Where what is read begins, `dtype`."""
        if self._text:
            self.dtype = np.dtype(f"S{spec.bytes}")
        elif spec.type in _SIZES:
            self.dtype = np.dtype(f"{order}{spec.type[0]}{_SIZES[spec.type]}")
        else:
            # Three bytes are read as four, one of a neighbour with them, and shifted: one pass, sign included.
            before = self.at >= 1 if self._big else self.at + 4 > length
            self.place = self.at - 1 if before else self.at
            self._shift = 8 if before == self._big else 0
            self.dtype = np.dtype(f"{order}{spec.type[0]}4")
        self._view = stored_number(self.dtype.str, self.place, length)
        self._signed = spec.type[0] in "if"
        self._float = spec.type[0] == "f"
        whole = spec.bits is None and spec.transform is None and spec.type in _EXACT
        linear = whole and abs(spec.scale.factor) < 1e290 and (spec.scale.factor != 1.0 or spec.offset != 0.0)
        self.linear = linear and not spec.sentinel and spec.when is None and spec.valid is None
        """Whether it is always a finite number of which `linear_of` makes a value."""

    def raw(self, rows: Bytes) -> Array:
        """Return the numbers as sent, (n,), see `number`."""
        return self.number(rows.view(self._view)["value"][:, 0])

    def number(self, stored: Array) -> Array:
        """Return `stored` (n,), of `dtype`, as sent: int64, uint64, float32, float64, or bytes of a text."""
        if self._text:
            return stored.copy()
        if self._float:
            return stored.astype(stored.dtype.newbyteorder("="))
        if self.spec.type in ("u24", "i24"):
            number: Array = (self._upper(stored) >> 8).astype(np.int64)
        elif self.spec.type == "u64":
            number = stored.astype(np.uint64)
        else:
            number = stored.astype(np.int64)
        if self.spec.bits is not None:
            first, count = self.spec.bits
            number = (number >> number.dtype.type(first)) & number.dtype.type((1 << count) - 1)
        return number

    def _upper(self, stored: Array) -> Array:
        """Return numbers of three bytes in the upper bytes of four, and in the lowest any other."""
        word = stored.astype(np.int32 if self._signed else np.uint32)
        return word << self._shift if self._shift else word

    def linear_of(self, stored: Array) -> Array:
        """Return what `physical` makes of `number`, float64 (n,), in one step less."""
        factor = self.spec.scale.factor
        if self.spec.type in ("u24", "i24"):
            stored = self._upper(stored)
            if not self._shift:
                stored &= ~stored.dtype.type(0xFF)
            factor /= 256.0  # Exact, and so is the 256-fold number.
        value: Array = stored.astype(np.float64)
        value *= factor
        if self.spec.offset:
            value += self.spec.offset
        return value

    def physical(self, raw: Array, others: Mapping[str, Array]) -> Array:
        """Return what `raw` means in the field's unit; `others`: raw numbers of the fields it depends on.

        Floats where anything is scaled or can be absent (NaN), else the integers as they are.
        """
        spec = self.spec
        plain = spec.scale.factor == 1.0 and spec.offset == 0.0 and spec.transform is None
        masked = bool(spec.sentinel) or spec.when is not None or spec.valid is not None
        if self._text or (plain and not masked):
            return raw
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            if spec.transform is not None:
                value = _transformed(spec.transform, raw.astype(np.float64))
            elif plain:
                value = raw.copy() if self._float else raw.astype(np.float64)
            else:
                value = np.multiply(raw, spec.scale.factor, dtype=np.float64)
                if spec.offset:
                    value += spec.offset
        if masked:
            value[self._absent(raw, others)] = np.nan
        return value

    def _absent(self, raw: Array, others: Mapping[str, Array]) -> NDArray[np.bool_]:
        spec = self.spec
        absent = np.zeros(len(raw), np.bool_)
        bits = raw if not self._float else raw.view(f"u{raw.dtype.itemsize}")
        for value in spec.sentinel:
            same = 8 * spec.bytes
            wanted = (
                value - (1 << same) if self._signed and not self._float and value >> (same - 1) else value
            )
            absent |= bits == wanted
        if spec.valid is not None:
            absent |= bit_of(others[spec.valid.field], spec.valid.bit) != spec.valid.value
        if spec.when is not None:
            absent |= ~there(spec.when, others[spec.when.field])
        return absent

    def unphysical(self, value: Array) -> Array:
        """Return raw numbers, float64 or float of the field, that mean `value`: the inverse of `physical`.

        Integers are rounded half away from zero, not yet limited to the field.
        """
        spec = self.spec
        numbers = np.asarray(value, np.float64)
        if spec.transform is not None:
            numbers = _untransformed(spec.transform, numbers, *self.limits())
        else:
            numbers = (numbers - spec.offset) / spec.scale.factor
        if self._float:
            return numbers
        return np.trunc(numbers + np.copysign(0.5, numbers))

    def limits(self) -> tuple[int, int]:
        """Return the smallest and largest raw number of an integer field."""
        bits = 8 * self.spec.bytes if self.spec.bits is None else self.spec.bits[1]
        return (-(1 << (bits - 1)), (1 << (bits - 1)) - 1) if self._signed else (0, (1 << bits) - 1)

    def write(self, rows: Bytes, raw: Array | int | bytes) -> None:
        """Put raw numbers into `rows`; integers saturate at the field's limits."""
        if self._text or self._float:
            with np.errstate(over="ignore"):
                rows.view(self._view)["value"][:, 0] = raw
            return
        numbers = _saturated(raw, *self.limits())
        size = self.spec.bytes
        if self.spec.bits is not None:
            first, count = self.spec.bits
            before = FieldCodec(self.spec.model_copy(update={"bits": None}), self._length, self._endian())
            keep = np.uint64(((1 << 8 * size) - 1) ^ (((1 << count) - 1) << first))
            numbers = (before.raw(rows).astype(np.uint64) & keep) | (numbers << np.uint64(first))
        for byte in range(size):
            shift = np.uint64(8 * (size - 1 - byte if self._big else byte))
            rows[:, self.at + byte] = (numbers >> shift) & np.uint64(0xFF)

    def _endian(self) -> Endian:
        return "big" if self._big else "little"


def bit_of(numbers: Array, bit: int) -> Array:
    """Return one bit, 0 or 1, of each of `numbers`."""
    one = numbers.dtype.type(1)
    result: Array = (numbers >> numbers.dtype.type(bit)) & one
    return result


def there(rule: When, numbers: Array) -> NDArray[np.bool_]:
    """Return in which frames a multiplexed field is there."""
    if rule.mod is not None:
        left = numbers % numbers.dtype.type(rule.mod)
    else:
        left = numbers & numbers.dtype.type(rule.mask or 0)
    present: NDArray[np.bool_] = left == rule.equals
    return present


def _saturated(raw: Array | int | bytes, low: int, high: int) -> NDArray[np.uint64]:
    """Return whole numbers within limits as the bits of two's complement."""
    numbers = np.asarray(raw)
    if numbers.dtype.kind == "f":
        numbers = np.where(np.isnan(numbers), 0.0, numbers)
        # The largest double below 2**64 or 2**63 is what a 64-bit field can be given exactly.
        top = float(high) if high < 1 << 53 else np.nextafter(float(high), 0.0)
        numbers = numbers.clip(float(low), top)
        return numbers.astype(np.int64 if low else np.uint64).astype(np.uint64)
    if numbers.dtype.kind == "u":
        return numbers.astype(np.uint64).clip(0, np.uint64(high))
    return numbers.astype(np.int64).clip(low, min(high, (1 << 63) - 1)).astype(np.uint64)


def _transformed(rule: Transform, raw: Array) -> Array:
    if rule.kind == "table":
        return np.interp(raw, rule.xs, rule.ys)
    if rule.kind == "polynomial":
        return np.polynomial.polynomial.polyval(raw, rule.coefficients)
    raw = np.where((raw > 0.0) & (raw < rule.full), raw, np.nan)  # Otherwise open or shorted.
    log = np.log(rule.k * raw / (rule.full - raw))
    inverse = rule.a + log * (rule.b + log * (rule.c + log * rule.d))
    result: Array = 1.0 / inverse - ZERO_CELSIUS_K
    return result


def _untransformed(rule: Transform, value: Array, low: int, high: int) -> Array:
    """Return the raw numbers nearest to `value` on a transform that rises or falls throughout."""
    raw = np.linspace(low, high, min(high - low + 1, 1 << 16))
    with np.errstate(invalid="ignore", divide="ignore"):
        curve = _transformed(rule, raw)
    usable = np.isfinite(curve)
    raw, curve = raw[usable], curve[usable]
    rising = curve[-1] > curve[0]
    order = slice(None) if rising else slice(None, None, -1)
    return np.interp(value, curve[order], raw[order])
