"""The tests with threads, processes, terminals and locks, again and again: not one may fail once in a while.

Run as `python -m benchmarks.repeats [TIMES]`, or `make repeats`; writes its section of benchmarks/reliability.md
and fails if a test failed. One pytest process repeats the files of a batch, each time in an order drawn anew.
"""

from __future__ import annotations

import random
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

from benchmarks._sections import write_section

ROOT = Path(__file__).parents[1]
TESTS = (
    "tests/bench/test_lease.py",
    "tests/bench/test_stream_loss.py",
    "tests/drivers/test_clock.py",
    "tests/drivers/test_link.py",
    "tests/drivers/test_slcan_bus.py",
    "tests/live/test_live.py",
    "tests/recording/test_journal.py",
    "tests/safety/test_starved_runner.py",
)
_BATCH = 20


def repeat(times: int) -> tuple[int, Counter[str]]:
    """Return how many tests passed, and how often each test failed, by its name."""
    passed, failed, draw = 0, Counter[str](), random.Random(times)
    for done in range(0, times, _BATCH):
        files = [file for _ in range(min(_BATCH, times - done)) for file in draw.sample(TESTS, len(TESTS))]
        found = subprocess.run(
            [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--keep-duplicates", *files],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
        failed.update(re.findall(r"^(?:FAILED|ERROR) (\S+)", found.stdout, re.MULTILINE))
        counted = re.search(r"(\d+) passed", found.stdout)
        passed += int(counted[1]) if counted else 0
        if counted is None:
            failed["pytest itself: " + found.stdout[-300:] + found.stderr[-300:]] += 1
        print(f"{min(done + _BATCH, times)} of {times}: {passed} passed, {failed.total()} failed", flush=True)
    return passed, failed


def main() -> int:
    """Repeat and write the section; 1 if a test failed."""
    times = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    passed, failed = repeat(times)
    lines = [
        f"{len(TESTS)} files of tests with threads, processes, terminals and locks, {times} times: "
        f"{passed:,} passed, {failed.total()} failed.",
        "",
        *(f"- `{name}`: {count}" for name, count in failed.most_common()),
    ]
    print(write_section("Repeats", f"python -m benchmarks.repeats {times}", lines))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
