"""Table telemetry rebuilt from the recorded bytes of both directions."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.acutrol.codec import decode_numbers, encode_state_query, split_reply
from drivers.base.errors import ProtocolError
from drivers.kit.config import TableConfig
from drivers.kit.kinds import Exchange, Transcript
from drivers.kit.matching import match_replies, polled, split_line


def decode_transcript(exchanges: Iterable[Exchange], config: TableConfig) -> Transcript:
    """Return one row a completed state poll, and counts; never raises on bytes.

    Columns, shape (n,) each: `time_ns` int64 (arrival of the reply's last byte), `angle_deg` and `rate_dps`
    float64 of the last axis, `<name>_angle_deg` and `<name>_rate_dps` of the others.
    Counts: `polls` asked, `damaged` of them without a good reply.
    """
    query = encode_state_query(*(axis.number for axis in config.all_axes)).strip()
    outer = [f"{axis.name}_{what}" for axis in config.all_axes[:-1] for what in ("angle_deg", "rate_dps")]
    names = [*outer, "angle_deg", "rate_dps"]
    return polled(
        match_replies(exchanges, split_line, _split),
        lambda request: request == query,
        lambda reply: _state(reply, names),
        ("angle_deg", "rate_dps", *outer),
    )


def _state(reply: bytes, names: list[str]) -> dict[str, float]:
    answer = split_reply(reply)
    if answer is None or answer[0].error:
        raise ProtocolError(
            "no state", found=repr(reply[:80]), expected=f"{len(names)} numbers without error"
        )
    return dict(zip(names, decode_numbers(answer[0].text, len(names)), strict=True))


def _split(request: bytes, buffer: bytes) -> tuple[bytes, int] | None:
    found = split_reply(buffer)
    return None if found is None else (buffer[: found[1]], found[1])
