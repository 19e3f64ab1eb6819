"""Numbers as printed, labels moved apart, curves thinned out: against closed forms and brute force."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.present.report._decimation import decimate
from bench.present.report._numbers import (
    DASH,
    column,
    duration,
    fixed,
    mean,
    moment,
    parameter,
    plain,
    significant,
    with_uncertainty,
    with_unit,
)
from bench.present.report._palette import PAINTS
from bench.present.report._run_content import block_means
from bench.present.report._spread import spread

UNKNOWN = [None, math.nan, math.inf, -math.inf]


@pytest.mark.parametrize("value", UNKNOWN)
def test_unknown_numbers_are_a_dash(value: float | None) -> None:
    assert {fixed(value, 2), significant(value), duration(value)} == {DASH}
    assert column([value, 1.5], 2) == (DASH, "1.5")
    assert with_unit(significant(value), "ppm") == DASH


@pytest.mark.parametrize(
    ("value", "uncertainty", "text"),
    [
        (69.99871, 0.00213, "69.9987 ± 0.0021"),  # four decimals at most
        (-12.3456, 1.26, "−12.3 ± 1.3"),
        (250.0, 31.4, "250 ± 31"),
        (0.1, 0.0, "0.1000 ± 0.0000"),
        (None, 0.1, DASH),
        (1.0, math.nan, DASH),
    ],
)
def test_a_value_has_the_decimals_of_its_uncertainty(value, uncertainty, text) -> None:
    assert with_uncertainty(value, uncertainty) == text


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [
        (0.02634, 3, "0.0263"),
        (0.1331, 3, "0.133"),
        (388.2, 3, "388"),
        (-45.66, 3, "−45.7"),
        (0.09996, 3, "0.100"),
        (1601187.0, 3, "1\u202f601\u202f187"),
        (0.0, 3, "0"),
        (3.2e-9, 3, "3.20e−9"),
    ],
)
def test_significant_digits(value: float | None, digits: int, text: str) -> None:
    assert significant(value, digits) == text


@given(st.floats(min_value=1e-6, max_value=1e9), st.integers(1, 6))
def test_significant_is_right_to_half_its_last_digit(value: float, digits: int) -> None:
    shown = float(significant(value, digits).replace("\u202f", ""))
    assert (
        abs(shown - value) <= 0.5000001 * 10.0 ** (math.floor(math.log10(value)) + 1 - digits) + 1e-15 * value
    )


def test_a_rounded_zero_has_no_sign() -> None:
    assert fixed(-0.004, 2) == "0.00"
    assert fixed(-0.006, 2) == "−0.01"


def test_a_column_has_common_decimals() -> None:
    assert column([0.123, 0.0263, None]) == ("0.1230", "0.0263", DASH)
    assert column([1e-7, 2.0]) == ("0.0000", "2.0000")
    assert column([]) == ()


def test_durations_and_moments() -> None:
    assert [duration(value) for value in (0.0, 119.0, 121.0, 3599.0, 16012.0)] == [
        "0 s", "119 s", "2 min", "1 h 00 min", "4 h 27 min",
    ]  # fmt: skip
    assert moment("2026-11-20T08:14:07.123+00:00") == "2026-11-20 08:14 UTC"
    assert moment("") == DASH
    assert moment("yesterday") == "yesterday"


def test_parameters_get_the_unit_their_name_ends_in() -> None:
    assert parameter("ramp_k_per_min", 12.0) == ("ramp", "12\u00a0K/min")
    assert parameter("cold_c", -45.0) == ("cold", "−45\u00a0°C")
    assert parameter("azimuth_deg", 90.0) == ("azimuth", "90°")
    assert parameter("repeats", 3) == ("repeats", "3")
    assert parameter("drift_dph", None) == ("drift", DASH)
    assert plain([1.0, True, "x"]) == "1, yes, x"


def test_mean_leaves_unknown_out() -> None:
    assert mean([1.0, None, math.nan, 3.0]) == 2.0
    assert mean([None]) is None


@given(
    st.lists(st.one_of(st.floats(-1e6, 1e6), st.just(math.nan)), min_size=1, max_size=400),
    st.integers(1, 40),
)
@settings(deadline=None, max_examples=150)
def test_decimation_keeps_extremes_ends_and_order(values: list[float], buckets: int) -> None:
    y = np.array(values)
    x = np.arange(len(y), dtype=float)
    thin_x, thin_y = decimate(x, y, buckets)
    assert len(thin_y) <= 2 * buckets + 2 or len(y) <= 2 * buckets + 2
    assert np.all(np.diff(thin_x) > 0)
    np.testing.assert_array_equal(thin_y, y[thin_x.astype(int)])
    assert thin_x[0] == 0 and thin_x[-1] == len(y) - 1
    if np.isfinite(y).any():
        assert np.nanmin(thin_y) == np.nanmin(y)
        assert np.nanmax(thin_y) == np.nanmax(y)


def test_decimation_of_a_spike_train_and_a_gap() -> None:
    y = np.zeros(10_000)
    y[1234], y[7777] = 5.0, -3.0
    y[4000:6000] = np.nan
    thin_x, thin_y = decimate(np.arange(10_000.0), y, 100)
    assert thin_y[thin_x == 1234] == 5.0
    assert thin_y[thin_x == 7777] == -3.0
    inside = (thin_x >= 4000) & (thin_x < 6000)
    assert inside.any() and np.isnan(thin_y[inside]).all()


def test_spread_moves_a_tie_apart_about_its_middle() -> None:
    assert spread([10.0, 10.0, 10.0], [4.0, 4.0, 4.0], 0.0, 100.0) == pytest.approx([6.0, 10.0, 14.0])
    assert spread([1.0, 50.0], [10.0, 10.0], 0.0, 100.0) == pytest.approx([5.0, 50.0])
    assert spread([50.0, 99.0], [10.0, 10.0], 0.0, 100.0) == pytest.approx([50.0, 95.0])
    assert spread([], [], 0.0, 1.0) == []


@given(st.lists(st.floats(0, 100), min_size=1, max_size=8), st.floats(1.0, 12.0))
@settings(deadline=None, max_examples=150)
def test_spread_never_overlaps_keeps_order_and_range(wanted: list[float], size: float) -> None:
    centres = spread(wanted, [size] * len(wanted), 0.0, 100.0)
    order = np.argsort(wanted, kind="stable")
    placed = np.array(centres)[order]
    assert np.all(np.diff(placed) >= size - 1e-9)
    assert placed[0] >= size / 2 - 1e-9
    assert placed[-1] <= 100.0 - size / 2 + 1e-9


def test_block_means_of_a_ramp_with_gaps() -> None:
    time_s = np.arange(0.5, 400.0)
    values = 2.0 * time_s
    values[200:300] = np.nan
    values[310] = np.nan
    middle, means = block_means(time_s, values, 100.0)
    np.testing.assert_allclose(middle, [50.0, 150.0, 250.0, 350.0])
    np.testing.assert_allclose(means[:2], [100.0, 300.0])
    assert np.isnan(means[2])
    assert means[3] == pytest.approx((70000.0 - 621.0) / 99.0)


def test_text_colours_reach_the_contrast_of_wcag_aa() -> None:
    """WCAG 2.2, success criterion 1.4.3: 4.5 : 1 against the paper, white and the dark theme's #151b22."""

    def luminance(colour: str) -> float:
        parts = [int(colour[at : at + 2], 16) / 255.0 for at in (1, 3, 5)]
        linear = [part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4 for part in parts]
        return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]

    assert len({paint.light for paint in PAINTS}) == len(PAINTS)
    for paint in PAINTS:
        if paint.name in ("grid", "band", "floor"):
            continue
        assert 1.05 / (luminance(paint.light) + 0.05) >= 4.5, paint.name
        assert (luminance(paint.dark) + 0.05) / (luminance("#151b22") + 0.05) >= 4.5, paint.name
