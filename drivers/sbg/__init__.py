"""SBG Ellipse on CAN: the shipped layout `sbg_ellipse` of `drivers.can_dbc`, under the unit's own name."""

from __future__ import annotations

import tomllib
from functools import lru_cache
from pathlib import Path

from drivers.can_dbc import CanConfig, CanLayout, can_kind, layout_from_mapping

ELLIPSE_DBC = Path(__file__).with_name("ellipse.dbc")
"""The unit's messages of interest to a gyro bench, with their default identifiers."""
ALL_GOOD = 0x03FF
"""Status with every bit of a healthy IMU."""

_MAPPING = Path(__file__).parents[1] / "can_dbc" / "sbg_ellipse.toml"


@lru_cache
def ellipse_layout(dbc: Path = ELLIPSE_DBC) -> CanLayout:
    """Return the layout from a DBC file with the maker's message names; ConfigurationError without them."""
    mapping = tomllib.loads(_MAPPING.read_text(encoding="utf-8")) | {"dbc": str(dbc.absolute())}
    return layout_from_mapping(mapping, _MAPPING.parent, str(_MAPPING), "sbg_ellipse")


SbgEllipse = can_kind(CanConfig, lambda config: ellipse_layout())

__all__ = ["ALL_GOOD", "ELLIPSE_DBC", "SbgEllipse", "ellipse_layout"]
