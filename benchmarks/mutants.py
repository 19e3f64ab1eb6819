"""What share of small changes to the code do the related tests notice? A random sample of mutants by room.

Run as `python -m benchmarks.mutants [SAMPLE] [ROOM ...] [--write]`: so many mutants a room (200), all rooms or
those named. The operators are cosmic-ray's: numbers, comparisons, arithmetic, conditions, loops, exceptions. A
place is drawn first and one of its mutants then, so that an addition with eleven of them counts as a condition
with one. Annotations and decorators are left out: nothing evaluates the ones, and what the others do
(`frozen=True`) is no behaviour. The draw is the same for the same sources, and a larger sample holds the
smaller one.

Each mutant is put into a copy of the tree, where the files with tests run that ran the mutated line when
nothing was changed, or nothing of its part (they run it in another process); the tests that ran the line
first, the quickest of them first of all. It is caught if a test fails, or if they take several times the
processor time that they take without it. A test on the host's clock must fail twice. Results are kept by
room in build/mutants: what is broken off goes on; a caught mutant stays caught while its file is the same;
a survivor is tried again when a test has changed. Those that no input can show stand in
equivalent_mutants.toml, with the reason, and do not count. `--write` puts the table into
benchmarks/reliability.md; `--kept` tries nothing and tells what is known, survivors of older tests as survivors.
"""

from __future__ import annotations

import ast
import hashlib
import json
import random
import sys
import tempfile
import tomllib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks._sections import write_section
from benchmarks._trial import FAILED, PASSED, ROOT, TIME, Copy

_KEPT = ROOT / "build" / "mutants"
_EQUIVALENT = Path(__file__).with_name("equivalent_mutants.toml")
_SEED, _SAMPLE = 1, 200
_GOAL = 0.85
_FACTOR, _LEAST_S, _CLEAN_S = 2.5, 6.0, 600.0
"""A mutant's tests may take so many times the processor time that they take without it, and this at least."""
_BLIND_S = 1e3
"""Tests that ran nothing of a part come last, as if they took so long."""
_CAUGHT, _SURVIVED, _SAME = "caught", "survived", "equivalent"


@dataclass(frozen=True)
class Part:
    """Sources by glob, and the quick tests that speak of them, the likeliest first: ten seconds or so."""

    sources: tuple[str, ...]
    tests: tuple[str, ...]


def _part(sources: str, tests: str, *more: str) -> Part:
    """Return a part: "bench/analysis/gap/_fit _cells" are two sources; tests are named alike."""
    return Part(
        tuple(f"{name}.py" for name in _in_folder(sources)),
        tuple(f"{name}.py" for words in (tests, *more) for name in _in_folder(words)),
    )


def _in_folder(words: str) -> list[str]:
    folder, _, names = words.rpartition("/")
    return [f"{folder}/{name}" for name in names.split()]


ROOMS: dict[str, tuple[Part, ...]] = {
    "safe": (
        _part(
            "bench/control/safe_state",
            "tests/safety/test_way_to_rest test_port_that_stays_away",
            "tests/control/test_session test_table_axes",
        ),
        _part(
            "bench/control/limits table_station",
            "tests/control/test_limits test_table_axes test_stations test_session",
        ),
        _part(
            "bench/control/watchdog/*",
            "tests/safety/test_takeover test_starved_runner test_replaced_terminal",
            "tests/reliability/test_watchdog",
        ),
    ),
    "recording": (
        _part(
            "bench/record/recording/_timing",
            "tests/record/recording/test_timing test_reading test_decode test_recording_kvh",
        ),
        _part("bench/record/recording/_remote", "tests/record/recording/test_object_storage"),
        _part(
            "bench/record/recording/*",
            "tests/record/recording/test_journal test_events test_reading test_runs test_arrow test_decode",
            "tests/record/recording/test_recording_kvh",
            "tests/record/recording/test_recover test_journal_threads",
            "tests/reliability/test_power_cut",
            "tests/record/recording/test_object_storage",
        ),
    ),
    "decoders": (
        _part("drivers/kvh/*", "tests/drivers/test_kvh_codec test_kvh_driver"),
        _part("drivers/kit/slcan_codec", "tests/drivers/test_slcan_codec test_slcan_bus"),
        _part(
            "drivers/can_dbc/*",
            "tests/drivers/test_can_dbc_mapping test_can_dbc_decoder test_can_dbc_signals",
        ),
        _part(
            "drivers/frames/_line*",
            "tests/drivers/frames/test_frames_rules test_printed_lines test_frames_lines",
            "tests/drivers/frames/test_frames_shipped test_line_reader test_fuzz",
        ),
        _part(
            "drivers/kit/_candidates patterns splitting framing",
            "tests/drivers/frames/test_frames_split test_frames_rules test_frames_resync",
            "tests/drivers/test_framing test_kvh_codec test_slcan_codec",
        ),
        _part(
            "drivers/frames/_verify _vectors",
            "tests/drivers/frames/test_frames_rules test_frames_document test_frames_settings",
            "tests/drivers/frames/test_frames_lines test_frames_shipped test_frames_command",
        ),
        _part(
            "drivers/frames/*",
            "tests/drivers/frames/test_frames_rules test_frames_document test_printed_lines test_frames_resync",
            "tests/drivers/frames/test_frames_shipped",
            "tests/drivers/frames/test_frames_settings test_frames_lines test_fuzz",
        ),
    ),
    "fits": (
        _part("bench/analysis/common/allan*", "tests/analysis/common/test_allan"),
        _part("bench/analysis/thermal/_dataset", "tests/analysis/thermal/test_dataset test_scale_factor"),
        _part("bench/analysis/thermal/_grey_box _diffusion", "tests/analysis/thermal/test_grey_box"),
        _part("bench/analysis/thermal/_hybrid", "tests/analysis/thermal/test_compensation test_hybrid"),
        _part("bench/analysis/thermal/_lstm*", "tests/analysis/thermal/test_lstm"),
        _part("bench/analysis/thermal/_scale_factor", "tests/analysis/thermal/test_scale_factor"),
        _part("bench/analysis/common/stepwise", "tests/analysis/common/test_stepwise"),
        _part(
            "bench/analysis/thermal/*",
            "tests/analysis/thermal/test_evaluate test_features test_linear_models test_compensation",
            "tests/analysis/thermal/test_scale_factor test_grey_box",
        ),
        _part("bench/analysis/rlg/_cycle", "tests/analysis/rlg/test_rlg_cycle"),
        _part(
            "bench/analysis/rlg/*",
            "tests/analysis/rlg/test_rlg_ramp test_rlg_report test_rlg_study test_rlg_profile",
        ),
        _part("bench/analysis/figures/*", "tests/analysis/figures/test_standards test_standard_run"),
    ),
    "gap": (
        _part(
            "bench/analysis/gap/_channel*",
            "tests/analysis/gap/test_gap_edges test_gap_by_hand test_gap_channels",
            "tests/analysis/gap/test_gap_modelled_channels test_gap_recording",
            "tests/analysis/gap/test_gap_one_diagnosis test_gap_platform test_gap_systems",
        ),
        _part("bench/analysis/gap/_position", "tests/analysis/gap/test_gap_platform test_gap_one_diagnosis"),
        _part(
            "bench/analysis/gap/_import _run_folder _data _model_file",
            "tests/analysis/gap/test_gap_edges test_gap_by_hand test_gap_cells test_gap_import",
            "tests/analysis/gap/test_gap_systems test_gap_diagnosis test_gap_commands",
        ),
        _part(
            "bench/analysis/gap/_rehearsal _response _suggest _series",
            "tests/analysis/gap/test_gap_edges test_gap_by_hand test_gap_rehearsal test_gap_platform",
        ),
        _part(
            "bench/analysis/gap/_disturbed _align",
            "tests/analysis/gap/test_gap_record_effects test_gap_diagnosis",
        ),
        _part(
            "bench/analysis/gap/_exam _examination _score _exam_folder _case_folder _signature",
            "tests/analysis/gap/test_gap_edges test_gap_by_hand test_gap_fit test_gap_exam",
        ),
        _part(
            "bench/analysis/gap/*",
            "tests/analysis/gap/test_gap_edges test_gap_by_hand test_gap_fit test_gap_cells",
            "tests/analysis/gap/test_gap_close test_gap_doubt test_gap_learn",
            "tests/analysis/gap/test_gap_lines test_gap_refine test_gap_noise test_gap_grams",
            "tests/analysis/gap/test_gap_second_look",
            "tests/analysis/gap/test_gap_diagnosis test_gap_one_diagnosis test_gap_recording test_gap_systems",
            "tests/analysis/gap/test_gap_record_effects test_gap_channels test_gap_effects test_gap_rehearsal",
            "tests/analysis/gap/test_gap_modelled_unit",
        ),
    ),
}
"""A file belongs to the first part of its room that names it."""


@dataclass(frozen=True)
class Mutant:
    """One change: which of cosmic-ray's operators, at which of its places in the file; who may notice it."""

    part: Part
    file: str
    function: str
    line: int
    operator: str
    occurrence: int

    @property
    def key(self) -> str:
        """Name it in the kept results."""
        return f"{self.file}:{self.line} {self.operator} {self.occurrence}"


def _places(part: Part, file: str) -> list[list[Mutant]]:
    """Return the mutants of a file, those of one place together; as found before, if the file is the same."""
    kept = _KEPT / "places" / f"{_digest(file)}.json"
    if not kept.exists():
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(_searched(file)), encoding="utf-8")
    return [[Mutant(part, file, *row) for row in place] for place in json.loads(kept.read_text("utf-8"))]


def _searched(file: str) -> list[list[tuple[str, int, str, int]]]:
    """Return (function, line, operator, occurrence) of the mutants of a file by place."""
    from cosmic_ray.ast import ast_nodes, get_ast_from_path
    from cosmic_ray.plugins import get_operator, operator_names

    nodes = list(ast_nodes(get_ast_from_path(ROOT / file)))
    found: dict[tuple[Any, ...], list[tuple[str, int, str, int]]] = {}
    for name in sorted(operator_names()):
        kind = get_operator(name)
        if kind.arguments() or name == "core/NoOp":
            continue
        operator, occurrence = kind(), 0
        for node in nodes:
            for start, end in operator.mutation_positions(node):
                if not _beside(node):
                    row = (_function(node), start[0], name, occurrence)
                    found.setdefault((start, end, _group(name)), []).append(row)
                occurrence += 1
    return [found[place] for place in sorted(found)]


def _group(operator: str) -> str:
    """Return what an operator changes: "core/ReplaceBinaryOperator_Add_Sub" changes what all others of it do."""
    return operator.split("_")[0]


def _up(node: Any) -> Iterator[tuple[Any, Any]]:
    """Return the pairs of a node of the tree and what it stands in, outwards."""
    while node.parent is not None:
        yield node, node.parent
        node = node.parent


def _function(node: Any) -> str:
    names = [above.name.value for _, above in _up(node) if above.type in ("funcdef", "classdef")]
    return ".".join(reversed(names)) or "(module)"


def _beside(node: Any) -> bool:
    """Return whether it stands in an annotation or a decorator, or is the star of a signature or a call."""
    if node.type == "decorator":
        return True
    if node.type == "operator" and node.parent.type in ("parameters", "param", "argument", "arglist"):
        return True
    for own, above in _up(node):
        if above.type == "decorator" or (above.type == "tfpdef" and own is not above.children[0]):
            return True
        if above.type == "annassign" and own is above.children[1]:
            return True
        if above.type == "funcdef" and own.get_previous_sibling() == "->":
            return True
    return False


def _mutated(mutant: Mutant, text: str) -> str | None:
    """Return the file with the mutant in it; None where that is no program, or no other one."""
    from cosmic_ray.mutating import mutate_code
    from cosmic_ray.plugins import get_operator

    changed: str | None
    try:
        changed = mutate_code(text, get_operator(mutant.operator)(), mutant.occurrence)
    except AttributeError:  # cosmic-ray cannot replace an exception whose name has a dot
        return None
    if changed is None:
        return None
    try:
        same = ast.dump(ast.parse(changed)) == ast.dump(ast.parse(text))
    except SyntaxError:
        return None
    return None if same else changed


def _drawn(room: str, count: int) -> list[Mutant]:
    """Return so many mutants of a room, of different places."""
    chance = random.Random(_SEED)
    parts: dict[str, Part] = {}
    for part in ROOMS[room]:
        for glob in part.sources:
            paths = list(ROOT.glob(glob))
            if not paths:
                raise SystemExit(f"no such sources: {glob}")
            for path in paths:
                parts.setdefault(str(path.relative_to(ROOT)), part)
    places = [place for file in sorted(parts) for place in _places(parts[file], file)]
    chance.shuffle(places)
    drawn: list[Mutant] = []
    for place in places:
        chance.shuffle(place)
        text = (ROOT / place[0].file).read_text(encoding="utf-8")
        one = next((node for node in place if _mutated(node, text) is not None), None)
        drawn += [] if one is None else [one]
        if len(drawn) == count:
            break
    return drawn


def _change(text: str, changed: str) -> str:
    """Return in a line what a mutant makes of its line."""
    before, after = text.splitlines(), changed.splitlines()
    at = next(
        (k for k, pair in enumerate(zip(before, after, strict=False)) if pair[0] != pair[1]), len(after) - 1
    )
    return f"`{before[at].strip()}` -> `{after[at].strip()}`"


@dataclass(frozen=True)
class Clean:
    """A part's tests without a mutant: how long each takes, which lines it runs; what a mutant may take."""

    seconds: dict[str, float]
    ran: dict[str, dict[int, list[str]]]
    """Tests by file and line; none for a line that is executed at import."""
    limit_s: float

    def order(self, mutant: Mutant) -> list[str]:
        """Return the tests that may find the mutant, in the order in which they find it soonest.

        Those that ran its statement, quickest first, then all others of their files (they may share what
        a fixture has made), then files that ran nothing of the part, because they run it in another
        process. If no test ran the statement (it is executed at import, say), all tests are returned.
        """
        lines = self.ran.get(mutant.file, {})
        line = max((line for line in lines if line <= mutant.line), default=None)
        near = set(self.seconds if line is None else lines[line] or self.seconds)
        seeing = {_file_of(test) for of in self.ran.values() for tests in of.values() for test in tests}
        first = {_file_of(test): _BLIND_S for test in self.seconds if _file_of(test) not in seeing}
        for test in near:
            first[_file_of(test)] = min(self.seconds[test], first.get(_file_of(test), _BLIND_S))

        def key(test: str) -> tuple[bool, float, str, float]:
            file = _file_of(test)
            return test not in near, first[file], file, self.seconds[test]

        return sorted((test for test in self.seconds if _file_of(test) in first), key=key)


def _file_of(test: str) -> str:
    return test.partition("::")[0]


class _Watch:
    """Pytest plug-in that writes down how long each test takes and which lines of the sources it runs."""

    def __init__(self, sources: Sequence[Path], notes: Path) -> None:
        self._sources, self._notes = sources, notes
        self._seconds: dict[str, float] = {}

    def pytest_configure(self) -> None:
        from coverage import Coverage

        self._coverage = Coverage(
            data_file=None, config_file=False, include=[str(path) for path in self._sources]
        )
        self._coverage.start()

    def pytest_runtest_logstart(self, nodeid: str) -> None:
        self._coverage.switch_context(nodeid)

    def pytest_runtest_logreport(self, report: Any) -> None:
        self._seconds[report.nodeid] = self._seconds.get(report.nodeid, 0.0) + report.duration

    def pytest_unconfigure(self) -> None:
        self._coverage.stop()
        data = self._coverage.get_data()
        ran = [
            {
                line: [test for test in tests if test]
                for line, tests in data.contexts_by_lineno(str(path)).items()
            }
            for path in self._sources
        ]
        self._notes.write_text(json.dumps([self._seconds, ran]), encoding="utf-8")


class _Order:
    """Pytest plug-in that runs tests in a given order."""

    def __init__(self, order: Sequence[str]) -> None:
        self._rank = {test: rank for rank, test in enumerate(order)}

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        items.sort(key=lambda item: self._rank.get(item.nodeid, -1))


class Trials:
    """Runs a part's tests in a copy of the tree that one mutant at a time is put into."""

    def __init__(self, folder: Path) -> None:
        self._copy, self._notes = Copy(folder), folder / "notes.json"
        self._clean: dict[Part, Clean] = {}

    def outcome(self, mutant: Mutant, changed: str) -> tuple[str, str]:
        """Return what the tests make of a mutant, and the one that failed."""
        clean = self._without(mutant.part)
        order = clean.order(mutant)
        files, plugin = sorted(set(map(_file_of, order))), _Order(order)
        with self._copy.changed(mutant.file, changed):
            found = self._copy.run(files, clean.limit_s, [plugin])
            if found.kind == FAILED and self._uses_the_hosts_clock(found.test):
                again = self._copy.run([found.test], clean.limit_s)
                if again.kind == PASSED:  # it had failed because the machine was busy
                    found = self._copy.run(files, clean.limit_s, [plugin])
        return {PASSED: _SURVIVED, FAILED: _CAUGHT}.get(found.kind, found.kind), found.test

    def _uses_the_hosts_clock(self, test: str) -> bool:
        file = ROOT / _file_of(test)
        return file.is_file() and "pytest.mark.concurrent" in file.read_text(encoding="utf-8")

    def _without(self, part: Part) -> Clean:
        """Run a part's tests without any mutant, if these were not run yet; RuntimeError if they fail."""
        if part not in self._clean:
            paths = [path for glob in part.sources for path in sorted(self._copy.root.glob(glob))]
            files = [str(path.relative_to(self._copy.root)) for path in paths]
            kept = _KEPT / "clean" / f"{_digest(*files, *part.tests)}.json"
            if kept.exists():
                self._run_clean(part, ["--collect-only"])  # what the tests import is compiled
            else:
                self._run_clean(part, [], _Watch(paths, self._notes))
                seconds, ran = json.loads(self._notes.read_text(encoding="utf-8"))
                processor_s = self._run_clean(part, [], _Order(sorted(seconds, key=seconds.__getitem__)))
                kept.parent.mkdir(parents=True, exist_ok=True)
                kept.write_text(json.dumps([seconds, dict(zip(files, ran, strict=True)), processor_s]))
            seconds, ran, processor_s = json.loads(kept.read_text(encoding="utf-8"))
            print(f"{' '.join(part.sources)}: the tests take {processor_s:.1f} s", flush=True)
            lines = {file: {int(line): tests for line, tests in of.items()} for file, of in ran.items()}
            self._clean[part] = Clean(seconds, lines, max(_FACTOR * processor_s, _LEAST_S))
        return self._clean[part]

    def _run_clean(self, part: Part, words: Sequence[str], *plugins: object) -> float:
        for _ in range(2):  # of those on the host's clock, one may fail on a busy machine
            outcome = self._copy.run([*words, *part.tests], _CLEAN_S, plugins, keep_compiled=True)
            if outcome.kind == PASSED:
                return outcome.processor_s
        said = self._copy.said()[-3000:]
        raise RuntimeError(f"{said}\nthe tests fail without a mutant: {outcome.kind} {outcome.test}")


class Kept:
    """Results of a room from run to run, by mutant, with what they hold for."""

    def __init__(self, room: str) -> None:
        self._path = _KEPT / f"{room}.json"
        self._rows: dict[str, dict[str, str]] = {}
        if self._path.exists():
            self._rows = json.loads(self._path.read_text(encoding="utf-8"))

    def row(self, mutant: Mutant, *, as_kept: bool = False) -> dict[str, str] | None:
        """Return what was found, if it still holds; `as_kept`: a survivor of earlier tests is one still."""
        row = self._rows.get(mutant.key)
        if row is None or row["source"] != _digest(mutant.file):
            return None
        old = row["outcome"] == _SURVIVED and row["tests"] != _digest(*mutant.part.tests)
        return None if old and not as_kept else row

    def keep(self, mutant: Mutant, outcome: str, by: str, change: str) -> dict[str, str]:
        """Keep what was found, at once."""
        row = {"outcome": outcome, "by": by, "change": change}
        row |= {"source": _digest(mutant.file), "tests": _digest(*mutant.part.tests)}
        self._rows[mutant.key] = row
        self._path.parent.mkdir(parents=True, exist_ok=True)
        beside = self._path.with_suffix(".part")
        beside.write_text(json.dumps(self._rows, indent=1), encoding="utf-8")
        beside.replace(self._path)
        return row


def _digest(*names: str) -> str:
    return hashlib.sha256(b"".join((ROOT / name).read_bytes() for name in names)).hexdigest()[:16]


def _equivalent() -> dict[tuple[str, str, str], str]:
    """Return why no input can show a mutant, by file, function and change."""
    rows = tomllib.loads(_EQUIVALENT.read_text(encoding="utf-8"))["mutant"]
    return {(row["file"], row["function"], row["change"]): row["reason"] for row in rows}


def _tried(room: str, count: int, trials: Trials | None) -> list[tuple[Mutant, dict[str, str]]]:
    """Return the room's mutants with what became of each; those known already are not run again.

    Without `trials` those that are not known are left out.
    """
    kept, mutants, equivalent = Kept(room), _drawn(room, count), _equivalent()
    results = []
    for number, mutant in enumerate(mutants, 1):
        row = kept.row(mutant, as_kept=trials is None)
        if row is None:
            text = (ROOT / mutant.file).read_text(encoding="utf-8")
            changed = _mutated(mutant, text)
            assert changed is not None
            change = _change(text, changed)
            if (mutant.file, mutant.function, change) in equivalent:
                row = {"outcome": _SURVIVED, "change": change}
            elif trials is None:
                continue
            else:
                row = kept.keep(mutant, *trials.outcome(mutant, changed), change)
            place = f"{mutant.file}:{mutant.line} {mutant.function}: {change}"
            print(
                f"{room}, {number} of {len(mutants)}: {row['outcome']}, {place} {row.get('by', '')}",
                flush=True,
            )
        if row["outcome"] == _SURVIVED and (mutant.file, mutant.function, row["change"]) in equivalent:
            row = row | {"outcome": _SAME}
        results.append((mutant, row))
    return results


def _lines(room: str, results: Sequence[tuple[Mutant, dict[str, str]]]) -> list[str]:
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


def _of(results: Sequence[tuple[Mutant, dict[str, str]]], outcome: str) -> list[str]:
    """Return a line for each mutant that ended so, by place."""
    rows = [
        (mutant.file, mutant.line, mutant.function, row["change"])
        for mutant, row in results
        if row["outcome"] == outcome
    ]
    return [f"* {file}:{line} `{function}`: {change}" for file, line, function, change in sorted(rows)]


def _share(results: Sequence[tuple[Mutant, dict[str, str]]]) -> float:
    tried = [row["outcome"] for _, row in results if row["outcome"] != _SAME]
    return sum(outcome != _SURVIVED for outcome in tried) / max(len(tried), 1)


def main() -> int:
    """Try the mutants; 1 if a room's tests catch less than 85 %."""
    words = [word for word in sys.argv[1:] if word not in ("--write", "--kept")]
    count = int(words.pop(0)) if words and words[0].isdigit() else _SAMPLE
    if unknown := set(words) - set(ROOMS):
        raise SystemExit(f"no such room: {', '.join(sorted(unknown))}. There are {', '.join(ROOMS)}.")
    lines, shares = [], []
    with tempfile.TemporaryDirectory() as folder:
        trials = None if "--kept" in sys.argv else Trials(Path(folder))
        for room in words or ROOMS:
            results = _tried(room, count, trials)
            lines += _lines(room, results)
            shares.append(_share(results))
    print("\n".join(["", *lines]))
    if "--write" in sys.argv:
        write_section("Mutants", f"python -m benchmarks.mutants {count}", lines)
    return 0 if min(shares) >= _GOAL else 1


if __name__ == "__main__":
    sys.exit(main())
