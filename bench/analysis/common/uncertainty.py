"""Uncertainty budgets after JCGM 100 (GUM): contributions, Welch-Satterthwaite, expanded uncertainty with k.

A budget is linear in its inputs: y = stated + sum of sensitivity times estimate. `Budget.draws` propagates the
distributions themselves (JCGM 101), for a check of what the linear sum and k say.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bench.analysis.common.quantiles import student
from drivers.base.arrays import Array

COVERAGE = 0.95
_DRAWS = 20_000
_ALMOST_NORMAL = 0.05
"""Share of the variance up to which distributions that are not normal leave k as it is."""


@dataclass(frozen=True)
class Contribution:
    """An input of a budget: its estimate and standard uncertainty in `unit`, and what they do to the figure.

    `sensitivity`: unit of the figure per `unit`. `freedom`: degrees of freedom of the standard uncertainty.
    `origin`: the certificate it is traceable to, or in words where it comes from.
    """

    source: str
    standard: float
    sensitivity: float = 1.0
    unit: str = ""
    estimate: float = 0.0
    kind: Literal["A", "B"] = "B"
    distribution: str = "normal"
    freedom: float = math.inf
    origin: str = ""

    @property
    def uncertainty(self) -> float:
        """What it adds to the figure's standard uncertainty, without sign."""
        return abs(self.sensitivity) * self.standard


@dataclass(frozen=True)
class Budget:
    """The budget of one figure; `stated` is the figure before the estimates of the inputs correct it.

    Inputs are independent. With `coverage` p the expanded uncertainty is k u_c, k from Student's t at the
    effective degrees of freedom, rounded down (JCGM 100, G.4.1).
    """

    stated: float
    contributions: tuple[Contribution, ...]
    coverage: float = COVERAGE

    @property
    def value(self) -> float:
        """The figure, corrected by the estimates."""
        return self.stated + sum(item.sensitivity * item.estimate for item in self.contributions)

    @property
    def combined(self) -> float:
        """Combined standard uncertainty (JCGM 100, 5.1.2)."""
        return math.hypot(*(item.uncertainty for item in self.contributions))

    @property
    def freedom(self) -> float:
        """Effective degrees of freedom (Welch-Satterthwaite; JCGM 100, G.2b)."""
        below = sum(item.uncertainty**4 / item.freedom for item in self.contributions)
        return self.combined**4 / below if below > 0.0 else math.inf

    @property
    def k(self) -> float:
        """Coverage factor."""
        freedom = max(1.0, math.floor(self.freedom)) if math.isfinite(self.freedom) else math.inf
        return student(0.5 + 0.5 * self.coverage, freedom)

    @property
    def expanded(self) -> float:
        """Expanded uncertainty U = k u_c."""
        return self.k * self.combined

    @property
    def half_width(self) -> float:
        """Half of the coverage interval: U; where much is not normal, that of the draws (JCGM 101, 7.7)."""
        odd = sum(self.share(item) for item in self.contributions if item.distribution != "normal")
        if odd <= _ALMOST_NORMAL:
            return self.expanded
        return float(np.quantile(np.abs(self.draws(_DRAWS) - self.value), self.coverage))

    def share(self, item: Contribution) -> float:
        """Return a contribution's share of the variance."""
        return (item.uncertainty / self.combined) ** 2 if self.combined > 0.0 else 0.0

    def draws(self, count: int, seed: int = 0) -> Array:
        """Return `count` draws of the figure from the distributions of its inputs (JCGM 101, 7)."""
        rng = np.random.default_rng(seed)
        total = np.full(count, self.value)
        for item in self.contributions:
            total += item.sensitivity * item.standard * _standardised(rng, item, count)
        return total


def _standardised(rng: np.random.Generator, item: Contribution, count: int) -> Array:
    """Return draws with mean 0; standard deviation 1, but for Student's t, whose scale is 1 (JCGM 101, 6.4.9)."""
    if item.distribution == "rectangular":
        return np.asarray(rng.uniform(-math.sqrt(3.0), math.sqrt(3.0), count))
    if item.distribution == "triangular":
        return np.asarray(math.sqrt(6.0) * rng.triangular(-1.0, 0.0, 1.0, count))
    if item.distribution == "arcsine":
        return np.asarray(math.sqrt(2.0) * np.sin(rng.uniform(0.0, 2.0 * math.pi, count)))
    if item.distribution == "exponential":
        return np.asarray(rng.exponential(1.0, count) - 1.0)
    if math.isfinite(item.freedom):
        return np.asarray(rng.standard_t(item.freedom, count))
    return np.asarray(rng.standard_normal(count))
