"""Does a test fail when what it guards is switched off? Each mechanism of the three promises, one at a time.

Run as `python -m benchmarks.guards [PART/PARTS | --new | WORDS]`: all, one of so many parts, those that the table
does not have yet, or those whose name has the WORDS. Writes its section of benchmarks/reliability.md after each,
beside the rows that are there: what is broken off goes on with `--new`.

A mechanism is named by its function and by what is done to it: a call left out, a condition that never or always
holds, an expression replaced, another value. That is done to the syntax tree, so that only a change of what the
code says loses it, not one of how it is written. The test that guards it runs in a copy of the tree: it must pass
before and fail after. 1 if a mechanism has no guard, or if what is to be changed is not found exactly once.
"""

from __future__ import annotations

import ast
import re
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from benchmarks._sections import COMMIT, section, write_section
from benchmarks._trial import NO_TEST, PASSED, ROOT, TIME, Copy

_LIMIT_S = 120.0
"""Processor time that a guard may take."""
_TITLE, _NONE = "Guards", "NONE"


@dataclass(frozen=True)
class Swap:
    """An expression or a statement of the function is replaced by another one."""

    part: str
    other: str

    def instead_of(self, node: ast.AST) -> ast.AST | None:
        """Return what takes the node's place, None where it stays."""
        if ast.dump(node) != ast.dump(_parsed(self.part)):
            return None
        other: ast.AST = _parsed(self.other)
        return other


def never(condition: str) -> Swap:
    """The condition never holds: its branch is gone."""
    return Swap(condition, "False")


def always(condition: str) -> Swap:
    """The condition always holds."""
    return Swap(condition, "True")


@dataclass(frozen=True)
class Skip:
    """The call that stands as a statement is left out."""

    called: str

    def instead_of(self, node: ast.AST) -> ast.AST | None:
        """Return what takes the node's place, None where it stays."""
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
            return ast.Pass() if ast.unparse(node.value.func) == self.called else None
        return None


@dataclass(frozen=True)
class Argument:
    """A call gets another value for an argument, or a dictionary for a key."""

    name: str
    value: str

    def instead_of(self, node: ast.AST) -> ast.AST | None:
        """Return what takes the node's place, None where it stays."""
        if isinstance(node, ast.keyword) and node.arg == self.name:
            return ast.keyword(self.name, _parsed(self.value))
        if isinstance(node, ast.Dict):
            for number, key in enumerate(node.keys):
                if isinstance(key, ast.Constant) and key.value == self.name:
                    node.values[number] = _parsed(self.value)
                    return node
        return None


@dataclass(frozen=True)
class Value:
    """A function returns this and does nothing else; a constant or a field has this value."""

    value: str

    def instead_of(self, node: ast.AST) -> ast.AST | None:
        """Return what takes the node's place, None where it stays."""
        if isinstance(node, ast.FunctionDef):
            node.body = [ast.Return(_parsed(self.value))]
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            node.value = _parsed(self.value)
        else:
            return None
        return node


@dataclass(frozen=True)
class Also:
    """A module says one thing more."""

    statement: str

    def instead_of(self, node: ast.AST) -> ast.AST | None:
        """Return what takes the node's place, None where it stays."""
        if not isinstance(node, ast.Module):
            return None
        node.body += ast.parse(self.statement).body
        return node


def _parsed(text: str) -> Any:
    (statement,) = ast.parse(text).body
    return statement.value if isinstance(statement, ast.Expr) else statement


@dataclass(frozen=True)
class Mechanism:
    """What is switched off: `change` is made to `place`, "module:function"; `guard` must see it."""

    promise: int
    name: str
    place: str
    change: Swap | Skip | Argument | Value | Also
    guard: str

    @property
    def file(self) -> str:
        """The file of the module."""
        stem = self.place.partition(":")[0].replace(".", "/")
        return f"{stem}/__init__.py" if (ROOT / stem).is_dir() else f"{stem}.py"

    def switched_off(self, text: str) -> str:
        """Return the file's text without the mechanism; ValueError unless it is there exactly once."""
        tree = ast.parse(text)
        places = (
            [tree] if ":" not in self.place else list(_named(tree, self.place.partition(":")[2].split(".")))
        )
        swapper = _Swapper(self.change)
        places = [swapper.visit(place) for place in places]
        if len(places) != 1 or swapper.times != 1:
            raise ValueError(
                f"{self.place}: {len(places)} times there, and {self.change} {swapper.times} times"
            )
        return ast.unparse(ast.fix_missing_locations(tree))


class _Swapper(ast.NodeTransformer):
    def __init__(self, change: Swap | Skip | Argument | Value | Also) -> None:
        self._change, self.times = change, 0

    def visit(self, node: ast.AST) -> ast.AST:
        other = self._change.instead_of(node)
        if other is None:
            return self.generic_visit(node)
        self.times += 1
        return other


def _named(tree: ast.AST, names: list[str]) -> list[ast.AST]:
    """Return the functions, classes, constants or fields of a dotted name."""
    if not names:
        return [tree]
    found: list[ast.AST] = []
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            own = [node.name]
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            own = [ast.unparse(target) for target in targets]
        else:
            own = []
        if names[0] in own:
            found += _named(node, names[1:])
    return found


_RECORDING, _CONTROL, _PANEL = "bench.record.recording", "bench.control", "bench.present.panel"
_T_JOURNAL, _T_CUT = "tests/record/recording/test_journal.py", "tests/reliability/test_power_cut.py"
_T_WHOLE, _T_RUNS = "tests/safety/test_whole_files.py", "tests/record/recording/test_runs.py"
_T_SESSION, _T_DOG = "tests/control/test_session.py", "tests/reliability/test_watchdog.py"
_T_LIMITS, _T_LEASE = "tests/integration/test_limits.py", "tests/control/test_lease.py"
_T_FILES, _T_PANEL = "tests/safety/test_hostile_files.py", "tests/present/panel/test_panel_parts.py"
_T_SIGN_IN = "tests/present/panel/test_panel_sign_in.py"
_T_VISITORS, _T_TYPES = (
    "tests/present/panel/test_panel_visitors.py",
    "tests/integration/test_manifest_types.py",
)
_T_CODE, _T_RECOVER = "tests/contracts/test_nothing_executes.py", "tests/record/recording/test_recover.py"

MECHANISMS = (
    Mechanism(
        1,
        "bytes are written four times in the interval",
        f"{_RECORDING}._journal:Journal.__init__",
        Swap("min(flush_interval_s, _LONGEST_INTERVAL_S) / 4.0", "400.0 * flush_interval_s"),
        _T_JOURNAL,
    ),
    Mechanism(
        1, "what is written is synced", f"{_RECORDING}._events:AppendFile.sync", Skip("sync_data"), _T_CUT
    ),
    Mechanism(
        1,
        "a mark never speaks of bytes that are not there",
        f"{_RECORDING}._journal:_Direction.write",
        Swap("self._handed_on - len(self.data.pending)", "self._handed_on"),
        _T_JOURNAL,
    ),
    Mechanism(
        1,
        "a disk that is full is told",
        f"{_RECORDING}._events:AppendFile.write",
        Swap("raise record_error(self.path, error) from error", "return"),
        _T_JOURNAL,
    ),
    Mechanism(
        1,
        "a disk that stalls stalls nobody",
        f"{_RECORDING}._journal:Journal.check",
        Swap("self._writer.wake", "self._write"),
        _T_JOURNAL,
    ),
    Mechanism(
        1,
        "memory does not run out behind a slow disk",
        f"{_RECORDING}._journal:Journal.check",
        never("waiting > _MOST_WAITING_BYTES"),
        _T_JOURNAL,
    ),
    Mechanism(
        1,
        "a run folder that was moved or whose mount is gone is told",
        f"{_RECORDING}._journal:Journal._sync",
        never("_place(self.folder) != self._place"),
        _T_JOURNAL,
    ),
    Mechanism(
        1, "a torn event is cut off by recovery", f"{_CONTROL}.recover:_cut_events", Skip("_cut"), _T_CUT
    ),
    Mechanism(
        1, "a torn mark is cut off by recovery", f"{_CONTROL}.recover:_complete", Skip("_cut"), _T_RECOVER
    ),
    Mechanism(
        1,
        "a recovered run is not complete",
        f"{_CONTROL}.recover:_complete",
        Argument("outcome", "'completed'"),
        _T_CUT,
    ),
    Mechanism(
        1,
        "a run that may still go on is left alone",
        f"{_CONTROL}.recover:recover",
        never("holder is not None"),
        _T_RECOVER,
    ),
    Mechanism(
        1,
        "checksums are compared",
        f"{_RECORDING}._verify:_compare_files",
        never("(found := checksum(path)) != entry"),
        _T_RUNS,
    ),
    Mechanism(
        1,
        "tables are rebuilt and compared",
        f"{_RECORDING}._verify:_compare_columns",
        always("left.tobytes() == right.tobytes()"),
        _T_RUNS,
    ),
    Mechanism(
        1,
        "a result takes the old one's place in one piece",
        "drivers.base.files:replace_file",
        Swap("path.with_name(f'{path.name}.part')", "path"),
        _T_WHOLE,
    ),
    Mechanism(
        1,
        "a result is on the disk before it takes the place",
        "drivers.base.files:replace_file",
        Skip("os.fsync"),
        _T_WHOLE,
    ),
    Mechanism(
        1,
        "files of two results do not lie side by side",
        "bench.analysis.common.state_file:saved_together",
        Skip("(folder / name).unlink"),
        _T_WHOLE,
    ),
    Mechanism(
        2,
        "stop commands leave before any answer is awaited",
        f"{_CONTROL}.safe_state:_Way._command_all",
        Skip("device.halt"),
        "tests/integration/test_aborts.py::test_stop_commands_leave_on_both_ports_before_any_answer_is_awaited",
    ),
    Mechanism(
        2,
        "safe is what is read back",
        f"{_CONTROL}.safe_state:_await_rest",
        always("rest.reached"),
        _T_SESSION,
    ),
    Mechanism(
        2,
        "a device that fails does not keep the other from being told",
        f"{_CONTROL}.safe_state:_Way._command",
        Swap("BenchError", "KeyError"),
        _T_SESSION,
    ),
    Mechanism(
        2,
        "the loss of another port is no end",
        f"{_CONTROL}.safe_state:_in_spite_of_others",
        always("_is_gone(device)"),
        _T_SESSION,
    ),
    Mechanism(
        2,
        "a way to the safe state that is cut off is not confirmed",
        f"{_CONTROL}.session:Bench.make_safe",
        Swap("tuple(Reading(code='cut_off').fact(name, cause, why) for name in devices)", "()"),
        _T_SESSION,
    ),
    Mechanism(
        2,
        "a polled port that goes away is known at once",
        "drivers.base.clock:WallClock._select",
        Swap("[port for port in self._polled if port not in ports]", "[]"),
        "tests/drivers/test_clock.py -k what_a_polled_port",
    ),
    Mechanism(
        2,
        "a signal stops the run",
        f"{_CONTROL}.signals:asking.ask",
        Skip("clock.interrupt.request"),
        "tests/integration/test_aborts.py::test_signals_to_a_run_on_the_wall_clock",
    ),
    Mechanism(
        2,
        "what is no yes is no consent",
        f"{_CONTROL}.questions:agreed",
        Swap("consents(reply.answer)", "True"),
        "tests/control/test_questions.py",
    ),
    Mechanism(
        2,
        "a question drops what was typed before it",
        f"{_CONTROL}.questions:Console._read.read",
        Skip("drop_typed"),
        "tests/control/test_questions.py",
    ),
    Mechanism(
        2,
        "the way to an angle is held against the rules",
        f"{_CONTROL}.limits:_may_pass",
        Value("False"),
        "tests/control/test_ways.py",
    ),
    Mechanism(
        2,
        "an axis with stops is never spun",
        f"{_CONTROL}.ways:require_no_stops",
        Value("None"),
        "tests/control/test_ways.py",
    ),
    Mechanism(
        1,
        "a signal waits until the record is closed",
        f"{_CONTROL}.signals:held.wait",
        Skip("came.append"),
        "tests/control/test_signals.py",
    ),
    Mechanism(
        2,
        "a lost last unit ends the run",
        f"{_CONTROL}.session:Bench._lose",
        Skip("self._stream_watchdog.lose"),
        "tests/integration/test_lost_units.py::test_the_last_gyro_that_dies_ends_the_run_a_minute_later",
    ),
    Mechanism(
        2,
        "the watchdog takes over from the dead",
        f"{_CONTROL}.watchdog._process:main",
        Swap("silent_s = None", "return 0"),
        f"{_T_DOG} -k 9-runner_ended",
    ),
    Mechanism(
        2,
        "the watchdog takes over from one that hangs",
        f"{_CONTROL}.watchdog._silence:HUNG_S",
        Value("2e6"),
        "tests/safety/test_starved_runner.py",
    ),
    Mechanism(
        2,
        "who stops the runner does not stop its watchdog",
        f"{_CONTROL}.watchdog._process:main",
        Skip("signal.signal"),
        f"{_T_DOG} -k 9-runner_ended",
    ),
    Mechanism(
        2,
        "the watchdog is armed",
        f"{_CONTROL}.runner:_drive",
        Skip("watchdog.arm"),
        f"{_T_DOG} -k 9-runner_ended",
    ),
    Mechanism(
        2,
        "a second watchdog stands by",
        f"{_CONTROL}.watchdog:Watchdog.arm",
        Skip("self._start"),
        "tests/safety/test_watchdogs_of_a_runner.py -k dismisses_both",
    ),
    Mechanism(
        2,
        "the second watchdog does what the first does not",
        f"{_CONTROL}.watchdog._process:main",
        always("first is not None and first.has_done_it(order.run_folder / FOLDER, begins_within_s)"),
        f"{_T_DOG} -k when_runner_and_first_watchdog",
    ),
    Mechanism(
        2,
        "a first watchdog that stands still in its work is ended",
        f"{_CONTROL}.watchdog._other:Other.has_done_it",
        never("now_s - since_s > patience_s"),
        "tests/safety/test_second_watchdog.py",
    ),
    Mechanism(
        2,
        "rules are asked before a command and on telemetry",
        f"{_CONTROL}.limits:breaks",
        Value("False"),
        _T_LIMITS,
    ),
    Mechanism(
        2,
        "telemetry is held against the limits",
        f"{_CONTROL}.limits:check_telemetry",
        Value("None"),
        _T_SESSION,
    ),
    Mechanism(
        2,
        "the ramp of the air is held against its limit",
        f"{_CONTROL}.limits:check_ramp",
        Value("None"),
        _T_LIMITS,
    ),
    Mechanism(
        2,
        "a rate is held against its limit before it is sent",
        f"{_CONTROL}.table_station:TableStation.check",
        never("max_rate_dps > allowed"),
        "tests/integration/test_trouble.py -k beyond",
    ),
    Mechanism(
        2,
        "an axis beyond its stops ends the run",
        f"{_CONTROL}.ways:check_stops",
        Value("None"),
        "tests/control/test_limits.py",
    ),
    Mechanism(2, "one user a bench", f"{_CONTROL}.lease:_lock", Skip("take_lock"), _T_LEASE),
    Mechanism(
        2, "a stale lease is recognised", f"{_CONTROL}.lease:take_lease", Skip("stale.append"), _T_LEASE
    ),
    Mechanism(
        2,
        "a platform's port is leased",
        "bench.record.benchfile._model:BenchFile.ports",
        Swap("{device.name: device.port for device in devices}", "{}"),
        _T_LEASE,
    ),
    Mechanism(
        3,
        "the panel listens on this machine",
        f"{_PANEL}._settings:PanelSettings.host",
        Value("'0.0.0.0'"),
        _T_CODE,
    ),
    Mechanism(
        3,
        "an open panel wants a token",
        f"{_PANEL}._settings:PanelSettings.check",
        never("self.token is None and self.operators is None and not is_local(self.host)"),
        _T_PANEL,
    ),
    Mechanism(
        3,
        "without the token nothing is served",
        f"{_PANEL}._access:Access._visit",
        always("self._token is None or self._bears_token(request) or self._equal(cookie)"),
        _T_PANEL,
    ),
    Mechanism(
        3,
        "tokens are compared in constant time",
        f"{_PANEL}._access:Access._equal",
        Value("given == self._token"),
        _T_CODE,
    ),
    Mechanism(
        3,
        "no requests from other sites' pages",
        f"{_PANEL}._access:Access._refused",
        never("origin is not None and origin.partition('://')[2] != host"),
        _T_PANEL,
    ),
    Mechanism(
        3,
        "no name of another site's that leads here",
        f"{_PANEL}._access:Access._refused",
        never("host_name(host) not in LOCAL_NAMES"),
        _T_PANEL,
    ),
    Mechanism(
        3,
        "a role that is not enough gets no further",
        f"{_PANEL}._access:Access._passed",
        never("not may(visit.role, needs)"),
        _T_SIGN_IN,
    ),
    Mechanism(
        3,
        "whoever has not signed in sees the door only",
        f"{_PANEL}._access:Access._passed",
        always("self._sessions is not None and path.startswith(_OPEN)"),
        _T_SIGN_IN,
    ),
    Mechanism(
        3,
        "a session ends with its operator's password",
        f"{_PANEL}._sign_in:Sessions.of",
        always("found is not None and found.name == name and (_stamp(found) == stamp)"),
        _T_SIGN_IN,
    ),
    Mechanism(
        3,
        "who guesses passwords waits",
        f"{_PANEL}._sign_in:Doorkeeper._require_patience",
        never("wrong >= _FREE_TRIES"),
        _T_SIGN_IN,
    ),
    Mechanism(
        3,
        "no password crosses a network in the open",
        f"{_PANEL}._settings:PanelSettings._check_sign_in",
        never("self.certificate is None and (not self.tls_elsewhere) and (not is_local(self.host))"),
        _T_SIGN_IN,
    ),
    Mechanism(
        3,
        "no path from the web leads out",
        f"{_PANEL}._folders:RunsFolder.inside",
        never("path == self.root"),
        _T_PANEL,
    ),
    Mechanism(
        3,
        "no path of a session leads out",
        f"{_PANEL}._folders:RunsFolder.within",
        always("real.is_relative_to(self.root)"),
        _T_PANEL,
    ),
    Mechanism(
        3,
        "no name in a manifest leads out",
        f"{_RECORDING}._manifest:_inside",
        never("any(part in ('', '.', '..') for part in name.split('/'))"),
        _T_FILES,
    ),
    Mechanism(
        3,
        "no run id leads out",
        f"{_CONTROL}.run_record:_new_folder",
        never("name == '..' or Path(name).name != name or not name.isprintable()"),
        _T_FILES,
    ),
    Mechanism(
        3,
        "no pipe or device is read",
        "drivers.base.files:read_bounded",
        never("not stat.S_ISREG(os.fstat(descriptor).st_mode)"),
        f"{_T_FILES} -k device",
    ),
    Mechanism(
        3,
        "no more is read than is allowed",
        "drivers.base.files:read_bounded",
        never("len(content) > most_bytes"),
        f"{_T_FILES} -k as_many",
    ),
    Mechanism(
        3, "no TOML is nested without end", "drivers.base.files:parse_toml", always("not level"), _T_FILES
    ),
    Mechanism(
        3,
        "no JSON is nested without end",
        "drivers.base.files:parse_json",
        Swap("RecursionError", "KeyError"),
        _T_FILES,
    ),
    Mechanism(
        3,
        "no archive unpacks to more than it may",
        "drivers.base.arrays:read_archive",
        never("sum(sizes.values()) > _MOST_BYTES"),
        _T_FILES,
    ),
    Mechanism(
        3, "no table is larger than the memory", f"{_RECORDING}._read:check_room", Value("None"), _T_FILES
    ),
    Mechanism(
        3,
        "text in a report stays text",
        "bench.present.report._layout:_environment",
        Argument("autoescape", "False"),
        "tests/present/report/test_report_html.py",
    ),
    Mechanism(
        3, "nothing is evaluated, no pickle is loaded", f"{_CONTROL}.history", Also("import pickle"), _T_CODE
    ),
    Mechanism(
        3,
        "a known vulnerability fails the audit",
        "benchmarks.audit:main",
        Swap("1 if verdict.reachable else 0", "0"),
        "tests/safety/test_audit.py",
    ),
    Mechanism(
        3,
        "who asks for nothing is put out in time",
        f"{_PANEL}._visitors:Visitor._wait",
        Swap("REQUEST_S", "1e6"),
        f"{_T_VISITORS} -k in_time",
    ),
    Mechanism(
        3,
        "who asks for nothing does not fill the doorway",
        f"{_PANEL}._visitors:Visitor._wait",
        never("len(self._waiting) > MOST_WAITING"),
        f"{_T_VISITORS} -k doorway",
    ),
    Mechanism(
        3,
        "a manifest has numbers where readers count on them",
        f"{_RECORDING}._free_parts:check_free_parts",
        Skip("FreeParts.model_validate"),
        f"{_T_TYPES} -k file_and_key",
    ),
    Mechanism(
        3,
        "an event has numbers where readers count on them",
        "bench.record.events._base:Number",
        Value("Any"),
        "tests/record/test_typed_events.py -k another_type",
    ),
    Mechanism(
        3,
        "no DBC file takes more computing than it may",
        "drivers.can_dbc._read_dbc:main",
        Swap("(cpu_s, cpu_s)", "(200, 200)"),
        "tests/drivers/test_can_dbc_signals.py -k two_kilobytes",
    ),
    Mechanism(
        3,
        "a process of ours imports nothing from the current folder",
        "bench.lab._process:LabProcess.__init__",
        Swap("[sys.executable, '-P', '-m', 'simulators.lab']", "[sys.executable, '-m', 'simulators.lab']"),
        f"{_T_CODE} -k current_folder",
    ),
    Mechanism(
        3,
        "workers of a command import nothing from the current folder",
        "bench.present.cli._app:main",
        Swap("os.environ['PYTHONSAFEPATH'] = '1'", "pass"),
        f"{_T_CODE} -k workers",
    ),
    Mechanism(
        3,
        "a port is a device or a socket",
        "drivers.kit.places:check_place",
        never("separator and scheme.lower() != 'socket'"),
        f"{_T_FILES} -k port_writes",
    ),
    Mechanism(
        3,
        "text of a file is no command to the terminal",
        "bench.present.cli._console:Terminal.render",
        never("segment.control is None and not segment.text.isprintable()"),
        f"{_T_FILES} -k terminal",
    ),
    Mechanism(
        3,
        "text of a file is no markup",
        "bench.present.cli._console:Terminal.__init__",
        Argument("markup", "True"),
        f"{_T_FILES} -k terminal",
    ),
    Mechanism(
        3,
        "no key has thousands of parts",
        "drivers.base.files:parse_toml",
        never("_LONG_KEY.search(_ASIDE.sub('q', text))"),
        f"{_T_FILES} -k thousands_of_parts",
    ),
    Mechanism(
        3,
        "an exported cell is no formula",
        "bench.record.exchange._export:_cell",
        always("text[:1].isalnum()"),
        f"{_T_FILES} -k formula",
    ),
)


class Guards:
    """Switches mechanisms off in a copy of the sources."""

    def __init__(self, folder: Path) -> None:
        self._copy = Copy(folder)
        self._sound: set[str] = set()
        """Guards that pass with nothing switched off."""

    def switch_off(self, mechanism: Mechanism) -> str:
        """Return the test that fails without the mechanism, or why there is none."""
        guard = mechanism.guard.split()
        try:
            changed = mechanism.switched_off((ROOT / mechanism.file).read_text(encoding="utf-8"))
        except ValueError as error:
            return f"{_NONE}: {error}"
        if mechanism.guard not in self._sound:
            before = self._copy.run(guard, _LIMIT_S, keep_compiled=True)
            if before.kind != PASSED:
                print(self._copy.said()[-2000:], file=sys.stderr)
                return f"{_NONE}: {before.test} {before.kind} with nothing switched off"
            self._sound.add(mechanism.guard)
        with self._copy.changed(mechanism.file, changed):
            after = self._copy.run(guard, _LIMIT_S)
        if after.kind == PASSED or after.test == NO_TEST:
            print(self._copy.said()[-2000:], file=sys.stderr)
            return f"{_NONE}: {mechanism.guard} {after.kind} {after.test}"
        return (
            f"`{guard[0].partition('::')[0]}` (it does not end)" if after.kind == TIME else f"`{after.test}`"
        )


def _kept() -> dict[str, str]:
    """Return the rows of the table by mechanism."""
    rows = [line.split(" | ") for line in section(_TITLE).splitlines() if line.startswith("| ")]
    return {cells[1]: " | ".join(cells) for cells in rows if len(cells) == 4}


def _chosen(words: list[str]) -> list[Mechanism]:
    if words == ["--new"]:
        return [mechanism for mechanism in MECHANISMS if mechanism.name not in _kept()]
    if words and (part := re.fullmatch(r"(\d+)/(\d+)", words[0])):
        return list(MECHANISMS[int(part[1]) - 1 :: int(part[2])])
    return [mechanism for mechanism in MECHANISMS if " ".join(words) in mechanism.name]


def _write(rows: dict[str, str]) -> str:
    known = [mechanism.name for mechanism in MECHANISMS]
    bad = [name for name in known if name in rows and _NONE in rows[name]]
    untried = [name for name in known if name not in rows]
    lines = [
        f"{len(known) - len(untried)} of {len(known)} mechanisms switched off, {len(bad)} without a guard.",
        "",
        "| promise | mechanism | test that fails without it | commit |",
        "|---|---|---|---|",
        *(rows[name] for name in known if name in rows),
        "",
        *([f"Not tried yet: {'; '.join(untried)}."] if untried else []),
    ]
    return write_section(_TITLE, "python -m benchmarks.guards", lines)


def main() -> int:
    """Switch each mechanism off, run its guard, write the section; 1 if one is not guarded."""
    chosen, rows, bad = _chosen(sys.argv[1:]), _kept(), 0
    with tempfile.TemporaryDirectory() as root:
        guards = Guards(Path(root))
        for number, mechanism in enumerate(chosen, 1):
            test = guards.switch_off(mechanism)
            bad += _NONE in test
            rows[mechanism.name] = f"| {mechanism.promise} | {mechanism.name} | {test} | {COMMIT} |"
            print(f"{number} of {len(chosen)}: {rows[mechanism.name]}", flush=True)
            _write(rows)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
