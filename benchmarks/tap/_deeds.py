"""What is done to the processes of a bench, and when."""

from __future__ import annotations

import json
import math
import os
import random
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from benchmarks.tap import _judge, _wire

PORTS = ("table", "chamber", "fog_1")
_PATIENCE_S = 40.0


@dataclass
class Trial:
    """A run that goes on: its process, its folder, and what passed at its ports."""

    pid: int
    folder: Path
    log: Path
    log_from: int
    begun_s: float
    reads_to_s: float = math.inf
    """From then on the runner was dead or stopped: what it did not read a line may drop."""
    guards: set[int] = field(default_factory=set)
    """Every watchdog that it was seen to have."""
    struck_from_s: float = math.inf
    """From then on somebody may have told the bench to stop."""

    def heard(self) -> list[list[_wire.Heard]]:
        """Return what passed at the ports since it was begun."""
        return [
            [piece for piece in port if piece.time_s >= self.begun_s]
            for port in _wire.read_log(self.log, len(PORTS), self.log_from)
        ]

    @property
    def watchdogs(self) -> list[int]:
        """The processes that guard it: of its children those that are watchdogs, the last one last."""
        with suppress(OSError):
            children = Path(f"/proc/{self.pid}/task/{self.pid}/children").read_text("ascii").split()
            found = [
                int(pid)
                for pid in children
                if b"bench.control.watchdog" in Path(f"/proc/{pid}/cmdline").read_bytes()
            ]
            self.guards.update(found)
            return found
        return []

    def watchdog(self, number: int = 0) -> int:
        """The first process that guards it, or the second, once there is one."""
        return int(wait_for(lambda: self.watchdogs[number : number + 1], "a watchdog")[0])

    def codes(self) -> list[str]:
        """Return the codes of its alarms and of what makes it invalid so far."""
        lines = (self.folder / "events.jsonl").read_text("utf-8").splitlines()
        rows = [json.loads(line) for line in lines if line.endswith("}")]
        return [row["code"] for row in rows if row["kind"] in ("alarm", "invalid")]

    def kill(self, pid: int, number: signal.Signals = signal.SIGKILL) -> float:
        """Send a signal to a process; return when. One that has ended already has no harm done."""
        now_s = time.monotonic()  # before: its stop may be on the wire by the time that this goes on
        self.struck_from_s = min(self.struck_from_s, now_s)
        if pid == self.pid and number in (signal.SIGKILL, signal.SIGSTOP):
            self.reads_to_s = min(self.reads_to_s, now_s)
        with suppress(ProcessLookupError):
            os.kill(pid, number)
        return now_s


@dataclass(frozen=True)
class Deed:
    """What is done to a bench: `then` strikes and returns when, s."""

    name: str
    then: Callable[[Trial, random.Random], float]


def wait_for(condition: Callable[[], Any], what: str, patience_s: float = _PATIENCE_S) -> Any:
    """Return what a condition gives once it gives something; TimeoutError."""
    until_s = time.monotonic() + patience_s
    while not (found := condition()):
        if time.monotonic() > until_s:
            raise TimeoutError(what)
        time.sleep(0.02)
    return found


def _runner(number: signal.Signals) -> Callable[[Trial, random.Random], float]:
    return lambda trial, _: trial.kill(trial.pid, number)


def _guarded_again(number: signal.Signals, end: signal.Signals) -> Callable[[Trial, random.Random], float]:
    """Return a deed: a watchdog is lost, either; the run goes on; the runner ends when another has come up."""

    def strike(trial: Trial, moments: random.Random) -> float:
        wait_for(lambda: _judge.turning(trial.heard()[0]), "a table that turns")  # armed by then
        trial.kill(trial.watchdog(moments.choice((0, 1))), number)
        wait_for(lambda: "watchdog_back" in trial.codes(), "another watchdog")
        time.sleep(moments.uniform(0.0, 0.5))
        return trial.kill(trial.pid, end)

    return strike


def _both(
    runner: signal.Signals, watchdog: signal.Signals, which: int
) -> Callable[[Trial, random.Random], float]:
    """Return a deed: the runner and one of its watchdogs are lost within a second, either first."""

    def strike(trial: Trial, moments: random.Random) -> float:
        losses = [(trial.watchdog(which), watchdog), (trial.pid, runner)]
        moments.shuffle(losses)
        trial.kill(*losses[0])
        time.sleep(moments.choice((0.0, moments.uniform(0.0, 0.05), moments.uniform(0.0, 1.0))))
        return trial.kill(*losses[1])

    return strike


def _both_watchdogs(trial: Trial, moments: random.Random) -> float:
    """Both watchdogs die; the runner goes on, or it ends the run if no other one comes up."""
    wait_for(lambda: _judge.turning(trial.heard()[0]), "a table that turns")
    for pid in (trial.watchdog(1), trial.watchdog(0)):
        trial.kill(pid)
    wait_for(lambda: "watchdog_back" in trial.codes(), "another watchdog")
    time.sleep(moments.uniform(0.0, 0.5))
    return trial.kill(trial.pid)


def _all_stands_still(trial: Trial, moments: random.Random) -> float:
    """Runner and watchdogs are stopped and go on; the run says so and is ended as any other."""
    wait_for(lambda: _judge.turning(trial.heard()[0]), "a table that turns")
    pids = (trial.pid, trial.watchdog(1), trial.watchdog(0))
    for pid in pids:
        trial.kill(pid, signal.SIGSTOP)
    time.sleep(moments.uniform(3.5, 6.0))
    for pid in pids:
        trial.kill(pid, signal.SIGCONT)
    wait_for(lambda: "poll_gap" in trial.codes(), "the alarm for the gap")
    return trial.kill(trial.pid, signal.SIGTERM)


def _while_it_ends(trial: Trial, moments: random.Random) -> float:
    """The runner is told to end and killed while it makes the bench safe, decodes and seals."""
    wait_for(lambda: _judge.turning(trial.heard()[0]), "a table that turns")
    told_s = trial.kill(trial.pid, signal.SIGTERM)
    time.sleep(moments.uniform(0.0, 0.8))
    trial.kill(trial.pid)
    return told_s


KILL, STOP, TERM = signal.SIGKILL, signal.SIGSTOP, signal.SIGTERM
DEEDS = (
    Deed("runner killed", _runner(KILL)),
    Deed("runner stopped", _runner(STOP)),
    Deed("runner told to end", _runner(TERM)),
    Deed("runner told to end, killed while it does", _while_it_ends),
    Deed("a watchdog killed, then the runner", _guarded_again(KILL, KILL)),
    Deed("a watchdog stopped, then the runner killed", _guarded_again(STOP, KILL)),
    Deed("both watchdogs killed, then the runner", _both_watchdogs),
    Deed("runner and first watchdog killed within 1 s", _both(KILL, KILL, 0)),
    Deed("runner killed and first watchdog stopped within 1 s", _both(KILL, STOP, 0)),
    Deed("runner stopped and first watchdog killed within 1 s", _both(STOP, KILL, 0)),
    Deed("runner and first watchdog stopped within 1 s", _both(STOP, STOP, 0)),
    Deed("runner and second watchdog killed within 1 s", _both(KILL, KILL, 1)),
    Deed("all stopped for 3.5 to 6 s, then told to end", _all_stands_still),
)
