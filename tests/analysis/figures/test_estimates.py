"""What noise would make of a figure: perfect units show nothing, the others' intervals hold the truth."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from bench.analysis.figures._estimate import DRAWS, Estimate, largest, linear, spread

RATES = np.linspace(-1.0, 1.0, 23)
FREE = np.eye(23) - np.outer(np.ones(23), np.ones(23)) / 23.0 - np.outer(RATES, RATES) / (RATES @ RATES)
UNITS = 150


def held(found: list[Estimate], truth: float) -> int:
    return sum(estimate.low <= truth <= estimate.high for estimate in found)


def units(shape: np.ndarray, size: float) -> list[Estimate]:
    """Largest residuals of units with that shape of residual, its peak `size`, in noise of 1 a rate."""
    rng = np.random.default_rng(7)
    true = FREE @ shape
    true *= size / max(np.abs(true).max(), 1e-30)
    noise = np.random.default_rng(8).standard_normal((DRAWS, 23)) @ FREE
    return [largest(true + FREE @ rng.standard_normal(23), noise) for _ in range(UNITS)]


def test_a_perfect_unit_shows_no_largest_residual() -> None:
    found = units(np.zeros(23), 0.0)
    assert held(found, 0.0) == sum(not estimate.seen for estimate in found)
    assert held(found, 0.0) >= binom.ppf(1e-4, UNITS, 0.97)
    assert np.median([estimate.value for estimate in found]) < 0.7  # the largest of 23 is 2.2 in the median
    assert np.median([estimate.high for estimate in found]) < 4.5


@pytest.mark.parametrize("size", [2.0, 6.0])
@pytest.mark.parametrize("shape", [RATES**3, np.abs(RATES), np.eye(23)[15]], ids=["cubic", "kink", "one"])
def test_the_interval_of_a_largest_residual_holds_it(shape: np.ndarray, size: float) -> None:
    found = units(shape, size)
    assert held(found, size) >= binom.ppf(1e-4, UNITS, 0.93)
    if size > 5.0:
        assert all(estimate.seen for estimate in found)
        assert np.median([estimate.value for estimate in found]) == pytest.approx(size, abs=0.5)
        assert np.median([estimate.high - estimate.low for estimate in found]) < 6.0


def test_a_spread_is_what_is_left_beyond_the_noise() -> None:
    rng = np.random.default_rng(3)
    noise = 0.5 * np.eye(6) + 2.0  # a common error is none of the spread
    for sigma, least in ((0.0, 0.96), (2.0, 0.93)):
        found = []
        for _ in range(1000):
            values = rng.normal(0.0, np.hypot(sigma, 0.5**0.5), 6) + rng.normal(0.0, 2.0**0.5)
            found.append(spread(values, noise))
        assert held(found, sigma) >= binom.ppf(1e-4, 1000, least)
    # s^2 = 1, no noise: chi-squared with one degree of freedom; printed tables: 5.024 and 0.000982.
    two = spread([0.0, 2.0**0.5], np.zeros((2, 2)))
    assert (two.value, two.low, two.high) == pytest.approx((1.0, 5.024**-0.5, 0.000982**-0.5), rel=1e-3)


def test_a_linear_figure_is_seen_where_its_interval_leaves_zero_out() -> None:
    noise = np.random.default_rng(1).standard_normal(100_000)
    estimate = linear(1.5, noise)
    assert (estimate.low, estimate.high) == pytest.approx((1.5 - 1.96, 1.5 + 1.96), abs=0.03)
    assert not estimate.seen and estimate.bound == pytest.approx(3.46, abs=0.03)
    turned = linear(-2.5, noise).times(-2.0)
    assert turned.seen and turned.value == 5.0 and turned.low == pytest.approx(5.0 - 3.92, abs=0.06)
