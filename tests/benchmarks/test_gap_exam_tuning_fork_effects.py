"""Effects of the tuning-fork gyros against closed forms."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad, solve_ivp

from benchmarks.gap_exam import _tuning_fork_bench as bench
from benchmarks.gap_exam import _tuning_fork_effects as effects
from benchmarks.gap_exam import _tuning_fork_foreign as foreign
from benchmarks.gap_exam._make import draw_unit
from benchmarks.gap_exam._tuning_fork import TUNING_FORK
from tests.gap_families import still

EARTH_DPH = 15.041067


@pytest.fixture(scope="module")
def unit():
    return draw_unit(TUNING_FORK, 5, {})


def at_temperature(bodies_c, step_s=1.0, **changed):
    """A run at rest in which every body has given temperatures (m,)."""
    values = np.asarray(bodies_c, float)
    bodies = dict.fromkeys((*bench.BODIES, "air", "demand"), values)
    return still(len(values), step_s, bodies_c=bodies, **changed)


def turning(rates_dps, step_s=1.0, celsius=25.0):
    """A run with the axis up at rates (m,) in each step."""
    rates = np.asarray(rates_dps, float)
    return replace(
        at_temperature(np.full(len(rates), celsius), step_s),
        angle_deg=np.concatenate(([0.0], np.cumsum(rates * step_s))),
        elevation_deg=np.full(len(rates), 90.0),
    )


def in_air(air_c, step_s=1.0, powered_s=math.inf):
    """A run in which the bodies follow the air (m,)."""
    air = np.asarray(air_c, float)
    bodies = {**bench.bodies(air, step_s, powered_s), "air": air, "demand": air}
    return still(len(air), step_s, bodies_c=bodies)


def ramp_lags_s():
    """How far each body is behind a steady ramp of the air, s: conductances' matrix against capacities."""
    names = list(bench.BODIES)
    matrix = np.zeros((5, 5))
    for k, _ in enumerate(names):
        for pair, conductance in bench.CONDUCTANCE_W_PER_K.items():
            if names[k] in pair:
                matrix[k, k] += conductance
                other = pair[0] if pair[1] == names[k] else pair[1]
                if other != "air":
                    matrix[k, names.index(other)] -= conductance
    return dict(zip(names, np.linalg.solve(matrix, list(bench.CAPACITY_J_PER_K.values())), strict=True))


# --- bias by temperature, strain and time ---


def test_quadrature_has_neither_value_nor_slope_on_the_factorys_bench(unit):
    growth, bend = 0.3 + 0.5 * unit.draw["a"], unit.draw["b"] - 0.5
    cold, below, there, above, hot = effects.quadrature(
        unit, at_temperature([-25.0, 24.9, 25.0, 25.1, 75.0]), 100.0
    )
    assert there == pytest.approx(0.0, abs=1e-12)
    assert above - below == pytest.approx(0.0, abs=1e-4)
    # (1 + growth x)(x + bend x^2) - x for a phase that is its own sine
    assert hot + cold == pytest.approx(200.0 * (growth + bend), rel=0.01, abs=0.05)
    assert hot - cold == pytest.approx(200.0 * growth * bend, rel=0.01, abs=0.05)


def test_package_stress_is_a_loop_as_wide_as_its_plays(unit):
    up_down = 25.0 + 45.0 * np.interp(np.arange(4000), [0, 500, 1500, 2500, 3500], [0, 1, -1, 1, -1])
    signal = effects.package_stress(unit, at_temperature(up_down, 5.0), 2.0)
    rising, falling = 2000, 3000
    assert abs(up_down[rising] - up_down[falling]) < 0.2
    # a play wider than half of the swing is not yet pushed in its middle
    plays = np.array(effects.PLAY_K)
    width = 2.0 * 2.0 * np.dot(effects.PLAY_WEIGHTS, np.minimum(plays, 45.0 - plays))
    assert signal[falling] - signal[rising] == pytest.approx(width, rel=0.01)
    # within the least play nothing moves
    small = effects.package_stress(unit, at_temperature(25.0 + 2.9 * np.sin(np.arange(400) / 20.0), 5.0), 2.0)
    assert np.ptp(small) == 0.0


def test_an_adhesive_gives_way_as_its_spectrum(unit):
    step = np.where(np.arange(4000) < 1, 25.0, 35.0)
    signal = effects.die_attach(unit, at_temperature(step), 3.0)
    for at in (300, 3000):
        left = np.dot(effects.ATTACH_WEIGHTS, np.exp(-at / np.array(effects.ATTACH_S)))
        assert signal[at] == pytest.approx(3.0 * 10.0 * left, rel=5e-3)
    assert signal[0] == 0.0


def test_the_fork_is_behind_the_asic_by_their_own_time_constants(unit):
    ramp = in_air(-30.0 + 0.05 * np.arange(20_000) / 10.0)
    behind = effects.element_lag(unit, ramp, 4.0)
    fork_s, asic_s = 0.004 / 1.2e-4, 0.02 / 0.012
    assert behind[0] == pytest.approx(0.0, abs=0.03)
    assert behind[-1] == pytest.approx(-4.0 * 0.005 * (fork_s - asic_s), rel=1e-3)


def test_the_package_bends_only_while_temperatures_change(unit):
    lags = ramp_lags_s()
    assert effects.lid_gradient(unit, in_air(np.full(5, -30.0)), 7.0) == pytest.approx(np.zeros(5), abs=1e-9)
    bent = effects.lid_gradient(unit, in_air(-30.0 + 0.005 * np.arange(20_000)), 7.0)
    assert bent[-1] == pytest.approx(7.0 * 0.005 * (lags["fixture"] - lags["package"]), rel=1e-3)
    assert bent[-1] > 0.1


def test_dielectric_soak_counts_from_power_up(unit):
    first_s = 25.0 + 50.0 * unit.draw["form"]
    soaks = [
        effects.dielectric_soak(unit, at_temperature([25.0], 1e-6, power_on_s=since), 80.0)[0]
        for since in (0.0, first_s, 3.0 * first_s)
    ]
    assert soaks == pytest.approx([80.0, 80.0 * 2.0**-0.8, 80.0 * 4.0**-0.8], rel=1e-6)


def test_two_segments_of_a_table_are_a_step_apart(unit):
    at = effects.TRIM_C[int(4.0 * unit.draw["c1"])]
    below, there, above = effects.trim_segment(unit, at_temperature([at - 8.0, at, at + 8.0]), 30.0)
    assert [below, there, above] == pytest.approx([0.0, 15.0, 30.0], abs=1e-3)


# --- scale factor ---


def test_the_drive_sags_in_the_cold_only(unit):
    knee = -5.0 + 20.0 * unit.draw["a"]
    cold = effects.drive_sag(unit, turning([100.0, -100.0], celsius=knee - 40.0), 5.0)
    assert cold == pytest.approx([-5e-6 * 40.0 * 3.6e5, 5e-6 * 40.0 * 3.6e5], rel=1e-3)
    at_knee = effects.drive_sag(unit, turning([100.0], celsius=knee), 5.0)
    assert at_knee == pytest.approx(-5e-6 * 4.0 * math.log(2.0) * 3.6e5)
    assert np.abs(effects.drive_sag(unit, turning([100.0], celsius=knee + 60.0), 5.0)).max() < 1e-4


def test_a_band_gap_is_a_parabola_about_its_top(unit):
    top_c = 35.0 + 25.0 * unit.draw["b"]

    def gain_ppm(celsius):
        return 1e6 * effects.regulator(unit, turning([50.0], celsius=celsius), 200.0)[0] / (3600.0 * 50.0)

    assert gain_ppm(25.0) == pytest.approx(0.0, abs=1e-9)
    assert gain_ppm(top_c + 30.0) == pytest.approx(gain_ppm(top_c - 30.0))
    assert gain_ppm(top_c) - gain_ppm(top_c + 50.0) == pytest.approx(200.0)


def test_curves_of_the_output(unit):
    rail = 330.0 + 270.0 * unit.draw["c"]
    soft = effects.soft_output(unit, turning([30.0, -30.0, 250.0]), 0.1)
    # tanh x = x - x^3 / 3 + 2 x^5 / 15
    assert soft[0] == pytest.approx(
        -360.0 * rail * ((30 / rail) ** 3 / 3 - 2 * (30 / rail) ** 5 / 15), rel=1e-4
    )
    assert soft[1] == -soft[0]
    both = 3.0 + 9.0 * unit.draw["form"]
    lopsided = effects.class_ab(unit, turning([0.0, 200.0, -200.0, 0.01]), 50.0)
    assert (
        lopsided[1]
        == lopsided[2]
        == pytest.approx(50e-6 * 3600.0 * (200.0 - both), rel=2e-3, abs=0.01 * both)
    )
    assert lopsided[0] == 0.0 and lopsided[3] < 1e-5


def test_a_converter_clips_the_mean_of_a_noisy_output(unit):
    width = effects.WIDEBAND_DPS

    def cut(z, above):
        return max(above + width * z, 0.0) * math.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)

    for above in (-0.7, 0.0, 0.3, 5.0):
        expected, _ = quad(cut, max(-above / width, -9.0), 9.0, args=(above,))
        assert effects.clipped(np.array([above]))[0] == pytest.approx(expected, rel=1e-6)
    upper = effects.CLIP_FROM_DPS * 0.8
    lower = upper * (1.0 - 0.01 * unit.draw["lean"])
    rate = np.array([245.0, -245.0, 150.0])
    seen = rate + effects.converter_clip(unit, turning(rate), 0.2) / 3600.0
    assert seen == pytest.approx([upper, -lower, 150.0], abs=1e-6)


# --- motion ---


def test_shaking_grows_by_the_square_and_rings_at_a_speed_of_the_fixture(unit):
    ringing = 60.0 + 150.0 * unit.draw["phase"]
    there, far, opposite = effects.bearing_vibration(unit, turning([ringing, 2e4, -2e4]), 6.0)
    assert there == pytest.approx(6.0 * 4.0 * (ringing / 100.0) ** 2)
    assert far == opposite == pytest.approx(6.0 * 200.0**2, rel=1e-4)
    aside = effects.bearing_vibration(unit, turning([ringing + 12.0]), 6.0)
    assert aside == pytest.approx(6.0 * 2.5 * ((ringing + 12.0) / 100.0) ** 2)


def test_tines_feel_gravity_along_the_axis_and_across_it(unit):
    positions = at_temperature([25.0] * 4, elevation_deg=np.array([90.0, 0.0, -90.0, 45.0]))
    up, level, down, oblique = effects.tine_imbalance(unit, positions, 20.0)
    assert math.hypot(up, level) == pytest.approx(20.0)
    assert down == pytest.approx(-up)
    assert oblique == pytest.approx((up + level) / math.sqrt(2.0))


def test_a_slow_filter_is_late_by_both_its_poles(unit):
    step_s = 0.05
    speeding = turning(100.0 * (np.arange(200) + 0.5) * step_s, step_s)
    for time_s in (0.004, 0.1):
        late = effects.output_filter(unit, speeding, time_s)
        assert late[-1] == pytest.approx(-2.0 * time_s * 100.0 * 3600.0, rel=1e-3)
    # a step of the rate: the mean of 1 - exp(-t / T) over the first step
    rate = np.where(np.arange(50) < 1, 0.0, 1.0)
    first = effects.low_pass(rate, 0.08, step_s)[1]
    assert first == pytest.approx(1.0 - 0.08 / step_s * (1.0 - math.exp(-step_s / 0.08)))


def test_a_beat_has_its_frequency_and_another_start_in_every_run(unit):
    frequency = 0.05 + 0.2 * unit.draw["order"] + effects.BEAT_HZ_PER_K * 10.0
    run = at_temperature(np.full(20_000, 35.0), 0.5)
    beat = effects.neighbour_beat(unit, run, 4.0)
    rises = np.count_nonzero((beat[1:] >= 0.0) & (beat[:-1] < 0.0))
    assert rises == pytest.approx(frequency * 10_000.0, abs=1.0)
    # the mean of a sine over 0.5 s
    expected = 4.0 * math.sin(math.pi * frequency * 0.5) / (math.pi * frequency * 0.5)
    assert beat.std() * math.sqrt(2.0) == pytest.approx(expected, rel=1e-3)
    other = effects.neighbour_beat(unit, replace(run, repeat=1), 4.0)
    assert np.abs(other - beat).max() > 0.1


# --- foreign ---


def test_water_follows_the_chambers_humidity_by_its_own_clock(unit):
    # Magnus beside the tables: 23.4 hPa at 20 degC, 6.11 hPa at 0 degC
    assert foreign.saturation_hpa(np.array([20.0, 0.0])) == pytest.approx([23.37, 6.11], rel=2e-3)
    dew_c = 4.0 + 10.0 * unit.draw["c2"]
    in_lab = foreign.saturation_hpa(dew_c) / foreign.saturation_hpa(22.0)
    in_oven = foreign.saturation_hpa(dew_c) / foreign.saturation_hpa(70.0)
    oven = foreign.humid_package(unit, at_temperature(np.full(4000, 70.0)), 100.0)
    arrhenius = math.exp(0.5 / 8.617333e-5 * (1.0 / 343.15 - 1.0 / 298.15))
    for at in (100, 1500, 3999):
        dried = 1.0 - math.exp(-(at + 1.0) / (9000.0 * arrhenius))
        assert oven[at] == pytest.approx(100.0 * float(in_oven - in_lab) * dried, rel=2e-3)
    # frozen: towards saturation, but hardly at all
    frozen = foreign.humid_package(unit, at_temperature(np.full(4000, -30.0)), 100.0)
    assert 0.0 < frozen[-1] < 100.0 * float(1.0 - in_lab) * 4000.0 / 9000.0 / 50.0


def test_water_in_a_changing_chamber_is_that_of_its_differential_equation(unit):
    air = 30.0 + 40.0 * np.sin(np.arange(9000) / 1500.0)
    dew_c = 4.0 + 10.0 * unit.draw["c2"]
    dew = foreign.saturation_hpa(dew_c)

    def slope(time_s, water):
        here = np.interp(time_s, np.arange(9000) + 0.5, air)
        return (min(float(dew / foreign.saturation_hpa(here)), 1.0) - water) / foreign.uptake_s(here)

    start = float(dew / foreign.saturation_hpa(22.0))
    solved = solve_ivp(slope, (0.0, 9000.0), [start], t_eval=np.arange(1.0, 9001.0), max_step=20.0)
    found = foreign.humid_package(unit, at_temperature(air), 1.0)
    np.testing.assert_allclose(found, solved.y[0] - start, atol=2e-3)


def test_a_crossing_mode_answers_in_phase_and_out_of_phase(unit):
    at, width = -20.0 + 85.0 * unit.draw["c2"], 1.5 + 2.5 * unit.draw["a"]
    mixed = math.pi * unit.draw["phase"]
    there, one_up, one_down, far = foreign.mode_crossing(
        unit, at_temperature([at, at + width, at - width, at + 1e5 * width]), 50.0
    )
    assert there == pytest.approx(50.0 * math.sin(mixed))
    assert one_up - one_down == pytest.approx(50.0 * math.cos(mixed))
    assert one_up + one_down == pytest.approx(50.0 * math.sin(mixed))
    assert abs(far) < 1e-2


def test_a_trim_word_changes_only_where_the_asic_passes_its_temperature(unit):
    at = 15.0 + 25.0 * unit.draw["tilt"]
    passing = at + 10.0 * np.cos(np.arange(8000) * math.pi / 100.0)
    words = foreign.latched_trim(unit, at_temperature(passing), 12.0)
    assert set(words.tolist()) == {-6.0, 6.0}
    changes = np.flatnonzero(np.diff(words)) + 1
    # 80 passages, half of which draw the other word
    assert 25 <= len(changes) <= 55
    beyond = np.abs(passing[changes] - at)
    assert (beyond > foreign.LATCH_K).all() and (beyond < foreign.LATCH_K + 0.5).all()
    other = foreign.latched_trim(unit, replace(at_temperature(passing), repeat=1), 12.0)
    assert 0.2 < (other != words).mean() < 0.8
    shivering = at + 0.9 * np.cos(np.arange(500))
    assert np.ptp(foreign.latched_trim(unit, at_temperature(shivering), 12.0)) == 0.0


def test_the_supply_sags_with_the_compressor_most_at_its_start(unit):
    run = at_temperature(np.full(60_000, -25.0), 0.5)
    sag = foreign.compressor_supply(unit, run, 10.0)
    assert sag.mean() == pytest.approx(10.0 * 0.7, rel=0.01)
    runs = bench.compressor_runs(np.full(60_000, -25.0), 0.5, bench.compressor_phase_s(unit, run.key))
    starts = np.flatnonzero(np.diff(runs) > 0.0) + 1
    after = np.mean([sag[start : start + 200] for start in starts[:-1]], axis=0)
    # 3 s and 20 s in series: the surge decays by the slower one
    assert after.max() > 12.0 and after[199] == pytest.approx(10.0, abs=0.1)
    hot = foreign.compressor_supply(unit, at_temperature(np.full(500, 60.0)), 10.0)
    assert np.abs(hot).max() == 0.0


def test_charge_of_past_rates_comes_back(unit):
    rates = np.where(np.arange(4000) < 2000, 120.0, 0.0)
    rates[0] = 0.0
    tail = foreign.charge_tail(unit, turning(rates), 1e-4)
    assert tail[1999] == pytest.approx(43.2, rel=1e-4)
    for since in (10, 200):
        left = np.dot(foreign.TAIL_WEIGHTS, np.exp(-since / np.array(foreign.TAIL_S)))
        assert tail[1999 + since] == pytest.approx(43.2 * left, rel=1e-3)


def test_earth_alone_does_nothing_to_the_scale_factor(unit):
    """At rest none of the effects of the rate says anything."""
    rest = turning(np.zeros(20))
    for name in ("drive_sag", "regulator", "soft_output", "class_ab", "bearing_vibration", "charge_tail"):
        assert np.abs(TUNING_FORK.effects[name].signal(unit, rest, 1.0)).max() < 1e-9, name
    assert np.abs(effects.output_filter(unit, rest, 0.1)).max() < 1e-6 * EARTH_DPH
