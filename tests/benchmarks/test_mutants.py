"""Which tests are asked about a mutant, in which order; the list of mutants that no input can show."""

from benchmarks.mutants import ROOMS, Clean, Mutant, _equivalent

PART = ROOMS["safe"][0]
CLEAN = Clean(
    seconds={
        "a.py::slow": 9.0,
        "a.py::quick": 0.1,
        "b.py::other": 0.2,
        "c.py::process": 0.05,
        "b.py::idle": 0.01,
    },
    ran={"m.py": {3: [], 7: ["a.py::slow", "b.py::other"], 9: ["a.py::quick"]}},
    limit_s=10.0,
)


def order(line, file="m.py"):
    return CLEAN.order(Mutant(PART, file, "f", line, "core/NumberReplacer", 0))


def test_those_that_ran_the_line_come_first_then_their_files_then_files_that_ran_nothing():
    assert order(7) == ["b.py::other", "a.py::slow", "b.py::idle", "a.py::quick", "c.py::process"]
    assert order(9) == ["a.py::quick", "a.py::slow", "c.py::process"]


def test_a_line_within_a_statement_is_that_of_the_statement():
    assert order(8) == order(7)


def test_a_line_that_is_executed_at_import_asks_all():
    every = sorted(CLEAN.seconds)
    assert sorted(order(3)) == sorted(order(1)) == sorted(order(7, "unseen.py")) == every


def test_every_equivalent_mutant_has_a_reason():
    rows = _equivalent()
    assert rows and all(reason.endswith(".") and " -> " in change for (_, _, change), reason in rows.items())
