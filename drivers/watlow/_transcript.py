"""Chamber telemetry of a Watlow controller rebuilt from the recorded bytes of both directions."""

from __future__ import annotations

from collections.abc import Iterable

from pymodbus.pdu.register_message import ReadHoldingRegistersRequest, ReadHoldingRegistersResponse

from drivers.base.errors import ProtocolError
from drivers.kit.kinds import Exchange, Transcript
from drivers.kit.matching import match_replies, transcript
from drivers.kit.modbus import Frames, Framing
from drivers.watlow.registers import F4, F4T, F4Readings, F4TReadings, Readings


def decode_f4(exchanges: Iterable[Exchange]) -> Transcript:
    """Return one row a completed state poll (`air_temp_c`, `set_point_c`, `aux_2_temp_c`, ...) and counts."""
    return _decode(list(exchanges), F4Readings(), F4.INPUTS[1])


def decode_f4t(exchanges: Iterable[Exchange]) -> Transcript:
    """Return one row a completed state poll (`air_temp_c`, `set_point_c`) and counts."""
    return _decode(list(exchanges), F4TReadings(), F4T.AIR)


def _decode(exchanges: list[Exchange], readings: Readings, first_register: int) -> Transcript:
    framing = _framing(exchanges)
    asked, answered = Frames(framing, server=True), Frames(framing, server=False)

    def split_request(buffer: bytes) -> tuple[bytes, int] | None:
        try:
            found = asked.split(buffer)
        except ProtocolError:
            return (b"", len(buffer))
        return None if found is None else (buffer[: found[1]], found[1])

    def split_reply(request: bytes, buffer: bytes) -> tuple[bytes, int] | None:
        found = answered.split(buffer)
        return None if found is None else (buffer[: found[1]], found[1])

    rows: list[tuple[int, dict[str, float]]] = []
    polls = 0
    for at_ns, request, reply in match_replies(exchanges, split_request, split_reply):
        question = asked.split(request) if request else None
        if question is None or not isinstance(question[0], ReadHoldingRegistersRequest):
            continue
        start = question[0].address
        polls += start == first_register
        answer = answered.split(reply) if reply else None
        if answer is not None and isinstance(answer[0], ReadHoldingRegistersResponse):
            row = readings.take(start, answer[0].registers)
            if row is not None:
                rows.append((at_ns, row))
    return transcript(rows, ("air_temp_c", "set_point_c"), polls)


def _framing(exchanges: list[Exchange]) -> Framing:
    """Tell RTU from TCP by what was sent first: an MBAP header has two zero bytes where RTU has a register."""
    sent = b"".join(data for _, direction, data in exchanges[:8] if direction == "sent")
    return "tcp" if sent[2:5] == b"\0\0\0" else "rtu"
