"""Decoding described frames: the compiled decoder against the loop people write, and against copying the bytes.

Run as `python -m benchmarks frames`. The loop finds the sync with `bytes.find`, checks each frame with a table
in Python and unpacks all of its numbers with `struct`. Both take turns on the same 1 MiB, clean and with 1 % of
the bytes changed or lost; ours must find every intact frame; figures are medians of processor time, each of at
least 20 ms. The last rows
count false frames in random bytes.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks._measure import Row, figure, in_turns, speed_row
from benchmarks.decode_kvh import copy_row, table_crc
from drivers.frames import FrameDecoder, FrameEncoder, MessageReader, load_family
from drivers.kvh import KvhDecoder

_MIB = 2**20
_TURNS = 7
_RANDOM = 20_000_000


def crc16(data: bytes, register: int = 0x1D0F) -> int:
    """CRC-16 by one table, byte after byte."""
    for byte in data:
        register = (register << 8 & 0xFFFF) ^ _TABLE16[register >> 8 ^ byte]
    return register


_TABLE16 = [0] * 256
for _byte in range(256):
    _value = _byte << 8
    for _ in range(8):
        _value = (_value << 1 ^ (0x11021 if _value & 0x8000 else 0)) & 0xFFFF
    _TABLE16[_byte] = _value


def _kvh(frame: bytes) -> tuple[float, ...] | None:
    return struct.unpack(">4x6fBBh4x", frame) if table_crc(frame) == 0 else None


def _stim(frame: bytes) -> tuple[float, ...] | None:
    if table_crc(frame[:-4] + b"\0\0") != int.from_bytes(frame[-4:], "big"):  # 38 bytes, padded to 36
        return None
    numbers = [
        int.from_bytes(frame[at : at + 3], "big", signed=True) for at in (1, 4, 7, 11, 14, 17, 21, 24, 27)
    ]
    return (*numbers, frame[10], frame[31], int.from_bytes(frame[32:34], "big"))


def _openimu(frame: bytes) -> tuple[float, ...] | None:
    if crc16(frame[2:-2]) != int.from_bytes(frame[-2:], "big"):
        return None
    return struct.unpack("<5xI9f2x", frame)


CASES: dict[str, tuple[str | None, bytes, int, Callable[[bytes], tuple[float, ...] | None]]] = {
    "kvh": ("a", bytes.fromhex("FE81FF55"), 36, _kvh),
    "stim300": ("rate_acc_incl", b"\x93", 38, _stim),
    "openimu": (None, bytes.fromhex("55557A3128"), 47, _openimu),
}


def loop(
    data: bytes, sync: bytes, length: int, read: Callable[[bytes], tuple[float, ...] | None]
) -> list[tuple[float, ...]]:
    """Decode frame after frame."""
    found = []
    at = data.find(sync)
    while 0 <= at <= len(data) - length:
        numbers = read(data[at : at + length])
        if numbers is not None:
            found.append(numbers)
            at += length
        else:
            at += 1
        at = data.find(sync, at)
    return found


def ours(name: str, message: str | None) -> Callable[[bytes], int]:
    """Return what decodes a stream call by call and says how many frames there were."""
    decoder = FrameDecoder(load_family(name), rate_hz=100.0, axes="xyz", message=message)
    return lambda data: len(decoder.feed(data))


def stream(name: str, message: str | None) -> list[bytes]:
    """Return 1 MiB of frames with noise in every channel."""
    rng = np.random.default_rng(1)
    encoder = FrameEncoder(load_family(name), message)
    count = _MIB // encoder.layout.length
    values: dict[str, NDArray[np.float64]] = {
        spec.name: rng.normal(0.0, 0.01, count)
        for spec in encoder.form.fields
        if spec.axis and spec.type != "u8"
    }
    counter = load_family(name).description.counter
    if counter is not None:
        values[counter.field] = np.arange(count, dtype=np.float64)
    data = encoder.encode(count, values)
    size = len(data) // count
    return [data[at : at + size] for at in range(0, len(data), size)]


def damaged(frames: list[bytes], share: float) -> tuple[bytes, int]:
    """Return the stream with a share of its bytes changed or lost (half each), and how many frames are intact."""
    rng = np.random.default_rng(2)
    clean = np.frombuffer(b"".join(frames), np.uint8)
    changed = rng.random(clean.size) < share / 2
    lost = rng.random(clean.size) < share / 2
    noise = np.where(changed, rng.integers(1, 256, clean.size), 0).astype(np.uint8)
    intact = ~(changed | lost).reshape(len(frames), -1).any(axis=1)
    return (clean ^ noise)[~lost].tobytes(), int(intact.sum())


def rows() -> Iterator[Row]:
    """Yield a row a comparison."""
    for name, (message, sync, length, read) in CASES.items():
        frames = stream(name, message)
        for title, share in (("clean", 0.0), ("1 % of bytes damaged", 0.01)):
            data, intact = damaged(frames, share)
            if not intact <= ours(name, message)(data) <= intact + 3:
                raise AssertionError(f"{name}, {title}: {ours(name, message)(data)} frames, {intact} intact")
            pair = in_turns(
                partial(lambda run, data: run(data), ours(name, message), data),
                partial(loop, data, sync, length, read),
                turns=_TURNS,
            )
            yield speed_row(
                f"decode {name}, {title}", len(frames) / 1e6, pair, "struct + table loop", "million frames/s"
            )
        data = b"".join(frames)
        yield copy_row(f"decode {name}, clean", partial(ours(name, message), data), len(data))
    yield from _of_its_own()
    for name in ("fg333", "stim210"):
        yield _false(name)


def _of_its_own() -> Iterator[Row]:
    """Compare the described KVH decoder with the one in drivers/kvh, in one piece and as a bench reads."""
    frames = stream("kvh", "a")
    for title, share, size in (
        ("clean", 0.0, 1 << 30),
        ("1 % damaged", 0.01, 1 << 30),
        ("clean, 3600 bytes a call", 0.0, 3600),
    ):
        data, _ = damaged(frames, share)
        pieces = [data[at : at + size] for at in range(0, len(data), size)]
        pair = in_turns(
            lambda pieces=pieces: list(map(ours("kvh", "a"), pieces)),  # type: ignore[misc]
            lambda pieces=pieces: list(map(KvhDecoder(nominal_rate_hz=1e3, axes="xyz").feed, pieces)),  # type: ignore[misc]
            turns=_TURNS,
        )
        name = "drivers/kvh's decoder"
        yield speed_row(f"described kvh, {title}", len(frames) / 1e6, pair, name, "million frames/s")


def _false(name: str) -> Row:
    """Count false frames in random bytes against what head and check promise."""
    family = load_family(name)
    reader, rng = MessageReader(family), np.random.default_rng(3)
    for _ in range(_RANDOM // 1_000_000):
        reader.feed(rng.bytes(1_000_000))
    promised = 1e9 * sum(form.false_per_byte for form in family.forms)
    found = reader.counts.frames * 1e9 / _RANDOM
    return figure(
        f"false frames, {name}", found, promised, "2**-(bits of head and check)", "in 1e9 random bytes"
    )


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows())
