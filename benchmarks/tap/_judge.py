"""What the wire says of a trial: when the table was told to stop, when it stood, and what the record lacks.

Nothing of the project is used. An ACUTROL3000 answers with eight bytes, error and length of the text (TM-9374A
3.4.2), here low byte first, then the text; a poll's text is angle and rate.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

from benchmarks.tap._wire import Heard

STOP_TABLE = b":mode:off"
TURN_TABLE = b":mode:rate"
START_CHAMBER = b"14001\xb61\xb61\xb61\r"
STOP_CHAMBER = b"14001\xb61\xb61\xb60\r"
AT_REST_DPS = 0.01
_ALIGNED_BYTES = 64


def told_s(heard: Sequence[Heard], command: bytes, after_s: float) -> float | None:
    """Return when a command first passed after a time, None if it did not."""
    return next(
        (piece.time_s for piece in heard if piece.sent and piece.time_s > after_s and command in piece.data),
        None,
    )


def rates(heard: Sequence[Heard]) -> Iterator[tuple[float, float]]:
    """Yield (time in s, rate in deg/s) of every answer to a poll of the table."""
    buffer = b""
    for piece in heard:
        if piece.sent:
            continue
        buffer += piece.data
        while len(buffer) >= 8:
            _, length = struct.unpack_from("<iI", buffer)
            if length > 4096:
                buffer = buffer[1:]
                continue
            if len(buffer) < 8 + length:
                break
            text, buffer = buffer[8 : 8 + length], buffer[8 + length :]
            fields = text.strip(b"\0\r\n").split(b";")
            if len(fields) in (2, 3):
                try:
                    yield piece.time_s, [float(field) for field in fields][1]
                except ValueError:
                    continue


def moved(table: Sequence[Heard], chamber: Sequence[Heard]) -> bool:
    """Whether the table was ever told to turn, or the chamber to start."""
    told = [piece.data for piece in table if piece.sent]
    started = [piece.data for piece in chamber if piece.sent]
    return any(TURN_TABLE in data for data in told) or any(START_CHAMBER in data for data in started)


def turning(heard: Sequence[Heard]) -> bool:
    """Whether the table turned when it last said so."""
    return any(abs(rate) > AT_REST_DPS for _, rate in list(rates(heard))[-1:])


def rest_s(heard: Sequence[Heard], after_s: float) -> float | None:
    """Return when the table first said after a time that it stands, None if it did not."""
    return next(
        (time_s for time_s, rate in rates(heard) if time_s > after_s and abs(rate) < AT_REST_DPS), None
    )


def missing(folder: Path, port: str, heard: Sequence[Heard], due_s: float, read_s: float) -> list[str]:
    """Return what is wrong with a port's raw files: they lack bytes that passed before `due_s`, or have others.

    `read_s`: until then the runner read; a line may drop what nobody reads later. What came
    before the bench opened the port is not its own: the record begins somewhere in what passed, and where it is
    empty, with the first byte that the bench sent there.
    """
    found = []
    opened_s = min((piece.time_s for piece in heard if piece.sent), default=due_s)
    for sent in (False, True):
        name = f"{port}{'.sent' if sent else ''}.bin"
        passed = [piece for piece in heard if piece.sent is sent]
        wire = b"".join(piece.data for piece in passed)
        due, read = (_bytes_until(passed, time_s) for time_s in (due_s, read_s))
        path = folder / "raw" / name
        record = path.read_bytes() if path.exists() else b""
        start = (
            0 if sent else wire.find(record[:_ALIGNED_BYTES]) if record else _bytes_until(passed, opened_s)
        )
        alike = min(len(record), max(0, read - start))
        if start < 0 or wire[start : start + alike] != record[:alike]:
            found.append(f"{name}: not what passed")
        elif len(record) < due - start:
            found.append(f"{name}: {due - start - len(record)} bytes older than the interval are lost")
    return found


def _bytes_until(passed: Sequence[Heard], time_s: float) -> int:
    return sum(len(piece.data) for piece in passed if piece.time_s <= time_s)
