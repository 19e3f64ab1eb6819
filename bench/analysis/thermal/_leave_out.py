"""Which model to take, by leaving every run out once; an average of models where the runs do not decide.

A near-nominal validation run ties models that part on other profiles. Here each run in turn takes no part in a
fit and is predicted by it; a model's score is the mean over these runs. Means of the best two and three stand
beside the models. Who is within one standard error of the best is tied with it; of the tied the mean of most
models is taken, since errors of different models partly cancel.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import zip_longest
from typing import Any

import numpy as np

from bench.analysis.common.fan_out import ALONE, FanOut
from bench.analysis.common.leave_out import within_one_standard_error
from bench.analysis.thermal._mean import MeanModel, mean_prediction
from bench.analysis.thermal._registry import is_network, new_model
from bench.analysis.thermal._regression import TARGETS, anchored_errors
from bench.analysis.thermal._selection import ModelScore, score_predictions
from bench.analysis.thermal._types import FeatureRun, Prediction, ThermalModel
from drivers.base.arrays import Array

LEAST_FOLDS = 3
_CONSIDERED = 1.5
"""Models whose error on the validation runs is more than this times the best one's are not left-one-out."""
_CONSIDERED_NETWORK = 1.1
"""The same for networks, which have to be trained anew for each run left out: minutes, not seconds."""
_AVERAGED = (2, 3)
_ALIKE = 0.25


@dataclass(frozen=True)
class Fold:
    """Runs left out of a fit, one of each kind, and what models fitted without them predict of them."""

    runs: tuple[FeatureRun, ...]
    predictions: Mapping[str, tuple[Prediction, ...]]


@dataclass(frozen=True)
class Choice:
    """The model taken, fitted on every run, and all scores, its own first.

    `folds` hold the predictions of the models it consists of; what is left there is what it leaves elsewhere.
    """

    model: ThermalModel
    models: Mapping[str, ThermalModel]
    scores: tuple[ModelScore, ...]
    folds: tuple[Fold, ...]

    def left_out(self, model: ThermalModel) -> list[tuple[FeatureRun, Prediction]]:
        """Return every run with what a model, fitted without it, predicts of it; empty without such fits."""
        names = [part.name for part in model.parts] if isinstance(model, MeanModel) else [model.name]
        if not set(names) <= set(self.folds[0].predictions):
            return []
        return [
            (run, mean_prediction([fold.predictions[name][number] for name in names]))
            for fold in self.folds
            for number, run in enumerate(fold.runs)
        ]


def choose(
    models: Mapping[str, ThermalModel],
    scores: Sequence[ModelScore],
    train: Sequence[FeatureRun],
    validation: Sequence[FeatureRun],
    *,
    fan: FanOut = ALONE,
) -> Choice | None:
    """Choose among `models`, fitted on `train` with `scores` on `validation`, best first.

    All runs are anchored. None with fewer than three bias runs or scale-factor groups.
    """
    left_out = _folds(train, validation)
    if len(left_out) < LEAST_FOLDS:
        return None
    considered = [
        score.name
        for score in scores
        if score.score <= (_CONSIDERED_NETWORK if is_network(score.name) else _CONSIDERED) * scores[0].score
    ]
    work = [(models[name], left) for left in left_out for name in considered]
    found = fan.map(partial(_predicted, tuple(train), tuple(validation)), work)
    folds = tuple(
        Fold(left, dict(zip(considered, found[start : start + len(considered)], strict=True)))
        for left, start in zip(left_out, range(0, len(found), len(considered)), strict=True)
    )
    errors = {name: _errors(folds, (name,)) for name in considered}
    order = sorted(considered, key=lambda name: float(errors[name].mean()))
    candidates: dict[tuple[str, ...], Array] = {(name,): errors[name] for name in order}
    unlike = _unlike(folds, order)
    candidates |= {
        tuple(unlike[:count]): _errors(folds, unlike[:count]) for count in _AVERAGED if count <= len(unlike)
    }
    taken = _tied_with_best(candidates)[-1]
    again = fan.map(partial(_again, tuple(train), tuple(validation)), [models[name] for name in order])
    fitted = dict(models) | dict(zip(order, again, strict=True))
    model = fitted[taken[0]] if len(taken) == 1 else MeanModel([fitted[name] for name in taken])
    if len(taken) > 1:
        fitted[model.name] = model
    listed = {name: _score(name, folds, (name,), errors[name]) for name in order}
    mean = [_score(model.name, folds, taken, candidates[taken])] if len(taken) > 1 else []
    first = mean or [listed.pop(taken[0])]
    rest = [score for score in scores if score.name not in considered]
    return Choice(model, fitted, (*first, *listed.values(), *rest), folds)


def _unlike(folds: Sequence[Fold], order: Sequence[str]) -> list[str]:
    """Return the models, best first, less those whose predictions are hardly other than a better one's."""
    kept: list[str] = []
    for name in order:
        if not any(_alike(folds, name, better) for better in kept):
            kept.append(name)
    return kept


def _alike(folds: Sequence[Fold], name: str, better: str) -> bool:
    """Return whether two models part by less than a quarter of what the better one leaves, in every target."""
    for target in TARGETS:
        apart, left = [np.empty(0)], [np.empty(0)]
        for fold in folds:
            for number, run in enumerate(fold.runs):
                if getattr(run, target) is not None:
                    first, second = (fold.predictions[each][number] for each in (name, better))
                    own: dict[str, Any] = dict.fromkeys(TARGETS) | {target: getattr(first, target)}
                    apart.append(anchored_errors([second], [replace(run, **own)], target))
                    left.append(anchored_errors([second], [run], target))
        if np.mean(np.concatenate(apart) ** 2) > _ALIKE**2 * np.mean(np.concatenate(left) ** 2):
            return False
    return True


def _tied_with_best(candidates: Mapping[tuple[str, ...], Array]) -> list[tuple[str, ...]]:
    """Return who is within one standard error of the best, those of fewer models first."""
    tied = within_one_standard_error(candidates)
    # Of single models the best only.
    return [*[names for names in tied if len(names) == 1][:1], *(names for names in tied if len(names) > 1)]


def _folds(train: Sequence[FeatureRun], validation: Sequence[FeatureRun]) -> list[tuple[FeatureRun, ...]]:
    kinds = [[run for run in (*train, *validation) if getattr(run, target) is not None] for target in TARGETS]
    seen: set[int] = set()
    folds = []
    for pair in zip_longest(*kinds):
        left = tuple(run for run in pair if run is not None and id(run) not in seen)
        seen |= {id(run) for run in left}
        # A run that carries both targets comes twice.
        if unique := tuple({id(run): run for run in left}.values()):
            folds.append(unique)
    return folds


def _predicted(
    train: Sequence[FeatureRun],
    validation: Sequence[FeatureRun],
    work: tuple[ThermalModel, tuple[FeatureRun, ...]],
) -> tuple[Prediction, ...]:
    model, left = work
    ids = {run.run_id for run in left}
    rest, checks = ([run for run in runs if run.run_id not in ids] for runs in (train, validation))
    fitted = _fit(model, rest, checks)
    return tuple(fitted.predict(run) for run in left)


def _again(
    train: Sequence[FeatureRun], validation: Sequence[FeatureRun], model: ThermalModel
) -> ThermalModel:
    """Return the model fitted on all runs; a network, which needs other runs to end its training by, as it is."""
    return model if is_network(model.name) else _fit(model, train, validation)


def _fit(model: ThermalModel, train: Sequence[FeatureRun], validation: Sequence[FeatureRun]) -> ThermalModel:
    unfitted = getattr(model, "unfitted", None)
    made: ThermalModel = unfitted() if unfitted is not None else new_model(model.name)
    if is_network(model.name):
        # The last run of each kind ends the training where the validation runs are left out.
        ending = validation or list({id(run): run for run in _last_of_each(train)}.values())
        ids = {run.run_id for run in ending}
        made.fit([run for run in train if run.run_id not in ids], ending)
    else:
        made.fit([*train, *validation], ())
    return made


def _last_of_each(runs: Sequence[FeatureRun]) -> list[FeatureRun]:
    return [
        next(run for run in reversed(runs) if getattr(run, target) is not None)
        for target in TARGETS
        if any(getattr(run, target) is not None for run in runs)
    ]


def _errors(folds: Sequence[Fold], names: Sequence[str]) -> Array:
    """Return what is left over what was there, of every fold, for the mean of the models named."""
    return np.array([_fold_score(fold, names).score for fold in folds])


def _fold_score(fold: Fold, names: Sequence[str]) -> ModelScore:
    means = [
        mean_prediction([fold.predictions[name][number] for name in names])
        for number in range(len(fold.runs))
    ]
    return score_predictions("+".join(names), means, fold.runs)


def _score(name: str, folds: Sequence[Fold], names: Sequence[str], errors: Array) -> ModelScore:
    each = [_fold_score(fold, names) for fold in folds]

    def rms(values: Sequence[float | None]) -> float | None:
        known = [value for value in values if value is not None]
        return float(np.sqrt(np.mean(np.square(known)))) if known else None

    return ModelScore(
        name,
        rms([score.bias_rms_dph for score in each]),
        rms([score.sf_rms_ppm for score in each]),
        float(errors.mean()),
        left_out=len(errors),
        standard_error=float(errors.std(ddof=1) / np.sqrt(len(errors))),
        parts=tuple(names) if len(names) > 1 else (),
    )
