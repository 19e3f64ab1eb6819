"""Six gyros at 1 kHz recorded together in real time: four on serial ports, two on CAN, lost frames and CPU share.

Run as `python -m benchmarks.six_gyros [SECONDS]` (default 20; 10 in `make bench`). A process of its own writes to
six pseudo-terminals every 5 ms what the units would have sent; the bench's links, its reader thread and its
journal record them, and every unit is decoded live once a second. Afterwards the record is decoded: every frame
must be there. The ratio says how many times the CPU time that was used fits into the real time.
"""

from __future__ import annotations

import os
import pty
import resource
import sys
import tempfile
import tty
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from bench.record.recording import Journal
from benchmarks._measure import Row, figure
from drivers.base.clock import WallClock, host_seconds
from drivers.can_dbc import CanDecoder, load_layout
from drivers.kit.instruments import StreamDecoder
from drivers.kit.link import Link
from drivers.kit.slcan_codec import FRAME_DTYPE
from drivers.kit.slcan_codec import encode_frames as encode_can
from drivers.kvh import KvhDecoder, encode_frames

_RATE_HZ, _TICK_S, _SERIAL, _CAN = 1000, 0.005, 4, 2


def serial_bytes(count: int) -> bytes:
    """Return frames of a KVH in Format A."""
    rng = np.random.default_rng(1)
    return encode_frames("A", rng.normal(size=(count, 3)), counter=np.arange(count), temp_c=25.0)


def can_bytes(count: int) -> bytes:
    """Return the two frames a sample of an SBG Ellipse as slcan text."""
    layout = load_layout("sbg_ellipse")
    frames = np.zeros((count, 2), FRAME_DTYPE)
    info, gyro = (layout.messages[slot.message] for slot in layout.sample)
    frames["id"], frames["dlc"] = (info.identifier, gyro.identifier), (info.length, gyro.length)
    frames["data"][:, 0] = info.pack({"TIME_STAMP": np.arange(count) * 1000, "STATUS": 0x3FF}, count)
    return encode_can(frames.ravel())


def send(masters: list[int], seconds: float) -> None:
    """Write to each port what its unit sends, on the wall clock, a port that is full loses nothing: it waits."""
    count = round(seconds * _RATE_HZ)
    texts = [serial_bytes(count)] * _SERIAL + [can_bytes(count)] * _CAN
    sizes = [len(text) // count for text in texts]
    clock = WallClock()
    done, start_s = 0, clock.now()
    while done < count:
        due = min(count, int((clock.now() - start_s) * _RATE_HZ))
        for master, text, size in zip(masters, texts, sizes, strict=True):
            view = memoryview(text)[done * size : due * size]
            while view:
                view = view[os.write(master, view) :]
        done = due
        clock.sleep(_TICK_S)
    clock.close()


class Unit:
    """One recorded port with its live decoder."""

    def __init__(
        self, name: str, path: str, clock: WallClock, journal: Journal, decoder: StreamDecoder
    ) -> None:
        self.link = Link(path, clock, name=name, tap=self)
        self.link.streaming = True
        self._record = journal.port(name)
        self._decoder = decoder
        self._blocks: list[bytes] = []
        clock.stream(self.link)

    def received(self, data: bytes, arrival_s: float) -> None:
        """Record, and keep for the live decoder."""
        self._record.received(data, arrival_s)
        self._blocks.append(data)

    def sent(self, data: bytes, time_s: float) -> None:
        """Nothing is sent."""

    def update(self) -> int:
        """Decode what came; return the frames so far."""
        blocks, self._blocks = self._blocks, []
        self._decoder.feed(b"".join(blocks))
        return self._decoder.counts.frames


def decoders() -> list[StreamDecoder]:
    """Return a fresh decoder for each unit."""
    layout = load_layout("sbg_ellipse")
    serial: list[StreamDecoder] = [
        KvhDecoder(nominal_rate_hz=_RATE_HZ, frame_format="A") for _ in range(_SERIAL)
    ]
    return [*serial, *(CanDecoder(layout, _RATE_HZ) for _ in range(_CAN))]


def rows(seconds: float = 10.0) -> list[Row]:
    """Return the CPU share of recording and live decoding, and how much was lost."""
    count = round(seconds * _RATE_HZ)
    ports = [pty.openpty() for _ in range(_SERIAL + _CAN)]
    for _, slave in ports:
        tty.setraw(slave)
    with tempfile.TemporaryDirectory(prefix="gyrobench-six-") as scratch:
        folder, clock = Path(scratch), WallClock()
        journal = Journal(folder, 1.0)
        units = [
            Unit(f"gyro_{k}", os.ttyname(slave), clock, journal, decoder)
            for k, ((_, slave), decoder) in enumerate(zip(ports, decoders(), strict=True))
        ]
        sender = get_context("fork").Process(target=send, args=([master for master, _ in ports], seconds))
        before = resource.getrusage(resource.RUSAGE_SELF)
        begin = host_seconds()
        sender.start()
        frames = [0] * len(units)
        while min(frames) < count and host_seconds() - begin < 3.0 * seconds + 30.0:
            clock.sleep(1.0)
            journal.check()
            frames = [unit.update() for unit in units]
        elapsed_s = host_seconds() - begin
        after = resource.getrusage(resource.RUSAGE_SELF)
        sender.join()
        for unit in units:
            unit.link.close()
        journal.close()
        clock.close()
        kept = []
        for k, decoder in enumerate(decoders()):
            decoder.feed((folder / "raw" / f"gyro_{k}.bin").read_bytes())
            kept.append(decoder.counts.frames)
    for master, slave in ports:
        os.close(master)
        os.close(slave)
    lost = sum(count - number for number in kept)
    cpu_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    total = count * len(units)
    name = f"six gyros at 1 kHz for {seconds:g} s"
    return [
        figure(f"{name}: processor time", cpu_s, elapsed_s, "limit: real time", "s", least=True),
        figure(f"{name}: frames kept", total - lost, total, "limit: frames sent", "frames"),
    ]


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows(float(sys.argv[1]) if len(sys.argv) > 1 else 20.0))
