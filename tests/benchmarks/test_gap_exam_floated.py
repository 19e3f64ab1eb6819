"""The floated gyros: bench by balances, noise and counter as documented, effects against closed forms."""

import math
import tomllib
from dataclasses import replace

import numpy as np
import pyarrow.csv
import pytest

from benchmarks.gap_exam import _floated_effects as effects
from benchmarks.gap_exam._files import read_arrays, read_seal
from benchmarks.gap_exam._floated import FLOATED, SHEET, read, rows
from benchmarks.gap_exam._floated_bench import (
    BODIES,
    FASTEST_DPS,
    LATITUDE_DEG,
    THERMAL_S,
    chamber,
    conductances,
    network,
    staircase,
    table_deg,
)
from benchmarks.gap_exam._make import Plan, draw_unit, make_case, plan, prepare_folder
from benchmarks.gap_exam._mems import MEMS
from benchmarks.gap_exam._signals import drawn

EARTH_DPH = 15.041067
UP_DPH = EARTH_DPH * math.sin(math.radians(LATITUDE_DEG))
NORTH_DPH = EARTH_DPH * math.cos(math.radians(LATITUDE_DEG))


@pytest.fixture(scope="module")
def unit():
    return draw_unit(FLOATED, 5, {})


@pytest.fixture(scope="module")
def stages(unit):
    """The runs of a unit by key."""
    return {stage.key: stage for stage in FLOATED.campaign(unit)}


def with_fluid(stage, fluid_c):
    """Return a run in which all bodies have one temperature (m,)."""
    values = np.broadcast_to(np.asarray(fluid_c, float), (stage.steps,))
    return replace(stage, bodies_c=dict.fromkeys((*BODIES, "air"), values))


def with_rate(stage, rate_dps):
    return replace(stage, angle_deg=np.arange(stage.steps + 1) * stage.step_s * rate_dps)


# --- bench ---


def test_a_seed_makes_one_campaign_and_another_seed_another(unit, stages):
    again = {stage.key: stage for stage in FLOATED.campaign(draw_unit(FLOATED, 5, {}))}
    other = {stage.key: stage for stage in FLOATED.campaign(draw_unit(FLOATED, 6, {}))}
    for key in ("SU|1", "RA|0"):
        np.testing.assert_array_equal(again[key].t_in_c, stages[key].t_in_c)
        np.testing.assert_array_equal(again[key].edges_s, stages[key].edges_s)
        assert np.abs(other[key].edges_s[:1000] - stages[key].edges_s[:1000]).max() > 0.001
    logs = [
        rows(unit, stages["RA|0"], np.zeros(len(stages["RA|0"].valid)), drawn(1, "log")) for _ in range(2)
    ]
    np.testing.assert_array_equal(*logs)


def test_what_the_bodies_are_heated_with_leaves_by_the_air():
    hours = 12.0
    air = np.full(round(hours * 3600.0 / THERMAL_S), 20.0)
    nodes = network(air, np.full(len(air), 3.2), np.full(len(air), 0.7), cold=True)
    _, to_air = conductances()
    assert to_air @ (nodes[:, -1] - 20.0) == pytest.approx(3.2 + 0.7, rel=1e-4)
    # nothing was on before: at first all is as warm as the air
    np.testing.assert_allclose(nodes[:5, 0], 20.0, atol=0.1)


def test_the_chamber_holds_and_its_compressor_cycles_when_cold():
    demand = np.concatenate((np.linspace(22.0, -12.0, 1500), np.full(2500, -12.0)))
    air, load = chamber(demand, drawn(3, "air"))
    assert air[-1500:].mean() == pytest.approx(-12.0, abs=0.1)
    assert np.count_nonzero(np.diff((load[-1500:] > 0.0).astype(int))) > 6
    assert np.ptp(air[-1500:]) > 0.2


def test_the_table_arrives_where_its_rates_lead():
    edges = np.arange(24001) * 0.1
    angle = table_deg(staircase(), edges, 270.0, 0.1)
    # to 25 deg/s by ramps of 18 deg/s2 and back, 120 s apart
    at = np.searchsorted(edges, (300.0, 415.0, 435.0))
    assert angle[at[0]] == pytest.approx(270.0, abs=1e-4)
    assert angle[at[2]] - angle[at[0]] == pytest.approx(0.5 * 120.0, abs=1e-4)
    assert (angle[at[1]] - angle[at[1] - 500]) / 50.0 == pytest.approx(0.5, abs=1e-5)
    assert angle[-1] == pytest.approx(270.0, abs=1e-3)


def test_moves_have_no_output_and_a_change_of_file_no_rows(stages):
    tumble = stages["TU|0"]
    middles = 0.5 * (tumble.edges_s[1:] + tumble.edges_s[:-1])
    assert not tumble.valid[np.abs(middles - 560.0) < 19.0].any()
    assert tumble.valid[np.abs(middles - 840.0) < 100.0].all()
    night = stages["NI|0"]
    missing = np.diff(np.concatenate(([0], (~night.kept).astype(int), [0])))
    begins, ends = np.flatnonzero(missing == 1), np.flatnonzero(missing == -1)
    assert len(begins) in (4, 5)
    assert ((ends - begins) * 0.8 < 9.0).all()
    assert (np.diff(night.edges_s) > 0.0).all()


# --- noise and counter ---


def test_output_is_whole_pulses_and_its_noise_that_of_the_sheet(unit, stages):
    night = stages["NI|0"]
    gaps = np.diff(night.edges_s)
    output = rows(unit, night, np.full(len(gaps), 9.0), drawn(8, "log"))
    pulses = output * gaps / SHEET.quantum_arcsec
    np.testing.assert_allclose(pulses, np.round(pulses), atol=1e-6)
    # N^2 / tau, and two edges of a uniform remainder
    expected = SHEET.arw_deg_per_sqrt_h**2 * 3600.0 / 0.8 + SHEET.quantum_arcsec**2 / 6.0 / 0.8**2
    assert np.var(output) == pytest.approx(expected, rel=0.05)
    hour = np.average(output[:4500], weights=gaps[:4500])
    flicker = SHEET.bias_instability_dph * math.sqrt(2.0 * math.log(2.0) / math.pi)
    assert abs(hour - 9.0) < 4.0 * math.hypot(SHEET.arw_deg_per_sqrt_h, 2.0 * flicker, 0.015)


@pytest.mark.parametrize("name", ["rough_bearing", "heavy_pulses"])
def test_what_is_inside_a_unit_acts_on_its_noise(stages, name):
    unit = draw_unit(FLOATED, 5, {name: 4.0})
    night = stages["NI|0"]
    # rates that differ from row to row leave remainders of all sizes
    rate = drawn(1, "rate").uniform(0.0, 1000.0, len(night.valid))
    output = rows(unit, night, rate, drawn(8, "log")) - rate
    white, pulse = (4.0 if name == part else 1.0 for part in ("rough_bearing", "heavy_pulses"))
    expected = (white * 0.004) ** 2 * 3600.0 / 0.8 + (pulse * 0.4) ** 2 / 6.0 / 0.8**2
    assert np.var(output) == pytest.approx(expected, rel=0.06)


def test_a_busy_logger_loses_its_share_of_rows():
    lossy = FLOATED.campaign(draw_unit(FLOATED, 5, {"busy_logger": 0.03}))
    kept = np.concatenate([stage.kept for stage in lossy])
    assert 1.0 - kept.mean() == pytest.approx(0.03 + 0.0015, abs=0.001)


def test_thermometers_and_encoder_are_those_of_the_run(unit, stages):
    stage = stages["SU|0"]
    t_in, t_out, angle = read(unit, stage, drawn(2, "read"))
    assert np.std(t_in - stage.in_rows(stage.t_in_c)) == pytest.approx(0.03, rel=0.05)
    assert np.abs(t_out - stage.in_rows(stage.t_out_c)).max() < 0.2
    assert np.abs(angle - stage.at_edges(stage.angle_deg)).max() < 1e-6


# --- a case on disk ---


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with a null and with the same unit whose float's mass is off, of three sorts of runs."""

    def campaign(unit):
        return [stage for stage in FLOATED.campaign(unit) if stage.code in ("RA", "TU", "MI")]

    family, made = replace(FLOATED, campaign=campaign), tmp_path_factory.mktemp("exam")
    prepare_folder(family, made)
    make_case(family, made, Plan("null_1", "null", 41, ()))
    make_case(family, made, Plan("single_1", "single", 41, (("mass_shift", 20.0),)))
    return made


def test_a_null_case_is_earth_and_table_within_the_sheet(folder):
    seal = read_seal(folder / "sealed" / "null_1.json")
    assert seal.effects == ()
    assert seal.left_out == ("MI|0",)
    case = folder / "cases" / "null_1"
    mapping = tomllib.loads((case / "runs.toml").read_text(encoding="utf-8"))
    assert mapping["columns"]["t_in"]["unit"] == "0.0625 degC"
    unit = draw_unit(FLOATED, 41, {})
    for run in (run for run in mapping["run"] if run["profile"] == "rates"):
        log = pyarrow.csv.read_csv(case / run["file"]).to_pandas()
        seconds = (log["stamp"] - log["stamp"].iloc[0]).dt.total_seconds().to_numpy()
        for begin, rate_dps in ((310.0, 0.5), (310.0 + 10 * 170.0, 25.0), (310.0 + 11 * 170.0, -25.0)):
            within = (seconds > begin) & (seconds < begin + 100.0)
            first, last = np.flatnonzero(within)[[0, -1]]
            gaps = np.diff(seconds[first : last + 1])
            if gaps.max() > 1.0:
                continue
            turned = log["table"].iloc[last] - log["table"].iloc[first]
            mean_dps = turned / (seconds[last] - seconds[first])
            assert mean_dps == pytest.approx(rate_dps, abs=0.01)
            output = 3600.0 * np.average(log["pulse_rate"].iloc[first + 1 : last + 1], weights=gaps)
            nominal = (3600.0 * mean_dps + UP_DPH) * (1.0 + 1e-6 * unit.sf_ppm) - unit.slope_dph * 1.4 / 50.0
            # turn-on, white noise and a pulse in 100 s
            assert output == pytest.approx(nominal, abs=4.0 * math.hypot(0.06, 0.024, 0.4 / 100.0))


def test_a_case_with_an_effect_differs_from_the_null_by_what_is_sealed(folder):
    seal = read_seal(folder / "sealed" / "single_1.json")
    assert seal.snr["mass_shift"] == pytest.approx(20.0, rel=1e-6)
    assert seal.names["mass_shift"] == ("acceleration_sensitivity",)
    parts = read_arrays(folder / "sealed" / "single_1.npz")
    logs = [
        pyarrow.csv.read_csv(folder / "cases" / name / "TU_1.csv").to_pandas()
        for name in ("null_1", "single_1")
    ]
    added = 3600.0 * (logs[1]["pulse_rate"] - logs[0]["pulse_rate"]).to_numpy()
    sealed = parts["mass_shift|TU|0"]
    for elevation in (0.0, 60.0, -90.0):
        there = np.isclose(logs[0]["elevation"], elevation) & np.isfinite(added)
        begin = np.flatnonzero(there)[0]
        some = slice(begin + 10, begin + 300)
        assert np.mean(added[some]) == pytest.approx(sealed[round((begin + 100) * 0.8 / 0.2)], abs=0.01)


def test_weak_effects_are_planned_for_this_family_and_not_for_others():
    def least(family):
        return min(snr for what in plan(family, 4, 120, "single") for _, snr in what.effects)

    assert 0.3 <= least(FLOATED) < 0.5
    assert least(MEMS) >= 1.0


def test_enough_mechanisms_have_a_name_and_enough_have_none(unit, stages):
    assert len(FLOATED.known) >= 15
    assert len(FLOATED.foreign) >= 5
    few = [stages[key] for key in ("HU|0", "RA|0", "IX|1", "TU|0", "KU|0")]
    for name, effect in FLOATED.effects.items():
        added = [effect.signal(unit, stage, 0.5) for stage in few]
        assert all(own.shape == (stage.steps,) for own, stage in zip(added, few, strict=True)), name
        assert all(np.isfinite(own).all() for own in added), name
        assert max(np.abs(own).max() for own in added) > 0.0, name
        if not effect.curved:
            np.testing.assert_allclose(effect.signal(unit, few[1], 1.5), 3.0 * added[1], rtol=1e-3, atol=1e-6)


# --- effects against closed forms ---


def test_pumped_fluid_at_a_steady_ramp(unit, stages):
    stage = stages["SU|0"]
    ramp = 10.0 + 2.0 * stage.time_s / 60.0
    own = effects.pumped_fluid(unit, with_fluid(stage, ramp), 0.3)
    np.testing.assert_allclose(own, 0.3 * 2.0 * (1.0 + 2.0 * (0.2 + 0.5 * unit.draw["a"])), rtol=1e-6)
    cold = with_fluid(stage, -5.0 + 1e-6 * stage.time_s)
    ratio = effects.thick_fluid(unit, cold, 1.0) / effects.pumped_fluid(unit, cold, 1.0)
    # ln(viscosity) by Andrade, temperatures in K
    assert ratio[0] == pytest.approx(math.exp(4700.0 / 268.15 - 4700.0 / 303.15) - 1.0, rel=1e-3)


def test_flotation_has_neither_value_nor_slope_on_the_bench(unit, stages):
    stage = stages["SU|0"]
    own = [effects.flotation(unit, with_fluid(stage, t), 2.0)[0] for t in (29.9, 30.0, 30.1, 80.0)]
    assert own[1] == pytest.approx(0.0, abs=1e-12)
    assert abs(own[2] - own[0]) < 1e-7
    assert own[3] == pytest.approx(2.0)


def test_a_slider_takes_the_work_of_its_loop():
    # elastic, then slipping: 4 w (A - w) a cycle
    swing = 5.0 * np.sin(np.linspace(0.0, 6.0 * math.pi, 60001))
    held = effects.stretched(swing, 2.0)
    cycle = slice(20000, 40001)
    middle = 0.5 * (held[cycle][1:] + held[cycle][:-1])
    assert np.sum(middle * np.diff(swing[cycle])) == pytest.approx(4.0 * 2.0 * (5.0 - 2.0), rel=1e-3)


def test_cement_lags_a_ramp_by_the_mean_of_its_times(unit, stages):
    night = stages["NI|0"]
    long = replace(night, elevation_deg=np.zeros(400_000), step_s=0.4)
    own = effects.cement_creep(unit, with_fluid(long, 0.001 * long.time_s), 30.0)
    times = np.geomspace(240.0, 7200.0, 7)
    weights = np.exp(-(((np.linspace(0.0, 1.0, 7) - unit.draw["c1"]) / 0.35) ** 2))
    assert own[-1] == pytest.approx(0.001 * np.average(times, weights=weights), rel=1e-3)


def test_effects_of_the_rate(unit, stages):
    stage = with_rate(stages["RA|0"], 20.0)
    rate = 3600.0 * 20.0 + UP_DPH
    last = -1
    assert effects.pulse_mismatch(unit, stage, 100.0)[last] == pytest.approx(50e-6 * rate, rel=0.01)
    share = 20.0 / (FASTEST_DPS * (0.25 + 0.4 * unit.draw["c2"]))
    iron = effects.torquer_iron(unit, stage, 100.0)[last]
    assert iron == pytest.approx(1e-4 * rate * (1.0 - 1.0 / (1.0 + share**2)), rel=1e-3)
    limit = effects.NO_LIMIT_DPS - 8.0
    assert effects.current_limit(unit, stage, 8.0)[last] == pytest.approx(3600.0 * limit - rate, rel=1e-6)
    assert effects.pivot_friction(unit, stage, 5.0)[last] == pytest.approx(-(5.0**1.5) / rate**0.5, rel=1e-3)
    still = with_rate(stage, 0.0)
    assert effects.pivot_friction(unit, still, 1e5)[last] == pytest.approx(-UP_DPH, rel=1e-4)
    glow = effects.coil_glow(unit, stage, 2.0)[last]
    assert glow == pytest.approx(2.0 * 0.64, rel=1e-6)


def test_delays_of_an_accelerating_table(unit, stages):
    stage = stages["RA|0"]
    edges = np.arange(stage.steps + 1) * stage.step_s
    faster = replace(stage, angle_deg=0.5 * 0.01 * edges**2)
    own = effects.latch_delay(unit, faster, 5.0)
    np.testing.assert_allclose(own[10:], -3600.0 * 0.005 * 0.01, rtol=1e-4)
    steady = effects.counter_clock(unit, with_rate(stage, 10.0), 3.0)
    # the derivative of s t (1 + 0.05 t / 1 h)
    expected = -3e-6 * 36000.0 * (1.0 + 0.1 * stage.time_s / 3600.0)
    np.testing.assert_allclose(steady[100:], expected[100:], rtol=1e-4)


def test_geometry_of_a_level_axis(unit, stages):
    night = stages["NI|0"]
    # the axis points east: the case turned counter-clockwise points a little north
    own = effects.mirror_azimuth(unit, night, 3600.0)
    np.testing.assert_allclose(own, NORTH_DPH * math.sin(math.radians(1.0)), rtol=1e-3)
    toward = 2.0 * math.pi * unit.draw["tilt"]
    tilt = effects.pier_tilt(unit, night, 600.0)[0]
    # a rotation about north lifts or lowers an axis that points east
    expected = UP_DPH * math.radians(600.0 / 3600.0) * math.cos(toward)
    assert abs(tilt) == pytest.approx(abs(expected), rel=0.01, abs=1e-5)


def test_an_encoder_disc_cancels_over_a_turn(unit, stages):
    stage = with_rate(stages["RA|0"], 10.0)
    own = effects.eccentric_encoder(unit, stage, 2.0)
    turn = round(36.0 / stage.step_s)
    assert np.sum(own[:turn]) == pytest.approx(0.0, abs=1e-6)
    # what the angle seems to gain, the gyro seems to miss
    gained = effects.encoder_arcsec(unit, np.array([0.0, 90.0]))
    assert np.sum(own[:90]) * stage.step_s == pytest.approx(-2.0 * np.diff(gained)[0], rel=1e-9)


def test_mass_and_steel_by_place(unit, stages):
    tumble = stages["TU|0"]
    own = effects.mass_shift(unit, tumble, 3.0)
    up, down = (own[tumble.elevation_deg == elevation][0] for elevation in (90.0, -90.0))
    assert up == pytest.approx(-down)
    level = own[tumble.elevation_deg == 0.0][0]
    assert math.hypot(up, level) == pytest.approx(3.0)
    indexing = effects.pier_steel(unit, stages["IX|0"], 1.0)
    assert np.ptp(indexing) == pytest.approx(2.0 * (math.tanh(1.5) + 0.2), rel=0.02)


def test_a_bubble_ends_up_at_the_upper_end(unit, stages):
    night = with_fluid(stages["NI|0"], 27.0)
    own = effects.gas_bubble(unit, replace(night, elevation_deg=np.full(night.steps, 90.0)), 1.0)
    volume = 300.15 / 300.0 / (1.0 + math.exp(-19.0 / 2.5))
    upper = math.cos(math.radians(20.0 * (unit.draw["a"] - 0.5)))
    assert own[-1] == pytest.approx(upper * volume, rel=1e-3)
    assert own[0] < 0.0


def test_a_retainer_whirls_for_its_share_of_time(unit, stages):
    night = with_fluid(stages["NI|0"], effects.REFERENCE_C)
    long = replace(night, elevation_deg=np.zeros(1_500_000))
    own = effects.retainer_whirl(unit, with_fluid(long, effects.REFERENCE_C), 1.0)
    assert own.mean() == pytest.approx(220.0 / (220.0 + 1500.0), rel=0.2)


def test_a_retainer_changes_place_late_both_ways(unit, stages):
    night = stages["NI|0"]
    swing = 40.0 + 15.0 * np.sin(2.0 * math.pi * night.time_s / 7200.0)
    own = effects.retainer_place(unit, with_fluid(night, swing), 1.0)
    crossed = swing[1:][np.diff((own > 0.5).astype(int)) != 0][1:3]
    warm = 38.0 + 6.0 * unit.draw["b"]
    apart = 3.0 + 6.0 * unit.draw["a"]
    np.testing.assert_allclose(sorted(crossed), (warm - apart, warm), atol=0.2)


def test_the_supply_dips_only_while_the_compressor_runs(unit, stages):
    shock = stages["HU|0"]
    own = effects.supply_dips(unit, shock, 1.0)
    falling = (shock.time_s > 1850.0) & (shock.time_s < 2000.0)
    rising = (shock.time_s > 5500.0) & (shock.time_s < 6500.0)
    assert own[falling].max() > 0.9
    assert np.abs(own[rising]).max() < 1e-3
