"""A byte stream cut into checked frames of several kinds, incrementally, each kind of fixed or stated length."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.framing import Check, windows
from drivers.instruments import StreamCounts

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]
Read = Callable[[Bytes, Ints], Ints]
"""Stream (n,) and where frames begin in it (m,) -> the bytes that each says it has (m,)."""
_ALIGNED = 512  # Rows looked at first while frames lie end to end; more from then on.
_MORE = 8192
_HEADS = 256  # Places looked at to tell which kind a stream is of.
_CROWDED = (
    1.5  # So many places look like the beginning of a frame, for one of the likely kind: worth sifting.
)


class Pattern:
    """Bytes that a frame of a kind has at given offsets, under masks."""

    def __init__(self, places: Sequence[tuple[int, int, int]], span: int) -> None:
        """Take (offset, value, mask) triples; `span` bytes of a frame must be there to tell."""
        whole = [place for place in places if place[2] == 0xFF]
        self.anchor = (whole or list(places))[0]
        self.places = tuple(places)
        self.span = max(span, *(at + 1 for at, _, _ in places))
        self.alone = False
        """Whether what `anchors` finds is this pattern's anchor and nothing else."""
        self._others = [place for place in places if place is not self.anchor]

    def find(self, data: Bytes, anchored: Ints) -> Ints:
        """Return every offset at which it is complete; `anchored`: where its anchor may be. Both in order."""
        whole = int(np.searchsorted(anchored, len(data) - self.span, side="right"))
        found = anchored[:whole]
        offset, value, mask = self.anchor
        if not self.alone:
            byte = data[found + offset]
            found = found[byte == value if mask == 0xFF else (byte & mask) == value]
        for offset, value, mask in self._others:
            byte = data[found + offset]
            found = found[byte == value if mask == 0xFF else (byte & mask) == value]
        return found

    def heads(self, rows: Bytes) -> NDArray[np.bool_]:
        """Return which rows have it."""
        good = np.ones(len(rows), np.bool_)
        for offset, value, mask in self.places:
            good &= rows[:, offset] == value if mask == 0xFF else (rows[:, offset] & mask) == value
        return good

    def may_begin(self, data: Bytes) -> bool:
        """Whether `data`, however short, can be the first bytes of a frame."""
        return all(at >= len(data) or int(data[at]) & mask == value for at, value, mask in self.places)


@dataclass(frozen=True)
class Kind:
    """A kind of frame: how it begins, how long it is (`length`, or `read` within `shortest` to `longest`), and
    the check of frames of a given length.
    """

    patterns: tuple[Pattern, ...]
    check: Callable[[int], Check]
    shortest: int
    longest: int
    read: Read | None = None


@dataclass
class Piece:
    """Sound frames of one kind and length: rows (n, length), offsets in the stream just past each (n,)."""

    kind: int
    rows: Bytes
    ends: Ints


@dataclass
class _Group:
    """Whole candidates of one kind and length."""

    kind: int
    length: int
    starts: Ints
    rows: Bytes
    sound: NDArray[np.bool_]


class StreamSplitter:
    """Cuts a byte stream into frames. No two kinds may begin alike.

    Equivalent to this scan, whatever the chunks: look for a frame's beginning; wait until it is whole; if sound
    take it and go on behind it, else count a reject and go on one byte further. Behind a frame that ends at e, a
    sound frame from e on is taken if there is one, else one from e - 1 on: a lost last byte is made good by an
    equal first byte that follows, and that next frame must not be lost. At most the longest frame is kept between
    calls.
    """

    def __init__(self, kinds: Sequence[Kind]) -> None:
        self.counts = StreamCounts()
        self.by_kind = [0] * len(kinds)
        """Frames of each kind so far."""
        self._kinds = list(kinds)
        self._patterns = [(number, pattern) for number, kind in enumerate(kinds) for pattern in kind.patterns]
        self._span = max(pattern.span for _, pattern in self._patterns)
        self._anchors = _anchors([pattern for _, pattern in self._patterns])
        self._pending = b""
        self._offset = 0  # In the stream, of the first pending byte.
        self._claimed = 0  # In the stream, end of the last frame taken.
        self._covered = 0  # Bytes in frames so far; a shared one counts once.
        self._last = self._patterns[0]

    @property
    def pending(self) -> int:
        """How many bytes wait for more."""
        return len(self._pending)

    def feed(self, data: bytes) -> list[Piece]:
        """Return the sound frames completed by `data`, a piece for each kind and length among them."""
        stream = np.frombuffer(self._pending + data if self._pending else data, np.uint8)
        pieces, at = self._aligned(stream)
        keep = self._undecided(stream, at)
        if keep is None:
            begin = max(0, self._claimed - self._offset - 1)
            more, keep = self._search(stream[begin:], self._offset + begin)
            pieces += more
            keep += begin
        self._pending = stream[keep:].tobytes()
        self._offset += keep
        self.counts.bytes_skipped = self._offset - (self._covered - max(0, self._claimed - self._offset))
        return pieces

    def _aligned(self, stream: Bytes) -> tuple[list[Piece], int]:
        """Take the frames of one kind and length that lie end to end from where the last one ended."""
        at = max(0, self._claimed - self._offset)
        found = self._kind_at(stream[at : at + self._span])
        if found is None:
            return [], at
        self._last = number, pattern = found
        kind = self._kinds[number]
        length = kind.shortest
        if kind.read is not None:
            length = int(kind.read(stream, np.array([at]))[0])
            if not kind.shortest <= length <= kind.longest:
                return [], at
        count = (len(stream) - at) // length
        if not count:
            return [], at
        rows = stream[at : at + count * length].reshape(count, length)
        check = kind.check(length)
        taken, step = 0, _ALIGNED
        while taken < count:
            part = rows[taken : taken + step]
            good = pattern.heads(part)
            if kind.read is not None:
                good &= kind.read(part.ravel(), np.arange(len(part)) * length) == length
            if not good.all():
                part = part[: int(good.argmin())]
            sound = check(part)
            run = len(part) if sound.all() else int(sound.argmin())
            taken += run
            if run < step:
                break
            step = _MORE
        if not taken:
            return [], at
        ends = np.arange(1, taken + 1, dtype=np.int64) * length + (self._offset + at)
        self._take(ends, [(number, taken)], taken * length)
        return [Piece(number, rows[:taken], ends)], at + taken * length

    def _kind_at(self, head: Bytes) -> tuple[int, Pattern] | None:
        """Return which kind begins at `head`; the one seen last is looked for first."""
        for found in (self._last, *self._patterns):
            if len(head) >= found[1].span and found[1].may_begin(head):
                return found
        return None

    def _undecided(self, stream: Bytes, at: int) -> int | None:
        """Return from where on to keep `stream`, whose frames end at `at`; None if only a search can tell."""
        rest = len(stream) - at
        number, pattern = self._last
        kind = self._kinds[number]
        if rest and (kind.read is not None or rest >= kind.shortest or not pattern.may_begin(stream[at:])):
            return None
        return self._with_shared(stream, at)

    def _with_shared(self, stream: Bytes, at: int) -> int:
        """Return `at`, or one less if the last byte of a frame that ends there may begin another."""
        return at - 1 if at and any(p.may_begin(stream[at - 1 :]) for _, p in self._patterns) else at

    def _search(self, stream: Bytes, base: int) -> tuple[list[Piece], int]:
        """Look at every beginning in `stream`; return the frames, and from where on to keep it.

        Frames of the likely kind come first, and beginnings inside of them are not looked at: they count for
        nothing when those frames are taken. Should one not be, everything is looked at.
        """
        claimed = self._claimed - base
        for hide in (True, False):
            groups, waiting, bad_length = self._candidates(stream, hide)
            starts = _joined([group.starts[group.sound] for group in groups])
            lengths = np.repeat([group.length for group in groups], [int(g.sound.sum()) for g in groups])
            order = np.argsort(starts, kind="stable")
            starts = starts[order]
            ends = starts + lengths[order].astype(np.int64)
            kept = _choose(starts, ends, claimed)
            if kept.all():
                break
        keep, limit = self._limit(stream, waiting, starts[kept], ends[kept], claimed)
        kept &= starts < limit
        chosen, chosen_ends = starts[kept], ends[kept]
        self._reject("checksum", groups, chosen, chosen_ends, claimed, keep)
        self._reject("length", bad_length, chosen, chosen_ends, claimed, keep)
        in_order = np.empty(len(order), np.bool_)
        in_order[order] = kept
        pieces = []
        first = 0
        for group in groups:
            count = int(group.sound.sum())
            mine = in_order[first : first + count]
            first += count
            if mine.any():
                rows = group.rows if group.sound.all() else group.rows[group.sound]
                at = group.starts[group.sound]
                if not mine.all():
                    rows, at = rows[mine], at[mine]
                pieces.append(Piece(group.kind, rows, at + (base + group.length)))
        if len(chosen):
            before = np.concatenate(([claimed], chosen_ends[:-1]))
            fresh = int((chosen_ends - np.maximum(chosen, before)).sum())
            self._take(chosen_ends + base, [(piece.kind, len(piece.ends)) for piece in pieces], fresh)
        return pieces, keep

    def _candidates(self, stream: Bytes, hide: bool) -> tuple[list[_Group], list[int], list[_Group]]:
        """Return whole candidates, where unfinished ones begin (in order), and those of impossible length.

        `hide`: leave out what begins inside of sound frames of the likely kind.
        """
        groups: list[_Group] = []
        bad: list[_Group] = []
        waiting: list[int] = []
        size = len(stream)
        anchored = {offset: _places_of(stream[offset:], *which) for offset, which in self._anchors.items()}
        likely = self._likely(stream, anchored)
        for number in (likely, *(n for n in range(len(self._kinds)) if n != likely)):
            kind = self._kinds[number]
            starts = [pattern.find(stream, anchored[pattern.anchor[0]]) for pattern in kind.patterns]
            at = starts[0] if len(starts) == 1 else np.sort(_joined(starts))
            if not len(at):
                continue
            if kind.read is None:
                whole = int(np.searchsorted(at, size - kind.shortest, side="right"))
                waiting += at[whole:].tolist()
                sizes = {kind.shortest: at[:whole]} if whole else {}
            else:
                length = kind.read(stream, at)
                right = (length >= kind.shortest) & (length <= kind.longest)
                if not right.all():
                    wrong = at[~right]
                    nothing = np.zeros(len(wrong), np.bool_)
                    bad.append(_Group(number, 0, wrong, stream[:0].reshape(0, 1), nothing))
                whole_too = right & (at + length <= size)
                waiting += at[right & ~whole_too].tolist()
                sizes = {int(n): at[whole_too & (length == n)] for n in np.unique(length[whole_too])}
            for length_here, where in sizes.items():
                rows = windows(stream, where, length_here)
                groups.append(_Group(number, length_here, where, rows, kind.check(length_here)(rows)))
            if hide and number == likely and sum(map(len, anchored.values())) > _CROWDED * len(at):
                hidden = _insides(size, groups)
                anchored = {offset: starts[~hidden[starts]] for offset, starts in anchored.items()}
        for position in range(max(0, size - self._span + 1), size):
            tail = stream[position:]
            if any(len(tail) < p.span and p.may_begin(tail) for _, p in self._patterns):
                waiting.append(position)
        return groups, sorted(waiting), bad

    def _likely(self, stream: Bytes, anchored: dict[int, Ints]) -> int:
        """Return the kind of most frames so far; before the first, the one whose head is seen most at first."""
        if self.counts.frames:
            return self.by_kind.index(max(self.by_kind))
        seen = [
            (len(pattern.find(stream, anchored[pattern.anchor[0]][:_HEADS])), -number)
            for number, pattern in self._patterns
        ]
        return -max(seen)[1]

    def _limit(
        self, stream: Bytes, waiting: list[int], starts: Ints, ends: Ints, claimed: int
    ) -> tuple[int, int]:
        """Return from where on to keep `stream`, and before which offset what was chosen is final."""
        for position in waiting:
            last = int(np.searchsorted(starts, position, side="left")) - 1
            end = int(ends[last]) if last >= 0 else claimed
            if last >= 0 and starts[last] == position - 1:
                before = int(ends[last - 1]) if last else claimed
                if before == position:  # A shared beginning was taken for want of the frame that may follow.
                    return position - 1, position - 1
            if position < end - 1:
                continue
            if position == end - 1 and last + 1 < len(starts) and starts[last + 1] == end:
                continue
            return (self._with_shared(stream, position) if position == end else position), position
        return len(stream), len(stream)

    def _reject(
        self, reason: str, groups: list[_Group], starts: Ints, ends: Ints, claimed: int, keep: int
    ) -> None:
        """Count the unsound candidates that no frame covers."""
        points = _joined([group.starts[~group.sound] for group in groups])
        points = points[points < keep]
        if not len(points):
            return
        before = np.searchsorted(starts, points, side="right")
        end = np.concatenate(([claimed], ends))[before]
        follows = np.concatenate((starts, [-1]))[before] == end
        outside = (points >= end) | ((points == end - 1) & ~follows)
        if count := int(np.count_nonzero(outside)):
            self.counts.rejected[reason] = self.counts.rejected.get(reason, 0) + count

    def _take(self, ends: Ints, kinds: list[tuple[int, int]], fresh: int) -> None:
        """Account for frames with these ascending ends; `fresh` bytes of them are in no frame yet."""
        self._covered += fresh
        self._claimed = int(ends[-1])
        self.counts.frames += len(ends)
        for number, count in kinds:
            self.by_kind[number] += count


def _anchors(patterns: list[Pattern]) -> dict[int, tuple[int, NDArray[np.bool_] | None]]:
    """Return offset -> (byte, None) where all anchors there are one byte, else (0, which bytes are an anchor)."""
    found: dict[int, tuple[int, NDArray[np.bool_] | None]] = {}
    for offset in {pattern.anchor[0] for pattern in patterns}:
        here = [pattern for pattern in patterns if pattern.anchor[0] == offset]
        alike = len({pattern.anchor for pattern in here}) == 1
        for pattern in here:
            pattern.alone = alike
        if alike and here[0].anchor[2] == 0xFF:
            found[offset] = (here[0].anchor[1], None)
        else:
            bytes_ = np.arange(256)
            table = np.zeros(256, np.bool_)
            for pattern in here:
                table |= bytes_ & pattern.anchor[2] == pattern.anchor[1]
            found[offset] = (0, table)
    return found


def _places_of(data: Bytes, byte: int, table: NDArray[np.bool_] | None) -> Ints:
    """Return where in `data` the byte is or, of several bytes, those that the table has."""
    if table is None:
        return np.flatnonzero(data == byte)
    return np.flatnonzero(np.frombuffer(data.tobytes().translate(table.tobytes()), np.bool_))


def _insides(size: int, groups: list[_Group]) -> NDArray[np.bool_]:
    """Return which of `size` places lie inside of sound frames; not the second, nor the last, of their bytes."""
    hidden = np.zeros(size, np.bool_)
    for group in groups:
        inner = group.length - 3
        if inner > 0 and group.sound.any():
            spans = np.ndarray((size - inner + 1,), f"V{inner}", hidden, strides=(1,))
            spans[group.starts[group.sound] + 2] = np.void(b"\1" * inner)
    return hidden


def _joined(arrays: list[Ints]) -> Ints:
    if len(arrays) == 1:
        return arrays[0]
    return np.concatenate(arrays) if arrays else np.empty(0, np.int64)


def _choose(starts: Ints, ends: Ints, claimed: int) -> NDArray[np.bool_]:
    """Return which of the sound frames with these borders are taken when each claims its bytes, in order."""
    taken = np.ones(len(starts), np.bool_)
    if not len(starts):
        return taken
    reached = np.maximum.accumulate(np.concatenate(([claimed], ends[:-1])))
    clash = starts < reached
    for at in np.flatnonzero(clash).tolist():
        if at == 0:
            end = claimed
        elif not clash[at - 1]:
            end = int(ends[at - 1])
        start = int(starts[at])
        follows = at + 1 < len(starts) and starts[at + 1] == end
        taken[at] = start >= end or (start == end - 1 and not follows)
        if taken[at]:
            end = int(ends[at])
    return taken
