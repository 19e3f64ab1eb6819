"""Figures of the standards against numbers worked out by hand and against closed forms of white noise."""

from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.common.statistics import bias_stability
from bench.analysis.figures._bias import (
    RateStep,
    bias_figures,
    repeatability,
    temperature_sensitivity,
    threshold,
    warm_up_time_s,
)
from bench.analysis.figures._scale_factor import (
    fit_rate_sequence,
    relative_repeatability_ppm,
    scale_factor_figures,
)
from drivers.base.errors import ConfigurationError

RATES = np.array([0, 5, 10, 20, 10, 5, 0, -5, -10, -20, -10, -5, 0], dtype=float)


def test_white_noise_shows_as_19_n_on_10_s_and_6_n_on_100_s() -> None:
    n = 0.004
    output = 0.5 + 9.486 + n * 60.0 * np.random.default_rng(0).standard_normal(400_000)
    figures = bias_figures(output, earth_rate_dph=9.486)
    assert figures.bias_dph == pytest.approx(0.5, abs=4 * n * 60 / 400_000**0.5)
    assert figures.stability_10s_dph == pytest.approx(18.97 * n, rel=0.02)
    assert figures.stability_100s_dph == pytest.approx(6.0 * n, rel=0.05)


def test_stability_counts_time_not_samples() -> None:
    rng = np.random.default_rng(1)
    fast = rng.standard_normal(100_000)
    slow = fast.reshape(-1, 10).mean(axis=1)
    assert bias_stability(fast, 100) == pytest.approx(bias_stability(slow, 10), rel=1e-12)


def test_repeatability_and_temperature_sensitivity_by_hand() -> None:
    assert repeatability([1.0, 2.0, 3.0, 4.0]) == pytest.approx(1.2909944)
    assert relative_repeatability_ppm([1.0, 1.00001, 0.99999]) == pytest.approx(10.0, rel=1e-6)
    # From 25 degC: 0.010/65 at -40, 0.012/40 at +65.
    assert temperature_sensitivity([0.0, 0.010, 0.012, 9.0], [25.0, -40.0, 65.0, 25.4]) == pytest.approx(3e-4)
    assert temperature_sensitivity([1.0, 1.00013], [25.0, -40.0], relative=True) == pytest.approx(
        2e-6, rel=1e-4
    )
    with pytest.raises(ConfigurationError, match="needs repeats"):
        repeatability([1.0])
    with pytest.raises(ConfigurationError, match="no two temperatures"):
        temperature_sensitivity([1.0, 2.0], [25.0, 25.5])


def test_warm_up_ends_where_the_output_stays_inside() -> None:
    time = np.arange(10_000.0)
    output = 1.0 + 0.1 * np.exp(-time / 1000.0)
    # 0.1 exp(-t/1000) = 0.01 at 2303 s: the block from 2300 s has its mean inside.
    assert warm_up_time_s(output, 0.01) == pytest.approx(2300.0, abs=100.0)
    assert warm_up_time_s(np.ones(1000), 0.01) == 0.0
    assert np.isnan(warm_up_time_s(np.append(np.ones(900), np.full(100, 5.0)), 0.01))


def test_scale_factor_line_is_polyfits() -> None:
    rng = np.random.default_rng(2)
    output = 1.0001 * RATES + 0.003 + rng.normal(0, 1e-5, len(RATES))
    fit = fit_rate_sequence(RATES, output)
    assert (fit.scale_factor, fit.offset) == pytest.approx(tuple(np.polyfit(RATES, output, 1)), rel=1e-9)
    assert abs(fit.residual.sum()) < 1e-12


def test_asymmetry_nonlinearity_hysteresis_and_repeatability() -> None:
    true = np.where(RATES > 0, 1.0 + 30e-6, 1.0 - 30e-6) * RATES
    figures = scale_factor_figures([(RATES, true), (RATES, true * (1 + 20e-6))])
    assert figures.asymmetry_ppm == pytest.approx(60.0, rel=1e-3)
    assert figures.hysteresis_ppm == pytest.approx(0.0, abs=1e-6)
    assert figures.repeatability_ppm == pytest.approx(20.0 / np.sqrt(2), rel=1e-3)
    # A kink of 60 ppm: residual worked out with polyfit.
    residual = true - np.polyval(np.polyfit(RATES, true, 1), RATES)
    assert figures.nonlinearity_ppm == pytest.approx(1e6 * np.abs(residual).max() / 20.0, rel=1e-3)
    late = RATES + np.where(np.diff(RATES, prepend=0.0) < 0, 1e-4, 0.0)
    assert scale_factor_figures([(RATES, late)]).hysteresis_ppm == pytest.approx(5.0, rel=0.01)
    assert scale_factor_figures([(RATES, true)]).repeatability_ppm is None


def test_sequences_without_a_slope_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="no scale factor"):
        fit_rate_sequence([1.0, 1.0, 2.0], [1.0, 1.0, 2.0])
    with pytest.raises(ConfigurationError, match="asymmetry"):
        scale_factor_figures([([1.0, 2.0, 3.0], [1.0, 2.0, 3.0])])


def test_threshold_is_the_smallest_input_below_which_nothing_passes() -> None:
    steps = [
        RateStep(rate, rate * share) for rate, share in ((0.1, 0.9), (0.01, 0.6), (0.03, 0.8), (0.003, 0.2))
    ]
    assert threshold(steps) == 0.01
    assert threshold([*steps, RateStep(0.05, 0.0)]) == 0.1
    assert threshold([RateStep(-0.2, -0.19), RateStep(0.05, 0.01)]) == 0.2
    with pytest.raises(ConfigurationError, match="above all of them"):
        threshold([RateStep(0.1, 0.0)])


def test_asymmetry_of_rates_below_one_degree_a_second() -> None:
    """Slopes of 1 + 30 ppm and 1 - 30 ppm differ by 60 ppm of their mean, however slow the rates are."""
    rates = np.array([-0.5, -0.25, -0.1, 0.0, 0.1, 0.25, 0.5])
    output = np.where(rates > 0, 1.0 + 30e-6, 1.0 - 30e-6) * rates
    figures = scale_factor_figures([(rates, output)])
    assert figures.asymmetry_ppm == pytest.approx(60.0, rel=1e-3)
    residual = output - np.polyval(np.polyfit(rates, output, 1), rates)
    assert figures.nonlinearity_ppm == pytest.approx(1e6 * np.abs(residual).max() / 0.5, rel=1e-7)
    for part in (rates >= 0, rates <= 0):
        with pytest.raises(ConfigurationError, match="asymmetry"):
            scale_factor_figures([(rates[part], output[part])])
