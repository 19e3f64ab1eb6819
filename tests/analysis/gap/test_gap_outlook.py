"""Where a search stands: what no run has shown yet stays possible, what a run would have shown does not."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bench.analysis.gap import Design, designs_for, information_gained, other_equipment, outlook, read_model
from bench.analysis.gap._designs import usual_designs
from bench.analysis.gap._information import expected_information
from bench.control.procedure import beyond_limits
from bench.record.benchfile import load_bench_file

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


def recorded(design: Design) -> list:
    """Return a design's stretches as runs of a unit with noise and nothing else."""
    rng = np.random.default_rng(1)
    runs = []
    for run in design.runs():
        noise = rng.standard_normal(len(run.stimulus)) * 60.0 * MODEL.noise.arw_deg_per_sqrt_h
        runs.append(replace(run, output_dph=run.stimulus.input_rate_dph + noise))
    return runs


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
