"""What is said to be lost while a stream runs: loss, restarts and data held up are told apart by arrivals."""

from types import SimpleNamespace

import numpy as np
import pytest

from bench.control.stream_stations import StreamLoss


def blocks(first_s: float, last_s: float, every_s: float = 0.5, hz: float = 100.0):
    """Yield (arrival, numbers of the samples since first_s) for a unit that is on from first_s to last_s."""
    for end in np.arange(first_s + every_s, last_s + 1e-9, every_s):
        stop = round((end - first_s) * hz)
        yield float(end), np.arange(stop - round(every_s * hz), stop)


def fed(pieces, modulo: int, hz: float = 100.0, step: float = 1.0):
    loss = StreamLoss(SimpleNamespace(counter_modulo=modulo, counter_step=step, nominal_rate_hz=hz))
    seen = []
    for arrival_s, numbers in pieces:
        loss.feed(np.asarray(numbers * step, np.int64) % modulo, arrival_s)
        seen.append(loss.lost)
    return seen


@pytest.mark.parametrize("modulo", [128, 65536, 1 << 32])
def test_after_a_power_on_only_what_the_silence_took_is_lost(modulo: int) -> None:
    on = [*blocks(0.0, 100.0), *blocks(160.0, 300.0), *blocks(300.5, 400.0)]
    seen = fed(on, modulo)
    assert seen[199] == 0 and max(seen[:204]) == 0  # not yet settled
    # 60 s of 100 Hz, and half a second
    assert max(seen) == seen[-1] == pytest.approx(6050, abs=3)
    assert sorted(seen) == seen


def test_a_quick_restart_loses_next_to_nothing() -> None:
    assert fed([*blocks(0.0, 654.0), *blocks(654.5, 700.0)], 65536)[-1] == pytest.approx(50, abs=3)


@pytest.mark.parametrize("step", [1.0, 10_000.0])
def test_gaps_by_the_counter_are_counted_at_once_and_exactly(step: float) -> None:
    pieces = [(t, n) for t, n in blocks(0.0, 60.0) if not 10.0 < t < 10.6]
    pieces[50] = (pieces[50][0], np.delete(pieces[50][1], [3, 4, 20]))
    seen = fed(pieces, int(65536 * step), step=step)
    assert seen[19] == 0 and seen[20] == 50 and seen[50] == 53 == seen[-1]


def test_whole_wraps_are_seen_by_the_time_they_took() -> None:
    pieces = [(t, n) for t, n in blocks(0.0, 60.0) if not 20.0 < t < 25.6]
    assert fed(pieces, 128)[-1] == pytest.approx(550, abs=3)


def test_data_held_up_are_not_lost() -> None:
    pieces = list(blocks(0.0, 60.0))
    late = [(max(t, 15.0) if t > 10.0 else t, n) for t, n in pieces]
    assert set(fed(late, 65536)) == {0}
    assert set(fed([(max(t, 5.0), n) for t, n in pieces], 128)) == {0}


def test_losses_go_on_being_counted_after_late_data_that_caught_up() -> None:
    pieces = [(max(t, 3.0), n) for t, n in blocks(0.0, 60.0)]
    pieces[40] = (pieces[40][0], pieces[40][1][5:])
    assert fed(pieces, 65536)[-1] == 5


def test_a_clock_that_is_two_percent_off_loses_nothing() -> None:
    assert set(fed([(1.02 * t, n) for t, n in blocks(0.0, 3000.0)], 65536)) == {0}
    assert set(fed([(0.98 * t, n) for t, n in blocks(0.0, 3000.0)], 128)) == {0}


@pytest.mark.parametrize("clock", [1.01, 0.99])
def test_a_clock_that_is_one_percent_off_and_looked_at_once_a_minute_loses_nothing(clock: float) -> None:
    """A unit without a counter: nothing but arrivals says what is missing."""
    pieces = [(clock * t, n) for t, n in blocks(0.0, 6000.0, every_s=60.0)]
    assert set(fed(pieces, 1 << 62)) == {0}
    gone = [(t, n) for t, n in pieces if not 3000.0 < t < 3070.0]
    assert fed([(t, n - 6000 * (t > 3000.0)) for t, n in gone], 1 << 62)[-1] == pytest.approx(6000, rel=0.15)


@pytest.mark.parametrize("modulo", [128, 65536])
def test_what_does_not_come_while_switched_off_is_not_lost(modulo: int) -> None:
    loss = StreamLoss(SimpleNamespace(counter_modulo=modulo, counter_step=1.0, nominal_rate_hz=100.0))
    before = [(t, n) for t, n in blocks(0.0, 100.0) if not 50.0 < t < 50.6]
    during = [*blocks(100.0, 103.0), *blocks(163.0, 165.0)]
    for arrival_s, numbers in before:
        loss.feed(numbers % modulo, arrival_s)
    loss.pause()
    for arrival_s, numbers in during:
        loss.feed(numbers % modulo, arrival_s)
    loss.resume()
    assert loss.lost == 50
    for arrival_s, numbers in [(t, n + 200) for t, n in blocks(165.0, 300.0) if not 200.0 < t < 200.6]:
        loss.feed(numbers % modulo, arrival_s)
    assert loss.lost == 100
