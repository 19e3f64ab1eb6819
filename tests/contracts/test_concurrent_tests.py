"""Which tests are concurrent is said by a mark, and no file that starts threads or processes lacks it."""

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

TESTS = Path(__file__).parents[1]
MODULES = {"threading", "multiprocessing", "concurrent", "tests.ptys"}
CALLS = {"subprocess.Popen", "os.fork", "os.openpty", "pty.openpty", "os.kill", "signal.pidfd_send_signal"}
NAMES = {"WallClock", "take_lease", "fan_out"}
WITHOUT = {
    "benchmarks/test_site.py": "its process is one call after which nothing runs",
    "campaign/conftest.py": "its processes are started by tests that have the mark",
    "present/panel/browser.py": "its panel is started by tests that have the mark",
    "record/recording/test_recover.py": "takes a lease in the test's own thread",
}


def concurrency(tree: ast.AST) -> Iterator[str]:
    """Yield what threads, processes, terminals, locks or the host's clock are used by."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (each.name for each in node.names if each.name.split(".")[0] in MODULES)
        elif isinstance(node, ast.ImportFrom):
            if node.module in MODULES or (node.module or "").split(".")[0] in MODULES:
                yield str(node.module)
            yield from (each.name for each in node.names if each.name in NAMES)
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            if (name := f"{node.value.id}.{node.attr}") in CALLS:
                yield name
        elif isinstance(node, ast.keyword) and node.arg == "clock" and ast.unparse(node.value) == "'wall'":
            yield "clock='wall'"


def test_every_file_of_concurrent_tests_has_the_mark() -> None:
    without = set()
    for path in sorted(TESTS.rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if "pytest.mark.concurrent" not in text and any(concurrency(ast.parse(text))):
            without.add(str(path.relative_to(TESTS)))
    assert without == WITHOUT.keys()


@pytest.mark.parametrize(
    "code",
    [
        "import threading",
        "from multiprocessing import Pool",
        "import subprocess\nsubprocess.Popen(['x'])",
        "import pty\npty.openpty()",
        "EmulatedLab(file, clock='wall')",
        "from tests.ptys import read_exactly",
    ],
)
def test_the_check_finds(code: str) -> None:
    assert list(concurrency(ast.parse(code)))
