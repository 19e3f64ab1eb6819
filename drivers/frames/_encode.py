"""Columns to bytes: what a unit with this description would send, for emulators and tests."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.frames._load import FrameFamily
from drivers.frames._read import there

Array = NDArray[Any]


class FrameEncoder:
    """Makes messages of one form of a description (default the first that carries a gyro channel)."""

    def __init__(self, family: FrameFamily, message: str | None = None, length: int | None = None) -> None:
        """Take the length of messages whose length is stated in them; default the shortest."""
        self.form = family.form(message)
        self.layout = self.form.layout(length or self.form.shortest)
        self._family = family
        self._counter = self.form.counter
        self._good: dict[str, int] = {}
        for bit in family.description.status:
            self._good[bit.field] = self._good.get(bit.field, 0) | bit.good << bit.bit
        for spec in self.form.fields:
            if spec.valid is not None:
                before = self._good.get(spec.valid.field, 0)
                self._good[spec.valid.field] = before | spec.valid.value << spec.valid.bit

    def encode(self, count: int, values: Mapping[str, ArrayLike]) -> bytes:
        """Return `count` messages. `values`: field -> physical values, (count,) or one for all.

        Integers are rounded half away from zero and saturate at the field's limits; the counter and cumulative
        angles wrap. A field not given has its usual value, and status bits are good. Raises KeyError for a field
        that the message does not have.
        """
        codecs = self.layout.codecs
        for name in values:
            if name not in codecs:
                raise KeyError(f"the message {self.form.name!r} has no field {name!r}")
        rows = self.layout.blank(count)
        raw: dict[str, Array] = {}
        for name, codec in codecs.items():
            spec = codec.spec
            if name in values:
                value = np.broadcast_to(np.asarray(values[name]), (count,))
                if spec.type.startswith("text:"):
                    raw[name] = value.astype(f"S{spec.bytes}")
                    continue
                numbers = codec.unphysical(value)
                if self._counter is not None and name == self._counter.field:
                    clock = self._counter.ticks_per_s if spec.type[0] == "f" else None  # Kept in s.
                    span = self._counter.modulo or codec.limits()[1] + 1
                    numbers = np.mod(numbers, span / clock if clock else span)
                elif spec.role == "cumulative_angle" or (spec.role == "time" and spec.type[0] == "u"):
                    span = codec.limits()[1] - codec.limits()[0] + 1
                    numbers = np.mod(numbers - codec.limits()[0], span) + codec.limits()[0]
                raw[name] = numbers
            elif spec.usual is not None:
                raw[name] = np.broadcast_to(codec.unphysical(np.array([spec.usual])), (count,))
            elif name in self._good:
                raw[name] = np.full(count, self._good[name], np.uint64)
            elif spec.type.startswith("text:"):
                raw[name] = np.zeros(count, f"S{spec.bytes}")
            else:
                zero = (
                    codec.unphysical(np.zeros(1)) if spec.transform is None and spec.role != "status" else 0
                )
                raw[name] = np.broadcast_to(zero, (count,)).astype(np.float64)
        self._put(rows, raw)
        self.layout.seal(rows)
        return rows.tobytes()

    def _put(self, rows: NDArray[np.uint8], raw: Mapping[str, Array]) -> None:
        """Write fields; words before the named bits in them, multiplexed fields only where they are there."""
        codecs = self.layout.codecs.items()
        for name, codec in sorted(codecs, key=lambda item: item[1].spec.bits is not None):
            if codec.spec.when is None:
                codec.write(rows, raw[name])
        for name, codec in codecs:
            rule = codec.spec.when
            if rule is not None:
                teller = self.layout.codecs[rule.field].raw(rows)
                here = there(rule, teller)
                part = np.ascontiguousarray(rows[here])
                codec.write(part, raw[name][here])
                rows[here] = part
