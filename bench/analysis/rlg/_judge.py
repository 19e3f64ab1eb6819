"""What a compensation does on a run it was not fitted on, and how that run differs from the fitted ones."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.common.statistics import Apart, apart
from bench.analysis.rlg._compensation import RlgCompensation
from bench.analysis.rlg._rows import RampRun
from bench.analysis.rlg._smooth import Promise
from drivers.base.arrays import Array

ANOTHER_DAY = "another day"
_MOVING_SHARE = 0.5
"""Rows whose rate is more than this part of the run's usual one belong to a ramp."""
_RATE_RATIO = 1.3
_RANGE_K = 5.0
_BIN_K = 2.0


@dataclass(frozen=True)
class BeforeAfter:
    """What an equation does to the stability of 100 s means (1 sigma, deg/h) on one run it was not fitted on.

    `differs` says how the run differs from those fitted. With a truth: `oracle_dph` after subtracting the true
    drift, `oracle_pct` the improvement that gives. `apart`: rows beyond what the training runs covered, and the
    stability inside and outside. `hysteresis_before_dph`, `hysteresis_after_dph`: rms difference between warming
    and cooling at the same case temperature, NaN for a run that goes one way only. `promise`: the improvement
    foretold from the run's temperatures; `inside`: part of its rows within the 95 % interval of the bias; None
    where one run was fitted.
    """

    run_id: str
    kind: str
    differs: str
    before_dph: float
    after_dph: float
    improvement_pct: float
    oracle_dph: float | None
    oracle_pct: float | None
    apart: Apart
    hysteresis_before_dph: float
    hysteresis_after_dph: float
    promise: Promise | None = None
    inside: float | None = None


def judge(compensation: RlgCompensation, run: RampRun, training: Sequence[RampRun] = ()) -> BeforeAfter:
    """Return what the equation does on a run; `training` are the runs that `differs` compares it with."""
    before = float(np.std(run.bias_dph, ddof=1))
    left = run.bias_dph - compensation.drift_dph(run)
    promise = inside = None
    if compensation.smooth is not None and compensation.smooth.runs > 1:
        promise = compensation.promise(run)
        inside = float(np.mean(np.abs(left) <= compensation.half_width_dph(run)))
    after = float(np.std(left, ddof=1))
    improvement = 100.0 * (1.0 - after / before)
    oracle = oracle_pct = None
    if run.true_bias_dph is not None:
        oracle = float(np.std(run.bias_dph - run.true_bias_dph, ddof=1))
        oracle_pct = 100.0 * (1.0 - oracle / before)
    return BeforeAfter(
        run.run_id,
        run.kind,
        how_it_differs(run, training),
        before,
        after,
        improvement,
        oracle,
        oracle_pct,
        apart(run.bias_dph, left, compensation.outside(run), block=1),
        hysteresis_dph(run, run.bias_dph),
        hysteresis_dph(run, left),
        promise,
        inside,
    )


@dataclass(frozen=True)
class RampProfile:
    """Direction of the first ramp (+1 warming, -1 cooling), rate in degC/min, ends of the case temperature."""

    direction: int
    rate: float
    low_c: float
    high_c: float


def profile_of(run: RampRun) -> RampProfile:
    """Return the profile that the case went through."""
    rate = float(np.percentile(np.abs(run.case_rate), 80.0))
    moving = np.abs(run.case_rate) > _MOVING_SHARE * rate
    direction = int(np.sign(run.case_rate[np.argmax(moving)])) if moving.any() else 0
    return RampProfile(direction, rate, float(run.case_c.min()), float(run.case_c.max()))


def how_it_differs(run: RampRun, training: Sequence[RampRun]) -> str:
    """Return how a run differs from those fitted, in words; one of the same profile is of another day."""
    own, fitted = profile_of(run), [profile_of(other) for other in training]
    if not fitted:
        return ""
    found = []
    if own.direction not in {other.direction for other in fitted}:
        found.append("other direction")
    if all(max(own.rate / other.rate, other.rate / own.rate) > _RATE_RATIO for other in fitted):
        found.append("another rate")
    low, high = min(other.low_c for other in fitted), max(other.high_c for other in fitted)
    if own.low_c < low - _RANGE_K or own.high_c > high + _RANGE_K:
        found.append("beyond the range")
    elif own.low_c > low + _RANGE_K or own.high_c < high - _RANGE_K:
        found.append("part of the range")
    return ", ".join(found) or ANOTHER_DAY


def hysteresis_dph(run: RampRun, values: Array) -> float:
    """Return the rms difference of `values` (n,) between warming and cooling at the same case temperature.

    Means over 2 degC that both directions passed; NaN if there is none.
    """
    rate = profile_of(run).rate
    place = np.floor(run.case_c / _BIN_K).astype(np.int64)
    place -= place.min()
    means = []
    for sign in (1.0, -1.0):
        use = sign * run.case_rate > _MOVING_SHARE * rate
        number = np.bincount(place[use], minlength=int(place.max()) + 1)
        total = np.bincount(place[use], values[use], int(place.max()) + 1)
        means.append(np.where(number > 0, total / np.maximum(number, 1), np.nan))
    apart = means[0] - means[1]
    known = apart[np.isfinite(apart)]
    return float(np.sqrt(np.mean(known**2))) if len(known) else float("nan")
