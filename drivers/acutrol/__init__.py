"""Acutronic ACUTROL3000 rate table controller, ACL over TCP or RS-232."""

from drivers.acutrol._driver import AcutrolTable
from drivers.acutrol._transcript import decode_transcript
from drivers.acutrol.codec import encode_state_query
from drivers.kit.config import TableConfig
from drivers.kit.kinds import Probe, TableKind

Acutrol3000 = TableKind(AcutrolTable, decode_transcript, TableConfig, probes=lambda: [Probe(10)])

__all__ = ["Acutrol3000", "decode_transcript", "encode_state_query"]
