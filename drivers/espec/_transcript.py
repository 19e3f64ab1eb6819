"""Chamber telemetry of an ESPEC controller rebuilt from the recorded bytes of both directions."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.espec.codec import END, decode_temperatures
from drivers.kit.kinds import Exchange, Transcript
from drivers.kit.matching import match_replies, polled, split_line


def decode_transcript(exchanges: Iterable[Exchange]) -> Transcript:
    """Return one row an answered `TEMP?` (`air_temp_c`, `set_point_c`, degC) and counts; never raises on
    bytes."""
    return polled(
        match_replies(exchanges, split_line, lambda request, buffer: _line(buffer)),
        lambda request: request.endswith(b"TEMP?"),
        _temperatures,
        ("air_temp_c", "set_point_c"),
    )


def _temperatures(reply: bytes) -> dict[str, float]:
    found = decode_temperatures(reply.decode("latin-1"))
    return {"air_temp_c": found.measured_c, "set_point_c": found.set_point_c}


def _line(buffer: bytes) -> tuple[bytes, int] | None:
    at = buffer.find(END)
    return None if at < 0 else (buffer[:at].strip(), at + len(END))
