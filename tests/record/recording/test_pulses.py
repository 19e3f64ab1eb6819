"""Clocks against pulses at a unit's trigger input: samples and pulses in true time, told by the unit's clock."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.record.recording import PortJournal, PulseReport
from bench.record.recording._decode import decode_stream
from bench.record.recording._pulses import PulseTimer, warnings_of
from bench.record.recording._timing import StreamTiming

NONE = np.zeros(0, np.int64)
TICKS_HZ = 2000.0


def timing(clock_error_ppm=0.0, residual_s=0.0):
    return StreamTiming(0.0, 5e-4, 16.0, np.zeros((0, 2), np.int64), 125.0, clock_error_ppm, residual_s)


def told(count, unit_ppm=0.0, *, interval_s=1.0, lacking=(), phase_s=0.3, unit_us=1.0):
    """Return the time since the last pulse that a unit sends with samples of these counts, in s."""
    true_s = np.asarray(count) / TICKS_HZ / (1.0 + unit_ppm * 1e-6)
    pulses_s = phase_s + interval_s * np.arange(-1, math.ceil(true_s.max() / interval_s) + 1)
    pulses_s = np.delete(pulses_s, [at + 1 for at in lacking])
    since_s = true_s - pulses_s[np.searchsorted(pulses_s, true_s, side="right") - 1]
    return np.rint(since_s * (1.0 + unit_ppm * 1e-6) * 1e6 / unit_us) * unit_us * 1e-6


def report(
    count, since_s, *, interval_s=1.0, begins=(), block=10_000, clock_ppm=0.0, residual_s=0.0, step_s=1e-6
):
    timer = PulseTimer(1.0 / TICKS_HZ, interval_s, np.asarray(begins, np.int64), step_s)
    for at in range(0, len(count), block):
        timer.feed(np.asarray(count)[at : at + block], since_s[at : at + block])
    return timer.report(timing(clock_ppm, residual_s))


@given(
    unit_ppm=st.floats(-10_000, 10_000),
    interval_s=st.sampled_from((0.05, 0.1, 1.0, 2.5)),
    phase_s=st.floats(0.0, 0.99),
    block=st.integers(1, 700),
)
@settings(max_examples=60, deadline=None)
def test_the_unit_clock_is_off_by_what_it_makes_of_the_pulses(unit_ppm, interval_s, phase_s, block):
    count = 16 * np.arange(1, 60 * 125)
    since_s = told(count, unit_ppm, interval_s=interval_s, phase_s=phase_s * interval_s)
    found = report(count, since_s, interval_s=interval_s, block=block)
    # a time holds as many pulses as intervals, or one more or less; those before the first sample are not seen
    seen_s = (count[-1] - count[0]) / TICKS_HZ / (1.0 + unit_ppm * 1e-6)
    assert found.pulses == pytest.approx(seen_s / interval_s, abs=1.001)
    assert found.missed == 0
    # instants rounded to 1 us are off by half of it at most: half a line up, half down tilts it by 1.5 us / T
    worst_ppm = 1.5 / (interval_s * (found.pulses - 1))
    assert found.unit_clock_error_ppm == pytest.approx(unit_ppm, abs=1.01 * worst_ppm)
    assert found.unit_clock_uncertainty_ppm == pytest.approx(worst_ppm / math.sqrt(3.0), rel=0.6)
    assert found.scatter_s < 0.6e-6


def test_the_uncertainty_is_that_of_the_slope_of_scattered_instants():
    rng = np.random.default_rng(7)
    count = 16 * np.arange(1, 100 * 125)
    scatter_s, off = 40e-6, []
    for _ in range(200):
        late_s = rng.normal(0.0, scatter_s, 102)
        true_s = count / TICKS_HZ
        pulses_s = np.arange(-1, 101) + 0.3 + late_s
        since_s = true_s - pulses_s[np.searchsorted(pulses_s, true_s, side="right") - 1]
        found = report(count, since_s)
        assert found.scatter_s == pytest.approx(scatter_s, rel=0.35)
        off.append(found.unit_clock_error_ppm / found.unit_clock_uncertainty_ppm)
    assert np.std(off) == pytest.approx(1.0, abs=0.2) and abs(np.mean(off)) < 0.25


def test_the_bench_clock_is_what_the_unit_clock_does_not_explain():
    """The unit is 40 ppm fast, and 100 ppm fast against the bench: the bench is slow by 60 ppm."""
    count = 16 * np.arange(1, 125 * 200)
    found = report(count, told(count, 40.0), clock_ppm=100.0, residual_s=1e-3)
    assert found.bench_clock_error_ppm == pytest.approx((1.00004 / 1.0001 - 1.0) * 1e6, abs=0.01)
    assert found.bench_clock_uncertainty_ppm == pytest.approx(1e-3 / 200.0 * 1e6, rel=0.01)
    assert warnings_of(found) == ()


@pytest.mark.parametrize(("clock_ppm", "residual_s", "said"), [(-300.0, 1e-3, True), (-300.0, 0.05, False)])
def test_a_bench_clock_that_is_surely_off_is_said(clock_ppm, residual_s, said):
    count = 16 * np.arange(1, 125 * 200)
    found = report(count, told(count), clock_ppm=clock_ppm, residual_s=residual_s)
    assert any("bench's clock is off by +300 ppm" in text for text in warnings_of(found)) is said


def test_pulses_that_do_not_come_are_counted_and_move_nothing():
    count = 16 * np.arange(1, 125 * 100)
    found = report(count, told(count, -250.0, lacking=(20, 21, 60)), clock_ppm=-250.0)
    assert (found.pulses, found.missed) == (97, 3)
    assert found.unit_clock_error_ppm == pytest.approx(-250.0, abs=0.01)
    assert warnings_of(found) == ("3 of 100 pulses at the unit's input are missing",)


def test_lost_samples_hide_no_more_pulses_than_came_meanwhile():
    """Behind 4.2 s without a sample the unit tells of the last pulse; the four before it are not known."""
    count = 16 * np.arange(1, 125 * 100)
    kept = (count / TICKS_HZ < 40.5) | (count / TICKS_HZ > 44.7)
    found = report(count[kept], told(count, 120.0)[kept])
    assert (found.pulses, found.missed) == (97, 3)
    assert found.unit_clock_error_ppm == pytest.approx(120.0, abs=0.01)


def test_a_unit_switched_off_and_on_has_its_pulses_on_a_line_of_their_own():
    """What its count was set to behind the pause is known from arrival only: 2 ms are of no consequence."""
    count = 16 * np.arange(1, 125 * 60)
    since_s = told(count, 80.0)
    cut = 125 * 30
    shifted = np.concatenate((count[:cut], count[cut:] + 7 * 2000 + 4))
    found = report(shifted, since_s, begins=[cut])
    assert found.missed == 0 and found.pulses == 60
    assert found.unit_clock_error_ppm == pytest.approx(80.0, abs=0.02)
    assert abs(report(shifted, since_s).unit_clock_error_ppm - 80.0) > 10.0  # were they one


@pytest.mark.parametrize("stands_s", [0.0, 8.388607, math.nan])
def test_a_value_that_stands_is_no_pulse(stands_s):
    count = 16 * np.arange(1, 125 * 30)
    found = report(count, np.full(len(count), stands_s))
    assert found == PulseReport(0, 0, 1.0)
    assert len(warnings_of(found)) == 1 and "no pulse came" in warnings_of(found)[0]


def test_a_time_that_wraps_through_negative_numbers_is_no_pulse():
    """A signed number of 24 bits of microseconds goes from 8.39 s to -8.39 s and on through 0."""
    count = 16 * np.arange(1, 125 * 60)
    since_s = np.mod(count / TICKS_HZ + 8.388608, 16.777216) - 8.388608
    assert report(count, since_s).pulses == 0


def test_two_pulses_make_no_line_and_a_unit_without_has_no_report():
    count = 16 * np.arange(1, 125 * 2)
    assert report(count, told(count)) == PulseReport(2, 0, 1.0)
    assert report(NONE, np.zeros(0)) is None and warnings_of(None) == ()


def test_a_stream_of_ticks_is_timed_by_ticks_and_pulses(tmp_path, fake):
    """Four ticks a sample at 100 Hz: a count is 2.5 ms. The unit's clock is 60 ppm fast, the bench's is right."""

    class Telling(fake.Decoder):
        counter_step = 4.0
        pulse_resolution_s = 1e-7

        def feed(self, data):
            batch = super().feed(data)
            batch.columns["since_pulse_s"] = batch.columns["delta"].astype(np.float64)
            return batch

    unit_ppm = 60.0
    true_s = 0.01 * np.arange(1, 6001) / (1.0 + unit_ppm * 1e-6)
    since_s = np.mod(true_s - 0.123, 0.5) * (1.0 + unit_ppm * 1e-6)
    port = PortJournal(tmp_path, "fog")
    for number, (at_s, since) in enumerate(zip(true_s, since_s, strict=True)):
        port.received(fake.encode(4 * number % 128, float(since)), 2.0 + at_s)
    port.flush(sync=False)
    found = decode_stream(tmp_path, fake.source(decoder=Telling, pulse_interval_s=0.5)).pulses
    assert (found.pulses, found.missed, found.interval_s) == (120, 0, 0.5)
    assert found.unit_clock_error_ppm == pytest.approx(unit_ppm, abs=0.01)  # the time is a float of 32 bits
    assert found.bench_clock_error_ppm == pytest.approx(0.0, abs=0.1)
    # least squares: s / (T sqrt(n / 12)) from scatter, 1.5 steps / T / sqrt(3) from rounding
    scattered = found.scatter_s / (60.0 * math.sqrt(10.0))
    told = 1e6 * math.hypot(scattered, 1.5 * 1e-7 / 60.0 / math.sqrt(3.0))
    assert found.unit_clock_uncertainty_ppm == pytest.approx(told, rel=0.02)


def test_every_stretch_between_restarts_costs_a_degree_of_freedom():
    """Five pulses of 10 us scatter in two stretches: two means and a slope leave two of them."""
    count = 16 * np.arange(1, 125 * 5 + 1)
    late_s = 1e-5 * np.array([0.0, 1.0, -1.0, 1.0, 1.0])
    true_s, pulses_s = count / TICKS_HZ, np.arange(-1, 5) + 0.3 + np.append(0.0, late_s)
    since_s = true_s - pulses_s[np.searchsorted(pulses_s, true_s, side="right") - 1]
    found = report(count, since_s, begins=[int(125 * 2.5)], step_s=0.0)
    true, unit = [], []
    for part in (slice(0, 3), slice(3, 5)):
        own = np.arange(5.0)[part]
        true.append(own - own.mean())
        unit.append(late_s[part] - late_s[part].mean())
    x, y = np.concatenate(true), np.concatenate(unit)
    left = y - x * (x @ y) / (x @ x)
    assert found.pulses == 5
    assert found.scatter_s == pytest.approx(math.sqrt(left @ left / 2), rel=1e-6)
    assert found.unit_clock_uncertainty_ppm == pytest.approx(
        1e6 * found.scatter_s / math.sqrt(x @ x), rel=1e-9
    )
