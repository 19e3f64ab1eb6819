"""Shapes between grid points, and smooth columns from means, against what they stand for."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.fft import dct

from bench.analysis.gap import Noise
from bench.analysis.gap._refine import _solved_within, between_grid_points
from bench.analysis.gap._stack import stacked
from simulators.effects import Stimulus, Variant
from tests.analysis.gap.conftest import effect, made_run, stimulus


def test_shapes_are_found_between_grid_points() -> None:
    """The data are a mode hop and a warm-up with shapes that no grid has; both are fitted together."""
    s = stimulus(12000)
    truth = [
        Variant(
            effect("mode_hop"),
            {"at_c": -11.3, "lag_s": 130.0, "width_k": 2.0, "loop_k": 0.0, "toward_case": 0.0},
        ),
        Variant(effect("warm_up"), {"time_constant_s": 1320.0, "stretch": 0.8}),
    ]
    data = 2.0 * truth[0].columns(s)[0] - 3.0 * truth[1].columns(s)[0]

    def gram(variants: Sequence[Variant]) -> np.ndarray:
        rows = np.concatenate([data[None], *(each.columns(s) for each in variants)])
        rows = rows - rows.mean(axis=1, keepdims=True)
        return rows @ rows.T * 100.0

    start = [
        Variant(
            truth[0].effect, {"at_c": -10.0, "lag_s": 0.0, "width_k": 2.5, "loop_k": 0.0, "toward_case": 0.0}
        ),
        Variant(truth[1].effect, {"time_constant_s": 900.0, "stretch": 1.0}),
    ]
    hop, warm_up = between_grid_points(start, gram)
    assert hop.shape["lag_s"] == pytest.approx(130.0, abs=25.0)
    assert hop.shape["at_c"] == pytest.approx(-11.3, abs=0.5)
    assert warm_up.shape["time_constant_s"] == pytest.approx(1320.0, rel=0.05)
    assert warm_up.shape["stretch"] == pytest.approx(0.8, abs=0.03)


@pytest.mark.parametrize("toward_case", [0.0, 0.3])
def test_a_shape_at_its_limit_does_not_spoil_the_others(toward_case: float) -> None:
    """The lag wants to fall below zero, where it may not go; loop, place and width are found all the same."""
    time_s = np.arange(1.0, 24_001.0)
    t_out_c = 10.0 + 15.0 * np.sin(time_s / 1400.0) + 6.0 * np.sin(time_s / 480.0)
    n = len(time_s)
    base = Stimulus(time_s, t_out_c, t_out_c, np.zeros(n + 1), np.zeros(n), 39.1)
    s = Stimulus(time_s, base.lagged(t_out_c, 240.0), t_out_c, np.zeros(n + 1), np.zeros(n), 39.1)
    hop = effect("mode_hop")
    shape = {"at_c": 12.0, "lag_s": 0.0, "width_k": 0.5, "loop_k": 1.6, "toward_case": toward_case}
    data = 2.0 * Variant(hop, shape).columns(s)[0]

    def gram(variants: Sequence[Variant]) -> np.ndarray:
        rows = np.concatenate([data[None], *(each.columns(s) for each in variants)])
        rows = rows - rows.mean(axis=1, keepdims=True)
        return rows @ rows.T * 100.0

    def left(variant: Variant) -> float:
        products = gram([variant])
        return float(products[0, 0] - products[0, 1] ** 2 / products[1, 1])

    begin = {"at_c": 14.0, "lag_s": 0.0, "width_k": 0.8, "loop_k": 0.0, "toward_case": 0.0}
    start = Variant(hop, begin)
    (found,) = between_grid_points([start], gram)
    assert left(found) < 1e-3 * left(start)
    assert found.shape["at_c"] == pytest.approx(12.0, abs=0.1)
    assert found.shape["width_k"] == pytest.approx(0.5, abs=0.05)


@given(st.integers(1, 4), st.integers(0, 3), st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_least_squares_within_bounds_is_that_of_all_corners(free: int, bound: int, seed: int) -> None:
    """Against every choice of values held at one of their bounds, by brute force."""
    rng = np.random.default_rng(seed)
    size = free + bound
    rows = rng.normal(size=(1 + size, 12))
    low = np.concatenate((np.full(free, -np.inf), -rng.uniform(0.0, 1.0, bound)))
    high = np.concatenate((np.full(free, np.inf), rng.uniform(0.0, 1.0, bound)))
    found = _solved_within(rows @ rows.T, low, high)
    nothing = np.zeros((2 + size, 2 + size))
    nothing[:-1, :-1] = rows @ rows.T
    nothing[-1, :-1] = nothing[:-1, -1] = 1e-13  # what rounding leaves of a column that does nothing
    nothing[-1, -1] = -1e-13
    beside = _solved_within(nothing, np.append(low, -1.0), np.append(high, 1.0))
    assert beside == pytest.approx(np.append(found, 0.0), abs=1e-9)
    best = np.inf
    for held in itertools.product(*([(None,)] * free + [(None, low[k], high[k]) for k in range(free, size)])):
        values = np.array([np.nan if at is None else at for at in held])
        loose = np.isnan(values)
        left = rows[0] - values[~loose] @ rows[1:][~loose]
        values[loose] = np.linalg.lstsq(rows[1:][loose].T, left, rcond=None)[0]
        if (values >= low - 1e-9).all() and (values <= high + 1e-9).all():
            best = min(best, float(np.square(rows[0] - values @ rows[1:]).sum()))
    assert (found >= low).all() and (found <= high).all()
    assert np.square(rows[0] - found @ rows[1:]).sum() <= best * (1.0 + 1e-3) + 1e-9


def test_effects_without_shapes_stay_as_they_are() -> None:
    start = [Variant(effect("azimuth_error"), {})]
    assert between_grid_points(start, lambda _: np.eye(2)) == start


@pytest.mark.parametrize("n", [12000, 9000, 5120])
def test_smooth_columns_from_means_have_the_coefficients_of_the_whole(n: int) -> None:
    s = stimulus(n)
    run = made_run("a", s, np.random.default_rng(1))
    rows = np.stack((s.warm_k, s.warming_k_per_min))
    stack = stacked([run], lambda _: [run.output_dph[None], rows], [False, True], Noise(0.01))
    whole = dct(rows, norm="ortho", axis=-1)[:, 1:]
    own = stack.chosen([1, 2])[0]
    assert (np.square(own - whole).sum(axis=1) < 1e-4 * np.square(whole).sum(axis=1)).all()
    assert stack.narrowed([2, 0], stack.full[:, :0]).chosen([0])[0, 0] == pytest.approx(own[1])
