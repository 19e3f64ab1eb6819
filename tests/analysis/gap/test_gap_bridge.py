"""Missing samples: against the conditional mean of the whole covariance, and what is left of noise."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.analysis.gap import Noise
from bench.analysis.gap._bridge import bridge, noise_left
from bench.analysis.gap._noise import power_of

WALKING = Noise(0.01, 0.0, 0.5)


def _missing(n: int, *gaps: tuple[int, int]) -> np.ndarray:
    missing = np.zeros(n, dtype=bool)
    for start, stop in gaps:
        missing[start:stop] = True
    return missing


def test_a_gap_is_filled_as_by_the_conditional_mean() -> None:
    """White noise and a random walk: the mean of the missing samples given all others, by dense algebra."""
    n, rng = 400, np.random.default_rng(4)
    missing = _missing(n, (150, 190))
    steps = WALKING.rate_random_walk_dph_per_sqrt_h**2 / 3600.0
    white = WALKING.arw_deg_per_sqrt_h**2 * 3600.0
    walk = steps * np.minimum.outer(np.arange(1.0, n + 1), np.arange(1.0, n + 1)) + 1e6  # a free start
    covariance = walk + white * np.eye(n)
    values = rng.multivariate_normal(np.zeros(n), walk - 1e6 + white * np.eye(n))
    known = ~missing
    # of the noise-free walk in the gap: white noise has no prediction
    expected = walk[np.ix_(missing, known)] @ np.linalg.solve(covariance[np.ix_(known, known)], values[known])
    filled = bridge(missing, 1.0, WALKING).over(values[None])[0]
    scatter = float(np.sqrt(np.mean((filled[missing] - expected) ** 2)))
    straight = np.interp(np.flatnonzero(missing), np.flatnonzero(known), values[known])
    assert scatter < 0.25 * float(np.sqrt(np.mean((straight - expected) ** 2)))
    assert filled[known] == pytest.approx(values[known], abs=0.0)


def test_white_noise_is_filled_by_the_mean_of_the_rest() -> None:
    n = 1000
    missing = _missing(n, (300, 500))
    values = np.random.default_rng(1).normal(size=n)
    filled = bridge(missing, 1.0, Noise(0.01)).over(values[None])[0]
    assert filled[missing] == pytest.approx(np.full(200, values[~missing].mean()), abs=0.02)


@given(st.lists(st.tuples(st.integers(0, 480), st.integers(1, 60)), min_size=1, max_size=5), st.floats(-5, 5))
@settings(max_examples=30, deadline=None)
def test_bridging_is_linear_and_keeps_a_constant(gaps: list[tuple[int, int]], factor: float) -> None:
    n = 512
    missing = _missing(n, *((start, start + length) for start, length in gaps))
    first, second = np.random.default_rng(2).normal(size=(2, n))
    over = bridge(missing, 1.0, WALKING).over
    both = over(np.stack((first, second, first + factor * second + 7.0)))
    assert both[2] == pytest.approx(both[0] + factor * both[1] + 7.0, abs=1e-8)


def test_of_white_noise_the_known_part_is_left_in_fast_coefficients_and_more_in_slow_ones() -> None:
    """A tenth is missing in one piece: fast coefficients keep nine tenths; the slow ones are those of a mean."""
    n = 4000
    missing = _missing(n, (1000, 1400))
    left = noise_left(missing, 1.0, Noise(0.01), Noise(0.01))
    assert left[n // 2 :].mean() == pytest.approx(0.9, abs=0.01)
    # sum over all coefficients: the known samples' energy and the little of the filled mean
    assert (left * power_of(Noise(0.01), n, 1.0)).sum() == pytest.approx(0.9 * 0.36 * n, rel=0.02)


def test_without_gaps_nothing_is_left_out() -> None:
    assert noise_left(np.zeros(300, dtype=bool), 1.0, WALKING, WALKING) == pytest.approx(np.ones(299))


def test_a_gap_of_one_sample_leaves_slow_noise_as_it_is() -> None:
    """Down to the bin of the lowest coefficient, in which 64 draws count."""
    missing = np.arange(8000) == 4000
    noise = Noise(0.01, 0.1, 1.0)
    assert noise_left(missing, 1.0, noise, noise)[:1000] == pytest.approx(np.ones(1000), abs=3e-3)
