"""Branch coverage of the rooms, from what `make coverage` has gathered, into benchmarks/reliability.md."""

from __future__ import annotations

import io
import sys

import coverage

from benchmarks._sections import write_section

_ROOMS = ("drivers", "bench", "simulators")
_WANTED_PERCENT = 90.0


def main() -> int:
    """Write the section; 1 if a room has less than is wanted."""
    data = coverage.Coverage()
    data.load()
    lines = ["| room | statements and branches covered | wanted |", "|---|---|---|"]
    found = []
    for room in _ROOMS:
        found.append(data.report(include=[f"*/{room}/*"], file=io.StringIO(), ignore_errors=True))
        lines.append(f"| `{room}` | {found[-1]:.1f} % | {_WANTED_PERCENT:g} % |")
    print(write_section("Branch coverage", "make coverage", lines))
    return 1 if min(found) < _WANTED_PERCENT else 0


if __name__ == "__main__":
    sys.exit(main())
