"""Ideal Aerosmith rate tables with ATL (AERO 4000, 1291, 2103 family), one axis over RS-232."""

from drivers.ideal_atl._codec import END, PROMPT, decode_number, encode, split_reply
from drivers.ideal_atl._driver import AtlTable
from drivers.ideal_atl._kind import IdealAtl, decode_transcript

__all__ = [
    "END",
    "PROMPT",
    "AtlTable",
    "IdealAtl",
    "decode_number",
    "decode_transcript",
    "encode",
    "split_reply",
]
