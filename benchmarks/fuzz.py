"""Decoders against bytes that no device sent: `python -m benchmarks.fuzz [BYTES]`, or `make fuzz`.

Every decoder gets the same sort of stream, a third each: random bytes, random bytes with heads of its own
frames strewn in, and its own frames with some bytes changed, lost or doubled; in chunks of random size. Nothing
may raise, no frame or line may come out whose check does not hold when computed anew, byte by byte, and offsets
must rise. `false frames` are those found in the random third. Each decoder gets BYTES bytes, default
five million (1e8 in all).
"""

from __future__ import annotations

import re
import sys
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from benchmarks._sections import write_section
from drivers.can_dbc import CanDecoder, load_layout, shipped_layouts
from drivers.frames import (
    FrameDecoder,
    FrameEncoder,
    FrameFamily,
    LineDescription,
    LineEncoder,
    LineSection,
    Messages,
    load_family,
    reader_of,
    shipped,
)
from drivers.kit.framing import Crc
from drivers.kit.slcan_codec import SlcanParser
from drivers.kvh import KvhDecoder, encode_frames

_BLOCK = 100_000


@dataclass
class Fuzzed:
    """What came of it: bytes offered, frames, those in random bytes, and wrong ones in words."""

    bytes_offered: int = 0
    frames: int = 0
    false_frames: int = 0
    mistakes: list[str] = field(default_factory=list)


Feed = Callable[[bytes], tuple[int, NDArray[np.int64], list[str]]]
"""Bytes -> frames, offsets of their ends, mistakes."""


def names() -> list[str]:
    """Return every decoder: a description's name, `can:` and a layout's, or one of those written by hand."""
    return [*shipped(), *(f"can:{name}" for name in shipped_layouts()), "kvh1750", "slcan"]


def fuzz(name: str, count: int, seed: int) -> Fuzzed:
    """Feed one decoder about `count` bytes."""
    rng = np.random.default_rng([seed, names().index(name)])
    feed, samples = _decoder(name)
    found, last = Fuzzed(), -1
    for number in range(max(3, -(-count // _BLOCK))):
        data = _stream(rng, samples, number % 3, min(_BLOCK, -(-count // 3)))
        begin = found.bytes_offered
        for chunk in _chunks(rng, data):
            frames, ends, mistakes = feed(chunk)
            found.frames += frames
            if number % 3 == 0:  # A frame of before may have waited for what follows it.
                found.false_frames += int(np.count_nonzero(ends > begin)) if len(ends) else frames
            found.mistakes += mistakes
            steps = np.diff(ends, prepend=last)
            if len(ends) and (steps <= 0).any():
                found.mistakes.append(f"ends do not rise: {ends.tolist()[:8]} after {last}")
            found.bytes_offered += len(chunk)
            if len(ends):
                last = int(ends[-1])
                if last > found.bytes_offered:
                    found.mistakes.append(f"a frame ends at {last} of {found.bytes_offered} bytes")
    return found


def _stream(rng: np.random.Generator, samples: list[bytes], what: int, count: int) -> bytes:
    if what == 0:
        return rng.bytes(count)
    parts: list[bytes] = []
    size = 0
    while size < count:
        sample = samples[int(rng.integers(len(samples)))]
        if what == 1:
            part = sample[: int(rng.integers(1, 9))] + rng.bytes(int(rng.integers(0, 90)))
        else:
            part = _damaged(rng, sample)
        parts.append(part)
        size += len(part)
    return b"".join(parts)


def _damaged(rng: np.random.Generator, sample: bytes) -> bytes:
    at = int(rng.integers(len(sample)))
    match int(rng.integers(6)):
        case 0:
            return sample[:at] + bytes([sample[at] ^ int(rng.integers(1, 256))]) + sample[at + 1 :]
        case 1:
            return sample[:at] + sample[at + 1 :]
        case 2:
            return sample[: at + 1] + sample[at:]
        case 3:
            return sample[:at]
        case _:
            return sample


def _chunks(rng: np.random.Generator, data: bytes) -> Iterator[bytes]:
    at = 0
    while at < len(data):
        size = int(2 ** rng.uniform(0.0, 15.0))
        yield data[at : at + size]
        at += size


def _decoder(name: str) -> tuple[Feed, list[bytes]]:
    if name == "slcan":
        parser = SlcanParser()
        lines = [b"t1238" + b"0102030405060708\r", b"T0CF02A808" + b"00820082007D0000\r", b"\x07", b"r1230\r"]

        def parse(data: bytes) -> tuple[int, NDArray[np.int64], list[str]]:
            frames = parser.feed(data)
            wrong = int((frames["dlc"] > 8).sum()) + int((frames["id"] >= 1 << 29).sum())
            return len(frames), np.empty(0, np.int64), ["an impossible CAN frame"] * bool(wrong)

        return parse, lines
    if name.startswith("can:"):
        layout = load_layout(name[4:])
        lines = [
            (f"T{message.identifier:08X}8" if message.extended else f"t{message.identifier:03X}8").encode()
            + b"0102030405060708\r"
            for message in layout.messages.values()
        ]
        lines.append(b"".join(lines))  # a whole sample: half of one is none
        return _stream_feed(CanDecoder(layout, 100.0)), lines
    if name == "kvh1750":
        data = encode_frames("A", np.ones((4, 3)), counter=np.arange(4), temp_c=20.0)
        return _stream_feed(KvhDecoder(nominal_rate_hz=1000.0)), [data[:36], data[36:72]]
    return _described(load_family(name))


def _stream_feed(decoder: CanDecoder | KvhDecoder) -> Feed:
    def feed(data: bytes) -> tuple[int, NDArray[np.int64], list[str]]:
        batch = decoder.feed(data)
        wrong = [key for key, column in batch.columns.items() if len(column) != len(batch)]
        return len(batch), batch.end_offset, wrong

    return feed


def _described(family: FrameFamily) -> tuple[Feed, list[bytes]]:
    reader = reader_of(family)
    form = next(form for form in family.forms if form.measures)
    axes = "".join(axis for axis in "xyz" if any(spec.axis == axis for spec in form.fields))
    decoder = FrameDecoder(family, rate_hz=100.0, axes=axes[:1], message=form.name)
    heard = bytearray()
    if isinstance(family.description, LineDescription):
        line = family.description.line
        samples = [vector.text.encode("latin-1") + b"\r\n" for vector in family.description.vector]
        samples.append(line.start.encode("latin-1") + b",1,2.5,-3e9,nan;12*00000000\r\n")
        samples.append(LineEncoder(family).encode(1, {}))
    else:
        line = None
        samples = [vector.hex for vector in family.description.vector]
        samples += [FrameEncoder(family, form.name).encode(1, {}) for form in family.forms]

    def feed(data: bytes) -> tuple[int, NDArray[np.int64], list[str]]:
        decoder.feed(data)
        found = reader.feed(data)
        if line is None:
            mistakes = [text for messages in found for text in _unsound(messages)]
        else:
            heard.extend(data)
            mistakes = [
                text for messages in found for text in _unsound_lines(line, heard, messages.end_offset)
            ]
        for messages in found:
            messages.columns()
        ends = [messages.end_offset for messages in found]
        return sum(map(len, ends)), np.sort(np.concatenate([*ends, np.empty(0, np.int64)])), mistakes

    return feed, samples


def _unsound_lines(line: LineSection, heard: bytearray, ends: NDArray[np.int64]) -> Iterator[str]:
    """Check every accepted line by its bytes: start, number of columns, and the check by its definition."""
    start = line.start.encode("latin-1")
    for end in ends.tolist():
        text = bytes(heard[heard.rfind(b"\n", 0, end - 1) + 1 : end])
        if start:
            text = text[text.rfind(start) :] if start in text else b""
        body, digits = text.rstrip(b"\r\n"), b""
        if line.checksum is not None:
            body, _, digits = body.rpartition(line.checksum.after.encode("latin-1"))
            covered = body[line.checksum.skip :]
            if line.checksum.kind == "xor8":
                wanted = b"%02X" % _sum("xor8", covered, "big", 0)[0]
            else:  # zlib's register begins with ones and ends inverted, this one does neither
                wanted = b"%08X" % (zlib.crc32(covered, 0xFFFFFFFF) ^ 0xFFFFFFFF)
            if digits.upper() != wanted:
                yield f"line {text!r}: check {digits!r}, not {wanted!r}"
        columns = re.split(
            r"\s+" if " " in line.separators else f"[{re.escape(line.separators)}]",
            body[len(start) :].decode("latin-1").strip(),
        )
        if len(columns) != line.columns:
            yield f"line {text!r}: {len(columns)} columns"


def _unsound(messages: Messages) -> Iterator[str]:
    """Check every frame by the definition of its check, one byte after the other."""
    endian = messages.form.endian
    for row in messages.rows:
        frame = row.tobytes()
        for spec in messages.form.checksums:
            covered = b"".join(frame[first : end or None] for first, end in spec.ranges)
            if spec.kind.startswith("crc"):
                assert spec.poly is not None
                width = int(spec.kind[3:])
                padded = covered + bytes(-len(covered) % spec.pad_to)
                value = Crc(width, spec.poly, spec.init, spec.reflected, spec.xorout).of(padded)
            else:
                value, width = _sum(spec.kind, covered, spec.words or endian, spec.init)
            at = spec.at % len(frame)
            if value != int.from_bytes(frame[at : at + width // 8], spec.endian or endian):
                yield f"{messages.form.name}: {frame.hex(' ')}"


def _sum(kind: str, covered: bytes, words: Literal["big", "little"], init: int) -> tuple[int, int]:
    if kind == "xor8":
        for byte in covered:
            init ^= byte
        return init, 8
    if kind == "sum16_words":
        pairs = (int.from_bytes(covered[at : at + 2], words) for at in range(0, len(covered), 2))
        return (init + sum(pairs)) % 65536, 16
    total = init + sum(covered)
    if kind == "neg8":
        return -total % 256, 8
    return (total % 65536, 16) if kind == "sum16" else (total % 256, 8)


def main() -> None:
    """Print a line a decoder and write them as a section; exit 1 if one let a wrong frame through."""
    count = int(float(sys.argv[1])) if len(sys.argv) > 1 else 5_000_000
    print(f"{'decoder':<20}{'bytes':>13}{'frames':>10}{'false frames':>14}")
    wrong = total = 0
    table = ["| decoder | bytes | frames | frames in random bytes | wrong |", "|---|---|---|---|---|"]
    for name in names():
        found = fuzz(name, count, seed=1)
        wrong += len(found.mistakes)
        total += found.bytes_offered
        figures = (found.bytes_offered, found.frames, found.false_frames, len(found.mistakes))
        table.append(f"| {name} | " + " | ".join(f"{figure:,}" for figure in figures) + " |")
        print(f"{name:<20}{found.bytes_offered:>13}{found.frames:>10}{found.false_frames:>14}", flush=True)
        for text in found.mistakes[:3]:
            print(f"    {text}")
    lines = [
        f"{total:,} bytes, {wrong} wrong frames. Where a decoder has no check value, random bytes make frames."
    ]
    write_section("Fuzzed decoders", f"python -m benchmarks.fuzz {count}", [*lines, "", *table])
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
