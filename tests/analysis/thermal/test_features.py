"""Features against closed forms: delays of the means, rates, gaps, anchoring, causality."""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.analysis.thermal import ThermalRun, prepare
from bench.analysis.thermal._features import centred_mean, change_per_minute, trailing_mean, window_mean
from bench.analysis.thermal._signals import LAG_TIMES_S, Signals, lag_terms
from drivers.base.errors import RecordError


def run_of(n: int = 1200, **changes: object) -> ThermalRun:
    time_s = np.arange(float(n))
    run = ThermalRun(
        run_id="r",
        unit_id="u",
        time_s=time_s,
        gyro_temp_c=30.0 - 0.02 * time_s,
        case_temp_c=25.0 - 0.05 * time_s,
        bias_dph=0.5 + 1e-3 * time_s,
        sf_error_ppm=None,
        reference=(100.0, 200.0),
    )
    return replace(run, **changes)  # type: ignore[arg-type]


def test_check_11_trailing_mean_delays_a_ramp_by_49_5_s_and_a_centred_one_by_half_a_second() -> None:
    ramp = np.arange(16000.0) * 0.2 - 45.0
    middle = slice(200, -200)
    assert np.allclose((ramp - trailing_mean(ramp, 100))[middle] / 0.2, 49.5, atol=1e-9)
    assert np.allclose((ramp - centred_mean(ramp, 100))[middle] / 0.2, 0.5, atol=1e-9)


@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.one_of(st.floats(-100, 100), st.just(float("nan"))), min_size=1, max_size=60),
    st.integers(1, 20),
)
def test_means_equal_the_definition_sample_by_sample(values: list[float], count: int) -> None:
    series = np.array(values)
    trailing, centred = trailing_mean(series, count), centred_mean(series, count)
    for i in range(len(series)):
        window = series[max(0, i - count + 1) : i + 1]
        known = window[np.isfinite(window)]
        expected = known.mean() if len(known) else np.nan
        assert trailing[i] == pytest.approx(expected, abs=1e-9, nan_ok=True)
        window = series[max(0, i - count // 2) : i - count // 2 + count]
        known = window[np.isfinite(window)]
        if 2 * len(known) >= len(window) + 1:
            assert centred[i] == pytest.approx(known.mean(), abs=1e-9)
        if 2 * len(known) < len(window) - 1:
            assert np.isnan(centred[i])


def test_rate_of_a_ramp_is_its_slope_per_minute_and_the_start_is_at_rest() -> None:
    ramp = 20.0 + np.arange(500.0) * (10.0 / 60.0)
    rate = change_per_minute(ramp)
    assert np.allclose(rate[60:], 10.0, atol=1e-9)
    assert rate[0] == 0.0
    assert rate[30] == pytest.approx(5.0)


def test_prepared_run_of_ramps_has_the_closed_form() -> None:
    features = prepare(run_of())
    late = features.time_s >= 200
    assert features.step_s == 10.0
    assert np.array_equal(features.time_s, np.arange(0.0, 1200.0, 10.0))
    assert np.allclose(features.t_in[late], 30.0 - 0.02 * (features.time_s[late] - 49.5), atol=1e-9)
    assert np.allclose(features.gradient[late], features.t_in[late] - features.t_out[late], atol=1e-12)
    assert np.allclose(features.dt_60[late], -1.2, atol=1e-9)
    inner = late & (features.time_s < 1140)
    # Centred target: half a second late; anchored on the window's mean, which lies at 149.5 s.
    assert features.bias_dph is not None
    assert np.allclose(features.bias_dph[inner], 1e-3 * (features.time_s[inner] - 0.5 - 149.5), atol=1e-9)
    assert np.array_equal(features.weight, (features.time_s >= 100).astype(float))


def test_gaps_are_held_in_the_inputs_and_weigh_nothing_in_the_targets() -> None:
    run = run_of()
    assert run.bias_dph is not None
    temp, bias = run.gyro_temp_c.copy(), run.bias_dph.copy()
    temp[500:700] = np.nan
    bias[800:950] = np.nan
    features = prepare(replace(run, gyro_temp_c=temp, bias_dph=bias))
    for column in (features.t_in, features.t_out, features.dt_60, features.gradient, features.bias_dph):
        assert column is not None and np.isfinite(column).all()
    # The trailing mean lives on what is in its window until 598 s; then its last value holds.
    held = features.t_in[(features.time_s >= 600) & (features.time_s < 700)]
    assert np.ptp(held) == 0.0 and held[0] == pytest.approx(30.0 - 0.02 * 499, abs=1e-9)
    assert np.array_equal(
        features.time_s[features.weight == 0], [*np.arange(0, 100, 10), *np.arange(810, 950, 10)]
    )


def test_inputs_are_causal_bit_for_bit() -> None:
    run = run_of()
    changed = run.gyro_temp_c.copy()
    changed[601:] += 7.0
    before, after = prepare(run), prepare(replace(run, gyro_temp_c=changed))
    past = before.time_s <= 600
    for name in ("t_in", "t_out", "dt_60", "gradient"):
        assert np.array_equal(getattr(before, name)[past], getattr(after, name)[past])
        assert name == "t_out" or not np.array_equal(getattr(before, name), getattr(after, name))


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"time_s": np.arange(1200.0) * 2}, "1 s grid"),
        ({"gyro_temp_c": np.full(1200, np.nan)}, "no gyro temperature"),
        ({"bias_dph": np.where(np.arange(1200) < 300, np.nan, 1.0)}, "reference window"),
    ],
)
def test_unusable_runs_are_refused(changes: dict[str, object], text: str) -> None:
    with pytest.raises(RecordError, match=text):
        prepare(run_of(**changes))


def test_importing_the_room_brings_neither_torch_nor_pandas() -> None:
    question = "import sys, bench.analysis.thermal; print({'torch', 'pandas'} & set(sys.modules))"
    answer = subprocess.run([sys.executable, "-c", question], capture_output=True, text=True, check=True)
    assert answer.stdout.strip() == "set()"


def test_a_mean_over_a_window_is_that_of_its_finite_values() -> None:
    time_s, values = np.arange(10.0), np.arange(10.0) ** 2
    values[4] = np.nan
    assert window_mean(time_s, values, (3.0, 6.0)) == (9.0 + 25.0) / 2.0
    with pytest.raises(RecordError, match="holds no data") as refused:
        window_mean(time_s, values, (20.0, 30.0), where="run r1")
    assert refused.value.found == "window 20..30 s, data 0..9 s"


def test_terms_of_lags_are_temperatures_low_passes_and_their_products() -> None:
    """Row by row: T_in and T_out, their low-passes, T_in^2, T_in^3, and lags times T_in and T_in^2."""
    rng, count, lags = np.random.default_rng(2), 5, len(LAG_TIMES_S)
    t_in, t_out, other = rng.normal(size=(3, count))
    low_in, low_out = rng.normal(size=(2, count, lags))
    inputs = Signals(t_in, t_out, other, other, other, low_in, low_out)
    plain = lag_terms(inputs, with_temperature=False)
    whole = lag_terms(inputs, with_temperature=True)
    for row in range(count):
        t = t_in[row]
        behind = [*(t - low_in[row]), *(t_out[row] - low_out[row])]
        linear = [t, t_out[row], *low_in[row], *low_out[row]]
        assert plain[row] == pytest.approx(linear)
        products = [t * t, t * t * t, *(one * t for one in behind), *(one * t * t for one in behind)]
        assert whole[row] == pytest.approx([*linear, *products])
