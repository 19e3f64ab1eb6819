"""Fits and evidence from Gram matrices against fits of the rows themselves."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad

from bench.analysis.gap._evidence import Candidate, log_bayes, reduced, search
from bench.analysis.gap._fit import solve
from bench.analysis.gap._score import wilson


def _rows(rng: np.random.Generator) -> np.ndarray:
    rows = rng.standard_normal((8, 500))
    rows[0] += 0.8 * rows[1] + 0.5 * rows[4] - 0.6 * rows[6]
    return rows


def test_solution_is_the_ridge_of_the_rows() -> None:
    rows = _rows(np.random.default_rng(1))
    sigmas = np.array([0.1, 0.3])
    found = solve(rows @ rows.T, sigmas, (4, 6))
    x = rows[[1, 2, 4, 6]].T
    # priors as two more observations
    stacked = np.vstack((x, np.diag([1 / 0.1, 1 / 0.3, 0.0, 0.0])[:2]))
    values, *_ = np.linalg.lstsq(stacked, np.append(rows[0], [0.0, 0.0]), rcond=None)
    assert found.values == pytest.approx(values, rel=1e-6)
    assert found.covariance == pytest.approx(np.linalg.inv(stacked.T @ stacked), rel=1e-5)


def test_reduced_system_gives_the_gain_of_the_full_fit() -> None:
    rows = _rows(np.random.default_rng(2))
    sigmas = np.array([1e6, 1e6])
    system = reduced(rows @ rows.T, sigmas)

    def cost(columns: list[int]) -> float:
        x = rows[columns].T
        left = rows[0] - x @ np.linalg.lstsq(x, rows[0], rcond=None)[0]
        return float(left @ left)

    at = 4 - 2
    gain = system[0, at] ** 2 / system[at, at]
    assert gain == pytest.approx(cost([1, 2]) - cost([1, 2, 4]), rel=1e-6)


def test_search_finds_the_set_among_correlated_columns() -> None:
    rng = np.random.default_rng(3)
    rows = rng.standard_normal((10, 2000))
    for k in range(2, 10):
        rows[k] = 0.7 * rows[k - 1] + 0.7 * rows[k]
    rows[0] += 0.3 * rows[3] - 0.4 * rows[7]
    candidates = [Candidate(f"e{k}", k - 1, (k,), 1) for k in range(1, 10)]
    found = search(rows @ rows.T, candidates, range(9))
    names = found.effects(found.best())
    assert names == {"e3", "e7"}


def test_nothing_is_found_in_noise() -> None:
    rng = np.random.default_rng(4)
    named = 0
    for _ in range(40):
        rows = rng.standard_normal((13, 400))
        candidates = [Candidate(f"e{k}", k - 1, (k,), 1) for k in range(1, 13)]
        named += bool(search(rows @ rows.T, candidates, range(12)).best())
    assert named <= 2


@pytest.mark.parametrize(("gain", "columns"), [(0.0, 1), (25.0, 1), (60.0, 2)])
def test_evidence_of_a_g_prior_is_the_integral_over_amplitudes(gain: float, columns: int) -> None:
    """One component of the mixture by quadrature: amplitude z ~ N(0, g) in units of its own deviation."""
    grid = (30.0, 300.0, 3e3, 3e4, 3e5)
    peak = math.sqrt(gain / columns)

    def integral(g: float) -> float:
        def density(z: float) -> float:
            prior = math.exp(-0.5 * z * z / g) / math.sqrt(2.0 * math.pi * g)
            return math.exp(z * peak - 0.5 * z * z) * prior

        return quad(density, -60.0, 60.0, points=[0.0, peak], limit=200)[0] ** columns

    expected = math.log(sum(integral(g) for g in grid) / len(grid))
    # N(0, g) on the amplitude gives ln(1 + g)/2, the same as the g-prior's
    assert log_bayes(gain, columns) == pytest.approx(expected, rel=2e-3, abs=1e-3)


def test_wilson_interval() -> None:
    # Newcombe, Statistics in Medicine 17 (1998), table I: 15 of 148 and 0 of 20
    assert wilson(15, 148) == pytest.approx((0.0624, 0.1605), abs=2e-4)
    assert wilson(0, 20) == pytest.approx((0.0, 0.1611), abs=2e-4)
