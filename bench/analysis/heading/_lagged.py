"""The lagged bilinear model: drift follows the lagged temperature times where gravity stands in the platform.

eps_i = sum_j K_ij g_j with g = [x, x cos, x sin] and x = the temperature change after a first-order lag: nine
numbers and one time constant, no 24 h window, no steady state. With `rate` and `quadratic` terms, fifteen
numbers. All are found in one least-squares fit with Gaussian priors, directly on the position errors.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize_scalar

from bench.analysis.heading._calibration import Calibration, Priors
from bench.analysis.heading._log import PlatformLog
from bench.analysis.heading._nine import too_few_headings
from bench.analysis.heading._second import (
    KINDS,
    TERMS,
    Kind,
    SecondChoice,
    SecondSensor,
    choose_second,
    missing_second,
    reference_of,
    second_terms,
)
from bench.analysis.heading._temperature import ReferenceTemperature, fit_reference, lagged
from drivers.base.arrays import Array

Form = Literal["lag9", "lag15"]
Cause = Literal["temperature", "unexplained", "heading", "none"]

FAST_TAU_S = 1800.0
TAU_RANGE_S = (0.7 * 3600.0, 18.0 * 3600.0)
LEAST_STAY_S = 2.0 * 3600.0
_LOG_RANGE = math.log(TAU_RANGE_S[1] / TAU_RANGE_S[0])
_STEP, _PARTS, _LEAST_BEND = 0.1, 20, 0.3
"""Step of the logarithm by which a cost's bend is taken; stretches of a run that are left out in turn; part of
the whole run's bend that they are taken to leave at least."""
_MIDDLE = 0.5 * math.log(TAU_RANGE_S[0] * TAU_RANGE_S[1])
_GRID = 12
_ROUNDS = 6
_TAU_TOLERANCE = 1e-3
_LEAST_COST_DROP = 60.0
"""Ten coefficients of noise lower the cost by 10 +- 4.5; this is far outside."""
_STEPS_RULE, _MOST_SHARE, _MIXED = 3.0, 0.5, 0.5
"""Ratio of costs, temperature to steps. Emulated platforms: temperature alone at most 0.35, friction alone at
least 10; with a hidden gradient of 29 % or friction as large as the temperature's effect, anything between."""
MOST_UNEXPLAINED = 0.25
"""Share of the effect left to steps beyond which a compensation can do harm: on platforms of six other kinds of
physics (`benchmarks/off_class`) nearly all that were made worse had more."""
_DOUBT = 1.5
_NAMES = {"lag9": ("x", "x cos", "x sin"), "lag15": ("x", "x cos", "x sin", "rate", "quadratic")}


@dataclass(frozen=True)
class Evidence:
    """Costs (sum of squared normalised residuals and priors) of rival explanations of the same run.

    `none`: neither; `temperature`: this model; `steps`: a constant drift of its own at each heading, which is
    what friction or a magnetic field would make. `other_share` is the part of the heading effect (variance of
    position) that steps still explain beside the temperature. `residual`: rms of normalised residuals; well
    below 1 is usual, since the assumed noise of a mean allows for its correlation with the next.
    """

    none: float
    temperature: float
    steps: float
    other_share: float
    residual: float

    @property
    def cause(self) -> Cause:
        """What the run says the heading effect comes from."""
        if self.none - min(self.temperature, self.steps) < _LEAST_COST_DROP * max(1.0, self.residual**2):
            return "none"
        by_steps = self.temperature > _STEPS_RULE * self.steps and self.other_share > _MOST_SHARE
        if by_steps:
            return "heading"
        return "unexplained" if self.other_share > MOST_UNEXPLAINED else "temperature"

    @property
    def least_reduction_percent(self) -> float:
        """Reduction to expect at least at other headings, %: less by what steps explain beside the
        temperature, and by what is left of this run."""
        left = math.sqrt(self.temperature / self.none) if self.none > 0.0 else 1.0
        return 100.0 * max(0.0, 1.0 - left - _DOUBT * math.sqrt(self.other_share))

    @property
    def mixed(self) -> bool:
        """Whether temperature is the cause, but steps (or structure that is not modelled) are beside it."""
        return self.cause == "temperature" and self.temperature > _MIXED * self.steps


@dataclass(frozen=True, eq=False)
class LaggedModel:
    """A fitted model. `gain_dph_per_k`, (3, k), rows x y z, columns `terms`; `sigma` of the same shape.

    `largest` (k,): the largest |regressor| of the calibration, beyond which the model was never tried. `swing`,
    (3, 4): periodic drift at the reference heading, deg/h, on cos, cos 2, sin, sin 2 of the sidereal angle.
    `tau_sigma_s`: standard deviation of `tau_s`, 0 in files that do not say. `second`: a second temperature whose
    three regressors are the last; None without.
    """

    form: Form
    gain: Array
    sigma: Array
    tau_s: float
    reference: ReferenceTemperature
    reference_heading_deg: float
    latitude_deg: float
    largest: Array
    swing: Array
    evidence: Evidence
    headings: int
    hours: float
    tau_sigma_s: float = 0.0
    second: SecondSensor | None = None

    @property
    def terms(self) -> tuple[str, ...]:
        """Names of the regressors."""
        return (*_NAMES[self.form], *(TERMS if self.second else ()))


def regressors(
    angle_rad: Array, temp_c: Array, step_s: float, reference: ReferenceTemperature, tau_s: float, form: Form
) -> Array:
    """Return g, (n, 3) or (n, 5), over uniform samples, settled on the first."""
    expected = reference.at(angle_rad)
    change = temp_c - expected
    x = lagged(change, step_s / tau_s)
    columns = [x, x * np.cos(angle_rad), x * np.sin(angle_rad)]
    if form == "lag15":
        absolute = lagged(temp_c - reference.coefficients[0], step_s / tau_s)
        columns += [lagged(change, step_s / FAST_TAU_S) - x, absolute**2 - (absolute - x) ** 2]
    return np.stack(columns, axis=1)


def fit_lagged(
    log: PlatformLog,
    form: Form = "lag9",
    priors: Priors | None = None,
    reference: ReferenceTemperature | None = None,
    second: Kind | None = None,
) -> LaggedModel:
    """Fit the model to a calibration run that begins at the reference heading.

    `reference` is that of the alignment; None takes it from the first stay of the log. `second`: how
    `log.second_c` enters, None: not at all. Raises RecordError with fewer than three headings beside the
    reference or without a sidereal day at it.
    """
    run = Calibration(log, priors or Priors())
    others = run.headings().shape[1] if run.stays else 0
    if others < 3:
        raise too_few_headings(others, LEAST_STAY_S)
    inputs = _Inputs(run, form, reference, second)
    columns, sigma = run.background()
    fixed = _Fixed(columns, sigma, run.values)
    gain_prior = run.priors.gain_dph_per_k
    taus = [_MIDDLE, _MIDDLE][: 2 if second else 1]

    def cost_of(index: int) -> Callable[[float], float]:
        other = [run.drifts(inputs.terms(k, float(np.exp(tau)))) for k, tau in enumerate(taus) if k != index]

        def cost(log_tau: float) -> float:
            own = run.drifts(inputs.terms(index, float(np.exp(log_tau))))
            return fixed.with_columns(np.concatenate([own, *other], axis=1), gain_prior).cost

        return cost

    for _ in range(_ROUNDS if second else 1):
        for index in range(len(taus)):
            taus[index] = _minimum(cost_of(index))
    tau_s, *second_s = (float(np.exp(log_tau)) for log_tau in taus)
    terms = np.concatenate([inputs.terms(k, float(np.exp(tau))) for k, tau in enumerate(taus)], axis=1)
    effect = run.drifts(terms)
    found = fixed.with_columns(effect, gain_prior)
    count = terms.shape[1]
    return LaggedModel(
        form=form,
        gain=found.solution[: 3 * count].reshape(3, count),
        sigma=found.sigma[: 3 * count].reshape(3, count),
        tau_s=tau_s,
        reference=inputs.reference,
        reference_heading_deg=run.stays[0].heading_deg,
        latitude_deg=log.latitude_deg,
        largest=np.abs(terms).max(axis=0),
        swing=found.solution[-12:].reshape(3, 4) if run.priors.reference_periodic else np.zeros((3, 4)),
        evidence=_evidence(run, fixed, effect, found.cost),
        headings=others,
        hours=float(run.grid.time_s[-1] - run.grid.time_s[0]) / 3600.0,
        tau_sigma_s=tau_s
        * max(_log_sigma(cost_of(0), taus[0]), _log_scatter(run, inputs, taus, (columns, sigma))),
        second=replace(inputs.second, tau_s=second_s[0]) if inputs.second else None,
    )


def choose_input(
    log: PlatformLog, form: Form = "lag9", reference: ReferenceTemperature | None = None
) -> SecondChoice | None:
    """Return whether `log.second_c` is to enter, and how, by stays left out; None for a log without one."""
    if log.second_c is None:
        return None
    run = Calibration(log, Priors())
    grid = np.geomspace(*TAU_RANGE_S, _GRID).tolist()
    first = {tau_s: _Inputs(run, form, reference, None).terms(0, tau_s) for tau_s in grid}
    others = {kind: _Inputs(run, form, reference, kind) for kind in KINDS}
    seconds = {kind: {tau_s: made.terms(1, tau_s) for tau_s in grid} for kind, made in others.items()}
    return choose_second(run, first, seconds)


class _Inputs:
    """The regressors of a run at any time constants: 0 those of the temperature, 1 those of a second one."""

    def __init__(
        self, run: Calibration, form: Form, reference: ReferenceTemperature | None, kind: Kind | None
    ) -> None:
        grid = self._grid = run.grid
        self._form: Form = form
        self._step_s = float(grid.time_s[1] - grid.time_s[0])
        stop = run.stays[0].stop
        angle, temp_c = grid.sidereal_rad[:stop], grid.temp_c[:stop]
        self.reference = reference or fit_reference(angle, temp_c)
        self.second: SecondSensor | None = None
        if kind is not None:
            if grid.second_c is None:
                raise missing_second("the calibration log")
            self.second = SecondSensor(kind, reference_of(kind, angle, temp_c, grid.second_c[:stop]), 1.0)
            self._change = self.second.change(grid.sidereal_rad, grid.temp_c, grid.second_c)

    def terms(self, index: int, tau_s: float) -> Array:
        """Return the regressors, (n, k)."""
        angle = self._grid.sidereal_rad
        if index:
            return second_terms(self._change, angle, self._step_s / tau_s)
        return regressors(angle, self._grid.temp_c, self._step_s, self.reference, tau_s, self._form)


def _evidence(run: Calibration, fixed: _Fixed, effect: Array, temperature_cost: float) -> Evidence:
    priors = run.priors
    steps = run.drifts(run.headings())
    prior = np.concatenate(
        [np.full(effect.shape[1], priors.gain_dph_per_k), np.full(steps.shape[1], priors.step_drift_dph)]
    )
    both = fixed.with_columns(np.concatenate([effect, steps], axis=1), prior)
    thermal = effect @ both.solution[: effect.shape[1]]
    other = steps @ both.solution[effect.shape[1] : effect.shape[1] + steps.shape[1]]
    total = float(thermal @ thermal + other @ other)
    return Evidence(
        none=fixed.with_columns(effect[:, :0], 1.0).cost,
        temperature=temperature_cost,
        steps=fixed.with_columns(steps, priors.step_drift_dph).cost,
        other_share=float(other @ other) / total if total > 0.0 else 0.0,
        residual=float(np.sqrt(both.cost / max(1, int(np.count_nonzero(run.values))))),
    )


@dataclass(frozen=True, eq=False)
class _Solution:
    solution: Array
    sigma: Array
    cost: float


class _Fixed:
    """Normal equations of the columns that do not change; others are put in front of them and solved."""

    def __init__(self, columns: Array, sigma: Array, values: Array) -> None:
        self._columns, self._values = columns, values
        self._normal = columns.T @ columns + np.diag(sigma**-2.0)
        self._right = columns.T @ values
        self._square = float(values @ values)

    def with_columns(self, columns: Array, sigma: Array | float) -> _Solution:
        cross = columns.T @ self._columns
        prior = np.broadcast_to(np.asarray(sigma, dtype=np.float64), (columns.shape[1],))
        own = columns.T @ columns + np.diag(prior**-2.0)
        normal = np.block([[own, cross], [cross.T, self._normal]])
        right = np.concatenate([columns.T @ self._values, self._right])
        scale = np.sqrt(np.diag(normal))
        factor = cho_factor(normal / np.outer(scale, scale), lower=True)
        solution = cho_solve(factor, right / scale) / scale
        count = columns.shape[1]
        unit = np.zeros((len(scale), count))
        unit[:count] = np.eye(count)
        variance = np.diag(cho_solve(factor, unit)[:count]) / scale[:count] ** 2
        return _Solution(solution, np.sqrt(variance), self._square - float(right @ solution))


def _log_sigma(cost: Callable[[float], float], log_tau: float, step: float = _STEP) -> float:
    """Return the standard deviation of the logarithm, by how a sum of normalised squares bends about it."""
    bend = (cost(log_tau + step) + cost(log_tau - step) - 2.0 * cost(log_tau)) / step**2
    return float(np.sqrt(2.0 / bend)) if bend > 2.0 / _LOG_RANGE**2 else _LOG_RANGE


def _log_scatter(
    run: Calibration, inputs: _Inputs, taus: Sequence[float], background: tuple[Array, Array]
) -> float:
    """Return the standard deviation of the logarithm of the first time constant as parts of the run show it.

    Each of `_PARTS` stretches of time is left out in turn (jackknife; Efron, Tibshirani: An Introduction to the
    Bootstrap, 1993, 11.5), with one Newton step to its own minimum. Drift that wanders between knots moves it by
    more than the noise does.
    """
    columns, sigma = background
    others = [run.drifts(inputs.terms(k, float(np.exp(tau)))) for k, tau in enumerate(taus) if k]
    own = [run.drifts(inputs.terms(0, float(np.exp(taus[0] + step)))) for step in (-_STEP, 0.0, _STEP)]
    effects = [np.concatenate([each, *others], axis=1) for each in own]
    half = len(run.values) // 2  # north and east
    part = np.arange(len(run.values)) % half * _PARTS // half

    def costs(keep: NDArray[np.bool_]) -> list[float]:
        fixed = _Fixed(columns[keep], sigma, run.values[keep])
        return [fixed.with_columns(each[keep], run.priors.gain_dph_per_k).cost for each in effects]

    low, middle, high = costs(part >= 0)
    least = max(_LEAST_BEND * (low + high - 2.0 * middle), 2.0 * (_STEP / _LOG_RANGE) ** 2)
    moved = []
    for number in range(_PARTS):
        low, middle, high = costs(part != number)
        moved.append(0.5 * _STEP * (low - high) / max(low + high - 2.0 * middle, least))
    return float(np.sqrt((_PARTS - 1) * np.var(moved)))


def _minimum(cost: Callable[[float], float]) -> float:
    low, high = (float(np.log(end)) for end in TAU_RANGE_S)
    grid = np.linspace(low, high, _GRID)
    costs = [cost(float(at)) for at in grid]
    best = int(np.argmin(costs))
    low, high = float(grid[max(0, best - 1)]), float(grid[min(_GRID - 1, best + 1)])
    found = minimize_scalar(cost, bounds=(low, high), method="bounded", options={"xatol": _TAU_TOLERANCE})
    return float(found.x) if found.fun < costs[best] else float(grid[best])
