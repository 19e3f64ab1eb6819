"""The splitter of many kinds of frame against a byte-by-byte scan, in any chunks; nothing intact is lost."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from drivers.kit.patterns import Pattern
from drivers.kit.splitting import Kind, StreamSplitter


def additive(rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
    """Sum of all bytes zero modulo 4: weak on purpose, so that chance frames and overlaps occur."""
    sound: NDArray[np.bool_] = rows.sum(axis=1) % 4 == 0
    return sound


def places(head: bytes, *more: tuple[int, int, int]) -> list[tuple[int, int, int]]:
    return [(at, byte, 255) for at, byte in enumerate(head)] + list(more)


SHORT = (places(b"\xa5"), 1, 4)  # one byte of sync, begins inside itself
LONG = (places(b"\x5a\x5a"), 2, 7)
MASKED = (places(b"\x0f", (2, 0x10, 0xF0)), 3, 5)
STATED = (places(b"\xee"), 2, None)  # says its length, 3 to 8, in byte 1
KINDS = (SHORT, LONG, MASKED, STATED)


def stated(data: NDArray[np.uint8], starts: NDArray[np.int64]) -> NDArray[np.int64]:
    return data[starts + 1].astype(np.int64)


def splitter() -> StreamSplitter:
    return StreamSplitter(
        [
            Kind(
                (Pattern(head, span),),
                lambda _: additive,
                length or 3,
                length or 8,
                None if length else stated,
            )
            for head, span, length in KINDS
        ]
    )


def kind_at(data: bytes, at: int) -> int | str | None:
    """Which kind begins at `at`; "?" if the end of the data leaves it open."""
    open_end = False
    for number, (head, span, _) in enumerate(KINDS):
        known = [(offset, value, mask) for offset, value, mask in head if at + offset < len(data)]
        if all(data[at + offset] & mask == value for offset, value, mask in known):
            if at + max(span, *(offset + 1 for offset, _, _ in head)) <= len(data):
                return number
            open_end = True
    return "?" if open_end else None


def candidate(data: bytes, at: int) -> tuple[str, int, int]:
    """(what, kind, length) of the beginning at `at`: sound, unsound, length, wait or none."""
    kind = kind_at(data, at)
    if kind is None:
        return "none", -1, 0
    if isinstance(kind, str):
        return "wait", -1, 0
    length = KINDS[kind][2]
    if length is None:
        length = data[at + 1]
        if not 3 <= length <= 8:
            return "length", kind, 0
    if at + length > len(data):
        return "wait", kind, length
    return ("sound" if sum(data[at : at + length]) % 4 == 0 else "unsound"), kind, length


def scan(
    data: bytes, candidate: Callable[[bytes, int], tuple[str, int, int]] = candidate
) -> tuple[list[tuple[int, int, bytes]], dict[str, int], int]:
    """The splitter's rule, byte by byte: (end, kind, frame), rejects by reason, bytes outside of frames."""
    frames: list[tuple[int, int, bytes]] = []
    rejects: dict[str, int] = {}
    inside: set[int] = set()
    at, end, looked_ahead = 0, -1, False
    while at < len(data):
        if at == end - 1 and not looked_ahead:  # what follows directly goes before what shares a byte
            what, kind, length = candidate(data, end) if end < len(data) else ("wait", -1, 0)
            looked_ahead = True
            if what == "sound":
                at = end
            elif what == "wait" and candidate(data, at)[0] != "none":
                break
            continue
        what, kind, length = candidate(data, at)
        if what == "wait":
            break
        if what == "sound":
            frames.append((at + length, kind, data[at : at + length]))
            inside.update(range(at, at + length))
            end, looked_ahead = at + length, False
            at = end - 1
            continue
        if what != "none":
            reason = "length" if what == "length" else "checksum"
            rejects[reason] = rejects.get(reason, 0) + 1
        at += 1
    return frames, rejects, len(set(range(at)) - inside)


def cut(data: bytes, sizes: list[int]) -> list[bytes]:
    chunks, at, turn = [], 0, 0
    while at < len(data):
        chunks.append(data[at : at + sizes[turn % len(sizes)]])
        at, turn = at + len(chunks[-1]), turn + 1
    return chunks


PIECES = [
    b"\xa5\x00\x00\x03",
    b"\x5a\x5a\x00\x00\x00\x00\x00",
    b"\x0f\x00\x11\x00\x00",
    b"\xee\x05\x00\x00\x01",
]
pieces = st.one_of(
    st.sampled_from(PIECES),
    st.sampled_from(
        [b"\xa5", b"\x5a", b"\x0f", b"\xee", b"\xee\x09", b"\xa5\x00\x00\xa5", b"\xa5\xa5\xa5\xa5"]
    ),
    st.binary(max_size=3),
)


@given(
    data=st.lists(pieces, max_size=30).map(b"".join),
    sizes=st.lists(st.integers(1, 19), min_size=1, max_size=6),
)
@example(data=b"\xa5\x00\x00\xa5" * 3, sizes=[5])
@settings(max_examples=500, deadline=None)
def test_splitter_does_what_a_byte_by_byte_scan_does_in_any_chunks(data: bytes, sizes: list[int]) -> None:
    ours = splitter()
    got = []
    for chunk in cut(data, sizes):
        for piece in ours.feed(chunk):
            rows = [row.tobytes() for row in piece.rows]
            got += [(end, piece.kind, row) for end, row in zip(piece.ends.tolist(), rows, strict=True)]
        assert ours.pending <= 8
    frames, rejects, skipped = scan(data)
    assert sorted(got) == frames
    assert ours.counts.rejected == rejects
    assert ours.counts.bytes_skipped == skipped
    assert ours.counts.frames == len(frames) == sum(ours.by_kind)


def test_a_lost_last_byte_does_not_cost_the_next_frame() -> None:
    frame = b"\xa5\x01\x02\x00"  # sum 168: sound, and so is its head with the next one's first byte
    data = b"\xa5\x00\x06" + frame + b"\xa5\x00\x00\x03"
    ours = splitter()
    rows = [row.tobytes() for piece in ours.feed(data) for row in piece.rows]
    assert frame in rows


def test_what_is_hidden_behind_likely_frames_is_never_one_that_counts() -> None:
    # With this weak check frames overlap often.
    rng = np.random.default_rng(4)
    palette = [*PIECES, b"\xa5", b"\x5a", b"\x0f", b"\xee", b"\xa5\x00\x00\xa5", b"\x00", b"\x01"]
    for _ in range(300):
        data = b"".join(palette[n] for n in rng.integers(len(palette), size=int(rng.integers(1, 60))))
        ours, got = splitter(), []
        for chunk in cut(data, [int(rng.integers(1, len(data) + 1))]):
            for piece in ours.feed(chunk):
                got += [(int(end), piece.kind) for end in piece.ends]
        frames, rejects, skipped = scan(data)
        assert sorted(got) == [(end, kind) for end, kind, _ in frames]
        assert ours.counts.rejected == rejects
        assert ours.counts.bytes_skipped == skipped


class Counting:
    """A check that counts the rows it is asked about."""

    def __init__(self) -> None:
        self.rows = 0

    def __call__(self, rows: NDArray[np.uint8]) -> NDArray[np.bool_]:
        self.rows += len(rows)
        return additive(rows)


def counted() -> tuple[StreamSplitter, list[Counting]]:
    checks = [Counting() for _ in KINDS]
    kinds = [
        Kind(
            (Pattern(head, span),),
            lambda _, check=check: check,  # type: ignore[misc]
            length or 3,
            length or 8,
            None if length else stated,
        )
        for (head, span, length), check in zip(KINDS, checks, strict=True)
    ]
    return StreamSplitter(kinds), checks


@pytest.mark.parametrize("kind", range(4))
@pytest.mark.parametrize("sizes", [[100_000], [4096], [7, 50, 333]])
def test_each_frame_of_a_clean_stream_is_checked_once(kind: int, sizes: list[int]) -> None:
    """A search through everything would check every place that looks like a beginning, too."""
    data = PIECES[kind] * 4000
    ours, checks = counted()
    for chunk in cut(data, sizes):
        ours.feed(chunk)
    assert ours.by_kind == [4000 if number == kind else 0 for number in range(4)]
    assert [check.rows for check in checks] == ours.by_kind


INSIDE = b"\x5a\x5a\xa5\x00\x00\x03\x00"  # sound itself, with what could be a sound frame inside


@pytest.mark.parametrize("first", [b"", PIECES[0] * 3])
def test_beginnings_inside_of_frames_of_the_likely_kind_are_not_looked_at(first: bytes) -> None:
    """Most are of one kind, with a beginning of another in each: only the real ones of that are checked."""
    assert sum(INSIDE) % 4 == 0
    data = first + (INSIDE * 4 + PIECES[1] * 5 + PIECES[0]) * 200
    ours, checks = counted()
    ours.feed(data)
    real = len(first) // 4 + 200
    assert ours.by_kind == [real, 1800, 0, 0]
    looked_at_first = 18  # rows that may lie end to end
    assert checks[0].rows - real <= looked_at_first and checks[1].rows - 1800 <= looked_at_first


@pytest.mark.parametrize("count", [3, 300])
def test_a_beginning_at_the_end_is_waited_for_behind_any_number_of_frames(count: int) -> None:
    """Noise between the frames, so that they are searched for; the last one comes in two pieces, cut anywhere."""
    data = b"".join(PIECES[0] + b"\x01" for _ in range(count)) + PIECES[1]
    for at in range(len(data) - 8, len(data)):
        ours, got = splitter(), 0
        for chunk in (data[:at], data[at:]):
            got += sum(len(piece.ends) for piece in ours.feed(chunk))
        assert got == count + 1
        assert ours.counts.bytes_skipped == count


def two_kinds() -> StreamSplitter:
    """Frames of 4 bytes that begin with A5, and of 40 that begin with 01."""
    short, long = (Pattern(places(head), 1) for head in (b"\xa5", b"\x01"))
    return StreamSplitter(
        [Kind((short,), lambda _: additive, 4, 4), Kind((long,), lambda _: additive, 40, 40)]
    )


ENDS_IN_A_BEGINNING, OTHER = b"\xa5\x01\x01\x01", b"\xa5\x00\x00\x03"


@pytest.mark.parametrize("before", [b"\x07", (OTHER + b"\x07") * 400])
def test_a_beginning_in_the_last_byte_of_a_frame_does_not_hold_up_the_frame_that_follows(
    before: bytes,
) -> None:
    """That beginning, of a long frame, is waited for if something else follows; a whole frame goes before it."""
    frames = before.count(OTHER)
    for between, more in ((b"", 2), (b"\x07", 1), (b"\x07\x07", 1)):
        got = sum(
            len(piece.ends) for piece in two_kinds().feed(before + ENDS_IN_A_BEGINNING + between + OTHER)
        )
        assert got == frames + more
    ours = two_kinds()
    assert sum(len(piece.ends) for piece in ours.feed(before + ENDS_IN_A_BEGINNING)) == frames + 1
    assert sum(len(piece.ends) for piece in ours.feed(OTHER)) == 1
