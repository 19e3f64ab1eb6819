"""How sets of effects are weighed, learned and told, on small made ones: against least squares and by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.gap import Model, Noise, Place, Term, _causes, _identify, _rate, identifiable
from bench.analysis.gap._cells import Cell
from bench.analysis.gap._channels import _verdict
from bench.analysis.gap._describe import _remaining_part
from bench.analysis.gap._designs import _ramp
from bench.analysis.gap._evidence import Candidate, _gains
from bench.analysis.gap._findings import Cause
from bench.analysis.gap._fit import Solution, solve
from bench.analysis.gap._generic import free_curves, smooth
from bench.analysis.gap._identify import _left
from bench.analysis.gap._judged import Judged, curves_that_matter, told_by_form
from bench.analysis.gap._learn import _LOOSE, _chosen, _Fitted, _Problem
from bench.analysis.gap._learned_forms import candidates_for
from bench.analysis.gap._position import _log_evidence
from bench.analysis.gap._prepare import prepare
from bench.analysis.gap._rows import Steps, _grid
from bench.analysis.gap._unknown import Remainder, credibility
from bench.analysis.gap._where import RegimePlace
from bench.analysis.gap._which import judged_sets
from simulators.effects import Variant
from tests.analysis.gap.conftest import effect, made_run, stimulus
from tests.analysis.gap.test_gap_edges import lines, mark

WHITE = Noise(0.004)
NONE = Solution(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 0)))
RNG = np.random.default_rng(1)
CURVE = "free curve: bias over T_in"
EFFECTS = {
    variant.effect.name: variant.effect for variant in free_curves([made_run("r", stimulus(600), RNG)])
} | {name: effect(name) for name in ("bias_quadratic", "bias_cubic", "warm_up", "shupe", "scale_factor")}


def judged(names, left, log_evidence=0.0):
    rest = Remainder(np.zeros(1), 0.0, np.zeros(1), np.zeros(1))
    own = np.array([float(left)])
    return Judged(
        frozenset(names), frozenset(), log_evidence, NONE, own, rest, NONE, NONE, frozenset({CURVE})
    )


def without(one, names):
    """Every effect takes 100 away."""
    return one.left + 100.0 * len(names)


def kept(*sets):
    return [set(one.names) for one in curves_that_matter(sets, without, EFFECTS)]


@pytest.mark.parametrize(
    ("gained", "rival", "stays"),
    [
        (5.0, "warm_up", False),
        (9.0, "warm_up", True),
        (9.0, "bias_quadratic", False),
        (14.0, "bias_quadratic", True),
        (9.0, None, True),
        (5.0, None, False),
    ],
)
def test_a_curve_that_gains_what_a_formula_may_miss_is_its_form(gained, rival, stays):
    """A sixteenth of what the effect takes away, an eighth if that is over the curve's very input."""
    other = {rival} if rival else {"shupe"}
    own = {CURVE} if rival else {CURVE, "shupe"}
    assert kept(judged(own, 50.0 - gained), judged(other, 50.0)) == ([own] if stays else []) + [other]


def test_a_curve_is_held_against_sets_that_have_all_the_rest_or_an_effect_of_its_input():
    """An eighth of what the quadratic takes is its form, whatever else a set with the curve has as well."""
    near, far = judged({CURVE, "warm_up"}, 40.0), judged({CURVE, "warm_up"}, 30.0)
    quadratic, other = judged({"bias_quadratic"}, 50.0), judged({"shupe"}, 41.0)
    assert kept(near, quadratic) == [{"bias_quadratic"}]
    assert kept(far, quadratic) == [{CURVE, "warm_up"}, {"bias_quadratic"}]
    # of another input it must have all the rest
    assert kept(near, other) == [{CURVE, "warm_up"}, {"shupe"}]
    assert kept(near, judged({"shupe", "warm_up"}, 41.0)) == [{"shupe", "warm_up"}]
    # what else the other set has does not stand for the curve
    further = judged({"bias_quadratic", "shupe"}, 52.4)
    assert {CURVE, "warm_up"} in kept(near, further)
    assert {CURVE, "warm_up"} not in kept(near, replace(further, left=np.array([52.2])))
    # a larger set is no simpler explanation
    larger = judged({"bias_quadratic", "warm_up", "shupe"}, 41.0)
    assert kept(near, larger)[0] == {CURVE, "warm_up"}
    # with a curve of its own it says nothing of one
    assert {CURVE, "warm_up"} in kept(near, judged({CURVE, "shupe"}, 40.5))


def test_formulas_of_one_input_draw_a_curve_together():
    """An eighth of what both take is the form of both; a formula of another input beside does not count."""
    both = judged({"bias_quadratic", "bias_cubic"}, 50.0)
    assert kept(judged({CURVE, "bias_cubic"}, 30.0), both) == [both.names]
    assert kept(judged({CURVE, "bias_cubic"}, 20.0), both) == [{CURVE, "bias_cubic"}, both.names]
    beside = judged({"bias_quadratic", "shupe"}, 50.0)
    assert kept(judged({CURVE, "shupe"}, 30.0), beside) == [{CURVE, "shupe"}, beside.names]


def test_a_set_that_only_the_form_of_an_effect_tells_from_the_best_is_nearly_as_probable():
    """Not one of another unit, and no curve; the more so the nearer it comes."""
    cells = [SimpleNamespace(count=40.0, repeatable=True, band=0)]
    best = judged({"bias_quadratic"}, 40.0, 0.0)
    far = [judged({name}, 45.0, -1000.0) for name in ("bias_cubic", "scale_factor", CURVE)]
    found = {min(one.names): one.log_evidence for one in told_by_form([best, *far], without, cells, EFFECTS)}
    assert found["bias_quadratic"] == 0.0 and found["scale_factor"] == found[CURVE] == -1000.0
    assert -20.0 < found["bias_cubic"] < -1.0
    as_near, _ = told_by_form([judged({"bias_cubic"}, 40.0, -1000.0), best], without, cells, EFFECTS)
    assert -1.0 < as_near.log_evidence < 0.0
    (further, _) = told_by_form([judged({"bias_cubic"}, 90.0, -1000.0), best], without, cells, EFFECTS)
    assert -1000.0 < further.log_evidence < found["bias_cubic"]


def bent_by(part):
    """A bias over T_in that a quadratic formula misses a part of, and what few candidates make of it."""
    rng = np.random.default_rng(4)
    s = stimulus(3000)
    quadratic = effect("bias_quadratic").variants()[0].columns(s)[0]
    real = quadratic * 20.0 + part * np.ptp(20.0 * quadratic) * np.sin(s.warm_k / 7.0)
    runs = [made_run(name, s, rng, real) for name in "ab"]
    names = ("bias_quadratic", "mode_hop", "warm_up")
    variants = [effect(name).variants()[0] for name in names]
    variants += [
        each for each in free_curves(runs) if each.effect.name == CURVE and each.shape["lag_s"] == 0.0
    ]
    model = Model("m", (), WHITE)
    return judged_sets(prepare(runs, model, variants), model, variants), variants


@pytest.fixture(scope="module")
def bent():
    return bent_by(0.2)


def test_what_a_formula_may_miss_in_all_bands_together_is_nothing_unknown(bent):
    """What is left fills bands in which the quadratic has next to nothing; up to a part it is its form."""
    for (found, _), remains in ((bent_by(0.15), False), (bent, True)):
        (quadratic,) = (one for one in found.judged if one.names == {"bias_quadratic"})
        assert (quadratic.rest.total > 0.0) == remains


def test_what_an_effects_formula_misses_is_taken_out_by_a_curve_over_its_input_alone(bent):
    found, variants = bent
    best = next(one for one in found.judged if one.names == {"bias_quadratic"})
    added = set(best.in_form.indices.tolist()) - set(best.solution.indices.tolist())
    owner = [k for k, each in enumerate(variants) for _ in each.effect.parameters]
    assert added and {variants[owner[column - 1]].effect.name for column in added} == {CURVE}
    # the curve is the finest or another, but one of them
    assert len({owner[column - 1] for column in added}) == 1


def test_sets_that_are_out_of_the_question_are_not_judged(bent):
    found, _ = bent
    names = [one.names for one in found.judged]
    assert frozenset() in names and frozenset({"warm_up"}) not in names and len(names) == len(set(names))


def test_an_effects_part_that_another_leaves_is_that_of_least_squares():
    """Columns of any size, and one that shows nothing."""
    rng = np.random.default_rng(2)
    rows = np.concatenate(
        (rng.normal(size=(40, 5)) * [1.0, 3.0, 1e-3, 2e-3, 50.0], np.zeros((40, 1))), axis=1
    )
    one, other = Candidate("a", 0, (1, 2), 1), Candidate("b", 1, (3, 4, 5), 1)
    inner = rows[:, 3:5] / np.linalg.norm(rows[:, 3:5], axis=0)
    left = rows[:, 1:3] - inner @ np.linalg.lstsq(inner, rows[:, 1:3], rcond=None)[0]
    expected = float(np.mean((left**2).sum(axis=0) / (rows[:, 1:3] ** 2).sum(axis=0)))
    assert _left(rows.T @ rows, one, other) == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("part", "alike"), [(0.06, True), (0.065, False), (0.02, True)])
def test_effects_are_alike_up_to_a_sixteenth(monkeypatch, part, alike):
    monkeypatch.setattr(_identify, "_left", lambda *_: part)
    runs = [made_run(name, stimulus(600), np.random.default_rng(ord(name))) for name in "ab"]
    found = [each for each in identifiable(runs, Model("m", (), WHITE)) if not each.reason]
    assert len(found) > 5
    for each in found:
        assert set(each.alike) == ({one.effect for one in found} - {each.effect} if alike else set())


@pytest.mark.parametrize("size", [1.0, 1e-4, 1e3])
def test_what_columns_take_from_the_cost_does_not_depend_on_their_size(size):
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(50, 5)) * [1.0, size, size, size, size]
    system = rows.T @ rows
    expected = [
        float(rows[:, 0] @ rows[:, at] @ np.linalg.lstsq(rows[:, at], rows[:, 0], rcond=None)[0])
        for at in ([1, 2], [3, 4])
    ]
    assert _gains(system, system, np.array([[1, 2], [3, 4]])) == pytest.approx(expected, rel=1e-4)


def cell(action, band=0):
    block = np.array([[5.0, 1.0], [1.0, action]])
    return Cell("p", "run", True, band, 10.0, 2, np.arange(2), block, 1.0, 100)


def test_an_effect_is_believed_by_what_is_explained_where_it_acts():
    """It acts with 4 * 9 / 2 where a tenth is left, and with 4 * 1 / 1 where half is."""
    rest = Remainder(np.zeros(2), 0.0, np.zeros(2), np.array([0.1, 0.5]))
    solution = Solution(np.array([1]), np.array([2.0]), np.eye(1))
    found = credibility([cell(9.0), cell(1.0, 1)], np.array([2.0, 1.0]), solution, [1], rest)
    assert found == pytest.approx(1.0 - (18.0 * 0.1 + 4.0 * 0.5) / 22.0)


@pytest.mark.parametrize("q", [1, 2, 3])
def test_nominal_parameters_are_fitted_beside_the_effects_that_stay(monkeypatch, q):
    """Two effects were fitted; the nominal columns are fitted, with priors, to the data less what stays."""
    rng = np.random.default_rng(q)
    rows = rng.normal(size=(60, 1 + q + 3))
    sigmas = np.array([0.05, 0.2, 1.0])[:q]
    gram = rows.T @ rows
    model = SimpleNamespace(sigmas=sigmas)
    solution = solve(gram, sigmas, [q + 1, q + 2, q + 3])
    candidates = (Candidate("a", 0, (1,), 1), Candidate("b", 1, (2, 3), 1))
    found = SimpleNamespace(
        posterior=SimpleNamespace(candidates=candidates),
        best=SimpleNamespace(names={"a", "b"}, members=frozenset({0, 1}), solution=solution),
        data=SimpleNamespace(cells=()),
        variance=(),
    )
    monkeypatch.setattr(_causes, "weighted_gram", lambda *_: gram)
    for names, at in (({"b"}, [1, 2]), ({"a"}, [0]), (set(), [])):
        data = rows[:, 0] - rows[:, q + 1 :][:, at] @ solution.values[q:][at]
        whole = np.concatenate((rows[:, 1 : 1 + q], np.diag(1.0 / sigmas)))
        expected = np.linalg.lstsq(whole, np.append(data, np.zeros(q)), rcond=None)[0]
        assert _causes.nominal_beside(found, model, names) == pytest.approx(expected)
    assert _causes.nominal_beside(found, model, {"a", "b"}).tolist() == solution.values[:q].tolist()


def test_a_curve_is_smooth_in_runs_of_a_steady_rate_alone():
    """A scale factor's curve jumps with the rate: by half a deg/s every ten seconds it is in the fast bands."""
    steady = made_run("r", stimulus(800, rate_dps=5.0), np.random.default_rng(1))
    s = steady.stimulus
    to_and_fro = np.where(np.arange(800) % 20 < 10, 5.0, 5.5)
    stepped = replace(steady, stimulus=replace(s, angle_deg=np.concatenate(([0.0], np.cumsum(to_and_fro)))))
    curves = {each.effect.name: each.effect for each in free_curves([steady])}
    of_rate = {name: each.curve.of_rate and not each.orders for name, each in curves.items()}
    assert any(of_rate.values()) and not all(of_rate.values())
    for name, each in curves.items():
        assert smooth(each, [steady]) is not bool(each.orders), name
        assert smooth(each, [steady, stepped]) is (not each.orders and not of_rate[name]), name
    assert not smooth(effect("warm_up"), [steady])


def test_values_at_neighbouring_nodes_are_alike_over_three_lengths():
    """A Gaussian process less its value at the first node; its length is that of its first step."""
    run = made_run("r", stimulus(900), np.random.default_rng(1))
    curves = [
        each
        for each in candidates_for([run])
        if each.form.smooth and each.form.curve and len(each.nodes) == 1
    ]
    assert curves
    for one in curves:
        (nodes,) = one.nodes
        lengths = []
        for prior in one.priors:
            found = one.basis @ prior @ prior.T @ one.basis.T
            step = 1.0 - 0.5 * found[0, 0]  # how alike the second node is to the first
            length = abs(nodes[1] - nodes[0]) / math.sqrt(-2.0 * math.log(step))
            alike = np.exp(-0.5 * ((nodes[:, None] - nodes) / length) ** 2)
            expected = (alike - alike[:1] - alike[:, :1] + 1.0)[1:, 1:]
            assert found == pytest.approx(expected, abs=0.05)
            lengths.append(length / np.ptp(nodes))
        assert lengths == sorted(lengths) and len(set(lengths)) == 3 and lengths[-1] < 1.0


def test_forms_are_fitted_beside_the_only_parameter_of_a_model():
    """A triangle of 3 K, and what settles after power-on; without priors that bind, as it was put in."""
    rng = np.random.default_rng(5)
    variant = Variant(effect("bias_linear"), dict(effect("bias_linear").shapes[0]))
    runs, size = [], 3000.0
    for profile, n in (("short", 1500), ("long", 1800)):
        t_in = 25.0 + np.interp(np.arange(n), [0.0, 0.5 * n, n], [0.0, 3.0, 0.0])
        s = replace(stimulus(n, cold=False), t_in_c=t_in, t_out_c=t_in)
        extra = size * variant.columns(s)[0] + 40.0 * np.exp(-s.time_s / 300.0)
        runs += [made_run(f"{profile} {k}", s, rng, extra, profile=profile) for k in range(2)]
    model = Model("m", (Term(variant, (0.0,), (1e6,)),), WHITE)
    data = prepare(runs, model, [])
    problem = _Problem(data, model, [])
    (place,) = [k for k, one in enumerate(problem.candidates) if one.form.name == "time since power-on"]
    ((values, sigmas),), nominal = problem.fitted([_Fitted(place, 0, 1e6)])
    assert nominal == pytest.approx([size], rel=0.02)
    s = runs[0].stimulus
    made = values @ problem.candidates[place].variant.columns(s)
    assert made - made.mean() == pytest.approx(
        40.0 * (np.exp(-s.time_s / 300.0) - 0.2 * (1 - math.exp(-5.0))), abs=0.3
    )
    assert (sigmas > 0.0).all()


class Told:
    """Two profiles with gaps of 100 each, and forms whose part of them `gone` (form, loose) says."""

    profiles, gap, noise = ("a", "b"), np.array([100.0, 100.0]), np.array([5.0, 5.0])

    def __init__(self, count, gone):
        self.candidates, self._gone = range(count), gone

    def roots(self, place):
        return [np.eye(1)]

    def gone_left_out(self, forms):
        return np.sum([self._gone(one.place, one.loose) for one in forms], axis=0)


def test_a_form_may_help_one_profile_and_must_harm_none():
    chosen, gone = _chosen(Told(1, lambda *_: np.array([60.0, 0.0])))
    assert [one.place for one in chosen] == [0] and gone.tolist() == [60.0, 0.0]
    chosen, gone = _chosen(Told(1, lambda *_: np.array([90.0, -20.0])))
    assert not chosen and gone.tolist() == [0.0, 0.0]
    # a second one must help both
    for second, count in ((np.array([15.0, 15.0]), 2), (np.array([30.0, 0.0]), 1)):
        told = Told(2, lambda place, _, second=second: np.array([40.0, 40.0]) if not place else second)
        assert len(_chosen(told)[0]) == count


def test_forms_are_screened_with_the_middling_prior():
    """The last of eight does well with that one alone, the others less well, and only if they are freer."""
    _, middling, free = sorted(_LOOSE)

    def gone(place, loose):
        if place == 7:
            return np.full(2, 40.0 if loose == middling else 0.0)
        return np.full(2, 30.0 if loose == free else 5.0)

    chosen, _ = _chosen(Told(8, gone))
    assert (chosen[0].place, chosen[0].loose) == (7, middling)


def test_a_position_pays_for_every_value_by_half_a_log_of_the_hours():
    """Ten values of temperature's effect, three a heading of steps; costs over the residual's square above 1."""

    def evidence(hours, residual=0.5, none=80.0, temperature=40.0, steps=20.0):
        found = SimpleNamespace(none=none, temperature=temperature, steps=steps, residual=residual)
        return _log_evidence(SimpleNamespace(model=SimpleNamespace(evidence=found, hours=hours, headings=4)))

    few, many = np.array(evidence(100.0)), np.array(evidence(700.0))
    assert few - many == pytest.approx(0.5 * math.log(7.0) * np.array([0.0, 10.0, 12.0]))
    assert evidence(0.1) == evidence(2.0)
    cheaper = np.array(evidence(100.0, none=60.0, temperature=20.0, steps=0.0))
    assert cheaper - few == pytest.approx([10.0] * 3)
    scaled = np.array(evidence(100.0, residual=2.0, none=60.0, temperature=20.0, steps=0.0))
    assert np.array(evidence(100.0, residual=2.0)) - scaled == pytest.approx([-2.5] * 3)


def place_of(p_value, **changed):
    return replace(Place("shock", "run", "5..9 min", 0.5, 1.0, 4.0, p_value), **changed)


@pytest.mark.parametrize(
    ("p_value", "rms", "causes", "explained", "verdict"),
    [
        (0.5, 1.0, "c", 1.0, "no gap"),
        (1e-6, 0.1, "c", 1.0, "within the model's accuracy"),
        (1e-6, 0.22, "c", 1.0, "no gap"),
        (1e-6, 1.0, "", 0.0, "unknown"),
        (1e-6, 1.0, "c", 0.9, "explained"),
        (1e-6, 1.0, "c", 0.5, "explained in part"),
    ],
)
def test_the_verdict_on_a_channel(p_value, rms, causes, explained, verdict):
    data = SimpleNamespace(places=[place_of(0.9), place_of(p_value)], rms=rms, accuracy=0.2, digit=0.25)
    assert _verdict(data, causes, explained) == verdict


def test_what_fits_no_curve_is_told_by_the_cell_and_the_interval_where_most_is_left():
    first, second = place_of(1e-6), place_of(1e-6, profile="ramp", rms=2.0)
    regimes = [
        RegimePlace("T_in", "degC", -40.0, -30.0, 0.3, 0.5, 4.0, 1e-4),
        RegimePlace("T_in", "degC", -30.0, -20.0, 0.9, 0.5, 4.0, 0.5),
        RegimePlace("dT_in/dt", "K/min", 4.0, 8.0, 0.4, 0.5, 4.0, 1e-4),
    ]
    assert _remaining_part([place_of(0.5)], regimes) is None and _remaining_part([], []) is None
    found = _remaining_part([place_of(0.5), first, second], regimes)
    assert found.follows == "dT_in/dt"
    assert found.sentence == (
        "It shows in shock (run) at 5..9 min, 0.5 deg/h rms, most of all at dT_in/dt 4 to 8 K/min."
    )
    found = _remaining_part([first], regimes[1:2])
    assert found.follows == "none of the inputs" and found.sentence.endswith("0.5 deg/h rms.")


def test_shares_of_the_oracles_shrinkage_are_good_from_95_percent():
    found = lines(*(mark(true_share=share) for share in (0.99, 0.97, 0.95, 0.94)))
    assert found["shrinkage: at least 95 % of the oracle's", "1..30"] == (3, 4)
    assert found["shrinkage: 95 % interval holds the true shrinkage", "1..30"] == (4, 4)


def test_means_of_rows_count_by_the_time_that_they_cover():
    """Rows of 0.2 and 0.3 s in turns, of which each covers the time before it."""
    time_s = np.concatenate(([0.0], np.cumsum(np.tile([0.2, 0.3], 40))))
    steps = Steps.of(time_s, np.ones(81, dtype=bool))
    values = np.concatenate(([0.0], np.tile([2.0, 7.0], 40)))
    assert steps.period_s == pytest.approx(1.0)
    assert steps.means(values)[1:-1] == pytest.approx(
        np.full(steps.count - 2, 0.4 * 2.0 + 0.6 * 7.0), rel=0.1
    )
    weights = steps.means(values) - steps.means(np.ones(81))
    assert np.isfinite(weights).all() and steps.means(np.ones(81)).tolist() == [1.0] * steps.count


def test_the_grid_of_rows_is_their_straight_line():
    rng = np.random.default_rng(1)
    number = np.array([0, 1, 2, 4, 5, 6, 9, 10])
    time_s = 100.0 + 0.5 * number + rng.uniform(-0.02, 0.02, 8)
    line = np.polyval(np.polyfit(number, time_s, 1), number)
    on = np.diff(number).astype(float)
    assert _grid(time_s, np.zeros(7, dtype=bool), on) == pytest.approx(line, abs=1e-9)
    # behind a time that is odd another stretch begins, of the same step
    odd = number[1:] == 9
    later = time_s + np.where(number >= 9, 0.2, 0.0)
    found = _grid(later, odd, on)
    assert found[:6].mean() == pytest.approx(later[:6].mean()) and found[6:].mean() == pytest.approx(
        later[6:].mean()
    )
    assert np.diff(found)[[0, 1, 3, 4, 6]] == pytest.approx([found[1] - found[0]] * 5)


def test_a_ramp_rises_as_its_settings_say():
    """From -40 to 60 degC at a third of a kelvin a minute: five hours, the case a minute behind."""
    design = _ramp(39.1, -40.0, 60.0, 1.0 / 3.0, dwell_min=30.0)
    (s,) = design.stimuli.values()
    assert len(s) == 60 * (60 + 30 + 300 + 30) + 1300  # down at 3 K/min
    up = slice(60 * 127, 60 * 397)
    assert np.diff(s.t_out_c)[up] == pytest.approx(np.full(60 * 270, 1.0 / 180.0), rel=1e-6)
    assert (s.t_out_c.min(), s.t_out_c.max()) == (pytest.approx(-40.0, abs=0.1), pytest.approx(60.0, abs=0.1))


@pytest.mark.parametrize("resembling", [0.9, 0.01])
def test_where_no_cause_is_sure_what_resembles_one_is_unknown(monkeypatch, resembling):
    """Something is there, however little what resembles it is sure."""
    unknown = 1.0
    monkeypatch.setattr(_rate, "candidate_variants", lambda *_: effect("bias_quadratic").variants())
    rng = np.random.default_rng(1)
    runs = [made_run(name, stimulus(900), rng) for name in "ab"]
    signal, model = _rate.RateSignal(), Model("m", (), WHITE)
    data = signal.prepare(runs, model)
    sets = signal.which(data)
    pair = ("shupe", "warm_up")
    cause = Cause("shupe", "", 0.2, None, {}, one_of=pair, set_probability=resembling)
    monkeypatch.setattr(_rate, "causes_of", lambda *_: ((), (cause,)))
    monkeypatch.setattr(_rate, "set_weights", lambda _: {frozenset({"shupe"}): (0.95, 0.05)})
    found = signal.finding(data, sets)
    assert found.unknown_probability == pytest.approx(unknown, abs=0.01)
    assert found.resembles == (cause,) and not found.causes
    alone = Cause("shupe", "", resembling, None, {}, one_of=("shupe",), set_probability=resembling)
    monkeypatch.setattr(_rate, "causes_of", lambda *_: ((), (alone,)))
    assert signal.finding(data, sets).unknown_probability == pytest.approx(unknown, abs=0.01)
    monkeypatch.setattr(
        _rate, "set_weights", lambda _: {frozenset(): (0.2, 0.0), frozenset({"shupe"}): (0.8, 0.0)}
    )
    assert signal.finding(data, sets).resembles == ()  # that nothing is there is not out of the question
