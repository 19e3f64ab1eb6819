"""The ACUTROL3000 as the bench finds it by name."""

from __future__ import annotations

from drivers.acutrol._driver import AcutrolTable
from drivers.acutrol._transcript import decode_transcript
from drivers.clock import Clock
from drivers.instruments import Settings, TableKind
from drivers.link import Link, Tap


def _open(settings: Settings, clock: Clock, tap: Tap) -> AcutrolTable:
    link = Link(settings["port"], clock, name=settings["name"], tap=tap, baudrate=settings["baudrate"])
    return AcutrolTable(link, axis=settings["axis"])


Acutrol3000 = TableKind(open=_open, decode_transcript=decode_transcript)
"""Settings used: `name`, `port`, `baudrate`, `axis`."""
