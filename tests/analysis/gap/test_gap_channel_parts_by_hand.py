"""Parts of a channel's diagnosis by hand: pieces, cells, floor, fits, sets of effects, shrinkage."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.fft import dct
from scipy.stats import f as fisher
from scipy.stats import t as student
from statsmodels.stats.multitest import multipletests

from bench.analysis.gap import _channel_fit, _channel_shrinkage
from bench.analysis.gap._channel_cells import (
    ChannelCells,
    band_name,
    channel_bands,
    channel_cells,
    channel_places,
    gap_rms,
    tolerance,
)
from bench.analysis.gap._channel_data import ChannelSeries, _series
from bench.analysis.gap._channel_fit import ChannelFit, fit_effects, log_evidence, search_effects
from bench.analysis.gap._channel_floor import ChannelFloor, channel_floor, octaves
from bench.analysis.gap._channel_shrinkage import judge_channel
from bench.analysis.gap._channels import ChannelSignal, _causes, _curves, _scatter, _term
from bench.analysis.gap._findings import Cause, Place
from bench.analysis.gap._model_file import ChannelTerm
from simulators.effects import CHANNEL_UNITS, ChannelEffect, ChannelInputs, catalogue

RATE_ERROR = catalogue()["table_rate_error"]
assert isinstance(RATE_ERROR, ChannelEffect)


def turning(values, *, phase=None, quiet=None, period_s=1.0, drive=6.0, run_id="r", time_s=None):
    """A table's rate over a demand of 6 deg/s."""
    n = len(values)
    time_s = period_s * (0.5 + np.arange(n)) if time_s is None else time_s
    inputs = ChannelInputs(time_s, np.full(n, drive), drive, period_s)
    return ChannelSeries(
        "table_rate",
        run_id,
        inputs,
        np.asarray(values, np.float64),
        np.full(n, "turn") if phase is None else np.asarray(phase),
        np.ones(n, np.bool_) if quiet is None else quiet,
        1e-4,
    )


def test_pieces_end_with_a_phase_a_value_or_a_pause_and_have_eight_samples():
    values = np.arange(60.0)
    values[20:22] = math.nan
    values[29] = math.nan  # seven samples before it, too few
    time_s = np.arange(60.0) + np.where(np.arange(60) >= 50, 0.6, 0.0)
    found = turning(values, phase=["a"] * 8 + ["b"] * 52, time_s=time_s).pieces()
    assert found == [("a", slice(0, 8)), ("b", slice(8, 20)), ("b", slice(30, 50)), ("b", slice(50, 60))]
    even = turning(values, phase=["a"] * 8 + ["b"] * 52, time_s=np.arange(60.0) + (np.arange(60) >= 50) * 0.5)
    assert even.pieces()[-1] == ("b", slice(30, 60))


def test_the_resolution_is_the_least_step_between_values():
    run = SimpleNamespace(run_id="r", unit_id="u", phase_at=lambda t: t.astype(str), checksum="s")
    inputs = ChannelInputs(np.arange(5.0), np.zeros(5), 0.0, 1.0)
    raw = np.array([3.0, 1.0, 1.0, 1.25, 9.0])
    found = _series(run, "table_rate", inputs, np.arange(5.0), raw)
    assert (found.resolution, found.run_id, found.checksum, found.unit_id) == (0.25, "r", "s", "u")
    assert found.quiet.tolist() == [True] * 5 and found.phase.tolist() == ["0.0", "1.0", "2.0", "3.0", "4.0"]
    assert _series(run, "table_rate", inputs, np.arange(5.0), np.ones(5)).resolution == 1e-6


def test_time_scales_are_named_from_fast_to_slow():
    assert channel_bands() == (
        "under 8 s", "8..32 s", "32..128 s", "128..512 s", "9..34 min", "over 34 min",
    )  # fmt: skip
    assert [band_name(k) for k in range(6)] == list(channel_bands())


def test_coefficients_lie_in_cells_of_phase_and_time_scale():
    """Coefficient k of n samples has a period of 2 n / k of them; that of the mean is the slowest."""
    phase = ["a"] * 40 + ["b"] * 24
    level = ChannelFloor(2.0 ** np.arange(24.0), 100.0 + np.arange(24.0), "made")
    series = turning(np.arange(64.0), phase=phase, period_s=2.0)
    cells = channel_cells([series], level)
    periods = [2 * n * 2.0 / max(k, 0.5) for n in (40, 24) for k in range(n)]
    edges = (0.0, 8.0, 32.0, 128.0, 512.0, 2048.0)
    expected = [
        (name, sum(period >= edge for edge in edges) - 1) for name, period in zip(phase, periods, strict=True)
    ]
    assert [cells.names[k] for k in cells.cell] == expected
    octave = np.floor(np.log2(periods)).astype(int)
    assert cells.floor.tolist() == (2.0**octave).tolist()
    for k in range(len(cells.names)):
        assert cells.trust[k] == pytest.approx((100.0 + octave)[cells.cell == k].mean())
    rest = np.random.default_rng(1).normal(size=64)
    rows = np.concatenate((dct(rest[:40], norm="ortho"), dct(rest[40:], norm="ortho")))
    assert cells.whitened([rest]) == pytest.approx(rows / np.sqrt(cells.floor))
    assert cells.sums(rows**2).sum() == pytest.approx(float(rest @ rest))


def made_cells(counts, floors, trust=50.0, phases=("a", "a", "b")):
    """Cells of so many coefficients, on a floor of their own."""
    n = sum(counts)
    series = turning(np.zeros(n), phase=np.repeat(phases, counts))
    number = np.repeat(np.arange(len(counts)), counts)
    names = tuple((phase, band) for phase, band in zip(phases, (0, 1, 0), strict=True))
    floor = np.repeat(np.asarray(floors, np.float64), counts)
    return ChannelCells((series,), floor, number, names, np.full(len(counts), trust))


def test_places_hold_energies_against_a_floor_that_is_known_from_so_many_coefficients():
    cells = made_cells((30, 20, 50), (4.0, 9.0, 1.0))
    left = np.repeat([2.0, 3.0, 1.0], (30, 20, 50))
    found = {(place.part, place.band): place for place in channel_places(cells, left)}
    ratios = np.array([4.0, 9.0, 1.0])
    raw = fisher.sf(ratios, [30, 20, 50], 50.0)
    adjusted = np.minimum(multipletests(raw, method="holm")[1] * len(CHANNEL_UNITS), 1.0)
    own = [found["a", "under 8 s"], found["a", "8..32 s"], found["b", "under 8 s"]]
    assert [place.p_value for place in own] == pytest.approx(adjusted.tolist())
    assert [place.energy_ratio for place in own] == pytest.approx(ratios.tolist())
    # above the floor are 3 x 4 and 8 x 9 a coefficient
    energy = np.array([30 * 3 * 4.0, 20 * 8 * 9.0, 0.0])
    assert [place.rms for place in own] == pytest.approx(
        [math.sqrt(energy[0] / 50), math.sqrt(energy[1] / 50), 0.0]
    )
    assert [place.share for place in own] == pytest.approx((energy / energy.sum()).tolist())
    assert [place.clear for place in own] == [True, True, False]
    assert [place.start_s for place in own] == [0.5, 0.5, 50.5]
    assert next(iter(found)) == ("a", "8..32 s")  # the largest share first
    whole = gap_rms(cells, left, list(found.values()))
    assert whole == pytest.approx(math.sqrt(energy.sum() / 100))
    assert gap_rms(cells, left, own[2:]) == 0.0


def test_a_misfit_is_tolerated_in_its_phase_a_tenth_as_much_one_time_scale_on():
    cells = made_cells((30, 20, 50), (4.0, 9.0, 1.0))
    left = np.repeat([2.0, 1.0, 1.0], (30, 20, 50))
    found = tolerance(cells, left, 0.5)[[0, 30, 50]]
    gap = 3.0 * 4.0 / 16.0  # a sixteenth of what is above the floor
    expected = [1.0 + (gap + 0.25) / 4.0, 1.0 + (0.1 * gap + 0.25) / 9.0, 1.0 + 0.25 / 1.0]
    assert found == pytest.approx(np.sqrt(expected))


def test_octaves_double_from_two_seconds_on():
    assert octaves(8, 1.0).tolist() == [5, 4, 3, 2, 2, 1, 1, 1]
    assert octaves(4, 0.05).tolist() == [0, 0, 0, 0]
    assert octaves(2, 1e9).tolist() == [23, 23]


def test_a_floor_is_that_of_the_quietest_stretch_and_grows_with_the_period_beyond_what_is_known():
    rng = np.random.default_rng(1)
    quiet = np.arange(4000) >= 1000
    values = 6.0 + np.where(quiet, 0.02, 2.0) * rng.normal(size=4000) + 1e-9 * np.arange(4000.0) ** 2
    still = turning(values, quiet=quiet)
    louder = turning(6.0 + 0.1 * rng.normal(size=4000), run_id="louder")
    found = channel_floor([still, louder])
    assert found.source == "quiet stretches"
    known = slice(1, 8)  # periods from 2 to 256 s
    assert found.power[known] == pytest.approx(np.full(7, 4e-4), rel=0.35)
    assert found.power[1] == pytest.approx(4e-4, rel=0.05)
    # of 3000 samples octave k holds the coefficients above 6000 / 2^(k + 1) up to 6000 / 2^k
    assert found.count[1:6].tolist() == [1499.0, 750.0, 375.0, 188.0, 94.0]
    slow = np.flatnonzero(found.count > 0)[-1]
    assert found.power[12:] == pytest.approx(found.power[11] * 2.0 ** np.arange(1, 13))
    assert slow == 23 and found.count[12:].tolist() == [found.count[11]] * 12
    power, octave = found.at(8, 1.0)
    assert power.tolist() == found.power[octave].tolist() and octave.tolist() == octaves(8, 1.0).tolist()


def test_without_a_quiet_stretch_neighbouring_samples_are_the_floor():
    """White noise of 1 on a parabola: power 1 in the samples' octave, then in proportion to the period."""
    curve = 0.01 * np.arange(4000.0) ** 2
    noise = np.random.default_rng(1).normal(size=4000)
    loud = turning(curve + noise, quiet=np.arange(4000) < 31)
    found = channel_floor([loud])
    assert found.source == "neighbouring samples" and set(found.count.tolist()) == {8.0}
    assert found.power[:2].tolist() == pytest.approx([1.0] * 2, rel=0.1)
    assert found.power[5] / found.power[1] == pytest.approx(2.0**4)
    steady = turning(np.full(400, 6.0), quiet=np.arange(400) < 31)
    found = channel_floor([replace(steady, resolution=0.6)])
    assert found.power.tolist() == pytest.approx([0.03] * 24)
    coarse = channel_floor([replace(loud, quiet=np.ones(4000, np.bool_), resolution=100.0)])
    assert coarse.power[:12].tolist() == pytest.approx([100.0**2 / 12.0] * 12)


def test_what_repeats_every_turn_and_a_cubic_are_taken_out_of_a_floor():
    n = 2000
    time_s = np.arange(float(n))
    angle = 7.3 * time_s
    x = np.linspace(-1.0, 1.0, n)
    shape = 0.3 * x**3 - 0.2 * x + 0.5 * np.cos(np.radians(4 * angle)) + 0.4 * np.sin(np.radians(angle))
    noise = 1e-3 * np.random.default_rng(1).normal(size=n)
    drive = 6.0 + np.sin(time_s / 9.0)

    def power(angle_deg):
        inputs = ChannelInputs(time_s, drive, 6.0, 1.0, (), angle_deg)
        return channel_floor([replace(turning(drive + shape + noise), inputs=inputs)]).power

    assert power(angle)[1:8] == pytest.approx(np.full(7, 1e-6), rel=0.6)
    assert power(np.zeros(n))[1:8].max() > 1e-2 and power(np.zeros(0))[1:8].max() > 1e-2
    assert power(angle % 80.0)[1:8].max() > 1e-2  # less than a quarter of a turn repeats nothing
    temperature = replace(turning(drive + noise), channel="case_temperature")
    assert channel_floor([temperature]).power[5] > 1e-3  # its drive is no part of what it should be


def effect_of(name, **changes):
    """An effect of the table's rate; its formula is never asked."""
    fields = {
        "name": name, "needed": False, "known": False, "neutral": (0.0,), "acts": None, "meaning": f"{name}!",
        "channel": "table_rate", "parameters": (SimpleNamespace(name=name, low=-1e3, high=1e3),),
    }  # fmt: skip
    starts = changes.pop("starts", ())
    return SimpleNamespace(begins=lambda values: starts, **(fields | changes))


@pytest.fixture
def linear(monkeypatch):
    """A channel whose effects add up: a column each, in units of 1."""
    n = 400
    rng = np.random.default_rng(5)
    columns = {
        name: np.convolve(rng.normal(size=n + 20), np.ones(21) / math.sqrt(21), mode="valid")
        for name in "abc"
    }

    def simulate(channel, inputs, values, effects):
        return 6.0 + sum((own[0] * columns[name] for name, own in values.items()), np.zeros(n))

    monkeypatch.setattr(_channel_fit, "simulate", simulate)
    return columns


def of_linear(columns, truth, noise=0.1, seed=3):
    n = len(columns["a"])
    values = 6.0 + sum((size * columns[name] for name, size in truth.items()), np.zeros(n))
    series = turning(values + noise * np.random.default_rng(seed).normal(size=n))
    floor = ChannelFloor(np.full(24, noise**2), np.full(24, 400.0), "made")
    return series, floor, channel_cells([series], floor)


def test_a_fit_is_weighted_least_squares_with_priors(linear):
    """The model's own parameter `a`, 2 +- 0.05, and `b` freely; the weights halve what counts of each row."""
    _, _, cells = of_linear(linear, {"a": 2.1, "b": -3.0})
    effects = [effect_of(name, starts=((9.0,), (-2.0,)) if name == "b" else ()) for name in "abc"]
    terms = [SimpleNamespace(name="a", values=(2.0,), sigmas=(0.05,))]
    weight = np.full(len(cells.cell), 2.0)
    found = fit_effects(cells, effects, terms, frozenset("b"), weight, None)
    rows = dct(np.stack([linear[name] for name in "ab"]), norm="ortho", axis=1) / 0.2
    data = dct(cells.series[0].values - 6.0, norm="ortho") / 0.2
    whole = np.concatenate((rows.T, [[1 / 0.05, 0.0]]))
    target = np.append(data, 2.0 / 0.05)
    expected, rest, *_ = np.linalg.lstsq(whole, target, rcond=None)
    deviation = np.sqrt(np.diag(np.linalg.inv(whole.T @ whole)))
    assert [found.values["a"][0], found.values["b"][0]] == pytest.approx(expected.tolist(), rel=1e-4)
    assert [found.sigmas["a"][0], found.sigmas["b"][0]] == pytest.approx(deviation.tolist(), rel=1e-3)
    assert found.cost == pytest.approx(float(rest[0]), rel=1e-6) and found.count == 1
    assert found.left == pytest.approx(2.0 * (data - rows.T @ expected), abs=1e-3)
    assert log_evidence(found) == pytest.approx(-0.5 * found.cost - 0.5 * math.log(400) - 5.0)
    nothing = fit_effects(cells, effects, [], frozenset(), weight, None)
    assert (nothing.values, nothing.count) == ({}, 0)
    assert nothing.cost == pytest.approx(float(data @ data)) and nothing.left == pytest.approx(2.0 * data)


def test_a_models_own_parameter_stays_within_three_deviations_and_an_effects_does_not(linear):
    _, _, cells = of_linear(linear, {"a": 3.0})
    effects, ones = [effect_of("a"), effect_of("b")], np.ones(len(cells.cell))
    terms = [SimpleNamespace(name="a", values=(2.0,), sigmas=(0.01,))]
    bound = fit_effects(cells, effects, terms, frozenset(), ones, None)
    assert bound.values["a"][0] == pytest.approx(2.03, abs=1e-4) and bound.count == 0
    free = fit_effects(cells, effects, terms, frozenset("a"), ones, None)
    assert free.values["a"][0] == pytest.approx(3.0, abs=0.05) and free.count == 1
    limited = [effect_of("a", parameters=(SimpleNamespace(name="a", low=-1.0, high=2.5),))]
    assert fit_effects(cells, limited, [], frozenset("a"), ones, None).values["a"][0] == pytest.approx(2.5)


def test_effects_are_added_while_they_help_and_rivals_tried_in_their_places(linear):
    _, _, cells = of_linear(linear, {"a": 2.0, "b": -0.8})
    effects = [*(effect_of(name) for name in "abc"), effect_of("known one", known=True)]
    linear["known one"] = linear["a"]
    ones = np.ones(len(cells.cell))
    nominal = fit_effects(cells, effects, [], frozenset(), ones, None)
    fits, best = search_effects(cells, effects, [], ones, nominal, 0.0)
    assert best.names == {"a", "b"}
    names = [set(fit.names) for fit in fits]
    assert names[:4] == [set(), {"a"}, {"b"}, {"c"}] and {"a", "b", "c"} in names
    assert {"a", "c"} in names and {"b", "c"} in names
    assert len(names) == len({frozenset(each) for each in names}) and not any("known one" in n for n in names)
    # what an effect does to the signal, 0.8 times the size of its column, must be more than the accuracy
    size = 0.8 * float(np.sqrt(np.mean(linear["b"] ** 2)))
    assert search_effects(cells, effects, [], ones, nominal, 0.95 * size)[1].names == {"a", "b"}
    assert search_effects(cells, effects, [], ones, nominal, 1.05 * size)[1].names == {"a"}
    assert search_effects(cells, effects, [], ones, nominal, 99.0)[1].names == set()


def fit_of(names, cost, count=None, values=None):
    values = dict.fromkeys(names, (2.0,)) if values is None else values
    size = len(names) if count is None else count
    return ChannelFit(frozenset(names), values, dict.fromkeys(values, (0.5,)), cost, size, np.zeros(100))


def test_a_causes_probability_is_that_of_the_sets_that_have_it():
    effects = [effect_of(name, neutral=(7.0,)) for name in "abc"]
    fits = [fit_of("", 60.0), fit_of("a", 20.0), fit_of("b", 22.0), fit_of("c", 300.0)]
    weights = {fit.names: math.exp(log_evidence(fit)) for fit in fits}
    (found,) = _causes(fits, fits[1], effects, fit_of("", 60.0, values={}))
    assert found.probability == pytest.approx(weights[frozenset("a")] / sum(weights.values()))
    assert found.alternatives == pytest.approx({"b": 1.0 / (1.0 + math.e)}, rel=1e-6)
    assert (found.name, found.meaning, found.nominal, found.term.values) == ("a", "a!", (7.0,), (2.0,))
    own = _causes(fits, fits[1], effects, fit_of("", 60.0, values={"a": (1.5,)}))
    assert own[0].nominal == (1.5,) and _causes(fits, fits[0], effects, fits[0]) == ()


def test_a_cause_is_told_with_its_nominal_values_and_what_could_stand_in_its_place():
    term = ChannelTerm(RATE_ERROR, (12.345678, 0.5), (0.98765, 0.01))
    told = ChannelSignal("table_rate").not_seen("no table")
    assert (told.verdict, told.reason, told.unit) == ("not seen", "no table", "deg/s")
    cause = Cause("table_rate_error", "It turns fast.", 0.9, term, {}, nominal=(1.0, 0.0))
    assert told.told(cause) == (
        "It turns fast. error_ppm = 12.35 ± 0.99 (nominal 1), offset_mdps = 0.5 ± 0.01 (nominal 0)."
    )
    rivals = replace(cause, alternatives={"table_rate_ripple_once": 0.254})
    assert told.told(rivals).endswith(
        " In its place could stand table rate ripple once 25 %: they do the same in these runs."
    )


def test_terms_keep_the_deviations_that_were_fitted_or_else_their_own():
    before = ChannelTerm(RATE_ERROR, (1.0, 2.0), (0.3, 0.4))
    values = {"table_rate_error": (5.0, 6.0)}
    fitted = ChannelFit(frozenset(), values, {"table_rate_error": (0.1, 0.0)}, 0.0, 0, np.zeros(1))
    assert _term(RATE_ERROR, fitted, before).sigmas == (0.1, 1e-12)
    assert _term(RATE_ERROR, replace(fitted, sigmas={}), before).sigmas == (0.3, 0.4)
    assert _term(RATE_ERROR, fitted, None).values == (5.0, 6.0)


def test_scatter_is_that_of_the_worst_run_beyond_what_is_usual():
    runs = [
        replace(turning(np.zeros(9)), scatter={"arrival_jitter": jitter, "late_frames": late})
        for jitter, late in ((0.3, 2e-4), (0.4, 1e-4), (0.1, 0.0))
    ]
    assert _scatter(runs, 0.2) == {"arrival_jitter": 0.4, "late_frames": 2e-4}
    assert _scatter(runs, 0.4) == {"late_frames": 2e-4}
    assert _scatter(runs[1:], 0.0) == {"arrival_jitter": 0.4}
    assert _scatter([replace(runs[0], scatter={"arrival_jitter": 0.05})], 0.0) == {}


def test_curves_have_five_hundred_points_from_the_first_to_the_last(linear):
    series, _, _ = of_linear(linear, {"a": 1.0})
    (found,) = _curves([series], [], fit_of("", 0.0, values={}), fit_of("a", 0.0, values={"a": (1.0,)}))
    assert found.time_s.tolist() == series.inputs.time_s.tolist() and found.run_id == "r"
    assert found.before == pytest.approx(series.values - 6.0)
    assert found.after == pytest.approx(series.values - 6.0 - linear["a"])


def test_a_channels_shrinkage_is_what_is_gone_above_the_floor_on_held_out_runs(linear):
    """Of 2 the fit takes 1.5 away: a sixteenth of the energy stays. Diagnosed runs only widen the interval."""
    held, floor, cells = of_linear(linear, {"a": 2.0}, noise=0.05)
    nominal, best = fit_of("", 0.0, values={}), fit_of("a", 0.0, values={"a": (1.5,)})
    found = judge_channel([held], [], [], floor, nominal, best)
    names = {(place.part, place.band) for place in channel_places(cells, cells.whitened([held.values - 6.0]))
             if place.clear}  # fmt: skip
    on = np.array([(phase, band_name(band)) in names for phase, band in cells.names])[cells.cell]
    energies = []
    for size in (0.0, 1.5):
        rows = dct(held.values - 6.0 - size * linear["a"], norm="ortho")
        energies.append(float((rows**2 - 0.05**2)[on].sum()))
    assert found.share == pytest.approx(1.0 - energies[1] / energies[0]) and 0.9 < found.share < 0.95
    assert (found.rms_before, found.rms_after) == pytest.approx(
        (math.sqrt(energies[0] / 400), math.sqrt(energies[1] / 400))
    )
    assert found.low == pytest.approx(2.0 * found.share - found.high, abs=1e-9)
    narrow = found.high - found.share
    others = [of_linear(linear, {"a": size}, noise=0.05, seed=7)[0] for size in (1.5, 3.0)]
    wide = judge_channel([held], others, [], floor, nominal, best)
    assert wide.share == pytest.approx(found.share)
    shares = [judge_channel([each], [], [], floor, nominal, best).share for each in (held, *others)]
    factor = float(student.ppf(0.975, 2)) * float(np.std(shares, ddof=1))
    assert wide.share - wide.low == pytest.approx(math.hypot(narrow, factor), rel=0.02)
    assert wide.high == pytest.approx(min(2 * wide.share - wide.low, 1.0))
    still = judge_channel([of_linear(linear, {}, noise=0.05)[0]], [], [], floor, nominal, best)
    assert math.isnan(still.share) and math.isnan(still.low) and (still.rms_before, still.rms_after) == (0, 0)


def test_the_variance_of_what_is_left_is_that_of_squares_of_noise(linear):
    """Energy E above m coefficients of noise of power p scatters by 2 m p^2 + 4 E p."""
    held, floor, cells = of_linear(linear, {"a": 2.0}, noise=0.05)
    fits = fit_of("", 0.0, values={}), fit_of("a", 0.0, values={"a": (1.0,)})
    clear = {(phase, band_name(band)) for phase, band in cells.names}
    before, after, variance = _channel_shrinkage._energies(held, [], floor, *fits, clear)
    assert before == pytest.approx(float(((held.values - 6.0) ** 2).sum()) - 400 * 0.0025)
    left = dct(held.values - 6.0 - linear["a"], norm="ortho") ** 2 - 0.0025
    own = np.maximum(cells.sums(left), 0.0).sum()
    assert after == pytest.approx(float(left.sum()))
    assert variance == pytest.approx(2.0 * 400 * 0.0025**2 + 4.0 * own * 0.0025)
    one = {("turn", "8..32 s")}
    assert _channel_shrinkage._energies(held, [], floor, *fits, one)[0] < before


def test_a_place_is_told_by_its_phase():
    place = Place("", "turn", "8..32 s", 1.0, 0.5, 3.0, 0.0099)
    assert place.clear and not replace(place, p_value=0.01).clear
