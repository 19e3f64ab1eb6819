"""Curves of a recorded run, few enough points to draw: extremes of telemetry, means of what the gyros sent."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bench.present.panel._values import rounded
from bench.record.recording import Run, seconds
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

POINTS = 1200
"""Points a curve at most; a run of a day has one every 72 s, a zoomed stretch has finer ones."""
_AT_ONCE_S = 3600.0
_LEAST_A_STRETCH = 3
_GAP = 4.0
"""Where the next value comes later than so many usual spacings the line ends."""
_DIGITS = 9

Table = Mapping[str, Any]
Read = Callable[[float | None, float | None], Table]


def run_curves(folder: Path, from_s: float | None = None, to_s: float | None = None) -> dict[str, Any]:
    """Return phases and curves of a run, or of a stretch of it; bench time in s. Raises BenchError.

    A curve is (key, lane, name, unit, t, low, high): lists of equal length, None where nothing came. Chamber and
    table: lowest and highest value of each of at most `POINTS` stretches, so that a spike stays. Gyros: the mean
    of the stretch, low and high alike.
    """
    run = Run.open(folder)
    end_s = run.manifest.duration_s or max((line.time_s for line in run.lines), default=0.0)
    low_s, high_s = (0.0 if from_s is None else from_s), (end_s if to_s is None else to_s)
    return {
        "end_s": end_s,
        "phases": [[phase.name, phase.start_s, phase.end_s] for phase in run.phases()],
        "curves": [curve for curve in _curves(run, low_s, high_s) if curve["t"]],
    }


def _curves(run: Run, low_s: float, high_s: float) -> Iterator[dict[str, Any]]:
    if "chamber" in run.tables:
        chamber = run.chamber(None, low_s, high_s)
        time_s = seconds(chamber)
        yield _extremes("air", "Air", "air", "°C", time_s, chamber["air_temp_c"])
        yield _extremes("set", "Air", "set point", "°C", time_s, chamber["set_point_c"])
        for column in sorted(chamber):
            if (number := column.removeprefix("aux_").removesuffix("_temp_c")).isdigit():
                name = run.manifest.bench.get("chamber", {}).get("auxiliary", {}).get(number)
                words = str(name or f"sensor {number}")
                yield _extremes(f"aux.{number}", words, words, "°C", time_s, chamber[column])
    for gyro in run.gyros:
        yield from _gyro(run, gyro, low_s, high_s)
    if "turntable" in run.tables:
        table = run.turntable(None, low_s, high_s)
        yield _extremes("table", "Table rate", "table", "°/s", seconds(table), table["rate_dps"])


def _gyro(run: Run, gyro: str, low_s: float, high_s: float) -> Iterator[dict[str, Any]]:
    """Yield rate and temperature of a gyro; an hour of samples is in memory at a time."""
    rate, temp = _Means(low_s, high_s), _Means(low_s, high_s)
    for start_s in np.arange(low_s, high_s, _AT_ONCE_S):
        columns = ("time_ns", "rate_dps", "temp_c", "valid")
        table = run.gyro(gyro, columns, float(start_s), min(float(start_s) + _AT_ONCE_S, high_s))
        time_s, valid = seconds(table), np.asarray(table["valid"], dtype=bool)
        rate.add(time_s[valid], np.asarray(table["rate_dps"], dtype=np.float64)[valid])
        temp.add(time_s, np.asarray(table["temp_c"], dtype=np.float64))
    yield rate.curve(f"{gyro}.rate", f"{gyro} rate", gyro, "°/s")
    yield temp.curve(f"{gyro}.temp", f"{gyro} inside", f"{gyro} inside", "°C")


class _Means:
    """Means of samples over stretches of equal length, filled piece by piece; few samples stay as they are."""

    def __init__(self, low_s: float, high_s: float) -> None:
        self._low_s = low_s
        self._width_s = max(high_s - low_s, 1e-6) / POINTS
        self._sums, self._counts = np.zeros(POINTS), np.zeros(POINTS)
        self._few: list[tuple[Array, Array]] | None = []

    def add(self, time_s: Array, values: Array) -> None:
        """Take samples in order of time; those that are not finite are none."""
        known = np.isfinite(values)
        time_s, values = time_s[known], values[known]
        stretch = np.clip(((time_s - self._low_s) / self._width_s).astype(np.int64), 0, POINTS - 1)
        self._sums += np.bincount(stretch, values, POINTS)
        self._counts += np.bincount(stretch, minlength=POINTS)
        if self._few is not None:
            self._few.append((time_s, values))
            if self._counts.sum() > _LEAST_A_STRETCH * POINTS:
                self._few = None

    def curve(self, key: str, lane: str, name: str, unit: str) -> dict[str, Any]:
        """Return the means as a curve."""
        if self._few is not None:
            time_s, values = (np.concatenate([np.empty(0), *parts]) for parts in zip(*self._few, strict=True))
            return _extremes(key, lane, name, unit, time_s, values)
        middle_s = self._low_s + (np.arange(POINTS, dtype=np.float64) + 0.5) * self._width_s
        with np.errstate(invalid="ignore"):
            means = self._sums / self._counts
        inside = np.flatnonzero(self._counts)
        kept = slice(inside[0], inside[-1] + 1)
        return _curve(key, lane, name, unit, middle_s[kept], means[kept], means[kept])


def _extremes(key: str, lane: str, name: str, unit: str, time_s: Array, values: Array) -> dict[str, Any]:
    """Return a curve of lowest and highest values, or of the values themselves if there are few."""
    values = np.asarray(values, dtype=np.float64)
    if len(time_s) > POINTS:
        count = min(POINTS, len(time_s) // _LEAST_A_STRETCH)
        edges = np.linspace(time_s[0], time_s[-1], count + 1)
        first = np.searchsorted(time_s, edges[:-1])
        middle_s = 0.5 * (edges[:-1] + edges[1:])
        there = np.diff(np.append(first, len(time_s))) > 0
        first = first[there]
        low, high = np.full(count, np.nan), np.full(count, np.nan)
        low[there] = np.fmin.reduceat(values, first)
        high[there] = np.fmax.reduceat(values, first)
        return _curve(key, lane, name, unit, middle_s, low, high)
    if len(time_s) > 2:
        spacing_s = np.diff(time_s)
        gaps = np.flatnonzero(spacing_s > _GAP * np.median(spacing_s)) + 1
        time_s, values = np.insert(time_s, gaps, time_s[gaps - 1]), np.insert(values, gaps, np.nan)
    return _curve(key, lane, name, unit, time_s, values, values)


def _curve(
    key: str, lane: str, name: str, unit: str, time_s: Array, low: Array, high: Array
) -> dict[str, Any]:
    shown = {
        "t": [round(value, 4) for value in time_s.tolist()],
        "low": [rounded(value, _DIGITS) for value in low.tolist()],
        "high": [rounded(value, _DIGITS) for value in high.tolist()],
    }
    return {"key": key, "lane": lane, "name": name, "unit": unit} | shown


def check_stretch(from_s: float | None, to_s: float | None) -> None:
    """Raise RecordError for a stretch that is none."""
    given = [value for value in (from_s, to_s) if value is not None]
    if not all(math.isfinite(value) for value in given) or (len(given) == 2 and not given[0] < given[1]):
        raise RecordError(
            "this is no stretch of a run", found=f"{from_s} to {to_s} s", expected="from before to"
        )
