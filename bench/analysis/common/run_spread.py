"""Linear regression on several runs whose coefficients differ from run to run, all sizes estimated from the runs.

    y_r = X_r (w + u_r) + Z_r v_r + e_r

w: the unit's coefficients, w ~ N(0, L); u_r: what a run has of its own of the same columns, u_r ~ N(0, s^2 L);
v_r: what a run has of its own of other columns (offset, slow drift); e_r: white noise. L is the sum of a few
variances, each times a given shape over the columns. These variances, s and the noise are those of the largest
marginal likelihood (empirical Bayes; Laird and Ware, Biometrics 38, 1982; Tipping, JMLR 1, 2001): what explains
nothing gets a variance of nothing. The cost of a step does not grow with the rows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

PRIOR_SPREAD, PRIOR_LOG_SD = 0.1, 1.0
"""Before any run is seen: coefficients of one unit lie 10 % apart, within a factor of 7 with 95 %."""
_LEAST_SPREAD, _MOST_SPREAD = 0.003, 2.0
_LEAST_SHARE, _MOST_SHARE = 1e-9, 25.0
"""Bounds of a column's variance, in parts of that of the outputs."""
_LEAST_NOISE, _MOST_NOISE = 1e-4, 2.0
"""Bounds of the noise; with variances of columns a hundred thousand times as large ten digits are left."""
_START_SHARE, _START_OWN = 0.03, 0.01
_STEPS = 200


@dataclass(frozen=True, eq=False)
class RunSpread:
    """What was found. `coefficients` (p,), w; their `covariance` (p, p); `prior` (p,), L; `own` (q,), of v_r.

    `apart` (p, p): the covariance of u_r, from what the fitted runs show of it; it is worth one degree of freedom
    less than there are runs. `noise`: variance of a row. `information` (p, p): what one more run like the mean of
    those fitted tells of w.
    """

    coefficients: Array
    covariance: Array
    prior: Array
    apart: Array
    own: Array
    noise: float
    information: Array

    def covariance_after(self, more: float) -> Array:
        """Return the covariance of the coefficients, (p, p), after so many more runs; infinity: zero."""
        if not np.isfinite(more):
            return np.zeros_like(self.covariance)
        root = np.sqrt(self.prior)
        # between roots of the prior, whose inverse has no bound
        inner = np.linalg.inv(self.covariance / np.outer(root, root))
        inner += more * root[:, None] * self.information * root
        return np.asarray(root[:, None] * np.linalg.solve(inner, np.diag(root)))


def fit_run_spread(
    columns: Sequence[Array],
    own_columns: Sequence[Array],
    outputs: Sequence[Array],
    shares: Array,
    own_shares: Array,
    start: Array | None = None,
) -> RunSpread:
    """Fit runs of `columns` (n_r, p), `own_columns` (n_r, q) and `outputs` (n_r,), less their common mean.

    `shares` (groups, p), `own_shares` (own groups, q): the variance of a column is the sum of the groups'
    variances times its shares of them. `start` (groups,): where the search for these variances begins, in parts
    of the usual; of groups that can stand for each other the larger one explains more. ConfigurationError for
    outputs that do not change.
    """
    size = float(np.mean([np.var(output) for output in outputs]))
    if not size > 0.0:
        raise ConfigurationError(
            "the output does not change: there is nothing to fit",
            where="regression with a spread from run to run",
            found=f"variance {size:g}",
            expected="the output of a gyro",
        )
    scale = np.sqrt(size)
    problem = _Problem(columns, own_columns, [output / scale for output in outputs], shares, own_shares)
    point = problem.solved(np.ones(len(shares)) if start is None else start)
    found = problem.at(point)
    apart = problem.apart(point, found)
    return RunSpread(
        scale * found.coefficients,
        size * found.covariance,
        size * found.prior,
        size * apart,
        size * found.varying[len(found.prior) :],
        float(size * np.exp(point[-1])),
        found.information.mean(axis=0) / size,
    )


@dataclass(frozen=True, eq=False)
class _Point:
    """A solution for given variances; `information` (runs, p + q, p + q), `pull` (runs, p + q)."""

    coefficients: Array
    covariance: Array
    prior: Array
    varying: Array
    whole: Array
    pull: Array
    log_determinant: float

    @property
    def information(self) -> Array:
        count = len(self.coefficients)
        return self.whole[:, :count, :count]


class _Problem:
    """The marginal likelihood over log variances: groups, own groups, s squared, noise."""

    def __init__(
        self,
        columns: Sequence[Array],
        own_columns: Sequence[Array],
        outputs: Sequence[Array],
        shares: Array,
        own_shares: Array,
    ) -> None:
        self.shares, self.own_shares, self.outputs = shares, own_shares, outputs
        self.count, self.own_count = len(shares), len(own_shares)
        self.rows = [np.column_stack(pair) for pair in zip(columns, own_columns, strict=True)]
        self.products = [rows.T @ rows for rows in self.rows]
        self.right = [rows.T @ output for rows, output in zip(self.rows, outputs, strict=True)]

    def solved(self, first: Array) -> Array:
        """Return the log variances of the largest marginal likelihood from a start, `first` of the usual."""
        start = np.log(
            [*(_START_SHARE * first), *[_START_OWN] * self.own_count, PRIOR_SPREAD**2, _START_SHARE]
        )
        sizes = (np.log(_LEAST_SHARE), np.log(_MOST_SHARE))
        bounds = [sizes] * (self.count + self.own_count)
        bounds += [
            (2.0 * np.log(_LEAST_SPREAD), 2.0 * np.log(_MOST_SPREAD)),
            (np.log(_LEAST_NOISE), np.log(_MOST_NOISE)),
        ]
        options = {"maxiter": _STEPS, "ftol": 3e-6, "gtol": 1e-6}
        return np.asarray(
            minimize(self.loss, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options).x
        )

    def at(self, point: Array) -> _Point:
        """Return coefficients and what they come from; per run by Woodbury's identity, then over the runs."""
        prior = np.exp(point[: self.count]) @ self.shares
        own = np.exp(point[self.count : -2]) @ self.own_shares
        noise = float(np.exp(point[-1]))
        varying = np.concatenate([np.exp(point[-2]) * prior, own])
        root, p = np.sqrt(varying), len(prior)
        determinant = 0.0
        whole, pull = [], []
        for products, right, output in zip(self.products, self.right, self.outputs, strict=True):
            factor = cho_factor(np.eye(len(root)) + root[:, None] * products * root / noise, lower=True)
            determinant += 2.0 * float(np.log(np.diag(factor[0])).sum()) + len(output) * np.log(noise)
            scaled = root[:, None] * products / noise
            solved = cho_solve(factor, np.column_stack([scaled, root * right / noise]))
            whole.append(products / noise - scaled.T @ solved[:, :-1])
            pull.append(right / noise - scaled.T @ solved[:, -1])
        known, pulled = np.array(whole), np.array(pull)
        root = np.sqrt(prior)
        information = known[:, :p, :p].sum(axis=0)
        factor = cho_factor(np.eye(p) + root[:, None] * information * root, lower=True)
        determinant += 2.0 * float(np.log(np.diag(factor[0])).sum())
        coefficients = root * cho_solve(factor, root * pulled[:, :p].sum(axis=0))
        covariance = root[:, None] * cho_solve(factor, np.diag(root))
        return _Point(coefficients, covariance, prior, varying, known, pulled, determinant)

    def apart(self, point: Array, found: _Point) -> Array:
        """Return the covariance of u_r, (p, p), from what the runs show of it and what they leave open.

        Second moments of its posterior over the runs (the E step of an EM), squares over one less than the runs.
        """
        p, runs = len(found.prior), len(self.outputs)
        variance = np.exp(point[-2]) * found.prior
        shown, open_to = np.zeros((p, p)), np.zeros((p, p))
        for whole, pull in zip(found.whole, found.pull, strict=True):
            inner = whole[:p, :p]
            mean = variance * (pull[:p] - inner @ found.coefficients)
            shown += np.outer(mean, mean)
            told = inner - inner @ found.covariance @ inner
            open_to += np.diag(variance) - variance[:, None] * told * variance
        return shown / max(runs - 1, 1) + open_to / runs

    def loss(self, point: Array) -> tuple[float, Array]:
        """Return minus the log of marginal likelihood and prior of s, over the rows, and its gradient."""
        found = self.at(point)
        p, noise, spread2 = len(found.prior), float(np.exp(point[-1])), float(np.exp(point[-2]))
        quadratic = noise_slope = 0.0
        squares, sizes = np.zeros(len(found.varying)), np.zeros(len(found.varying))
        common = np.zeros(p)
        for whole, pull, rows, output in zip(found.whole, found.pull, self.rows, self.outputs, strict=True):
            left = pull - whole[:, :p] @ found.coefficients
            shared = whole[:, :p] @ found.covariance
            common += left[:p]
            squares += left**2
            sizes += np.diag(whole) - np.einsum("ij,ij->i", shared, whole[:, :p])
            dual = (output - rows[:, :p] @ found.coefficients - rows @ (found.varying * left)) / noise
            quadratic += float(output @ dual)
            twice = (whole - whole @ (found.varying[:, None] * whole)) / noise
            trace = (len(output) - float(found.varying @ np.diag(whole))) / noise
            trace -= float(np.einsum("ij,ji->", found.covariance, twice[:p, :p]))
            noise_slope += 0.5 * (trace - float(dual @ dual)) * noise
        total = found.whole[:, :p, :p].sum(axis=0)
        certain = np.diag(total) - np.einsum("ij,ij->i", total @ found.covariance, total)
        own_run = 0.5 * (sizes - squares)
        slope = 0.5 * (certain - common**2) + spread2 * own_run[:p]
        off = (0.5 * point[-2] - np.log(PRIOR_SPREAD)) / PRIOR_LOG_SD
        gradient = np.concatenate(
            [
                np.exp(point[: self.count]) * (self.shares @ slope),
                np.exp(point[self.count : -2]) * (self.own_shares @ own_run[p:]),
                [float(spread2 * own_run[:p] @ found.prior + 0.5 * off / PRIOR_LOG_SD), noise_slope],
            ]
        )
        count = sum(map(len, self.outputs))
        return 0.5 * (found.log_determinant + quadratic + off**2) / count, gradient / count
