"""A model common to a batch of units, and what each unit's own runs say beside it.

    y = Z (beta + delta) + constant of the run + error,   delta ~ N(0, diag(variance)) from unit to unit

Z are the terms of a model on all runs of the batch, turned to their principal components: there each
component has its own size in the drift, whatever the terms share. `beta`, the variances and the error's are
found by expectation and maximisation (Laird and Ware 1982); a component in which units do not differ gets no
variance and so no correction. A unit's delta is its expectation given its own runs: without one it is zero.
Errors of a model go on for hours, so rows say less than their number: by how much (`inflation`) is chosen by
units left out, each predicted with one run of its own. Where own runs do not help, no correction is taken.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np

from bench.analysis.thermal._anchor import anchor_runs, room_c
from bench.analysis.thermal._features import WINDOW_S
from bench.analysis.thermal._registry import new_model
from bench.analysis.thermal._regression import (
    TARGETS,
    LinearMap,
    MappedModel,
    anchored_errors,
    in_reference,
    standardisation,
)
from bench.analysis.thermal._types import FeatureRun, Prediction
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

LEAST_UNITS = 3
"""Two units say nothing of how a third one differs."""
INFLATIONS = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0, np.inf)
"""Tried for each target; the last is no correction at all."""
ANY_UNIT = ""
"""Unit id of the common compensation, which no unit is refused."""
_ROUNDS = 300
_LEAST_VARIANCE = 1e-12
"""Of components and of prior variances, in parts of the largest: below it arithmetic is all there is."""

Units = Mapping[str, Sequence[FeatureRun]]


@dataclass(frozen=True)
class Moments:
    """Of rows (n, k), each run's counted from its mean: Z'Z (k, k), Z'y (k,), y'y, and how many rows they are
    worth."""

    terms: Array
    cross: Array
    square: float
    rows: float

    def __add__(self, other: Moments) -> Moments:
        """Return the moments of both runs' rows."""
        return Moments(
            self.terms + other.terms,
            self.cross + other.cross,
            self.square + other.square,
            self.rows + other.rows,
        )

    def turned(self, rotation: Array) -> Moments:
        """Return the moments of Z @ rotation."""
        return replace(self, terms=rotation.T @ self.terms @ rotation, cross=rotation.T @ self.cross)


@dataclass(frozen=True)
class Prior:
    """What a batch says of one target before a unit has runs: `rotation` (terms, k), `mean` and `variance`
    (k,) of the coefficients of components, the error's variance `noise` and by how much it is taken
    larger."""

    rotation: Array
    mean: Array
    variance: Array
    noise: float
    inflation: float = np.inf

    def coefficients(self, own: Moments | None) -> Array:
        """Return a unit's coefficients of standardised terms, (terms,), given the moments of its own runs."""
        return np.asarray(self.rotation @ (self.mean + self._own(own)[0]))

    def determined(self, own: Moments | None) -> float:
        """Return how many numbers the unit's own runs decide: 0 where the batch decides all of them."""
        return self._own(own)[1]

    def _own(self, own: Moments | None) -> tuple[Array, float]:
        if own is None or np.isinf(self.inflation):
            return np.zeros(len(self.mean)), 0.0
        own = own.turned(self.rotation)
        delta, spread = _expected(own.terms, own.cross, self.mean, self.variance, self.noise * self.inflation)
        free = self.variance > 0.0
        return delta, float(np.sum(1.0 - np.diag(spread)[free] / self.variance[free]))


@dataclass(frozen=True)
class BatchFit:
    """The common model: `basis` gives the terms, `priors` what coefficients are, by target that the batch
    carries.

    `reference_run`: the run whose reference window is where the drift of a unit without runs is zero.
    """

    basis: MappedModel
    priors: Mapping[str, Prior]
    reference_run: FeatureRun

    def model(self, own: Sequence[FeatureRun]) -> MappedModel:
        """Return the model of a unit with its own runs, or the common one: a model as any other fit makes
        it."""
        fitted, _ = self.basis.fitted()
        coefficients = np.zeros_like(fitted.coefficients)
        for column, target in enumerate(TARGETS):
            if target in self.priors:
                coefficients[:, column] = self.priors[target].coefficients(self.moments(own, target))
        made = copy.copy(self.basis)
        made.map = LinearMap(fitted.centre, fitted.scale, coefficients, np.zeros(2))
        room = room_c(self.reference_run)
        # The drift is zero at the batch's reference temperature, or as near to it as the unit has been.
        at = min(own or [self.reference_run], key=lambda run: abs(room_c(run) - room))
        zero = made.map.apply(made.run_terms(at))[in_reference(at)].mean(axis=0)
        made.map = replace(made.map, intercept=-zero)
        return made

    def moments(self, runs: Sequence[FeatureRun], target: str) -> Moments | None:
        """Return the moments of the runs that carry a target; None if none does."""
        return _sum([_moments(self.basis, run, target) for run in runs if getattr(run, target) is not None])

    def determined(self, own: Sequence[FeatureRun]) -> dict[str, float]:
        """Return how many numbers of each target a unit's own runs decide."""
        return {name: prior.determined(self.moments(own, name)) for name, prior in self.priors.items()}


@dataclass(frozen=True)
class LeftUnits:
    """What a batch predicts of units left out of it: for each target its runs with their predictions, and the
    mean over units of what is left over what was there; without runs of their own, and with one by each
    inflation."""

    without: Mapping[str, list[tuple[FeatureRun, Prediction]]]
    with_one: Mapping[str, Mapping[float, list[tuple[FeatureRun, Prediction]]]]

    def score(self, target: str, inflation: float | None = None) -> float:
        """Return left over raw, root mean squares over the units' runs; `inflation` None: without own
        runs."""
        pairs = self.without[target] if inflation is None else self.with_one[target][inflation]
        return float(np.mean([_left_over_raw(run, prediction, target) for run, prediction in pairs]))

    def inflation(self, target: str) -> float:
        """Return the inflation that leaves least."""
        return min(INFLATIONS, key=lambda value: self.score(target, value))


def require_batch(units: Units) -> None:
    """Raise ConfigurationError for too few units, or units with too few runs of a kind."""
    for target in TARGETS:
        counts = {unit: sum(getattr(run, target) is not None for run in runs) for unit, runs in units.items()}
        able = [unit for unit, count in counts.items() if count >= 2]
        if any(counts.values()) and len(able) < LEAST_UNITS:
            kind = "bias runs" if target == "bias_dph" else "scale-factor groups"
            raise ConfigurationError(
                f"too few units with two {kind} for a model common to a batch",
                where="fit of a batch",
                found=", ".join(f"{unit}: {count}" for unit, count in counts.items()),
                expected=f"two {kind} of each of {LEAST_UNITS} units or more",
                remedy="add runs, or fit each unit on its own runs",
            )


def fit_batch(units: Units, name: str, started: MappedModel | None = None) -> BatchFit:
    """Return the common model of a batch on the terms of the model `name`; `started`: one of nearly the same
    runs.

    Inflations are infinite: `leave_units_out` says which to take. ConfigurationError for a model that is no
    linear map.
    """
    rooms = [room_c(run) for runs in units.values() for run in runs]
    room = float(np.median(rooms))
    # Every unit's runs count from the same reference temperature; then they are fitted as if of one unit.
    anchored = [run for runs in units.values() for run in anchor_runs(runs, reference_temp_c=room)]
    pooled = [replace(run, unit_id=ANY_UNIT) for run in anchored]
    basis = _basis(name, started, pooled)
    priors = {}
    for target in TARGETS:
        own = [_sum([_moments(basis, run, target) for run in runs if getattr(run, target) is not None])
               for runs in units.values()]  # fmt: skip
        if carried := [moments for moments in own if moments is not None]:
            priors[target] = fit_prior(carried)
    return BatchFit(basis, priors, min(pooled, key=lambda run: abs(room_c(run) - room)))


def fit_prior(units: Sequence[Moments]) -> Prior:
    """Return mean, variances and noise of coefficients, from the moments of units (at least two)."""
    total = _sum(units)
    assert total is not None
    values, vectors = np.linalg.eigh(total.terms / total.rows)
    kept = values > _LEAST_VARIANCE * values[-1]
    rotation = vectors[:, kept] / np.sqrt(values[kept])
    turned = [unit.turned(rotation) for unit in units]
    whole = total.turned(rotation)
    mean = np.asarray(np.linalg.solve(whole.terms, whole.cross))
    # To begin with units differ by as much as the coefficients are large, and half of what is left is noise.
    variance = np.asarray(np.maximum(mean**2, np.mean(mean**2) * 1e-3))
    noise = 0.5 * max(whole.square - float(mean @ whole.cross), _LEAST_VARIANCE * whole.square) / whole.rows
    terms, cross = np.stack([unit.terms for unit in turned]), np.stack([unit.cross for unit in turned])
    square = sum(unit.square for unit in turned)
    for _ in range(_ROUNDS):
        delta, spread = _expected(terms, cross, mean, variance, noise)
        mean = np.asarray(np.linalg.solve(whole.terms, np.sum(cross - _times(terms, delta), axis=0)))
        variance = np.asarray(np.mean(delta**2 + np.diagonal(spread, axis1=1, axis2=2), axis=0))
        own = mean + delta
        # the expected sum of squares that they leave
        left = square + float(np.sum(own * (_times(terms, own) - 2.0 * cross)) + np.sum(terms * spread))
        noise = max(left, _LEAST_VARIANCE * whole.square) / whole.rows
    return Prior(rotation, mean, variance, noise)


def leave_units_out(units: Units, name: str, whole: BatchFit) -> LeftUnits:
    """Return what fits without each unit predict of its runs, each run with the unit's next one as its
    own."""
    without: dict[str, list[tuple[FeatureRun, Prediction]]] = {target: [] for target in whole.priors}
    with_one: dict[str, dict[float, list[tuple[FeatureRun, Prediction]]]] = {
        target: {value: [] for value in INFLATIONS} for target in whole.priors
    }
    for unit, runs in units.items():
        rest = fit_batch({other: of for other, of in units.items() if other != unit}, name, whole.basis)
        for target, prior in rest.priors.items():
            carried = [run for run in runs if getattr(run, target) is not None]
            common = rest.model(())
            for number, run in enumerate(carried):
                without[target].append((run, common.predict(run)))
                if len(carried) < 2:
                    continue
                own = [carried[(number + 1) % len(carried)]]
                for value in INFLATIONS:
                    fit = replace(rest, priors={**rest.priors, target: replace(prior, inflation=value)})
                    with_one[target][value].append((run, fit.model(own).predict(run)))
    return LeftUnits(without, with_one)


def _basis(name: str, started: MappedModel | None, pooled: Sequence[FeatureRun]) -> MappedModel:
    unfitted = getattr(started, "unfitted", None)
    made = unfitted() if unfitted is not None else new_model(name)
    if not isinstance(made, MappedModel):
        raise ConfigurationError(
            f"the model {name!r} cannot be common to a batch",
            where="fit of a batch",
            expected="one linear in its terms: poly3, multilinear, lag_ridge, lag_ridge_x_temp, grey_box",
            remedy="name such a one with --models",
        )
    made.fit(pooled, ())
    fitted, step_s = made.fitted()
    terms = [made.run_terms(run) for run in pooled]
    centre, scale = standardisation(terms, pooled)
    made.map, made.step_s = replace(fitted, centre=centre, scale=scale), step_s
    return made


def _moments(basis: MappedModel, run: FeatureRun, target: str) -> Moments:
    """Moments of a run that carries the target; rows nearer than the window of the means count for one."""
    fitted, step_s = basis.fitted()
    used = run.weight > 0
    terms = ((basis.run_terms(run) - fitted.centre) / fitted.scale)[used]
    values = cast(Array, getattr(run, target))[used]
    terms, values = terms - terms.mean(axis=0), values - values.mean()
    share = step_s / WINDOW_S
    return Moments(
        share * terms.T @ terms, share * terms.T @ values, share * float(values @ values), share * len(values)
    )


def _sum(moments: Sequence[Moments]) -> Moments | None:
    total: Moments | None = None
    for each in moments:
        total = each if total is None else total + each
    return total


def _expected(terms: Array, cross: Array, mean: Array, variance: Array, noise: float) -> tuple[Array, Array]:
    """Return deltas (..., k) of units with moments `terms` (..., k, k) and `cross` (..., k) and covariances.

    Written so that a variance of zero gives zero.
    """
    root = np.sqrt(variance)
    inner = np.eye(len(root)) + root[:, None] * terms * root / noise
    spread = root[:, None] * np.linalg.inv(inner) * root
    return _times(spread, cross - terms @ mean) / noise, spread


def _times(matrices: Array, vectors: Array) -> Array:
    """Return products of matrices (..., k, k) and vectors (..., k)."""
    return np.asarray((matrices @ vectors[..., None])[..., 0])


def _left_over_raw(run: FeatureRun, prediction: Prediction, target: str) -> float:
    error = anchored_errors([prediction], [run], target)
    raw = getattr(run, target)[run.weight > 0]
    return float(np.sqrt(np.mean(error**2) / np.mean(raw**2)))
