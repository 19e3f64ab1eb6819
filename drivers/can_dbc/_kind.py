"""Any gyro on CAN as the bench finds it by name: `driver = "can_dbc"`, `layout` a mapping file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from drivers.base.clock import Clock
from drivers.base.errors import ConfigurationError
from drivers.can_dbc._decode import CanDecoder
from drivers.can_dbc._driver import CanGyro
from drivers.can_dbc._layout import CanLayout, layout_from_plain, layout_to_plain
from drivers.can_dbc._mapping import layout_from_mapping, load_layout
from drivers.kit.instruments import GyroKind, Settings
from drivers.kit.link import Tap
from drivers.slcan import open_can

Layout = str | Mapping[str, Any]
"""A shipped layout's name, a mapping file's path, a mapping in place, or a layout compiled before."""


def resolve_layout(value: Layout, folder: Path = Path()) -> dict[str, Any]:
    """Return what a bench file says of a layout compiled to plain values; `folder`: where its paths start.

    ConfigurationError names what cannot be used. What is compiled already stays as it is.
    """
    if isinstance(value, str):
        return layout_to_plain(load_layout(value, folder))
    if "messages" in value:
        return dict(value)
    return layout_to_plain(layout_from_mapping(value, folder, "layout in the bench file"))


def layout_of(settings: Settings) -> CanLayout:
    """Return the layout that a gyro's settings name or hold; ConfigurationError without one."""
    value = settings.get("layout")
    if value is None:
        raise ConfigurationError(
            "a gyro on CAN needs a layout",
            where=str(settings.get("name", "gyro")),
            found="no key layout",
            expected="a shipped layout's name, or the path of a mapping file (see docs/can.md)",
        )
    return layout_from_plain(resolve_layout(value))


def can_kind(layout: Callable[[Settings], CanLayout]) -> GyroKind:
    """Return the kind of gyro whose layout comes from its settings.

    Settings used: `name`, `interface`, `channel`, `bitrate`, `rate_hz`, `axes`, `source_address`.
    """

    def opened(settings: Settings, clock: Clock, tap: Tap) -> CanGyro:
        found = layout(settings)
        bus, link = open_can(
            settings["interface"], settings["channel"], settings["bitrate"], clock, settings["name"], tap=tap
        )
        return CanGyro(
            bus,
            link,
            found,
            rate_hz=settings["rate_hz"],
            axes=settings["axes"],
            source_address=settings.get("source_address"),
        )

    def decoder(settings: Settings) -> CanDecoder:
        return CanDecoder(
            layout(settings), settings["rate_hz"], settings["axes"], settings.get("source_address")
        )

    def rates(
        settings: Settings, columns: Mapping[str, NDArray[Any]], sample_rate_hz: float
    ) -> dict[str, NDArray[Any]]:
        """Return rates as sent, angle increments times the true sample rate."""
        return {
            axis: columns[f"rate_{axis}_dps"]
            if f"rate_{axis}_dps" in columns
            else columns[f"angle_{axis}_deg"] * sample_rate_hz
            for axis in settings["axes"]
        }

    def accelerations(
        settings: Settings, columns: Mapping[str, NDArray[Any]], sample_rate_hz: float
    ) -> dict[str, NDArray[Any]]:
        """Return specific forces as sent."""
        mapped = layout(settings).accelerations()
        return {axis: columns[f"accelerometer_{axis}_mps2"] for axis in mapped}

    return GyroKind(open=opened, decoder=decoder, rates=rates, accelerations=accelerations)


CanDbc = can_kind(layout_of)
"""Further setting: `layout`, see `resolve_layout`."""
