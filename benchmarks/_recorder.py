"""A run on an emulated lab that records in blocks: a line on standard input has it record so many seconds more.

Usage: python -m benchmarks._recorder RUNS_FOLDER. Each block is answered with a line of JSON: frames recorded,
host seconds, and processor seconds of the thread that writes the live files (`live_s`) and of all other threads
of this process (`record_s`), which drive the bench and record; the lab is a process of its own. In virtual time a
block has the same frames however slow the machine is, while live files are written ten times a host second.
"""

from __future__ import annotations

import json
import sys
import threading
from pathlib import Path
from time import process_time

from bench.control.live import Live
from bench.control.procedure import Demands, Parameters, Procedure
from bench.control.questions import EmulatedOperator
from bench.control.runner import RunRequest, run_procedure
from bench.control.session import Bench
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import load_bench_file
from drivers.base.clock import host_seconds

_BENCH = Path(__file__).parents[1] / "examples" / "lab.toml"


def _live_s() -> float:
    thread = next(running for running in threading.enumerate() if running.name == "live files")
    return 1e-9 * int(Path(f"/proc/self/task/{thread.native_id}/schedstat").read_text().split()[0])


def _frames(bench: Bench) -> int:
    for gyro in bench.gyros.values():
        gyro.update()
    return sum(gyro.frames for gyro in bench.gyros.values())


def _blocks(bench: Bench, _: Parameters) -> None:
    for line in sys.stdin:
        frames, host_s, live_s, cpu_s = _frames(bench), host_seconds(), _live_s(), process_time()
        bench.wait(float(line), "recording a block")
        live_s, cpu_s = _live_s() - live_s, process_time() - cpu_s
        found = {"record_s": cpu_s - live_s, "live_s": live_s, "host_s": host_seconds() - host_s}
        sys.stdout.write(json.dumps(found | {"frames": _frames(bench) - frames}) + "\n")
        sys.stdout.flush()


PROCEDURE = Procedure(
    name="blocks",
    title="Blocks",
    source="benchmarks",
    parameters=Parameters,
    run=_blocks,
    expected_duration_s=lambda _: 86_400.0,
    demands=lambda _: Demands(),
)


def main(runs: Path) -> None:
    """Record until standard input ends."""
    file = load_bench_file(_BENCH)
    with EmulatedLab(file, Plant()) as lab, Live() as live:
        operator = EmulatedOperator(lab.perform)
        request = RunRequest(PROCEDURE, Parameters(), lab.file, runs, operator, run_id="blocks", live=live)
        result = run_procedure(request)
    if result.outcome != "completed":
        raise SystemExit(f"{result.outcome}: {result.reason}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
