"""Lines that wander, against the wave that was put in."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.analysis.gap import Model, diagnose
from simulators.effects._line_track import tracked
from simulators.effects._steady_line import _spectrum
from tests.analysis.gap.conftest import made_run, stimulus


def _wandering(n: int, frequency: float, wander: float, phase: float) -> np.ndarray:
    cycles = frequency * (1.0 + wander * np.sin(2.0 * np.pi * np.arange(n) / 5000.0))
    return np.asarray(np.sin(2.0 * np.pi * np.cumsum(cycles) + phase))


@given(
    st.floats(0.05, 0.42), st.sampled_from([0.0, 0.005, 0.015]), st.floats(0.0, 6.28), st.integers(0, 1000)
)
@settings(max_examples=25, deadline=None)
def test_a_line_is_followed_wherever_it_wanders(
    frequency: float, wander: float, phase: float, seed: int
) -> None:
    n = 12_000
    wave = 2.0 * _wandering(n, frequency, wander, phase)
    rest = wave + np.random.default_rng(seed).normal(0.0, 1.0, n) + np.linspace(-3.0, 3.0, n)
    found = tracked(rest, frequency, 2.0, np.zeros(n))
    assert np.std(found - wave) < 0.25 * np.std(wave)


def test_where_there_is_no_line_of_its_size_nothing_is_taken() -> None:
    rng = np.random.default_rng(3)
    noise = rng.normal(0.0, 1.0, 12_000)
    assert not tracked(noise, 0.18, 2.0, np.zeros(12_000)).any()
    other = noise + 8.0 * _wandering(12_000, 0.18, 0.0, 0.3)
    assert not tracked(other, 0.18, 2.0, np.zeros(12_000)).any()
    elsewhere = noise + 2.0 * _wandering(12_000, 0.21, 0.0, 0.3)
    assert not tracked(elsewhere, 0.18, 2.0, np.zeros(12_000)).any()


def test_a_line_that_climbs_fast_is_followed_by_its_change() -> None:
    """In the 500 samples that noise asks a window to have its phase bends by 1.7 rad to either end."""
    n = 2_000
    cycles = 0.2 + 9e-6 * (np.arange(n) - 0.5 * n)
    wave = 0.55 * np.sin(2.0 * np.pi * np.cumsum(cycles))
    rest = wave + np.random.default_rng(8).normal(0.0, 1.0, n)
    off = (tracked(rest, 0.2, 0.55, np.zeros(n)) - wave)[300:-300]  # the ends have half of a window each
    assert np.std(off) < 0.35 * np.std(wave)


def test_a_steady_line_stays_as_it_was_fitted() -> None:
    wave = 2.0 * _wandering(12_000, 0.18, 0.0, 0.3)
    rest = wave + np.random.default_rng(4).normal(0.0, 1.0, 12_000)
    assert tracked(rest, 0.18, 2.0, wave) is wave


def test_what_is_not_known_is_followed_through() -> None:
    wave = 3.0 * _wandering(12_000, 0.11, 0.005, 0.0)
    rest = wave + np.random.default_rng(5).normal(0.0, 1.0, 12_000)
    rest[::7] = np.nan
    rest[5_000:5_060] = np.nan
    found = tracked(rest, 0.11, 3.0, np.zeros(12_000))
    assert np.std(found - wave) < 0.25 * np.std(wave)
    rest[::2] = np.nan  # no two samples side by side: nothing says how large noise is
    assert tracked(rest, 0.11, 3.0, wave) is wave


def test_a_line_stands_out_of_its_surroundings_as_much_beside_a_long_run_as_alone() -> None:
    """A short run is transformed on the grid of the longest: its surroundings stay as many of its frequencies."""
    rest = np.random.default_rng(7).normal(0.0, 1.0, 1_800)
    alone, beside = _spectrum(rest, 4 * 1_800), _spectrum(rest, 48 * 1_800)
    np.testing.assert_allclose(beside[::12], alone, rtol=1e-6)


@pytest.mark.parametrize("off_hz", [0.0, 2e-4])
def test_a_line_that_is_another_in_each_run_and_follows_temperature_leaves_nothing(
    nominal: Model, off_hz: float
) -> None:
    """A beat of two oscillators: it drifts by 4e-5 Hz/K, and starts a little off in every run."""
    rng = np.random.default_rng(6)
    runs = []
    for name, n, rate_dps in (("short", 5000, 0.0), ("long", 8000, 0.0), ("turning", 6000, 15.0)):
        for repeat in range(2):
            s = stimulus(n, rate_dps=rate_dps)
            hz = 0.15 + off_hz * rng.standard_normal() + 4e-5 * s.warm_k
            beat = 0.4 * np.sin(2.0 * np.pi * (np.cumsum(hz) + rng.random()))
            runs.append(made_run(f"{name} {repeat}", s, rng, beat, profile=name))
    found = diagnose(runs, nominal).rate
    assert found.verdict == "explained"
    assert set(found.stochastic) == {"vibration_or_mains_line"}
    (term,) = found.disturbed.terms
    assert term.values[0] == pytest.approx(0.4, rel=0.15)
    assert term.values[1] == pytest.approx(0.15, rel=0.03)
