"""What a fitted explanation foretells: against least squares; misfit, against a cell worked out by hand."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from bench.analysis.gap._cells import Cell
from bench.analysis.gap._information import expected_information
from bench.analysis.gap._predictions import fitted, log_odds, tolerant_gram

RNG = np.random.default_rng(7)
X = RNG.standard_normal((40, 4)) @ np.array(
    [[1.0, 0.3, 0.0, 0.2], [0.0, 1.0, 0.8, 0.0], [0.0, 0.0, 0.5, 0.4], [0.0, 0.0, 0.0, 0.7]]
)
"""Whitened samples of a nominal column and three effects' columns, which are akin."""
SIGMAS = np.array([0.5, 3.0, 2.0, 10.0])


def test_a_fit_beside_the_nominal_parameters_is_ridge_regression():
    own, follows = np.array([0, 2, 3]), np.array([0.0, 1.5, 0.0, 0.0])
    foretold = fitted(X.T @ X, SIGMAS, own, follows, 0.3)
    # least squares with a row more for each prior
    rows = np.concatenate((X[:, own], np.diag(1.0 / SIGMAS[own])))
    best = np.linalg.lstsq(rows, np.concatenate((X @ follows, np.zeros(3))), rcond=None)[0]
    assert foretold.mean[own] == pytest.approx(best) and foretold.mean[1] == 0.0
    covariance = np.linalg.inv(rows.T @ rows)
    assert (foretold.root @ foretold.root.T)[np.ix_(own, own)] == pytest.approx(covariance)
    assert foretold.probability == 0.3 and not foretold.root[1].any()


def test_without_a_recorded_run_each_has_its_prior():
    foretold = fitted(np.zeros((4, 4)), SIGMAS, np.array([0, 1]), np.array([0.0, 1.0, 0.0, 0.0]), 0.5)
    assert not foretold.mean.any()
    assert foretold.root @ foretold.root.T == pytest.approx(np.diag([0.25, 9.0, 0.0, 0.0]))


def test_two_effects_that_agree_on_what_is_recorded_are_told_apart_only_by_what_neither_takes():
    """The first runs show two columns that are the same; a further one shows them apart, or the same again."""
    recorded = np.array([[400.0, 400.0], [400.0, 400.0]])
    one, other = (
        fitted(recorded, np.full(2, 100.0), np.array([at]), np.array([1.0, 0.0]), 0.5) for at in (0, 1)
    )
    assert other.mean[1] == pytest.approx(1.0, rel=1e-4)
    same, apart = np.full((2, 2), 900.0), np.array([[900.0, 0.0], [0.0, 900.0]])
    assert expected_information(same, [one, other]) == pytest.approx(0.0, abs=1e-9)
    assert expected_information(apart, [one, other]) > 0.68


def test_the_odds_of_one_more_effect_are_those_of_the_marginal_likelihoods():
    known, own = np.array([0, 1]), np.array([2, 3])
    data = X @ np.array([0.3, 2.0, 0.8, -0.4]) + RNG.standard_normal(40)
    rows = np.column_stack((data, X))
    as_fitted, without = log_odds(rows.T @ rows, SIGMAS, known, own)

    def log_likelihood(columns, values):
        spread = X[:, columns] * SIGMAS[columns]
        return multivariate_normal(np.zeros(40), np.eye(40) + spread @ spread.T).logpdf(values)

    both = np.concatenate((known, own))
    assert as_fitted == pytest.approx(log_likelihood(both, data) - log_likelihood(known, data))
    nothing = np.zeros(40)
    assert without == pytest.approx(log_likelihood(both, nothing) - log_likelihood(known, nothing))


def test_where_an_effect_acts_a_run_is_as_noisy_as_its_formula_is_wrong():
    """An effect of 20 standard deviations in 16 coefficients: 0.25^2 400 / 8 more noise."""
    products = np.array([[0.0, 0.0, 0.0], [0.0, 4.0, 1.0], [0.0, 1.0, 1.0]])
    strong = Cell("p", "run", True, 3, 16.0, 3, np.arange(3), products, 1.0, 17)
    calm = Cell("p", "run", True, 8, 16.0, 3, np.arange(3), 0.1 * products, 1.0, 17)
    total = strong.whitened + calm.whitened
    nothing = tolerant_gram([strong, calm], total, np.array([1e-9]), np.zeros(1))
    assert nothing == pytest.approx(total)
    # the nominal parameter is known, and takes nothing
    found = tolerant_gram([strong, calm], total, np.array([1e-9]), np.array([20.0]))
    variances = [1.0 + 0.0625 * 400.0 * part / 8.0 for part in (1.0, 0.1)]
    assert found == pytest.approx(sum(p / v for p, v in zip((1.0, 0.1), variances, strict=True)) * products)
    # unknown, it takes 1 * 20 / 4 of its column: 400 - 100 are left
    found = tolerant_gram([strong, calm], total, np.array([1e9]), np.array([20.0]))
    variances = [1.0 + 0.0625 * 300.0 * part / 8.0 for part in (1.0, 0.1)]
    assert found == pytest.approx(sum(p / v for p, v in zip((1.0, 0.1), variances, strict=True)) * products)
