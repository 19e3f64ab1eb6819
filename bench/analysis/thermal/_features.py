"""From a run of 1 s means to model inputs and targets on a coarser grid: 100 s means, rate, gradient."""

from __future__ import annotations

import numpy as np

from bench.analysis.common.statistics import hold
from bench.analysis.thermal._types import FeatureRun, ThermalRun
from drivers.base.arrays import Array
from drivers.base.errors import RecordError

STEP_S = 10
"""Step of models, unless a compensation has another."""
WINDOW_S = 100
CHANGE_S = 60
"""The rate of change is in degC/min because this is a minute."""


def trailing_mean(values: Array, count: int) -> Array:
    """Mean of each sample and the `count` - 1 before it, shape (n,); NaN is left out, all-NaN gives NaN.

    At the start the window is what there is. A ramp comes out (count - 1) / 2 samples late.
    """
    return _window_mean(values, count - 1, 0, 1)


def centred_mean(values: Array, count: int) -> Array:
    """Mean over `count` samples around each sample, shape (n,); NaN where fewer than half of the window is there.

    The window reaches count // 2 samples back, so for an even `count` a ramp comes out half a sample late. At
    the ends the window is what there is.
    """
    before = count // 2
    return _window_mean(values, before, count - 1 - before, (count + 1) // 2)


def _window_mean(values: Array, before: int, after: int, least: int) -> Array:
    finite = np.isfinite(values)
    whole = bool(finite.all())
    # Counted from the first value the running sum stays small, so differences keep digits.
    origin = float(values[np.argmax(finite)]) if finite.any() else 0.0
    summed = values - origin if whole else np.where(finite, values - origin, 0.0)
    window = _window_sum(np.ones(len(values)), before, after)
    count = window if whole else _window_sum(finite.astype(np.float64), before, after)
    mean = origin + _window_sum(summed, before, after) / np.maximum(count, 1.0)
    if whole:
        return np.asarray(mean)
    return np.where((count > 0) & (count >= np.minimum(least, (window + 1) // 2)), mean, np.nan)


def _window_sum(values: Array, before: int, after: int) -> Array:
    """Sum of each value, `before` before and `after` after it, as far as there are so many; shape (n,)."""
    total = np.zeros(before + len(values) + after + 1)
    np.cumsum(values, out=total[before + 1 : before + 1 + len(values)])
    total[before + 1 + len(values) :] = total[before + len(values)]
    return np.asarray(total[before + 1 + after :] - total[: len(values)])


def change_per_minute(temp_c: Array) -> Array:
    """Change of a 1 s series over the last minute in degC/min, shape (n,).

    Before the start the first finite value is taken to have held, as a model's warm-up does.
    """
    finite = np.flatnonzero(np.isfinite(temp_c))
    if not len(finite):
        return np.full_like(temp_c, np.nan)
    earlier = np.concatenate((np.full(CHANGE_S, temp_c[finite[0]]), temp_c))[: len(temp_c)]
    return np.asarray(temp_c - earlier)


def window_mean(time_s: Array, values: Array, window_s: tuple[float, float], *, where: str = "") -> float:
    """Mean of the finite `values` with window_s[0] <= time < window_s[1]; RecordError when there are none."""
    inside = values[(time_s >= window_s[0]) & (time_s < window_s[1])]
    inside = inside[np.isfinite(inside)]
    if not len(inside):
        raise RecordError(
            "the reference window holds no data",
            where=where,
            found=f"window {window_s[0]:g}..{window_s[1]:g} s, data {time_s[0]:g}..{time_s[-1]:g} s",
            expected="the equilibrium at room temperature before the shock",
            remedy="check the run's phases; a run without its reference cannot be used",
        )
    return float(np.mean(inside))


def prepare(run: ThermalRun, *, step_s: int = STEP_S) -> FeatureRun:
    """Return `run` as model inputs and targets on a grid of `step_s` seconds, starting at the run's first second.

    Inputs are causal: means over the last `WINDOW_S`, rate over the last `CHANGE_S` and then the same mean;
    through a gap longer than the window they hold their last value. Targets are centred means (a trailing one
    would make every model 49.5 s late) less their mean over the reference window. `weight` is 0 before the
    reference window, where the unit is not in equilibrium yet, and where a target is missing (its value is then
    0). Raises RecordError for a run that is not on a 1 s grid, or has no temperature or no reference.
    """
    where = f"run {run.run_id}"
    _check_grid(run.time_s, where)
    smooth_in = hold(trailing_mean(_temperature(run.gyro_temp_c, "gyro", where), WINDOW_S))
    smooth_out = hold(trailing_mean(_temperature(run.case_temp_c, "case", where), WINDOW_S))
    change = hold(trailing_mean(change_per_minute(run.gyro_temp_c), WINDOW_S))
    usable = run.time_s >= run.reference[0]
    targets: list[Array | None] = []
    for values in (run.bias_dph, run.sf_error_ppm):
        if values is None:
            targets.append(None)
            continue
        target = centred_mean(values, WINDOW_S) - window_mean(run.time_s, values, run.reference, where=where)
        usable = usable & np.isfinite(target)
        targets.append(np.nan_to_num(target)[::step_s])
    return FeatureRun(
        run_id=run.run_id,
        unit_id=run.unit_id,
        step_s=float(step_s),
        time_s=run.time_s[::step_s],
        t_in=smooth_in[::step_s],
        t_out=smooth_out[::step_s],
        dt_60=change[::step_s],
        gradient=(smooth_in - smooth_out)[::step_s],
        bias_dph=targets[0],
        sf_error_ppm=targets[1],
        weight=usable[::step_s].astype(np.float64),
        reference=run.reference,
        checksum=run.checksum,
    )


def _check_grid(time_s: Array, where: str) -> None:
    steps = np.diff(time_s)
    if len(time_s) < 2 or np.max(np.abs(steps - 1.0)) > 1e-6:
        raise RecordError(
            "the run is not on a 1 s grid",
            where=where,
            found=f"{len(time_s)} samples"
            + (f", steps {steps.min():g}..{steps.max():g} s" if len(steps) else ""),
            expected="1 s means, seconds without data as NaN",
            remedy="resample the recording to 1 s before the fit",
        )


def _temperature(values: Array, sensor: str, where: str) -> Array:
    if not np.isfinite(values).any():
        raise RecordError(
            f"the run has no {sensor} temperature",
            where=where,
            found="no finite value",
            expected="both the gyro's own sensor and one on its case",
            remedy="check the sensor and its assignment in the bench file",
        )
    return values
