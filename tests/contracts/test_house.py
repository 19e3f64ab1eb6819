"""The measures of the house: rooms of bench, sizes of functions and files, names that packages export."""

from __future__ import annotations

import ast
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PRODUCT = ("bench", "drivers", "procedures", "simulators")
MOST_ROOMS = 8
MOST_EXPORTED = 350
LONGEST_FUNCTION = 101
LONGEST_FILE = 407


LARGEST_BYTES = 400_000
TOP = {
    ".ci", ".gitignore", "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "Makefile", "README.md",
    "SECURITY.md", "bench", "benchmarks", "constraints.txt", "deploy", "docs", "drivers", "examples", "gyrobench",
    "procedures", "pyproject.toml", "simulators", "tests",
}  # fmt: skip
"""What the project has at its top; whatever else lies there is somebody's download or a run."""


def sources() -> list[Path]:
    return [path for room in PRODUCT for path in sorted((ROOT / room).rglob("*.py"))]


def exported(package: Path) -> list[str]:
    for node in ast.parse(package.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and any(ast.unparse(name) == "__all__" for name in node.targets):
            return list(ast.literal_eval(node.value))
    return []


def test_nothing_but_the_project_is_kept() -> None:
    """Every clone pays for a file for good: packages, records and downloads are not of the project."""
    if not (ROOT / ".git").exists():
        pytest.skip("no git checkout: an archive says nothing of what is kept")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True)
    kept = [name for name in listed.stdout.split("\0") if name and (ROOT / name).exists()]
    assert {name.split("/")[0] for name in kept} <= TOP
    large = {
        name: (ROOT / name).stat().st_size for name in kept if (ROOT / name).stat().st_size > LARGEST_BYTES
    }
    assert large == {}


def test_bench_is_a_few_rooms_without_loose_modules() -> None:
    rooms = [path for path in (ROOT / "bench").iterdir() if (path / "__init__.py").exists()]
    assert len(rooms) <= MOST_ROOMS
    assert [path.name for path in (ROOT / "bench").glob("*.py")] == ["__init__.py"]


def test_packages_of_bench_export_few_names() -> None:
    count = {
        str(path.parent.relative_to(ROOT)): len(exported(path))
        for path in (ROOT / "bench").rglob("__init__.py")
    }
    assert sum(count.values()) <= MOST_EXPORTED, count


def test_a_function_fits_on_two_screens_and_a_file_in_one_sitting() -> None:
    long = []
    for path in sources():
        text = path.read_text(encoding="utf-8")
        if len(text.splitlines()) > LONGEST_FILE:
            long.append(f"{path.relative_to(ROOT)}: {len(text.splitlines())} lines")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
                lines = (node.end_lineno or 0) - node.lineno + 1
                if lines > LONGEST_FUNCTION:
                    long.append(f"{path.relative_to(ROOT)}: {node.name}: {lines} lines")
    assert long == []
