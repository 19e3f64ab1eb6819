"""Sample times against known truth: the samples' own times, jittered arrivals, lost frames, wrong clocks."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.record.recording._timing import StreamTimer, Unwrapper

MODULO = 128
FRAME = 36


def fit(
    samples, period_s, latency_s, *, nominal_hz=100.0, chunk=1, block=1000, modulo=MODULO, step=1, shift=0
):
    """Return (timing, time in s of each frame, corrected counts) for frames of the given sample numbers."""
    samples = np.asarray(samples, np.int64)
    counter = (samples * step + shift) % modulo
    ends = FRAME * np.arange(1, len(samples) + 1)
    last = np.append(np.arange(chunk - 1, len(samples) - 1, chunk), len(samples) - 1)
    arrival = 5.0 + samples[last] * period_s + np.broadcast_to(latency_s, len(samples))[last]
    arrival = np.maximum.accumulate(arrival)
    marks = np.column_stack((ends[last], np.rint(arrival * 1e9).astype(np.int64)))
    timer = StreamTimer(modulo, step, nominal_hz)
    for at in range(0, len(samples), block):
        timer.feed(counter[at : at + block], ends[at : at + block], marks)
    timing = timer.fit()
    unwrap = Unwrapper(modulo)
    blocks = range(0, len(samples), block)
    counts = np.concatenate([timing.corrected(unwrap.feed(counter[at : at + block])[0], at) for at in blocks])
    return timing, timing.time_ns(counts) * 1e-9, counts


def jitter(seed, count, scale_s=0.004):
    return np.random.default_rng(seed).exponential(scale_s, count)


@given(data=st.lists(st.integers(0, 127), max_size=60), block=st.integers(1, 20))
@settings(max_examples=60, deadline=None)
def test_unwrapping_does_not_depend_on_block_borders(data, block):
    unwrap, parts = Unwrapper(MODULO), []
    for at in range(0, len(data), block):
        parts += unwrap.feed(np.array(data[at : at + block], np.int64))[0].tolist()
    assert [count % MODULO for count in parts] == data
    assert all(0 <= later - earlier < MODULO for earlier, later in itertools.pairwise(parts))


@pytest.mark.parametrize("clock_ppm", [-10_000, -50, 0, 50, 10_000])
@pytest.mark.parametrize("rate_hz", [100.0, 1000.0])
def test_a_clock_off_by_one_percent_is_found_and_times_stay_within_a_sample(clock_ppm, rate_hz):
    count = 60_000
    period_s = 1.0 / (rate_hz * (1 + clock_ppm * 1e-6))
    timing, time_s, _ = fit(np.arange(count), period_s, jitter(1, count), nominal_hz=rate_hz)
    truth = 5.0 + np.arange(count) * period_s
    assert np.abs(time_s - truth).max() < 0.5 / rate_hz
    assert timing.clock_error_ppm == pytest.approx(clock_ppm, abs=10)
    assert timing.sample_rate_hz == pytest.approx(1 / period_s, rel=1e-5)
    told = [f"not the nominal {rate_hz:g} Hz ({clock_ppm * 1e-4:+.2f}%)"] if abs(clock_ppm) > 1000 else []
    assert [text.split(", ")[1].split(":")[0] for text in timing.warnings] == told


@pytest.mark.parametrize("chunk", [1, 7, 100])
@settings(max_examples=40, deadline=None)
@given(gap=st.integers(1, 1000), at=st.integers(500, 4000), seed=st.integers(0, 9))
def test_a_gap_of_any_length_is_counted_and_placed(chunk, gap, at, seed):
    samples = np.concatenate((np.arange(at), np.arange(at + gap, 6000 + gap)))
    _, time_s, counts = fit(samples, 0.01, jitter(seed, len(samples)), chunk=chunk)
    assert counts[-1] - counts[0] == samples[-1]
    lost = np.flatnonzero(np.diff(counts) > 1)
    if gap % MODULO:  # whole wraps leave no trace in the counter: placed within the chunk only
        assert lost.tolist() == [at - 1]
        assert np.diff(counts)[at - 1] == gap + 1
    else:
        assert len(lost) == 1
        assert abs(lost[0] - (at - 1)) <= chunk
    assert np.abs(time_s[-1000:] - (5.0 + samples[-1000:] * 0.01)).max() < 0.002


def test_whole_wraps_are_lost_where_it_is_late_not_where_the_counter_steps_most():
    """Three wraps and five samples are missing before one frame, fifty before the next one."""
    after = 2000 + 3 * MODULO + 5
    samples = np.concatenate((np.arange(2000), [after], np.arange(after + 51, 6000)))
    _, time_s, counts = fit(samples, 0.01, 0.0)
    assert counts.tolist() == samples.tolist()
    assert np.abs(time_s - (5.0 + samples * 0.01)).max() < 1e-6


def test_sparse_arrival_marks_at_a_high_rate_still_resolve_a_gap_of_many_wraps():
    """1 kHz, one mark a second as the emulated lab may give: a wrap is 0.128 s."""
    samples = np.concatenate((np.arange(20_500), np.arange(20_500 + 1000, 61_000)))
    _, time_s, counts = fit(samples, 0.00101, 0.0, nominal_hz=1000.0, chunk=1000)
    assert counts.tolist() == samples.tolist()
    assert np.abs(time_s - (5.0 + samples * 0.00101)).max() < 1e-5


@pytest.mark.parametrize("stall_s", [0.7, 1.3, 5.0])
def test_a_busy_host_is_not_taken_for_lost_frames(stall_s):
    """Frames held up and then delivered in a burst arrive late, but none is missing."""
    count = 12_000
    sample_s = np.arange(count) * 0.01
    held = (sample_s > 60.0) & (sample_s < 60.0 + stall_s)
    latency = np.where(held, 60.0 + stall_s - sample_s, 0.0) + jitter(2, count, 0.001)
    timing, time_s, counts = fit(np.arange(count), 0.01, latency)
    assert counts.tolist() == list(range(count))
    assert np.abs(time_s - 5.0 - sample_s).max() < 0.002
    assert len(timing.corrections) == 0


def test_a_slow_read_every_second_does_not_move_the_line():
    latency = np.where(np.arange(50_000) % 100 == 0, 0.3, 0.0002)
    _, time_s, _ = fit(np.arange(50_000), 0.01, latency)
    assert np.abs(time_s - 5.0002 - np.arange(50_000) * 0.01).max() < 1e-6


def test_a_microsecond_counter_that_wraps_gives_rate_and_gaps():
    """Device time in us modulo 2**32, 100 Hz, a wrap after ten seconds and a gap of three."""
    samples = np.concatenate((np.arange(3000), np.arange(3003, 9000)))
    period_s = 0.01 / 1.0002
    timing, time_s, counts = fit(
        samples, period_s, jitter(3, len(samples), 0.001), modulo=2**32, step=10_000, shift=2**32 - 10_000_000
    )
    assert timing.counter_step == 10_000
    assert (counts - counts[0]).tolist() == (samples * 10_000).tolist()
    assert timing.clock_error_ppm == pytest.approx(200, abs=3)
    assert np.abs(time_s - 5.0 - samples * period_s).max() < 5e-4


@pytest.mark.parametrize("block", [2, 3, 1000])
def test_a_devices_own_step_is_measured_however_few_frames_come_at_once(block):
    """Its datasheet says 10,000 us a sample; it makes 9,998."""
    counter = (9_998 * np.arange(3000)) % 2**32
    ends = FRAME * np.arange(1, 3001)
    marks = np.column_stack((ends, 9_998_000 * np.arange(3000)))
    timer = StreamTimer(2**32, 10_000, 100.0)
    for at in range(0, 3000, block):
        timer.feed(counter[at : at + block], ends[at : at + block], marks)
    timing = timer.fit()
    assert timing.counter_step == 9_998
    assert timing.sample_rate_hz == pytest.approx(1e6 / 9_998, rel=1e-9)
    assert timing.clock_error_ppm == pytest.approx(0.0, abs=1e-3)


def test_a_rate_two_percent_off_is_warned_of():
    """962.4 Hz where 1000 Hz was asked for, as a public KVH 1750 recording shows (protocols, rule 3)."""
    timing, _, _ = fit(np.arange(40_000), 1 / 962.4, 0.0, nominal_hz=1000.0)
    assert timing.sample_rate_hz == pytest.approx(962.4, abs=0.01)
    assert "962.400 Hz" in timing.warnings[0]


@pytest.mark.parametrize(
    ("has_counter", "said"),
    [(True, "the device's counter started anew 1 times"), (False, "the stream paused 1 times")],
)
def test_a_restarted_device_is_told_and_its_samples_keep_their_time(has_counter, said):
    """Power lost for 4.37 s; the counter starts at 0 again."""
    before, after = np.arange(5003), np.arange(5003 + 437, 20_000)
    samples = np.concatenate((before, after))
    counter = np.concatenate((before % MODULO, (after - after[0]) % MODULO))
    ends = FRAME * np.arange(1, len(samples) + 1)
    marks = np.column_stack((ends, np.rint((5.0 + samples * 0.01) * 1e9).astype(np.int64)))
    timer = StreamTimer(MODULO, 1, 100.0, has_counter)
    timer.feed(counter, ends, marks)
    timing = timer.fit()
    counts = timing.corrected(Unwrapper(MODULO).feed(counter)[0], 0)
    assert counts.tolist() == samples.tolist()
    assert timing.warnings[0].startswith(said)


def test_the_time_on_the_wire_is_taken_off():
    ends = FRAME * np.arange(1, 1001)
    marks = np.column_stack((ends, 10_000_000 * np.arange(1000) + 390_625))
    timer = StreamTimer(MODULO, 1, 100.0)
    timer.feed(np.arange(1000) % MODULO, ends, marks)
    assert timer.fit(FRAME * 10 / 921_600).start_s == pytest.approx(0.0, abs=1e-9)


def test_memory_is_one_row_a_second():
    timer = StreamTimer(MODULO, 1, 1000.0)
    ends = FRAME * np.arange(1, 100_001)
    marks = np.column_stack((ends, 1_000_000 * np.arange(100_000)))
    for at in range(0, 100_000, 1000):
        timer.feed(np.arange(at, at + 1000) % MODULO, ends[at : at + 1000], marks)
    assert sum(len(part) for part in timer._counts) <= 201


@pytest.mark.parametrize("off_s", [5.0, 60.0])
@pytest.mark.parametrize("on_s", [4.0, 37.0, 400.0, 640.0])
@pytest.mark.parametrize("clock_ppm", [-10_000, 0, 10_000])
def test_a_device_switched_off_and_on_counts_anew_and_keeps_its_times(off_s, on_s, clock_ppm):
    """A 16-bit counter at 100 Hz wraps in 655 s: its step across the pause says anything from 0 to that."""
    period_s = 0.01 / (1 + clock_ppm * 1e-6)
    before, after = round(on_s / period_s), 30_000
    counter = np.concatenate((np.arange(before), np.arange(after))) % 65536
    pause_s = off_s + 0.0037
    true_s = 5.0 + np.concatenate(
        (np.arange(before) * period_s, before * period_s + pause_s + np.arange(after) * period_s)
    )
    arrival = np.maximum.accumulate(true_s + jitter(3, len(true_s), 0.001))
    ends = FRAME * np.arange(1, len(counter) + 1)
    marks = np.column_stack((ends, np.rint(arrival * 1e9).astype(np.int64)))
    timer, unwrap = StreamTimer(65536, 1, 100.0), Unwrapper(65536)
    for at in range(0, len(counter), 1000):
        timer.feed(counter[at : at + 1000], ends[at : at + 1000], marks)
    timing = timer.fit()
    count = timing.corrected(unwrap.feed(counter)[0], 0)
    assert np.abs(timing.time_ns(count) * 1e-9 - true_s).max() < 0.012
    assert np.diff(count)[before - 1] == pytest.approx(pause_s / period_s + 1, abs=1.1)
    assert np.delete(np.diff(count), before - 1).tolist() == [1] * (len(count) - 2)
    assert timing.clock_error_ppm == pytest.approx(clock_ppm, abs=60)
    assert any("started anew 1 times" in text for text in timing.warnings)


@pytest.mark.parametrize("stall_s", [3.0, 40.0])
@pytest.mark.parametrize("clock_ppm", [-10_000, 10_000])
def test_a_stall_of_the_host_is_no_restart_of_a_device_with_a_long_wrap(stall_s, clock_ppm):
    count, period_s = 30_000, 0.01 / (1 + clock_ppm * 1e-6)
    sample_s = np.arange(count) * period_s
    held = (sample_s > 60.0) & (sample_s < 60.0 + stall_s)
    latency = np.where(held, 60.0 + stall_s - sample_s, 0.0) + jitter(2, count, 0.001)
    timing, time_s, counts = fit(np.arange(count), period_s, latency, modulo=65536)
    assert counts.tolist() == list(range(count))
    assert np.abs(time_s - 5.0 - sample_s).max() < 0.002
    assert len(timing.corrections) == 0


@pytest.mark.parametrize(
    ("on", "off_s", "block", "first"),
    [
        ([1371, 1442, 1537, 3895], [20.0, 1.0, 1.0], 3000, 501),
        ([3351, 1928, 3204, 4161], [20.0, 0.3, 0.3], 8192, 611),
        ([1133, 3290, 1929, 3438, 4854], [20.0, 5.0, 0.5, 3.0], 8192, 528),
    ],
)
def test_a_device_with_a_bad_contact_counts_anew_again_and_again_and_keeps_its_times(on, off_s, block, first):
    """A 10-bit counter at 100 Hz: what was early before the last restart says nothing of the next one.

    `on`: samples between the pauses; the first batch holds one restart at least, the next ones the others.
    """
    counter, true_s, at_s = [], [], 5.0
    for count, pause_s in zip(on, [*off_s, 0.0], strict=True):
        counter.append((np.arange(count) + (0 if counter else first)) % 1024)
        true_s.append(at_s + 0.01 * np.arange(count))
        at_s = true_s[-1][-1] + 0.01 + pause_s + 0.0037
    counter, true_s = np.concatenate(counter), np.concatenate(true_s)
    arrival = np.maximum.accumulate(true_s + jitter(3, len(true_s), 0.001))
    ends = FRAME * np.arange(1, len(counter) + 1)
    marks = np.column_stack((ends, np.rint(arrival * 1e9).astype(np.int64)))
    timer, unwrap = StreamTimer(1024, 1, 100.0), Unwrapper(1024)
    for at in range(0, len(counter), block):
        timer.feed(counter[at : at + block], ends[at : at + block], marks)
    timing = timer.fit()
    count = timing.corrected(unwrap.feed(counter)[0], 0)
    assert np.abs(timing.time_ns(count) * 1e-9 - true_s).max() < 0.012


@pytest.mark.parametrize("batch_s", [0.001, 0.016])
@pytest.mark.parametrize("rate_hz", [100.0, 250.0, 500.0, 1000.0, 2000.0])
def test_batches_of_an_adapter_leave_a_tenth_of_a_sample(rate_hz, batch_s):
    """A latency timer of 16 ms or 1 ms, a clock that is fast by 30 ppm, ten minutes; the host adds 0.5 ms."""
    rng = np.random.default_rng(int(rate_hz))
    number = np.arange(int(600 * rate_hz))
    truth_s = 0.137 + number / (rate_hz * (1.0 + 30e-6))
    released = np.ceil((truth_s + 0.4 / rate_hz) / batch_s)
    last = np.append(np.flatnonzero(np.diff(released) > 0), len(number) - 1)
    arrival_s = released[last] * batch_s + rng.uniform(0.0, 0.0005, len(last))
    timer = StreamTimer(65536, 1, rate_hz)
    ends = FRAME * (number + 1)
    marks = np.column_stack((ends[last], np.rint(1e9 * np.maximum.accumulate(arrival_s)).astype(np.int64)))
    timer.feed(number % 65536, ends, marks)
    timing = timer.fit(0.4 / rate_hz)
    assert rate_hz * np.sqrt(np.mean((1e-9 * timing.time_ns(number) - truth_s) ** 2)) < 0.1
    named = [text for text in timing.warnings if f"in batches of {1e3 * batch_s:.3g} ms" in text]
    assert len(named) == (batch_s == 0.016 and rate_hz >= 250.0)


def test_a_busy_reader_that_comes_at_odd_times_is_no_adapter():
    """Reads a tenth of a second apart on average: ten frames of 100 Hz at a time, or one, or thirty."""
    rng = np.random.default_rng(6)
    number = np.arange(30_000)
    reads = np.cumsum(rng.exponential(10.0, 3000)).astype(np.int64)
    last = np.unique(np.append(reads[reads < 29_999], 29_999))
    timer = StreamTimer(65536, 1, 100.0)
    marks = np.column_stack((FRAME * (last + 1), last * 10_000_000))
    timer.feed(number % 65536, FRAME * (number + 1), marks)
    assert not [text for text in timer.fit().warnings if "batches" in text]
