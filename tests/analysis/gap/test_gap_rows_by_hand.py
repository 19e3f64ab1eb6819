"""Rows, steps, stamps and logs by hand; and sensors, stamps and tables of a run as channels."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import norm

from bench.analysis.gap import Model, Noise, _channel_run
from bench.analysis.gap._channel_data import _case, _inside, _stamps
from bench.analysis.gap._channel_run import RunSource
from bench.analysis.gap._data import by_length, cut, good_length, group_runs, interpolated, stand_ins, unseen
from bench.analysis.gap._import import _phases, read_mapped_runs
from bench.analysis.gap._log_rows import _finest_step, _in_blocks, finest_angle_deg, held_rows
from bench.analysis.gap._rate import RateSignal
from bench.analysis.gap._rows import Steps, _digits, _evened, _odd, _rows_on, true_times
from bench.analysis.gap._run_folder import _between_polls, _profile
from bench.record.events.run import AirDemand, ConditioningDemand
from bench.record.recording import Arrivals
from bench.record.recording._events import Line
from drivers.base.errors import ConfigurationError, RecordError
from tests.analysis.gap.conftest import made_run, stimulus
from tests.analysis.gap.test_gap_folders_by_hand import polled


def all_of(time_s):
    return np.ones(len(time_s), dtype=bool)


def test_steps_hold_the_rows_whose_middles_lie_in_them():
    """Rows of 0.25 s from 100 s on; one is lost, one has no value."""
    time_s = 0.25 * np.delete(np.arange(42.0), 22)
    use = np.ones(41, dtype=bool)
    use[9] = False  # it ends at 2.25 s
    steps = Steps.of(time_s, use)
    assert (steps.count, steps.period_s, steps.usual_s) == (10, 1.0, 0.25)
    assert steps.edges_s.tolist() == list(range(11))
    assert steps.covers_s.tolist() == [0.0] + [0.25] * 40
    places = np.ceil(time_s - 1e-9).astype(int) - 1
    expected = np.where((places >= 10) | (time_s == 0.0), -1, places)
    assert steps.owner.tolist() == expected.tolist()
    # the row behind the lost one, which ends at 5.75 s, began nobody knows when
    lacking = {9, int(np.flatnonzero(time_s == 5.75)[0])}
    assert np.flatnonzero(~steps.use).tolist() == sorted({*lacking, *np.flatnonzero(expected < 0)})
    assert np.flatnonzero(~steps.whole).tolist() == [2, 5]
    assert steps.starts_s[[0, 1, 2, 5]].tolist() == [0.0, 1.0, 2.25, 5.0]
    assert steps.stops_s[[0, 1, 2, 5]].tolist() == [1.0, 2.0, 3.0, 6.0]
    values = time_s.copy()
    means = steps.means(values)
    assert means[[0, 1, 4]] == pytest.approx([0.625, 1.625, 4.625])
    assert steps.means(values, steps.use)[2] == pytest.approx((2.5 + 2.75 + 3.0) / 3.0)
    assert math.isnan(steps.means(np.where(places == 3, np.nan, values))[3])


@pytest.mark.parametrize(
    ("row_s", "period_s"), [(0.3, 1.2), (2.0, 2.0), (0.5, 1.0), (0.021, 1.008), (0.97, 0.97), (0.9, 1.8)]
)
def test_a_step_is_made_up_of_whole_rows_of_a_second_or_more(row_s, period_s):
    steps = Steps.of(row_s * np.arange(1000.0), np.ones(1000, dtype=bool))
    assert steps.period_s == pytest.approx(period_s, abs=1e-6)
    assert steps.count == int(row_s * 999 / period_s + 1e-6) and steps.whole.all()


def test_angles_are_known_where_rows_begin_and_end():
    """7 deg/s, 3 from 20 s on, of rows of 0.25 s; from 30 to 33.25 s no rows."""
    time_s = 0.25 * np.arange(200.0)
    turned = np.where(time_s < 20.0, 7.0 * time_s, 140.0 + 3.0 * (time_s - 20.0))
    kept = (time_s <= 30.0) | (time_s >= 33.25)
    steps = Steps.of(time_s[kept], all_of(time_s[kept]))
    angle, rate = steps.angles(turned[kept])
    edges = np.arange(50.0)
    assert angle == pytest.approx(np.where(edges < 20.0, 7.0 * edges, 140.0 + 3.0 * (edges - 20.0)))
    expected = np.where(edges < 20.0, 7.0, 3.0)
    expected[20] = 5.0  # the mean of both sides
    assert rate == pytest.approx(expected)
    assert np.flatnonzero(~steps.whole).tolist() == [30, 31, 32, 33]
    slow = Steps.of(np.arange(20.0), np.ones(20, dtype=bool))
    assert slow.angles(7.0 * np.arange(20.0))[1] is None
    half = Steps.of(0.5 * np.arange(40.0), np.ones(40, dtype=bool))
    assert half.angles(3.5 * np.arange(40.0))[1] == pytest.approx(np.full(20, 7.0))


def test_beside_a_hole_the_rate_at_a_border_is_that_of_the_side_that_is_there():
    """7 deg/s until 30 s and 3 from 34 s on; how it turned in between nobody knows."""
    time_s = 0.25 * np.arange(200.0)
    turned = np.where(time_s <= 30.0, 7.0 * time_s, 500.0 + 3.0 * (time_s - 34.0))
    kept = (time_s <= 30.0) | (time_s >= 34.0)
    steps = Steps.of(time_s[kept], all_of(time_s[kept]))
    _, rate = steps.angles(turned[kept])
    first, last = np.flatnonzero(~steps.whole)[[0, -1]]
    assert rate[first - 1 : first + 1] == pytest.approx([7.0, 7.0])
    assert rate[last + 1 : last + 3] == pytest.approx([3.0, 3.0])


def test_a_rate_at_a_border_is_that_of_the_table_also_while_it_changes():
    """A rate of t^3/100: two rows of 0.5 s beside a border have a mean that is off by t/400, four have none."""
    time_s = 0.5 * np.arange(41.0)
    _, rate = Steps.of(time_s, all_of(time_s)).angles(time_s**4 / 400.0)
    edges = np.arange(21.0)
    assert rate[1:-1] == pytest.approx(edges[1:-1] ** 3 / 100.0, abs=1e-6)


def test_times_between_rows_are_odd_where_the_clock_was_set():
    """Lost rows make whole multiples; a clock that is set by 0.3 s makes none. Many odd ones are jitter."""
    number = np.delete(np.arange(400.0), [50, 51, 170])
    time_s = 0.8 * number
    assert not _odd(time_s).any()
    later = np.where(number >= 200, time_s + 0.3, time_s)
    assert np.flatnonzero(_odd(later)).tolist() == [int(np.flatnonzero(number == 200)[0]) - 1]
    back = np.where(number >= 200, time_s - 0.3, time_s)
    assert np.flatnonzero(_odd(back)).tolist() == [int(np.flatnonzero(number == 200)[0]) - 1]
    jitter = time_s + np.random.default_rng(1).uniform(0.0, 0.3, len(time_s))
    assert _odd(jitter).sum() == 0
    assert (
        not _odd(-time_s).any() and _odd(time_s[:2]).tolist() == [False] and _odd(time_s[:1]).tolist() == []
    )
    # stamps of a hundredth of a second are off by one and a half of it, between two of them
    rounded = np.round(time_s + 0.001, 2)
    off = rounded.copy()
    off[300:] += 0.01
    assert not _odd(off).any()
    off[300:] += 0.02
    assert np.flatnonzero(_odd(off)).tolist() == [299]


def test_stamps_are_rounded_to_so_many_digits():
    time_s = np.cumsum(np.random.default_rng(1).uniform(0.3, 0.9, 50))
    for digits in range(6):
        assert _digits(np.round(time_s, digits)) == digits
    assert _digits(time_s) == 6 and _digits(np.arange(9.0)) == 0


def test_rounded_stamps_of_even_rows_lie_on_their_grid():
    grid = 0.7352941 * np.delete(np.arange(300.0), [7, 8, 100])
    even, found = _evened(np.round(grid, 3), np.zeros(296, dtype=bool))
    assert found and even == pytest.approx(grid, abs=2e-4) and even[0] == 0.0
    assert np.diff(even)[[6, 50]] == pytest.approx([3 * 0.7352941, 0.7352941], abs=1e-5)
    off = np.round(grid, 3)
    off[150] += 0.01
    same, found = _evened(off, np.zeros(296, dtype=bool))
    assert not found and same is off
    stretched = np.round(np.where(grid > 80.0, grid + 0.2, grid), 3)
    odd = np.zeros(296, dtype=bool)
    odd[np.flatnonzero(np.diff(grid > 80.0))] = True
    assert _evened(stretched, odd)[1] and not _evened(stretched, np.zeros(296, dtype=bool))[1]
    assert not _evened(np.array([0.0, 1.0]), np.zeros(1, dtype=bool))[1]
    three, found = _evened(np.array([4.0, 5.0, 6.0]), np.zeros(2, dtype=bool))
    assert found and three == pytest.approx([0.0, 1.0, 2.0])
    assert not _evened(np.array([0.0, 1.0, 1.0, 2.0]), np.zeros(3, dtype=bool))[1]


@pytest.mark.parametrize("true", ["grid", "stamps"])
def test_stamps_are_true_unless_an_even_grid_fits_what_the_gyro_saw_far_better(true):
    """The table swings by 10 deg/s; the gyro is read evenly, or at the stamps."""
    n = 400
    rng = np.random.default_rng(1)
    grid = 0.1 * np.arange(n)
    stamps = grid + rng.uniform(-0.02, 0.02, n)

    def angle(time_s):
        return 10.0 * time_s + 20.0 * np.sin(0.5 * time_s)

    own = grid if true == "grid" else stamps
    # the table's angle is that at the reading, whatever the stamp says
    rate = np.concatenate(([0.0], np.diff(angle(own)) / np.diff(own))) + rng.normal(0.0, 0.003, n)
    rate[50] = np.nan
    found, known = true_times(stamps, rate, angle(own))
    assert known is (true == "stamps")
    if true == "stamps":
        assert found is stamps
    else:
        assert np.diff(found) == pytest.approx(np.full(n - 1, 0.1), abs=2e-4)
        few, known = true_times(stamps[:16], rate[:16], angle(own)[:16])
        assert few.tolist() == stamps[:16].tolist() and not known
        far = np.sort(grid + rng.uniform(-0.2, 0.2, n))
        assert true_times(far, rate, angle(own)) == (far, False)
        assert true_times(grid, rate, angle(own)) == (grid, False)


@pytest.mark.parametrize("ticks", ["true", "rounded", "standing"])
def test_stamps_on_ticks_are_true_where_the_table_turned_as_far_as_they_say(ticks):
    """Rows of 100.0266 ms on ticks of 1 ms at 40 deg/s: a tick is 0.04 deg, and 144 deg/h in ten rows."""
    n = 3000
    even = 0.1000266 * np.arange(1.0, n + 1.0)
    stamps = np.round(even, 3)
    own = stamps if ticks == "true" else even
    angle = 0.0 * own if ticks == "standing" else 40.0 * own
    rate = angle[-1] / own[-1] + np.random.default_rng(2).normal(0.0, 47.0 / 3600.0, n)
    times, known = true_times(stamps, rate, angle)
    assert known is (ticks == "true") and (times is stamps) is (ticks != "rounded")
    steps = Steps.of(times - times[0], np.ones(n, dtype=bool), stamped=known)
    assert steps.period_s == pytest.approx(1.000266, abs=2e-6)
    turned, _ = steps.angles(angle)
    speeds = np.diff(turned)[1:-1] / steps.period_s
    assert speeds == pytest.approx(np.full(len(speeds), 0.0 if ticks == "standing" else 40.0), abs=1e-4)


def _ticked(ppm, seconds=60.0, dps=40.0):
    """Stamps of rows of 200 ms and some ppm on ticks of 1 ms, what is even, and the gyro's noise, deg/s."""
    even = 0.2 * (1.0 + 1e-6 * ppm) * np.arange(1.0, 5.0 * seconds + 1.0)
    noise = np.random.default_rng(3).normal(0.0, 33.0 / 3600.0, len(even))
    return np.round(even, 3), even, dps + noise


def test_a_few_ticks_tell_where_the_table_turns_fast_and_one_does_not():
    stamps, even, rate = _ticked(31.0, seconds=200.0)
    assert (np.diff(stamps) > 0.2005).sum() == 6
    assert true_times(stamps, rate, 40.0 * stamps) == (stamps, True)
    found, known = true_times(stamps, rate, 40.0 * even)
    assert not known and found is not stamps
    once, even, rate = _ticked(31.0, seconds=40.0)
    assert (np.diff(once) > 0.2005).sum() == 1
    assert true_times(once, rate, 40.0 * once) == (once, False)


def test_ticks_that_are_three_times_the_noise_are_enough_if_there_are_a_few():
    stamps, _, rate = _ticked(31.0, seconds=300.0, dps=5.0)
    assert (np.diff(stamps) > 0.2005).sum() == 9
    assert true_times(stamps, rate, 5.0 * stamps) == (stamps, True)


def _moved_late(stamps, rate):
    """A table's angle that moves 5 deg at every tick, and a gyro's output that has each move a row later."""
    ticks = np.flatnonzero(np.diff(stamps) > 0.2005)
    moved = np.zeros(len(stamps))
    moved[ticks + 1] = 5.0
    late = rate.copy()
    late[np.minimum(ticks + 2, len(rate) - 1)] += 5.0 / 0.2
    return np.cumsum(moved), late


def test_moves_that_come_late_are_no_evidence_beside_a_slow_turn():
    """At every tick a move of 5 deg that the gyro sees a row later: both readings are off by 25 deg/s there."""
    stamps, even, rate = _ticked(150.0, seconds=300.0, dps=0.5)
    moved, late = _moved_late(stamps, rate)
    _, known = true_times(stamps, late, 0.5 * even + moved)
    assert not known


def test_an_output_of_one_word_at_rest_does_not_hide_what_ticks_do_where_it_turns():
    """Four fifths of the run stand, and the output's word is larger than its noise: most rows repeat."""
    stamps, _, noisy = _ticked(150.0, seconds=500.0, dps=0.0)
    dps = np.where(np.arange(len(stamps)) < 500, 40.0, 0.0)
    angle = np.cumsum(dps * np.diff(stamps, prepend=0.0))
    word_dps = 100.0 / 3600.0
    rate = word_dps * np.round((dps + noisy) / word_dps)
    assert np.median(np.abs(np.diff(rate))) == 0.0
    assert true_times(stamps, rate, angle) == (stamps, True)


def test_runs_of_true_stamps_have_one_period_however_they_begin():
    periods = set()
    for begin in (0.0, 0.00031, 0.00049, 0.00083):
        for n in (2000, 2777):
            stamps = np.round(begin + 0.1000266 * np.arange(n), 3)
            periods.add(Steps.of(stamps - stamps[0], np.ones(n, dtype=bool), stamped=True).period_s)
    assert periods == {1.000266}


def test_what_neither_reading_of_the_stamps_explains_decides_nothing():
    """Moves that the gyro sees a row late, at every tick: each alone would be far more than the noise."""
    stamps, _, rate = _ticked(150.0, seconds=300.0, dps=0.0)
    turned, late = _moved_late(stamps, rate)
    assert true_times(stamps, late, turned) == (stamps, False)
    assert true_times(stamps, np.full(len(rate), np.nan), turned) == (stamps, False)
    assert true_times(stamps, rate, np.zeros(len(rate))) == (stamps, False)


def test_rows_of_a_logger_that_holds_are_told_from_those_that_are_equal_by_chance():
    rng = np.random.default_rng(2)
    values = rng.normal(size=500)
    held = values.copy()
    held[100:104], held[300] = held[99], held[299]
    assert np.flatnonzero(held_rows(held)).tolist() == [100, 101, 102, 103, 300]
    lost = held.copy()
    lost[[20, 21, 400]] = np.nan
    assert np.flatnonzero(held_rows(lost)).tolist() == [100, 101, 102, 103, 300]
    often = np.repeat(values[:250], 2)
    assert not held_rows(often).any()  # half of the rows: that is no logger that holds now and then
    assert held_rows(np.repeat(values, np.where(np.arange(500) % 10, 1, 2))).sum() == 50
    assert not held_rows(np.ones(500)).any() and held_rows(values).tolist() == [False] * 500
    assert not held_rows(np.array([1.0, 1.0, *np.arange(19.0)])).any()  # too few steps to say


def test_equal_neighbours_are_expected_from_how_often_a_value_stands_in_a_block():
    """Of 64 rows in any order two of k equal ones are neighbours k (k - 1) / 64 times; one place says nothing."""
    block = np.arange(64.0)
    assert _in_blocks(block) == 0.0
    block[[3, 10, 30]] = 99.0
    assert _in_blocks(block) == pytest.approx(3 * 2 / 64)
    block[[50, 51]] = 77.0
    assert _in_blocks(block) == pytest.approx(3 * 2 / 64)
    block[[53, 5]] = 77.0
    assert _in_blocks(block) == pytest.approx((3 * 2 + 4 * 3) / 64)
    block[0] = np.nan
    assert _in_blocks(block) == pytest.approx((3 * 2 + 4 * 3) / 63)
    assert _in_blocks(np.concatenate((block, [1.0, 2.0, 1.0, 2.0]))) == pytest.approx(18 / 63 + (2 + 2) / 4)
    assert _in_blocks(np.full(5, np.nan)) == 0.0


def test_a_counters_step_is_seen_in_rows_of_uneven_length():
    """Whole pulses of 0.5 arcsec over rows of 0.5, 0.6 or 0.7 s: no two rows need have one step of rate."""
    rng = np.random.default_rng(4)
    lengths_s = rng.choice([0.5, 0.6, 0.7], 4000)
    pulses = rng.integers(-9, 10, 4000)
    rates = 0.5 / 3600.0 * pulses / lengths_s
    time_s = np.cumsum(lengths_s)
    time_s[2000:] += 1.3  # two rows are missing: the row after them is not so long
    assert 3600.0 * finest_angle_deg(rates, time_s, 0.6) == pytest.approx(0.5, rel=1e-6)
    assert 3600.0 * finest_angle_deg(np.round(rates, 4), np.arange(4000.0), 1.0) == pytest.approx(0.36)
    assert math.isnan(finest_angle_deg(np.ones(9), np.arange(9.0), 1.0))


def test_the_finest_step_is_one_that_a_tenth_of_all_steps_are_finer_than():
    steps = np.concatenate((np.full(5, 1e-9), np.full(95, 0.25)))
    assert _finest_step(np.cumsum(steps)) == pytest.approx(0.25)
    assert _finest_step(np.cumsum(np.arange(1.0, 101.0))) == pytest.approx(
        np.quantile(np.arange(2.0, 101.0), 0.1)
    )
    assert _finest_step(np.array([3.0, np.nan, 1.0, np.inf])) == 2.0
    assert math.isnan(_finest_step(np.ones(5))) and math.isnan(_finest_step(np.full(5, np.nan)))


def test_phases_of_a_log_begin_when_they_say():
    entry = SimpleNamespace(
        phases=[SimpleNamespace(name=name, start_s=start) for name, start in (("room", 0.0), ("ramp", 30.0))]
    )
    assert _phases(entry, np.array([1.0, 30.0, 30.5, 31.0])).tolist() == ["room", "room", "ramp", "ramp"]
    assert _phases(SimpleNamespace(phases=[]), np.array([1.0, 9.0])).tolist() == ["run", "run"]


def test_logs_of_one_name_are_called_after_their_files(tmp_path):
    for name in ("a", "b", "c"):
        rows = [f"{0.5 * k:.1f},{np.sin(k):.6f},{25 + 0.01 * k:.4f}" for k in range(600)]
        (tmp_path / f"{name}.csv").write_text("\n".join(["t,rate,temp", *rows]), encoding="utf-8")
    entries = "".join(
        f'[[run]]\nfile = "{file}.csv"\nrun_id = "{run}"\nelevation_deg = 30.0\npower_on_s = 100.0\n'
        for file, run in (("a", "one"), ("b", "two"), ("c", "one"))
    )
    (tmp_path / "map.toml").write_text(
        'format = 1\nunit_id = "G7"\nlatitude_deg = 39.1\n[columns]\ntime = { name = "t", unit = "s" }\n'
        'output = { name = "rate", unit = "deg/s" }\nt_out = { name = "temp", unit = "degC" }\n' + entries,
        encoding="utf-8",
    )
    one, two, three = read_mapped_runs(tmp_path / "map.toml")
    assert [run.run_id for run in (one, two, three)] == ["a", "two", "c"]
    s = one.stimulus
    assert len(s) == 299 and s.time_s[[0, -1]].tolist() == [101.0, 399.0]
    assert s.t_in_c.tolist() == s.t_out_c.tolist() and s.t_in_c == pytest.approx(
        25.015 + 0.02 * np.arange(299)
    )
    assert s.elevation_deg.tolist() == [30.0] * 299 and s.angle_deg.tolist() == [0.0] * 300
    assert one.output_dph == pytest.approx(
        [1800.0 * (math.sin(k) + math.sin(k + 1)) for k in range(1, 599, 2)], abs=0.01
    )
    assert one.row_s == 0.5 and len(one.rows_dps) == 600 and one.lost_fraction == 0.0
    assert one.finest_arcsec > 0.0 and not one.simulated and one.phase.tolist() == ["run"] * 299


def test_temperatures_that_were_not_measured_stand_in_for_each_other():
    one, other = np.array([1.0, 2.0]), np.array([3.0, 4.0])
    assert stand_ins(one, other, 2) == (pytest.approx(one), pytest.approx(other))
    assert [each.tolist() for each in stand_ins(None, other, 2)] == [[3.0, 4.0]] * 2
    assert [each.tolist() for each in stand_ins(one, None, 2)] == [[1.0, 2.0]] * 2
    assert [each.tolist() for each in stand_ins(None, None, 2)] == [[25.0] * 2] * 2
    assert interpolated(np.array([np.nan, 1.0, np.nan, np.nan, 4.0])).tolist() == [1.0, 1.0, 2.0, 3.0, 4.0]
    assert np.isnan(interpolated(np.full(3, np.nan))).all()
    s = stimulus(300)
    assert unseen(s) == "" and unseen(replace(s, t_in_c=s.t_out_c)).startswith("one temperature only")
    flat = np.full(300, 7.0)
    assert unseen(replace(s, t_in_c=flat, t_out_c=flat)).startswith("no temperature was recorded")


def test_lengths_have_no_prime_factor_above_seven():
    expected = [n for n in range(1, 1500) if n == 1 or max(p for p in range(2, n + 1) if n % p == 0 and all(
        p % q for q in range(2, math.isqrt(p) + 1))) <= 7]  # fmt: skip
    for n in (1, 2, 11, 13, 97, 251, 343, 625, 1001, 1499):
        assert good_length(n) == max(each for each in expected if each <= n)


def test_runs_of_a_profile_and_a_period_are_cut_to_one_length():
    rng = np.random.default_rng(1)
    rows = [("a 1", 700, "a", "+1", 1.0), ("b", 500, "b", "+1", 1.0), ("a 2", 691, "a", "-1", 1.0),
            ("a 3", 900, "a", "+1", 1.0), ("a 4", 600, "a", "+1", 2.0)]  # fmt: skip
    runs = []
    for name, n, profile, condition, period_s in rows:
        s = replace(stimulus(n), period_s=period_s, edge_rate_dps=np.arange(n + 1.0))
        runs.append(made_run(name, s, rng, profile=profile, condition=condition))
    groups = group_runs(runs)
    found = [[[run.run_id for run in own] for own in group.runs] for group in groups]
    assert found == [[["a 1", "a 3"], ["a 2"]], [["b"]], [["a 4"]]]
    assert [group.conditions for group in groups] == [("+1", "-1"), ("+1",), ("+1",)]
    assert [len(run.stimulus) for group in groups for run in group.flat] == [686] * 3 + [500, 600]
    assert [group.balanced for group in groups] == [False, True, True]
    short, s = groups[0].flat[1], runs[3].stimulus
    assert short.output_dph.tolist() == runs[3].output_dph[:686].tolist() and len(short.phase) == 686
    for name in ("time_s", "t_in_c", "t_out_c", "elevation_deg"):
        assert getattr(short.stimulus, name).tolist() == getattr(s, name)[:686].tolist()
    assert short.stimulus.angle_deg.tolist() == s.angle_deg[:687].tolist()
    assert short.stimulus.edge_rate_dps.tolist() == list(range(687))
    assert cut(runs[0], 700) is runs[0] and (short.stimulus.latitude_deg, short.stimulus.period_s) == (
        39.1,
        1.0,
    )


def test_programmes_of_other_lengths_are_groups_of_their_own():
    """A short one takes nothing from a long one."""
    rng = np.random.default_rng(1)
    rows = [("25 C 1", 840, "25 C"), ("all 1", 6660, "all"), ("25 C 2", 842, "25 C"), ("all 2", 6600, "all"),
            ("all 3", 3400, "all"), ("all 4", 2700, "all"), ("cold 1", 6050, "cold")]  # fmt: skip
    runs = [
        made_run(name, stimulus(n), rng, profile="rates", condition=condition) for name, n, condition in rows
    ]
    groups = group_runs(runs)
    found = {group.profile: [[run.run_id for run in own] for own in group.runs] for group in groups}
    assert found == {
        "rates, 14 min": [["25 C 1", "25 C 2"]],
        # repeats of a programme down to half of it are compared, another programme is cut by a tenth at most
        "rates, 56.7 min": [["all 1", "all 2", "all 3"]],
        "rates, 45 min": [["all 4"]],
        "rates, 101 min": [["cold 1"]],
    }
    assert [len(group.flat[0].stimulus) for group in groups] == [840, 3375, 2700, 6048]
    named = by_length(runs)
    assert [run.profile for run in named] == [run.profile for run in by_length(named)]
    assert [run.run_id for run in named] == [run.run_id for run in runs]
    # lines are looked for in runs by the profile that their cells have
    ready = RateSignal().prepare(runs, Model("m", (), Noise(0.004)))
    assert {run.profile for run in ready.disturbed.runs} == {group.profile for group in ready.data.groups}


class Warmed:
    """A run with a chamber at 20 degC that cools by 0.01 K/s from 1000 s on, and sensors read every 2 s."""

    tables, checksum = ("chamber", "gyro_g"), "sum"

    def __init__(self, case_sensor="probe", *, inside=True, end_s=3000.0):
        device = SimpleNamespace(case_sensor=case_sensor)
        self.manifest = SimpleNamespace(run_id="run", device=lambda name: device, stream={"g": "s"}, units={})
        self.inside, self.end_s = inside, end_s
        told = [
            (0.0, AirDemand("chamber", 20.0, 2.0)),
            (10.0, ConditioningDemand("chamber", True)),
            (end_s, None),
        ]
        self.lines = [Line(time_s, event) for time_s, event in told]

    def chamber(self):
        time_s = np.arange(0.0, self.end_s, 1.0)
        air = 20.0 - 0.01 * np.maximum(time_s - 1000.0, 0.0)
        return {"time_ns": (1e9 * time_s).astype(np.int64), "air_temp_c": air}

    def sensor(self, name):
        if name != "probe":
            raise RecordError("no such sensor")
        time_s = np.arange(5.0, self.end_s, 2.0)
        return time_s, 21.0 + np.zeros(len(time_s))

    def gyro(self, name, columns):
        time_s = np.arange(0.0, self.end_s, 0.5)
        temp = np.where(
            (np.arange(len(time_s)) % 2 == 0) & self.inside, 30.0 + 0.25 * (time_s > 2000.0), np.nan
        )
        return {"time_ns": (1e9 * time_s).astype(np.int64), "temp_c": temp}

    def phase_at(self, times_s):
        return np.where(times_s < 1000.0, "soak", "shock")


def test_a_case_is_compared_with_what_follows_from_the_air_and_the_inside_with_the_case():
    run = Warmed()
    case, inside = _case(RunSource(run, "g")), _inside(RunSource(run, "g"))
    assert (case.channel, inside.channel) == ("case_temperature", "gyro_temperature")
    time_s = case.inputs.time_s
    assert time_s[[0, 1, -1]].tolist() == [10.0, 20.0, 2990.0] and set(case.values.tolist()) == {21.0}
    air = 20.0 - 0.01 * np.maximum(time_s - 1000.0, 0.0)
    assert case.inputs.drive == pytest.approx(air, abs=0.03)
    assert (case.inputs.start, inside.inputs.start) == (21.0, 30.0)
    assert case.quiet.tolist() == (time_s > 10.0 + 1800.0).tolist()
    assert inside.inputs.time_s[0] == 5.0 and set(inside.inputs.drive.tolist()) == {21.0}
    assert inside.values[[0, -1]].tolist() == [30.0, 30.25] and inside.resolution == 0.25
    assert "no sensor" in _case(RunSource(Warmed(None), "g")) and "no sensor" in _inside(
        RunSource(Warmed(None), "g")
    )
    assert "no sensor" in _case(RunSource(run, "")) and "no sensor" in _inside(RunSource(run, ""))
    assert "case_sensor other" in _case(RunSource(Warmed("other"), "g"))
    assert _inside(RunSource(Warmed(inside=False), "g")) == "the gyro says no temperature"
    assert _inside(RunSource(Warmed(end_s=15.0), "g")) == "the gyro says no temperature"
    bare = Warmed()
    bare.tables = ("gyro_g",)
    assert "no sensor" in _case(RunSource(bare, "g")) and "no sensor" in _inside(RunSource(bare, "g"))
    bare = Warmed()
    bare.chamber = lambda: {"time_ns": np.zeros(1, np.int64)}
    assert "no record of the air" in _case(RunSource(bare, "g"))


def test_stamps_are_the_earliest_of_every_second_and_what_comes_later_is_scatter(monkeypatch):
    """100 frames a second; the clock is 20 ppm slow; arrivals late by an exponential of 0.4 ms, one by 80 ms."""
    n = 60_000
    rng = np.random.default_rng(1)
    late = rng.exponential(4e-4, n)
    late[30_000] = 0.080
    arrival_s = np.maximum.accumulate(0.01 * (1.0 + 20e-6) * np.arange(n) + late + 7.0)
    seen = Arrivals(np.arange(n), arrival_s, 0.01)
    run = SimpleNamespace(
        manifest=SimpleNamespace(stream={"g": 1}, run_id="run", units={}), checksum="",
        has_arrivals=lambda g: True, arrivals=lambda source: seen, phase_at=lambda t: np.full(len(t), "run"),
    )  # fmt: skip
    monkeypatch.setattr(_channel_run, "gyro_source", lambda *_: "source")
    found = _stamps(RunSource(run, "g"))
    assert found.inputs.time_s == pytest.approx(7.0 + np.arange(len(found.values)), abs=0.1)
    slope = np.polyfit(found.inputs.time_s, found.values, 1)[0]
    assert slope == pytest.approx(20e-3, rel=0.02) and abs(found.values.mean()) < 1e-9
    # of an exponential the median distance from the median is 0.4812 times its mean
    assert found.scatter["arrival_jitter"] == pytest.approx(1.4826 * 0.4812 * 0.4, rel=0.03)
    assert pytest.approx(1.0 / norm.ppf(0.75), abs=1e-4) == 1.4826
    assert (
        found.scatter["late_frames"] == pytest.approx(4 / 60_000, rel=0.3) and 1e-3 <= found.resolution < 0.1
    )
    assert _stamps(RunSource(run, "h")) == "no arrival times of the gyro's stream"
    few = replace(seen, count=seen.count[:31], arrival_s=seen.arrival_s[:31])
    run.arrivals = lambda source: few
    assert _stamps(RunSource(run, "g")) == "no arrival times of the gyro's stream"

    def refuse(*_):
        raise ConfigurationError("no kind")

    monkeypatch.setattr(_channel_run, "gyro_source", refuse)
    assert _stamps(RunSource(run, "g")).startswith("the stream cannot be decoded again: no kind")
    run.has_arrivals = lambda g: False
    assert _stamps(RunSource(run, "g")) == "no arrival times of the gyro's stream"


def test_a_drift_of_the_output_is_no_noise_that_hides_what_lies_between_polls():
    """The rate changes by 10 deg/s between polls, under noise of 100 deg/h and a drift of 1e6 deg/h a second."""
    changed = polled(lambda t: np.where(t < 20.0, 0.0, 10.0 * (t - 20.0)))
    error = np.random.default_rng(1).normal(0.0, 100.0, 39) + 1e6 * np.arange(39.0)
    edges = np.arange(0.5, 40.0)
    assert edges[:-1][_between_polls(changed, edges, error, True)].tolist() == [18.5, 19.5, 20.5]


def test_a_profile_is_the_procedure_with_what_is_not_usual():
    def run(procedure, **parameters):
        return SimpleNamespace(manifest=SimpleNamespace(procedure=procedure, parameters=parameters))

    assert _profile(run("somebody's own", a=1)) == "somebody's own"
    assert (
        _profile(run("zero-bias-cold-shock", soak_min=12.5, repeats=7))
        == "zero-bias-cold-shock, soak_min 12.5"
    )
    assert _profile(run("zero-bias-cold-shock")) == "zero-bias-cold-shock"


@pytest.mark.parametrize(("row_s", "lost"), [(0.02, 0.0), (0.02, 0.002), (0.05, 0.0), (1.0 / 60.0, 0.0)])
def test_rows_on_a_slowly_ticking_clock_are_counted_one_by_one(row_s: float, lost: float) -> None:
    """Ticks of 64 Hz: at 50 Hz most rows are one tick apart and some two, and hardly any is missing."""
    rng = np.random.default_rng(6)
    kept = np.flatnonzero(rng.random(20_000) >= lost)
    stamps_s = np.floor((kept * row_s + 0.003) * 64.0) / 64.0
    kept = kept[np.append(True, np.diff(stamps_s) > 0.0)]
    stamps_s = np.floor((kept * row_s + 0.003) * 64.0) / 64.0
    assert np.array_equal(_rows_on(stamps_s), np.diff(kept))


def test_rows_that_are_often_missing_are_no_ticks() -> None:
    """Two of five rows of an even clock lost: no line through all places them, and none is needed."""
    kept = np.flatnonzero(np.random.default_rng(7).random(5_000) >= 0.4)
    assert np.array_equal(_rows_on(0.1 * kept), np.diff(kept))
