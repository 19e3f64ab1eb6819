"""The serial line of a platform INS, our own definition: no maker publishes one.

Sentences as in NMEA 0183: `$`, ASCII without `$ * CR LF`, `*`, two upper-case hexadecimal digits of the XOR
of everything between `$` and `*`, CR LF; 38400 8N1 unless told otherwise; 1/60 to 1 sentence a second.

    $PINS,<counter>,<latitude>,<longitude>,<platform temperature>,<cabinet temperature>,<status>[,<x>,<y>,<z>]*hh

counter      decimal 0 .. 65535, one more each sentence, then 0 again
latitude     geodetic, deg, sign, 8 decimals (0.036 mas); longitude likewise, -180 <= longitude < 180
temperature  degC, 4 decimals; empty while the sensor is dead
status       two hexadecimal digits: bit 0 position valid, bit 1 navigating (0: aligning), bit 2 heater
regulated
x, y, z      specific force in the platform's axes, m/s2, sign, 7 decimals (0.01 ug), only when asked for;
empty while the accelerometer is dead

The bench asks with $PINSQ and gets $PINSA (done) or $PINSE,<reason> (refused):

    $PINSQ,ID*hh            -> $PINSA,ID,<maker>,<model>,<serial number>,<firmware>*hh
    $PINSQ,PERIOD,<s>*hh    -> $PINSA,PERIOD,<s>*hh      whole seconds, 1 .. 60
    $PINSQ,START*hh         -> $PINSA,START*hh           sentences from the next whole period on
    $PINSQ,FORCE,<0 or 1>*hh -> $PINSA,FORCE,<0 or 1>*hh  1: with accelerometers from the next sentence on
    $PINSQ,STOP*hh          -> $PINSA,STOP*hh
    $PINSQ,NAVIGATE*hh      -> $PINSA,NAVIGATE*hh        ends the alignment
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from drivers.kit.instruments import FrameBatch, StreamCounts

COUNTER_MODULO = 65536
POSITION_VALID, NAVIGATING, REGULATED = 1, 2, 4
FORCE = ("accelerometer_x_mps2", "accelerometer_y_mps2", "accelerometer_z_mps2")
LONGEST = 128
"""Bytes of the longest sentence; what is longer without an end is noise."""


def checksum(body: bytes) -> int:
    """Return the XOR of `body`, what stands between `$` and `*` (NMEA 0183)."""
    value = 0
    for byte in body:
        value ^= byte
    return value


def sentence(*fields: str) -> bytes:
    """Return a sentence of these fields, the first the address without `$`."""
    body = ",".join(fields).encode("ascii")
    return b"$%s*%02X\r\n" % (body, checksum(body))


def parse(line: bytes) -> list[str] | None:
    """Return the fields of a sentence without its CR LF; None if it is not whole."""
    if len(line) < 4 or line[:1] != b"$" or line[-3:-2] != b"*":
        return None
    body, given = line[1:-3], line[-2:]
    if b"%02X" % checksum(body) != given:
        return None
    try:
        return body.decode("ascii").split(",")
    except UnicodeDecodeError:
        return None


def encode_position(
    counter: int,
    latitude_deg: float,
    longitude_deg: float,
    temp_c: float,
    cabinet_temp_c: float,
    status: int,
    force_mps2: Sequence[float] = (),
) -> bytes:
    """Return a $PINS sentence, `force_mps2` (3,) or nothing at its end; NaN values are sent empty."""
    around = (longitude_deg + 180.0) % 360.0 - 180.0
    return sentence(
        "PINS",
        str(counter % COUNTER_MODULO),
        f"{latitude_deg:+.8f}",
        f"{around:+.8f}",
        _number(temp_c, ".4f"),
        _number(cabinet_temp_c, ".4f"),
        f"{status:02X}",
        *(_number(value, "+.7f") for value in force_mps2),
    )


class PlatformDecoder:
    """Bytes to rows, incrementally (`drivers.kit.instruments.StreamDecoder`).

    Columns, shape (n,): `counter` int64, `status` uint8, `valid` bool (position valid and navigating),
    `latitude_deg`, `longitude_deg`, `temp_c`, `cabinet_temp_c` float64, NaN where missing; with `accelerometers`
    also those of `FORCE`, NaN in a sentence that has none. Rejected: `checksum`, `fields` (a sound $PINS sentence
    that cannot be read), `length` (no end in 128 bytes); answers are passed over.
    """

    counter_modulo = COUNTER_MODULO
    counter_step = 1.0

    def __init__(self, period_s: float, *, accelerometers: bool = False) -> None:
        self.counts = StreamCounts()
        self._accelerometers = accelerometers
        self.nominal_rate_hz = 1.0 / period_s
        self._pending = b""
        self._offset = 0

    def feed(self, data: bytes) -> FrameBatch:
        """Decode the next bytes; an incomplete sentence is kept for the next call."""
        stream = self._pending + data
        rows: list[tuple[float, ...]] = []
        ends: list[int] = []
        at = 0
        while (end := stream.find(b"\n", at)) >= 0:
            row = self._line(stream[at : end + 1])
            if row is not None:
                rows.append(row)
                ends.append(self._offset + end + 1)
            at = end + 1
        if len(stream) - at > LONGEST:
            self.counts.reject("length")
            self.counts.bytes_skipped += len(stream) - at
            at = len(stream)
        self._pending = stream[at:]
        self._offset += at
        self.counts.frames += len(rows)
        return _batch(rows, ends, self._accelerometers)

    def _line(self, line: bytes) -> tuple[float, ...] | None:
        start = line.rfind(b"$")  # what stands before is the rest of a sentence whose end was lost
        text = line[start:].rstrip(b"\r\n") if start >= 0 else b""
        fields = parse(text)
        if fields is None:
            self.counts.reject("checksum")
            self.counts.bytes_skipped += len(line)
            return None
        self.counts.bytes_skipped += start
        if fields[0] != "PINS":
            return None
        row = _row(fields)
        if row is None:
            self.counts.reject("fields")
            self.counts.bytes_skipped += len(line) - start
        return row


def _row(fields: Sequence[str]) -> tuple[float, ...] | None:
    if len(fields) not in (7, 10):
        return None
    try:
        counter, status = int(fields[1]), int(fields[6], 16)
        position = [float(text) for text in fields[2:4]]
        temperatures = [float(text or "nan") for text in fields[4:6]]
        force = [float(text or "nan") for text in fields[7:] or ("", "", "")]
    except ValueError:
        return None
    inside = 0 <= counter < COUNTER_MODULO and abs(position[0]) <= 90.0 and abs(position[1]) <= 180.0
    return (counter, status, *position, *temperatures, *force) if inside and 0 <= status <= 255 else None


def _batch(rows: list[tuple[float, ...]], ends: list[int], accelerometers: bool) -> FrameBatch:
    table = np.array(rows, dtype=np.float64).reshape(-1, 9)
    status = table[:, 1].astype(np.uint8)
    columns = {
        "counter": table[:, 0].astype(np.int64),
        "status": status,
        "valid": (status & (POSITION_VALID | NAVIGATING)) == POSITION_VALID | NAVIGATING,
        "latitude_deg": table[:, 2],
        "longitude_deg": table[:, 3],
        "temp_c": table[:, 4],
        "cabinet_temp_c": table[:, 5],
    }
    if accelerometers:
        columns |= {name: table[:, 6 + axis] for axis, name in enumerate(FORCE)}
    return FrameBatch(columns, np.array(ends, dtype=np.int64))


def _number(value: float, form: str) -> str:
    return format(value, form) if value == value else ""
