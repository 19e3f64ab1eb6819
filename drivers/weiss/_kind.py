"""The Weiss chamber as the bench finds it by name."""

from __future__ import annotations

from drivers.base.clock import Clock
from drivers.kit.instruments import ChamberKind, Settings
from drivers.kit.link import Link, Tap
from drivers.weiss._driver import WeissChamber
from drivers.weiss._transcript import decode_transcript


def _open(settings: Settings, clock: Clock, tap: Tap) -> WeissChamber:
    link = Link(settings["port"], clock, name=settings["name"], tap=tap, baudrate=settings["baudrate"])
    return WeissChamber(
        link,
        address=1 if settings["address"] is None else settings["address"],
        auxiliary=tuple(settings["auxiliary"]),
        simserv=settings["simserv"],
        start_channel=settings["start_channel"],
        safe_set_point_c=settings["safe_set_point_c"],
    )


Weiss = ChamberKind(open=_open, decode_transcript=decode_transcript)
"""Settings used: `name`, `port`, `baudrate`, `address`, `auxiliary`, `simserv`, `start_channel`,
`safe_set_point_c`.
"""
