"""Maps of where a gap lies, weighted products, learning beside a model's own parameters, and what foretells."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.fft import dct, idct
from scipy.stats import chi2
from statsmodels.stats.multitest import multipletests

from bench.analysis.gap import Model, Noise, Simulation, Term
from bench.analysis.gap._cells import BANDS, band_slices
from bench.analysis.gap._data import Group
from bench.analysis.gap._evidence import reduced
from bench.analysis.gap._fit import DIRECTIONS, Floor, Solution, floor_from_repeats, tolerated
from bench.analysis.gap._learn import _Fitted, _Problem
from bench.analysis.gap._lines import strongest_line
from bench.analysis.gap._model_file import parse_model
from bench.analysis.gap._prepare import gathered, noise_beside, prepare
from bench.analysis.gap._simulation import INPUTS, read_simulation
from bench.analysis.gap._stochastic import DATA_SHEET, REPEATS, judge_noise
from bench.analysis.gap._where import phase_map, regime_map
from bench.analysis.gap._which import _gram_of, judged_sets, left_of_runs, second_look
from drivers.base.errors import ConfigurationError
from tests.analysis.gap.conftest import effect, made_run, stimulus

WHITE = Noise(0.004)
N = 2000


def floor_of(ratio=1.0, sigma=0.0):
    return Floor(np.linspace(1.0, 2.0, len(BANDS)) * ratio, np.linspace(0.0, sigma, len(BANDS)), True)


def two_groups(period_s):
    """Two conditions of one profile of 2000 samples and another profile, 450 of a phase of it missing."""
    rng = np.random.default_rng(1)
    runs = [
        made_run(name, replace(stimulus(N, rate_dps=rate * period_s), period_s=period_s), rng, condition=name)
        for name, rate in (("+5", 5.0), ("-5", -5.0))
    ]
    other = made_run("ramp", replace(stimulus(N), period_s=period_s), rng, profile="ramp")
    other = replace(other, output_dph=np.where(np.arange(N) < 450, np.nan, other.output_dph))
    groups = [Group("shock", ("+5", "-5"), ((runs[0],), (runs[1],))), Group("ramp", ("0",), ((other,),))]
    return groups, [rng.normal(0.0, 2.2, (2, N - 1)), rng.normal(0.0, 1.3, (1, N - 1))]


@pytest.mark.parametrize("period_s", [1.0, 2.0, 0.25])
def test_a_map_of_phases_is_what_a_bands_inverse_transform_has_in_each(period_s):
    groups, residuals = two_groups(period_s)
    floor = floor_of(sigma=0.2)
    found = {
        (place.profile, place.part, place.band): place for place in phase_map(groups, residuals, floor, WHITE)
    }
    rows, p_raw = [], []
    for group, own in zip(groups, residuals, strict=True):
        run = group.runs[0][0]
        for band, part in enumerate(band_slices(N, period_s)):
            if part.start == part.stop:
                continue
            only = np.zeros((len(own), N))
            only[:, 1 + part.start : 1 + part.stop] = own[:, part]
            energy = (idct(only, norm="ortho", axis=1) ** 2).sum(axis=0) / floor.ratio[band]
            for phase in ("room", "shock"):
                at = (run.phase == phase) & ~np.isnan(run.output_dph)
                expected = len(own) * (part.stop - part.start) / N * at.sum()
                seen = energy[at].sum() / (1.0 + 2.0 * floor.sigma[band])
                excess = max(seen - expected, 0.0)
                power = 0.24**2 / period_s * floor.ratio[band]
                rms, start_s = math.sqrt(excess * power / (len(own) * at.sum())), period_s * np.argmax(at)
                rows.append(((group.profile, phase, BANDS[band]), excess, rms, seen / expected, start_s))
                p_raw.append(chi2.sf(seen, max(expected, 1.0)))
    p_values = multipletests(p_raw, method="holm")[1]
    shares = np.array([row[1] for row in rows]) * (p_values < 0.01)
    for (key, _, rms, ratio, start_s), p_value, share in zip(
        rows, p_values, shares / shares.sum(), strict=True
    ):
        place = found[key]
        assert (place.rms, place.energy_ratio, place.start_s) == pytest.approx((rms, ratio, start_s))
        assert (place.p_value, place.share) == pytest.approx((p_value, share), abs=1e-12)
    assert len(found) == len(rows) and any(place.clear for place in found.values())
    assert [place.share for place in found.values()] == sorted(
        (p.share for p in found.values()), reverse=True
    )


@pytest.mark.parametrize("period_s", [1.0, 2.0, 0.25])
def test_a_map_of_regimes_gathers_the_bands_with_a_gap_by_intervals_of_an_input(period_s):
    groups, residuals = two_groups(period_s)
    floor, bands = floor_of(sigma=0.2), {"shock": {5, 9}, "ramp": {10}}
    found = {(place.of, place.low): place for place in regime_map(groups, residuals, floor, WHITE, bands)}
    slices = band_slices(N, period_s)
    sums = np.zeros((4, 3))
    edges = (-7.0, -0.5, 0.5, 7.0)  # of the table's rate
    for group, residual in zip(groups, residuals, strict=True):
        for run, own in zip(group.flat, residual, strict=True):
            kept = ~np.isnan(run.output_dph)
            row = np.searchsorted(edges, run.stimulus.table_rate_dps, side="right") - 1
            for band in bands[group.profile]:
                part = slices[band]
                only = np.zeros(N)
                only[1 + part.start : 1 + part.stop] = own[part]
                energy = idct(only, norm="ortho") ** 2 / floor.ratio[band] / (1.0 + 2.0 * floor.sigma[band])
                expected = (part.stop - part.start) / N
                for k in range(3):
                    at = kept & (row == k)
                    sums[:3, k] += (
                        energy[at].sum(),
                        expected * at.sum(),
                        (energy[at] - expected).sum() * 0.24**2 / period_s * floor.ratio[band],
                    )
            sums[3] += [(kept & (row == k)).sum() for k in range(3)]
    gap = np.maximum(sums[0] - sums[1], 0.0)
    for k, low in enumerate(edges[:-1]):
        place = found["table rate", low]
        assert (place.high, place.unit) == (edges[k + 1], "deg/s")
        assert place.energy_ratio == pytest.approx(sums[0, k] / sums[1, k])
        assert place.share == pytest.approx(gap[k] / gap.sum())
        assert place.rms_dph == pytest.approx(math.sqrt(max(sums[2, k], 0.0) / sums[3, k]))
        assert place.p_value == pytest.approx(min(chi2.sf(sums[0, k], sums[1, k]) * 9 * 5, 1.0))
    assert {low for of, low in found if of == "table rate"} == set(edges[:-1])
    coldest = min(low for of, low in found if of == "T_in")
    assert coldest == 10.0 * math.floor((groups[0].flat[0].stimulus.warm_k.min() + 25.0) / 10.0)


@pytest.fixture(scope="module")
def searched():
    """A warm-up in two repeats, with few candidates and a slope as model."""
    rng = np.random.default_rng(4)
    s = stimulus(N)
    variants = [each for name in ("bias_quadratic", "warm_up", "shupe") for each in effect(name).variants()]
    extra = 4.0 * np.exp(-s.time_s / 450.0)
    runs = [made_run(name, s, rng, extra) for name in "ab"]
    slope = Term(effect("bias_linear").variants()[0], (0.0,), (0.5,))
    model = Model("m", (slope,), WHITE)
    data = prepare(runs, model, variants)
    return judged_sets(data, model, variants), model, variants, runs


def test_products_of_any_variants_are_weighted_as_those_of_the_search(searched):
    """Sum and difference of the two repeats, band by band over noise and what formulas may miss."""
    found, model, variants, runs = searched
    data = found.data
    variance = tolerated(data.cells, found.before, directions=DIRECTIONS)
    fixed = data.stacks[0].chosen(range(2))
    columns = np.concatenate([each.columns(runs[0].stimulus) for each in variants])
    rows = np.concatenate((fixed, np.stack([dct(columns, norm="ortho", axis=1)[:, 1:]] * 2)), axis=1)
    mixed = np.stack((rows[0] + rows[1], rows[0] - rows[1])) / math.sqrt(2.0)
    total = np.zeros((rows.shape[1],) * 2)
    for k, cell in enumerate(data.cells):
        part = band_slices(N, 1.0)[cell.band]
        own = mixed[k % 2][:, part] / math.sqrt(cell.power * variance[k])
        total += own @ own.T
    expected = reduced(total, model.sigmas)
    size = np.sqrt(np.diag(expected))
    gram = _gram_of(found, model)
    found_size = gram(variants) / np.outer(size, size)
    assert found_size == pytest.approx(expected / np.outer(size, size), abs=2e-3)
    # what was asked for before, in another order or beside others, is no other
    few = [*variants[1::-1], effect("bias_quadratic").variants()[0]]
    assert gram(few) == pytest.approx(_gram_of(found, model)(few), rel=1e-12)
    assert gram(variants) == pytest.approx(found_size * np.outer(size, size), rel=1e-12)


def test_a_second_look_keeps_the_best_points_and_finds_the_time_between_them(searched):
    found, model, variants, runs = searched
    assert found.best.names == {"warm_up"} and found.line is None
    few, again = second_look(found, model, variants)
    assert {each.effect.name for each in few} == {each.effect.name for each in variants}
    own = [each.shape["time_constant_s"] for each in few if each.effect.name == "warm_up"]
    grid = {each.shape["time_constant_s"] for each in variants if each.effect.name == "warm_up"}
    assert any(abs(each - 450.0) < 40.0 for each in own if each not in grid)
    (stack,) = again.stacks
    column = 2
    for each in few:
        rows = dct(each.columns(runs[0].stimulus), norm="ortho", axis=1)[:, 1:]
        k = len(rows)
        assert stack.chosen(range(column, column + k))[0][:, :60] == pytest.approx(
            rows[:, :60], abs=2e-2 * np.abs(rows).max()
        )
        column += k
    once_more = judged_sets(again, model, few, found.hidden)
    assert once_more.best.names == found.best.names and once_more.hidden is found.hidden
    assert float(once_more.best.left.sum()) < float(found.best.left.sum())


def test_what_is_left_of_a_run_is_its_output_less_the_fit_over_the_noise(searched):
    found, model, variants, runs = searched
    solution = found.best.solution
    (left,) = left_of_runs(found.data, solution)
    columns = [model.terms[0].variant, *variants]
    owner = [each for each in columns for _ in each.effect.parameters]
    place = [k for each in columns for k in range(len(each.effect.parameters))]
    for run, own in zip(runs, left, strict=True):
        rest = run.output_dph - model.predict(run.stimulus)
        for index, value in zip(solution.indices.tolist(), solution.values.tolist(), strict=True):
            rest = rest - value * owner[index - 1].columns(run.stimulus)[place[index - 1]]
        noise = found.data.noise.noise.arw_deg_per_sqrt_h * 60.0
        assert own[40:] == pytest.approx(dct(rest, norm="ortho")[41:] / noise, abs=0.05)


def test_noise_beside_a_solution_is_that_of_what_repeats_differ_in_less_it(searched):
    found, model, _, _ = searched
    nothing = Solution(np.array([1]), np.zeros(1), np.zeros((1, 1)))
    for solution in (nothing, found.best.solution):
        again = noise_beside(found.data, solution, model)
        assert again.source == REPEATS and again.noise.arw_deg_per_sqrt_h == pytest.approx(0.004, rel=0.05)
    sheet = replace(found.data, noise=judge_noise([], WHITE, REPEATS))
    assert noise_beside(sheet, nothing, model) is sheet.noise and sheet.noise.source == DATA_SHEET
    whole = gathered(found.data.groups, found.data.stacks, sheet.noise, model, None)
    repeats = gathered(found.data.groups, found.data.stacks, found.data.noise, model, None)
    assert (whole.floor.sigma >= 0.5).all() and not (repeats.floor.sigma >= 0.5).all()
    raw = repeats.floor.ratio[repeats.cells[0].band]
    assert repeats.cells[0].power == pytest.approx(
        (found.data.noise.noise.arw_deg_per_sqrt_h * 60.0) ** 2 * raw, rel=0.01
    )
    left = floor_from_repeats(whole.cells, model.sigmas, nothing)
    assert left.from_repeats and left.ratio == pytest.approx(np.ones(len(BANDS)), abs=0.5)


def test_a_line_is_that_of_the_quantity_of_energy_above_its_surroundings():
    """Two runs, a window twice as high all over: the surroundings count, not the floor."""
    run = made_run("r", stimulus(4000, cold=False), np.random.default_rng(1), profile="still")
    rows = np.random.default_rng(2).choice([-1.5, 1.5], size=(2, 3999))
    rows[:, 2000] = 9.0
    group = Group("still", ("0",), ((run, run),))
    line = strongest_line([group], [rows], WHITE, {})
    assert line.period_s == pytest.approx(8000.0 / 2001.0, rel=8 / 2001)
    excess = 2.0 * (81.0 - 1.5**2)
    assert line.amplitude_dph == pytest.approx(math.sqrt(2.0 * excess * 0.24**2 / rows.size), rel=1e-6)
    rows[:, 2000] = 3.5
    assert strongest_line([group], [rows], WHITE, {}) is None
    # below 700 s of period there is none: that is an effect's
    slow = np.ones((2, 3999))
    slow[:, 8] = 40.0
    assert strongest_line([group], [slow], WHITE, {}) is None
    slow[:, 8], slow[:, 20] = 1.0, 40.0
    assert strongest_line([group], [slow], WHITE, {}) is not None


def test_forms_are_learned_beside_the_models_own_parameters_as_by_least_squares_of_the_rows():
    """All profiles together: scores under a unit prior, then the nominal ones to what those leave."""
    rng = np.random.default_rng(5)
    runs = []
    slope = effect("bias_linear").variants()[0]
    for profile, n in (("short", 1200), ("long", 1600)):
        s = stimulus(n)
        extra = 2.0 * np.sin(s.warm_k / 5.0) + 0.7 * slope.columns(s)[0]
        runs += [made_run(f"{profile} {k}", s, rng, extra, profile=profile) for k in range(2)]
    model = Model("m", (Term(slope, (0.0,), (0.3,)),), WHITE)
    problem = _Problem(prepare(runs, model, []), model, [])
    place = next(k for k, one in enumerate(problem.candidates) if one.form.name == "bias over T_in")
    form = _Fitted(place, 0, 0.5)
    root = math.sqrt(0.5 * float(problem.gap.sum())) * problem.roots(place)[0]
    rows, forms = [], []
    for own, of_form in zip(problem._rows[0], problem._rows[1 + place], strict=True):
        m = of_form.shape[2]
        rows.append(own[:, 0])
        forms.append(np.pad(root.T @ np.float64(of_form[:, 0]), ((0, 0), (0, own.shape[2] - m))))
    data, nominal, x = (
        np.concatenate([r[0] for r in rows]),
        np.concatenate([r[1] for r in rows]),
        np.concatenate(forms, axis=1),
    )
    whole = np.concatenate((nominal[None], x))
    prior = np.diag(np.append(1.0 / 0.09, np.ones(len(x))))
    inverse = np.linalg.inv(whole @ whole.T + prior)
    scores = (inverse @ (whole @ data))[1:]
    basis = problem.candidates[place].basis @ root
    expected = float(nominal @ (data - scores @ x)) / (float(nominal @ nominal) + 1.0 / 0.09)
    ((values, sigmas),), change = problem.fitted([form])
    scale = np.abs(values).max()
    assert values == pytest.approx(basis @ scores, abs=1e-3 * scale)
    assert sigmas == pytest.approx(np.sqrt(np.diag(basis @ inverse[1:, 1:] @ basis.T)), rel=1e-3)
    assert change == pytest.approx([expected], rel=1e-3)
    before = data - nominal * float(nominal @ data) / (float(nominal @ nominal) + 1.0 / 0.09)
    assert problem.before.sum() == pytest.approx(float(before @ before), rel=1e-4)
    gone = problem.gone_left_out([form])
    assert gone.shape == (2,) and (gone > 0.8 * problem.gap).all()


def test_columns_that_somebody_foretold_are_means_in_their_units(tmp_path):
    """In deg/s, times in ms that begin 200 ms before the run; a row without a number is left out."""
    time_ms = np.arange(-200.0, 301_000.0, 100.0)
    rate = 2.0 + 1e-3 * time_ms / 1000.0
    text = [f"{t:.1f},{r:.9f}" for t, r in zip(time_ms, rate, strict=True)]
    text[55] = text[55].split(",")[0] + ",nan"
    (tmp_path / "r 1.csv").write_text("\n".join(["t,r", *text]), encoding="utf-8")
    settings = {
        "columns": "{run}.csv",
        "time": {"name": "t", "unit": "ms"},
        "output": {"name": "r", "unit": "deg/s"},
    }
    simulation = read_simulation(settings, str(tmp_path / "m.toml"))
    assert simulation.kind == "columns" and simulation.folder == tmp_path
    s = stimulus(300)
    found = simulation.foretold_dph(s, "r 1")
    assert found == pytest.approx(3600.0 * (2.0 + 1e-3 * (np.arange(300) + 0.5)), rel=1e-6)
    backwards = [text[0], text[2], text[1], *text[3:]]
    (tmp_path / "b.csv").write_text("\n".join(["t,r", *backwards]), encoding="utf-8")
    with pytest.raises(ConfigurationError, match="no times that grow"):
        simulation.foretold_dph(s, "b")
    (tmp_path / "c.csv").write_text("\n".join(["t,r", text[0]]), encoding="utf-8")
    with pytest.raises(ConfigurationError, match="no times that grow"):
        simulation.foretold_dph(s, "c")
    late = [f"{t + 1e9:.1f},1.0" for t in time_ms]
    (tmp_path / "d.csv").write_text("\n".join(["t,r", *late]), encoding="utf-8")
    with pytest.raises(ConfigurationError, match="foretells nothing of this run") as refused:
        simulation.foretold_dph(s, "d")
    assert refused.value.found == "(300,) values, 0 of them numbers"
    assert read_simulation({}, "m.toml") is None
    for table in ({"columns": "a", "fmu": "b"}, {"time": {}}, {"function": "f", "other": 1}):
        with pytest.raises(ConfigurationError, match=r"\[simulation\] cannot be used"):
            read_simulation(table, "m.toml")
    wrong = Simulation(settings | {"output": {"name": "r", "unit": "degC"}}, tmp_path)
    with pytest.raises(ConfigurationError):
        wrong.foretold_dph(s, "r 1")
    fmu = Simulation(
        {"fmu": "x.fmu", "inputs": {"u": "nothing"}, "output": {"name": "y", "unit": "deg/s"}}, tmp_path
    )
    with pytest.raises(ConfigurationError, match="is given something that is not recorded") as refused:
        fmu.foretold_dph(s, "r")
    assert refused.value.found == "nothing" and set(refused.value.expected.split(", ")) == set(INPUTS)


def test_inputs_of_a_simulation_are_those_at_the_middles_of_the_steps():
    s = replace(stimulus(300, rate_dps=4.0), period_s=2.0)
    found = {name: of(s) for name, of in INPUTS.items()}
    assert found["time_s"][:2].tolist() == [0.0, 1.0] and found["table_rate_dps"][0] == pytest.approx(2.0)
    assert found["table_angle_deg"][:2].tolist() == [12.0, 16.0]
    up = 15.041067 / 3600.0 * math.sin(math.radians(39.1))
    assert found["rate_dps"] == pytest.approx(np.full(300, 2.0 + up), rel=1e-6)
    assert found["t_in_c"] is s.t_in_c and found["elevation_deg"] is s.elevation_deg


def test_a_model_files_optional_parameters_are_nought_and_its_shape_is_the_usual_one():
    names = list(effect("table_wobble_once").parameters)
    given = {parameter.name: 3.0 for parameter in names if not parameter.optional}
    row = ", ".join(f"{name} = {value}" for name, value in given.items())
    text = "format = 1\nname = 'x'\n[noise]\narw_deg_per_sqrt_h = 0.01\nquantum_arcsec = 0.2\n"
    text += f'[[effect]]\nname = "table_wobble_once"\nparameters = {{ {row} }}\nsigma = {{ {row} }}\n'
    (term,) = parse_model(text, "m").terms
    for parameter, value, sigma in zip(names, term.values, term.sigmas, strict=True):
        assert (value, sigma) == ((3.0, 3.0) if not parameter.optional else (0.0, pytest.approx(1e-9)))
    assert parse_model(text, "m").name == "x" and parse_model(text, "m").noise == Noise(
        0.01, quantum_arcsec=0.2
    )
    with pytest.raises(ConfigurationError, match="not TOML"):
        parse_model("format = ", "m")
    with pytest.raises(ConfigurationError, match="catalogue lacks") as refused:
        parse_model(text.replace("table_wobble_once", "noise_level"), "m")
    assert refused.value.found == "noise_level" and "noise_level" not in refused.value.expected.split(", ")
