"""A gyro of our own for these tests: 7-byte frames (AA, counter, float32 rate, XOR), nothing clever."""

import struct
from types import SimpleNamespace

import numpy as np
import pytest

from bench.record.recording import PortJournal, StreamSource
from drivers.kit.instruments import FrameBatch, StreamCounts

SIZE = 7


def encode(counter, rate):
    body = struct.pack("<BBf", 0xAA, counter, rate)
    check = 0
    for byte in body:
        check ^= byte
    return body + bytes([check])


class Decoder:
    """Reads frame by frame; a wrong check moves on by one byte."""

    counter_step = 1.0

    def __init__(self, modulo=128, rate_hz=100.0):
        self.counter_modulo = modulo
        self.nominal_rate_hz = rate_hz
        self.counts = StreamCounts()
        self._buffer = b""
        self._offset = 0

    def feed(self, data):
        buffer = self._buffer + data
        rows, ends, at = [], [], 0
        while len(buffer) - at >= SIZE:
            frame = buffer[at : at + SIZE]
            if frame[0] == 0xAA and not np.bitwise_xor.reduce(np.frombuffer(frame, np.uint8)):
                rows.append(struct.unpack("<Bf", frame[1:6]))
                at += SIZE
                ends.append(self._offset + at)
            else:
                at += 1
                self.counts.bytes_skipped += 1
        self._buffer, self._offset = buffer[at:], self._offset + at
        self.counts.frames += len(rows)
        counter = np.array([row[0] for row in rows], np.int64)
        return FrameBatch(
            {
                "counter": counter,
                "status": np.full(len(rows), 7, np.uint8),
                "valid": np.ones(len(rows), bool),
                "delta": np.array([row[1] for row in rows], np.float32),
                "temp_c": np.full(len(rows), 20.0, np.float32),
            },
            np.array(ends, np.int64),
        )


def values(columns, sample_rate_hz):
    rate_dps = np.asarray(columns["delta"] * sample_rate_hz, np.float32)
    return {"rate_dps": rate_dps, "rate_y_dps": -columns["delta"], "temp_c": columns["temp_c"]}


def source(**changes):
    return StreamSource(**{"role": "gyro", "name": "fog", "decoder": Decoder, "values": values} | changes)


def record(folder, samples, period_s, *, start_s=1.0, latency_s=None, chunk=1):
    """Journal frames of the given sample numbers; the frame of sample n ends at start_s + n * period_s.

    They arrive `chunk` at a time, `latency_s` (a number or one a chunk) after the last of them.
    """
    port = PortJournal(folder, "fog")
    samples = np.asarray(samples)
    for at in range(0, len(samples), chunk):
        part = samples[at : at + chunk]
        late = 0.0 if latency_s is None else latency_s[at // chunk]
        data = b"".join(encode(int(n) % 128, float(n)) for n in part)
        port.received(data, start_s + part[-1] * period_s + late)
    port.flush(sync=False)
    return port


@pytest.fixture
def fake():
    return SimpleNamespace(encode=encode, Decoder=Decoder, source=source, record=record, size=SIZE)
