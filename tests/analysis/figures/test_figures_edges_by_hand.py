"""Figures at their edges: the settled end of a course, few and very many samples, several folders of a unit."""

from __future__ import annotations

import math
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.optimize import isotonic_regression

from bench.analysis.common.allan_noise import NoiseCoefficients
from bench.analysis.figures import Figure, StandardFigures, _from_run
from bench.analysis.figures._bias import RateStep, _course, temperature_sensitivity, threshold, warm_up_time_s
from bench.analysis.figures._budget import with_budgets
from bench.analysis.figures._estimate import Estimate, largest, linear, spread
from bench.analysis.figures._from_run import figures_of_unit, standard_figures
from bench.analysis.figures._parts import PARTS
from bench.analysis.figures._record import MOST_SAMPLES, Record, _whole
from bench.analysis.figures._scale_factor import RateSequence, scale_factor_figures
from bench.record.events.run import Interval
from drivers.base.errors import ConfigurationError, RecordError
from tests.analysis.figures.test_figures_by_hand import Plan, clock
from tests.analysis.figures.test_figures_parts_by_hand import Rows, record_of, rest

QUIET = NoiseCoefficients(0.0, 1e-6, 0.0, 0.0, 0.0)


def test_a_course_counts_from_the_mean_of_its_last_quarter():
    """Of twelve means the last three, of seven the last one, of three the last one."""
    falling = np.array([20.0, 16.0, 13.0, 11.0, 10.0, 9.0, 8.5, 8.0, 7.0, 4.0, 2.0, 0.0])
    assert _course(falling).tolist() == pytest.approx((falling - 2.0).tolist())
    assert _course(falling[:7]).tolist() == pytest.approx((falling[:7] - 8.5).tolist())
    assert _course(falling[:8]).tolist() == pytest.approx((falling[:8] - 8.25).tolist())
    assert _course(-falling[:3]).tolist() == pytest.approx((13.0 - falling[:3]).tolist())


def test_a_record_of_nine_hours_at_a_kilohertz_is_kept_whole_and_fits_into_a_third_of_a_gigabyte():
    assert 9.0 <= MOST_SAMPLES / 3.6e6 < 10.0 and MOST_SAMPLES * 8 < 0.3 * 2**30


def test_three_samples_have_a_rate_and_two_have_not():
    three, rate_hz = record_of([0.2, 0.6, 1.0], [3.0, 5.0, 10.0]).samples_dph(rest(0.0, 2.0))
    assert (three.tolist(), rate_hz) == (pytest.approx([3.0, 5.0, 10.0]), pytest.approx(2.5))
    two, rate_hz = record_of([0.2, 1.4], [3.0, 5.0]).samples_dph(rest(0.0, 2.0))
    assert (two.tolist(), rate_hz) == (pytest.approx([3.0, 5.0]), 1.0)


def test_a_hundredth_of_a_record_may_be_missing_and_lies_between_its_neighbours():
    values = np.arange(200.0) ** 2
    values[[50, 120]] = np.nan
    found = _whole(values, "w", "samples")
    assert found[[50, 120]].tolist() == [(49.0**2 + 51.0**2) / 2.0, (119.0**2 + 121.0**2) / 2.0]
    assert found[51] == 51.0**2
    values[130] = np.nan
    with pytest.raises(RecordError, match="gaps") as refused:
        _whole(values, "noise, g", "samples")
    assert (
        refused.value.found == "3 of 200 samples without a valid sample" and refused.value.where == "noise, g"
    )


def result(unit, bias, name="g", **of):
    rows = (
        Figure("bias", bias, "deg/h", "s", bias - 0.02, bias + 0.02),
        Figure("scale factor", 2.0, "", "s"),
    )
    fields = {"figures": rows, "missing": (("misalignment", "left out"),), "allan": None, "noise": None} | of
    return StandardFigures(f"run {bias}", unit, name, **fields)


def test_figures_over_runs_are_of_one_unit_and_of_two_runs_or_more(monkeypatch):
    asked = []
    kept = {"a": result("u", 1.0), "b": result("u", 1.4), "c": result("v", 1.0)}

    def figures(folder, gyro):
        asked.append((folder.name, gyro))
        return kept[folder.name]

    monkeypatch.setattr(_from_run, "standard_figures", figures)
    one, over = figures_of_unit([Path("a")], "g")
    assert one == [kept["a"]] and over == () and asked == [("a", "g")]
    both, over = figures_of_unit([Path("a"), Path("b")])
    assert both == [kept["a"], kept["b"]]
    assert [figure.name for figure in over] == [
        "bias repeatability",
        "scale-factor repeatability between runs",
    ]
    noise = (0.02 / 1.959964) ** 2
    assert over[0].value == pytest.approx(math.sqrt(0.08 - noise)) and over[0].unit == "deg/h"
    assert over[1].value == 0.0 and over[1].unit == "ppm" and over[1].source == "GJB 2426A, 2 power-ons"
    for folders, found in ((["a", "c"], "u, v"), ([], "no run")):
        with pytest.raises(ConfigurationError, match="one report is of one unit") as refused:
            figures_of_unit([Path(name) for name in folders])
        assert refused.value.found == found
    assert kept["b"].value("bias") == 1.4
    with pytest.raises(KeyError):
        kept["b"].value("warm-up")
    assert kept["b"].shown() == {
        "unit": "u",
        "run": "run 1.4",
        "figures": 2,
        "not measured": ["misalignment"],
    }


def test_a_run_without_intervals_or_without_that_gyro_gives_no_figures(monkeypatch):
    def opened(intervals, units):
        manifest = SimpleNamespace(units=units, procedure="known-state")
        return SimpleNamespace(
            open=lambda folder: SimpleNamespace(manifest=manifest, of=lambda kind: intervals)
        )

    some = [(0.0, Interval("bias", 0.0, 9.0))]
    for intervals, units, gyro, found, expected in (
        ([], {"g": "u", "h": "v"}, None, "known-state, gyros g, h", "a standard-test run with gyro g"),
        (some, {"g": "u"}, "h", "known-state, gyros g", "a standard-test run with gyro h"),
        (some, {}, None, "known-state, gyros ", "a standard-test run with gyro "),
    ):
        monkeypatch.setattr(_from_run, "Run", opened(intervals, units))
        with pytest.raises(ConfigurationError, match="no standard test of that gyro") as refused:
            standard_figures(Path("f"), gyro)
        assert (refused.value.found, refused.value.expected) == (found, expected)
        assert refused.value.where == "f"


def test_a_threshold_that_nothing_passes_is_told_with_what_each_input_gave():
    steps = [RateStep(1.0, 0.2, 0.1), RateStep(-4.0, -1.9, 0.2)]
    with pytest.raises(ConfigurationError, match="no input is shown to give its output") as refused:
        threshold(steps)
    assert refused.value.found == "-4 deg/h gave 48 +- 10 %, 1 deg/h gave 20 +- 20 %"
    assert refused.value.expected.startswith("at least 50 %")
    with pytest.raises(ConfigurationError) as refused:
        threshold([])
    assert refused.value.found == "none"
    with pytest.raises(ConfigurationError) as refused:
        threshold(steps, share=0.8)
    assert refused.value.expected.startswith("at least 80 %")
    # exactly half is enough, and an input of which half may be true is not shown to fail
    assert threshold([RateStep(2.0, 1.0)]) == Estimate(2.0, 0.0, 2.0, seen=False)
    found = threshold([RateStep(8.0, 8.0), RateStep(-3.0, -1.2, 0.2), RateStep(1.0, 0.1, 0.05)])
    assert (found.value, found.low, found.high, found.seen) == (8.0, 1.0, 8.0, True)


@pytest.mark.parametrize(("apart_c", "refused"), [(1.0, False), (-1.0, False), (0.99, True), (-0.99, True)])
def test_a_point_counts_from_one_degree_off_the_first_on(apart_c, refused):
    errors = np.zeros((5, 2))
    if refused:
        with pytest.raises(ConfigurationError, match="no two temperatures") as error:
            temperature_sensitivity([3.0, 4.0], [20.0, 20.0 + apart_c], errors)
        assert error.value.found == f"20.0 degC, {20.0 + apart_c:.1f} degC"
        return
    assert temperature_sensitivity([3.0, 4.0], [20.0, 20.0 + apart_c], errors).value == 1.0
    relative = temperature_sensitivity([4.0, 4.2], [20.0, 20.0 + 2.0 * apart_c], errors, relative=True)
    assert relative.value == pytest.approx(0.025)
    # the steepest of the points counts, however far away
    steep = temperature_sensitivity([0.0, 1.0, -3.0, 1.0], [20.0, 25.0, 22.0, 20.5], np.zeros((5, 4)))
    assert steep.value == 1.5


def test_estimates_without_noise_are_what_was_found():
    none = np.zeros((50, 3))
    assert largest(np.array([1.0, -4.0, 2.0]), none) == Estimate(4.0, 4.0, 4.0)
    assert not largest(np.zeros(3), np.ones((50, 3))).seen and not largest(np.zeros(3), none).seen
    assert linear(-2.0, np.zeros(9)) == Estimate(-2.0, -2.0, -2.0)
    draws = np.array([-1.0, 1.0])
    assert not linear(1.95, draws).seen and linear(1.97, draws).seen and linear(-1.97, draws).seen
    still = spread([5.0, 5.0, 5.0], np.eye(3))
    assert (still.value, still.low, still.high, still.seen) == (0.0, 0.0, 0.0, False)
    exact = spread([1.0, 2.0, 6.0], np.zeros((3, 3)))
    assert exact.value == pytest.approx(math.sqrt(7.0)) and exact.seen and exact.bound == exact.high
    other = Estimate(2.0, 1.0, 4.0, False).times(-3.0)
    assert (other.value, other.low, other.high, other.seen) == (-6.0, -12.0, -3.0, False)


def test_one_sequence_needs_the_noise_of_the_unit_and_two_equal_ones_of_six_rates_do_not():
    """Two sequences of n rates have n - 2 degrees of freedom: from eight on their scatter tells more."""

    def sequences(n, count):
        rates = np.linspace(-20.0, 20.0, n)
        rng = np.random.default_rng(n)
        start = 1000.0 * np.arange(n)
        return [
            RateSequence(
                rates,
                rates,
                1.5 * rates + 1e-4 * rng.normal(size=n),
                start + 1e5 * k,
                start + 1e5 * k + 500.0,
            )
            for k in range(count)
        ]

    for n, count in ((9, 1), (9, 2), (5, 3)):
        with pytest.raises(ConfigurationError, match="nothing of their own noise") as refused:
            scale_factor_figures(sequences(n, count), None)
        assert refused.value.found == f"{count} sequence of {n} dwells, no noise record"
        assert math.isinf(scale_factor_figures(sequences(n, count), QUIET).scale_factor.freedom)
    for n, count, freedom in ((10, 2, 8.0), (6, 3, 8.0), (11, 4, 27.0)):
        found = scale_factor_figures(sequences(n, count), None)
        assert found.scale_factor.freedom == freedom
        # a slope over n rates scatters by sigma over the root of their squares, less for each sequence
        rates = np.linspace(-20.0, 20.0, n)
        half = 1.96 * 1e-4 / np.linalg.norm(rates) / math.sqrt(count)
        assert found.scale_factor.high - found.scale_factor.value == pytest.approx(half, rel=0.6)
        assert found.repeatability_ppm is not None and found.hysteresis_ppm is None


def test_bias_over_temperature_is_less_the_vertical_earth_rate_and_over_its_own_scale_factor():
    """0.5 and 0.7 deg/h at 20 and 30 degC, of a unit that gives twice the rate, on a table about the vertical."""
    up = 15.041067 * math.sin(math.radians(40.0))
    rows, means = [], {}
    for number, (temp_c, bias) in enumerate(((20.0, 0.5), (30.0, 0.7))):
        for k, rate in enumerate((0.0, 10.0, -10.0)):
            start = 1000.0 * (3 * number + k)
            rows.append(Interval("temperature", start, start + 600.0, rate_dps=rate, temp_c=temp_c))
            means[start] = (2.0 + 1e-5 * (temp_c - 20.0)) * (1.01 * rate + (up + bias) / 3600.0)
    unit = Rows(*rows, means=means)
    unit.temp_c = lambda row: row.temp_c + 1.0
    bias, scale = PARTS["temperature sensitivity"](unit, QUIET)
    assert bias.value == pytest.approx(0.02, rel=1e-3)
    assert (scale.value, scale.unit) == (pytest.approx(5.0, rel=1e-3), "ppm/degC")
    assert bias.source == scale.source == "GJB 2426A" and bias.seen and scale.seen


def test_a_warm_up_is_as_sure_as_walks_of_that_size_leave_it():
    """Walks summed second by second about the same course, each judged by its own nearest falling course."""
    walk, blocks, tolerance = 3.0, 12, 1.0
    course = 6.0 * np.exp(-np.arange(blocks) / 2.5)
    output = np.repeat(course, 100)
    found = warm_up_time_s(output, tolerance, NoiseCoefficients(0.0, 0.0, 0.0, walk, 0.0))
    outside = np.flatnonzero(course - course[-3:].mean() > tolerance)[-1] + 1
    assert found.value == 100.0 * outside and found.seen
    rng, times = np.random.default_rng(8), []
    for _ in range(1500):
        steps = rng.normal(0.0, walk / 60.0, 100 * blocks)
        means = course + np.cumsum(steps).reshape(blocks, 100).mean(axis=1)
        nearest = min(
            (isotonic_regression(means, increasing=rising).x for rising in (True, False)),
            key=lambda each: np.sum((each - means) ** 2),
        )
        late = np.flatnonzero(np.abs(nearest - means[-3:].mean()) > tolerance)
        times.append(late[-1] + 1 if len(late) else 0)
    low, high = 100.0 * np.quantile(times, [0.025, 0.975])
    assert low < found.value < high
    assert found.low == pytest.approx(low - 50.0, abs=100.0) and found.high == pytest.approx(
        high + 50.0, abs=100.0
    )


def test_an_even_interval_is_that_of_a_signed_figure_and_may_reach_below_zero():
    """A clock that is known to 100 %: 2 +- 0.1 is then 2 +- 3.9, and only a magnitude ends at nothing."""
    even = Figure("rate ramp", 2.0, "deg/h/h", "s", 1.9, 2.1)
    (found,) = with_budgets([even], Plan(), clock(1e6))
    noise, of_clock = 0.1 / 1.959964, 2.0
    half = 1.959964 * math.hypot(noise, of_clock)
    assert (found.low, found.high) == (
        pytest.approx(2.0 - half),
        pytest.approx(2.0 + half),
    ) and not found.seen
    (bound,) = with_budgets([Figure("rate ramp", 2.0, "deg/h/h", "s", 1.8, 2.1)], Plan(), clock(1e6))
    assert bound.low == 0.0 and bound.high == pytest.approx(2.0 + math.hypot(0.1, 1.959964 * of_clock))


def test_an_interval_of_one_end_tells_no_digits():
    for low, high in ((None, 5.0), (5.0, None), (None, None)):
        figure = Figure("f", 3.14159, "deg/h", "s", low, high)
        assert (figure.digits, figure.standard_error, figure.bound) == (4, 0.0, None)
        assert figure.shown() == {"f": "3.14159 deg/h"}
        (kept,) = with_budgets([figure], Plan(), clock(1.0))
        assert kept is figure


@pytest.mark.parametrize("n", [5, 9])
def test_a_single_sequence_has_the_intervals_of_white_noise_in_closed_form(n):
    """Means over 500 s scatter by N over the root of the time; a slope by that over the root of its squares."""
    walk, rates = 0.003, np.linspace(-20.0, 20.0, n)
    start = 1000.0 * np.arange(n)
    sequence = RateSequence(rates, rates, 1.5 * rates + 0.2, start, start + 500.0)
    found = scale_factor_figures([sequence], NoiseCoefficients(0.0, walk, 0.0, 0.0, 0.0))
    sigma_dps = walk / math.sqrt(500.0 / 3600.0) / 3600.0
    slope = sigma_dps / np.linalg.norm(rates)
    half = found.scale_factor.high - found.scale_factor.value
    assert half == pytest.approx(1.959964 * slope, rel=0.06)
    assert found.scale_factor.value - found.scale_factor.low == pytest.approx(half)
    # the asymmetry is the difference of two slopes through half of the rates each, the zero in both
    side = np.linspace(0.0, 20.0, (n + 1) // 2)
    weights = np.zeros(n)
    weights[n // 2 :] += (side - side.mean()) / np.sum((side - side.mean()) ** 2)
    weights[: n // 2 + 1] -= (side - side.mean()) / np.sum((side - side.mean()) ** 2)
    ppm = 1e6 * sigma_dps * np.linalg.norm(weights) / 1.5
    assert found.asymmetry_ppm.high - found.asymmetry_ppm.value == pytest.approx(1.959964 * ppm, rel=0.06)


def test_a_rest_between_the_rates_is_in_the_slopes_of_both_signs():
    """2 above and 2.002 below nothing, where the output is off by a thousandth of a deg/s."""
    nominal = [0.0, 10.0, 20.0, -10.0, -20.0]
    rows = [
        rest(1000.0 * k, test="scale_factor", rate_dps=rate, sequence=1) for k, rate in enumerate(nominal)
    ]
    rows[0] = rest(0.0, test="scale_factor", rate_dps=None, sequence=1)
    true = 1.01 * np.array(nominal)
    output = np.where(true >= 0.0, 2.0, 2.002) * true + np.array([1e-3, 0.0, 0.0, 0.0, 0.0])
    means = dict(zip((row.start_s for row in rows), output, strict=True))
    found = {each.name: each for each in PARTS["scale factor"](Rows(*rows, means=means), QUIET)}
    rising, falling = (np.polyfit(true[side], output[side], 1)[0] for side in ([0, 1, 2], [0, 3, 4]))
    whole = np.polyfit(true, output, 1)[0]
    asymmetry = found["scale-factor asymmetry"].value
    assert asymmetry == pytest.approx(1e6 * (rising - falling) / whole, rel=1e-9)


def test_a_table_that_speeds_up_between_two_readings_is_followed_by_the_mean_of_both():
    """From rest to 800 deg/s in eight seconds, read every two: 300 and 500 deg in between, not 0 or 200."""
    time_s = np.array([0.0, 2.0, 4.0, 6.0, 8.0])
    table = {
        "time_ns": np.rint(1e9 * time_s).astype(np.int64),
        "angle_deg": np.mod(50.0 * time_s**2, 360.0),
        "rate_dps": 100.0 * time_s,
    }
    run = SimpleNamespace(turntable=lambda columns, start, end: table)
    assert Record(run, "g", 0.0).true_rate_dps(rest(0.0, 9.0)) == pytest.approx(400.0)


def test_four_blocks_of_a_hundred_seconds_tell_a_warm_up_and_three_do_not():
    output = np.repeat([5.0, 1.0, 0.0, 0.0], 100)
    assert warm_up_time_s(output, 0.5, QUIET).value == 200.0
    with pytest.raises(ConfigurationError, match="tells no warm-up time") as refused:
        warm_up_time_s(output[:399], 0.5, QUIET)
    assert refused.value.expected == "at least 4 blocks, all with data"
