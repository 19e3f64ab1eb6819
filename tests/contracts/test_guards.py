"""The list of guards is kept with the code: what it switches off is there once, and so is its guard."""

import ast
import re

import pytest

from benchmarks._trial import ROOT
from benchmarks.guards import MECHANISMS, Also, Argument, Mechanism, Skip, Value, always, never


@pytest.mark.parametrize("mechanism", MECHANISMS, ids=lambda mechanism: mechanism.name)
def test_what_a_guard_watches_and_the_guard_itself_are_there_once(mechanism):
    text = (ROOT / mechanism.file).read_text(encoding="utf-8")
    assert mechanism.switched_off(text) != ast.unparse(ast.parse(text))
    path, _, test = mechanism.guard.split()[0].partition("::")
    tests = re.findall(r"^def (test_\w+)", (ROOT / path).read_text(encoding="utf-8"), re.MULTILINE)
    assert tests and (not test or test in tests), (path, test)


def test_names_are_there_once():
    names = [mechanism.name for mechanism in MECHANISMS]
    assert len(set(names)) == len(names)


SOURCE = """
LIMIT = 3.0

class Door:
    width: int = 2

    async def open(self, far):
        if (far
                > LIMIT):  # written over two lines
            self.bell.ring(far)
        return turn(far, slowly=True)

def shut(door):
    return door.width
"""


@pytest.mark.parametrize(
    ("place", "change", "line"),
    [
        ("m:Door.open", never("far > LIMIT"), "if False:"),
        ("m:Door.open", always("far>LIMIT"), "if True:"),
        ("m:Door.open", Skip("self.bell.ring"), "pass"),
        ("m:Door.open", Argument("slowly", "False"), "return turn(far, slowly=False)"),
        ("m:LIMIT", Value("9"), "LIMIT = 9"),
        ("m:Door.width", Value("0"), "width: int = 0"),
        ("m:shut", Value("None"), "return None"),
        ("m", Also("import pickle"), "import pickle"),
    ],
)
def test_what_is_switched_off_is_found_however_it_is_written(place, change, line):
    text = Mechanism(1, "m", place, change, "").switched_off(SOURCE)
    assert [each.strip() for each in text.splitlines()].count(line) == 1
    assert len(set(text.splitlines()) - set(ast.unparse(ast.parse(SOURCE)).splitlines())) == 1


@pytest.mark.parametrize(
    ("place", "change"),
    [("m:Door.close", Value("None")), ("m:shut", never("far > LIMIT")), ("m:Door.open", always("far"))],
)
def test_what_is_not_there_exactly_once_is_an_error(place, change):
    with pytest.raises(ValueError, match="times"):
        Mechanism(1, "m", place, change, "").switched_off(SOURCE)
