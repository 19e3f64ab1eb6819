"""Models linear in their coefficients: cubic, multilinear, stepwise, lagged ridge."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, Self

import numpy as np

from bench.analysis.common.stepwise import stepwise
from bench.analysis.thermal._regression import (
    TARGETS,
    LinearMap,
    MappedModel,
    anchored_errors,
    common_step,
    fit_ordinary,
    fit_ridge,
    solve_least_squares,
    target_rows,
)
from bench.analysis.thermal._signals import LAG_TIMES_S, Signals, SignalStream, lag_terms, signals
from bench.analysis.thermal._types import FeatureRun
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

RIDGES = tuple(10.0 ** (exponent / 2) for exponent in range(-16, 1))
"""Penalties tried on the validation run, relative to a standardised term's variance."""


class _LinearModel(MappedModel):
    """A map of terms of the signals of one step, by ordinary least squares unless a kind finds it otherwise."""

    @abstractmethod
    def terms(self, inputs: Signals) -> Array:
        """Return the terms, shape (n, k), from signals of n steps."""

    def fit(self, train: Sequence[FeatureRun], validation: Sequence[FeatureRun]) -> None:
        """Learn coefficients and normalisation from `train`."""
        self.step_s = common_step(train)
        self.map = self._fit_map([self.run_terms(run) for run in train], train, validation)

    def _fit_map(
        self, terms: Sequence[Array], train: Sequence[FeatureRun], validation: Sequence[FeatureRun]
    ) -> LinearMap:
        return fit_ordinary(terms, train)

    def run_terms(self, run: FeatureRun) -> Array:
        """Return the terms of a run, shape (n, k)."""
        return self.terms(signals(run))

    def stepper(self) -> LinearStepper:
        """Return the model on a stream."""
        return LinearStepper(self, *self.fitted())


class LinearStepper:
    """A linear model on a stream; its state is the low-passes and the last minute of the case temperature."""

    def __init__(self, model: _LinearModel, fitted: LinearMap, step_s: float) -> None:
        self._model, self._map = model, fitted
        self._stream = SignalStream(step_s)

    def step(self, t_in: float, t_out: float, dt_60: float, gradient: float) -> tuple[float, float]:
        """Return (bias_dph, sf_error_ppm) for this step."""
        inputs = self._stream.step(t_in, t_out, dt_60, gradient)
        bias_dph, sf_error_ppm = self._map.apply(self._model.terms(inputs))[0]
        return float(bias_dph), float(sf_error_ppm)


class CubicModel(_LinearModel):
    """A cubic in T_in: what a static temperature calibration gives."""

    name = "poly3"

    def terms(self, inputs: Signals) -> Array:
        """Return T, T^2, T^3."""
        return np.column_stack([inputs.t_in, inputs.t_in**2, inputs.t_in**3])


class MultilinearModel(_LinearModel):
    """T_in, T_in^2, T_in^3, its rate and the gradient: the usual linear fit."""

    name = "multilinear"

    def terms(self, inputs: Signals) -> Array:
        """Return T, T^2, T^3, dT, G."""
        powers = [inputs.t_in, inputs.t_in**2, inputs.t_in**3]
        return np.column_stack([*powers, inputs.dt_in, inputs.gradient])


class StepwiseModel(_LinearModel):
    """Terms of case and inside temperature chosen by stepwise regression on 100 s rows, then fitted on all rows.

    Without pre-whitening, a drift's autocorrelated rows keep nearly every term: it is then a full regression.
    """

    name = "stepwise"

    def __init__(self, *, p_enter: float = 0.05) -> None:
        super().__init__()
        self.p_enter = p_enter

    def terms(self, inputs: Signals) -> Array:
        """Return 11 candidates, 1 = case (T_out), 2 = inside (T_in), rates in degC/min."""
        t1, t2, d1, d2 = inputs.t_out, inputs.t_in, inputs.dt_out, inputs.dt_in
        return np.column_stack([t1, t2, d1, d2, t1 * d1, t2 * d2, d1**2, d2**2, t1**2, t2**2, t1 - t2])

    def _fit_map(
        self, terms: Sequence[Array], train: Sequence[FeatureRun], validation: Sequence[FeatureRun]
    ) -> LinearMap:
        full = fit_ordinary(terms, train)
        every = max(1, round(100.0 / train[0].step_s))
        coefficients, intercept = np.zeros_like(full.coefficients), np.zeros(2)
        for column, target in enumerate(TARGETS):
            rows = target_rows(terms, train, target)
            if rows is None:
                continue
            chosen = stepwise(
                rows.terms[::every],
                rows.target[::every],
                p_enter=self.p_enter,
                segments=rows.run[::every],
            )
            # A term left out gets no scale: its standardised column is zero, and so is its coefficient.
            scale = np.where(chosen.final.included, full.scale, np.inf)
            coefficients[:, column], intercept[column] = solve_least_squares(rows, full.centre, scale)
        return LinearMap(full.centre, full.scale, coefficients, intercept)


class LaggedRidgeModel(_LinearModel):
    """Both temperatures and their low-passes, ridge penalty chosen on the validation run for each target.

    Without a validation run each training run is left out in turn, and the penalty with the least error is taken.

    With `with_temperature` (its name is then lag_ridge_x_temp) also T_in^2, T_in^3 and each difference of a
    temperature and its low-pass times T_in and T_in^2; it needs several runs of each kind, or it over-fits. The
    coefficients lean on near-collinear filters: never apply one unit's model to another.
    """

    def __init__(self, *, with_temperature: bool = False) -> None:
        super().__init__()
        self.name = "lag_ridge_x_temp" if with_temperature else "lag_ridge"
        self.with_temperature = with_temperature
        self.ridge: tuple[float, ...] = ()

    def terms(self, inputs: Signals) -> Array:
        """Return 14 terms, or 40 with temperature."""
        return lag_terms(inputs, with_temperature=self.with_temperature)

    def to_state(self) -> dict[str, Any]:
        """Return the linear model's state, the low-passes' time constants and the penalties chosen."""
        return {
            **super().to_state(),
            "with_temperature": self.with_temperature,
            "lag_times_s": list(LAG_TIMES_S),
            "ridge": list(self.ridge),
        }

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> Self:
        """Restore a model; ConfigurationError for one with other low-passes than this version's."""
        if list(state["lag_times_s"]) != list(LAG_TIMES_S):
            raise ConfigurationError(
                "the model's low-passes are not those of this version",
                where="model lag_ridge",
                found=str(list(state["lag_times_s"])),
                expected=str(list(LAG_TIMES_S)),
                remedy="fit the model again",
            )
        model = cls(with_temperature=bool(state["with_temperature"]))
        model.step_s, model.map = float(state["step_s"]), LinearMap.from_state(state)
        model.ridge = tuple(state["ridge"])
        return model

    def _fit_map(
        self, terms: Sequence[Array], train: Sequence[FeatureRun], validation: Sequence[FeatureRun]
    ) -> LinearMap:
        maps = fit_ridge(terms, train, RIDGES)
        if validation:
            checks = [self.run_terms(run) for run in validation]
            scores = np.array([_scores(fitted, checks, validation) for fitted in maps])
        else:
            scores = _left_out_scores(terms, train)
        carried = {target for target in TARGETS for run in train if getattr(run, target) is not None}
        best = dict(zip(TARGETS, scores.min(axis=0), strict=True))
        if missing := [target for target in TARGETS if target in carried and best[target] == np.inf]:
            raise ConfigurationError(
                "no validation run to choose the ridge penalty by",
                where=f"model {self.name}",
                found=f"no validation run with {' and '.join(missing)}",
                expected="a validation run for each target that is trained",
                remedy="keep one run of each kind out of the training",
            )
        first, second = (int(index) for index in np.argmin(scores, axis=0))
        self.ridge = (RIDGES[first], RIDGES[second])
        columns = ((maps[first], 0), (maps[second], 1))
        return LinearMap(
            maps[0].centre,
            maps[0].scale,
            np.column_stack([fitted.coefficients[:, column] for fitted, column in columns]),
            np.array([fitted.intercept[column] for fitted, column in columns]),
        )


def _left_out_scores(terms: Sequence[Array], runs: Sequence[FeatureRun]) -> Array:
    """Root mean square error of each penalty and target over the runs, each left out of the fit in turn,
    (penalties, 2); inf for a target that fewer than two runs carry."""
    scores = np.full((len(RIDGES), len(TARGETS)), np.inf)
    for column, target in enumerate(TARGETS):
        carriers = [number for number, run in enumerate(runs) if getattr(run, target) is not None]
        if len(carriers) < 2:
            continue
        squares = np.zeros(len(RIDGES))
        for left in carriers:
            rest = [number for number in carriers if number != left]
            maps = fit_ridge([terms[number] for number in rest], [runs[number] for number in rest], RIDGES)
            predictions = [fitted.predict(terms[left]) for fitted in maps]
            errors = [anchored_errors([prediction], [runs[left]], target) for prediction in predictions]
            squares += [float(np.mean(error**2)) for error in errors]
        scores[:, column] = np.sqrt(squares / len(carriers))
    return scores


def _scores(fitted: LinearMap, checks: Sequence[Array], runs: Sequence[FeatureRun]) -> list[float]:
    """Root mean square error of each target over the validation runs; inf where none carries it."""
    predictions = [fitted.predict(terms) for terms in checks]
    errors = [anchored_errors(predictions, runs, target) for target in TARGETS]
    return [float(np.sqrt(np.mean(error**2))) if len(error) else np.inf for error in errors]
