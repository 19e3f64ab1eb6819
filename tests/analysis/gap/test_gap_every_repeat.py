"""A cause stands if each repeat shows it, beside all that it was fitted with, whatever acts elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import pytest

from bench.analysis.gap import Model, Term, diagnose, suggest
from bench.analysis.gap._cells import BANDS
from bench.analysis.gap._close import holding
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._fit import Floor
from drivers.base.arrays import Array
from simulators.effects import Stimulus
from tests.analysis.gap.conftest import made_run, stimulus

_FLOOR = Floor(np.ones(len(BANDS)), np.zeros(len(BANDS)), True)
Extra = Callable[[Stimulus, int], Array]


def _runs(rng: np.random.Generator, extra: Extra) -> list[GapRun]:
    runs = []
    for name, n in (("short", 4000), ("long", 7000), ("longer", 9000)):
        for repeat in range(3):
            s = stimulus(n)
            runs.append(made_run(f"{name} {repeat}", s, rng, extra(s, repeat), profile=name))
    return runs


@pytest.mark.parametrize("part", [1.0, 0.5, 0.0, -0.5])
def test_the_part_of_a_term_that_runs_show_is_the_one_that_is_in_them(
    nominal: Model, term: Term, part: float
) -> None:
    rng = np.random.default_rng(2)
    size = np.asarray(term.values)
    runs = _runs(rng, lambda s, _: part * size @ term.variant.columns(s))
    with_it = Model("closed", (*nominal.terms, term), nominal.noise)
    (shown,) = holding(with_it, [nominal], runs, _FLOOR)
    assert shown == pytest.approx(part, abs=0.05)
    assert np.isnan(holding(nominal, [nominal], runs, _FLOOR)).all()


def test_what_some_repeats_show_and_one_does_not_is_no_cause(nominal: Model) -> None:
    """A part cracks after the first repeat: its answer to cold is no law of the unit."""

    def cracked(s: Stimulus, repeat: int) -> Array:
        return np.asarray((repeat > 0) * 0.012 * s.warm_k)

    found = diagnose(_runs(np.random.default_rng(4), cracked), nominal).rate
    assert not found.causes
    assert found.unknown_probability > 0.9
    assert "the repeat" in [part.follows for part in found.unknown_parts]
    assert any("in every repeat" in text for text in found.warnings)


def test_repeats_that_differ_are_told_where_one_condition_has_fewer(nominal: Model) -> None:
    """Beside profiles with three repeats each there is one with two conditions, one of them done once."""

    def cracked(s: Stimulus, repeat: int) -> Array:
        return np.asarray((repeat > 0) * 0.012 * s.warm_k)

    rng = np.random.default_rng(5)
    runs = _runs(rng, cracked)
    s = stimulus(4000)
    runs += [
        made_run(f"pair {condition} {k}", s, rng, cracked(s, k), profile="pair", condition=condition)
        for condition, repeats in (("+20", 3), ("-20", 1))
        for k in range(repeats)
    ]
    parts = diagnose(runs, nominal).rate.unknown_parts
    assert "the repeat" in [part.follows for part in parts]


def test_a_repeat_of_other_runs_alone_says_nothing_of_a_cause(nominal: Model) -> None:
    """Runs at rest were done once more than those at a rate, and differ; those at a rate have an asymmetry."""
    rng, runs = np.random.default_rng(11), []
    for repeat in range(3):
        s = stimulus(5000)
        step = (repeat == 1) * 0.3 * (np.arange(5000) > 2200)
        runs.append(made_run(f"rest {repeat}", s, rng, step, profile="rest"))
    rate_dps = np.array([20.0, 0.0, -20.0, 0.0])[np.arange(6000) // 500 % 4]
    turning = replace(stimulus(6000), angle_deg=np.concatenate(([0.0], np.cumsum(rate_dps))))
    for repeat in range(2):
        extra = 20e-6 * 0.5 * np.abs(turning.input_rate_dph)
        runs.append(made_run(f"rates {repeat}", turning, rng, extra, profile="rates"))
    found = diagnose(runs, nominal).rate
    assert "scale_factor_asymmetry" in [cause.name for cause in found.causes]
    assert "the repeat" in [part.follows for part in found.unknown_parts]


def test_a_cause_stays_named_beside_something_larger_that_acts_elsewhere(nominal: Model) -> None:
    """Turning heats the unit slowly, which no formula of the catalogue says; a gradient acts in the shocks."""
    rng = np.random.default_rng(1)
    runs = _runs(rng, lambda s, _: 0.03 * s.gradient_k)
    for repeat in range(3):
        s = _turning(4000)
        heat = 8.0 * s.lagged((s.table_rate_dps / 20.0) ** 2, 900.0)
        runs.append(made_run(f"steps {repeat}", s, rng, heat, profile="steps"))
    found = diagnose(runs, nominal).rate
    assert [cause.name for cause in found.causes] == ["gradient"]
    assert found.unknown_probability > 0.9


def test_a_cause_that_needs_a_curve_beside_it_is_none(nominal: Model) -> None:
    """A scale factor follows the temperature less and less: beside a curve over T_in a lag fits, alone not."""
    rng = np.random.default_rng(3)
    rates = {
        "steps": (0.0, 20.0, 0.0, -20.0, 0.0, 10.0, 0.0, -10.0, 5.0, -5.0),
        "once": (0.0, 10.0, -20.0, 20.0, 0.0, 5.0, 0.0, -5.0),
        "early": (20.0, 0.0, -15.0, 0.0, 8.0),
    }
    runs = []
    for name, rates_dps in rates.items():
        for repeat in range(3):
            s = _turning(4000, rates_dps, cold=True)
            scale = 40e-6 * np.sin(s.t_in_c / 13.0 + 1.5) * np.exp(-s.time_s / 2000.0)
            runs.append(made_run(f"{name} {repeat}", s, rng, scale * s.input_rate_dph, profile=name))
    held_out = runs[2::3]
    found = diagnose([run for run in runs if run not in held_out], nominal, held_out).rate
    assert not found.causes and found.verdict == "unknown"
    assert any("where what is unknown stays" in text for text in found.warnings)
    assert found.held_out[0].share > 0.9  # what is learned closes it, and says no name


def test_the_next_run_is_one_that_shows_what_was_learned_without_a_name(nominal: Model) -> None:
    rng = np.random.default_rng(1)
    runs = []
    for name, rates_dps in _RATES.items():
        for repeat in range(3):
            s = _turning(4000, rates_dps)
            heat = 6.0 * s.lagged((s.table_rate_dps / 20.0) ** 2, 900.0)
            runs.append(made_run(f"{name} {repeat}", s, rng, heat, profile=name))
    found = diagnose(runs, nominal)
    assert found.rate.learned is not None
    assert [term.name for term in found.rate.learned.terms] == ["learned: heat of turning"]
    first = suggest(found)[0]
    assert first.procedure == "standard-test"  # of all it turns fastest
    assert first.decides == "learned: heat of turning or nothing"


_STEPS_DPS = (0.0, 20.0, 0.0, -20.0, 0.0, 10.0, 0.0, -10.0)
_RATES = {
    "steps": (0.0, 20.0, 0.0, -20.0),
    "once": (0.0, 10.0, -20.0, 20.0, 0.0, 0.0, 0.0, 0.0),
    "early": (20.0, 0.0, -15.0, 0.0, 0.0),
}


def _turning(n: int, rates_dps: Sequence[float] = _STEPS_DPS, *, cold: bool = False) -> Stimulus:
    still = stimulus(n, cold=cold)
    each_dps = np.repeat(rates_dps, n // len(rates_dps))
    angle_deg = 10.0 + np.concatenate(([0.0], np.cumsum(each_dps)))
    return Stimulus(still.time_s, still.t_in_c, still.t_out_c, angle_deg, still.elevation_deg, 39.1)
