"""Figures of the standards against numbers worked out by hand and against closed forms of white noise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from bench.analysis.common.allan_noise import NoiseCoefficients
from bench.analysis.common.mean_noise import covariance_of_means, freedom_of_blocks
from bench.analysis.common.statistics import bias_stability
from bench.analysis.figures._bias import (
    RateStep,
    bias_figures,
    temperature_sensitivity,
    threshold,
    warm_up_time_s,
)
from bench.analysis.figures._parts import Figure
from bench.analysis.figures._scale_factor import (
    RateSequence,
    ScaleFactorFigures,
    _freedom,
    fit_rate_sequence,
    scale_factor_figures,
)
from drivers.base.errors import ConfigurationError

NO_NOISE = NoiseCoefficients(0.0, 0.0, 0.0, 0.0, 0.0)
RATES = np.array([0, 5, 10, 20, 10, 5, 0, -5, -10, -20, -10, -5, 0], dtype=float)


def test_white_noise_shows_as_19_n_on_10_s_and_6_n_on_100_s() -> None:
    n = 0.004
    output = 0.5 + 9.486 + n * 60.0 * np.random.default_rng(0).standard_normal(400_000)
    figures = bias_figures(output, 9.486, NoiseCoefficients(0.0, n, 0.0, 0.0, 0.0))
    error = n * 60 / 400_000**0.5
    assert figures.bias_dph.value == pytest.approx(0.5, abs=4 * error)
    assert figures.bias_dph.high - figures.bias_dph.low == pytest.approx(2 * 1.96 * error, rel=1e-4)
    assert figures.stability_10s_dph.value == pytest.approx(18.97 * n, rel=0.02)
    assert figures.stability_100s_dph.value == pytest.approx(6.0 * n, rel=0.05)
    # chi-squared with 3999 degrees of freedom: its 97.5 % point is 4175.1 (Wilson and Hilferty)
    low = figures.stability_100s_dph.value * (3999 / 4175.1) ** 0.5
    assert figures.stability_100s_dph.low == pytest.approx(low, rel=1e-3)


def test_stability_counts_time_not_samples() -> None:
    rng = np.random.default_rng(1)
    fast = rng.standard_normal(100_000)
    slow = fast.reshape(-1, 10).mean(axis=1)
    assert bias_stability(fast, 100) == pytest.approx(bias_stability(slow, 10), rel=1e-12)


def test_temperature_sensitivity_by_hand() -> None:
    none = np.zeros((5, 4))
    # From 25 degC: 0.010/65 at -40, 0.012/40 at +65.
    of_bias = temperature_sensitivity([0.0, 0.010, 0.012, 9.0], [25.0, -40.0, 65.0, 25.4], none)
    assert of_bias.value == pytest.approx(3e-4)
    of_scale = temperature_sensitivity([1.0, 1.00013], [25.0, -40.0], none[:, :2], relative=True)
    assert of_scale.value == pytest.approx(2e-6, rel=1e-4)
    assert temperature_sensitivity([1.0, 1.5], [25.0, 26.0], none[:, :2]).value == pytest.approx(0.5)
    with pytest.raises(ConfigurationError, match="no two temperatures"):
        temperature_sensitivity([1.0, 2.0], [25.0, 25.5], none[:, :2])


def test_warm_up_ends_where_the_output_stays_inside() -> None:
    time = np.arange(10_000.0)
    output = 1.0 + 0.1 * np.exp(-time / 1000.0)
    # 0.1 exp(-t/1000) = 0.01 at 2303 s: the block from 2300 s has its mean inside.
    found = warm_up_time_s(output, 0.01, NO_NOISE)
    assert found.value == pytest.approx(2300.0, abs=100.0) and found.low <= 2303.0 <= found.high
    still = warm_up_time_s(np.ones(1000), 0.01, NO_NOISE)
    assert (still.value, still.seen, still.bound) == (0.0, False, 50.0)
    with pytest.raises(ConfigurationError, match="still warming up"):
        warm_up_time_s(np.append(np.ones(900), np.full(100, 5.0)), 0.01, NO_NOISE)
    with pytest.raises(ConfigurationError, match="no warm-up time"):
        warm_up_time_s(np.ones(350), 0.01, NO_NOISE)


def test_a_single_mean_outside_is_no_warm_up_and_the_interval_holds_that_of_a_transient() -> None:
    n = 0.01
    noise = NoiseCoefficients(0.0, n, 0.0, 0.0, 0.0)
    tolerance = 3.0 * 6.0 * n
    rng = np.random.default_rng(4)
    time = np.arange(3600.0)
    spiked = np.ones(3600)
    spiked[1000:1100] += 2.0 * tolerance
    assert not warm_up_time_s(spiked, tolerance, noise).seen
    slow = 1.0 * np.exp(-time / 400.0)
    level = slow[-900:].mean()  # the band lies about what the unit settles to
    truth = float(time[np.abs(slow - level) > tolerance][-1])
    held = seen = 0
    for _ in range(40):
        white = n * 60.0 * rng.standard_normal(3600)
        seen += warm_up_time_s(white, tolerance, noise).seen
        found = warm_up_time_s(slow + white, tolerance, noise)
        held += found.low <= truth <= found.high
    assert seen == 0 and held >= 35


def test_scale_factor_line_is_polyfits() -> None:
    rng = np.random.default_rng(2)
    output = 1.0001 * RATES + 0.003 + rng.normal(0, 1e-5, len(RATES))
    fit = fit_rate_sequence(RATES, output)
    assert (fit.scale_factor, fit.offset) == pytest.approx(tuple(np.polyfit(RATES, output, 1)), rel=1e-9)
    assert abs(fit.residual.sum()) < 1e-12


def figures_of(*sequences: tuple[np.ndarray, np.ndarray]) -> ScaleFactorFigures:
    """Dwells of 60 s, 80 s apart, of a gyro without noise."""
    made = []
    for number, (rates, output) in enumerate(sequences):
        start = 80.0 * (np.arange(len(rates)) + number * len(rates))
        made.append(RateSequence(rates, rates, np.asarray(output), start, start + 60.0))
    return scale_factor_figures(made, NO_NOISE)


def test_asymmetry_nonlinearity_hysteresis_and_repeatability() -> None:
    true = np.where(RATES > 0, 1.0 + 30e-6, 1.0 - 30e-6) * RATES
    figures = figures_of((RATES, true), (RATES, true * (1 + 20e-6)))
    assert figures.asymmetry_ppm.value == pytest.approx(60.0, rel=1e-3)
    assert figures.hysteresis_ppm is not None and figures.repeatability_ppm is not None
    assert figures.hysteresis_ppm.value == pytest.approx(0.0, abs=1e-6)
    assert figures.repeatability_ppm.value == pytest.approx(20.0 / np.sqrt(2), rel=1e-3)
    # A kink of 60 ppm: residual worked out with polyfit.
    residual = true - np.polyval(np.polyfit(RATES, true, 1), RATES)
    assert figures.nonlinearity_ppm.value == pytest.approx(1e6 * np.abs(residual).max() / 20.0, rel=1e-3)
    assert figures_of((RATES, true)).repeatability_ppm is None


def test_asymmetry_and_hysteresis_keep_their_signs() -> None:
    for sign in (1.0, -1.0):
        kinked = (1.0 + sign * 30e-6 * np.sign(RATES)) * RATES
        assert figures_of((RATES, kinked)).asymmetry_ppm.value == pytest.approx(sign * 60.0, rel=1e-3)
        # Only at 10 deg/s does it matter from where the rate is reached: the line takes no part of it up.
        late = RATES + np.where((np.diff(RATES, prepend=0.0) < 0) & (RATES == 10.0), sign * 1e-4, 0.0)
        hysteresis = figures_of((RATES, late)).hysteresis_ppm
        assert hysteresis is not None and hysteresis.value == pytest.approx(sign * 5.0, rel=0.2)


def test_sequences_without_a_slope_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="no scale factor"):
        fit_rate_sequence([1.0, 1.0, 2.0], [1.0, 1.0, 2.0])
    with pytest.raises(ConfigurationError, match="asymmetry"):
        figures_of((RATES[1:4], RATES[1:4]))


def test_threshold_is_the_smallest_input_below_which_nothing_passes() -> None:
    steps = [
        RateStep(rate, rate * share) for rate, share in ((0.1, 0.9), (0.01, 0.6), (0.03, 0.8), (0.003, 0.2))
    ]
    assert threshold(steps).value == 0.01
    assert threshold([*steps, RateStep(0.05, 0.0)]).value == 0.1
    assert threshold([RateStep(-0.2, -0.19), RateStep(0.05, 0.01)]).value == 0.2
    with pytest.raises(ConfigurationError, match=r"no input is shown.*0\.1 deg/h gave 40 \+- 98 %"):
        threshold([RateStep(0.1, 0.04, 0.05)])


def test_asymmetry_of_rates_below_one_degree_a_second() -> None:
    """Slopes of 1 + 30 ppm and 1 - 30 ppm differ by 60 ppm of their mean, however slow the rates are."""
    rates = np.array([-0.5, -0.25, -0.1, 0.0, 0.1, 0.25, 0.5])
    output = np.where(rates > 0, 1.0 + 30e-6, 1.0 - 30e-6) * rates
    figures = figures_of((rates, output))
    assert figures.asymmetry_ppm.value == pytest.approx(60.0, rel=1e-3)
    residual = output - np.polyval(np.polyfit(rates, output, 1), rates)
    assert figures.nonlinearity_ppm.value == pytest.approx(1e6 * np.abs(residual).max() / 0.5, rel=1e-7)
    for part in (rates >= 0, rates <= 0):
        with pytest.raises(ConfigurationError, match="asymmetry"):
            figures_of((rates[part], output[part]))


def test_a_threshold_that_noise_hides_is_not_seen_above_what_shows() -> None:
    """With 0.02 deg/h of noise a step of 0.01 tells nothing; 0.08 gives 0.5 only beyond 1.96 of it."""
    shares = ((0.01, -0.5), (0.02, 0.3), (0.04, 1.2), (0.08, 1.0), (0.16, 1.0))
    found = threshold([RateStep(size, size * share, 0.02) for size, share in shares])
    assert (found.value, found.low, found.high, found.seen) == (0.08, 0.0, 0.08, False)
    dead = threshold([RateStep(size, size * (size > 0.1), 0.01) for size, _ in shares])
    assert (dead.value, dead.low, dead.high, dead.seen) == (0.16, 0.08, 0.16, True)


def test_degrees_of_freedom_are_those_of_the_whole_covariance() -> None:
    for noise in (
        NoiseCoefficients(1e-5, 0.01, 0.0, 0.0, 0.0),
        NoiseCoefficients(0.0, 0.01, 0.02, 0.05, 0.0),
    ):
        start = 10.0 * np.arange(30)
        centre = np.eye(30) - 1.0 / 30
        covariance = centre @ covariance_of_means(start, start + 10.0, noise) @ centre
        expected = np.trace(covariance) ** 2 / np.trace(covariance @ covariance)
        assert freedom_of_blocks(30, 10.0, noise) == pytest.approx(expected, rel=1e-6)
    assert freedom_of_blocks(30, 10.0, NoiseCoefficients(0.0, 0.01, 0.0, 0.0, 0.0)) == pytest.approx(29.0)


def test_the_standard_error_of_a_figure_is_half_of_its_interval_over_1_96() -> None:
    assert Figure("bias", 1.0, "deg/h", "", -0.96, 2.96).standard_error == pytest.approx(1.0, rel=1e-3)
    assert [Figure("bias", 1.0, "deg/h", "", *ends).standard_error for ends in ((), (0.5,), (None, 2.0))] == [
        0.0
    ] * 3


def test_repeats_of_one_sequence_have_degrees_of_freedom_and_others_none() -> None:
    """Each of m equal sequences of n rates, less a line: (m - 1) (n - 2). Other rates repeat nothing."""
    one, other = (RateSequence(rates, rates, rates, rates, rates) for rates in (RATES, RATES + 1.0))
    assert _freedom([one, one]) == 11.0 and _freedom([one, one, one]) == 22.0
    assert math.isinf(_freedom([one, other])) and math.isinf(_freedom([one]))
