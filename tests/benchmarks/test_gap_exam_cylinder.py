"""Metal cylinder gyros: heat, table, masks and noise against closed forms, files against the data sheet."""

import math

import allantools
import numpy as np
import pytest
from scipy.fft import dct
from scipy.integrate import solve_ivp

from benchmarks.gap_exam import _cylinder_bench as bench
from benchmarks.gap_exam._cylinder import CYLINDER, NOISY, SHEET
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._make import draw_unit
from drivers.base.constants import earth_rate_north_dph, earth_rate_up_dph
from tests.gap_families import deviations, null_residual, run, share_of_the_column, still


@pytest.fixture(scope="module")
def unit():
    return draw_unit(CYLINDER, 5, {})


@pytest.fixture(scope="module")
def stages(unit):
    return CYLINDER.campaign(unit)


# heat ---------------------------------------------------------------------------------------------------------


def test_at_rest_the_board_is_warmer_than_the_housing_by_its_power_over_its_posts(unit):
    heat = bench.heat_of(unit)
    plate, housing, board, metal = heat.followed(np.full(4, 23.0), np.zeros(4), 4e4)[:, -1]
    assert board - housing == pytest.approx(bench.SELF_HEAT_K, abs=1e-6)
    assert metal == pytest.approx(housing, abs=1e-3)
    # all of the power leaves into the air from plate and housing
    on_plate, on_housing = 23.0 - plate, 23.0 - housing
    lost = on_plate * (1.0 + 0.3 * abs(on_plate) ** 0.25) + on_housing * (
        0.2 + 0.08 * abs(on_housing) ** 0.25
    )
    assert -lost == pytest.approx(bench.BOARD_W, rel=1e-6)


def test_bodies_follow_the_air_as_the_differential_equation_says(unit):
    heat, n = bench.heat_of(unit), 1500
    at = np.arange(1, n + 1) * bench.HEAT_STEP_S
    capacities = np.array(
        [bench.PLATE_J_PER_K, bench.HOUSING_J_PER_K, bench.BOARD_J_PER_K, bench.METAL_J_PER_K]
    )

    def slope(t, bodies):
        return (
            np.array(heat.flows(20.0 + 30.0 * math.sin(t / 700.0), 3.0, bodies, bench.BOARD_W)) / capacities
        )

    exact = solve_ivp(slope, (0.0, at[-1]), np.full(4, 20.0), t_eval=at[[400, n - 1]], rtol=1e-8).y
    found = heat.followed(20.0 + 30.0 * np.sin((at - 1.0) / 700.0), np.full(n, 9.0), 0.0)[:, [400, n - 1]]
    np.testing.assert_allclose(found, exact, atol=0.12)


def test_heat_of_metal_is_stem_and_radiation_and_nought_at_one_temperature(unit):
    flows = bench.heat_of(unit).flows(20.0, 0.0, (20.0, 20.0, 20.0, 20.0), 0.0)
    np.testing.assert_allclose(flows, 0.0, atol=1e-12)
    warm = bench.heat_of(unit).flows(20.0, 0.0, (20.0, 60.0, 60.0, 20.0), 0.0)[3]
    radiated = 0.3 * 3e-3 * 5.670374e-8 * (333.15**4 - 293.15**4)
    assert warm == pytest.approx(bench.STEM_W_PER_K * 40.0 + radiated, rel=5e-3)


def test_the_chambers_air_ramps_no_faster_than_it_can_and_lags_behind_slower_demands():
    step_s = bench.HEAT_STEP_S
    at_min = np.arange(3000) * step_s / 60.0
    air = bench.chamber_air(np.minimum(at_min * 2.0, 60.0), step_s, 3.0)
    # a first-order lag is behind a ramp by slope times its time constant
    assert 40.0 - air[np.searchsorted(at_min, 20.0)] == pytest.approx(
        2.0 * bench.CHAMBER_LAG_S / 60.0, rel=0.02
    )
    jump = bench.chamber_air(np.where(at_min < 1.0, 0.0, 60.0), step_s, 3.0)
    assert np.diff(jump).max() * 60.0 / step_s == pytest.approx(3.0)
    assert jump[-1] == pytest.approx(60.0, abs=1e-6)


def test_the_makers_thermometer_is_warmer_than_the_metal_by_a_share_of_the_boards_heat(stages):
    for stage in stages:
        if len(stage.phases) == 1 and stage.code != "CS":
            apart = stage.t_in_c - stage.body("metal")
            # the room's air waves: the metal is behind by some minutes
            np.testing.assert_allclose(apart, bench.BEAD_HEAT_K, atol=0.25)


# table and grid -----------------------------------------------------------------------------------------------


def test_the_servo_settles_on_its_rate_and_swings_over_as_its_damping_says():
    angle = bench.servo_deg([(1.0, 100.0)], 400, 7.0)
    speed = np.diff(angle) / bench.STEP_S
    np.testing.assert_allclose(speed[-50:], 100.0, atol=1e-6)
    # a ramp of length L smooths the overshoot of a step to at most exp(-pi z / sqrt(1 - z^2))
    z = bench.SERVO_DAMPING
    assert 0.0 < speed.max() - 100.0 < 100.0 * math.exp(-math.pi * z / math.sqrt(1.0 - z * z))
    # behind the ramp the angle is late by half the ramp, by 2 z / w, and by half a step of the hold
    late_s = 0.5 * 100.0 / bench.DPS2 + 2.0 * z / bench.SERVO_RAD_S + 0.5 * bench.STEP_S
    assert angle[-1] - 7.0 == pytest.approx(100.0 * (49.0 - late_s), abs=100.0 * 0.5 * bench.STEP_S + 0.1)


def test_rows_cover_the_run_on_even_grids_of_whole_eighths_of_a_second(stages):
    for stage in stages:
        steps = np.diff(stage.edges_s)
        np.testing.assert_array_equal(steps, steps[0])
        assert steps[0] in (0.125, 0.25, 0.5, 1.0)
        assert stage.edges_s[0] == 0.0 and stage.edges_s[-1] == pytest.approx(stage.steps * bench.STEP_S)


def test_masks_cover_every_move_and_change_of_mount_and_no_measured_turn(stages):
    for stage in stages:
        if stage.code == "PO":
            slow = np.abs(stage.in_rows(stage.rate_dps)) < 0.01
            fast = np.abs(stage.in_rows(stage.rate_dps)) > 23.0
            begun = stage.edges_s[:-1] < 2400.0
            assert not (~slow & begun & stage.valid).any()
            assert (fast & stage.valid).sum() * 0.5 == pytest.approx(180.0, abs=4.0)
            np.testing.assert_array_equal(stage.kept, stage.valid)
        elif stage.code == "TU":
            at = stage.in_rows(stage.elevation_deg)[stage.valid]
            assert set(np.round(at, 9)) == {-90.0, -45.0, -30.0, 0.0, 30.0, 45.0, 90.0}
            assert stage.kept.all() and 0.7 < stage.valid.mean() < 0.9
        else:
            assert stage.valid.all() and stage.kept.all()


def test_the_campaign_has_27_runs_and_a_profile_never_shown(stages):
    assert len(stages) == len({stage.run_id for stage in stages}) == 27
    assert {s.profile for s in stages} - {s.profile for s in stages if not s.held_out} == {"mission"}
    assert sorted(stage.number for stage in stages) == list(range(27))
    rates = np.concatenate([stage.rate_dps for stage in stages])
    assert (rates.min(), rates.max()) == pytest.approx((-200.0, 200.0), rel=0.02)
    assert min(s.body("metal").min() for s in stages) < -30.0
    assert max(s.body("metal").max() for s in stages) > 60.0
    assert all(s.power_on_s == 0.0 for s in stages if s.code == "CS")


def test_the_true_rate_is_earth_rate_where_the_table_stands(stages):
    latitude = bench.LATITUDE_DEG
    up = sensed_dph(run(stages, "LS"), latitude)
    np.testing.assert_allclose(up, earth_rate_up_dph(latitude), rtol=1e-9)
    level = sensed_dph(run(stages, "PO"), latitude)
    assert level[:1000].mean() == pytest.approx(earth_rate_north_dph(latitude), rel=1e-6)
    # half a turn further on the axis points south
    assert level[int(1200.0 / bench.STEP_S)] == pytest.approx(-earth_rate_north_dph(latitude), rel=1e-4)


def test_the_lean_is_the_catalogues_own_column_with_its_true_values(unit, stages):
    assert share_of_the_column(CYLINDER, unit, stages, "lean") == pytest.approx(1.0, abs=0.08)


def test_late_samples_miss_the_delay_times_the_change_of_rate(unit, stages):
    stage = run(stages, "RS")
    missed = CYLINDER.effects["sampler_lag"].signal(unit, stage, 2.0)
    rate = sensed_dph(stage, bench.LATITUDE_DEG)
    at = slice(8, int(80.0 / bench.STEP_S))
    # a rate that ends higher than it began was missed by that times 2 ms
    assert missed[at].sum() * bench.STEP_S == pytest.approx(
        -2e-3 * (rate[at.stop - 1] - rate[at.start]), rel=1e-3
    )
    speeding = np.gradient(rate, bench.STEP_S)[at]
    assert float(missed[at] @ speeding / (speeding @ speeding)) == pytest.approx(-2e-3, rel=0.15)


# noise and files ----------------------------------------------------------------------------------------------


def test_noise_is_white_flicker_walk_and_counts():
    taus = np.array([8.0, 64.0, 512.0])
    flicker = 2.0 * math.log(2.0) / math.pi * SHEET.bias_instability_dph**2
    walk = SHEET.rate_random_walk_dph_per_sqrt_h**2 * taus / 3600.0 / 3.0
    expected = np.sqrt(3600.0 * SHEET.arw_deg_per_sqrt_h**2 / taus + flicker + walk)
    np.testing.assert_allclose(deviations(CYLINDER, taus, 20_000), expected, rtol=0.15)


@pytest.mark.parametrize(
    ("name", "factor", "tau_s"),
    [("tired_preamplifier", 4.0, 1.0), ("restless_phase", 12.0, 128.0), ("coarse_counter", 40.0, 0.125)],
)
def test_each_noise_has_the_allan_deviation_of_its_factor(name, factor, tau_s):
    assert NOISY[name][1] == factor
    factors = {known: factor if known == name else 1.0 for known in NOISY}
    white = factors["tired_preamplifier"] * SHEET.arw_deg_per_sqrt_h
    instability = factors["restless_phase"] * SHEET.bias_instability_dph
    quantum = factors["coarse_counter"] * SHEET.quantum_arcsec
    expected = 3600.0 * white**2 / tau_s + 2.0 * math.log(2.0) / math.pi * instability**2
    expected += quantum**2 / 4.0 / tau_s**2
    squares = []
    for seed in range(6):
        unit, rng = draw_unit(CYLINDER, seed, {name: factor}), np.random.default_rng(seed)
        output = CYLINDER.rows(unit, still(40_000, 0.125), np.zeros(40_000), rng)
        squares.append(allantools.oadev(output, rate=8.0, data_type="freq", taus=[tau_s])[1][0] ** 2)
    assert math.sqrt(np.mean(squares)) == pytest.approx(math.sqrt(expected), rel=0.2)


def test_the_counter_errs_by_less_than_a_count_and_loses_no_angle():
    n, quantum = 4000, 40.0 * SHEET.quantum_arcsec
    unit = draw_unit(CYLINDER, 1, {"coarse_counter": 40.0})
    fine, coarse = (
        CYLINDER.rows(who, still(n, 0.125), np.full(n, 3600.0), np.random.default_rng(1))
        for who in (draw_unit(CYLINDER, 1, {"coarse_counter": 1e-9}), unit)
    )
    apart = np.cumsum(coarse - fine) * 0.125
    # both ends of an angle err by half a count at most
    assert 0.9 * quantum < np.ptp(apart) < quantum


def test_a_null_has_the_noise_of_its_sheet_and_nothing_else(tmp_path):
    left = null_residual(CYLINDER, tmp_path, 3)
    assert np.mean(left**2) == pytest.approx(1.0, abs=0.1)
    assert np.abs(left).max() < 5.5


def test_counts_of_angle_have_the_spectrum_that_the_sheet_gives_them():
    """Beyond white noise the coarse counter adds quantum^2 / 12 per step of angle, differentiated."""
    n, quantum = 60_000, 40.0 * SHEET.quantum_arcsec
    unit = draw_unit(CYLINDER, 2, {"coarse_counter": 40.0})
    output = CYLINDER.rows(unit, still(n, 0.125), np.full(n, 41.8), np.random.default_rng(2))
    power = dct(output - output.mean(), norm="ortho")[1:] ** 2
    half = np.arange(1, n) / n
    expected = 3600.0 * SHEET.arw_deg_per_sqrt_h**2 / 0.125
    expected = expected + quantum**2 / 12.0 / 0.125**2 * 4.0 * np.sin(0.5 * np.pi * half) ** 2
    for low, high in ((0.2, 0.4), (0.6, 0.95)):
        band = (half > low) & (half < high)
        assert power[band].sum() / expected[band].sum() == pytest.approx(1.0, abs=0.05)
