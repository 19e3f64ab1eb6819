"""Scores against closed forms: white noise, a known drift, predictions that are right or a little wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.common.statistics import attained, bias_stability, block_means
from bench.analysis.thermal import Prediction, Scores, ThermalRun
from bench.analysis.thermal._evaluate import evaluate, noise_floor

N = 40_000
ARW = 0.004


def known_run(seed: int = 0) -> tuple[ThermalRun, np.ndarray]:
    """A drift of 0.2 deg/h peak (sine of 4000 s) on white noise of 0.004 deg/sqrt(h), 1000 s at rest first."""
    time_s = np.arange(float(N))
    drift = np.where(time_s < 1000, 0.0, 0.2 * np.sin(2 * np.pi * (time_s - 1000) / 4000))
    noise = ARW * 60.0 * np.random.default_rng(seed).standard_normal(N)
    run = ThermalRun(
        "r",
        "u",
        time_s,
        0 * time_s,
        0 * time_s,
        7.0 + drift + noise,
        None,
        (0.0, 1000.0),
        true_bias_dph=3.0 + drift,
    )
    return run, drift


def on_grid(values: np.ndarray) -> Prediction:
    return Prediction(values[::10], 0.0 * values[::10])


def test_check_8_block_means_of_white_noise_scatter_by_6_and_19_times_its_arw() -> None:
    noise = ARW * 60.0 * np.random.default_rng(1).standard_normal(2_000_000)
    assert bias_stability(noise) == pytest.approx(6.0 * ARW, rel=0.02)
    assert bias_stability(noise, 10) == pytest.approx(18.97 * ARW, rel=0.02)


def test_block_means_leave_gaps_out_and_drop_blocks_that_are_mostly_gap() -> None:
    values = np.arange(30.0)
    values[12:15] = np.nan
    values[20:26] = np.nan
    assert block_means(values, 10) == pytest.approx([4.5, (145 - 12 - 13 - 14) / 7, np.nan], nan_ok=True)


def test_noise_floor_sees_noise_and_not_drift() -> None:
    run, _ = known_run()
    assert run.bias_dph is not None
    assert noise_floor(run.bias_dph) == pytest.approx(6.0 * ARW, rel=0.05)
    ramp = run.bias_dph + 1e-3 * run.time_s
    assert noise_floor(ramp) == pytest.approx(noise_floor(run.bias_dph), rel=1e-9)


def test_the_true_drift_as_prediction_reaches_the_oracle() -> None:
    run, drift = known_run()
    scores = evaluate(on_grid(drift + 11.0), run)
    assert scores.raw_stability_dph == pytest.approx(np.hypot(0.2 / np.sqrt(2), 6 * ARW), rel=0.03)
    assert scores.oracle_stability_dph == pytest.approx(6 * ARW, rel=0.1)
    assert scores.improvement_pct == pytest.approx(scores.oracle_pct, abs=0.1)
    assert scores.oracle_pct == pytest.approx(
        100 * (1 - 6 * ARW / np.hypot(0.2 / np.sqrt(2), 6 * ARW)), abs=1.5
    )
    assert attained([scores])[1] == pytest.approx(100.0, abs=0.2)
    assert scores.attainable_pct == pytest.approx(scores.oracle_pct, abs=2.0)
    # What remains is the 10 s hold: 4.5 s late on average, 0.2 * 2 pi / 4000 * 4.5.
    assert scores.true_max_dph == pytest.approx(0.2 * 2 * np.pi / 4000 * 4.5, rel=0.1)
    assert scores.true_rmse_dph == pytest.approx(0.2 * 2 * np.pi / 4000 * 4.5 / np.sqrt(2), rel=0.1)


def test_no_prediction_improves_nothing_and_half_of_the_drift_halves_it() -> None:
    run, drift = known_run()
    assert evaluate(on_grid(0.0 * drift), run).improvement_pct == pytest.approx(0.0, abs=1e-9)
    half = evaluate(on_grid(0.5 * drift), run)
    assert half.stability_dph == pytest.approx(np.hypot(0.1 / np.sqrt(2), 6 * ARW), rel=0.03)
    assert half.improvement_pct is not None and half.oracle_pct is not None
    assert half.improvement_pct < half.oracle_pct


def test_without_a_truth_the_noise_floor_bounds_the_claim() -> None:
    run, drift = known_run()
    scores = evaluate(on_grid(drift), replace(run, true_bias_dph=None))
    assert scores.oracle_pct is None and scores.true_rmse_dph is None
    assert attained([scores]) == (None, None)  # what could be attained is not known
    assert scores.improvement_pct == pytest.approx(scores.attainable_pct, abs=3.0)


def test_of_attainable_is_the_share_of_the_means() -> None:
    rows = [
        Scores("a", improvement_pct=40.0, oracle_pct=50.0),
        Scores("b", improvement_pct=90.0, oracle_pct=90.0),
    ]
    assert attained([*rows, Scores("c", improvement_pct=10.0)]) == pytest.approx((70.0, 100.0 * 65.0 / 70.0))


def test_inside_and_outside_of_the_range_are_given_apart() -> None:
    """The prediction is right up to 20 000 s; beyond, out of its range, it is wrong by 1 deg/h."""
    run, drift = known_run()
    beyond = run.time_s >= 20_000
    wrong = drift + np.where(beyond, np.sin(2 * np.pi * run.time_s / 5000), 0.0)
    split = evaluate(on_grid(wrong), run, beyond[::10]).apart
    assert split is not None and (split.outside, split.count) == (20_000, N)
    assert run.bias_dph is not None
    assert split.inside_before == pytest.approx(bias_stability(run.bias_dph[:20_000]))
    assert split.outside_before == pytest.approx(bias_stability(run.bias_dph[20_000:]))
    assert split.inside_after == pytest.approx(6 * ARW, rel=0.15)
    assert split.outside_after == pytest.approx(np.sqrt(0.5), rel=0.02)
    inside = evaluate(on_grid(drift), run, np.zeros(N // 10, dtype=np.bool_)).apart
    assert inside is not None and (inside.outside, inside.outside_before) == (0, None)


def test_the_time_before_the_reference_window_does_not_count() -> None:
    run, drift = known_run()
    assert run.bias_dph is not None
    warm_up = np.where(run.time_s < 500, 50.0, 0.0)
    late = replace(run, reference=(500.0, 1000.0))
    spoilt = replace(late, bias_dph=run.bias_dph + warm_up)
    assert evaluate(on_grid(drift), spoilt) == evaluate(on_grid(drift), late)


def test_scale_factor_errors_are_counted_from_the_reference_window() -> None:
    time_s = np.arange(5000.0)
    error = np.where(time_s < 1000, 0.0, 300.0 * (time_s - 1000) / 4000)
    run = ThermalRun(
        "r", "u", time_s, time_s, time_s, None, error + 40.0, (0.0, 1000.0), true_sf_error_ppm=error - 5.0
    )
    scores = evaluate(Prediction(0 * time_s[::10], error[::10] * 1.01 + 77.0), run)
    expected = 0.01 * block_means(error)
    # The hold of 10 s adds 4.5 s of 0.075 ppm/s.
    assert scores.sf_max_ppm == pytest.approx(expected.max(), abs=0.35)
    assert scores.sf_true_rms_ppm == pytest.approx(np.sqrt(np.mean(expected**2)), abs=0.35)
    assert scores.sf_raw_rms_ppm == pytest.approx(np.sqrt(np.mean(block_means(error) ** 2)), rel=1e-6)
    assert scores.raw_stability_dph is None
