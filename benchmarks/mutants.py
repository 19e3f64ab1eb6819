"""What share of small changes to the code do the related tests notice? A random sample of mutants by room.

Run as `python -m benchmarks.mutants [SAMPLE] [ROOM ...] [--write]`: so many mutants a room (200), all rooms or
those named. The operators are cosmic-ray's: numbers, comparisons, arithmetic, conditions, loops, exceptions. A
place is drawn first and one of its mutants then, so that an addition with eleven of them counts as a condition
with one. Annotations and decorators are left out: nothing evaluates the ones, and what the others do
(`frozen=True`) is no behaviour. The draw is the same for the same sources, and a larger sample holds the
smaller one.

Each mutant is put into a copy of the tree, where the room's tests run in a process forked from one that has the
libraries loaded. It is caught if a test fails, or if they take several times as long as without it. Results are
kept by room in build/mutants: what is broken off goes on; a caught mutant stays caught while its file is the
same; a survivor is tried again when a test has changed. `--write` puts the table into
benchmarks/reliability.md.
"""

from __future__ import annotations

import ast
import compileall
import ctypes
import hashlib
import importlib
import json
import os
import py_compile
import random
import re
import resource
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[1]
_KEPT = ROOT / "build" / "mutants"
_PACKAGES = ("bench", "drivers", "procedures", "simulators")
_SEED, _SAMPLE = 1, 200
_GOAL = 0.85
_FACTOR, _LEAST_S, _CLEAN_S = 4.0, 20.0, 600.0
"""A mutant's tests may take so many times as long as without it, and this long at least."""
_MOST_BYTES = 8 << 30
_SET_CHILD_SUBREAPER = 36
"""Of prctl(2)."""
_CAUGHT, _TIME, _SURVIVED = "caught", "out of time", "survived"
_LIBRARIES = (
    "numpy",
    "scipy.fft",
    "scipy.linalg",
    "scipy.optimize",
    "scipy.signal",
    "scipy.stats",
    "pandas",
    "pyarrow.parquet",
    "pydantic",
    "typer",
    "rich",
    "hypothesis.strategies",
    "pytest",
    "_pytest.assertion.rewrite",
    "can",
    "cantools",
    "serial",
    "torch",
    "statsmodels.api",
    "allantools",
    "pymodbus",
    "fsspec",
    "jinja2",
    "joblib",
)
"""Loaded once, before the processes of the tests are forked; nothing of ours."""


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
            "tests/safety/test_port_that_stays_away",
            "tests/control/test_session test_table_axes",
        ),
        _part("bench/control/limits limit_watch", "tests/control/test_limits test_table_axes test_session"),
        _part(
            "bench/control/watchdog/*",
            "tests/safety/test_starved_runner test_replaced_terminal",
            "tests/reliability/test_watchdog",
        ),
    ),
    "recording": (
        _part(
            "bench/record/recording/_timing",
            "tests/record/recording/test_timing test_decode test_recording_kvh",
        ),
        _part("bench/record/recording/_remote", "tests/record/recording/test_object_storage"),
        _part(
            "bench/record/recording/*",
            "tests/record/recording/test_journal test_events test_runs test_arrow test_decode test_recording_kvh",
            "tests/record/recording/test_recover test_journal_threads",
            "tests/reliability/test_power_cut",
            "tests/record/recording/test_object_storage",
        ),
    ),
    "decoders": (
        _part("drivers/kvh/*", "tests/drivers/test_kvh_codec test_kvh_driver"),
        _part("drivers/kit/slcan_codec", "tests/drivers/test_slcan_codec test_slcan_bus"),
        _part("drivers/can_dbc/*", "tests/drivers/test_can_dbc_decoder test_can_dbc_signals"),
        _part(
            "drivers/frames/_line*",
            "tests/drivers/frames/test_printed_lines test_frames_lines",
            "tests/drivers/frames/test_frames_shipped test_line_reader test_fuzz",
        ),
        _part(
            "drivers/frames/_candidates _find _split _verify _vectors",
            "tests/drivers/frames/test_frames_split test_frames_document test_frames_shipped test_frames_command",
        ),
        _part(
            "drivers/frames/*",
            "tests/drivers/frames/test_frames_document test_printed_lines test_frames_resync test_frames_shipped",
            "tests/drivers/frames/test_frames_settings test_frames_lines test_fuzz",
        ),
    ),
    "fits": (
        _part("bench/analysis/common/allan*", "tests/analysis/common/test_allan"),
        _part("bench/analysis/thermal/_dataset", "tests/analysis/thermal/test_dataset test_scale_factor"),
        _part("bench/analysis/thermal/_grey_box _diffusion", "tests/analysis/thermal/test_grey_box"),
        _part("bench/analysis/thermal/_hybrid", "tests/analysis/thermal/test_compensation test_hybrid"),
        _part("bench/analysis/thermal/_lstm*", "tests/analysis/thermal/test_lstm"),
        _part("bench/analysis/thermal/_scale_factor _alignment", "tests/analysis/thermal/test_scale_factor"),
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
        _part("bench/analysis/gap/_channel*", "tests/analysis/gap/test_gap_channels"),
        _part("bench/analysis/gap/_position", "tests/analysis/gap/test_gap_platform"),
        _part(
            "bench/analysis/gap/_import _run_folder _data _model_file",
            "tests/analysis/gap/test_gap_cells test_gap_import",
            "tests/analysis/gap/test_gap_systems test_gap_diagnosis test_gap_commands",
        ),
        _part(
            "bench/analysis/gap/_rehearsal _response _suggest _series",
            "tests/analysis/gap/test_gap_rehearsal",
        ),
        _part(
            "bench/analysis/gap/_disturbed _align",
            "tests/analysis/gap/test_gap_record_effects test_gap_diagnosis",
        ),
        _part(
            "bench/analysis/gap/_exam _examination _score _exam_folder _case_folder _signature",
            "tests/analysis/gap/test_gap_fit test_gap_exam",
        ),
        _part(
            "bench/analysis/gap/*",
            "tests/analysis/gap/test_gap_fit test_gap_cells test_gap_close test_gap_doubt test_gap_lines",
            "tests/analysis/gap/test_gap_refine test_gap_noise test_gap_grams test_gap_diagnosis",
            "tests/analysis/gap/test_gap_record_effects",
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


def _ours() -> list[str]:
    """Return the files of the tree, those not committed yet among them."""
    words = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    found = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=True).stdout
    return [name for name in found.splitlines() if (ROOT / name).is_file()]


def _places(part: Part, file: str) -> list[list[Mutant]]:
    """Return the mutants of a file, those of one place together."""
    from cosmic_ray.ast import ast_nodes, get_ast_from_path
    from cosmic_ray.plugins import get_operator, operator_names

    nodes = list(ast_nodes(get_ast_from_path(ROOT / file)))
    found: dict[tuple[Any, ...], list[Mutant]] = {}
    for name in sorted(operator_names()):
        kind = get_operator(name)
        if kind.arguments() or name == "core/NoOp":
            continue
        operator, occurrence = kind(), 0
        for node in nodes:
            for start, end in operator.mutation_positions(node):
                mutant = Mutant(part, file, _function(node), start[0], name, occurrence)
                occurrence += 1
                if not _beside(node):
                    found.setdefault((start, end, _group(name)), []).append(mutant)
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

    changed: str | None = mutate_code(text, get_operator(mutant.operator)(), mutant.occurrence)
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
        one = next((each for each in place if _mutated(each, text) is not None), None)
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


class Trials:
    """Runs tests in a copy of the tree that one mutant at a time is put into."""

    def __init__(self, folder: Path) -> None:
        self._copy, self._log, self._scratch = folder / "copy", folder / "log", folder / "tmp"
        self._limits_s: dict[Part, float] = {}
        _adopt_orphans()
        for name in _ours():
            (self._copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, self._copy / name)
        # by content: a mutant may have its original's size and second of change
        hashed = py_compile.PycInvalidationMode.CHECKED_HASH
        for name in _PACKAGES:
            compileall.compile_dir(self._copy / name, quiet=2, invalidation_mode=hashed)
        for name in _LIBRARIES:
            with suppress(ImportError):
                importlib.import_module(name)
        ours = {name.partition(".")[0] for name in sys.modules} & set(_PACKAGES)
        assert not ours, f"loaded before the mutants: {ours}"

    def limit_s(self, part: Part) -> float:
        """Return how long a mutant's tests may take; RuntimeError if they fail without any mutant."""
        if part not in self._limits_s:
            for _ in range(2):  # the second time what they import is compiled
                before_s = time.monotonic()
                outcome, by = self._outcome(part, _CLEAN_S, keep_compiled=True)
                if outcome != _SURVIVED:
                    log = self._log.read_text(encoding="utf-8", errors="replace")[-3000:]
                    raise RuntimeError(f"{log}\nthe tests fail without a mutant: {outcome} {by}")
            clean_s = time.monotonic() - before_s
            self._limits_s[part] = max(_FACTOR * clean_s, _LEAST_S)
            print(f"{' '.join(part.sources)}: the tests take {clean_s:.1f} s", flush=True)
        return self._limits_s[part]

    def outcome(self, mutant: Mutant, changed: str) -> tuple[str, str]:
        """Return what the tests make of a mutant, and the one that failed."""
        limit_s = self.limit_s(mutant.part)
        path = self._copy / mutant.file
        text = path.read_text(encoding="utf-8")
        path.write_text(changed, encoding="utf-8")
        try:
            return self._outcome(mutant.part, limit_s, keep_compiled=False)
        finally:
            path.write_text(text, encoding="utf-8")

    def _outcome(self, part: Part, limit_s: float, *, keep_compiled: bool) -> tuple[str, str]:
        shutil.rmtree(self._scratch, ignore_errors=True)
        sys.stdout.flush()
        pid = os.fork()
        if not pid:
            self._run_tests(part, keep_compiled)
        ended = os.pidfd_open(pid)
        try:
            in_time = bool(select.select([ended], [], [], limit_s)[0])
        finally:
            os.close(ended)
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
            status = os.waitpid(pid, 0)[1]
            _end_orphans()
        if not in_time:
            return _TIME, ""
        if status == 0:
            return _SURVIVED, ""
        log = self._log.read_text(encoding="utf-8", errors="replace")
        failed = re.search(r"^(?:FAILED|ERROR) (\S+)", log, re.MULTILINE)
        return _CAUGHT, failed[1] if failed else "(it cannot be imported)"

    def _run_tests(self, part: Part, keep_compiled: bool) -> None:
        """Run the tests and end this process."""
        code = 70
        try:
            os.setsid()
            resource.setrlimit(resource.RLIMIT_DATA, (_MOST_BYTES, _MOST_BYTES))
            nothing = os.open(os.devnull, os.O_RDONLY)
            log = os.open(self._log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
            for end, descriptor in ((0, nothing), (1, log), (2, log)):
                os.dup2(descriptor, end)
            os.chdir(self._copy)
            sys.path[:] = [str(self._copy), *(each for each in sys.path if Path(each).resolve() != ROOT)]
            os.environ |= {
                "PYTHONPATH": str(self._copy),
                "PYTHONDONTWRITEBYTECODE": "" if keep_compiled else "1",
            }
            sys.dont_write_bytecode = not keep_compiled
            import pytest
            from hypothesis import Phase, settings

            phases = (Phase.explicit, Phase.generate)  # whether it fails is asked, not how little is enough
            settings.register_profile("mutants", database=None, derandomize=True, phases=phases)
            settings.load_profile("mutants")
            words = ["-x", "-p", "no:cacheprovider", "--basetemp", str(self._scratch)]
            words += ["-W", "ignore::pytest.PytestAssertRewriteWarning"]  # hypothesis is loaded already
            code = int(pytest.main([*words, *part.tests]))
        except BaseException:
            traceback.print_exc()
        finally:
            os._exit(code)


def _adopt_orphans() -> None:
    """Become the parent of what tests start and leave: a watchdog that is a mutant may never end."""
    if ctypes.CDLL(None, use_errno=True).prctl(_SET_CHILD_SUBREAPER, 1, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "prctl")


def _end_orphans() -> None:
    """End the processes that are children of this one now that their parents have ended."""
    while True:
        table = Path(f"/proc/{os.getpid()}/task/{os.getpid()}/children")
        children = [int(word) for word in table.read_text(encoding="ascii").split()]
        if not children:
            return
        for child in children:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


class Kept:
    """Results of a room from run to run, by mutant, with what they hold for."""

    def __init__(self, room: str) -> None:
        self._path = _KEPT / f"{room}.json"
        self._rows: dict[str, dict[str, str]] = {}
        if self._path.exists():
            self._rows = json.loads(self._path.read_text(encoding="utf-8"))

    def row(self, mutant: Mutant) -> dict[str, str] | None:
        """Return what was found, if it still holds."""
        row = self._rows.get(mutant.key)
        if row is None or row["source"] != _digest(mutant.file):
            return None
        return None if row["outcome"] == _SURVIVED and row["tests"] != _digest(*mutant.part.tests) else row

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


def _tried(room: str, count: int, trials: Trials) -> list[tuple[Mutant, dict[str, str]]]:
    """Return the room's mutants with what became of each; those known already are not run again."""
    kept, mutants = Kept(room), _drawn(room, count)
    found = []
    for number, mutant in enumerate(mutants, 1):
        row = kept.row(mutant)
        if row is None:
            text = (ROOT / mutant.file).read_text(encoding="utf-8")
            changed = _mutated(mutant, text)
            assert changed is not None
            row = kept.keep(mutant, *trials.outcome(mutant, changed), _change(text, changed))
            place = f"{mutant.file}:{mutant.line} {mutant.function}: {row['change']}"
            print(f"{room}, {number} of {len(mutants)}: {row['outcome']}, {place} {row['by']}", flush=True)
        found.append((mutant, row))
    return found


def _lines(room: str, found: Sequence[tuple[Mutant, dict[str, str]]]) -> list[str]:
    """Return the room's share and its survivors."""
    alive = [(mutant, row["change"]) for mutant, row in found if row["outcome"] == _SURVIVED]
    late = sum(row["outcome"] == _TIME for _, row in found)
    share = _share(found)
    head = f"**{room}**: {len(found) - len(alive)} of {len(found)} caught, {share:.1%} ({late} by time)."
    places = sorted(alive, key=lambda each: (each[0].file, each[0].line))
    return [head, "", *(f"* {own.file}:{own.line} `{own.function}`: {change}" for own, change in places), ""]


def _share(found: Sequence[tuple[Mutant, dict[str, str]]]) -> float:
    return sum(row["outcome"] != _SURVIVED for _, row in found) / max(len(found), 1)


def main() -> int:
    """Try the mutants; 1 if a room's tests catch less than 85 %."""
    words = [word for word in sys.argv[1:] if word != "--write"]
    count = int(words.pop(0)) if words and words[0].isdigit() else _SAMPLE
    if unknown := set(words) - set(ROOMS):
        raise SystemExit(f"no such room: {', '.join(sorted(unknown))}. There are {', '.join(ROOMS)}.")
    lines, shares = [], []
    with tempfile.TemporaryDirectory() as folder:
        trials = Trials(Path(folder))
        for room in words or ROOMS:
            found = _tried(room, count, trials)
            lines += _lines(room, found)
            shares.append(_share(found))
    print("\n".join(["", *lines]))
    if "--write" in sys.argv:
        from benchmarks._sections import write_section  # ours: not before the tests' processes were forked

        write_section("Mutants", f"python -m benchmarks.mutants {count}", lines)
    return 0 if min(shares) >= _GOAL else 1


if __name__ == "__main__":
    sys.exit(main())
