"""CAN: an slcan adapter as a python-can bus, and any other python-can bus as a link of slcan lines.

The codec is here at once; what needs python-can is loaded when it is first asked for. python-can loads every log
format it finds a library for, pandas among them: seconds that reading a record or serving a lab has no use for.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from drivers.slcan._codec import FRAME_DTYPE, SlcanParser, encode_frame, encode_frames
from drivers.slcan._commands import BITRATE_COMMANDS

if TYPE_CHECKING:
    from drivers.slcan._bus import INTERFACE, BufferedSlcanBus
    from drivers.slcan._messages import MessageLink
    from drivers.slcan._open import open_can
    from drivers.slcan._python_can import from_messages, to_messages

_WITH_PYTHON_CAN = {
    "INTERFACE": "_bus",
    "BufferedSlcanBus": "_bus",
    "MessageLink": "_messages",
    "from_messages": "_python_can",
    "open_can": "_open",
    "to_messages": "_python_can",
}

__all__ = [
    "BITRATE_COMMANDS",
    "FRAME_DTYPE",
    "INTERFACE",
    "BufferedSlcanBus",
    "MessageLink",
    "SlcanParser",
    "encode_frame",
    "encode_frames",
    "from_messages",
    "open_can",
    "to_messages",
]


def __getattr__(name: str) -> Any:
    if name in _WITH_PYTHON_CAN:
        return getattr(importlib.import_module(f"drivers.slcan.{_WITH_PYTHON_CAN[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
