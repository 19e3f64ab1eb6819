"""Weiss Technik and Vötsch climatic chambers: SimServ and ASCII-2 on TCP port 2049 or RS-232."""

from drivers.weiss._kind import Weiss, WeissConfig

__all__ = ["Weiss", "WeissConfig"]
