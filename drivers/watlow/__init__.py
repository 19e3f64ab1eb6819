"""Chambers with a Watlow F4 (Modbus RTU) or F4T (Modbus TCP or RTU) controller."""

from drivers.watlow._kind import F4Config, F4TConfig, WatlowF4, WatlowF4T

__all__ = ["F4Config", "F4TConfig", "WatlowF4", "WatlowF4T"]
