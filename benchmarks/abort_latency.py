"""From an event to the stop commands on both ports: runs on the wall clock against emulated labs.

Run as `python -m benchmarks.abort_latency [RUNS]`; writes its section of benchmarks/reliability.md. At a
random moment of a run something happens: a signal, an error in the procedure, the table unplugged (its
terminal hangs up; what is told then is the chamber), the only gyro unplugged on a bench with `last_unit_s = 0`,
the chamber's door opened against a rule of the bench file (a limit), the table's interlock open. The moment is
stamped on the run's own clock, the stop bytes when they are handed to the port (raw/<port>.sent.idx). Door and
interlock can only be seen in an answer to a poll, once a second: they are counted from the arrival of the
answer, and from the event. The yardstick is the 50 ms that the bench promises. For a runner that is killed or
stopped it is the 3 s of the watchdog; host time counts there.
"""

from __future__ import annotations

import json
import os
import random
import select
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any
from unittest import mock

from bench.control import safe_state
from bench.control.procedure import Demands, Parameters, Procedure
from bench.control.questions import AssumeYes
from bench.control.runner import RunRequest, run_procedure
from bench.control.session import Bench
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import BenchFile, bench_file_from, load_bench_file
from bench.record.recording import read_exchanges
from benchmarks._measure import Row, figure, usual
from benchmarks._sections import write_section
from drivers.base.clock import WallClock, utc_now
from simulators.faults import Fault

_RUNS = 9
_PROMISED_MS = 50.0
_WATCHDOG_MS = 3000.0
_PATIENCE_S = 30.0
"""For a takeover to end; longer is a fault of this benchmark or of the bench."""
_EARLIEST_S, _LATEST_S = 0.2, 1.5
_RATE_DPS = 1.0
_COMMANDS = (
    ("table", "table stop", b":mode:off 1\r\n"),
    ("chamber", "chamber stop", b"14001\xb61\xb61\xb60\r"),
    ("chamber", "chamber safe set point", b"11001\xb61\xb61\xb625.0\r"),
)
_DOOR = {"name": "spin with the door open", "rate_dps": {"above": 0.1}, "door": "open"}


@dataclass(frozen=True)
class Event:
    """What happens. `seen_on`: the port whose answer tells the bench, empty if it needs no answer; `stamp_after`:
    `happen` returns at the moment that counts; `told`: the ports that can be told still.
    """

    name: str
    happen: Callable[[EmulatedLab], None]
    seen_on: str = ""
    stamp_after: bool = False
    told: tuple[str, ...] = ("table", "chamber")


def _press(_: EmulatedLab) -> None:
    os.kill(os.getpid(), signal.SIGINT)


def _strike(port: str, kind: str, **more: Any) -> Callable[[EmulatedLab], None]:
    def strike(lab: EmulatedLab) -> None:
        lab.perform({"act": "fault", "port": port, "kind": kind, **more})

    return strike


def _unplug(port: str) -> Callable[[EmulatedLab], None]:
    def unplug(lab: EmulatedLab) -> None:
        """Return when the terminal has hung up: the lab takes its time for that."""
        terminal = os.open(lab.ports[port], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
        waiting = select.poll()
        waiting.register(terminal, 0)  # hanging up is told without being asked for
        lab.perform({"act": "fault", "port": port, "kind": "vanish", "duration_s": 1e6})
        waiting.poll(10_000)
        os.close(terminal)

    return unplug


_SIGNAL = Event("signal", _press)
_EVENTS = (
    _SIGNAL,
    Event("error in the procedure", lambda _: None),
    Event("table unplugged", _unplug("table"), stamp_after=True, told=("chamber",)),
    Event("only gyro unplugged, `last_unit_s = 0`", _unplug("fog_1"), stamp_after=True),
    Event("limit: door opened while turning", _strike("chamber", "alarm", text="Door open"), "chamber"),
    Event("interlock of the table", _strike("table", "trip", text="rate trip"), "table"),
)
_ERROR, _INTERLOCK = _EVENTS[1], _EVENTS[-1]


def _bench_file(*, watchdog: bool) -> BenchFile:
    data = load_bench_file(Path(__file__).parents[1] / "examples" / "demo.toml").model_dump(mode="json")
    data["gyro"] = data["gyro"][:1]
    data["chamber"]["door_message"] = "door"
    data["limits"]["forbid"] = [_DOOR]
    data["safe"] |= {"last_unit_s": 0.0, "watchdog": watchdog}
    return bench_file_from(data)


def _turn(bench: Bench, *, settled: bool = False) -> None:
    bench.table.device.servo_on()
    bench.chamber.go_to(0.0)
    bench.chamber.start()
    if settled:
        bench.table.spin(_RATE_DPS)
    else:
        bench.table.device.spin(_RATE_DPS)


def _procedure(run: Callable[[Bench, Parameters], None]) -> Procedure:
    return Procedure("turn", "A turn", "", Parameters, run, lambda _: 30.0, lambda _: Demands(10.0, 0.0))


def _once(event: Event, lab: EmulatedLab, runs: Path, delay_s: float, run_id: str) -> tuple[Path, float]:
    """Do one run and return its folder and when the event happened, s of bench time."""
    stamps: list[float] = []

    def happen(bench: Bench) -> None:
        waiting = WallClock()
        waiting.sleep(delay_s)
        waiting.close()
        before_s = bench.clock.now()
        event.happen(lab)
        stamps.append(bench.clock.now() if event.stamp_after else before_s)

    def run(bench: Bench, _: Parameters) -> None:
        _turn(bench, settled=event is _INTERLOCK)  # a table that has not settled has no demand to leave
        if event is _ERROR:
            bench.wait(delay_s, "turning")
            stamps.append(bench.clock.now())
            raise ArithmeticError("an error of the procedure's own")
        threading.Thread(target=happen, args=(bench,), daemon=True).start()
        bench.wait(30.0, "turning")

    request = RunRequest(_procedure(run), Parameters(), lab.file, runs, AssumeYes(), run_id=run_id)
    try:
        result = run_procedure(request)
        assert result.outcome == "aborted", result
    except ArithmeticError:
        pass
    return runs / run_id, stamps[0]


def _latencies_ms(event: Event, folder: Path, stamp_s: float) -> Iterator[tuple[float, float]]:
    """Yield for each stop command its time from the event, and from when the bench could know of it."""
    known_s, earliest_s = stamp_s, stamp_s - _EARLIEST_S / 2.0  # the bench may act before the stamp is taken
    sent = {
        port: [(t / 1e9, data) for t, way, data in read_exchanges(folder, port) if way == "sent"]
        for port in ("table", "chamber")
    }
    first_stop_s = min(
        t
        for port, _, command in _COMMANDS
        if port in event.told
        for t, data in sent[port]
        if data == command and t >= earliest_s
    )
    if event.seen_on:
        answers = (t / 1e9 for t, way, _ in read_exchanges(folder, event.seen_on) if way == "received")
        known_s = max(t for t in answers if t <= first_stop_s)
    for port, _, command in _COMMANDS:
        if port not in event.told:
            yield 0.0, 0.0
            continue
        told_s = next(t for t, data in sent[port] if data == command and t >= earliest_s)
        yield 1e3 * max(told_s - stamp_s, 0.0), 1e3 * max(told_s - known_s, 0.0)


def _measure(event: Event, count: int) -> dict[str, list[tuple[float, float]]]:
    """Return by stop command (from the event, from the knowledge) in ms of `count` runs."""
    moments, file = random.Random(1), _bench_file(watchdog=False)
    gone = tuple(  # prepares the ports for it
        Fault(port=port, kind="vanish", at_s=(1e8,), duration_s=1e6) for port in ("table", "fog_1")
    )
    found: dict[str, list[tuple[float, float]]] = {name: [] for _, name, _ in _COMMANDS}
    for number in range(count):
        plant = Plant(fault=gone)
        with (
            tempfile.TemporaryDirectory() as runs,
            EmulatedLab(file, plant, clock="wall") as lab,
            mock.patch.object(
                safe_state, "RETURN_S", 0.1
            ),  # a port that stays away is waited for after all that
        ):
            delay_s = moments.uniform(_EARLIEST_S, _LATEST_S)
            folder, stamp_s = _once(event, lab, Path(runs), delay_s, f"run-{number}")
            for name, value in zip(found, _latencies_ms(event, folder, stamp_s), strict=True):
                found[name].append(value)
    return found


def _watchdog_ms(number: signal.Signals, count: int) -> list[float]:
    """Return how long after `number` struck the runner the first stop command left, in ms, of `count` runs."""
    found = []
    for _ in range(count):
        with (
            tempfile.TemporaryDirectory() as runs,
            EmulatedLab(_bench_file(watchdog=True), Plant(), clock="wall") as lab,
        ):
            child = subprocess.Popen(
                [sys.executable, "-m", "benchmarks.abort_latency", "--runner", runs],
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
            )
            with child:
                assert child.stdin is not None and child.stdout is not None
                child.stdin.write(json.dumps(lab.file.model_dump(mode="json")).encode() + b"\n")
                child.stdin.flush()
                assert child.stdout.readline() == b"turning\n"
                struck = datetime.fromisoformat(utc_now())
                child.send_signal(number)
                try:
                    _, words = child.communicate(timeout=_PATIENCE_S)  # its watchdogs hold its standard error
                finally:
                    child.kill()
            found.append(_taken_over_ms(Path(runs) / "run" / "watchdog", struck, words))
    return found


def _taken_over_ms(folder: Path, struck: datetime, words: bytes) -> float:
    """Return how long after `struck` the takeover's first stop command left; `words`: what was said of it.

    The watchdog's own clock starts when it writes down that it takes over.
    """
    rows: list[dict[str, Any]] = [
        json.loads(line) for line in (folder / "events.jsonl").read_text().splitlines()
    ]
    assert rows[-1]["kind"] == "takeover_ended", words.decode()
    taken = datetime.fromisoformat(rows[0]["utc"])
    told_s = min(
        t / 1e9
        for port, _, command in _COMMANDS
        for t, way, data in read_exchanges(folder, port)
        if way == "sent" and data == command
    )
    return 1e3 * ((taken - struck).total_seconds() + told_s - float(rows[0]["time_s"]))


def _runner(runs: Path) -> None:
    """Be the runner that is killed: turn until the end."""

    def run(bench: Bench, _: Parameters) -> None:
        _turn(bench)
        print("turning", flush=True)
        bench.wait(3600.0, "turning")

    file = bench_file_from(json.loads(sys.stdin.readline()))
    run_procedure(RunRequest(_procedure(run), Parameters(), file, runs, AssumeYes(), run_id="run"))


def rows() -> Iterator[Row]:
    """Yield median and worst latency of each command over the runs, from a signal."""
    count = usual(_RUNS, 3)
    measured = _measure(_SIGNAL, count)
    for name, pairs in measured.items():
        values = [from_event for from_event, _ in pairs]
        for kind, value in (("median", statistics.median(values)), ("worst", max(values))):
            title = f"signal to {name}, {kind} of {count}"
            yield figure(title, value, _PROMISED_MS, "limit: the promise", "ms", least=True)


def main() -> int:
    """Measure every event and write the section; 1 if a promise was broken."""
    if sys.argv[1:2] == ["--runner"]:
        _runner(Path(sys.argv[2]))
        return 0
    count = int(sys.argv[1]) if len(sys.argv) > 1 else _RUNS
    head = ["event", "runs", "median", "worst", "promise", "from the event, worst"]
    table = [head, ["---"] * len(head)]
    broken = False
    for event in _EVENTS:
        runs = list(zip(*_measure(event, count).values(), strict=True))
        last = [max(known for _, known in run) for run in runs]
        whole = [max(since for since, _ in run) for run in runs]
        broken |= max(last) > _PROMISED_MS
        name = f"{event.name}, from the answer that tells" if event.seen_on else event.name
        table.append(_line(name, last, _PROMISED_MS, whole))
        print(" | ".join(table[-1]), flush=True)
    for number in (signal.SIGKILL, signal.SIGSTOP):
        times = _watchdog_ms(number, count)
        broken |= max(times) > _WATCHDOG_MS
        table.append(_line(f"{number.name} of the runner, by its watchdog", times, _WATCHDOG_MS, times))
        print(" | ".join(table[-1]), flush=True)
    lines = [
        "From the event to the last of three commands on the wire: table stop, chamber stop, safe set point; of",
        "the watchdog: to the first. Wall clock, emulated lab on pseudo-terminals. A door or an interlock is",
        "seen in the answer to a poll, once a second; a port that goes away is known at once.",
        "",
        *(f"| {' | '.join(row)} |" for row in table),
    ]
    print(write_section("Time to the safe state", f"python -m benchmarks.abort_latency {count}", lines))
    return 1 if broken else 0


def _line(name: str, values: list[float], promise_ms: float, whole: list[float]) -> list[str]:
    figures = (statistics.median(values), max(values), promise_ms, max(whole))
    return [name, str(len(values)), *(f"{figure:.1f} ms" for figure in figures)]


if __name__ == "__main__":
    sys.exit(main())
