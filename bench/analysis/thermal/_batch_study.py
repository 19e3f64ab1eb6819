"""A study of a batch: the common model chosen by units left out, a compensation for every unit, judged on
test runs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from bench.analysis.common.fan_out import ALONE, FanOut
from bench.analysis.common.runs import require_unseen
from bench.analysis.thermal._batch import (
    ANY_UNIT,
    BatchFit,
    LeftUnits,
    Units,
    fit_batch,
    leave_units_out,
    require_batch,
)
from bench.analysis.thermal._compensation import Compensation
from bench.analysis.thermal._evaluate import Scores
from bench.analysis.thermal._features import prepare
from bench.analysis.thermal._registry import require_models
from bench.analysis.thermal._study import judged, load_runs
from bench.analysis.thermal._types import FeatureRun, Prediction, ThermalRun
from bench.analysis.thermal._width import fit_width
from bench.record.shown import Shown

BATCH_MODELS = ("multilinear", "grey_box")
"""Models that may be common to a batch, unless others are named. A bank of low-passes is none: one unit's
coefficients lean on near-collinear filters, and make another unit worse on profiles that were not fitted."""

_OWN_RUNS = 3
"""Runs of a target from which a unit's own fit was the better one on most plants (docs/off_class.md)."""


@dataclass(frozen=True)
class LeftOver:
    """What a common model leaves of a target over what was there, in units left out of its fit: the mean over
    their runs, without runs of their own and with one."""

    without: float
    with_one: float


@dataclass(frozen=True, repr=False)
class BatchStudy(Shown):
    """What came out. `scores`: of every model by target, the chosen one's first. `common`: the compensation
    of a unit without runs; `compensations`: of every unit that has some, and `determined`, by unit and
    target, how many numbers its own runs decide. `tests` with their `judged` figures; a unit that is not in
    the batch takes `common`."""

    fit: BatchFit
    units: Mapping[str, tuple[ThermalRun, ...]]
    scores: Mapping[str, Mapping[str, LeftOver]]
    common: Compensation
    compensations: Mapping[str, Compensation]
    determined: Mapping[str, Mapping[str, float]]
    tests: tuple[ThermalRun, ...]
    judged: tuple[Scores, ...]

    @property
    def chosen(self) -> str:
        """Name of the common model."""
        return self.fit.basis.name

    @property
    def known_by_themselves(self) -> tuple[str, ...]:
        """Units with so many runs of their own that a fit without the batch is likely to be better."""

        def counts(of: Sequence[ThermalRun]) -> list[int]:
            return [sum(getattr(run, target) is not None for run in of) for target in self.fit.priors]

        return tuple(unit for unit, of in self.units.items() if max(counts(of)) >= _OWN_RUNS)

    def shown(self) -> dict[str, object]:
        """Return the units, the model that is common to them and what it leaves of units left out."""
        return {
            "units": list(self.units),
            "chosen": self.chosen,
            "left of units left out": self.scores[self.chosen],
        }


def run_batch(
    runs: Sequence[ThermalRun],
    tests: Sequence[ThermalRun] = (),
    names: Sequence[str] | None = None,
    *,
    fan: FanOut = ALONE,
) -> BatchStudy:
    """Fit the batch that `runs` are of, each of its unit; `fan` says where, one model each.

    ConfigurationError for too few units or runs, a model that cannot be common, a run both fitted and judged.
    """
    units: dict[str, list[ThermalRun]] = {}
    for run in runs:
        units.setdefault(run.unit_id, []).append(run)
    require_unseen(runs, tests)
    prepared = {unit: tuple(map(prepare, of)) for unit, of in units.items()}
    require_batch(prepared)
    wanted = tuple(BATCH_MODELS if names is None else names)
    found = fan.map(partial(_tried, prepared), wanted)
    scores = {name: _scores(left) for name, (_, left) in zip(wanted, found, strict=True)}
    order = sorted(wanted, key=lambda name: _mean(scores[name]))
    fit, left = found[wanted.index(order[0])]
    inflated = {
        target: replace(prior, inflation=left.inflation(target)) for target, prior in fit.priors.items()
    }
    fit = replace(fit, priors=inflated)
    compensations = {unit: _compensation(fit, left, prepared, unit) for unit in prepared}
    common = _compensation(fit, left, prepared, ANY_UNIT)
    of_run = [compensations.get(run.unit_id, common) for run in tests]
    return BatchStudy(
        fit=fit,
        units={unit: tuple(of) for unit, of in units.items()},
        scores={name: scores[name] for name in order},
        common=common,
        compensations=compensations,
        determined={unit: fit.determined(of) for unit, of in prepared.items()},
        tests=tuple(tests),
        judged=tuple(judged(made.model, run, made.limits) for made, run in zip(of_run, tests, strict=True)),
    )


def study_batch(
    folders: Sequence[Path],
    tests: Sequence[Path] = (),
    gyro: str | None = None,
    names: Sequence[str] | None = None,
    *,
    fan: FanOut = ALONE,
) -> BatchStudy:
    """Return the study of run folders of several units; ConfigurationError as `run_batch`, and for invalid
    runs."""
    require_models(names or ())
    return run_batch(load_runs(folders, gyro), load_runs(tests, gyro, allow_invalid=True), names, fan=fan)


def _tried(units: Units, name: str) -> tuple[BatchFit, LeftUnits]:
    fit = fit_batch(units, name)
    return fit, leave_units_out(units, name, fit)


def _scores(left: LeftUnits) -> dict[str, LeftOver]:
    return {
        target: LeftOver(left.score(target), left.score(target, left.inflation(target)))
        for target in left.without
    }


def _mean(scores: Mapping[str, LeftOver]) -> float:
    return float(np.mean([(score.without + score.with_one) / 2.0 for score in scores.values()]))


def _compensation(fit: BatchFit, left: LeftUnits, units: Units, unit: str) -> Compensation:
    """Return the compensation of a unit; it learnt from all runs, so they all are in its file and set its
    limits."""
    own = units.get(unit, ())
    others = [run for other, runs in units.items() if other != unit for run in runs]
    told: list[tuple[FeatureRun, Prediction]] = []
    for target in fit.priors:
        has = any(getattr(run, target) is not None for run in own)
        told += left.with_one[target][left.inflation(target)] if has else left.without[target]
    width = fit_width(told)
    train = [replace(run, unit_id=unit) for run in (*own, *others)]
    return Compensation.from_fit(fit.model(own), train, width=width)
