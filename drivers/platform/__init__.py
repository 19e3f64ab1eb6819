"""A platform INS that sends position and temperatures over a serial line: codec and driver."""

from drivers.platform._driver import BAUDRATE
from drivers.platform._kind import PINS

__all__ = ["BAUDRATE", "PINS"]
