"""How good a prediction is on a run: against the raw output, against the noise floor, against the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.statistics import BLOCK_S, Apart, apart, bias_stability, block_means
from bench.analysis.thermal._features import STEP_S, window_mean
from bench.analysis.thermal._regression import TARGETS
from bench.analysis.thermal._types import Prediction, ThermalRun
from drivers.base.arrays import Array


@dataclass(frozen=True)
class Scores:
    """Figures of one model on one run, from the start of the reference window to the end; None = does not apply.

    `raw_stability_dph`, `stability_dph`: 1 sigma (ddof 1) of 100 s block means before and after compensation.
    `improvement_pct` = 100 (1 - after/before). `noise_floor_dph`: what white noise alone would leave, found from
    short-term differences without a model; `attainable_pct`: the improvement if only that were left. With a
    truth: `oracle_stability_dph` and `oracle_pct` for subtracting the true drift, `true_rmse_dph`,
    `true_max_dph` of the prediction's error. Scale factor: rms and largest error of 100 s block means against the
    measurement, and against the truth. `apart`: the bias stability, or the rms of the scale-factor error, inside
    and outside the range of the compensation; None where that was not asked.
    """

    run_id: str
    raw_stability_dph: float | None = None
    stability_dph: float | None = None
    improvement_pct: float | None = None
    noise_floor_dph: float | None = None
    attainable_pct: float | None = None
    oracle_stability_dph: float | None = None
    oracle_pct: float | None = None
    true_rmse_dph: float | None = None
    true_max_dph: float | None = None
    sf_raw_rms_ppm: float | None = None
    sf_rms_ppm: float | None = None
    sf_max_ppm: float | None = None
    sf_true_rms_ppm: float | None = None
    sf_true_max_ppm: float | None = None
    apart: Apart | None = None


def noise_floor(values: Array, *, short_s: int = 10) -> float:
    """Standard deviation that the white noise of 1 s samples leaves in 100 s block means.

    From the second differences of means over `short_s` (a Hadamard variance, blind to a steady drift), carried
    to 100 s by 1/sqrt(time). Noise that averages slower than white is not in it. NaN without data.
    """
    means = block_means(values, short_s)
    second = means[2:] - 2.0 * means[1:-1] + means[:-2]
    second = second[np.isfinite(second)]
    if not len(second):
        return float("nan")
    return float(np.sqrt(np.mean(second**2) / 6.0 * short_s / BLOCK_S))


def evaluate(prediction: Prediction, run: ThermalRun, outside: NDArray[np.bool_] | None = None) -> Scores:
    """Score a prediction for `prepare(run)` on the run of 1 s means.

    It is held over each step, as on the bench, and counted from its mean over the reference window. `outside`:
    the steps whose inputs are out of the compensation's range.
    """
    used = run.time_s >= run.reference[0]

    def from_reference(values: Array) -> Array:
        mean = window_mean(run.time_s, values, run.reference, where=f"run {run.run_id}")
        return np.asarray(values - mean)[used]

    figures: dict[str, float | None] = {}
    split = None
    beyond = None if outside is None else np.repeat(outside, STEP_S)[: len(run.time_s)][used]
    for target in TARGETS:
        measured, truth = getattr(run, target), getattr(run, f"true_{target}")
        if measured is None:
            continue
        drift = from_reference(np.repeat(getattr(prediction, target), STEP_S)[: len(run.time_s)])
        true_drift = None if truth is None else from_reference(truth)
        if target == "bias_dph":
            values = measured[used]
            figures |= _bias_figures(values, drift, true_drift)
            split = None if beyond is None else apart(values, values - drift, beyond)
        else:
            values = from_reference(measured)
            figures |= _sf_figures(values, drift, true_drift)
            if beyond is not None and split is None:
                split = apart(values, values - drift, beyond, spread=_rms)
    return Scores(run.run_id, **figures, apart=split)


def _bias_figures(bias: Array, drift: Array, truth: Array | None) -> dict[str, float | None]:
    raw, after, floor = bias_stability(bias), bias_stability(bias - drift), noise_floor(bias)
    figures: dict[str, float | None] = {
        "raw_stability_dph": raw,
        "stability_dph": after,
        "improvement_pct": _percent(raw, after),
        "noise_floor_dph": floor,
        "attainable_pct": _percent(raw, floor),
    }
    if truth is not None:
        error = block_means(drift - truth)
        oracle = bias_stability(bias - truth)
        figures |= {
            "oracle_stability_dph": oracle,
            "oracle_pct": _percent(raw, oracle),
            "true_rmse_dph": _rms(error),
            "true_max_dph": float(np.nanmax(np.abs(error))),
        }
    return figures


def _sf_figures(measured: Array, drift: Array, truth: Array | None) -> dict[str, float | None]:
    error = block_means(measured - drift)
    figures: dict[str, float | None] = {
        "sf_raw_rms_ppm": _rms(block_means(measured)),
        "sf_rms_ppm": _rms(error),
        "sf_max_ppm": float(np.nanmax(np.abs(error))),
    }
    if truth is not None:
        error = block_means(drift - truth)
        figures |= {"sf_true_rms_ppm": _rms(error), "sf_true_max_ppm": float(np.nanmax(np.abs(error)))}
    return figures


def _percent(before: float, after: float) -> float:
    return 100.0 * (1.0 - after / before)


def _rms(values: Array) -> float:
    return float(np.sqrt(np.nanmean(values**2)))
