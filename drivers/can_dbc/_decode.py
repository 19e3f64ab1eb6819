"""slcan lines of a CAN gyro to samples, by its layout."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import ConfigurationError
from drivers.can_dbc._layout import CanLayout, SignalUse, ValidRule, outer_multiplexer
from drivers.can_dbc._signals import MessageLayout, SignalLayout
from drivers.can_dbc._values import Block, Source, Values, columns_of, merged
from drivers.kit.instruments import FrameBatch, LossSide, StreamCounts
from drivers.kit.slcan_codec import FRAME_DTYPE, SlcanParser

_ROWS = 1 << 62
"""Modulo of the row number that stands in for a counter."""
_HELD, _KNOWN, _FOREIGN = 253, 254, 255
_WHOLE = np.dtype(f"V{FRAME_DTYPE.itemsize}")
_EXTENDED = 1 << 31
"""Bit of a key, beside the identifier's 29, that is set in frames with an extended one."""
_Index = slice | NDArray[np.intp]


class CanDecoder:
    """One row for every run of the frames of a sample in their order, other messages and answers aside.

    Columns, shape (n,): `counter` (int64: the unit's counter or time in raw steps, or the number of the row where
    it has neither), `status` (unsigned, 0 where it has none), `rate_<axis>_dps` for each of `axes` (float32;
    `angle_<axis>_deg` for a unit that sends angle increments), `temp_c` (float32, NaN where unknown),
    `case_temp_c` if the unit sends it, `accelerometer_<axis>_mps2` of those that are mapped (float32), `valid`
    (bool). Signals of messages that are not part of a sample have the value that came last before it.

    `counts.frames` are rows; `counts.rejected` has slcan lines by `SlcanParser`'s reasons, and messages by
    `short_message` (DLC below the message's length; a longer one is read as far as it is known), `unpaired` (the
    last frame of a sample without the others just before it) and `unknown_id` (no message of the DBC file). A
    line that is no frame between the frames of a sample parts them, since it may have been one of them.

    Frames that were lost whole can leave the first frames of one sample and the last of a later one side by side.
    Nothing in them tells, but the counter skips: behind such a sample if its first frame has the counter, before
    it if its last has (`loss_taints`). Without a counter nothing does.
    """

    def __init__(
        self, layout: CanLayout, rate_hz: float, axes: str | None = None, source_address: int | None = None
    ) -> None:
        """`axes`: those wanted, default all. `source_address`: the J1939 node to listen to, None for any.

        Raises ConfigurationError for a rate or axes that cannot be.
        """
        have = "".join(layout.rates())
        axes = have if axes is None else axes
        if not rate_hz > 0.0 or not axes or len(set(axes)) < len(axes) or not set(axes) <= set(have):
            raise ConfigurationError(
                f"these settings cannot be those of a unit with layout {layout.name}",
                found=f"rate_hz = {rate_hz!r}, axes = {axes!r}",
                expected=f"a positive rate, and axes out of {', '.join(have)}",
            )
        self.counts = StreamCounts()
        self.nominal_rate_hz = rate_hz
        self.layout = layout
        self.axes = axes
        self.source_address = source_address
        self._slots = [(slot, layout.messages[slot.message]) for slot in layout.sample]
        self._least = np.array([message.length for _, message in self._slots], np.uint8)
        self._sent = {name: _sender(each, source_address) for name, each in layout.messages.items()}
        senders = np.array([self._sent[slot.message] for slot in layout.sample], np.uint32)
        self._masks, self._keys = senders[:, 0], senders[:, 1]
        self._selectors = [
            (at, s, slot.selection) for at, slot in enumerate(layout.sample) if (s := layout.selector(slot))
        ]
        self._known = [
            (mask | _EXTENDED, at & mask | extended * _EXTENDED) for at, mask, extended in layout.known
        ]
        self._counter = layout.use("time", "counter")
        self.has_counter = self._counter is not None
        self.counter_modulo = self._counter.modulo if self._counter else _ROWS
        self.counter_step = self._counter.step if self._counter else 1.0
        if self._counter is not None and self._counter.role == "time":
            self.counter_step = 1.0 / self._counter.factor / rate_hz
        slot = None if self._counter is None else layout.slot_of(self._counter)
        self.loss_taints = frozenset[LossSide]()
        if slot is not None:
            last = len(self._slots) - 1
            self.loss_taints |= {"before"} if slot < last else set()
            self.loss_taints |= {"after"} if slot > 0 else set()
        used: list[SignalUse | ValidRule] = [*layout.uses, *layout.valid]
        rules = merged([rule for rule in layout.valid if not rule.axis or rule.axis in axes])
        self._rules = [(Source(layout, rule), mask, equals) for rule, mask, equals in rules]
        self._count = None if self._counter is None else Source(layout, self._counter)
        status = layout.use("status")
        self._status = None if status is None else Source(layout, status)
        self._values = [
            (name, None if use is None else Values(layout, use)) for name, use in columns_of(layout, axes)
        ]
        self._held = {use.message: np.empty(0, FRAME_DTYPE) for use in used if layout.slot_of(use) is None}
        self._lines = SlcanParser()
        self._own_rejected: dict[str, int] = {}
        self._waiting = np.empty(0, FRAME_DTYPE)
        self._waiting_kind = np.empty(0, np.uint8)

    def feed(self, data: bytes) -> FrameBatch:
        """Decode the next bytes; frames of a sample that is not complete are kept for the next call."""
        batch = self.feed_frames(self._lines.feed(data))
        self.counts.bytes_skipped = self._lines.counts.bytes_skipped
        self.counts.rejected = self._lines.counts.rejected | self._own_rejected
        return batch

    def feed_frames(self, frames: NDArray[np.void]) -> FrameBatch:
        """Decode the next frames, shape (n,) of `drivers.kit.slcan_codec.FRAME_DTYPE`; `end_offset` grows."""
        cycle = _joined(self._waiting, frames) if len(self._waiting) else frames
        count = len(self._slots)
        whole = len(cycle) // count * count
        if whole and self._is_samples(cycle, whole):
            held = self._held
            rows: list[_Index] = [slice(slot, whole, count) for slot in range(count)]
            self._waiting, self._waiting_kind = (
                cycle[whole:].copy(),
                np.arange(len(cycle) - whole, dtype=np.uint8),
            )
        else:
            kind = self._kinds(frames)
            held = self._take_held(frames, kind)
            cycle, rows = self._take_samples(frames, kind)
        payloads, offsets = cycle["data"], cycle["end_offset"]
        parts = [payloads[at] for at in rows]
        end_offset = offsets[rows[-1]]
        with np.errstate(over="ignore", invalid="ignore"):  # floating-point signals may hold anything
            columns = self._columns(Block(parts, end_offset, held))
        self.counts.frames += len(end_offset)
        self.counts.rejected = dict(self._own_rejected)
        return FrameBatch(columns, end_offset.copy())

    def _is_samples(self, frames: NDArray[np.void], whole: int) -> bool:
        """Whether these are samples frame by frame, nothing between them, and behind `whole` the head of one."""
        count = len(self._slots)
        keys, lengths, others = _keys(frames), frames["length"], frames["others_before"]
        for first, end, width in ((0, whole, count), (whole, len(frames), len(frames) - whole)):
            if first < end and not (
                ((keys[first:end].reshape(-1, width) & self._masks[:width]) == self._keys[:width]).all()
                and (lengths[first:end].reshape(-1, width) >= self._least[:width]).all()
            ):
                return False
        if others[0] != others[whole - 1] and count > 1:
            return False
        data = frames["data"]
        return all((selector.raw(data[at::count]) == value).all() for at, selector, value in self._selectors)

    def _kinds(self, frames: NDArray[np.void]) -> NDArray[np.uint8]:
        """Return what each frame is: the number of its slot, held, known otherwise, or foreign; (n,)."""
        key = _keys(frames)
        kind = np.full(len(frames), _FOREIGN, np.uint8)
        for number, (slot, _) in enumerate(self._slots):
            found = _are(key, self._sent[slot.message])
            if (selector := self.layout.selector(slot)) is not None:
                found &= selector.raw(frames["data"]) == slot.selection
            np.putmask(kind, found, number)
        if not (kind == _FOREIGN).any():
            return kind
        rest = np.flatnonzero(kind == _FOREIGN)
        key = key[rest]
        for known in self._known:
            kind[rest[_are(key, known)]] = _KNOWN
        for name in self._held:
            kind[rest[_are(key, self._sent[name])]] = _HELD
        self._reject("unknown_id", np.count_nonzero(kind == _FOREIGN))
        return kind

    def _take_held(self, frames: NDArray[np.void], kind: NDArray[np.uint8]) -> dict[str, NDArray[np.void]]:
        """Return, by message, the frames that values are held from: the last of before, then these."""
        result = {}
        for name, before in self._held.items():
            message = self.layout.messages[name]
            own = _chosen(frames, kind == _HELD)
            own = own[_are(_keys(own), self._sent[name])] if len(self._held) > 1 else own
            whole = own["length"] >= message.length
            self._reject("short_message", np.count_nonzero(~whole))
            result[name] = _joined(before, own[whole])
            self._held[name] = _last_of_each(result[name], outer_multiplexer(message))
        return result

    def _take_samples(
        self, frames: NDArray[np.void], kind: NDArray[np.uint8]
    ) -> tuple[NDArray[np.void], list[_Index]]:
        """Return the frames of samples and, by slot, which of them belong to the complete ones."""
        count = len(self._slots)
        is_sample = kind < count
        if not is_sample.all():
            frames, kind = _chosen(frames, is_sample), kind[is_sample]
        new = frames["length"] >= self._least[kind]
        self._reject("short_message", len(new) - np.count_nonzero(new))
        if len(self._waiting):
            frames = _joined(self._waiting, frames)
            kind = np.concatenate((self._waiting_kind, kind))
            new = frames["length"] >= self._least[kind]
        whole, others = new, frames["others_before"]
        last = (kind == count - 1) & whole
        complete = last[count - 1 :].copy()
        if not len(complete):
            self._reject("unpaired", np.count_nonzero(last))
            self._keep(frames, kind)
            return frames, [slice(0, 0)] * count
        for back in range(1, count):
            at = slice(count - 1 - back, len(frames) - back)
            complete &= (kind[at] == count - 1 - back) & whole[at]
        if count > 1 and len(complete):
            complete &= others[count - 1 :] == others[: len(frames) - count + 1]
        starts = np.flatnonzero(complete)
        self._reject("unpaired", np.count_nonzero(last) - len(starts))
        self._keep(frames, kind)
        return frames, [_every(starts + slot, count) for slot in range(count)]

    def _keep(self, frames: NDArray[np.void], kind: NDArray[np.uint8]) -> None:
        """Keep the frames at the end that may begin a sample."""
        tail = max(0, len(kind) - len(self._slots) + 1)
        last = kind[tail:].tolist()
        keep = len(kind)
        if 0 in last:
            at = len(last) - 1 - last[::-1].index(0)
            if last[at:] == list(range(len(last) - at)):
                keep = tail + at
        self._waiting, self._waiting_kind = frames[keep:].copy(), kind[keep:].copy()

    def _columns(self, block: Block) -> dict[str, NDArray[Any]]:
        rows = len(block)
        columns: dict[str, NDArray[Any]] = {}
        valid = np.ones(rows, np.bool_)
        if self._count is None:
            columns["counter"] = self.counts.frames + np.arange(rows)
        else:
            raw = self._count.raw(block)[0]
            columns["counter"] = raw & (1 << self._count.signal.bits) - 1
        columns["status"] = np.zeros(rows, np.uint8)
        if self._status is not None:
            raw, known = self._status.raw(block)
            columns["status"] = raw.astype(np.min_scalar_type((1 << self._status.signal.bits) - 1))
            valid &= known
        for name, values in self._values:
            if values is None:
                columns[name] = np.full(rows, np.nan, np.float32)
                continue
            columns[name] = values.physical(block)
            if values.must_be_finite:
                valid &= np.isfinite(columns[name])
        for rule, mask, equals in self._rules:
            raw, known = rule.raw(block)
            valid &= known
            valid &= (raw & mask) == equals
        columns["valid"] = valid
        return columns

    def _reject(self, reason: str, count: int | np.intp) -> None:
        if count:
            self._own_rejected[reason] = self._own_rejected.get(reason, 0) + int(count)


def _every(at: NDArray[np.intp], step: int) -> _Index:
    """Return `at` as a slice if its entries are `step` apart, which saves copying what they point at."""
    if len(at) and at[-1] - at[0] == step * (len(at) - 1):
        return slice(int(at[0]), int(at[-1]) + 1, step)
    return at


def _last_of_each(frames: NDArray[np.void], multiplexer: SignalLayout | None) -> NDArray[np.void]:
    """Return the last frame, or the last of each value of the multiplexer, in order."""
    if multiplexer is None or len(frames) < 2:
        return frames[-1:].copy()
    back = np.unique(multiplexer.raw(frames["data"])[::-1], return_index=True)[1]
    return frames[np.sort(len(frames) - 1 - back)]


def _joined(before: NDArray[np.void], frames: NDArray[np.void]) -> NDArray[np.void]:
    """Return both, moved frame by frame: NumPy moves structures field by field."""
    return np.concatenate((before.view(_WHOLE), frames.view(_WHOLE))).view(FRAME_DTYPE)


def _chosen(frames: NDArray[np.void], which: NDArray[np.bool_]) -> NDArray[np.void]:
    """Return those of the frames, likewise."""
    return frames.view(_WHOLE)[which].view(FRAME_DTYPE)


def _keys(frames: NDArray[np.void]) -> NDArray[np.uint32]:
    """Return identifier and kind of identifier of each frame as one number, (n,)."""
    keys: NDArray[np.uint32] = frames["id"] | frames["extended"].astype(np.uint32) << np.uint32(31)
    return keys


def _sender(message: MessageLayout, source: int | None) -> tuple[int, int]:
    """Return mask and value of the keys of a message, from the J1939 node `source` if it is given."""
    mask, value = message.identifier_mask, message.identifier
    if source is not None and message.extended:
        mask, value = mask | 0xFF, value & ~0xFF | source
    return mask | _EXTENDED, value & mask | message.extended * _EXTENDED


def _are(keys: NDArray[np.uint32], sender: tuple[int, int]) -> NDArray[np.bool_]:
    mask, value = sender
    return np.asarray((keys & np.uint32(mask)) == np.uint32(value))
