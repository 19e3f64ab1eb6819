"""What a procedure measured, as `run`, `rehearse` and `runs show` print it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bench.present.cli._console import Terminal


def say_measurements(console: Terminal, rows: Sequence[Mapping[str, Any]]) -> None:
    """Print what a procedure measured; nothing if it measured nothing."""
    if not rows:
        return
    cells = [
        (
            row["name"],
            number(row["value"], ".6g"),
            row["unit"],
            number(row["low"], "g"),
            number(row["high"], "g"),
            _judged(row),
        )
        for row in rows
    ]
    console.table(("measurement", "value", "unit", "low", "high", "judged"), cells)


def number(value: float | None, digits: str) -> str:
    """Return a number as it is printed, - where there is none."""
    return "-" if value is None else format(value, digits)


def _judged(row: Mapping[str, Any]) -> str:
    if row["low"] is None and row["high"] is None:
        return "no limits"  # older records say passed there
    return "inside" if row["passed"] else "outside"
