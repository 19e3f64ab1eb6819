"""The short form of the kill test: a dozen SIGKILLs in recording, closing and saving a fit."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = [pytest.mark.concurrent, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
CODE = """
from benchmarks.reliability import kill_test
tally = kill_test(12, 20261122)
assert tally.kills == 12, tally
assert (tally.unreadable, tally.false_complete) == (0, 0), tally
"""


def test_a_dozen_kills_cost_no_folder_and_make_no_run_look_complete():
    """In a process of its own: it forks. Bytes lost beyond the interval are counted by the benchmark: time on a
    loaded machine is no test.
    """
    done = subprocess.run([sys.executable, "-c", CODE], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
