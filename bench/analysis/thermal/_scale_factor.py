"""Scale factor and zero-rate bias at every second from runs of one profile at several constant rates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from bench.analysis.common.statistics import hold
from bench.analysis.thermal._features import centred_mean, trailing_mean, window_mean
from bench.analysis.thermal._types import ThermalRun
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError, LimitExceeded

_SMOOTH_S = 100


@dataclass(frozen=True, kw_only=True)
class RateRun(ThermalRun):
    """One temperature run at a constant table rate: what the gyro put out, before it is worked into a target.

    `rate_dps` is the table's rate without Earth rate, which all runs of a group share and which cancels.
    """

    bias_dph: None = None
    sf_error_ppm: None = None
    rate_dps: float
    output_dps: Array


def rate_weights(rates_dps: ArrayLike) -> Array:
    """Return the weights w, shape (m,), that make K = sum(w_i F_i) the least-squares slope of F over the rates.

    For +W, -W, 0 they are (1, -1, 0) / 2W: the zero run never enters. ConfigurationError unless two rates differ.
    """
    rates = np.asarray(rates_dps, dtype=np.float64)
    centred = rates - rates.mean()
    power = float(centred @ centred)
    if power <= 0.0:
        raise ConfigurationError(
            "a scale factor needs at least two different rates",
            where="scale-factor group",
            found=f"rates {rates.tolist()} deg/s",
            expected="for instance +20, -20 and 0 deg/s",
            remedy="add the missing rate runs to the group",
        )
    return np.asarray(centred / power)


def scale_factor_group(
    runs: Sequence[RateRun], *, align: bool = True, max_shift_s: int = 600, max_spread_c: float = 1.0
) -> ThermalRun:
    """Combine rate runs of one profile and one unit into a run of scale-factor error (ppm of its reference mean).

    With `align` the runs are shifted onto the first by their case temperature. ConfigurationError for fewer than
    two rates, LimitExceeded when T_in differs by more than `max_spread_c` at equal time: the least
    squares would then mix different thermal states.
    """
    rates = [run.rate_dps for run in runs]
    weights = rate_weights(rates)
    first = runs[0]
    shifts = tuple(
        find_shift(first.case_temp_c, run.case_temp_c, max_shift_s=max_shift_s) if align else 0
        for run in runs
    )
    moved = zip(runs, shifts, strict=True)
    count = min(len(run.time_s) - max(shift, 0) for run, shift in moved)
    start = max(0, *(-shift for shift in shifts))

    def stacked(name: str) -> Array:
        pairs = zip(runs, shifts, strict=True)
        return np.array([shifted(getattr(run, name), shift, count)[start:] for run, shift in pairs])

    time_s = first.time_s[start:count]
    outputs, inner = stacked("output_dps"), stacked("gyro_temp_c")
    where = f"scale-factor group of {', '.join(run.run_id for run in runs)}"
    smooth = np.array([trailing_mean(row, _SMOOTH_S) for row in inner])
    difference = smooth.max(axis=0) - smooth.min(axis=0)
    spread = float(np.nanmax(difference)) if np.isfinite(difference).any() else float("inf")
    if spread > max_spread_c:
        raise LimitExceeded(
            "the gyro temperature differs between the runs of the group",
            where=where,
            found=f"{spread:.2f} degC at equal time, shifts {list(shifts)} s",
            expected=f"at most {max_spread_c:g} degC",
            remedy="repeat the run that departs, or align the runs",
        )
    scale_factor = weights @ outputs
    level = window_mean(time_s, scale_factor, first.reference, where=where)
    truths = [run.true_sf_error_ppm for run in runs]
    truth = None
    if all(values is not None for values in truths):
        truth = np.asarray((weights * np.asarray(rates)) @ stacked("true_sf_error_ppm"))
    return ThermalRun(
        run_id="+".join(run.run_id for run in runs),
        unit_id=first.unit_id,
        time_s=time_s,
        gyro_temp_c=inner.mean(axis=0),
        case_temp_c=stacked("case_temp_c").mean(axis=0),
        bias_dph=None,
        sf_error_ppm=(scale_factor / level - 1.0) * 1e6,
        reference=first.reference,
        checksum="+".join(run.checksum for run in runs if run.checksum),
        phases=first.phases,
        true_sf_error_ppm=truth,
        remarks=tuple(f"at {run.rate_dps:g} deg/s {text}" for run in runs for text in run.remarks),
        meta={"rates_dps": rates, "shifts_s": list(shifts), "temp_spread_c": spread},
    )


def find_shift(reference_c: Array, other_c: Array, *, max_shift_s: int = 600, smooth_s: int = 30) -> int:
    """Return by how many seconds `other_c` lags `reference_c` (negative: leads), both 1 s series of any length.

    The shift of the largest cross-correlation of the slopes d(T_out)/dt of `smooth_s` means, within
    +-`max_shift_s`: the ramps of a temperature shock are sharp in the slope, plateaus do not count.
    """
    slopes = [np.gradient(centred_mean(hold(series), smooth_s)) for series in (reference_c, other_c)]
    length = sum(map(len, slopes))
    spectrum = np.conj(np.fft.rfft(slopes[0], length)) * np.fft.rfft(slopes[1], length)
    correlation = np.fft.irfft(spectrum, length)
    shifts = np.arange(-max_shift_s, max_shift_s + 1)
    shifts = shifts[(shifts > -len(slopes[0])) & (shifts < len(slopes[1]))]
    return int(shifts[np.argmax(correlation[shifts])])


def shifted(values: Array, shift_s: int, count: int) -> Array:
    """Return `values` moved earlier by `shift_s` samples, `count` of them; NaN where there are none."""
    index = np.arange(count) + shift_s
    inside = (index >= 0) & (index < len(values))
    result = np.full(count, np.nan)
    result[inside] = values[index[inside]]
    return result
