"""Allan deviation against published vectors, another implementation and closed forms; noise coefficients back."""

from __future__ import annotations

import allantools
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2

from bench.analysis.common.allan import _BLOCK, LONG_RECORD, AllanDeviation, allan_deviation
from bench.analysis.common.allan_confidence import confidence_interval, degrees_of_freedom, noise_exponents
from bench.analysis.common.allan_noise import NOISE_NAMES, _basis, _Scatter, _spectra, fit_noise
from drivers.base.errors import ConfigurationError, RecordError

NBS_9 = [892.0, 809.0, 823.0, 798.0, 671.0, 644.0, 883.0, 903.0, 677.0]


def sp1065_1000() -> np.ndarray:
    """The 1000-point set of NIST SP 1065 section 12.4: a Lehmer generator, n <- 16807 n mod (2^31 - 1)."""
    n, values = 1234567890, []
    for _ in range(1000):
        values.append(n / 2147483647)
        n = 16807 * n % 2147483647
    return np.array(values)


def test_check_17_nbs_nine_points() -> None:
    allan = allan_deviation(np.array(NBS_9), 1.0, [1.0, 2.0])
    assert np.allclose(allan.deviation, [91.22945, 85.95287], rtol=1e-7)
    assert np.array_equal(allan.terms, [8, 6])


def test_check_17_sp1065_thousand_points() -> None:
    data = sp1065_1000()
    # The set's own statistics, SP 1065 table 31: the generator is right before its result is judged.
    assert (data.max(), data.min(), data.mean(), data.std(ddof=1)) == pytest.approx(
        (0.9957453, 1.371760e-3, 0.4897745, 0.2884664), rel=1e-6
    )
    allan = allan_deviation(data, 1.0, [1.0, 10.0, 100.0])
    assert np.allclose(allan.deviation, [0.2922319, 0.09159953, 0.03241343], rtol=2e-7)


@settings(max_examples=20, deadline=None)
@given(st.integers(50, 3000), st.integers(0, 2**31), st.sampled_from([1.0, 10.0, 100.0]))
def test_equal_to_allantools(count: int, seed: int, rate_hz: float) -> None:
    data = 5.0 + np.cumsum(np.random.default_rng(seed).normal(size=count)) * 0.1
    taus = np.geomspace(1, count // 3, 12) / rate_hz
    ours = allan_deviation(data, rate_hz, taus)
    tau, expected, _, number = allantools.oadev(data, rate=rate_hz, data_type="freq", taus=ours.tau_s)
    assert np.allclose(ours.tau_s, tau)
    assert np.allclose(ours.deviation, expected, rtol=1e-8)
    assert np.array_equal(ours.terms[: len(number)], number)


def test_blocks_join_without_a_seam() -> None:
    data = np.random.default_rng(1).normal(size=2 * _BLOCK + 777)
    m = 37
    means = np.convolve(data, np.ones(m) / m, "valid")
    expected = np.sqrt(np.mean((means[m:] - means[:-m]) ** 2) / 2)
    assert allan_deviation(data, 1.0, m).deviation[0] == pytest.approx(expected, rel=1e-10)


def test_octaves_reach_half_the_record_and_white_noise_falls_with_the_root_of_time() -> None:
    data = np.random.default_rng(2).normal(size=1 << 18)
    allan = allan_deviation(data, 100.0)
    assert np.array_equal(allan.tau_s * 100, 2.0 ** np.arange(18))
    expected = 1.0 / np.sqrt(allan.tau_s * 100)
    assert (np.abs(allan.deviation / expected - 1)[:10] < 5 * allan.relative_error[:10]).all()


def test_a_large_mean_costs_no_digits() -> None:
    data = np.random.default_rng(3).normal(size=200_000)
    small, large = (allan_deviation(data + level, 1.0, [1, 100, 1000]) for level in (0.0, 7.2e4))
    assert np.allclose(small.deviation, large.deviation, rtol=1e-7)


def test_a_ramp_gives_its_slope() -> None:
    # A rate of r per second gives sigma = r tau / sqrt(2) at every tau, exactly.
    allan = allan_deviation(np.arange(5000.0) * 2e-3, 1.0)
    assert np.allclose(allan.deviation, 2e-3 * allan.tau_s / np.sqrt(2), rtol=1e-9)


@pytest.mark.parametrize("count", [37, 5000, 3 * 2 * _BLOCK + 129])
def test_octaves_from_few_starts_are_the_differences_at_those_starts(count: int) -> None:
    data = 3.0 + np.random.default_rng(7).normal(size=count)
    few = allan_deviation(data, 1.0, all_starts=False)
    phase = np.concatenate(([0.0], np.cumsum(data - data.mean())))
    for tau, value, terms in zip(few.tau_s, few.deviation, few.terms, strict=True):
        m = int(tau)
        start = np.arange(0, count - 2 * m + 1, max(1, m // 16))
        second = phase[start + 2 * m] - 2 * phase[start + m] + phase[start]
        assert terms == len(start)
        assert value == pytest.approx(np.sqrt(np.mean(second**2) / 2) / m, rel=1e-9)


def test_a_long_record_is_within_a_fraction_of_its_own_error_of_all_starts() -> None:
    data = np.cumsum(np.random.default_rng(8).normal(size=1 << 18)) * 1e-3
    data += np.random.default_rng(9).normal(size=1 << 18)
    few, full = (allan_deviation(data, 1.0, all_starts=all_starts) for all_starts in (False, True))
    assert np.array_equal(few.tau_s, full.tau_s)
    assert np.allclose(few.deviation[:5], full.deviation[:5], rtol=1e-10)
    assert (np.abs(few.deviation / full.deviation - 1) < 0.3 * full.relative_error).all()


def long_record(kind: str) -> np.ndarray:
    """A record a little longer than a long one, no multiple of a block."""
    count = LONG_RECORD + 4321
    rng, at = np.random.default_rng(21), np.arange(count)
    white = rng.normal(size=count)
    return {
        "white": white,
        "white on a level": white + 7.2e4,
        "angle noise": np.round(np.diff(rng.normal(size=count + 1)), 3),
        "walk": np.cumsum(white) * 1e-2,
        "ramp": white + 1e6 * at / count,
        "steps": white + 50.0 * (at // 100_000 % 2),
        "spike": white + 1e5 * (at == count // 2),
    }[kind]


@pytest.mark.parametrize(
    "kind", ["white", "white on a level", "angle noise", "walk", "ramp", "steps", "spike"]
)
def test_octaves_of_a_long_record_from_every_start_are_the_definition(kind: str) -> None:
    data = long_record(kind)
    ours = allan_deviation(data, 100.0, all_starts=True)
    # the definition, with 64 bits of mantissa, at any length below, at and above a block and at the longest
    level = np.longdouble(data.sum()) / len(data)
    phase = np.concatenate((np.zeros(1, np.longdouble), np.cumsum(data.astype(np.longdouble) - level)))
    lengths = np.rint(ours.tau_s * 100.0).astype(int)
    assert lengths.tolist() == [2**octave for octave in range(20)]
    for at in (0, 1, 2, 5, 9, 14, 15, 16, 18, 19):
        m = lengths[at]
        second = phase[2 * m :] - 2 * phase[m:-m] + phase[: -2 * m]
        assert ours.terms[at] == len(second)
        assert ours.deviation[at] == pytest.approx(float(np.sqrt(np.mean(second**2) / 2)) / m, rel=1e-8)
    tau, expected, _, number = allantools.oadev(data, rate=100.0, data_type="freq", taus=ours.tau_s)
    assert np.allclose(ours.deviation[: len(tau)], expected, rtol=1e-8)
    assert np.array_equal(ours.terms[: len(number)], number)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("all_starts", [True, False])
def test_a_sample_that_is_missing_in_a_long_record_is_told(bad: float, all_starts: bool) -> None:
    data = long_record("white")
    data[700_000] = bad
    with pytest.raises(RecordError, match="1 missing"):
        allan_deviation(data, 100.0, all_starts=all_starts)


def test_all_averaging_times() -> None:
    data = sp1065_1000()
    every = allan_deviation(data, 1.0, "all")
    assert np.array_equal(every.tau_s, np.arange(1, 501))
    tau, expected, _, _ = allantools.oadev(data, rate=1.0, data_type="freq", taus="all")
    assert np.allclose(every.deviation[: len(tau)], expected, rtol=1e-9)


@pytest.mark.parametrize(("alpha", "expected"), [(2, 36 / 70), (0, 2 / 3)])
def test_degrees_of_freedom_of_neighbouring_differences_are_exact(alpha: int, expected: float) -> None:
    # m = 1: correlations 1, -2/3, 1/6 of white phase, 1, -1/2 of white rate; edf = n / sum of squares.
    assert degrees_of_freedom(1_000_000, 1, alpha) == pytest.approx(expected * 1e6, rel=1e-3)


@pytest.mark.parametrize("alpha", [2, 0, -1, -2])
@pytest.mark.parametrize(("samples", "length"), [(100, 10), (1024, 10), (1024, 100), (100_000, 20_000)])
def test_degrees_of_freedom_equal_greenhall_and_rileys_algorithm(
    alpha: int, samples: int, length: int
) -> None:
    expected = allantools.edf_greenhall(alpha, 2, length, samples + 1, overlapping=True)
    assert degrees_of_freedom(samples, length, alpha) == pytest.approx(float(expected), rel=0.09)


def test_noise_types_by_slope_and_intervals_by_chi_square() -> None:
    rng = np.random.default_rng(10)
    white = allan_deviation(rng.normal(size=1 << 16), 1.0)
    assert (noise_exponents(white)[:8] == 0).all()
    assert (noise_exponents(allan_deviation(np.diff(rng.normal(size=1 << 16)), 1.0))[:8] == 2).all()
    walk = np.cumsum(rng.normal(size=1 << 16))
    assert (noise_exponents(allan_deviation(walk, 1.0))[2:8] == -2).all()
    assert (np.diff(noise_exponents(white)) <= 0).all()
    low, high = confidence_interval(white)
    assert (low < white.deviation).all() and (white.deviation < high).all()
    edf = degrees_of_freedom(1 << 16, 256, 0)
    quantiles = chi2.ppf([0.975, 0.025], edf)
    assert (low[8], high[8]) == pytest.approx(tuple(white.deviation[8] * np.sqrt(edf / quantiles)), rel=1e-9)


def test_intervals_hold_the_deviation_of_white_noise_as_often_as_they_say() -> None:
    rng = np.random.default_rng(11)
    taus = [1.0, 8.0, 64.0, 256.0]
    inside = np.zeros(4)
    for _ in range(400):
        allan = allan_deviation(rng.normal(size=2048), 1.0, taus)
        low, high = confidence_interval(allan, alpha=np.zeros(4, dtype=np.int64))
        inside += (low <= 1 / np.sqrt(allan.tau_s)) & (1 / np.sqrt(allan.tau_s) <= high)
    assert inside / 400 == pytest.approx(0.95, abs=0.035)


def exact(true: tuple[float, ...]) -> AllanDeviation:
    q, n, b, k, r = true
    base = allan_deviation(np.random.default_rng(4).normal(size=200_000), 1.0)
    tau_h = base.tau_s / 3600
    variance = 3 * q**2 / tau_h**2 + n**2 / tau_h + 2 * np.log(2) / np.pi * b**2
    variance += k**2 * tau_h / 3 + r**2 * tau_h**2 / 2
    return AllanDeviation(
        base.tau_s, np.sqrt(variance), base.terms, base.relative_error, base.record_s, base.rate_hz
    )


def test_noise_fit_recovers_exact_coefficients_and_leaves_absent_ones_out() -> None:
    true = (0.0, 0.004, 0.006, 0.003, 0.0)
    fit = fit_noise(exact(true))
    found = [getattr(fit.coefficients, name) for name in NOISE_NAMES]
    assert found == pytest.approx(true, rel=1e-4, abs=2e-6)
    assert fit.low.quantisation_deg == 0.0 and fit.low.rate_ramp_dph_h == 0.0
    assert 0.0 < fit.low.angle_random_walk_deg_sqrt_h < 0.004 < fit.high.angle_random_walk_deg_sqrt_h
    assert np.allclose(fit.coefficients.deviation(exact(true).tau_s), exact(true).deviation, rtol=1e-4)


def test_the_interval_of_pure_white_noise_is_that_of_its_edf() -> None:
    # All n samples tell of N^2 alone, if nothing else is fitted; with Q beside it, somewhat less than all.
    fit = fit_noise(exact((0.0, 0.004, 0.0, 0.0, 0.0)))
    relative = fit.high.angle_random_walk_deg_sqrt_h**2 / 0.004**2 - 1.0
    assert 1.96 * np.sqrt(2 / 200_000) < relative < 4 * 1.96 * np.sqrt(2 / 200_000)


def test_stated_intervals_hold_the_coefficients_of_simulated_gyros() -> None:
    # A smaller campaign than benchmarks/allan.py: 40 seeds, at most 6 of 40 outside (p = 0.003 at 95 %).
    true = np.array([2e-6, 0.003, 0.0, 0.02, 0.0])
    inside = np.zeros(5)
    for seed in range(40):
        rng = np.random.default_rng(seed)
        count = 20_000
        rate = true[1] * 60.0 * rng.standard_normal(count)
        rate += np.cumsum(true[3] / 60.0 * rng.standard_normal(count))
        rate += np.diff(true[0] * rng.standard_normal(count + 1)) * 3600.0
        fit = fit_noise(allan_deviation(rate, 1.0))
        low, high = (np.array([getattr(end, name) for name in NOISE_NAMES]) for end in (fit.low, fit.high))
        inside += (low <= true) & (true <= high)
    assert (inside >= 34).all()
    assert high[1] / low[1] < 1.1  # not so wide as to say nothing


def test_too_few_averaging_times_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="five noise coefficients"):
        fit_noise(allan_deviation(np.random.default_rng(0).normal(size=100), 1.0))


@pytest.mark.parametrize("tau_s", [[0.2], [600.0], []])
def test_averaging_times_outside_the_record_are_refused(tau_s: list[float]) -> None:
    with pytest.raises(ConfigurationError, match="averaging time"):
        allan_deviation(np.zeros(1000), 1.0, tau_s)


def test_a_gap_is_refused() -> None:
    with pytest.raises(RecordError, match="unbroken"):
        allan_deviation(np.array([1.0, np.nan, 2.0, 3.0]), 1.0)


@pytest.mark.parametrize("seed", [11, 38, 47, 53])
def test_an_interval_holds_its_own_estimate(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rate = 0.003 * 60.0 * rng.standard_normal(20_000)
    rate += np.cumsum(0.003 / 60.0 * rng.standard_normal(20_000))
    fit = fit_noise(allan_deviation(rate, 1.0))
    low, value, high = (end.squares() for end in (fit.low, fit.coefficients, fit.high))
    assert (low <= value).all() and (value <= high).all()


@pytest.mark.parametrize(("clusters", "expected"), [(2, 1 / np.sqrt(2)), (9, 0.25), (51, 0.1), (5001, 0.01)])
def test_the_error_of_a_value_is_that_of_its_number_of_clusters(clusters: int, expected: float) -> None:
    """IEEE Std 952: 1 / sqrt(2 (K - 1)) for K clusters; one alone would say nothing."""
    m = 7
    allan = allan_deviation(np.random.default_rng(12).normal(size=clusters * m), 10.0, [m / 10.0])
    assert allan.relative_error == pytest.approx(expected, rel=1e-12)


def test_variances_and_spectra_of_unit_coefficients_are_those_of_ieee_std_952() -> None:
    """Annex C: 3 Q^2/tau^2, N^2/tau, 2 ln 2/pi B^2, K^2 tau/3, R^2 tau^2/2, and 4 Q^2/dt sin^2(pi f dt), N^2."""
    tau_h = np.array([0.5, 2.0])
    expected = [[3.0 / t**2, 1.0 / t, 2.0 * np.log(2.0) / np.pi, t / 3.0, t * t / 2.0] for t in tau_h]
    assert _basis(tau_h) == pytest.approx(np.array(expected))
    dt_h, sine = 0.01, np.sin(np.pi * np.array([0.1, 0.3]))
    slow = 2.0 * sine / dt_h  # 2 pi f where f dt is small
    columns = [4.0 * sine**2 / dt_h, np.ones(2), 1.0 / slow, 1.0 / slow**2, np.zeros(2)]
    assert _spectra(sine, dt_h) == pytest.approx(np.column_stack(columns))


@pytest.mark.parametrize("ramp", [0.0, 0.9, 3.0])
def test_variances_of_one_record_scatter_as_the_covariance_says(ramp: float) -> None:
    """4,000 records of ten minutes, white noise on a ramp, their Allan variances by the definition's sums."""
    rng, n, lengths, walk = np.random.default_rng(1), 600, (1, 4, 16, 60), 0.01
    drift = ramp * np.arange(n) / 3600.0

    def variances(rate: np.ndarray) -> list[float]:
        angle = np.concatenate(([0.0], np.cumsum(rate)))
        steps = ((angle[2 * k :] - 2.0 * angle[k:-k] + angle[: -2 * k]) / k for k in lengths)
        return [float(np.mean(step**2)) / 2.0 for step in steps]

    seen = np.array([variances(60.0 * walk * rng.standard_normal(n) + drift) for _ in range(4000)])
    scatter = _Scatter(np.array(lengths) / 3600.0, n / 3600.0, 1.0 / 3600.0)
    squares = np.array([0.0, walk**2, 0.0, 0.0, ramp**2])
    covariance = scatter.covariance(squares)
    assert np.diag(covariance) == pytest.approx(seen.var(axis=0), rel=0.2)
    assert covariance[2, 3] == pytest.approx(np.cov(seen.T)[2, 3], rel=0.2)
    squares = np.array([1e-12, walk**2, 0.01, 0.02, ramp**2])
    for weights in (np.array([1.0, -0.5, 0.3, 0.1]), np.array([0.0, 0.0, -1.0, 2.0])):
        for index in range(5):
            a, b, q = scatter.variance_of(weights, squares, index)
            for x in (squares[index], 0.0, 3.0):
                other = np.where(np.arange(5) == index, x, squares)
                whole = weights @ scatter.covariance(other) @ weights
                assert a + b * x + q * x**2 == pytest.approx(whole, rel=1e-3)
