"""Decoding CAN signals in batches, against cantools' `decode_message` loop over the same frames, in the same run.

Run as `python -m benchmarks.can_decode`. The yardstick gets its frames as (identifier, bytes) pairs, ready to
decode; ours gets arrays of frames, as the slcan parser gives them, as many as a megabyte of text holds, the block
that a recording is read in. Layouts: a little-endian unit (SBG Ellipse), a big-endian one (Xsens MTi), a J1939
one. One row adds the slcan text, which the yardstick does not have to read.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from pathlib import Path

import cantools
import numpy as np
from numpy.typing import NDArray

import drivers.can_dbc
from drivers.can_dbc import CanDecoder, CanLayout, load_layout
from drivers.clock import host_seconds
from drivers.sbg import ELLIPSE_DBC
from drivers.slcan_codec import FRAME_DTYPE, SlcanParser, encode_frames

_SAMPLES, _REPEATS, _BLOCK, _FRAMES = 100_000, 5, 1 << 20, 47_000
_Ours = Callable[[CanLayout, NDArray[np.void]], float]
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


def by_us(layout: CanLayout, frames: NDArray[np.void]) -> float:
    """Messages/s from arrays of frames to columns."""
    decoder = CanDecoder(layout, 100.0)
    begin = host_seconds()
    rows = sum(len(decoder.feed_frames(frames[at : at + _FRAMES])) for at in range(0, len(frames), _FRAMES))
    elapsed_s = host_seconds() - begin
    assert rows == len(frames) // len(layout.sample)
    return len(frames) / elapsed_s


def by_us_from_text(layout: CanLayout, frames: NDArray[np.void]) -> float:
    """Messages/s from slcan text to columns."""
    text = encode_frames(frames)
    decoder = CanDecoder(layout, 100.0)
    begin = host_seconds()
    for at in range(0, len(text), _BLOCK):
        decoder.feed(text[at : at + _BLOCK])
    return len(frames) / (host_seconds() - begin)


def by_cantools(layout: CanLayout, frames: NDArray[np.void], dbc: Path) -> float:
    """Messages/s of `decode_message`, frame by frame."""
    database = cantools.database.load_file(dbc, encoding="utf-8")
    few = frames[:20_000]
    lengths, data = few["length"].tolist(), few["data"]
    pairs = [(int(n), data[k, : lengths[k]].tobytes()) for k, n in enumerate(few["id"].tolist())]
    begin = host_seconds()
    for identifier, payload in pairs:
        database.decode_message(identifier, payload)
    return len(few) / (host_seconds() - begin)


def rows() -> list[dict[str, object]]:
    """Return ours, yardstick and ratio for each unit, and for slcan text."""
    table = []
    for name, dbc in _UNITS.items():
        layout = load_layout(name)
        frames = frames_of(layout, _SAMPLES)
        contests: list[tuple[str, Callable[[CanLayout, NDArray[np.void]], float]]] = [
            (f"{name}: frames to columns", by_us)
        ]
        if name == "sbg_ellipse":
            assert len(SlcanParser().feed(encode_frames(frames))) == len(frames)
            contests.append((f"{name}: slcan text to columns", by_us_from_text))
        for title, ours in contests:
            pairs = [(ours(layout, frames), by_cantools(layout, frames, dbc)) for _ in range(_REPEATS)]
            mine, yardstick = (statistics.median(values) for values in zip(*pairs, strict=True))
            table.append(
                {
                    "benchmark": title,
                    "ours": mine,
                    "yardstick": yardstick,
                    "yardstick_name": "cantools decode_message loop, text not counted",
                    "unit": "messages/s",
                    "ratio": mine / yardstick,
                }
            )
    return table


def main() -> None:
    """Print the rows."""
    for row in rows():
        print(
            f"{row['benchmark']}: {row['ours']:,.0f} /s, {row['yardstick']:,.0f} /s, ratio {row['ratio']:.0f}"
        )


if __name__ == "__main__":
    main()
