"""Metal cylinder gyros: what table, heat, drive, mount and node do, against closed forms and limits."""

import math

import numpy as np
import pytest

from benchmarks.gap_exam import _cylinder_bench as bench
from benchmarks.gap_exam import _cylinder_effects as effects
from benchmarks.gap_exam._cylinder import CYLINDER
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._make import draw_unit
from benchmarks.gap_exam._signals import play
from drivers.base.constants import earth_rate_up_dph
from tests.gap_families import repeats_apart, run, still


@pytest.fixture(scope="module")
def unit():
    return draw_unit(CYLINDER, 5, {})


@pytest.fixture(scope="module")
def stages(unit):
    return CYLINDER.campaign(unit)


def signal(unit, stage, name, size=1.0):
    return CYLINDER.effects[name].signal(unit, stage, size)


def turning(rates_dps, step_s=0.125, **changed):
    """A run, axis up, at rates (n,) in room air."""
    n = len(rates_dps)
    fields = {
        "angle_deg": np.concatenate(([0.0], np.cumsum(rates_dps) * step_s)),
        "elevation_deg": np.full(n, 90.0),
        "bodies_c": {"metal": np.full(n, 25.0), "housing": np.full(n, 25.0)},
    }
    return still(n, step_s, **{**fields, **changed})


def at_rates(rates_dps):
    """A run whose sensed rates, with the Earth's, are the given ones, deg/s."""
    return turning(np.asarray(rates_dps) - earth_rate_up_dph(bench.LATITUDE_DEG) / 3600.0)


# the maker's table --------------------------------------------------------------------------------------------


def test_the_tables_residue_is_nought_at_the_makers_points_and_bends_between(unit):
    t = np.linspace(-40.0, 80.0, 1201)
    left = signal(unit, still(1201, t_in_c=t), "between_factory_points")
    np.testing.assert_allclose(left[[0, 600, 1200]], 0.0, atol=1e-12)
    # away from the points the second derivative is that of the peak itself, as a line has none
    peak = effects.loss_peak(t, 1.0, 260.0 + 65.0 * unit.draw["a"], 3200.0 + 2300.0 * unit.draw["form"])
    bends = np.diff(left - peak, 2)
    np.testing.assert_allclose(np.delete(bends, 599), 0.0, atol=1e-12)


def test_the_loss_peak_has_half_its_height_where_the_closed_form_says():
    half = 1.0 / (1.0 / 290.0 + math.acosh(2.0) / 4000.0) - 273.15
    assert effects.loss_peak(np.array([half]), 1.0, 290.0, 4000.0)[0] == pytest.approx(0.5)


def test_piezo_gain_is_proportional_to_rate_and_has_its_slope_at_25_degrees(unit):
    def gained(metal_c, rate):
        stage = turning(np.full(8, rate), bodies_c={"metal": np.full(8, metal_c)})
        return signal(unit, stage, "piezo_gain")[0] / sensed_dph(stage, bench.LATITUDE_DEG)[0]

    assert gained(25.0, 50.0) == pytest.approx(0.0, abs=1e-18)
    assert (gained(25.01, 50.0) - gained(24.99, 50.0)) / 0.02 == pytest.approx(1e-6, rel=1e-3)
    assert gained(60.0, 50.0) == pytest.approx(gained(60.0, -20.0), rel=1e-9)
    assert gained(60.0, 1.0) > 35e-6 and gained(-10.0, 1.0) > -35e-6


@pytest.mark.parametrize("name", ["late_gain", "metal_behind_bead", "pyroelectric_charge"])
def test_what_heat_does_late_is_gone_in_a_steady_unit(unit, name):
    n = 400
    bodies = {"metal": np.full(n, 40.0), "housing": np.full(n, 40.0)}
    stage = turning(np.full(n, 30.0), bodies_c=bodies, t_in_c=np.full(n, 40.0 + bench.BEAD_HEAT_K))
    np.testing.assert_allclose(signal(unit, stage, name), 0.0, atol=1e-9)


def test_pyroelectric_charge_of_a_long_ramp_is_its_slope(unit):
    n = 6000
    metal = 20.0 + 2.0 * np.arange(n) * 0.125 / 60.0
    ramp = signal(unit, turning(np.zeros(n), bodies_c={"metal": metal}), "pyroelectric_charge")
    assert ramp[-1] == pytest.approx(2.0, rel=5e-3)
    down = signal(unit, turning(np.zeros(n), bodies_c={"metal": 40.0 - metal}), "pyroelectric_charge")
    np.testing.assert_allclose(down, -ramp, atol=1e-9)


def test_a_warped_base_has_its_size_for_each_kelvin_between_it_and_the_plate(unit):
    bodies = {
        "board": np.array([30.0, 20.0]),
        "housing": np.array([20.0, 20.0]),
        "plate": np.array([20.0, 25.0]),
    }
    np.testing.assert_allclose(signal(unit, still(2, bodies_c=bodies), "warped_base", 3.0), [15.0, -15.0])


def test_the_coarse_table_has_no_mean_over_whole_cells_and_steps_by_its_size(unit):
    cell_k = 6.0 + 6.0 * unit.draw["c"]
    t = 10.0 + cell_k * 3.0 * (np.arange(30_000) + 0.5) / 30_000
    values = signal(unit, still(30_000, t_in_c=t), "coarse_table", 4.0)
    assert values.mean() == pytest.approx(0.0, abs=1e-3)
    steps = np.diff(values)
    assert (steps < -3.9).sum() == 3 and np.ptp(values) == pytest.approx(4.0, rel=1e-3)


# heat and its memory ------------------------------------------------------------------------------------------


def test_glue_relaxes_exponentially_at_25_degrees_and_faster_in_heat_by_arrhenius():
    def left_after(t_c, seconds):
        values = np.concatenate(([t_c - 1.0], np.full(seconds, t_c)))
        strain = effects.relaxed_strain(values, 1.0, 1200.0, 4000.0)
        return math.log(strain[1] / strain[-1]) / (seconds - 1)

    assert left_after(25.0, 900) == pytest.approx(1.0 / 1200.0, rel=1e-6)
    ratio = left_after(55.0, 900) / left_after(25.0, 900)
    assert ratio == pytest.approx(math.exp(4000.0 * (1.0 / 298.15 - 1.0 / 328.15)), rel=1e-6)


def test_glue_on_a_slow_ramp_holds_slope_times_time_constant_and_forgets_it():
    ramp = 25.0 + 1e-5 * np.arange(20_000)
    strain = effects.relaxed_strain(ramp, 1.0, 1000.0, 0.0)
    assert strain[-1] == pytest.approx(1e-5 * 1000.0, rel=1e-6)
    rest = effects.relaxed_strain(np.concatenate((ramp, np.full(20_000, ramp[-1]))), 1.0, 1000.0, 0.0)
    assert abs(rest[-1]) < 1e-8 * strain[-1] + 1e-10


def test_a_play_has_a_loop_of_twice_its_half_width_however_slow():
    there = np.linspace(0.0, 50.0, 501)
    cycle = np.concatenate((there, there[::-1], there))
    dragged = play(cycle, 5.0)
    # at 25 degC: on the way down, and up again
    assert dragged[501 + 250] - dragged[1002 + 250] == pytest.approx(10.0)
    slow = play(np.repeat(cycle, 3), 5.0)
    np.testing.assert_array_equal(slow[::3], dragged)


def test_magnetic_damping_is_a_loop_between_its_limits(unit, stages):
    stage = run(stages, "CY")
    values = signal(unit, stage, "magnetic_damping")
    assert values.min() == pytest.approx(-1.0) and values.max() == pytest.approx(1.0)
    metal = stage.body("metal")
    swap = [np.flatnonzero(np.diff(np.sign(metal - 20.0)) == way)[-1] for way in (-2.0, 2.0)]
    assert values[swap[0]] > 0.8 and values[swap[1]] < -0.8


def test_the_range_switches_up_above_and_down_below_and_stays_between():
    state = effects.switched(np.array([9.9, 10.4, 10.6, 10.1, 9.6, 9.4, 10.4]), 10.0, 1.0)
    np.testing.assert_array_equal(state, [0.0, 0.0, 1.0, 1.0, 1.0, 0.0, 0.0])
    np.testing.assert_array_equal(effects.switched(np.array([10.2, 10.3]), 10.0, 1.0), [1.0, 1.0])


def test_repoling_is_whole_at_power_on_and_a_power_law_late(unit):
    exponent = 0.7 + 0.8 * unit.draw["form"]
    assert signal(unit, still(1, 1e-6), "repoling")[0] == pytest.approx(1.0)
    late = [signal(unit, still(1, 1e-6, power_on_s=t), "repoling")[0] for t in (1e6, 1e7)]
    assert late[1] / late[0] == pytest.approx(10.0**-exponent, rel=1e-3)


def test_a_mode_crossing_is_odd_about_its_centre_and_has_its_size_a_width_away(unit):
    centre = -5.0 + 50.0 * unit.draw["order"]
    x = np.array([-3.0, -1.0, 0.0, 1.0, 3.0]) * (2.0 + 3.0 * unit.draw["c"])
    values = signal(unit, still(5, bodies_c={"metal": centre + x}), "mode_crossing")
    np.testing.assert_allclose(values, [-0.6, -1.0, 0.0, 1.0, 0.6], atol=1e-9)


def test_heat_of_the_motor_is_even_in_rate_and_comes_to_its_size_and_goes(unit):
    rate = np.concatenate((np.full(40_000, 100.0), np.zeros(60_000)))
    rate[0] = 0.0
    warm, other = (signal(unit, turning(sense * rate), "motor_heat") for sense in (1.0, -1.0))
    assert warm[39_999] == pytest.approx(1.0, rel=2e-3) and abs(warm[-1]) < 1e-4
    np.testing.assert_allclose(warm, other, atol=1e-12)


# drive --------------------------------------------------------------------------------------------------------


def test_the_drive_limits_both_senses_alike_and_nothing_below(unit):
    stage = at_rates([-250.0, -100.0, 0.0, 100.0, 250.0])
    limit = 3600.0 * effects.STRONGEST_DPS * 0.8
    rate = sensed_dph(stage, bench.LATITUDE_DEG)
    found = signal(unit, stage, "drive_limit", 0.2) + rate
    np.testing.assert_allclose(found, [-limit, *rate[1:4], limit], rtol=1e-9)


def test_small_rates_give_nothing_and_large_ones_all(unit):
    rates_dps = np.array([-50.0, -3.0, -0.2, 0.2, 3.0, 50.0]) * 36.0 / 3600.0
    stage = at_rates(rates_dps)
    lost = -signal(unit, stage, "dead_band", 36.0) / (3600.0 * rates_dps)
    np.testing.assert_allclose(lost, [0.0, 0.0, 1.0, 1.0, 0.0, 0.0], atol=0.07)
    assert effects.ignored(np.array([36.0]), 36.0, 0.2)[0] == pytest.approx(0.5, abs=1e-6)


def test_rayleigh_drive_is_odd_in_rate_and_full_beyond_its_rate(unit):
    stage = at_rates([-1e5, -1e-3, 1e-3, 1e5])
    ppm = 1e6 * signal(unit, stage, "rayleigh_drive") / sensed_dph(stage, bench.LATITUDE_DEG)
    np.testing.assert_allclose(ppm, [1.0, 0.0, 0.0, 1.0], atol=5e-3)


def test_push_and_pull_is_even_in_rate_and_half_the_difference_far_out(unit):
    stage = at_rates([-1e4, -20.0, 0.0, 20.0, 1e4])
    values = signal(unit, stage, "push_and_pull")
    np.testing.assert_allclose(values[:2], values[:2:-1], rtol=1e-9)
    assert values[2] == pytest.approx(0.0, abs=1e-9)
    assert values[4] == pytest.approx(0.5e-6 * 3.6e7, rel=2e-3)


def test_the_supplys_ripple_is_one_line_of_its_amplitude(unit):
    n = 80_000
    values = signal(unit, still(n, 0.125), "supply_ripple", 3.0)
    power = np.abs(np.fft.rfft(values * np.hanning(n))) ** 2
    line_hz = 0.02 * 20.0 ** unit.draw["b"]
    at = round(line_hz * n * 0.125)
    assert power[at - 3 : at + 4].sum() > 0.999 * power.sum()
    assert np.mean(values**2) == pytest.approx(4.5, rel=1e-2)


def test_electrodes_give_back_what_they_soaked_up_with_the_sign_of_the_rate(unit):
    rate = np.concatenate(([0.0], np.full(60_000, 100.0), np.zeros(80_000)))
    values, other = (signal(unit, turning(way * rate), "soaked_electrodes") for way in (1.0, -1.0))
    assert values[60_000] == pytest.approx(1.0, abs=1e-3) and 0.0 < values[60_400] < 1.0
    # the longest soak is left in the end, e-fold by e-fold
    assert values[-1] / values[-7681] == pytest.approx(math.exp(-1.0), rel=1e-3)
    np.testing.assert_allclose(values, -other, atol=1e-12)


# mount, field, node -------------------------------------------------------------------------------------------


def test_sag_changes_sign_with_the_axis_and_is_nought_when_it_is_level(unit):
    bodies = {"metal": np.full(3, 25.0)}
    stage = still(3, elevation_deg=np.array([90.0, 0.0, -90.0]), bodies_c=bodies)
    np.testing.assert_allclose(signal(unit, stage, "sag", 2.0), [2.0, 0.0, -2.0], atol=1e-12)


def test_the_alloy_feels_a_weak_field_as_it_is_and_a_turned_axis_with_the_other_sign(unit):
    turn = np.linspace(0.0, 2.0 * np.pi, 720, endpoint=False)
    level = effects.magnetised(turn, np.zeros(720), unit)
    np.testing.assert_allclose(level, -np.roll(level, 360), atol=1e-12)
    assert level.max() == pytest.approx(math.cos(effects.DIP_RAD), rel=0.15)
    up, down = (effects.magnetised(turn, np.full(720, s * np.pi / 2.0), unit) for s in (1.0, -1.0))
    np.testing.assert_allclose(up, -down, atol=1e-12)
    assert np.ptp(up) < 1e-12


def test_a_node_goes_round_once_in_the_angle_that_its_gain_says(unit):
    gain = 0.36 + 0.08 * unit.draw["a"]
    n = 80_000
    values = signal(unit, at_rates(np.full(n, 1.0)), "wandering_node")
    period_s = 180.0 / gain
    crossings = np.flatnonzero((values[:-1] < 0.0) & (values[1:] >= 0.0)) * 0.125
    np.testing.assert_allclose(np.diff(crossings), period_s, atol=0.3)
    assert np.abs(values).max() == pytest.approx(1.0, abs=1e-6)


def test_a_knock_shifts_bias_at_its_time_and_a_run_without_one_is_still(unit, stages):
    stage = run(stages, "LS")
    values = signal(unit, stage, "knocks")
    begins = np.flatnonzero(np.abs(np.diff(values)) > 0.2) * bench.STEP_S
    np.testing.assert_allclose(begins, [at for name, at in stage.phases if "knock" in name], atol=0.2)
    assert np.ptp(values[stage.time_s < 7200.0]) == 0.0
    assert np.ptp(signal(unit, run(stages, "CY"), "knocks")) == 0.0
    tumbled = signal(unit, run(stages, "TU"), "knocks")
    assert (np.abs(np.diff(tumbled)) > 0.2).sum() == 7


def test_what_changes_differs_between_repeats_and_the_rest_hardly(unit, stages):
    for name, effect in CYLINDER.effects.items():
        share, whole = repeats_apart(CYLINDER, unit, stages, name)
        assert whole > 0.0, name
        if not effect.names or effect.changing:
            assert (share > 0.2) == effect.changing, (name, share)
