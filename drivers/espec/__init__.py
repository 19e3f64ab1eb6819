"""ESPEC chambers with a P-300 or SCP-220 controller, ASCII over RS-232, RS-485 or TCP port 10001."""

from drivers.espec._kind import EspecConfig, EspecP300, EspecScp220

__all__ = ["EspecConfig", "EspecP300", "EspecScp220"]
