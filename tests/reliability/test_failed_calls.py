"""The short form of failing calls: every fortieth call of a run and of a recovery fails once."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.failed_calls import library

pytestmark = [pytest.mark.concurrent, pytest.mark.slow]

ROOT = Path(__file__).parents[2]
CODE = """
from benchmarks.failed_calls import failed_calls
tallies = failed_calls(4, 20261126, every=40)
assert [text for tally in tallies.values() for text in tally.problems] == []
ends = {end for tally in tallies.values() for end in tally.ends}
assert {"completed", "aborted", "aborted, recovered"} <= ends, ends
"""


def test_no_failed_call_makes_a_run_lie_about_its_record(tmp_path):
    """In a process of its own: it forks, with the calls preloaded."""
    calls = library(tmp_path)
    if calls is None:
        pytest.skip("this takes Linux and a C compiler")
    environment = os.environ | {"LD_PRELOAD": str(calls)}
    command = [sys.executable, "-c", CODE]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
