"""Driver of an SBG Ellipse: it can only be listened to, since its CAN output takes no commands."""

from __future__ import annotations

from pathlib import Path

import can

from drivers.errors import DeviceSilent, WrongDevice
from drivers.instruments import Identity
from drivers.link import Link
from drivers.sbg._decode import SbgDecoder
from drivers.sbg._messages import AXES, ELLIPSE_DBC, load_ellipse
from drivers.slcan import SlcanParser

_LISTEN_S = 5.0
"""How long to wait for a first cycle of messages; the slowest output is 1 Hz."""


class SbgGyro:
    """An Ellipse (`drivers.instruments.Gyro`) whose IMU_INFO and IMU_GYRO outputs were set to `rate_hz` before.

    `bus` and `link` are what `drivers.slcan.open_can` returned; the bus is kept because python-can shuts one down
    that nobody holds.
    """

    def __init__(
        self, bus: can.BusABC, link: Link, *, rate_hz: float, axes: str = AXES, dbc: Path = ELLIPSE_DBC
    ) -> None:
        self.bus = bus
        self.link = link
        self._rate_hz = rate_hz
        self._axes = axes
        self._dbc = dbc
        self.decoder()  # refuses settings that cannot be before the first byte

    def identify(self) -> Identity:
        """Listen until IMU_INFO and IMU_GYRO have come, at most 5 s.

        Raises WrongDevice naming the identifiers that were seen instead, DeviceSilent when no frame came.
        """
        messages = load_ellipse(self._dbc)
        wanted = {(messages.info.identifier, messages.info.extended)}
        wanted |= {(messages.gyro.identifier, messages.gyro.extended)}
        parser, seen = SlcanParser(), set[tuple[int, bool]]()
        deadline_s = self.link.clock.now() + _LISTEN_S
        heard = b""
        while not wanted <= seen and self.link.clock.now() < deadline_s:
            data = self.link.read_some(deadline_s - self.link.clock.now())
            heard = (heard + data)[:60]
            frames = parser.feed(data)
            seen |= set(zip(frames["id"].tolist(), frames["extended"].tolist(), strict=True))
        if not seen:
            raise self._silent(heard)
        if not wanted <= seen:
            raise self._wrong(_names(seen), _names(wanted))
        return Identity("SBG Systems", "Ellipse", details={"identifiers": _names(seen)})

    def start(self) -> None:
        """Take everything on the bus for the stream; the unit streams by itself."""
        self.link.streaming = True
        self.link.discard()

    def stop(self) -> None:
        """Nothing: the unit cannot be told to be quiet, and what it sends goes on to the link's tap."""

    def close(self) -> None:
        """Close the port, then let go of the bus: python-can complains about one that nobody shut down."""
        self.link.close()
        self.bus.shutdown()

    def decoder(self) -> SbgDecoder:
        """Return a fresh decoder of the unit's stream."""
        return SbgDecoder(self._rate_hz, self._axes, self._dbc)

    def _silent(self, heard: bytes) -> DeviceSilent:
        return DeviceSilent(
            f"no CAN frame within {_LISTEN_S:g} s",
            where=f"{self.link.name} ({self.link.url})",
            found=repr(heard) if heard else "nothing",
            expected="the messages of an SBG Ellipse",
            remedy="check power, wiring, termination (the unit has none) and the bit rate of the bus",
        )

    def _wrong(self, seen: str, wanted: str) -> WrongDevice:
        return WrongDevice(
            "what sends on this bus is not an SBG Ellipse with its IMU messages on",
            where=f"{self.link.name} ({self.link.url})",
            found=f"identifiers {seen}",
            expected=f"identifiers {wanted}",
            remedy="turn IMU_INFO and IMU_GYRO on in the unit's configuration, or correct the bench file",
        )


def _names(identifiers: set[tuple[int, bool]]) -> str:
    ordered = sorted(identifiers, key=lambda item: (item[1], item[0]))
    return ", ".join(f"0x{value:08X}" if extended else f"0x{value:03X}" for value, extended in ordered)
