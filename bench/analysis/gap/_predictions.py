"""What explanations foretell of a run: each fitted, beside the nominal parameters, to all that is recorded.

Two explanations that agree on the recorded runs are told apart by a further one only as far as neither, fitted to
that run and the recorded ones together, follows the other. All are linear in their columns: with the columns X of
the recorded runs, whitened, and prior sigmas s, an explanation's coefficients have the covariance
C = (diag(s)^-2 + X' X)^-1 and the mean C X' y. y is what the leading explanation fits: evidence that the recorded
runs give is in the probabilities already. A run's noise is larger where an effect acts, by what its formula may
miss of it: as in the diagnosis of what is recorded.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from bench.analysis.gap._cells import Cell
from bench.analysis.gap._fit import (
    DIRECTIONS,
    MISFIT,
    Solution,
    beside_nominal,
    counts,
    tolerated,
    weighted_gram,
)
from bench.analysis.gap._information import Foretold
from drivers.base.arrays import Array


def tolerant_gram(cells: Sequence[Cell], every: Array, prior_sigmas: Array, effects: Array) -> Array:
    """Return a run's products of [data, nominal, effects' columns], (1 + q + p,) squared, on noise and misfit.

    `every` is the Gram matrix of [data, nominal, effects] in this run and all others, without misfit; `effects`
    (p,) are the coefficients of what acts, of which each formula may miss a quarter beside what the nominal
    parameters (priors (q,)), fitted to all these runs, take.
    """
    q = len(prior_sigmas)
    own = np.flatnonzero(effects) + 1 + q
    acts = Solution(own, effects[own - 1 - q], np.zeros((0, 0)))
    acting = beside_nominal(every, prior_sigmas, acts, own.tolist())
    values = np.zeros(len(every))
    values[acting.indices] = acting.values
    energy = np.array([values[cell.at] @ cell.whitened @ values[cell.at] for cell in cells])
    variance = tolerated(cells, counts(cells) + energy, MISFIT, DIRECTIONS)
    return weighted_gram(cells, variance)


def fitted(
    recorded: Array, sigmas: Array, own: NDArray[np.int64], follows: Array, probability: float
) -> Foretold:
    """Return how an explanation of the columns `own` foretells, fitted where another does what it does.

    `recorded` is the recorded runs' Gram matrix (p, p), zero without any; `sigmas` (p,) are the columns' priors
    and `follows` (p,) the coefficients of the other.
    """
    scale = sigmas[own]
    normal = np.eye(len(own)) + recorded[np.ix_(own, own)] * np.outer(scale, scale)
    lower = np.linalg.cholesky(normal)
    root, mean = np.zeros((len(sigmas), len(own))), np.zeros(len(sigmas))
    root[own] = scale[:, None] * np.linalg.inv(lower).T
    mean[own] = root[own] @ (root[own].T @ (recorded[own] @ follows))
    return Foretold(probability, mean, root)


def log_odds(
    products: Array, sigmas: Array, known: NDArray[np.int64], own: NDArray[np.int64]
) -> tuple[float, float]:
    """Return the log odds that recorded runs give for one more effect beside `known` columns: as it fits, or not.

    `products` (1 + p,) squared are of [data, columns], `sigmas` (p,) the columns' priors, `own` the effect's. The
    odds are those of the marginal likelihoods; the second as if the data were none of the effect.
    """
    both = np.concatenate((known, own))
    scale = sigmas[both]
    normal = np.eye(len(both)) + products[np.ix_(1 + both, 1 + both)] * np.outer(scale, scale)
    data = products[1 + both, 0] * scale
    ends = np.array(
        [float(np.linalg.slogdet(part)[1]) for part in (normal, normal[: len(known), : len(known)])]
    )
    gains = [float(data[:n] @ np.linalg.solve(normal[:n, :n], data[:n])) for n in (len(both), len(known))]
    volume = 0.5 * float(ends[0] - ends[1])
    return 0.5 * (gains[0] - gains[1]) - volume, -volume
