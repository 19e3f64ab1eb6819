"""Least squares of both targets on standardised terms, over the usable rows of several runs, and models of it."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from bench.analysis.thermal._types import FeatureRun, Prediction, Stepper
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

TARGETS = ("bias_dph", "sf_error_ppm")
_SAVED = ("centre", "scale", "coef", "intercept")
"""What a saved map is called, in the order of its attributes."""


@dataclass(frozen=True)
class LinearMap:
    """(terms - centre) / scale @ coefficients + intercept; k terms, columns in the order of `TARGETS`.

    `centre`, `scale` (k,) come from the training rows; `coefficients` (k, 2), `intercept` (2,).
    """

    centre: Array
    scale: Array
    coefficients: Array
    intercept: Array

    def apply(self, terms: Array) -> Array:
        """Return both targets, (n, k) -> (n, 2)."""
        return np.asarray((terms - self.centre) / self.scale @ self.coefficients + self.intercept)

    def predict(self, terms: Array) -> Prediction:
        """Return the drift of terms (n, k)."""
        both = self.apply(terms)
        return Prediction(both[:, 0], both[:, 1])

    def to_state(self) -> dict[str, Any]:
        """Return the four arrays."""
        return dict(zip(_SAVED, (self.centre, self.scale, self.coefficients, self.intercept), strict=True))

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> Self:
        """Restore a map; ValueError if its arrays do not fit together."""
        arrays = [np.asarray(state[name], dtype=np.float64) for name in _SAVED]
        shapes, terms = [array.shape for array in arrays], len(arrays[2])
        if shapes != [(terms,), (terms,), (terms, 2), (2,)]:
            raise ValueError(f"{', '.join(_SAVED)} of shapes {shapes}")
        restored = cls(*arrays)
        if not (restored.scale > 0.0).all():
            raise ValueError("a scale that is not above zero")
        return restored


class MappedModel(ABC):
    """A model that is a linear map of terms; kinds say which terms, and how they and the map are found.

    `step_s` and `map` are None before a fit.
    """

    name: str

    def __init__(self) -> None:
        self.step_s: float | None = None
        self.map: LinearMap | None = None

    @abstractmethod
    def fit(self, train: Sequence[FeatureRun], validation: Sequence[FeatureRun]) -> None:
        """Learn from `train`, choose by `validation`."""

    @abstractmethod
    def stepper(self) -> Stepper:
        """Return the model on a stream."""

    @abstractmethod
    def run_terms(self, run: FeatureRun) -> Array:
        """Return the terms of a run, shape (n, k)."""

    def predict(self, run: FeatureRun) -> Prediction:
        """Return the drift over a whole run; ConfigurationError before a fit or on another step."""
        fitted, step_s = self.fitted()
        if step_s != run.step_s:
            raise ConfigurationError(
                "the model cannot be applied to this run",
                where=f"model {self.name}, run {run.run_id}",
                found=f"run on a {run.step_s:g} s step",
                expected=f"{step_s:g} s",
                remedy="prepare the run with the model's step",
            )
        return fitted.predict(self.run_terms(run))

    def to_state(self) -> dict[str, Any]:
        """Return step, map and whatever the kind of model adds."""
        fitted, step_s = self.fitted()
        return {"step_s": step_s, **fitted.to_state()}

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> Self:
        """Restore a model."""
        model = cls()
        model.step_s, model.map = float(state["step_s"]), LinearMap.from_state(state)
        return model

    def fitted(self) -> tuple[LinearMap, float]:
        """Return map and step; ConfigurationError before a fit."""
        if self.map is None or self.step_s is None:
            raise ConfigurationError(
                "the model has not been fitted", where=f"model {self.name}", remedy="call fit first"
            )
        return self.map, self.step_s


@dataclass(frozen=True)
class Rows:
    """The usable rows of one target: terms (n, k), target (n,), the number of the run each row is from (n,)."""

    terms: Array
    target: Array
    run: NDArray[np.intp]


def target_rows(terms: Sequence[Array], runs: Sequence[FeatureRun], target: str) -> Rows | None:
    """Stack the rows with weight of those runs that carry `target`; None when there are none."""
    parts = []
    for number, (block, run) in enumerate(zip(terms, runs, strict=True)):
        values = getattr(run, target)
        if values is not None and (usable := run.weight > 0).any():
            parts.append((block[usable], values[usable], np.full(int(usable.sum()), number)))
    if not parts:
        return None
    return Rows(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def common_step(runs: Sequence[FeatureRun]) -> float:
    """Return the step the runs share; ConfigurationError for no runs, or runs of several steps or units."""
    steps, units = {run.step_s for run in runs}, {run.unit_id for run in runs}
    if len(steps) == len(units) == 1:
        return steps.pop()
    raise ConfigurationError(
        "these runs cannot be fitted together",
        where="fit",
        found=f"{len(runs)} runs, units {sorted(units)}, steps {sorted(steps)} s",
        expected="at least one run, all of one unit and on one step",
        remedy="choose the runs of one unit and prepare them alike",
    )


def standardisation(terms: Sequence[Array], runs: Sequence[FeatureRun]) -> tuple[Array, Array]:
    """Return mean and standard deviation (1 where it vanishes) of each term over the rows with weight."""
    rows = np.concatenate([block[run.weight > 0] for block, run in zip(terms, runs, strict=True)])
    if not len(rows):
        raise ConfigurationError(
            "no training run has a usable row",
            where="fit",
            found=f"{len(runs)} runs, all weights zero",
            expected="temperatures and a target after the reference window",
            remedy="check the recordings for gaps",
        )
    spread = rows.std(axis=0)
    return rows.mean(axis=0), np.where(spread > 1e-12, spread, 1.0)


def solve_least_squares(rows: Rows, centre: Array, scale: Array) -> tuple[Array, float]:
    """Return coefficients (k,) on standardised terms, the smallest where not unique, and intercept."""
    terms, mean_terms, target, mean_target = _centred(rows, centre, scale)
    coefficients = np.asarray(np.linalg.lstsq(terms, target, rcond=1e-10)[0], dtype=np.float64)
    return coefficients, mean_target - float(mean_terms @ coefficients)


def _centred(rows: Rows, centre: Array, scale: Array) -> tuple[Array, Array, Array, float]:
    terms = (rows.terms - centre) / scale
    mean_terms, mean_target = terms.mean(axis=0), float(rows.target.mean())
    return terms - mean_terms, mean_terms, rows.target - mean_target, mean_target


def fit_ordinary(terms: Sequence[Array], runs: Sequence[FeatureRun]) -> LinearMap:
    """Fit both targets on the terms of `runs` by ordinary least squares.

    A target that no run carries gets zero coefficients: no correction is made that was not learnt.
    """
    centre, scale = standardisation(terms, runs)
    coefficients, intercept = np.zeros((len(centre), 2)), np.zeros(2)
    for column, target in enumerate(TARGETS):
        rows = target_rows(terms, runs, target)
        if rows is not None:
            coefficients[:, column], intercept[column] = solve_least_squares(rows, centre, scale)
    return LinearMap(centre, scale, coefficients, intercept)


def fit_ridge(terms: Sequence[Array], runs: Sequence[FeatureRun], ridges: Sequence[float]) -> list[LinearMap]:
    """Fit both targets once for each penalty of `ridges`, as `fit_ordinary` does without one.

    The penalty is relative: `ridge` times the row count, on standardised terms, not on the intercept.
    """
    centre, scale = standardisation(terms, runs)
    maps = [LinearMap(centre, scale, np.zeros((len(centre), 2)), np.zeros(2)) for _ in ridges]
    for column, target in enumerate(TARGETS):
        rows = target_rows(terms, runs, target)
        if rows is None:
            continue
        inner, mean_terms, values, mean_target = _centred(rows, centre, scale)
        normal, cross = inner.T @ inner, inner.T @ values
        for ridge, fitted in zip(ridges, maps, strict=True):
            coefficients = np.linalg.solve(normal + ridge * len(values) * np.eye(len(centre)), cross)
            fitted.coefficients[:, column] = coefficients
            fitted.intercept[column] = mean_target - float(mean_terms @ coefficients)
    return maps


def in_reference(run: FeatureRun) -> NDArray[np.bool_]:
    """Return which steps lie in the run's reference window, shape (n,)."""
    return np.asarray((run.time_s >= run.reference[0]) & (run.time_s < run.reference[1]))


def anchored_errors(predictions: Sequence[Prediction], runs: Sequence[FeatureRun], target: str) -> Array:
    """Return target minus prediction on the rows with weight of the runs that carry the target, run after run.

    Both count from the mean over the run's reference window. Empty where no run carries the target.
    """
    errors = [np.empty(0)]
    for prediction, run in zip(predictions, runs, strict=True):
        if (values := getattr(run, target)) is not None:
            error = values - getattr(prediction, target)
            usable = run.weight > 0
            window = usable & in_reference(run)
            errors.append(error[usable] - (error[window].mean() if window.any() else 0.0))
    return np.concatenate(errors)


def target_noise(runs: Sequence[FeatureRun]) -> dict[str, float]:
    """Return the noise (1 sigma) of each target the runs carry, without a model; at least 1e-6 of its spread.

    From second differences of rows 100 s apart, which 100 s means make independent: white noise has 6 times its
    variance in them. Their median, since a shock's curvature is in few; a normal's median magnitude is 0.6745.
    """
    noise = {}
    for target in TARGETS:
        carried = [(getattr(run, target), run) for run in runs if getattr(run, target) is not None]
        rows = [values[run.weight > 0][:: max(1, round(100.0 / run.step_s))] for values, run in carried]
        if not rows or not sum(map(len, rows)):
            continue
        magnitudes = np.abs(np.concatenate([np.diff(values, 2) for values in rows]))
        sigma = float(np.median(magnitudes)) / (0.6745 * np.sqrt(6.0)) if len(magnitudes) else 0.0
        noise[target] = max(sigma, 1e-6 * float(np.std(np.concatenate(rows))), 1e-12)
    return noise
