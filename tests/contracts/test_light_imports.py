"""What takes long to import is imported by who needs it: no command waits for a library that it does not use."""

import subprocess
import sys

import pytest


@pytest.mark.parametrize(
    ("modules", "heavy"),
    [
        ("gyrobench, bench.present.cli._app", "numpy scipy pandas pyarrow torch pydantic rich matplotlib"),
        ("bench.lab.rehearsal, simulators.lab.in_process", "scipy pandas torch matplotlib"),
        ("bench.record.exchange", "scipy pandas torch matplotlib"),
        ("bench.analysis.figures, bench.present.report", "scipy pandas torch matplotlib"),
        ("simulators.exam", "scipy.stats scipy.signal pandas torch matplotlib"),
        ("bench.analysis.heading", "scipy.stats scipy.signal pandas torch matplotlib"),
    ],
)
def test_importing_loads_nothing_heavy(modules: str, heavy: str) -> None:
    code = f"import sys, {modules}; print([name for name in {heavy.split()} if name in sys.modules])"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
