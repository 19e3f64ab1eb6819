"""What a run that has not been made would tell: expected information about which explanation is true, in nats.

Each explanation foretells the run as a Gaussian: the mean that its fitted effects give, the spread of an effect
of unknown size, white noise after whitening. The mutual information between explanation and data is bounded from
below by pairwise Bhattacharyya distances (Kolchinsky and Tracey, Entropy 19, 361, 2017, eq. 10). All distances
follow from the run's Gram matrix of the effects' columns, the nominal model's own taken out.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._fit import DIRECTIONS, MISFIT
from drivers.base.arrays import Array


@dataclass(frozen=True, eq=False)
class Foretold:
    """How an explanation foretells a run: `mean` (p,) of the coefficients, `sigmas` (p,) their spread."""

    probability: float
    mean: Array
    sigmas: Array

    @property
    def spread(self) -> NDArray[np.int64]:
        """Columns of unknown size."""
        return np.flatnonzero(self.sigmas > 0.0)


def expected_information(gram: Array, explanations: Sequence[Foretold]) -> float:
    """Return the least information that a run of this Gram matrix (p, p) is expected to give, in nats."""
    weights = np.array([each.probability for each in explanations])
    weights = weights / weights.sum()
    count = len(explanations)
    roots = [_root(each) for each in explanations]
    log_volumes = [_log_volume(gram, root) for root in roots]
    near = np.eye(count)
    for i in range(count):
        for j in range(i):
            root = np.concatenate((roots[i], roots[j]), axis=1) / math.sqrt(2.0)
            apart = explanations[i].mean - explanations[j].mean
            distance = _bhattacharyya(gram, apart, root, 0.5 * (log_volumes[i] + log_volumes[j]))
            near[i, j] = near[j, i] = math.exp(-distance)
    return float(-(weights @ np.log(near @ weights)))


def expected_if(gram: Array, explanations: Sequence[Foretold], true: int) -> Array:
    """Return the probabilities (m,) of explanations that a run is expected to leave if one of them is true.

    Each loses the mean log odds that the run gives against it: the Kullback-Leibler divergence of the true one's
    prediction, at its fitted size, from its own, less that from the true one's with its spread.
    """
    lost = np.zeros(len(explanations))
    for index, each in enumerate(explanations):
        root = _root(each)
        inner = np.eye(root.shape[1]) + root.T @ gram @ root
        square = _apart(gram, explanations[true].mean - each.mean, root, inner)
        shrunk = root.shape[1] - float(np.trace(np.linalg.inv(inner)))
        lost[index] = 0.5 * (square + float(np.linalg.slogdet(inner)[1]) - shrunk)
    weights = np.array([each.probability for each in explanations]) * np.exp(
        -np.maximum(lost - lost[true], 0.0)
    )
    return np.asarray(weights / weights.sum())


def deflection(gram: Array, mean: Array) -> float:
    """Return the norm of a foretold mean in a run, in standard deviations of its noise."""
    return math.sqrt(max(float(mean @ gram @ mean), 0.0))


def _root(explanation: Foretold) -> Array:
    """Return a root (p, k) of the covariance of an explanation's coefficients."""
    spread = explanation.spread
    root = np.zeros((len(explanation.mean), len(spread)))
    root[spread, np.arange(len(spread))] = explanation.sigmas[spread]
    return root


def _log_volume(gram: Array, root: Array) -> float:
    """Return the log determinant of the covariance I + X R R' X', X' X being the Gram matrix."""
    inner = np.eye(root.shape[1]) + root.T @ gram @ root
    return float(np.linalg.slogdet(inner)[1])


def _bhattacharyya(gram: Array, apart: Array, root: Array, log_volume: float) -> float:
    """Return the distance of two predictions whose means are `apart`.

    `root`: of the mean of their covariances; `log_volume`: the mean of theirs.
    """
    inner = np.eye(root.shape[1]) + root.T @ gram @ root
    square = _apart(gram, apart, root, inner)
    return 0.125 * square + 0.5 * max(float(np.linalg.slogdet(inner)[1]) - log_volume, 0.0)


def _apart(gram: Array, apart: Array, root: Array, inner: Array) -> float:
    """Return the square of the distance of two means in units of a spread, `inner` = I + R' X' X R.

    A formula misses up to a quarter of a real effect's amplitude, in a few directions: what tells the means
    apart counts only as far as that leaves.
    """
    across = root.T @ gram @ apart
    square = max(float(apart @ gram @ apart - across @ np.linalg.solve(inner, across)), 0.0)
    return square / (1.0 + MISFIT**2 * square / DIRECTIONS)
