"""Bytes to columns: all messages of a description, and one gyro's stream as the bench reads it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import ConfigurationError
from drivers.frames._form import Form, Layout, Messages
from drivers.frames._line_read import LineReader
from drivers.frames._lines import LineDescription
from drivers.frames._load import FrameFamily
from drivers.frames._model import ACCEL_ROLES, GYRO_ROLES, Counter, FieldSection
from drivers.frames._read import bit_of, record_of
from drivers.frames._units import constant, factor
from drivers.kit.instruments import FrameBatch
from drivers.kit.splitting import StreamSplitter

Array = NDArray[Any]
_NO_WRAP = 1 << 62


def reader_of(family: FrameFamily, forms: list[Form] | None = None) -> MessageReader | LineReader:
    """Return what reads the messages of a description from bytes, default all of them."""
    if isinstance(family.description, LineDescription):
        return LineReader(family.description, family.forms[0])
    return MessageReader(family, forms)


class MessageReader:
    """Reads every message of a description from a byte stream, in any chunks; never raises on bytes."""

    def __init__(self, family: FrameFamily, forms: list[Form] | None = None) -> None:
        self.forms = family.forms if forms is None else forms
        self._splitter = StreamSplitter([form.kind() for form in self.forms])
        self.counts = self._splitter.counts

    @property
    def by_form(self) -> dict[str, int]:
        """Messages so far, by name."""
        return {form.name: n for form, n in zip(self.forms, self._splitter.by_kind, strict=True)}

    @property
    def pending(self) -> int:
        """Bytes that wait for more."""
        return self._splitter.pending

    def feed(self, data: bytes) -> list[Messages]:
        """Return the messages completed by `data`, one entry for each form and length among them."""
        return [
            Messages(self.forms[piece.kind].layout(piece.rows.shape[1]), piece.rows, piece.ends)
            for piece in self._splitter.feed(data)
        ]


class FrameDecoder:
    """Incremental decoder (`drivers.kit.instruments.StreamDecoder`) of one gyro's stream.

    Columns, (n,): `counter` int64 (without one in the frame: frames by the bytes that went by, so that damage
    leaves a gap); `status` as sent; `valid` bool: status bits of severity "error" and valid bits are good for the
    unit's axes, and its rates are numbers; `temp_c` and, where sent, `case_temp_c`, float32; `since_pulse_s`
    float64, where sent: time since the last pulse at the unit's trigger input, by its own clock; gyro channels,
    accelerations and temperatures under their own names in their own units (a cumulative angle as the
    increment of one sample, NaN for the first). Other messages of the description are read and dropped.
    """

    def __init__(
        self,
        family: FrameFamily,
        *,
        rate_hz: float,
        axes: str,
        axis: str | None = None,
        message: str | None = None,
    ) -> None:
        """Raise ConfigurationError for a message or an axis that the description does not have."""
        wanted = messages_of(family, message)
        measuring = wanted or [form for form in family.forms if form.measures]
        for form in measuring:
            channels(family, form, axes)
        self._forms = wanted
        forms = [form for form in family.forms if form in measuring or not form.measures]
        self._reader = reader_of(family, forms)
        self._family = family
        self._axes = axes
        self._axis = axis or axes[0]
        self.counts = self._reader.counts
        self.nominal_rate_hz = rate_hz
        # Of messages that count differently one must be named.
        alike = len({str(form.counter) for form in measuring}) == 1
        counter = measuring[0].counter if alike else None
        self.has_counter = counter is not None
        self.counter_modulo, self.counter_step = _NO_WRAP, 1.0
        if counter is not None:
            self.counter_modulo, self.counter_step = _counting(measuring[0], counter, rate_hz)
        self._plans: dict[tuple[str, int], _Plan] = {}
        self._count = 0  # Of frames by bytes, where the frame has no counter.
        self._end = -1
        self._angles: dict[str, float] = {}
        self._counter = 0

    @property
    def expected(self) -> str:
        """The messages that it reads, by name; empty for the first it hears."""
        return " or ".join(form.name for form in self._forms)

    @property
    def pulse_resolution_s(self) -> float:
        """The step of the time since a pulse, the coarsest of the messages it reads; 0 if they tell of none."""
        fields = [spec for form in self._reader.forms for spec in form.fields if spec.role == "since_pulse"]
        return max((abs(spec.scale.factor) * factor(spec.unit) for spec in fields), default=0.0)

    @property
    def by_message(self) -> dict[str, int]:
        """Messages so far, by name."""
        return self._reader.by_form

    def feed(self, data: bytes) -> FrameBatch:
        """Decode the next bytes of the stream; an incomplete frame is kept for the next call."""
        found = [messages for messages in self._reader.feed(data) if messages.form.measures]
        if not self._forms and found:
            self._forms = [min(found, key=lambda messages: int(messages.end_offset[0])).form]
        found = [messages for messages in found if messages.form in self._forms]
        if not found:
            form = next(iter(self._forms), None) or next(f for f in self._reader.forms if f.measures)
            layout = form.layout(form.shortest)
            nothing = np.empty((0, layout.length), np.uint8)
            found = [Messages(layout, nothing, np.empty(0, np.int64))]
        parts = [self._plan(messages.layout).columns(messages.rows) for messages in found]
        ends = found[0].end_offset
        columns = parts[0]
        lengths = np.full(len(ends), found[0].layout.length)
        if len(self._forms) > 1:  # What all of them have, so that the table is one whatever came first.
            columns = {name: columns[name] for name in columns if name in self._common()}
        if len(parts) > 1:
            ends = np.concatenate([messages.end_offset for messages in found])
            lengths = np.repeat([each.layout.length for each in found], [len(each.rows) for each in found])
            columns = {name: np.concatenate([part[name] for part in parts]) for name in columns}
            if (ends[1:] < ends[:-1]).any():  # Frames of several lengths.
                order = np.argsort(ends)
                ends, lengths = ends[order], lengths[order]
                columns = {name: column[order] for name, column in columns.items()}
        if "counter" not in columns:
            numbers = found[0].numbers
            counted = self._counted(ends, lengths) if numbers is None else numbers
            columns = {"counter": counted, **columns}
        self._increments(columns)
        return FrameBatch(columns, ends)

    def _plan(self, layout: Layout) -> _Plan:
        key = layout.form.name, layout.length
        if key not in self._plans:
            self._plans[key] = _Plan(
                self._family, layout, self._axes, self._axis, has_counter=self.has_counter
            )
        return self._plans[key]

    def _common(self) -> set[str]:
        """Return the columns that every message of those in turn has."""
        plans = [self._plan(form.layout(form.shortest)) for form in self._forms]
        return set.intersection(*(set(plan.names) for plan in plans))

    def _counted(self, ends: NDArray[np.int64], lengths: NDArray[np.int64]) -> NDArray[np.int64]:
        """Count frames by the bytes from end to end: bytes in between that were none leave a gap."""
        if not len(ends):
            return ends
        before = ends[0] - lengths[0] if self._end < 0 else self._end
        between = np.diff(ends, prepend=before) - lengths
        gaps = np.flatnonzero(between > 0)
        steps = np.ones(len(ends), np.int64)
        steps[gaps] += np.rint(between[gaps] / lengths[gaps]).astype(np.int64)
        count: NDArray[np.int64] = self._count + np.cumsum(steps)
        self._count, self._end = int(count[-1]), int(ends[-1])
        return count - 1

    def _increments(self, columns: dict[str, Array]) -> None:
        """Turn cumulative angles into what was turned in one sample."""
        counter = columns["counter"]
        if not self._forms or not len(counter):
            return
        fields = self._forms[0].fields
        turned = [spec for spec in fields if spec.role == "cumulative_angle" and spec.name in columns]
        if not turned:
            return
        first = self._counter if self._angles else int(counter[0])
        ticks = _modulo(np.diff(counter, prepend=first), self.counter_modulo)
        far = np.flatnonzero(ticks != self.counter_step)  # Not one sample after the one before.
        samples = np.maximum(1.0, np.rint(ticks[far] / self.counter_step))
        for spec in turned:
            raw = columns[spec.name]
            before = self._angles.get(spec.name)
            step = np.diff(raw, prepend=raw[0] if before is None else before)
            if raw.dtype.kind == "f":  # Wraps, if it does, at a full turn.
                span = 360.0 / factor(spec.unit) / abs(spec.scale.factor)
                with np.errstate(invalid="ignore"):
                    step = step - span * np.rint(step / span)
                columns["valid"] &= np.isfinite(step)
            else:
                bits = 8 * spec.bytes if spec.bits is None else spec.bits[1]
                step = _modulo(step + (1 << bits - 1), 1 << bits) - (1 << bits - 1)
            angle = step * spec.scale.factor
            angle[far] /= samples
            if before is None:
                angle[0] = np.nan
                columns["valid"][0] = False
            columns[spec.name] = angle
            self._angles[spec.name] = raw[-1].item()
        self._counter = int(counter[-1])


def _modulo(numbers: NDArray[np.int64], modulo: int) -> NDArray[np.int64]:
    """Return `numbers` modulo a positive number; by powers of two, without a division."""
    return numbers & (modulo - 1) if modulo & (modulo - 1) == 0 else numbers % modulo


class _Plan:
    """What of a layout the bench reads, worked out once."""

    def __init__(
        self, family: FrameFamily, layout: Layout, axes: str, axis: str, *, has_counter: bool
    ) -> None:
        description, form = family.description, layout.form
        counter = form.counter if has_counter else None
        by_name = {spec.name: spec for spec in form.fields}
        self._layout = layout
        self._counter = None if counter is None else counter.field
        self._ticks = (counter.ticks_per_s if counter else None) or 1.0
        self._status = next((spec.name for spec in form.fields if spec.role == "status"), None)
        self._gyros = [by_name[name] for name in channels(family, form, axes).values()]
        self._temps = [spec for spec in form.fields if spec.role == "temp"]
        ordered = sorted(self._temps, key=lambda spec: spec.axis != axis)
        self._temp = ordered[0] if ordered else None
        self._case = next((spec for spec in form.fields if spec.role == "case_temp"), None)
        self._pulse = next((spec for spec in form.fields if spec.role == "since_pulse"), None)
        kept = [
            *self._gyros,
            *(
                spec
                for spec in form.fields
                if spec.role in (*ACCEL_ROLES, "temp", "case_temp", "since_pulse")
            ),
        ]
        self._kept = list({spec.name: spec for spec in kept}.values())
        self._good: dict[str, tuple[int, int]] = {}
        for bit in description.status:
            if bit.severity == "error" and bit.field in by_name and (bit.axis is None or bit.axis in axes):
                mask, good = self._good.get(bit.field, (0, 0))
                self._good[bit.field] = mask | 1 << bit.bit, good | bit.good << bit.bit
        self._rules = [spec.valid for spec in self._gyros if spec.valid is not None]
        raw = set(self._good) | {rule.field for rule in self._rules}
        raw |= {rule.field for spec in self._kept for rule in (spec.when, spec.valid) if rule is not None}
        raw |= {name for name in (self._counter, self._status) if name is not None}
        raw |= {
            spec.name
            for spec in self._kept
            if spec.role == "cumulative_angle" or not layout.codecs[spec.name].linear
        }
        needed = {spec.name for spec in self._kept} | raw
        self._codecs = {name: layout.codecs[name] for name in by_name if name in needed}
        self._raw = [name for name in self._codecs if name in raw]
        self._record = record_of(self._codecs, layout.length)
        self.names = list(self.columns(np.empty((0, layout.length), np.uint8)))

    def columns(self, rows: NDArray[np.uint8]) -> dict[str, Array]:
        """Return the columns of `rows`, see FrameDecoder."""
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):
            return self._columns(rows)

    def _columns(self, rows: NDArray[np.uint8]) -> dict[str, Array]:
        stored = rows.view(self._record)[:, 0]
        raw = {name: self._codecs[name].number(stored[name]) for name in self._raw}
        valid = np.ones(len(rows), np.bool_)
        for name, (mask, good) in self._good.items():
            valid &= (raw[name] & mask) == good
        for rule in self._rules:
            valid &= bit_of(raw[rule.field], rule.bit) == rule.value
        columns: dict[str, Array] = {}
        if self._counter is not None:
            count = raw[self._counter]
            if count.dtype.kind == "f":  # A clock in seconds.
                count = np.rint(np.nan_to_num(count * self._ticks, posinf=0.0, neginf=0.0))
            columns["counter"] = count.astype(np.int64)
        columns["status"] = np.zeros(len(rows), np.uint8) if self._status is None else raw[self._status]
        columns["valid"] = valid
        for spec in self._kept:
            codec = self._codecs[spec.name]
            if spec.role == "cumulative_angle":
                columns[spec.name] = raw[spec.name]
            elif codec.linear:
                columns[spec.name] = codec.linear_of(stored[spec.name])
            else:
                columns[spec.name] = codec.physical(raw[spec.name], raw)
        for spec in self._gyros:
            if columns[spec.name].dtype.kind == "f" and not self._codecs[spec.name].linear:
                valid &= np.isfinite(columns[spec.name])
        columns["temp_c"] = (
            np.full(len(rows), np.nan, np.float32) if self._temp is None else celsius(self._temp, columns)
        )
        if self._case is not None:
            columns["case_temp_c"] = celsius(self._case, columns)
        if self._pulse is not None:
            columns["since_pulse_s"] = columns.pop(self._pulse.name) * factor(self._pulse.unit)
        return columns


def messages_of(family: FrameFamily, named: str | None) -> list[Form]:
    """Return the messages that a bench reads: named, or the description's; empty for the first it hears."""
    wanted = named or family.description.message or ()
    return [family.form(name) for name in ((wanted,) if isinstance(wanted, str) else wanted)]


def channels(family: FrameFamily, form: Form, axes: str) -> dict[str, str]:
    """Return axis -> field of the gyro channels that a bench reads from a message; the file's first role."""
    role = next((spec.role for spec in form.fields if spec.role in GYRO_ROLES), None)
    found = {str(spec.axis): spec.name for spec in form.fields if spec.role == role}
    for axis in axes:
        if axis not in found:
            raise ConfigurationError(
                f"the message {form.name!r} has no gyro channel {axis}",
                where=family.where,
                found=f"axes {', '.join(found) or 'none'}",
                expected=f"axes {', '.join(axes)}, as the bench file says",
                remedy="correct axis and axes in the bench file, or frame_format if another message has it",
            )
    return {axis: found[axis] for axis in axes}


def celsius(spec: FieldSection, columns: Mapping[str, Array]) -> NDArray[np.float32]:
    """Return a temperature column in degC, float32."""
    with np.errstate(invalid="ignore", over="ignore"):
        value = columns[spec.name]
        if factor(spec.unit) != 1.0 or constant(spec.unit) != 0.0:
            value = value * factor(spec.unit) + constant(spec.unit)
        return value.astype(np.float32)


def _counting(form: Form, counter: Counter, rate_hz: float) -> tuple[int, float]:
    """Return where the counter wraps, and how much it rises a sample."""
    spec = next(field for field in form.fields if field.name == counter.field)
    bits = min(62, 8 * spec.bytes if spec.bits is None else spec.bits[1])
    step = float(counter.step) if counter.ticks_per_s is None else counter.ticks_per_s / rate_hz
    return counter.modulo or 1 << bits, step
