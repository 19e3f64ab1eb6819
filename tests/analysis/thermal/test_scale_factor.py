"""Scale factor by time against closed forms, alignment against shifts that were put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.analysis.thermal._scale_factor import RateRun, find_shift, rate_weights, scale_factor_group
from drivers.base.errors import ConfigurationError, LimitExceeded

N = 9000
EARTH_DPS = 9.4860 / 3600.0


def profile(time_s: np.ndarray, late_s: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Case and gyro temperature of a shock from 25 to -45 degC at 12 degC/min, closed form by two lags."""
    t = time_s - late_s
    slope = 12.0 / 60.0

    def ramp_response(start_s: float, length_s: float, tau_s: float) -> np.ndarray:
        def response(u: np.ndarray) -> np.ndarray:
            u = np.maximum(u, 0.0)
            return np.asarray(u - tau_s * (1 - np.exp(-u / tau_s)))

        return slope * (response(t - start_s) - response(t - start_s - length_s))

    case = 25.0 - ramp_response(2000.0, 350.0, 90.0) + ramp_response(6000.0, 350.0, 90.0)
    gyro = 27.0 - ramp_response(2000.0, 350.0, 500.0) + ramp_response(6000.0, 350.0, 500.0)
    return case, gyro


def rate_run(rate_dps: float, late_s: float = 0.0, noise_dps: float = 0.0, seed: int = 0) -> RateRun:
    time_s = np.arange(float(N))
    case, gyro = profile(time_s, late_s)
    rng = np.random.default_rng(seed)
    true_ppm = 5.0 * (gyro - 27.0)
    bias_dps = (0.3 + 0.01 * (gyro - 27.0)) / 3600.0
    output = 1.002 * (rate_dps + EARTH_DPS) * (1 + true_ppm * 1e-6) + bias_dps
    return RateRun(
        run_id=f"{rate_dps:+g}",
        unit_id="u",
        rate_dps=rate_dps,
        time_s=time_s,
        gyro_temp_c=gyro + rng.normal(0, 0.01, N),
        case_temp_c=case + rng.normal(0, 0.01, N),
        output_dps=output + noise_dps * rng.standard_normal(N),
        reference=(200.0, 2000.0),
        true_sf_error_ppm=true_ppm,
    )


def test_check_9_weights_of_plus_minus_zero() -> None:
    assert np.allclose(rate_weights([20.0, -20.0, 0.0]) * 40.0, [1.0, -1.0, 0.0], atol=1e-12)


@settings(max_examples=50, deadline=None)
@given(st.lists(st.floats(-300, 300), min_size=3, max_size=8), st.integers(0, 2**31))
def test_general_rates_equal_a_polynomial_fit(rates: list[float], seed: int) -> None:
    if np.ptp(rates) < 1.0:
        return
    outputs = np.random.default_rng(seed).normal(0, 10, (len(rates), 4))
    slope = rate_weights(rates) @ outputs
    expected = np.polynomial.polynomial.polyfit(np.array(rates), outputs, 1)
    assert np.allclose(slope, expected[1], rtol=1e-7, atol=1e-7)


def test_equal_rates_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="two different rates"):
        rate_weights([20.0, 20.0])


def test_group_recovers_scale_factor_with_earth_rate_left_out() -> None:
    group = scale_factor_group([rate_run(20.0), rate_run(-20.0, seed=1), rate_run(0.0, seed=2)])
    error = group.sf_error_ppm
    assert error is not None and group.true_sf_error_ppm is not None and group.bias_dph is None
    gyro = profile(np.arange(float(N)))[1]
    assert np.allclose(error, 5.0 * (gyro - 27.0), atol=1e-6)
    assert np.allclose(group.true_sf_error_ppm, 5.0 * (gyro - 27.0), atol=1e-6)
    assert group.meta["temp_spread_c"] < 0.01


def test_check_10_a_start_120_s_late_is_found_and_taken_out() -> None:
    runs = [
        rate_run(20.0, noise_dps=1e-5),
        rate_run(-20.0, late_s=120.0, seed=1),
        rate_run(0.0, -35.0, seed=2),
    ]
    group = scale_factor_group(runs)
    assert np.allclose(group.meta["shifts_s"], [0, 120, -35], atol=2)
    apart = scale_factor_group(runs, align=False, max_spread_c=np.inf)
    truth = 5.0 * (profile(group.time_s)[1] - 27.0)
    assert group.sf_error_ppm is not None and apart.sf_error_ppm is not None
    aligned = np.abs(group.sf_error_ppm - truth)
    late = np.abs(apart.sf_error_ppm - 5.0 * (profile(apart.time_s)[1] - 27.0))
    # Half of a 120 s shift at 1.9 degC/min and 5 ppm/degC is 9.6 ppm.
    assert aligned.max() < 2.0
    assert late.max() > 7.0
    assert len(group.time_s) == N - 120 - 35 or len(group.time_s) >= N - 158


@settings(max_examples=15, deadline=None)
@given(st.integers(-500, 500), st.integers(0, 1000))
def test_any_shift_is_found_within_two_seconds(late_s: int, seed: int) -> None:
    time_s = np.arange(float(N))
    rng = np.random.default_rng(seed)
    first, other = (profile(time_s, late)[0] + rng.normal(0, 0.02, N) for late in (0.0, late_s))
    other[4000:4050] = np.nan
    assert abs(find_shift(first, other) - late_s) <= 2


def test_runs_in_different_thermal_states_are_refused() -> None:
    warm = rate_run(-20.0)
    warm = replace(warm, gyro_temp_c=warm.gyro_temp_c + 1.5)
    with pytest.raises(LimitExceeded, match=r"1\.5\d degC"):
        scale_factor_group([rate_run(20.0), warm])
