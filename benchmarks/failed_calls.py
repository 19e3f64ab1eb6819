"""Every call that a recorder makes of the system fails once, then two in a run: no run lies about its record.

Run as `python -m benchmarks.failed_calls [PAIRS] [SEED] [EVERY]` (a C compiler is needed; without one it says
so and ends with 2); writes its section of benchmarks/reliability.md. A run on an emulated lab, from the making of
its folder to the seal, is repeated; each time another call on the files fails (EVERY: each so many-th only): with
EIO, with no space from there on, or by taking only half of the bytes. The calls are those of the C library
(`_failing_calls.c`, preloaded), Python's and Arrow's alike. Then pairs, drawn; then the calls of `runs recover`;
then a process that is refused memory.

Judged against an undisturbed run of the same seed, which has the same bytes: a run that reads "completed" has
every byte, and verifies; any other says why, its table and chamber rest, and it is completed by `runs recover`
unless it never had a manifest; its bytes are the same until the two runs went apart; nobody sees a traceback.
Of a process that is refused memory only the record is judged: it may die of that.
"""

from __future__ import annotations

import ctypes
import errno
import json
import math
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import traceback
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.control.procedure import Demands, Parameters, Procedure
from bench.control.recover import recover
from bench.control.run_record import decode_run
from bench.control.session import Bench
from bench.lab.emulated import Plant
from bench.lab.rehearsal import rehearse_procedure
from bench.record.benchfile import bench_file_from
from bench.record.events.run import Invalid
from bench.record.recording import read_events, read_manifest, verify
from benchmarks._sealed_runs import FILE
from benchmarks._sections import write_section
from drivers.base.clock import WallClock
from drivers.base.errors import BenchError

SHORT, FULL = -1, -2
_HOW = {errno.EIO: "EIO", FULL: "no space from there on", SHORT: "half of the bytes"}
_GYROS = ("fog_1", "can_1")
_SOURCE = Path(__file__).with_name("_failing_calls.c")
_PATIENCE_S = 60.0
_TURN_S = 4.0
_REFUSED = 1, 20, 10**9
"""How many requests for memory in a row are refused."""
_MEMORY_TRIALS = 100
_REQUESTS = 4000
"""Of 512 bytes and more that such a run makes from when its table turns, about."""

Strike = tuple[int, int]
"""Number of the call, from 1, and how it fails."""


@dataclass
class Tally:
    """What became of the trials of a kind."""

    trials: int = 0
    ends: Counter[str] = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)


@dataclass(frozen=True)
class Truth:
    """Of an undisturbed run: its raw files, time and kind of its events, and its measurements."""

    raw: dict[str, bytes]
    rows: list[tuple[float, str]]
    measurements: tuple[dict[str, Any], ...]

    @classmethod
    def of(cls, folder: Path) -> Truth:
        """Read it from a run folder."""
        raw = {path.name: path.read_bytes() for path in sorted((folder / "raw").iterdir())}
        return cls(raw, _rows(folder), read_manifest(folder).measurements)


def _rows(folder: Path) -> list[tuple[float, str]]:
    return [(row["time_s"], row["kind"]) for row in read_events(folder).rows]


def _turn(bench: Bench, _: Parameters) -> None:
    bench.table.device.servo_on()
    with bench.step("1", "Turn"):
        bench.table.spin(5.0)
        bench.wait(_TURN_S, "turning")
    bench.measure("rate_error", 0.25, "deg/h")
    bench.table.stop()


def _record(runs: Path, starve: tuple[int, int] | None = None) -> str:
    """Make a run in `runs`; return its outcome, and whether the bench rests."""

    def turn(bench: Bench, parameters: Parameters) -> None:
        if starve is not None:
            ctypes.CDLL(None).failing_calls_starve(*map(ctypes.c_long, starve))
        _turn(bench, parameters)

    procedure = Procedure(
        "turn",
        "A turn",
        "",
        Parameters,
        turn,
        lambda _: _TURN_S,
        lambda _: Demands(5.0),
        text="RATE = 5.0\n",
    )
    file = bench_file_from(FILE | {"recording": {"flush_interval_s": 0.8}})
    result = rehearse_procedure(procedure, Parameters(), file, Plant(seed=11), runs, run_id="run")
    rests = all(state.confirmed for state in result.safe)
    if result.outcome != "completed" and not result.reason:
        return "ended without a reason"
    return result.outcome if rests else f"{result.outcome}, not confirmed safe"


def _recover(runs: Path) -> str:
    return recover(runs / "run").outcome


def _forked(work: Callable[[Path], str], runs: Path, strikes: tuple[Strike, ...]) -> tuple[str, list[str]]:
    """Do `work` in a process of its own whose calls fail; return how it ended, and every call that was made.

    How it ended: what `work` returned, "refused: ..." for an error in words, else what is wrong.
    """
    told, log = runs.with_name("told"), runs.with_name("calls")
    for path in (told, log):
        path.write_bytes(b"")
    pid = os.fork()
    if pid == 0:
        try:
            _child(work, runs, strikes, told, log)
        finally:
            os._exit(1)  # whatever it met, it is no second parent
    status = _wait(pid)
    text = told.read_text("utf-8", "replace")
    end = text.rpartition("\nEND ")[2].strip() if "\nEND " in text else f"no end, status {status}"
    if "Traceback" in text and not end.startswith("Traceback"):
        end += "; Traceback: " + text.replace("\n", " ")[-600:]
    return end, log.read_text("utf-8", "replace").splitlines()


def _child(
    work: Callable[[Path], str], runs: Path, strikes: tuple[Strike, ...], told: Path, log: Path
) -> None:
    output = os.open(told, os.O_WRONLY | os.O_APPEND)
    os.dup2(output, 1)
    os.dup2(output, 2)
    feed = partial(ctypes.CDLL(None).failing_calls_starve, 0, 0)
    _arm(f"{runs}/", strikes, os.open(log, os.O_WRONLY | os.O_APPEND))
    try:
        end = work(runs)
    except BenchError as error:
        feed()
        end = f"refused: {error}".replace("\n", " ")
    except BaseException:
        feed()
        end = "Traceback: " + traceback.format_exc(limit=-4).replace("\n", " ")
    feed()
    os.write(output, f"\nEND {end}\n".encode())
    os._exit(0)


def _wait(pid: int) -> int:
    clock = WallClock()
    until_s = clock.now() + _PATIENCE_S
    try:
        while True:
            done, status = os.waitpid(pid, os.WNOHANG)
            if done:
                return status
            if clock.now() > until_s:
                os.kill(pid, signal.SIGKILL)
            clock.sleep(0.01)
    finally:
        clock.close()


def _arm(below: str, strikes: tuple[Strike, ...], log: int) -> None:
    first, second = (*strikes, (0, 0), (0, 0))[:2]
    ctypes.CDLL(None).failing_calls_arm(
        below.encode(), ctypes.c_long(first[0]), first[1], ctypes.c_long(second[0]), second[1], log
    )


def _judge(folder: Path, said: str, truth: Truth, *, words: bool) -> tuple[str, list[str]]:
    """Return in a few words what a run came to, and what is wrong with that; `words`: it had to end in words."""
    end, _, shown = said.partition("; Traceback")
    speechless = bool(shown) or end.startswith(("Traceback", "no end", "ended without"))
    problems = [said] if speechless and words else []
    if end.endswith("not confirmed safe") and words:
        problems.append(end)
    if not (folder / "manifest.json").exists():
        return "no record begun", [*problems, *(["said to be completed"] if end == "completed" else [])]
    was_open = not read_manifest(folder).complete
    manifest = recover(folder)
    problems += [f"{problem.path}: {problem.text}" for problem in verify(folder, decode_run).problems]
    raw = (
        {path.name: path.read_bytes() for path in sorted((folder / "raw").iterdir())}
        if (folder / "raw").exists()
        else {}
    )
    events = read_events(folder)
    if "completed" in (end, manifest.outcome):
        if end != manifest.outcome and not (end.startswith("refused") or speechless):
            problems.append(f"said to be {end}, its record says {manifest.outcome}")
        differ = [name for name in {*raw, *truth.raw} if raw.get(name) != truth.raw.get(name)]
        problems += [f"completed, and {name} is not what passed" for name in differ]
        if _rows(folder) != truth.rows or manifest.measurements != truth.measurements:
            problems.append("completed, and its events are others")
    elif not any(invalid.code == "record_hole" for _, invalid in events.of(Invalid)):
        apart_s = _apart_s(folder, raw, truth)
        for name in _GYROS:
            marks = _marks(raw, f"{name}.bin")
            alike = int(max(marks[marks[:, 1] < apart_s * 1e9, 0], default=0))
            if raw.get(f"{name}.bin", b"")[:alike] != truth.raw[f"{name}.bin"][:alike]:
                problems.append(f"{name}.bin is not what was sent")
    return f"{manifest.outcome}, recovered" if was_open else manifest.outcome, problems


def _apart_s(folder: Path, raw: dict[str, bytes], truth: Truth) -> float:
    """Return from when on a run went another way than the undisturbed one, s.

    That is the first event or the first byte told to a device that is another: from there the table turns
    otherwise, and the gyros feel it.
    """
    times = [here[0] for here, there in zip(_rows(folder), truth.rows, strict=False) if here != there][:1]
    for name in (name for name in truth.raw if name.endswith(".sent.bin")):
        here, there = raw.get(name, b""), truth.raw[name]
        alike = next(
            (at for at, (one, two) in enumerate(zip(here, there, strict=False)) if one != two), len(there)
        )
        if alike < len(here):
            marks = _marks(raw, name)
            times.append(float(marks[np.searchsorted(marks[:, 0], alike, side="right"), 1]) / 1e9)
    return min(times, default=math.inf)


def _marks(raw: dict[str, bytes], name: str) -> NDArray[np.int64]:
    return np.frombuffer(raw.get(f"{name.removesuffix('.bin')}.idx", b""), "<i8").reshape(-1, 2)


class Trials:
    """Runs in a folder, one after the other."""

    def __init__(self, root: Path) -> None:
        self._runs = root / "runs"
        end, calls = self._once(_record, ())
        if end != "completed":
            raise RuntimeError(f"the undisturbed run ended as {end}")
        self.calls = calls
        self._truth = Truth.of(self._runs / "run")
        self._left = self._leave_open(root)
        end, self.recover_calls = self._once(_recover, (), self._left)
        if end != "aborted":
            raise RuntimeError(f"the undisturbed recovery ended as {end}")

    def _leave_open(self, root: Path) -> Path:
        """Return a run as a kill would have left it."""
        left = shutil.copytree(self._runs / "run", root / "left" / "run")
        for path in left.glob("*.parquet"):
            path.unlink()
        shutil.rmtree(left / "live")
        lines = (left / "events.jsonl").read_bytes().splitlines(keepends=True)
        (left / "events.jsonl").write_bytes(b"".join(lines[:-1]))
        manifest = json.loads((left / "manifest.json").read_text("utf-8"))
        starts = {name: {"start_offset": entry["start_offset"]} for name, entry in manifest["stream"].items()}
        manifest |= {"outcome": "running", "seal": "", "files": {}, "written": {}, "stream": starts}
        (left / "manifest.json").write_text(json.dumps(manifest), "utf-8")
        return left

    def _once(
        self,
        work: Callable[[Path], str],
        strikes: tuple[Strike, ...],
        left: Path | None = None,
    ) -> tuple[str, list[str]]:
        shutil.rmtree(self._runs, ignore_errors=True)
        self._runs.mkdir()
        if left is not None:
            shutil.copytree(left, self._runs / "run")
        return _forked(work, self._runs, strikes)

    def record(
        self, strikes: tuple[Strike, ...], tally: Tally, starve: tuple[int, int] | None = None
    ) -> None:
        """Make a run whose calls fail, or that is refused memory (first request, how many), and judge it."""
        end, calls = self._once(partial(_record, starve=starve), strikes)
        self._count(end, calls, strikes, tally)

    def recover(self, strikes: tuple[Strike, ...], tally: Tally) -> None:
        """Recover a run by calls that fail, and judge what another recovery makes of it."""
        end, calls = self._once(_recover, strikes, self._left)
        self._count(end, calls, strikes, tally)

    def _count(self, end: str, calls: list[str], strikes: tuple[Strike, ...], tally: Tally) -> None:
        tally.trials += 1
        try:
            word, problems = _judge(self._runs / "run", end, self._truth, words=bool(strikes))
        except (BenchError, OSError) as error:
            word, problems = "cannot be recovered", [str(error).replace("\n", " ")]
        tally.ends[word] += 1
        failed = [calls[at - 1] if at <= len(calls) else f"{at} not made" for at, _ in strikes]
        how = " and ".join(f"{call} ({_HOW[kind]})" for call, (_, kind) in zip(failed, strikes, strict=True))
        tally.problems += [f"{how or 'memory'}: {problem}" for problem in problems]


def _applies(call: str, how: int) -> bool:
    """Return whether a call can fail so: not every one moves bytes, or takes space."""
    kinds = {SHORT: ("read", "write"), FULL: ("open", "write", "sync", "mkdir", "rename")}
    return how not in kinds or call.split()[1] in kinds[how]


def failed_calls(
    pairs: int, seed: int, say: Callable[[str], None] = lambda _: None, every: int = 1
) -> dict[str, Tally]:
    """Have every call (each `every`-th) fail once, then `pairs` drawn from `seed`; return what became of it."""
    draw, tallies = random.Random(seed), {}
    with tempfile.TemporaryDirectory(prefix="gyrobench-calls-") as root:
        trials = Trials(Path(root))
        for name, made, attempt in (
            ("run", trials.calls, trials.record), ("`runs recover`", trials.recover_calls, trials.recover)
        ):  # fmt: skip
            for how, words in _HOW.items():
                tally = tallies[f"{name}: a call fails, {words}"] = Tally()
                for number in range(1, len(made) + 1, every):
                    if _applies(made[number - 1], how):
                        attempt(((number, how),), tally)
                say(f"{name}, {words}: {tally.ends}, {len(tally.problems)} problems")
        tally = tallies["run: two calls fail"] = Tally()
        for _ in range(pairs):
            drawn = sorted(draw.sample(range(1, len(trials.calls) + 1), 2))
            trials.record(tuple((number, draw.choice([errno.EIO, FULL, SHORT])) for number in drawn), tally)
        say(f"pairs: {tally.ends}, {len(tally.problems)} problems")
        tally = tallies["run: memory runs out"] = Tally()
        for _ in range(_MEMORY_TRIALS // every):
            trials.record((), tally, (draw.randint(1, _REQUESTS), draw.choice(_REFUSED)))
        say(f"memory: {tally.ends}, {len(tally.problems)} problems")
    return tallies


def library(folder: Path) -> Path | None:
    """Compile the calls that fail into `folder`; None where there is no Linux and no C compiler."""
    compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
    if compiler is None or sys.platform != "linux":
        return None
    made = folder / "failing_calls.so"
    subprocess.run([compiler, "-O1", "-shared", "-fPIC", "-o", str(made), str(_SOURCE), "-ldl"], check=True)
    return made


def _preloaded(arguments: list[str]) -> int:
    with tempfile.TemporaryDirectory(prefix="gyrobench-calls-") as folder:
        if (calls := library(Path(folder))) is None:
            print(
                "FAILED CALLS NOT MADE: this takes Linux and a C compiler (cc, gcc, clang).", file=sys.stderr
            )
            return 2
        command = [sys.executable, "-m", "benchmarks.failed_calls", *arguments]
        return subprocess.run(command, env=os.environ | {"LD_PRELOAD": str(calls)}, check=False).returncode


def main() -> int:
    """Have calls fail and write the section; 1 if a run was not honest."""
    if not hasattr(ctypes.CDLL(None), "failing_calls_arm"):
        return _preloaded(sys.argv[1:])
    pairs, seed, every = (*map(int, sys.argv[1:4]), *(200, 1, 1)[len(sys.argv) - 1 :])
    tallies = failed_calls(pairs, seed, lambda text: print(text, flush=True), every)
    problems = [f"{kind}: {text}" for kind, tally in tallies.items() for text in tally.problems]
    rows = [
        f"| {kind} | {tally.trials} | {', '.join(f'{n} {end}' for end, n in sorted(tally.ends.items()))} "
        f"| {len(tally.problems)} |"
        for kind, tally in tallies.items()
    ]
    lines = [
        f"{sum(tally.trials for tally in tallies.values())} runs, {len(problems)} problems. A run that reads",
        "completed has every byte and event of an undisturbed run of the same seed, and verifies. Every other",
        "says why, its table and chamber rest, its bytes are those of that run until the two went apart, and",
        "`runs recover` completes it unless it never had a manifest. Nobody saw a traceback. Calls: those of the",
        "C library on the files of the run, one after the other, and every one of `runs recover`. Where memory",
        "runs out, requests of 512 bytes and more are refused from a random one on (1, 20, or all): there only",
        "the record is judged, since a process may die of it, as of a kill."
        + ("" if every == 1 else f" One call in {every} was failed; without the third number, every one is."),
        "",
        "| what fails | runs | they end as | problems |",
        "|---|---|---|---|",
        *rows,
        "",
        *(f"- {text[:600]}" for text in problems[:20]),
    ]
    print(write_section("Failed calls", f"python -m benchmarks.failed_calls {pairs} {seed} {every}", lines))
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
