"""Table telemetry rebuilt from the recorded bytes of both directions."""

from __future__ import annotations

from collections.abc import Iterable
from functools import partial

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
    numbers = [axis.number for axis in config.all_axes]
    queries = [encode_state_query(*numbers, marked=marked).strip() for marked in (False, True)]
    outer = [f"{axis.name}_{what}" for axis in config.all_axes[:-1] for what in ("angle_deg", "rate_dps")]
    names = [*outer, "angle_deg", "rate_dps"]
    return polled(
        match_replies(exchanges, split_line, partial(_split, queries)),
        lambda request: request in queries,
        lambda reply: _state(reply, names),
        ("angle_deg", "rate_dps", *outer),
    )


def _state(reply: bytes, names: list[str]) -> dict[str, float]:
    answer = split_reply(reply)
    if answer is None or answer[0].error:
        raise ProtocolError(
            "no state", found=repr(reply[:80]), expected=f"{len(names)} numbers without error"
        )
    marked = answer[0].text.count(";") == len(names)
    return dict(zip(names, decode_numbers(answer[0].text, len(names) + marked), strict=False))


def _split(queries: list[bytes], request: bytes, buffer: bytes) -> tuple[bytes, int] | None:
    """A poll's answer has as many numbers as were asked for: one more in every other poll."""
    found = split_reply(buffer)
    if found is None:
        return None
    if request in queries and not found[0].error and found[0].text.count(";") != request.count(b";"):
        raise ProtocolError("the answer to another poll", found=found[0].text[:80])
    return buffer[: found[1]], found[1]
