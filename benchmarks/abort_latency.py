"""From the signal to the stop commands on both ports: a run on the wall clock against an emulated lab.

Run as `python -m benchmarks abort_latency`. A run is stopped by SIGINT at random moments; the signal is stamped
on the run's own clock just before it is sent, the bytes when they are handed to the port (raw/<port>.sent.idx).
The yardstick is the 50 ms that the bench promises.
"""

from __future__ import annotations

import os
import random
import signal
import statistics
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench.benchfile import load_bench_file
from bench.emulated import EmulatedLab, Plant
from bench.procedure import Demands, Parameters, Procedure
from bench.questions import AssumeYes
from bench.recording import read_exchanges
from bench.runner import RunRequest, run_procedure
from bench.session import Bench
from drivers.clock import Clock, WallClock

_RUNS = 9
_PROMISED_MS = 50.0
_COMMANDS = (
    ("table", "table stop", b":mode:off 1\r\n"),
    ("chamber", "chamber stop", b"14001\xb61\xb61\xb60\r"),
    ("chamber", "chamber safe set point", b"11001\xb61\xb61\xb625.0\r"),
)


def _request(lab: EmulatedLab, runs: Path, stamps: list[float], delay_s: float) -> RunRequest:
    def run(bench: Bench, _: Parameters) -> None:
        bench.table.device.servo_on()
        bench.chamber.go_to(0.0)
        bench.chamber.start()
        bench.table.spin(10.0)
        threading.Thread(target=_press, args=(bench.clock, delay_s, stamps), daemon=True).start()
        bench.wait(30.0, "turning")

    procedure = Procedure("turn", "A turn", "", Parameters, run, lambda _: 30.0, lambda _: Demands(10.0, 0.0))
    return RunRequest(procedure, Parameters(), lab.file, runs, AssumeYes())


def _press(clock: Clock, delay_s: float, stamps: list[float]) -> None:
    waiting = WallClock()
    waiting.sleep(delay_s)
    waiting.close()
    stamps.append(clock.now())
    os.kill(os.getpid(), signal.SIGINT)


def _latencies_ms(folder: Path, stamp_s: float) -> Iterator[float]:
    for port, _, command in _COMMANDS:
        sent = [t for t, way, data in read_exchanges(folder, port) if way == "sent" and data == command]
        yield next(1e3 * (t / 1e9 - stamp_s) for t in sent if t / 1e9 >= stamp_s)


def rows() -> list[dict[str, Any]]:
    """Return median and worst latency of each command over the runs."""
    file = load_bench_file(Path(__file__).parents[1] / "examples" / "demo.toml")
    moments = random.Random(1)
    found: list[tuple[float, ...]] = []
    with tempfile.TemporaryDirectory() as runs, EmulatedLab(file, Plant(), clock="wall") as lab:
        for _ in range(_RUNS):
            stamps: list[float] = []
            result = run_procedure(_request(lab, Path(runs), stamps, moments.uniform(0.2, 1.5)))
            found.append(tuple(_latencies_ms(result.folder, stamps[0])))
    table = []
    for (_, name, _), values in zip(_COMMANDS, zip(*found, strict=True), strict=True):
        for kind, value in (("median", statistics.median(values)), ("worst", max(values))):
            table.append(
                {
                    "benchmark": f"signal to {name}, {kind} of {_RUNS}",
                    "ours": value,
                    "yardstick": _PROMISED_MS,
                    "yardstick_name": "the promise",
                    "unit": "ms",
                    "ratio": value / _PROMISED_MS,
                }
            )
    return table
