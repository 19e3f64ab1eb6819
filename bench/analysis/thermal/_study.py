"""One study: models fitted on training runs, one chosen on validation runs, all judged on test runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from bench.analysis.common.fan_out import ALONE, FanOut
from bench.analysis.common.runs import require_completed, require_separate
from bench.analysis.thermal._anchor import anchor_runs
from bench.analysis.thermal._compensation import Compensation
from bench.analysis.thermal._dataset import load_thermal_runs
from bench.analysis.thermal._evaluate import Scores, evaluate
from bench.analysis.thermal._features import prepare
from bench.analysis.thermal._leave_out import choose
from bench.analysis.thermal._lstm import LstmModel
from bench.analysis.thermal._registry import require_models
from bench.analysis.thermal._selection import ModelScore, fit_models, score_models
from bench.analysis.thermal._stream import FEATURES, Limits
from bench.analysis.thermal._types import FeatureRun, ThermalModel, ThermalRun
from bench.analysis.thermal._width import fit_width
from bench.record.recording import Run
from bench.record.shown import Shown
from drivers.base.errors import ConfigurationError


@dataclass(frozen=True, repr=False)
class Study(Shown):
    """What came out. `scores` holds, for every model, its figures on every test run, in the order of `tests`.

    `network`: the compensation of the best network that was fitted, chosen or not; its width is None where it was
    too far behind to be fitted without each run.

    Without test runs the validation runs stand in `tests` and `judged_on_chosen` says that the figures flatter.
    """

    train: tuple[ThermalRun, ...]
    validation: tuple[ThermalRun, ...]
    tests: tuple[ThermalRun, ...]
    models: dict[str, ThermalModel]
    selection: tuple[ModelScore, ...]
    compensation: Compensation
    scores: dict[str, tuple[Scores, ...]]
    judged_on_chosen: bool
    network: Compensation | None = None

    @property
    def chosen(self) -> str:
        """Name of the chosen model."""
        return self.selection[0].name

    @property
    def remarks(self) -> list[str]:
        """What was left out of which run."""
        runs = {id(run): run for run in (*self.train, *self.validation, *self.tests)}
        return [f"{run.run_id}: {text}" for run in runs.values() for text in run.remarks]

    def shown(self) -> dict[str, object]:
        """Return what was fitted on what, the chosen model, and the stability it leaves."""
        rows = self.scores[self.chosen]
        return {
            "unit": self.train[0].unit_id,
            "fitted on": len(self.train),
            "chosen on": len(self.validation),
            "judged on": len(self.tests),
            "chosen": self.chosen,
            "1 sigma of 100 s, deg/h": [row.stability_dph for row in rows],
            "less by, %": [row.improvement_pct for row in rows],
        }


def run_study(
    train: Sequence[ThermalRun],
    validation: Sequence[ThermalRun],
    tests: Sequence[ThermalRun],
    names: Sequence[str] | None = None,
    *,
    fan: FanOut = ALONE,
) -> Study:
    """Fit where `fan` says, choose, judge; ConfigurationError for no validation run or runs of several units.

    With three runs of a kind or more each is left out in turn to choose, and the model chosen is fitted on all of
    them; with fewer the validation runs choose.
    """
    if not validation:
        raise ConfigurationError(
            "no validation run",
            where="fit",
            found="training runs only",
            expected="at least one run that takes no part in the fit, to choose between models",
            remedy="name one with --validate",
        )
    require_separate(train, (*validation, *tests))
    prepared, checks = [prepare(run) for run in train], [prepare(run) for run in validation]
    models = fit_models(prepared, checks, names, fan=fan)
    selection = score_models(models, checks)
    chosen, learnt = models[selection[0].name], anchor_runs(prepared)
    choice = choose(models, selection, *_apart(anchor_runs([*prepared, *checks]), len(prepared)), fan=fan)
    if choice is not None:
        chosen, models, selection = choice.model, dict(choice.models), choice.scores
        learnt = anchor_runs([*prepared, *checks])

    def compensation_of(model: ThermalModel) -> Compensation:
        left_out = [] if choice is None else choice.left_out(model)
        width = fit_width(left_out) if left_out else None
        return Compensation.from_fit(model, learnt, checks, scores=selection, width=width)

    compensation = compensation_of(chosen)
    networks = [models[score.name] for score in selection if isinstance(models[score.name], LstmModel)]
    judging = tests or validation
    return Study(
        train=tuple(train),
        validation=tuple(validation),
        tests=tuple(judging),
        models=models,
        selection=selection,
        compensation=compensation,
        scores={
            name: tuple(judged(model, run, compensation.limits) for run in judging)
            for name, model in models.items()
        },
        judged_on_chosen=not tests,
        network=compensation_of(networks[0]) if networks else None,
    )


def _apart(runs: list[FeatureRun], count: int) -> tuple[list[FeatureRun], list[FeatureRun]]:
    return runs[:count], runs[count:]


def judged(model: ThermalModel, run: ThermalRun, limits: Limits) -> Scores:
    """Return the figures of a model on a run, inside and outside of the limits apart."""
    features = prepare(run)
    inputs = np.stack([getattr(features, name) for name in FEATURES], axis=-1)
    return evaluate(model.predict(features), run, limits.flags(inputs) > 0)


def study_folders(
    train: Sequence[Path],
    validation: Sequence[Path],
    tests: Sequence[Path] = (),
    gyro: str | None = None,
    names: Sequence[str] | None = None,
    *,
    fan: FanOut = ALONE,
) -> Study:
    """Return the study of run folders. `gyro`: default the first of each; `names`: models, default all.

    ConfigurationError as `run_study`, and for an invalid run to fit or to choose on: only a test run may be one.
    """
    require_models(names or ())  # before minutes go into reading and fitting
    training, choosing = load_runs(train, gyro), load_runs(validation, gyro)
    return run_study(training, choosing, load_runs(tests, gyro, allow_invalid=True), names, fan=fan)


def load_runs(
    folders: Sequence[Path], gyro: str | None = None, *, allow_invalid: bool = False
) -> list[ThermalRun]:
    """Load thermal runs from run folders; ConfigurationError for an invalid run unless `allow_invalid`."""
    if not allow_invalid:
        for folder in folders:
            require_completed(Run.open(folder))
    return [run for folder in folders for run in load_thermal_runs(folder, gyro)]
