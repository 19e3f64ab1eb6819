"""The short form of the soak test: a dozen runs with faults, drawn by a seed."""

import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
CODE = """
from benchmarks.soak import soak
verdicts = soak(12, 20261122)
assert len(verdicts) == 12
bad = [verdict for verdict in verdicts if verdict.problems]
assert not bad, bad
assert {"completed", "stopped safe"} <= {verdict.outcome for verdict in verdicts}, verdicts
"""


def test_a_dozen_runs_with_faults_end_well_or_stop_safe_with_the_truth_in_the_record():
    """In a process of its own: it patches the host's clock and disk."""
    done = subprocess.run([sys.executable, "-c", CODE], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
