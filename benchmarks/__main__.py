"""Runs the benchmarks and prints their tables: `python -m benchmarks [--keep] [NAME ...]`; `--list` names them.

The tables are written to latest.md too. Ratios are compared with those kept in ratios.json: a loss of more than a
quarter is reported and ends with exit code 1. `--keep` keeps the ratios found of what is named instead.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
import platform
import sys
from collections.abc import Iterable, Mapping
from importlib.metadata import version
from pathlib import Path

import benchmarks
from benchmarks._guard import keep, lost
from drivers.clock import utc_now

LATEST = Path(__file__).with_name("latest.md")


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
    lines = ["| benchmark | ours | yardstick | ratio | unit | yardstick is |", "|---|---|---|---|---|---|"]
    for row in rows:
        ours, yardstick, ratio = (_number(row[key]) for key in ("ours", "yardstick", "ratio"))
        lines.append(
            f"| {row['benchmark']} | {ours} | {yardstick} | {ratio} | {row['unit']} | {row['yardstick_name']} |"
        )
    print("\n".join(lines), flush=True)
    return "\n".join(lines) + "\n"


def _number(value: object) -> str:
    if isinstance(value, int | float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return str(value)


def machine() -> str:
    """Return in a line when, on what and with which versions."""
    versions = ", ".join(f"{name} {version(name)}" for name in ("gyrobench", "numpy", "scipy", "torch"))
    load = os.getloadavg()[0]
    return (
        f"{utc_now()}, {os.cpu_count()} processors ({platform.machine()}), load {load:.1f}, "
        f"{platform.system()} {platform.release()}, Python {platform.python_version()}, {versions}"
    )


def main() -> int:
    """Run what is asked for, default all; return 1 if a ratio was lost."""
    asked = [argument for argument in sys.argv[1:] if argument != "--keep"]
    if asked == ["--list"]:
        print("\n".join(names()))
        return 0
    texts, losses = [f"# Latest figures\n\n`make bench`, {machine()}\n"], []
    for name in asked or names():
        print(f"\n## {name}\n", flush=True)
        rows = list(importlib.import_module(f"benchmarks.{name}").rows())
        texts.append(f"## {name}\n\n{show(rows)}")
        if "--keep" in sys.argv[1:]:
            keep(name, rows)
        losses += lost(name, rows)
    if losses:
        texts.append("## Lost more than a quarter\n\n" + "".join(f"- {text}\n" for text in losses))
        print(f"\n{texts[-1]}")
    LATEST.write_text("\n".join(texts), encoding="utf-8")
    return 1 if losses else 0


if __name__ == "__main__":
    sys.exit(main())
