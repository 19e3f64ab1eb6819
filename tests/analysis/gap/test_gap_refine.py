"""Shapes between grid points, and smooth columns from means, against what they stand for."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.fft import dct

from bench.analysis.gap import Noise
from bench.analysis.gap._refine import between_grid_points
from bench.analysis.gap._stack import stacked
from simulators.effects import Variant
from tests.analysis.gap.conftest import effect, made_run, stimulus


def test_shapes_are_found_between_grid_points() -> None:
    """The data are a mode hop and a warm-up with shapes that no grid has; both are fitted together."""
    s = stimulus(12000)
    truth = [
        Variant(effect("mode_hop"), {"at_c": -11.3, "lag_s": 130.0, "width_k": 2.0}),
        Variant(effect("warm_up"), {"time_constant_s": 1320.0, "stretch": 0.8}),
    ]
    data = 2.0 * truth[0].columns(s)[0] - 3.0 * truth[1].columns(s)[0]

    def gram(variants: Sequence[Variant]) -> np.ndarray:
        rows = np.concatenate([data[None], *(each.columns(s) for each in variants)])
        rows = rows - rows.mean(axis=1, keepdims=True)
        return rows @ rows.T * 100.0

    start = [
        Variant(truth[0].effect, {"at_c": -10.0, "lag_s": 0.0, "width_k": 2.5}),
        Variant(truth[1].effect, {"time_constant_s": 900.0, "stretch": 1.0}),
    ]
    hop, warm_up = between_grid_points(start, gram)
    assert hop.shape["lag_s"] == pytest.approx(130.0, abs=25.0)
    assert hop.shape["at_c"] == pytest.approx(-11.3, abs=0.5)
    assert warm_up.shape["time_constant_s"] == pytest.approx(1320.0, rel=0.05)
    assert warm_up.shape["stretch"] == pytest.approx(0.8, abs=0.03)


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
