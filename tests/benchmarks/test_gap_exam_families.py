"""The plant families: noise as documented, inputs up to the limits stated, true values as in the catalogue."""

import math
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import read_recordings
from bench.analysis.gap._data import GapRun
from bench.record.exchange import read_log, read_mapping
from benchmarks.gap_exam import __main__ as command
from benchmarks.gap_exam import _mems, _ring_laser
from benchmarks.gap_exam._exam_plant import EXAM_PLANT, make_exam_case
from benchmarks.gap_exam._files import Logged, gap_of, read_arrays, read_seal, run_keys, write_case
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._make import Plan, draw_unit, kinds_of, make_case, plan, prepare_folder
from benchmarks.gap_exam._mems import MEMS
from benchmarks.gap_exam._ring_laser import RING_LASER
from benchmarks.gap_exam._separable import indistinct
from benchmarks.gap_exam._signals import drawn
from benchmarks.gap_exam._whitening import NoiseLevels, Part, deflection
from tests.gap_families import deviations, share_of_the_column, still, stimulus

FAMILIES = {"ring_laser": RING_LASER, "mems": MEMS}


@pytest.fixture(scope="module", params=FAMILIES)
def made(request):
    """A family, a unit of it and the unit's campaign."""
    family = FAMILIES[request.param]
    unit = draw_unit(family, 5, {})
    return family, unit, family.campaign(unit)


def test_ring_laser_noise_is_white_markov_and_walk():
    taus = np.array([4.0, 32.0, 256.0, 2000.0])
    sheet = _ring_laser.SHEET
    ratio = taus / _ring_laser.MARKOV_S
    # IEEE Std 952, C.1.4: the exponentially correlated process
    markov = sheet.bias_instability_dph**2 * 2.0 / ratio
    markov *= 1.0 - (3.0 - 4.0 * np.exp(-ratio) + np.exp(-2.0 * ratio)) / (2.0 * ratio)
    walk = sheet.rate_random_walk_dph_per_sqrt_h**2 * taus / 3600.0 / 3.0
    expected = np.sqrt(3600.0 * sheet.arw_deg_per_sqrt_h**2 / taus + markov + walk)
    np.testing.assert_allclose(deviations(RING_LASER, taus, 20_000), expected, rtol=0.15)


def test_mems_noise_is_white_flicker_and_walk():
    taus = np.array([8.0, 64.0, 512.0])
    sheet = _mems.SHEET
    flicker = 2.0 * math.log(2.0) / math.pi * sheet.bias_instability_dph**2
    walk = sheet.rate_random_walk_dph_per_sqrt_h**2 * taus / 3600.0 / 3.0
    expected = np.sqrt(3600.0 * sheet.arw_deg_per_sqrt_h**2 / taus + flicker + walk)
    np.testing.assert_allclose(deviations(MEMS, taus, 20_000), expected, rtol=0.15)


def test_mems_white_noise_has_the_colour_of_its_filter():
    """Rows of the output's own period show the AR(2) spectrum."""
    n = 60_000
    stage = still(n, 0.1)
    output = MEMS.rows(draw_unit(MEMS, 1, {}), stage, np.zeros(n), drawn(1, "noise"))
    power = np.abs(np.fft.rfft(output - output.mean())) ** 2 / n
    a, b = _mems.AR2
    for turn in (0.2, 0.5, 0.9):
        z = np.exp(-1j * np.pi * turn)
        expected = 36000.0 * 0.06**2 * (1.0 - a - b) ** 2 / abs(1.0 - a * z - b * z * z) ** 2
        middle = round(turn * n / 2)
        assert power[middle - 900 : middle + 900].mean() == pytest.approx(expected, rel=0.12)


def test_a_campaign_has_at_most_27_runs_and_a_profile_never_shown(made):
    _, _, stages = made
    assert len(stages) == 27
    assert len({stage.run_id for stage in stages}) == len({stage.key for stage in stages}) == 27
    shown = {stage.profile for stage in stages if not stage.held_out}
    assert {stage.profile for stage in stages} - shown in ({"other cycle"}, {"stairs"})


def test_inputs_reach_the_limits_stated(made):
    family, _, stages = made
    rates = np.concatenate([stage.axis_dps for stage in stages])
    cold = min(stage.t_in_c.min() for stage in stages)
    hot = max(stage.t_in_c.max() for stage in stages)
    fastest, coldest, hottest = {"ring_laser": (100.0, -33.0, 45.0), "mems": (300.0, -33.0, 55.0)}[
        family.name
    ]
    assert np.quantile(rates, 0.9999) == pytest.approx(fastest, rel=0.02)
    assert rates.min() == pytest.approx(-fastest, rel=0.05)
    assert cold < coldest and hot > hottest
    periods = {round(float(np.median(np.diff(stage.edges_s))), 1) for stage in stages}
    assert periods == ({0.2, 0.5, 1.0} if family is RING_LASER else {0.1, 0.5, 0.8, 1.0, 2.0})


def test_rows_without_an_output_are_those_of_a_moving_table(made):
    family, _, stages = made
    for stage in stages:
        jumps = np.abs(np.diff(stage.rate_dps, prepend=stage.rate_dps[0])) / stage.step_s
        moving = stage.in_rows(jumps) > (8.0 if stage.code == "RT" else 1.0)
        if stage.code in ("PO", "TU", "RT"):
            assert not (moving & stage.valid).any()
            assert 0.02 < 1.0 - stage.valid.mean() < 0.2
        else:
            assert stage.valid.all()
    missing = [stage.code for stage in stages if not stage.kept[~stage.valid].all()]
    assert set(missing) == ({"RT"} if family is RING_LASER else {"TU"} & set(missing))


def test_logs_say_in_their_own_units_what_happened(made, tmp_path):
    family, unit, stages = made
    codes = ("PO", "RT", "SL") if family is RING_LASER else ("TU", "RA", "RS")
    for stage in [next(stage for stage in stages if stage.code == code) for code in codes]:
        rng = drawn(0, "log")
        rate = stage.in_rows(sensed_dph(stage, family.latitude_deg))
        write_case(tmp_path, family, [Logged(stage, rate, *family.read(unit, stage, rng))])
        mapping = read_mapping(tmp_path / "runs.toml")
        log = read_log(tmp_path / mapping.run[0].file, mapping)
        output = log.columns["output"][1:]
        np.testing.assert_allclose(
            3600.0 * output, np.where(stage.valid, rate, np.nan)[stage.kept], rtol=1e-9
        )
        np.testing.assert_allclose(log.time_s[1:], stage.edges_s[1:][stage.kept], atol=1e-6)
        true = stage.in_rows(stage.t_in_c)[stage.kept]
        assert np.abs(log.columns["t_in"][1:] - true).max() < (0.1 if family is RING_LASER else 0.2)
        middle = stage.in_rows(stage.elevation_deg)[stage.kept]
        standing = stage.valid[stage.kept]
        np.testing.assert_allclose(log.columns["elevation"][1:][standing], middle[standing], atol=1e-9)
        turn = log.columns["angle"] - stage.at_edges(stage.angle_deg)[np.concatenate(([True], stage.kept))]
        # a pause may hide whole turns
        assert np.ptp(turn - 360.0 * np.round(turn / 360.0)) < 1e-3


def test_the_true_rate_is_what_the_catalogue_expects_of_the_log(made):
    family, _, stages = made
    for stage in stages:
        if stage.step_s == 1.0 or not stage.turning or stage.code in ("PO", "TU"):
            continue
        s = stimulus(family, stage)
        mine = stage.in_seconds(sensed_dph(stage, family.latitude_deg))
        # within a second of the sweep the level axis turns faster and faster: the catalogue takes a mean speed
        np.testing.assert_allclose(
            mine, s.input_rate_dph, rtol=1e-7, atol=0.8 if stage.code == "SW" else 5e-3
        )


def test_true_values_are_those_of_the_catalogues_own_columns(made):
    """A signal whose truth is stated is the catalogue's column times that value, but for its form."""
    family, unit, stages = made
    for name, effect in family.effects.items():
        if effect.truth is None or name in ("mode_hop", "trim_step"):
            continue
        assert share_of_the_column(family, unit, stages, name) == pytest.approx(1.0, abs=0.08), name


def test_every_effect_is_finite_and_seen_somewhere(made):
    family, unit, stages = made
    for name, effect in family.effects.items():
        total = 0.0
        for stage in stages[:9]:
            signal = effect.signal(unit, stage, effect.sizes[1] if effect.curved else 1.0)
            assert signal.shape == (stage.steps,) and np.isfinite(signal).all(), name
            total += float(np.ptp(signal))
        assert total > 0.0 or name in ("after_cycles", "cracked"), name


def test_effects_that_change_differ_between_repeats_and_others_hardly(made):
    family, unit, stages = made
    pairs = [(a, b) for a in stages for b in stages if a.code == b.code and (a.repeat, b.repeat) == (0, 1)]
    for name, effect in family.effects.items():
        # where a turning table starts is random: what follows its angle differs in time, not in kind
        if effect.names or name in ("third", "wound_cable"):
            continue
        apart = whole = 0.0
        for a, b in pairs:
            first, second = (stage.in_seconds(effect.signal(unit, stage, 1.0)) for stage in (a, b))
            n = min(len(first), len(second))
            apart += float(np.var(first[:n] - second[:n]))
            whole += float(np.var(first) + np.var(second))
        assert (apart > 0.2 * whole) == effect.changing, (name, apart / max(whole, 1e-30))


def test_the_deflection_of_a_sine_in_white_noise_is_the_closed_form():
    n, amplitude, white = 4096, 0.3, 0.01
    sine = amplitude * np.sin(2.0 * np.pi * 50.0 * (np.arange(n) + 0.5) / n)
    part = Part(sine[None], np.ones((1, n)), np.ones(n, bool))
    found = deflection([part, part], NoiseLevels(white, 0.0, 0.0))
    assert found == pytest.approx(amplitude * math.sqrt(n) / (60.0 * white), rel=1e-9)
    twin = Part(sine[None], np.stack((sine, np.ones(n))), np.ones(n, bool))
    assert deflection([twin, twin], NoiseLevels(white, 0.0, 0.0)) == pytest.approx(0.0, abs=1e-4)


def test_the_runs_tell_a_curve_from_a_tilt_and_not_an_effect_from_its_own_column(tmp_path):
    prepare_folder(RING_LASER, tmp_path)
    make_case(RING_LASER, tmp_path, Plan("single_1", "single", 77, (("mass_squared", 2.0),)))
    sheet = RING_LASER.sheet
    noise = NoiseLevels(sheet.arw_deg_per_sqrt_h, sheet.bias_instability_dph, 0.001, sheet.quantum_arcsec)
    mass = {"mass_squared": ["acceleration_squared"]}
    assert indistinct(tmp_path, "single_1", mass, ["acceleration_squared"], noise)
    assert not indistinct(tmp_path, "single_1", mass, ["bias_quadratic"], noise)
    assert not indistinct(tmp_path, "single_1", mass, ["noise_level"], noise)


def test_cases_have_the_ratio_planned_and_come_out_the_same_again(tmp_path):
    prepare_folder(RING_LASER, tmp_path)
    single = next(what for what in plan(RING_LASER, 3, 12) if what.kind == "pair")
    make_case(RING_LASER, tmp_path, single)
    seal = read_seal(tmp_path / "sealed" / f"{single.name}.json")
    assert dict(seal.snr) == pytest.approx(dict(single.effects), rel=1e-3)
    first = (tmp_path / "cases" / single.name / "PO_1.csv").read_bytes()
    make_case(RING_LASER, tmp_path, single)
    assert (tmp_path / "cases" / single.name / "PO_1.csv").read_bytes() == first
    assert plan(RING_LASER, 3, 12) == plan(RING_LASER, 3, 12)
    assert kinds_of(12).count("null") == 3 and kinds_of(24).count("noise") == 2


def test_the_exams_own_plant_is_written_as_the_others_are(tmp_path):
    prepare_folder(EXAM_PLANT, tmp_path)
    make_exam_case(tmp_path, Plan("mixed_1", "mixed", 3, ()))
    seal = read_seal(tmp_path / "sealed" / "mixed_1.json")
    known, foreign = (name for name, _ in seal.effects)
    assert known in seal.names[known] and seal.names[foreign] == ()
    assert set(seal.snr) == {known, foreign} and 1.0 <= seal.snr[known] <= 30.0
    runs = read_recordings(
        [tmp_path / "cases" / "mixed_1" / "runs.toml"], [Path(run) for run in seal.held_out]
    )
    rates = [[run for run in part if isinstance(run, GapRun)] for part in (runs.runs, runs.held_out)]
    assert [len(part) for part in rates] == [16, 8]
    parts = read_arrays(tmp_path / "sealed" / "mixed_1.npz")
    keys = run_keys(tmp_path / "cases" / "mixed_1")
    for run in runs.shown:
        gap = gap_of(parts, [known, foreign], keys[run.run_id])
        left = run.output_dph - run.stimulus.input_rate_dph - gap
        # white noise of the sheet, its scale factor and slope of bias
        assert (
            np.std(np.diff(left)) == pytest.approx(np.sqrt(2.0) * 60.0 * 0.004, rel=0.1)
            or run.condition != "east"
        )


@pytest.mark.slow
def test_several_processes_make_what_one_makes(tmp_path, capsys):
    words = ["make", "exam_plant", "--seed", "4", "--cases", "2", "--out"]
    command.main([*words, str(tmp_path / "one")])
    command.main([*words, str(tmp_path / "two"), "--jobs", "2"])
    assert sorted(capsys.readouterr().out.split()) == ["null_4_0", "null_4_0", "single_4_1", "single_4_1"]
    for name in ("null_4_0", "single_4_1"):
        one, two = (tmp_path / folder / "sealed" / f"{name}.json" for folder in ("one", "two"))
        assert one.read_text() == two.read_text()
    command.main([*words, str(tmp_path / "one")])
    assert capsys.readouterr().out == ""  # nothing is made twice
