"""What one end of a serial line makes of bytes that the other sends with other settings, bit by bit."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from simulators.config import SerialFormat
from simulators.interfaces import StreamBlock


def to_device(data: bytes, bench: SerialFormat, device: SerialFormat) -> bytes:
    """Return what the device takes of `data`: bytes with a wrong stop bit or parity are passed over."""
    if bench == device:
        return data
    return bytes(byte for byte, _, sound in _received(data, bench, device) if sound)


def to_bench(data: bytes, bench: SerialFormat, device: SerialFormat) -> bytes:
    """Return what the bench reads of `data`, unsound ones too: without INPCK a port hands them on."""
    if bench == device:
        return data
    return bytes(byte for byte, _, _ in _received(data, device, bench))


def block_to_bench(block: StreamBlock, bench: SerialFormat, device: SerialFormat) -> StreamBlock | None:
    """Return what the bench reads of a stream, None if nothing; its bytes follow one another without a pause."""
    if bench == device:
        return block
    received = _received(block.data, device, bench)
    places = np.array([at for _, at, _ in received], np.int64)
    counts = np.searchsorted(places, block.marks[:, 0])
    rises = np.diff(counts, prepend=0) > 0
    if not rises.any():
        return None
    marks = np.column_stack((counts, block.marks[:, 1]))[rises]
    return dataclasses.replace(block, data=bytes(byte for byte, _, _ in received), marks=marks)


def _received(data: bytes, sender: SerialFormat, reader: SerialFormat) -> list[tuple[int, int, bool]]:
    """Return (byte, place in `data` of the byte its start bit lies in, whether parity and stop bit are right).

    The reader finds a falling edge and samples the middle of its own bits from there. A stop bit that is 0 is
    taken for the next start bit, as the data sheet of the PC16550D says. Around `data` the line is idle.
    """
    bits = [bit for byte in data for bit in _sent_bits(byte, sender)]
    length = sender.bits_a_byte
    ratio = sender.baudrate / reader.baudrate
    edges = iter([i for i, bit in enumerate(bits) if not bit and (i == 0 or bits[i - 1])])
    count = 2 + reader.bytesize + reader.parity_bits
    received: list[tuple[int, int, bool]] = []
    start, free = float(next(edges, math.inf)), 0.0
    while start < len(bits):
        sampled = [_level(bits, start + (k + 0.5) * ratio) for k in range(count)]
        if sampled[0]:  # too short to be a start bit
            free = start + 0.5 * ratio
        else:
            value = sum(bit << k for k, bit in enumerate(sampled[1 : 1 + reader.bytesize]))
            sound = sampled[-1] == 1 and sampled[1 + reader.bytesize : -1] == _parity(value, reader)
            received.append((value, int(start) // length, sound))
            free = start + (count - 0.5) * ratio
            if not sampled[-1]:
                start += (count - 1) * ratio
                continue
        start = next((float(edge) for edge in edges if edge >= free), math.inf)
    return received


def _level(bits: list[int], at: float) -> int:
    return bits[int(at)] if at < len(bits) else 1


def _sent_bits(byte: int, sender: SerialFormat) -> list[int]:
    value = byte & ((1 << sender.bytesize) - 1)
    data = [value >> k & 1 for k in range(sender.bytesize)]
    return [0, *data, *_parity(value, sender), *[1] * sender.stopbits]


def _parity(value: int, line: SerialFormat) -> list[int]:
    odd = value.bit_count() & 1
    return {"N": [], "E": [odd], "O": [1 - odd]}[line.parity]
