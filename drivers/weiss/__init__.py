"""Weiss Technik and Vötsch climatic chambers: SimServ and ASCII-2 on TCP port 2049 or RS-232."""

from drivers.weiss._ascii2 import (
    Values,
    decode_values,
    encode_configuration_query,
    encode_gradient,
    encode_read,
    encode_set,
    encode_values,
)
from drivers.weiss._configuration import Configuration, Setting, decode_configuration, encode_configuration
from drivers.weiss._driver import WeissChamber
from drivers.weiss._kind import Weiss, WeissConfig
from drivers.weiss._simserv import (
    MESSAGE_TYPES,
    NOT_AVAILABLE,
    NOT_READABLE,
    OK,
    SEPARATOR,
    STATUS_TEXTS,
    UNKNOWN_COMMAND,
    WRONG_PARAMETERS,
    ChamberStatus,
    Number,
    SimServReply,
    decode_simserv_reply,
    encode_request,
    encode_simserv_reply,
)
from drivers.weiss._transcript import decode_transcript

__all__ = [
    "MESSAGE_TYPES",
    "NOT_AVAILABLE",
    "NOT_READABLE",
    "OK",
    "SEPARATOR",
    "STATUS_TEXTS",
    "UNKNOWN_COMMAND",
    "WRONG_PARAMETERS",
    "ChamberStatus",
    "Configuration",
    "Number",
    "Setting",
    "SimServReply",
    "Values",
    "Weiss",
    "WeissChamber",
    "WeissConfig",
    "decode_configuration",
    "decode_simserv_reply",
    "decode_transcript",
    "decode_values",
    "encode_configuration",
    "encode_configuration_query",
    "encode_gradient",
    "encode_read",
    "encode_request",
    "encode_set",
    "encode_simserv_reply",
    "encode_values",
]
