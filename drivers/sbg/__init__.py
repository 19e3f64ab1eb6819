"""SBG Ellipse on CAN: message layouts from a DBC file, decoder, driver."""

from drivers.sbg._decode import SbgDecoder
from drivers.sbg._driver import SbgGyro
from drivers.sbg._kind import SbgEllipse
from drivers.sbg._layout import MessageLayout, SignalLayout, compile_message, load_message
from drivers.sbg._messages import (
    ALL_GOOD,
    AXES,
    COUNTER_MODULO,
    ELLIPSE_DBC,
    Ellipse,
    load_ellipse,
    valid_mask,
)

__all__ = [
    "ALL_GOOD",
    "AXES",
    "COUNTER_MODULO",
    "ELLIPSE_DBC",
    "Ellipse",
    "MessageLayout",
    "SbgDecoder",
    "SbgEllipse",
    "SbgGyro",
    "SignalLayout",
    "compile_message",
    "load_ellipse",
    "load_message",
    "valid_mask",
]
