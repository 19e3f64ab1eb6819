"""A model that is a sum of two: the second is fitted on what the first leaves."""

from __future__ import annotations

from abc import ABC
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Generic, Self, TypeVar

from bench.analysis.thermal._regression import TARGETS
from bench.analysis.thermal._types import FeatureRun, Prediction, Stepper, ThermalModel

First = TypeVar("First", bound=ThermalModel)
Second = TypeVar("Second", bound=ThermalModel)


class SumModel(ABC, Generic[First, Second]):
    """Kinds say which two models; `KEYS` are their names in a file."""

    name: str
    KEYS: tuple[str, str]

    def __init__(self, first: First, second: Second) -> None:
        self.first, self.second = first, second

    def fit(self, train: Sequence[FeatureRun], validation: Sequence[FeatureRun]) -> None:
        """Fit the first part, then the second on its residuals; errors are those of the parts."""
        self.first.fit(train, validation)
        self.second.fit(*([residual(self.first, run) for run in runs] for runs in (train, validation)))

    def predict(self, run: FeatureRun) -> Prediction:
        """Return the drift over a whole run."""
        first, second = self.first.predict(run), self.second.predict(run)
        return Prediction(first.bias_dph + second.bias_dph, first.sf_error_ppm + second.sf_error_ppm)

    def stepper(self) -> SumStepper:
        """Return a fresh streaming form."""
        return SumStepper(self.first.stepper(), self.second.stepper())

    def to_state(self) -> dict[str, Any]:
        """Return the states of both parts."""
        return dict(zip(self.KEYS, (self.first.to_state(), self.second.to_state()), strict=True))

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Self:
        """Restore a fitted model."""
        model = cls()  # type: ignore[call-arg]  # kinds need no arguments
        kinds: tuple[Any, Any] = (type(model.first), type(model.second))
        model.first, model.second = (
            kind.from_state(state[key]) for kind, key in zip(kinds, cls.KEYS, strict=True)
        )
        return model


class SumStepper:
    """Parts on one stream, their outputs added with equal weights."""

    def __init__(self, *parts: Stepper, weight: float = 1.0) -> None:
        self._parts, self._weight = parts, weight

    def step(self, t_in: float, t_out: float, dt_60: float, gradient: float) -> tuple[float, float]:
        """Return (bias_dph, sf_error_ppm) for this step."""
        outputs = [part.step(t_in, t_out, dt_60, gradient) for part in self._parts]
        bias_dph, sf_error_ppm = (self._weight * sum(column) for column in zip(*outputs, strict=True))
        return bias_dph, sf_error_ppm


def residual(model: ThermalModel, run: FeatureRun) -> FeatureRun:
    """Return the run with what a model leaves of its targets in their place."""
    prediction = model.predict(run)
    left = {
        target: getattr(run, target) - getattr(prediction, target)
        for target in TARGETS
        if getattr(run, target) is not None
    }
    return replace(run, **left)
