"""A platform INS that sends position and temperatures over a serial line: codec and driver."""

from drivers.platform._codec import (
    COUNTER_MODULO,
    NAVIGATING,
    POSITION_VALID,
    REGULATED,
    PlatformDecoder,
    checksum,
    encode_position,
    parse,
    sentence,
)
from drivers.platform._driver import BAUDRATE, PlatformIns
from drivers.platform._kind import PINS

__all__ = [
    "BAUDRATE",
    "COUNTER_MODULO",
    "NAVIGATING",
    "PINS",
    "POSITION_VALID",
    "REGULATED",
    "PlatformDecoder",
    "PlatformIns",
    "checksum",
    "encode_position",
    "parse",
    "sentence",
]
