"""Cells, closing, learning's rows, logs and rehearsals, positions and words of the diagnosis, by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.fft import dct

from bench.analysis.gap import (
    Diagnosis,
    Model,
    Noise,
    Term,
    _exam_folder,
    _fmu,
    _grams,
    _suggest,
    closed_model,
)
from bench.analysis.gap._aliases import RowLine, in_rows
from bench.analysis.gap._align import aligned
from bench.analysis.gap._cells import (
    BANDS,
    Cell,
    cells_in,
    group_cells,
    mixing,
    repeatable_rows,
    rescaled,
    run_rows,
    whitened_rows,
)
from bench.analysis.gap._close import _jackknife, _rms, _shares_by, holding
from bench.analysis.gap._data import Group
from bench.analysis.gap._describe import UnknownPart
from bench.analysis.gap._designs import Design, designs_for
from bench.analysis.gap._exam import true_region
from bench.analysis.gap._examination import SHARES, case_kinds
from bench.analysis.gap._facts import _finite
from bench.analysis.gap._findings import Cause, Finding
from bench.analysis.gap._fit import Floor, weighted_gram
from bench.analysis.gap._model_file import ChannelTerm, model_text, parse_model
from bench.analysis.gap._noise import fit_noise, periodogram, spectrum
from bench.analysis.gap._prepare import Prepared, narrowed
from bench.analysis.gap._rehearsal import _channel_log_gaps
from bench.analysis.gap._score import Marked
from bench.analysis.gap._stack import stacked
from bench.analysis.gap._stochastic import REPEATS, NoiseVerdict, floor_data
from bench.analysis.gap._suggest import Suggestion, _open_questions, suggest
from bench.analysis.gap._where import holm, in_time, places
from bench.record.benchfile import load_bench_file
from drivers.base.errors import ConfigurationError
from simulators.effects import ChannelEffect, catalogue
from tests.analysis.gap.conftest import effect, made_run, stimulus
from tests.analysis.gap.test_gap_by_hand import air
from tests.analysis.gap.test_gap_edges import lines, mark
from tests.safety.test_takeover import DEMO

WHITE = Noise(0.004)
N = 1000
EXACT = Floor(np.ones(len(BANDS)), np.zeros(len(BANDS)), from_repeats=True)


def group_of(conditions, repeats, seed=1, period_s=1.0):
    rng = np.random.default_rng(seed)
    runs = []
    for condition in conditions:
        s = replace(stimulus(N, rate_dps=float(condition)), period_s=period_s)
        runs.append(tuple(made_run(f"{condition} {k}", s, rng, condition=condition) for k in range(repeats)))
    return Group("shock", tuple(conditions), tuple(runs))


@pytest.mark.parametrize("period_s", [1.0, 2.0, 0.25])
def test_rows_of_runs_have_the_products_of_their_cells(period_s):
    """With any variance; those that repeats share are the first of each condition's contrasts."""
    group, rng = group_of(("+5", "-5"), 2, period_s=period_s), np.random.default_rng(2)
    columns = {run.run_id: rng.normal(size=(2, N)) for run in group.flat}
    stack = stacked(
        group.flat, lambda run: [run.output_dph[None], columns[run.run_id]], [False, False], WHITE
    )
    cells = group_cells(group, stack, WHITE)
    assert len(cells) == cells_in(group) == 4 * len({each.band for each in cells})
    assert sum(each.count for each in cells[::4]) == N - 1
    whole = stack.chosen(range(3))
    names, same, mix = mixing(group)
    assert names == ["common", "odd in rate"] * 2 and same == [True, True, False, False]
    scaled = np.tensordot(mix, whole, axes=1) / 0.24 * math.sqrt(period_s)
    total = sum(each.products(np.arange(3)) for each in cells)
    assert total == pytest.approx(np.einsum("rik,rjk->ij", scaled, scaled), rel=1e-5)
    for parity in range(4):
        own = sum(each.products(np.arange(3)) for each in cells[parity::4])
        assert own == pytest.approx(scaled[parity] @ scaled[parity].T, rel=1e-5)
    variance = np.linspace(1.0, 5.0, len(cells))
    rows = whitened_rows(group, stack, WHITE, variance)(whole)
    weighted = sum(each.products(np.arange(3)) / v for each, v in zip(cells, variance, strict=True))
    assert rows.shape == (3, 4 * (N - 1)) and rows @ rows.T == pytest.approx(weighted, rel=1e-5)
    floor = np.linspace(1.0, 3.0, len(BANDS))
    shared = repeatable_rows(group, WHITE, WHITE, floor)(whole)
    raised = rescaled(cells, floor)
    of_band = floor[[each.band for each in cells]]
    assert weighted_gram(raised, variance) == pytest.approx(weighted_gram(cells, variance * of_band))
    twice = rescaled(raised, floor)[3].products(np.arange(3))
    assert twice == pytest.approx(cells[3].products(np.arange(3)) / of_band[3] ** 2)
    expected = sum(each.products(np.arange(3)) for each in raised if each.repeatable)
    assert shared.shape == (3, 2, N - 1)
    assert np.einsum("irk,jrk->ij", shared, shared) == pytest.approx(expected, rel=1e-5)
    assert repeatable_rows(group, WHITE, WHITE, floor)(whole[:, :, :40]) == pytest.approx(shared[:, :, :40])
    alone = run_rows(group, WHITE, WHITE, floor)(whole)
    assert np.einsum("irk,jrk->ij", alone, alone) == pytest.approx(
        sum(each.products(np.arange(3)) for each in raised), rel=1e-5
    )
    assert raised[5].power == pytest.approx(0.24**2 / period_s * floor[raised[5].band])
    uneven = Group("shock", ("+5", "-5"), (group.runs[0], group.runs[1][:1]))
    assert mixing(uneven)[0] == ["+5 0", "+5 1", "-5 0"] and mixing(uneven)[2].tolist() == np.eye(3).tolist()


def test_differences_of_repeats_are_noise_and_quiet_runs_are_where_there_are_none():
    group = group_of(("0",), 3)
    stack = stacked(group.flat, lambda run: [run.output_dph[None]], [False], WHITE).full
    (found,), source = floor_data([group], [stack], WHITE, np.zeros(0))
    assert source == REPEATS and found.count.sum() == 2 * (N - 1)
    total = float(found.energy.sum()) / found.count.sum()
    assert total == pytest.approx(0.24**2, rel=0.1)
    both = np.stack([dct(run.output_dph, norm="ortho")[1:] for run in group.flat])
    apart = both - both.mean(axis=0)
    assert found.energy.sum() == pytest.approx(float((apart**2).sum()), rel=1e-5)
    still = made_run("still", stimulus(N, cold=False), np.random.default_rng(3))
    warm = replace(still, stimulus=replace(still.stimulus, t_in_c=25.0 + 2.1 * (np.arange(N) > 500)))
    turned = replace(still, stimulus=stimulus(N, rate_dps=0.011, cold=False))
    turned = replace(
        turned, stimulus=replace(turned.stimulus, angle_deg=np.cumsum(np.arange(N + 1) > 500) * 0.011)
    )
    for run, count in ((still, N - 5), (warm, 0), (turned, 0)):
        one = Group("p", ("0",), ((run,),))
        rows = stacked([run], lambda run: [run.output_dph[None]], [False], WHITE).full
        spectra, source = floor_data([one], [rows], WHITE, np.zeros(0))
        assert (source, sum(each.count.sum() for each in spectra)) == (
            "quiet runs" if count else "data sheet",
            count,
        )


def test_a_fit_of_noise_is_at_the_top_of_its_posterior():
    """The cost by hand, of bins of a spectrum with prior widths; no step of a coefficient lowers it."""
    rows = np.random.default_rng(4).normal(0.0, 0.3, (2, 4000)) + np.linspace(0, 1, 4000)
    data = [
        periodogram(dct(rows, norm="ortho", axis=1), 1.0),
        periodogram(dct(rows[:1, :3000], norm="ortho"), 2.0),
    ]
    sheet = Noise(0.004, 0.05, 0.1)
    widths = {"arw_deg_per_sqrt_h": 0.07, "bias_instability_dph": 0.25}
    found = fit_noise(data, sheet, widths)

    def cost(noise):
        value = 0.0
        for part in data:
            power = spectrum(noise, part.frequency, part.period_s)
            value += 0.5 * float((part.count * np.log(power) + part.energy / power).sum())
        for name, width in widths.items():
            value += 0.5 * (math.log(getattr(noise, name) / getattr(sheet, name)) / width) ** 2
        return value

    assert found.cost == pytest.approx(cost(found.noise), rel=1e-9)
    for name in widths:
        for factor in (0.99, 1.01):
            assert cost(replace(found.noise, **{name: factor * getattr(found.noise, name)})) > found.cost
    assert found.noise.rate_random_walk_dph_per_sqrt_h == 0.1
    rising = periodogram(np.arange(1.0, 41.0)[None], 1.0, skip=3)
    assert rising.count.sum() == 37 and rising.energy.sum() == pytest.approx(sum(k * k for k in range(4, 41)))
    half = periodogram(np.arange(1.0, 41.0)[None], 1.0, np.full(39, 0.5))
    assert half.count.sum() == 19.5 and (half.frequency * half.count).sum() == pytest.approx(
        sum(range(1, 40)) / 80
    )


def cell(energy, count=50.0, band=3, profile="p", parity="run", same=True, power=4.0):
    return Cell(profile, parity, same, band, count, 1, np.arange(1), np.array([[energy]]), power, 500)


def test_places_are_cells_that_repeats_share_clear_ones_first_by_size():
    cells = [cell(500.0), cell(60.0, band=4), cell(900.0, same=False), cell(2000.0, 1000.0, band=5, power=1.0),
             cell(45.0, band=6)]  # fmt: skip
    left = np.array([each.products(np.zeros(1, np.int64))[0, 0] for each in cells])
    found = places(cells, left, EXACT)
    assert [place.band for place in found] == [BANDS[k] for k in (5, 3, 4, 6)]
    assert [place.share for place in found] == pytest.approx([1000 / 1450, 450 / 1450, 0.0, 0.0])
    assert found[1].rms == pytest.approx(math.sqrt(450.0 * 4.0 / 500)) and found[1].energy_ratio == 10.0
    assert found[3].rms == 0.0 and found[0].rms == pytest.approx(math.sqrt(1000.0 / 500))
    assert {place.start_s for place in found} == {0.0}  # cells are of whole runs
    unsure = replace(EXACT, sigma=np.full(len(BANDS), 1.0))
    assert [place.clear for place in places(cells, left, unsure)] == [True, False, False, False]
    assert holm(np.array([0.01, 0.4, 0.02])).tolist() == pytest.approx([0.03, 0.4, 0.04])
    rng = np.random.default_rng(1)
    rows = rng.normal(size=(2, 99))
    parts = [in_time(rows, slice(0, 40)), in_time(rows, slice(40, 99))]
    assert [own.sum() for own in parts] == pytest.approx(
        [(rows[:, :40] ** 2).sum(), (rows[:, 40:] ** 2).sum()]
    )
    assert in_time(rows, slice(0, 99)).shape == (100,)


def test_shares_of_parts_and_what_profiles_differ_by():
    """Leaving out one of three profiles leaves shares of 50/70, 30/50 and 40/60: a jackknife's deviation."""
    gone, left = np.array([20.0, 40.0, 30.0 - 20.0]), np.array([10.0, 10.0, 10.0])
    profiles = np.array(["a", "b", "c"])
    shares = [50 / 70, 30 / 50, 60 / 80]
    expected = math.sqrt(2.0 * float(np.var(shares)))
    assert _jackknife(gone, left, profiles) == pytest.approx(expected)
    assert _jackknife(gone, left, np.array(["a"] * 3)) == 0.0 == _jackknife(gone[:0], left[:0], profiles[:0])
    active = np.array([True, True, True, False])
    first, then = np.array([110.0, 90.0, 50.0, 900.0]), np.array([60.0, 40.0, 50.0, 0.0])
    found = _shares_by(["a", "b", "c", "a"], active, first, then, np.full(4, 50.0))
    # nothing is left in `b` below the noise; in `c` there is no gap
    assert found == pytest.approx({"a": 50 / 60, "b": 1.0, "c": math.nan}, nan_ok=True)
    cells = [
        cell(0.0),
        cell(0.0, band=4),
        cell(0.0, profile="q", power=1.0),
        cell(0.0, profile="q", same=False),
    ]
    rms = _rms(cells, np.array([60.0, 30.0, 70.0, 99.0]), np.array([True, True, True, False]))
    assert rms == pytest.approx(math.sqrt((10 * 4.0 + 20 * 1.0) / 1500))


def term_of(name, *values):
    variant = effect(name).variants()[0]
    return Term(variant, values, (0.1,) * len(values))


@pytest.mark.parametrize("part", [1.0, 0.75, 0.0])
def test_of_what_a_term_adds_held_out_runs_show_a_part(part):
    """Runs with a part of a warm-up of 30 deg/h, beside a slope that both models have."""
    s, rng = stimulus(2000), np.random.default_rng(1)
    slope, warm, none = term_of("bias_linear", 5.0), term_of("warm_up", 30.0), term_of("warm_up", 1e-4)
    extra = 5.0 * slope.variant.columns(s)[0] + part * 30.0 * warm.variant.columns(s)[0]
    runs = [made_run(name, s, rng, extra) for name in "ab"]
    closed = Model("m", (slope, warm), WHITE)
    others = [Model("m", (slope,), WHITE), Model("m", (slope, warm, none), WHITE)]
    found = holding(closed, others, runs, EXACT)
    assert found[0] == pytest.approx(part, abs=0.03) and math.isnan(found[1])


def test_the_true_region_is_the_strongest_cells_with_four_fifths_of_the_energy():
    waves = {"75..150 s": 3.0, "20..38 s": 2.0, "5..10 s": 1.0}
    periods = {"75..150 s": 100.0, "20..38 s": 25.0, "5..10 s": 6.25}
    n = 2000
    at = np.arange(n) + 0.5
    output = sum(size * np.cos(2.0 * math.pi * at / periods[band]) for band, size in waves.items())
    run = replace(made_run("r", stimulus(n, cold=False), np.random.default_rng(1)), output_dph=output)
    model = Model("m", (), WHITE)
    assert true_region([run], model) == (("shock", "run", "75..150 s"), ("shock", "run", "20..38 s"))
    # nine of fourteen is less than four fifths, nine of ten and a quarter is more
    weak = replace(run, output_dph=3.0 * np.cos(2.0 * math.pi * at / 100.0) + 0.5 * output)
    assert true_region([weak], model) == (("shock", "run", "75..150 s"),)
    assert true_region([replace(run, output_dph=np.zeros(n))], model) == ()


@pytest.mark.parametrize("cases", [1, 40, 100, 333])
def test_an_exam_has_its_kinds_in_their_shares_the_rest_null(cases):
    found = case_kinds(cases, 5)
    assert len(found) == cases and case_kinds(cases, 5) == found
    for kind, share in SHARES.items():
        assert found.count(kind) == pytest.approx(share * cases, abs=0.51 if kind != "null" else 3.0)
    assert cases < 100 or (case_kinds(cases, 6) != found and found[:9] != sorted(found[:9]))
    assert sum(SHARES.values()) == pytest.approx(1.0)


def test_an_exams_folder_has_its_plan_and_a_line_for_every_case_marked(monkeypatch, tmp_path):
    marked = [mark(), mark(snr=9.0, unknown=0.8)]
    steps = [("0 a", None), ("1 b", None), ("0 a", marked[0]), ("1 b", marked[1])]
    monkeypatch.setattr(_exam_folder, "examine", lambda cases, seed, folder, fan: iter(steps[: 2 * cases]))
    folder = tmp_path / "a" / "b"
    assert list(_exam_folder.hold_exam(2, 7, folder)) == steps
    found = _exam_folder.read_exam(folder)
    assert (found.seed, found.cases, found.marked) == (7, 2, tuple(marked))
    with pytest.raises(ConfigurationError, match="holds an exam already"):
        list(_exam_folder.hold_exam(2, 7, folder))
    assert len(list(_exam_folder.hold_exam(1, 0, tmp_path / "d"))) == 2
    for cases, seed in ((0, 1), (1, -1)):
        with pytest.raises(ConfigurationError, match="needs cases"):
            list(_exam_folder.hold_exam(cases, seed, tmp_path / "c"))
    with pytest.raises(ConfigurationError, match="no exam's results"):
        _exam_folder.read_exam(tmp_path)


def test_of_stochastic_cases_those_are_right_that_name_nothing_else():
    """And of cases with a known and an unknown effect those that report both."""
    noise = {"effects": (), "stochastic": "noise_level", "snr": 0.0, "causes": {}}
    named = ("noise_level",)
    found = lines(
        mark("stochastic", **noise, stochastic_named=named),
        mark("stochastic", **noise | {"causes": {"shupe": 0.9}}, stochastic_named=named),
        mark("stochastic", **noise, stochastic_named=named, unknown=0.6),
        mark("stochastic", **noise, stochastic_named=(*named, "quantisation")),
        mark("stochastic", **noise), mark("stochastic", **noise, stochastic_named=named),
        mark("known and unknown", 5.0, ("shupe", "strange"), unknown=0.6),
        mark("known and unknown", 5.0, ("shupe", "strange"), unknown=0.4),
        mark("known and unknown", 5.0, ("shupe", "strange"), {"warm_up": 0.9}, unknown=0.6),
        mark("null", 0.0, (), {}), mark("null", 0.0, (), {}, stochastic_named=named),
        mark("null", 0.0, (), {}, unknown=0.6), mark("null", 0.0, (), {"shupe": 0.9}),
        mark("unknown", 20.0, ("strange",), {}, unknown=0.6), mark("unknown", 20.0, ("strange",)),
    )  # fmt: skip
    by_kind = {
        what.split(":")[0]: hits
        for (what, _), hits in found.items()
        if what.split(":")[0] in ("stochastic", "null", "known and unknown")
    }
    assert by_kind == {"stochastic": (2, 6), "null": (3, 4), "known and unknown": (1, 3)}
    outside = {what: hits for (what, _), hits in found.items() if what.startswith("outside")}
    assert outside == {
        "outside the catalogue: called unknown": (1, 2), "outside the catalogue: a false cause named": (1, 2),
    }  # fmt: skip


def test_an_exams_line_is_read_as_it_was_written():
    one = mark(alternatives={"shupe": {"warm_up": 0.2}}, stochastic_named=("noise_level",), unknown=0.7)
    assert Marked.from_line(one.line) == one
    assert one.in_set and one.first and not one.foreign and one.known == one.named == {"shupe"}
    other = mark(effects=("warm_up", "strange"), alternatives={"shupe": {"warm_up": 0.2}})
    assert other.in_set and not other.first and other.foreign and other.claims == [(0.9, False), (0.1, True)]
    for text in ("{}", "[1]", '{"effects": 1}', one.line.replace('"seed"', '"sed"')):
        with pytest.raises(ConfigurationError, match="no exam case"):
            Marked.from_line(text)


def test_a_line_in_means_may_be_an_alias_or_is_where_the_rows_have_it():
    line = RowLine(0.2, 2.0, math.nan, math.nan)
    assert line.sentence == (
        "the line at 0.2 Hz in means of 2 s may be an alias: its cause may lie off by multiples of 0.5 Hz"
    )
    near, far = replace(line, frequency_hz=0.2004, amplitude_dph=3.21987), replace(line, frequency_hz=0.3)
    assert near.sentence == "the line at 0.2 Hz in means of 2 s is at 0.2004 Hz in the log's rows, 3.22 deg/h"
    assert "is an alias: it is at 0.3 Hz" in far.sentence
    rate, n = 20.0, 30_000
    wave = 9.0 * np.sin(2 * np.pi * 0.186 * np.arange(n) / rate) + np.random.default_rng(1).normal(size=n)
    wave[::7] = np.nan
    run = replace(
        made_run("r", stimulus(1500, cold=False), np.random.default_rng(1)),
        rows_dps=wave / 3600.0,
        row_s=0.05,
    )
    assert in_rows(0.186, [run]).frequency_hz == pytest.approx(0.186, abs=1e-6)
    short = replace(run, rows_dps=np.zeros(2000) + 1e-5 * np.random.default_rng(2).normal(size=2000))
    assert in_rows(0.186, [short, run, short]).amplitude_dph == pytest.approx(9.0, rel=0.05)
    for none in (replace(run, row_s=0.5), replace(run, rows_dps=None), short):
        assert math.isnan(in_rows(0.186, [none]).frequency_hz)


def test_a_clock_is_set_right_only_where_the_table_turns_unevenly_and_by_what_was_recorded():
    rate = np.where(np.arange(600) % 100 < 50, 4.0, -4.0)
    s = replace(stimulus(600, cold=False), angle_deg=np.concatenate(([0.0], np.cumsum(rate))))
    s = replace(s, edge_rate_dps=np.append(rate, rate[-1]))
    run = made_run("r", s, np.random.default_rng(1))
    late = replace(run, output_dph=np.roll(run.output_dph, 2))
    (found,), notes = aligned([late])
    assert found.stimulus.angle_deg[2:].tolist() == s.angle_deg[:-2].tolist() and len(notes) == 1
    assert found.stimulus.edge_rate_dps[2:].tolist() == s.edge_rate_dps[:-2].tolist()
    assert found.stimulus.angle_deg[:2].tolist() == [0.0, 0.0]
    # without the steps of the rate, and five samples on either side, nothing says how late it is
    steps = np.flatnonzero(np.diff(rate))
    near = np.abs(np.arange(600)[:, None] - steps).min(axis=1)
    for reach, set_right in ((7, False), (1, True)):
        output = np.where(near <= reach, np.nan, late.output_dph)
        output[380:420] = late.output_dph[380:420] if reach == 1 else np.nan
        assert bool(aligned([replace(late, output_dph=output)])[1]) is set_right
    slow = replace(s, angle_deg=s.angle_deg * 0.4 / 8.0, edge_rate_dps=None)
    sluggish = replace(
        made_run("r", slow, np.random.default_rng(1)), output_dph=np.roll(slow.input_rate_dph, 2)
    )
    assert aligned([sluggish]) == ([sluggish], [])
    faster = replace(slow, angle_deg=s.angle_deg * 0.6 / 8.0)
    quick = replace(sluggish, stimulus=faster, output_dph=np.roll(faster.input_rate_dph, 2))
    assert len(aligned([quick])[1]) == 1


@pytest.mark.parametrize("late", [-3, 3, 5])
def test_what_the_table_did_where_samples_are_missing_says_nothing_of_a_clock(late):
    rate = np.where(np.arange(800) % 100 < 50, 4.0, -4.0)
    output = np.roll(3600.0 * rate, late) + np.random.default_rng(1).normal(0.0, 0.2, 800)
    for start in (120, 333, 690):
        rate[start : start + 4] = 3000.0
        output[start : start + 4] = np.nan
    s = replace(stimulus(800, cold=False), angle_deg=np.concatenate(([0.0], np.cumsum(rate))))
    _, notes = aligned([replace(made_run("r", s, np.random.default_rng(1)), output_dph=output)])
    assert len(notes) == 1 and f"{abs(late)} s {'late' if late > 0 else 'early'} against" in notes[0]


def test_products_are_made_on_the_device_that_there_is(monkeypatch):
    rows = np.random.default_rng(1).normal(size=(2, 3, 7))
    monkeypatch.setattr(_grams, "compute_device", lambda: "another")
    monkeypatch.setattr(_grams, "with_torch", lambda own, device: (own.shape, device))
    assert _grams.gram_blocks(rows) == ((2, 3, 7), "another")
    own = _grams.gram_blocks(rows, "cpu")
    assert np.stack(own) == pytest.approx(np.einsum("rik,rjk->rij", rows, rows))


class Fmpy:
    """An FMU of one output: twice its input and a start value; for co-simulation its input is held for a step."""

    def __init__(self, together):
        self.together = together

    def read_model_description(self, file):
        names = [SimpleNamespace(name=name) for name in ("in", "out", "bias")]
        return SimpleNamespace(modelVariables=names, coSimulation=1 if self.together else None)

    def simulate_fmu(self, file, *, stop_time, output_interval, start_values, **given):
        if start_values["bias"] < 0.0:
            raise ValueError("a library fails")
        kind = "CoSimulation" if self.together else "ModelExchange"
        assert (given["start_time"], given["output"], given["fmi_type"]) == (0.0, ["out"], kind)
        signals = given["input"]
        time_s = np.arange(round(stop_time / output_interval) + 1) * output_interval
        at_s = time_s - output_interval if self.together else time_s
        line = np.polyfit(signals["time"], signals["in"], 1)
        return {"time": time_s, "out": 2.0 * np.polyval(line, at_s) + start_values["bias"]}


@pytest.mark.parametrize("together", [True, False])
def test_an_fmus_output_is_the_mean_over_each_step(monkeypatch, together):
    """Of twice an input that rises by 3 a second, 5 s a step; the input's means are those at the middles."""
    monkeypatch.setattr(_fmu, "from_extra", lambda *_: Fmpy(together))
    means = 7.0 + 3.0 * 5.0 * (np.arange(6) + 0.5)
    found = _fmu.simulate_fmu(Path("x.fmu"), {"in": means}, "out", {"bias": 1.0}, 6, 5.0)
    assert found == pytest.approx(2.0 * means + 1.0)
    with pytest.raises(ConfigurationError) as refused:
        _fmu.simulate_fmu(Path("x.fmu"), {"on": means}, "out", {"b": 1.0}, 6, 5.0)
    assert refused.value.found == "on, b" and refused.value.expected == "bias, in, out"
    with pytest.raises(ConfigurationError, match="cannot be simulated"):
        _fmu.simulate_fmu(Path("x.fmu"), {"in": means}, "out", {"bias": -1.0}, 6, 5.0)


def test_an_effects_values_are_told_with_their_deviations_where_the_runs_bound_them():
    term = Term(effect("shupe").variants()[0], (0.123456, 2.0), (0.0123, 1e9))
    one, other = (parameter.name for parameter in effect("shupe").parameters)
    assert term.fitted(1.0, "+-") == f"{one} = 0.1235 +- 0.012, {other} not to be seen in these runs"
    low, high = effect("shupe").parameters[1].bounds(3.0)
    edge = replace(term, sigmas=(0.01, 0.99 * (high - low)))
    assert f"{other} = 2 +-" in edge.fitted(3.0, "+-") and "not to be seen" in edge.fitted(1.0, "+-")
    assert "not to be seen" in replace(term, sigmas=(0.01, high - low)).fitted(3.0, "+-")


def test_a_models_accuracy_is_of_channels_and_not_negative():
    head = "format = 1\n[noise]\narw_deg_per_sqrt_h = 0.01\n"
    model = parse_model(head + "[accuracy]\nchamber_air = 0.5\ntable_rate = 0.0\n", "m")
    assert model.accuracy == {"chamber_air": 0.5, "table_rate": 0.0}
    assert parse_model(model_text(model), "m").accuracy == model.accuracy
    with pytest.raises(ConfigurationError) as refused:
        parse_model(head + "[accuracy]\nchamber_air = -0.5\nair = 1.0\ntable_rate = 1.0\n", "m")
    assert refused.value.found == "air = 1.0, chamber_air = -0.5"
    with pytest.raises(ConfigurationError, match="not a model file of this version"):
        parse_model(head.replace("1", "2", 1), "m")
    for noise in (
        "arw_deg_per_sqrt_h = 0.0",
        "bias_instability_dph = 1.0",
        "arw_deg_per_sqrt_h = 0.1\nother = 1.0",
    ):
        with pytest.raises(ConfigurationError, match=r"\[noise\] cannot be used"):
            parse_model(f"format = 1\n[noise]\n{noise}\n", "m")
    named = next(p for p in effect("shupe").parameters)
    for value, sigma in ((named.high * 1.01, 0.1), (named.low * 1.01, 0.1), (0.0, 0.0)):
        rows = {p.name: 0.1 for p in effect("shupe").parameters}
        parts = [
            ", ".join(f"{k} = {v}" for k, v in (rows | {named.name: own}).items()) for own in (value, sigma)
        ]
        text = f'{head}[[effect]]\nname = "shupe"\nparameters = {{ {parts[0]} }}\nsigma = {{ {parts[1]} }}\n'
        with pytest.raises(ConfigurationError, match="out of bounds"):
            parse_model(text, "m")


def test_a_number_that_does_not_exist_is_null():
    facts = {"a": math.nan, "b": [1.0, math.inf, {"c": -math.inf}], "d": ("x", 2, None), "e": {"f": 0.0}}
    assert _finite(facts) == {"a": None, "b": [1.0, None, {"c": None}], "d": ["x", 2, None], "e": {"f": 0.0}}


def test_a_closed_model_has_the_terms_of_all_findings():
    offset, rate = catalogue()["temperature_sensor_offset"], catalogue()["table_rate_error"]
    assert isinstance(offset, ChannelEffect) and isinstance(rate, ChannelEffect)
    old, new = ChannelTerm(offset, (0.1,), (0.2,)), ChannelTerm(offset, (0.7,), (0.01,))
    other = ChannelTerm(rate, (1.0, 0.0), (1.0, 1.0))
    model = Model("m", (), WHITE, channel_terms=(old,))
    cause = Cause("table_rate_error", "", 0.9, other, {})
    findings = (
        Finding(signal="gyro_temperature", unit="K", verdict="no gap", terms=(new,)),
        Finding(signal="table_rate", unit="deg/s", verdict="explained", terms=(other,), causes=(cause,)),
    )
    found = Diagnosis("u", model, findings, {"r": "sum"})
    closed = closed_model(found)
    assert closed.channel_terms == (new, other) and closed.fitted_on == {"r": "sum"}
    assert closed.name == "m+table_rate_error" and found.verdict == "no gap"
    assert found.causes == (cause,) and found.closing == ("table_rate_error",)
    with pytest.raises(LookupError, match="no rate"):
        _ = found.rate
    assert found.position is None and found.channels == ()
    assert found.shown() == {
        "unit": "u", "model": "m", "runs": ["r"], "verdict": "no gap", "causes": ["table_rate_error"],
    }  # fmt: skip


def rate_of(**changes):
    fields = {"causes": (), "resembles": (), "unknown_parts": (), "learned": None, "latitude_deg": 39.1}
    return SimpleNamespace(**(fields | changes))


def test_open_are_rivals_curves_without_a_name_what_was_learned_or_else_the_sizes_of_causes():
    shupe, warm = term_of("shupe", 1.0, 2.0), term_of("warm_up", 3.0)
    cause = Cause("shupe", "", 0.9, shupe, {}, {"warm_up": warm})
    sure = Cause("warm_up", "", 0.9, warm, {})

    def asked(**changes):
        return [(text, list(one), list(other)) for text, one, other in _open_questions(rate_of(**changes))]

    assert asked(causes=(cause, sure)) == [("shupe or warm_up", [shupe], [warm])]
    assert asked(causes=(sure,)) == [("size of warm_up", [warm], [])]
    curve = UnknownPart("T_in", "", term=shupe)
    bare = UnknownPart("time", "")
    assert asked(unknown_parts=(curve, bare)) == [("free curve over T_in or nothing", [shupe], [])]
    assert asked(unknown_parts=(curve,), resembles=(sure, cause)) == [
        ("free curve over T_in or warm_up", [shupe], [warm])
    ]
    learned = SimpleNamespace(terms=(shupe, warm))
    assert asked(unknown_parts=(bare,), learned=learned) == [
        ("shupe and warm_up or nothing", [shupe, warm], [])
    ]
    assert asked(unknown_parts=(curve,), learned=learned) == [
        ("free curve over T_in or nothing", [shupe], [])
    ]
    assert asked(unknown_parts=(bare,), causes=(sure,)) == []


def test_procedures_are_suggested_by_log_odds_an_hour_up_to_three_hundred(monkeypatch):
    hours = {"slow": 10.0, "fast": 1.0, "long": 3.0, "blind": 0.1}
    odds = {"slow": 9000.0, "fast": 40.0, "long": 200.0, "blind": 0.9}
    designs = [SimpleNamespace(procedure=n, text=n, hours=h, settings={"a": h}) for n, h in hours.items()]
    monkeypatch.setattr(_suggest, "usual_designs", lambda latitude: designs)
    monkeypatch.setattr(_suggest, "_log_odds", lambda design, *_: odds[design.procedure])
    rate = rate_of(causes=(Cause("warm_up", "", 0.9, None, {}),))
    found = SimpleNamespace(model=None, rate=rate, of_rate=rate)
    # 300 of 10 h are 30, 40 of one 40, 200 of three 67; what decides nothing is left out
    assert [each.procedure for each in suggest(found)] == ["long", "fast", "slow"]
    assert suggest(found, 1) == [Suggestion("long", "long", 3.0, 200.0, "size of warm_up", {"a": 3.0})]
    assert suggest(SimpleNamespace(of_rate=None)) == []


@pytest.mark.parametrize("period_s", [1.0, 2.0, 0.25])
def test_log_odds_are_half_the_square_of_what_tells_two_signals_apart(period_s):
    """A warm-up of 3 deg/h against one of 2, and against nothing, of which a quarter may be misfit."""
    s = replace(stimulus(2000), period_s=period_s)
    design = Design("", {}, "t", {"a": s, "b": replace(s, angle_deg=s.angle_deg + 1.0)})
    model = Model("m", (), WHITE)
    three, two = term_of("warm_up", 3.0), term_of("warm_up", 2.0)
    row = dct(three.variant.columns(s)[0], norm="ortho")[1:] / 0.24 * math.sqrt(period_s)
    edges = [
        math.floor(4000.0 * period_s / each)
        for each in (3500.0, 1400.0, 560.0, 300.0, 150.0, 75.0, 38.0, 20.0, 10.0, 5.0)
    ]
    bands = np.split(row, [*edges])
    for other, size in (((two,), 1.0), ((), 3.0)):
        expected = 0.0
        for band in bands:
            energy = float((band**2).sum())
            expected += 0.5 * size**2 * energy / (1.0 + 9.0 * energy / 16.0 / max(len(band), 1))
        assert _suggest._log_odds(design, (three,), other, model) == pytest.approx(2.0 * expected, rel=1e-3)


def test_designs_are_for_the_axis_under_test():
    file = load_bench_file(DEMO)

    def up(axis):
        return {
            float(next(iter(each.stimuli.values())).elevation_deg[0])
            for each in designs_for(file, axis)
            if each.procedure == "constant-rotation"
        }

    assert (
        up("z") == {90.0}
        and up("x") == {0.0}
        and up(None) == (up("z") if file.gyro[0].axis == "z" else up("x"))
    )


def test_channels_of_rehearsals_are_compared_in_the_phases_that_all_have():
    levels = ((2.0, 40), (0.0, 60), (1.0, 50), (0.5, 50))
    logs = [[air(np.concatenate((np.full(30, 9.0 + off), np.full(n, off))), ["soak"] * 30 + ["shock"] * n)]
            for off, n in levels]  # fmt: skip
    (gap,) = _channel_log_gaps(logs)
    assert (gap.rms_nominal, gap.rms_closed, gap.rms_floor) == pytest.approx((2.0, 1.0, 0.5))
    assert gap.share == pytest.approx(1.0 - 0.75 / 3.75)
    assert _channel_log_gaps([*logs[:3], []]) == []
    other = [air(np.full(50, 0.5), ["hall"] * 50)]
    assert _channel_log_gaps([*logs[:3], other]) == []
    noisy = [*logs[:2], [air(np.full(70, 1.0), ["soak"] * 30 + ["shock"] * 40)], logs[0]]
    assert math.isnan(_channel_log_gaps([logs[0], logs[2], logs[3], logs[1]])[0].share) is False
    assert math.isnan(_channel_log_gaps([logs[3], logs[3], logs[3], noisy[3]])[0].share)


def test_kept_columns_come_first_and_fresh_ones_behind_them():
    group = group_of(("0",), 2)
    model = Model("m", (term_of("bias_linear", 0.0),), WHITE)
    variants = [effect(name).variants()[0] for name in ("shupe", "warm_up", "bias_ramp")]
    every = [model.terms[0].variant, *variants]
    stack = stacked(
        group.flat,
        lambda run: [run.output_dph[None], *(each.columns(run.stimulus) for each in every)],
        [False] * 5, WHITE,
    )  # fmt: skip
    data = Prepared((group,), (stack,), NoiseVerdict(WHITE, {"": 1.0}, REPEATS, {}, WHITE), (), EXACT)
    fresh = [effect("bias_quadratic").variants()[0]]
    few, kept = narrowed(data, model, variants, [2, 0], fresh)
    (own,), (bare,) = kept.stacks, narrowed(data, model, variants, [1], [])[1].stacks
    assert few == [variants[2], variants[0], *fresh]
    whole = stack.chosen(range(6))
    added = dct(fresh[0].columns(group.flat[0].stimulus), norm="ortho", axis=1)[:, 1:]
    assert own.chosen(range(5)).tolist() == whole[:, [0, 1, 5, 2, 3]].tolist()
    assert own.chosen([5])[0] == pytest.approx(added, abs=1e-3)
    assert bare.chosen(range(3)).tolist() == whole[:, [0, 1, 4]].tolist()
