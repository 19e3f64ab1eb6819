"""Noise of the gyros while a run goes on: the Allan deviation of the last hour, from the live files."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench.analysis.common.allan import AllanDeviation, allan_deviation
from bench.present.panel._tails import history_between
from bench.present.panel._values import table_of
from drivers.base.arrays import Array
from drivers.base.clock import host_seconds
from drivers.base.errors import BenchError

_HOUR_S = 3600.0
_EVERY_S = 10.0
"""Host time between two readings, whoever looks and however often."""
_LEAST = 30
"""Means that a curve begins with."""
_STILL_DPS = 0.02
_GAP = 3.5
_MOST = 7200


class Noise:
    """Follows the rows of a run's history; `curves` are those of the last reading."""

    def __init__(self, run: Path) -> None:
        self.curves: list[dict[str, Any]] = []
        self._run = run
        self._next_at = -math.inf
        self._rows: list[dict[str, Any]] = []

    def update(self, time_s: float) -> None:
        """Work it out anew if that is due and rows have come; `time_s`: bench time now."""
        if host_seconds() < self._next_at:
            return
        self._next_at = host_seconds() + _EVERY_S
        start_s = time_s - _HOUR_S
        newest_s = float(self._rows[-1]["time_s"]) if self._rows else -math.inf
        if newest_s > time_s:  # another run in the same folder
            self._rows, newest_s = [], -math.inf
        come = [
            {name: row.get(name) for name in ("time_s", "rate_dps", "gyros")}
            for row in history_between(self._run, max(start_s, newest_s), time_s)
            if row["time_s"] > newest_s
        ]
        if not come:
            return
        self._rows = [row for row in self._rows if row["time_s"] >= start_s] + come
        del self._rows[:-_MOST]
        names = sorted({name for row in self._rows for name in table_of(row.get("gyros"))})
        self.curves = [curve for name in names if (curve := noise_curve(name, self._rows)) is not None]


def noise_curve(gyro: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any] | None:
    """Return a gyro's Allan deviation with its 95 % interval in deg/h, None where the record is too short.

    Taken is the last stretch in which the table stood still and no row is missing: {"gyro", "record_s",
    "tau_s", "deviation", "low", "high"}. Every row has the mean of all samples since the row before; their
    integral at equal steps, as long as the longest of the rows, is what the deviation is made of.
    """
    time_s, means = _last_stretch(gyro, rows)
    if len(time_s) < _LEAST:
        return None
    step_s = float(np.max(np.diff(time_s)))
    angle_deg = np.concatenate(([0.0], np.cumsum(means[1:] * np.diff(time_s))))
    count = int((time_s[-1] - time_s[0]) / step_s + 1e-6)
    grid_s = time_s[0] + step_s * np.arange(count + 1)
    rates = np.diff(np.interp(grid_s, time_s, angle_deg)) / step_s
    try:
        allan = allan_deviation(rates, 1.0 / step_s)
    except BenchError:
        return None
    low, high = _interval(allan)
    dph = 3600.0
    shown = {"tau_s": allan.tau_s, "deviation": dph * allan.deviation, "low": dph * low, "high": dph * high}
    if not all(np.isfinite(values).all() and (values > 0.0).all() for values in shown.values()):
        return None
    numbers = {name: [float(f"{value:.5g}") for value in values] for name, values in shown.items()}
    return {"gyro": gyro, "record_s": round(float(time_s[-1] - time_s[0]), 1)} | numbers


def _interval(allan: AllanDeviation) -> tuple[Array, Array]:
    from bench.analysis.common.allan_confidence import confidence_interval  # scipy is slow to import

    return confidence_interval(allan)


def _last_stretch(gyro: str, rows: Sequence[Mapping[str, Any]]) -> tuple[Array, Array]:
    """Return times and means of the last rows without a gap, the table at rest."""
    kept: list[tuple[float, float]] = []
    for row in reversed(rows):
        values, rate_dps = table_of(row.get("gyros")).get(gyro), row.get("rate_dps")
        mean = values[2] if isinstance(values, list) and len(values) > 2 else None
        if not isinstance(mean, int | float) or not math.isfinite(mean):
            break
        if not isinstance(rate_dps, int | float) or abs(rate_dps) > _STILL_DPS:
            break  # what turns the gyro is no noise of it
        kept.append((float(row["time_s"]), float(mean)))
    if len(kept) < _LEAST:
        return np.empty(0), np.empty(0)
    time_s, means = np.array(kept[::-1]).T
    steps_s = np.diff(time_s)
    gaps = np.flatnonzero((steps_s > _GAP * np.median(steps_s)) | (steps_s <= 0.0))
    first = int(gaps[-1]) + 1 if len(gaps) else 0
    return time_s[first:], means[first:]
