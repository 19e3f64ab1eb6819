"""Quantiles are those of scipy.stats, whose import they spare."""

import math

import pytest
from scipy import stats

from bench.analysis.common.quantiles import chi_squared, student

PROBABILITIES = (0.001, 0.025, 0.5, 0.95, 0.975, 0.999)


@pytest.mark.parametrize("freedom", [1.0, 2.0, 3.7, 30.0, 1e4, math.inf])
def test_students_t(freedom: float) -> None:
    for probability in PROBABILITIES:
        assert student(probability, freedom) == pytest.approx(
            float(stats.t.ppf(probability, freedom)), rel=1e-12, abs=1e-12
        )


@pytest.mark.parametrize("freedom", [0.3, 1.0, 4.6, 200.0])
def test_chi_squared(freedom: float) -> None:
    for probability in PROBABILITIES:
        assert chi_squared(probability, freedom) == pytest.approx(
            float(stats.chi2.ppf(probability, freedom)), rel=1e-12
        )
