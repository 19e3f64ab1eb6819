"""Receiving CAN over an slcan adapter, against python-can's own slcan bus and cantools, in the same run.

Run as `python -m benchmarks slcan_receive`. The same lines go through a pseudo-terminal, written by a process of
its own, to each reader in turn; every reader must get every frame. Medians of processor time of the reading
process; the limit is reading the bytes in blocks and dropping them.
"""

from __future__ import annotations

import contextlib
import os
import pty
import statistics
import tty
from collections.abc import Callable, Iterator
from importlib.metadata import version
from multiprocessing import get_context
from time import process_time

import can
import cantools
import numpy as np
from can.interfaces.slcan import slcanBus
from numpy.typing import ArrayLike

from benchmarks._measure import Pair, Row, in_turns, speed_row, usual
from drivers.base.clock import WallClock
from drivers.can_dbc import CanDecoder
from drivers.kit.link import Link
from drivers.kit.slcan_codec import FRAME_DTYPE, SlcanParser, encode_frames
from drivers.sbg import ALL_GOOD, ELLIPSE_DBC, ellipse_layout
from drivers.slcan import BufferedSlcanBus

_FEW, _MANY, _SAMPLES = 4_000, 400_000, 20_000
_LINE = 22
_LARGEST_READ = 4095
"""A pseudo-terminal never gives more at once; a frame is decoded with the `_BLOCKS` that came with it."""
_BLOCKS = 16


def lines(count: int) -> bytes:
    """Return `count` standard frames of 8 random bytes."""
    rng = np.random.default_rng(1)
    frames = np.zeros(count, FRAME_DTYPE)
    frames["id"], frames["dlc"] = rng.integers(0, 0x800, count), 8
    frames["data"] = rng.integers(0, 256, (count, 8))
    return encode_frames(frames)


@contextlib.contextmanager
def terminal() -> Iterator[tuple[int, str]]:
    """Open a pseudo-terminal: descriptor of the adapter's end, path of the bench's."""
    master, slave = pty.openpty()
    tty.setraw(slave)
    try:
        yield master, os.ttyname(slave)
    finally:
        os.close(slave)
        os.close(master)


def timed(master: int, text: bytes, read_all: Callable[[], None]) -> float:
    """Return the processor seconds a frame that `read_all` takes for `text` off the port."""
    os.read(master, 4096)  # what was written to open the adapter
    writer = get_context("fork").Process(target=write_all, args=(master, text))
    writer.start()
    begin = process_time()
    read_all()
    elapsed_s = process_time() - begin
    writer.join()
    return elapsed_s / (len(text) / _LINE)


def write_all(master: int, text: bytes) -> None:
    """Write in blocks, as an adapter on USB does."""
    view = memoryview(text)
    while view:
        view = view[os.write(master, view[:65536]) :]


def messages_of_ours(text: bytes) -> float:
    """Seconds a frame of `BufferedSlcanBus.recv`."""
    with terminal() as (master, path), BufferedSlcanBus(path) as bus:
        return timed(master, text, lambda: receive(bus, len(text) // _LINE))


def messages_of_python_can(text: bytes) -> float:
    """Seconds a frame of python-can's `slcanBus.recv`."""
    with terminal() as (master, path), slcanBus(path, bitrate=500_000, sleep_after_open=0) as bus:
        return timed(master, text, lambda: receive(bus, len(text) // _LINE))


def receive(bus: can.BusABC, count: int) -> None:
    """Receive `count` messages one by one."""
    for _ in range(count):
        if bus.recv(5.0) is None:
            raise AssertionError("a frame was lost")


def frames_of_ours(text: bytes) -> float:
    """Seconds a frame of link and parser in blocks, as a recording is decoded."""
    with terminal() as (master, path):
        clock = WallClock()
        link, parser = Link(path, clock, name="bulk"), SlcanParser()
        os.write(link.fileno(), b"C\rS6\rO\r")

        def read_all() -> None:
            left = len(text)
            while left:
                blocks = [link.read_some(5.0) for _ in range(min(_BLOCKS, -(-left // _LARGEST_READ)))]
                data = b"".join(blocks)
                parser.feed(data)
                left -= len(data)
            if parser.counts.frames != len(text) // _LINE:
                raise AssertionError("a frame was lost")

        found = timed(master, text, read_all)
        link.close()
        clock.close()
        return found


def blocks_dropped(text: bytes) -> float:
    """Seconds a frame of reading in blocks and dropping them."""
    with terminal() as (master, path):
        port = os.open(path, os.O_RDWR | os.O_NOCTTY)
        os.write(port, b"C\rS6\rO\r")

        def read_all() -> None:
            left = len(text)
            while left:
                left -= len(os.read(port, 65536))

        found = timed(master, text, read_all)
        os.close(port)
        return found


def sbg_lines(count: int) -> bytes:
    """Return `count` cycles of IMU_INFO and IMU_GYRO."""
    messages = ellipse_layout().messages
    info, gyro = (messages[f"SBG_ECAN_MSG_IMU_{name}"] for name in ("INFO", "GYRO"))
    rng = np.random.default_rng(1)
    rates: dict[str, ArrayLike] = {f"GYRO_{axis}": rng.integers(-32768, 32768, count) for axis in "XYZ"}
    status: dict[str, ArrayLike] = {
        "TIME_STAMP": np.arange(count) * 10_000,
        "STATUS": ALL_GOOD,
        "TEMPERATURE": 2500,
    }
    frames = np.zeros((count, 2), FRAME_DTYPE)
    frames["id"], frames["dlc"] = (info.identifier, gyro.identifier), (8, 6)
    frames["data"][:, 0], frames["data"][:, 1] = (info.pack(status, count), gyro.pack(rates, count))
    return encode_frames(frames.ravel())


def samples_of_ours(text: bytes) -> int:
    """Decode slcan text to columns; return how many samples."""
    decoder = CanDecoder(ellipse_layout(), 100.0)
    return sum(len(decoder.feed(text[at : at + 65536])) for at in range(0, len(text), 65536))


def samples_of_cantools(text: bytes) -> int:
    """Decode the same text in a `decode_message` loop."""
    database = cantools.database.load_file(ELLIPSE_DBC)
    rows = []
    cycle: dict[str, object] = {}
    for line in text.decode("ascii").split("\r")[:-1]:
        cycle |= database.decode_message(int(line[1:4], 16), bytes.fromhex(line[5:]))
        if line.startswith("t122"):
            rows.append(cycle)
            cycle = {}
    return len(rows)


def rows() -> Iterator[Row]:
    """Yield a row a comparison."""
    few, many, samples = lines(_FEW), lines(_MANY), sbg_lines(_SAMPLES)
    tenth = many[: len(many) // 10 // _LINE * _LINE]
    peer = f"python-can {version('python-can')} slcanBus.recv"
    for title, ours, text, other, other_text, name in (
        ("slcan over a pty, message by message", messages_of_ours, tenth, messages_of_python_can, few, peer),
        ("slcan over a pty, in blocks", frames_of_ours, many, messages_of_python_can, few, peer),
        (
            "slcan over a pty, in blocks",
            frames_of_ours,
            many,
            blocks_dropped,
            many,
            "limit: bytes read, dropped",
        ),
    ):
        times = [(ours(text), other(other_text)) for _ in range(usual(5, 2))]
        pair = Pair(
            *(statistics.median(column) for column in (*zip(*times, strict=True), [b / a for a, b in times]))
        )
        yield speed_row(title, 1.0, pair, name, "frames/s")
    assert samples_of_ours(samples) == samples_of_cantools(samples) == _SAMPLES
    pair = in_turns(lambda: samples_of_ours(samples), lambda: samples_of_cantools(samples), turns=3)
    name = f"cantools {version('cantools')} decode_message loop"
    yield speed_row("SBG Ellipse, slcan text to columns", _SAMPLES, pair, name, "samples/s")


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows())
