"""Spectra, lines, gaps and rows of the diagnosis against sums in time and other closed forms."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import permutations
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.fft import dct

from bench.analysis.gap import Model, Noise, Term
from bench.analysis.gap._aliases import in_rows
from bench.analysis.gap._align import aligned
from bench.analysis.gap._bridge import bridge, noise_left
from bench.analysis.gap._data import Group
from bench.analysis.gap._describe import differing_parts
from bench.analysis.gap._fit import Solution
from bench.analysis.gap._lines import _log_tail, _surroundings, strongest_line
from bench.analysis.gap._noise import power_of, spectrum
from bench.analysis.gap._rows import steady_beside
from bench.analysis.gap._signature import signature_norm, unexplained
from bench.analysis.gap._stack import Stack, stacked
from simulators.effects import Variant
from tests.analysis.gap.conftest import effect, made_run, stimulus

WHITE = Noise(0.004)
"""0.24 deg/h in means of 1 s."""
N = 4000


def line_in(coefficients, gaps=None, named_hz=()):
    run = made_run("r", stimulus(N, cold=False), np.random.default_rng(1), profile="still")
    groups = [Group("still", ("0",), ((run,),))]
    return strongest_line(groups, [coefficients], WHITE, gaps or {}, named_hz)


def ones_with(number, size_dph):
    """Coefficients of size one, the floor, but for one: that of a wave of so many half periods in the run."""
    rows = np.random.default_rng(2).choice([-1.0, 1.0], size=(1, N - 1))
    rows[0, number - 1] = size_dph * math.sqrt(0.5 * N) / 0.24
    return rows


def test_a_wave_is_found_with_its_period_and_its_amplitude():
    found = line_in(ones_with(1234, 0.2))
    assert found.period_s == pytest.approx(2.0 * N / 1234, rel=8 / 1234)
    assert found.amplitude_dph == pytest.approx(0.2, rel=0.01)
    assert found.harmonic == 0 and found.profile == "still"
    assert line_in(ones_with(1234, 0.0)) is None


@pytest.mark.parametrize(
    ("number", "what"), [(1000, "table rate"), (200, "T_out"), (400, "T_in"), (1234, "")]
)
def test_a_wave_that_an_input_has_too_is_told_as_that_inputs(number, what):
    """The table swings in 8 s, the chamber cycles in 40 s; in 20 s the unit's heater, felt by the case."""
    time_s = np.arange(N) + 0.5
    s = stimulus(N, cold=False)
    angle = 10.0 + 2.0 * np.sin(2.0 * np.pi * np.arange(N + 1) / 8.0)
    noise = 0.01 * np.random.default_rng(9).normal(size=(2, N))
    heated = np.sin(2.0 * np.pi * time_s / 20.0)
    t_out = s.t_out_c + 0.3 * np.sin(2.0 * np.pi * time_s / 40.0) + 0.03 * heated + noise[0]
    t_in = s.t_in_c + 0.3 * heated + noise[1]
    s = replace(s, angle_deg=angle, t_in_c=t_in, t_out_c=t_out, elevation_deg=np.zeros(N), latitude_deg=90.0)
    run = made_run("r", s, np.random.default_rng(1), profile="swung")
    groups = [Group("swung", ("0",), ((run,),))]
    assert strongest_line(groups, [ones_with(number, 0.2)], WHITE, {}).follows == what


def test_a_wave_that_is_a_tenth_of_its_profiles_gap_may_be_a_misfit():
    excess = 0.5 * N * (0.2 / 0.24) ** 2
    assert line_in(ones_with(1234, 0.2), {"still": 12.0 * excess}) is None
    assert line_in(ones_with(1234, 0.2), {"still": 8.0 * excess}) is not None
    assert line_in(ones_with(1234, 0.2), {"another": 12.0 * excess}) is not None


@pytest.mark.parametrize("alias_hz", [0.0, 1.0, 7.0])
@pytest.mark.parametrize("number_named", [1232.6, 1236.0, 1240.4])
def test_what_is_left_where_a_named_line_folds_to_is_no_other_line(alias_hz, number_named):
    """A twentieth of the alias on either side, and one window of eight coefficients beyond."""
    named_hz = [alias_hz + number_named / (2.0 * N)]
    low, high = math.floor(0.95 * number_named), math.ceil(1.05 * number_named)
    for number in (low - 6, low, 1233, 1240, high, high + 6):
        assert line_in(ones_with(number, 0.2), named_hz=named_hz) is None
    for number in (low - 18, high + 18):
        assert line_in(ones_with(number, 0.2), named_hz=named_hz) is not None


def test_surroundings_of_a_slope_are_the_slope():
    assert _surroundings(np.arange(60.0))[7:-7].tolist() == np.arange(7.0, 53.0).tolist()


@pytest.mark.parametrize("energy", [20.0, 400.0, 9e3])
def test_the_tail_of_eight_degrees_of_freedom_is_a_sum_of_four_terms(energy):
    """That of an even number is that of Poisson's distribution."""
    half = 0.5 * energy
    exact = -half + math.log(sum(half**j / math.factorial(j) for j in range(4)))
    assert _log_tail(np.array([energy]), 8.0)[0] == pytest.approx(exact, abs=4.0 / half)


@pytest.mark.parametrize("order", [None, 1.0, 2.0])
@pytest.mark.parametrize("period_s", [1.0, 5.0, 60.0])
def test_the_spectrum_of_correlated_noise_is_the_sum_of_its_covariances(order, period_s):
    """Of variance one; a Markov process of the first order where no order is given, two in line for the second.

    Two in line have the covariance r^k (1 + k (1 - r^2) / (1 + r^2)).
    """
    noise = Noise(1e-9, correlated_dph=1.0, correlation_time_s=30.0)
    noise = noise if order is None else replace(noise, correlation_order=order)
    r, lag = math.exp(-period_s / 30.0), np.arange(1, 3000)
    covariance = r**lag * (1.0 + lag * (1.0 - r**2) / (1.0 + r**2) * (order == 2.0))
    for frequency in (0.003, 0.05, 0.4, 0.97):
        expected = 1.0 + 2.0 * float((covariance * np.cos(math.pi * frequency * lag)).sum())
        found = float(spectrum(noise, np.array([frequency]), period_s)[0])
        assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("period_s", [1.0, 4.0])
def test_white_noise_and_walks_have_the_power_of_their_samples(period_s):
    """A sample of white noise is N / sqrt(T); a step of a walk K sqrt(T); of the quantum, q / sqrt(12) twice."""
    frequency = np.array([0.01, 0.3, 0.8])
    white = spectrum(Noise(0.01), frequency, period_s)
    assert white == pytest.approx([0.01**2 * 3600.0 / period_s] * 3)
    change = 2.0 - 2.0 * np.cos(math.pi * frequency)
    walk = spectrum(Noise(1e-9, 0.0, 2.0), frequency, period_s)
    assert walk == pytest.approx(2.0**2 * period_s / 3600.0 / change)
    quantum = spectrum(Noise(1e-9, 0.0, 0.0, 3.0), frequency, period_s)
    assert quantum == pytest.approx((3.0 / period_s) ** 2 / 12.0 * change)


WALKING = Noise(0.01, 0.02, 0.5)


def test_two_gaps_near_each_other_are_filled_alike_forwards_and_backwards():
    missing = np.zeros(80, np.bool_)
    missing[20:26] = missing[31] = missing[50:70] = True
    values = np.cumsum(np.random.default_rng(3).normal(size=80))
    forwards = bridge(missing, 1.0, WALKING).over(values[None])[0]
    backwards = bridge(missing[::-1].copy(), 1.0, WALKING).over(values[None, ::-1])[0]
    assert forwards == pytest.approx(backwards[::-1], abs=1e-9)
    assert forwards[~missing].tolist() == values[~missing].tolist()


@pytest.mark.parametrize("cut", [slice(0, 7), slice(30, 38)])
def test_a_gap_of_a_walk_without_white_noise_is_filled_by_a_line(cut):
    """A walk is expected on the line between what stands beside the gap, and at the run's begin to stay."""
    missing = np.zeros(60, np.bool_)
    missing[cut] = True
    values = np.linspace(3.0, 9.0, 60)
    filled = bridge(missing, 1.0, Noise(1e-7, 0.0, 5.0)).over(values[None])[0]
    expected = values if cut.start else np.where(missing, values[7], values)
    assert filled == pytest.approx(expected, abs=1e-4)


def test_a_bridge_takes_white_noise_from_the_fast_coefficients():
    """Half of the samples missing, half of the power of white noise: every other is a mean of many."""
    missing = np.zeros(2048, np.bool_)
    missing[1::2] = True
    left = noise_left(missing, 1.0, Noise(0.01, 0.0, 1e-6), Noise(0.01))
    assert len(left) == 2047
    assert left[1500:].mean() == pytest.approx(0.5, rel=0.05)
    assert noise_left(np.zeros(100, np.bool_), 1.0, WALKING, WALKING).tolist() == [1.0] * 99


def test_columns_that_are_chosen_keep_their_coefficients():
    """Three columns in full and two smooth ones, of which the first four coefficients are kept."""
    rng = np.random.default_rng(1)
    full, slow, fresh = rng.normal(size=(2, 3, 9)), rng.normal(size=(2, 2, 4)), rng.normal(size=(2, 2, 9))
    stack = Stack(full, slow, np.array([3, 0, 4, 1, 2]), WHITE)
    whole = np.concatenate((full, np.pad(slow, ((0, 0), (0, 0), (0, 5)))), axis=1)[:, stack.place]
    assert stack.chosen(range(5)).tolist() == whole.tolist()
    assert stack.energies(slice(2, 6)) == pytest.approx((whole[:, :, 2:6] ** 2).sum(axis=(0, 2)))
    for count in range(1, 5):
        for columns in permutations(range(5), count):
            own = stack.narrowed(columns, fresh)
            expected = np.concatenate((whole[:, columns], fresh), axis=1)
            assert own.chosen(range(count + 2)).tolist() == expected.tolist()
            bare = stack.narrowed(columns, fresh[:, :0])
            assert bare.chosen(range(count)).tolist() == whole[:, columns].tolist()


def test_what_a_nominal_model_cannot_imitate_is_what_least_squares_in_time_leaves():
    rng = np.random.default_rng(4)
    s = stimulus(N)
    s = replace(s, angle_deg=10.0 + np.concatenate(([0.0], np.cumsum(np.where(s.time_s < 2500, 0.01, 0.02)))))
    variants = [Variant(effect("scale_factor"), {}), Variant(effect("bias_linear"), {})]
    variants[1] = Variant(variants[1].effect, dict(variants[1].effect.shapes[0]))
    model = Model("m", tuple(Term(each, (0.0,), (1e7,)) for each in variants), WHITE)
    wave = np.sin(s.time_s / 170.0)
    run = replace(made_run("r", s, rng), output_dph=wave + 0.1 * s.warm_k + rng.normal(0.0, 0.24, N))
    columns = np.stack([np.ones(N), *(each.columns(s)[0] for each in variants)])
    columns /= np.linalg.norm(columns, axis=1, keepdims=True)
    rest = run.output_dph - np.linalg.lstsq(columns.T, run.output_dph, rcond=None)[0] @ columns
    expected = float(np.linalg.norm(rest)) / 0.24
    assert signature_norm([run], model) == pytest.approx(expected, rel=1e-4)
    left = unexplained([run], model)
    assert left.shape == (1, N - 1)
    assert float(np.linalg.norm(left)) == pytest.approx(expected, rel=1e-4)
    assert left[0] == pytest.approx(dct(rest, norm="ortho")[1:] / 0.24, abs=0.02)


@pytest.mark.parametrize("period_s", [1.0, 4.0])
def test_the_repeat_that_differs_is_told_with_its_time_by_what_changes_slowly(period_s):
    """In b a burst of 15 samples a period, five times as large, is faster than 20 samples and does not count."""
    at = np.arange(float(N))
    noise = Noise(0.004, correlated_dph=0.5, correlation_time_s=20.0)
    runs = []
    for name in "abc":
        s = replace(stimulus(N, cold=False), period_s=period_s)
        own = 0.01 * np.random.default_rng(ord(name)).normal(size=N)
        if name == "b":
            own += 5.0 * np.sin(2.0 * np.pi * at / 15.0) * np.exp(-0.5 * ((at - 600.0) / 150.0) ** 2)
            own += np.exp(-0.5 * ((at - 3000.0) / 200.0) ** 2)
        runs.append(replace(made_run(name, s, np.random.default_rng(1)), output_dph=own))
    group = Group("still", ("0",), (tuple(runs),))
    alone = Group("other", ("0",), ((runs[1],),))

    def data(*groups):
        stacks = [stacked(each.flat, lambda run: [run.output_dph[None]], [False], noise) for each in groups]
        return SimpleNamespace(groups=groups, stacks=stacks, noise=SimpleNamespace(noise=noise, differs=1.0))

    nothing = Solution(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 0)))
    for groups in ([group], [alone, group], [group, alone]):
        (part,) = differing_parts(data(*groups), nothing)
        assert f"most in b about {3000.0 * period_s / 60.0:.0f} min after its start" in part.sentence
        assert "0.5 deg/h rms, changing within 20 s" in part.sentence


def moved(before, after, masked=6):
    """Steps of an angle: ten `before` a masked move of 50 a step, `after` behind it; and which are masked."""
    turned = np.array([*before, *[50.0] * masked, *after])
    missing = np.zeros(len(turned), np.bool_)
    missing[len(before) : len(before) + masked] = True
    angle = 5.0 + np.concatenate(([0.0], np.cumsum(turned)))
    return turned, angle, missing


def test_steady_rates_go_on_into_a_masked_move_that_keeps_its_angle():
    turned, angle, missing = moved([7.0] * 10, [-3.0] * 10)
    found = steady_beside(angle, missing)
    assert found[[0, -1]].tolist() == [5.0, angle[-1]]
    expected = [7.0, *[(300.0 - 7.0 + 3.0) / 4.0] * 4, -3.0]
    assert np.diff(found)[10:16] == pytest.approx(expected)
    assert np.diff(found)[~missing] == pytest.approx(turned[~missing])


def test_a_rate_that_changes_beside_a_masked_move_does_not_go_on_in_it():
    before, after = [7.0] * 9 + [7.5], [-3.2] + [-3.0] * 9
    _, angle, missing = moved(before, [-3.0] * 10)
    assert np.diff(steady_beside(angle, missing))[10:16] == pytest.approx([50.0, *[253.0 / 4.0] * 4, -3.0])
    _, angle, missing = moved([7.0] * 10, after)
    assert np.diff(steady_beside(angle, missing))[10:16] == pytest.approx([7.0, *[243.0 / 4.0] * 4, 50.0])
    # one step is no rate, and two masked ones are no move
    _, angle, missing = moved([7.0], [-3.0])
    assert steady_beside(angle, missing) == pytest.approx(angle)
    _, angle, missing = moved([7.0] * 10, [-3.0] * 10, masked=2)
    assert steady_beside(angle, missing) == pytest.approx(angle)


@pytest.mark.parametrize(("low", "high", "alias"), [(1.0, 30.0, False), (1.0, 70.0, True)])
def test_of_two_lines_that_fold_to_one_the_one_that_means_leave_more_of_is_told(low, high, alias):
    """Means of 1 s leave 1 / 49.65 as much of 9.185 Hz as of 0.185 Hz: their frequencies' ratio."""
    rate, rows = 50.0, 40_000
    time_s = np.arange(rows) / rate
    wave = low * np.sin(2 * np.pi * 0.185 * time_s) + high * np.sin(2 * np.pi * 9.185 * time_s)
    run = replace(
        made_run("r", stimulus(800, cold=False), np.random.default_rng(1)),
        rows_dps=(wave + 0.1 * np.random.default_rng(2).normal(size=rows)) / 3600.0,
        row_s=1.0 / rate,
    )
    line = in_rows(0.185, [run])
    assert line.frequency_hz == pytest.approx(9.185 if alias else 0.185, abs=1e-3)
    assert line.amplitude_dph == pytest.approx(high if alias else low, rel=0.02)
    assert ("is an alias" in line.sentence) is alias
    assert math.isnan(in_rows(0.3, [run]).frequency_hz)


@pytest.mark.parametrize("late", [-3, 0, 2])
def test_a_clock_that_is_off_by_whole_samples_is_set_right(late):
    """The table goes to and fro; the gyro says the same, some samples later."""
    rate = np.where(np.arange(1000) % 100 < 50, 4.0, -4.0)
    angle = np.concatenate(([0.0], np.cumsum(rate)))
    s = replace(stimulus(1000, cold=False), angle_deg=angle)
    run = made_run("r", s, np.random.default_rng(1))
    run = replace(run, output_dph=np.roll(run.output_dph, late))
    (found,), notes = aligned([run])
    away = found.output_dph - found.stimulus.input_rate_dph
    assert np.abs(away[10:-10] - np.median(away)).max() < 2.0
    word = "late" if late > 0 else "early"
    assert len(notes) == (late != 0) and all(
        f"{abs(late)} s {word} against the table" in one for one in notes
    )


def test_the_power_of_coefficients_begins_with_the_slowest():
    walk = power_of(Noise(1e-9, 0.0, 1.0), 100, 1.0)
    assert len(walk) == 99 and walk[0] == pytest.approx(1.0 / 3600.0 / (2.0 - 2.0 * math.cos(math.pi / 100)))


@pytest.mark.parametrize("smooth", [False, True])
@pytest.mark.parametrize("size", [1.0, 0.643, 6e-17])
def test_a_constant_has_no_coefficients_whatever_is_missing(smooth, size):
    run = made_run("r", stimulus(N, cold=False), np.random.default_rng(1))
    run.output_dph.reshape(-1, 100)[:, 40:45] = np.nan
    rows = np.vstack((np.full(N, size), size + 1e-9 * size * np.sin(np.arange(N) / 400.0)))
    found = stacked([run], lambda _: [rows], [smooth], Noise(0.004, 0.01)).chosen([0, 1])[0]
    assert not found[0].any()
    assert found[1].max() == pytest.approx(1e-9 * size * math.sqrt(N / 2.0), rel=0.5)
