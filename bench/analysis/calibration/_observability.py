"""Observability degree: what of each state the velocities show, from one QR factorisation.

The paper defines the degree of state i as beta_i = || part of column i of Q that is orthogonal to all others ||,
found from null spaces. It equals 1 / || row i of the pseudo-inverse of Q || where unit vector i is in the row
space of Q, and 0 otherwise: there the pseudo-inverse alone misleads, hence the rank test. For white noise
beta_i = sigma_v / sqrt(CRLB_ii). The velocity error of a real navigator is an integrated random walk, so the
degree is a screening figure; the Kalman gain ratio (prior over posterior sigma) is the one to design with.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bench.analysis.calibration._conventions import Task
from drivers.base.arrays import Array

RANK_TOLERANCE = 1e-9
_SEEN_TOLERANCE = 1e-6


@dataclass(frozen=True, eq=False)
class Observability:
    """Degrees by state, shape (30,): `degree` in 1/SI unit, `normalised` = prior sigma / white-noise sigma."""

    degree: Array
    normalised: Array
    rank: int


def observability(q: Array, task: Task, tolerance: float = RANK_TOLERANCE) -> Observability:
    """Return the degrees of Q (m, 30); singular values below `tolerance` of the largest count as zero."""
    scaled = q * (task.prior_sigma / task.noise.velocity_mps)
    _, singular, right = np.linalg.svd(np.linalg.qr(scaled, mode="r"))
    rank = int(np.sum(singular > tolerance * singular[0]))
    # Row i of the pseudo-inverse is right[:rank, i] / singular @ left^T, and the left vectors are orthonormal.
    inverse_norm = np.sqrt(np.sum((right[:rank] / singular[:rank, None]) ** 2, axis=0))
    seen = np.linalg.norm(right[rank:], axis=0) < _SEEN_TOLERANCE
    normalised = np.where(seen, 1.0 / np.maximum(inverse_norm, np.finfo(float).tiny), 0.0)
    return Observability(
        degree=normalised * task.noise.velocity_mps / task.prior_sigma,
        normalised=normalised,
        rank=rank,
    )
