"""Questions and answers of a polled instrument, paired again from the recorded bytes of both directions."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import ProtocolError
from drivers.kit.kinds import Exchange, Transcript

Text = TypeVar("Text", str, bytes)

SplitRequest = Callable[[bytes], tuple[bytes, int] | None]
"""First request in a buffer and the bytes it takes, None while incomplete."""
SplitReply = Callable[[bytes, bytes], tuple[bytes, int] | None]
"""(request, buffer) -> first reply and the bytes it takes, None while incomplete; raises ProtocolError."""


def split_line(buffer: bytes) -> tuple[bytes, int] | None:
    """Return the first line in `buffer` that is not empty, CR or LF at its end, and the bytes up to there.

    The empty line that a halt begins with is not answered.
    """
    skipped = 0
    for line in buffer.splitlines(keepends=True):
        skipped += len(line)
        if line.strip():
            return (line.strip(), skipped) if line[-1:] in b"\r\n" else None
    return None


def match_replies(
    exchanges: Iterable[Exchange], split_request: SplitRequest, split_reply: SplitReply
) -> Iterator[tuple[int, bytes, bytes | None]]:
    """Yield (time in ns, request, reply) of every request; the reply is None if none came that fits.

    The time is that of the reply's last byte, or of the request. A new request voids the replies still due,
    as in the drivers, so one lost byte costs one exchange. Never raises on bytes.
    """
    line, received = b"", b""
    due: list[tuple[int, bytes]] = []
    for at_ns, direction, data in exchanges:
        if direction == "sent":
            line += data
            requests = []
            while (found := split_request(line)) is not None:
                request, used = found
                line = line[used:]
                requests.append((at_ns, request))
            if requests:
                yield from ((asked_ns, request, None) for asked_ns, request in due)
                due, received = requests, b""
            continue
        received += data
        while due:
            try:
                answer = split_reply(due[0][1], received)
            except ProtocolError:
                yield (*due.pop(0), None)
                received = b""
                break
            if answer is None:
                break
            reply, used = answer
            received = received[used:]
            yield at_ns, due.pop(0)[1], reply
    yield from ((asked_ns, request, None) for asked_ns, request in due)


def transcript(rows: Sequence[tuple[int, dict[str, float]]], first: Sequence[str], polls: int) -> Transcript:
    """Return (time in ns, values) of the answered polls as columns, and counts: `polls`, `damaged` of them.

    Columns: `time_ns` int64, then `first`, then all others by name; float64, NaN where missing.
    """
    others = sorted({name for _, row in rows for name in row} - set(first))
    columns: dict[str, NDArray[Any]] = {"time_ns": np.array([at for at, _ in rows], dtype=np.int64)}
    for name in (*first, *others):
        columns[name] = np.array([row.get(name, math.nan) for _, row in rows], dtype=np.float64)
    return columns, {"polls": polls, "damaged": polls - len(rows)}


def polled(
    answered: Iterable[tuple[int, Text, Text | None]],
    is_poll: Callable[[Text], bool],
    decode: Callable[[Text], dict[str, float]],
    first: Sequence[str],
) -> Transcript:
    """Return one row an answered poll, and counts, of an instrument whose poll is one question.

    answered: (time in ns, request, reply or None), as `match_replies` yields them.
    decode: reply -> values by column; raises ProtocolError for a bad reply, which costs its row only.
    """
    rows: list[tuple[int, dict[str, float]]] = []
    polls = 0
    for at_ns, request, reply in answered:
        if not is_poll(request):
            continue
        polls += 1
        with suppress(ProtocolError):
            if reply is not None:
                rows.append((at_ns, decode(reply)))
    return transcript(rows, first, polls)
