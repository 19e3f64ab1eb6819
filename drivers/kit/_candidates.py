"""What may be frames: candidates of one kind and length, which of them are taken, and what is refused."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.kit.patterns import Bytes, Ints


@dataclass
class Group:
    """Whole candidates of one kind and length; of length 0: those refused for what `refused` says."""

    kind: int
    length: int
    starts: Ints
    rows: Bytes
    sound: NDArray[np.bool_]
    refused: str = "checksum"

    def __post_init__(self) -> None:
        # Places rather than masks: taking what a mask picks at random costs a wrong guess for every change.
        self._which = np.flatnonzero(self.sound)
        self.good = self.starts[self._which]

    def rows_of(self, good: slice | Ints) -> Bytes:
        """Return the rows of some of `good`."""
        which = self._which[good]
        if len(which) == len(self.starts):
            return self.rows
        whole = self.rows.view(f"V{self.length}")[:, 0]  # Copied frame by frame, not byte by byte.
        return whole[which].view(np.uint8).reshape(-1, self.length)

    def unsound(self, end: int) -> Ints:
        """Return those of `starts` before `end` that are not sound."""
        bad = self.starts[np.flatnonzero(~self.sound)]
        return bad[: int(np.searchsorted(bad, end))]

    def passed(self, good: slice | Ints, count: int) -> Ints:
        """Return how many of some of `good` begin before each of the first `count` that are not sound."""
        marks = np.zeros(len(self.starts), np.int64)
        marks[self._which[good]] = 1
        passed: Ints = np.cumsum(marks, out=marks)[np.flatnonzero(~self.sound)[:count]]
        return passed


def refused(number: int, starts: Ints, reason: str) -> Group:
    """Return candidates of which none is sound."""
    return Group(number, 0, starts, np.empty((0, 1), np.uint8), np.zeros(len(starts), np.bool_), reason)


def joined(arrays: list[Ints]) -> Ints:
    """Return them one after the other; the one itself if there is no other."""
    if len(arrays) == 1:
        return arrays[0]
    return np.concatenate(arrays) if arrays else np.empty(0, np.int64)


def insides(size: int, groups: list[Group]) -> NDArray[np.bool_]:
    """Return which of `size` places lie inside of sound frames; not the second, nor the last, of their bytes."""
    hidden = np.zeros(size, np.bool_)
    for group in groups:
        _mark(hidden, group.good + 2, group.length - 3)
    return hidden


def _mark(places: NDArray[np.bool_], starts: Ints, length: int) -> None:
    """Set `length` places from each of `starts` on."""
    if length > 0 and len(starts):
        spans = np.ndarray((len(places) - length + 1,), f"V{length}", places, strides=(1,))
        spans[starts] = np.void(b"\1" * length)


def choose(starts: Ints, ends: Ints, claimed: int) -> Ints | None:
    """Return which of the sound frames with these borders are taken when each claims its bytes in order.

    None: all of them.
    """
    if not len(starts) or (starts[0] >= claimed and bool((starts[1:] >= ends[:-1]).all())):
        return None
    taken = np.ones(len(starts), np.bool_)
    reached = np.concatenate(([claimed], ends[:-1]))
    if bool((reached[1:] < reached[:-1]).any()):
        np.maximum.accumulate(reached, out=reached)
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
    return None if taken.all() else np.flatnonzero(taken)


def shares(groups: list[Group], picks: slice | Ints) -> Iterator[slice | Ints]:
    """Yield which of each group's sound frames ascending places among all of them, group by group, are."""
    first = 0
    for group in groups:
        if isinstance(picks, slice) or len(groups) == 1:
            yield picks
        else:
            here, there = np.searchsorted(picks, (first, first + len(group.good)))
            yield picks[here:there] - first
            first += len(group.good)


def open_places(points: Ints, follows: Ints, starts: Ints, before: Ints) -> int:
    """Count the `points` at which a frame might begin, frames from `starts` on being taken.

    `follows`: how many of those begin before each point; `before` (one more than `starts`): where what is before
    each of them ends, and the last of them. The last byte of a frame may be the first of another, unless one
    follows it.
    """
    ends = before[follows]
    free = points >= ends
    shared = np.flatnonzero(points == ends - 1)
    if len(shared):
        after = np.concatenate((starts, [-1]))[follows[shared]]
        free[shared] = after != ends[shared]
    return int(np.count_nonzero(free))
