"""Hybrid: the lagged ridge model, and a small LSTM on what it leaves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Self

from bench.analysis.thermal._linear_models import LaggedRidgeModel
from bench.analysis.thermal._lstm import LstmModel
from bench.analysis.thermal._lstm_weights import LstmSettings
from bench.analysis.thermal._regression import TARGETS
from bench.analysis.thermal._types import FeatureRun, Prediction, Stepper

RESIDUAL_SETTINGS = LstmSettings(hidden=16, epochs=120)


class HybridModel:
    """Sum of two models: the linear one carries what extrapolates, the network only the rest.

    `linear` and `network` are the parts, both fitted by `fit`, the network on the residual of the linear part.
    """

    name = "hybrid"

    def __init__(self, settings: LstmSettings = RESIDUAL_SETTINGS) -> None:
        self.linear = LaggedRidgeModel()
        self.network = LstmModel(settings)

    def fit(self, train: Sequence[FeatureRun], validation: Sequence[FeatureRun]) -> None:
        """Fit the linear part, then the network on its residuals; errors are those of the parts."""
        self.linear.fit(train, validation)
        self.network.fit(
            [_residual(self.linear, run) for run in train],
            [_residual(self.linear, run) for run in validation],
        )

    def predict(self, run: FeatureRun) -> Prediction:
        """Return the drift over a whole run."""
        linear, rest = self.linear.predict(run), self.network.predict(run)
        return Prediction(linear.bias_dph + rest.bias_dph, linear.sf_error_ppm + rest.sf_error_ppm)

    def stepper(self) -> HybridStepper:
        """Return a fresh streaming form."""
        return HybridStepper(self.linear.stepper(), self.network.stepper())

    def to_state(self) -> dict[str, Any]:
        """Return the states of both parts."""
        return {"linear": self.linear.to_state(), "network": self.network.to_state()}

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Self:
        """Restore a fitted model."""
        model = cls()
        model.linear = LaggedRidgeModel.from_state(state["linear"])
        model.network = LstmModel.from_state(state["network"])
        return model


class HybridStepper:
    """Both parts on one stream."""

    def __init__(self, linear: Stepper, network: Stepper) -> None:
        self._parts = (linear, network)

    def step(self, t_in: float, t_out: float, dt_60: float, gradient: float) -> tuple[float, float]:
        """Return (bias_dph, sf_error_ppm) for this step."""
        outputs = [part.step(t_in, t_out, dt_60, gradient) for part in self._parts]
        return outputs[0][0] + outputs[1][0], outputs[0][1] + outputs[1][1]


def _residual(linear: LaggedRidgeModel, run: FeatureRun) -> FeatureRun:
    prediction = linear.predict(run)
    rest = {
        target: getattr(run, target) - getattr(prediction, target)
        for target in TARGETS
        if getattr(run, target) is not None
    }
    return replace(run, **rest)
