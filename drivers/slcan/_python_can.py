"""python-can messages from parsed frames, and slcan lines from messages."""

from __future__ import annotations

import can
import numpy as np
from numpy.typing import NDArray

from drivers.errors import LimitExceeded
from drivers.slcan._codec import encode_frame


def to_messages(frames: NDArray[np.void], timestamps_s: NDArray[np.float64]) -> list[can.Message]:
    """Return frames (`FRAME_DTYPE`) as messages with the given time stamps, shape (n,)."""
    # By way of lists: indexing records one by one costs more than all the rest.
    data = frames["data"].tobytes()
    fields = zip(
        timestamps_s.tolist(),
        *(frames[name].tolist() for name in ("id", "extended", "remote", "dlc", "length")),
        range(0, len(data), 8),
        strict=True,
    )
    return [
        can.Message(
            timestamp=timestamp_s,
            arbitration_id=identifier,
            is_extended_id=extended,
            is_remote_frame=remote,
            dlc=dlc,
            data=data[at : at + length],
        )
        for timestamp_s, identifier, extended, remote, dlc, length, at in fields
    ]


def unsupported_kind(message: can.Message) -> str:
    """Return what makes a message one that slcan has no line for ('fd', 'error_frame'), empty for none."""
    return "fd" if message.is_fd else "error_frame" if message.is_error_frame else ""


def encode_message(message: can.Message) -> bytes:
    """Return a message as an slcan line; LimitExceeded for one that classic CAN data lines cannot carry."""
    kind = unsupported_kind(message)
    if kind:
        raise LimitExceeded(
            "slcan has no line for this message",
            found=kind,
            expected="a data or remote frame of classic CAN",
            remedy="use a CAN interface of python-can that carries it",
        )
    return encode_frame(
        message.arbitration_id,
        bytes(message.data),
        extended=message.is_extended_id,
        remote=message.is_remote_frame,
        dlc=message.dlc,
    )
