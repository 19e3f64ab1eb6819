"""Table telemetry rebuilt from the recorded bytes of both directions."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.base.errors import ProtocolError
from drivers.ideal_atl._codec import POSITION, RATE, decode_number, split_reply
from drivers.ideal_atl._driver import AtlConfig
from drivers.kit.kinds import Exchange, Transcript
from drivers.kit.matching import match_replies, transcript


def decode_transcript(exchanges: Iterable[Exchange], config: AtlConfig) -> Transcript:
    """Return one row a completed state poll, `angle_deg` and `rate_dps`, and counts.

    A poll is a PVE whose answer is followed by a PPO's. Never raises on bytes.
    """
    rows: list[tuple[int, dict[str, float]]] = []
    polls, rate_dps = 0, None
    for at_ns, request, reply in match_replies(
        exchanges, _request, lambda request, buffer: split_reply(buffer)
    ):
        value = _number(reply)
        if request == RATE:
            polls += 1
            rate_dps = value
        elif request == POSITION and rate_dps is not None and value is not None:
            rows.append((at_ns, {"angle_deg": value % 360.0, "rate_dps": rate_dps}))
            rate_dps = None
    return transcript(rows, ("angle_deg", "rate_dps"), polls)


def _number(reply: bytes | None) -> float | None:
    try:
        return None if reply is None else decode_number(reply)
    except ProtocolError:
        return None


def _request(buffer: bytes) -> tuple[bytes, int] | None:
    at = buffer.find(b"\n")
    return None if at < 0 else (buffer[:at].strip(), at + 1)
