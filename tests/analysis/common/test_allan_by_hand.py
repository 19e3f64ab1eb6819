"""Which starts an Allan deviation is made of, and what is taken for the flicker of a record that shows none."""

from __future__ import annotations

import numpy as np
import pytest

from bench.analysis.common.allan import allan_deviation
from bench.analysis.common.allan_confidence import degrees_of_freedom
from bench.analysis.common.allan_noise import _Scatter, fit_noise

FLICKER = 2.0 * np.log(2.0) / np.pi


@pytest.mark.parametrize(("count", "every"), [(1 << 20, True), ((1 << 20) + 1, False)])
def test_beyond_a_mebisample_a_few_starts_stand_for_all(count, every):
    """The last octave has one start at each sample left; of a longer record sixteen an averaging time."""
    allan = allan_deviation(np.random.default_rng(1).normal(size=count), 100.0)
    longest = 1 << 19
    assert allan.tau_s[-1] == longest / 100.0
    assert allan.terms[-1] == (count - 2 * longest + 1 if every else 1)
    assert allan.terms[12] == (count - 2 * 4096 + 1 if every else pytest.approx(count / 256 - 31, abs=2))


def test_a_short_record_is_of_all_starts_and_asked_for_few_of_sixteen():
    values = np.random.default_rng(2).normal(size=4096)
    assert allan_deviation(values, 1.0).terms.tolist() == [4097.0 - 2.0 * 2.0**k for k in range(12)]
    few = allan_deviation(values, 1.0, all_starts=False)
    assert few.terms[:5].tolist() == [4097.0 - 2.0 * 2.0**k for k in range(5)]
    # 32 samples an averaging time: starts at every other one
    assert few.terms[5] == (4096 - 64) // 2 + 1


@pytest.mark.parametrize("behind", [1, 5, 100, 255])
def test_a_few_samples_behind_the_last_block_begin_no_differences_that_they_cannot_end(behind):
    """Three blocks of starts, and what is left of the record: sums that do not reach their length are none."""
    count = 3 * 32768 + behind
    values = np.random.default_rng(behind).normal(size=count)
    few = allan_deviation(values, 1.0, all_starts=False)
    angle = np.concatenate(([0.0], np.cumsum(values)))
    for m, value, terms in zip(2 ** np.arange(len(few.tau_s)), few.deviation, few.terms, strict=True):
        start = np.arange(0, count - 2 * m + 1, max(1, m // 16))
        second = angle[start + 2 * m] - 2.0 * angle[start + m] + angle[start]
        assert terms == len(start), m
        assert value == pytest.approx(np.sqrt(np.mean(second**2) / 2.0) / m, rel=1e-9), m


@pytest.mark.parametrize(
    ("alpha", "first", "second"),
    [(2, -2.0 / 3.0, 1.0 / 6.0), (0, -0.5, 0.0), (-2, 0.25, 0.0),
     (-1, (9.0 * np.log(3.0) - 16.0 * np.log(2.0)) / (8.0 * np.log(2.0)), None)],
)  # fmt: skip
def test_degrees_of_freedom_of_a_few_differences_are_their_sum_by_hand(alpha, first, second):
    """Of 2, 3 and 4 samples there are 1, 2 and 3 differences; M over the sum of (1 - j/M) rho(j)^2."""
    assert degrees_of_freedom(2, 1, alpha) == pytest.approx(1.0)
    assert degrees_of_freedom(3, 1, alpha) == pytest.approx(2.0 / (1.0 + first**2))
    if second is None:  # t^2 ln t at 1 to 4, as second differences of second differences
        p = [0.0, 0.0, *(t * t * np.log(t) for t in (2.0, 3.0, 4.0))]
        second = (6.0 * p[2] - 4.0 * (p[3] + p[1]) + p[4] + p[0]) / (2.0 * p[2])
    expected = 3.0 / (1.0 + 4.0 / 3.0 * first**2 + 2.0 / 3.0 * second**2)
    assert degrees_of_freedom(4, 1, alpha) == pytest.approx(expected)


def test_a_ramps_share_of_the_scatter_is_the_mean_of_all_differences():
    """What a wave of each frequency does to differences of neighbouring means, summed sample by sample."""
    n, lengths = 300, (1, 7, 60)
    scatter = _Scatter(np.array(lengths) / 3600.0, n / 3600.0, 1.0 / 3600.0)
    # 96 points an octave, from 1/64 of a cycle a record to half the sample rate, each in its middle
    octaves = np.log2(64.0 * 0.5 * n)
    points = np.arange(0.5, octaves * 96.0)
    cycles = 2.0 ** (points / 96.0) / 64.0 / n  # a sample
    step = cycles * 3600.0 * np.log(2.0) / 96.0
    assert scatter.drift.shape == scatter.power.shape == (3, len(cycles))
    for row, m in enumerate(lengths):
        weight = np.concatenate((np.full(m, -1.0 / m), np.full(m, 1.0 / m)))
        for k in range(0, len(cycles), 37):
            wave = np.exp(2j * np.pi * cycles[k] * np.arange(n))
            each = np.convolve(wave, weight[::-1], "valid")
            assert len(each) == n - 2 * m + 1
            drift = m / 3600.0 * abs(each.mean()) * np.sqrt(2.0 * step[k])
            assert abs(scatter.drift[row, k]) == pytest.approx(drift, rel=1e-6, abs=1e-9 * m)
            power = abs(each[0]) ** 2 * np.sqrt(step[k] / (n / 3600.0))
            assert scatter.power[row, k] == pytest.approx(power, rel=1e-6)


@pytest.mark.parametrize(("count", "longest_s"), [(200, 16.0), (1000, 64.0), (20_000, 1024.0)])
def test_a_flicker_that_is_not_shown_counts_with_half_of_what_it_can_be_at_most(count, longest_s):
    """It is not more than the lowest variance, a standard error of it added: 2 ln 2 / pi B^2 is all of it."""
    times = [2.0**k for k in range(11) if 2.0**k <= 0.1 * count]
    assert times[-1] == longest_s
    white = allan_deviation(np.random.default_rng(1).normal(size=count), 1.0, [*times, 0.4 * count])
    fit = fit_noise(white)
    assert fit.low.bias_instability_dph == 0.0
    variances = [
        deviation**2 * (1.0 + 1.0 / np.sqrt(2.0 * (count / tau_s - 1.0)))
        for tau_s, deviation in zip(white.tau_s, white.deviation, strict=True)
        if tau_s <= longest_s
    ]
    assert fit.for_errors.bias_instability_dph == pytest.approx(0.5 * np.sqrt(min(variances) / FLICKER))
    assert fit.for_errors.bias_instability_dph > fit.coefficients.bias_instability_dph
