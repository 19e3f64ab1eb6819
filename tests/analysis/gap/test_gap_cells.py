"""Cells, parity of runs, gaps: invariants of an orthonormal change of basis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.analysis.gap import Model, Noise
from bench.analysis.gap._cells import BANDS, band_slices, contrasts, group_cells
from bench.analysis.gap._data import GapRun, check_runs, good_length, group_runs
from bench.analysis.gap._stack import stacked, transformed
from bench.analysis.gap._where import holm
from drivers.base.errors import ConfigurationError
from tests.analysis.gap.conftest import made_run, stimulus


@given(st.integers(300, 40000), st.sampled_from([0.5, 1.0, 10.0]))
@settings(max_examples=60, deadline=None)
def test_bands_hold_every_coefficient_once(n: int, period_s: float) -> None:
    slices = band_slices(n, period_s)
    assert len(slices) == len(BANDS)
    assert [k for part in slices for k in range(part.start, part.stop)] == list(range(n - 1))


def test_a_wave_lies_in_its_band() -> None:
    n = 4000
    rows = np.cos(2.0 * np.pi * (np.arange(n) + 0.5) / 100.0)[None]
    coefficients = transformed(made_run("a", stimulus(n), np.random.default_rng(0)), rows, Noise(0.01))[0]
    energy = [float((coefficients[part] ** 2).sum()) for part in band_slices(n, 1.0)]
    assert BANDS[int(np.argmax(energy))] == "75..150 s"
    assert max(energy) == pytest.approx(n / 2.0, rel=1e-9)


@given(
    st.lists(st.sampled_from(["+20", "-20", "0", "a", "b"]), min_size=1, max_size=4, unique=True),
    st.integers(1, 4),
)
@settings(max_examples=60, deadline=None)
def test_contrasts_are_a_rotation(conditions: list[str], repeats: int) -> None:
    names, repeatable, rows = contrasts(conditions, repeats)
    m = len(conditions) * repeats
    assert rows @ rows.T == pytest.approx(np.eye(m), abs=1e-12)
    assert len(names) == len(repeatable) == m
    assert sum(repeatable) == len(conditions)


def test_odd_in_rate_holds_what_changes_sign_with_rate() -> None:
    names, _, rows = contrasts(("-20", "0", "+20"), 1)
    odd, even, same = np.array([-1.0, 0.0, 1.0]), np.array([1.0, 0.0, 1.0]), np.ones(3)
    by_name = dict(zip(names, rows, strict=True))
    assert abs(by_name["odd in rate"] @ odd) == pytest.approx(np.sqrt(2.0))
    assert by_name["odd in rate"] @ even == pytest.approx(0.0)
    assert by_name["even in rate"] @ odd == pytest.approx(0.0)
    assert by_name["even in rate"] @ same == pytest.approx(0.0)
    assert by_name["common"] @ same == pytest.approx(np.sqrt(3.0))


def test_cells_of_noise_hold_one_unit_of_energy_a_coefficient(nominal: Model) -> None:
    rng = np.random.default_rng(1)
    runs = [
        made_run(f"{rate} {k}", stimulus(4000, rate_dps=float(rate)), rng, condition=rate)
        for rate in ("+20", "-20", "0")
        for k in range(2)
    ]
    (group,) = group_runs(runs)
    flat = [run for each in group.runs for run in each]
    stack = stacked(
        flat, lambda run: [(run.output_dph - nominal.predict(run.stimulus))[None]], [False], nominal.noise
    )
    cells = group_cells(group, stack, nominal.noise)
    number = sum(cell.count for cell in cells)
    assert number == 6 * (good_length(4000) - 1)
    energy = sum(float(cell.products(np.zeros(1, np.int64))[0, 0]) for cell in cells)
    assert energy == pytest.approx(number, abs=4.0 * np.sqrt(2.0 * number))


def test_runs_of_different_units_are_refused() -> None:
    rng = np.random.default_rng(2)
    runs = [made_run("a", stimulus(400), rng), replace(made_run("b", stimulus(400), rng), unit_id="unit 2")]
    with pytest.raises(ConfigurationError, match="different units"):
        check_runs(runs)


def test_copies_of_a_run_are_refused() -> None:
    run = made_run("a", stimulus(400), np.random.default_rng(2))
    with pytest.raises(ConfigurationError, match="same samples"):
        check_runs([run, replace(run, run_id="b")])


def sharing(alike: float, seed: int) -> list[GapRun]:
    """Two runs with white noise of which part is the same: changes of the same sign in `alike` more than half.

    Signs of Gaussian variables with correlation r have 2/pi arcsin(r) (Sheppard, 1899).
    """
    correlation = np.sin(0.5 * np.pi * alike)
    rng = np.random.default_rng(seed)
    s, same = stimulus(8000), rng.normal(0.0, 0.24, 8000)
    runs = []
    for name in "ab":
        own = rng.normal(0.0, 0.24, 8000)
        noise = np.sqrt(correlation) * same + np.sqrt(1.0 - correlation) * own
        run = made_run(name, s, rng)
        runs.append(replace(run, output_dph=s.input_rate_dph + noise))
    return runs


@pytest.mark.parametrize("alike", [0.85, 0.95])
def test_copies_with_a_little_noise_of_their_own_are_refused(alike: float) -> None:
    """A run resampled or rounded again: its differences from the first would be called the noise floor."""
    runs = sharing(alike, 3)
    with pytest.raises(ConfigurationError, match="same samples") as refused:
        check_runs(runs)
    assert float(refused.value.found.rpartition(" ")[2]) == pytest.approx(alike, abs=0.02)
    check_runs([runs[0], replace(runs[1], condition="+20")])  # only repeats give a floor


@pytest.mark.parametrize("alike", [0.0, 0.5, 0.75])
def test_repeats_that_share_some_of_their_noise_are_no_copies(alike: float) -> None:
    check_runs(sharing(alike, 4))


def test_repeats_that_share_a_ripple_far_above_their_noise_are_no_copies() -> None:
    """An eccentric encoder's wave has most changes alike; another profile shows what noise the gyro has."""
    rng = np.random.default_rng(5)
    s = stimulus(6000)
    wave = 20.0 * np.sin(2.0 * np.pi * np.arange(6000) / 5.3)
    shaken = [made_run(name, s, rng, profile="turning") for name in "ab"]
    shaken = [replace(run, output_dph=run.output_dph + wave) for run in shaken]
    quiet = made_run("c", s, rng)
    check_runs([*shaken, quiet])
    slow = replace(quiet, output_dph=0.01 * (quiet.output_dph - s.input_rate_dph) + s.input_rate_dph)
    slow = replace(slow, run_id="e", stimulus=replace(s, period_s=100.0))
    with pytest.raises(
        ConfigurationError, match="same samples"
    ):  # slower rows have less noise: no measure of these
        check_runs([*sharing(0.85, 3), slow])
    with pytest.raises(ConfigurationError, match="same samples"):
        check_runs([shaken[0], replace(shaken[0], run_id="d"), quiet])


def test_a_run_that_is_too_short_or_too_empty_is_refused() -> None:
    rng = np.random.default_rng(3)
    with pytest.raises(ConfigurationError, match="too short"):
        check_runs([made_run("a", stimulus(60), rng)])
    run = made_run("a", stimulus(1000), rng)
    spoiled = run.output_dph.copy()
    spoiled[::3] = spoiled[1::3] = np.nan
    with pytest.raises(ConfigurationError, match="missing"):
        check_runs([replace(run, output_dph=spoiled)])


def test_holm_against_a_worked_example() -> None:
    # Holm 1979: p = .01, .04, .03 -> .03, .06, .06
    assert holm(np.array([0.01, 0.04, 0.03])) == pytest.approx([0.03, 0.06, 0.06])
