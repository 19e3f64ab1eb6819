"""The ATL table as the bench finds it by name, and its telemetry rebuilt from a record."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from numpy.typing import NDArray

from drivers.base.clock import Clock
from drivers.base.errors import ConfigurationError, ProtocolError
from drivers.ideal_atl._codec import POSITION, RATE, decode_number, split_reply
from drivers.ideal_atl._driver import AtlTable
from drivers.kit.instruments import Exchange, Settings, TableKind
from drivers.kit.link import Link, Tap
from drivers.kit.pairing import pairs, table


def _open(settings: Settings, clock: Clock, tap: Tap) -> AtlTable:
    axes = [axis["name"] for axis in settings["axes"]]
    if len(axes) > 1:
        raise ConfigurationError(
            "the ATL driver turns one axis",
            where="table",
            found=", ".join(axes),
            expected="one of [[table.axes]], or none",
        )
    link = Link(settings["port"], clock, name=settings["name"], tap=tap, baudrate=settings["baudrate"])
    return AtlTable(link, axis=axes[0])


def decode_transcript(
    exchanges: Iterable[Exchange], settings: Settings
) -> tuple[dict[str, NDArray[Any]], dict[str, int]]:
    """Return one row a completed state poll, `angle_deg` and `rate_dps`, and counts.

    A poll is a PVE whose answer is followed by a PPO's. Never raises on bytes.
    """
    rows: list[tuple[int, dict[str, float]]] = []
    polls, rate_dps = 0, None
    for at_ns, request, reply in pairs(exchanges, _request, lambda request, buffer: split_reply(buffer)):
        value = _number(reply)
        if request == RATE:
            polls += 1
            rate_dps = value
        elif request == POSITION and rate_dps is not None and value is not None:
            rows.append((at_ns, {"angle_deg": value % 360.0, "rate_dps": rate_dps}))
            rate_dps = None
    return table(rows, ("angle_deg", "rate_dps")), {"polls": polls, "damaged": polls - len(rows)}


def _number(reply: bytes | None) -> float | None:
    try:
        return None if reply is None else decode_number(reply)
    except ProtocolError:
        return None


def _request(buffer: bytes) -> tuple[bytes, int] | None:
    at = buffer.find(b"\n")
    return None if at < 0 else (buffer[:at].strip(), at + 1)


IdealAtl = TableKind(open=_open, decode_transcript=decode_transcript)
"""Settings used: `name`, `port`, `baudrate`, the one of `axes`."""
