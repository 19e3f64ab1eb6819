"""Watlow chambers as the bench finds them by name."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal

from drivers.kit.config import ChamberConfig, key
from drivers.kit.kinds import ChamberKind, Connection, Probe
from drivers.kit.link import Link
from drivers.kit.modbus import Framing, ModbusMaster
from drivers.watlow._driver import F4Chamber, F4TChamber
from drivers.watlow._transcript import decode_f4, decode_f4t
from drivers.watlow.registers import F4_WORDS, F4T_WORDS


class _WatlowConfig(ChamberConfig):
    simserv: Literal[True] = key(default=True, exclude=True, description="none: a Watlow has no SimServ")

    @property
    def device(self) -> int:
        """The controller's Modbus address."""
        return self.address or 1


class F4Config(_WatlowConfig):
    """`[chamber]` of an F4: Modbus RTU, through a device server too; `auxiliary` are inputs 2 and 3."""

    start_channel: int = key(
        default=1, ge=1, le=8, description="the digital output of the F4 that starts the chamber, 1 to 8"
    )


class F4TConfig(_WatlowConfig):
    """`[chamber]` of an F4T."""

    start_channel: Literal[1] = key(
        default=1, exclude=True, description="none: an F4T is started by its mode"
    )

    @property
    def framing(self) -> Framing:
        """How it is spoken to: Modbus TCP over a socket, RTU over a serial line."""
        return "tcp" if self.port.startswith("socket://") else "rtu"


def _open_f4(config: F4Config, connection: Connection) -> F4Chamber:
    link, modbus = _line(config, connection, "rtu", F4_WORDS)
    return F4Chamber(
        link,
        modbus,
        start_output=config.start_channel,
        auxiliary=tuple(config.auxiliary),
        safe_set_point_c=connection.safe_set_point_c,
    )


def _open_f4t(config: F4TConfig, connection: Connection) -> F4TChamber:
    link, modbus = _line(config, connection, config.framing, F4T_WORDS)
    return F4TChamber(
        link, modbus, auxiliary=tuple(config.auxiliary), safe_set_point_c=connection.safe_set_point_c
    )


def _line(
    config: _WatlowConfig, connection: Connection, framing: Framing, words: Mapping[int, str]
) -> tuple[Link, ModbusMaster]:
    link = connection.link(config.port, config.baudrate)
    return link, ModbusMaster(link, framing, config.device, words)


def _f4_probes() -> list[Probe]:
    return [Probe(50, baudrate=baud, ends_line=False) for baud in (19_200, 9600)]


WatlowF4 = ChamberKind(_open_f4, decode_f4, F4Config, probes=_f4_probes)
WatlowF4T = ChamberKind(
    _open_f4t, decode_f4t, F4TConfig, probes=lambda: [Probe(51, baudrate=9600, ends_line=False)]
)
