"""Start-up against its limits: `gyrobench --help` and `import bench`."""

from __future__ import annotations

import statistics
import subprocess
import sys
from pathlib import Path

from drivers.clock import host_seconds

_TURNS = 5


def rows() -> list[dict[str, object]]:
    """Return the median of five against its limit, s."""
    python = sys.executable
    found = {
        "gyrobench --help": (_wall([str(Path(python).with_name("gyrobench")), "--help"]), 0.4),
        "import bench": (_wall([python, "-c", "import bench"]), 0.3),
    }
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
