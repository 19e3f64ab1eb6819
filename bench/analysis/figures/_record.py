"""What a standard-test run holds of one gyro, interval by interval."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from bench.record.events.run import BEFOREHAND, Answer, Interval
from bench.record.recording import Run, row_means, seconds
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS
from drivers.base.errors import ConfigurationError, RecordError

MOST_SAMPLES = 1 << 25
"""Samples of a noise record beyond which neighbours are averaged: 9 h at 1 kHz, 0.3 GB."""
_FEWEST = 3
_MOST_EMPTY = 0.01
_EDGE_S = 2.0
"""Time that a slow stream may leave at the ends of an interval."""


class Measured(Protocol):
    """What the figures are made of: intervals of measurement, and what gyro and table did in them."""

    @property
    def latitude_deg(self) -> float:
        """Latitude of the bench."""

    def intervals(self, test: str) -> list[Interval]:
        """Return the intervals of a test, none if it was left out."""

    def needed(self, test: str) -> list[Interval]:
        """Return the same; ConfigurationError if there are none."""

    def output_dph(self, interval: Interval) -> Array:
        """Return the valid samples of an interval, deg/h."""

    def mean_dps(self, interval: Interval) -> float:
        """Return the mean output, deg/s."""

    def temp_c(self, interval: Interval) -> float:
        """Return the mean of the unit's own temperature."""

    def seconds_dph(self, interval: Interval) -> Array:
        """Return means over whole seconds, deg/h."""

    def samples_dph(self, interval: Interval) -> tuple[Array, float]:
        """Return the samples at equal distances, deg/h, and their rate in Hz."""

    def true_rate_dps(self, interval: Interval) -> float:
        """Return the mean table rate by its encoder."""

    def azimuth_deg(self, interval: Interval) -> float:
        """Return where the horizontal axis points, from north on the table's scale."""


@dataclass(frozen=True)
class Record:
    """The intervals of a run and what the gyro and the table did in them."""

    run: Run
    gyro: str
    axis_angle_error_deg: float

    @property
    def latitude_deg(self) -> float:
        return self.run.manifest.latitude_deg

    def intervals(self, test: str) -> list[Interval]:
        """Return the intervals of a test; without those at a turn in the fixture that nobody made."""
        answers = [answer for _, answer in self.run.of(Answer) if answer.by == BEFOREHAND]
        not_made = {answer.details.get("roll_deg") for answer in answers} - {None}
        of_test = [interval for _, interval in self.run.of(Interval) if interval.test == test]
        return [interval for interval in of_test if interval.roll_deg not in not_made]

    def needed(self, test: str) -> list[Interval]:
        if intervals := self.intervals(test):
            return intervals
        manifest = self.run.manifest
        raise ConfigurationError(
            f"the run has no interval of {test.replace('_', ' ')}",
            where=f"run {manifest.run_id}",
            found=manifest.outcome,
            remedy=manifest.reason or "the test was left out of the run",
        )

    def output_dph(self, interval: Interval) -> Array:
        """Valid samples of an interval, deg/h; RecordError if they do not reach from its begin to its end."""
        table = self._table(interval, ("time_ns", "rate_dps", "valid"))
        valid = table["valid"].astype(np.bool_)
        time_s = seconds(table)[valid]
        length_s = interval.end_s - interval.start_s
        silent_s = length_s
        if len(time_s):
            silent_s = float(max(time_s[0] - interval.start_s, interval.end_s - time_s[-1]))
        if silent_s > _MOST_EMPTY * length_s + _EDGE_S:
            raise RecordError(
                "the unit was silent where it was to be measured",
                where=f"{interval.test}, {self.gyro}",
                found=f"nothing valid for {silent_s:.1f} s of {length_s:.1f} s, from {interval.start_s:.1f} s on",
                expected="samples from the begin of the interval to its end",
            )
        return np.asarray(3600.0 * table["rate_dps"][valid].astype(np.float64))

    def mean_dps(self, interval: Interval) -> float:
        return float(self.output_dph(interval).mean() / 3600.0)

    def temp_c(self, interval: Interval) -> float:
        values = self._table(interval, ("temp_c",))["temp_c"].astype(np.float64)
        if not np.isfinite(values).any():
            raise ConfigurationError(
                "the unit sends no temperature",
                where=f"{interval.test}, {self.gyro}",
                expected="a stream with the unit's temperature",
                remedy="choose a message that carries it",
            )
        return float(np.nanmean(values))

    def seconds_dph(self, interval: Interval) -> Array:
        """Means over whole seconds, the few empty ones interpolated."""
        table = self._table(interval, ("time_ns", "rate_dps", "valid"))
        row = np.floor(seconds(table) - interval.start_s).astype(np.int64)
        count = math.floor(interval.end_s - interval.start_s)
        rates = DPH_PER_DPS * table["rate_dps"].astype(np.float64)
        means = row_means(rates, row, count, table["valid"].astype(np.bool_))
        return _whole(means, f"{interval.test}, {self.gyro}", "seconds")

    def samples_dph(self, interval: Interval) -> tuple[Array, float]:
        """Samples at their own rate, the few missing ones interpolated; of more than `MOST_SAMPLES` means."""
        table = self._table(interval, ("time_ns", "rate_dps", "valid"))
        time_s = seconds(table)
        if len(time_s) < _FEWEST:
            return self.seconds_dph(interval), 1.0
        spacing_s = float(np.median(np.diff(time_s)))
        # Times of arrival jitter; the rate over the whole record, less what is lost, does not.
        lost = np.rint(np.diff(time_s) / spacing_s) - 1.0
        count = len(time_s) + int(np.maximum(lost, 0.0).sum())
        rate_hz = (count - 1) / float(time_s[-1] - time_s[0])
        row = np.clip(np.rint((time_s - time_s[0]) * rate_hz).astype(np.int64), 0, count - 1)
        together = -(-count // MOST_SAMPLES)
        rates = DPH_PER_DPS * table["rate_dps"].astype(np.float64)
        means = row_means(rates, row // together, count // together, table["valid"].astype(np.bool_))
        return _whole(means, f"{interval.test}, {self.gyro}", "samples"), rate_hz / together

    def true_rate_dps(self, interval: Interval) -> float:
        """Mean table rate by its encoder: angle turned over time."""
        table = self.run.turntable(("time_ns", "angle_deg", "rate_dps"), interval.start_s, interval.end_s)
        time_s = seconds(table)
        if len(time_s) < 2:
            return interval.rate_dps or 0.0
        # Between telegrams the table turns by rate * time; the encoder tells the rest of the turn.
        step_s = np.diff(time_s)
        expected = 0.5 * (table["rate_dps"][1:] + table["rate_dps"][:-1]) * step_s
        error = (np.diff(table["angle_deg"]) - expected + 180.0) % 360.0 - 180.0
        return float((expected + error).sum() / step_s.sum())

    def azimuth_deg(self, interval: Interval) -> float:
        """Mean of the table's angle and the axis' azimuth on it."""
        angle = self.run.turntable(("angle_deg",), interval.start_s, interval.end_s)["angle_deg"]
        mean = np.exp(1j * np.radians(angle + self.axis_angle_error_deg)).mean()
        return math.degrees(math.atan2(mean.imag, mean.real))

    def _table(self, interval: Interval, columns: Sequence[str]) -> dict[str, NDArray[Any]]:
        return self.run.gyro(self.gyro, columns, interval.start_s, interval.end_s)


def _whole(means: Array, where: str, what: str) -> Array:
    """Return means with the few empty ones interpolated; RecordError for more than 1 %."""
    empty = np.isnan(means)
    if empty.mean() > _MOST_EMPTY:
        raise RecordError(
            "the record has gaps",
            where=where,
            found=f"{int(empty.sum())} of {len(means)} {what} without a valid sample",
            expected="fewer than 1 %",
        )
    known = np.flatnonzero(~empty)
    return np.asarray(np.interp(np.arange(len(means)), known, means[known]))
