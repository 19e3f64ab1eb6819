"""Depolarised fibre gyros: heat, coil, light, table and noise against closed forms, files against the sheet."""

import math

import numpy as np
import pytest

from benchmarks.gap_exam import _depolarised_bench as bench
from benchmarks.gap_exam import _depolarised_effects as effects
from benchmarks.gap_exam._depolarised import DEPOLARISED
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._make import draw_unit
from drivers.base.constants import earth_rate_up_dph
from tests.gap_families import deviations, null_residual, repeats_apart, run, share_of_the_column, still

EARTH_DPS = earth_rate_up_dph(bench.LATITUDE_DEG) / 3600.0


@pytest.fixture(scope="module")
def unit():
    return draw_unit(DEPOLARISED, 5, {})


@pytest.fixture(scope="module")
def stages(unit):
    return DEPOLARISED.campaign(unit)


def signal(unit, stage, name, size=1.0):
    return DEPOLARISED.effects[name].signal(unit, stage, size)


def warm(values, *names, step_s=1.0):
    """A run at rest with some nodes at given temperatures (n,)."""
    return still(len(values), step_s, bodies_c=dict.fromkeys(names, np.asarray(values, float)))


def turning(rate_dps, n=4000, step_s=0.1, **bodies):
    """A run, axis up, on a table of given rates (n,)."""
    angle = np.concatenate(([0.0], np.cumsum(np.broadcast_to(rate_dps, n)) * step_s))
    held = {name: np.full(n, value) for name, value in bodies.items()}
    return still(n, step_s, angle_deg=angle, elevation_deg=np.full(n, 90.0), bodies_c=held)


# heat ---------------------------------------------------------------------------------------------------------


def test_all_power_leaves_by_base_and_lid_once_the_unit_has_settled(unit):
    mount = 0.8 + 0.4 * unit.draw["c2"]
    settled = bench.heated(unit, np.full(3, 20.0), 1e7, 2.0)[:, 0] - 20.0
    assert mount * (0.85 * settled[0] + 0.42 * settled[1]) == pytest.approx(1.8 + 0.9, rel=1e-9)


def test_nodes_exchange_heat_without_loss_beside_what_the_air_takes(unit):
    matrix, air, _ = bench.network(unit)
    capacity = np.array((520.0, 110.0, 32.0, 30.0, 28.0, 26.0, 150.0, 60.0, 24.0))
    assert capacity @ matrix == pytest.approx(-capacity * air, abs=1e-12)


def test_the_network_forgets_when_power_came_on(unit):
    early, late = (bench.heated(unit, np.full(6000, 24.0), powered_s, 2.0) for powered_s in (0.0, 3000.0))
    assert np.abs(early[:, 0] - late[:, 0]).max() > 2.0
    assert early[:, -1] == pytest.approx(late[:, -1], abs=0.01)


def test_outer_layers_warm_before_the_middle_ones_when_the_air_gets_warmer(unit):
    nodes = bench.heated(unit, np.linspace(0.0, 30.0, 900), 1e7, 2.0)
    layers = (nodes - nodes[:, :1])[2:5, 300]
    assert (np.diff(layers) < 0.0).all()


def test_a_chamber_ramps_no_faster_than_it_can_and_arrives():
    air = bench.chamber_air(np.concatenate((np.full(10, 40.0), np.full(2000, -25.0))), 2.0)
    assert np.abs(np.diff(air)).max() <= 7.0 / 60.0 * 2.0 + 1e-9
    assert air[-1] == pytest.approx(-25.0, abs=1e-3)


def test_the_cooler_holds_the_diode_within_its_limits_and_lets_it_follow_beyond(unit):
    hot = bench.SET_C + 22.0 + 6.0 * unit.draw["a"]
    assert bench.beyond_cooler(unit, np.array([20.0, 30.0])) == pytest.approx([0.0, 0.0], abs=1e-6)
    assert bench.beyond_cooler(unit, np.array([hot + 20.0])) == pytest.approx([20.0], abs=1e-6)
    assert np.diff(bench.beyond_cooler(unit, np.array([-60.0, -59.0]))) == pytest.approx([1.0], abs=1e-6)


# runs and logs ------------------------------------------------------------------------------------------------


def test_rows_are_half_seconds_and_moves_of_the_mount_are_blank(stages):
    for stage in stages:
        assert np.diff(stage.edges_s) == pytest.approx(0.5)
        assert stage.valid.all() == (stage.code != "PO")
    places = run(stages, "PO")
    assert not places.valid[(places.edges_s[1:] > 590.0) & (places.edges_s[:-1] < 610.0)].any()


def test_the_chamber_reaches_heat_and_cold_and_the_cooler_its_limits(stages):
    assert run(stages, "RH").body("beyond").mean() > 5.0
    assert run(stages, "RC").body("beyond").mean() < -2.0
    assert np.abs(run(stages, "RR").body("beyond")).max() < 1e-3


def test_the_table_turns_back_to_where_it_began(stages):
    angle = run(stages, "RR").angle_deg
    assert angle[-1] == pytest.approx(angle[0], abs=1e-6)
    assert np.abs(run(stages, "RR").rate_dps).max() == pytest.approx(100.0, rel=1e-6)


def test_a_mission_is_held_out_whole_and_no_sort_of_run_loses_all_others(stages):
    shown = {stage.code for stage in stages if not stage.held_out}
    assert {stage.code for stage in stages} - shown == {"WE"}


# coil and potting ---------------------------------------------------------------------------------------------


def test_a_uniform_ramp_gives_the_stated_shupe_bias_and_rest_none(unit):
    ramp = warm(10.0 + np.arange(600.0) / 60.0, *bench.LAYERS)
    assert signal(unit, ramp, "unequal_layers", 7.0) == pytest.approx(7.0)
    assert signal(unit, warm(np.full(60, 50.0), *bench.LAYERS), "unequal_layers") == pytest.approx(0.0)


def test_potting_is_a_hundred_times_stiffer_in_the_glass(unit):
    assert effects.glass(unit, np.array([-80.0, 90.0])) == pytest.approx([1.0, 0.01], rel=1e-3)
    cold, hot = (warm(start + np.arange(600.0) / 60.0, "layer2", "layer3") for start in (-80.0, 90.0))
    ratio = signal(unit, cold, "glass_transition") / signal(unit, hot, "glass_transition")
    assert ratio == pytest.approx(100.0, rel=0.01)


def test_polarised_light_bends_the_bias_about_a_minimum_near_room_temperature(unit):
    bias = signal(unit, warm(np.linspace(-20.0, 65.0, 851), *bench.LAYERS), "residual_polarisation")
    assert abs(-20.0 + 0.1 * int(np.argmin(bias)) - 25.0) < 6.0
    assert bias.min() >= 0.0
    assert min(bias[0], bias[-1]) > 0.5


def test_the_coupler_lags_a_ramp_by_its_time(unit):
    spool = 25.0 + np.arange(12000.0) / 60.0
    behind = 500.0 + 900.0 * unit.draw["c"]
    late = signal(unit, warm(spool, "spool"), "late_coupler", 2.0)
    assert late[-1] == pytest.approx(2.0 * (spool[-1] - 25.0 - behind / 60.0), rel=2e-3)


def test_glue_relaxes_after_a_step_by_its_exponentials(unit):
    stage = warm(np.concatenate(([20.0], np.full(40000, 30.0))), "spool")
    stress = signal(unit, stage, "creeping_glue")
    fastest = 400.0 + 500.0 * unit.draw["a"]
    weights = np.exp(-0.6 * unit.draw["form"] * np.arange(3))
    expected = weights @ np.exp(-1000.0 / (fastest * 3.0 ** np.arange(3))) / weights.sum()
    assert stress[1000] == pytest.approx(10.0 * expected, rel=1e-3)
    assert abs(stress[-1]) < 0.1


def test_friction_does_not_care_how_fast_a_loop_is_and_keeps_its_sign_to_the_end(unit):
    path = np.concatenate((np.linspace(20.0, 60.0, 400), np.linspace(60.0, 20.0, 400)))
    quick = signal(unit, warm(np.repeat(path, 20), "layer4"), "sticking_potting")
    slow = signal(unit, warm(np.repeat(path, 60), "layer4"), "sticking_potting")
    assert quick[::20] == pytest.approx(slow[::60], abs=0.02)
    up, down = quick[200 * 20], quick[600 * 20]
    assert up == pytest.approx(-down, rel=1e-6)
    shares = np.array([0.5, 1.0, 0.5 + unit.draw["g1"]])
    assert up == pytest.approx(shares @ (1.5, 4.0, 9.0) / shares.sum() / 9.0)


# light and electronics ----------------------------------------------------------------------------------------


def test_photon_energy_is_that_of_varshni_for_indium_phosphide():
    kelvin = np.array([250.0, 303.15, 340.0])
    gap_ev = 1.42 - 3.63e-4 * kelvin**2 / (kelvin + 162.0)
    about = 303.15 + np.array([-0.01, 0.01])
    slope = np.diff(-3.63e-4 * about**2 / (about + 162.0))[0] / 0.02
    assert effects.photon_energy(kelvin - 273.15) == pytest.approx(
        (gap_ev - gap_ev[1]) / abs(slope), rel=1e-5
    )


def test_a_leaking_cooler_changes_the_scale_factor_by_the_can_and_nothing_at_the_set_point(unit):
    stage = turning(10.0, can=bench.SET_C + 1.0)
    changed = signal(unit, stage, "leaking_cooler", 50.0)
    assert changed == pytest.approx(-50e-6 * 3600.0 * (10.0 + EARTH_DPS), rel=2e-3)
    assert signal(unit, turning(10.0, can=bench.SET_C), "leaking_cooler") == pytest.approx(0.0, abs=1e-9)


def test_the_modulator_changes_the_scale_factor_by_its_size_over_fifty_kelvins(unit):
    changed = signal(unit, turning(20.0, spool=75.0), "modulator_depth", 300.0)
    assert np.abs(changed) == pytest.approx(300e-6 * 3600.0 * (20.0 + EARTH_DPS), rel=1e-6)


@pytest.mark.parametrize("rate_dps", [5.0, 40.0, -100.0])
def test_an_arcsine_of_too_large_a_sine_reads_too_much_by_a_tangent(unit, rate_dps):
    error, per_dps = 20e-6, (0.8 + 0.2 * unit.draw["form"]) / 100.0
    rate = rate_dps + EARTH_DPS
    exact = 3600.0 * (math.asin((1.0 + error) * math.sin(per_dps * rate)) / per_dps - rate)
    assert signal(unit, turning(rate_dps), "sine_response", 20.0) == pytest.approx(exact, rel=1e-4)


def test_the_table_ends_and_its_last_value_stays(unit):
    for rate in (70.0, -95.0):
        read = 3600.0 * (rate + EARTH_DPS) + signal(unit, turning(rate), "table_end", 40.0)
        assert read == pytest.approx(math.copysign(3600.0 * (60.0 + EARTH_DPS), rate))
    assert signal(unit, turning(50.0), "table_end", 40.0) == pytest.approx(0.0)
    assert signal(unit, turning(100.0), "table_end", 0.001) == pytest.approx(-3.6, rel=1e-6)


def test_a_rectifier_parts_the_signs_by_its_size(unit):
    up = signal(unit, turning(50.0 - EARTH_DPS), "rectifier", 100.0)
    down = signal(unit, turning(-50.0 - EARTH_DPS), "rectifier", 100.0)
    assert up == pytest.approx(down, rel=1e-9)
    assert up == pytest.approx(0.5 * 100e-6 * 50.0 * 3600.0, rel=1e-4)


def test_a_converter_stands_still_below_its_threshold_and_counts_all_well_above(unit):
    for dps, left in ((0.0005, -0.0005), (-0.0005, 0.0005), (0.01, 0.0)):
        stage = turning(dps - EARTH_DPS)
        assert signal(unit, stage, "dead_converter", 9.0) == pytest.approx(3600.0 * left, abs=1e-3)


def test_the_pick_up_is_at_its_size_at_power_on_and_gone_in_the_end(unit):
    lukewarm = signal(unit, still(20000), "warming_pick_up", 30.0)
    assert lukewarm[0] == pytest.approx(-30.0, rel=0.02)
    assert (np.diff(lukewarm) > 0.0).all()
    assert abs(lukewarm[-1]) < 1e-3


def test_the_bridge_changes_back_half_a_kelvin_lower(unit):
    up, down = np.linspace(0.0, 50.0, 50001), np.linspace(50.0, 0.0, 50001)
    there = signal(unit, warm(up, "can"), "bridge_flip", 8.0)
    back = signal(unit, warm(down, "can"), "bridge_flip", 8.0)
    # both are late by the follower's half time
    apart = up[np.argmax(there > 4.0)] - down[np.argmax(back < 4.0)]
    assert apart == pytest.approx(0.5, abs=0.02)
    assert (there[0], there[-1]) == pytest.approx((0.0, 8.0))


# table and surroundings ---------------------------------------------------------------------------------------


def test_the_shield_keeps_the_sense_of_the_last_turn_and_loses_it(unit):
    rates = np.concatenate((np.full(600, -20.0), np.zeros(6000)))
    left = signal(unit, turning(rates, len(rates)), "remanence", 3.0)
    fades = 150.0 + 450.0 * unit.draw["c1"]
    assert left[599] == pytest.approx(-3.0, rel=2e-3)
    assert left[-1] == pytest.approx(left[599] * math.exp(-600.0 / fades), rel=1e-6)


def test_the_cable_pulls_by_all_turns_oddly_after_some_slack(unit):
    one, other = (signal(unit, turning(rate), "wound_cable") for rate in (10.0, -10.0))
    assert one == pytest.approx(-other)
    # 400 s at 10 deg/s are 11 turns
    assert one[-1] == pytest.approx(
        math.tanh(0.2 * (4000.0 / 360.0 - 1.0 - 2.0 * unit.draw["lean"])), rel=2e-3
    )


def test_the_spool_resonates_at_one_speed_alike_in_both_directions(unit):
    own = 27.0 + 6.0 * unit.draw["order"]
    at = [float(signal(unit, turning(rate), "spool_resonance")[0]) for rate in (0.93 * own, own, -1.07 * own)]
    assert at[0] > 2.0 > abs(at[1]) > at[2]
    assert at[2] == pytest.approx(float(signal(unit, turning(1.07 * own), "spool_resonance")[0]))


def test_dew_needs_cold_and_dries_in_the_warm(unit):
    stage = warm(np.concatenate((np.full(3000, -20.0), np.full(6000, 50.0))), "base")
    film = signal(unit, stage, "dew")
    assert film[2999] > 0.5
    assert film[-1] == 0.0
    assert signal(unit, warm(np.full(100, 60.0), "base"), "dew") == pytest.approx(0.0)


def test_stated_misalignment_and_lateness_mean_what_the_catalogue_means(unit, stages):
    for name in ("misalignment", "late_samples"):
        assert share_of_the_column(DEPOLARISED, unit, stages, name) == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("name", DEPOLARISED.effects)
def test_effects_differ_between_repeats_only_where_they_say_so(unit, stages, name):
    apart, whole = repeats_apart(DEPOLARISED, unit, stages, name)
    assert whole > 0.0
    assert DEPOLARISED.effects[name].changing == (apart > 0.04)


# noise --------------------------------------------------------------------------------------------------------


def test_a_null_unit_has_the_white_noise_and_the_wander_of_its_sheet():
    taus = np.array([4.0, 16.0, 64.0])
    found = deviations(DEPOLARISED, taus, 14400, 0.5)
    sheet = bench.SHEET
    white = 60.0 * sheet.arw_deg_per_sqrt_h / np.sqrt(taus)
    flicker = sheet.bias_instability_dph * math.sqrt(2.0 * math.log(2.0) / math.pi)
    quantum = sheet.quantum_arcsec / np.sqrt(4.0) / taus
    walk = sheet.rate_random_walk_dph_per_sqrt_h * np.sqrt(taus / 3600.0 / 3.0)
    expected = np.sqrt(white**2 + flicker**2 + quantum**2 + walk**2)
    assert found == pytest.approx(expected, rel=0.08)


def test_a_dim_source_is_noisier_by_its_factor():
    stage = still(7200, 0.5)
    rows = [
        bench.rows_dph(draw_unit(DEPOLARISED, 5, inside), stage, np.zeros(7200), np.random.default_rng(3))
        for inside in ({}, {"dim_source": 3.0})
    ]
    assert np.std(rows[1]) / np.std(rows[0]) == pytest.approx(3.0, rel=0.05)


def test_files_of_a_null_case_hold_nothing_but_the_noise_of_the_sheet(tmp_path):
    residual = null_residual(DEPOLARISED, tmp_path, 77)
    assert np.mean(residual**2) == pytest.approx(1.0, abs=0.06)


def test_an_upright_axis_senses_the_table_and_the_vertical_earth_rate(stages):
    stage = run(stages, "RR")
    sensed = sensed_dph(stage, bench.LATITUDE_DEG)
    assert sensed - 3600.0 * stage.rate_dps == pytest.approx(3600.0 * EARTH_DPS, abs=1e-6)
