"""Noise spectra and whitening against covariance matrices and exact likelihood."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.fft import dct
from scipy.linalg import solve_triangular

from bench.analysis.gap._noise import Noise, fit_noise, periodogram, spectrum


def _covariance(noise: Noise, n: int) -> np.ndarray:
    """Covariance of 1 s samples from the processes' definitions; the walk starts at zero."""
    lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    total = np.eye(n) * (60.0 * noise.arw_deg_per_sqrt_h) ** 2
    each = noise.bias_instability_dph**2 * math.log(3.0) / math.pi
    for time_s in 3.0 ** np.arange(9):
        total += each * np.exp(-lag / time_s)
    walk = noise.rate_random_walk_dph_per_sqrt_h / 60.0
    total += walk**2 * (np.minimum.outer(np.arange(n), np.arange(n)) + 1.0)
    step = np.eye(n) - np.eye(n, k=-1)
    return total + step @ step.T * noise.quantum_arcsec**2 / 12.0


@pytest.mark.parametrize(
    "noise",
    [
        Noise(0.004),
        Noise(0.004, 0.0, 0.6),
        Noise(0.004, 0.1),
        Noise(0.004, 0.006, 0.03, 0.05),
    ],
)
def test_dct_whitens_the_exact_covariance(noise: Noise) -> None:
    n = 600
    transform = dct(np.eye(n), norm="ortho", axis=0)[1:]
    power = spectrum(noise, np.arange(1, n) / n, 1.0)
    whitened = transform @ _covariance(noise, n) @ transform.T / np.sqrt(np.outer(power, power))
    assert np.diag(whitened).mean() == pytest.approx(1.0, abs=0.01)
    assert np.diag(whitened)[:40] == pytest.approx(np.ones(40), abs=0.35)
    off = whitened - np.diag(np.diag(whitened))
    assert np.abs(off).max() < 0.3
    assert np.sqrt((off**2).sum() / n) < 0.08


def test_white_and_walk_are_diagonal_exactly() -> None:
    n = 400
    noise = Noise(0.004, 0.0, 2.0)
    transform = dct(np.eye(n), norm="ortho", axis=0)[1:]
    covariance = transform @ _covariance(noise, n) @ transform.T
    power = spectrum(noise, np.arange(1, n) / n, 1.0)
    scaled = covariance / np.sqrt(np.outer(power, power))
    # the walk's last sample ends free, so that only a rank-one part of order 1/n is left
    assert np.diag(scaled)[5:].mean() == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("noise", [Noise(0.004, 0.006, 0.03, 0.05), Noise(0.004, 0.03, 0.05)])
def test_estimates_in_the_dct_are_as_good_as_the_exact_ones(noise: Noise) -> None:
    """Variance of an amplitude's estimate beside a free bias: generalised least squares and the DCT's weights."""
    n = 800
    covariance = _covariance(noise, n)
    column = np.tanh((np.arange(n) - 350.0) / 60.0)
    factor = np.linalg.cholesky(covariance)
    exact = solve_triangular(factor, np.stack((column, np.ones(n)), axis=1), lower=True)
    bias = exact[:, 1] / np.linalg.norm(exact[:, 1])
    best = 1.0 / float(((exact[:, 0] - bias * (bias @ exact[:, 0])) ** 2).sum())
    transform = dct(np.eye(n), norm="ortho", axis=0)[1:]
    weights = transform @ column / spectrum(noise, np.arange(1, n) / n, 1.0)
    information = float(weights @ (transform @ column))
    actual = float(weights @ transform @ covariance @ transform.T @ weights) / information**2
    assert actual < 1.04 * best
    assert 1.0 / information == pytest.approx(actual, rel=0.2)


def test_fit_finds_the_coefficients() -> None:
    rng = np.random.default_rng(5)
    n, truth = 4096, Noise(0.004, 0.02, 0.0, 0.3)
    power = spectrum(truth, np.arange(1, n) / n, 1.0)
    data = [periodogram(_rows(power, rng), 1.0) for _ in range(6)]
    widths = {"arw_deg_per_sqrt_h": 1.0, "bias_instability_dph": 1.0, "quantum_arcsec": 1.0}
    found = fit_noise(data, Noise(0.006, 0.01, 0.0, 0.2), widths).noise
    assert found.arw_deg_per_sqrt_h == pytest.approx(0.004, rel=0.05)
    assert found.bias_instability_dph == pytest.approx(0.02, rel=0.2)
    assert found.quantum_arcsec == pytest.approx(0.3, rel=0.15)


def _rows(power: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    rows = np.zeros((2, len(power) + 1))
    rows[:, 1:] = rng.standard_normal((2, len(power))) * np.sqrt(power)
    return rows


def test_periodogram_counts_every_coefficient_once() -> None:
    rng = np.random.default_rng(6)
    rows = rng.standard_normal((3, 500))
    found = periodogram(rows, 1.0)
    assert found.count.sum() == 3 * 499
    assert found.energy.sum() == pytest.approx((rows[:, 1:] ** 2).sum())
