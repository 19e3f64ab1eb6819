"""Parts of the diagnosis by hand: harmonics, times to wait, grids, pools, curves, noise, marks of an exam."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.fft import dct
from scipy.stats import norm
from statsmodels.stats.proportion import proportion_confint

from bench.analysis.gap import Noise, _exam
from bench.analysis.gap._cells import BANDS
from bench.analysis.gap._channel_data import Demand, _in_force, _late_fraction, _quiet
from bench.analysis.gap._data import Group
from bench.analysis.gap._designs import usual_designs
from bench.analysis.gap._fit import Floor, floor_from_repeats
from bench.analysis.gap._generic import free_curves
from bench.analysis.gap._lines import SpectralLine, _of_one_length, _surroundings
from bench.analysis.gap._noise import periodogram
from bench.analysis.gap._refine import _spacing
from bench.analysis.gap._rehearsal import _phase_means
from bench.analysis.gap._rows import Steps
from bench.analysis.gap._run_folder import _filled
from bench.analysis.gap._score import Exam, Marked, wilson
from bench.analysis.gap._stochastic import NoiseVerdict, _starts, judge_noise
from bench.analysis.gap._where import REGIMES, phase_map, regime_map
from bench.record.recording import Arrivals
from drivers.base.errors import ConfigurationError
from simulators.effects import Stimulus, Variant
from tests.analysis.gap.conftest import effect, made_run, stimulus


@pytest.mark.parametrize(
    ("turns", "harmonic"),
    [(1.0, 1), (0.5, 2), (1 / 3, 3), (1 / 24, 24), (1 / 25, 0), (0.0, 0), (-1.0, 0), (2.0, 0), (0.345, 0)],
)
def test_a_line_is_a_harmonic_if_a_turn_holds_a_whole_number_of_its_periods(turns, harmonic):
    line = SpectralLine("p", 40.0, 1.0, 1.0, turns)
    assert line.harmonic == harmonic and line.frequency_hz == 0.025
    assert replace(line, turns=turns * 1.005).harmonic == harmonic  # half a percent is the rate's own error


def test_a_demand_is_reached_after_its_way_and_half_an_hour():
    """From 20 to -40 degC at 2 K/min: 30 min; to 0 degC at once: a kelvin a second of a minute, 40 min."""
    demands = [
        Demand(100.0, 20.0, math.inf),
        Demand(1000.0, -40.0, 2.0 / 60.0),
        Demand(9000.0, 0.0, math.inf),
    ]
    times_s = np.array([0.0, 100.0, 999.0, 1000.0, 8999.0, 9000.0, 1e5])
    assert _in_force(demands, times_s).tolist() == [0, 0, 0, 1, 1, 2, 2]
    # each is reached at its ramp from where the one before went, and holds for half an hour
    settled_s = np.array([1000.0 + 1800.0 + 1800.0, 9000.0 + 2400.0 + 1800.0])
    assert not _quiet(demands, times_s[:4]).any()
    assert not _quiet(demands, settled_s - 1.0).any()
    assert _quiet(demands, settled_s + 1.0).all()
    assert _quiet([], times_s).all()


def test_the_spacing_of_a_grid_is_half_of_both_neighbours_and_at_its_end_the_one():
    shape = effect("warm_up")
    grid = sorted({float(each["time_constant_s"]) for each in shape.shapes})
    assert len(grid) > 2
    for at in range(len(grid)):
        low, high = grid[max(at - 1, 0)], grid[min(at + 1, len(grid) - 1)]
        steps = (at > 0) + (at < len(grid) - 1)
        found = _spacing(Variant(shape, {"time_constant_s": grid[at] * 1.0001, "stretch": 0.9}))
        assert found == pytest.approx({"time_constant_s": (high - low) / steps, "stretch": 0.5})


def test_runs_of_one_length_are_looked_at_together_and_each_alone():
    rng = np.random.default_rng(1)
    groups = [
        Group(name, ("0",), ((made_run(name, stimulus(n), rng, profile=name),),))
        for name, n in (("a", 4000), ("b", 5000), ("c", 4000))
    ]
    assert _of_one_length(groups) == [[0], [1], [2], [0, 2]]
    assert _of_one_length(groups[:2]) == [[0], [1]]


def test_surroundings_are_the_median_beside_a_window_and_its_neighbours():
    energy = np.ones(101)
    energy[50] = 1e6
    found = _surroundings(energy)
    assert found.tolist() == pytest.approx([1.0] * 101)


def curves(*runs):
    return {variant.effect.name for variant in free_curves(list(runs))}


def test_free_curves_are_drawn_over_what_changes_enough():
    rng = np.random.default_rng(1)
    still = made_run("still", stimulus(4000, cold=False), rng)
    shock = made_run("shock", stimulus(4000), rng)
    turning = made_run("turning", stimulus(4000, rate_dps=5.0, cold=False), rng)
    assert curves(still) == {"free curve: bias over table angle", "free curve: bias over time since power-on"}
    assert {"T_in", "T_out", "dT_in/dt", "T_in - T_out"} <= {
        word
        for name in curves(shock)
        for word in ("T_in", "T_out", "dT_in/dt", "T_in - T_out")
        if word in name
    }
    assert any("T_out" in name and "T_in" not in name for name in curves(shock))
    assert len(curves(turning)) == 4 and len(curves(shock, turning)) > len(curves(shock))


SHEET = Noise(0.004)


def spectra(noise_of, n=20_000, runs=4):
    rng = np.random.default_rng(3)
    rows = np.stack([noise_of(rng, n) for _ in range(runs)])
    return [periodogram(dct(rows, norm="ortho", axis=1), 1.0)]


def test_white_noise_of_the_sheet_is_no_effect_and_twice_as_much_is():
    """0.004 deg/sqrt(h) is 0.24 deg/h in 1 s means: 60 times as many deg/h as deg/sqrt(h) in a second."""
    verdict = judge_noise(spectra(lambda rng, n: rng.normal(0.0, 0.24, n)), SHEET, "repeats")
    assert verdict.named == "" and verdict.noise.arw_deg_per_sqrt_h == pytest.approx(0.004, rel=0.05)
    louder = judge_noise(spectra(lambda rng, n: rng.normal(0.0, 0.48, n)), SHEET, "repeats")
    assert louder.named == "noise_level" and louder.probabilities["noise_level"] > 0.9
    assert louder.noise.arw_deg_per_sqrt_h == pytest.approx(0.008, rel=0.05)
    assert louder.risen("noise_level").startswith("arw_deg_per_sqrt_h = 0.00")
    assert louder.risen("noise_level").endswith(", the model has 0.004") and louder.risen("shupe") == ""
    assert sum(louder.probabilities.values()) == pytest.approx(1.0)


def test_a_walk_beside_white_noise_is_named_as_one():
    """A walk of 2 deg/h/sqrt(h): steps of 2 / 60 deg/h a second."""
    walk = judge_noise(
        spectra(lambda rng, n: rng.normal(0.0, 0.24, n) + np.cumsum(rng.normal(0.0, 2.0 / 60.0, n))),
        SHEET,
        "repeats",
    )
    assert walk.named == "rate_random_walk"
    assert walk.noise.rate_random_walk_dph_per_sqrt_h == pytest.approx(2.0, rel=0.2)


def test_without_spectra_the_sheet_holds():
    verdict = judge_noise([], SHEET, "repeats")
    assert (verdict.named, verdict.noise, verdict.source, verdict.risen("noise_level")) == (
        "",
        SHEET,
        "data sheet",
        "",
    )


def mark(kind="single", snr=2.0, effects=("shupe",), causes=None, **changes):
    fields = {
        "seed": 1, "kind": kind, "effects": effects, "stochastic": "", "snr": snr, "sha256": "",
        "causes": {"shupe": 0.9} if causes is None else causes, "alternatives": {}, "stochastic_named": (),
        "unknown": 0.1, "placed": True, "stated_share": (0.9, 0.8, 0.99), "true_share": 0.95, "seconds": 1.0,
    }  # fmt: skip
    return Marked(**(fields | changes))


def lines(*marked):
    return {(line.what, line.snr): (line.right, line.of) for line in Exam(1, len(marked), marked).lines}


def test_an_exams_lines_count_what_was_right():
    both = {"shupe": 0.9, "warm_up": 0.8}
    found = lines(
        mark(),
        mark(causes={"warm_up": 0.9}, placed=False, true_share=0.90),
        mark("pair", effects=("shupe", "warm_up"), causes=both),
        mark("pair", effects=("shupe", "warm_up"), causes={"shupe": 0.9}, snr=1.0),
        mark("pair", effects=("shupe", "warm_up"), causes=both, snr=0.9),
        mark("null", effects=(), causes={}, snr=0.0),
    )
    assert found["pairs: precision", "1..30"] == (3, 3)
    assert found["pairs: recall", "1..30"] == (3, 4)
    exact = {snr: hits for (what, snr), hits in found.items() if what == "pair: exactly both"}
    assert sum(right for right, _ in exact.values()) == 2 and sum(of for _, of in exact.values()) == 3
    placed = [hits for (what, _), hits in found.items() if what.startswith("place: ")]
    assert sum(right for right, _ in placed) == 3 and sum(of for _, of in placed) == 4
    null = next(hits for (what, _), hits in found.items() if what.startswith("null: "))
    assert null == (0, 1)


def test_claims_are_gathered_in_tenths_and_held_against_what_came_true():
    """Ten claims of 0.85, of which half are right, and ten of nothing unknown at 0.05, all of them right."""
    right, wrong = mark(causes={"shupe": 0.85}, unknown=0.05), mark(causes={"warm_up": 0.85}, unknown=0.05)
    bins, error = Exam(1, 10, (right,) * 5 + (wrong,) * 5).reliability
    assert [(round(each.stated, 9), each.count, each.true) for each in bins] == [(0.05, 10, 0), (0.85, 10, 5)]
    assert error == pytest.approx((0.05 * 10 + 0.35 * 10) / 20)
    sure, _ = Exam(1, 1, (mark(causes={"shupe": 1.0}, unknown=0.0),)).reliability
    assert [(each.stated, each.count, each.true) for each in sure] == [(0.0, 1, 0), (1.0, 1, 1)]


def test_shrinkage_of_an_exam_is_that_of_single_effects_and_pairs_that_can_be_seen():
    shares = (0.5, 0.9, 0.95, 1.0)
    marked = [mark(true_share=share) for share in shares]
    median, tenth = Exam(1, 5, (*marked, mark("null", effects=(), true_share=0.0))).shrinkage_quantiles
    assert (median, tenth) == (pytest.approx(0.925), pytest.approx(0.62))
    assert all(map(math.isnan, Exam(1, 0, ()).shrinkage_quantiles))


@pytest.mark.parametrize(("right", "of"), [(7, 10), (0, 10), (10, 10), (181, 200)])
def test_wilsons_interval_is_that_of_statsmodels(right, of):
    expected = proportion_confint(right, of, alpha=2.0 * norm.sf(1.96), method="wilson")
    assert wilson(right, of) == pytest.approx(expected, abs=1e-9)
    assert wilson(0, 0) == (0.0, 1.0)


def test_a_noise_coefficient_is_looked_for_from_its_own_size_or_from_the_white_noises():
    """0.024 deg/h: 6 times 0.004 deg/sqrt(h), the bias instability that such a white noise usually goes with."""
    near = pytest.approx([0.036, 0.096, 0.36])
    assert _starts(SHEET, "bias_instability_dph") == near
    assert _starts(SHEET, "rate_random_walk_dph_per_sqrt_h") == near
    assert _starts(Noise(0.004, 0.1), "bias_instability_dph") == pytest.approx([0.15, 0.4, 1.5])
    assert _starts(Noise(0.004, 0.1), "rate_random_walk_dph_per_sqrt_h") == pytest.approx([0.15, 0.4, 1.5])


def test_a_plans_settings_are_what_its_stimuli_do():
    plans = {plan.procedure: plan for plan in usual_designs(39.1)}
    level = plans["constant-rotation"]
    (turning,) = level.stimuli.values()
    assert np.median(turning.table_rate_dps) == pytest.approx(level.settings["rate_dps"])
    turns_s = level.settings["turns"] * 360.0 / level.settings["rate_dps"]
    assert len(turning) * turning.period_s == pytest.approx(turns_s, abs=0.5)
    (steps,) = plans["standard-test"].stimuli.values()
    rates = np.unique(np.round(steps.table_rate_dps, 6))
    rates = rates[np.abs(rates - np.round(rates)) < 1e-6]  # the samples in which no step begins
    assert rates.tolist() == (-rates[::-1]).tolist() and 0.0 in rates
    assert rates.max() == plans["standard-test"].settings["max_rate_dps"]
    three = [float(np.median(s.table_rate_dps)) for s in plans["scale-factor-cold-shock"].stimuli.values()]
    assert three == pytest.approx([20.0, -20.0, 0.0])


def test_means_of_phases_count_from_each_phases_begin():
    time_s = np.arange(1.0, 451.0)
    values = np.where(time_s <= 250, 1.0, 5.0)
    values[200:250] = np.nan
    phase = np.where(time_s <= 250, "soak", "shock")
    series = SimpleNamespace(inputs=SimpleNamespace(time_s=time_s), phase=phase, values=values)
    found = _phase_means(series)
    assert list(found) == ["0 soak", "1 shock"]
    assert found["0 soak"].tolist() == pytest.approx([1.0, 1.0, math.nan], nan_ok=True)
    assert found["1 shock"].tolist() == [5.0, 5.0]


def test_a_map_of_regimes_holds_energies_against_how_many_there_are():
    """Whitened coefficients of size one are the floor itself: a ratio of one; of size zero, of nothing."""
    run = made_run("still", stimulus(4000, cold=False), np.random.default_rng(1))
    group = Group("shock", ("0",), ((run,),))
    floor = Floor(np.ones(len(BANDS)), np.zeros(len(BANDS)), from_repeats=True)
    every = {"shock": set(range(len(BANDS)))}
    for size, ratio in ((1.0, 1.0), (2.0, 4.0), (0.0, 0.0)):
        places = regime_map([group], [np.full((1, 3999), size)], floor, SHEET, every)
        whole = [place for place in places if place.of in ("T_in", "table rate")]
        assert [place.energy_ratio for place in whole] == pytest.approx([ratio] * 2, rel=1e-6)
        assert all(0.0 <= place.p_value <= 1.0 for place in places)
    assert regime_map([group], [np.zeros((1, 3999))], floor, SHEET, {}) == []


def test_a_short_run_of_a_profile_adds_nothing_to_bands_that_it_has_not():
    """128 s have no coefficient slower than 256 s: the slowest bands are those of the long run alone."""
    long, short = (
        made_run(name, stimulus(n, cold=False), np.random.default_rng(n))
        for name, n in (("l", 4000), ("s", 128))
    )
    groups = [Group("shock", ("0",), ((run,),)) for run in (long, short)]
    floor = Floor(np.ones(len(BANDS)), np.zeros(len(BANDS)), from_repeats=True)
    left = [np.full((1, 3999), 2.0), np.full((1, 127), 2.0)]
    slow = {"shock": {0, 1}}
    assert regime_map(groups, left, floor, SHEET, slow) == regime_map(
        groups[:1], left[:1], floor, SHEET, slow
    )


def test_intervals_of_what_has_a_sign_are_the_same_on_both_sides():
    for regime in REGIMES:
        assert list(regime.edges) == sorted(set(regime.edges))
        if regime.of in ("dT_in/dt", "table rate"):
            assert list(regime.edges) == [-edge for edge in reversed(regime.edges)]


def over_input(t_in_c):
    time_s = np.arange(1.0, len(t_in_c) + 1.0)
    level = np.full(len(t_in_c), 90.0)
    s = Stimulus(time_s, t_in_c, t_in_c, np.zeros(len(t_in_c) + 1), level, 39.1)
    return curves(made_run("r", s, np.random.default_rng(1)))


def test_a_span_of_ten_kelvin_shows_a_curve_and_one_below_does_not_though_its_rate_may():
    held = np.interp(np.arange(4000), [1000, 3000], [15.0, 25.0])
    assert any("T_in" in name and "dT_in" not in name for name in over_input(held))
    small = over_input(20.0 + 4.0 * np.sin(np.arange(4000) / 50.0))  # up to 4.8 K/min
    assert not any("T_in" in name and "dT_in" not in name for name in small)
    assert any("dT_in/dt" in name for name in small)


def test_effects_of_an_examined_case_have_the_size_asked_for_and_signs_in_turn(monkeypatch):
    """A signature of norm 4 for a unit effect, an SNR of 2 (a norm of 20): five times as much."""
    time_s = np.arange(1.0, 6.0)
    run = SimpleNamespace(
        time_s=time_s, t_in_c=time_s, t_out_c=time_s, angle_deg=np.zeros(6), elevation_deg=np.zeros(5)
    )
    truths = [SimpleNamespace(**vars(run), repeat=repeat) for repeat in range(_exam.REPEATS)]
    truths = [SimpleNamespace(**vars(t), profile="p", condition="0", phase=np.full(5, "run")) for t in truths]
    for name, stand_in in {
        "draw_case": lambda *_: SimpleNamespace(effects={"a": None, "b": None}, seed=7, snr=2.0),
        "simulate_campaign": lambda *_: truths,
        "signal_dph": lambda *_: np.ones(5),
        "signature_norm": lambda *_: 4.0,
        "outputs_dph": lambda _, truths, *__, **___: [np.zeros(5) for _ in truths],
        "true_region": lambda *_: (),
    }.items():
        monkeypatch.setattr(_exam, name, stand_in)
    sealed, given, kept, clean = _exam.make_case(7, "pair")
    assert sealed.amplitudes == {"a": -5.0, "b": 5.0}
    assert (len(given), len(kept), len(clean)) == (_exam.REPEATS - 1, 1, 1)


def test_a_risen_coefficient_is_told_by_the_effect_that_raised_it():
    sheet, rises = Noise(0.004, 0.1, 0.5, 0.2), {"bias_instability": 0.3, "quantisation": 0.4}
    verdict = NoiseVerdict(sheet, {"bias_instability": 1.0}, "repeats", rises, sheet)
    assert verdict.risen("bias_instability") == "bias_instability_dph = 0.3, the model has 0.1"
    assert verdict.risen("quantisation") == "quantum_arcsec = 0.4, the model has 0.2"
    assert verdict.risen("noise_level") == ""


def test_an_effect_below_a_third_of_the_noise_is_in_no_band_of_an_exam():
    assert not any(what.startswith("single: ") for what, _ in lines(mark(snr=0.2)))
    bands = {
        snr for what, snr in lines(*(mark(snr=snr) for snr in (0.3, 1.0, 3.0, 29.9))) if "single: " in what
    }
    assert bands == {"0.3..1", "1..3", "3..10", "10..30"}


def test_a_map_of_phases_holds_energies_against_the_floor():
    """Coefficients of size one and any sign are the floor: every phase and band has as much as it should."""
    rng = np.random.default_rng(1)
    run = made_run("still", stimulus(4000), rng)
    group = Group("shock", ("0",), ((run,),))
    floor = Floor(np.ones(len(BANDS)), np.zeros(len(BANDS)), from_repeats=True)
    signs = rng.choice([-1.0, 1.0], size=(1, 3999))
    for size, ratio in ((1.0, 1.0), (3.0, 9.0)):
        places = phase_map([group], [size * signs], floor, SHEET)
        assert {place.part for place in places} == {"room", "shock"}
        fast = [place for place in places if place.band == BANDS[-1]]
        assert [place.energy_ratio for place in fast] == pytest.approx([ratio] * len(fast), rel=0.15)


def test_missing_seconds_are_bridged_up_to_a_fifth():
    run = SimpleNamespace(place="runs/r")
    values = np.arange(10.0)
    values[[3, 7]] = np.nan
    assert _filled(values, run, "T").tolist() == list(range(10))
    values[5] = np.nan
    with pytest.raises(ConfigurationError) as refused:
        _filled(values, run, "T")
    assert refused.value.found == "30 % of the seconds without a value"
    assert _filled(np.full(10, np.nan), run, "T") is None


def test_a_late_mark_stands_for_every_frame_since_the_one_before():
    count = np.array([0, 1, 2, 6, 7, 8])
    seen = Arrivals(count, 0.01 * count, 0.01)
    assert _late_fraction(seen, np.array([0.0, 0.0, 0.0, 1000.0, 0.0, 0.0])) == 0.5
    assert _late_fraction(seen, np.array([0.0, 1000.0, 0.0, 0.0, 0.0, 0.0]) - 1000.0 * (count == 6)) == 0.125


def test_without_repeats_the_floor_is_the_models_as_of_forty_coefficients_a_band():
    floor = floor_from_repeats([], np.zeros(0))
    assert floor.ratio.tolist() == [1.0] * len(BANDS) and not floor.from_repeats
    assert floor.sigma.tolist() == pytest.approx([math.sqrt(2.0 / 40.0)] * len(BANDS))


def test_jittered_rows_of_one_rate_have_one_period() -> None:
    # stamps that jitter by 3 %, some rows lost: the median of the differences is off, their mean is not
    periods = set()
    for seed in range(20):
        rng = np.random.default_rng(seed)
        time_s = 0.5 * np.arange(3000.0) + rng.uniform(-0.015, 0.015, 3000)
        time_s[0] = 0.0
        kept = rng.random(3000) > 0.001
        kept[:2] = True
        steps = Steps.of(time_s[kept], np.ones(int(kept.sum()), dtype=bool))
        periods.add(steps.period_s)
    assert periods == {1.0}
