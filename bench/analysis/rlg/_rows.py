"""A ramp run as rows: 100 s means of bias and of two temperatures, and the temperatures' rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.statistics import stretches
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

ROW_S = 100
_STALL_SHARE = 0.2
_STALL_S = 900.0


@dataclass(frozen=True)
class RampRun:
    """One run of one unit, arrays of shape (n,) with a row for each 100 s in which everything was measured.

    `case_c` (T1) and `block_c` (T2) in degC, `case_rate`, `block_rate` in degC/min, `bias_dph` the output less
    the Earth rate. `segment` labels rows without a gap between them. `remarks` say what was left out or looks
    wrong, and why. `true_bias_dph` exists on emulated runs and is never fitted to.
    """

    run_id: str
    unit_id: str
    time_s: Array
    case_c: Array
    block_c: Array
    case_rate: Array
    block_rate: Array
    bias_dph: Array
    segment: NDArray[np.int64]
    remarks: tuple[str, ...] = ()
    true_bias_dph: Array | None = None
    checksum: str = ""
    kind: str = ""

    def part(self, use: NDArray[np.bool_]) -> RampRun:
        """Return the rows that `use`, (n,), names; what is on both sides of a gap is no neighbour."""
        number, segment, truth = np.flatnonzero(use), self.segment[use], self.true_bias_dph
        gaps = (np.diff(number, prepend=number[0]) > 1) | (np.diff(segment, prepend=segment[0]) > 0)
        columns = {name: getattr(self, name)[use] for name in _COLUMNS}
        return replace(
            self, **columns, segment=np.cumsum(gaps), true_bias_dph=None if truth is None else truth[use]
        )


_COLUMNS = ("time_s", "case_c", "block_c", "case_rate", "block_rate", "bias_dph")


def ramp_run(
    run_id: str,
    unit_id: str,
    time_s: Array,
    case_c: Array,
    block_c: Array,
    bias_dph: Array,
    *,
    true_bias_dph: Array | None = None,
    ramps: Sequence[tuple[float, float]] = (),
    checksum: str = "",
    kind: str = "",
) -> RampRun:
    """Make rows of 1 s series, shape (n,) each, NaN where a second has no data.

    A rate is the least-squares slope over the row. Rows with more than half of any series missing are left out.
    `ramps` are (start, end) in s at which the chamber was to move; where the case stood still instead, a remark
    says so. ConfigurationError for series that give fewer than three rows.
    """
    count = len(time_s) // ROW_S
    blocks = {
        name: series[: count * ROW_S].reshape(count, ROW_S)
        for name, series in (("bias", bias_dph), ("case (T1)", case_c), ("block (T2)", block_c))
    }
    remarks = []
    whole = np.ones(count, dtype=np.bool_)
    for name, block in blocks.items():
        missing = ~(np.isfinite(block).sum(axis=1) > ROW_S // 2)
        if missing.any():
            remarks.append(f"{int(missing.sum())} of {count} rows left out: {name} is missing in them")
        whole &= ~missing
    if whole.sum() < 3:
        raise ConfigurationError(
            "the run has hardly any rows",
            where=f"run {run_id}",
            found=f"{int(whole.sum())} of {ROW_S} s with bias and both temperatures",
            expected="at least 3, a ramp gives hundreds",
            remedy="; ".join(remarks) or "record longer",
        )
    centre_s = time_s[: count * ROW_S].reshape(count, ROW_S).mean(axis=1)
    rows = {name: np.nanmean(block[whole], axis=1) for name, block in blocks.items()}
    rates = {name: _slope_per_min(block[whole]) for name, block in blocks.items()}
    remarks += _stalls(centre_s[whole], rates["case (T1)"], ramps)
    truth = None
    if true_bias_dph is not None:
        truth = true_bias_dph[: count * ROW_S].reshape(count, ROW_S).mean(axis=1)[whole]
    number = np.flatnonzero(whole)
    return RampRun(
        run_id=run_id,
        unit_id=unit_id,
        time_s=centre_s[whole],
        case_c=rows["case (T1)"],
        block_c=rows["block (T2)"],
        case_rate=rates["case (T1)"],
        block_rate=rates["block (T2)"],
        bias_dph=rows["bias"],
        segment=np.cumsum(np.diff(number, prepend=number[0]) > 1),
        remarks=tuple(remarks),
        true_bias_dph=truth,
        checksum=checksum,
        kind=kind,
    )


def _slope_per_min(block: Array) -> Array:
    """Least-squares slope of each row of 1 s values, per minute, missing values left out."""
    use = np.isfinite(block)
    number = use.sum(axis=1, keepdims=True)
    time = np.where(use, np.arange(block.shape[1], dtype=np.float64), 0.0)
    time = np.where(use, time - time.sum(axis=1, keepdims=True) / number, 0.0)
    values = np.where(use, block, 0.0)
    return np.asarray(60.0 * (time * values).sum(axis=1) / (time**2).sum(axis=1))


def _stalls(time_s: Array, case_rate: Array, ramps: Sequence[tuple[float, float]]) -> list[str]:
    """Return a remark for every ramp during which the case stood still for a quarter of an hour or more."""
    remarks = []
    for start_s, end_s in ramps:
        inside = (time_s >= start_s) & (time_s <= end_s)
        if inside.sum() < 3:
            continue
        usual = float(np.median(np.abs(case_rate[inside])))
        still = inside & (np.abs(case_rate) < _STALL_SHARE * usual)
        still &= time_s > start_s + _STALL_S  # the case follows the air with a lag
        for first, last in stretches(still):
            length_s = (last - first) * float(ROW_S)
            if length_s >= _STALL_S:
                remarks.append(
                    f"the ramp stalled from {time_s[first]:.0f} s for {length_s / 60.0:.0f} min: these rows are "
                    "kept, their rate is that of a dwell"
                )
    return remarks
