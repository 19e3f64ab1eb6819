"""Fits and evidence from Gram matrices against fits of the rows themselves."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from scipy.integrate import quad

from bench.analysis.gap._cells import BANDS, Cell
from bench.analysis.gap._evidence import Candidate, log_bayes, reduced, search
from bench.analysis.gap._fit import floor_from_repeats, solve, tolerated
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


def _cell(band: int, energy: float, count: int = 100, **other: Any) -> Cell:
    where = {"profile": "shock", "parity": "common", "repeatable": True, **other}
    at, block = np.zeros(1, dtype=np.int64), np.array([[energy]])
    return Cell(**where, band=band, count=count, columns=1, at=at, whitened=block, power=1.0, samples=10_000)


def test_a_formulas_misfit_is_tolerated_in_the_bands_beside_its_gap_too() -> None:
    """A lag of 180 s that really is one of 220 s leaves something at faster and slower periods than its gap's."""
    cells = [_cell(band, 5100.0 if band == 4 else 100.0) for band in range(8)]
    left = np.array([cell.products(np.zeros(1, np.int64))[0, 0] for cell in cells])
    here = tolerated(cells, left)
    # a misfit of 0.35 of the amplitude, in its own band: 0.35^2 of a gap of 50 times the noise
    assert here[4] == pytest.approx(1.0 + 0.35**2 * 50.0)
    assert here[[0, 1, 2, 6, 7]] == pytest.approx(1.0)
    assert here[3] == here[5]
    # so much that what a misfit of that size leaves next door, a quarter of it at least, is no discovery there
    assert 0.25 * (here[4] - 1.0) < here[3] - 1.0 < here[4] - 1.0


@pytest.mark.parametrize("other", [{"profile": "ramp"}, {"parity": "odd in rate"}, {"repeatable": False}])
def test_a_gap_excuses_nothing_in_other_runs(other: dict[str, Any]) -> None:
    cells = [_cell(4, 5100.0), _cell(5, 100.0, **other), _cell(5, 100.0)]
    apart, beside = tolerated(cells, np.array([5100.0, 100.0, 100.0]))[1:]
    assert apart == 1.0 < beside


@pytest.mark.parametrize("count", [2000, 8000])
def test_the_floors_uncertainty_is_its_scatter(count: int) -> None:
    """Differences of repeats hold noise alone: chi-square energies, whose mean scatters by sqrt(2 / n)."""
    rng = np.random.default_rng(8)
    bands = range(len(BANDS))
    drawn = [
        floor_from_repeats(
            [_cell(band, rng.chisquare(count), count, repeatable=False) for band in bands], np.zeros(0)
        )
        for _ in range(200)
    ]
    ratio, sigma = np.stack([each.ratio for each in drawn]), drawn[0].sigma
    assert ratio.mean() == pytest.approx(1.0, abs=0.003)
    # 2200 draws: the scatter is known to 1.5 %; the noise model counts as some coefficients more
    assert np.sqrt(np.mean((ratio - 1.0) ** 2)) == pytest.approx(float(sigma.mean()), rel=0.06)
    assert drawn[0].from_repeats


def _named(gains: Sequence[float]) -> frozenset[str]:
    """Effects named of ten with a column each, none like another, that lower the cost by `gains`."""
    places = np.arange(10) + 1
    system = np.eye(11)
    system[0, 0] = 1000.0 + sum(gains)
    system[0, places[: len(gains)]] = system[places[: len(gains)], 0] = np.sqrt(gains)
    found = search(system, [Candidate(f"e{k}", k, (k + 1,), 1) for k in range(10)], range(10))
    return found.effects(found.best())


@pytest.mark.parametrize("strong", [100.0, 1000.0])
def test_a_further_effect_must_be_clearer_than_a_first_one(strong: float) -> None:
    """What is left beside a strong effect may be its formula's misfit: the same evidence names nothing there."""
    assert _named([15.0]) == {"e0"}
    assert _named([strong, 15.0]) == {"e0"}
    assert _named([strong, 25.0]) == {"e0", "e1"}
