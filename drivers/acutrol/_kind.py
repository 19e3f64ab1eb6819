"""The ACUTROL3000 as the bench finds it by name."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from numpy.typing import NDArray

from drivers.acutrol._driver import AcutrolTable
from drivers.acutrol._transcript import decode_transcript
from drivers.base.clock import Clock
from drivers.kit.instruments import Exchange, Settings, TableKind
from drivers.kit.link import Link, Tap


def _open(settings: Settings, clock: Clock, tap: Tap) -> AcutrolTable:
    link = Link(settings["port"], clock, name=settings["name"], tap=tap, baudrate=settings["baudrate"])
    return AcutrolTable(link, axes=_axes(settings))


def _decode(
    exchanges: Iterable[Exchange], settings: Settings
) -> tuple[dict[str, NDArray[Any]], dict[str, int]]:
    return decode_transcript(exchanges, _axes(settings))


def _axes(settings: Settings) -> dict[str, int]:
    return {axis["name"]: axis["number"] for axis in settings["axes"]}


Acutrol3000 = TableKind(open=_open, decode_transcript=_decode)
"""Settings used: `name`, `port`, `baudrate`, `axes` (of each `name` and `number`)."""
