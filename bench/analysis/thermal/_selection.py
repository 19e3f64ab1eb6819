"""Which model to take: all are fitted on the training runs, the validation run chooses, other runs judge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from typing import Any

import numpy as np

from bench.analysis.common.fan_out import ALONE, FanOut
from bench.analysis.thermal._anchor import anchor_runs
from bench.analysis.thermal._registry import model_names, new_model
from bench.analysis.thermal._regression import TARGETS, anchored_errors
from bench.analysis.thermal._types import FeatureRun, Prediction, ThermalModel
from drivers.base.errors import ConfigurationError


@dataclass(frozen=True)
class ModelScore:
    """One model on runs it was not fitted on, errors counted from the reference window's mean.

    `bias_rms_dph`, `sf_rms_ppm`: root mean square of what is left (None: no validation run carries it).
    `score`: mean over the targets of left / raw; 0 is perfect, 1 is no compensation at all. `left_out`: how many
    runs were left out in turn, each predicted by a fit on the others; `standard_error`: of the score over them.
    0 and None: the score is of the validation runs alone. `parts`: the models that a mean consists of.
    """

    name: str
    bias_rms_dph: float | None
    sf_rms_ppm: float | None
    score: float
    left_out: int = 0
    standard_error: float | None = None
    parts: tuple[str, ...] = ()

    def to_state(self) -> dict[str, Any]:
        """Return what a file has of it; what was not left out is not said."""
        state = asdict(self)
        last = ("left_out", "standard_error", "parts")
        return state if self.left_out else {name: state[name] for name in state if name not in last}


def fit_models(
    train: Sequence[FeatureRun],
    validation: Sequence[FeatureRun],
    names: Sequence[str] | None = None,
    *,
    fan: FanOut = ALONE,
) -> dict[str, ThermalModel]:
    """Fit the named models (default: all) on `train`, brought to one reference temperature.

    `fan` says where the fits run, one model each. A fit that fails raises: a comparison with a hole in it would
    choose the wrong model without saying so.
    """
    wanted = tuple(names) if names is not None else model_names()
    fitted = fan.map(partial(_fitted, anchor_runs(train), tuple(validation)), wanted)
    return dict(zip(wanted, fitted, strict=True))


def score_models(
    models: Mapping[str, ThermalModel], validation: Sequence[FeatureRun]
) -> tuple[ModelScore, ...]:
    """Return the models' scores on `validation`, best first; ConfigurationError without a usable target."""
    return tuple(
        sorted((_score(name, model, validation) for name, model in models.items()), key=lambda s: s.score)
    )


def _fitted(train: Sequence[FeatureRun], validation: Sequence[FeatureRun], name: str) -> ThermalModel:
    model = new_model(name)
    model.fit(train, validation)
    return model


def _score(name: str, model: ThermalModel, validation: Sequence[FeatureRun]) -> ModelScore:
    return score_predictions(name, [model.predict(run) for run in validation], validation)


def score_predictions(
    name: str, predictions: Sequence[Prediction], validation: Sequence[FeatureRun]
) -> ModelScore:
    """Return the score of predictions of runs; ConfigurationError if none carries a usable target."""
    left: dict[str, float | None] = dict.fromkeys(TARGETS)
    ratios = []
    for target in TARGETS:
        errors = anchored_errors(predictions, validation, target)
        if len(errors):
            carried = [run for run in validation if getattr(run, target) is not None]
            raw = np.concatenate([getattr(run, target)[run.weight > 0] for run in carried])
            after, before = (float(np.sqrt(np.mean(values**2))) for values in (errors, raw))
            left[target] = after
            ratios.append(after / before)
    if not ratios:
        raise ConfigurationError(
            "no validation run has a usable target",
            where=f"model {name}",
            found=f"{len(validation)} validation runs",
            expected="a bias run or a scale-factor group that took no part in the fit",
            remedy="keep one run out of the training",
        )
    return ModelScore(name, left["bias_dph"], left["sf_error_ppm"], float(np.mean(ratios)))
