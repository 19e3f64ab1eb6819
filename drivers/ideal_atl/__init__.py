"""Ideal Aerosmith rate tables with ATL (AERO 4000, 1291, 2103 family), one axis over RS-232."""

from drivers.ideal_atl._kind import IdealAtl, decode_transcript

__all__ = ["IdealAtl", "decode_transcript"]
