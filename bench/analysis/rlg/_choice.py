"""Equation, smooth form, or the mean of both: decided by what each leaves on rows left out of its fit.

Every run is left out once; of a single run every quarter, which says less: it is the same power-on. Who is within
one standard error of the best is tied with it. The equation or the smooth form is taken where one of the two is
tied and the other is not, else their mean: errors of different forms partly cancel.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.leave_out import within_one_standard_error
from bench.analysis.rlg._compensation import RlgCompensation
from bench.analysis.rlg._rows import RampRun
from bench.analysis.rlg._smooth import fit_smooth
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

EQUATION, MEAN, SMOOTH = "equation", "mean of both", "smooth form"
SHARES: Mapping[str, float] = {EQUATION: 0.0, MEAN: 0.5, SMOOTH: 1.0}
"""Share of the smooth form by name."""
QUARTERS = 4


@dataclass(frozen=True)
class Choice:
    """The form taken, and what each of the three leaves of what was there, (folds,), on every fold left out.

    `left_out` names the folds: run ids, or quarters of a single run. `failed`: why there was nothing to decide
    on, "" usually; the equation is taken then.
    """

    taken: str
    errors: Mapping[str, tuple[float, ...]]
    left_out: tuple[str, ...]
    failed: str = ""


@dataclass(frozen=True, eq=False)
class _Fold:
    """What is fitted, the rows of it in use, and the run and its rows that were left out."""

    name: str
    fitted: Sequence[RampRun]
    use: Sequence[NDArray[np.bool_]]
    judged: RampRun
    rows: NDArray[np.bool_]


def choose_form(
    training: Sequence[RampRun],
    equation: Callable[[Sequence[RampRun]], RlgCompensation],
    *,
    one_temperature: bool,
) -> Choice:
    """Leave runs out and choose; `equation` fits the equation of runs."""
    errors: dict[str, list[float]] = {name: [] for name in SHARES}
    folds = _folds(training)
    try:
        for fold in folds:
            parts = [run.part(rows) for run, rows in zip(fold.fitted, fold.use, strict=True)]
            first = equation(parts).drift_dph(fold.judged)
            form = fit_smooth(fold.fitted, one_temperature=one_temperature, use=fold.use).form
            second = form.drift_dph(fold.judged)
            for name, share in SHARES.items():
                left = fold.judged.bias_dph - (1.0 - share) * first - share * second
                size = _size(left[fold.rows], whole=bool(fold.rows.all()))
                errors[name].append(size / float(np.std(fold.judged.bias_dph)))
    except ConfigurationError as error:
        return Choice(EQUATION, {}, (), str(error))
    tied = within_one_standard_error({name: np.array(values) for name, values in errors.items()})
    alone = [name for name in (EQUATION, SMOOTH) if name in tied]
    taken = alone[0] if len(alone) == 1 else MEAN
    found = {name: tuple(float(value) for value in values) for name, values in errors.items()}
    return Choice(taken, found, tuple(fold.name for fold in folds))


def _size(left: Array, *, whole: bool) -> float:
    """Return the stability of a whole run, or the rms of a part: its offset from the rest counts there."""
    return float(np.std(left) if whole else np.sqrt(np.mean(left**2)))


def _folds(training: Sequence[RampRun]) -> list[_Fold]:
    every = [np.ones(len(run.time_s), dtype=np.bool_) for run in training]
    if len(training) > 1:
        return [
            _Fold(
                run.run_id, [*training[:k], *training[k + 1 :]], [*every[:k], *every[k + 1 :]], run, every[k]
            )
            for k, run in enumerate(training)
        ]
    [run] = training
    quarter = np.arange(len(run.time_s)) * QUARTERS // len(run.time_s)
    return [
        _Fold(f"quarter {k + 1}", training, [quarter != k], run, quarter == k)
        for k in range(min(QUARTERS, len(run.time_s)))
    ]
