"""Gas rate gyros: heat, jet, bridge, table and noise against closed forms, files against the data sheet."""

import math

import allantools
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from benchmarks.gap_exam import _gas_rate_bench as bench
from benchmarks.gap_exam import _gas_rate_effects as effects
from benchmarks.gap_exam._gas_rate import GAS_RATE, SHEET
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._make import draw_unit
from benchmarks.gap_exam._signals import play
from tests.gap_families import deviations, null_residual, repeats_apart, run, share_of_the_column, still


@pytest.fixture(scope="module")
def unit():
    return draw_unit(GAS_RATE, 5, {})


@pytest.fixture(scope="module")
def stages(unit):
    return GAS_RATE.campaign(unit)


def signal(unit, stage, name, size=1.0):
    return GAS_RATE.effects[name].signal(unit, stage, size)


def turning(rate_dps, n=6000, step_s=0.1, **bodies):
    """A run, axis up, on a table of given rates (n,)."""
    angle = np.concatenate(([0.0], np.cumsum(np.broadcast_to(rate_dps, n)) * step_s))
    return still(n, step_s, angle_deg=angle, elevation_deg=np.full(n, 90.0), bodies_c=bodies)


# heat ---------------------------------------------------------------------------------------------------------


def test_heat_of_the_gyro_leaves_into_the_air_and_warms_every_node_as_long():
    rise = bench.heat().warmed(np.array([0.0, 1e7]))
    assert np.abs(rise[:, 0]).max() == 0.0
    assert bench.TO_AIR_W_PER_K @ rise[:, 1] == pytest.approx(bench.HEAT_W.sum(), rel=1e-9)
    # by hand: pump and gas are two nodes between the case and each other
    gas, pump = rise[2:, 1] - rise[1, 1]
    assert 0.12 * gas + 0.03 * (gas - pump) == pytest.approx(0.35, rel=1e-9)
    assert 0.09 * pump + 0.03 * (pump - gas) == pytest.approx(0.60, rel=1e-9)


def test_nodes_follow_the_air_as_the_differential_equation_says():
    step_s, n = 0.5, 4000
    air = 25.0 + 20.0 * np.sin(2.0 * np.pi * np.arange(1, n + 1) * step_s / 900.0)

    def slope(t, temperature_c):
        now = 25.0 + 20.0 * math.sin(2.0 * math.pi * t / 900.0)
        flow = np.array([2.5, 0.06, 0.0, 0.0]) * (now - temperature_c)
        for a, b, conductance in ((0, 1, 0.5), (1, 2, 0.12), (1, 3, 0.09), (2, 3, 0.03)):
            flow[a] += conductance * (temperature_c[b] - temperature_c[a])
            flow[b] += conductance * (temperature_c[a] - temperature_c[b])
        return flow / np.array([1500.0, 120.0, 18.0, 9.0])

    exact = solve_ivp(slope, (0.0, n * step_s), np.full(4, 25.0), t_eval=[700.0, 1999.0], rtol=1e-8)
    found = bench.heat().followed(air, step_s)[:, [1399, 3997]]
    np.testing.assert_allclose(found, exact.y, atol=0.06)


def test_the_bead_lags_behind_a_ramp_by_its_time_constant(stages):
    stage = run(stages, "RL")
    # near the end of the ramp up, where everything has the ramp's slope
    at = int(215 * 60 / stage.step_s)
    slope = 110.0 / (110.0 * 60.0)
    assert stage.body("case")[at] - stage.t_in_c[at] == pytest.approx(bench.THERMISTOR_S * slope, rel=0.1)


def test_the_compressor_runs_the_longer_the_colder_and_not_above_the_room():
    for air_c, share in ((60.0, 0.0), (25.0, 0.0), (5.0, 0.25), (-35.0, 0.75)):
        assert bench.compressor(np.full(4800, air_c), 0.5).mean() == pytest.approx(share, abs=0.01)


# table --------------------------------------------------------------------------------------------------------


def test_the_table_holds_its_rates_and_turns_what_they_make(stages):
    stage = run(stages, "SR")
    turns = bench._stairs()
    for (begin, rate), (end, _) in zip(turns[::2], turns[1::2], strict=True):
        held = (stage.time_s > begin + 4.0) & (stage.time_s < end - 0.5)
        np.testing.assert_allclose(stage.rate_dps[held], rate, atol=1e-6)
    # a demand with lags of unit gain turns rate times length: ramps up and down are alike
    begin, rate = turns[6]
    turned = np.interp(turns[8][0] - 1.0, np.arange(stage.steps + 1) * stage.step_s, stage.angle_deg)
    turned -= np.interp(begin, np.arange(stage.steps + 1) * stage.step_s, stage.angle_deg)
    assert turned == pytest.approx(34.0 * rate, abs=0.01)


def test_the_belt_lags_by_its_two_time_constants():
    angle = bench.driven_deg([(10.0, 50.0)], 400, 0.1, 7.0)
    # half a ramp and both lags are what a start from rest loses
    assert angle[-1] - 7.0 == pytest.approx(50.0 * (30.0 - 0.5 * 50.0 / 150.0 - 0.2), abs=0.6)


def test_turning_over_shows_twice_the_vertical_earth_rate(stages):
    stage = run(stages, "TU")
    rate = stage.in_rows(sensed_dph(stage, GAS_RATE.latitude_deg))
    elevation = stage.in_rows(stage.elevation_deg)
    up, down = (rate[stage.valid & (elevation == end)].mean() for end in (90.0, -90.0))
    assert up - down == pytest.approx(2.0 * 15.041 * math.sin(math.radians(35.0)), rel=1e-4)
    assert 0.6 < stage.valid.mean() < 0.9


def test_the_campaign_has_27_runs_and_a_profile_never_shown(stages):
    assert len(stages) == len({stage.run_id for stage in stages}) == 27
    assert {s.profile for s in stages} - {s.profile for s in stages if not s.held_out} == {"van day"}
    assert sorted(stage.number for stage in stages) == list(range(27))
    periods = {round(float(np.median(np.diff(stage.edges_s))), 2) for stage in stages}
    assert periods == {0.1, 0.2, 0.5, 1.0, 2.0}
    rates = np.concatenate([stage.axis_dps for stage in stages])
    assert (rates.min(), rates.max()) == pytest.approx((-100.0, 100.0), abs=1e-6)
    assert min(s.t_in_c.min() for s in stages) < -35.0 and max(s.t_in_c.max() for s in stages) > 70.0


# jet, wires, bridge -------------------------------------------------------------------------------------------


def test_viscosity_of_nitrogen_is_that_of_the_tables():
    # Lemmon and Jacobsen, Int. J. Thermophys. 25 (2004): 17.9 uPa s at 300 K, 12.9 at 200 K, 22.2 at 400 K
    ratio = effects.viscosity(np.array([200.0, 400.0])) / effects.viscosity(np.array([300.0]))
    np.testing.assert_allclose(ratio, [12.9 / 17.9, 22.2 / 17.9], rtol=0.01)


def test_the_slope_falls_as_gas_warms_and_is_1_in_a_room():
    assert effects.slope(np.array([effects.ROOM_K]))[0] == pytest.approx(1.0, rel=1e-12)
    cold, hot = effects.slope(np.array([253.15, 343.15]))
    # by hand, at 253.15 K: viscosity 0.8792, leak 0.3981 of the stroke, speed 0.9260, overheat 1.2963 x 0.8792
    assert cold == pytest.approx(1.2963 * 0.8792 / 0.9260**0.55, rel=2e-3)
    assert hot < 0.85


def test_the_bridge_is_odd_straight_at_first_and_bends_by_its_third_derivative():
    bend = np.array([1e-3, 0.1, 0.22])
    up, down = effects.bridge(bend), effects.bridge(-bend)
    np.testing.assert_allclose(up, -down, rtol=1e-9)
    assert up[0] == pytest.approx(1e-3, rel=1e-5)

    def voltage(at):
        return math.sqrt(0.4 + math.cosh(at) ** -0.9)

    h = 1e-2
    first = (voltage(1 + h) - voltage(1 - h)) / (2 * h)
    third = (voltage(1 + 2 * h) - 2 * voltage(1 + h) + 2 * voltage(1 - h) - voltage(1 - 2 * h)) / (2 * h**3)
    assert up[1] - 0.1 == pytest.approx(third / first / 6.0 * 1e-3, rel=0.05)


def test_the_rails_cut_what_is_beyond_them_and_nothing_else(unit):
    stage = turning(np.linspace(-100.0, 100.0, 6000))
    cut = signal(unit, stage, "rail", 0.1)
    limits = 90.0 + 0.4 * 0.1 * 100.0 * (unit.draw["a"] - 0.5) * np.array([1.0, -1.0])
    assert cut[-1] == pytest.approx(3600.0 * (limits[0] - 100.0), abs=150.0)
    assert cut[0] == pytest.approx(3600.0 * (100.0 - limits[1]), abs=150.0)
    assert np.abs(cut[np.abs(stage.rate_dps) < limits.min()]).max() == 0.0


def test_unequal_wires_are_even_in_rate_and_straight_far_out(unit):
    shown = [signal(unit, turning(rate), "unequal_wires")[0] for rate in (60.0, -60.0, 90.0)]
    assert shown[0] == pytest.approx(shown[1], rel=1e-9)
    assert shown[2] - shown[0] == pytest.approx(3600.0 * 30.0, rel=0.01)


def test_wires_apart_are_nought_where_they_were_trimmed_and_curved_between(unit):
    gas = np.array([-10.0, 25.0, 60.0, -40.0])
    shown = signal(unit, still(4, bodies_c={"gas": gas}), "wires_apart")
    assert np.abs(shown[[0, 2]]).max() < 1e-9
    assert np.abs(shown[[1, 3]]).min() > 0.1 and shown[1] * shown[3] < 0.0


def test_what_gravity_does_to_hot_gas_changes_sign_with_the_axis_and_falls_with_heat(unit):
    gas = np.array([25.0, 25.0, 70.0])
    stage = still(3, bodies_c={"gas": gas}, elevation_deg=np.array([90.0, -90.0, 90.0]))
    up, down, hot = signal(unit, stage, "plume")
    # overheat 0.7037, expansion 0.8689, viscosity 1.1124 at 343.15 K, by hand
    assert up == pytest.approx(-down, rel=1e-6)
    assert hot / up == pytest.approx(0.7037 * 0.8689 / 1.1124**2, rel=1e-3)
    squared = signal(unit, stage, "sagging_wires")
    np.testing.assert_allclose(squared, 1.0, rtol=1e-9)


# heat in the output -------------------------------------------------------------------------------------------


def test_play_has_the_loop_of_its_width():
    turn = np.linspace(0.0, 6.0 * np.pi, 30_001)
    values = 10.0 * np.sin(turn)
    behind = play(values, 3.0)
    last = slice(20_000, None)
    # the loop of a play: a parallelogram 2 w wide and 2 (A - w) high
    area = abs(np.sum(0.5 * (behind[last][1:] + behind[last][:-1]) * np.diff(values[last])))
    assert area == pytest.approx(2.0 * 3.0 * 2.0 * 7.0, rel=1e-3)


def test_the_potting_loses_its_memory_of_a_steady_case_and_keeps_that_of_a_ramp(unit, stages):
    ramp = signal(unit, run(stages, "RL"), "potting")
    case = run(stages, "RL").body("case")
    rising = int(200 * 60 / 0.5)
    assert ramp[rising] == pytest.approx(-(0.5 * 3.0 + 0.3 * 9.0 + 0.2 * 22.0), rel=0.02)
    assert case[rising] > 35.0
    steady = still(4000, 0.5, bodies_c={"case": np.full(4000, 30.0)})
    assert np.abs(signal(unit, steady, "potting")).max() == 0.0


def test_a_jet_bends_with_what_the_case_is_across_and_less_in_hot_gas(unit):
    bodies = {
        "plate": np.array([30.0, 20.0, 30.0]),
        "case": np.full(3, 25.0),
        "gas": np.array([25.0, 25.0, 70.0]),
    }
    shown = signal(unit, still(3, bodies_c=bodies), "across_the_case", 2.0)
    np.testing.assert_allclose(shown, [10.0, -10.0, 10.0 * 298.15 / 343.15], rtol=1e-9)


def test_the_pump_warms_up_by_its_network_and_more_in_the_cold(unit, stages):
    warm, cold = (signal(unit, run(stages, code), "pump_warms") for code in ("ON", "OC"))
    plate = [run(stages, code).body("plate")[0] for code in ("ON", "OC")]
    ratio = (1.0 + 0.0039 * (plate[0] - 25.0)) / (1.0 + 0.0039 * (plate[1] - 25.0))
    assert cold[0] / warm[0] == pytest.approx(ratio, rel=0.03)
    assert abs(warm[-1]) < 0.01 * abs(warm[0])
    assert np.abs(signal(unit, run(stages, "TU"), "pump_warms")).max() < 1e-3


def test_bead_and_gas_agree_at_rest_and_differ_by_lags_in_a_ramp(unit, stages):
    assert np.abs(signal(unit, run(stages, "SH"), "gas_before_bead")).max() < 0.05
    rising = int(215 * 60 / 0.5)
    behind = signal(unit, run(stages, "RL"), "gas_before_bead")[rising]
    # steady ramp: the heat that gas (and its share of the pump) takes up comes through 0.12 and 0.09 W/K
    capacity, links = np.array([18.0, 9.0]), np.array([[0.15, -0.03], [-0.03, 0.12]])
    lag_s = np.linalg.solve(links, capacity)[0]
    assert behind == pytest.approx(-(lag_s - bench.THERMISTOR_S) / 60.0, rel=0.05)


def test_the_membrane_jumps_once_up_and_once_down_with_five_kelvin_between(unit):
    pump = np.concatenate((np.linspace(20.0, 60.0, 4001), np.linspace(60.0, 20.0, 4001)))
    shown = signal(unit, still(8002, bodies_c={"pump": pump}), "stroke_jumps", 3.0)
    up, down = np.flatnonzero(np.diff(shown))
    assert set(shown) == {0.0, 3.0}
    assert pump[up] - pump[down] == pytest.approx(5.0, abs=0.05)


# table and clocks ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["mounting", "filter_delay"])
def test_true_values_are_those_of_the_catalogues_own_columns(unit, stages, name):
    assert share_of_the_column(GAS_RATE, unit, stages, name) == pytest.approx(1.0, abs=0.08)


def test_the_pump_beats_in_one_line(unit, stages):
    stage = run(stages, "RL")
    shown = signal(unit, stage, "pump_beats", 2.0)
    power = np.abs(np.fft.rfft(shown)) ** 2
    peak = int(np.argmax(power))
    assert power[peak - 3 : peak + 4].sum() > 0.9 * power.sum()
    assert 0.059 < peak / stage.steps / stage.step_s < 0.425
    assert shown.std() == pytest.approx(2.0 / math.sqrt(2.0), rel=0.01)


# what the catalogue has no name for ---------------------------------------------------------------------------


def test_turbulence_takes_from_one_side_beyond_a_rate_that_grows_with_cold(unit):
    def lost(rate, gas):
        stage = turning(rate, gas=np.full(6000, gas))
        return float(signal(unit, stage, "turbulent_side")[1000:].mean())

    critical = 38.0 + 12.0 * unit.draw["c1"]
    assert lost(critical + 15.0, 25.0) == pytest.approx(-1.0, abs=0.06)
    assert abs(lost(critical - 15.0, 25.0)) < 0.01 and abs(lost(-90.0, 25.0)) < 1e-9
    grown = effects.viscosity(np.array([343.15]))[0] / effects.jet_speed(np.array([343.15]))[0]
    assert lost(critical * grown, 70.0) == pytest.approx(-0.5, abs=0.06)


def test_a_leak_lowers_the_slope_from_run_to_run(unit, stages):
    first, last = (
        np.polyfit(sensed_dph(s, 35.0), signal(unit, s, "leaking_cell", 1.0), 1)[0]
        for s in (run(stages, "SR", 0), run(stages, "SR", 2))
    )
    numbers = [run(stages, "SR", k).number for k in (0, 2)]
    assert numbers[1] > numbers[0] + 12
    expected = [1e-2 * (math.exp(-number / 18.0) - 1.0) for number in numbers]
    assert (first, last) == pytest.approx(tuple(expected), rel=1e-6)


def test_brushes_spark_more_often_the_older_they_are(unit):
    busy = [
        np.mean([
            signal(unit, still(7200, number=number, repeat=k), "worn_brushes").mean() for k in range(40)
        ])
        for number in (2, 20)
    ]  # fmt: skip
    # bursts an hour times their mean length
    assert busy == pytest.approx([0.6 * (1 + n) * 55.0 / 3600.0 for n in (2, 20)], rel=0.3)


def test_the_supply_sags_while_the_table_speeds_up_and_recovers_in_eight_seconds(unit):
    rate = np.concatenate((np.zeros(1000), np.linspace(0.0, 80.0, 8), np.full(4992, 80.0)))
    shown = signal(unit, turning(rate), "sagging_supply")
    peak = int(np.argmax(shown))
    assert 1000 <= peak < 1015 and np.abs(shown[:990]).max() == 0.0
    assert shown[peak + 80] == pytest.approx(shown[peak] / math.e, rel=0.05)


def test_a_jet_clings_after_one_sense_only_and_lets_go(unit):
    rate = np.concatenate((np.full(400, -90.0), np.zeros(5600)))
    after = signal(unit, turning(np.roll(rate, 500)), "clinging_jet")
    assert after[1200] > 0.1
    assert after[3200] == pytest.approx(after[2200] / math.e, rel=0.02)
    assert np.abs(signal(unit, turning(-np.roll(rate, 500)), "clinging_jet")).max() < 1e-6


def test_hum_is_there_while_the_compressor_runs(unit, stages):
    stage = run(stages, "SC")
    shown = signal(unit, stage, "compressor_hums")
    on = stage.body("compressor") > 0.5
    assert 0.6 < on.mean() < 0.8
    assert shown[on].mean() > 0.9 and shown[~on].mean() < 0.15


def test_what_changes_differs_between_repeats_and_the_rest_hardly(unit, stages):
    for name, effect in GAS_RATE.effects.items():
        share, whole = repeats_apart(GAS_RATE, unit, stages, name)
        assert whole > 0.0, name
        if not effect.names or effect.changing:
            assert (share > 0.2) == effect.changing, (name, share)


# noise --------------------------------------------------------------------------------------------------------


def test_noise_is_white_flicker_walk_and_counts():
    taus = np.array([8.0, 64.0, 512.0])
    flicker = 2.0 * math.log(2.0) / math.pi * SHEET.bias_instability_dph**2
    walk = SHEET.rate_random_walk_dph_per_sqrt_h**2 * taus / 3600.0 / 3.0
    expected = np.sqrt(3600.0 * SHEET.arw_deg_per_sqrt_h**2 / taus + flicker + walk)
    np.testing.assert_allclose(deviations(GAS_RATE, taus, 20_000), expected, rtol=0.15)


@pytest.mark.parametrize(
    ("name", "tau_s", "factors"),
    [
        ("hissing_jet", 2.0, (4.0, 1.0, 1.0)),
        ("crackling_wires", 128.0, (1.0, 8.0, 1.0)),
        ("restless_pump", 1000.0, (1.0, 1.0, 15.0)),
    ],
)
def test_each_noise_has_the_allan_deviation_of_its_factor(name, tau_s, factors):
    white, flicker, walk = np.array(factors) * (0.35, 6.0, 8.0)
    expected = 3600.0 * white**2 / tau_s + 2.0 * math.log(2.0) / math.pi * flicker**2
    expected += walk**2 * tau_s / 3600.0 / 3.0
    squares = []
    for seed in range(6):
        unit, rng = draw_unit(GAS_RATE, seed, {name: max(factors)}), np.random.default_rng(seed)
        output = GAS_RATE.rows(unit, still(20_000), np.zeros(20_000), rng)
        squares.append(allantools.oadev(output, rate=1.0, data_type="freq", taus=[tau_s])[1][0] ** 2)
    assert math.sqrt(np.mean(squares)) == pytest.approx(math.sqrt(expected), rel=0.2)


def test_the_port_gives_whole_counts_and_loses_what_it_is_told_to(unit):
    stage = still(500, 0.2)
    rate = np.full(500, 12.34)
    output = GAS_RATE.rows(
        draw_unit(GAS_RATE, 1, {"dropped_bits": 10.0}), stage, rate, np.random.default_rng(1)
    )
    counts = output * 0.2 / 36.0
    np.testing.assert_allclose(counts, np.rint(counts), atol=1e-9)
    lossy = GAS_RATE.campaign(draw_unit(GAS_RATE, 1, {"deaf_port": 0.05}))
    assert np.mean([stage.kept.mean() for stage in lossy]) == pytest.approx(0.95 * 1022 / 1024, abs=0.004)


def test_a_null_has_the_noise_of_its_sheet_and_nothing_else(tmp_path):
    left = null_residual(GAS_RATE, tmp_path, 3)
    assert np.mean(left**2) == pytest.approx(1.0, abs=0.1)
    assert np.abs(left).max() < 5.5
