"""CAN: an slcan adapter as a python-can bus, and any other python-can bus as a link of slcan lines."""

from drivers.slcan._bus import INTERFACE, BufferedSlcanBus
from drivers.slcan._codec import FRAME_DTYPE, SlcanParser, encode_frame, encode_frames
from drivers.slcan._commands import BITRATE_COMMANDS
from drivers.slcan._messages import MessageLink
from drivers.slcan._open import open_can
from drivers.slcan._python_can import from_messages, to_messages

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
