"""The five methods on plants of other physics than their models, beside what is attainable and the goals.

    python -m benchmarks off_class                 # the summary
    python -m benchmarks.off_class.thermal         # one method in full; also batch, heading, rlg, whirl,
                                                   # calibration

The plants in the files that begin with an underscore share no formula with `bench/analysis` or `simulators`.
"""

from __future__ import annotations

from collections.abc import Iterator
from importlib import import_module

from benchmarks._measure import Row

METHODS = ("thermal", "heading", "rlg", "whirl", "calibration")


def rows() -> Iterator[Row]:
    """Return the figures of every method, one after the other."""
    for method in METHODS:
        yield from import_module(f"benchmarks.off_class.{method}").rows()
