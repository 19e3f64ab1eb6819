"""The tests with threads, processes, terminals and locks, again and again: not one may fail once in a while.

Run as `python -m benchmarks.repeats [TIMES [SLOW_TIMES]]`, or `make repeats`; writes its section of
benchmarks/reliability.md and fails if a test failed. Which tests is said by the mark `concurrent`, which
tests/contracts keeps complete. Those that are also `slow` (whole processes of gyrobench, a browser, a
cluster) are repeated SLOW_TIMES, a tenth of TIMES if that is left out. One pytest process repeats the files
of a batch, each time in an order drawn anew.
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
_MARK = "pytest.mark.concurrent"
QUICK, SLOW = "concurrent and not slow", "concurrent and slow"
_BATCH = 10


def files() -> list[str]:
    """Return the files that hold concurrent tests."""
    found = sorted((ROOT / "tests").rglob("test_*.py"))
    return [str(path.relative_to(ROOT)) for path in found if _MARK in path.read_text(encoding="utf-8")]


def repeat(mark: str, times: int) -> tuple[int, Counter[str]]:
    """Return how many tests passed, and how often each test failed, by its name."""
    tests = files()
    passed, failed, draw = 0, Counter[str](), random.Random(times)
    for done in range(0, times, _BATCH):
        drawn = [file for _ in range(min(_BATCH, times - done)) for file in draw.sample(tests, len(tests))]
        found = _pytest("-p", "no:cacheprovider", "--keep-duplicates", "-m", mark, *drawn)
        names = re.findall(r"^(?:FAILED|ERROR) (\S+)", found.stdout, re.MULTILINE)
        failed.update(names)
        if names:
            print(found.stdout[-6000:], flush=True)
        counted = re.search(r"(\d+) passed", found.stdout)
        passed += int(counted[1]) if counted else 0
        if counted is None:
            failed["pytest itself: " + found.stdout[-300:] + found.stderr[-300:]] += 1
        done = min(done + _BATCH, times)
        print(f"{mark}, {done} of {times}: {passed} passed, {failed.total()} failed", flush=True)
    return passed, failed


def _pytest(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "pytest", *words], cwd=ROOT, capture_output=True, text=True, check=False
    )


def main() -> int:
    """Repeat and write the section; 1 if a test failed."""
    times = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    slow_times = int(sys.argv[2]) if len(sys.argv) > 2 else -(-times // 10)
    lines = [f"In {len(files())} files.", "", "| tests | times | passed | failed |", "|---|---|---|---|"]
    failures = Counter[str]()
    for mark, count in ((QUICK, times), (SLOW, slow_times)):
        if count:
            passed, failed = repeat(mark, count)
            failures += failed
            lines.append(f"| `-m '{mark}'` | {count} | {passed:,} | {failed.total()} |")
    lines += ["", *(f"- `{name}`: {count}" for name, count in failures.most_common())]
    print(write_section("Repeats", f"python -m benchmarks.repeats {times} {slow_times}", lines))
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
