"""Sensonor STIM300 configured in its Service Mode: codec of the commands, and driver.

Source: Sensonor TS1524 rev. 31 (February 2024), sections 7.5, 8.7 and 9. The datagrams are those of the frame
description `stim300`.
"""

from drivers.stim300._driver import Stim300, Stim300Config, family

__all__ = ["Stim300", "Stim300Config", "family"]
