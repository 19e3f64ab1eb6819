"""Dwells and repeats of the standards' test by measured noise, against closed forms."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import norm

from bench.analysis.common.allan_noise import NoiseCoefficients
from bench.analysis.common.mean_noise import covariance_of_means
from bench.analysis.figures._parts import alternation_weights
from bench.record.events.run import Interval
from benchmarks.allan import simulate
from drivers.base.errors import ConfigurationError
from procedures import standard_test
from procedures._by_noise import AtRest, Schedule, dwells_s, finest, repeated, schedules, shortest
from procedures._standard_plan import GRADES, Dwell, Plan, StandardTestParameters
from procedures.standard_test import PROCEDURE

N = 0.01
WHITE = (0.0, N, 0.0, 0.0, 0.0)
FLICKER = (0.0, 1e-4, 0.05, 0.0, 0.0)


def at_rest(coefficients, seconds=200_000, seed=3):
    return simulate(np.random.default_rng(seed), seconds, coefficients)


def alternating(repeats, dwell_s, gap_s, coefficients):
    """Return the standard error of the answer to an input put in so often, in closed form."""
    start = (dwell_s + gap_s) * np.arange(2.0 * repeats + 1.0)
    weights = alternation_weights(repeats)
    return math.sqrt(
        weights @ covariance_of_means(start, start + dwell_s, NoiseCoefficients(*coefficients)) @ weights
    )


@pytest.mark.parametrize("coefficients", [WHITE, FLICKER])
@pytest.mark.parametrize(("dwell_s", "gap_s"), [(60.0, 30.0), (480.0, 30.0)])
def test_the_difference_taken_of_a_record_is_that_of_its_noise(coefficients, dwell_s, gap_s):
    found = AtRest.of_means(at_rest(coefficients)).difference_dph(dwell_s, gap_s)
    assert found == pytest.approx(alternating(1, dwell_s, gap_s, coefficients), rel=0.1)
    if coefficients is WHITE:  # N / sqrt(T) each, T in h
        assert found == pytest.approx(N * math.sqrt(1.5 * 3600.0 / dwell_s), rel=0.1)


def test_a_drift_and_missing_seconds_are_no_noise():
    means = at_rest(WHITE, 50_000)
    plain = AtRest.of_means(means).difference_dph(300.0, 30.0)
    drifting = means + 0.5 * np.arange(len(means)) / 3600.0
    assert AtRest.of_means(drifting).difference_dph(300.0, 30.0) == pytest.approx(plain, rel=1e-6)
    holes = means.copy()
    holes[7::10] = math.nan
    holes[20_000:22_000] = math.nan
    assert AtRest.of_means(holes).difference_dph(300.0, 30.0) == pytest.approx(plain, rel=0.15)
    lone = means.copy()  # a stretch of which one second in 200 is there: no dwell
    lone[20_000:40_000] = math.nan
    lone[20_000:40_000:200] = means[20_000:40_000:200]
    assert AtRest.of_means(lone).difference_dph(300.0, 30.0) == pytest.approx(plain, rel=0.15)
    every_fourth = np.arange(len(means)) % 4 == 0  # a bus that hands over four seconds at once
    sums = np.where(every_fourth, np.convolve(means, np.ones(4))[: len(means)], 0.0)
    together = AtRest(4.0 * every_fourth, sums)
    assert together.difference_dph(300.0, 30.0) == pytest.approx(plain, rel=0.05)


def test_pieces_of_a_record_are_the_record():
    whole = AtRest.of_means(at_rest(WHITE, 9000))
    pieces = [AtRest(whole.samples[k : k + 300], whole.sums_dph[k : k + 300]) for k in range(0, 9000, 300)]
    assert AtRest.of_pieces(pieces).difference_dph(240.0, 30.0) == whole.difference_dph(240.0, 30.0)


def test_a_record_too_short_for_three_dwells_tells_nothing():
    record = AtRest.of_means(np.zeros(3 * 60 + 2 * 30))
    assert record.difference_dph(60.0, 30.0) == 0.0
    assert math.isnan(record.difference_dph(61.0, 30.0))
    assert math.isnan(AtRest.of_means(np.full(999, math.nan)).difference_dph(60.0, 30.0))
    assert list(dwells_s(record)) == [] and schedules([record], 30.0) == []


@pytest.mark.parametrize("repeats", [1, 2, 5, 12])
def test_repeats_help_as_the_closed_form_has_it(repeats):
    weights = alternation_weights(repeats)
    assert weights.sum() == pytest.approx(0.0) and weights[1::2].sum() == pytest.approx(1.0)
    assert weights @ weights / 1.5 == pytest.approx(repeated(repeats))
    assert weights @ np.arange(len(weights)) == pytest.approx(0.0)
    # of flicker the alternation is nearly without memory
    ratio = alternating(repeats, 480.0, 30.0, FLICKER) / alternating(1, 480.0, 30.0, FLICKER)
    assert ratio == pytest.approx(math.sqrt(repeated(repeats)), rel=0.12)


def test_the_shortest_and_the_finest_are_those_of_all():
    among = [
        Schedule(60.0, 1, 8.0, 30.0),
        Schedule(60.0, 4, 4.0, 30.0),
        Schedule(240.0, 1, 4.1, 30.0),
        Schedule(240.0, 4, 2.0, 30.0),
    ]
    assert [each.duration_s for each in among] == [270.0, 810.0, 810.0, 2430.0]
    assert shortest(among, 8.0) is among[0] and shortest(among, 4.0) is among[1]
    assert shortest(among, 2.0) is among[3] and shortest(among, 1.9) is None
    assert (
        finest(among, 810.0) is among[1] and finest(among, 1e6) is among[3] and finest(among, 269.0) is None
    )


def test_the_noisiest_unit_counts():
    quiet, noisy = (AtRest.of_means(at_rest((0.0, n, 0.0, 0.0, 0.0), 20_000)) for n in (N, 3.0 * N))
    both, alone = schedules([quiet, noisy], 30.0), schedules([noisy], 30.0)
    assert both == alone
    assert both[0].error_dph == pytest.approx(3.0 * schedules([quiet], 30.0)[0].error_dph, rel=0.1)


def planned(coefficients, **given):
    p = StandardTestParameters(**given)
    seconds = round(3600.0 * p.preset().noise_h)
    return Plan.of(p).after({"unit": AtRest.of_means(at_rest(coefficients, seconds))})


def test_inputs_are_as_small_as_the_noise_lets_be_shown_in_the_time():
    """Half of an input that is all there is shown in 19 of 20 tests; what is next smaller takes more time."""
    plan = planned((0.0, 0.004, 0.006, 0.0, 0.0))
    assert plan.by_noise and plan.shown_dph == plan.inputs[0].input_dph
    for each in plan.inputs:
        ratio = each.schedule.error_dph / each.input_dph
        assert norm.cdf((1.0 - 0.5) / ratio - 1.959964) >= 0.949
    assert [each.number for each in plan.inputs] == list(range(plan.inputs[0].number, 5))
    assert sum(each.schedule.duration_s for each in plan.inputs) <= 4.0 * 3600.0
    for hours in (0.3, 0.6, 1.0, 2.0, 4.0):
        within = planned((0.0, 0.002, 0.0, 0.0, 0.0), steps_h=hours)
        assert sum(each.schedule.duration_s for each in within.inputs) <= hours * 3600.0
    longer = planned((0.0, 0.004, 0.006, 0.0, 0.0), steps_h=40.0)
    assert longer.inputs[0].input_dph < plan.inputs[0].input_dph
    quiet = planned((0.0, 1e-4, 1e-4, 0.0, 0.0))
    assert [each.input_dph for each in quiet.inputs] == pytest.approx([0.01, 0.02, 0.04, 0.08, 0.16])
    assert {each.schedule.dwell_s for each in quiet.inputs} == {60.0}


def test_a_unit_whose_noise_hides_every_input_takes_all_the_time_for_the_largest():
    plan = planned((0.0, 0.5, 2.0, 0.0, 0.0))
    (most,) = plan.inputs
    assert plan.shown_dph is None and most.input_dph == pytest.approx(0.16)
    assert 0.5 * 4.0 < most.schedule.duration_s / 3600.0 <= 4.0
    assert plan.needed_dph == pytest.approx(7.2 * most.schedule.error_dph) and plan.needed_dph > 0.16


def test_a_unit_of_another_class_on_the_table_has_no_say():
    """A MEMS unit beside a fibre optic gyro, that no input would show; of two that are able the noisier."""
    p = StandardTestParameters()
    fog, worse, mems = (
        AtRest.of_means(at_rest((0.0, n, b, 0.0, 0.0), 21_600))
        for n, b in ((0.004, 0.006), (0.012, 0.006), (0.2, 4.0))
    )
    alone = Plan.of(p).after({"fog": fog})
    both = Plan.of(p).after({"fog": fog, "mems": mems})
    assert (both.inputs, both.rate_dwell_s, both.sequences) == (
        alone.inputs,
        alone.rate_dwell_s,
        alone.sequences,
    )
    assert both.too_noisy == ("mems",) and alone.too_noisy == ()
    three = Plan.of(p).after({"fog": fog, "worse": worse, "mems": mems})
    assert three.inputs == Plan.of(p).after({"worse": worse}).inputs and three.too_noisy == ("mems",)
    assert three.shown_dph > both.shown_dph
    # where no unit is able the quietest one counts
    hopeless = Plan.of(p).after(
        {"mems": mems, "worst": AtRest.of_means(at_rest((0.0, 2.0, 4.0, 0.0, 0.0), 21_600))}
    )
    assert hopeless.inputs == Plan.of(p).after({"mems": mems}).inputs and hopeless.too_noisy == ("worst",)


def test_a_dwell_that_was_given_stays_and_its_error_is_told():
    plan = planned((0.0, 0.004, 0.0, 0.0, 0.0), step_dwell_s=900.0, noise_h=100.0)
    assert [each.schedule.dwell_s for each in plan.inputs] == [900.0] * 5
    error = 0.004 * math.sqrt(1.5 * 4.0)
    assert plan.inputs[0].schedule.error_dph == pytest.approx(error, rel=0.15)
    assert plan.shown_dph == next(s for s in (0.01, 0.02, 0.04, 0.08, 0.16) if s >= 7.2 * error)
    unknown = Plan.of(StandardTestParameters()).after({"unit": AtRest.of_means(np.zeros(10))})
    assert unknown.by_noise is False and unknown.shown_dph is None
    assert [each.schedule.duration_s for each in unknown.inputs] == [3 * 960.0] * 5  # 4 h


def test_rates_are_dwelt_at_until_a_residual_can_be_told():
    """Each rate twice a sequence: three standard errors N / sqrt(2 n T) of white noise, in ppm of 20 deg/s."""
    white = 0.05
    plan = planned((0.0, white, 0.0, 0.0, 0.0), residual_ppm=3.0, rates_h=40.0, noise_h=100.0)
    error = white / math.sqrt(plan.rate_dwell_s / 3600.0) / math.sqrt(2.0 * plan.sequences)
    assert 3.0 * error / 72_000.0 < 3.3e-6 and plan.rate_dwell_s > 60.0
    # to dwell is cheaper than to repeat, as moves take time
    assert plan.sequences == 2
    plain = planned((0.0, 0.004, 0.006, 0.0, 0.0))
    assert (plain.rate_dwell_s, plain.sequences) == (60.0, 2)
    given = planned((0.0, white, 0.0, 0.0, 0.0), residual_ppm=3.0, rates_h=40.0, rate_dwell_s=60.0)
    assert given.rate_dwell_s == 60.0 and given.sequences == 6
    patient = planned((0.0, 10.0, 0.0, 0.0, 0.0), rates_h=200.0, noise_h=100.0)
    assert (
        patient.rate_dwell_s == 480.0 and patient.sequences == 6
    )  # what ten minutes and six sequences can do
    short = planned((0.0, white, 0.0, 0.0, 0.0), residual_ppm=3.0, rates_h=0.1)
    assert (short.rate_dwell_s, short.sequences) == (60.0, 2)


def test_the_intervals_of_a_plan_are_in_the_order_of_the_test_without_overlap():
    p = PROCEDURE.parse({"grade": "mems"})
    rows = PROCEDURE.intervals(p, at_rest((0.0, 0.2, 4.0, 0.0, 0.0), 7200))
    tests = list(dict.fromkeys(row.test for row in rows))
    assert tests == [
        "warm_up", "bias", "noise", "threshold", "resolution", "misalignment", "scale_factor", "temperature",
    ]  # fmt: skip
    assert all(before.end_s <= after.start_s for before, after in pairwise(rows))
    assert len([row for row in rows if row.test == "bias"]) == 7
    fog = PROCEDURE.intervals(PROCEDURE.parse({}), np.zeros(0))
    east = [row for row in fog if row.test == "axis_east"]
    assert [row.end_s - row.start_s for row in east] == [900.0] * 4
    first, second = [row for row in fog if row.test == "bias"][:2]
    assert first.start_s == east[-1].end_s and second.start_s - first.end_s == 60.0 + 3600.0
    # the way back from 60 to 25 degC at 2 K/min comes after the last dwell
    assert PROCEDURE.expected_duration_s(PROCEDURE.parse({})) - fog[-1].end_s == pytest.approx(60.0 * 17.5)
    cold = PROCEDURE.intervals(PROCEDURE.parse({"rate_dwell_s": "1200"}), np.zeros(0))
    assert min(row.end_s - row.start_s for row in cold if row.test == "temperature") == 1200.0
    inputs = [row.input_dph for row in rows if row.test == "threshold"]
    assert inputs[::2] == [0.0] * len(inputs[::2]) and set(inputs[1::2]) == {-9.6} and len(inputs) > 3
    assert [row.roll_deg for row in rows if row.test == "misalignment"] == [0, 0, 180, 180, 90, 90, 270, 270]
    temps = [row.temp_c for row in rows if row.test == "temperature"]
    assert temps == [25.0] * 3 + [-40.0] * 3 + [60.0] * 3
    soaks = [row for row in rows if row.test == "temperature" and not row.rate_dps]
    # 65 K and 100 K at 2 K/min, soaks of 150 min
    assert soaks[1].start_s - soaks[0].end_s > 60.0 * (150.0 + 32.5)
    assert soaks[2].start_s - soaks[1].end_s > 60.0 * (150.0 + 50.0)
    assert all(row.end_s - row.start_s >= 600.0 for row in rows if row.test == "temperature")


def test_a_unit_that_is_gone_at_the_end_of_the_record_has_no_say():
    class Gyro:
        def __init__(self, gone):
            self.gone = gone

        def seconds(self, start_s, end_s):
            count = round(end_s - start_s)
            return np.full(count, 2.0), np.full(count, 2.0 * start_s)

    class Bench:
        def __init__(self):
            self.now_s, self.told = 100.0, []
            self.gyros = {"here": Gyro(False), "lost": Gyro(True)}

        def wait(self, length_s, doing):
            self.now_s += length_s

        def event(self, event):
            self.told.append(event)

    bench = Bench()
    found = standard_test._record_noise(bench, Dwell("noise", 700.0))
    assert set(found) == {"here"} and bench.told == [Interval("noise", 100.0, 800.0)]
    assert len(found["here"].samples) == 700
    assert found["here"].sums_dph[[0, 299, 300, 600, 699]] / 7200.0 == pytest.approx(
        [100, 100, 400, 700, 700]
    )


def test_presets_and_what_is_given():
    fog = PROCEDURE.parse({})
    assert fog.preset() == GRADES["fog"]
    assert PROCEDURE.parse({"grade": "rlg", "noise_h": "3"}).preset().noise_h == 3.0
    assert PROCEDURE.parse({"grade": "rlg"}).preset().smallest_step_dph == GRADES["rlg"].smallest_step_dph
    rates = fog.rates()
    assert max(rates) == 20.0 and min(rates) == -20.0 and rates[0] == rates[-1] == 0.0
    assert len({rate for rate in rates if rate > 0}) == 11 and np.abs(np.diff(rates)).max() < 2.0
    plan = Plan.of(fog)
    for rate in rates[1:5]:
        turns = plan.at_rate_s(rate) * rate / 360.0
        assert turns == pytest.approx(round(turns)) and plan.at_rate_s(rate) >= 60.0
    with pytest.raises(ConfigurationError, match="grade"):
        PROCEDURE.parse({"grade": "toy"})
    demands = PROCEDURE.demands(fog)
    assert (demands.max_rate_dps, demands.min_temp_c, demands.max_temp_c) == (20.0, -40.0, 60.0)
    assert PROCEDURE.expected_duration_s(fog) > 3600 * 15


@pytest.mark.parametrize(("most_dps", "per_sign"), [(100.0, 11), (20.0, 7), (0.3, 3)])
def test_the_largest_rate_is_the_one_asked_for_to_the_last_bit(most_dps, per_sign):
    """Eleven steps of an eleventh are 1e-14 more, which a bench with that limit refuses in mid-test."""
    rates = StandardTestParameters(max_rate_dps=most_dps, rates_per_sign=per_sign).rates()
    assert max(rates) == most_dps and min(rates) == -most_dps
    assert len(rates) == 4 * per_sign + 1
