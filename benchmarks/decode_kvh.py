"""Decoding KVH Format A: `KvhDecoder` against the loop one would write first, and against copying the bytes.

Run as `python -m benchmarks decode_kvh`. The loop finds the header with `bytes.find`, checks the CRC of each
message with a table in Python (or with fastcrc, where installed) and unpacks it with `struct`. Ours and the loop
take turns on the same bytes and must find the same number of messages; figures are medians of processor time.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from benchmarks._loops import crc32
from benchmarks._measure import Pair, Row, Work, in_turns, speed_row
from drivers.kvh import KvhDecoder, encode_frames

_SYNC = bytes.fromhex("FE81FF55")
_LENGTH = 36
_FRAME = struct.Struct(">4x6fBBh4x")
_TURNS = 7
_LARGE = 29127  # Messages in 1 MiB.
_COPY = 64 * 2**20  # Bytes; larger than the caches.
_SMALL = 100  # One second at 100 Hz.


def loop(data: bytes, crc: Callable[[bytes], int]) -> list[tuple[float, ...]]:
    """Decode message after message."""
    found = []
    at = data.find(_SYNC)
    while 0 <= at <= len(data) - _LENGTH:
        message = data[at : at + _LENGTH]
        if crc(message) == 0:
            found.append(_FRAME.unpack(message))
            at += _LENGTH - 1
        else:
            at += 1
        at = data.find(_SYNC, at)
    return found


def ours() -> Callable[[bytes], int]:
    """Return what decodes a stream call by call and says how many messages there were in each."""
    decoder = KvhDecoder(nominal_rate_hz=100.0, axes="xyz")
    return lambda data: len(decoder.feed(data))


def yardsticks() -> dict[str, Callable[[bytes], int]]:
    """Return the CRCs for the loop, by the loop's name."""
    crcs: dict[str, Callable[[bytes], int]] = {"struct + table CRC loop": crc32}
    try:
        from fastcrc import crc32 as fast
    except ImportError:
        return crcs
    return crcs | {"struct + fastcrc loop": fast.mpeg_2}


def stream(count: int, damaged_bytes: float) -> bytes:
    """Return `count` messages with a share of the bytes changed (half of it) or lost (the other half)."""
    rng = np.random.default_rng(1)
    rot = rng.normal(0.0, 1e-5, (count, 3))
    clean = np.frombuffer(encode_frames("A", rot, counter=np.arange(count), temp_c=25.0), np.uint8)
    changed = rng.random(clean.size) < damaged_bytes / 2
    noise = np.where(changed, rng.integers(1, 256, clean.size), 0).astype(np.uint8)
    return (clean ^ noise)[rng.random(clean.size) >= damaged_bytes / 2].tobytes()


def rows() -> Iterator[Row]:
    """Yield a row a comparison."""
    for title, count, damaged_bytes in (
        ("decode KVH, 1 MiB a call", _LARGE, 0.0),
        ("decode KVH, 1 MiB a call, 1 % of bytes damaged", _LARGE, 0.01),
        ("decode KVH, 100 messages a call", _SMALL, 0.0),
    ):
        data = stream(count, damaged_bytes)
        for name, crc in yardsticks().items():
            if ours()(data) != len(loop(data, crc)):
                raise AssertionError(f"{title}: decoder and {name} found different messages")
            pair = in_turns(partial(ours(), data), partial(loop, data, crc), turns=_TURNS)
            yield speed_row(title, count / 1e6, pair, name, "million messages/s")
    data = stream(_LARGE, 0.0)
    yield copy_row("decode KVH, 1 MiB a call", partial(ours(), data), len(data))


def copy_row(title: str, work: Work, size: int) -> Row:
    """Return the row of a work on `size` bytes against copying as many in memory, in blocks beyond the caches."""
    source, target = np.ones(_COPY, np.uint8), np.ones(_COPY, np.uint8)
    pair = in_turns(work, partial(np.copyto, target, source), turns=_TURNS)
    scaled = Pair(pair.ours_s, pair.other_s, pair.ratio * size / _COPY)
    return speed_row(title, size / 1e6, scaled, "limit: copy of 64 MiB in memory", "MB/s")


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows())
