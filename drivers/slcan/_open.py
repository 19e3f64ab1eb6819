"""Opening a CAN bus by the names of a bench file."""

from __future__ import annotations

from typing import Any

from drivers.base.clock import Clock
from drivers.base.errors import ConfigurationError
from drivers.kit.link import Link, Tap
from drivers.kit.python_can import can
from drivers.slcan._bus import INTERFACE, BufferedSlcanBus
from drivers.slcan._messages import BUS_ERRORS, MessageLink


def open_can(
    interface: str,
    channel: str,
    bitrate: int,
    clock: Clock,
    name: str,
    *,
    tap: Tap | None = None,
    **options: Any,
) -> tuple[can.BusABC, Link]:
    """Return an open bus and the link that its messages can be recorded from.

    `interface` and `channel` are python-can's (`gyrobench_slcan`: an slcan adapter on a serial port or URL);
    `bitrate` in bit/s; `name` names the port, `tap` gets its bytes; `options` go to the interface. Closing the
    link closes the bus.
    Raises ConfigurationError when the interface is unknown or the bus cannot be opened.
    """

    def opened() -> can.BusABC:
        return can.Bus(interface=interface, channel=channel, bitrate=bitrate, ignore_config=True, **options)

    try:
        if interface == INTERFACE:
            adapter = BufferedSlcanBus(channel, bitrate, clock, name, tap=tap, **options)
            return adapter, adapter.link
        bus = opened()
    except BUS_ERRORS as error:
        raise ConfigurationError(
            "the CAN bus cannot be opened",
            where=f"{name} ({interface}, {channel})",
            found=str(error),
            expected=f"{INTERFACE}, or another interface that python-can knows, and its channel",
            remedy="check interface, channel and options in the bench file, and that the adapter is plugged in",
        ) from error
    return bus, MessageLink(bus, clock, name=name, tap=tap, opener=opened)
