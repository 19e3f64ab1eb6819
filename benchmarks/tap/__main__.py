"""Processes of a bench on the wall clock are killed and stopped; a tap on the wire says what became of it.

Run as `python -m benchmarks.tap [TRIALS] [SEED] [LANES]`; writes its section of benchmarks/reliability.md. Each
trial is a `gyrobench run` of a table that turns and a chamber that cools, on an emulated lab behind the tap, as
many side by side as there are lanes (2). At a random instant, from the making of the run folder to its seal,
runner, watchdog or both are killed or stopped. Judged are the bytes that passed (`_judge.py`) and, after
`gyrobench runs recover` and `verify`, the folder that is left: nothing of the project is imported but what writes
the page, and what starts its commands (`_warm.py`).
"""

from __future__ import annotations

import json
import random
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import textwrap
import threading
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks._sections import write_section
from benchmarks.tap import _judge, _wire
from benchmarks.tap._deeds import DEEDS, PORTS, Deed, Trial, wait_for
from benchmarks.tap._warm import Commands

_INTERVAL_S = 1.0
"""What a crash may cost: `flush_interval_s` of the bench file."""
_REST_WITHIN_S = 3.0
_WHILE_TURNING = 0.7
"""Part of the trials in which the table turns when the bench is struck; the rest are struck as the run begins."""
_TURNS_S = 0.2, 2.5
"""For how long it has been turning."""
_BEGINS_S = 1.5
"""Within so long after the folder was made a run that begins is struck."""
_MEANING = (
    "Stopped: told on the wire, both devices, and the table said that it stands. Times from the last deed, "
    "median and worst: of the later of the two stop commands, and of the first answer without rotation; a table "
    "at 10 deg/s brakes for its own time. Nothing moved: struck before the first command. Records: every byte "
    "that passed a second before the deed and earlier is in the folder, none that did not pass, and the folder "
    "verifies."
)
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


@dataclass
class Tally:
    """What became of the trials of a kind."""

    trials: int = 0
    unmoved: int = 0
    unstopped: int = 0
    told_s: list[float] = field(default_factory=list)
    """From the deed to the first stop on the wire, both devices."""
    rest_s: list[float] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)
    outcomes: Counter[str] = field(default_factory=Counter)

    def add(self, other: Tally) -> None:
        """Count another's trials too."""
        self.trials += other.trials
        self.unmoved += other.unmoved
        self.unstopped += other.unstopped
        self.told_s += other.told_s
        self.rest_s += other.rest_s
        self.problems += other.problems
        self.outcomes += other.outcomes


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
        command = [sys.executable, _wire.__file__, str(log), *(ports[name] for name in PORTS)]
        with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as tap:
            assert tap.stdout is not None
            text = (root / "lab.toml").read_text("utf-8")
            for name, instead in zip(PORTS, json.loads(tap.stdout.readline()), strict=True):
                text = text.replace(f'"{ports[name]}"', f'"{instead}"')
            (root / "bench.toml").write_text(text, "utf-8")
            yield root / "bench.toml", log
            tap.communicate(b"")
        lab.terminate()


def _gyrobench(*words: str) -> list[str]:
    return [str(Path(sys.executable).with_name("gyrobench")), *words]


class Lane:
    """A lab with its tap, on which one trial goes on at a time."""

    def __init__(self, root: Path, bench: Path, log: Path, commands: Commands) -> None:
        self._root, self._bench, self._log, self._commands = root, bench, log, commands
        self._said = root / "said"

    def attempt(self, deed: Deed, moments: random.Random, tally: Tally) -> None:
        """Begin a run, do the deed at some instant, and judge what passed and what is left."""
        runs = self._root / f"runs-{time.monotonic_ns()}"
        log_from, begun_s = self._log.stat().st_size, time.monotonic()
        words = ("run", "./turn.py", "--bench", str(self._bench), "--runs", str(runs), "--json")
        pid = self._commands.start(self._root, self._said, *words)
        trial = None
        try:
            folder = wait_for(lambda: next(runs.glob("*/events.jsonl"), None), "a run folder").parent
            trial = Trial(pid, folder, self._log, log_from, begun_s)
            if moments.random() < _WHILE_TURNING:
                wait_for(lambda: _judge.turning(trial.heard()[0]), "a table that turns")
                time.sleep(moments.uniform(*_TURNS_S))
            else:
                time.sleep(moments.uniform(0.0, _BEGINS_S))
            _ = trial.watchdogs
            struck_s = deed.then(trial, moments)
            tally.trials += 1
            self._look_at_the_bench(trial, deed, struck_s, tally)
        except TimeoutError as error:
            tally.problems.append(f"{deed.name}: no {error}")
            return
        finally:
            if trial is not None:
                self._clear_away(trial)
            self._commands.wait(pid)
        tally.problems += [
            f"{deed.name}: {problem}" for problem in self._look_at_the_folder(trial, struck_s, tally)
        ]

    @staticmethod
    def _clear_away(trial: Trial) -> None:
        """End the run, and let a watchdog that was stopped before anything moved, which nobody minds, go on."""
        _ = trial.watchdogs
        trial.kill(trial.pid)
        for guard in trial.guards:
            trial.kill(guard, signal.SIGCONT)
        wait_for(
            lambda: not any(Path(f"/proc/{guard}/task").exists() for guard in trial.guards),
            "end of the guards",
        )

    def _look_at_the_bench(self, trial: Trial, deed: Deed, struck_s: float, tally: Tally) -> None:
        def stopped() -> bool:
            table, chamber, _ = trial.heard()
            if not _judge.moved(table, chamber) and time.monotonic() > struck_s + _REST_WITHIN_S:
                tally.unmoved += 1
                return True
            told = (
                _judge.told_s(table, _judge.STOP_TABLE, trial.struck_from_s),
                _judge.told_s(chamber, _judge.STOP_CHAMBER, trial.struck_from_s),
            )
            rest_s = _judge.rest_s(table, told[0]) if told[0] else None
            if None in told or rest_s is None:
                return False
            tally.told_s.append(max(struck_s, *(time_s for time_s in told if time_s is not None)) - struck_s)
            tally.rest_s.append(max(struck_s, rest_s) - struck_s)
            return True

        try:
            wait_for(
                stopped,
                f"stop of the bench ({trial.folder.name})",
            )
        except TimeoutError as error:
            tally.unstopped += 1
            tally.problems.append(f"{deed.name}: no {error}")

    def _look_at_the_folder(self, trial: Trial, struck_s: float, tally: Tally) -> Iterator[str]:
        """Yield what the folder lacks, or says that is not so."""
        for name, heard in zip(PORTS, trial.heard(), strict=True):
            due_s = min(trial.reads_to_s, struck_s) - _INTERVAL_S
            yield from _judge.missing(trial.folder, name, heard, due_s, trial.reads_to_s)
        if self._outcome(trial) == "running":
            wait_for(lambda: self._command("runs", "recover", str(trial.folder)) == 0, "recovery")
        tally.outcomes[self._outcome(trial)] += 1
        if self._command("runs", "verify", str(trial.folder)):
            yield "does not verify: " + re.sub(r"\s+", " ", self._said.read_text("utf-8", "replace")[-300:])
        if self._outcome(trial) not in ("aborted", "invalid"):
            yield f"reads as {self._outcome(trial)}"

    @staticmethod
    def _outcome(trial: Trial) -> str:
        return str(json.loads((trial.folder / "manifest.json").read_text("utf-8"))["outcome"])

    def _command(self, *words: str) -> int:
        return self._commands.wait(self._commands.start(self._root, self._said, *words))


def _line(name: str, tally: Tally) -> str:
    def figures(values: list[float]) -> str:
        return f"{statistics.median(values):.2f} s, {max(values):.2f} s" if values else ""

    outcomes = ", ".join(f"{count} {outcome}" for outcome, count in sorted(tally.outcomes.items()))
    stopped = tally.trials - tally.unstopped - tally.unmoved
    counts = (tally.trials, tally.unmoved, stopped, tally.unstopped or "")
    cells = (name, *counts, figures(tally.told_s), figures(tally.rest_s), outcomes)
    return f"| {' | '.join(map(str, cells))} |"


def make_trials(count: int, seed: int, lanes: int) -> dict[str, Tally]:
    """Make the trials, the kinds in turn; return what became of each kind."""
    tallies = {deed.name: Tally() for deed in DEEDS}
    numbers, lock = iter(range(count)), threading.Lock()
    commands = Commands()

    def work(lane: int) -> None:
        with tempfile.TemporaryDirectory() as folder, _lab(Path(folder)) as (bench, log):
            here = Lane(Path(folder), bench, log, commands)
            while True:
                with lock:
                    number = next(numbers, None)
                if number is None:
                    return
                deed = DEEDS[number % len(DEEDS)]
                tally = Tally()
                try:
                    here.attempt(deed, random.Random(f"{seed} {number}"), tally)
                except TimeoutError as error:
                    tally.problems.append(f"{deed.name}: no {error}")
                with lock:
                    tallies[deed.name].add(tally)
                    print(f"{number} {deed.name}: {tally.problems or 'well'}", file=sys.stderr, flush=True)

    try:
        with ThreadPoolExecutor(lanes) as pool:
            for done in [pool.submit(work, lane) for lane in range(lanes)]:
                done.result()
    finally:
        commands.close()
    return tallies


def main() -> int:
    """Make the trials and write their section; 1 if a bench was not stopped in time or a record is not true."""
    count, seed, lanes = (*map(int, sys.argv[1:4]), *(72, 1, 2)[len(sys.argv) - 1 :])
    tallies = make_trials(count, seed, lanes)
    late = [
        f"{deed.name}: at rest after {rest_s:.2f} s"
        for deed in DEEDS
        for rest_s in tallies[deed.name].rest_s
        if rest_s > _REST_WITHIN_S
    ]
    problems = [*late, *(problem for tally in tallies.values() for problem in tally.problems)]
    trials = sum(tally.trials for tally in tallies.values())
    lines = [
        *textwrap.wrap(f"{trials} trials, {len(problems)} problems. {_MEANING}", 110),
        "",
        "| struck | trials | nothing moved | stopped | not stopped | told | at rest | outcome |",
        "|---|---|---|---|---|---|---|---|",
        *(_line(deed.name, tallies[deed.name]) for deed in DEEDS),
        "",
        *(f"- {problem}" for problem in problems[:10]),
    ]  # fmt: skip
    print(
        write_section("Kills seen from the wire", f"python -m benchmarks.tap {count} {seed} {lanes}", lines)
    )
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
