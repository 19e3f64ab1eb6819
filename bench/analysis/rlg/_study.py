"""Stepwise regression on training runs, as published and corrected for autocorrelation, judged on other runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.compensation import provenance
from bench.analysis.common.runs import require_separate
from bench.analysis.common.statistics import Apart, apart
from bench.analysis.common.stepwise import StepwiseResult, stepwise
from bench.analysis.rlg._compensation import RlgCompensation
from bench.analysis.rlg._rows import RampRun
from bench.analysis.rlg._variables import CANDIDATES, FIVE_TERMS, candidate_matrix
from bench.record.shown import Shown
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

PLAIN, CORRECTED, FIVE = "stepwise", "stepwise, corrected", "five terms"
ANOTHER_DAY = "another day"
_MOVING_SHARE = 0.5
"""Rows whose rate is more than this part of the run's usual one belong to a ramp."""
_RATE_RATIO = 1.3
_RANGE_K = 5.0
_BIN_K = 2.0
_SAME_COLUMN = 1e-5
"""Part of T2's spread that a straight line of T1 may leave if both are one column (in another unit, too)."""


@dataclass(frozen=True)
class BeforeAfter:
    """What an equation does to the stability of 100 s means (1 sigma, deg/h) on one run it was not fitted on.

    `differs` says how the run differs from those fitted. With a truth: `oracle_dph` after subtracting the true
    drift, `oracle_pct` the improvement that gives. `apart`: rows beyond what the training runs covered, and the
    stability inside and outside. `hysteresis_before_dph`, `hysteresis_after_dph`: rms difference between warming
    and cooling at the same case temperature, NaN for a run that goes one way only.
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


@dataclass(frozen=True)
class StepwiseVariant:
    """One way of choosing the terms: the regression with all its steps, its equation, and what it does."""

    name: str
    result: StepwiseResult
    compensation: RlgCompensation
    judged: tuple[BeforeAfter, ...]

    @property
    def mean_improvement_pct(self) -> float:
        """Mean improvement over the runs judged."""
        return float(np.mean([row.improvement_pct for row in self.judged])) if self.judged else float("nan")


@dataclass(frozen=True, repr=False)
class RlgStudy(Shown):
    """A study of one unit. `left_out`: variables that could take no part, and why."""

    unit_id: str
    training: tuple[RampRun, ...]
    tests: tuple[RampRun, ...]
    variants: tuple[StepwiseVariant, ...]
    left_out: tuple[tuple[str, str], ...]

    def shown(self) -> dict[str, object]:
        """Return the unit, the chosen equation's terms, and what it improves on each test run."""
        return {
            "unit": self.unit_id,
            "terms": list(self.chosen.result.selected),
            "tests": [row.run_id for row in self.chosen.judged],
            "improvement, %": [row.improvement_pct for row in self.chosen.judged],
        }

    @property
    def chosen(self) -> StepwiseVariant:
        """The corrected selection: the equation to use, settled before any held-out run was looked at."""
        return self.variant(CORRECTED)

    def variant(self, name: str) -> StepwiseVariant:
        """Return a variant by name; raises KeyError."""
        return {variant.name: variant for variant in self.variants}[name]


def run_rlg_study(
    training: Sequence[RampRun],
    tests: Sequence[RampRun],
    variables: Sequence[str] = CANDIDATES,
    *,
    p_enter: float = 0.05,
    p_remove: float = 0.10,
) -> RlgStudy:
    """Regress the bias of the training runs on the variables, judge every equation on the tests.

    The five terms of the paper stand beside the selections as an equation of their own, fitted with all five
    in. ConfigurationError for runs of several units, a run both fitted and judged, or fewer rows than
    variables.
    """
    require_separate(training, tests)
    x, y = candidate_matrix(training, variables), np.concatenate([run.bias_dph for run in training])
    usable, left_out = _usable(x, variables, twins=_one_column(training))
    if len(y) < len(usable) + 3 or not usable:
        raise ConfigurationError(
            "too few rows for that many variables",
            where="stepwise regression",
            found=f"{len(y)} rows of 100 s, {len(usable)} usable variables",
            expected=f"at least {len(usable) + 3} rows and one variable",
            remedy="add runs, or shorten the list of variables",
        )
    segment = _segments(training)
    columns = [list(variables).index(name) for name in usable]
    options: dict[str, Any] = {"names": usable, "p_enter": p_enter, "p_remove": p_remove, "segments": segment}
    chosen = {
        PLAIN: stepwise(x[:, columns], y, **options),
        CORRECTED: stepwise(x[:, columns], y, prewhiten=True, **options),
    }
    if set(FIVE_TERMS) <= set(usable):
        five = candidate_matrix(training, FIVE_TERMS)
        # Neither in nor out: p_remove of 1 keeps the five, p_enter of 0 adds none.
        try:
            chosen[FIVE] = stepwise(
                five, y, names=FIVE_TERMS, start=FIVE_TERMS, p_enter=0.0, p_remove=1.0, segments=segment
            )
        except ConfigurationError as alike:
            left_out += ((FIVE, str(alike)),)
    left_out += _collinear(chosen[PLAIN])
    variants = []
    for name, result in chosen.items():
        compensation = _compensation(training, result)
        variants.append(
            StepwiseVariant(
                name, result, compensation, tuple(judge(compensation, run, training) for run in tests)
            )
        )
    return RlgStudy(training[0].unit_id, tuple(training), tuple(tests), tuple(variants), tuple(left_out))


def judge(compensation: RlgCompensation, run: RampRun, training: Sequence[RampRun] = ()) -> BeforeAfter:
    """Return what the equation does on a run; `training` are the runs that `differs` compares it with."""
    before = float(np.std(run.bias_dph, ddof=1))
    left = run.bias_dph - compensation.drift_dph(run)
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


def _compensation(training: Sequence[RampRun], result: StepwiseResult) -> RlgCompensation:
    inside = np.flatnonzero(result.final.included)
    temps = np.concatenate([run.case_c for run in training])
    rates = np.concatenate([run.case_rate for run in training])
    return RlgCompensation(
        unit_id=training[0].unit_id,
        variables=tuple(result.names[i] for i in inside),
        coefficients=tuple(float(result.final.coefficient[i]) for i in inside),
        intercept_dph=result.final.intercept,
        temp_range_c=(float(temps.min()), float(temps.max())),
        rate_range=(float(rates.min()), float(rates.max())),
        statistics={
            "multiple_r": result.multiple_r,
            "r2": result.final.r2,
            "adjusted_r2": result.adjusted_r2,
            "rmse_dph": result.final.rmse,
            "f": result.f,
            "significance_f": result.significance_f,
            "lag1_correlation": result.lag1_correlation,
            "effective_n": result.effective_n,
        },
        **provenance({run.run_id: run.checksum for run in training}),
    )


def _one_column(runs: Sequence[RampRun]) -> bool:
    """Return whether T1 and T2 are one temperature: what of T2 is no straight line of T1 is rounding only."""
    t1, t2 = (np.concatenate([getattr(run, name) for run in runs]) for name in ("case_c", "block_c"))
    line = np.column_stack([t1, np.ones(len(t1))])
    left = t2 - line @ np.linalg.lstsq(line, t2, rcond=None)[0]
    return bool(np.std(left) <= _SAME_COLUMN * max(np.std(t2), 1e-12))


def _usable(x: Array, names: Sequence[str], *, twins: bool) -> tuple[tuple[str, ...], list[tuple[str, str]]]:
    """Return the variables that vary, and those that do not with the reason; `twins`: T1 and T2 are one."""
    spread, size = np.ptp(x, axis=0), np.abs(x).max(axis=0)
    usable, left_out = [], []
    for name, width, largest in zip(names, spread, size, strict=True):
        if twins and "T2" in name:
            left_out.append(
                (name, "T1 and T2 are one column in the training runs: one temperature was recorded")
            )
        elif width > 1e-9 * max(largest, 1e-12):
            usable.append(name)
        else:
            left_out.append((name, "constant in the training runs: nothing can be learnt from it"))
    return tuple(usable), left_out


def _collinear(result: StepwiseResult) -> list[tuple[str, str]]:
    """Return the terms that cannot enter beside those that are in."""
    final = result.final
    return [
        (name, "a sum of the variables already in (" + ", ".join(result.selected) + "): it adds nothing")
        for name, inside, p in zip(result.names, final.included, final.p_value, strict=True)
        if not inside and np.isnan(p)
    ]


def _segments(runs: Sequence[RampRun]) -> NDArray[np.int64]:
    parts, offset = [], 0
    for run in runs:
        parts.append(run.segment + offset)
        offset = int(parts[-1].max()) + 1
    return np.concatenate(parts)
