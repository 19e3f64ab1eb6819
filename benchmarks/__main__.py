"""Runs the benchmarks and prints one table: `python -m benchmarks [NAME ...]`; `--list` names them."""

from __future__ import annotations

import importlib
import pkgutil
import sys
from collections.abc import Iterable, Mapping

import benchmarks


def names() -> list[str]:
    """Return the modules that have rows."""
    found = [module.name for module in pkgutil.iter_modules(benchmarks.__path__)]
    return [
        name
        for name in sorted(found)
        if not name.startswith("_") and hasattr(importlib.import_module(f"benchmarks.{name}"), "rows")
    ]


def show(rows: Iterable[Mapping[str, object]]) -> None:
    """Print rows as a Markdown table."""
    print("| benchmark | ours | yardstick | ratio | unit | yardstick is |")
    print("|---|---|---|---|---|---|")
    for row in rows:
        ours, yardstick, ratio = (_number(row[key]) for key in ("ours", "yardstick", "ratio"))
        print(
            f"| {row['benchmark']} | {ours} | {yardstick} | {ratio} | {row['unit']} | {row['yardstick_name']} |"
        )


def _number(value: object) -> str:
    if isinstance(value, int | float):
        return f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return str(value)


def main() -> None:
    """Run what is asked for, default all."""
    if sys.argv[1:] == ["--list"]:
        print("\n".join(names()))
        return
    for name in sys.argv[1:] or names():
        print(f"\n## {name}\n", flush=True)
        show(importlib.import_module(f"benchmarks.{name}").rows())


if __name__ == "__main__":
    main()
