"""Which tests are asked about a mutant, in which order; how a process that has imported the source gets it."""

import importlib.util

import pytest

from benchmarks import _clean, _mutations
from benchmarks._clean import Clean
from benchmarks._mutant_rooms import ROOMS
from benchmarks._mutations import Mutant, drawn, mutated
from benchmarks._warm import Cold, _exchange, _functions
from benchmarks.mutants import _equivalent

PART = ROOMS["safe"][0]
SOURCE = """LIMIT = 1

def far(
    x: float = 2.0,
) -> bool:
    if x > 1.0:
        return bool(
            x == 3.0
        )
    return False
"""
CLEAN = Clean(
    seconds={
        "a.py::slow": 9.0,
        "a.py::quick": 0.1,
        "b.py::other": 0.2,
        "c.py::process": 0.05,
        "b.py::idle": 0.01,
    },
    ran={"m.py": {6: ["a.py::slow", "b.py::other"], 10: ["a.py::quick"]}},
    imported={"m.py": {1, 3, 4}},
)


@pytest.fixture(autouse=True)
def source(tmp_path, monkeypatch):
    (tmp_path / "m.py").write_text(SOURCE)
    (tmp_path / "b.py").write_text('@pytest.fixture(scope="module")')
    monkeypatch.setattr(_mutations, "ROOT", tmp_path)
    monkeypatch.setattr(_clean, "ROOT", tmp_path)
    _mutations._tree.cache_clear()
    yield
    _mutations._tree.cache_clear()


def mutant(line):
    return Mutant(PART, "m.py", "f", line, "core/NumberReplacer", 0)


def test_those_that_ran_the_line_then_those_that_share_a_fixture_then_files_that_ran_nothing():
    assert CLEAN.order(mutant(6)) == [
        "b.py::other",
        "a.py::slow",
        "b.py::idle",
        "c.py::process",
    ]
    assert CLEAN.order(mutant(10)) == ["a.py::quick", "c.py::process"]


def test_what_no_test_ran_is_asked_of_those_that_run_it_in_another_process():
    assert CLEAN.order(mutant(8)) == ["c.py::process"]


def test_a_line_within_a_statement_is_that_of_the_statement():
    assert list(_mutations.statement(mutant(8))) == [7, 8]
    assert list(_mutations.statement(mutant(4))) == [3, 4]


def test_a_condition_in_brackets_is_executed_where_it_begins(tmp_path):
    """Of `if (` alone on its line nothing tells that it was executed."""
    (tmp_path / "m.py").write_text("def f(x):\n    while (\n        x\n        > 1\n    ):\n        x -= 1\n")
    _mutations._tree.cache_clear()
    assert [list(_mutations.statement(mutant(line))) for line in (2, 3, 4, 6)] == [
        [2, 3],
        [2, 3],
        [2, 3, 4],
        [6],
    ]


def test_what_is_executed_at_import_asks_all():
    assert sorted(CLEAN.order(mutant(1))) == sorted(CLEAN.order(mutant(4))) == sorted(CLEAN.seconds)
    assert CLEAN.at_import(mutant(4)) and not CLEAN.at_import(mutant(6))


def test_a_larger_sample_holds_the_smaller_one_and_a_change_elsewhere_draws_nothing_else(
    tmp_path, monkeypatch
):
    pytest.importorskip("cosmic_ray", reason="no cosmic-ray: pip install 'gyrobench[bench]'")
    monkeypatch.setattr(_mutations, "KEPT", tmp_path / "kept")
    monkeypatch.setitem(ROOMS, "safe", (PART.__class__(("m.py",), ()),))
    few, many = drawn("safe", 3), drawn("safe", 100)
    assert many[:3] == few and len(many) > 5
    assert len({mutated(each) for each in many}) == len(many)
    assert drawn("safe", 3, 2) != few and {each.key for each in drawn("safe", 3, 2)} - {
        each.key for each in few
    }
    changes = {_mutations.change(each) for each in many}
    (tmp_path / "m.py").write_text("A_LINE = 7\n" + SOURCE)
    assert changes < {_mutations.change(each) for each in drawn("safe", 100)}


def test_every_equivalent_mutant_has_a_reason():
    rows = _equivalent()
    assert rows and all(reason.endswith(".") and " -> " in change for (_, _, change), reason in rows.items())


LIVE = """def outer(x):
    def inner(y):
        return x + y + 1
    return inner

class Pair:
    @property
    def sum(self):
        return 2 + 3

kept = outer(10)
both = (lambda: 1), (lambda: 2)
"""


@pytest.fixture
def live(tmp_path):
    path = tmp_path / "live.py"
    path.write_text(LIVE)
    spec = importlib.util.spec_from_file_location("live", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    functions = _functions(tmp_path)[str(path)]

    def change(before, after):
        _exchange(functions, LIVE.replace(before, after), str(path))

    return module, change


def test_functions_methods_and_what_was_made_of_them_before_do_what_the_changed_source_says(live):
    module, change = live
    pair = module.Pair()
    change("+ y + 1", "+ y - 1")
    assert module.outer(1)(2) == 2 and module.kept(5) == 14
    change("2 + 3", "2 * 3")
    assert pair.sum == 6 and module.kept(5) == 16, "one change at a time"


@pytest.mark.parametrize(
    ("before", "after"),
    [("", ""), ("(10)", "(11)"), ("lambda: 1", "lambda: 3"), ("x + y", "y")],
    ids=["nothing", "at import", "two of a name in a line", "other free variables"],
)
def test_what_cannot_be_given_to_a_function_that_is_there_is_refused(live, before, after):
    with pytest.raises((Cold, ValueError)):
        live[1](before, after)
