"""Sample times where the line under the arrivals can be drawn by hand."""

import numpy as np
import pytest

from bench.record.recording._timing import StreamTimer, Unwrapper, _line_below

MODULO = 128
FRAME = 36


def fed(counter, arrival_s, *, modulo=MODULO, block=1_000_000, rate_hz=100.0):
    """Return the timing of frames of which each has an arrival time, and their corrected counts."""
    ends = FRAME * np.arange(1, len(counter) + 1)
    marks = np.column_stack((ends, np.rint(np.asarray(arrival_s) * 1e9).astype(np.int64)))
    timer, unwrap = StreamTimer(modulo, 1, rate_hz), Unwrapper(modulo)
    for at in range(0, len(counter), block):
        timer.feed(counter[at : at + block], ends[at : at + block], marks)
    timing = timer.fit()
    return timing, timing.corrected(unwrap.feed(counter)[0], 0)


@pytest.mark.parametrize(
    ("points", "start_s", "period_s"),
    [
        ([(0, 2.0), (1, 2.1), (2, 2.2), (3, 2.3)], 2.0, 0.1),
        ([(0, 0.0), (2, 0.5), (2, 0.25), (4, 0.6)], 0.0, 0.125),
        ([(0, 2.5), (1, 2.4), (2, 2.5), (2, 2.6), (8, 2.8), (9, 2.9), (10, 3.0)], 2.4 - 0.4 / 7, 0.4 / 7),
        ([(7, 5.0)], 4.3, 0.1),
    ],
    ids=["on a line", "a count twice, later first", "a count twice, earlier first", "one point"],
)
def test_the_line_lies_below_all_arrivals_of_a_count_and_touches_two(points, start_s, period_s):
    count, arrival_s = np.array([x for x, _ in points]), np.array([y for _, y in points])
    assert _line_below(count, arrival_s, 0.1) == pytest.approx((start_s, period_s), abs=1e-12)


@pytest.mark.parametrize("block", [700, 1_000_000])
def test_marks_that_were_held_up_and_come_all_at_once_are_no_restart(block):
    """A mark a second; from 10 to 15 s nothing comes, and then five marks within a tenth of a millisecond."""
    last = np.arange(99, 6000, 100)
    sample_s = 0.01 * np.arange(6000)
    ends = FRAME * np.arange(1, 6001)
    arrival = sample_s[last].copy()
    held = (arrival > 10.0) & (arrival < 15.0)
    arrival[held] = 15.0 + 1e-5 * np.arange(held.sum())
    marks = np.column_stack((ends[last], np.rint(arrival * 1e9).astype(np.int64)))
    timer = StreamTimer(65536, 1, 100.0)
    for at in range(0, 6000, block):
        timer.feed(np.arange(at, min(at + block, 6000)), ends[at : at + block], marks)
    timing = timer.fit()
    assert len(timing.corrections) == 0 and timing.period_s == pytest.approx(0.01, rel=1e-6)
    assert not any("started anew" in text for text in timing.warnings)


def test_a_counter_that_leaps_by_thirty_without_time_began_anew():
    """At 100 Hz that is 0.3 s early: the device cannot have sampled ahead of its time."""
    true_s = 5.0 + 0.01 * np.arange(4000)
    counter = np.concatenate((np.arange(2000), np.arange(2030, 4030))) % 1024
    timing, count = fed(counter, true_s, modulo=1024)
    assert count.tolist() == list(range(4000))
    assert np.abs(timing.time_ns(count) * 1e-9 - true_s).max() < 1e-6
    assert timing.warnings[0].startswith("the device's counter started anew 1 times")


@pytest.mark.parametrize(("off", "told"), [(0.03, True), (-0.03, True), (0.015, False)])
def test_a_rate_far_off_is_told_however_little_the_record_says_of_it(off, told):
    """In four seconds of which one came 20 ms late, one percent and a half may be chance; three are told."""
    sample_s = np.arange(400) / (100.0 * (1.0 + off))
    timing, _ = fed(np.arange(400), sample_s + np.where((sample_s >= 1.0) & (sample_s < 2.0), 0.02, 0.0))
    assert timing.sample_rate_hz == pytest.approx(100.0 * (1.0 + off), rel=1e-6)
    assert bool(timing.warnings) is told
