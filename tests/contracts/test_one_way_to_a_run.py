"""A run is read through `Run`: nobody beside it puts a path in a run's folder together."""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
WRITERS = ("bench/record", "bench/control", "bench/lab/emulated.py")
"""Who makes run folders and may know what lies where in them."""
LIVE = ("bench/present/panel",)
"""Who watches folders in which a run is still being written."""
SOURCES = [path for room in ("bench", "procedures") for path in sorted((ROOT / room).rglob("*.py"))]
NAMES = ("MANIFEST_FILE", "EVENTS_FILE", "RAW_FOLDER")
PRIVATE = re.compile(r"(\brun|Run\.open\(.*\))\._(folder|url)$")
FILES = re.compile(r"\.parquet$|^raw(/|$)|^truth_|^manifest\.json$|^events\.jsonl$")


def reached_into(tree: ast.AST) -> Iterator[str]:
    """Yield what names a file of a run in path arithmetic."""
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Div):
            texts = [part.value for part in ast.walk(node.right) if isinstance(part, ast.Constant)]
            named = isinstance(node.right, ast.Name) and node.right.id in NAMES
            if named or any(isinstance(text, str) and FILES.search(text) for text in texts):
                yield ast.unparse(node)
        elif isinstance(node, ast.Attribute) and PRIVATE.search(ast.unparse(node)):
            yield ast.unparse(node)


def test_no_path_into_a_run_beside_the_record() -> None:
    wrong = [
        f"{path.relative_to(ROOT)}: {text}"
        for path in SOURCES
        if not path.relative_to(ROOT).as_posix().startswith(WRITERS + LIVE)
        for text in reached_into(ast.parse(path.read_text(encoding="utf-8")))
    ]
    assert wrong == []


@pytest.mark.parametrize(
    "code",
    [
        "run.place / 'chamber.parquet'",
        "folder / f'truth_{gyro}.npz'",
        "folder / 'raw' / f'{gyro}.idx'",
        "folder / f'gyro_{name}.parquet'",
        "(folder / MANIFEST_FILE).exists()",
        "run._folder",
        "Run.open(place)._folder",
    ],
)
def test_the_check_finds(code: str) -> None:
    assert list(reached_into(ast.parse(code)))
