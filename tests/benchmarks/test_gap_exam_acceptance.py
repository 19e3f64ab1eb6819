"""Acceptance line: heat against balances, stations against their habits, effects against limits and parities."""

import dataclasses
import math

import numpy as np
import pytest

from benchmarks.gap_exam import _acceptance_effects as effects
from benchmarks.gap_exam import _acceptance_line as line
from benchmarks.gap_exam._acceptance import ACCEPTANCE, SHEET, rows
from benchmarks.gap_exam._make import draw_unit
from benchmarks.gap_exam._signals import drawn
from drivers.base.constants import ZERO_CELSIUS_K
from tests.gap_families import run, still


@pytest.fixture(scope="module")
def unit():
    return draw_unit(ACCEPTANCE, 5, {})


@pytest.fixture(scope="module")
def stages(unit):
    return ACCEPTANCE.campaign(unit)


def stage_with(unit, stamps, code="ST", station="pier", **changed):
    """A run of a station whose clock has a given habit."""
    habit = dataclasses.replace(line.habit_of(unit, station), stamps=stamps, **changed)
    sort = next(sort for sort in line._sorts(drawn(1, "line")) if sort.code == code)
    return line._stage(unit, sort, habit, 0, 0, False)


def turning(rate_dps, n=600, step_s=0.1, **changed):
    """A run, axis up, on a table of given rates (n,)."""
    angle = np.concatenate(([0.0], np.cumsum(np.broadcast_to(rate_dps, n)) * step_s))
    return still(n, step_s, angle_deg=angle, elevation_deg=np.full(n, 90.0), **changed)


# heat ---------------------------------------------------------------------------------------------------------


def test_settled_bodies_give_the_laser_s_power_to_the_air():
    end = line.heated(np.full(20_000, 30.0), (30.0, 30.0, 30.0, 30.0))[:, -1]
    assert line.heat_flows(end.tolist(), 30.0, 1.0) == pytest.approx([0.0] * 4, abs=1e-9)

    def lost(body_c):
        hot, cold = body_c + ZERO_CELSIUS_K, 30.0 + ZERO_CELSIUS_K
        return 0.05 * (body_c - 30.0) ** 1.25 + 0.018 * 0.8 * 5.670374419e-8 * (hot**4 - cold**4)

    assert lost(end[2]) + 0.6 * lost(end[3]) == pytest.approx(0.9, rel=1e-6)
    # a tenth of the power crosses the link of the chip, all of it that of the carrier
    assert end[0] - end[1] == pytest.approx(0.09 / 0.05, rel=1e-6)
    assert end[1] - end[2] == pytest.approx(0.9 / 0.12, rel=1e-6)


def test_a_unit_without_power_stays_at_the_temperature_of_the_air():
    assert line.heated(np.full(500, -18.0), (-18.0,) * 4, on=0.0) == pytest.approx(np.full((4, 500), -18.0))


# stations -----------------------------------------------------------------------------------------------------


def test_a_campaign_has_at_most_27_runs_and_stations_are_drawn_anew():
    kinds = set()
    for seed in range(12):
        made = ACCEPTANCE.campaign(draw_unit(ACCEPTANCE, seed, {}))
        assert len(made) <= 27
        assert sum(stage.kept.sum() for stage in made) <= 40_500
        kinds |= {line.habit_of(draw_unit(ACCEPTANCE, seed, {}), station).stamps for station in line.STATIONS}
    assert kinds == set(line.STAMPS)


def test_one_run_is_aborted_and_the_others_of_its_sort_are_not(stages):
    lengths = {stage.run_id: stage.edges_s[-1] for stage in stages}
    longest = {stage.code: max(s.edges_s[-1] for s in stages if s.code == stage.code) for stage in stages}
    short = [stage for stage in stages if lengths[stage.run_id] < 0.9 * longest[stage.code]]
    assert [stage.repeat for stage in short] == [1]


def test_a_clock_that_is_off_stretches_stamps_and_leaves_the_rows(unit):
    stage = stage_with(unit, "drifting", stamp_size=30.0)
    assert stage.edges_s == pytest.approx(stage.taken_s * (1.0 + 30e-6), rel=1e-12)
    assert np.ptp(np.diff(stage.taken_s)) < 1e-9


def test_jittered_stamps_are_late_by_no_more_than_their_size_and_rounded_ones_are_whole(unit):
    late = stage_with(unit, "jittered", stamp_size=3e-3)
    assert np.min(late.edges_s - late.taken_s) >= 0.0 and 2.9e-3 < np.max(late.edges_s - late.taken_s) < 3e-3
    whole = stage_with(unit, "rounded", stamp_size=1e-3)
    assert whole.edges_s * 1e3 == pytest.approx(np.round(whole.edges_s * 1e3), abs=1e-6)
    assert np.abs(whole.edges_s - whole.taken_s).max() <= 0.5e-3 + 1e-9


def test_rows_of_a_stage_are_means_over_their_true_times(unit):
    stage = stage_with(unit, "drifting", stamp_size=1e4)
    middles = 0.5 * (stage.taken_s[1:] + stage.taken_s[:-1])
    assert stage.in_rows(stage.time_s) == pytest.approx(middles, abs=1e-6)


def test_a_move_ends_at_the_angle_that_was_commanded_and_its_rows_are_blanked(unit):
    stage = stage_with(unit, "even", "RS", "table", commanded=True, masks=True, ramp_s=1.0, jerk_limited=True)
    fine_s = np.arange(stage.steps + 1) * stage.step_s
    apart = np.abs(np.interp(stage.taken_s, fine_s, stage.logged_deg - stage.angle_deg))
    assert apart[1:][stage.valid].max() < 1e-9 and apart[:-1][stage.valid].max() < 1e-9
    assert apart.max() > 1.0
    assert 0.7 < stage.valid.mean() < 0.95
    found = {round(rate) for rate in stage.rate_dps[np.abs(np.gradient(stage.rate_dps)) < 1e-9].tolist()}
    assert found == {0, 5, -5, 20, -20, 50, -50, 100, -100}


def test_thermometers_have_the_step_of_their_station(unit, stages):
    for code, station in (("RA", "chamber"), ("ST", "pier")):
        t_in, t_out, _ = ACCEPTANCE.read(unit, run(stages, code), drawn(1, "read"))
        step_k = line.habit_of(unit, station).thermometer_step_k
        for logged in (t_in, t_out):
            assert logged / step_k == pytest.approx(np.round(logged / step_k), abs=1e-6)


def test_the_same_unit_has_the_same_campaign(unit, stages):
    for one, other in zip(stages, ACCEPTANCE.campaign(unit), strict=True):
        assert np.array_equal(one.edges_s, other.edges_s) and np.array_equal(one.kept, other.kept)
        assert np.array_equal(one.t_in_c, other.t_in_c)


# output -------------------------------------------------------------------------------------------------------


def test_white_noise_of_the_rows_is_that_of_the_sheet(unit):
    stage = still(20_000, 1.0)
    output = rows(unit, stage, np.zeros(20_000), drawn(3, "noise"))
    white = (60.0 * SHEET.arw_deg_per_sqrt_h) ** 2
    # what a count rounds adds 1/6 of its square; differences hide 1/f and the walk but for a few per cent
    assert np.var(np.diff(output)) / 2.0 == pytest.approx(
        white + 3.0 * SHEET.quantum_arcsec**2 / 12.0, rel=0.05
    )


# effects ------------------------------------------------------------------------------------------------------


def test_locking_takes_the_whole_rate_within_the_zone_and_nothing_far_outside():
    inside = effects.locked_dph(np.array([-9.0, 0.0, 9.0]), 10.0, 2.0)
    assert inside.tolist() == [0.0, 0.0, 0.0]
    assert effects.locked_dph(np.array([26.0, -26.0]), 10.0, 2.0) == pytest.approx([24.0, -24.0])
    assert effects.locked_dph(np.array([1e5]), 10.0, 2.0) == pytest.approx([1e5], abs=1e-3)


def test_a_loop_ends_at_its_limit_and_is_true_far_below():
    assert effects.limited_dph(np.array([1e6, -1e6]), 100.0, 12.0) == pytest.approx([100.0, -100.0])
    assert effects.limited_dph(np.array([30.0]), 100.0, 12.0) == pytest.approx([30.0], abs=1e-5)


def test_kerr_is_even_in_rate_and_the_limit_odd(unit):
    one, other = turning(80.0), turning(-80.0)
    earth = effects._rate(turning(0.0))[0]
    even = effects.kerr(unit, one, 100.0) - effects.kerr(unit, other, 100.0)
    assert np.abs(even).max() < 1e-4 * 3.0 * earth
    odd = effects.limit(unit, one, 2.4) + effects.limit(unit, other, 2.4)
    assert np.abs(odd).max() < 0.01 * np.abs(effects.limit(unit, one, 2.4)).max()


def test_the_speed_of_the_chip_s_temperature_acts_less_than_in_proportion_and_odd(unit):
    time_s = np.arange(6000) * 0.1

    def settled(k_per_min):
        ramp = turning(0.0, 6000, bodies_c={"chip": 25.0 + k_per_min * time_s / 60.0})
        return effects.shupe(unit, ramp, 1.0)[-1]

    knee = 1.5 + 3.5 * unit.draw["b"]
    assert settled(4.0) == pytest.approx(knee * math.asinh(4.0 / knee), rel=1e-6)
    assert settled(-4.0) == pytest.approx(-settled(4.0))


def test_the_laser_hops_back_at_a_lower_temperature(unit):
    chip = np.concatenate((np.linspace(20.0, 70.0, 300), np.linspace(70.0, 20.0, 300)))
    up = effects.mode_hop(unit, turning(0.0, bodies_c={"chip": chip}), 1.0)
    hop, half = 39.0 + 13.0 * unit.draw["c1"], 0.5 + 2.0 * unit.draw["c2"]
    assert chip[np.argmax(up > 0.0)] == pytest.approx(hop + half, abs=0.2)
    assert chip[599 - np.argmax(up[::-1] > 0.0)] == pytest.approx(hop - half, abs=0.2)
    assert set(up.tolist()) == {0.0, 1.0}


def test_creep_and_hysteresis_are_nothing_at_a_temperature_that_stays(unit):
    stage = turning(0.0, bodies_c={"chip": np.full(600, 40.0), "carrier": np.full(600, 38.0)})
    assert np.abs(effects.creep(unit, stage, 1.0)).max() < 1e-9
    assert not effects.hysteresis(unit, stage, 1.0).any()


def test_every_effect_shows_in_the_campaign(unit, stages):
    for name, effect in ACCEPTANCE.effects.items():
        parts = [effect.signal(unit, stage, effect.sizes[1] if effect.curved else 1.0) for stage in stages]
        assert all(np.isfinite(part).all() for part in parts), name
        assert max(np.ptp(part) for part in parts) > 0.0, name
    assert (len(ACCEPTANCE.known), len(ACCEPTANCE.foreign), len(ACCEPTANCE.noisy)) == (16, 6, 3)


def test_an_effect_differs_between_repeats_of_the_same_run_where_it_says_so(unit, stages):
    first = run(stages, "ST")
    second = dataclasses.replace(first, repeat=1)
    for name, effect in ACCEPTANCE.effects.items():
        one, other = (effect.signal(unit, stage, 1.0) for stage in (first, second))
        assert np.array_equal(one, other) != effect.changing, name
