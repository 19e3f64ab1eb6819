"""python-can messages from parsed frames, and slcan lines from messages."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import repeat

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import LimitExceeded
from drivers.kit.python_can import can
from drivers.kit.slcan_codec import FRAME_DTYPE, encode_frame


def to_messages(frames: NDArray[np.void], timestamps_s: NDArray[np.float64]) -> list[can.Message]:
    """Return frames (`FRAME_DTYPE`) as messages with the given time stamps, shape (n,)."""
    # By way of lists, and without keywords: indexing records one by one, or naming arguments, costs more than all
    # the rest.
    data = frames["data"].tobytes()
    ends = zip(range(0, len(data), 8), frames["length"].tolist(), strict=True)
    return list(
        map(
            can.Message,
            timestamps_s.tolist(),
            frames["id"].tolist(),
            frames["extended"].tolist(),
            frames["remote"].tolist(),
            repeat(False),  # no error frames
            repeat(None),  # channel
            frames["dlc"].tolist(),
            [data[at : at + length] for at, length in ends],
        )
    )


def from_messages(
    messages: Iterable[can.Message],
) -> tuple[NDArray[np.void], NDArray[np.float64], dict[str, int]]:
    """Return messages as frames (`FRAME_DTYPE`), their times in s, (n,) each, and what was left out.

    Left out, by kind: CAN FD and error frames, which classic CAN has not, and a DLC beyond 8. `end_offset`
    is the number of the frame among the messages, from 1: it orders, no bytes stand behind it.
    """
    rows, data, times_s = [], [], []
    left_out: dict[str, int] = {}
    for number, message in enumerate(messages, 1):
        kind = unsupported_kind(message) or ("dlc" if message.dlc > 8 or len(message.data) > 8 else "")
        if kind:
            left_out[kind] = left_out.get(kind, 0) + 1
            continue
        payload = b"" if message.is_remote_frame else bytes(message.data)
        rows.append(
            (
                message.arbitration_id,
                message.is_extended_id,
                message.is_remote_frame,
                message.dlc,
                len(payload),
                number,
            )
        )
        data.append(payload.ljust(8, b"\0"))
        times_s.append(message.timestamp)
    frames = np.zeros(len(rows), FRAME_DTYPE)
    columns = zip(*rows, strict=True) if rows else ([] for _ in range(6))
    for name, values in zip(
        ("id", "extended", "remote", "dlc", "length", "end_offset"), columns, strict=True
    ):
        frames[name] = values
    frames["data"] = np.frombuffer(b"".join(data), np.uint8).reshape(-1, 8)
    return frames, np.array(times_s, np.float64), left_out


def unsupported_kind(message: can.Message) -> str:
    """Return what makes a message one that slcan has no line for ('fd', 'error_frame'), empty for none."""
    return "fd" if message.is_fd else "error_frame" if message.is_error_frame else ""


class NotClassicCan(LimitExceeded, can.CanOperationError):  # type: ignore[misc]  # python-can is Any
    """A message that slcan has no line for: a limit here, an error of the bus to python-can's users."""


def encode_message(message: can.Message) -> bytes:
    """Return a message as an slcan line; NotClassicCan for one that classic CAN data lines cannot carry."""
    kind = unsupported_kind(message)
    if kind:
        raise NotClassicCan(
            "slcan has no line for this message",
            found=kind,
            expected="a data or remote frame of classic CAN",
            remedy="use a CAN interface of python-can that carries it",
        )
    try:
        return encode_frame(
            message.arbitration_id,
            bytes(message.data),
            extended=message.is_extended_id,
            remote=message.is_remote_frame,
            dlc=message.dlc,
        )
    except LimitExceeded as error:
        raise NotClassicCan(
            error.what, found=error.found, expected=error.expected, remedy=error.remedy
        ) from error
