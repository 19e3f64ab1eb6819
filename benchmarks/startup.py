"""Start-up against its limits: `gyrobench --help`, `import bench`, an emulated bench of the pytest plug-in."""

from __future__ import annotations

import statistics
import subprocess
import sys
from pathlib import Path

from bench.emulated import Plant
from bench.testing import LabPool, usual_bench
from drivers.clock import host_seconds

_TURNS = 5


def rows() -> list[dict[str, object]]:
    """Return the median of five against its limit, s."""
    python = sys.executable
    found = {
        "gyrobench --help": (_wall([str(Path(python).with_name("gyrobench")), "--help"]), 0.4),
        "import bench": (_wall([python, "-c", "import bench"]), 0.3),
    }
    ready_s, gone_s = _bench_ready()
    found["emulated_bench, ready, median of 9 after the first"] = (ready_s, 1.0)
    found["emulated_bench, gone again"] = (gone_s, 1.0)
    return [
        {
            "benchmark": name,
            "ours": seconds,
            "yardstick": limit,
            "yardstick_name": "limit of the design",
            "unit": "s",
            "ratio": limit / seconds,
        }
        for name, (seconds, limit) in found.items()
    ]


def _bench_ready() -> tuple[float, float]:
    """Return the median times to a lab that answers and to its end, of nine after the first, s."""
    ready, gone = [], []
    with LabPool(usual_bench(None)) as pool:
        for _ in range(10):
            begin = host_seconds()
            with pool.lab(Plant()):
                there = host_seconds()
            ready.append(there - begin)
            gone.append(host_seconds() - there)
    return statistics.median(ready[1:]), statistics.median(gone[1:])


def _wall(command: list[str]) -> float:
    times = []
    for _ in range(_TURNS):
        begin = host_seconds()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        times.append(host_seconds() - begin)
    return statistics.median(times)


if __name__ == "__main__":
    from benchmarks.__main__ import show

    show(rows())
