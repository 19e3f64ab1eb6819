"""Figures of a standard test by hand: thresholds, courses, sequences, records, budgets; and Allan fits."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import chi2

from bench.analysis.common.allan import allan_deviation
from bench.analysis.common.allan_confidence import noise_exponents
from bench.analysis.common.allan_noise import NoiseCoefficients, _Scatter, fit_noise
from bench.analysis.common.bench_errors import ASSUMED, BenchErrors
from bench.analysis.common.mean_noise import covariance_of_means, white_variance
from bench.analysis.figures import Figure, StandardFigures, figures_over_runs
from bench.analysis.figures._bias import RateStep, _blocks_outside, _course, bias_figures, threshold
from bench.analysis.figures._budget import _cosine, with_budgets
from bench.analysis.figures._estimate import Estimate, _where, largest, linear, spread
from bench.analysis.figures._parts import PARTS, _earth_dph
from bench.analysis.figures._record import Record, _whole
from bench.analysis.figures._scale_factor import (
    RateSequence,
    _asymmetry_weights,
    _residual_weights,
    _rising_and_falling,
    _rows_of_rates,
    _signed,
    scale_factor_figures,
    slope_weights,
)
from bench.record.events.run import BEFOREHAND, Answer, Interval
from benchmarks.metrology import certificate
from drivers.base.errors import ConfigurationError, RecordError

WHITE = NoiseCoefficients(0.0, 0.01, 0.0, 0.0, 0.0)
NONE = NoiseCoefficients(0.0, 0.0, 0.0, 0.0, 0.0)
EARTH_DPH = 15.041067


def test_a_share_that_falls_reaches_a_level_where_it_does():
    assert _where(lambda a: 1.0 - a / 8.0, 0.5, 16.0) == pytest.approx(4.0, abs=1e-5)
    assert _where(lambda a: 1.0 - a, 0.25, 3.0) == pytest.approx(0.75, abs=1e-5)
    assert _where(lambda a: 0.5 - a, 0.5, 3.0) == 0.0 and _where(lambda a: 1.0, 0.5, 3.0) == pytest.approx(
        3.0, abs=1e-5
    )


def test_a_largest_value_alone_is_found_beyond_its_noise():
    """A single residual of 5 in noise of 1: its interval is that of a normal value, its own size the median."""
    draws = np.random.default_rng(1).standard_normal((40_000, 1))
    found = largest(np.array([-5.0]), draws)
    assert found.value == pytest.approx(5.0, abs=0.05) and found.seen
    assert (found.low, found.high) == pytest.approx((5.0 - 1.96, 5.0 + 1.96), abs=0.1)
    assert largest(np.array([0.0, 0.0]), np.ones((9, 2))) == Estimate(0.0, 0.0, 0.0, False)
    assert largest(np.array([2.0, -3.0]), np.zeros((9, 2))) == Estimate(3.0, 3.0, 3.0, True)
    assert Estimate(1.0, -4.0, 3.0).bound == 4.0 and Estimate(1.0, -2.0, 3.0).bound == 3.0
    turned = Estimate(1.0, -4.0, 3.0, False).times(-2.0)
    assert (turned.value, turned.low, turned.high, turned.seen) == (-2.0, -6.0, 8.0, False)


def test_a_spread_is_what_scatters_beyond_the_errors():
    """Of three values 1, 2 and 6, in errors of variance 1 each with 0.3 in common."""
    covariance = 0.7 * np.eye(3) + 0.3
    found = spread([1.0, 2.0, 6.0], covariance)
    assert found.value == pytest.approx(math.sqrt(7.0 - 0.7))
    low, high = (14.0 / chi2.ppf(p, 2) - 0.7 for p in (0.975, 0.025))
    assert (found.low, found.high) == pytest.approx((math.sqrt(low), math.sqrt(high))) and found.seen
    none = spread([1.0, 1.1, 1.0], 9.0 * np.eye(3))
    assert (none.value, none.low, none.seen) == (0.0, 0.0, False) and none.high == pytest.approx(
        math.sqrt(0.01 / 3)
    )
    either = linear(1.0, np.array([-0.5, 0.5] * 50))
    assert (1.0 - either.low, either.high - 1.0) == pytest.approx((0.979982, 0.979982))  # 1.96 of 0.5


def test_a_threshold_is_the_smallest_input_from_which_all_larger_ones_pass():
    def steps(*shares, error=0.0):
        return [RateStep(sign * 2.0**k, sign * share * 2.0**k, error) for k, (share, sign) in
                enumerate(zip(shares, (1, -1, 1, -1), strict=True))]  # fmt: skip

    assert threshold(steps(0.0, 0.6, 0.9, 1.0)) == Estimate(2.0, 1.0, 2.0, True)
    assert threshold(steps(0.9, 0.3, 0.9, 1.0)) == Estimate(4.0, 2.0, 4.0, True)
    assert threshold(steps(0.5, 0.5, 0.9, 1.0)) == Estimate(1.0, 0.0, 1.0, False)
    # noise of 0.2 hides what the two smallest do: 0.39 of an input of one, 0.2 of one of two
    hidden = threshold(steps(0.6, 0.6, 0.9, 1.0, error=0.2))
    assert (hidden.value, hidden.low, hidden.seen) == (4.0, 0.0, False)
    assert threshold(steps(0.0, 0.6, 0.9, 1.0), share=0.95) == Estimate(8.0, 4.0, 8.0, True)
    step = RateStep(-4.0, 1.0, 0.5)
    assert step.ratio == -0.25 and step.margin == pytest.approx(1.959964 * 0.125)
    with pytest.raises(ConfigurationError, match="no input is shown") as refused:
        threshold([RateStep(2.0, 0.5, 0.0), RateStep(-1.0, -0.25, 0.1)])
    assert refused.value.found == "2 deg/h gave 25 +- 0 %, -1 deg/h gave 25 +- 20 %"
    assert refused.value.expected == "at least 50 %, beyond the noise"


def test_a_course_is_the_nearest_one_that_rises_or_falls():
    means = np.array([5.0, 3.0, 4.0, 1.0, 1.0, 1.2, 0.8, 1.0])
    assert _course(means) + 0.9 == pytest.approx([5.0, 3.5, 3.5, 1.0667, 1.0667, 1.0667, 0.9, 0.9], abs=1e-3)
    assert _course(-means) == pytest.approx(-_course(means))
    assert _course(np.array([1.0, 2.0, 3.0])) == pytest.approx([-2.0, -1.0, 0.0])
    assert [_blocks_outside(np.array([3.0, -1.0, 2.0, 0.5]), each) for each in (0.4, 0.5, 1.9, 2.0, 3.0)] == [
        4,
        3,
        3,
        1,
        0,
    ]


def test_a_bias_is_that_of_its_record_and_its_stabilities_are_of_chi_squared():
    rng = np.random.default_rng(1)
    noise = NoiseCoefficients(1e-5, 0.01, 0.0, 0.0, 0.0)
    output = 9.0 + rng.normal(0.0, 0.6, 3000)
    found = bias_figures(output, 4.0, noise)
    half = 1.959964 * math.sqrt(0.01**2 * 3600 / 3000 + 2.0 * (1e-5 * 3600 / 3000) ** 2)
    assert found.bias_dph.value == pytest.approx(output.mean() - 4.0)
    assert found.bias_dph.high - found.bias_dph.value == pytest.approx(half)
    assert white_variance(3000, noise) == pytest.approx((half / 1.959964) ** 2)
    for own, length in ((found.stability_10s_dph, 10), (found.stability_100s_dph, 100)):
        assert own.value == pytest.approx(np.std(output.reshape(-1, length).mean(axis=1), ddof=1))
        assert own.low < own.value < own.high
    white = bias_figures(output, 4.0, WHITE).stability_100s_dph
    ratios = [math.sqrt(29 / chi2.ppf(p, 29)) for p in (0.975, 0.025)]
    assert (white.low / white.value, white.high / white.value) == pytest.approx(tuple(ratios), rel=1e-6)


def sequence(rates, output, start=0.0):
    rates = np.asarray(rates, np.float64)
    at = start + 100.0 * np.arange(len(rates))
    return RateSequence(rates, 1.001 * rates, np.asarray(output, np.float64), at, at + 60.0)


RATES = [0.0, 5.0, 10.0, 5.0, 0.0, -5.0, -20.0, -5.0, 0.0]


def test_weights_of_a_sequence_are_those_of_least_squares():
    rng = np.random.default_rng(1)
    out = rng.normal(size=9)
    one = sequence(RATES, out)
    line = np.polyfit(one.rate_dps, out, 1)
    assert slope_weights(one.rate_dps) @ out == pytest.approx(line[0])
    assert _residual_weights(one.rate_dps) @ out == pytest.approx(out - np.polyval(line, one.rate_dps))
    up, down = (
        np.polyfit(one.rate_dps[side], out[side], 1)[0]
        for side in (one.nominal_dps >= 0, one.nominal_dps <= 0)
    )
    assert _asymmetry_weights(one) @ out == pytest.approx(up - down)
    means = _rows_of_rates([one, one]) @ np.concatenate((out, out + 1.0))
    own = [out[np.array(RATES) == rate].mean() + 0.5 for rate in (-20.0, -5.0, 0.0, 5.0, 10.0)]
    assert means == pytest.approx(own)
    # 0 is come to from below at the end and from above in the middle; 5 rising and falling, -5 falling and rising
    differences = _rising_and_falling([one]) @ out
    assert differences == pytest.approx([out[5] - out[7], out[4] - out[8], out[3] - out[1]])
    assert _rising_and_falling([sequence([0.0, 1.0, 2.0], out[:3])]).shape == (0, 3)
    with pytest.raises(ConfigurationError, match="no asymmetry") as refused:
        _asymmetry_weights(sequence([0.0, 5.0, 10.0, -0.0], out[:4]))
    assert refused.value.found == "1 of sign -1"
    assert _signed(Estimate(3.0, 1.0, 4.0), np.array([1.0, -3.0])) == Estimate(-3.0, -4.0, -1.0)
    assert _signed(Estimate(3.0, 0.0, 4.0, False), np.array([1.0, -3.0])) == Estimate(3.0, -4.0, 4.0, False)


def test_figures_of_a_sequence_without_noise_are_exact():
    """A scale factor of 2 with 1000 ppm more at positive rates, and 0.004 deg/s less while rates fall."""
    rates = np.array(RATES)
    falling = np.diff(rates, prepend=0.0) < 0.0
    output = 2.0 * 1.001 * rates * (1.0 + 1e-3 * (rates > 0)) + 0.5 - 0.004 * falling
    found = scale_factor_figures([sequence(rates, output)], NONE)
    x = 1.001 * rates
    line = np.polyfit(x, output, 1)
    rest = output - np.polyval(line, x)
    full = abs(line[0]) * 1.001 * 20.0
    assert found.scale_factor.value == pytest.approx(line[0]) and math.isinf(found.scale_factor.freedom)
    means = [rest[rates == rate].mean() for rate in np.unique(rates)]
    assert found.nonlinearity_ppm.value == pytest.approx(1e6 * np.abs(means).max() / full)
    up, down = (np.polyfit(x[side], output[side], 1)[0] for side in (rates >= 0, rates <= 0))
    assert found.asymmetry_ppm.value == pytest.approx(1e6 * (up - down) / line[0])
    assert found.hysteresis_ppm.value == pytest.approx(-1e6 * 0.004 / full, rel=1e-6)
    assert found.repeatability_ppm is None
    two = scale_factor_figures([sequence(rates, output), sequence(rates, 1.002 * output, 2000.0)], NONE)
    mean = 1.001 * line[0]
    assert two.scale_factor.value == pytest.approx(mean)
    assert two.repeatability_ppm.value == pytest.approx(
        1e6 * math.sqrt(0.5) * 0.002 * line[0] / mean, rel=0.2
    )
    with pytest.raises(ConfigurationError, match="tell nothing of their own noise"):
        scale_factor_figures([sequence(rates, output)], None)


def table(time_s, **columns):
    return {
        "time_ns": (1e9 * np.asarray(time_s)).astype(np.int64),
        **{k: np.asarray(v) for k, v in columns.items()},
    }


def record_of(rows=None, turned=None, events=()):
    run = SimpleNamespace(
        gyro=lambda name, columns, start, end: rows, turntable=lambda columns, start, end: turned,
        of=lambda kind: [
            (0.0, each)
            for each in (Interval("bias", 0.0, 1.0), Interval("noise", 2.0, 9.0), *events)
            if isinstance(each, kind)
        ],
        manifest=SimpleNamespace(run_id="r", outcome="aborted", reason="", latitude_deg=39.1),
    )  # fmt: skip
    return Record(run, "g", 30.0)


def test_a_records_seconds_and_samples_are_even_and_whole():
    rng = np.random.default_rng(1)
    kept = np.delete(np.arange(2000), [5, 700, 701])
    time_s = 100.0 + 0.1 * kept + rng.uniform(-0.01, 0.01, len(kept))
    rate = kept / 3600.0
    valid = np.ones(len(kept), np.int8)
    valid[10] = 0
    interval = Interval("noise", 100.0, 300.9)
    record = record_of(table(time_s, rate_dps=rate, valid=valid, temp_c=np.full(len(kept), 31.0)))
    found = record.seconds_dph(replace(interval, start_s=99.95, end_s=299.95))
    assert len(found) == 200 and found[1] == pytest.approx(
        np.mean([11, 12, 13, 14, 15, 16, 17, 18, 19]), abs=0.6
    )
    samples, rate_hz = record.samples_dph(interval)
    assert rate_hz == pytest.approx(10.0, rel=1e-4) and samples == pytest.approx(np.arange(2000.0), abs=1e-6)
    assert record.output_dph(interval).tolist() == pytest.approx(np.delete(kept, 10).tolist())
    assert record.mean_dps(interval) == pytest.approx(np.delete(kept, 10).mean() / 3600.0)
    assert record.temp_c(interval) == 31.0
    with pytest.raises(ConfigurationError, match="sends no temperature"):
        record_of(table([0.0], temp_c=[math.nan])).temp_c(interval)
    assert [each.test for each in record.needed("noise")] == ["noise"] and record.intervals("warm_up") == []
    with pytest.raises(ConfigurationError, match="no interval of warm up"):
        record.needed("warm_up")
    assert _whole(np.where(np.arange(200) == 7, np.nan, np.arange(200.0)), "w", "seconds")[7] == 7.0
    with pytest.raises(RecordError, match="gaps") as refused:
        _whole(np.where(np.arange(200) < 3, np.nan, 1.0), "w", "seconds")
    assert refused.value.found == "3 of 200 seconds without a valid sample"


@pytest.mark.parametrize(
    ("first_s", "last_s", "silent_s"), [(100.0, 160.0, 40.0), (104.0, 200.0, 4.0), (None, 0, 100.0)]
)
def test_a_unit_that_is_silent_in_an_interval_has_no_mean_there(first_s, last_s, silent_s):
    """Unplugged at 160 s of a dwell from 100 to 200 s, back 4 s late, or gone: no half is taken for all."""
    interval = Interval("scale_factor", 100.0, 200.0, rate_dps=10.0)
    time_s = np.arange(100.0, 200.5, 0.5)
    valid = np.zeros(len(time_s), np.int8) if first_s is None else (first_s <= time_s) & (time_s <= last_s)
    record = record_of(table(time_s, rate_dps=np.full(len(time_s), 10.0), valid=valid))
    for read in (record.output_dph, record.mean_dps):
        with pytest.raises(RecordError, match="silent") as refused:
            read(interval)
        assert refused.value.found.startswith(f"nothing valid for {silent_s:.1f} s of 100.0 s")
    late = (time_s >= 102.5) & (time_s <= 197.5)
    whole = record_of(table(time_s, rate_dps=np.full(len(time_s), 10.0), valid=late))
    assert whole.mean_dps(interval) == pytest.approx(10.0)


def test_an_answer_that_is_no_number_shows_no_input():
    steps = [RateStep(1.0, math.nan, 0.1), RateStep(2.0, 2.0, 0.1)]
    assert threshold(steps).value == 2.0
    with pytest.raises(ConfigurationError, match="no input is shown"):
        threshold([RateStep(1.0, 1.0, 0.1), RateStep(2.0, math.nan, 0.1)])


def test_a_turn_in_the_fixture_that_nobody_made_is_no_position():
    """Questions answered beforehand (`--yes`) are answered by nobody; somebody's answer stands."""
    rows = [Interval("misalignment", 0.0, 1.0, roll_deg=roll) for roll in (0.0, 180.0, 90.0)]
    answers = [
        Answer("Turn?", "yes", by, "mount", "axis_horizontal", {"roll_deg": roll})
        for roll, by in ((180.0, "Ada at the console"), (90.0, BEFOREHAND))
    ]
    answers.append(Answer("Mount?", "yes", BEFOREHAND, "mount", "axis_horizontal"))
    record = record_of(events=(*rows, *answers))
    assert record.intervals("misalignment") == rows[:2]
    assert len(record.intervals("bias")) == 1


def test_a_tables_rate_is_the_angle_turned_over_the_time():
    """At 200 deg/s, read every 0.9 s or so: half a turn and more between readings."""
    rng = np.random.default_rng(1)
    time_s = np.cumsum(rng.uniform(0.85, 0.95, 60))
    angle = np.mod(200.0 * time_s + 77.0, 360.0)
    rate = 200.0 + rng.normal(0.0, 1.0, 60)
    interval = Interval("scale_factor", 0.0, 60.0, rate_dps=199.0)
    found = record_of(turned=table(time_s, angle_deg=angle, rate_dps=rate)).true_rate_dps(interval)
    assert found == pytest.approx(200.0, rel=1e-7)
    assert record_of(turned=table([1.0], angle_deg=[0.0], rate_dps=[0.0])).true_rate_dps(interval) == 199.0
    north = record_of(turned=table([0.0, 1.0], angle_deg=[329.0, 331.0], rate_dps=[0.0, 0.0]))
    assert north.azimuth_deg(interval) == pytest.approx(0.0, abs=1e-9)
    assert _earth_dph(north, interval) == pytest.approx(EARTH_DPH * math.cos(math.radians(39.1)), rel=1e-6)


def figure(name, value, half, **changes):
    fields = {
        "name": name,
        "value": value,
        "unit": "deg/h",
        "source": "s",
        "low": value - half,
        "high": value + half,
    }
    return Figure(**(fields | changes))


class Plan:
    """A test of which the axis points to 50 deg, at 30 degrees of latitude, with inputs of 1 and 4 deg/h."""

    latitude_deg = 30.0
    temps = (25.0, 25.4, -15.0, 65.0)
    rolls = (None, 0.0)

    def needed(self, test):
        return self.intervals(test)

    def intervals(self, test):
        if test == "temperature":
            return [SimpleNamespace(temp=temp) for temp in self.temps]
        if test == "misalignment":
            return [
                SimpleNamespace(roll_deg=roll, rate_dps=rate) for roll in self.rolls for rate in (9.0, -9.0)
            ]
        return [SimpleNamespace(input_dph=size) for size in (1.0, -4.0, 0.0)]

    def azimuth_deg(self, interval):
        return 130.0 if getattr(interval, "input_dph", 0.0) == -4.0 else 50.0

    def temp_c(self, interval):
        return interval.temp


def parts_of(name, value=2.0, *others):
    (found,) = [
        each
        for each in with_budgets([figure(name, value, 0.1), *others], Plan(), BenchErrors())
        if each.name == name
    ]
    return {each.source: each for each in found.budget.contributions}, found


def budget_of_turned(way):
    """Return the inputs of a misalignment whose unit was turned over in its fixture."""
    plan = Plan()
    plan.rolls = (0.0, 180.0, 90.0, 270.0)
    name = f"input-axis misalignment, component {way} the table"
    (found,) = with_budgets([figure(name, 0.3, 0.1)], plan, BenchErrors())
    return found.budget.contributions


def test_sensitivities_of_figures_are_those_of_their_definitions():
    """Differences of the formulas themselves: Earth rate along the axis, output over rate, sines of turns."""
    rad = math.pi / 180.0

    def earth(lat=30.0, azimuth=50.0, elevation=0.0):
        lat, azimuth, elevation = lat * rad, azimuth * rad, elevation * rad
        level = math.cos(lat) * math.cos(azimuth) * math.cos(elevation)
        return EARTH_DPH * (level + math.sin(lat) * math.sin(elevation))

    def slope(of, **step):
        ((name, size),) = step.items()
        return (of(**{name: {"lat": 30.0, "azimuth": 50.0, "elevation": 0.0}[name] + size}) - of()) / size

    by_source, found = parts_of("bias")
    assert by_source["table_level_deg"].sensitivity == pytest.approx(-slope(earth, elevation=1e-6), rel=1e-4)
    assert by_source["fixture_deg"].sensitivity == by_source["table_level_deg"].sensitivity
    # what is thought of azimuth or latitude, less what is true, goes the other way
    assert by_source["azimuth_deg"].sensitivity == pytest.approx(slope(earth, azimuth=1e-6), rel=1e-4)
    assert by_source["latitude_deg"].sensitivity == pytest.approx(slope(earth, lat=1e-6), rel=1e-4)
    assert "unit_temp_c" not in by_source
    assert by_source["azimuth_deg"].standard == pytest.approx(ASSUMED["azimuth_deg"] / math.sqrt(3.0))
    assert by_source["noise"].standard == pytest.approx(0.1 / 1.959964)
    assert found.high - found.value == pytest.approx(found.budget.half_width)
    warm = figure("bias temperature sensitivity", 0.02, 0.001)
    assert parts_of("bias", 2.0, warm)[0]["unit_temp_c"].sensitivity == pytest.approx(0.02)
    hidden = replace(warm, seen=False)
    assert "unit_temp_c" not in parts_of("bias", 2.0, hidden)[0]
    by_source, _ = parts_of("scale factor", 1.5, figure("scale-factor temperature sensitivity", 3.0, 0.1))
    assert by_source["time_base_ppm"].sensitivity == pytest.approx(-1.5e-6)
    assert by_source["table_rate_ppm"].sensitivity == pytest.approx(1.5e-6)
    assert by_source["unit_temp_c"].sensitivity == pytest.approx(1.5e-6 * 3.0)
    by_source, _ = parts_of("input-axis misalignment, component along the table", 0.3)
    tangent = math.tan(0.3 * rad) / rad * 1e-6
    assert [
        by_source[k].sensitivity for k in ("fixture_deg", "time_base_ppm", "table_rate_ppm")
    ] == pytest.approx([-1.0, -tangent, tangent])
    turned = {each.source: each for each in budget_of_turned("along")}
    assert turned["fixture_seat_deg"].uncertainty == pytest.approx(
        math.sqrt(2.0) / 2.0 * ASSUMED["fixture_seat_deg"] / math.sqrt(3.0)
    )
    assert "fixture_deg" not in turned and "fixture_seat_deg" in {
        each.source for each in budget_of_turned("across")
    }
    by_source, _ = parts_of("input-axis elevation, unit in its fixture", 0.3)
    assert set(by_source) == {"noise", "time_base_ppm", "table_rate_ppm"}
    by_source, _ = parts_of("threshold", 3.0)  # of the nearest input, 4 deg/h, at 130 deg
    north = EARTH_DPH * math.cos(30.0 * rad)
    assert by_source["table_angle_deg"].sensitivity == pytest.approx(
        north * math.sin(130.0 * rad) * rad, rel=1e-6
    )
    assert by_source["table_angle_deg"].standard == pytest.approx(
        math.sqrt(2.0 / 3.0) * ASSUMED["table_angle_deg"]
    )
    assert by_source["latitude_deg"].sensitivity == pytest.approx(3.0 * math.tan(30.0 * rad) * rad)
    assert by_source["azimuth_deg"].sensitivity == pytest.approx(-3.0 / math.tan(130.0 * rad) * rad)
    by_source, _ = parts_of("bias temperature sensitivity", 0.5)
    assert by_source["unit_temp_c"].sensitivity == pytest.approx(0.5 / 40.0)
    for name, power in (
        ("angle random walk", 0.5),
        ("quantisation", 1.0),
        ("rate random walk", -0.5),
        ("rate ramp", -1.0),
    ):
        assert parts_of(name, 2.0)[0]["time_base_ppm"].sensitivity == pytest.approx(-power * 2e-6)
    assert parts_of("warm-up time to 3 s_100", 300.0)[0]["time_base_ppm"].sensitivity == pytest.approx(-3e-4)
    assert list(parts_of("bias stability, 10 s averages", 1.0)[0]) == ["noise"]
    assert with_budgets([figure("x", 1.0, 0.1, low=None)], Plan(), BenchErrors())[0].budget is None


def clock(ppm):
    """A time base that is known to so many ppm, one standard uncertainty."""
    return BenchErrors([certificate("time_base_ppm", 2.0 * ppm, "normal")])


def test_an_interval_that_is_not_even_grows_by_the_bench_on_either_side():
    uneven = figure("rate ramp", 2.0, 0.0, low=0.5, high=6.0)
    (found,) = with_budgets([uneven], Plan(), clock(1e5))
    added = 1.959964 * 0.1 * 2.0
    assert found.high - 2.0 == pytest.approx(math.hypot(4.0, added), rel=1e-3)
    assert 2.0 - found.low == pytest.approx(math.hypot(1.5, added), rel=1e-3)
    wide = replace(uneven, low=0.1)
    (found,) = with_budgets([wide], Plan(), clock(1e6))
    assert found.low == 0.0 and not found.seen  # a magnitude
    part = BenchErrors().of("table_level_deg", 3.0, difference=True)
    assert (part.standard, part.unit, part.estimate) == (
        pytest.approx(math.sqrt(2 / 3) * ASSUMED["table_level_deg"]),
        "deg",
        0.0,
    )
    told = BenchErrors(azimuth_sigma_deg=0.3).of("azimuth_deg", 3.0)
    assert (told.standard, told.kind, told.origin) == (0.3, "A", "Earth rate")


def test_the_cosine_of_an_input_axis_off_the_table_is_that_of_draws():
    along, across = (f"input-axis misalignment, component {way} the table" for way in ("along", "across"))
    one = {along: figure(along, 0.4, 0.1)}
    cosine = _cosine(one, BenchErrors(), 2.0)
    parts = [ASSUMED[name] / math.sqrt(3.0) for name in ("fixture_deg", "table_wobble_deg")]
    ppm = 1e6 * (math.hypot(*parts, 0.4) * math.pi / 180.0) ** 2
    assert (cosine.standard, cosine.estimate, cosine.sensitivity) == pytest.approx((ppm, ppm, 2e-6))
    assert cosine.distribution == "exponential"
    rng = np.random.default_rng(4)
    for size_deg, shape in ((0.01, "exponential"), (0.2, "normal")):
        both = {along: figure(along, 0.6 * size_deg, 1e-9), across: figure(across, -0.8 * size_deg, 1e-9)}
        cosine = _cosine(both, BenchErrors(), 1.0)
        added = math.hypot(*parts) * rng.standard_normal((400_000, 2)) + size_deg * np.array([0.6, -0.8])
        drawn = 1e6 * (1.0 - np.cos(np.radians(np.linalg.norm(added, axis=1))))
        assert cosine.distribution == shape
        assert cosine.estimate == pytest.approx(drawn.mean(), rel=5e-3)
        assert cosine.standard == pytest.approx(drawn.std(), rel=1e-2)


def test_repeatability_over_runs_is_beyond_the_noise_within_each():
    def run(bias, scale):
        rows = (figure("bias", bias, 0.0196), figure("scale factor", scale, 1.96e-6))
        return StandardFigures("r", "u", "g", rows, (), None, None)

    bias, scale = figures_over_runs([run(1.0, 2.0), run(1.3, 2.0002), run(1.1, 2.0001)])
    assert bias.value == pytest.approx(math.sqrt(np.var([1.0, 1.3, 1.1], ddof=1) - 1e-4), rel=1e-3)
    assert (
        scale.value == pytest.approx(math.sqrt(50.0**2 - 0.5**2), rel=1e-3) and "3 power-ons" in bias.source
    )
    assert figures_over_runs([run(1.0, 2.0)]) == ()


class Dwells:
    """A unit of 2 output deg/s a deg/s and 0.5 deg/h of bias, of which the scale factor grows by 3e-6 a degC."""

    latitude_deg = 30.0

    def __init__(self, *rows):
        self.rows = rows

    def needed(self, test):
        return [row for row in self.rows if row.test == test]

    def true_rate_dps(self, row):
        return 1.0001 * row.rate_dps

    def mean_dps(self, row):
        scale = 2.0 + 3e-6 * ((row.temp_c or 25.0) - 25.0) * 2.0
        up = EARTH_DPH * math.sin(math.radians(30.0))
        return scale * (self.true_rate_dps(row) + (up + 0.5 + 0.01 * ((row.temp_c or 25.0) - 25.0)) / 3600.0)

    def temp_c(self, row):
        return row.temp_c

    def output_dph(self, row):
        return np.full(9, 7.0 + 0.8 * (row.input_dph or 0.0) + 0.01 * row.start_s)


def test_sensitivities_to_temperature_are_those_of_the_points_against_the_first():
    points = [(temp, rate) for temp in (25.0, -15.0, 60.0) for rate in (0.0, 20.0, -20.0)]
    rows = [
        Interval("temperature", 1000.0 * k, 1000.0 * k + 600.0, rate_dps=rate, temp_c=temp)
        for k, (temp, rate) in enumerate(points)
    ]
    bias, scale = PARTS["temperature sensitivity"](Dwells(*rows), WHITE)
    assert (bias.value, bias.unit) == (pytest.approx(0.01, rel=0.02), "deg/h/degC")
    assert (scale.value, scale.unit) == (pytest.approx(3.0, rel=0.1), "ppm/degC")


def test_small_rates_are_held_against_the_rests_beside_them():
    """A drift of 0.01 deg/h a second drops out; 0.8 of the input is seen."""
    rows = []
    for step, size in ((1, 2.0), (0, 1.0)):
        for k, sense in enumerate((0.0, 1.0, 0.0)):
            begin = 100.0 * (3 * step + k)
            rows.append(Interval("threshold", begin, begin + 90.0, step=step, input_dph=-sense * size))
    (found,) = PARTS["threshold"](Dwells(*rows), NoiseCoefficients(0.0, 1e-4, 0.0, 0.0, 0.0))
    assert found.value == 1.0 and "no smaller one was put in" in found.source and found.name == "threshold"


def test_allan_variances_of_coefficients_are_ieee_952s():
    noise = NoiseCoefficients(2e-4, 0.01, 0.05, 0.3, 0.7)
    tau_s = np.array([1.0, 36.0, 3600.0])
    h = tau_s / 3600.0
    squares = (
        3.0 * 4e-8 / h**2
        + 1e-4 / h
        + 2.0 * math.log(2.0) / math.pi * 0.0025
        + 0.09 * h / 3.0
        + 0.49 * h**2 / 2.0
    )
    assert noise.deviation(tau_s) == pytest.approx(np.sqrt(squares))
    assert noise.squares() == pytest.approx([4e-8, 1e-4, 0.0025, 0.09, 0.49])


def test_the_scatter_of_a_weighted_sum_is_a_quadratic_of_each_coefficient():
    rng = np.random.default_rng(1)
    scatter = _Scatter(np.array([1.0, 8.0, 64.0, 300.0]) / 3600.0, 1.0, 1.0 / 3600.0)
    weights = rng.normal(size=4)
    squares = np.array([1e-9, 1e-4, 1e-3, 1e-2, 1e-2])
    for index in range(5):
        a, b, q = scatter.variance_of(weights, squares, index)
        for size in (0.0, 0.3, 4.0):
            given = squares.copy()
            given[index] = size
            whole = scatter.covariance(given)
            exact = weights @ (whole - 1e-6 / (1.0 + 1e-6) * np.diag(np.diag(whole))) @ weights
            assert a + b * size + q * size**2 == pytest.approx(exact, rel=1e-4), index
    # white noise: each ordinate of the periodogram is exponential and counts for both signs of its frequency

    def power(f):
        x = math.pi * f / 3600.0
        return (2.0 * math.sin(8.0 * x) ** 2 / (8.0 * math.sin(x))) ** 4

    exact = quad(power, 1e-6, 1800.0, limit=2000)[0]
    found = scatter.covariance(np.array([0.0, 1.0, 0.0, 0.0, 0.0]))[1, 1]
    assert found == pytest.approx(exact, rel=0.01)


def test_intervals_of_coefficients_hold_them_and_what_is_absent_has_a_bound():
    rng = np.random.default_rng(2)
    record = 0.6 * rng.standard_normal(40_000)
    found = fit_noise(allan_deviation(record, 1.0))
    low, high = found.low, found.high
    assert low.angle_random_walk_deg_sqrt_h < 0.01 < high.angle_random_walk_deg_sqrt_h
    assert high.angle_random_walk_deg_sqrt_h - low.angle_random_walk_deg_sqrt_h < 5e-4
    for name in (
        "bias_instability_dph",
        "rate_random_walk_dph_sqrt_h",
        "rate_ramp_dph_h",
        "quantisation_deg",
    ):
        assert getattr(low, name) == 0.0 < getattr(high, name)
    assert found.for_errors.bias_instability_dph == pytest.approx(
        0.5 * high.bias_instability_dph, rel=1e-6
    ) or (found.for_errors.bias_instability_dph > 0.0)
    assert found.for_errors.rate_ramp_dph_h == 0.0 == found.for_errors.rate_random_walk_dph_sqrt_h
    narrow = fit_noise(allan_deviation(record, 1.0), level=0.5)
    assert (
        narrow.high.angle_random_walk_deg_sqrt_h < high.angle_random_walk_deg_sqrt_h and narrow.level == 0.5
    )
    exponents = noise_exponents(allan_deviation(record, 1.0, [1, 2, 4, 8]))
    assert exponents.tolist() == [0, 0, 0, 0]


def test_means_of_white_noise_are_independent_and_those_of_a_walk_are_not():
    noise = NoiseCoefficients(0.0, 0.02, 0.0, 0.0, 0.0)
    found = covariance_of_means([0.0, 100.0, 150.0], [100.0, 130.0, 250.0], noise)
    assert np.diag(found) == pytest.approx(0.02**2 * 3600.0 / np.array([100.0, 30.0, 100.0]))
    assert found - np.diag(np.diag(found)) == pytest.approx(np.zeros((3, 3)), abs=1e-12)
    walk = NoiseCoefficients(0.0, 0.0, 0.0, 0.5, 0.0)
    means = covariance_of_means([0.0, 7200.0], [3600.0, 10800.0], walk)
    # two hours apart, each of an hour: K^2 (2 - 1/3)
    assert np.array([1.0, -1.0]) @ means @ np.array([1.0, -1.0]) == pytest.approx(0.25 * (2.0 - 1.0 / 3.0))
