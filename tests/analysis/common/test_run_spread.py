"""Regression with a spread from run to run against dense Gaussian algebra; one standard error by hand."""

from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.common.leave_out import within_one_standard_error
from bench.analysis.common.run_spread import PRIOR_LOG_SD, PRIOR_SPREAD, _Problem, fit_run_spread
from drivers.base.errors import ConfigurationError

RUNS, ROWS, P, Q = 3, 40, 5, 3
SHARES = np.array([[1.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.5, 1.0, 1.0, 0.3]])
OWN_SHARES = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.25]])


def problem(seed: int) -> tuple[_Problem, np.ndarray]:
    rng = np.random.default_rng(seed)
    columns = [rng.normal(size=(ROWS, P)) for _ in range(RUNS)]
    own = [rng.normal(size=(ROWS, Q)) for _ in range(RUNS)]
    outputs = [rng.normal(size=ROWS) for _ in range(RUNS)]
    return _Problem(columns, own, outputs, SHARES, OWN_SHARES), rng.normal(size=6) - 1.0


def dense(made: _Problem, point: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Covariance of all rows, the prior of w, columns and outputs of all runs, by the model's definition."""
    prior, own = np.diag(np.exp(point[:2]) @ SHARES), np.diag(np.exp(point[2:4]) @ OWN_SHARES)
    columns, outputs = np.vstack([rows[:, :P] for rows in made.rows]), np.concatenate(made.outputs)
    covariance = columns @ prior @ columns.T + np.exp(point[5]) * np.eye(RUNS * ROWS)
    for run, rows in enumerate(made.rows):
        part = slice(run * ROWS, (run + 1) * ROWS)
        covariance[part, part] += np.exp(point[4]) * rows[:, :P] @ prior @ rows[:, :P].T
        covariance[part, part] += rows[:, P:] @ own @ rows[:, P:].T
    return covariance, prior, columns, outputs


@pytest.mark.parametrize("seed", [0, 1])
def test_loss_and_solution_are_those_of_dense_gaussians(seed: int) -> None:
    made, point = problem(seed)
    covariance, prior, columns, outputs = dense(made, point)
    off = (0.5 * point[4] - np.log(PRIOR_SPREAD)) / PRIOR_LOG_SD
    expected = np.linalg.slogdet(covariance)[1] + outputs @ np.linalg.solve(covariance, outputs) + off**2
    loss, gradient = made.loss(point)
    assert loss == pytest.approx(0.5 * expected / len(outputs), rel=1e-10)
    steps = 1e-5 * np.eye(6)
    slopes = [(made.loss(point + step)[0] - made.loss(point - step)[0]) / 2e-5 for step in steps]
    assert gradient == pytest.approx(np.array(slopes), rel=1e-5, abs=1e-8)
    found = made.at(point)
    gain = prior @ columns.T @ np.linalg.inv(covariance)
    assert found.coefficients == pytest.approx(gain @ outputs, rel=1e-8)
    assert found.covariance == pytest.approx(prior - gain @ columns @ prior, rel=1e-7, abs=1e-10)
    # second moments of what each run has of its own, by the dense posterior
    variance, whole = np.exp(point[4]) * prior, np.zeros((P, P))
    for run, rows in enumerate(made.rows):
        cross = np.zeros((P, RUNS * ROWS))
        cross[:, run * ROWS : (run + 1) * ROWS] = variance @ rows[:, :P].T
        mean = cross @ np.linalg.solve(covariance, outputs)
        whole += np.outer(mean, mean) / (RUNS - 1)
        whole += (variance - cross @ np.linalg.solve(covariance, cross.T)) / RUNS
    assert made.apart(point, found) == pytest.approx(whole, rel=1e-7, abs=1e-10)


def simulated(spread: float, runs: int, seed: int) -> tuple[list[np.ndarray], list[np.ndarray], np.ndarray]:
    """Columns and outputs of runs whose four coefficients lie `spread` apart; the coefficients."""
    rng = np.random.default_rng(seed)
    true = np.array([1.0, -1.0, 1.0, 1.0])
    columns = [rng.normal(size=(200, 4)) for _ in range(runs)]
    outputs = [
        part @ (true * (1.0 + spread * rng.standard_normal(4))) + 0.05 * rng.normal(size=200)
        for part in columns
    ]
    return columns, outputs, true


@pytest.mark.parametrize("spread", [0.03, 0.2])
def test_spread_and_coefficients_of_made_runs_are_found(spread: float) -> None:
    columns, outputs, true = simulated(spread, 12, 3)
    own, eye = [np.ones((200, 1))] * 12, np.eye(4)
    found = fit_run_spread(columns, own, outputs, eye, np.ones((1, 1)))
    # forty-eight draws know a standard deviation to a tenth
    assert np.sqrt(np.trace(found.apart) / 4.0) == pytest.approx(spread, rel=0.3)
    sigma = np.sqrt(np.diag(found.covariance))
    assert (np.abs(found.coefficients - true) < 4.0 * sigma).all()
    assert sigma.mean() == pytest.approx(spread / np.sqrt(12), rel=0.4)
    assert np.sqrt(found.noise) == pytest.approx(0.05, rel=0.1)


def test_more_runs_are_worth_what_they_tell() -> None:
    """With every run twice the coefficients are as sure as is foretold of three more runs like these."""
    made, point = problem(5)
    columns, own = [rows[:, :P] for rows in made.rows], [rows[:, P:] for rows in made.rows]
    found = fit_run_spread(columns, own, made.outputs, SHARES, OWN_SHARES)
    single, twice = (
        _Problem(columns * n, own * n, made.outputs * n, SHARES, OWN_SHARES).at(point) for n in (1, 2)
    )
    told = type(found)(
        single.coefficients, single.covariance, single.prior, found.apart, found.own, 1.0,
        single.information.mean(axis=0),
    )  # fmt: skip
    assert told.covariance_after(3.0) == pytest.approx(twice.covariance, rel=1e-7, abs=1e-12)
    assert told.covariance_after(0.0) == pytest.approx(single.covariance, rel=1e-7, abs=1e-12)
    assert not told.covariance_after(np.inf).any()


def test_an_output_that_does_not_change_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="does not change"):
        fit_run_spread([np.ones((5, 1))], [np.ones((5, 1))], [np.zeros(5)], np.ones((1, 1)), np.ones((1, 1)))


def test_who_is_within_one_standard_error_of_the_best() -> None:
    best = np.array([1.0, 2.0, 3.0])
    # differences 0.2, 0.1, 0.3: mean 0.2, standard error 0.1 / sqrt(3) = 0.058
    sure = best + np.array([0.2, 0.1, 0.3])
    # differences 1, -0.9, 0: mean 0.033, standard error 0.55
    doubtful = best + np.array([1.0, -0.9, 0.0])
    errors = {"sure": sure, "best": best, "doubtful": doubtful}
    assert within_one_standard_error(errors) == ["best", "doubtful"]
    # at the very border a form is tied: differences 0 and 2, mean 1, standard error 1
    border = {"a": np.array([1.0, 1.0]), "b": np.array([1.0, 3.0])}
    assert within_one_standard_error(border) == ["a", "b"]
