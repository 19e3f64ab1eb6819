"""The mean of several fitted models: what is taken where the runs do not decide between them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from bench.analysis.thermal._sum import SumStepper
from bench.analysis.thermal._types import FeatureRun, Prediction, ThermalModel


class MeanModel:
    """Every part predicts, their mean is the drift. `fit` fits the parts it was made of."""

    name = "mean"

    def __init__(self, parts: Sequence[ThermalModel] = ()) -> None:
        self.parts = tuple(parts)

    def fit(self, train: Sequence[FeatureRun], validation: Sequence[FeatureRun]) -> None:
        """Fit every part; errors are theirs."""
        for part in self.parts:
            part.fit(train, validation)

    def predict(self, run: FeatureRun) -> Prediction:
        """Return the drift over a whole run."""
        return mean_prediction([part.predict(run) for part in self.parts])

    def stepper(self) -> SumStepper:
        """Return a fresh streaming form."""
        return SumStepper(*(part.stepper() for part in self.parts), weight=1.0 / len(self.parts))

    def to_state(self) -> dict[str, Any]:
        """Return names and states of the parts; the registry restores them."""
        return {"parts": [{"name": part.name, "state": part.to_state()} for part in self.parts]}


def mean_prediction(predictions: Sequence[Prediction]) -> Prediction:
    """Return the mean of predictions for one run."""
    return Prediction(
        np.mean([prediction.bias_dph for prediction in predictions], axis=0),
        np.mean([prediction.sf_error_ppm for prediction in predictions], axis=0),
    )
