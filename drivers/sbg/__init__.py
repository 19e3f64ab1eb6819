"""SBG Ellipse on CAN: the shipped layout `sbg_ellipse` of `drivers.can_dbc`, under the unit's own name."""

from __future__ import annotations

import tomllib
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

from drivers.can_dbc import (
    CanConfig,
    CanDecoder,
    CanGyro,
    CanLayout,
    can_kind,
    compile_message,
    layout_from_mapping,
    load_message,
)
from drivers.kit.link import Link

if TYPE_CHECKING:  # whoever has the bus has python-can; a lab that emulates one does without
    from drivers.kit.python_can import can

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


class SbgDecoder(CanDecoder):
    """Decoder of an Ellipse: a row for every IMU_GYRO that directly follows its IMU_INFO."""

    def __init__(self, rate_hz: float, axes: str = "xyz", dbc: Path = ELLIPSE_DBC) -> None:
        """Raises ConfigurationError for a rate or axes that cannot be, or a DBC file without the messages."""
        super().__init__(ellipse_layout(dbc), rate_hz, axes)


class SbgGyro(CanGyro):
    """An Ellipse whose IMU_INFO and IMU_GYRO outputs were set to `rate_hz` before."""

    def __init__(
        self, bus: can.BusABC, link: Link, *, rate_hz: float, axes: str = "xyz", dbc: Path = ELLIPSE_DBC
    ) -> None:
        super().__init__(bus, link, ellipse_layout(dbc), rate_hz=rate_hz, axes=axes)


SbgEllipse = can_kind(CanConfig, lambda config: ellipse_layout())

__all__ = [
    "ALL_GOOD",
    "ELLIPSE_DBC",
    "SbgDecoder",
    "SbgEllipse",
    "SbgGyro",
    "compile_message",
    "ellipse_layout",
    "load_message",
]
