"""Covariance of means against the Allan variance's closed forms and against sums over every sample."""

from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.common.allan_noise import NoiseCoefficients
from bench.analysis.common.mean_noise import covariance_of_means, draws, white_variance

NOISES = {
    "quantisation": NoiseCoefficients(2e-5, 0.0, 0.0, 0.0, 0.0),
    "walk": NoiseCoefficients(0.0, 0.01, 0.0, 0.0, 0.0),
    "flicker": NoiseCoefficients(0.0, 0.0, 0.02, 0.0, 0.0),
    "drift": NoiseCoefficients(0.0, 0.0, 0.0, 0.05, 0.0),
}


@pytest.mark.parametrize("name", NOISES)
def test_neighbouring_means_differ_by_the_allan_variance(name: str) -> None:
    """IEEE Std 952: the Allan variance is half the mean square of the difference of neighbouring means."""
    for tau_s in (1.0, 60.0, 3600.0):
        covariance = covariance_of_means([0.0, tau_s], [tau_s, 2.0 * tau_s], NOISES[name])
        weights = np.array([1.0, -1.0])
        expected = NOISES[name].deviation(tau_s) ** 2
        assert 0.5 * weights @ covariance @ weights == pytest.approx(float(expected), rel=1e-9)


def test_stretches_with_pauses_are_those_of_a_walk_summed_sample_by_sample() -> None:
    start, end = np.array([0.0, 100.0, 400.0, 470.0]), np.array([60.0, 160.0, 430.0, 500.0])
    contrast = np.array([0.4, -1.1, 0.9, -0.2])
    sample_s, k = 0.25, 0.05
    time = np.arange(0.0, 500.0, sample_s) + 0.5 * sample_s
    inside = (time >= start[:, None]) & (time < end[:, None])
    weights = contrast @ (inside / inside.sum(axis=1, keepdims=True))
    walk = k**2 / 3600.0 * np.minimum.outer(time, time)
    found = contrast @ covariance_of_means(start, end, NOISES["drift"]) @ contrast
    assert found == pytest.approx(weights @ walk @ weights, rel=1e-3)


def test_white_noise_of_a_mean_and_draws_with_their_covariance() -> None:
    assert white_variance(900.0, NOISES["walk"]) == pytest.approx((0.01 * 60.0) ** 2 / 900.0)
    covariance = np.array([[2.0, -0.7], [-0.7, 1.0]])
    assert np.cov(draws(covariance, 100_000).T) == pytest.approx(covariance, abs=0.03)
    many = draws(covariance, 500)
    assert np.cov(many.T, ddof=0) == pytest.approx(covariance, abs=1e-9)
    assert many.mean(axis=0) == pytest.approx(0.0, abs=1e-9)
    few = draws(covariance, 2 * len(covariance))
    assert few.shape == (2 * len(covariance), len(covariance)) and np.isfinite(few).all()
    assert np.array_equal(draws(covariance, 500), many) and not np.array_equal(
        draws(covariance, 500, 1), many
    )
