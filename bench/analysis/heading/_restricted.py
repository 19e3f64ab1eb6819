"""Linear regression with noise that remembers: restricted maximum likelihood on hourly means.

The size of the noise is taken at its best; its form (how long it remembers, how much of it is white) is tried
on a grid and judged by the restricted likelihood, which does not favour forms that the columns have eaten up
(Patterson and Thompson, Biometrika 58, 1971).
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.linalg import solve_triangular

from drivers.base.arrays import Array

HOUR_S = 3600.0
_TIMES_H = (20.0, 1.0, 2.5, 5.0, 10.0, 40.0, 80.0, 160.0)
_WHITE = (1e-2, 1e-6, 1e-4, 1e-3, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 100.0)
FORMS = tuple(product((HOUR_S * hours for hours in _TIMES_H), _WHITE))
"""(time of the Markov process s, white variance against its variance) that are tried."""


@dataclass(frozen=True, eq=False)
class Restricted:
    """A regression: `solution` (k,), and `root` (k, k), upper: its covariance is variance (R^T R)^-1.

    `square`: whitened residuals squared and summed; `logs`: the log determinants of the restricted likelihood;
    `freedom`: rows less columns.
    """

    solution: Array
    root: Array
    square: float
    logs: float
    freedom: int

    @classmethod
    def fit(cls, rows: Array, values: Array, covariance: Array) -> Restricted:
        """Fit `values` (n,) by `rows` (n, k) with noise of `covariance` (n, n), up to its size."""
        lower = np.linalg.cholesky(covariance)
        white = solve_triangular(lower, np.column_stack([rows, values]), lower=True)
        basis, root = np.linalg.qr(white[:, :-1])
        seen = basis.T @ white[:, -1]
        return cls(
            solution=np.asarray(solve_triangular(root, seen)),
            root=root,
            square=float(white[:, -1] @ white[:, -1] - seen @ seen),
            logs=2.0 * float(np.sum(np.log(np.diag(lower))) + np.sum(np.log(np.abs(np.diag(root))))),
            freedom=len(rows) - rows.shape[1],
        )

    @property
    def cost(self) -> float:
        """-2 log of the restricted likelihood, but for a constant."""
        return self.freedom * float(np.log(self.square / self.freedom)) + self.logs

    @property
    def covariance(self) -> Array:
        """Covariance of the solution, (k, k)."""
        inverse = np.linalg.inv(self.root)
        return np.asarray(inverse @ inverse.T * self.square / self.freedom)


def markov_after_lag(time_s: Array, room_s: float, white: float, lag_s: float = 1.0) -> Array:
    """Return the covariance (n, n) of a first-order Markov process seen through a lag, of variance 1, and white.

    The two poles a and b make (a exp(-t / a) - b exp(-t / b)) / (a - b); with a lag of a second it is the
    process.
    """
    apart_s = np.abs(time_s[:, None] - time_s[None, :])
    slow_s = (
        room_s if abs(room_s / lag_s - 1.0) > 1e-3 else 1.001 * lag_s
    )  # equal poles: the limit from beside it
    seen = slow_s * np.exp(-apart_s / slow_s) - lag_s * np.exp(-apart_s / lag_s)
    return np.asarray(seen / (slow_s - lag_s) + white * np.eye(len(time_s)))


def hourly(time_s: Array, columns: Array) -> Array:
    """Return means of an hour of [time, columns], (hours, 1 + k); hours with half of the usual samples or more.

    Rows (n, k) with a value that is not finite are left out. Time counts from `time_s[0]`.
    """
    good = np.isfinite(columns).all(axis=1)
    since_s = time_s[good] - time_s[0]
    if not len(since_s):
        return np.empty((0, 1 + columns.shape[1]))
    hour = np.floor(since_s / HOUR_S).astype(np.int64)
    count = np.bincount(hour).astype(np.float64)
    full = count >= 0.5 * np.median(count[count > 0.0])
    sums = [np.bincount(hour, weights=column)[full] for column in (since_s, *columns[good].T)]
    return np.asarray(np.column_stack(sums) / count[full, None])
