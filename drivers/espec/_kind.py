"""ESPEC chambers as the bench finds them by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

from drivers.espec._driver import EspecChamber
from drivers.espec._transcript import decode_transcript
from drivers.kit.config import ChamberConfig, key
from drivers.kit.kinds import ChamberKind, Connection, Probe


class EspecConfig(ChamberConfig):
    """`[chamber]` of an ESPEC; without `address` it is on RS-232 or TCP."""

    simserv: Literal[True] = key(default=True, exclude=True, description="none: an ESPEC has no SimServ")
    start_channel: Literal[1] = key(
        default=1, exclude=True, description="none: an ESPEC is started by its mode"
    )


def _opener(model: str, rom: str) -> Callable[[EspecConfig, Connection], EspecChamber]:
    def open_chamber(config: EspecConfig, connection: Connection) -> EspecChamber:
        return EspecChamber(
            connection.link(config.port, config.baudrate),
            model=model,
            rom=rom,
            address=config.address,
            safe_set_point_c=connection.safe_set_point_c,
        )

    return open_chamber


EspecP300 = ChamberKind(_opener("P-300", "P3"), decode_transcript, EspecConfig, probes=lambda: [Probe(30)])
EspecScp220 = ChamberKind(_opener("SCP-220", ""), decode_transcript, EspecConfig, probes=lambda: [Probe(31)])
