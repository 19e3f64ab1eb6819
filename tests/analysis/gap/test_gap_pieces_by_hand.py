"""Pieces of the diagnosis that few inputs reach: each against a sum, a closed form or a count of its own."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.gap import (
    Model,
    Noise,
    Simulation,
    Term,
    _channel_fit,
    _learn,
    _missing,
    _rate,
    write_missing,
)
from bench.analysis.gap._candidates import possible_candidates
from bench.analysis.gap._cells import _helmert, cells_in, contrasts, mixing
from bench.analysis.gap._channel_fit import fit_effects
from bench.analysis.gap._channels import ChannelSignal
from bench.analysis.gap._data import Group, good_length, group_runs
from bench.analysis.gap._evidence import Candidate
from bench.analysis.gap._fit import Products, solve, tolerated, weighted_gram
from bench.analysis.gap._generic import free_curves
from bench.analysis.gap._learn import _Fitted, _Problem, learned
from bench.analysis.gap._missing import MissingTerms, missing_terms
from bench.analysis.gap._prepare import prepare
from bench.analysis.gap._which import judged_sets
from drivers.base.errors import ConfigurationError
from simulators.effects import Variant, catalogue
from tests.analysis.gap.conftest import effect, made_run, stimulus

WHITE = Noise(0.004)
CURVE = "free curve: bias over T_in"


def runs_of(*conditions, n=300):
    rng = np.random.default_rng(1)
    s = stimulus(n, cold=False)
    return [made_run(f"{k} {name}", s, rng, condition=name) for k, name in enumerate(conditions)]


# groups of runs


def test_runs_that_were_repeated_unequally_often_stand_for_themselves():
    """All of them are repeatable, so that none is taken for noise."""
    (group,) = group_runs(runs_of("0", "0", "+5", "+5", "+5"))
    assert not group.balanced
    names, repeatable, mix = mixing(group)
    assert names == [run.run_id for run in group.flat] and len(set(names)) == 5
    assert repeatable == [True] * 5 and mix.tolist() == np.eye(5).tolist()


@pytest.mark.parametrize("repeats", [1, 2, 3])
@pytest.mark.parametrize(
    ("conditions", "names", "rows"),
    [
        (("0",), ["run"], [[1]]),
        (("+5", "-5"), ["common", "odd in rate"], [[1, 1], [1, -1]]),
        (("-5", "+5"), ["common", "odd in rate"], [[1, 1], [-1, 1]]),
        (("0", "+5", "-5"), ["common", "odd in rate", "even in rate"], [[1, 1, 1], [0, 1, -1], [-2, 1, 1]]),
        (("+5", "0", "-5"), ["common", "odd in rate", "even in rate"], [[1, 1, 1], [1, 0, -1], [1, -2, 1]]),
        (("+5", "-4"), ["common", "orientation 1"], [[1, 1], [1, -1]]),
        (
            ("0 deg", "90 deg", "180 deg", "270 deg"),
            ["common", "orientation 1", "orientation 2", "orientation 3"],
            [[1, 1, 1, 1], [1, -1, 0, 0], [1, 1, -2, 0], [1, 1, 1, -3]],
        ),
    ],
)
def test_contrasts_are_between_conditions_first_and_then_between_repeats(conditions, names, rows, repeats):
    labels, repeatable, mix = contrasts(conditions, repeats)
    m = len(conditions) * repeats
    assert labels == names * repeats
    assert repeatable == [True] * len(conditions) + [False] * (m - len(conditions))
    assert mix @ mix.T == pytest.approx(np.eye(m), abs=1e-12)
    for own, row in zip(mix, rows, strict=False):
        expected = np.repeat(row, repeats) / np.linalg.norm(np.repeat(row, repeats))
        assert own == pytest.approx(expected, abs=1e-12)
    # what comes after the first repeat sums to nothing over the repeats of each condition
    sums = mix[len(conditions) :].reshape(-1, len(conditions), repeats).sum(axis=2)
    assert sums == pytest.approx(np.zeros_like(sums), abs=1e-12)


@pytest.mark.parametrize("n", [1, 2, 5])
def test_differences_are_of_each_from_the_mean_of_those_before(n):
    found = _helmert(n)
    for k in range(1, n):
        expected = np.concatenate((np.full(k, 1.0 / k), [-1.0], np.zeros(n - k - 1)))
        assert found[k] == pytest.approx(expected / math.sqrt(1.0 + 1.0 / k))
    assert found[0] == pytest.approx(np.full(n, 1.0 / math.sqrt(n)))


def test_a_group_has_a_cell_for_every_band_of_every_run():
    """Of 300 s the slowest period is 600 s: bands beyond 560 s hold one coefficient, those beyond 1400 s none."""
    (group,) = group_runs(runs_of("0", "+5", "-5"))
    assert cells_in(group) == 9 * 3
    long = Group("p", ("0",), ((made_run("l", stimulus(8000, cold=False), np.random.default_rng(1)),),))
    assert cells_in(long) == 11


@pytest.mark.parametrize(
    ("count", "length"), [(1, 1), (11, 10), (13, 12), (121, 120), (257, 256), (2401, 2401)]
)
def test_a_length_for_fast_transforms(count, length):
    assert good_length(count) == length


# what may be seen


@pytest.mark.parametrize(("low", "high"), [(-6.0, 1.0), (-1.0, 6.0), (-6.0, 6.0)])
@pytest.mark.parametrize(("size", "seen"), [(0.8, False), (0.9, True)])
def test_an_effect_may_show_if_its_larger_bound_reaches_five_deviations(low, high, size, seen):
    """6 times 0.9 is above 5, 6 times 0.8 below."""
    own = effect("bias_linear")
    parameter = replace(own.parameters[0], low=low, high=high)
    variant = Variant(replace(own, parameters=(parameter,)), {})
    system = np.diag([1.0, size**2])
    found, reasons = possible_candidates(
        system, system, [Candidate("bias_linear", 0, (1,), 1)], [variant], 0, 1.0
    )
    assert found == ([0] if seen else []) and bool(reasons) is not seen
    # the bounds of a coarser gyro are wider
    found, _ = possible_candidates(system, system, [Candidate("bias_linear", 0, (1,), 1)], [variant], 0, 1.1)
    assert found == ([0] if 1.1 * 6.0 * size > 5.0 else [])


@pytest.mark.parametrize(("left", "told"), [(0.9e-6, False), (1.1e-6, True)])
def test_what_the_models_own_terms_do_is_no_candidate(left, told):
    variant = effect("bias_linear").variants()[0]
    gram, system = np.diag([1.0, 7.0, 1e12]), np.diag([1.0, left * 1e12])
    found, reasons = possible_candidates(
        system, gram, [Candidate("bias_linear", 0, (1,), 1)], [variant], 1, 1.0
    )
    assert found == ([0] if told else [])
    assert told or reasons["bias_linear"].startswith("cannot be told from the nominal model's own terms")


@pytest.mark.parametrize(("part", "added"), [(0.2, True), (0.45, True), (0.6, False), (0.7, False)])
def test_a_formula_is_corrected_by_a_curve_up_to_its_tolerance(part, added):
    """A wave over T_in beside a quadratic bias: the formula may miss 0.35 of its amplitude, as it is weighted."""
    rng = np.random.default_rng(4)
    s = stimulus(3000)
    quadratic = 20.0 * effect("bias_quadratic").variants()[0].columns(s)[0]
    wave = np.sin(s.warm_k / 7.0)
    basis = np.stack((np.ones(3000), quadratic), axis=1)
    wave = wave - basis @ np.linalg.lstsq(basis, wave, rcond=None)[0]
    real = quadratic + part * quadratic.std() / wave.std() * wave
    runs = [made_run(name, s, rng, real) for name in "ab"]
    variants = [effect("bias_quadratic").variants()[0]]
    variants += [
        each for each in free_curves(runs) if each.effect.name == CURVE and len(each.effect.nodes) == 17
    ][:1]
    model = Model("m", (), WHITE)
    data = prepare(runs, model, variants)
    found = judged_sets(data, model, variants)
    (one,) = (each for each in found.judged if each.names == {"bias_quadratic"})
    gram = weighted_gram(data.cells, tolerated(data.cells, found.before, directions=8.0))
    products = Products.of(data.cells, range(1, 19))
    none, alone, both = (
        float(products.left(solve(gram, model.sigmas, at)).sum()) for at in ((), (1,), range(1, 19))
    )
    ratio = (alone - both) / (none - alone)
    assert (ratio < 0.35**2) is added and ratio < 0.3
    assert (len(one.in_form.indices) > len(one.solution.indices)) is added


# learned terms


SLOW = stimulus(900)


def two_profiles(extra):
    rng = np.random.default_rng(3)
    runs = []
    for profile, n in (("short", 900), ("long", 1200)):
        s = stimulus(n)
        runs += [made_run(f"{profile} {k}", s, rng, extra(s), profile=profile) for k in range(2)]
    return runs


def terms_of(*names):
    return tuple(Term(effect(name).variants()[0], (0.0,), (1e6,)) for name in names)


@pytest.mark.parametrize("names", [(), ("bias_linear",), ("bias_linear", "warm_up"),
                                   ("bias_linear", "warm_up", "scale_factor")])  # fmt: skip
def test_forms_are_fitted_beside_all_parameters_of_a_model(names):
    """As many changes as parameters, each what was put in."""
    sizes = {"bias_linear": 30.0, "warm_up": -20.0, "scale_factor": 4e3}

    def extra(s):
        return sum(
            (sizes[name] * effect(name).variants()[0].columns(s)[0] for name in names), np.zeros(len(s))
        )

    model = Model("m", terms_of(*names), WHITE)
    problem = _Problem(prepare(two_profiles(extra), model, []), model, [])
    (place,) = (
        k for k, one in enumerate(problem.candidates) if one.form.name == "memory of temperature changes"
    )
    ((values, sigmas),), nominal = problem.fitted([_Fitted(place, 0, 1e-9)])
    assert len(nominal) == len(names) and values.shape == sigmas.shape == (4,)
    assert nominal[:2] == pytest.approx([sizes[name] for name in names[:2]], rel=0.05)


@pytest.mark.parametrize(("share", "offered"), [(0.19, False), (0.21, True)])
def test_a_learned_term_is_offered_from_a_fifth_of_the_gap_on(monkeypatch, share, offered):
    """Its share in the profiles left out is told even if it is not offered."""
    gap, noise = np.array([300.0, 100.0, 50.0]), np.array([10.0, 10.0, 60.0])
    gone = np.array([share * 300.0, share * 100.0, 49.0])
    variant = effect("warm_up").variants()[0]
    problem = SimpleNamespace(
        profiles=("a", "b", "c"), gap=gap, noise=noise, harmed=lambda _: [],
        candidates=[SimpleNamespace(variant=variant)],
        fitted=lambda _: ([(np.array([2.0]), np.array([0.5]))], np.zeros(0)),
    )  # fmt: skip
    monkeypatch.setattr(_learn, "_Problem", lambda *_: problem)
    monkeypatch.setattr(_learn, "_chosen", lambda _: ([_Fitted(0, 0, 0.3)], gone))
    (group,) = group_runs(runs_of("0", "0"))
    found = learned(SimpleNamespace(groups=(group,)), Model("m", (), WHITE), [])
    assert found.by_profile == pytest.approx({"a": share, "b": share})
    if offered:
        assert found.share == pytest.approx(share) and not found.reason
        assert [(term.name, term.values, term.sigmas) for term in found.terms] == [
            ("warm_up", (2.0,), (0.5,))
        ]
    else:
        assert found.terms == () and found.reason.startswith("no form that was learned")


def test_what_harms_a_run_is_taken_back_last_form_first(monkeypatch):
    """The reason names the runs that the whole of it harmed."""
    gap, noise = np.array([300.0, 100.0]), np.array([10.0, 10.0])
    asked = []

    def harmed(chosen):
        asked.append([one.place for one in chosen])
        return ["run 7"] if len(chosen) == 3 else ["run 8"]

    problem = SimpleNamespace(
        profiles=("a", "b"), gap=gap, noise=noise, harmed=harmed, gone_left_out=lambda _: np.zeros(2)
    )
    monkeypatch.setattr(_learn, "_Problem", lambda *_: problem)
    forms = [_Fitted(k, 0, 0.3) for k in range(3)]
    monkeypatch.setattr(_learn, "_chosen", lambda _: (forms, 0.9 * gap))
    found = learned(SimpleNamespace(groups=()), Model("m", (), WHITE), [])
    assert asked == [[0, 1, 2], [0, 1], [0]]
    assert found.reason == "what was learned moves run 7 further away" and not found.terms
    assert found.by_profile == {}


# channels


def fit_of(monkeypatch, starts, target, bounds=(-10.0, 10.0), begin=6.0):
    """A fit that stays where it starts, and what it was given."""
    asked = {}

    def stay(cost, at, *, bounds, **_):
        asked["bounds"] = bounds
        return SimpleNamespace(x=at, jac=np.eye(len(at)), cost=0.5 * float((cost(at) ** 2).sum()))

    monkeypatch.setattr(_channel_fit, "least_squares", stay)
    monkeypatch.setattr(
        _channel_fit, "channel_rests", lambda series, effects, values: [target(values["b"][0])]
    )
    own = SimpleNamespace(
        name="b",
        begins=lambda values: starts,
        neutral=(begin,),
        parameters=(SimpleNamespace(low=bounds[0], high=bounds[1]),),
    )
    cells = SimpleNamespace(series=(), whitened=lambda rests: rests[0])
    found = fit_effects(cells, [own], [], frozenset("b"), np.ones(3), None)
    return found, asked["bounds"]


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_fit_starts_where_the_squares_are_least(monkeypatch, sign):
    """Whatever their sign: -5 leaves three rests of 1, 2 leaves three of 3, the neutral value of 4."""
    left = {-5.0: 1.0, 2.0: -3.0, 6.0: -4.0}
    found, _ = fit_of(monkeypatch, ((2.0,), (-5.0,)), lambda at: np.full(3, sign * left[round(at, 6)]))
    assert found.values["b"] == pytest.approx((-5.0,)) and found.cost == pytest.approx(3.0)


@pytest.mark.parametrize(("begin", "step"), [(6.0, 0.6), (-6.0, 0.6), (0.01, 0.02), (0.1, 0.02)])
def test_a_fits_steps_are_a_tenth_of_the_value_or_a_thousandth_of_its_range(monkeypatch, begin, step):
    _, (low, high) = fit_of(monkeypatch, (), lambda at: np.zeros(3), begin=begin)
    assert low == pytest.approx([1.0 + (-10.0 - begin) / step])
    assert high == pytest.approx([1.0 + (10.0 - begin) / step])


@pytest.mark.parametrize(("left", "explained"), [(1.0, 1.0), (0.5, 1.0), (1.5, 0.5), (1.9, 0.1)])
def test_of_a_channel_what_is_gone_above_the_floor_is_explained(left, explained):
    """In squares of its unit: the gap is 0.04 above a floor of 0.01 a coefficient; less is none."""
    floor = np.full(4, 0.01)
    cells = SimpleNamespace(floor=floor, names=(("p", 0),), series=(), cell=np.zeros(4, dtype=int))
    own = catalogue()["table_rate_error"]
    value = {own.name: own.neutral}
    before = SimpleNamespace(left=np.full(4, math.sqrt(2.0)), values=value, names=frozenset())
    sigmas = {own.name: (1.0,) * len(own.neutral)}
    best = SimpleNamespace(left=np.full(4, math.sqrt(left)), values=value, sigmas=sigmas, names={own.name})
    data = SimpleNamespace(
        cells=cells, nominal=before, effects=[own], terms=[], places=[], rms=1.0, accuracy=0.0,
        floor=SimpleNamespace(source="made"),
    )  # fmt: skip
    signal = ChannelSignal("table_rate")
    with pytest.MonkeyPatch.context() as patched:
        cause = SimpleNamespace(name=own.name)
        patched.setattr("bench.analysis.gap._channels._causes", lambda *_: (cause,))
        patched.setattr("bench.analysis.gap._channels.channel_places", lambda *_: [])
        assert signal.finding(data, ([before, best], best)).explained == pytest.approx(explained)
        patched.setattr("bench.analysis.gap._channels._causes", lambda *_: ())
        found = signal.finding(data, ([before, best], best))
    assert found.explained == 0.0 and found.floor_rms == pytest.approx(0.1)


# what is said and written


@pytest.mark.parametrize(("evidence", "told"), [(7.0, True), (0.0, False)])
def test_a_line_that_is_a_ripples_waveform_is_not_told(monkeypatch, evidence, told):
    monkeypatch.setattr(_rate, "in_rows", lambda hz, _: SimpleNamespace(sentence=f"{hz} Hz"))
    line, best = SimpleNamespace(frequency_hz=0.25), SimpleNamespace(line=evidence)
    disturbed = SimpleNamespace(terms=(), runs=())
    found = _rate._of_lines(SimpleNamespace(line=line, best=best), disturbed)
    assert found == (["0.25 Hz"] if told else [])
    assert _rate._of_lines(SimpleNamespace(line=None, best=best), disturbed) == []
    own = catalogue()["vibration_or_mains_line"]
    hz = [parameter.unit.symbol == "Hz" for parameter in own.parameters]
    term = SimpleNamespace(effect=own, values=tuple(float(k) for k in range(1, len(hz) + 1)))
    found = _rate._of_lines(SimpleNamespace(line=None, best=best), SimpleNamespace(terms=(term,), runs=()))
    assert found == [f"{k}.0 Hz" for k, one in enumerate(hz, 1) if one] and len(found) == 1


@pytest.mark.parametrize("n", [300, 301, 303])
@pytest.mark.parametrize("period_s", [1.0, 0.5])
def test_what_a_simulation_lacks_has_a_row_a_step(tmp_path, n, period_s):
    s = replace(stimulus(n, cold=False), period_s=period_s)
    run = replace(made_run("a b/c", s, np.random.default_rng(1)), simulated=True)
    (term,) = terms_of("warm_up")
    model = Model(
        "m", (replace(term, values=(3.0,)),), WHITE, simulation=Simulation({"function": "f"}, tmp_path)
    )
    (file,) = write_missing(model, [run], tmp_path / "closed.toml")
    assert file.name == "closed_a-b-c.csv"
    rows = np.loadtxt(file, delimiter=",", skiprows=1)
    assert rows.shape == (n, 3) and rows[:, 0] == pytest.approx(period_s * np.arange(1, n + 1))
    assert rows[:, 1] == pytest.approx(run.output_dph - s.input_rate_dph, rel=1e-6)
    assert rows[:, 2] == pytest.approx(3.0 * term.variant.columns(s)[0], rel=1e-6)


def warm(value, time_constant_s=900.0):
    own = effect("warm_up")
    return Term(Variant(own, {"time_constant_s": time_constant_s}), (value,), (1.0,))


def test_missing_are_the_terms_of_the_one_model_less_those_of_the_other():
    shupe = Term(effect("shupe").variants()[0], (0.5, -2.0), (0.1, 0.1))
    closed = Model("c", (warm(3.0), warm(4.0), warm(2.0, 300.0), shupe), WHITE)
    nominal = Model("n", (warm(1.5), replace(shupe, values=(0.25, 1.0))), WHITE)
    assert missing_terms(closed, nominal) == [
        {"effect": "warm_up", "values": [5.5], "shape": {"time_constant_s": 900.0}},
        {"effect": "warm_up", "values": [2.0], "shape": {"time_constant_s": 300.0}},
        {"effect": "shupe", "values": [0.25, -3.0], "shape": dict(shupe.variant.shape)},
    ]
    only = missing_terms(Model("c", (), WHITE), Model("n", (warm(1.5),), WHITE))
    assert only == [{"effect": "warm_up", "values": [-1.5], "shape": {"time_constant_s": 900.0}}]
    with pytest.raises(ConfigurationError, match="nothing is missing"):
        missing_terms(nominal, nominal)


@pytest.mark.parametrize("start_s", [0.0, 40.0])
@pytest.mark.parametrize("step_s", [1.0, 0.5, 0.25])
def test_missing_terms_of_time_and_rate_step_by_step(start_s, step_s):
    """What warms up counts from the first step; a scale factor has the rate of its step."""
    scale = Term(Variant(effect("scale_factor"), {}), (200.0,), (1.0,))
    given = {"terms": missing_terms(Model("c", (warm(3.0), scale), WHITE), Model("n", (), WHITE)),
             "latitude_deg": 39.1, "own": []}  # fmt: skip
    plant = MissingTerms(given, None)
    assert set(plant.inputs) == {"rate_dps"} and plant.parameters == {} and plant.step_s == 1.0
    for k in range(40):
        rate_dps = 0.5 * k
        found = plant.step(start_s + k * step_s, step_s, {"rate_dps": rate_dps})["missing_dph"]
        second = math.floor(k * step_s + 1e-9) + 1
        expected = 3.0 * math.exp(-second / 900.0) + 200e-6 * 3600.0 * rate_dps
        assert found == pytest.approx(expected, abs=0.01)


def test_temperatures_go_straight_from_step_to_step(monkeypatch):
    """In steps of 4 s each second has its part of the way; at the first there is none yet."""
    seen = []
    own = effect("bias_linear").variants()[0]
    monkeypatch.setattr(
        Variant, "stepper", lambda self, values: lambda t_in, t_out: seen.append((t_in, t_out)) or 0.0
    )
    plant = MissingTerms(
        {"terms": [{"effect": "bias_linear", "values": [1.0], "shape": dict(own.shape)}], "latitude_deg": 0.0,
         "own": []}, None)  # fmt: skip
    assert plant.inputs["t_in_c"] == _missing._INPUTS["t_in_c"] and "smoothing_s" in plant.parameters
    for k, (t_in, t_out) in enumerate([(10.0, 20.0), (14.0, 12.0), (15.0, 12.0)]):
        plant.step(4.0 * k, 4.0, {"t_in_c": t_in, "t_out_c": t_out, "smoothing_s": 0.0})
    expected_in = [10.0, 11.0, 12.0, 13.0, 14.0, 14.25, 14.5, 14.75, 15.0]
    expected_out = [20.0, 18.0, 16.0, 14.0, 12.0, 12.0, 12.0, 12.0, 12.0]
    assert [each[0] for each in seen] == pytest.approx(expected_in)
    assert [each[1] for each in seen][1:] == pytest.approx(expected_out[1:])
