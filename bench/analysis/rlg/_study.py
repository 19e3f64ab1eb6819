"""Equations and a smooth form on training runs, one of them chosen by runs left out, all judged on other runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.compensation import provenance
from bench.analysis.common.runs import require_separate
from bench.analysis.common.stepwise import StepwiseResult, stepwise
from bench.analysis.rlg._basis import STATIC
from bench.analysis.rlg._choice import EQUATION, SHARES, Choice, choose_form
from bench.analysis.rlg._compensation import RlgCompensation
from bench.analysis.rlg._judge import BeforeAfter, judge
from bench.analysis.rlg._rows import RampRun
from bench.analysis.rlg._smooth import MORE_RUNS, Promise, RunToRun, fit_smooth, promise_of
from bench.analysis.rlg._variables import CANDIDATES, FIVE_TERMS, candidate_matrix
from bench.record.shown import Shown
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

PLAIN, CORRECTED, FIVE = "stepwise", "stepwise, corrected", "five terms"
SPLINE = "spline"
_SAME_COLUMN = 1e-5
"""Part of T2's spread that a straight line of T1 may leave if both are one column (in another unit, too)."""


@dataclass(frozen=True)
class Judged:
    """One way to compensate a unit, and what it does on runs that had no part in it."""

    name: str
    compensation: RlgCompensation
    judged: tuple[BeforeAfter, ...]

    @property
    def mean_improvement_pct(self) -> float:
        """Mean improvement over the runs judged."""
        return float(np.mean([row.improvement_pct for row in self.judged])) if self.judged else float("nan")


@dataclass(frozen=True)
class StepwiseVariant(Judged):
    """One way of choosing the terms: the regression with all its steps, its equation, and what it does."""

    result: StepwiseResult


@dataclass(frozen=True)
class Outlook:
    """Improvement in % to expect on further runs like those fitted, with `more_runs` of them fitted as well."""

    more_runs: float
    improvement_pct: float


@dataclass(frozen=True, repr=False)
class RlgStudy(Shown):
    """A study of one unit. `left_out`: variables that could take no part, and why.

    `variants`: equations; `forms`: the spline on temperatures alone, the smooth form, its mean with the equation.
    `spread`, `outlook` (of the smooth form): how far runs lie apart, and what more of them would bring; None and
    empty of one run. `promise`: the improvement to expect on runs like those fitted.
    """

    unit_id: str
    training: tuple[RampRun, ...]
    tests: tuple[RampRun, ...]
    variants: tuple[StepwiseVariant, ...]
    forms: tuple[Judged, ...]
    choice: Choice
    spread: RunToRun | None
    promise: Promise | None
    outlook: tuple[Outlook, ...]
    left_out: tuple[tuple[str, str], ...]

    def shown(self) -> dict[str, object]:
        """Return the unit, what was taken, the equation's terms, and what it improves on each test run."""
        return {
            "unit": self.unit_id,
            "taken": self.chosen.name,
            "terms": list(self.equation.result.selected),
            "tests": [row.run_id for row in self.chosen.judged],
            "improvement, %": [row.improvement_pct for row in self.chosen.judged],
        }

    @property
    def equation(self) -> StepwiseVariant:
        """The corrected selection."""
        return self.variant(CORRECTED)

    @property
    def chosen(self) -> Judged:
        """What goes into the file: settled before any held-out run was looked at."""
        if self.choice.taken == EQUATION:
            return self.equation
        return {form.name: form for form in self.forms}[self.choice.taken]

    @property
    def everything(self) -> tuple[Judged, ...]:
        """All ways that are judged side by side."""
        return (*self.variants, *self.forms)

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
    """Fit the bias of the training runs by equations and by the smooth form, choose one, judge all on the tests.

    The five terms of the paper stand beside the selections as an equation of their own, fitted with all five
    in. ConfigurationError for runs of several units, a run both fitted and judged, or fewer rows than
    variables.
    """
    require_separate(training, tests)
    options: dict[str, Any] = {"p_enter": p_enter, "p_remove": p_remove}
    chosen, left_out = _equations(training, variables, options)
    single = _one_column(training)
    fitted = fit_smooth(training, one_temperature=single)
    spline = fit_smooth(training, one_temperature=single, groups=STATIC)
    choice = choose_form(
        training,
        lambda runs: _compensation(runs, _corrected(runs, variables, options)),
        one_temperature=single,
    )
    several = len(training) > 1
    equations = {name: _compensation(training, result) for name, result in chosen.items()}
    if several:
        equations[CORRECTED] = replace(equations[CORRECTED], smooth=fitted.form)
    whole = replace(equations[CORRECTED], smooth=fitted.form)
    forms = {
        SPLINE: replace(whole, smooth=spline.form, smooth_share=1.0),
        **{name: replace(whole, smooth_share=share) for name, share in SHARES.items() if share > 0.0},
    }

    def judged(compensation: RlgCompensation) -> tuple[BeforeAfter, ...]:
        return tuple(judge(compensation, run, training) for run in tests)

    taken = equations[CORRECTED] if choice.taken == EQUATION else forms[choice.taken]
    return RlgStudy(
        unit_id=training[0].unit_id,
        training=tuple(training),
        tests=tuple(tests),
        variants=tuple(
            StepwiseVariant(name, made, judged(made), chosen[name]) for name, made in equations.items()
        ),
        forms=tuple(Judged(name, made, judged(made)) for name, made in forms.items()),
        choice=choice,
        spread=fitted.form.spread(training) if several else None,
        promise=promise_of([taken.promise(run) for run in training]) if several else None,
        outlook=tuple(Outlook(more, fitted.after(training, more)) for more in MORE_RUNS) if several else (),
        left_out=tuple(left_out),
    )


def _equations(
    training: Sequence[RampRun], variables: Sequence[str], options: dict[str, Any]
) -> tuple[dict[str, StepwiseResult], list[tuple[str, str]]]:
    """Return the regressions by name, and what could take no part in them with the reason."""
    x, y, usable, left_out = _regressors(training, variables)
    segments = _segments(training)
    chosen = {
        PLAIN: stepwise(x, y, names=usable, segments=segments, **options),
        CORRECTED: stepwise(x, y, names=usable, segments=segments, prewhiten=True, **options),
    }
    if set(FIVE_TERMS) <= set(usable):
        five = candidate_matrix(training, FIVE_TERMS)
        # Neither in nor out: p_remove of 1 keeps the five, p_enter of 0 adds none.
        try:
            chosen[FIVE] = stepwise(
                five, y, names=FIVE_TERMS, start=FIVE_TERMS, p_enter=0.0, p_remove=1.0, segments=segments
            )
        except ConfigurationError as alike:
            left_out.append((FIVE, str(alike)))
    return chosen, [*left_out, *_collinear(chosen[PLAIN])]


def _corrected(runs: Sequence[RampRun], variables: Sequence[str], options: dict[str, Any]) -> StepwiseResult:
    x, y, usable, _ = _regressors(runs, variables)
    return stepwise(x, y, names=usable, segments=_segments(runs), prewhiten=True, **options)


def _regressors(
    training: Sequence[RampRun], variables: Sequence[str]
) -> tuple[Array, Array, tuple[str, ...], list[tuple[str, str]]]:
    """Return the usable variables (n, k), the bias (n,), their names, and what is left out with the reason."""
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
    return x[:, [list(variables).index(name) for name in usable]], y, usable, left_out


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
