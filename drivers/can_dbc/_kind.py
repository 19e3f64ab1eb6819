"""Any gyro on CAN as the bench finds it by name: `driver = "can_dbc"`, `layout` a mapping file."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Literal, TypeVar

from numpy.typing import NDArray

from drivers.base.errors import ConfigurationError
from drivers.can_dbc._decode import CanDecoder
from drivers.can_dbc._driver import CanGyro
from drivers.can_dbc._layout import CanLayout, layout_from_plain, layout_to_plain
from drivers.can_dbc._mapping import layout_from_mapping, load_layout
from drivers.kit.config import GyroConfig, Mistake, key
from drivers.kit.kinds import Columns, Connection, GyroKind
from drivers.slcan import open_can

Layout = str | Mapping[str, Any]
"""A shipped layout's name, a mapping file's path, a mapping in place, or a layout compiled before."""
Config = TypeVar("Config", bound="CanConfig")


def resolve_layout(value: Layout, folder: Path = Path()) -> dict[str, Any]:
    """Return what a bench file says of a layout compiled to plain values; `folder`: where its paths start.

    ConfigurationError names what cannot be used. What is compiled already stays as it is.
    """
    if isinstance(value, str):
        return layout_to_plain(load_layout(value, folder))
    if "messages" in value:
        return dict(value)
    return layout_to_plain(layout_from_mapping(value, folder, "layout in the bench file"))


class CanConfig(GyroConfig):
    """`[[gyro]]` of a unit that is on CAN only."""

    only_on_can: ClassVar[bool] = True

    @property
    def technology(self) -> Literal["fog", "rlg", "mems"]:
        """Units on CAN are MEMS units, as far as we have met them."""
        return "mems"


class CanDbcConfig(CanConfig):
    """`[[gyro]]` of a unit on CAN whose messages a layout describes."""

    layout: str | dict[str, Any] = key(
        description="a shipped CAN layout's name, or a mapping file's path from the bench file's folder",
    )
    reads: ClassVar[frozenset[str]] = frozenset({"layout"})

    @classmethod
    def with_files(cls, given: Mapping[str, Any], folder: Path) -> tuple[dict[str, Any], list[Mistake]]:
        """Compile the layout; one that cannot be used is left as it is."""
        layout = given.get("layout")
        if not isinstance(layout, (str, dict)):
            return dict(given), []
        try:
            return {**given, "layout": _compiled(layout, given.get("axes"), folder)}, []
        except ConfigurationError as error:
            found = ": ".join(part for part in (error.where, error.what, error.found) if part)
            return dict(given), [Mistake("layout", found, error.expected)]


def _compiled(layout: Layout, axes: object, folder: Path) -> dict[str, Any]:
    plain = resolve_layout(layout, folder)
    have = "".join(layout_from_plain(plain).rates())
    if isinstance(axes, str) and not set(axes) <= set(have):
        raise ConfigurationError(
            "the layout lacks an axis that the gyro is said to have",
            found=f"axes {have!r}",
            expected=repr(axes),
        )
    return plain


def layout_of(config: CanDbcConfig) -> CanLayout:
    """Return the layout that a gyro's section names or holds."""
    return layout_from_plain(resolve_layout(config.layout))


def can_kind(config_class: type[Config], layout: Callable[[Config], CanLayout]) -> GyroKind[Config]:
    """Return the kind of gyro on CAN whose layout comes from its configuration."""

    def opened(config: Config, connection: Connection) -> CanGyro:
        listener = decoder(config)  # refuses settings that cannot be before the bus is opened
        interface, channel = config.interface, config.channel
        assert interface is not None and channel is not None, "as the bench file's checks have it"
        clock, name = connection.clock, connection.name
        bus, link = open_can(interface, channel, config.bitrate, clock, name, tap=connection.tap)
        return CanGyro(bus, link, listener)

    def decoder(config: Config) -> CanDecoder:
        return CanDecoder(layout(config), config.rate_hz, config.axes, config.source_address)

    def rates(config: Config, columns: Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
        """Return rates as sent, angle increments times the true sample rate."""
        return {
            axis: columns[f"rate_{axis}_dps"]
            if f"rate_{axis}_dps" in columns
            else columns[f"angle_{axis}_deg"] * sample_rate_hz
            for axis in config.axes
        }

    def accelerations(config: Config, columns: Columns, sample_rate_hz: float) -> dict[str, NDArray[Any]]:
        """Return specific forces as sent."""
        return {axis: columns[f"accelerometer_{axis}_mps2"] for axis in layout(config).accelerations()}

    return GyroKind(opened, decoder, rates, config_class, accelerations=accelerations)


CanDbc = can_kind(CanDbcConfig, layout_of)
