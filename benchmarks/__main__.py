"""Runs the benchmarks and prints their tables: `python -m benchmarks [--keep] [NAME ...]`; `--list` names them.

Everything is in one table at the end, which is written to latest.md too. Ratios are compared with those kept in
ratios.json: a loss of more than a quarter that a second measurement confirms is reported, and the exit code is 1.
`--keep` keeps the ratios found of what is named instead. A benchmark that fails is reported, the others go on.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
import platform
import sys
import traceback
from collections.abc import Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import benchmarks
from benchmarks._guard import better, keep, lost
from drivers.clock import host_seconds, utc_now

LATEST = Path(__file__).with_name("latest.md")
_SOFTWARE = (
    "gyrobench", "numpy", "scipy", "pandas", "pyarrow", "torch", "pyserial", "python-can", "cantools",
    "allantools", "statsmodels", "filterpy", "asammdf", "pymeasure", "tickit",
)  # fmt: skip


def names() -> list[str]:
    """Return the modules that have rows."""
    found = [module.name for module in pkgutil.iter_modules(benchmarks.__path__)]
    return [
        name
        for name in sorted(found)
        if not name.startswith("_") and hasattr(importlib.import_module(f"benchmarks.{name}"), "rows")
    ]


def show(rows: Iterable[Mapping[str, object]]) -> str:
    """Print rows as a Markdown table and return it."""
    text = table(rows)
    print(text, end="", flush=True)
    return text


def table(rows: Iterable[Mapping[str, object]]) -> str:
    """Return rows as a Markdown table."""
    lines = ["| benchmark | ours | yardstick | ratio | unit | yardstick is |", "|---|---|---|---|---|---|"]
    for row in rows:
        ours, yardstick, ratio = (_number(row[key]) for key in ("ours", "yardstick", "ratio"))
        lines.append(
            f"| {row['benchmark']} | {ours} | {yardstick} | {ratio} | {row['unit']} | {row['yardstick_name']} |"
        )
    return "\n".join(lines) + "\n"


def _number(value: object) -> str:
    if isinstance(value, int | float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return str(value)


def machine() -> str:
    """Return in a line when, on what and with which versions."""
    versions = ", ".join(f"{name} {found}" for name in _SOFTWARE if (found := _version(name)))
    load = os.getloadavg()[0]
    return (
        f"{utc_now()}, {os.cpu_count()} processors ({platform.machine()}), load {load:.1f}, "
        f"{platform.system()} {platform.release()}, Python {platform.python_version()}, {versions}"
    )


def _version(name: str) -> str:
    try:
        return version(name)
    except PackageNotFoundError:
        return ""


def measured(name: str) -> tuple[list[Mapping[str, object]], list[str]]:
    """Return a benchmark's rows, and what it lost of the ratios kept, twice in a row."""
    module = importlib.import_module(f"benchmarks.{name}")
    rows = list(module.rows())
    losses = lost(name, rows)
    if losses:
        print(f"{len(losses)} ratios lower than kept: measured once more", flush=True)
        again = list(module.rows())
        rows = better(rows, again)
        losses = lost(name, rows)
    return rows, losses


def main() -> int:
    """Run what is asked for, default all; return 1 if a ratio was lost or a benchmark failed."""
    asked = [argument for argument in sys.argv[1:] if argument != "--keep"]
    if asked == ["--list"]:
        print("\n".join(names()))
        return 0
    begin, everything, losses, failures = host_seconds(), [], [], []
    for name in asked or names():
        print(f"\n## {name}\n", flush=True)
        started = host_seconds()
        try:
            rows, missing = measured(name)
        except Exception as error:  # the others are measured all the same
            traceback.print_exc()
            failures.append(f"{name}: {type(error).__name__}: {error}")
            continue
        show(rows)
        print(f"\n{host_seconds() - started:.0f} s", flush=True)
        everything += rows
        if "--keep" in sys.argv[1:]:
            keep(name, rows)
        else:
            losses += missing
    text = f"# Latest figures\n\n`make bench`, {machine()}; took {host_seconds() - begin:.0f} s.\n\n"
    text += table(everything)
    for title, found in (("Lost more than a quarter", losses), ("Failed", failures)):
        if found:
            text += f"\n## {title}\n\n" + "".join(f"- {each}\n" for each in found)
    print(f"\n{text}", flush=True)
    LATEST.write_text(text, encoding="utf-8")
    return 1 if losses or failures else 0


if __name__ == "__main__":
    sys.exit(main())
