"""The list of guards is kept with the code: what it switches off is there once, and so is its guard."""

import ast
import re
from pathlib import Path

import pytest

from benchmarks.guards import MECHANISMS

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("each", MECHANISMS, ids=lambda each: each.name)
def test_what_a_guard_watches_and_the_guard_itself_are_there(each):
    text = (ROOT / each.file).read_text(encoding="utf-8")
    assert text.count(each.on) == 1, (each.file, each.on)
    ast.parse(text.replace(each.on, each.off))
    path, _, test = each.guard.split()[0].partition("::")
    tests = re.findall(r"^def (test_\w+)", (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE)
    assert tests and (not test or test in tests), (path, test)


def test_names_are_there_once():
    names = [each.name for each in MECHANISMS]
    assert len(set(names)) == len(names)
