"""Processes of a bench on the wall clock are killed and stopped; a tap on the wire says what became of it.

Run as `python -m benchmarks.tap [TRIALS] [SEED]`; writes its section of benchmarks/reliability.md. Each trial is
a `gyrobench run` of a table that turns and a chamber that cools, on an emulated lab behind the tap. At a random
moment runner, watchdog or both are killed or stopped. Judged are the bytes that passed (`_judge.py`) and, after
`gyrobench runs recover` and `verify`, the folder that is left: nothing of the project is imported but what writes
the page.
"""

from __future__ import annotations

import json
import os
import random
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks._sections import write_section
from benchmarks.tap import _judge, _wire

_PORTS = ("table", "chamber", "fog_1")
_INTERVAL_S = 1.0
"""What a crash may cost: `flush_interval_s` of the bench file."""
_REST_WITHIN_S = 3.0
_PATIENCE_S = 40.0
_TURNS_S = 1.0, 4.0
"""A table that has been turning for so long is struck."""
_BENCH = """
[bench]
name = "tap"
latitude_deg = 40.0
[table]
driver = "acutrol3000"
port = "pty-table"
[chamber]
driver = "weiss"
port = "socket://127.0.0.1:1"
[[gyro]]
name = "fog_1"
driver = "kvh1750"
port = "pty-fog"
unit = "F1"
axis = "x"
rate_hz = 100
"""
_PROCEDURE = """
from gyrobench import Bench, Demands, Parameters, Procedure

def run(bench, p):
    with bench.step("1", "Turn"):
        bench.chamber.go_to(10.0)
        bench.chamber.start()
        bench.table.engage()
        bench.table.spin(10.0)
        bench.wait(3600.0, "turning")

PROCEDURE = Procedure("turn", "A turn", "", Parameters, run, lambda p: 3600.0, lambda p: Demands(10.0, 10.0))
"""


@dataclass(frozen=True)
class Struck:
    """What is done to a bench: `then` strikes and returns when, s; `guarded`: somebody stops the bench."""

    name: str
    then: Callable[[Trial, random.Random], float]
    guarded: bool = True


@dataclass
class Trial:
    """A run that goes on: its process, its folder, and what passed at its ports."""

    process: subprocess.Popen[bytes]
    folder: Path
    log: Path
    begun_s: float

    def heard(self) -> list[list[_wire.Heard]]:
        """Return what passed at the ports since it was begun."""
        return [
            [piece for piece in port if piece.time_s >= self.begun_s]
            for port in _wire.read_log(self.log, len(_PORTS))
        ]

    @property
    def watchdog(self) -> int:
        """The process that guards it: the last of its children that is one."""
        children = (
            Path(f"/proc/{self.process.pid}/task/{self.process.pid}/children").read_text("ascii").split()
        )
        guards = [
            pid for pid in children if b"bench.control.watchdog" in Path(f"/proc/{pid}/cmdline").read_bytes()
        ]
        return int(guards[-1])

    def codes(self) -> list[str]:
        """Return the codes of its alarms and of what makes it invalid so far."""
        lines = (self.folder / "events.jsonl").read_text("utf-8").splitlines()
        rows = [json.loads(line) for line in lines if line.endswith("}")]
        return [row["code"] for row in rows if row["kind"] in ("alarm", "invalid")]


@dataclass
class Tally:
    """What became of the trials of a kind."""

    trials: int = 0
    unstopped: int = 0
    told_s: list[float] = field(default_factory=list)
    """From the deed to the first stop on the wire, both devices."""
    rest_s: list[float] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    outcomes: Counter[str] = field(default_factory=Counter)


def _wait(condition: Callable[[], Any], what: str) -> Any:
    until_s = time.monotonic() + _PATIENCE_S
    while not (found := condition()):
        if time.monotonic() > until_s:
            raise TimeoutError(what)
        time.sleep(0.02)
    return found


def _kill(trial: Trial, pid: int, number: signal.Signals = signal.SIGKILL) -> float:
    del trial
    os.kill(pid, number)
    return time.monotonic()


def _watchdog_then_runner(trial: Trial, moments: random.Random) -> float:
    """The watchdog dies; the runner when another guards."""
    _kill(trial, trial.watchdog)
    _wait(lambda: "watchdog_back" in trial.codes(), "another watchdog")
    time.sleep(moments.uniform(0.0, 1.0))
    return _kill(trial, trial.process.pid)


def _both_soon(trial: Trial, moments: random.Random) -> float:
    """The watchdog dies; the runner when the other one has been started and is not up yet."""
    first = trial.watchdog
    _kill(trial, first)

    def replaced() -> bool:
        with suppress(OSError, IndexError):
            return trial.watchdog != first
        return False

    _wait(replaced, "another watchdog's process")
    time.sleep(moments.uniform(0.0, 0.5))
    return _kill(trial, trial.process.pid)


def _both_at_once(trial: Trial, moments: random.Random) -> float:
    pids = [trial.watchdog, trial.process.pid]
    moments.shuffle(pids)
    for pid in pids:
        os.kill(pid, signal.SIGKILL)
    return time.monotonic()


def _all_stands_still(trial: Trial, moments: random.Random) -> float:
    """Runner and watchdog are stopped and go on; the run says so and is ended as any other."""
    pids = (trial.process.pid, trial.watchdog)
    for pid in pids:
        os.kill(pid, signal.SIGSTOP)
    time.sleep(moments.uniform(5.0, 9.0))
    for pid in pids:
        os.kill(pid, signal.SIGCONT)
    _wait(lambda: "poll_gap" in trial.codes(), "the alarm for the gap")
    return _kill(trial, trial.process.pid, signal.SIGTERM)


_DEEDS = (
    Struck("runner killed", lambda trial, _: _kill(trial, trial.process.pid)),
    Struck("runner stopped", lambda trial, _: _kill(trial, trial.process.pid, signal.SIGSTOP)),
    Struck("runner told to end", lambda trial, _: _kill(trial, trial.process.pid, signal.SIGTERM)),
    Struck("watchdog killed, then the runner", _watchdog_then_runner),
    Struck("watchdog killed, the runner before another is up", _both_soon),
    Struck("all stopped for 5 to 9 s, then told to end", _all_stands_still),
    Struck("both killed at once", _both_at_once, guarded=False),
)


@contextmanager
def _lab(root: Path) -> Iterator[tuple[Path, Path]]:
    """Serve a lab with the tap before it; yield the bench file that reaches the tap, and the tap's log."""
    (root / "given.toml").write_text(_BENCH)
    (root / "turn.py").write_text(_PROCEDURE)
    words = ["lab", "--bench", "given.toml", "--write", "lab.toml", "--json"]
    with subprocess.Popen(
        _gyrobench(*words), cwd=root, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL
    ) as lab:
        assert lab.stdout is not None
        ports = json.loads(lab.stdout.readline())["ports"]
        log = root / "wire.log"
        command = [sys.executable, _wire.__file__, str(log), *(ports[name] for name in _PORTS)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as tap:
            assert tap.stdout is not None
            text = (root / "lab.toml").read_text("utf-8")
            for name, instead in zip(_PORTS, json.loads(tap.stdout.readline()), strict=True):
                text = text.replace(f'"{ports[name]}"', f'"{instead}"')
            (root / "bench.toml").write_text(text, "utf-8")
            yield root / "bench.toml", log
            tap.communicate(b"")
        lab.terminate()


def _gyrobench(*words: str) -> list[str]:
    return [str(Path(sys.executable).with_name("gyrobench")), *words]


def _try(root: Path, bench: Path, log: Path, deed: Struck, moments: random.Random, tally: Tally) -> None:
    runs = root / f"runs-{time.monotonic_ns()}"
    begun_s = time.monotonic()
    words = _gyrobench("run", "./turn.py", "--bench", str(bench), "--runs", str(runs), "--json")
    with subprocess.Popen(words, cwd=root, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
        try:
            folder = _wait(lambda: next(runs.glob("*/events.jsonl"), None), "a run folder").parent
            trial = Trial(process, folder, log, begun_s)
            _wait(lambda: _judge.turning(trial.heard()[0]), "a table that turns")
            time.sleep(moments.uniform(*_TURNS_S))
            struck_s = deed.then(trial, moments)
            tally.trials += 1
            _look_at_the_bench(trial, deed, struck_s, tally)
        finally:
            process.kill()
    tally.problems += [f"{deed.name}: {problem}" for problem in _look_at_the_folder(trial, struck_s, tally)]


def _look_at_the_bench(trial: Trial, deed: Struck, struck_s: float, tally: Tally) -> None:
    def stopped() -> bool:
        table, chamber, _ = trial.heard()
        told = (
            _judge.told_s(table, _judge.STOP_TABLE, struck_s),
            _judge.told_s(chamber, _judge.STOP_CHAMBER, struck_s),
        )
        rest_s = _judge.rest_s(table, told[0]) if told[0] else None
        if None in told or rest_s is None:
            return False
        tally.told_s.append(max(time_s for time_s in told if time_s is not None) - struck_s)
        tally.rest_s.append(rest_s - struck_s)
        return True

    try:
        if deed.guarded:
            _wait(stopped, f"{deed.name}: the bench was not stopped")
        else:
            time.sleep(2.0 * _REST_WITHIN_S)
            tally.unstopped += not stopped()
    except TimeoutError as error:
        tally.unstopped += 1
        tally.problems.append(str(error))
    time.sleep(1.0)  # a watchdog closes its own record, and lets go of the bench


def _look_at_the_folder(trial: Trial, struck_s: float, tally: Tally) -> Iterator[str]:
    """Yield what the folder lacks, or says that is not so."""
    for name, heard in zip(_PORTS, trial.heard(), strict=True):
        yield from _judge.missing(trial.folder, name, heard, trial.begun_s, struck_s - _INTERVAL_S)
    manifest = json.loads((trial.folder / "manifest.json").read_text("utf-8"))
    if manifest["outcome"] == "running":
        subprocess.run(_gyrobench("runs", "recover", str(trial.folder)), capture_output=True, check=False)
        manifest = json.loads((trial.folder / "manifest.json").read_text("utf-8"))
    tally.outcomes[manifest["outcome"]] += 1
    verified = subprocess.run(
        _gyrobench("runs", "verify", str(trial.folder)), capture_output=True, check=False
    )
    if verified.returncode:
        yield "does not verify: " + re.sub(r"\s+", " ", (verified.stdout + verified.stderr).decode()[-300:])
    if manifest["outcome"] not in ("aborted", "invalid"):
        yield f"reads as {manifest['outcome']}"


def _line(name: str, tally: Tally) -> str:
    def figures(values: list[float]) -> str:
        return f"{statistics.median(values):.2f} s, {max(values):.2f} s" if values else ""

    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in sorted(tally.outcomes.items()))
    stopped = tally.trials - tally.unstopped
    cells = (name, tally.trials, stopped, figures(tally.told_s), figures(tally.rest_s), outcomes)
    return f"| {' | '.join(map(str, cells))} |"


def main() -> int:
    """Make the trials and write their section; 1 if a bench was not stopped in time or a record is not true."""
    trials, seed = (*map(int, sys.argv[1:3]), *(70, 1)[len(sys.argv) - 1 :])
    moments, tallies = random.Random(seed), {deed: Tally() for deed in _DEEDS}
    with tempfile.TemporaryDirectory() as folder, _lab(Path(folder)) as (bench, log):
        for number in range(trials):
            deed = _DEEDS[number % len(_DEEDS)]
            _try(Path(folder), bench, log, deed, moments, tallies[deed])
    late = [
        f"{deed.name}: told to stop after {told_s:.2f} s"
        for deed, tally in tallies.items()
        for told_s in tally.told_s
        if told_s > _REST_WITHIN_S
    ]
    problems = [*late, *(problem for tally in tallies.values() for problem in tally.problems)]
    lines = [
        f"{len(problems)} problems. Stopped: both devices were told on the wire, and the table said it stands.",
        "Times from the last deed, median and worst: of the later stop command, and of the first answer without",
        "rotation (a table at 10 deg/s takes its time to brake). Records: every byte that passed a second before",
        "the deed or earlier is in the folder, no other byte is, and the folder verifies. A bench whose runner",
        "and watchdog die at the same instant is guarded by nobody, as docs/safety.md says.",
        "",
        "| struck | trials | stopped | told | at rest | outcome |",
        "|---|---|---|---|---|---|",
        *(_line(deed.name, tally) for deed, tally in tallies.items()),
        "",
        *(f"- {problem}" for problem in problems[:10]),
    ]
    print(write_section("Kills seen from the wire", f"python -m benchmarks.tap {trials} {seed}", lines))
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
