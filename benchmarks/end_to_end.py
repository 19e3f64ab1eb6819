"""A cold-shock run through the emulated bench in virtual time: one gyro at 100 Hz in 36-byte frames over a pty,
chamber and table polled every second, recorded, decoded to Parquet, sealed; and a day's campaign with two gyros.

    python -m benchmarks end_to_end

Yardsticks in the same process: the same bytes through a pty, read in blocks and dropped (the limit); those with
the questions and answers of chamber and table, one at a time, nothing computed; and the bytes read frame by frame
with pyserial and `struct` (what people write).
"""

from __future__ import annotations

import dataclasses
import os
import socket
import statistics
import struct
import tempfile
import threading
import tty
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import serial

from bench.campaign import load_campaign, rehearse_campaign
from bench.control.procedure import find_procedure
from bench.control.questions import EmulatedOperator
from bench.control.run_record import RunRecord
from bench.control.runner import RunRequest, run_procedure
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import BenchFile, load_bench_file
from benchmarks._measure import Pair, Row, all_cpu_s, figure, row, usual
from drivers.base.clock import host_seconds
from drivers.base.virtual_clock import share_cpu

REPEATS = 3
FRAME_BYTES = 36
RATE_HZ = 100
PROCEDURE = "zero-bias-cold-shock"
_DAY = """
title = "A day of cold shocks"
[[run]]
name = "shock"
procedure = "zero-bias-cold-shock"
repeats = 8
parameters = { soak_min = 20, hold_min = 15, east_after_min = 10, east_dwell_s = 300, warm_up_min = 40 }
"""
THREE_HOURS = {"soak_min": 20, "hold_min": 15, "east_after_min": 10, "east_dwell_s": 300, "warm_up_min": 40}


@dataclass(frozen=True)
class Timing:
    """One run: bench time, wall seconds of driving it and of decoding and sealing it, processor time of all."""

    bench_s: float
    start_s: float
    drive_s: float
    close_s: float
    cpu_s: float

    @property
    def speed(self) -> float:
        """Bench seconds a wall second, everything but the lab's start-up."""
        return self.bench_s / (self.drive_s + self.close_s)


def bench_file() -> BenchFile:
    """Return the demo's bench with its serial gyro alone, at 100 Hz."""
    file = load_bench_file(Path(__file__).parents[1] / "examples" / "demo.toml")
    gyro = dataclasses.replace(file.gyro[0], rate_hz=float(RATE_HZ))
    chamber = dataclasses.replace(file.chamber, auxiliary={1: "fog_1 case"})
    return file.model_copy(update={"gyro": (gyro,), "chamber": chamber})


def run_once() -> Timing:
    """Rehearse one run and time its parts."""
    procedure = find_procedure(PROCEDURE)
    file, plant = bench_file(), Plant()
    marks: list[float] = []
    close = RunRecord.close

    def timed_close(record: RunRecord, *ending: Any) -> Any:
        marks.append(host_seconds())
        return close(record, *ending)

    RunRecord.close = timed_close  # type: ignore[method-assign, assignment]  # the only seam of driving and sealing
    try:
        with tempfile.TemporaryDirectory() as folder:
            begin, cpu_s = host_seconds(), all_cpu_s()
            with EmulatedLab(file, plant) as lab:
                ready = host_seconds()
                request = RunRequest(
                    procedure,
                    procedure.parse(THREE_HOURS),
                    lab.file,
                    Path(folder),
                    EmulatedOperator(lab.perform),
                )
                result = run_procedure(request)
                end = host_seconds()
    finally:
        RunRecord.close = close  # type: ignore[method-assign]
    assert result.outcome == "completed", result.reason
    cpu_s = all_cpu_s() - cpu_s  # the lab has ended
    return Timing(result.duration_s, ready - begin, marks[0] - ready, end - marks[0], cpu_s)


def side_by_side() -> tuple[int, float]:
    """Return how many runs were rehearsed at once, one a processor, and their bench s a wall s together."""
    count = len(os.sched_getaffinity(0))
    with ProcessPoolExecutor(count, mp_context=get_context("spawn")) as pool:
        for _ in pool.map(abs, range(count)):  # starting the interpreters is not what is timed
            pass
        begin = host_seconds()
        timings = [task.result() for task in [pool.submit(run_once) for _ in range(count)]]
        elapsed = host_seconds() - begin
    return count, sum(timing.bench_s for timing in timings) / elapsed


def campaign_day(folder: Path) -> tuple[float, float]:
    """Rehearse a day of chamber, table and two gyros at 100 Hz, a lab a processor; return bench and wall s."""
    file = bench_file()
    other: dict[str, Any] = {"name": "fog_2", "port": "/dev/ttyUSB9", "unit": "FOG-002", "case_sensor": None}
    second = dataclasses.replace(file.gyro[0], **other)
    file = file.model_copy(update={"gyro": (file.gyro[0], second)})
    plan = folder / "campaign.toml"
    plan.write_text(_DAY, encoding="utf-8")
    campaign = load_campaign(plan, file)
    begin = host_seconds()
    results = rehearse_campaign(campaign, file, Plant(), folder / "runs", jobs=len(os.sched_getaffinity(0)))
    wall_s = host_seconds() - begin
    for name, result in results.items():
        assert result.outcome == "completed", f"{name}: {result.reason}"
    return sum(result.duration_s for result in results.values()), wall_s


def pty_limit(n_bytes: int) -> float:
    """Return wall seconds to move `n_bytes` through a pty in blocks."""
    return _through_pty(n_bytes, 65536, _read_blocks)


def ports_limit(seconds: int) -> float:
    """Return wall seconds of a run's system calls alone, in one process, for `seconds` of bench time.

    Each second two questions over TCP and one over a pty, with their answers; every four the gyro's blocks.
    On one processor, as the run.
    """
    block = bytes(RATE_HZ * FRAME_BYTES)  # of a second: a pty holds 4096 bytes
    listener = socket.create_server(("127.0.0.1", 0))
    near = socket.create_connection(listener.getsockname())
    far, _ = listener.accept()
    ptys = [os.openpty() for _ in range(2)]
    for _, slave in ptys:
        tty.setraw(slave)
    table, gyro = ptys
    asked = ((near.fileno(), far.fileno()), (near.fileno(), far.fileno()), (table[1], table[0]))
    question, answer = bytes(24), bytes(40)
    processors = share_cpu(min(os.sched_getaffinity(0)))
    begin = host_seconds()
    for second in range(seconds):
        for bench, device in asked:
            os.write(bench, question)
            os.read(device, 4096)
            os.write(device, answer)
            os.read(bench, 4096)
        for _ in range(0 if second % 4 else 4):
            sent = os.write(gyro[0], block)
            while sent > 0:
                sent -= len(os.read(gyro[1], 65536))
    elapsed = host_seconds() - begin
    os.sched_setaffinity(0, processors)
    for connection in (listener, near, far):
        connection.close()
    for descriptor in (*table, *gyro):
        os.close(descriptor)
    return elapsed


def frame_loop(n_bytes: int) -> float:
    """Return wall seconds to read `n_bytes` frame by frame with pyserial and unpack each."""
    return _through_pty(n_bytes, 65536, _read_frames)


def _through_pty(n_bytes: int, block: int, read: Callable[[serial.Serial, int], None]) -> float:
    master, slave = os.openpty()
    tty.setraw(slave)
    port = serial.Serial(os.ttyname(slave), timeout=5.0)
    payload = bytes(range(FRAME_BYTES)) * (block // FRAME_BYTES)

    def feed() -> None:
        sent = 0
        while sent < n_bytes:
            sent += os.write(master, payload[: min(len(payload), n_bytes - sent)])

    thread = threading.Thread(target=feed)
    begin = host_seconds()
    thread.start()
    read(port, n_bytes)
    elapsed = host_seconds() - begin
    thread.join()
    port.close()
    os.close(master)
    os.close(slave)
    return elapsed


def _cpu_s(work: Callable[[], object]) -> float:
    begin = all_cpu_s()
    work()
    return all_cpu_s() - begin


def _read_blocks(port: serial.Serial, n_bytes: int) -> None:
    got = 0
    while got < n_bytes:
        got += len(os.read(port.fileno(), 65536))


def _read_frames(port: serial.Serial, n_bytes: int) -> None:
    unpack = struct.Struct(">4s6fBBhI").unpack
    for _ in range(n_bytes // FRAME_BYTES):
        unpack(port.read(FRAME_BYTES))


def rows() -> Iterator[Row]:
    """Yield one run, runs side by side, and a campaign of a day."""
    repeats = usual(REPEATS, 1)
    timings = [run_once() for _ in range(repeats)]
    middle = sorted(timings, key=lambda timing: timing.speed)[repeats // 2]
    n_bytes = round(middle.bench_s) * RATE_HZ * FRAME_BYTES
    limit = middle.bench_s / statistics.median(pty_limit(n_bytes) for _ in range(repeats))
    loop = middle.bench_s / 10.0 / statistics.median(frame_loop(n_bytes // 10) for _ in range(repeats))
    print(
        f"lab start {middle.start_s:.2f} s, driving {middle.drive_s:.2f} s, decoding and sealing "
        f"{middle.close_s:.2f} s, {middle.bench_s:.0f} s of bench time: {middle.speed:,.0f} x real time"
    )
    name, unit = f"{middle.bench_s / 3600:.1f} h emulated run, a gyro at 100 Hz", "x real time"
    yield figure(name, middle.speed, limit, "limit: gyro bytes through a pty and dropped", unit)
    calls = middle.bench_s / statistics.median(ports_limit(round(middle.bench_s)) for _ in range(repeats))
    yield figure(
        name, middle.speed, calls, "limit: its questions and blocks through ports, nothing computed", unit
    )
    yield figure(name, middle.speed, loop, "pyserial read(36) + struct loop, gyro bytes only", unit)
    yield figure(name, middle.speed, 5000.0, "goal", unit)
    loops = [_cpu_s(lambda: frame_loop(n_bytes // 10)) * 10.0 for _ in range(repeats)]
    cpu_s, loop_s = statistics.median(timing.cpu_s for timing in timings), statistics.median(loops)
    pair = Pair(cpu_s, loop_s, loop_s / cpu_s)
    yield row(
        f"{name}, processor time of bench and lab", pair, "pyserial read(36) + struct loop of its bytes"
    )
    count, together = side_by_side()
    yield figure(f"{count} of them side by side, all imports included", together, 9000.0, "goal", unit)
    with tempfile.TemporaryDirectory(prefix="gyrobench-day-") as folder:
        bench_s, wall_s = campaign_day(Path(folder))
    name = f"campaign of {bench_s / 3600.0:.1f} h, chamber, table, two gyros at 100 Hz, {count} processors"
    yield figure(f"{name}, a day of it", 86_400.0 * wall_s / bench_s, 15.0, "goal", "s", least=True)
    both = 2 * round(bench_s) * RATE_HZ * FRAME_BYTES
    limit_s = pty_limit(both)
    yield figure(
        name, wall_s, limit_s, "limit: bytes of both gyros through a pty, one processor", "s", least=True
    )


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows())
