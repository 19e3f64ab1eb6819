"""Decoding described frames: the compiled decoder against the loop people write, and against copying the bytes.

Run as `python -m benchmarks frames`. The loops (`benchmarks/_loops.py`) find the head with `bytes.find`, check
each frame in Python and unpack all of its numbers with `struct`; those of ASCII lines split. Ours and the loop
take turns on the same bytes, clean and with 1 % of the bytes changed or lost; ours must find every intact frame.
Processor time. The last rows count false frames in random bytes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

from benchmarks._loops import LINE_LOOPS, LOOPS, LineLoop, Loop
from benchmarks._measure import Row, figure, in_turns, speed_row
from benchmarks.decode_kvh import copy_row
from drivers.frames import FrameDecoder, FrameEncoder, LineEncoder, MessageReader, load_family
from drivers.kit.patterns import find_sync, windows
from drivers.kvh import KvhDecoder

_BYTES = 2**19
_TURNS = 5
_RANDOM = 20_000_000
_AXES = {"fg333": "z", "kvh_dsp3000": "z", "rlg2t": "x"}


def ours(name: str, message: str | None) -> Callable[[bytes], int]:
    """Return what decodes a stream call by call and says how many frames there were."""
    decoder = FrameDecoder(load_family(name), rate_hz=100.0, axes=_AXES.get(name, "xyz"), message=message)
    return lambda data: len(decoder.feed(data))


def stream(name: str, message: str | None) -> list[bytes]:
    """Return half a MiB of frames, or 10,000 lines, with noise in every channel."""
    rng = np.random.default_rng(1)
    family = load_family(name)
    encoder: FrameEncoder | LineEncoder
    if name in LINE_LOOPS:
        encoder, count = LineEncoder(family), 10_000
    else:
        encoder = FrameEncoder(family, message)
        count = _BYTES // encoder.layout.length
    values: dict[str, NDArray[np.float64]] = {
        spec.name: rng.normal(0.0, 0.01, count)
        for spec in encoder.form.fields
        if spec.axis and spec.type != "u8"
    }
    counter = family.description.counter
    if counter is not None:
        spec = next(field for field in encoder.form.fields if field.name == counter.field)
        values[counter.field] = np.arange(count, dtype=np.float64) * (0.01 if spec.unit == "s" else 1.0)
    data = encoder.encode(count, values)
    if name in LINE_LOOPS:
        return data.splitlines(keepends=True)
    size = len(data) // count
    return [data[at : at + size] for at in range(0, len(data), size)]


def damaged(frames: list[bytes], share: float) -> tuple[bytes, int]:
    """Return the stream with a share of its bytes changed or lost (half each), and how many frames are intact."""
    rng = np.random.default_rng(2)
    clean = np.frombuffer(b"".join(frames), np.uint8)
    changed = rng.random(clean.size) < share / 2
    lost = rng.random(clean.size) < share / 2
    noise = np.where(changed, rng.integers(1, 256, clean.size), 0).astype(np.uint8)
    whole = np.add.reduceat(changed | lost, np.cumsum([0, *map(len, frames[:-1])])) == 0
    return (clean ^ noise)[~lost].tobytes(), int(whole.sum())


def rows() -> Iterator[Row]:
    """Yield a row a comparison."""
    loops: dict[str, Loop | LineLoop] = {**LOOPS, **LINE_LOOPS}
    for name, loop in loops.items():
        message = loop.message if isinstance(loop, Loop) else None
        frames = stream(name, message)
        for title, share in (("clean", 0.0), ("1 % of bytes damaged", 0.01)):
            data, intact = damaged(frames, share)
            found = ours(name, message)(data)
            # A line is sound without its CR, and the DSP-3000's has no check: damage there is not seen.
            if found < intact or (name in LOOPS and found > intact + 3 + 0.002 * len(frames)):
                raise AssertionError(f"{name}, {title}: {found} frames, {intact} intact")
            pair = in_turns(
                partial(lambda run, data: run(data), ours(name, message), data),
                partial(loop, data),
                turns=_TURNS,
            )
            kind = "split + check loop"
            if isinstance(loop, Loop):
                sums = load_family(name).form(message).checksums[0].kind.startswith("sum")
                kind = "struct + sum loop" if sums else "struct + table loop"
            yield speed_row(f"decode {name}, {title}", len(frames) / 1e6, pair, kind, "million frames/s")
            if kind == "struct + sum loop" and share:
                decode = partial(ours(name, message), data)
                least = in_turns(decode, partial(_heads_and_copies, data, loop), turns=_TURNS)
                limit = "limit: heads found, frames copied, no check"
                yield speed_row(
                    f"decode {name}, {title}", len(frames) / 1e6, least, limit, "million frames/s"
                )
        if name in ("kvh", "stim300", "openimu"):
            data = b"".join(frames)
            yield copy_row(f"decode {name}, clean", partial(ours(name, message), data), len(data))
    yield from _of_its_own()
    for name in ("fg333", "stim210"):
        yield _false(name)


def _heads_and_copies(data: bytes, loop: Loop | LineLoop) -> int:
    """What no decoder of arrays is without: one look for the head, and each frame moved once."""
    assert isinstance(loop, Loop)
    stream = np.frombuffer(data, np.uint8)
    starts = find_sync(stream, loop.sync)
    return len(windows(stream, starts[starts <= len(stream) - loop.length], loop.length))


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
