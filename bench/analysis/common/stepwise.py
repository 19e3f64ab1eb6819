"""Stepwise linear regression by F tests with the sweep operator, every intermediate step kept.

Semantics of MATLAB's stepwise / stepwisefit: the intercept is always in; the term with the smallest p enters if
p < p_enter, else the term with the largest p leaves if p > p_remove; the end is reached when neither happens or a
set of terms recurs. Sweep operator: Goodnight, The American Statistician 33(3), 1979.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import fdtrc

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

PIVOT_TOLERANCE = 1e-10
"""A term cannot enter when the terms in leave less than this fraction of its variance unexplained."""
_EXACT_PIVOT = 1e-3
"""Cross products lose a digit with each power of ten of a pivot: below this terms are orthogonalised instead."""
_LEAST_DIAGONAL = 3e-9
"""Smallest diagonal of the triangle of unit columns: rounding over it is 1e-7, seven digits are left."""
_REFINABLE = 1e-5
"""Diagonals from which correcting by the normal equations converges."""
_CORRECTIONS = 3
_TIE = 1e-6
"""Probabilities as close as this part are equal but for rounding."""


@dataclass(frozen=True)
class StepwiseStep:
    """The regression after one step; arrays of shape (k,) over all candidate terms.

    `action` is "start", "enter" or "remove", `term` the one that moved ("" at the start), `f` and `p` the test
    that moved it. Coefficients, standard errors and p of terms that are out are the values they would have if
    added alone; NaN for a term that cannot enter (collinear or constant). `rmse` is sqrt(SSE / (n - k - 1)).
    """

    action: str
    term: str
    f: float
    p: float
    included: NDArray[np.bool_]
    coefficient: Array
    standard_error: Array
    p_value: Array
    intercept: float
    sse: float
    r2: float
    rmse: float


@dataclass(frozen=True)
class StepwiseResult:
    """The final regression, its statistics table and all steps (the last one is the final regression).

    `f`, `significance_f`: F(k, n-k-1) of the whole regression and its upper tail; 0 and 1 when no term is in.
    Residual diagnostics on the rows that were fitted (the whitened ones if `whitened`): lag-1 correlation,
    Durbin-Watson statistic, effective number of rows n (1 - rho)/(1 + rho). `vif`, shape (k,): variance
    inflation of the terms in, NaN for those out. `whitening_rho` is the correlation removed before the
    selection, 0 if none was.
    """

    names: tuple[str, ...]
    steps: tuple[StepwiseStep, ...]
    n: int
    adjusted_r2: float
    f: float
    significance_f: float
    lag1_correlation: float
    durbin_watson: float
    effective_n: float
    vif: Array
    whitening_rho: float

    @property
    def final(self) -> StepwiseStep:
        """The regression after the last step."""
        return self.steps[-1]

    @property
    def selected(self) -> tuple[str, ...]:
        """Names of the terms in."""
        return tuple(name for name, inside in zip(self.names, self.final.included, strict=True) if inside)

    @property
    def multiple_r(self) -> float:
        """Square root of R2."""
        return float(np.sqrt(max(self.final.r2, 0.0)))  # rounding of no term at all

    def predict(self, x: Array) -> Array:
        """Return the regression's value for terms `x`, shape (n, k) in the order of `names`."""
        inside = self.final.included
        return np.asarray(self.final.intercept + x[:, inside] @ self.final.coefficient[inside])


def stepwise(
    x: Array,
    y: Array,
    *,
    names: Sequence[str] | None = None,
    p_enter: float = 0.05,
    p_remove: float | None = None,
    start: Sequence[str] = (),
    prewhiten: bool = False,
    segments: ArrayLike | None = None,
) -> StepwiseResult:
    """Regress `y` (n,) on the columns of `x` (n, k), choosing terms step by step.

    `p_remove` defaults to max(p_enter, 0.1); `start` names the terms that are in at first. The p-values hold for
    independent residuals only. `prewhiten` removes a lag-1 correlation first (Cochrane-Orcutt with all
    candidates in): drift rows need it, smooth terms are kept at random without. `segments` (n,) labels rows of
    one uninterrupted run, so that neighbours are not sought across runs. ConfigurationError for unusable input.
    """
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    labels = tuple(names) if names is not None else tuple(f"x{i + 1}" for i in range(x.shape[-1]))
    _check(x, y, labels, start)
    p_remove = max(p_enter, 0.1) if p_remove is None else p_remove
    parts = np.zeros(len(y)) if segments is None else np.asarray(segments)
    rho = cochrane_orcutt_rho(x, y, parts) if prewhiten else 0.0
    if prewhiten:
        x, y, parts = _whitened(x, y, parts, rho)
    problem = _Problem(x, y, rho)
    inside = [labels.index(name) for name in start]
    steps = [problem.step("start", "", np.nan, np.nan, inside)]
    visited = {frozenset(inside)}
    while (move := _next_move(steps[-1], p_enter, p_remove)) is not None:
        action, term = move
        before = steps[-1]
        inside = [*inside, term] if action == "enter" else [i for i in inside if i != term]
        if frozenset(inside) in visited:
            break
        visited.add(frozenset(inside))
        with np.errstate(divide="ignore"):  # a term that leaves nothing
            f = float((before.coefficient[term] / before.standard_error[term]) ** 2)
        steps.append(problem.step(action, labels[term], f, float(before.p_value[term]), inside))
    return _result(problem, labels, steps, parts, rho)


def _next_move(step: StepwiseStep, p_enter: float, p_remove: float) -> tuple[str, int] | None:
    """Return what happens next; of terms that are as good as equal (collinear ones) the first one moves."""
    outside = np.where(step.included | np.isnan(step.p_value), np.inf, step.p_value)
    if len(outside) and outside.min() < p_enter:
        return "enter", int(np.argmax(outside <= (1.0 + _TIE) * outside.min()))
    within = np.where(step.included, step.p_value, -np.inf)
    if len(within) and within.max() > p_remove:
        return "remove", int(np.argmax(within >= (1.0 - _TIE) * within.max()))
    return None


class _Problem:
    """Centred, scaled cross products of one regression, from which any set of terms is swept in."""

    def __init__(self, x: Array, y: Array, rho: float) -> None:
        self.x, self.y, self.rho = x, y, rho
        self.centre, self.level = x.mean(axis=0), float(y.mean())
        both = np.column_stack([x - self.centre, y - self.level])
        norm = np.linalg.norm(both, axis=0)
        # Centring leaves rounding of the size of the mean: a column of nothing else is constant.
        dead = norm <= 1e-12 * np.linalg.norm(np.column_stack([x, y]), axis=0)
        self.norm = np.where(dead, 1.0, norm)
        both = np.where(dead, 0.0, both / self.norm)
        self.products = both.T @ both

    def swept(self, inside: Sequence[int]) -> Array:
        """Sweep the terms in: their block is then minus the inverse, their last column the coefficients.

        With a pivot below `_EXACT_PIVOT` the terms' own numbers come from `orthogonal`.
        """
        matrix: Array = self.products.copy()
        least = 1.0
        for k in inside:
            least = min(least, float(matrix[k, k]))
            if least <= 0.0:
                break
            pivot, row, column = matrix[k, k], matrix[k].copy(), matrix[:, k].copy()
            matrix -= np.outer(column, row / pivot)
            matrix[k], matrix[:, k], matrix[k, k] = row / pivot, column / pivot, -1.0 / pivot
        if least >= _EXACT_PIVOT:
            return matrix
        slope, variance, remaining = self.orthogonal(inside)
        at = np.array(inside)
        if least < PIVOT_TOLERANCE:  # what products say of the terms that are out is rounding
            matrix = np.zeros_like(matrix)
        matrix[at, at], matrix[at, -1], matrix[-1, -1] = -variance, slope, remaining
        return matrix

    def orthogonal(self, inside: Sequence[int]) -> tuple[Array, Array, float]:
        """Return coefficients of unit columns, diagonal of their inverse products, share of y left.

        By QR, corrected by the normal equations in extended precision where that converges (Bjorck, Numerical
        Methods for Least Squares Problems, 6.6.5). ConfigurationError where fewer than seven digits are left.
        """
        columns, y = self.x[:, list(inside)].astype(np.longdouble), self.y.astype(np.longdouble)
        columns = (columns - columns.mean(axis=0)) / self.norm[list(inside)]
        y = (y - y.mean()) / self.norm[-1]
        q, r = np.linalg.qr(columns.astype(np.float64))
        least = float(np.abs(np.diag(r)).min())
        if least < _LEAST_DIAGONAL:
            raise ConfigurationError(
                "the terms are so alike that no coefficient of theirs has seven digits",
                where="stepwise",
                found=f"a term of which the others leave {least:.1g} of its size unexplained",
                expected=f"at least {_LEAST_DIAGONAL:.0g}",
                remedy="leave out a term, or centre the variable that powers are taken of",
            )
        slope = np.linalg.solve(r, q.T @ y.astype(np.float64)).astype(np.longdouble)
        for _ in range(_CORRECTIONS if least > _REFINABLE else 0):
            gradient = (columns.T @ (y - columns @ slope)).astype(np.float64)
            slope = slope + np.linalg.solve(r, np.linalg.solve(r.T, gradient))
        left = y - columns @ slope
        variance = np.sum(np.linalg.inv(r) ** 2, axis=1)
        return slope.astype(np.float64), variance, float(left @ left)

    def step(self, action: str, term: str, f: float, p: float, inside: Sequence[int]) -> StepwiseStep:
        """Return the regression on the terms `inside`."""
        matrix = self.swept(inside)
        count, k = len(self.y), len(inside)
        included = np.zeros(self.x.shape[1], dtype=np.bool_)
        included[list(inside)] = True
        diagonal, cross = np.diag(matrix)[:-1], matrix[:-1, -1]
        remaining = max(float(matrix[-1, -1]), 0.0)
        open_to = ~included & (diagonal > PIVOT_TOLERANCE)
        usable = included | open_to
        safe = np.where(usable, diagonal, 1.0)
        slope = np.where(included, cross, cross / safe)
        gain = cross**2 / np.abs(safe)
        left = np.where(included, remaining, np.maximum(remaining - gain, 0.0))
        freedom = np.where(included, count - k - 1, count - k - 2)
        with np.errstate(divide="ignore", invalid="ignore"):
            ratio = np.where(gain > 0.0, gain / (left / freedom), 0.0)
            p_value = np.where(usable & (freedom > 0), fdtrc(1.0, np.maximum(freedom, 1), ratio), np.nan)
            error = np.where(included, np.sqrt(remaining / freedom * np.abs(safe)), 0.0)
            error = np.where(included, error, np.sqrt(left / freedom / safe))
        unit = self.norm[-1] / self.norm[:-1]
        coefficient = np.where(usable, slope * unit, np.nan)
        sse = remaining * float(self.norm[-1]) ** 2
        mean_term = float(self.centre[included] @ coefficient[included])
        return StepwiseStep(
            action=action,
            term=term,
            f=f,
            p=p,
            included=included,
            coefficient=coefficient,
            standard_error=np.where(usable, error * unit, np.nan),
            p_value=p_value,
            intercept=(self.level - mean_term) / (1.0 - self.rho),
            sse=sse,
            r2=1.0 - remaining,
            rmse=float(np.sqrt(sse / (count - k - 1))),
        )


def _result(
    problem: _Problem, labels: tuple[str, ...], steps: list[StepwiseStep], parts: Array, rho: float
) -> StepwiseResult:
    final = steps[-1]
    inside = np.flatnonzero(final.included)
    count, k = len(problem.y), len(inside)
    freedom = count - k - 1
    residual = problem.y - problem.level
    residual = residual - (problem.x[:, inside] - problem.centre[inside]) @ final.coefficient[inside]
    lag1 = _lag1_correlation(residual, parts)
    f = (final.r2 / k) / ((1.0 - final.r2) / freedom) if k and final.r2 < 1.0 else (np.inf if k else 0.0)
    vif = np.full(len(labels), np.nan)
    vif[inside] = -np.diag(problem.swept(list(inside)))[inside]
    change = np.diff(residual)[np.diff(parts) == 0]
    return StepwiseResult(
        names=labels,
        steps=tuple(steps),
        n=count,
        adjusted_r2=1.0 - (1.0 - final.r2) * (count - 1) / freedom,
        f=float(f),
        significance_f=float(fdtrc(k, freedom, f)) if k else 1.0,
        lag1_correlation=lag1,
        durbin_watson=float(change @ change / (residual @ residual)) if residual.any() else np.nan,
        effective_n=count * (1.0 - lag1) / (1.0 + lag1),
        vif=vif,
        whitening_rho=rho,
    )


_LARGEST_RHO = 0.999


def cochrane_orcutt_rho(
    x: Array, y: Array, segments: Array, *, tolerance: float = 1e-4, iterations: int = 50
) -> float:
    """Lag-1 correlation of the residuals of `y` on all of `x`, by Cochrane and Orcutt's iteration.

    Source: Cochrane and Orcutt, JASA 44(245), 1949. ConfigurationError when the residual is a random walk, or
    alternates.
    """
    rho = 0.0
    for _ in range(iterations):
        white_x, white_y, _ = _whitened(x, y, segments, rho) if rho else (x, y, segments)
        centre, level = white_x.mean(axis=0), white_y.mean()
        scale = np.maximum(np.linalg.norm(white_x - centre, axis=0), np.finfo(np.float64).tiny)
        slope = np.linalg.lstsq((white_x - centre) / scale, white_y - level, rcond=1e-10)[0] / scale
        residual = y - x @ slope
        previous, rho = rho, _lag1_correlation(residual - residual.mean(), segments)
        if abs(rho) >= _LARGEST_RHO:
            walks = rho > 0.0
            raise ConfigurationError(
                "the residual is a random walk: no regression can be tested on it"
                if walks
                else "the residual alternates from block to block: no regression can be tested on it",
                found=f"lag-1 correlation {rho:.4f}",
                expected=f"within {_LARGEST_RHO}",
                remedy="use longer block means, or add the term that explains the drift"
                if walks
                else "record longer, or use shorter block means: there are too few for so many terms",
            )
        if abs(rho - previous) < tolerance:
            break
    return rho


def _lag1_correlation(residual: Array, parts: Array) -> float:
    together = np.diff(parts) == 0
    power = float(residual[:-1][together] @ residual[:-1][together])
    return float(residual[1:][together] @ residual[:-1][together]) / power if power > 0.0 else 0.0


def _whitened(x: Array, y: Array, parts: Array, rho: float) -> tuple[Array, Array, Array]:
    together = np.diff(parts) == 0
    white_x = (x[1:] - rho * x[:-1])[together]
    return white_x, (y[1:] - rho * y[:-1])[together], parts[1:][together]


def _check(x: Array, y: Array, labels: Sequence[str], start: Sequence[str]) -> None:
    finite = bool(np.isfinite(x).all() and np.isfinite(y).all())
    shaped = x.ndim == 2 and y.shape == (len(x),) and len(set(labels)) == len(labels) == x.shape[1]
    if shaped and finite and set(start) <= set(labels) and len(x) >= x.shape[1] + 3:
        return
    raise ConfigurationError(
        "the regression's input cannot be used",
        where="stepwise",
        found=f"x {x.shape}, y {y.shape}, {len(labels)} names, all finite: {finite}, start {list(start)}",
        expected="x (n, k), y (n,), k different names, n >= k + 3, no NaN, start terms among the names",
        remedy="leave out rows with gaps; use more rows or fewer terms",
    )
