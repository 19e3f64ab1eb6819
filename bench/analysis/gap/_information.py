"""What a run that has not been made would tell: expected information about which explanation is true, in nats.

Each explanation foretells the run as a Gaussian: the mean that its fitted effects give, the spread of an effect
of unknown size, white noise after whitening. The mutual information between explanation and data is bounded from
below by pairwise Bhattacharyya distances and from above by pairwise Kullback-Leibler divergences (Kolchinsky and
Tracey, Entropy 19, 361, 2017, eq. 10 to 12); the mean of both is taken. All distances follow from the run's Gram
matrix of the effects' columns, the nominal model's own taken out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np

from bench.analysis.gap._fit import DIRECTIONS, MISFIT
from drivers.base.arrays import Array


@dataclass(frozen=True, eq=False)
class Foretold:
    """How an explanation foretells a run: `mean` (p,) of the coefficients, `root` (p, k) of their covariance."""

    probability: float
    mean: Array
    root: Array


def expected_information(gram: Array, explanations: Sequence[Foretold]) -> float:
    """Return the information that a run of this Gram matrix (p, p) is expected to give, in nats."""
    return alikeness(gram, explanations).information([each.probability for each in explanations])


@dataclass(frozen=True, eq=False)
class Alikeness:
    """How alike explanations foretell a run, (m, m) from 0 to 1: by pairwise distances, and by divergences."""

    near: Array
    farther: Array

    def information(self, probabilities: Sequence[float]) -> float:
        """Return the information about which is true, in nats; probabilities need not have a sum of 1."""
        weights = np.array(probabilities) / sum(probabilities)
        at = np.flatnonzero(weights)
        own = weights[at]
        bounds = [float(-(own @ np.log(each[np.ix_(at, at)] @ own))) for each in (self.near, self.farther)]
        return 0.5 * sum(bounds)


def alikeness(gram: Array, explanations: Sequence[Foretold]) -> Alikeness:
    """Return how alike explanations foretell a run of this Gram matrix (p, p)."""
    spreads = [_Spread.of(gram, each) for each in explanations]
    count = len(explanations)
    near, farther = np.eye(count), np.eye(count)
    for i, j in product(range(count), repeat=2):
        if i > j:
            near[i, j] = near[j, i] = math.exp(-_bhattacharyya(gram, spreads[i], spreads[j]))
        if i != j:
            farther[i, j] = math.exp(-max(_divergence(gram, spreads[i], spreads[j]), 0.0))
    return Alikeness(near, farther)


def expected_if(gram: Array, explanations: Sequence[Foretold], true: int) -> Array:
    """Return the probabilities (m,) of explanations that a run is expected to leave if one of them is true.

    Each loses the mean log odds that the run gives against it: the Kullback-Leibler divergence of the true one's
    prediction, at its fitted size, from its own, less that from the true one's with its spread.
    """
    fitted = _Spread.of(gram, replace(explanations[true], root=np.zeros((len(gram), 0))))
    lost = np.array([_divergence(gram, fitted, _Spread.of(gram, each)) for each in explanations])
    weights = np.array([each.probability for each in explanations]) * np.exp(
        -np.maximum(lost - lost[true], 0.0)
    )
    return np.asarray(weights / weights.sum())


def deflection(gram: Array, mean: Array) -> float:
    """Return the norm of a foretold mean in a run, in standard deviations of its noise."""
    return math.sqrt(max(float(mean @ gram @ mean), 0.0))


@dataclass(frozen=True, eq=False)
class _Spread:
    """A prediction N(X m, I + X R R' X'): m (p,), R (p, k), and what follows of both with G = X' X.

    `seen` = G R, `inner` = I + R' G R, and the log determinant of that, which is the covariance's.
    """

    mean: Array
    root: Array
    seen: Array
    inner: Array
    log_volume: float

    @classmethod
    def of(cls, gram: Array, explanation: Foretold) -> _Spread:
        """Return that of an explanation."""
        return cls.with_root(gram, explanation.mean, explanation.root)

    @classmethod
    def with_root(cls, gram: Array, mean: Array, root: Array) -> _Spread:
        """Return that of a mean and a root of the coefficients' covariance."""
        seen = gram @ root
        inner = np.eye(root.shape[1]) + root.T @ seen
        return cls(mean, root, seen, inner, float(np.linalg.slogdet(inner)[1]))


def _bhattacharyya(gram: Array, one: _Spread, other: _Spread) -> float:
    """Return the distance of two predictions."""
    root = np.concatenate((one.root, other.root), axis=1) / math.sqrt(2.0)
    between = _Spread.with_root(gram, one.mean, root)
    volume = between.log_volume - 0.5 * (one.log_volume + other.log_volume)
    return 0.125 * _apart(gram, one.mean - other.mean, between) + 0.5 * max(volume, 0.0)


def _divergence(gram: Array, true: _Spread, other: _Spread) -> float:
    """Return the Kullback-Leibler divergence of the `true` prediction from another, in nats."""
    spread = float(np.sum(true.root * true.seen))
    across = other.root.T @ true.seen
    own = other.inner - np.eye(len(other.inner))
    taken = float(np.trace(np.linalg.solve(other.inner, own + across @ across.T)))
    square = _apart(gram, true.mean - other.mean, other)
    return 0.5 * (spread - taken + square + other.log_volume - true.log_volume)


def _apart(gram: Array, apart: Array, spread: _Spread) -> float:
    """Return the square of the distance of two means in units of a spread.

    A formula misses up to a quarter of a real effect's amplitude, in a few directions: what tells the means
    apart counts only as far as that leaves.
    """
    across = spread.seen.T @ apart
    square = max(float(apart @ gram @ apart - across @ np.linalg.solve(spread.inner, across)), 0.0)
    return square / (1.0 + MISFIT**2 * square / DIRECTIONS)
