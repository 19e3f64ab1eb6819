"""Figures over time: a straight line through a unit's values, and the difference of two units, with intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

_LEVEL = 0.95
_ROUNDING = 1e-12
_DAY_S = 86_400.0
MONTH_S = 30.4375 * _DAY_S


@dataclass(frozen=True)
class Interval:
    """A value with the ends of its 95 % interval; None where it has none."""

    value: float
    low: float | None = None
    high: float | None = None

    @property
    def apart(self) -> bool | None:
        """Whether the interval leaves zero out; None without one."""
        if self.low is None or self.high is None:
            return None
        return self.low > 0.0 or self.high < 0.0


def slope(time_s: Sequence[float], values: Sequence[float]) -> Interval | None:
    """Return the slope of a straight line by least squares, per month; None for fewer than 3 times.

    The interval is Student's t on n - 2 degrees of freedom, from the scatter about the line.
    """
    x, y = np.asarray(time_s, dtype=np.float64) / MONTH_S, np.asarray(values, dtype=np.float64)
    x = x - x.mean() if len(x) else x
    spread = float(x @ x)
    if len(x) < 3 or spread == 0.0:
        return None
    found = float(x @ (y - y.mean())) / spread
    left = y - y.mean() - found * x
    freedom = len(x) - 2
    half = _student(freedom) * math.sqrt(float(left @ left) / freedom / spread)
    return Interval(found, found - half, found + half)


def difference(one: Interval, other: Interval) -> Interval:
    """Return other less one; independent errors, the ends of the intervals added in squares (MOVER).

    Source: Zou and Donner, Statistics in Medicine 27 (2008) 1693.
    """
    found = other.value - one.value
    if one.low is None or one.high is None or other.low is None or other.high is None:
        return Interval(found)
    return Interval(
        found,
        found - math.hypot(other.value - other.low, one.high - one.value),
        found + math.hypot(other.high - other.value, one.value - one.low),
    )


def mean_difference(one: Sequence[float], other: Sequence[float]) -> Interval | None:
    """Return the difference of the means, other less one, by Welch's t; None with fewer than 2 values of either.

    What varies between runs of one unit is in the interval, which a single run cannot know.
    """
    if min(len(one), len(other)) < 2:
        return None
    parts = [float(np.var(values, ddof=1)) / len(values) for values in (one, other)]
    found = float(np.mean(other) - np.mean(one))
    total = sum(parts)
    size = max(abs(value) for values in (one, other) for value in values)
    if total <= (_ROUNDING * size) ** 2:  # values that are equal but for the last bit
        return Interval(0.0 if abs(found) <= _ROUNDING * size else found)
    below = sum(part**2 / (len(values) - 1) for part, values in zip(parts, (one, other), strict=True))
    half = _student(total**2 / below) * math.sqrt(total)
    return Interval(found, found - half, found + half)


def _student(freedom: float) -> float:
    from scipy.special import stdtrit  # slow to import: only who looks at trends waits for it

    return float(stdtrit(freedom, 0.5 + 0.5 * _LEVEL))


def trends(points: Sequence[Mapping[str, Any]], units: Sequence[str]) -> list[dict[str, Any]]:
    """Return every figure of `units` as its page shows it: points by time, a slope each, and how units compare.

    `points`: {"unit", "figure", "of", "value", "low", "high", "least", "most", "time_s", "run"}.
    """
    by_figure: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for point in sorted(points, key=lambda point: float(point["time_s"])):
        by_figure.setdefault((point["figure"], point["of"]), []).append(point)
    return [_trend(name, of, found, units) for (name, of), found in sorted(by_figure.items())]


def _trend(name: str, of: str, points: Sequence[Mapping[str, Any]], units: Sequence[str]) -> dict[str, Any]:
    rows = []
    series = {unit: [point for point in points if point["unit"] == unit] for unit in units}
    for unit, own in series.items():
        line = slope([point["time_s"] for point in own], [point["value"] for point in own])
        rows.append({"unit": unit, "points": own, "slope": None if line is None else vars(line)})
    compared = None
    if len(units) == 2 and all(series.values()):
        first, second = (
            Interval(own[-1]["value"], own[-1]["low"], own[-1]["high"]) for own in series.values()
        )
        means = mean_difference(*([point["value"] for point in own] for own in series.values()))
        newest = difference(first, second)
        compared = {
            "newest": vars(newest) | {"apart": newest.apart},
            "means": None if means is None else vars(means) | {"apart": means.apart},
        }
    return {"figure": name, "of": of, "units": rows, "compared": compared}
