"""Table telemetry rebuilt from the recorded bytes of both directions."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Mapping
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drivers.acutrol.codec import decode_numbers, encode_state_query, split_reply
from drivers.base.errors import ProtocolError

_ONE_AXIS: Mapping[str, int] = {"table": 1}


def decode_transcript(
    exchanges: Iterable[tuple[int, Literal["sent", "received"], bytes]],
    axes: Mapping[str, int] = _ONE_AXIS,
) -> tuple[dict[str, NDArray[Any]], dict[str, int]]:
    """Return one row a completed state poll, and counts.

    `exchanges`: (time in ns, direction, bytes) in time order; chunks may split or join messages. Columns, shape
    (n,) each: `time_ns` int64 (arrival of the reply's last byte), `angle_deg` and `rate_dps` float64 of the last
    of `axes` (name -> number on the controller), `<name>_angle_deg` and `<name>_rate_dps` of the others. Counts:
    `polls` asked, `damaged` of them without a good reply. Never raises on bytes. A new request voids the replies
    still due, as in the driver, so one lost byte costs one poll.
    """
    query = encode_state_query(*axes.values()).strip()
    time_ns: list[int] = []
    values: list[tuple[float, ...]] = []
    polls = 0
    line, received = b"", b""
    due: deque[bool] = deque()
    for at_ns, direction, data in exchanges:
        if direction == "sent":
            *lines, line = (line + data).replace(b"\n", b"\r").split(b"\r")
            requests = [text.strip() == query for text in lines if text.strip()]
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
                    values.append(decode_numbers(reply.text, 2 * len(axes)))
                    time_ns.append(at_ns)
        except ProtocolError:
            due, received = deque(), b""
    table = np.array(values, dtype=np.float64).reshape(-1, 2 * len(axes))
    columns: dict[str, NDArray[Any]] = {
        "time_ns": np.array(time_ns, dtype=np.int64),
        "angle_deg": table[:, -2],
        "rate_dps": table[:, -1],
    }
    for at, name in enumerate(list(axes)[:-1]):
        columns |= {f"{name}_angle_deg": table[:, 2 * at], f"{name}_rate_dps": table[:, 2 * at + 1]}
    return columns, {"polls": polls, "damaged": polls - len(time_ns)}
