"""Does a test fail when what it guards is switched off? Each mechanism of the three promises, one at a time.

Run as `python -m benchmarks.guards [PART/PARTS | --new | WORDS]`: all, one of so many parts, those that the table
does not have yet, or those whose name has the WORDS. Writes its section of benchmarks/reliability.md after each,
beside the rows that are there: what is broken off goes on with `--new`. In a copy of the sources a few characters
are changed that take the mechanism away, and the test that guards it is run there: it must pass before and fail
after. 1 if a mechanism has no guard, or if the text to be changed is not found exactly once.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from benchmarks._sections import COMMIT, section, write_section

ROOT = Path(__file__).parents[1]
_COPIED = (
    ".ci",
    "bench",
    "drivers",
    "simulators",
    "procedures",
    "benchmarks",
    "tests",
    "examples",
    "pyproject.toml",
)
_TIMEOUT_S = 200
_TITLE, _NONE, _NO_RUN = "Guards", "NONE", "(no test was run)"


@dataclass(frozen=True)
class Mechanism:
    """What is switched off: in `file` the text `on` becomes `off`; `guard` is the test that must see it."""

    promise: int
    name: str
    file: str
    on: str
    off: str
    guard: str


_JOURNAL, _APPEND, _RECOVER = (
    "bench/record/recording/_journal.py",
    "bench/record/recording/_append.py",
    "bench/control/recover.py",
)
_FILES, _STATE, _SAFE = (
    "drivers/base/files.py",
    "bench/analysis/common/state_file.py",
    "bench/control/safe_state.py",
)
_GUARDIAN, _SESSION = "bench/control/watchdog/_process.py", "bench/control/session.py"
_LIMITS, _WATCH = "bench/control/limits.py", "bench/control/limit_watch.py"
_ACCESS, _FOLDERS = "bench/present/panel/_access.py", "bench/present/panel/_folders.py"
_T_JOURNAL, _T_CUT = "tests/record/recording/test_journal.py", "tests/reliability/test_power_cut.py"
_T_WHOLE, _T_RUNS = "tests/safety/test_whole_files.py", "tests/record/recording/test_runs.py"
_T_SESSION, _T_DOG = "tests/control/test_session.py", "tests/reliability/test_watchdog.py"
_T_LIMITS, _T_LEASE = "tests/integration/test_limits.py", "tests/control/test_lease.py"
_T_FILES, _T_PANEL = "tests/safety/test_hostile_files.py", "tests/present/panel/test_panel_parts.py"
_VISITORS, _T_VISITORS = "bench/present/panel/_visitors.py", "tests/present/panel/test_panel_visitors.py"
_T_TYPES = "tests/integration/test_manifest_types.py"
_T_CODE = "tests/contracts/test_nothing_executes.py"

MECHANISMS = (
    Mechanism(
        1,
        "bytes are written four times in the interval",
        _JOURNAL,
        "_LONGEST_INTERVAL_S) / 4.0",
        "_LONGEST_INTERVAL_S) * 400.0",
        _T_JOURNAL,
    ),
    Mechanism(1, "what is written is synced", _APPEND, "os.fdatasync(self._fd)", "pass", _T_CUT),
    Mechanism(
        1,
        "a mark never speaks of bytes that are not there",
        _JOURNAL,
        "self._write_marks(self._handed_on - len(self.data.pending))",
        "self._write_marks(self._handed_on)",
        _T_JOURNAL,
    ),
    Mechanism(
        1,
        "a disk that is full is told",
        _APPEND,
        "raise record_error(self.path, error) from error\n        finally",
        "return\n        finally",
        _T_JOURNAL,
    ),
    Mechanism(
        1,
        "a disk that stalls stalls nobody",
        _JOURNAL,
        "if waiting >= _BLOCK_BYTES:\n            self._writer.wake()",
        "if waiting >= _BLOCK_BYTES:\n            self._write()",
        _T_JOURNAL,
    ),
    Mechanism(
        1,
        "memory does not run out behind a slow disk",
        _JOURNAL,
        "if waiting > _MOST_WAITING_BYTES:",
        "if False:",
        _T_JOURNAL,
    ),
    Mechanism(
        1,
        "a run folder that was moved or whose mount is gone is told",
        _JOURNAL,
        "_place(self.folder) != self._place",
        "False",
        _T_JOURNAL,
    ),
    Mechanism(
        1,
        "a torn event is cut off by recovery",
        _RECOVER,
        "    if torn:\n        _cut(path",
        "    if False:\n        _cut(path",
        _T_CUT,
    ),
    Mechanism(
        1,
        "a torn mark is cut off by recovery",
        _RECOVER,
        "_cut(index, index.stat().st_size // _PAIR_BYTES * _PAIR_BYTES)",
        "pass",
        "tests/record/recording/test_recover.py",
    ),
    Mechanism(
        1,
        "a recovered run is not complete",
        _RECOVER,
        '"outcome": "aborted",\n                "reason"',
        '"outcome": "completed",\n                "reason"',
        _T_CUT,
    ),
    Mechanism(
        1,
        "a run that may still go on is left alone",
        _RECOVER,
        "if holder is not None:",
        "if False:",
        "tests/record/recording/test_recover.py",
    ),
    Mechanism(
        1,
        "checksums are compared",
        "bench/record/recording/_verify.py",
        "elif (found := checksum(path)) != entry:",
        "elif (found := checksum(path)) is None:",
        _T_RUNS,
    ),
    Mechanism(
        1,
        "tables are rebuilt and compared",
        "bench/record/recording/_verify.py",
        "if left.tobytes() == right.tobytes():",
        "if True:",
        _T_RUNS,
    ),
    Mechanism(
        1,
        "a result takes the old one's place in one piece",
        _FILES,
        'part = path.with_name(f"{path.name}.part")',
        "part = path",
        _T_WHOLE,
    ),
    Mechanism(
        1,
        "a result is on the disk before it takes the place",
        _FILES,
        "os.fsync(file.fileno())",
        "pass",
        _T_WHOLE,
    ),
    Mechanism(
        1,
        "files of two results do not lie side by side",
        _STATE,
        "(folder / name).unlink(missing_ok=True)",
        "pass",
        _T_WHOLE,
    ),
    Mechanism(
        2,
        "stop commands leave before any answer is awaited",
        _SAFE,
        "                device.halt()\n        for attempt",
        "                pass\n        for attempt",
        "tests/integration/test_aborts.py::test_stop_commands_leave_on_both_ports_before_any_answer_is_awaited",
    ),
    Mechanism(
        2,
        "safe is what is read back",
        _SAFE,
        "            if rest.reached:",
        "            if True:",
        _T_SESSION,
    ),
    Mechanism(
        2,
        "a device that fails does not keep the other from being told",
        _SAFE,
        "make_safe)\n        except BenchError",
        "make_safe)\n        except KeyError",
        _T_SESSION,
    ),
    Mechanism(
        2,
        "the loss of another port is no end",
        _SAFE,
        "            if _is_gone(device):\n                raise",
        "            raise",
        _T_SESSION,
    ),
    Mechanism(
        2,
        "a way to the safe state that is cut off is not confirmed",
        _SESSION,
        'tuple(Reading(code="cut_off").fact(name, cause, why) for name in stations)',
        "()",
        _T_SESSION,
    ),
    Mechanism(
        2,
        "a polled port that goes away is known at once",
        "drivers/base/clock.py",
        "others = [port for port in self._polled if port not in ports]",
        "others: list[Any] = []",
        "tests/drivers/test_clock.py -k what_a_polled_port",
    ),
    Mechanism(
        2,
        "a signal stops the run",
        "bench/control/runner.py",
        'clock.interrupt.request(f"stopped by {name}")',
        "pass",
        "tests/integration/test_aborts.py::test_signals_to_a_run_on_the_wall_clock",
    ),
    Mechanism(
        2,
        "a lost last unit ends the run",
        _SESSION,
        "        self._stream_watchdog.lose(unit, self.clock.now(), error)\n",
        "",
        "tests/integration/test_lost_units.py::test_the_last_gyro_that_dies_ends_the_run_a_minute_later",
    ),
    Mechanism(
        2,
        "the watchdog takes over from the dead",
        _GUARDIAN,
        "silent_s = None  # the runner's process has ended\n            break",
        "return 0",
        f"{_T_DOG} -k 9-the",
    ),
    Mechanism(
        2,
        "the watchdog takes over from one that hangs",
        "bench/control/watchdog/__init__.py",
        "HUNG_S = 2.0",
        "HUNG_S = 2e6",
        "tests/safety/test_starved_runner.py",
    ),
    Mechanism(
        2,
        "who stops the runner does not stop its watchdog",
        _GUARDIAN,
        "signal.signal(number, signal.SIG_IGN)",
        "pass",
        f"{_T_DOG} -k 9-the",
    ),
    Mechanism(
        2,
        "the watchdog is armed",
        "bench/control/runner.py",
        "            watchdog.arm()",
        "            pass",
        f"{_T_DOG} -k 9-the",
    ),
    Mechanism(
        2,
        "rules are asked before a command and on telemetry",
        _LIMITS,
        "        if breaks(rule, reach):",
        "        if False:",
        _T_LIMITS,
    ),
    Mechanism(
        2,
        "telemetry is held against the limits",
        _WATCH,
        'check_telemetry(limits, rate_dps, air["air_temp_c"])',
        "pass",
        _T_SESSION,
    ),
    Mechanism(
        2,
        "the ramp of the air is held against its limit",
        _WATCH,
        'check_ramp(limits, air["air_temp_c"] - before["air_temp_c"], air["time_s"] - before["time_s"])',
        "pass",
        _T_LIMITS,
    ),
    Mechanism(
        2,
        "a rate is held against its limit before it is sent",
        "bench/control/table_station.py",
        "        if max_rate_dps > allowed:",
        "        if False:",
        "tests/integration/test_trouble.py -k beyond",
    ),
    Mechanism(
        2,
        "an axis beyond its stops ends the run",
        _LIMITS,
        "if span < 360.0 and",
        "if False and",
        "tests/control/test_limits.py",
    ),
    Mechanism(
        2,
        "one user a bench",
        "bench/control/lease.py",
        "            _set_lock(descriptor, fcntl.F_WRLCK)",
        "            pass",
        _T_LEASE,
    ),
    Mechanism(
        2, "a stale lease is recognised", "bench/control/lease.py", "stale.append(left)", "pass", _T_LEASE
    ),
    Mechanism(
        2,
        "a platform's port is leased",
        "bench/control/lease.py",
        "    ports += [platform.port for platform in file.platform]\n",
        "",
        _T_LEASE,
    ),
    Mechanism(
        3,
        "the panel listens on this machine",
        "bench/present/panel/_server.py",
        'host: str = "127.0.0.1"',
        'host: str = "0.0.0.0"',
        _T_CODE,
    ),
    Mechanism(
        3,
        "an open panel wants a token",
        "bench/present/panel/_server.py",
        "if self.token is None and not is_local(self.host):",
        "if False:",
        _T_PANEL,
    ),
    Mechanism(
        3,
        "without the token nothing is served",
        _ACCESS,
        "elif self._token is None or self._has_token(headers):",
        "elif True:",
        _T_PANEL,
    ),
    Mechanism(
        3,
        "tokens are compared in constant time",
        _ACCESS,
        "hmac.compare_digest(given.encode(), self._token.encode())",
        "given == self._token",
        _T_CODE,
    ),
    Mechanism(
        3,
        "no requests from other sites' pages",
        _ACCESS,
        'origin.partition("://")[2] != host:',
        "False:",
        _T_PANEL,
    ),
    Mechanism(
        3,
        "no name of another site's that leads here",
        _ACCESS,
        "host_name(host) not in LOCAL_NAMES:",
        "False:",
        _T_PANEL,
    ),
    Mechanism(
        3,
        "no path from the web leads out",
        _FOLDERS,
        "return path if path != self.root and path.is_relative_to(self.root) else None",
        "return path",
        _T_PANEL,
    ),
    Mechanism(
        3,
        "no path of a session leads out",
        _FOLDERS,
        "return found if found.is_relative_to(self.root) else None",
        "return found",
        _T_PANEL,
    ),
    Mechanism(
        3,
        "no name in a manifest leads out",
        "bench/record/recording/_manifest.py",
        'if any(part in ("", ".", "..") for part in name.split("/")):',
        "if False:",
        _T_FILES,
    ),
    Mechanism(
        3,
        "no run id leads out",
        "bench/control/run_record.py",
        'if name == ".." or Path(name).name != name or not name.isprintable():',
        "if False:",
        _T_FILES,
    ),
    Mechanism(
        3,
        "no pipe or device is read",
        _FILES,
        "if not stat.S_ISREG(os.fstat(descriptor).st_mode):",
        "if False:",
        f"{_T_FILES} -k device",
    ),
    Mechanism(
        3,
        "no more is read than is allowed",
        _FILES,
        "if len(content) > most_bytes:",
        "if False:",
        f"{_T_FILES} -k as_many",
    ),
    Mechanism(
        3,
        "no TOML is nested without end",
        _FILES,
        '            return data\n    raise ValueError("nested too deep")',
        "            return data\n    return data",
        _T_FILES,
    ),
    Mechanism(
        3,
        "no JSON is nested without end",
        _FILES,
        'RecursionError as error:\n        raise ValueError("nested too deep") from error\n\n\ndef',
        'KeyError as error:\n        raise ValueError("nested too deep") from error\n\n\ndef',
        _T_FILES,
    ),
    Mechanism(
        3,
        "no archive unpacks to more than it may",
        "drivers/base/arrays.py",
        "if sum(sizes.values()) > _MOST_BYTES:",
        "if False:",
        _T_FILES,
    ),
    Mechanism(
        3,
        "no table is larger than the memory",
        "bench/record/recording/_read.py",
        "if 2 * 8 * rows * columns > room:",
        "if False:",
        _T_FILES,
    ),
    Mechanism(
        3,
        "text in a report stays text",
        "bench/present/report/_layout.py",
        "autoescape=True",
        "autoescape=False",
        "tests/present/report/test_report_html.py",
    ),
    Mechanism(
        3,
        "nothing is evaluated, no pickle is loaded",
        "bench/control/history.py",
        "from __future__ import annotations\n",
        "from __future__ import annotations\nimport pickle\n",
        _T_CODE,
    ),
    Mechanism(
        3,
        "a known vulnerability fails the audit",
        "benchmarks/audit.py",
        "return 1 if verdict.reachable else 0",
        "return 0",
        "tests/safety/test_audit.py",
    ),
    Mechanism(
        3,
        "who asks for nothing is put out in time",
        _VISITORS,
        "self.loop.call_later(REQUEST_S, self.put_out)",
        "self.loop.call_later(1e6, self.put_out)",
        f"{_T_VISITORS} -k in_time",
    ),
    Mechanism(
        3,
        "who asks for nothing does not fill the doorway",
        _VISITORS,
        "if len(self._waiting) > MOST_WAITING:",
        "if False:",
        f"{_T_VISITORS} -k doorway",
    ),
    Mechanism(
        3,
        "a manifest has numbers where readers count on them",
        "bench/record/recording/_shapes.py",
        "    _FREE_PARTS.validate_python(parts)",
        "    pass",
        f"{_T_TYPES} -k file_and_key",
    ),
    Mechanism(
        3,
        "an event has numbers where readers count on them",
        "bench/record/events/_base.py",
        "Number = Annotated[float, Field(strict=True, ge=-1e300, le=1e300, allow_inf_nan=False)]",
        "Number = Any",
        f"{_T_TYPES} -k event_log",
    ),
    Mechanism(
        3,
        "no DBC file takes more computing than it may",
        "drivers/can_dbc/_read_dbc.py",
        "resource.setrlimit(resource.RLIMIT_CPU, (cpu_s, cpu_s))",
        "resource.setrlimit(resource.RLIMIT_CPU, (200, 200))",
        "tests/drivers/test_can_dbc_signals.py -k two_kilobytes",
    ),
    Mechanism(
        3,
        "a process of ours imports nothing from the current folder",
        "bench/lab/prefork.py",
        '[sys.executable, "-P", "-m", "simulators.lab"],',
        '[sys.executable, "-m", "simulators.lab"],',
        f"{_T_CODE} -k current_folder",
    ),
    Mechanism(
        3,
        "workers of a command import nothing from the current folder",
        "bench/present/cli/_app.py",
        'os.environ["PYTHONSAFEPATH"] = "1"',
        "pass",
        f"{_T_CODE} -k workers",
    ),
    Mechanism(
        3,
        "a port is a device or a socket",
        "drivers/kit/link.py",
        'if separator and scheme.lower() != "socket":',
        "if False:",
        f"{_T_FILES} -k port_writes",
    ),
    Mechanism(
        3,
        "text of a file is no command to the terminal",
        "bench/present/cli/_console.py",
        "if segment.control is None and not segment.text.isprintable():",
        "if False:",
        f"{_T_FILES} -k terminal",
    ),
    Mechanism(
        3,
        "text of a file is no markup",
        "bench/present/cli/_console.py",
        '{"markup": False, "emoji": False}',
        '{"markup": True, "emoji": False}',
        f"{_T_FILES} -k terminal",
    ),
    Mechanism(
        3,
        "no key has thousands of parts",
        _FILES,
        """    if _LONG_KEY.search(
        _ASIDE.sub("q", text)
    ):""",
        "    if False:",
        f"{_T_FILES} -k thousands_of_parts",
    ),
    Mechanism(
        3,
        "an exported cell is no formula",
        "bench/record/exchange/_export.py",
        """return text if text[:1].isalnum() else f"'{text}\"""",
        "return text",
        f"{_T_FILES} -k formula",
    ),
)


def _file(guard: str) -> str:
    return guard.split()[0].split("::")[0]


def _run(copy: Path, guard: str) -> tuple[bool, str]:
    """Run a guard in the copy; return whether all passed, and the first test that did not."""
    command = [sys.executable, "-m", "pytest", "-x", "-p", "no:cacheprovider", *guard.split()]
    # started by a copy: what is changed there must not be found in the folder that is installed
    environment = os.environ | {"PYTHONPATH": str(copy)}
    try:
        done = subprocess.run(
            command,
            cwd=copy,
            env=environment,
            capture_output=True,
            text=True,
            check=False,
            timeout=_TIMEOUT_S,
        )
    except subprocess.TimeoutExpired:
        return False, "(it does not end)"
    if done.returncode == 0:
        return True, ""
    failed = re.search(r"^(?:FAILED|ERROR) \S+?(?:::(\w+)\S*)?(?: |$)", done.stdout, re.MULTILINE)
    if failed is None or done.returncode != 1:  # no such test, or what was changed is no program any more
        print(done.stdout[-2000:] + done.stderr[-1000:], file=sys.stderr)
        return False, _NO_RUN
    return False, failed[1] or "(it cannot be read)"


class Guards:
    """Switches mechanisms off in a copy of the sources."""

    def __init__(self, root: Path) -> None:
        self._copy = root / "copy"
        self._sound: set[str] = set()
        """Guards that pass with nothing switched off."""
        self._copy.mkdir()
        for name in _COPIED:
            if (ROOT / name).is_dir():
                shutil.copytree(ROOT / name, self._copy / name, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(ROOT / name, self._copy / name)

    def switch_off(self, each: Mechanism) -> str:
        """Return the test that fails without the mechanism, or why there is none."""
        path = self._copy / each.file
        text = path.read_text(encoding="utf-8")
        if text.count(each.on) != 1:
            return f"{_NONE}: {each.on!r} is {text.count(each.on)} times in {each.file}"
        if each.guard not in self._sound:
            passed, failed = _run(self._copy, each.guard)
            if not passed:
                return f"{_NONE}: {_file(each.guard)}::{failed} fails with nothing switched off"
            self._sound.add(each.guard)
        changed = text.replace(each.on, each.off)
        compile(changed, each.file, "exec")
        path.write_text(changed, encoding="utf-8")
        passed, failed = _run(self._copy, each.guard)
        path.write_text(text, encoding="utf-8")
        name = f"{_file(each.guard)}::{failed}"
        return (
            f"{_NONE} in {each.guard}" if passed else f"{_NONE}: {name}" if failed == _NO_RUN else f"`{name}`"
        )


def _kept() -> dict[str, str]:
    """Return the rows of the table by mechanism."""
    rows = [line.split(" | ") for line in section(_TITLE).splitlines() if line.startswith("| ")]
    return {cells[1]: " | ".join(cells) for cells in rows if len(cells) == 4}


def _chosen(words: list[str]) -> list[Mechanism]:
    if words == ["--new"]:
        return [each for each in MECHANISMS if each.name not in _kept()]
    if words and (part := re.fullmatch(r"(\d+)/(\d+)", words[0])):
        return list(MECHANISMS[int(part[1]) - 1 :: int(part[2])])
    return [each for each in MECHANISMS if " ".join(words) in each.name]


def _write(rows: dict[str, str]) -> str:
    known = [each.name for each in MECHANISMS]
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
        for number, each in enumerate(chosen, 1):
            found = guards.switch_off(each)
            bad += _NONE in found
            rows[each.name] = f"| {each.promise} | {each.name} | {found} | {COMMIT} |"
            print(f"{number} of {len(chosen)}: {rows[each.name]}", flush=True)
            _write(rows)
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
