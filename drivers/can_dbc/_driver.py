"""Driver of a gyro that streams on CAN: it is only listened to, since its CAN output takes no commands."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from drivers.base.errors import DeviceSilent, WrongDevice
from drivers.can_dbc._decode import CanDecoder
from drivers.can_dbc._signals import MessageLayout
from drivers.kit.conversation import StreamingGyro
from drivers.kit.instruments import Identity
from drivers.kit.link import Link
from drivers.kit.slcan_codec import SlcanParser

if TYPE_CHECKING:  # whoever has the bus has python-can; a lab that emulates one does without
    from drivers.kit.python_can import can

_LISTEN_S = 5.0
"""How long to wait for a first sample; the slowest output of the known units is 1 Hz."""


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
