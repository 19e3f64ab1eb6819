"""Spring-restrained rate gyros: heat, bar, pivots, oil, pick-off, table and counter against closed forms."""

import math

import numpy as np
import pytest

from benchmarks.gap_exam import _spring_bench as bench
from benchmarks.gap_exam import _spring_effects as effects
from benchmarks.gap_exam._families import FAMILIES
from benchmarks.gap_exam._make import draw_unit
from benchmarks.gap_exam._spring import SHEET, SPRING
from tests.gap_families import null_residual, run, still


@pytest.fixture(scope="module")
def unit():
    return draw_unit(SPRING, 5, {})


@pytest.fixture(scope="module")
def stages(unit):
    return SPRING.campaign(unit)


def signal(unit, stage, name, size=1.0):
    return SPRING.effects[name].signal(unit, stage, size)


def turning(rate_dps, n=6000, step_s=0.1, **changed):
    """A run, axis up, on a table of given rates (n,)."""
    angle = np.concatenate(([0.0], np.cumsum(np.broadcast_to(rate_dps, n)) * step_s))
    return still(n, step_s, angle_deg=angle, elevation_deg=np.full(n, 90.0), **changed)


def test_the_family_is_registered_with_twenty_known_effects_seven_foreign_and_three_noisy():
    assert FAMILIES["spring_restrained"] is SPRING
    assert (len(SPRING.known), len(SPRING.foreign), len(SPRING.noisy)) == (20, 7, 3)


# heat ---------------------------------------------------------------------------------------------------------


def test_settled_heat_flows_from_motor_and_coil_to_the_air(unit):
    case = bench.heated(unit, np.full(4000, 23.0), 1.0, 7200.0)[0]
    expected = 23.0 + (bench.MOTOR_W + bench.COIL_W) / bench.AIR_W_PER_K
    assert case == pytest.approx(np.full(4000, expected), abs=1e-8)


def test_the_bodies_gain_the_energy_that_motor_coil_and_air_bring(unit):
    step_s = 0.1
    air = 23.0 + 20.0 * np.sin(np.arange(9000) * step_s / 300.0)
    bodies = bench.heated(unit, air, step_s, 10.0)
    stored = np.array(bench.HEAT_J_PER_K) @ (bodies[:, -1] - bodies[:, 0])
    on_s = 10.0 + (np.arange(9000)) * step_s
    motor = bench.MOTOR_W * np.where(on_s < bench.RUN_UP_S, bench.RUN_UP_FACTOR, 1.0)
    brought = motor + bench.COIL_W + bench.AIR_W_PER_K * (air - bodies[0])
    halved = np.concatenate(([0.5], np.ones(8998), [0.5]))
    assert stored == pytest.approx(float(halved @ brought) * step_s, abs=2.0)


def test_a_start_ends_where_a_settled_run_stands(unit):
    air = np.full(20_000, 23.0)
    assert bench.heated(unit, air, 1.0, 20.0)[:, -1] == pytest.approx(
        bench.heated(unit, air, 1.0, 7200.0)[:, -1], abs=1e-3
    )


# table and counter --------------------------------------------------------------------------------------------


def test_the_servo_reaches_the_rate_before_rows_count(unit, stages):
    stage = run(stages, "RR")
    rate = stage.in_rows(stage.rate_dps)[stage.valid]
    wanted = np.array([0.0, 1.0, 3.0, 6.0, 12.0, 20.0, 30.0])
    off = np.abs(np.abs(rate)[:, None] - wanted).min(axis=1)
    assert off.max() < 1e-6


def test_every_gate_lasts_half_a_second_and_threshold_runs_have_no_mask(stages):
    assert all(np.allclose(np.diff(stage.edges_s), 0.5) for stage in stages)
    assert run(stages, "TH").valid.all()
    assert not run(stages, "RR").valid.all()


def test_the_acceptance_run_is_held_out_whole_and_one_repeat_of_each_other(stages):
    held = [stage.code for stage in stages if stage.held_out]
    assert sorted(held) == sorted(sort.code for sort in bench.SORTS)
    assert sum(stage.code == "AC" for stage in stages) == 1


def test_a_gate_counts_whole_pulses(unit, stages):
    stage = run(stages, "RR")
    quiet = draw_unit(SPRING, 5, {"rotor_bearings": 1e-9, "flex_wander": 1e-9})
    rate = np.full(len(stage.valid), 777.0)
    first = SPRING.rows(quiet, stage, rate, np.random.default_rng(1))
    counts = first * 0.5 / SHEET.quantum_arcsec
    assert counts == pytest.approx(np.round(counts), abs=1e-6)


# bar, pivots, stops -------------------------------------------------------------------------------------------


def test_the_bar_balances_the_moment_of_the_gyro():
    rate = np.linspace(-30.0, 30.0, 61)
    x = effects.deflection_dps(rate, 0.08, 2.3) / bench.TOP_DPS
    assert x * (1.0 + 0.08 * np.abs(x) ** 2.3) == pytest.approx(rate / bench.TOP_DPS, abs=1e-12)
    assert x == pytest.approx(-x[::-1], abs=1e-12)


def test_a_cubic_bar_is_the_root_of_its_cubic():
    root = next(r.real for r in np.roots([0.05, 0.0, 1.0, -0.8]) if abs(r.imag) < 1e-9)
    got = effects.deflection_dps(np.array([0.8 * bench.TOP_DPS]), 0.05, 2.0)
    assert got[0] == pytest.approx(root * bench.TOP_DPS, rel=1e-10)


def test_pivots_pass_nothing_below_their_threshold_and_all_far_above():
    rate = np.array([-5.0, -0.01, -0.005, 0.0, 0.005, 0.01, 5.0])
    assert effects.freed_dps(rate, 0.01, 0.8) == pytest.approx([-5.0, 0, 0, 0, 0, 0, 5.0], abs=1e-12)


def test_the_stop_leaves_what_lies_below_it_and_acts_alike_on_both_sides(unit):
    slow = turning(25.0)
    assert signal(unit, slow, "end_stop", 1.0) == pytest.approx(np.zeros(slow.steps), abs=1e-9)
    up, down = (signal(unit, turning(rate), "end_stop", 5.0)[0] for rate in (30.0, -30.0))
    earth_dph = effects.sensed_dps(turning(0.0))[0] * 3600.0
    assert up < 0.0 < down
    assert up + down == pytest.approx(-2.0 * earth_dph, rel=0.05)


def test_damping_delays_a_ramp_by_its_time_and_loses_no_angle():
    n, step_s = 4000, 0.1
    ramp = 0.01 * (np.arange(n) + 0.5) * step_s
    lost = effects.unrestored(ramp, np.full(n, 25.0), 0.5, step_s)
    assert lost[-1] == pytest.approx(-0.01 * 0.5, rel=1e-6)
    there_and_back = np.concatenate((np.zeros(10), np.full(100, 8.0), np.zeros(2000)))
    lost = effects.unrestored(there_and_back, np.full(2110, 25.0), 0.5, step_s)
    assert np.sum(lost) * step_s == pytest.approx(0.0, abs=1e-9)


def test_silicone_oil_is_five_times_as_thick_at_minus_forty():
    assert effects.viscosity(np.array([25.0, -40.0])) == pytest.approx(
        [1.0, math.exp(1740.0 * 9.350e-4)], rel=2e-3
    )


def test_the_bar_forgets_a_rate_in_the_end_but_not_at_once(unit):
    rate = np.concatenate((np.full(600, 20.0), np.zeros(200_000)))
    after = signal(unit, turning(rate, len(rate)), "bar_aftereffect")
    assert after[700] > 0.01 * after[601] > 0.0
    assert abs(after[-1]) < 1e-3 * after[601]


# heat and gravity ---------------------------------------------------------------------------------------------


def test_flow_to_the_bellows_is_viscosity_times_the_slope(unit):
    oil = 20.0 - 2.0 * np.arange(600) / 60.0
    stage = still(600, 1.0, bodies_c={"oil": oil})
    assert signal(unit, stage, "bellows_flow") == pytest.approx(-2.0 * effects.viscosity(oil), rel=1e-9)


def test_the_bubble_has_a_hysteresis_of_temperature(unit):
    down_and_up = np.concatenate((np.linspace(30.0, -40.0, 7000), np.linspace(-40.0, 30.0, 7000)))
    bias = signal(unit, still(14_000, 1.0, bodies_c={"oil": down_and_up}), "oil_bubble")
    cooling, warming = bias[:7000], bias[7000:][::-1]
    assert np.all(warming >= cooling - 1e-9)
    assert np.sum(warming - cooling) / 100.0 == pytest.approx(bench.within(unit, "c2", 1.5, 5.0), abs=0.5)


def test_halves_are_even_and_become_the_size_of_the_rate_less_the_knee():
    rate = np.array([-20.0, 0.0, 20.0])
    assert effects.halves_dps(rate, 0.2) == pytest.approx(
        [20.0 - 0.2 * math.log(2.0), 0.0, 20.0 - 0.2 * math.log(2.0)], abs=1e-12
    )


def test_creep_and_bellows_say_nothing_at_a_constant_temperature(unit):
    stage = still(900, 1.0, bodies_c={"oil": np.full(900, 31.0), "pickoff": np.full(900, 31.0)})
    for name in ("cement_creep", "bellows_friction", "bellows_flow"):
        assert signal(unit, stage, name) == pytest.approx(np.zeros(900), abs=1e-9)


def test_the_cross_rate_is_even_and_acts_only_where_spin_and_input_axis_both_turn(unit):
    at_45 = [still(100, 0.1, angle_deg=np.arange(101) * 0.1 * rate, elevation_deg=np.full(100, 45.0))
             for rate in (30.0, -30.0)]  # fmt: skip
    assert signal(unit, at_45[0], "cross_coupling") == pytest.approx(np.full(100, 0.5))
    assert signal(unit, at_45[1], "cross_coupling") == pytest.approx(np.full(100, 0.5))
    assert signal(unit, turning(30.0), "cross_coupling") == pytest.approx(np.zeros(6000), abs=1e-12)


def test_what_changes_between_repeats_differs_in_two_runs_alike(unit):
    first = turning(12.0, code="RR", repeat=0)
    second = turning(12.0, code="RR", repeat=1)
    for name, effect in SPRING.effects.items():
        if effect.changing:
            one, two = signal(unit, first, name), signal(unit, second, name)
            assert np.var(one - two) > 0.1 * np.var(one) > 0.0, name


def test_a_null_case_has_the_noise_of_its_sheet(tmp_path):
    left = null_residual(SPRING, tmp_path, 5)
    assert np.mean(left**2) == pytest.approx(1.0, abs=0.06)
    assert np.abs(left).max() < 5.0
