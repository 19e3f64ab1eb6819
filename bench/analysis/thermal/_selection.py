"""Which model to take: all are fitted on the training runs, the validation run chooses, other runs judge."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from bench.analysis.common.fan_out import ALONE, FanOut
from bench.analysis.thermal._anchor import anchor_runs
from bench.analysis.thermal._registry import model_names, new_model
from bench.analysis.thermal._regression import anchored_error
from bench.analysis.thermal._types import FeatureRun, ThermalModel
from drivers.base.errors import ConfigurationError


@dataclass(frozen=True)
class ModelScore:
    """One model on the validation runs, errors counted from the reference window's mean.

    `bias_rms_dph`, `sf_rms_ppm`: root mean square of what is left (None: no validation run carries it).
    `score`: mean over the targets of left / raw; 0 is perfect, 1 is no compensation at all.
    """

    name: str
    bias_rms_dph: float | None
    sf_rms_ppm: float | None
    score: float


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
    left: dict[str, float | None] = {"bias_dph": None, "sf_error_ppm": None}
    ratios = []
    predictions = [model.predict(run) for run in validation]
    for target in left:
        pairs = [
            (error, getattr(run, target)[run.weight > 0])
            for run, prediction in zip(validation, predictions, strict=True)
            if (error := anchored_error(prediction, run, target)) is not None and error.size
        ]
        if pairs:
            after, before = (
                float(np.sqrt(np.mean(np.concatenate(part) ** 2))) for part in zip(*pairs, strict=True)
            )
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
