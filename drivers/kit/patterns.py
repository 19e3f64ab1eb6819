"""Where frames begin: the bytes at their heads, looked for over a whole piece of a stream at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Bytes = NDArray[np.uint8]
Check = Callable[[NDArray[np.uint8]], NDArray[np.bool_]]
"""Rows of candidate frames (n, length), each beginning with the sync word -> which of them are sound (n,)."""


class Pattern:
    """Bytes that a frame of a kind has at given offsets, under masks."""

    def __init__(self, places: Sequence[tuple[int, int, int]], span: int) -> None:
        """Take (offset, value, mask) triples; `span` bytes of a frame must be there to tell."""
        whole = [place for place in places if place[2] == 0xFF]
        # A byte that comes again in the head would be met at two places of each frame.
        values = [value for _, value, _ in places]
        self.anchor = min(whole or places, key=lambda place: (values.count(place[1]), place[0]))
        self.places = tuple(places)
        self.span = max(span, *(at + 1 for at, _, _ in places))

    def heads(self, rows: Bytes) -> NDArray[np.bool_]:
        """Return which rows have it."""
        good = np.ones(len(rows), np.bool_)
        for offset, value, mask in self.places:
            good &= rows[:, offset] == value if mask == 0xFF else (rows[:, offset] & mask) == value
        return good

    def may_begin(self, data: Bytes) -> bool:
        """Whether `data`, however short, can be the first bytes of a frame."""
        return all(at >= len(data) or int(data[at]) & mask == value for at, value, mask in self.places)


class Finder:
    """Finds where any of some patterns is complete, in one look over the bytes for each offset of an anchor."""

    def __init__(self, patterns: Sequence[Pattern]) -> None:
        self._patterns = tuple(patterns)
        self._anchors = [
            _Anchor(offset, [pattern for pattern in patterns if pattern.anchor[0] == offset])
            for offset in dict.fromkeys(pattern.anchor[0] for pattern in patterns)
        ]
        self.anchors = sum(len(anchor.values) for anchor in self._anchors)
        """How many bytes, by value and offset, are an anchor."""

    def find(self, data: Bytes, hidden: NDArray[np.bool_] | None = None) -> list[Ints]:
        """Return the ascending offsets in `data` at which each pattern is complete; none that are `hidden`."""
        found = {id(p): at for anchor in self._anchors for p, at in anchor.find(data, hidden)}
        return [found[id(pattern)] for pattern in self._patterns]


class _Anchor:
    """Patterns whose anchors are at the same offset."""

    def __init__(self, offset: int, patterns: Sequence[Pattern]) -> None:
        self._offset = offset
        self._patterns = tuple(patterns)
        self._table = np.zeros(256, np.bool_)
        for _, value, mask in (pattern.anchor for pattern in patterns):
            self._table |= np.arange(256) & mask == value
        self.values = np.flatnonzero(self._table).astype(np.uint8)
        common = set.intersection(*(set(pattern.places) for pattern in patterns))
        self._common = [place for place in patterns[0].places if place in common]
        self._own = [[place for place in pattern.places if place not in common] for pattern in patterns]
        self._span = max(at + 1 for at, _, _ in self._common) if common else 1

    def find(self, data: Bytes, hidden: NDArray[np.bool_] | None) -> Iterator[tuple[Pattern, Ints]]:
        """Yield each pattern with the ascending offsets at which it is complete."""
        here = data[self._offset :]
        common = self._common
        if len(self.values) == 1:
            there = here == self.values[0]
            common = [place for place in common if place[0] != self._offset]
            if common and common[0][0] > self._offset and common[0][2] == 0xFF:
                # A second byte compared everywhere costs less than gathering it where the first one is.
                (at, value, _), common = common[0], common[1:]
                there = there[: max(0, len(there) - (at - self._offset))]
                there &= data[at:] == value
        else:
            there = np.frombuffer(here.tobytes().translate(self._table.tobytes()), np.bool_)
        if hidden is not None:
            there = there & ~hidden[: len(there)]
        places = np.flatnonzero(there)
        if len(self.values) == 1:
            places = _having(data, places, common, self._span)
            for pattern, own in zip(self._patterns, self._own, strict=True):
                yield pattern, _having(data, places, own, pattern.span)
            return
        values = here[places]
        order = np.argsort(values, kind="stable")
        bounds = np.searchsorted(values[order], np.arange(257))
        for pattern, own in zip(self._patterns, self._own, strict=True):
            _, value, mask = pattern.anchor
            rest = own
            mine = places
            if mask == 0xFF:
                mine = places[order[bounds[value] : bounds[value + 1]]]
                rest = [place for place in own if place != pattern.anchor]
            yield pattern, _having(data, mine, [*self._common, *rest], pattern.span)


def _having(data: Bytes, at: Ints, places: Sequence[tuple[int, int, int]], span: int) -> Ints:
    """Return those of the ascending offsets `at` that have `span` bytes and in them what `places` say."""
    if len(at) and at[-1] > len(data) - span:
        at = at[: int(np.searchsorted(at, len(data) - span, side="right"))]
    for offset, value, mask in places:
        byte = data[offset:][at]
        good = byte == value if mask == 0xFF else (byte & mask) == value
        if not good.all():
            at = at[good]
    return at


def find_sync(data: NDArray[np.uint8], sync: bytes) -> NDArray[np.int64]:
    """Return every offset in `data` (uint8, shape (n,)) at which `sync` is complete, in order."""
    last = len(data) - len(sync) + 1
    if last <= 0:
        return np.empty(0, np.int64)
    at = np.flatnonzero(data[:last] == sync[0])
    for offset in range(1, len(sync)):
        at = at[data[at + offset] == sync[offset]]
    return at


def windows(data: NDArray[np.uint8], starts: NDArray[np.int64], length: int) -> NDArray[np.uint8]:
    """Return copies of the `length` bytes from each of `starts` on in `data`: uint8 (n, length)."""
    if not len(starts):
        return np.empty((0, length), np.uint8)
    # One item a byte offset, each `length` bytes long, as a view; indexing then copies whole items.
    every = np.ndarray((len(data) - length + 1,), f"V{length}", data, strides=(1,))
    return every[starts].view(np.uint8).reshape(len(starts), length)
