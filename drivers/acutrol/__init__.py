"""Acutronic ACUTROL3000 rate table controller, ACL over TCP or RS-232."""

from drivers.acutrol._codec import (
    DYNAMIC_BITS,
    HEADER_BYTES,
    INTERLOCK_BITS,
    MAX_TEXT_BYTES,
    SOFTWARE_FAULT_BITS,
    STATE_BITS,
    Reply,
    bits_in_words,
    decode_header,
    decode_numbers,
    decode_text,
    encode_command,
    encode_reply,
    encode_state_query,
    split_reply,
)
from drivers.acutrol._driver import AcutrolTable
from drivers.acutrol._grammar import (
    DATA_TYPE_ERROR,
    MESSAGE_TOO_LONG,
    NOT_IMPLEMENTED,
    PARAMETER_OUT_OF_RANGE,
    UNDEFINED_HEADER,
    WRONG_PARAMETER_COUNT,
    Command,
    Refusal,
    parse_message,
)
from drivers.acutrol._kind import Acutrol3000
from drivers.acutrol._transcript import decode_transcript

__all__ = [
    "DATA_TYPE_ERROR",
    "DYNAMIC_BITS",
    "HEADER_BYTES",
    "INTERLOCK_BITS",
    "MAX_TEXT_BYTES",
    "MESSAGE_TOO_LONG",
    "NOT_IMPLEMENTED",
    "PARAMETER_OUT_OF_RANGE",
    "SOFTWARE_FAULT_BITS",
    "STATE_BITS",
    "UNDEFINED_HEADER",
    "WRONG_PARAMETER_COUNT",
    "Acutrol3000",
    "AcutrolTable",
    "Command",
    "Refusal",
    "Reply",
    "bits_in_words",
    "decode_header",
    "decode_numbers",
    "decode_text",
    "decode_transcript",
    "encode_command",
    "encode_reply",
    "encode_state_query",
    "parse_message",
    "split_reply",
]
