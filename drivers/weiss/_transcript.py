"""Chamber telemetry rebuilt from the recorded bytes of both directions."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterable
from typing import Any, Literal

from numpy.typing import NDArray

from drivers.base.errors import ProtocolError
from drivers.kit.matching import table
from drivers.weiss.ascii2 import decode_values
from drivers.weiss.configuration import Configuration, decode_configuration
from drivers.weiss.simserv import Number, decode_simserv_reply, encode_request

_AIR = encode_request(Number.GET_ACTUAL, 1).strip()
_SET_POINT = encode_request(Number.GET_SET_POINT, 1).strip()
_MEASURED = encode_request(Number.GET_MEASURED, "").strip()


def decode_transcript(
    exchanges: Iterable[tuple[int, Literal["sent", "received"], bytes]],
) -> tuple[dict[str, NDArray[Any]], dict[str, int]]:
    """Return one row a completed state poll, and counts.

    `exchanges`: (time in ns, direction, bytes) in time order; chunks may split or join messages. Columns, shape
    (n,) each: `time_ns` int64 (arrival of the poll's last byte), `air_temp_c`, `set_point_c` and `aux_<n>_temp_c`
    float64, NaN where a poll did not ask for sensor n; the set point is the last one read. Counts: `polls` asked,
    `damaged` of them without good replies. Never raises on bytes. A new request voids the replies still due, as
    in the driver.

    With ASCII-2 every `$ddI` is a poll; its sensors are the connected ones of the recorded `$dd?` text.
    """
    reader = _Reader()
    for at_ns, direction, data in exchanges:
        if direction == "sent":
            reader.sent(data)
        else:
            reader.received(at_ns, data)
    return reader.table(), {"polls": reader.polls, "damaged": reader.polls - len(reader.rows)}


class _Reader:
    """Pairs requests with replies, one poll at a time."""

    def __init__(self) -> None:
        self.polls = 0
        self.rows: list[tuple[int, dict[str, float]]] = []
        self._line = b""
        self._input = b""
        self._due: list[bytes] = []
        self._sensors: dict[str, float] = {}
        self._unanswered: set[bytes] = set()
        """Questions for sensors of the poll under way whose answer has not come; they may be asked again."""
        self._set_point_c = math.nan
        self._configuration: Configuration | None = None

    def sent(self, data: bytes) -> None:
        *lines, self._line = (self._line + data).replace(b"\n", b"\r").split(b"\r")
        requests = [line for line in lines if line]
        if not requests:
            return
        if self._due:
            self._unanswered |= {request for request in self._due if request.startswith(_MEASURED)}
            if _is_configuration(self._due[0]):
                with contextlib.suppress(ProtocolError):
                    self._configuration = decode_configuration(self._input.decode("latin-1"))
        self._due, self._input = requests, b""
        for line in requests:
            if line == _AIR or _is_values(line):
                self.polls += 1

    def received(self, at_ns: int, data: bytes) -> None:
        self._input += data
        while self._due and not _is_configuration(self._due[0]):
            end = b"\r" if self._due[0].startswith(b"$") else b"\r\n"
            at = self._input.find(end)
            if at < 0:
                return
            reply, self._input = self._input[:at], self._input[at + len(end) :]
            request = self._due.pop(0)
            try:
                self._take(request, reply, at_ns)
            except ValueError:
                if request.startswith(_MEASURED):
                    self._unanswered.add(request)

    def _take(self, request: bytes, reply: bytes, at_ns: int) -> None:
        """Take one reply; raises ValueError for a bad one."""
        if _is_values(request):
            self.rows.append((at_ns, self._ascii2_row(reply)))
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

    def _ascii2_row(self, reply: bytes) -> dict[str, float]:
        try:
            numbers = decode_values(reply).numbers
        except ProtocolError:
            raise ValueError from None
        configuration = self._configuration
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

    def table(self) -> dict[str, NDArray[Any]]:
        """Return the columns."""
        sensors = {name for _, row in self.rows for name in row if name.startswith("aux_")}
        names = ["air_temp_c", "set_point_c", *sorted(sensors, key=lambda name: int(name.split("_")[1]))]
        return table(self.rows, names)


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
