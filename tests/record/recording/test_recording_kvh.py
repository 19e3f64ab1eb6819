"""A KVH recording, its frames built here byte by byte from the interface document, decoded into a table."""

import math
import struct

import numpy as np
import pyarrow.parquet as pq
import pytest

from bench.record.recording import PortJournal, StreamSource, decode_stream
from drivers.kvh import KvhDecoder, rate_dps

VECTOR = bytes.fromhex("FE81FF55 37A96A6E 38586C1F B75BF862 BF803E78 BB650D28 3B0A37AC 77 3D 0028 4BFA34D8")
"""A real Format A frame: rot x 2.019593e-5 rad, sequence 61, 40 degC (KVH ICD 56-0298 and public driver)."""


def crc(data):
    """CRC-32, polynomial 04C11DB7, start FFFFFFFF, not reflected, no final XOR; bit by bit."""
    register = 0xFFFFFFFF
    for byte in data:
        register ^= byte << 24
        for _ in range(8):
            register = ((register << 1) ^ (0x04C11DB7 if register & 0x80000000 else 0)) & 0xFFFFFFFF
    return register


def frame(sequence, rot_x, temp_c, status=0x77):
    body = struct.pack(">4s6fBBh", b"\xfe\x81\xff\x55", rot_x, 0, 0, 0, 0, 1, status, sequence, temp_c)
    return body + struct.pack(">I", crc(body))


def source(**changes):
    return StreamSource(
        "gyro",
        "fog",
        decoder=lambda: KvhDecoder(nominal_rate_hz=100.0, axes="x", temp_units="C"),
        values=lambda columns, rate_hz: {
            "rate_dps": np.float32(rate_dps(columns["rot_x"], "delta", "RAD", rate_hz)),
            "temp_c": columns["temp_c"],
        },
        **changes,
    )


def test_the_frame_builder_agrees_with_the_published_vector():
    assert crc(VECTOR[:-4]) == int.from_bytes(VECTOR[-4:], "big")


def test_a_kvh_stream_with_a_clock_half_a_percent_fast_becomes_true_rates(tmp_path):
    """Earth rate as delta angles of a device at 100.5 Hz; frame 400 damaged, 130 frames never sent."""
    earth_dps, true_hz = 15.041067 / 3600.0, 100.5
    delta = math.radians(earth_dps) / true_hz
    samples = [n for n in range(3000) if not 1000 <= n < 1130]
    port = PortJournal(tmp_path, "fog")
    port.received(VECTOR, 9.0)
    for n in samples:
        data = frame((62 + n) % 128, delta, -40, status=0x76 if n == 77 else 0x77)
        if n == 400:
            data = data[:10] + bytes([data[10] ^ 4]) + data[11:]
        port.received(data, 9.0 + (n + 1) / true_hz)
    port.flush(sync=False)

    report = decode_stream(tmp_path, source(baudrate=921_600))
    table = pq.read_table(tmp_path / "gyro_fog.parquet")
    rate, lost = table["rate_dps"].to_numpy(), table["lost_before"].to_numpy()
    assert report.sample_rate_hz == pytest.approx(true_hz, rel=1e-7)
    assert report.clock_error_ppm == pytest.approx(5000, abs=0.1)
    assert rate[0] == pytest.approx(math.degrees(2.019593e-5) * true_hz, rel=1e-6)
    assert rate[1:] == pytest.approx(np.full(len(samples) - 1, earth_dps), rel=1e-6)
    assert {int(table["counter"][int(at)].as_py()): int(lost[at]) for at in np.flatnonzero(lost)} == {
        61 + 402: 1,
        61 + 1131: 130,
    }
    wire_ns = round(36 * 10 / 921_600 * 1e9)
    expected = 9e9 + (table["counter"].to_numpy() - 61) / true_hz * 1e9 - wire_ns
    assert np.abs(table["time_ns"].to_numpy() - expected).max() <= 2
    assert np.flatnonzero(~table["valid"].to_numpy()).tolist() == [78]
    assert table["temp_c"].to_pylist()[:2] == [40.0, -40.0]
    assert report.rejected == {"checksum": 1}
    assert (report.frames, report.lost, report.invalid) == (len(samples), 131, 1)
