"""The tuning-fork gyros: bench by balances and closed forms, noise and logs as documented, cases as sealed."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bench.analysis.gap import read_recordings
from benchmarks.gap_exam import _tuning_fork_bench as bench
from benchmarks.gap_exam._families import FAMILIES
from benchmarks.gap_exam._files import SEALED_S, read_arrays, read_seal, run_keys
from benchmarks.gap_exam._make import Plan, draw_unit, make_case, prepare_folder
from benchmarks.gap_exam._signals import drawn
from benchmarks.gap_exam._tuning_fork import REGISTER_K, TUNING_FORK, read, rows
from simulators.effects import catalogue
from tests.gap_families import (
    deviations,
    null_residual,
    repeats_apart,
    share_of_the_column,
    sheet_noise,
    still,
)

SHEET = TUNING_FORK.sheet


@pytest.fixture(scope="module")
def unit():
    return draw_unit(TUNING_FORK, 5, {})


@pytest.fixture(scope="module")
def stages(unit):
    """The runs of a unit by key."""
    return {stage.key: stage for stage in TUNING_FORK.campaign(unit)}


# --- heat ---


def heat_flow(temperatures_c, air_c, powered=True):
    """The heat into each body, W, summed over the list of conductances."""
    at = dict(zip(bench.BODIES, temperatures_c, strict=True), air=air_c)
    into = {name: bench.POWER_W.get(name, 0.0) if powered else 0.0 for name in at}
    for (one, other), conductance in bench.CONDUCTANCE_W_PER_K.items():
        into[one] += conductance * (at[other] - at[one])
        into[other] += conductance * (at[one] - at[other])
    return np.array([into[name] for name in bench.BODIES])


def test_bodies_at_rest_have_no_heat_left_over():
    felt = bench.bodies(np.full(3, -30.0), 1.0, math.inf)
    np.testing.assert_allclose(heat_flow([felt[name][-1] for name in bench.BODIES], -30.0), 0.0, atol=1e-12)
    # 45 mW over 12 mW/K; no heat flows into the fork
    assert felt["asic"][-1] - felt["package"][-1] == pytest.approx(3.75)
    assert felt["quartz"][-1] == pytest.approx(felt["package"][-1])


def test_bodies_follow_the_differential_equations_from_power_up_on():
    air = np.repeat([20.0, 60.0], 200)
    felt = bench.bodies(air, 1.0, 0.0)
    capacity = list(bench.CAPACITY_J_PER_K.values())

    def slope(time_s, temperatures_c):
        return heat_flow(temperatures_c, air[min(int(time_s), 399)]) / capacity

    solved = solve_ivp(
        slope, (0.0, 400.0), [20.0] * 5, t_eval=np.arange(400.0) + 0.5, max_step=0.5, rtol=1e-6
    )
    for name, expected in zip(bench.BODIES, solved.y, strict=True):
        np.testing.assert_allclose(felt[name], expected, atol=0.02, err_msg=name)


def test_power_before_the_run_has_warmed_the_unit_already():
    long_ago = bench.bodies(np.full(3000, 25.0), 1.0, 0.0)
    found = bench.bodies(np.full(3, 25.0), 1.0, 1000.0)
    for name in bench.BODIES:
        np.testing.assert_allclose(found[name], long_ago[name][1000:1003], atol=1e-9)


# --- chamber and table ---


def test_the_chamber_lags_a_ramp_and_overshoots_a_step_as_a_controller_of_second_order():
    # above 31 degC the compressor stands still
    ramp = 40.0 + 0.01 * np.arange(2000.0)
    assert ramp[-1] - bench.chamber_air(ramp, 1.0, 0.0)[-1] == pytest.approx(
        0.01 * 2.0 * bench.CHAMBER_DAMPING / bench.CHAMBER_PER_S, rel=1e-3
    )
    step = np.where(np.arange(2000) < 10, 40.0, 50.0)
    z = bench.CHAMBER_DAMPING
    assert bench.chamber_air(step, 1.0, 0.0).max() - 50.0 == pytest.approx(
        10.0 * math.exp(-math.pi * z / math.sqrt(1.0 - z * z)), rel=0.01
    )


def test_the_compressor_runs_its_share_and_cools_while_it_runs():
    cold = np.full(15000, -25.0)
    runs = bench.compressor_runs(cold, 1.0, 33.0)
    assert runs.mean() == pytest.approx(0.2 + 40.0 / 80.0, abs=1e-3)
    assert np.count_nonzero(np.diff(runs) > 0.0) == 15000 // bench.COMPRESSOR_S
    air = bench.chamber_air(cold, 1.0, 33.0)[300:]
    assert air.mean() == pytest.approx(-25.0, abs=0.01)
    assert 0.1 < np.ptp(air) < bench.COMPRESSOR_K
    assert np.diff(air)[runs[301:] > 0.0].mean() < 0.0
    assert not bench.compressor_runs(np.full(500, 60.0), 1.0, 0.0).any()


def test_the_servo_errs_after_a_step_of_rate_by_the_closed_form_only():
    step_s = 0.01
    time = np.arange(301) * step_s
    error = 10.0 * time - bench.servo_deg(10.0 * time, step_s)
    w, z = 2.0 * math.pi * bench.SERVO_HZ, bench.SERVO_DAMPING
    damped = w * math.sqrt(1.0 - z * z)
    # the error's transfer function is s^2 / (s^2 + 2 z w s + w^2); the angle asked is 10 / s^2
    np.testing.assert_allclose(
        error, 10.0 * np.exp(-z * w * time) * np.sin(damped * time) / damped, atol=1e-9
    )
    assert error.min() < 0.0 and abs(error[-1]) < 1e-9


def test_rows_end_at_the_ticks_of_a_timer():
    edges = bench.row_edges(840.0, 0.2)
    ticks = np.diff(edges) * 64.0
    assert set(ticks.tolist()) == {12.0, 13.0} and len(ticks) == 4200 and edges[-1] == 840.0
    assert (np.diff(bench.row_edges(600.0, 0.5)) == 0.5).all()


def test_output_is_blank_while_the_table_changes_its_rate_and_nowhere_else(stages):
    for stage in stages.values():
        if stage.code in ("RS", "RT", "PT"):
            jumps = np.abs(np.diff(stage.rate_dps, prepend=0.0)) / stage.step_s
            assert not (stage.valid & (stage.in_rows(jumps) > 1.0)).any()
            seen = stage.valid[stage.kept].mean()
            assert (0.8 < seen < 0.95) if stage.code == "PT" else (0.9 < seen < 0.98), stage.code
        else:
            assert stage.valid.all() and stage.kept.all()
    held = stages["PT|0"]
    assert (np.abs(held.in_rows(held.rate_dps))[held.valid] < 1e-4).all()
    # three plateaus of 12 minutes of 111 are logged, and 10 minutes of two soaks
    assert stages["RT|0"].kept.mean() == pytest.approx(56.0 / 111.0, abs=1e-3)


def test_the_campaign_reaches_its_limits_and_keeps_a_profile_back(unit, stages):
    assert len(stages) == len({stage.run_id for stage in stages.values()}) == 27
    shown = {stage.profile for stage in stages.values() if not stage.held_out}
    assert {stage.profile for stage in stages.values()} - shown == {"drive"}
    by_axis = np.concatenate([stage.in_rows(stage.axis_dps)[stage.valid] for stage in stages.values()])
    assert [by_axis.min(), by_axis.max()] == pytest.approx([-bench.FASTEST_DPS, bench.FASTEST_DPS], rel=1e-3)
    felt = np.concatenate([stage.t_in_c for stage in stages.values()])
    assert felt.min() < -25.0 and felt.max() > 80.0
    assert all((stage.power_on_s < 10.0) == (stage.profile == "power-up") for stage in stages.values())
    again = {stage.key: stage for stage in TUNING_FORK.campaign(unit)}
    other = {stage.key: stage for stage in TUNING_FORK.campaign(draw_unit(TUNING_FORK, 6, {}))}
    np.testing.assert_array_equal(again["TC|1"].t_in_c, stages["TC|1"].t_in_c)
    assert np.abs(other["TC|1"].t_in_c - stages["TC|1"].t_in_c).max() > 0.05
    assert np.abs(stages["TC|0"].t_in_c - stages["TC|1"].t_in_c).max() > 0.05


# --- noise and logs ---


def allan_dph(tau_s, quantum=1.0, white=1.0, flicker=1.0, walk=1.0):
    """IEEE Std 952: 3 Q^2 / tau^2 + N^2 / tau + 2 ln 2 B^2 / pi + K^2 tau / 3, its root in deg/h."""
    q = quantum * SHEET.quantum_arcsec / math.sqrt(12.0)
    n = white * SHEET.arw_deg_per_sqrt_h * 60.0
    b = flicker * SHEET.bias_instability_dph
    k = walk * SHEET.rate_random_walk_dph_per_sqrt_h / 60.0
    variance = 3.0 * q**2 / tau_s**2 + n**2 / tau_s + 2.0 * math.log(2.0) / math.pi * b**2
    return np.sqrt(variance + k**2 * tau_s / 3.0)


def test_noise_is_that_of_the_sheet():
    taus = np.array([1.0, 10.0, 100.0, 1000.0])
    found = deviations(TUNING_FORK, taus, 40_000, units=8)
    for ratio, within in zip(found / allan_dph(taus), (0.02, 0.03, 0.05, 0.12), strict=True):
        assert ratio == pytest.approx(1.0, abs=within)
    assert SHEET.quantum_arcsec == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("name", "term", "tau_s"),
    [
        ("noisy_charge_amplifier", "white", 4.0),
        ("flickering_bias_current", "flicker", 64.0),
        ("creeping_mount", "walk", 512.0),
        ("divided_modulator_clock", "quantum", 1.0),
    ],
)
def test_what_is_inside_a_unit_raises_its_own_term(name, term, tau_s):
    factor = TUNING_FORK.noisy[name][1]
    found = []
    for seed in range(6):
        loud = draw_unit(TUNING_FORK, seed, {name: factor})
        # rates that no two rows share: at rest the charge left over would be alike from row to row
        rate = drawn(seed, "rate").uniform(0.0, 1e5, 16_384)
        output = rows(loud, still(16_384), rate, drawn(seed, "noise")) - rate
        means = output.reshape(-1, int(tau_s)).mean(axis=1)
        found.append(0.5 * np.mean(np.diff(means) ** 2))
    expected = allan_dph(tau_s, **{term: factor})
    assert expected > 1.5 * allan_dph(tau_s)
    assert math.sqrt(np.mean(found)) == pytest.approx(expected, rel=0.15)


def test_output_is_whole_pulses_and_loses_none(unit):
    stage = still(4000, 0.2, edges_s=bench.row_edges(800.0, 0.2))
    rate = 3600.0 * 20.0 * np.sin(np.arange(4000) / 90.0)
    lengths = np.diff(stage.edges_s)
    pulses = rows(unit, stage, rate, drawn(1, "x")) * lengths / SHEET.quantum_arcsec
    np.testing.assert_allclose(pulses, np.round(pulses), atol=1e-6)
    louder = rows(unit, stage, rate + 3600.0, drawn(1, "x")) * lengths / SHEET.quantum_arcsec
    assert louder.sum() - pulses.sum() == pytest.approx(3600.0 * 800.0 / 6.0, abs=1.0)


def test_a_full_buffer_loses_its_share_of_rows_in_blocks():
    lost = bench.overrun(400_000, 0.05, drawn(3, "x"))
    assert lost.mean() == pytest.approx(0.05, rel=0.06)
    starts = np.count_nonzero(np.diff(lost.astype(int)) > 0)
    assert lost.sum() / starts == pytest.approx(4.0, rel=0.06)
    assert not bench.overrun(1000, 0.0, drawn(3, "x")).any() and not lost[0]
    noisy = draw_unit(TUNING_FORK, 5, {"overrun_buffer": 0.05})
    kept = {stage.key: stage.kept for stage in TUNING_FORK.campaign(noisy)}
    assert 1.0 - kept["TS|0"].mean() == pytest.approx(0.05, abs=0.02)
    # a diagnosis takes runs of which at most 60 % is missing
    worst = draw_unit(TUNING_FORK, 5, {"overrun_buffer": TUNING_FORK.noisy["overrun_buffer"][1]})
    assert all((stage.valid & stage.kept).mean() > 0.42 for stage in TUNING_FORK.campaign(worst))


def test_register_thermometer_and_encoder_read_the_run(unit, stages):
    stage = stages["RS|0"]
    register, pt100, position = read(unit, stage, drawn(1, "x"))
    np.testing.assert_allclose(register / REGISTER_K, np.round(register / REGISTER_K), atol=1e-9)
    error = register - stage.in_rows(stage.body("asic"))
    assert abs(error.mean()) < 0.01 and error.std() == pytest.approx(
        math.hypot(0.08, 0.125 / 12**0.5), rel=0.1
    )
    difference = pt100 - stage.in_rows(stage.t_out_c)
    assert difference.std() == pytest.approx(math.hypot(0.01, 0.01 / 12**0.5), rel=0.1)
    assert np.abs(position - stage.at_edges(stage.angle_deg)).max() < 0.51 * bench.ENCODER_DEG
    warming = stages["TC|0"]
    at = int(20.0 * 60.0 / warming.step_s)
    slope = np.gradient(warming.body("fixture"), warming.step_s)[at]
    assert warming.body("fixture")[at] - warming.t_out_c[at] == pytest.approx(bench.PT100_S * slope, rel=0.05)


# --- cases ---


def test_a_null_case_is_noise_of_the_sheet(tmp_path):
    rest = null_residual(TUNING_FORK, tmp_path, 21, without=("rate steps",))
    assert len(rest) > 5000
    assert np.mean(rest**2) == pytest.approx(1.0, abs=0.05)


def test_rates_hot_and_cold_come_out_of_the_files_with_the_units_scale_factor(tmp_path):
    prepare_folder(TUNING_FORK, tmp_path)
    make_case(TUNING_FORK, tmp_path, Plan("null_2", "null", 22, ()))
    drawn_ppm = draw_unit(TUNING_FORK, 22, {}).sf_ppm
    runs = read_recordings([tmp_path / "cases" / "null_2" / "runs.toml"]).shown
    steps = [run for run in runs if run.profile == "rate steps"]
    assert len(steps) == 6
    for run in steps:
        seen = np.isfinite(run.output_dph)
        rate = run.stimulus.input_rate_dph[seen]
        slope, _ = np.polyfit(rate, run.output_dph[seen], 1)
        # the slope of the bias, 30 deg/h per 50 K, is nothing beside 250 deg/s
        assert 1e6 * (slope - 1.0) == pytest.approx(drawn_ppm, abs=3.0)


@pytest.mark.parametrize("name", ["bearing_vibration", "compressor_supply"])
def test_a_case_differs_from_the_null_by_what_is_sealed(tmp_path, name):
    prepare_folder(TUNING_FORK, tmp_path)
    for case, effects in (("null", ()), ("single", ((name, 12.0),))):
        make_case(TUNING_FORK, tmp_path, Plan(f"{case}_3", case, 23, effects))
    outputs = {}
    for case in ("null_3", "single_3"):
        folder = tmp_path / "cases" / case
        keys = run_keys(folder)
        shown = read_recordings([folder / "runs.toml"]).shown
        outputs[case] = {keys[run.run_id]: run.output_dph for run in shown}
    parts = read_arrays(tmp_path / "sealed" / "single_3.npz")
    seal = read_seal(tmp_path / "sealed" / "single_3.json")
    assert seal.snr[name] == pytest.approx(12.0, rel=1e-3)
    assert seal.left_out == ("DC|0",)
    for key in ("SW|0", "TC|1", "CU|2"):
        added = outputs["single_3"][key] - outputs["null_3"][key]
        sealed = parts[f"{name}|{key}"].reshape(-1, round(1.0 / SEALED_S)).mean(axis=1)[: len(added)]
        # each differs by less than a pulse at either end of a row
        np.testing.assert_allclose(added[: len(sealed)], sealed, atol=13.0)
        assert added.mean() == pytest.approx(sealed.mean(), abs=0.02)


def test_effects_have_names_of_the_catalogue_or_none():
    assert FAMILIES["quartz_tuning_fork"] is TUNING_FORK
    names = set(catalogue())
    for effect in TUNING_FORK.effects.values():
        assert {*effect.names, *effect.beside} <= names
    assert {name for *_, name in TUNING_FORK.noisy.values()} <= names
    assert len(TUNING_FORK.known) == 18 and len(TUNING_FORK.foreign) == 5
    assert sheet_noise(TUNING_FORK).quantum == SHEET.quantum_arcsec


@pytest.mark.parametrize(("name", "ratio"), [("output_filter", 1.0), ("converter_clip", 30.0)])
def test_curved_effects_come_in_the_ratios_planned(tmp_path, name, ratio):
    prepare_folder(TUNING_FORK, tmp_path)
    make_case(TUNING_FORK, tmp_path, Plan("single_4", "single", 24, ((name, ratio),)))
    assert read_seal(tmp_path / "sealed" / "single_4.json").snr[name] == pytest.approx(ratio, rel=0.02)


@pytest.mark.parametrize("name", ["tine_imbalance", "mount_lean", "output_filter"])
def test_true_values_are_those_of_the_catalogues_own_columns(unit, stages, name):
    size = 0.02 if name == "output_filter" else 0.5
    share = share_of_the_column(TUNING_FORK, unit, list(stages.values()), name, size)
    assert share == pytest.approx(1.0, abs=0.08)


def test_what_changes_differs_between_repeats_and_the_rest_hardly(unit, stages):
    runs = list(stages.values())
    for name, effect in TUNING_FORK.effects.items():
        # level turns start anywhere, an encoder's waves and a lean with them
        apart, whole = repeats_apart(TUNING_FORK, unit, runs, name, without=("LT", "SW", "RS", "RT", "DC"))
        assert whole > 0.0, name
        assert (apart > 0.2) == effect.changing, (name, apart)
