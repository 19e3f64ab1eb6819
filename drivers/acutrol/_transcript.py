"""Table telemetry rebuilt from the recorded bytes of both directions."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterable
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drivers.acutrol._codec import decode_numbers, split_reply
from drivers.errors import ProtocolError

_STATE_QUERY = re.compile(rb":read:pos\? (\d+);rate\? \1")


def decode_transcript(
    exchanges: Iterable[tuple[int, Literal["sent", "received"], bytes]],
) -> tuple[dict[str, NDArray[Any]], dict[str, int]]:
    """Return one row a completed state poll, and counts.

    `exchanges`: (time in ns, direction, bytes) in time order; chunks may split or join messages. Columns, shape
    (n,) each: `time_ns` int64 (arrival of the reply's last byte), `angle_deg` and `rate_dps` float64. Counts:
    `polls` asked, `damaged` of them without a good reply. Never raises on bytes. A new request voids the replies
    still due, as in the driver, so one lost byte costs one poll.
    """
    time_ns: list[int] = []
    values: list[tuple[float, ...]] = []
    polls = 0
    line, received = b"", b""
    due: deque[bool] = deque()
    for at_ns, direction, data in exchanges:
        if direction == "sent":
            *lines, line = (line + data).replace(b"\n", b"\r").split(b"\r")
            requests = [_STATE_QUERY.fullmatch(text) is not None for text in lines if text.strip()]
            if requests:
                due, received = deque(requests), b""
                polls += sum(requests)
            continue
        if not due:
            continue
        received += data
        try:
            while due and (found := split_reply(received)) is not None:
                reply, used = found
                received = received[used:]
                if due.popleft() and reply.error == 0:
                    values.append(decode_numbers(reply.text, 2))
                    time_ns.append(at_ns)
        except ProtocolError:
            due, received = deque(), b""
    table = np.array(values, dtype=np.float64).reshape(-1, 2)
    columns: dict[str, NDArray[Any]] = {
        "time_ns": np.array(time_ns, dtype=np.int64),
        "angle_deg": table[:, 0],
        "rate_dps": table[:, 1],
    }
    return columns, {"polls": polls, "damaged": polls - len(time_ns)}
