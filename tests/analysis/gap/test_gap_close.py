"""Interval of the shrinkage and order of places, against draws of noise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from bench.analysis.gap import Model, Term
from bench.analysis.gap._cells import BANDS, Cell
from bench.analysis.gap._close import _interval, shrinkage
from bench.analysis.gap._fit import Floor
from bench.analysis.gap._where import places
from simulators.effects import Variant
from tests.analysis.gap.conftest import effect, made_run, stimulus

EXACT = Floor(np.ones(len(BANDS)), np.zeros(len(BANDS)), from_repeats=True)


def test_the_interval_of_the_shrinkage_holds_the_truth_as_often_as_it_says() -> None:
    """A gap s of which d is predicted, in two cells of 200 coefficients of unit noise."""
    rng = np.random.default_rng(3)
    number = np.array([200.0, 200.0])
    gap = rng.normal(0.0, 1.0, (2, 200))
    predicted = 0.9 * gap + 0.1 * rng.normal(0.0, 1.0, (2, 200))
    left = gap - predicted
    truth = 1.0 - np.square(left).sum() / np.square(gap).sum()
    held, shares = 0, []
    for _ in range(400):
        noise = rng.normal(0.0, 1.0, (2, 200))
        first, then = np.square(gap + noise).sum(axis=1), np.square(left + noise).sum(axis=1)
        changed = np.square(predicted).sum(axis=1)
        share, low, high = _interval(first, then, changed, number, np.array([0, 1]), EXACT)
        held += low <= truth <= high
        shares.append(share)
    assert 0.92 < held / 400 < 0.985
    assert abs(np.median(shares) - truth) < 0.01


def test_the_strongest_place_is_the_clearest_one_not_the_one_with_most_noise() -> None:
    def cell(band: int, count: int, energy: float) -> Cell:
        block = np.array([[energy]])
        return Cell("shock", "common", True, band, count, 1, np.zeros(1, dtype=np.int64), block, 1.0, 14000)

    # 1.5 standard deviations of noise in many coefficients against a gap in few
    cells = [cell(0, 8, 88.0), cell(10, 9000, 9200.0)]
    found = places(cells, np.array([88.0, 9200.0]), EXACT)
    assert [place.band for place in found] == [BANDS[0], BANDS[10]]
    assert found[0].share == 1.0


def test_a_gap_smaller_than_its_uncertainty_has_no_share() -> None:
    """It once had a bound of -7.9e12."""
    number, bands = np.array([1000.0]), np.array([0])
    share, low, high = _interval(np.array([1000.5]), np.array([999.0]), np.array([2.0]), number, bands, EXACT)
    assert np.isnan([share, low, high]).all()


def test_runs_without_a_gap_have_no_share_and_no_caution(nominal: Model) -> None:
    """Two models that differ by little more than the noise of their difference, on runs of neither."""
    s = stimulus(4000)
    runs = [made_run(f"judge {seed}", s, np.random.default_rng(seed)) for seed in range(4)]
    flat = Floor(np.ones(len(BANDS)), np.full(len(BANDS), 0.05), from_repeats=True)
    warm = Term(Variant(effect("warm_up"), {"time_constant_s": 900.0}), (0.05,), (0.01,))
    shrunk = shrinkage(nominal, replace(nominal, terms=(*nominal.terms, warm)), runs, flat)
    assert np.isnan(shrunk.share)
    assert shrunk.cells == 0
    assert not shrunk.caution


def test_what_is_left_within_seconds_counts_and_the_interval_holds_it(nominal: Model) -> None:
    """A slow part that the model takes away beside a quick one, alike in all runs, that stays."""
    s = stimulus(4000)
    warm = Term(Variant(effect("warm_up"), {"time_constant_s": 900.0}), (3.0,), (0.01,))
    slow = 3.0 * warm.variant.columns(s)[0]
    quick = 0.25 * np.diff(np.random.default_rng(99).normal(size=4001))
    runs = [
        made_run(f"judge {seed}", s, np.random.default_rng(seed), slow + quick, condition="0")
        for seed in range(3)
    ]
    flat = Floor(np.ones(len(BANDS)), np.full(len(BANDS), 0.02), from_repeats=True)
    shrunk = shrinkage(nominal, replace(nominal, terms=(*nominal.terms, warm)), runs, flat)
    gone, left = np.square(slow - slow.mean()).sum(), np.square(quick).sum()
    truth = gone / (gone + left)
    assert 0.3 < truth < 0.95
    assert abs(shrunk.share - truth) < 0.05
    assert shrunk.low < truth < shrunk.high
