"""A procedure in a file of the user's own: found, named with its line where it cannot be used."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.control.procedure import find_procedure, read_procedure
from drivers.base.errors import ConfigurationError

WHOLE = """
from gyrobench import Demands, Parameters, Procedure, parameter
from helping_hand import WAIT_S

class Settings(Parameters):
    wait_s: float = parameter(WAIT_S, "how long", "s", gt=0)

MINE = Procedure("mine", "-", "-", Settings, lambda b, p: None, lambda p: p.wait_s, lambda p: Demands())
"""


def refused(path: Path) -> ConfigurationError:
    with pytest.raises(ConfigurationError) as wrong:
        read_procedure(str(path))
    return wrong.value


def test_the_one_procedure_is_found_with_modules_beside_the_file(tmp_path: Path) -> None:
    (tmp_path / "helping_hand.py").write_text("WAIT_S = 7.0\n")
    (tmp_path / "mine.py").write_text(WHOLE)
    found = read_procedure(str(tmp_path / "mine.py"))
    assert found.name == "mine" and found.text == WHOLE
    assert found.parse({}).model_dump() == {"wait_s": 7.0}


def test_two_and_none_are_refused_and_named(tmp_path: Path) -> None:
    (tmp_path / "helping_hand.py").write_text("WAIT_S = 7.0\n")
    two = tmp_path / "two.py"
    two.write_text(WHOLE + "from dataclasses import replace\nOTHER = replace(MINE, name='other')\n")
    error = refused(two)
    assert "more than one procedure" in error.what and error.found == "MINE, OTHER"
    two.write_text(WHOLE + "ALSO = MINE\n")
    assert read_procedure(str(two)).name == "mine"
    two.write_text("PROCEDURE = 'mine'\n")
    error = refused(two)
    assert "without a procedure" in error.what and "gyrobench new procedure" in error.remedy


@pytest.mark.parametrize(
    ("text", "line", "found"),
    [
        ("x = 1\nimport nothing_of_that_name\n", 2, "ModuleNotFoundError: No module named"),
        ("x = 1\n\nx = (\n", 3, "SyntaxError"),
        ("def f():\n    return 1 / 0\nf()\n", 2, "ZeroDivisionError"),
    ],
)
def test_a_mistake_is_told_with_its_line(tmp_path: Path, text: str, line: int, found: str) -> None:
    path = tmp_path / "wrong.py"
    path.write_text(text)
    error = refused(path)
    assert error.where == f"{path}, line {line}" and found in error.found


def test_a_file_that_is_not_there_and_one_named_where_only_installed_ones_are_taken(tmp_path: Path) -> None:
    assert "cannot be read" in refused(tmp_path / "none.py").what
    with pytest.raises(ConfigurationError, match="install the package that has it"):
        find_procedure("./mine.py")  # a campaign file is data: nothing named in it is run
