"""The Weiss chamber as the bench finds it by name."""

from __future__ import annotations

from drivers.kit.config import ChamberConfig, key
from drivers.kit.kinds import ChamberKind, Connection, Probe
from drivers.weiss._driver import WeissChamber
from drivers.weiss._transcript import decode_transcript


class WeissConfig(ChamberConfig):
    """`[chamber]` of a Weiss or Vötsch chamber."""

    address: int | None = key(
        default=None, ge=0, le=31, description="the address of a Weiss chamber, 0 to 31; left out: 1"
    )
    simserv: bool = key(default=True, description="true if the chamber's port also answers SimServ")
    start_channel: int = key(
        default=1, ge=1, le=32, description="the number of the digital output that starts the chamber"
    )

    @property
    def bus_address(self) -> int:
        """The address in every message."""
        return 1 if self.address is None else self.address


def _open(config: WeissConfig, connection: Connection) -> WeissChamber:
    return WeissChamber(
        connection.link(config.port, config.baudrate),
        address=config.bus_address,
        auxiliary=tuple(config.auxiliary),
        simserv=config.simserv,
        start_channel=config.start_channel,
        safe_set_point_c=connection.safe_set_point_c,
    )


Weiss = ChamberKind(
    _open, decode_transcript, WeissConfig, probes=lambda: [Probe(20), Probe(21, keys={"simserv": False})]
)
