"""Chamber telemetry of a CTS rebuilt from the recorded bytes of both directions."""

from __future__ import annotations

import re
from collections.abc import Iterable
from contextlib import suppress

from drivers.base.errors import ProtocolError
from drivers.cts.codec import AIR, COMMAND, ETX, REPLY_BYTES, STX, decode_analog, decode_frame
from drivers.kit.kinds import Exchange, Transcript
from drivers.kit.matching import match_replies, transcript

_ANALOG = re.compile("A[0-6]")


def decode_transcript(exchanges: Iterable[Exchange]) -> Transcript:
    """Return one row an answered `A0` with the channels asked after it, and counts; never raises on bytes."""
    exchanges = list(exchanges)
    first = next((data for _, way, data in exchanges if way == "sent" and data), b"")
    if first[0:1] == bytes([STX]):
        answered = match_replies(exchanges, _framed_request, lambda request, buffer: _framed(buffer))
    else:
        answered = match_replies(exchanges, _bare_request, _bare)
    polls = _Polls()
    for at_ns, request, reply in answered:
        polls.take(at_ns, request.decode("latin-1"), None if reply is None else reply.decode("latin-1"))
    return transcript(polls.rows(), ("air_temp_c", "set_point_c"), polls.count)


class _Polls:
    """Polls in the making: each begins with the air, and ends where the next one begins."""

    def __init__(self) -> None:
        self.count = 0
        self._done: list[tuple[int, dict[str, float]]] = []
        self._at_ns = 0
        self._row: dict[str, float] = {}
        self._missing: set[str] = set()

    def take(self, at_ns: int, request: str, reply: str | None) -> None:
        """Take a question with its answer, None if none came that fits."""
        if not _ANALOG.fullmatch(request):
            return
        if request == AIR:
            self._finish()
            self.count += 1
            self._at_ns = at_ns
        self._missing.add(request)
        with suppress(ProtocolError):
            values = decode_analog(reply or "", int(request[1:]))
            self._missing.discard(request)
            if request == AIR:
                self._row = {"air_temp_c": values.actual, "set_point_c": values.set_point}
            else:
                self._row[f"aux_{request[1:]}_temp_c"] = values.actual

    def rows(self) -> list[tuple[int, dict[str, float]]]:
        """Return the rows, that of the last poll included."""
        self._finish()
        return self._done

    def _finish(self) -> None:
        if "air_temp_c" in self._row and not self._missing:
            self._done.append((self._at_ns, self._row))
        self._row, self._missing = {}, set()


def _framed_request(buffer: bytes) -> tuple[bytes, int] | None:
    try:
        return _framed(buffer)
    except ProtocolError:
        return b"", buffer.find(bytes([ETX])) + 1


def _framed(buffer: bytes) -> tuple[bytes, int] | None:
    at = buffer.find(bytes([ETX]))
    return None if at < 0 else (decode_frame(buffer[: at + 1])[1].encode("ascii"), at + 1)


def _bare_request(buffer: bytes) -> tuple[bytes, int] | None:
    if not buffer:
        return None
    found = COMMAND.match(buffer.decode("latin-1"))
    return (buffer[: found.end()], found.end()) if found else (b"", len(buffer))


def _bare(request: bytes, buffer: bytes) -> tuple[bytes, int] | None:
    letter = request[:1].decode("latin-1")
    length = REPLY_BYTES.get(letter, 1)
    if buffer and buffer[:1] != request[:1]:
        raise ProtocolError("not an answer to the question", found=repr(buffer[:20]), expected=letter)
    return None if len(buffer) < length else (buffer[:length], length)
