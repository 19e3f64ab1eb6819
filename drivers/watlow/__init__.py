"""Chambers with a Watlow F4 (Modbus RTU) or F4T (Modbus TCP or RTU) controller."""

from drivers.watlow._driver import WatlowChamber
from drivers.watlow._kind import F4Config, F4TConfig, WatlowF4, WatlowF4T
from drivers.watlow._registers import F4, F4T, F4Readings, F4TReadings, scaled, unscaled
from drivers.watlow._transcript import decode_f4, decode_f4t

__all__ = [
    "F4",
    "F4T",
    "F4Config",
    "F4Readings",
    "F4TConfig",
    "F4TReadings",
    "WatlowChamber",
    "WatlowF4",
    "WatlowF4T",
    "decode_f4",
    "decode_f4t",
    "scaled",
    "unscaled",
]
