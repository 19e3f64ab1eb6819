"""Reads raw/: blocks of bytes, arrival marks, and the exchanges of a polled instrument; torn tails are cut."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from operator import itemgetter
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from bench.record.recording._journal import RAW_FOLDER, TIE_NS
from drivers.base.errors import RecordError
from drivers.kit.kinds import Exchange

BLOCK_BYTES = 1 << 20
_MARKS_AT_ONCE = 4096
_LONGEST_SILENCE_NS = 30 * 86_400 * 10**9


def raw_path(folder: Path, port: str) -> Path:
    """Return the file of everything `port` received."""
    return folder / RAW_FOLDER / f"{port}.bin"


def read_blocks(path: Path, start: int = 0, block_bytes: int = BLOCK_BYTES) -> Iterator[bytes]:
    """Yield the bytes of `path` from offset `start` in blocks; nothing if the file does not exist."""
    if not path.exists():
        return
    with path.open("rb", buffering=0) as file:
        file.seek(start)
        while block := file.read(block_bytes):
            yield block


def read_marks(path: Path) -> NDArray[np.int64]:
    """Return the index of `path` (a .bin file), int64 (m, 2): (bytes so far, bench time ns), mapped, not read.

    Cut where the index is torn (half a pair) or speaks of bytes that are not in the file: `missing_tail` tells of
    those. RecordError if bytes or times go backwards, or time leaps by a month: then it is not torn but damaged.
    """
    marks = _all_marks(path)
    size = path.stat().st_size if path.exists() else 0
    return marks[: int(np.searchsorted(marks[:, 0], size, side="right"))]


def missing_tail(path: Path) -> tuple[int, float] | None:
    """Return how many bytes a .bin file lacks of those that its index has, and the bench time in s from which.

    None for a file that has them all.
    """
    marks = _all_marks(path)
    size = path.stat().st_size if path.exists() else 0
    if not len(marks) or marks[-1, 0] <= size:
        return None
    whole = int(np.searchsorted(marks[:, 0], size, side="right"))
    return int(marks[-1, 0]) - size, float(marks[whole - 1, 1]) / 1e9 if whole else 0.0


def _all_marks(path: Path) -> NDArray[np.int64]:
    index = path.with_suffix(".idx")
    pairs = index.stat().st_size // 16 if index.exists() else 0
    if not pairs:
        return np.empty((0, 2), np.int64)
    marks = np.memmap(index, dtype="<i8", mode="r", shape=(pairs, 2))
    _check_order(index, marks)
    return marks


def first_arrivals(
    marks: NDArray[np.int64], done: int, end_offset: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.float64], int]:
    """Return which frames of a batch have an arrival mark of their own, when they came in s, and marks done.

    `done`: how many marks earlier batches took. `end_offset` (n,) of the frames; where several arrived with one
    mark it is that of the first. A mark behind whose frame more than a frame is missing says nothing of its time.
    """
    upto = int(np.searchsorted(marks[:, 0], end_offset[-1], side="right"))
    here = np.asarray(marks[done:upto])
    frame = np.searchsorted(end_offset, here[:, 0], side="right") - 1
    if len(end_offset) > 2:
        near = here[:, 0] - end_offset[frame] <= 2.0 * np.median(np.diff(end_offset))
        here, frame = here[near], frame[near]
    first = np.flatnonzero(np.diff(frame, prepend=-1) > 0)
    return frame[first], here[first, 1] * 1e-9, upto


def _check_order(index: Path, marks: NDArray[np.int64], rows: int = 65536) -> None:
    """Raise RecordError if bytes or times go backwards (times beyond tie-breaking) or leap."""
    before = np.zeros((1, 2), np.int64)
    for start in range(0, len(marks), rows):
        here = np.concatenate((before, marks[start : start + rows]))
        before = here[-1:]
        # Times are compared as float64: the difference of two damaged ones may not fit into 64 bits.
        later = np.diff(here[:, 1].astype(np.float64))
        wrong = (here[1:, 0] < here[:-1, 0]) | (later < -TIE_NS) | (later > _LONGEST_SILENCE_NS)
        if wrong.any():
            at = int(np.argmax(wrong))
            raise RecordError(
                "the arrival index is damaged",
                where=f"{index}, pair {start + at + 1}",
                found=f"{here[at + 1].tolist()} after {here[at].tolist()}",
                expected="bytes and times that do not go backwards, and no month of silence",
                remedy="restore the file from a copy",
            )


def read_exchanges(folder: Path, port: str) -> Iterator[Exchange]:
    """Yield what went over `port` in both directions as (time ns, "sent" or "received", bytes), by time.

    Bytes that a kill left without a mark belong to no moment and are left out.
    """
    received = _directed(raw_path(folder, port), "received")
    sent = _directed(raw_path(folder, port).with_suffix(".sent.bin"), "sent")
    yield from heapq.merge(sent, received, key=itemgetter(0))


def can_frames(folder: Path, port: str) -> Iterator[tuple[NDArray[np.void], NDArray[np.float64]]]:
    """Yield the frames of a CAN port (`drivers.kit.slcan_codec.FRAME_DTYPE`) and their bench times in s, (n,).

    A frame's time lies on the straight line between the arrivals before and after its line's end.
    """
    from drivers.kit.slcan_codec import SlcanParser

    path = raw_path(folder, port)
    marks = read_marks(path)
    parser = SlcanParser()
    for block in read_blocks(path):
        frames = parser.feed(block)
        if len(frames) and len(marks):
            yield frames, np.interp(frames["end_offset"], marks[:, 0], marks[:, 1] * 1e-9)


def _directed(path: Path, direction: Literal["sent", "received"]) -> Iterator[Exchange]:
    marks = read_marks(path)
    if not len(marks):
        return
    with path.open("rb") as file:
        at = 0
        for start in range(0, len(marks), _MARKS_AT_ONCE):
            for size, time_ns in marks[start : start + _MARKS_AT_ONCE].tolist():
                yield time_ns, direction, file.read(size - at)
                at = size
