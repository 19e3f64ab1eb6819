"""Runs whose samples are not 1 s apart: bands, bridges, lines, aliases and whitening by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.fft import dct

from bench.analysis.gap import Model, Noise
from bench.analysis.gap._aliases import in_rows
from bench.analysis.gap._align import aligned
from bench.analysis.gap._bridge import bridge, noise_left
from bench.analysis.gap._cells import (
    BAND_EDGES_S,
    BANDS,
    band_slices,
    cells_in,
    group_cells,
    left_of_noise,
    mixed_whitened,
)
from bench.analysis.gap._data import Group, group_runs
from bench.analysis.gap._fit import Solution
from bench.analysis.gap._lines import strongest_line
from bench.analysis.gap._noise import FLICKER_TIMES_S, Periodogram
from bench.analysis.gap._series import differences, write_missing
from bench.analysis.gap._signature import unexplained
from bench.analysis.gap._stack import stacked, transformed
from bench.analysis.gap._stochastic import REPEATS, _raised, floor_data
from bench.analysis.gap._which import left_of_runs
from tests.analysis.gap.conftest import made_run, stimulus

WHITE = Noise(0.004)
"""0.24 deg/h in means of 1 s."""
N = 4000
PERIODS_S = [0.25, 1.0, 2.0]


def still(period_s, n=N, rate_dps=0.0):
    return replace(stimulus(n, cold=False, rate_dps=rate_dps * period_s), period_s=period_s)


def run_of(values, period_s, name="r"):
    made = made_run(name, still(period_s, len(values)), np.random.default_rng(1), profile="still")
    return replace(made, output_dph=np.asarray(values, np.float64))


def wave(number, n=N):
    """The cosine of `number` half periods in the run: one coefficient of sqrt(n / 2)."""
    return np.cos(np.pi * number * (np.arange(n) + 0.5) / n)


@pytest.mark.parametrize("period_s", [0.25, 0.5, 1.0, 2.0, 10.0])
@pytest.mark.parametrize("n", [700, 7000, 21_000])
def test_a_coefficient_is_in_the_band_of_its_period(n, period_s):
    """Number k of n has a period of 2 n / k samples; one on an edge belongs to the slower band."""
    periods_s = 2.0 * n * period_s / np.arange(1, n)
    expected = [sum(own < edge for edge in BAND_EDGES_S) for own in periods_s.tolist()]
    slices = band_slices(n, period_s)
    assert [band for band, part in enumerate(slices) for _ in range(part.start, part.stop)] == expected
    group = Group("still", ("0",), ((run_of(np.zeros(n), period_s),),))
    assert cells_in(group) == len(set(expected))


@pytest.mark.parametrize(("period_s", "band"), [(0.25, "20..38 s"), (1.0, "75..150 s"), (2.0, "150..300 s")])
def test_a_wave_of_a_hundred_samples_is_in_the_band_of_its_seconds(period_s, band):
    """White noise of 0.004 deg/sqrt(h) is 0.24 deg/h over the root of the period in seconds."""
    run = run_of(wave(80), period_s)
    (group,) = group_runs([run])
    stack = stacked(group.flat, lambda own: [own.output_dph[None]], [False], WHITE)
    cells = group_cells(group, stack, WHITE)
    energies = {BANDS[each.band]: float(each.products(np.zeros(1, np.int64))[0, 0]) for each in cells}
    assert energies.pop(band) == pytest.approx(0.5 * N * period_s / 0.24**2, rel=1e-5)
    assert max(energies.values()) < 1e-3
    assert [each.power for each in cells] == pytest.approx([0.24**2 / period_s] * len(cells))
    assert [each.count for each in cells] == [
        part.stop - part.start for part in band_slices(N, period_s) if part.stop > part.start
    ]


def slow_covariance(lag_s, noise):
    """Of flicker, a sum of Markov processes, and of a random walk from far before, (deg/h)^2."""
    flicker = noise.bias_instability_dph**2 * math.log(3.0) / math.pi
    walk = noise.rate_random_walk_dph_per_sqrt_h**2 / 3600.0
    # a walk's covariance is what both have walked: half the sum of the ways less their distance
    walked = walk * (1e4 - 0.5 * lag_s)
    return flicker * np.exp(-lag_s[..., None] / FLICKER_TIMES_S).sum(axis=-1) + walked


@pytest.mark.parametrize("period_s", PERIODS_S)
@pytest.mark.parametrize(
    "noise",
    [Noise(0.01, 0.0, 30.0), Noise(0.01, 0.8), Noise(0.002, 0.0, 10.0, 0.2), Noise(0.01, 0.5, 20.0, 0.3)],
)
def test_a_gap_among_few_samples_is_filled_by_the_best_linear_prediction(noise, period_s):
    """Three samples on each side stand alone; the mean is not known (generalised least squares)."""
    at_s = period_s * np.arange(9.0)
    missing = np.isin(np.arange(9), [3, 4, 5])
    white = noise.arw_deg_per_sqrt_h**2 * 3600.0 / period_s + (noise.quantum_arcsec / period_s) ** 2 / 6.0
    covariance = slow_covariance(np.abs(at_s[:, None] - at_s), noise)
    inverse = np.linalg.inv(covariance[np.ix_(~missing, ~missing)] + white * np.eye(6))
    across, ones = covariance[np.ix_(missing, ~missing)], np.ones(6)
    lacking = 1.0 - across @ inverse @ ones
    weights = (across + lacking[:, None] / (ones @ inverse @ ones)) @ inverse
    filled = bridge(missing, period_s, noise).over(np.eye(9))
    assert pytest.approx(weights, abs=1e-6) == filled[np.ix_(~missing, missing)].T
    assert np.ptp(weights) > 0.02
    assert filled[:, ~missing].tolist() == np.eye(9)[:, ~missing].tolist()


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_what_bridging_leaves_of_noise_is_that_of_its_covariance(period_s):
    """Four bins an octave, from 64 runs: each bin against the bridge's matrix between the noise's covariance."""
    n, noise = 256, Noise(0.01, 0.0, 30.0)
    missing = (np.arange(n) >= 60) & (np.arange(n) < 120)
    index = np.arange(1, n)
    change = 2.0 - 2.0 * np.cos(np.pi * index / n)
    power = 0.36 / period_s + 900.0 * period_s / 3600.0 / change
    basis = dct(np.eye(n), norm="ortho", axis=1)[:, 1:]
    filled = bridge(missing, period_s, noise).over(basis.T)
    seen = dct(filled, norm="ortho", axis=1)[:, 1:]
    expected = (power[:, None] * seen**2).sum(axis=0) / power
    bins = np.floor(4.0 * np.log2(index)).astype(int)
    found = noise_left(missing, period_s, noise, noise)
    for each in np.unique(bins):
        at = bins == each
        scatter = 4.0 * math.sqrt(2.0 / (64.0 * at.sum()))
        assert found[at] == pytest.approx(np.full(at.sum(), expected[at].mean()), rel=scatter)
    assert np.ptp(expected) > 0.3
    # steps of a walk over white noise grow with the period: K T at 1 s is K at T, and so are the very draws,
    # which are in single precision
    same = Noise(0.01, 0.0, 30.0 * period_s)
    assert found == pytest.approx(noise_left(missing, 1.0, same, same), rel=1e-5)


def lacking(period_s):
    """Two and a half periods of a wave with a gap of 700 samples, and a walk under white noise to match 1 s."""
    values = wave(5)
    values[1500:2200] = np.nan
    return run_of(values, period_s), Noise(0.01, 0.0, 2.0)


@pytest.mark.parametrize("period_s", [0.25, 2.0])
def test_gaps_of_runs_are_bridged_for_the_walk_of_their_seconds(period_s):
    """K T at 1 s is K at T; a bridge for the very walk at 1 s fills the gap otherwise."""
    run, noise = lacking(period_s)
    alike, other = replace(noise, rate_random_walk_dph_per_sqrt_h=2.0 * period_s), run.missing
    rows = np.stack([run.output_dph, np.arange(float(N)) / N])
    expected = dct(bridge(other, 1.0, alike).over(rows), norm="ortho", axis=1)[:, 1:]
    wrong = dct(bridge(other, 1.0, noise).over(rows), norm="ortho", axis=1)[:, 1:]
    assert np.abs(expected - wrong)[:, :30].max() > 0.05
    assert transformed(run, rows, noise) == pytest.approx(expected, abs=1e-9)
    stack = stacked([run], lambda _: [rows, rows], [False, True], noise)
    assert stack.chosen([0, 1])[0] == pytest.approx(expected, abs=1e-4)
    # of a line between kinks means over 10 s tell the slow coefficients but for little
    assert stack.chosen([2, 3])[0][:, :30] == pytest.approx(expected[:, :30], abs=0.03)
    group = Group("still", ("0",), ((run,),))
    left = noise_left(other, 1.0, alike, alike)
    assert left_of_noise(group, noise, noise) == pytest.approx(left, rel=1e-5)
    width = round(100.0 / period_s) | 1
    model = Model("m", (), noise)
    real = replace(run, output_dph=run.output_dph + run.stimulus.input_rate_dph)
    (found,) = differences([real], model, model, points=N)
    filled = bridge(other, 1.0, alike).over(rows[:1])[0]
    mean = np.convolve(filled - filled.mean(), np.full(width, 1.0 / width), mode="valid")
    assert found.before_dph[width // 2 : N - width // 2] == pytest.approx(mean, abs=1e-6)


@pytest.mark.parametrize("missing", [slice(5000, 5100), slice(1000, 1007), slice(7900, 8000)])
def test_white_noise_is_filled_by_the_mean_of_4096_samples_on_either_side(missing):
    """Without slow noise every sample counts alike, as far as the stretches go."""
    n = 10_000
    lost = np.zeros(n, np.bool_)
    lost[missing] = True
    near = np.zeros(n, np.bool_)
    near[max(missing.start - 4096, 0) : missing.stop + 4096] = True
    values = np.random.default_rng(1).normal(size=(2, n)) + np.where(near, 0.0, 1e6)
    filled = bridge(lost, 1.0, Noise(0.01)).over(values)
    mean = values[:, near & ~lost].mean(axis=1)
    assert filled[:, lost] == pytest.approx(np.repeat(mean[:, None], lost.sum(), axis=1), abs=1e-6)


def line_in(coefficients, period_s, *, named_hz=(), rate_dps=0.0):
    n = coefficients.shape[1] + 1
    run = made_run("r", still(period_s, n, rate_dps), np.random.default_rng(1), profile="still")
    return strongest_line([Group("still", ("0",), ((run,),))], [coefficients], WHITE, {}, named_hz)


def ones_with(number, size_dph, period_s, n=N):
    """Whitened coefficients of size one but for that of a wave of so many half periods in the run."""
    rows = np.random.default_rng(2).choice([-1.0, 1.0], size=(1, n - 1))
    rows[0, number - 1] = size_dph * math.sqrt(0.5 * n * period_s) / 0.24
    return rows


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_a_lines_period_amplitude_and_harmonic_are_those_of_its_seconds(period_s):
    own_s = 2.0 * N * period_s / 1236.5  # the middle of the window of 1233 to 1240
    found = line_in(ones_with(1234, 0.4, period_s), period_s, rate_dps=360.0 / own_s / 3.0)
    assert found.period_s == pytest.approx(own_s) and found.frequency_hz == pytest.approx(1.0 / own_s)
    assert found.amplitude_dph == pytest.approx(0.4, rel=0.05)
    assert found.turns == pytest.approx(1.0 / 3.0, rel=1e-6) and found.harmonic == 3


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_lines_are_looked_for_below_700_s(period_s):
    """The first window that lies below it as a whole; what is slower is an effect's."""
    n = 16_000
    first = math.ceil(2.0 * n * period_s / 700.0 / 8.0)
    assert line_in(ones_with(8 * first, 3.0, period_s, n), period_s) is None
    found = line_in(ones_with(8 * first + 1, 3.0, period_s, n), period_s)
    assert 2.0 * n * period_s / (8 * first + 1) <= 700.0 < 2.0 * n * period_s / (8 * first - 7)
    assert found.period_s == pytest.approx(2.0 * n * period_s / (8 * first + 4.5))
    for number in (8 * first - 4, 8 * first + 4, 8 * first + 12):
        named_hz = [number / (2.0 * n * period_s)]
        assert line_in(ones_with(8 * first + 1, 3.0, period_s, n), period_s, named_hz=named_hz) is None


@pytest.mark.parametrize("period_s", PERIODS_S)
@pytest.mark.parametrize("turns", [0.0, 1.0, 3.0])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_named_line_hides_what_is_where_it_folds_to_and_nothing_else(period_s, turns, sign):
    """Means of T fold a line by multiples of 1 / T about nought; a twentieth of the alias is the same line."""
    rows = ones_with(1234, 0.4, period_s)
    own_hz = 1234.0 / (2.0 * N * period_s)
    assert line_in(rows, period_s, named_hz=[abs(turns / period_s + sign * own_hz)]) is None
    for other_hz in (turns / period_s + sign * 1.08 * own_hz, 0.5 * own_hz):
        assert line_in(rows, period_s, named_hz=[abs(other_hz)]) is not None


def test_runs_are_looked_at_together_if_their_windows_are_of_one_frequency():
    """Of as many samples as far apart; else a coefficient is of another frequency in each."""
    rows = ones_with(1234, 0.2, 1.0)
    rows[0, 1233] = 6.0

    def group(name, period_s, n=N):
        return Group(name, ("0",), ((made_run(name, still(period_s, n), np.random.default_rng(1)),),))

    groups = [group("a", 1.0), group("b", 2.0), group("c", 1.0), group("d", 1.0, 3000)]
    groups = [replace(each, runs=((replace(each.flat[0], profile=each.profile),),)) for each in groups]
    left = [rows, rows, rows, rows[:, :2999]]
    found = strongest_line(groups, left, WHITE, {})
    assert found.profile == "a, c" and found.period_s == pytest.approx(2.0 * N / 1236.5)
    assert strongest_line(groups[1:], left[1:], WHITE, {}).profile in ("b", "c", "d")


@pytest.mark.parametrize("period_s", PERIODS_S)
@pytest.mark.parametrize(("power", "raised"), [(1.3, False), (1.4, True)])
def test_a_walk_raises_noise_by_the_square_of_the_period(period_s, power, raised):
    """K^2 T / 3600 over 2 - 2 cos(pi f) beside N^2 3600 / T of white noise; clear is 35 % more."""
    frequency = np.array([0.01, 0.7])
    change = 2.0 - 2.0 * math.cos(0.01 * math.pi)
    walk = math.sqrt((power - 1.0) * change * 3600.0) * 0.24 / period_s
    data = [Periodogram(frequency, np.ones(2), np.ones(2), period_s)]
    assert _raised(data, Noise(0.004, 0.0, walk), WHITE) is raised


@pytest.mark.parametrize("alias_hz", [0.0, 1.0, 2.0])
def test_a_named_line_that_folds_to_less_than_is_looked_at_hides_nothing(alias_hz):
    """In a run of 16000 s the slowest six windows are not looked at: those of effects, and of a mean."""
    n = 16_000
    rows = ones_with(1234, 0.2, 1.0, n)
    assert line_in(rows, 1.0, named_hz=[alias_hz]) == line_in(rows, 1.0)
    assert line_in(rows, 1.0).period_s == pytest.approx(2.0 * n / 1236.5)


def rows_of(period_s, waves):
    """A run of 800 means with 20 minutes of rows at 50 Hz: some waves, (Hz, deg/h), and little noise."""
    time_s = np.arange(60_000) / 50.0
    rows = 0.05 * np.random.default_rng(2).normal(size=len(time_s))
    for at_hz, size in waves:
        rows += size * np.sin(2 * np.pi * at_hz * time_s)
    made = made_run("r", still(period_s, 800), np.random.default_rng(1))
    return replace(made, rows_dps=rows / 3600.0, row_s=0.02)


@pytest.mark.parametrize("part", [0.8, 1.2])
@pytest.mark.parametrize(("period_s", "order"), [(0.25, 2), (1.0, 9), (2.0, 18), (2.0, 7)])
def test_a_line_in_means_is_the_one_in_rows_that_folds_to_it(period_s, order, part):
    """Means leave less of the faster one by the ratio of both: a little less or more of it is put in."""
    high_hz = order / period_s + 0.185
    high = part * high_hz / 0.185
    run = rows_of(period_s, [(0.185, 1.0), (high_hz, high)])
    line = in_rows(0.185, [run])
    alias = part > 1.0
    assert line.frequency_hz == pytest.approx(high_hz if alias else 0.185, abs=1e-3)
    assert line.amplitude_dph == pytest.approx(high if alias else 1.0, rel=0.02)
    assert line.sentence.startswith(f"the line at 0.185 Hz in means of {period_s:g} s is ")
    assert ("is an alias" in line.sentence) is alias
    unknown = in_rows(0.185, [replace(run, rows_dps=None)]).sentence
    assert unknown.endswith(f"its cause may lie off by multiples of {1.0 / period_s:g} Hz")


@pytest.mark.parametrize("period_s", [1.0, 2.0])
def test_a_line_just_below_half_the_rate_of_the_rows_is_found_too(period_s):
    """Rows at 50 Hz have lines up to 25 Hz: 24.815 Hz folds to 0.185 Hz in means of 1 s and of 2 s."""
    line = in_rows(0.185, [rows_of(period_s, [(24.815, 5.0)])])
    assert line.frequency_hz == pytest.approx(24.815, abs=1e-3)
    assert line.amplitude_dph == pytest.approx(5.0, rel=0.02)


@pytest.mark.parametrize("period_s", PERIODS_S)
@pytest.mark.parametrize(("at", "alias"), [(0.45, False), (0.55, True), (1.45, True), (1.55, True)])
def test_a_line_just_faster_than_half_the_means_is_an_alias(period_s, at, alias):
    """Of 0.55 / T Hz means show 0.45 / T Hz, which is near."""
    line = in_rows(0.45 / period_s, [rows_of(period_s, [(at / period_s, 5.0)])])
    assert line.frequency_hz == pytest.approx(at / period_s, abs=1e-3)
    assert ("is an alias" in line.sentence) is alias


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_a_late_clock_is_told_in_seconds(period_s):
    rate = np.where(np.arange(1000) % 100 < 50, 4.0, -4.0)
    angle = np.concatenate(([0.0], np.cumsum(rate * period_s)))
    run = made_run("r", replace(still(period_s, 1000), angle_deg=angle), np.random.default_rng(1))
    (found,), (note,) = aligned([replace(run, output_dph=np.roll(run.output_dph, 3))])
    assert f"the gyro's samples are {3 * period_s:g} s late" in note
    away = found.output_dph - found.stimulus.input_rate_dph
    assert np.abs(away[10:-10] - np.median(away)).max() < 2.0


@pytest.mark.parametrize(("period_s", "together"), [(0.25, 40), (1.0, 10), (2.0, 5), (7.0, 1), (30.0, 1)])
def test_smooth_columns_have_the_coefficients_down_to_20_s(period_s, together):
    """From means over 10 s at most: a cosine of k half periods has sqrt(n / 2) at number k, and nothing else."""
    runs = [run_of(np.zeros(N), period_s)]
    numbers = [1, 7, 60, 99]
    rows = np.stack([wave(k) for k in numbers])
    stack = stacked(runs, lambda _: [rows], [True], WHITE)
    assert stack.slow.shape == (1, 4, N // together - 1)
    expected = np.zeros((4, N // together - 1))
    expected[np.arange(4), np.array(numbers) - 1] = math.sqrt(0.5 * N)
    assert stack.slow[0] == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_residuals_are_whitened_by_the_noise_of_their_period(period_s):
    """Of the data less 0.5 times a column, with white noise of 0.24 deg/h over the root of the period."""
    own, column = 0.7 * wave(200) + 0.5 * wave(31), wave(31)
    run = run_of(own, period_s)
    group = Group("still", ("0",), ((run,),))
    stack = stacked(group.flat, lambda each: [each.output_dph[None], column[None]], [False, False], WHITE)
    noise = SimpleNamespace(noise=WHITE)
    data = SimpleNamespace(groups=(group,), stacks=(stack,), noise=noise)
    (left,) = left_of_runs(data, Solution(np.array([1]), np.array([0.5]), np.eye(1)))
    expected = np.zeros((1, N - 1))
    expected[0, 199] = 0.7 * math.sqrt(0.5 * N * period_s) / 0.24
    assert left == pytest.approx(expected, abs=1e-3)
    whole = mixed_whitened(group, stack.chosen(range(2)), WHITE)
    expected[0, 30] = 0.5 * math.sqrt(0.5 * N * period_s) / 0.24
    assert whole[:, 0] == pytest.approx(expected, abs=1e-3)
    real = replace(run, output_dph=own + run.stimulus.input_rate_dph)
    assert unexplained([real], Model("m", (), WHITE)) == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_noise_of_repeats_is_gathered_in_deg_per_h(period_s):
    """Half the square of what two repeats differ by; bins of an eighth of an octave at their own period."""
    rng = np.random.default_rng(1)
    sheet = Noise(0.004, 0.1, 2.0)
    values = rng.normal(size=(2, N))
    runs = tuple(run_of(each, period_s, name) for each, name in zip(values, "ab", strict=True))
    group = Group("still", ("0",), (runs,))
    coefficients = dct(values, norm="ortho", axis=1)[:, None, 1:]
    (found,), source = floor_data([group], [coefficients], sheet, np.zeros(0))
    assert source == REPEATS and found.period_s == period_s
    apart = dct((values[0] - values[1]) / math.sqrt(2.0), norm="ortho")[1:] ** 2
    bins = np.floor(8.0 * np.log2(np.arange(1, N))).astype(int)
    expected = [apart[bins == each].sum() for each in np.unique(bins)]
    assert found.energy == pytest.approx(expected, rel=1e-6)
    assert found.count.tolist() == [(bins == each).sum() for each in np.unique(bins)]


@pytest.mark.parametrize("period_s", PERIODS_S)
def test_what_a_simulation_lacks_is_written_at_the_ends_of_the_steps(tmp_path, period_s):
    run = replace(run_of(np.arange(300.0), period_s), simulated=True)
    own = SimpleNamespace(foretold_dph=None)
    closed = SimpleNamespace(simulation=own, predict=lambda s: s.input_rate_dph + 7.0)
    (file,) = write_missing(closed, [run], tmp_path / "m.toml")
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    assert rows[:, 0] == pytest.approx(period_s * np.arange(1.0, 301.0))
    assert rows[:, 1] == pytest.approx(np.arange(300.0) - run.stimulus.input_rate_dph, abs=1e-5)
    assert rows[:, 2] == pytest.approx(np.full(300, 7.0))
