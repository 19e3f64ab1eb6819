"""Any gyro on CAN as the bench finds it by name: `driver = "can_dbc"`, `layout` a mapping file.

It is only listened to, since its CAN output takes no commands.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import ConfigurationError, DeviceSilent, WrongDevice
from drivers.can_dbc._decode import CanDecoder
from drivers.can_dbc._layout import CanLayout, layout_from_plain, layout_to_plain
from drivers.can_dbc._mapping import layout_from_mapping, load_layout
from drivers.can_dbc._signals import MessageLayout
from drivers.kit.config import GyroConfig, Mistake, key
from drivers.kit.conversation import StreamingGyro
from drivers.kit.instruments import Identity
from drivers.kit.kinds import Columns, Connection, GyroKind
from drivers.kit.link import Link
from drivers.kit.slcan_codec import SlcanParser
from drivers.slcan import open_can

if TYPE_CHECKING:
    from drivers.kit.python_can import can

_LISTEN_S = 5.0
"""How long to wait for a first sample; the slowest output of the known units is 1 Hz."""

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


class CanGyro(StreamingGyro):
    """A unit (`drivers.kit.instruments.Gyro`) whose outputs were set before.

    `bus` and `link` are what `drivers.slcan.open_can` returned; the bus is kept because python-can shuts one down
    that nobody holds. `decoder`: one for its stream.
    """

    def __init__(self, bus: can.BusABC, link: Link, decoder: CanDecoder) -> None:
        super().__init__(link)
        self.bus = bus
        self.layout = decoder.layout
        self._source = decoder.source_address
        self._messages = [self.layout.messages[slot.message] for slot in self.layout.sample]

    def identify(self) -> Identity:
        """Listen until every message of a sample has come, at most 5 s.

        Raises WrongDevice naming the identifiers that were seen instead, DeviceSilent when no frame came.
        """
        missing = {message.name: message for message in self._messages}
        parser, seen = SlcanParser(), set[tuple[int, bool]]()
        deadline_s = self.link.clock.now() + _LISTEN_S
        heard = b""
        while missing and self.link.clock.now() < deadline_s:
            data = self.link.read_some(deadline_s - self.link.clock.now())
            heard = (heard + data)[:60]
            frames = parser.feed(data)
            seen |= set(zip(frames["id"].tolist(), frames["extended"].tolist(), strict=True))
            missing = {name: sent for name, sent in missing.items() if not self._among(sent, frames)}
        if not seen:
            raise self._silent(heard)
        if missing:
            raise self._wrong(identifier_names(seen))
        return Identity(self.layout.maker, self.layout.model, details={"identifiers": identifier_names(seen)})

    def close(self) -> None:
        """Close the port, then let go of the bus: python-can complains about one that nobody shut down."""
        self.link.close()
        self.bus.shutdown()

    def _among(self, message: MessageLayout, frames: NDArray[np.void]) -> bool:
        found = message.sent_by(frames["id"], frames["extended"])
        if self._source is not None and message.extended:
            found &= (frames["id"] & np.uint32(0xFF)) == self._source
        return bool(found.any())

    def _unit(self) -> str:
        return f"{self.layout.maker} {self.layout.model}".strip()

    def _silent(self, heard: bytes) -> DeviceSilent:
        return DeviceSilent(
            f"no CAN frame within {_LISTEN_S:g} s",
            where=self.link.where,
            found=repr(heard) if heard else "nothing",
            expected=f"the messages of a unit of kind {self._unit()}",
            remedy="check power, wiring, termination (few units have their own) and the bit rate of the bus",
        )

    def _wrong(self, seen: str) -> WrongDevice:
        names = {(message.identifier, message.extended): message for message in self._messages}
        source = "" if self._source is None else f" from address 0x{self._source:02X}"
        return WrongDevice(
            f"what sends on this bus is not a unit of kind {self._unit()} with its outputs on",
            where=self.link.where,
            found=f"identifiers {seen}",
            expected=f"identifiers {identifier_names(set(names))}{source} "
            f"({', '.join(message.name for message in names.values())})",
            remedy="turn these messages on in the unit's configuration, or correct the bench file",
        )


def identifier_names(identifiers: set[tuple[int, bool]]) -> str:
    """Return (identifier, extended) in words, standard ones first."""
    ordered = sorted(identifiers, key=lambda item: (item[1], item[0]))
    return ", ".join(f"0x{value:08X}" if extended else f"0x{value:03X}" for value, extended in ordered)


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
