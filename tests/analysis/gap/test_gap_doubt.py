"""When a name is put in doubt: by what is left beyond the noise, by what competes for its place."""

from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.gap._causes import _of_any
from bench.analysis.gap._cells import BANDS, Cell
from bench.analysis.gap._evidence import Candidate, SetPosterior
from bench.analysis.gap._fit import Floor, Solution, beside_nominal
from bench.analysis.gap._refine import sets_of_note
from bench.analysis.gap._unknown import credibility, prevalence, remainder

_FLOOR = Floor(np.ones(len(BANDS)), np.zeros(len(BANDS)), True)


def _trust(count: int, effect: float, missed: float) -> float:
    """Credibility of an effect of energy `effect` in a cell of noise at its mean, `missed` of it left over."""
    block = np.array([[effect + count, effect], [effect, effect]])
    cell = Cell("shock", "common", True, 3, count, 2, np.arange(2), block, 1.0, 10000)
    solution = Solution(np.array([1]), np.ones(1), np.zeros((1, 1)))
    gap, left = np.array([effect + count]), np.array([count + missed])
    rest = remainder([cell], np.ones(1), gap, left, _FLOOR, np.zeros(1))
    return credibility([cell], np.ones(1), solution, [1], rest)


def test_noise_that_happens_to_be_high_does_not_speak_against_a_name() -> None:
    """1000 coefficients of noise scatter by 45; an effect of energy 100 that leaves 60 more than the mean."""
    assert _trust(1000, 100.0, 60.0) == 1.0
    assert _trust(1000, 100.0, 95.0) == pytest.approx(1.0 - (95.0 - 2.0 * np.sqrt(2000.0)) / 100.0)
    # where the noise is nothing beside the effect the part left counts whole
    assert _trust(8, 1e6, 4e5) == pytest.approx(0.6, abs=0.001)


def test_an_effect_that_is_little_of_what_is_there_in_its_runs_is_not_prevalent() -> None:
    """The effect fits the slow band of a run alone; the unknown that is left there fills another."""
    count = 8.0
    cells, left = [], []
    for profile, own, others in (("shock", 100.0, 900.0), ("rates", 300.0, 0.0)):
        for band, energy in ((2, own), (7, 0.0)):
            block = np.array([[energy + count, energy], [energy, energy]])
            cells.append(Cell(profile, "common", True, band, count, 2, np.arange(2), block, 1.0, 10000))
        left += [count, count + others]
    solution = Solution(np.array([1]), np.ones(1), np.zeros((1, 1)))
    gap = np.array([cell.products(np.zeros(1, np.int64))[0, 0] for cell in cells]) + np.array(left) - count
    rest = remainder(cells, np.ones(4), gap, np.array(left), _FLOOR, np.zeros(4))
    beyond = 900.0 - 2.0 * np.sqrt(2.0 * count)
    expected = 0.25 * 100.0 / (100.0 + beyond) + 0.75
    assert prevalence(cells, gap, solution, rest) == pytest.approx(expected)
    assert credibility(cells, np.ones(4), solution, [1], rest) == pytest.approx(1.0)


def test_what_is_left_in_another_parity_makes_an_effect_no_less_prevalent() -> None:
    """A supply that dips whichever way the table turns does not look like a scale factor."""
    count = 8.0
    block = np.array([[108.0, 100.0], [100.0, 100.0]])
    still = np.array([[1008.0, 0.0], [0.0, 0.0]])
    cells = [
        Cell("rates", parity, True, 3, count, 2, np.arange(2), each, 1.0, 10000)
        for parity, each in (("odd", block), ("common", still))
    ]
    solution = Solution(np.array([1]), np.ones(1), np.zeros((1, 1)))
    gap, left = np.array([108.0, 1008.0]), np.array([8.0, 1008.0])
    rest = remainder(cells, np.ones(2), gap, left, _FLOOR, np.zeros(2))
    assert prevalence(cells, gap, solution, rest) == pytest.approx(1.0)


def test_an_effect_that_others_undo_is_not_prevalent() -> None:
    """Alone it would be a hundred times the gap: what is left of it beside its opponent proves no cause."""
    block = np.array([[18.0, 1000.0], [1000.0, 1000.0]])
    cell = Cell("rates", "common", True, 3, 8.0, 2, np.arange(2), block, 1.0, 10000)
    solution = Solution(np.array([1]), np.ones(1), np.zeros((1, 1)))
    rest = remainder([cell], np.ones(1), np.array([18.0]), np.array([8.0]), _FLOOR, np.zeros(1))
    assert prevalence([cell], np.array([18.0]), solution, rest) == pytest.approx(4.0 * 10.0 / 1000.0)


def test_rivals_share_a_place_and_what_is_elsewhere_does_not_count() -> None:
    weights = {
        frozenset({"curve", "gradient"}): (0.0, 0.5),
        frozenset({"curve", "thermal_lag"}): (0.1, 0.2),
        frozenset({"curve"}): (0.0, 0.2),
    }
    assert _of_any(weights, {"gradient", "thermal_lag"}) == pytest.approx(0.8)
    assert _of_any(weights, {"gradient"}) == pytest.approx(0.5)


def test_an_effect_is_refined_beside_the_curve_that_it_stands_with() -> None:
    names = ("hysteresis", "relaxation", "free curve: bias over T_in")
    posterior = SetPosterior(
        tuple(Candidate(name, k, (k + 1,), 1, curve=k == 2) for k, name in enumerate(names)),
        {
            frozenset(): 0.0,
            frozenset({0}): 5.0,
            frozenset({1}): 4.0,
            frozenset({2}): 30.0,
            frozenset({0, 2}): 40.0,
        },
    )
    assert sets_of_note(posterior, 12.0, 1) == [frozenset({0}), frozenset({0, 2})]


def test_what_the_nominal_model_takes_over_is_not_done_by_an_effect() -> None:
    """Columns of length 1 at 60 degrees, the nominal one free: 0.75 of the effect's energy is its own."""
    gram = np.array([[0.0, 0.0, 0.0], [0.0, 1.0, 0.5], [0.0, 0.5, 1.0]])
    fitted = Solution(np.array([1, 2]), np.array([7.0, 2.0]), np.zeros((2, 2)))
    own = beside_nominal(gram, np.array([1e9]), fitted, [2])
    assert own.indices.tolist() == [1, 2]
    assert own.values @ gram[1:, 1:] @ own.values == pytest.approx(0.75 * 4.0)
