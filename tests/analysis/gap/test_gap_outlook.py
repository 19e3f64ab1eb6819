"""Where a search stands: what no run has shown yet stays possible, what a run would have shown does not."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import (
    Design,
    designs_for,
    diagnose,
    information_gained,
    other_equipment,
    outlook,
    read_model,
)
from bench.analysis.gap._candidates import effects_beside
from bench.analysis.gap._columns import Columns, usual_variant
from bench.analysis.gap._designs import usual_designs
from bench.analysis.gap._information import Foretold, expected_information
from bench.analysis.gap._model_file import Term
from bench.analysis.gap._outlook import Explanation, _odds, foreseeable
from bench.control.procedure import beyond_limits
from bench.record.benchfile import load_bench_file
from simulators.effects import Variant

ROOT = Path(__file__).parents[3]
BENCH = ROOT / "examples" / "demo.toml"
MODEL = read_model(ROOT / "examples" / "nominal" / "fog_cold_shock.toml")
LATITUDE_DEG = 39.98


@pytest.fixture(scope="module")
def designs() -> list[Design]:
    return designs_for(load_bench_file(BENCH))


@pytest.fixture(scope="module")
def start(designs: list[Design]):
    return outlook(None, MODEL, [], designs)


def recorded(design: Design, variant: Variant | None = None, size: float = 0.0) -> list:
    """Return a design's stretches as runs of a unit with noise, and perhaps an effect of a size."""
    rng = np.random.default_rng(1)
    runs = []
    for run in design.runs():
        output = rng.standard_normal(len(run.stimulus)) * 60.0 * MODEL.noise.arw_deg_per_sqrt_h
        if variant is not None:
            output += size * variant.columns(run.stimulus)[0]
        runs.append(replace(run, output_dph=run.stimulus.input_rate_dph + output))
    return runs


def term(name: str, *values: float) -> Term:
    """Return an effect in its usual form."""
    return Term(usual_variant(effects_beside(MODEL)[name]), values, tuple(0.1 * abs(each) for each in values))


def test_designs_keep_to_the_limits_and_their_settings_suit_the_procedures(designs):
    file = load_bench_file(BENCH)
    for design in designs:
        values = design.test.parse(dict(design.settings))
        assert not list(beyond_limits(design.test.demands(values), file)), design.text
        foretold_h = sum(len(s) * s.period_s for s in design.stimuli.values()) / 3600.0
        assert 0.1 * design.hours < foretold_h < 1.2 * design.hours, design.text
    assert len({(design.procedure, design.text) for design in designs}) == len(designs)
    narrow = file.model_copy(update={"limits": file.limits.model_copy(update={"min_temp_c": -5.0})})
    left = {design.procedure for design in designs_for(narrow)}
    assert left == {"constant-rotation", "rates-over-temperature", "standard-test", "thermal-ramp"}


def test_before_any_run_a_gap_is_as_likely_as_none(start):
    assert start.probabilities[frozenset()] == pytest.approx(0.5)
    assert sum(start.probabilities.values()) == pytest.approx(1.0)
    assert all(len(label) == 1 for label in start.probabilities if label)


def test_the_first_runs_are_chosen_by_information_an_hour(start):
    rates = [choice.nats / choice.design.hours for choice in start.choices()]
    assert rates == sorted(rates, reverse=True) and rates[-1] > 0.0
    assert all(choice.design.hours <= 2.0 for choice in start.choices(2.0))
    longest = max(start.designs, key=lambda each: each.hours)
    shortest = min(start.designs, key=lambda each: each.hours)
    assert start.information(longest) > start.information(shortest)


def test_a_run_without_a_gap_makes_improbable_what_it_would_have_shown(designs, start):
    shock = next(each for each in designs if each.procedure == "zero-bias-cold-shock")
    after = outlook(None, MODEL, recorded(shock), designs)
    thermal, rate = frozenset({"bias_quadratic"}), frozenset({"scale_factor_asymmetry"})
    assert after.probabilities.get(thermal, 0.0) < 0.2 * start.probabilities[thermal]
    assert after.probabilities[rate] > start.probabilities[rate]
    assert after.probabilities[frozenset()] > 0.5
    assert after.information(shock) < 0.5 * start.information(shock)


def test_what_the_data_clearly_show_is_no_less_probable_for_having_no_name(designs, start):
    """A bias over temperature squared, of 3 and of 9 standard deviations in a shock; nothing is diagnosed."""
    shock = next(each for each in designs if each.procedure == "zero-bias-cold-shock")
    label, own = frozenset({"bias_quadratic"}), usual_variant(effects_beside(MODEL)["bias_quadratic"])
    columns = Columns(MODEL, {"bias_quadratic": own})
    sigmas = math.sqrt(float(columns.gram(shock.runs())[0, 0]))
    weak, clear, certain = (
        outlook(None, MODEL, recorded(shock, own, size / sigmas), designs).probabilities
        for size in (3.0, 9.0, 60.0)
    )
    assert weak.get(label, 0.0) < 0.5 * start.probabilities[label] < start.probabilities[label] < clear[label]
    # no more than as probable as nothing, which is what the diagnosis says
    assert certain[label] == pytest.approx(certain[frozenset()])
    # noise that is named is no name for it
    seen = columns.products(recorded(shock, own, 9.0 / sigmas), np.zeros(columns.count))[0]
    prior = np.concatenate((np.full(len(MODEL.sigmas), 1e-9), columns.bounds(MODEL.noise.coarseness)))
    bare, noisy, named = (
        _odds(columns, seen, prior, Explanation(frozenset(names), 1.0, terms), ["bias_quadratic"])
        for names, terms in (((), ()), (("quantisation",), ()), (("unknown",), ()))
    )
    assert bare == noisy and noisy["bias_quadratic"] > 10.0 > 1.0 > named["bias_quadratic"]


def test_what_a_named_effect_imitates_in_the_runs_stays_possible_beside_it(designs):
    """At one rate of each sign a rate's square is its size; what the temperature does is none of both."""
    rates = next(
        each for each in designs if each.text.startswith("1 rates of each sign") and "-40" in each.text
    )
    leading = Explanation(frozenset({"scale_factor_asymmetry"}), 1.0, (term("scale_factor_asymmetry", 12.0),))
    names = ["vibration_rectification", "bias_quadratic"]
    usual = {name: usual_variant(effects_beside(MODEL)[name]) for name in ("scale_factor_asymmetry", *names)}
    columns = Columns(MODEL, usual).with_terms(leading.terms)
    seen = columns.products(recorded(rates), columns.values(()))[0]
    prior = np.concatenate((np.full(len(MODEL.sigmas), 1e-9), columns.bounds(MODEL.noise.coarseness)))
    alone = _odds(columns, seen, prior, Explanation(frozenset(), 1.0), names)
    beside = _odds(columns, seen, prior, leading, names)
    assert alone["bias_quadratic"] < 0.1 and beside["bias_quadratic"] < 2.0 * alone["bias_quadratic"]
    assert alone["vibration_rectification"] < 0.1 < 0.3 < beside["vibration_rectification"]


def test_a_disturbance_that_the_diagnosis_names_acts_in_every_explanation(designs):
    """A pump shakes at 0.11 Hz, in another phase each run: the rate's mean has no gap, and yet something acts."""
    ramp = next(each for each in designs if each.procedure == "thermal-ramp")
    runs = [
        replace(run, output_dph=run.output_dph + 3.0 * np.sin(2.0 * np.pi * 0.11 * run.stimulus.time_s + k))
        for k, run in enumerate(recorded(ramp))
    ]
    after = outlook(diagnose(runs, MODEL).rate, MODEL, runs, designs, {ramp.key: runs})
    assert after.leading.label == {"vibration_or_mains_line"}
    assert all("vibration_or_mains_line" in label for label in after.probabilities)
    # any run shows it again: the shortest will do
    again = after.showing(after.leading.label, math.inf, 10.0)
    assert again.design.hours == min(each.hours for each in designs if each.key != ramp.key)


def test_a_formula_may_miss_as_much_where_the_nominal_model_could_imitate_the_effect(designs):
    """At one rate an eccentric encoder is an azimuth error. Runs of both signs have told them apart before."""
    model = read_model(ROOT / "examples" / "nominal" / "fog_on_its_bench.toml")
    usual = {"azimuth_error": usual_variant(effects_beside(model)["azimuth_error"])}
    turns = [each for each in designs if each.procedure == "constant-rotation" and "20 deg/s" in each.text]
    both, one = (next(each for each in turns if f"{count} reversals" in each.text) for count in (3, 0))
    columns, acting = Columns(model, usual), np.array([10.0])
    q = len(model.sigmas)
    before = columns.products(both.runs(), acting)[0]
    plain, alone = (each[1 + q, 1 + q] for each in columns.products(one.runs(), acting))
    after = columns.products(one.runs(), acting, before)[1][1 + q, 1 + q]
    # the energy of 10 deg in the few cells about the turn's period: 8 / 0.25^2 each, were all of it in one
    assert 100.0 * after < 8.0 / 0.25**2 * 30.0 < 100.0 * alone < 100.0 * plain


def test_a_bench_of_one_axis_cannot_show_what_follows_the_attitude(start):
    assert "acceleration_sensitivity" in start.hidden_from_bench
    turned = next(design for text, design in other_equipment(LATITUDE_DEG) if "two axes" in text)
    with_it = outlook(None, MODEL, [], [*usual_designs(LATITUDE_DEG), turned])
    assert "acceleration_sensitivity" not in with_it.hidden_from_bench


def test_information_gained_is_the_divergence_of_after_from_before():
    before = {"no gap": 0.5, "shupe": 0.25, "mode_hop": 0.25}
    assert information_gained(before, before) == pytest.approx(0.0)
    assert information_gained(before, {"shupe": 1.0}) == pytest.approx(math.log(4.0))
    half = {"shupe": 0.5, "mode_hop": 0.5}
    assert information_gained(before, half) == pytest.approx(math.log(2.0))


def test_what_was_not_held_possible_had_the_probability_that_it_has_before_any_run():
    """Three names: a first has half over three, another beside it a quarter over three."""
    before = {"no gap": 0.6, "shupe": 0.4, "gradient": 0.0}
    pair = 0.5 / 3.0 * 0.25 / 3.0
    assert information_gained(before, {"mode_hop": 1.0}) == pytest.approx(-math.log(0.5 / 3.0))
    for name in ("shupe + mode_hop", "mode_hop + bias_ramp", "gradient"):
        assert information_gained(before, {name: 1.0}) == pytest.approx(-math.log(pair))
    held = before | {"mode_hop + shupe": 0.01}
    assert information_gained(held, {"mode_hop + shupe": 1.0}) == pytest.approx(math.log(100.0))


def test_a_run_before_anything_is_named_is_about_a_second_effect_too(designs, start):
    """The first as by itself, the second with the odds of another, if a first acts."""
    run = designs[0]
    gram = start._grams(run)[1][1:, 1:]
    first = expected_information(gram, start._predictions)
    hidden = [each for each in start._predictions if each.probability < 0.4]
    share = sum(each.probability for each in hidden)
    none = next(each for each in start._predictions if each.probability > 0.4)
    odds = [replace(each, probability=0.25 * each.probability / share) for each in hidden]
    second = expected_information(gram, [replace(none, probability=1.0), *odds])
    assert start.information(run) == pytest.approx(first + share * second)
    few = {frozenset(), frozenset({"shupe"})}
    own = [start._predictions[n] for n, each in enumerate(start.explanations) if each.label in few]
    assert start.information(run, few) == pytest.approx(expected_information(gram, own))


def test_what_happens_while_the_rate_steps_is_not_foretold(designs):
    rates = next(each for each in designs if each.procedure == "standard-test")
    (run,) = rates.runs()
    steps = np.flatnonzero(np.abs(np.diff(run.stimulus.table_rate_dps)) > 1.0)
    assert run.missing[steps].all() and run.missing[steps + 1].all()
    assert run.missing.sum() == 2 * len(steps)


def test_a_prior_that_is_wider_than_arithmetic_goes_is_cut() -> None:
    """Of two explanations one has a coefficient that nothing recorded bounds, of a coarse gyro."""
    best = np.array([1e3, 1e3, 0.0])
    sigmas = foreseeable(np.array([3e9, 2.0, 5.0]), best)
    assert sigmas.tolist() == pytest.approx([1e6 / math.sqrt(1e3), 2.0, 5.0])
    gram = np.array([[1e3, 999.0, 0.0], [999.0, 1e3, 0.0], [0.0, 0.0, 0.0]])
    wide = Foretold(0.5, np.array([0.1, 0.0, 0.0]), np.diag(sigmas))
    known = Foretold(0.5, np.array([0.1, 0.0, 0.0]), np.diag([1e-3, 1e-3, 1e-3]))
    assert expected_information(gram, [wide, known]) == pytest.approx(math.log(2.0), abs=0.01)
