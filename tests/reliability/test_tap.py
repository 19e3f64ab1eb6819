"""The short form of kills seen from the wire: each kind once. How soon is asked by the long form only."""

from pathlib import Path

import pytest

from benchmarks.tap.__main__ import make_trials
from benchmarks.tap._deeds import DEEDS

pytestmark = [
    pytest.mark.concurrent,
    pytest.mark.slow,
    pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="without /proc no watchdog is found"),
]


def test_whoever_is_lost_the_bench_is_stopped_and_the_record_true():
    tallies = make_trials(len(DEEDS), 20261127, 3)
    assert [problem for tally in tallies.values() for problem in tally.problems] == []
    assert all(tally.trials == 1 for tally in tallies.values())
    assert (
        sum(len(tally.rest_s) for tally in tallies.values()) >= 7
    )  # the rest was struck before anything moved
