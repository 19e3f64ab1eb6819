"""A gyro's record as the fits take it: a value for every second, without single ones that stand far off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.outliers import RARE, outliers
from bench.record.recording import Run, row_means
from drivers.base.arrays import Array
from drivers.base.constants import DPH_PER_DPS

_SLOW_S = 1.05
"""Time between rows from which on seconds without one are usual."""


@dataclass(frozen=True)
class GyroSeconds:
    """Output and temperature of a gyro in whole seconds, (n,) each, NaN without a value; what was left out."""

    rate_dps: Array
    temp_c: Array
    remarks: tuple[str, ...]
    period_s: float

    def of(self, values: NDArray[Any], second: NDArray[np.int64]) -> Array:
        """Return another column (m,) of the gyro's samples as these are, by the second of each sample (m,)."""
        return since_last(row_means(values, second, len(self.rate_dps)), self.period_s)


def gyro_seconds(run: Run, gyro: str, start_s: int, end_s: int) -> GyroSeconds:
    """Return 1 s means of a gyro, (end_s - start_s,): row k is of start_s + k < time <= start_s + k + 1.

    Of a log with seconds between its rows a row is of all that passed since the one before. Single values of
    the output that stand far off those about them (a lost bit, a shock) are NaN, and said.
    """
    means = run.second_means(gyro, start_s, end_s)
    far, sizes = outliers(means.rate_dps, most=RARE)
    remarks = []
    rate_dps = means.rate_dps
    if len(far):
        rate_dps = rate_dps.copy()
        rate_dps[far] = np.nan
        most = sizes[np.abs(sizes).argmax()] * DPH_PER_DPS
        remarks.append(
            f"{len(far)} of {len(rate_dps)} s left out: the output stands up to {most:+.3g} deg/h off the "
            f"seconds about it, first at {start_s + far[0] + 1} s"
        )
    period_s = _period_s(run, gyro)
    return GyroSeconds(
        since_last(rate_dps, period_s), since_last(means.temp_c, period_s), tuple(remarks), period_s
    )


def since_last(values: Array, period_s: float) -> Array:
    """Return 1 s values, (n,), of rows `period_s` apart: each second since the last row is the next one's."""
    if period_s <= _SLOW_S:
        return values
    at = np.arange(len(values))
    last = max(len(values) - 1, 0)
    following = np.minimum.accumulate(np.where(np.isfinite(values), at, 2 * last + 1)[::-1])[::-1]
    return np.where(following - at < period_s, values[np.minimum(following, last)], np.nan)


def _period_s(run: Run, gyro: str) -> float:
    rate_hz = run.manifest.stream.get(gyro, {}).get("sample_rate_hz")
    return 1.0 / rate_hz if rate_hz else 0.0
