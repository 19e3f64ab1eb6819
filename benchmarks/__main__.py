"""Runs the benchmarks: `python -m benchmarks [--quick] [--write] [--keep] [NAME ...]`; `--list` names them.

Every row is printed as soon as it is measured, with how long it took; all are in one table at the end. `--write`
also puts them into RESULTS.md, a section a benchmark; `make bench` does. `--quick` takes fewer turns and is less
precise. Ratios are compared with those kept in ratios.json: a loss of more than a quarter that a second
measurement confirms is reported, and the exit code is 1. `--keep` keeps the ratios found of what is named. A
benchmark that fails is reported, its rows up to there and the others are not lost; the exit code is 1.
"""

from __future__ import annotations

import argparse
import importlib
import os
import pkgutil
import platform
import sys
import traceback
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import benchmarks
from benchmarks._guard import better, keep, lost
from benchmarks._measure import be_quick
from benchmarks._sections import RESULTS, write_section
from drivers.base.clock import host_seconds

_HEAD = "| benchmark | ours | yardstick | ratio | unit | yardstick is |\n|---|---|---|---|---|---|\n"
_SOFTWARE = (
    "gyrobench", "numpy", "scipy", "pandas", "pyarrow", "torch", "pyserial", "python-can", "cantools",
    "allantools", "statsmodels", "filterpy", "asammdf", "pymeasure", "tickit", "lewis",
)  # fmt: skip


@dataclass
class Found:
    """What became of a benchmark: its rows, the ratios it lost, why it failed if it did, how long it took."""

    name: str
    rows: list[Mapping[str, object]] = field(default_factory=list)
    losses: list[str] = field(default_factory=list)
    failure: str = ""
    took_s: float = 0.0


def names() -> list[str]:
    """Return the modules that have rows."""
    found = [module.name for module in pkgutil.iter_modules(benchmarks.__path__)]
    return [
        name
        for name in sorted(found)
        if not name.startswith("_") and hasattr(importlib.import_module(f"benchmarks.{name}"), "rows")
    ]


def show(rows: Iterable[Mapping[str, object]]) -> list[Mapping[str, object]]:
    """Print rows as a Markdown table, each as soon as it is there, and return them."""
    return list(_shown(rows))


def _shown(rows: Iterable[Mapping[str, object]]) -> Iterator[Mapping[str, object]]:
    print(_HEAD, end="", flush=True)
    begin = host_seconds()
    for row in rows:
        print(f"{line(row)} {host_seconds() - begin:.1f} s", flush=True)
        yield row
        begin = host_seconds()


def table(rows: Iterable[Mapping[str, object]]) -> str:
    """Return rows as a Markdown table."""
    return _HEAD + "".join(f"{line(row)}\n" for row in rows)


def line(row: Mapping[str, object]) -> str:
    """Return a row as a line of the table."""
    ours, yardstick, ratio = (_number(row[key]) for key in ("ours", "yardstick", "ratio"))
    return (
        f"| {row['benchmark']} | {ours} | {yardstick} | {ratio} | {row['unit']} | {row['yardstick_name']} |"
    )


def _number(value: object) -> str:
    if isinstance(value, int | float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return str(value)


def machine() -> str:
    """Return in a line on what and with which versions."""
    versions = ", ".join(f"{name} {found}" for name in _SOFTWARE if (found := _version(name)))
    memory_gib = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return (
        f"{os.cpu_count()} processors ({_processor()}), {memory_gib:.0f} GiB, "
        f"{platform.system()} {platform.release()}, Python {platform.python_version()}, {versions}"
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    return f"{model}, {platform.machine()}" if model else platform.machine()


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def measured(name: str, *, guarded: bool = True) -> Found:
    """Run a benchmark, once more if ratios were lost; what it printed until it failed is kept."""
    found, begin = Found(name), host_seconds()
    try:
        rows = importlib.import_module(f"benchmarks.{name}").rows
        for row in _shown(rows()):
            found.rows.append(row)
        found.losses = lost(name, found.rows) if guarded else []
        if found.losses:
            print(f"{len(found.losses)} ratios lower than kept: measured once more", flush=True)
            found.rows = better(found.rows, list(_shown(rows())))
            found.losses = lost(name, found.rows)
    except Exception as error:  # the others are measured all the same
        traceback.print_exc()
        found.failure = f"{name}: {type(error).__name__}: {error}"
    found.took_s = host_seconds() - begin
    print(f"{name} took {found.took_s:.0f} s", flush=True)
    return found


def write(found: Found, command: str) -> None:
    """Put what was found of a benchmark into its section of the page."""
    lines = [table(found.rows)] if found.rows else []
    lines += [f"Failed: {found.failure}", ""] if found.failure else []
    write_section(found.name, f"{command} {found.name}", [*lines, f"Took {found.took_s:.0f} s."], RESULTS)


def write_whole(everything: Sequence[Found], command: str, took_s: float) -> None:
    """Put machine, versions, and what was lost or failed at the page's head."""
    told = [f"{machine()}.", "", f"All took {took_s / 60.0:.1f} minutes."]
    write_section("Machine", command, told, RESULTS)
    write_section("Guard", command, trouble(everything), RESULTS)


def trouble(everything: Sequence[Found]) -> list[str]:
    """Return a line for each ratio lost and each benchmark that failed, or that there is none."""
    losses = [f"- lost more than a quarter: {text}" for found in everything for text in found.losses]
    failures = [f"- failed: {found.failure}" for found in everything if found.failure]
    return [*losses, *failures] or ["No ratio kept was lost, nothing failed."]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is asked for, default all; return 1 if a ratio was lost or a benchmark failed."""
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="benchmarks, default all")
    parser.add_argument("--list", action="store_true", help="name them")
    parser.add_argument("--quick", action="store_true", help="fewer turns, less precise")
    parser.add_argument("--write", action="store_true", help="write RESULTS.md")
    parser.add_argument("--keep", action="store_true", help="keep the ratios found")
    asked, known = parser.parse_args(arguments), names()
    if asked.list:
        print("\n".join(known))
        return 0
    if unknown := sorted(set(asked.names) - set(known)):
        parser.error(f"no benchmark {', '.join(unknown)}; there are {', '.join(known)}")
    be_quick(asked.quick)
    command = "python -m benchmarks" + (" --quick" if asked.quick else "")
    begin, everything = host_seconds(), []
    chosen = asked.names or known
    for number, name in enumerate(chosen, 1):
        print(
            f"\n## {name} ({number} of {len(chosen)}, {host_seconds() - begin:.0f} s since the start)\n",
            flush=True,
        )
        found = measured(name, guarded=not asked.keep)
        everything.append(found)
        if asked.write:
            write(found, command)
        if asked.keep and not found.failure:
            keep(name, found.rows)
    print(f"\n## All\n\n{machine()}\n\n{table(row for found in everything for row in found.rows)}")
    print("\n".join(trouble(everything)), flush=True)
    if asked.write and not asked.names:
        write_whole(everything, command, host_seconds() - begin)
    return 1 if any(found.losses or found.failure for found in everything) else 0


if __name__ == "__main__":
    sys.exit(main())
