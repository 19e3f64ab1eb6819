"""Chamber telemetry rebuilt from the recorded bytes of both directions."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable

from drivers.base.errors import ProtocolError
from drivers.kit.kinds import Exchange, Transcript
from drivers.kit.matching import match_replies, split_line, transcript
from drivers.weiss.ascii2 import decode_values
from drivers.weiss.configuration import Configuration, decode_configuration
from drivers.weiss.simserv import Number, decode_simserv_reply, encode_request

_AIR = encode_request(Number.GET_ACTUAL, 1).strip()
_SET_POINT = encode_request(Number.GET_SET_POINT, 1).strip()
_MEASURED = encode_request(Number.GET_MEASURED, "").strip()


def decode_transcript(exchanges: Iterable[Exchange]) -> Transcript:
    """Return one row a completed state poll, and counts.

    Columns, shape (n,) each: `time_ns` int64 (arrival of the poll's last byte), `air_temp_c`, `set_point_c` and
    `aux_<n>_temp_c` float64, NaN where a poll did not ask for sensor n; the set point is the last one read.
    Counts: `polls` asked, `damaged` of them without good replies. Never raises on bytes.

    With ASCII-2 every `$ddI` is a poll; its sensors are the connected ones of the recorded `$dd?` text.
    """
    reader = _Reader()
    for at_ns, request, reply in match_replies(exchanges, split_line, reader.split_reply):
        reader.take(at_ns, request, reply)
    sensors = {name for _, row in reader.rows for name in row if name.startswith("aux_")}
    ordered = sorted(sensors, key=lambda name: int(name.split("_")[1]))
    return transcript(reader.rows, ["air_temp_c", "set_point_c", *ordered], reader.polls)


class _Reader:
    """Makes rows of requests and replies, one poll at a time."""

    def __init__(self) -> None:
        self.polls = 0
        self.rows: list[tuple[int, dict[str, float]]] = []
        self._sensors: dict[str, float] = {}
        self._unanswered: set[bytes] = set()
        """Questions for sensors of the poll under way whose answer has not come; they may be asked again."""
        self._set_point_c = math.nan
        self._text = b""
        """What has come of the answer to `$dd?`, which has no end of its own."""
        self._configuration: Configuration | None = None

    def split_reply(self, request: bytes, buffer: bytes) -> tuple[bytes, int] | None:
        """Return the first reply in `buffer` and the bytes it takes; none to `$dd?`, whose text is kept."""
        if _is_configuration(request):
            self._text = buffer
            return None
        end = b"\r" if request.startswith(b"$") else b"\r\n"
        reply, ended, _ = buffer.partition(end)
        return (reply, len(reply) + len(end)) if ended else None

    def take(self, at_ns: int, request: bytes, reply: bytes | None) -> None:
        """Take a request with its reply, None if it was void when the next one was sent."""
        if _is_configuration(request):
            with contextlib.suppress(ProtocolError):
                self._configuration = decode_configuration(self._text.decode("latin-1"))
            self._text = b""
            return
        self.polls += request == _AIR or _is_values(request)
        try:
            if reply is None:
                raise ValueError
            self._take(request, reply, at_ns)
        except ValueError:
            if request.startswith(_MEASURED):
                self._unanswered.add(request)

    def _take(self, request: bytes, reply: bytes, at_ns: int) -> None:
        """Take one reply; raises ValueError for a bad one."""
        if _is_values(request):
            self.rows.append((at_ns, _ascii2_row(reply, self._configuration)))
        elif request == _SET_POINT:
            self._set_point_c = _simserv_number(reply)
        elif request == _AIR:
            air = {"air_temp_c": _simserv_number(reply), "set_point_c": self._set_point_c}
            if not self._unanswered:
                self.rows.append((at_ns, air | self._sensors))
            self._sensors, self._unanswered = {}, set()
        elif request.startswith(_MEASURED):
            self._unanswered.discard(request)
            self._sensors[f"aux_{int(request[len(_MEASURED) :])}_temp_c"] = _simserv_number(reply)


def _ascii2_row(reply: bytes, configuration: Configuration | None) -> dict[str, float]:
    try:
        numbers = decode_values(reply).numbers
    except ProtocolError:
        raise ValueError from None
    if configuration is None:
        set_point_c, air_temp_c, *_ = numbers
        return {"air_temp_c": air_temp_c, "set_point_c": set_point_c}
    if len(numbers) != len(configuration.read_fields):
        raise ValueError
    row = {
        "air_temp_c": numbers[configuration.actual_index("CV01")],
        "set_point_c": numbers[configuration.read_fields.index("CV01")],
    }
    for number in configuration.measured_values():
        row[f"aux_{number}_temp_c"] = numbers[configuration.actual_index(f"MV{number:02d}")]
    return row


def _is_values(line: bytes) -> bool:
    return line[:1] == b"$" and line[3:] == b"I"


def _is_configuration(line: bytes) -> bool:
    return line[:1] == b"$" and line[3:] == b"?"


def _simserv_number(reply: bytes) -> float:
    try:
        status, fields = (decoded := decode_simserv_reply(reply)).status, decoded.fields
    except ProtocolError:
        raise ValueError from None
    (value,) = (float(field) for field in fields)
    if status != 1 or not math.isfinite(value):
        raise ValueError
    return value
