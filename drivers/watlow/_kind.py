"""Watlow chambers as the bench finds them by name."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.base.clock import Clock
from drivers.kit.instruments import ChamberKind, Settings
from drivers.kit.link import Link, Tap
from drivers.kit.modbus import Framing, ModbusMaster
from drivers.watlow._controllers import Controller, F4Controller, F4TController
from drivers.watlow._driver import WatlowChamber
from drivers.watlow._registers import F4_WORDS, F4T_WORDS
from drivers.watlow._transcript import decode_f4, decode_f4t


def _open_f4(settings: Settings, clock: Clock, tap: Tap) -> WatlowChamber:
    link, modbus = _line(settings, clock, tap, "rtu", F4_WORDS)
    return _chamber(
        settings, link, modbus, F4Controller(modbus, settings["start_channel"], tuple(settings["auxiliary"]))
    )


def _open_f4t(settings: Settings, clock: Clock, tap: Tap) -> WatlowChamber:
    link, modbus = _line(settings, clock, tap, f4t_framing(settings["port"]), F4T_WORDS)
    return _chamber(settings, link, modbus, F4TController(modbus))


def f4t_framing(port: str) -> Framing:
    """Return how an F4T is spoken to at a port: Modbus TCP over a socket, RTU over a serial line."""
    return "tcp" if port.startswith("socket://") else "rtu"


def _line(
    settings: Settings, clock: Clock, tap: Tap, framing: Framing, words: Mapping[int, str]
) -> tuple[Link, ModbusMaster]:
    link = Link(settings["port"], clock, name=settings["name"], tap=tap, baudrate=settings["baudrate"])
    return link, ModbusMaster(link, framing, settings["address"] or 1, words)


def _chamber(settings: Settings, link: Link, modbus: ModbusMaster, controller: Controller) -> WatlowChamber:
    return WatlowChamber(
        link,
        modbus,
        controller,
        auxiliary=tuple(settings["auxiliary"]),
        safe_set_point_c=settings["safe_set_point_c"],
    )


WatlowF4 = ChamberKind(open=_open_f4, decode_transcript=decode_f4)
"""Settings used: `name`, `port` (RTU, through a device server too), `baudrate`, `address` (Modbus),
`start_channel` (digital output that starts the chamber), `auxiliary` (inputs 2 and 3), `safe_set_point_c`.
"""

WatlowF4T = ChamberKind(open=_open_f4t, decode_transcript=decode_f4t)
"""Settings used: `name`, `port` (Modbus TCP over `socket://`, else RTU), `baudrate`, `address`,
`safe_set_point_c`."""
