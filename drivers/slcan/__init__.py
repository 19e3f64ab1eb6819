"""CAN: an slcan adapter as a python-can bus, and any other python-can bus as a link of slcan lines.

Loads python-can; the bytes alone are in `drivers.kit.slcan_codec`.
"""

from drivers.slcan._bus import BufferedSlcanBus
from drivers.slcan._messages import open_can
from drivers.slcan._python_can import from_messages, to_messages

__all__ = ["BufferedSlcanBus", "from_messages", "open_can", "to_messages"]
