"""Ideal Aerosmith rate tables with ATL (AERO 4000, 1291, 2103 family), one axis over RS-232."""

from drivers.ideal_atl._driver import AtlConfig, AtlTable
from drivers.ideal_atl._transcript import decode_transcript
from drivers.kit.kinds import Probe, TableKind

IdealAtl = TableKind(AtlTable, decode_transcript, AtlConfig, probes=lambda: [Probe(40)])

__all__ = ["IdealAtl", "decode_transcript"]
