"""How far off a prediction may be: intervals that hold 95 % of what was measured, from the runs left out.

half width = (base + per_rate |dT/dt| + per_gradient |gradient|) (1 + 10 excess)

The three coefficients are a non-negative fit to the magnitude of errors on runs that the model was not fitted on.
Their common factor is such that 95 % of the errors of a further run are inside, on average over what that run may
be like: within a run errors are taken as normal; the logarithm of their size differs from run to run as it does
among those left out, by Student's distribution, these being few (the predictive distribution of a normal sample).
Runs that agree give a narrow interval, four that do not a wide one. `excess`: how far the inputs are outside of
the training runs, in parts of their range; no run says what errors are there, so a tenth of it doubles the width.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from scipy.optimize import brentq, nnls
from scipy.special import erf, erfinv, stdtrit

from bench.analysis.thermal._regression import TARGETS, anchored_errors
from bench.analysis.thermal._stream import FEATURES, Interval
from bench.analysis.thermal._types import FeatureRun, Prediction
from drivers.base.arrays import Array

LEVEL = 0.95
PER_EXCESS = 10.0
LEAST_RANGE = 1e-9
"""An input that did not change in training has this range, so that nothing is divided by zero."""
TERMS = ("dt_60", "gradient")
"""What widens the interval inside of the range, beside its base."""
_CHANCES = 2000


@dataclass(frozen=True, eq=False)
class PredictionWidth:
    """`coefficients` (2, 3): base, per degC/min, per degC of gradient, of bias in deg/h and scale factor in ppm.

    The interval is for means of 100 s, their noise included. `runs`: how many were left out to find it.
    """

    coefficients: Array
    runs: int

    def half_widths(self, features: Array, inputs: Mapping[str, Interval]) -> Array:
        """Return half widths, (..., 4) -> (..., 2), of features in the order of `FEATURES`."""
        low, high = np.array([inputs[name] for name in FEATURES]).T
        beyond = np.maximum(low - features, 0.0) + np.maximum(features - high, 0.0)
        excess = (beyond / np.maximum(high - low, LEAST_RANGE)).sum(axis=-1)
        return np.asarray(_terms(features) @ self.coefficients.T * (1.0 + PER_EXCESS * excess)[..., None])

    def to_state(self) -> dict[str, Any]:
        """Return what a file needs."""
        return {"coefficients": self.coefficients, "runs": self.runs, "level": LEVEL}

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Self:
        """Restore a width; ValueError if it is none."""
        coefficients = np.asarray(state["coefficients"], dtype=np.float64)
        if coefficients.shape != (2, 3) or (coefficients < 0.0).any():
            raise ValueError("coefficients of a prediction width that are none")
        return cls(coefficients, int(state["runs"]))


def fit_width(left_out: Sequence[tuple[FeatureRun, Prediction]]) -> PredictionWidth:
    """Return the width that holds `LEVEL` of the errors of predictions of runs left out of the fit.

    A target that no run carries gets no width.
    """
    coefficients = np.zeros((2, 3))
    for row, target in enumerate(TARGETS):
        carried = [(run, prediction) for run, prediction in left_out if getattr(run, target) is not None]
        if not carried:
            continue
        errors = [np.abs(anchored_errors([prediction], [run], target)) for run, prediction in carried]
        terms = [_terms(_features(run))[run.weight > 0] for run, _ in carried]
        shape = nnls(np.concatenate(terms), np.concatenate(errors))[0]
        sizes = np.array(
            [
                np.sqrt(np.mean((error / np.maximum(term @ shape, 1e-12)) ** 2))
                for error, term in zip(errors, terms, strict=True)
            ]
        )
        if not sizes.any():  # all predicted to the last digit
            continue
        coefficients[row] = further_run(sizes[sizes > 0.0]) * shape
    return PredictionWidth(coefficients, len(left_out))


def further_run(sizes: Array) -> float:
    """Return what holds `LEVEL` of the errors of a further run, of runs whose errors have rms `sizes` (n,).

    One run alone does not say how runs differ: the next is taken to be half as large again.
    """
    if len(sizes) == 1:
        return float(1.5 * sizes[0] * np.sqrt(2.0) * erfinv(LEVEL))
    logs, count = np.log(sizes), len(sizes)
    spread = float(logs.std(ddof=1)) * np.sqrt(1.0 + 1.0 / count)
    chances = (np.arange(_CHANCES) + 0.5) / _CHANCES
    further = np.exp(logs.mean() + spread * stdtrit(count - 1, chances))

    def missing(log_width: float) -> float:
        return float(np.mean(erf(np.exp(log_width) / (further * np.sqrt(2.0))))) - LEVEL

    return float(np.exp(brentq(missing, logs.min() - 10.0, logs.max() + 50.0 * (1.0 + spread))))


def _features(run: FeatureRun) -> Array:
    return np.column_stack([getattr(run, name) for name in FEATURES])


def _terms(features: Array) -> Array:
    """Return 1, |dT/dt|, |gradient|, (..., 4) -> (..., 3)."""
    rate, gradient = (features[..., FEATURES.index(name)] for name in TERMS)
    return np.stack([np.ones_like(rate), np.abs(rate), np.abs(gradient)], axis=-1)
