"""How the inside follows the case: lags put in come out, and a foretold run has them."""

import numpy as np
import pytest

from bench.analysis.gap._data import GapRun
from bench.analysis.gap._heat import Heat, heat_of
from simulators.effects import Stimulus


def run_of(time_s, t_in_c, t_out_c):
    n = len(time_s)
    s = Stimulus(time_s, t_in_c, t_out_c, np.zeros(n + 1), np.zeros(n), 39.1)
    return GapRun("r", "u", "p", "c", s, np.zeros(n), np.full(n, "run"))


def first_order(values, time_s):
    """The exact answer to a straight line from sample to sample, step by step."""
    decay, out, state = np.exp(-1.0 / time_s), [], values[0]
    for before, now in zip([values[0], *values[:-1]], values, strict=True):
        slope = now - before
        state = now - slope * time_s + (state - before + slope * time_s) * decay
        out.append(state)
    return np.array(out)


@pytest.fixture(scope="module")
def shock():
    time_s = np.arange(4000.0, 16000.0)
    case = np.interp(time_s, [5000.0, 5350.0, 9000.0, 9350.0], [25.0, -45.0, -45.0, 25.0])
    inside = first_order(first_order(case, 100.0), 400.0) + 2.5 + 1.5 * (1.0 - np.exp(-time_s / 1500.0))
    return run_of(time_s, inside + np.random.default_rng(2).normal(0.0, 0.01, len(time_s)), case)


def test_lags_and_offsets_that_were_put_in_come_out(shock):
    heat = heat_of([shock])
    assert (heat.outer_s, heat.inner_s) in ((100.0, 400.0), (400.0, 100.0))
    assert heat.offset_k + heat.rise_k == pytest.approx(4.0, abs=0.05)
    assert heat.inside_c(shock.stimulus) == pytest.approx(shock.stimulus.t_in_c, abs=0.3)


def test_a_foretold_run_has_the_units_heat_and_nothing_else_changes(shock):
    heat = Heat(0.0, 10.0, 1.0, 0.0)
    other = heat.on(shock)
    assert other.stimulus.t_in_c == pytest.approx(first_order(shock.stimulus.t_out_c, 10.0) + 1.0, abs=0.5)
    assert np.array_equal(other.stimulus.t_out_c, shock.stimulus.t_out_c)


def test_runs_at_one_temperature_or_with_one_sensor_show_no_heat(shock):
    time_s = np.arange(3000.0)
    still = np.full(3000, 25.0)
    assert heat_of([]) is None and heat_of([run_of(time_s, still + 1.0, still)]) is None
    assert heat_of([run_of(time_s, np.linspace(0.0, 50.0, 3000), np.linspace(0.0, 50.0, 3000))]) is None
    assert heat_of([run_of(time_s, still + 1.0, still), shock]) == heat_of([shock])
