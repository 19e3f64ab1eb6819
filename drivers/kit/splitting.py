"""A byte stream cut into checked frames of several kinds, incrementally, each kind of fixed or stated length."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.kit._candidates import Group, choose, insides, joined, open_places, refused, shares
from drivers.kit.instruments import StreamCounts
from drivers.kit.patterns import Bytes, Check, Finder, Ints, Pattern, windows

Read = Callable[[Bytes, Ints], Ints]
"""Stream (n,) and where frames begin in it (m,) -> the bytes that each says it has (m,)."""
_FEW = 16  # Rows looked at first, or twice as many as lay end to end the last time; then more at once.
_MORE = 8192
_HEAD = 1 << 16  # Bytes looked at to tell which kind a stream is of.


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
    few: Callable[[Sequence[bytes]], NDArray[np.bool_]] | None = None


@dataclass
class Piece:
    """Sound frames of one kind and length: rows (n, length), offsets in the stream just past each (n,)."""

    kind: int
    rows: Bytes
    ends: Ints


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
        self._finder = Finder([pattern for _, pattern in self._patterns])
        self._sifted: dict[int, tuple[Finder, Finder]] = {}  # Likely kind -> what finds it, and the others.
        self._pending = b""
        self._offset = 0  # In the stream, of the first pending byte.
        self._claimed = 0  # In the stream, end of the last frame taken.
        self._covered = 0  # Bytes in frames so far; a shared one counts once.
        self._last = self._patterns[0]
        self._usual: set[int] = set()  # Lengths of sound frames, where frames state theirs.
        self._run = 0  # How many frames lay end to end at the beginning of the last piece.

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
        taken, step = 0, _FEW + 2 * self._run
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
        self._run = taken
        if 2 * taken < count:  # A search through everything gives one piece.
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
        # With one anchor for all, finding the others costs no look of its own.
        for sift in (True, False) if self._finder.anchors > 1 else (False,):
            groups, waiting = self._candidates(stream, sift)
            found = [group for group in groups if len(group.good)]
            starts = joined([group.good for group in found])
            ends = joined([group.good + group.length for group in found])
            order = None
            if len(found) > 1:
                order = np.argsort(starts, kind="stable")
                starts, ends = starts[order], ends[order]
            taken = choose(starts, ends, claimed)
            if taken is None:
                break
        if taken is not None:
            starts, ends = starts[taken], ends[taken]
            order = taken if order is None else order[taken]
        keep, final = self._limit(stream, waiting, starts, ends, claimed)
        count = int(np.searchsorted(starts, final))
        starts, ends = starts[:count], ends[:count]
        picks: slice | Ints = slice(count)
        if order is not None:
            picks = np.sort(order[:count]) if len(found) > 1 else order[:count]
        pieces = []
        for group, mine in zip(found, shares(found, picks), strict=True):
            rows, at = group.rows_of(mine), group.good[mine]
            if len(at):
                pieces.append(Piece(group.kind, rows, at + (base + group.length)))
        before = np.concatenate(([claimed], ends))
        for group in groups:
            points = group.unsound(keep)
            if not len(points):
                continue
            if len(found) == 1 and group is found[0]:
                follows = group.passed(picks, len(points))
            else:
                follows = np.searchsorted(starts, points, side="right")
            bad = open_places(points, follows, starts, before)
            self.counts.reject(group.refused, bad)
        if count:
            # A frame may share one byte with the one before.
            fresh = sum(piece.rows.size for piece in pieces) - int(np.count_nonzero(starts < before[:-1]))
            self._take(ends + base, [(piece.kind, len(piece.ends)) for piece in pieces], fresh)
        return pieces, keep

    def _candidates(self, stream: Bytes, sift: bool) -> tuple[list[Group], list[int]]:
        """Return whole candidates and those of impossible length, and where unfinished ones begin, in order.

        `sift`: leave out what begins inside of sound frames of the likely kind.
        """
        groups: list[Group] = []
        waiting: list[int] = []
        size = len(stream)
        for number, at in self._beginnings(stream, groups) if sift else self._by_kind(stream):
            if not len(at):
                continue
            kind = self._kinds[number]
            if kind.read is None:
                whole = int(np.searchsorted(at, size - kind.shortest, side="right"))
                waiting += at[whole:].tolist()
                sizes = {kind.shortest: at[:whole]} if whole else {}
            else:
                length = kind.read(stream, at)
                right = (length >= kind.shortest) & (length <= kind.longest)
                if not right.all():
                    groups.append(refused(number, at[~right], "length"))
                whole_too = right & (at + length <= size)
                waiting += at[right & ~whole_too].tolist()
                sizes, unsound = self._by_length(stream, number, at[whole_too], length[whole_too])
                groups.append(refused(number, unsound, "checksum"))
            for length_here, where in sizes.items():
                rows = windows(stream, where, length_here)
                groups.append(Group(number, length_here, where, rows, kind.check(length_here)(rows)))
        for position in range(max(0, size - self._span + 1), size):
            tail = stream[position:]
            if any(len(tail) < p.span and p.may_begin(tail) for _, p in self._patterns):
                waiting.append(position)
        return groups, sorted(waiting)

    def _by_length(self, stream: Bytes, number: int, at: Ints, length: Ints) -> tuple[dict[int, Ints], Ints]:
        """Return candidates by length, and where those of rare lengths begin of which none is sound.

        A damaged length is rarely the same twice: they are looked at all together.
        """
        if not len(at):
            return {}, at
        main = int(length[len(length) // 2])  # The usual one, if there is one.
        others = np.flatnonzero(length != main)
        sizes = {main: at[np.flatnonzero(length == main)] if len(others) else at}
        sizes |= {int(n): at[others[length[others] == n]] for n in np.unique(length[others])}
        few = self._kinds[number].few
        rare = [n for n, where in sizes.items() if len(where) < _FEW and n not in self._usual]
        if few is None or not rare:
            return sizes, at[:0]
        spans = [(begin, n) for n in rare for begin in sizes[n].tolist()]
        sound = few([stream[begin : begin + n].tobytes() for begin, n in spans])
        self._usual |= {n for (_, n), good in zip(spans, sound.tolist(), strict=True) if good}
        unsound = [sizes.pop(n) for n in rare if n not in self._usual]
        return sizes, np.sort(joined(unsound))

    def _by_kind(self, stream: Bytes) -> Iterator[tuple[int, Ints]]:
        """Yield each kind and where it begins."""
        yield from _merged([number for number, _ in self._patterns], self._finder.find(stream))

    def _beginnings(self, stream: Bytes, groups: list[Group]) -> Iterator[tuple[int, Ints]]:
        """Yield the likely kind first, then, once its frames are in `groups`, the others outside of those."""
        likely = self._likely(stream)
        mine = [pattern for number, pattern in self._patterns if number == likely]
        others = [(number, pattern) for number, pattern in self._patterns if number != likely]
        if likely not in self._sifted:
            self._sifted[likely] = Finder(mine), Finder([pattern for _, pattern in others])
        first, rest = self._sifted[likely]
        yield from _merged([likely] * len(mine), first.find(stream))
        hidden = insides(len(stream), groups)
        yield from _merged([number for number, _ in others], rest.find(stream, hidden))

    def _likely(self, stream: Bytes) -> int:
        """Return the kind of most frames so far; before the first, the one whose head is seen most at first."""
        if self.counts.frames:
            return self.by_kind.index(max(self.by_kind))
        seen = [0] * len(self._kinds)
        for number, at in self._by_kind(stream[:_HEAD]):
            seen[number] += len(at)
        return seen.index(max(seen))

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

    def _take(self, ends: Ints, kinds: list[tuple[int, int]], fresh: int) -> None:
        """Account for frames with these ascending ends; `fresh` bytes of them are in no frame yet."""
        self._covered += fresh
        self._claimed = int(ends[-1])
        self.counts.frames += len(ends)
        for number, count in kinds:
            self.by_kind[number] += count


def _merged(numbers: list[int], found: list[Ints]) -> Iterator[tuple[int, Ints]]:
    """Yield each kind once with where its patterns begin, in order; those of a kind are neighbours."""
    for number in dict.fromkeys(numbers):
        starts = [at for each, at in zip(numbers, found, strict=True) if each == number]
        yield number, starts[0] if len(starts) == 1 else np.sort(joined(starts))
