"""A table that is read with noise, against a gyro that follows the reading and one that does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.gap import Model, diagnose
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._rate import RateSignal
from bench.analysis.gap._reading import _dwells, _step_deg, _within, without_reading_noise
from simulators.effects import Stimulus
from tests.analysis.gap.conftest import made_run, stimulus

NOISE_DEG = 3e-5
"""Of a reading: 0.15 deg/h in the rate of a sample of 1 s, beside 0.24 deg/h of the gyro."""


def _read(s: Stimulus, seed: int) -> Stimulus:
    """What is logged of a table: its angle with the noise of the reading."""
    noise = np.random.default_rng(seed).normal(0.0, NOISE_DEG, len(s) + 1)
    return replace(s, angle_deg=s.angle_deg + noise)


def _standing(number: int, n: int = 5000) -> GapRun:
    """A table that stands and is read with noise; the gyro sees the Earth's rate alone."""
    made = made_run(f"run {number}", stimulus(n), np.random.default_rng(number))
    return replace(made, stimulus=_read(made.stimulus, 50 + number))


def test_a_reading_that_the_gyro_does_not_follow_is_no_rate() -> None:
    still, notes = without_reading_noise([_standing(1), _standing(2)])
    for run in still:
        assert np.ptp(run.stimulus.input_rate_dph) < 0.02  # of 1 deg/h as read
    assert len(notes) == 1 and "0.15 deg/h a sample" in notes[0] and "evenly" in notes[0]


def test_a_scatter_that_the_gyro_follows_is_the_tables() -> None:
    runs = []
    for number in range(2):
        moved = _read(stimulus(5000), 70 + number)  # now the noise is the table's own motion
        run = made_run(f"run {number}", moved, np.random.default_rng(number))
        run.output_dph[1000:] = np.nan  # what is lost says nothing against it
        runs.append(run)
    kept, notes = without_reading_noise(runs)
    assert all(one is run for one, run in zip(kept, runs, strict=True)) and notes == []


def test_a_gyro_that_is_two_samples_late_follows_all_the_same(nominal: Model) -> None:
    rate_dps = np.repeat([0.0, 2.0, 0.0], 2000)
    s = replace(stimulus(6000, cold=False), angle_deg=np.concatenate(([10.0], 10.0 + np.cumsum(rate_dps))))
    moved = _read(s, 21)
    made = made_run("late", moved, np.random.default_rng(22))
    early = np.clip(np.arange(6001) + 2, 0, 6000)
    late = replace(made, stimulus=replace(moved, angle_deg=moved.angle_deg[early]))
    ready = RateSignal().prepare([late], nominal)
    assert "2 s late" in ready.notes[0] and not any("read with a noise" in note for note in ready.notes)


def test_a_move_that_comes_half_a_sample_late_decides_nothing() -> None:
    rate_dps = np.repeat([0.0, 2.0, 0.0], 2000)
    s = replace(stimulus(6000, cold=False), angle_deg=np.concatenate(([10.0], 10.0 + np.cumsum(rate_dps))))
    made = made_run("late", s, np.random.default_rng(23))
    made.output_dph[[2000, 4000]] -= 3600.0 * np.array([1.0, -1.0])
    (even,), notes = without_reading_noise([replace(made, stimulus=_read(s, 24))])
    np.testing.assert_allclose(even.stimulus.table_rate_dps, rate_dps, atol=1e-4)
    assert "read with a noise" in notes[0]


def test_each_rate_has_a_scatter_of_its_own_and_tails_of_moves_are_cut_off() -> None:
    """Rounded stamps make a noise in proportion to the rate; what settles after a move is no scatter."""
    rates_dps = np.array([0.0, 2.0, -5.0, 50.0, -100.0, 100.0])
    rate_dps = np.repeat(rates_dps, 100)
    tail = np.where(np.arange(100) < 8, 0.02 * np.exp(-np.arange(100) / 2.0), 0.0)
    rate_dps += np.sign(rate_dps) * np.tile(tail, 6)
    true = np.concatenate(([10.0], 10.0 + np.cumsum(rate_dps)))
    late_s = np.random.default_rng(4).uniform(-5e-5, 5e-5, len(true))
    s = replace(stimulus(600, cold=False), angle_deg=true + late_s * np.append(rate_dps, rate_dps[-1]))
    dwells = list(_dwells(0, made_run("steps", s, np.random.default_rng(5))))
    middles = [rate_dps[(each.edges.start + each.edges.stop) // 2] for each in dwells]
    assert middles == rates_dps[1:].tolist()
    for dwell, rate in zip(dwells[2:], rates_dps[3:], strict=True):
        assert 85 <= dwell.edges.stop - dwell.edges.start <= 101
        slope = (dwell.line_deg[-1] - dwell.line_deg[0]) / (len(dwell.line_deg) - 1)
        # 60 samples of 5e-5 s / sqrt(3) at that rate, and the tail's 0.02 deg that the ends may keep
        assert abs(slope - rate) < 5e-6 * abs(rate) + 2e-4
        assert np.std(dwell.beside_deg) == pytest.approx(abs(rate) * 5e-5 / 3.0**0.5, rel=0.4)


def test_a_stretch_whose_angle_walks_keeps_its_ends() -> None:
    rate = np.random.default_rng(6).normal(1.0, 1e-4, 300)
    s = replace(stimulus(300, cold=False), angle_deg=np.concatenate(([0.0], np.cumsum(rate))))
    (dwell,) = _dwells(0, made_run("tachometer", s, np.random.default_rng(7)))
    assert dwell.edges == slice(0, 301) and dwell.line_deg[-1] == pytest.approx(float(rate.sum()))


def test_what_the_gyro_is_too_noisy_to_decide_stays() -> None:
    for seed in range(20):
        output = np.random.default_rng(seed).normal(0.0, 30.0, 5000)
        (kept,), notes = without_reading_noise([run := replace(_standing(1), output_dph=output)])
        assert kept is run and notes == []


def test_a_gyro_across_the_tables_axis_decides_nothing() -> None:
    lying = made_run("lying", stimulus(5000, elevation_deg=0.0, cold=False), np.random.default_rng(1))
    lying = replace(lying, stimulus=_read(lying.stimulus, 2))
    (kept,), notes = without_reading_noise([lying])
    assert kept is lying and notes == []


STEP_DEG = 11.0 / 3600.0
"""Of a resolver's code: up to 11 deg/h in the rate of a sample of 1 s."""


def _swept(number: int, ripple_deg: float = 0.0) -> tuple[GapRun, np.ndarray]:
    """Turns to and fro of 36 s at 10 deg/s, read in codes, and the true angle; a ripple of 4 s is the table's."""
    way_s = np.arange(3601.0) % 72.0
    true = 10.0 + 10.0 * np.where(way_s < 36.0, way_s, 72.0 - way_s) + 1e-3 * number
    true = true + ripple_deg * np.sin(0.5 * np.pi * np.arange(3601.0) + number)
    made = made_run(
        f"sweep {number}", replace(stimulus(3600, cold=False), angle_deg=true), np.random.default_rng(number)
    )
    read = STEP_DEG * np.round(true / STEP_DEG)
    return replace(made, stimulus=replace(made.stimulus, angle_deg=read)), true


def test_a_resolvers_code_is_no_rate_however_short_the_turns_are() -> None:
    """At an even rate codes come in a pattern: a line of several deg/h in what is asked of the gyro."""
    (run, true), (other, _) = _swept(1), _swept(2)
    even, notes = without_reading_noise([run, other])
    assert len(notes) == 1 and "evenly" in notes[0]
    off_dph = 3600.0 * (even[0].stimulus.table_rate_dps - np.diff(true))
    inside = np.abs(np.diff(true)) > 9.9
    assert 3600.0 * np.std(run.stimulus.table_rate_dps[inside] - np.diff(true)[inside]) > 4.0
    assert np.std(off_dph[inside]) < 0.5


def test_what_a_resolver_hardly_reads_is_the_tables_if_the_gyro_follows_it() -> None:
    run, _ = _swept(1, ripple_deg=1.3 * STEP_DEG)
    (kept,), notes = without_reading_noise([run])
    assert kept is run and notes == []


def test_creep_after_a_move_is_cut_off_what_a_resolver_calls_even() -> None:
    creep_deg = 4.0 * STEP_DEG * np.exp(-(np.arange(3601.0) % 72.0) / 8.0)
    run, true = _swept(3)
    true = true - creep_deg
    made = made_run("creeps", replace(run.stimulus, angle_deg=true), np.random.default_rng(4))
    read = replace(made.stimulus, angle_deg=STEP_DEG * np.round(true / STEP_DEG))
    (even,), notes = without_reading_noise([replace(made, stimulus=read)])
    assert notes
    assert np.abs(even.stimulus.angle_deg - true).max() < 1.3 * STEP_DEG


def test_steps_of_a_reading_are_told_from_noise_on_a_grid_and_from_a_table_that_indexes() -> None:
    true = 10.0 + 0.0123 * np.arange(2000.0)
    noise = np.random.default_rng(6).normal(size=2000)
    assert _step_deg(STEP_DEG * np.round(true / STEP_DEG)) == pytest.approx(STEP_DEG)
    # a text of four digits, and noise as large as its last one: at one rate it turns by two digits more, or three
    assert _step_deg(np.round(true + 1e-4 * noise, 4)) == 0.0
    assert _step_deg(true) == 0.0 and _step_deg(true + 1e-4 * noise) == 0.0
    indexed = np.repeat(90.0 * np.arange(100.0), 20)
    assert _step_deg(indexed) == 0.0 and _step_deg(1e-4 * indexed[:100]) == 0.0
    # steps of one size, but no multiples of it: a table that hunts beside an even rate
    assert _step_deg(true + STEP_DEG * np.floor(0.37 * np.arange(2000.0))) == 0.0
    moves = np.where(np.arange(2000) % 100 < 90, 0.0, 3.0 + 0.1 * noise)
    moved = true + np.cumsum(moves)
    assert _step_deg(STEP_DEG * np.round(moved / STEP_DEG)) == pytest.approx(STEP_DEG)


def test_what_is_cut_off_a_stretch_is_the_end_that_creeps() -> None:
    even = 0.3 * STEP_DEG * np.arange(60.0)
    creep = 6.0 * STEP_DEG * np.exp(-np.arange(60.0) / 3.0)
    for angle, kept in ((even - creep, slice(10, 60)), (even + creep[::-1], slice(0, 50))):
        read = STEP_DEG * np.round(angle / STEP_DEG)
        found = _within(read, slice(0, 60), 0.75 * STEP_DEG)
        assert abs(found.start - kept.start) <= 4 and abs(found.stop - kept.stop) <= 4


def test_rests_do_not_make_the_noise_of_a_resolver_look_less() -> None:
    rate_dps = np.concatenate((np.repeat(np.tile([0.0, 10.0], 20), 40), np.zeros(40)))
    true = np.concatenate(([10.0], 10.0 + np.cumsum(rate_dps)))
    s = replace(stimulus(len(rate_dps), cold=False), angle_deg=true)
    made = made_run("rests", s, np.random.default_rng(8))
    read = replace(s, angle_deg=STEP_DEG * np.round(true / STEP_DEG))
    _, notes = without_reading_noise([replace(made, stimulus=read)])
    size_dph = float(notes[0].partition("noise of ")[2].split()[0])
    turning = rate_dps > 0.0
    assert size_dph == pytest.approx(3600.0 * np.std((read.table_rate_dps - rate_dps)[turning]), rel=0.3)


def test_a_tachometer_that_scatters_is_no_rate_and_its_integral_leaves_no_step() -> None:
    """Rates as logged, of 0.001 deg/s of noise: their sum walks by 0.05 deg in the first dwell."""
    rate_dps = np.repeat([0.0, 2.0], 3000)
    s = replace(stimulus(6000, cold=False), angle_deg=np.concatenate(([10.0], 10.0 + np.cumsum(rate_dps))))
    made = made_run("logged", s, np.random.default_rng(12))
    logged_dps = rate_dps + np.random.default_rng(13).normal(0.0, 1e-3, 6000)
    read = replace(s, angle_deg=np.concatenate(([10.0], 10.0 + np.cumsum(logged_dps))))
    (even,), notes = without_reading_noise([replace(made, stimulus=read)])
    np.testing.assert_allclose(even.stimulus.table_rate_dps, rate_dps, atol=1e-4)
    assert "3.6 deg/h a sample" in notes[0]
    ripple_dps = 7e-4 * np.sin(2.0 * np.pi * np.arange(6000) / 200.0)  # below the noise, and the table's
    rippled = np.concatenate(([10.0], 10.0 + np.cumsum(logged_dps + ripple_dps)))
    (kept,), notes = without_reading_noise([replace(made, stimulus=replace(s, angle_deg=rippled))])
    assert kept.stimulus.angle_deg is rippled and notes == []


def test_rates_at_the_edges_of_samples_are_those_of_the_line() -> None:
    turning = stimulus(3000, rate_dps=4.0)
    edge_rate_dps = 4.0 + np.random.default_rng(14).normal(0.0, 1e-4, 3001)
    run = made_run("edges", turning, np.random.default_rng(15))
    read = replace(_read(turning, 16), edge_rate_dps=edge_rate_dps)
    (even,), _ = without_reading_noise([replace(run, stimulus=read)])
    assert even.stimulus.edge_rate_dps == pytest.approx(np.full(3001, 4.0), abs=1e-6)


def test_a_slow_rate_and_its_edges_stay_what_they_are() -> None:
    """Steps of 9 deg/h beside rest: no one line goes through them, and they keep their rates."""
    s = stimulus(4000, cold=False)
    rate_dps = np.repeat([0.0, 0.0025, 0.0, 0.02], 1000)
    s = replace(s, angle_deg=np.concatenate(([10.0], 10.0 + np.cumsum(rate_dps))))
    made = made_run("slow", s, np.random.default_rng(3))
    (still,), _ = without_reading_noise([replace(made, stimulus=_read(s, 5))])
    mean_dps = still.stimulus.table_rate_dps.reshape(4, 1000).mean(axis=1)
    np.testing.assert_allclose(mean_dps, [0.0, 0.0025, 0.0, 0.02], atol=1e-6)


def test_lost_samples_are_no_evidence_and_a_table_that_turns_is_read_alike() -> None:
    run, turning = _standing(1), made_run("t", stimulus(5000, rate_dps=5.0), np.random.default_rng(9))
    turning = replace(turning, stimulus=_read(turning.stimulus, 8))
    output = run.output_dph.copy()
    output[1000:4000] = np.nan
    even, notes = without_reading_noise([replace(run, output_dph=output), turning])
    assert notes and all(np.ptp(each.stimulus.input_rate_dph) < 0.02 for each in even)
    nothing = replace(run, output_dph=np.full(len(output), np.nan))
    (kept,), notes = without_reading_noise([nothing])
    assert kept is nothing and notes == []


def test_a_table_that_swings_beside_its_noise_is_left_alone() -> None:
    """A ripple of 0.4 arcsec beside 0.11 arcsec of reading noise is the table's, whatever the noise is."""
    run = _standing(4)
    swing_deg = 1.1e-4 * np.sin(2.0 * np.pi * np.arange(5001) / 36.0)
    s = replace(run.stimulus, angle_deg=run.stimulus.angle_deg + swing_deg)
    (kept,), notes = without_reading_noise([replace(run, stimulus=s)])
    assert kept.stimulus is s and notes == []


@pytest.mark.parametrize("seed", range(2))
def test_a_perfect_gyro_on_a_table_that_is_read_with_noise_has_no_gap(nominal: Model, seed: int) -> None:
    """The edge of a dead zone beside the Earth's rate was fitted to the noise of the reading."""
    runs = [_standing(10 * seed + number, 8000) for number in range(4)]
    rates = np.repeat([0.0, 1.0, -1.0, 10.0, -10.0, 0.003, -0.003, 0.03, -0.03, 0.0], 200)
    s = replace(stimulus(2000, cold=False), angle_deg=np.concatenate(([10.0], 10.0 + np.cumsum(rates))))
    for number in range(2):
        made = made_run(f"rates {number}", s, np.random.default_rng((seed, number)), profile="rates")
        runs.append(replace(made, stimulus=_read(s, 90 + number)))
    found = diagnose(runs, nominal)
    assert found.verdict == "no gap", (found.causes, found.rate.stochastic)
    assert any("is read with a noise" in note for note in found.rate.warnings)


def test_a_table_that_sweeps_to_and_fro_in_few_samples_turns_for_a_gyro_that_follows() -> None:
    """Sectors of 60 deg in 2 s, after a rest: the samples scatter about a line as a noisy reading does."""
    swept = np.tile((0.0, 60.0, 60.46, 0.46), 105)
    angle_deg = np.concatenate((np.full(21, 222.86), 267.4 + swept, np.full(20, 222.86)))
    s = replace(stimulus(len(angle_deg) - 1, cold=False), angle_deg=angle_deg)
    rng = np.random.default_rng(5)
    runs = [made_run(name, s, rng) for name in "ab"]
    for run in runs:
        run.output_dph[10] += 1e6  # an impulse
    kept, notes = without_reading_noise(runs)
    assert notes == [] and all(one is run for one, run in zip(kept, runs, strict=True))


def test_a_held_out_run_is_read_as_those_that_were_fitted(nominal: Model) -> None:
    """The noise of its table's reading, 1 deg/h, is six times what a bias of 0.4 deg/h does to it."""

    def run(number: int) -> GapRun:
        s = stimulus(5000)
        made = made_run(f"run {number}", s, np.random.default_rng(number), 0.4 * (s.warm_k / 50.0) ** 3)
        return replace(made, stimulus=_read(made.stimulus, 50 + number))

    found = diagnose([run(1), run(2)], nominal, [run(3)]).rate
    assert [cause.name for cause in found.causes] == ["bias_cubic"]
    (held,) = found.held_out
    assert held.share > 0.95


def test_a_move_in_the_last_sample_of_a_turn_is_no_scatter() -> None:
    """Twenty turns, each with a part of the next in its last sample: less than five times the scatter."""
    s, long = stimulus(3000), 150
    rate_dps = np.where(np.arange(3000) // long % 2, -5.0, 5.0)
    last = np.arange(long - 1, 3000 - long, long)
    for sample in range(1, 4):  # the move takes four samples
        rate_dps[last + sample] *= 0.5 * sample - 1.0
    part = 4.0 * NOISE_DEG * np.sign(rate_dps[last + 4])
    rate_dps[last] += part
    made = made_run(
        "moves", replace(s, angle_deg=np.cumsum(np.append(0.0, rate_dps))), np.random.default_rng(5)
    )
    (even,), notes = without_reading_noise([replace(made, stimulus=_read(made.stimulus, 7))])
    assert notes
    off_dph = even.stimulus.input_rate_dph - made.stimulus.input_rate_dph
    assert np.abs(off_dph[10:140]).max() < 0.1
    # 0.15 deg/h of reading in each, and nothing taken away in their mean
    assert abs(float(np.mean(off_dph[last] * np.sign(part)))) < 0.15
