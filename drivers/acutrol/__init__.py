"""Acutronic ACUTROL3000 rate table controller, ACL over TCP or RS-232."""

from drivers.acutrol._kind import Acutrol3000
from drivers.acutrol._transcript import decode_transcript
from drivers.acutrol.codec import encode_state_query

__all__ = ["Acutrol3000", "decode_transcript", "encode_state_query"]
