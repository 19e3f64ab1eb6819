"""Chamber telemetry of a Thermotron controller rebuilt from the recorded bytes of both directions."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

from drivers.base.errors import ProtocolError
from drivers.kit.kinds import Exchange, Transcript
from drivers.kit.matching import match_replies, split_line, transcript
from drivers.thermotron.codec import AIR, CR, Readings, decode_line, decode_number

_ADDRESSED = b"\xff#"


def decode_transcript(exchanges: Iterable[Exchange]) -> Transcript:
    """Return one row a completed poll (`air_temp_c`, `set_point_c`, `aux_<n>_temp_c`) and counts."""
    readings = Readings()
    rows: list[tuple[int, dict[str, float]]] = []
    polls = 0
    for at_ns, request, reply in match_replies(exchanges, split_line, lambda request, buffer: _line(buffer)):
        address = request[2] if request.startswith(_ADDRESSED) and len(request) > 2 else None
        asked = request[0 if address is None else 3 :].decode("latin-1")
        polls += asked == AIR
        with suppress(ProtocolError):
            if reply is None:
                continue
            row = readings.take(asked, decode_number(decode_line(reply, address)))
            if row is not None:
                rows.append((at_ns, row))
    return transcript(rows, ("air_temp_c", "set_point_c"), polls)


def _line(buffer: bytes) -> tuple[bytes, int] | None:
    at = buffer.find(CR)
    return None if at < 0 else (buffer[:at], at + 1)
