"""ESPEC chambers as the bench finds them by name."""

from __future__ import annotations

from collections.abc import Callable

from drivers.base.clock import Clock
from drivers.espec._driver import EspecChamber
from drivers.espec._transcript import decode_transcript
from drivers.kit.instruments import ChamberKind, Settings
from drivers.kit.link import Link, Tap


def _opener(model: str, rom: str) -> Callable[[Settings, Clock, Tap], EspecChamber]:
    def open_chamber(settings: Settings, clock: Clock, tap: Tap) -> EspecChamber:
        link = Link(settings["port"], clock, name=settings["name"], tap=tap, baudrate=settings["baudrate"])
        return EspecChamber(
            link,
            model=model,
            rom=rom,
            address=settings["address"],
            safe_set_point_c=settings["safe_set_point_c"],
        )

    return open_chamber


EspecP300 = ChamberKind(open=_opener("P-300", "P3"), decode_transcript=decode_transcript)
"""Settings used: `name`, `port`, `baudrate`, `address` (RS-485 only), `safe_set_point_c`."""

EspecScp220 = ChamberKind(open=_opener("SCP-220", ""), decode_transcript=decode_transcript)
"""As `EspecP300`."""
