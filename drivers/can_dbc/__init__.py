"""Gyros on CAN described by a DBC file and a mapping: layouts, batch decoder, driver."""

from drivers.can_dbc._decode import CanDecoder
from drivers.can_dbc._kind import (
    CanConfig,
    CanDbc,
    CanDbcConfig,
    can_kind,
    identifier_names,
    layout_of,
    resolve_layout,
)
from drivers.can_dbc._layout import CanLayout, SignalUse, Slot, ValidRule
from drivers.can_dbc._mapping import layout_from_mapping, load_layout, shipped_layouts
from drivers.can_dbc._signals import MessageLayout

__all__ = [
    "CanConfig",
    "CanDbc",
    "CanDbcConfig",
    "CanDecoder",
    "CanLayout",
    "MessageLayout",
    "SignalUse",
    "Slot",
    "ValidRule",
    "can_kind",
    "identifier_names",
    "layout_from_mapping",
    "layout_of",
    "load_layout",
    "resolve_layout",
    "shipped_layouts",
]
