"""Grey-box model: coil temperatures by diffusion between the two measured ones, then terms physics asks for.

Six parameters of the diffusion and of the coating's glass transition are found by bounded least squares, the
coefficients of the terms by linear least squares inside it (variable projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Self

import numpy as np
from scipy.optimize import least_squares

from bench.analysis.thermal._diffusion import NODES, Diffusion, diffusion
from bench.analysis.thermal._regression import (
    TARGETS,
    LinearMap,
    MappedModel,
    anchored_errors,
    common_step,
    fit_ridge,
    target_noise,
)
from bench.analysis.thermal._types import FeatureRun
from drivers.base.arrays import Array

_RIDGE = 1e-9
_RADIUS = (np.arange(NODES) - (NODES - 1) / 2) / NODES


@dataclass(frozen=True)
class GreyBoxParameters:
    """The nonlinear parameters: exchange rates in 1/s, transition temperature and width in degC."""

    k_in: float
    k_out: float
    k_layer: float
    k_relax: float
    transition_c: float
    width_c: float

    def to_vector(self) -> Array:
        """Return the vector that is searched: logarithms of what must be positive."""
        rates = np.log([self.k_in, self.k_out, self.k_layer, self.k_relax])
        return np.array([*rates, self.transition_c / _TEMP_SCALE_C, np.log(self.width_c)])

    @classmethod
    def from_vector(cls, vector: Array) -> Self:
        """Inverse of `to_vector`."""
        k_in, k_out, k_layer, k_relax = (float(rate) for rate in np.exp(vector[:4]))
        return cls(k_in, k_out, k_layer, k_relax, float(vector[4] * _TEMP_SCALE_C), float(np.exp(vector[5])))


_TEMP_SCALE_C = 10.0
_STARTS = (
    GreyBoxParameters(0.02, 0.01, 0.2, 1 / 2000.0, -20.0, 8.0),
    GreyBoxParameters(0.01, 0.03, 0.5, 1 / 2000.0, -20.0, 8.0),
)
"""A coil that follows its spool, and one that follows the case: descent does not cross from one to the other."""
_AGAIN = 8
"""Evaluations that are enough from the minimum of nearly the same runs."""
_LOW = GreyBoxParameters(1e-3, 1e-4, 5e-3, 1 / 20000.0, -50.0, 2.0)
_HIGH = GreyBoxParameters(0.5, 0.5, 5.0, 1 / 400.0, 20.0, 25.0)


class GreyBoxModel(MappedModel):
    """Ten-layer diffusion between T_in and T_out, 6 nonlinear and 11 linear parameters a target.

    The structure is known and only its numbers are learnt, so it holds outside the training profiles. Errors
    count in units of each target's own noise. The validation runs choose between the minima that two starts
    lead to; without one the training cost does.
    """

    name = "grey_box"

    parameters: GreyBoxParameters

    def __init__(self, *, evaluations: int = 25, starts: Sequence[GreyBoxParameters] = _STARTS) -> None:
        super().__init__()
        self.evaluations, self.starts = evaluations, tuple(starts)

    def fit(self, train: Sequence[FeatureRun], validation: Sequence[FeatureRun]) -> None:
        """Fit to `train`; ConfigurationError when there is nothing to fit."""
        step_s = common_step(train)
        searched = [self._search(start, train, step_s) for start in self.starts]
        costs = [cost for _, cost in searched]
        fits = []
        for parameters, _ in searched:
            terms = _terms(parameters, _inputs(train), train, step_s)
            fits.append((parameters, fit_ridge(terms, train, [_RIDGE])[0]))
        if validation:
            costs = [_cost(parameters, fitted, validation, step_s) for parameters, fitted in fits]
        self.step_s = step_s
        self.parameters, self.map = fits[int(np.argmin(costs))]

    def _search(
        self, start: GreyBoxParameters, train: Sequence[FeatureRun], step_s: float
    ) -> tuple[GreyBoxParameters, float]:
        """Return the parameters that least squares reach from `start`, and their cost."""
        inputs, noise = _inputs(train), target_noise(train)

        def residual(vector: Array) -> Array:
            terms = _terms(GreyBoxParameters.from_vector(vector), inputs, train, step_s)
            errors = _errors(fit_ridge(terms, train, [_RIDGE])[0], terms, train)
            return np.concatenate([values / noise[target] for target, values in errors.items()])

        found = least_squares(
            residual,
            start.to_vector(),
            bounds=(_LOW.to_vector(), _HIGH.to_vector()),
            diff_step=1e-3,
            max_nfev=self.evaluations,
        )
        return GreyBoxParameters.from_vector(found.x), float(found.cost)

    def unfitted(self) -> GreyBoxModel:
        """Return an unfitted model that starts from this one's parameters: for fits to nearly the same runs."""
        return GreyBoxModel(evaluations=_AGAIN, starts=(self.parameters,))

    def run_terms(self, run: FeatureRun) -> Array:
        """Return the terms of a run, (n, 10)."""
        return _terms(self.parameters, _inputs([run]), [run], run.step_s)[0]

    def stepper(self) -> GreyBoxStepper:
        """Return the model on a stream."""
        fitted, step_s = self.fitted()
        return GreyBoxStepper(self.parameters, fitted, step_s)

    def to_state(self) -> dict[str, Any]:
        """Return step, nonlinear parameters and the linear map."""
        return {**super().to_state(), "parameters": asdict(self.parameters)}

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> Self:
        """Restore a model."""
        model = super().from_state(state)
        parameters = {key: float(value) for key, value in state["parameters"].items()}
        model.parameters = GreyBoxParameters(**parameters)
        if not min(value for name, value in parameters.items() if name != "transition_c") > 0.0:
            raise ValueError("an exchange rate or a width that is not above zero")
        return model


class GreyBoxStepper:
    """The grey box on a stream; its state is the layers, the relaxation and the last case temperature."""

    def __init__(self, parameters: GreyBoxParameters, fitted: LinearMap, step_s: float) -> None:
        self._parameters, self._map, self._step_s = parameters, fitted, step_s
        self._chain = _chain(parameters, step_s)
        self._state: Array | None = None
        self._earlier_out = 0.0

    def step(self, t_in: float, t_out: float, dt_60: float, gradient: float) -> tuple[float, float]:
        """Return (bias_dph, sf_error_ppm); the rate and the gradient follow from the temperatures."""
        inputs = np.array([t_in, t_out])
        if self._state is None:
            self._state, self._earlier_out = self._chain.rest @ inputs, t_out
        self._state = self._chain.advance(self._state, inputs)
        rate_out = np.array((t_out - self._earlier_out) * 60.0 / self._step_s)
        self._earlier_out = t_out
        terms = _state_terms(self._parameters, self._chain, self._state, inputs, rate_out)
        bias_dph, sf_error_ppm = self._map.apply(terms)
        return float(bias_dph), float(sf_error_ppm)


def _chain(parameters: GreyBoxParameters, step_s: float) -> Diffusion:
    p = parameters
    return diffusion(p.k_in, p.k_out, p.k_layer, p.k_relax, step_s)


def _inputs(runs: Sequence[FeatureRun]) -> Array:
    """Both temperatures of all runs side by side, (n, runs, 2); shorter runs hold their last value."""
    length = max(len(run.time_s) for run in runs)
    stacked = [np.column_stack([run.t_in, run.t_out]) for run in runs]
    padded = [np.pad(block, ((0, length - len(block)), (0, 0)), mode="edge") for block in stacked]
    return np.stack(padded, axis=1)


def _terms(
    parameters: GreyBoxParameters, inputs: Array, runs: Sequence[FeatureRun], step_s: float
) -> list[Array]:
    chain = _chain(parameters, step_s)
    states = chain.simulate(inputs)
    rate_out = np.diff(inputs[..., 1], axis=0, prepend=inputs[:1, :, 1]) * (60.0 / step_s)
    terms = _state_terms(parameters, chain, states, inputs, rate_out)
    return [terms[: len(run.time_s), number] for number, run in enumerate(runs)]


def _state_terms(
    parameters: GreyBoxParameters, chain: Diffusion, states: Array, inputs: Array, rate_out: Array
) -> Array:
    """Return the terms (..., 10) from states (..., 11), inputs (..., 2) and the case's rate (...).

    u = (Tc-25)/50, v = (T_in-25)/50, Tc the coil's mean, rates in degC/min, soft: grown below the transition.
    """
    rates = chain.rates(states, inputs)[..., :NODES]
    coil, rate = states[..., :NODES].mean(axis=-1), rates.mean(axis=-1)
    u, v = (coil - 25.0) / 50.0, (inputs[..., 0] - 25.0) / 50.0
    # The sigmoid as a tanh: no overflow far above the transition.
    soft = 0.5 - 0.5 * np.tanh((coil - parameters.transition_c) / (2.0 * parameters.width_c))
    columns = [
        u,
        u**2,
        u**3,
        v,
        v**2,
        rates @ _RADIUS,
        rate - rate_out,
        rate,
        rate * soft,
        coil - states[..., NODES],
    ]
    return np.stack(columns, axis=-1)


def _cost(
    parameters: GreyBoxParameters, fitted: LinearMap, runs: Sequence[FeatureRun], step_s: float
) -> float:
    """Sum over the targets of the mean square anchored error in units of the target's noise."""
    predictions = [fitted.predict(block) for block in _terms(parameters, _inputs(runs), runs, step_s)]
    noise = target_noise(runs)
    return sum(
        float(np.mean(anchored_errors(predictions, runs, target) ** 2)) / sigma**2
        for target, sigma in noise.items()
    )


def _errors(fitted: LinearMap, terms: Sequence[Array], runs: Sequence[FeatureRun]) -> dict[str, Array]:
    errors: dict[str, list[Array]] = {target: [] for target in TARGETS}
    for block, run in zip(terms, runs, strict=True):
        both, usable = fitted.apply(block), run.weight > 0
        for column, target in enumerate(TARGETS):
            values = getattr(run, target)
            if values is not None and usable.any():
                errors[target].append((values - both[:, column])[usable])
    return {target: np.concatenate(blocks) for target, blocks in errors.items() if blocks}
