"""Decoding CAN signals in batches, against cantools' `decode_message` loop over the same frames, in the same run.

Run as `python -m benchmarks can_decode`. The yardstick gets its frames as (identifier, bytes) pairs, ready to
decode; ours gets arrays of frames, as the slcan parser gives them, as many as a megabyte of text holds, the block
that a recording is read in. Layouts: a little-endian unit (SBG Ellipse), a big-endian one (Xsens MTi), a J1939
one. One row adds the slcan text, which the yardstick does not have to read; further rows give ours the small
blocks of live reception, where the cost of a NumPy call, about sixty a block of any size, outweighs the work.
Processor time, in turns.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from importlib.metadata import version
from pathlib import Path

import cantools
import numpy as np
from numpy.typing import NDArray

import drivers.can_dbc
from benchmarks._measure import Pair, Row, Work, in_turns, speed_row
from drivers.can_dbc import CanDecoder, CanLayout, load_layout
from drivers.kit.slcan_codec import FRAME_DTYPE, SlcanParser, encode_frames
from drivers.sbg import ELLIPSE_DBC

_SAMPLES, _BLOCK, _FRAMES, _FEW = 100_000, 1 << 20, 47_000, 20_000
_LIVE = (64, 250, 1000, 4000)
"""Frames a call when received live: what one second of a slow unit gives, or a read of a fast bus."""
_ONE_READ = 4095
"""Characters that one read of a pseudo-terminal gives at most: 190 frames."""
_FOLDER = Path(drivers.can_dbc.__file__).parent
_UNITS = {
    "sbg_ellipse": ELLIPSE_DBC,
    "xsens_mti": _FOLDER / "xsens_mti.dbc",
    "openimu300": _FOLDER / "openimu300.dbc",
}


def frames_of(layout: CanLayout, count: int) -> NDArray[np.void]:
    """Return the frames of `count` samples with random payloads."""
    rng = np.random.default_rng(1)
    frames = np.zeros((count, len(layout.sample)), FRAME_DTYPE)
    for at, slot in enumerate(layout.sample):
        message = layout.messages[slot.message]
        frames["id"][:, at], frames["extended"][:, at] = message.identifier, message.extended
        frames["dlc"][:, at] = frames["length"][:, at] = message.length
        frames["data"][:, at, : message.length] = rng.integers(0, 256, (count, message.length))
    flat: NDArray[np.void] = frames.ravel()
    flat["end_offset"] = np.arange(1, len(flat) + 1)
    return flat


def by_us(layout: CanLayout, frames: NDArray[np.void], block: int = _FRAMES) -> None:
    """Decode arrays of frames to columns, `block` of them a call."""
    decoder = CanDecoder(layout, 100.0)
    rows = sum(len(decoder.feed_frames(frames[at : at + block])) for at in range(0, len(frames), block))
    assert rows == len(frames) // len(layout.sample)


def by_us_from_text(layout: CanLayout, text: bytes, block: int = _BLOCK) -> None:
    """Decode slcan text to columns, `block` characters a call."""
    decoder = CanDecoder(layout, 100.0)
    for at in range(0, len(text), block):
        decoder.feed(text[at : at + block])


def by_cantools(frames: NDArray[np.void], dbc: Path) -> Callable[[], None]:
    """Return a loop of `decode_message`, frame by frame."""
    database = cantools.database.load_file(dbc, encoding="utf-8")
    lengths, data = frames["length"].tolist(), frames["data"]
    pairs = [(int(n), data[k, : lengths[k]].tobytes()) for k, n in enumerate(frames["id"].tolist())]

    def work() -> None:
        for identifier, payload in pairs:
            database.decode_message(identifier, payload)

    return work


def rows() -> Iterator[Row]:
    """Yield ours against cantools for each unit, and for slcan text; and against copying the payloads."""
    name = f"cantools {version('cantools')} decode_message loop"
    for unit, dbc in _UNITS.items():
        layout = load_layout(unit)
        frames = frames_of(layout, _SAMPLES)
        peer = by_cantools(frames[:_FEW], dbc)
        works: list[tuple[str, Work, str]] = [("frames to columns", partial(by_us, layout, frames), name)]
        if unit == "sbg_ellipse":
            text = encode_frames(frames)
            assert len(SlcanParser().feed(text)) == len(frames)
            own = partial(by_us_from_text, layout, text)
            works.append(("slcan text to columns", own, f"{name}, text not counted"))
            works += [
                (f"{block} frames a call", partial(by_us, layout, frames, block), name) for block in _LIVE
            ]
            own = partial(by_us_from_text, layout, text, _ONE_READ)
            works.append((f"slcan text, {_ONE_READ} characters a call", own, f"{name}, text not counted"))
        for title, ours, against in works:
            pair = in_turns(ours, peer)
            scaled = Pair(pair.ours_s, pair.other_s, pair.ratio * len(frames) / _FEW)
            yield speed_row(f"{unit}: {title}", len(frames), scaled, against, "messages/s")
        payloads = np.ascontiguousarray(frames["data"])
        limit = in_turns(partial(by_us, layout, frames), partial(np.copy, payloads))
        yield speed_row(
            f"{unit}: frames to columns", len(frames), limit, "limit: copying the payloads", "messages/s"
        )


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows())
