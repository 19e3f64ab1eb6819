"""Thousands of runs on a Dask cluster of this machine, a worker killed at random every minute.

    python -m benchmarks.cluster             # 10,000 runs on 6 workers; writes its part of docs/scale.md
    python -m benchmarks.cluster --runs 400 --kill-every-s 10 --no-write

The user's own commands: `dask scheduler`, `dask worker`, `gyrobench campaign rehearse --cluster`. A run is one
turn of the table with two gyros, recorded through bytes, decoded and sealed. In the end every run must be sealed,
and ten drawn at random must have the bytes of a rehearsal without a cluster. Resident memory is sampled every two
seconds.
"""

from __future__ import annotations

import argparse
import contextlib
import hashlib
import json
import math
import os
import random
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from benchmarks._marks import fill
from benchmarks._sections import stamp
from drivers.base.clock import host_seconds

_ROOT = Path(__file__).parents[1]
_PAGE = _ROOT / "docs" / "scale.md"
_PLAN = """[[run]]
name = "turn-{number}"
procedure = "constant-rotation"
repeats = {repeats}
parameters = {{ turns = 1, rate_dps = 20, rest_s = 10 }}
"""
_MOST_REPEATS, _FIRST, _COMPARED = 1000, 100, 10
"""Repeats of a run in a campaign; runs made again without a cluster, and how many of them are compared."""
_SAMPLE_S, _YOUNG_S = 2.0, 30.0
"""Time between samples; age of a worker that has loaded all."""


@dataclass
class Watched:
    """Resident memory in MiB over time in s: of scheduler and command, and of each worker over its age."""

    scheduler: list[tuple[float, float]] = field(default_factory=list)
    command: list[tuple[float, float]] = field(default_factory=list)
    workers: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    kills: int = 0


def main() -> None:
    """Run the campaign, check it, and print or write what was measured."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--workers", type=int, default=6)
    parser.add_argument("--kill-every-s", type=float, default=60.0)
    parser.add_argument("--no-write", action="store_true", help="print only")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as spare:
        folder = Path(spare)
        plan = _plan(folder, given.runs)
        watched, elapsed_s = _campaign(folder, plan, given.workers, given.kill_every_s)
        sealed, size_mib = _sealed(folder / "out" / "runs")
        same = _compared(folder, given.runs)
    text = "\n".join(
        [
            *_table(watched, elapsed_s, given.workers, given.runs, sealed, same, size_mib),
            "",
            stamp(f"python -m benchmarks.cluster --runs {given.runs} --workers {given.workers}"),
            "",
        ]
    )
    print(text)
    if sealed != given.runs or same != _COMPARED:
        sys.exit("not every run is there, or not with its bytes")
    if not given.no_write:
        fill(_PAGE, "cluster", text)


def _plan(folder: Path, runs: int) -> Path:
    plan, whole = folder / "plan.toml", runs // _MOST_REPEATS
    sizes = [_MOST_REPEATS] * whole + ([runs % _MOST_REPEATS] if runs % _MOST_REPEATS else [])
    parts = [_PLAN.format(number=number, repeats=repeats) for number, repeats in enumerate(sizes)]
    plan.write_text('title = "turns"\n' + "".join(parts), encoding="utf-8")
    return plan


def _rehearse(plan: Path, out: Path, *more: str) -> list[str]:
    bench = str(_ROOT / "examples" / "demo.toml")
    own = [sys.executable, "-m", "gyrobench", "campaign", "rehearse", str(plan)]
    return [*own, "--bench", bench, "--out", str(out), "--seed", "1", *more]


def _campaign(folder: Path, plan: Path, workers: int, kill_every_s: float) -> tuple[Watched, float]:
    """Return memory over time, and how long the command took."""
    with ExitStack() as stack:
        scheduler = _started(
            stack, folder / "scheduler.log", "scheduler", "--host", "127.0.0.1", "--port", "0"
        )
        address = _logged(folder / "scheduler.log", r"Scheduler at:\s+(tcp://\S+)")[0]
        many = ("--nworkers", str(workers), "--nthreads", "1", "--local-directory", str(folder))
        nannies = _started(stack, folder / "workers.log", "worker", *many, address)
        _logged(folder / "workers.log", r"Registered to:\s+(\S+)", workers)
        begin = host_seconds()
        rehearsal = _rehearse(plan, folder / "out", "--cluster", address, "--json")
        command = psutil.Popen(rehearsal, stdout=subprocess.DEVNULL)
        stack.callback(_end, command)
        watched = _watched(scheduler, nannies, command, kill_every_s)
        elapsed_s = host_seconds() - begin
        if command.wait():
            sys.exit(f"the campaign ended with exit code {command.returncode}")
    return watched, elapsed_s


def _watched(scheduler: Any, nannies: Any, command: Any, kill_every_s: float) -> Watched:
    """Sample memory and kill workers until the command has ended."""
    watched, chance = Watched(), random.Random(1)
    begin = last_kill = host_seconds()
    while command.poll() is None:
        now = host_seconds()
        watched.scheduler.append((now - begin, _mib(scheduler)))
        watched.command.append((now - begin, _mib(command)))
        workers = [each for each in nannies.children() if "spawn_main" in " ".join(_cmdline(each))]
        for worker in workers:
            watched.workers.setdefault(worker.pid, []).append((now, _mib(worker)))
        if workers and now - last_kill >= kill_every_s:
            with contextlib.suppress(psutil.NoSuchProcess):
                chance.choice(workers).kill()
                watched.kills += 1
            last_kill = now
        with contextlib.suppress(psutil.TimeoutExpired):
            command.wait(_SAMPLE_S)
    return watched


def _started(stack: ExitStack, log: Path, what: str, *arguments: str) -> Any:
    own = [sys.executable, "-W", "ignore", "-m", f"distributed.cli.dask_{what}", "--no-dashboard", *arguments]
    quiet = os.environ | {"DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}  # as docs/scale.md says
    with log.open("w", encoding="utf-8") as stream:
        process = psutil.Popen(own, stdout=stream, stderr=stream, env=quiet)
    stack.callback(_end, process)
    return process


def _end(process: Any) -> None:
    with contextlib.suppress(psutil.NoSuchProcess):
        process.terminate()
        process.wait()


def _logged(log: Path, pattern: str, count: int = 1, within_s: float = 60.0) -> list[str]:
    """Return what a log says `count` times, once it does; TimeoutError if it does not."""
    last = host_seconds() + within_s
    while len(found := re.findall(pattern, log.read_text(encoding="utf-8"))) < count:
        if host_seconds() > last:
            raise TimeoutError(f"{log.name} has no {count} lines like {pattern}")
        time.sleep(0.1)
    return found


def _mib(process: Any) -> float:
    """Return a process's resident memory, NaN once it has ended."""
    try:
        return float(process.memory_info().rss) / (1 << 20)
    except psutil.Error:
        return math.nan


def _cmdline(process: Any) -> list[str]:
    try:
        return list(process.cmdline())
    except psutil.Error:
        return []


def _sealed(runs: Path) -> tuple[int, float]:
    """Return how many runs are completed and sealed, and the MiB of all."""
    count, size = 0, 0
    for manifest in runs.glob("*/manifest.json"):
        count += json.loads(manifest.read_text(encoding="utf-8"))["outcome"] == "completed"
        size += sum(path.stat().st_size for path in manifest.parent.rglob("*") if path.is_file())
    return count, size / (1 << 20)


def _compared(folder: Path, runs: int) -> int:
    """Return how many of the runs drawn have the bytes of the same runs without a cluster."""
    first = folder / "first.toml"
    # a run's lab depends on its number alone: the first ones are made again
    first.write_text('title = "turns"\n' + _PLAN.format(number=0, repeats=_FIRST), encoding="utf-8")
    again = _rehearse(first, folder / "again", "--jobs", "1", "--json")
    subprocess.run(again, check=True, stdout=subprocess.DEVNULL)
    drawn = random.Random(2).sample(range(1, min(_FIRST, runs) + 1), _COMPARED)
    names = [f"turn-0-{number}" for number in drawn]
    both = ((folder / "out" / "runs" / name, folder / "again" / "runs" / name) for name in names)
    return sum(_bytes_of(one) == _bytes_of(other) for one, other in both)


def _bytes_of(run: Path) -> dict[str, str]:
    """Return checksums of what the ports carried, and of the tables."""
    files = [*sorted((run / "raw").iterdir()), *sorted(run.glob("*.parquet"))]
    return {str(path.relative_to(run)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def _table(
    watched: Watched, elapsed_s: float, workers: int, runs: int, sealed: int, same: int, size_mib: float
) -> list[str]:
    lived = [values for values in watched.workers.values() if values[-1][0] - values[0][0] > 2.0 * _YOUNG_S]
    loaded = [[(at, mib) for at, mib in values if at - values[0][0] > _YOUNG_S] for values in lived]
    grown = [60.0 * _slope(values) for values in loaded]
    most = max(mib for values in watched.workers.values() for _, mib in values if not math.isnan(mib))
    lines = ["| | |", "|---|---|"]
    lines += [
        f"| runs, sealed | {runs:,}, {sealed:,}; {size_mib:,.0f} MiB |",
        f"| bytes the same without a cluster | {same} of {_COMPARED} drawn from the first {min(_FIRST, runs)} |",
        f"| workers, killed | {workers} at a time, {watched.kills}; {len(watched.workers)} in all |",
        f"| time | {elapsed_s / 60.0:.0f} min, {runs / elapsed_s:.1f} runs/s |",
    ]
    for name, values in (("scheduler", watched.scheduler), ("command", watched.command)):
        first, last = _part(values, 0.1, 0.2), _part(values, 0.9, 1.0)
        lines.append(f"| memory of the {name}, MiB, after a tenth and at the end | {first:.0f}, {last:.0f} |")
    growth = f"{len(grown)}: {np.median(grown):.2f}, {max(grown):.2f}" if grown else "none lived long enough"
    lines.append(
        f"| memory of a worker: most, MiB; growth, MiB/min, median and most | {most:.0f}; of {growth} |"
    )
    return lines


def _part(values: Sequence[tuple[float, float]], start: float, stop: float) -> float:
    whole = values[-1][0]
    known = [mib for at, mib in values if start * whole <= at <= stop * whole and not math.isnan(mib)]
    return float(np.median(known)) if known else math.nan


def _slope(values: Sequence[tuple[float, float]]) -> float:
    at, mib = np.array(values).T
    known = np.isfinite(mib)
    return float(np.polyfit(at[known] - at[0], mib[known], 1)[0])


if __name__ == "__main__":
    main()
