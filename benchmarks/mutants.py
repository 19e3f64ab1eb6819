"""What share of small changes to the code do the related tests notice? A random sample of mutants by room.

Run as `python -m benchmarks.mutants [SAMPLE] [ROOM ...] [--draw N] [--write]`: so many mutants a room (200),
all rooms or those named. The operators are cosmic-ray's: numbers, comparisons, arithmetic, conditions, loops,
exceptions. A place is drawn first and one of its mutants then, so that an addition with eleven of them counts
as a condition with one. Annotations and decorators are left out: nothing evaluates the ones, and what the
others do (`frozen=True`) is no behaviour. The draw is the same for the same sources, and a larger sample holds
the smaller one. `--draw 2` draws others: tests written for the survivors of one draw are judged by another.

Each mutant is put into a copy of the tree, where the tests run that ran the mutated statement when nothing was
changed, quickest first, then the others of their files where they share a fixture. They run in a process that
has collected them, with the new code given to the function (benchmarks/_warm.py); where the statement is
executed at import, all is imported anew and all tests run. Last, of what survives, come tests that ran nothing
of the part: they run it in another process. A mutant is caught if a test fails, or if the tests take several
times the processor time that they take without it. A test must fail twice: a busy machine fails one now and
then. Results are kept by room in build/mutants: what is broken off goes on; a caught mutant stays caught while
its file is the same; a survivor is asked the tests that have changed. Those that no input can show stand in
equivalent_mutants.toml, with the reason, and do not count. `--write` puts the table into
benchmarks/reliability.md; `--kept` tries nothing and tells what is known; `--near` leaves out the tests in
other processes: what they would catch counts as survived.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
import tomllib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from benchmarks._clean import Clean, Watch, file_of
from benchmarks._mutant_rooms import ROOMS, Part
from benchmarks._mutations import KEPT, Mutant, change, digest, drawn, mutated
from benchmarks._sections import write_section
from benchmarks._trial import FAILED, NO_TEST, PASSED, ROOT, TIME, Copy, Outcome, Progress, Steps
from benchmarks._warm import Cold, Warm

_EQUIVALENT = Path(__file__).with_name("equivalent_mutants.toml")
_SAMPLE = 200
_GOAL = 0.85
_FACTOR, _LEAST_S, _CLEAN_S = 2.5, 6.0, 900.0
"""A mutant's tests may take so many times the processor time that they take without it, and so much more."""
_TRIES = 3
"""Without a mutant, of the tests on the host's clock, one may fail on a busy machine."""
_COLD_S = 12.0
"""So much more where all is imported anew."""
_CAUGHT, _SURVIVED, _SAME = "caught", "survived", "equivalent"


class Trials:
    """Runs a part's tests in a copy of the tree that one mutant at a time is put into."""

    def __init__(self, folder: Path) -> None:
        self._copy, self._notes = Copy(folder), folder / "notes.json"
        self._progress = Progress()
        self._clean: dict[Part, Clean] = {}
        self._warm: dict[Part, Warm] = {}

    def outcome(self, mutant: Mutant, files: Sequence[str]) -> Outcome:
        """Return what the tests of some files make of a mutant."""
        clean = self.clean(mutant.part)
        order = [test for test in clean.order(mutant) if file_of(test) in files]
        if not order:
            return Outcome(PASSED, "", 0.0)
        with self._copy.changed(mutant.file, mutated(mutant)):
            found = self._run(mutant, order)
            if found.kind == FAILED or (found.kind == TIME and self._may_have_starved(found.test)):
                again = self._run(mutant, self._of(found.test, order) or order)
                if again.kind == PASSED:  # it had failed because the machine was busy
                    found = self._run(mutant, order)
        return found

    def fails_again(self, mutant: Mutant, test: str) -> bool:
        """Return whether a test that has caught a mutant, all cases of it, catches it once more."""
        every = self.clean(mutant.part).order(mutant)
        order = every if test == NO_TEST else self._of(test, every)
        with self._copy.changed(mutant.file, mutated(mutant)):
            return bool(order) and self._run(mutant, order).kind != PASSED

    def _of(self, test: str, order: Sequence[str]) -> list[str]:
        return [each for each in order if each == test or each.startswith(f"{test}[")]

    def close(self) -> None:
        """End the processes that have collected tests."""
        for warm in self._warm.values():
            warm.close()
        self._warm.clear()

    def _run(self, mutant: Mutant, order: Sequence[str]) -> Outcome:
        clean = self.clean(mutant.part)
        limits_s = {test: _FACTOR * clean.seconds[test] for test in order}
        if not clean.at_import(mutant):
            with suppress(Cold):
                found = self._warm[mutant.part].run(mutant.file, limits_s, _LEAST_S)
                return self._named(found, order)
        files, steps = sorted(set(map(file_of, order))), Steps(self._progress, limits_s, _COLD_S)
        return self._named(self._copy.run(files, lambda: self._progress.allowed_s, [steps]), order)

    def _named(self, found: Outcome, order: Sequence[str]) -> Outcome:
        """Return the outcome with the test that ran last."""
        if found.kind != PASSED and self._progress.running >= 0:
            return replace(found, test=order[self._progress.running])
        return found

    def _may_have_starved(self, test: str) -> bool:
        """Return whether a test waits on the host's clock, or nothing had begun yet."""
        file = ROOT / file_of(test)
        return not test or (file.is_file() and "pytest.mark.concurrent" in file.read_text(encoding="utf-8"))

    def clean(self, part: Part) -> Clean:
        """Return what a part's tests do without any mutant; RuntimeError if they fail.

        Starts the process that has collected them, too: before a mutant is in the copy.
        """
        if part not in self._clean:
            paths = [path for glob in part.sources for path in sorted(self._copy.root.glob(glob))]
            files = [str(path.relative_to(self._copy.root)) for path in paths]
            kept = {test: KEPT / "clean" / f"{digest(*files, test)}.json" for test in part.tests}
            self._watch(paths, kept)
            seconds: dict[str, float] = {}
            ran: dict[str, dict[int, list[str]]] = {file: {} for file in files}
            imported: dict[str, set[int]] = {file: set() for file in files}
            for path in kept.values():
                notes = json.loads(path.read_text(encoding="utf-8"))
                seconds |= notes["seconds"]
                for file, lines, before in zip(files, notes["ran"], notes["imported"], strict=True):
                    imported[file] |= set(before)
                    for line, tests in lines.items():
                        ran[file][int(line)] = [*ran[file].get(int(line), []), *tests]
            self._clean[part] = Clean(seconds, ran, imported)
            print(f"{' '.join(part.sources)}: the tests take {sum(seconds.values()):.1f} s", flush=True)
        if part not in self._warm:
            self._warm[part] = Warm(self._copy, part.tests, self._progress)
        return self._clean[part]

    def _watch(self, sources: Sequence[Path], kept: Mapping[str, Path]) -> None:
        """Write down what tests do that nothing is known of yet, by file; None of those that fail."""
        for _ in range(_TRIES):
            unknown = [file for file, path in kept.items() if not path.exists()]
            if not unknown:
                return
            self._notes.write_text("{}", encoding="utf-8")
            plugin = Watch(sources, self._notes)
            self._copy.run([*unknown, "--maxfail=1000"], _CLEAN_S, [plugin], keep_compiled=True)
            for file, notes in json.loads(self._notes.read_text(encoding="utf-8")).items():
                kept[file].parent.mkdir(parents=True, exist_ok=True)
                kept[file].write_text(json.dumps(notes), encoding="utf-8")
        unknown = [file for file, path in kept.items() if not path.exists()]
        if unknown:
            said = self._copy.said()[-3000:]
            raise RuntimeError(f"{said}\nthe tests fail without a mutant: {', '.join(unknown)}")


class Kept:
    """Results of a room from run to run, by mutant, with what they hold for."""

    def __init__(self, room: str) -> None:
        self._path = KEPT / f"{room}.json"
        self._rows: dict[str, dict[str, Any]] = {}
        if self._path.exists():
            self._rows = json.loads(self._path.read_text(encoding="utf-8"))

    def row(self, mutant: Mutant) -> dict[str, Any] | None:
        """Return what was found of this source."""
        row = self._rows.get(mutant.key)
        return None if row is None or row["source"] != digest(mutant.file) else row

    def unasked(self, mutant: Mutant) -> list[str]:
        """Return the test files that it has not survived as they are now; none if it is caught."""
        row = self.row(mutant) or {"outcome": _SURVIVED, "survived": {}}
        if row["outcome"] != _SURVIVED:
            return []
        return [file for file in mutant.part.tests if row["survived"].get(file) != digest(file)]

    def once(self, mutant: Mutant) -> str:
        """Return the test that has caught a mutant once and was not asked again; empty for any other mutant."""
        row = self.row(mutant)
        return row["by"] if row and row["outcome"] == _CAUGHT and not row.get("twice") else ""

    def twice(self, mutant: Mutant, again: bool) -> None:
        """Keep whether a test that has caught a mutant catches it again; if not, nothing is known of it."""
        if again:
            self._rows[mutant.key]["twice"] = True
        else:
            del self._rows[mutant.key]
        self._write()

    def keep(self, mutant: Mutant, found: Outcome, files: Sequence[str]) -> dict[str, Any]:
        """Keep what was found, at once."""
        before = self.row(mutant) or {"survived": {}}
        outcome = {PASSED: _SURVIVED, FAILED: _CAUGHT}.get(found.kind, found.kind)
        row: dict[str, Any] = {"outcome": outcome, "by": found.test, "twice": True}
        row |= {"change": change(mutant), "source": digest(mutant.file)}
        row["survived"] = before["survived"] | {file: digest(file) for file in files}
        self._rows[mutant.key] = row
        self._write()
        return row

    def _write(self) -> None:
        self._path.parent.mkdir(parents=True, exist_ok=True)
        beside = self._path.with_suffix(".part")
        beside.write_text(json.dumps(self._rows, indent=1), encoding="utf-8")
        beside.replace(self._path)


def _equivalent() -> dict[tuple[str, str, str], str]:
    """Return why no input can show a mutant, by file, function and change."""
    rows = tomllib.loads(_EQUIVALENT.read_text(encoding="utf-8"))["mutant"]
    return {(row["file"], row["function"], row["change"]): row["reason"] for row in rows}


def _try(room: str, mutants: Sequence[Mutant], trials: Trials, *, blind: bool) -> None:
    """Try the room's mutants; those known already are not run again.

    Tests that run the sources in another process, `blind`, are asked last, of what all others have let pass.
    """
    kept, equivalent = Kept(room), _equivalent()
    for number, mutant in enumerate(mutants, 1):
        same = (mutant.file, mutant.function, change(mutant)) in equivalent
        if test := kept.once(mutant):
            again = trials.fails_again(mutant, test)
            print(
                f"{room}, {number} of {len(mutants)}: {'again' if again else 'not again'}, {test}", flush=True
            )
            kept.twice(mutant, again)
        files = [] if same else kept.unasked(mutant)
        if files and not blind:
            files = [file for file in files if file not in trials.clean(mutant.part).blind()]
        if files:
            began_s = time.monotonic()
            found = trials.outcome(mutant, files)
            row = kept.keep(mutant, found, files)
            print(
                f"{room}, {number} of {len(mutants)}: {row['outcome']}, {mutant.file}:{mutant.line} "
                f"{mutant.function}: {row['change']} {row['by']} "
                f"({found.processor_s:.1f} s of {time.monotonic() - began_s:.1f} s)",
                flush=True,
            )
    trials.close()


def _known(room: str, mutants: Sequence[Mutant]) -> list[tuple[Mutant, dict[str, Any]]]:
    """Return those of the room's mutants that were tried, with what became of each."""
    kept, equivalent = Kept(room), _equivalent()
    results: list[tuple[Mutant, dict[str, Any]]] = []
    for mutant in mutants:
        same = (mutant.file, mutant.function, change(mutant)) in equivalent
        row = {"outcome": _SAME, "change": change(mutant)} if same else kept.row(mutant)
        results += [] if row is None else [(mutant, row)]
    return results


def _lines(room: str, results: Sequence[tuple[Mutant, dict[str, Any]]]) -> list[str]:
    """Return the room's share, its survivors and its equivalent mutants."""
    survivors, equivalent = _of(results, _SURVIVED), _of(results, _SAME)
    tried = len(results) - len(equivalent)
    lines = [
        f"**{room}**: {tried - len(survivors)} of {tried} caught, {_share(results):.1%} "
        f"({len(_of(results, TIME))} by time); {len(equivalent)} more are equivalent."
    ]
    for title, mutants in (("Survivors", survivors), ("Equivalent", equivalent)):
        if mutants:
            lines += ["", f"{title}:", "", *mutants]
    return [*lines, ""]


def _of(results: Sequence[tuple[Mutant, dict[str, Any]]], outcome: str) -> list[str]:
    """Return a line for each mutant that ended so, by place."""
    rows = [
        (mutant.file, mutant.line, mutant.function, row["change"])
        for mutant, row in results
        if row["outcome"] == outcome
    ]
    return [f"* {file}:{line} `{function}`: {change}" for file, line, function, change in sorted(rows)]


def _share(results: Sequence[tuple[Mutant, dict[str, Any]]]) -> float:
    tried = [row["outcome"] for _, row in results if row["outcome"] != _SAME]
    return float(sum(outcome != _SURVIVED for outcome in tried) / max(len(tried), 1))


def _room(name: str) -> str:
    if name not in ROOMS:
        raise argparse.ArgumentTypeError(f"no such room: {name}. There are {', '.join(ROOMS)}.")
    return name


def _asked() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.mutants")
    parser.add_argument("sample", nargs="?", type=int, default=_SAMPLE)
    parser.add_argument("rooms", nargs="*", type=_room, metavar="ROOM", help=", ".join(ROOMS))
    parser.add_argument("--draw", type=int, default=1)
    for name in ("--write", "--kept", "--near"):
        parser.add_argument(name, action="store_true")
    return parser.parse_args()


def main() -> int:
    """Try the mutants; 1 if a room's tests catch less than 85 %."""
    asked = _asked()
    rooms = asked.rooms or [*ROOMS]
    samples = {room: drawn(room, asked.sample, asked.draw) for room in rooms}
    if not asked.kept:
        with tempfile.TemporaryDirectory() as folder:
            trials = Trials(Path(folder))
            for blind in (False,) if asked.near else (False, True):
                for room, mutants in samples.items():
                    _try(room, mutants, trials, blind=blind)
    lines, shares = [], []
    for room, mutants in samples.items():
        results = _known(room, mutants)
        lines += _lines(room, results)
        shares.append(_share(results))
    print("\n".join(["", *lines]))
    if asked.write:
        write_section("Mutants", f"python -m benchmarks.mutants {asked.sample} --draw {asked.draw}", lines)
    return 0 if min(shares) >= _GOAL else 1


if __name__ == "__main__":
    sys.exit(main())
