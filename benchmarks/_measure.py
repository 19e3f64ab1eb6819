"""Two ways of doing the same work timed in turns, and what a row of a table is.

Processor time of this process (`process_time`) is hardly moved by what else the machine does, and of two works
that follow each other both are slowed alike: the ratio is the median of the ratios of neighbours. `--quick` takes
fewer turns.
"""

from __future__ import annotations

import ctypes
import gc
import math
import multiprocessing
import resource
import statistics
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from time import process_time
from typing import Any, TypeVar

Row = dict[str, object]
Work = Callable[[], object]
Timer = Callable[[], float]
Count = TypeVar("Count", int, float)
_quick = [False]


def be_quick(quick: bool = True) -> None:
    """Measure less precisely from now on."""
    _quick[0] = quick


def usual(count: Count, quick: Count) -> Count:
    """Return how many turns, seconds or runs to take: `count`, or `quick` of them where it is to go fast."""
    return quick if _quick[0] else count


@dataclass(frozen=True)
class Pair:
    """Median seconds of ours and of the other, and the median of the other's over ours."""

    ours_s: float
    other_s: float
    ratio: float


def in_turns(
    ours: Work, other: Work, *, turns: int = 5, least_s: float = 0.02, timer: Timer = process_time
) -> Pair:
    """Time both `turns` times, one after the other, each often enough for `least_s`; first once to warm up."""
    turns = usual(turns, min(turns, 3))
    repeats = [max(1, round(least_s / max(1e-7, _seconds(work, 1, timer)))) for work in (ours, other)]
    times = [(_seconds(ours, repeats[0], timer), _seconds(other, repeats[1], timer)) for _ in range(turns)]
    return Pair(
        statistics.median(mine for mine, _ in times),
        statistics.median(its for _, its in times),
        statistics.median(its / max(mine, 1e-9) for mine, its in times),
    )


def all_cpu_s() -> float:
    """Return the processor time of this process and of those it has started and that have ended."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(usage.ru_utime + usage.ru_stime for usage in used)


def _seconds(work: Work, repeats: int, timer: Timer) -> float:
    begin = timer()
    for _ in range(repeats):
        work()
    return (timer() - begin) / repeats


def row(
    benchmark: str, pair: Pair, yardstick_name: str, *, per: float = 1.0, unit: str = "s", kept: bool = True
) -> Row:
    """Return the row of two times; `per` units make a second (1e3 for ms), the ratio is how many times faster.

    What is measured against a limit or a goal is not kept: there the machine decides.
    """
    return {
        "benchmark": benchmark,
        "ours": per * pair.ours_s,
        "yardstick": per * pair.other_s,
        "yardstick_name": yardstick_name,
        "unit": unit,
        "ratio": pair.ratio,
        "kept": kept and not yardstick_name.startswith(("limit", "goal")),
    }


def speed_row(benchmark: str, amount: float, pair: Pair, yardstick_name: str, unit: str) -> Row:
    """Return the row of two speeds, `amount` units having been done in each time of `pair`."""
    own = amount / pair.ours_s
    return row(benchmark, pair, yardstick_name, unit=unit) | {"ours": own, "yardstick": own / pair.ratio}


def figure(
    benchmark: str, ours: float, yardstick: float, yardstick_name: str, unit: str, *, least: bool = False
) -> Row:
    """Return the row of a figure, its ratio ours / yardstick, or its inverse where the `least` is best.

    Its ratio is not kept: one measurement, which the disk, the network or the hour moves.
    """
    return {
        "benchmark": benchmark,
        "ours": ours,
        "yardstick": yardstick,
        "yardstick_name": yardstick_name,
        "unit": unit,
        "ratio": (yardstick / ours if ours > 0 else math.inf) if least else ours / yardstick,
        "kept": False,
    }


@dataclass(frozen=True)
class Cost:
    """Processor seconds of a work, and by how many MiB its memory rose at its peak."""

    cpu_s: float
    memory_mib: float


def cost(prepare: Callable[[], Work]) -> Cost:
    """Make a work ready in a forked process of its own and return what doing it cost; errors are raised here."""
    fork = multiprocessing.get_context("fork")
    receiver, sender = fork.Pipe(duplex=False)
    process = fork.Process(target=_report, args=(prepare, sender))
    process.start()
    sender.close()
    try:
        found = receiver.recv()
    except EOFError:
        found = RuntimeError("the process that did the work was killed")
    process.join()
    if isinstance(found, BaseException):
        raise found
    return Cost(*found)


def _report(prepare: Callable[[], Work], sender: Any) -> None:
    try:
        work = prepare()
        gc.collect()
        ctypes.CDLL(None).malloc_trim(0)
        Path("/proc/self/clear_refs").write_text("5")  # the peak starts from here
        before_kib, begin = _status("VmRSS"), process_time()
        work()
        cpu_s = process_time() - begin
        sender.send((cpu_s, max(0.0, (_status("VmHWM") - before_kib) / 1024.0)))
    except BaseException as error:
        sender.send(error)


def _status(name: str) -> float:
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(float(line.split()[1]) for line in lines if line.startswith(name + ":"))
