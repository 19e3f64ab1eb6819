"""A part's tests without a mutant: what each takes, which lines it runs; which tests are asked of a mutant."""

from __future__ import annotations

import json
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks._mutations import Mutant, statement
from benchmarks._trial import ROOT, Early

_BLIND_S = 1e3
"""Tests that ran nothing of a part come last, as if they took so long."""


@dataclass(frozen=True)
class Clean:
    """A part's tests without a mutant: the processor time that each takes, and which lines it runs."""

    seconds: dict[str, float]
    ran: dict[str, dict[int, list[str]]]
    """Tests by file and line."""
    imported: dict[str, set[int]]
    """Lines that are executed before the tests."""

    def order(self, mutant: Mutant) -> list[str]:
        """Return the tests that may find the mutant, in the order in which they find it soonest.

        Those that ran its statement, quickest first, then the others of their files where a fixture makes
        something for more than one of them, then files that ran nothing of the part, because they run it in
        another process: these alone if no test ran the statement. If it is executed at import, all are returned.
        """
        near = set(self.seconds) if self.at_import(mutant) else set(self._ran(mutant))
        first = dict.fromkeys(self.blind(), _BLIND_S)
        for test in near:
            first[file_of(test)] = min(self.seconds[test], first.get(file_of(test), _BLIND_S))

        def key(test: str) -> tuple[bool, float, str, float]:
            file = file_of(test)
            return test not in near, first[file], file, self.seconds[test]

        asked = near | {
            test for test in self.seconds if file_of(test) in first and self._shares(file_of(test))
        }
        return sorted(asked, key=key)

    def _shares(self, file: str) -> bool:
        """Return whether a file's tests may see what others of them ran (or ran nothing of the part)."""
        texts = [
            path.read_text("utf-8")
            for path in (ROOT / file, ROOT / Path(file).parent / "conftest.py")
            if path.exists()
        ]
        return file in self.blind() or any(word in text for text in texts for word in ('scope="', "cache"))

    def blind(self) -> set[str]:
        """Return the files with tests that ran nothing of the part: they run it in another process."""
        seeing = {file_of(test) for of in self.ran.values() for tests in of.values() for test in tests}
        return {file_of(test) for test in self.seconds} - seeing

    def at_import(self, mutant: Mutant) -> bool:
        """Return whether the mutant's statement is executed before the tests."""
        return bool(self.imported[mutant.file] & set(statement(mutant)))

    def _ran(self, mutant: Mutant) -> list[str]:
        lines = self.ran[mutant.file]
        return [test for line in statement(mutant) for test in lines.get(line, ())]


def file_of(test: str) -> str:
    return test.partition("::")[0]


class Watch(Early):
    """Pytest plug-in that writes down, by file, what each test takes and which lines it runs."""

    def __init__(self, sources: Sequence[Path], notes: Path) -> None:
        self._sources, self._notes = sources, notes
        self._seconds: dict[str, float] = {}
        self._failed: set[str] = set()

    def begin(self) -> None:
        from coverage import Coverage

        self._coverage = Coverage(
            data_file=None, config_file=False, include=[str(path) for path in self._sources]
        )
        self._coverage.start()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._coverage.switch_context(nodeid)
        self._seconds[nodeid] = -sum(os.times()[:4])

    def pytest_runtest_logreport(self, report: Any) -> None:
        if report.failed:
            self._failed.add(file_of(report.nodeid))

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        self._seconds[nodeid] += sum(os.times()[:4])

    def pytest_unconfigure(self) -> None:
        self._coverage.stop()
        data = self._coverage.get_data()
        rows = [data.contexts_by_lineno(str(path)) for path in self._sources]
        found: dict[str, Any] = {}
        for file in {file_of(test) for test in self._seconds} - self._failed:
            found[file] = {
                "seconds": {test: s for test, s in self._seconds.items() if file_of(test) == file},
                "ran": [
                    {line: [test for test in tests if file_of(test) == file] for line, tests in of.items()}
                    for of in rows
                ],
                "imported": [[line for line, tests in of.items() if "" in tests] for of in rows],
            }
        self._notes.write_text(json.dumps(found), encoding="utf-8")
