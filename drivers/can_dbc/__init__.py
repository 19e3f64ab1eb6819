"""Gyros on CAN described by a DBC file and a mapping: layouts, batch decoder, driver."""

from drivers.can_dbc._dbc import MAX_FILE_BYTES, compile_message, find_message, load_database
from drivers.can_dbc._decode import CanDecoder
from drivers.can_dbc._driver import CanGyro, identifier_names
from drivers.can_dbc._kind import CanConfig, CanDbc, CanDbcConfig, can_kind, layout_of, resolve_layout
from drivers.can_dbc._layout import (
    CanLayout,
    SignalUse,
    Slot,
    ValidRule,
    layout_from_plain,
    layout_to_plain,
)
from drivers.can_dbc._mapping import layout_from_mapping, load_layout, shipped_layouts
from drivers.can_dbc._signals import MessageLayout, SignalLayout

__all__ = [
    "MAX_FILE_BYTES",
    "CanConfig",
    "CanDbc",
    "CanDbcConfig",
    "CanDecoder",
    "CanGyro",
    "CanLayout",
    "MessageLayout",
    "SignalLayout",
    "SignalUse",
    "Slot",
    "ValidRule",
    "can_kind",
    "compile_message",
    "find_message",
    "identifier_names",
    "layout_from_mapping",
    "layout_from_plain",
    "layout_of",
    "layout_to_plain",
    "load_database",
    "load_layout",
    "resolve_layout",
    "shipped_layouts",
]
