"""Soak test: seeded runs on an emulated lab with faults, singly and in pairs; each must end well or stop safe.

Run as `python -m benchmarks.soak [RUNS] [SEED]`; writes its section of benchmarks/reliability.md and fails if a
run was not honest.
What is judged, by means the run itself has no part in: its folder is rebuilt from the raw bytes; the instruments
are asked anew, after the run, whether they rest; every accepted frame of a gyro with a damaged line is looked up
among those that the same lab sends without faults; what must not pass unnoticed is held against the outcome.
"""

from __future__ import annotations

import os
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import pyarrow.parquet as pq

from bench.control.devices import open_chamber, open_table
from bench.control.procedure import Demands, Parameters, Procedure
from bench.control.questions import Question, Reply
from bench.control.run_record import decode_run
from bench.control.runner import RunRequest, RunResult, run_procedure
from bench.control.session import Bench
from bench.lab.emulated import EmulatedLab, Plant
from bench.record.benchfile import BenchFile, bench_file_from
from bench.record.recording import read_manifest, verify
from benchmarks._sealed_runs import FILE
from benchmarks._sections import write_section
from drivers.base import clock as host
from drivers.base.errors import BenchError, RunAborted
from drivers.base.virtual_clock import VirtualClock
from drivers.kit.instruments import Instrument
from drivers.kit.registry import load_kind
from simulators.faults import Fault

_GYROS = ("fog_1", "can_1")
_PORTS = ("table", "chamber", *_GYROS)
_LASTS_S = {"delay": (0.2, 4.0), "silence": (1.0, 20.0), "vanish": (1.0, 8.0)}
_WIRE = ("drop", "repeat", "flip", "noise", "truncate", "bad_check", "double", "lose", *_LASTS_S)
_TO_DEVICE = ("drop_command", "flip_command", "noise_command")
_CHECKED = ("fog_1",)
"""Ports whose messages carry a check value: the protocols of table and chamber and slcan lines have none."""
_ALTERING = ("drop", "repeat", "flip", "noise", "truncate")
"""Faults after which bytes may read as another message; after the rest what arrives was sent."""
_READ = {
    "table": ("turntable", {"rate_dps": 0.1}),
    "chamber": ("chamber", {"air_temp_c": 0.5, "set_point_c": 0.05}),
}
"""Telemetry by port: its table, and what its columns may differ from their neighbours."""
_HOLD_S = 60.0
_LATEST_END_S = 8000.0
_MUST_TELL_S = 11.0
_FILE: dict[str, Any] = FILE | {"bench": FILE["bench"] | {"name": "soak"}}


@dataclass(frozen=True)
class Case:
    """One run: its faults, and what else happens."""

    name: str
    faults: tuple[Fault, ...] = ()
    scenario: str = ""
    forbidden: tuple[str, ...] = ()
    """Outcomes that would not be the truth."""


@dataclass
class Verdict:
    """How a run ended and what was wrong with that; `false_frames` were accepted and never sent."""

    case: Case
    outcome: str
    reason: str
    problems: list[str] = field(default_factory=list)
    false_frames: dict[str, int] = field(default_factory=dict)
    false_readings: dict[str, int] = field(default_factory=dict)
    """Of table and chamber: readings apart from both their neighbours."""


def cases(count: int, seed: int) -> list[Case]:
    """Return `count` cases: the scenarios, every wire fault on every port, then pairs drawn from `seed`.

    Fewer than all of the first two are drawn from them, those that take long only when needed.
    """
    draw = random.Random(seed)
    singles = [(port, kind) for port in _PORTS for kind in _WIRE if kind != "bad_check" or port in _CHECKED]
    singles += [(port, kind) for port in ("table", "chamber") for kind in _TO_DEVICE]
    found = [*_scenarios(), *(_wire_case(draw, [single]) for single in singles)]
    if count < len(found):
        quick = [case for case in found if case.scenario != "operator" and case.scenario != "disk"]
        return draw.sample(quick if count <= len(quick) else found, count)
    while len(found) < count:
        found.append(_wire_case(draw, [draw.choice(singles), draw.choice(singles)]))
    return found


def _wire_case(draw: random.Random, faults: list[tuple[str, str]]) -> Case:
    made = [_wire_fault(draw, port, kind) for port, kind in faults]
    untold = [fault for fault in made if fault.kind == "vanish" or fault.duration_s > _MUST_TELL_S]
    return Case(
        " + ".join(f"{port} {kind}" for port, kind in faults),
        tuple(made),
        forbidden=("completed",) if untold else (),
    )


def _wire_fault(draw: random.Random, port: str, kind: str) -> Fault:
    at_s = tuple(sorted(draw.uniform(12.0, 50.0) for _ in range(1 if kind in _LASTS_S else 4)))
    lasts_s = draw.uniform(*_LASTS_S[kind]) if kind in _LASTS_S else 0.0
    return Fault(port=port, kind=kind, at_s=at_s, count=draw.randint(1, 5), duration_s=lasts_s)


def _scenarios() -> list[Case]:
    def fault(port: str, kind: str, **more: Any) -> Fault:
        return Fault(port=port, kind=kind, at_s=(25.0,), **more)

    ended, unsafe = ("completed", "invalid"), ("not confirmed",)
    dies = [
        Case(f"two gyros, {name} dies", (fault(name, "vanish", duration_s=1e6),), "", ("completed",))
        for name in _GYROS
    ]
    gone = [
        Case(f"{name} unplugged and back", (fault(name, "vanish", duration_s=5.0),), "", ("completed",))
        for name in _GYROS
    ]
    both = tuple(fault(name, "vanish", duration_s=5.0) for name in _GYROS)
    return [
        *dies,
        *gone,
        Case("both gyros unplugged and back", both, "", ("completed",)),
        Case("chamber alarm", (fault("chamber", "alarm", text="compressor"),), "long", ended),
        Case("table trip", (fault("table", "trip", text="rate trip"),), "", ended),
        Case("table refuses", (fault("table", "refuse", text="busy"),), "", unsafe),
        Case("chamber refuses", (fault("chamber", "refuse"),), "", unsafe),
        Case("chamber never reaches -40", (fault("chamber", "weaken", factor=0.02),), "cold", ("completed",)),
        Case("host clock steps back an hour", (), "clock", ("invalid", "aborted")),
        Case("disk stalls 5 s", (), "disk", ("invalid", "aborted")),
        Case("operator answers after an hour", (), "operator", ("invalid", "aborted")),
        Case("nothing happens", (), "", ("invalid", "aborted")),
    ]


def _procedure(scenario: str) -> Procedure:
    def turn(bench: Bench, _: Parameters) -> None:
        bench.table.device.servo_on()
        bench.chamber.go_to(-40.0 if scenario == "cold" else 20.0)
        bench.chamber.start()
        if scenario == "operator":
            bench.ask("Is the chamber closed?")
        bench.table.spin(5.0)
        if scenario == "cold" and not bench.wait_until(
            lambda: bench.chamber.history.last["air_temp_c"] <= -39.0, timeout_s=2400.0, what="-40 degC"
        ):
            bench.invalidate("the chamber did not reach -40 degC within 40 min")
        if scenario in ("", "clock", "disk"):
            _work(bench)
        else:
            bench.wait(_HOLD_S if scenario != "long" else 150.0, "turning")
        bench.table.stop()

    return Procedure(
        "soak", "A turn", "", Parameters, turn, lambda _: _HOLD_S, lambda _: Demands(5.0, -40.0, 25.0)
    )


def _work(bench: Bench) -> None:
    """Command both instruments again and again: what strikes a command has to be met too."""
    end_s, high = bench.now_s + _HOLD_S, False
    while bench.now_s < end_s:
        bench.wait(1.0, "turning")
        high = not high
        bench.chamber.go_to(20.5 if high else 20.0)
        bench.table.spin(3.0 if high else 5.0)


class _Operator:
    """Answers an hour after the question, by the bench's clock."""

    def ask(self, question: Question) -> Callable[[], Reply | None]:
        waited = iter(range(5 * 3600))  # the bench looks five times a second
        return lambda: None if next(waited, None) is not None else Reply("yes", "late operator")


@contextmanager
def _host_trouble(scenario: str) -> Iterator[None]:
    """Step the host's clock an hour back after the run's start, or let one sync of the disk take 5 s."""
    with ExitStack() as stack:
        if scenario == "clock":
            calls = Counter[str]()

            def now(zone: Any) -> Any:
                calls["now"] += 1
                step = timedelta(hours=1) if calls["now"] > 1 else timedelta()
                return datetime.now(zone) - step

            stepped = SimpleNamespace(datetime=SimpleNamespace(now=now), UTC=UTC)
            stack.enter_context(mock.patch.object(host, "datetime", stepped))
        if scenario == "disk":
            real_sync, stalled = os.fdatasync, Counter[str]()

            def sync(descriptor: int) -> None:
                stalled["sync"] += 1
                if stalled["sync"] == 1:
                    wall = host.WallClock()
                    wall.sleep(5.0)
                    wall.close()
                real_sync(descriptor)

            stack.enter_context(mock.patch.object(os, "fdatasync", sync))
        yield


class Soak:
    """Runs cases one after the other, each in a lab of its own; the gyros' true frames are made once."""

    def __init__(self, root: Path) -> None:
        self._root = root
        self._file = bench_file_from(_FILE)
        self._true: dict[str, set[tuple[str, ...]]] = {}
        self._number = 0

    def run(self, case: Case) -> Verdict:
        """Run and judge one case."""
        self._number += 1
        plant = Plant(seed=11, delivery_s=1.0, fault=case.faults)
        with EmulatedLab(self._file, plant) as lab:
            result = self._drive(lab.file, case)
            verdict = Verdict(case, _outcome(result), result.reason)
            if "not confirmed" not in verdict.outcome and (found := _not_at_rest(lab)):
                verdict.problems.append(f"said to be safe and is not: {found}")
        self._judge(case, result, verdict)
        return verdict

    def _drive(self, file: BenchFile, case: Case) -> RunResult:
        procedure = _procedure(case.scenario)
        request = RunRequest(
            procedure, Parameters(), file, self._root, _Operator(), None, f"run-{self._number}"
        )
        with _host_trouble(case.scenario):
            return run_procedure(request)

    def _judge(self, case: Case, result: RunResult, verdict: Verdict) -> None:
        report = verify(result.folder, decode_run)
        verdict.problems += [f"{problem.path}: {problem.text}" for problem in report.problems]
        manifest = read_manifest(result.folder)
        if manifest.outcome != result.outcome or (result.outcome != "completed" and not manifest.reason):
            verdict.problems.append(f"the record says {manifest.outcome!r}, {manifest.reason!r}")
        if result.outcome in case.forbidden or any(word in verdict.outcome for word in case.forbidden):
            verdict.problems.append(f"ended as {result.outcome}: {result.reason}")
        if result.duration_s > _LATEST_END_S:
            verdict.problems.append(f"took {result.duration_s:.0f} s")
        struck_ports = {fault.port for fault in case.faults}
        verdict.false_readings = {
            name: _false_readings(result.folder, name) for name in struck_ports & _READ.keys()
        }
        if case.scenario or not struck_ports <= set(_GYROS):
            return  # what the gyros felt is not what they would have felt
        for name in _GYROS:
            frames = _frames(result.folder, name)
            if not self._true.get(name):
                self._true[name] = self._true_frames(name)
            false = sum((frames - Counter(dict.fromkeys(self._true[name], 10**9))).values())
            if false:
                verdict.false_frames[name] = false
            altered = any(fault.port == name and fault.kind in _ALTERING for fault in case.faults)
            if false and (name in _CHECKED or not altered):
                verdict.problems.append(f"{name}: {false} frames accepted that were never sent")

    def _true_frames(self, name: str) -> set[tuple[str, ...]]:
        with EmulatedLab(self._file, Plant(seed=11, delivery_s=1.0)) as lab:
            self._number += 1
            result = self._drive(lab.file, Case("the truth"))
        for gyro in _GYROS:
            self._true[gyro] = set(_frames(result.folder, gyro))
        return self._true[name]


def _frames(folder: Path, name: str) -> Counter[tuple[str, ...]]:
    """Return what the record accepts as valid of a gyro's frames, without temperature: it may lag."""
    manifest = read_manifest(folder)
    section = next(entry for entry in bench_file_from(manifest.bench).gyro if entry.name == name)
    data = (folder / "raw" / f"{name}.bin").read_bytes()[int(manifest.stream[name]["start_offset"]) :]
    columns = load_kind("gyro", section.driver).decoder(section).feed(data).columns
    path = folder / f"gyro_{name}.parquet"
    if not path.exists():
        return Counter()
    valid = pq.read_table(path, columns=["valid"])["valid"].to_numpy()
    kept = [
        columns[column][valid].tolist() for column in sorted(columns) if column not in ("valid", "temp_c")
    ]
    return Counter(tuple(map(repr, row)) for row in zip(*kept, strict=True))


def _false_readings(folder: Path, name: str) -> int:
    """Return how many rows of telemetry stand apart from both their neighbours, which agree: a damaged digit."""
    stem, tolerances = _READ[name]
    path = folder / f"{stem}.parquet"
    if not path.exists():
        return 0
    wrong = np.zeros(pq.read_metadata(path).num_rows, np.bool_)
    for column, tolerance in tolerances.items():
        values = pq.read_table(path, columns=[column])[column].to_numpy()
        if len(values) >= 3:
            before, here, behind = values[:-2], values[1:-1], values[2:]
            wrong[1:-1] |= (np.abs(before - behind) <= tolerance) & (np.abs(here - before) > 2.0 * tolerance)
    return int(wrong.sum())


def _outcome(result: RunResult) -> str:
    if not all(state.confirmed for state in result.safe):
        return "aborted, safe state not confirmed and said so"
    return {"aborted": "stopped safe", "invalid": "to its end, invalid"}.get(result.outcome, result.outcome)


def _not_at_rest(lab: EmulatedLab) -> str:
    """Ask table and chamber over links of our own; return what does not rest, empty if all does."""

    class Deaf:
        def received(self, data: bytes, arrival_s: float) -> None: ...

        def sent(self, data: bytes, time_s: float) -> None: ...

    clock = VirtualClock(str(lab.clock_url))
    found = []
    try:
        openers: dict[str, Callable[..., Instrument]] = {"table": open_table, "chamber": open_chamber}
        for name, opener in openers.items():
            text = ""
            for _ in range(5):  # a fault may still strike an answer
                try:
                    device = opener(lab.file, clock, Deaf())
                    try:
                        rest = device.read_rest()
                    finally:
                        device.link.close()
                    text = "" if rest.reached else repr(rest)
                    break
                except RunAborted:
                    raise
                except BenchError as error:
                    text = str(error)
                    clock.sleep(5.0)
            if text:
                found.append(f"{name}: {text}")
    finally:
        clock.close()
    return "; ".join(found)


def soak(count: int, seed: int, say: Callable[[Verdict], None] = lambda _: None) -> list[Verdict]:
    """Run `count` cases and return what became of them."""
    verdicts = []
    with tempfile.TemporaryDirectory() as root:
        runner = Soak(Path(root))
        for case in cases(count, seed):
            verdicts.append(runner.run(case))
            say(verdicts[-1])
    return verdicts


def table(verdicts: list[Verdict]) -> list[str]:
    """Return Markdown lines: outcomes by fault, a pair counted under both of its faults."""
    outcomes = sorted({verdict.outcome for verdict in verdicts})
    by_fault: dict[str, Counter[str]] = {}
    false: Counter[str] = Counter()
    for verdict in verdicts:
        for name in set(verdict.case.name.split(" + ")):
            by_fault.setdefault(name, Counter())[verdict.outcome] += 1
            false[name] += sum(verdict.false_frames.values())
    head = ["fault", "runs", *outcomes, "false frames"]
    rows = [
        [
            name,
            str(found.total()),
            *(str(found[outcome] or "") for outcome in outcomes),
            str(false[name] or ""),
        ]
        for name, found in by_fault.items()
    ]
    return [f"| {' | '.join(row)} |" for row in [head, ["---"] * len(head), *rows]]


def _false_frames(verdicts: list[Verdict]) -> str:
    totals = {name: sum(verdict.false_frames.get(name, 0) for verdict in verdicts) for name in _GYROS}
    return "false frames accepted: " + ", ".join(
        f"{count} of {name} ({'with' if name in _CHECKED else 'no'} check value)"
        for name, count in totals.items()
    )


def _false_readings_text(verdicts: list[Verdict]) -> str:
    totals = {name: sum(verdict.false_readings.get(name, 0) for verdict in verdicts) for name in _READ}
    return ", ".join(f"{count} of the {name}" for name, count in totals.items()) + " (no check value)"


def main() -> int:
    """Run the soak test and write its section; 1 if a run was not honest."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 200
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1

    def say(verdict: Verdict) -> None:
        problems = "".join(f" PROBLEM: {problem}" for problem in verdict.problems)
        print(f"{verdict.case.name}: {verdict.outcome}. {verdict.reason}{problems}", flush=True)

    verdicts = soak(count, seed, say)
    bad = [verdict for verdict in verdicts if verdict.problems]
    lines = [
        f"{count} runs, {len(bad)} with a problem; {_false_frames(verdicts)};",
        f"false readings accepted: {_false_readings_text(verdicts)}.",
        "A pair of faults counts under both.",
        "",
        *table(verdicts),
        "",
        *(f"- {verdict.case.name}: {'; '.join(verdict.problems)}" for verdict in bad),
    ]
    print(write_section("Soak", f"python -m benchmarks.soak {count} {seed}", lines))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
