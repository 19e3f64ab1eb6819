"""Start-up against its limits and a bare Python: `python -m benchmarks startup`.

`gyrobench --help`, `import bench`, an emulated lab in a process of its own, labs of the pytest plug-in. Wall time
against the limit of the design; processor time, which other work hardly moves, against `python -c pass`.
"""

from __future__ import annotations

import os
import resource
import statistics
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from bench.lab.emulated import EmulatedLab, Plant
from bench.lab.testing import usual_bench
from benchmarks._measure import Row, figure, usual
from drivers.base.clock import host_seconds

_LIMIT = "limit of the design"


def rows() -> Iterator[Row]:
    """Yield the medians, s."""
    python = sys.executable
    turns = usual(9, 3)
    _, bare_s = _timed(_command([python, "-c", "pass"]), turns)
    for name, command, limit_s in (
        ("gyrobench --help", [str(Path(python).with_name("gyrobench")), "--help"], 0.4),
        ("import bench", [python, "-c", "import bench"], 0.3),
    ):
        wall_s, cpu_s = _timed(_command(command), turns)
        yield figure(name, wall_s, limit_s, _LIMIT, "s", least=True)
        yield figure(f"{name}, processor time", cpu_s, bare_s, "limit: python -c pass", "s", least=True)
    ready: list[float] = []
    _, cpu_s = _timed(lambda: _lab(ready), turns)
    name = "emulated lab in a process of its own"
    yield figure(f"{name}, ready", statistics.median(ready), 0.5, _LIMIT, "s", least=True)
    yield figure(
        f"{name}, processor time to its end", cpu_s, bare_s, "limit: python -c pass", "s", least=True
    )
    ready_s, gone_s = _bench_ready(turns)
    yield figure("emulated_bench of the pytest plug-in, ready", ready_s, 0.5, _LIMIT, "s", least=True)
    yield figure("emulated_bench of the pytest plug-in, gone again", gone_s, 0.5, _LIMIT, "s", least=True)


def _command(words: list[str]) -> Callable[[], object]:
    # What a user has: compiled files are kept, whatever this process was told.
    environment = {name: text for name, text in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    return lambda: subprocess.run(words, check=True, stdout=subprocess.DEVNULL, env=environment)


def _timed(work: Callable[[], object], turns: int) -> tuple[float, float]:
    """Return median wall time, and processor time of the processes that the work starts; once to warm up."""
    work()
    wall, cpu = [], []
    for _ in range(turns):
        before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), host_seconds()
        work()
        wall.append(host_seconds() - begin)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        cpu.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return statistics.median(wall), statistics.median(cpu)


def _lab(ready: list[float]) -> None:
    begin = host_seconds()
    with EmulatedLab(usual_bench(None), Plant(), apart=True):
        ready.append(host_seconds() - begin)


def _bench_ready(turns: int) -> tuple[float, float]:
    """Return the median times to a lab that answers and to its end, after a first one, s."""
    ready, gone = [], []
    for _ in range(turns + 1):
        begin = host_seconds()
        with EmulatedLab(usual_bench(None), Plant()):
            there = host_seconds()
        ready.append(there - begin)
        gone.append(host_seconds() - there)
    return statistics.median(ready[1:]), statistics.median(gone[1:])


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows())
