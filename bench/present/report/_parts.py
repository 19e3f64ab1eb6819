"""Parts that several reports have word for word: warnings, colophon, rows of figures, before and after."""

from __future__ import annotations

import math
from collections.abc import Sequence

from bench.present.report._figures import Curve, Lane
from bench.present.report._numbers import DASH, moment, significant
from bench.present.report._page import Key, Notes, Section
from bench.present.report._palette import AFTER, BEFORE
from drivers.base.arrays import Array

BEFORE_AFTER = (Key("before", BEFORE), Key("after", AFTER))
"""The legend of `before_after`."""
OF_RUNS = "Figures are computed from the runs' records; times are UTC."


def warnings(texts: Sequence[str]) -> Section:
    """Return the section of warnings, each text once; it is not printed when there are none."""
    return Section("Warnings", [Notes(list(dict.fromkeys(texts)), "doubt")])


def made(created_utc: str, remark: str = "") -> str:
    """Return the last line of a report: when it was made, and `remark`."""
    return f"Report made {moment(created_utc)}. {remark}".strip() if created_utc else remark


def before_after(
    label: str, x: Array, before: Array, after: Array, *, height: float = 130.0, of: str = ""
) -> Lane:
    """Return a lane with a quantity before and after compensation; `of` names what it is about."""
    label_before = f"{of} before".strip()
    return Lane(label, [Curve(label_before, x, before, BEFORE), Curve("after", x, after, AFTER)], height)


def stated(value: float | None, bound: float | None, digits: int = 3) -> str:
    """Return a figure as it is stated: its value, or what it is at most where the record does not show it."""
    if bound is None:
        return significant(value, digits)
    return f"not seen above {significant(bound, 2)}" if math.isfinite(bound) else "not seen, no bound known"


def interval(low: float | None, high: float | None, digits: int = 3) -> str:
    """Return the interval that holds a value of so many digits; an upper end that is not known is infinite."""
    digits = max(3, digits)
    if low is None or high is None:
        return DASH
    return f"{significant(low, digits)} … {significant(high, digits) if math.isfinite(high) else '∞'}"
