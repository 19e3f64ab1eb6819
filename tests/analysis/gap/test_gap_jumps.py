"""Jumps between repeats: steps that are put in, and random walks that have the same spectrum and no step."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.fft import idct

from bench.analysis.gap import Model, diagnose
from bench.analysis.gap._data import GapRun
from bench.analysis.gap._jumps import _levels, _of_noise, _places_s
from bench.analysis.gap._noise import Noise, power_of
from drivers.base.arrays import Array
from tests.analysis.gap.conftest import made_run, stimulus

ALL, QUIET = np.ones(12_000, dtype=bool), np.zeros(11_999)


def test_a_difference_of_levels_is_that_of_the_means_about_a_block() -> None:
    rng = np.random.default_rng(1)
    curves = rng.normal(size=(2, 105))
    below, above = _levels(curves, 5)
    assert below.shape == above.shape == (2, 15)
    for k in range(15):
        before, after = curves[:, 5 * k : 5 * k + 15], curves[:, 5 * k + 20 : 5 * k + 35]
        assert below[:, k] == pytest.approx(before.mean(axis=1))
        assert above[:, k] == pytest.approx(after.mean(axis=1))


@pytest.mark.parametrize("seed", range(6))
def test_a_random_walk_has_no_jumps(seed: int) -> None:
    rng = np.random.default_rng(seed)
    walks = np.cumsum(rng.normal(0.0, 0.01, (3, 12_000)), axis=1) + rng.normal(0.0, 0.3, (3, 12_000))
    assert _places_s(walks - walks.mean(axis=0), ALL, ~ALL, QUIET, 1.0) == []


def test_a_step_in_a_random_walk_is_found_once_at_its_time() -> None:
    rng = np.random.default_rng(11)
    walks = np.cumsum(rng.normal(0.0, 0.01, (3, 12_000)), axis=1) + rng.normal(0.0, 0.3, (3, 12_000))
    walks[1, 7_310:] += 3.0
    places = _places_s(walks - walks.mean(axis=0), ALL, ~ALL, QUIET, 1.0)
    assert len(places) == 1
    assert places[0][1] == pytest.approx(7_310.0, abs=60.0)


def test_a_step_in_white_noise_has_the_deviation_of_two_means() -> None:
    """Closed form: each level is the mean of three blocks."""
    assert _of_noise(np.full(11_999, 4.0), 20) == pytest.approx(2.0 * np.sqrt(2.0 / 60.0), rel=1e-3)


def test_a_few_blocks_that_are_alike_by_chance_make_no_step_of_the_next() -> None:
    """Two hours of noise have eleven levels of ten minutes; of 3000 such pairs this is one of two."""
    n, period_s, rng = 2187, 3.125, np.random.default_rng(1022)
    power = power_of(Noise(0.05, 0.0, 1.5), n, period_s)
    coefficients = np.zeros((2, n))
    coefficients[:, 1:] = rng.normal(size=(2, n - 1)) * np.sqrt(power)
    curves = idct(coefficients, norm="ortho", axis=-1)
    apart, known = curves - curves.mean(axis=0), np.ones(n, dtype=bool)
    assert _places_s(apart, known, ~known, np.zeros(n - 1), period_s) != []
    assert _places_s(apart, known, ~known, power, period_s) == []


def test_a_step_where_nothing_was_recorded_is_none() -> None:
    """A bridge over a gap has no noise: what is nothing beside noise would be sharp there."""
    rng = np.random.default_rng(12)
    curves = rng.normal(0.0, 1.0, (2, 12_000))
    known = ALL.copy()
    known[3_000:9_000] = False
    curves[:, ~known] *= 1e-3
    curves[0, 6_000:9_000] += 0.3
    assert _places_s(curves - curves.mean(axis=0), known, ~ALL, QUIET, 1.0) == []
    assert _places_s(curves - curves.mean(axis=0), ALL, ~ALL, QUIET, 1.0) != []


def test_a_step_that_comes_with_a_turn_of_the_table_is_none() -> None:
    rng = np.random.default_rng(13)
    curves = rng.normal(0.0, 1.0, (2, 12_000))
    curves[0, 6_000:] += 3.0
    turns = ~ALL
    assert len(_places_s(curves - curves.mean(axis=0), ALL, turns, QUIET, 1.0)) == 1
    turns[6_003] = True
    assert _places_s(curves - curves.mean(axis=0), ALL, turns, QUIET, 1.0) == []


def test_what_steps_somewhat_later_in_the_other_repeat_is_the_same_event(nominal: Model) -> None:
    def run(name: str, at: int, seed: int) -> GapRun:
        rng, s = np.random.default_rng(seed), stimulus(9000)
        return made_run(name, s, rng, np.where(np.arange(9000) < at, 0.0, 2.0))

    def told(second: int) -> bool:
        found = diagnose([run("a", 1200, 1), run("b", second, 2)], nominal).rate
        return any("steps in one repeat" in part.sentence for part in found.unknown_parts)

    assert told(8000) and not told(1500)


def _runs(rng: np.random.Generator, steps: bool) -> list[GapRun]:
    runs = []
    for name, n in (("short", 5000), ("long", 8000)):
        for repeat in range(3):
            s = stimulus(n)
            walk: Array = np.cumsum(rng.normal(0.0, 0.004, n))
            if steps:
                walk[int(rng.integers(1000, n - 1000)) :] += 2.0
            runs.append(made_run(f"{name} {repeat}", s, rng, walk, profile=name))
    return runs


def test_a_level_that_latches_is_no_random_walk_and_no_cause(nominal: Model) -> None:
    found = diagnose(_runs(np.random.default_rng(5), steps=True), nominal).rate
    assert found.verdict == "unknown" and not found.stochastic and not found.causes
    told = [part.sentence for part in found.unknown_parts if part.follows == "the repeat"]
    assert "steps in one repeat and not in the other" in told[0]
    assert 4 <= int(told[0].split("start, ")[1].split(" such")[0]) <= 6
    size_dph = float(told[0].split("by ")[1].split(" deg/h")[0])
    assert size_dph == pytest.approx(2.0, abs=0.3)
    same = diagnose(_runs(np.random.default_rng(5), steps=False), nominal).rate
    assert same.verdict != "unknown"
