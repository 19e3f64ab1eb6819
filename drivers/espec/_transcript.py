"""Chamber telemetry of an ESPEC controller rebuilt from the recorded bytes of both directions."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.base.errors import ProtocolError
from drivers.espec.codec import END, decode_temperatures
from drivers.kit.kinds import Exchange, Transcript
from drivers.kit.matching import match_replies, split_line, transcript


def decode_transcript(exchanges: Iterable[Exchange]) -> Transcript:
    """Return one row an answered `TEMP?` (`air_temp_c`, `set_point_c`, degC) and counts; never raises on
    bytes."""
    rows: list[tuple[int, dict[str, float]]] = []
    polls = 0
    for at_ns, request, reply in match_replies(exchanges, split_line, lambda request, buffer: _line(buffer)):
        if not request.endswith(b"TEMP?"):
            continue
        polls += 1
        try:
            found = decode_temperatures((reply or b"").decode("latin-1"))
        except ProtocolError:
            continue
        rows.append((at_ns, {"air_temp_c": found.measured_c, "set_point_c": found.set_point_c}))
    return transcript(rows, ("air_temp_c", "set_point_c"), polls)


def _line(buffer: bytes) -> tuple[bytes, int] | None:
    at = buffer.find(END)
    return None if at < 0 else (buffer[:at].strip(), at + len(END))
