"""The tuned-rotor family against closed forms: conduction, drift by cross products, loops, noise, its nulls."""

import math

import numpy as np
import pytest
from scipy import stats
from scipy.optimize import brentq

from bench.analysis.gap import read_recordings
from benchmarks.gap_exam import _tuned_rotor as lab
from benchmarks.gap_exam import _tuned_rotor_bench as plant
from benchmarks.gap_exam import _tuned_rotor_effects as wrong
from benchmarks.gap_exam._files import Logged, read_seal, write_case
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._make import Plan, draw_unit, make_case, prepare_folder
from benchmarks.gap_exam._signals import drawn
from benchmarks.gap_exam._tuned_rotor import TUNED_ROTOR
from tests.gap_families import deviations, null_residual, repeats_apart, share_of_the_column, stimulus

UNIT = draw_unit(TUNED_ROTOR, 5, {})


@pytest.fixture(scope="module")
def stages():
    return TUNED_ROTOR.campaign(UNIT)


def test_a_slab_in_a_wind_cools_as_the_series_says():
    """Incropera, Fundamentals of Heat and Mass Transfer, eq. 5.42: insulated behind, Biot number h L / k."""
    slab = plant.Slab(cells=40, joint_w_per_k=0.0)
    film = 1.7
    biot, time_s = film / slab.through_w_per_k, slab.capacity_j_per_k / slab.through_w_per_k
    roots = [
        brentq(lambda z: z * math.tan(z) - biot, k * math.pi + 1e-9, (k + 0.5) * math.pi - 1e-9)
        for k in range(40)
    ]
    nodes, step_s = np.ones(41), 0.2
    onward, face = slab.step(step_s), float(slab.to_face(np.array(film)))
    depth = (np.arange(40) + 0.5) / 40.0
    for step in range(1, 2001):
        heat = np.zeros(41)
        heat[0] = -face * nodes[0]
        nodes = onward @ (nodes + step_s * heat / slab.capacities)
        if step in (250, 1000, 2000):
            series = sum(
                4.0 * math.sin(z) / (2.0 * z + math.sin(2.0 * z))
                * math.exp(-z * z * step * step_s / time_s) * np.cos(z * (1.0 - depth))
                for z in roots
            )  # fmt: skip
            np.testing.assert_allclose(nodes[:40], series, atol=3e-3)
            assert nodes[40] == 1.0


def test_heat_in_steady_state_passes_film_slab_and_joint_in_series():
    slab = plant.Slab()
    steps = 12_000
    heat = plant.heated(np.full((steps, 2), 25.0), np.tile([0.0, 1.0], (steps, 1)), slab)
    for run, film in enumerate(plant._FILM_W_PER_K):
        face, inner, core, air = (heat[name][-1, run] for name in ("face", "inner", "core", "air"))
        radiated = plant.STEFAN_BOLTZMANN_W * plant._RADIATING_M2 * ((face + 273.15) ** 4 - 298.15**4)
        half = 0.5 / (slab.cells * slab.through_w_per_k)
        assert (face - air) / (1.0 / film + half) + radiated == pytest.approx(plant._MOTOR_W, rel=1e-3)
        through = 2.0 * half * (slab.cells - 1) * plant._MOTOR_W
        assert inner - face == pytest.approx(through, rel=1e-3)
        assert core - inner == pytest.approx(plant._MOTOR_W * (half + 1.0 / slab.joint_w_per_k), rel=1e-3)


def test_an_unbalanced_rotor_drifts_as_its_weight_times_lever_over_its_momentum():
    """Spin axis level, weight m g at l along it: (m l / H) g about the vertical, none about a level axis."""
    elevation = np.array([90.0, 0.0, -90.0, 30.0])
    level = np.array([0.0, 0.0, 1.0])
    found = wrong.unbalance_dph(0.7 * level, 0.0, elevation, level)
    np.testing.assert_allclose(found, -0.7 * np.sin(np.radians(elevation)), atol=1e-12)
    # a damped suspension turns the drift by a right angle
    damped = wrong.unbalance_dph(0.0 * level, 0.4, elevation, level)
    np.testing.assert_allclose(damped, 0.4 * np.cos(np.radians(elevation)), atol=1e-12)
    # a rotor as soft along as across has no moment; a softer spin axis gives the product of both pulls
    spin = np.array([0.0, 1.0, 0.0])
    np.testing.assert_allclose(wrong.compliance_dph(np.eye(3), elevation, spin), 0.0, atol=1e-12)
    product = wrong.compliance_dph(np.outer(spin, spin), elevation, spin)
    np.testing.assert_allclose(product, 0.5 * np.sin(np.radians(2.0 * elevation)), atol=1e-12)


def test_loops_settle_at_one_and_do_not_care_how_fast():
    there_and_back = np.concatenate((np.linspace(0, 60, 4001), np.linspace(60, 0, 4001)[1:]))
    loop = wrong.bouc_wen(there_and_back, 6.0)
    assert loop[4000] == pytest.approx(1.0, abs=1e-3) and loop[-1] == pytest.approx(-1.0, abs=1e-3)
    slower = wrong.bouc_wen(np.repeat(there_and_back, 3), 6.0)
    np.testing.assert_allclose(slower[::3], loop, atol=1e-12)
    # it begins with the slope 1 / width
    assert loop[10] == pytest.approx(there_and_back[10] / 6.0, rel=0.01)


def test_the_table_lags_by_its_gears_play_and_sways_at_its_own_frequency():
    step_s = 0.01
    edges = np.arange(0.0, 60.0 + step_s, step_s)
    motor, changing = plant.limited_rate(((5.0, 2.0), (20.0, -2.0), (35.0, 0.0)), edges, 4.0)
    # 0.5 + 29 there, 28 + 0.5 back
    assert motor[-1] == pytest.approx(1.0, abs=1e-9)
    assert changing.sum() * step_s == pytest.approx(0.5 + 1.0 + 0.5, abs=0.05)
    behind = plant.driven(motor, step_s)
    cogged = 1.0 + plant._COGGING_DEG * math.sin(math.radians(plant._COGS))
    assert behind[-1] == pytest.approx(cogged + plant._PLAY_DEG, abs=1e-6)
    # after the jolt: a ringing of the damped frequency
    sway = (behind - motor)[580:1500]
    crossings = np.flatnonzero(np.diff(np.sign(sway - np.mean(sway[-200:]))))[:4]
    damped_hz = plant._SWAY_HZ * math.sqrt(1.0 - plant._SWAY_DAMPING**2)
    assert np.mean(np.diff(crossings)) * step_s == pytest.approx(0.5 / damped_hz, rel=0.1)


def test_noise_is_white_flicker_walk_and_pulses():
    taus = 0.8 * np.array([16.0, 128.0, 1024.0])
    found = deviations(TUNED_ROTOR, taus, 24_000, 0.8)
    sheet = lab.SHEET
    white = (1.0 - lab._SWAY_SHARE) * 3600.0 * sheet.arw_deg_per_sqrt_h**2 / taus
    flicker = 2.0 * math.log(2.0) / math.pi * sheet.bias_instability_dph**2
    walk = sheet.rate_random_walk_dph_per_sqrt_h**2 * taus / 3600.0 / 3.0
    np.testing.assert_allclose(found, np.sqrt(white + flicker + walk), rtol=0.12)
    sway = lab._sway(400_000, drawn(1, "sway"))
    assert sway.var() == pytest.approx(lab._SWAY_SHARE, rel=0.02)


def test_a_null_case_is_the_nominal_model_and_noise(tmp_path):
    """Scale factor, slope and a bias a run, fitted to the files: what is left has the noise's spectrum."""
    left = null_residual(TUNED_ROTOR, tmp_path, 4242, ("rates", "positions"))
    assert left.var() == pytest.approx(1.0, abs=0.15)
    assert abs(stats.kurtosis(left)) < 0.4 and np.abs(left).max() < 5.0


def test_campaign_masks_and_rows(stages):
    assert len(stages) == 26 and len({stage.key for stage in stages}) == 26
    shown = {stage.profile for stage in stages if not stage.held_out}
    assert {stage.profile for stage in stages} - shown == {"mixed day"}
    for stage in stages:
        assert (np.diff(stage.edges_s) > 0.3).all()
        # what follows a loss, and a move, has no output; the rest has
        after_loss = np.flatnonzero(~stage.kept[:-1] & stage.kept[1:]) + 1
        assert not stage.valid[after_loss].any()
        if stage.code == "PT":
            moving = stage.in_rows(np.abs(stage.rate_dps)) > 0.5
            assert moving.any() and not (moving & stage.valid).any()
    assert {round(float(np.median(np.diff(stage.edges_s))), 1) for stage in stages} == {0.8, 2.5}
    t_in = np.concatenate([stage.t_in_c for stage in stages])
    assert t_in.min() < -3.0 and t_in.max() > 55.0
    assert max(stage.rate_dps.max() for stage in stages) == pytest.approx(35.0, rel=0.1)


def test_the_true_rate_is_what_the_catalogue_expects_of_the_log(stages):
    for stage in stages[:9]:
        if stage.code != "PT":
            mine = stage.in_seconds(sensed_dph(stage, TUNED_ROTOR.latitude_deg))
            np.testing.assert_allclose(mine, stimulus(TUNED_ROTOR, stage).input_rate_dph, rtol=1e-6, atol=0.2)


def test_true_values_are_those_of_the_catalogues_own_columns(stages):
    """A signal whose truth is stated is the catalogue's column times that value, but for its form."""
    stated = [name for name, effect in TUNED_ROTOR.effects.items() if effect.truth and name != "detent"]
    for name in stated:
        assert share_of_the_column(TUNED_ROTOR, UNIT, stages, name) == pytest.approx(1.0, abs=0.08), name
    assert set(stated) == {"unbalance", "bridge", "lean", "latency"}


def test_every_effect_acts_and_only_those_called_so_change(stages):
    for name, effect in TUNED_ROTOR.effects.items():
        # where a turning table starts is random
        turning = ("SP", "SN", "RS", "MD") if name in ("eccentric", "cogs") else ()
        apart, whole = repeats_apart(TUNED_ROTOR, UNIT, stages, name, turning)
        assert whole > 0.0, name
        # Earth rate on a leaning axis turns with the table
        if name != "lean":
            assert (apart > 0.2) == effect.changing, (name, apart)


def test_a_case_has_the_ratio_planned_and_its_logs_are_read(tmp_path, stages):
    prepare_folder(TUNED_ROTOR, tmp_path)
    make_case(TUNED_ROTOR, tmp_path, Plan("pair_1", "pair", 9, (("leads", 4.0), ("stiction", 2.0))))
    seal = read_seal(tmp_path / "sealed" / "pair_1.json")
    assert dict(seal.snr) == pytest.approx({"leads": 4.0, "stiction": 2.0}, rel=0.02)
    assert seal.names["leads"] == ("hysteresis",) and seal.left_out == ("MD|0",)
    stage = next(stage for stage in stages if stage.code == "SL")
    rate = stage.in_rows(sensed_dph(stage, TUNED_ROTOR.latitude_deg))
    write_case(tmp_path / "one", TUNED_ROTOR, [Logged(stage, rate, *TUNED_ROTOR.read(UNIT, stage, drawn(0)))])
    run = read_recordings([tmp_path / "one" / "runs.toml"]).runs[0]
    assert run.stimulus.period_s == pytest.approx(2.5, rel=0.02)
