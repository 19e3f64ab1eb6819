"""What is concluded from sets of effects, by hand: what they leave, what is form, weights."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.gap import Noise
from bench.analysis.gap._candidates import candidates_of, possible_candidates, series_of
from bench.analysis.gap._cells import BANDS, Cell
from bench.analysis.gap._evidence import Candidate, SetPosterior, log_bayes, search
from bench.analysis.gap._fit import MISFIT, TOLERANCE, Floor, Solution, tolerated, weighted_gram
from bench.analysis.gap._generic import free_curves
from bench.analysis.gap._judged import Judged, _missed, correcting, instead_of, less_forms, missed_beside
from bench.analysis.gap._refine import best_of_each, sets_of_note
from bench.analysis.gap._unknown import Remainder, prevalence, remainder
from bench.analysis.gap._which import _renumbered, set_weights
from simulators.effects import Effect, Variant, catalogue
from tests.analysis.gap.conftest import effect, made_run, stimulus

WHITE = Noise(0.004)
NONE = Solution(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 0)))
RUN = made_run("r", stimulus(600, rate_dps=5.0), np.random.default_rng(1))
CURVES = {each.effect.name: each for each in free_curves([RUN])}


def cell(band, count, repeatable=True, profile="p", parity="run", block=None):
    block = np.eye(2) if block is None else np.asarray(block, np.float64)
    return Cell(profile, parity, repeatable, band, count, len(block), np.arange(len(block)), block, 1.0, 100)


def support(left, expected, number):
    x = max(left / expected, 1.0)
    return max(0.5 * number * (x - 1.0 - math.log(x)) - 7.0, 0.0)


def test_what_is_left_is_held_against_noise_and_what_a_formula_may_miss():
    """By the likelihood of a free variance, cell by cell, less 7 for a few hundred cells looked at."""
    sigma = np.linspace(0.0, 0.1, len(BANDS))
    floor = Floor(np.ones(len(BANDS)), sigma, True)
    cells = [cell(0, 40.0), cell(2, 20.0), cell(5, 60.0), cell(8, 50.0, repeatable=False), cell(3, 30.0)]
    variance = np.array([1.5, 1.0, 2.0, 1.0, 1.0])
    gap = np.array([900.0, 25.0, 500.0, 800.0, 2030.0])
    left = np.array([300.0, 22.0, 90.0, 400.0, 200.0])
    found = remainder(cells, variance, gap, left, floor, np.zeros(5))
    number = np.array([each.count for each in cells])
    expected = [
        n * v * (1.03 + 2.0 * sigma[each.band]) for n, v, each in zip(number, variance, cells, strict=True)
    ]
    own = [support(x, e, n) for x, e, n in zip(left, expected, number, strict=True)]
    own[3] = 0.0  # what differs from repeat to repeat
    own[4] = 0.0  # 170 of 2000: less than a tenth stays
    assert found.log_evidence == pytest.approx(own) and own[0] > 10.0
    # the cells with a gap together: 0, 2 and 4; that of 1 is 5 beyond 20 +- 6
    clear = [0, 2, 4]
    ratio = sum(left[k] / expected[k] * number[k] for k in clear)
    whole = float(number[clear].sum())
    assert found.pooled == pytest.approx(support(ratio, whole, whole)) and found.pooled > 0.0
    assert found.total == max(sum(own), found.pooled)
    assert replace(found, pooled=1e6).total == 1e6
    beyond = [
        2.0 * (math.sqrt(2.0 * n) + n * sigma[each.band]) for n, each in zip(number, cells, strict=True)
    ]
    sure = np.maximum(left - number - beyond, 0.0)
    assert found.energy == pytest.approx(sure)
    assert found.share == pytest.approx(sure / np.maximum(gap - number, left - number))
    none = remainder(cells, variance, number, number, floor, np.zeros(5))
    assert none.total == 0.0 and none.share.tolist() == [0.0] * 5


def test_a_step_that_comes_late_leaves_its_form_and_nothing_unknown():
    """A pulse fills bands where the step has little; over all bands of its runs it is a sixteenth at most."""
    cells = [cell(0, 40.0), cell(6, 40.0), cell(6, 40.0, parity="odd")]
    gap, left = np.array([10040.0, 700.0, 700.0]), np.array([40.0, 640.0, 640.0])
    beyond = 600.0 - 2.0 * math.sqrt(80.0)
    floor = Floor(np.ones(len(BANDS)), np.zeros(len(BANDS)), True)

    def evidence(acting):
        return remainder(cells, np.ones(3), gap, left, floor, np.array([acting, 60.0, 0.0])).log_evidence

    full = support(640.0, 1.03 * 40.0, 40.0)
    least = 16.0 * beyond - 60.0
    # the other parity, in which nothing acts, speaks for itself
    assert evidence(1.001 * least) == pytest.approx([0.0, 0.0, full])
    assert evidence(0.999 * least) == pytest.approx([0.0, full, full])
    # what effects undo of each other does not count as what they do
    small = np.array([1000.0, 700.0, 700.0])
    found = remainder(cells, np.ones(3), small, left, floor, np.array([1e6, 1e6, 0.0]))
    assert found.log_evidence[1] == pytest.approx(full)
    # what repeats differ by is no part of what is left, and the cells together say no more than each
    differing = [*cells[:2], cell(6, 40.0, repeatable=False)]
    found = remainder(differing, np.ones(3), gap, left, floor, np.array([1.001 * least, 60.0, 0.0]))
    assert found.log_evidence.tolist() == [0.0, 0.0, 0.0] and found.pooled == found.total == 0.0


def test_an_effect_prevails_where_what_is_left_shows_in_runs_that_it_does_not_touch():
    """Two profiles and two parities; what differs from repeat to repeat counts nowhere."""
    rows = [
        ("a", "run", True, 0, 30.0, 5.0), ("a", "run", True, 3, 10.0, 15.0), ("a", "odd", True, 3, 0.0, 50.0),
        ("b", "run", True, 3, 20.0, 0.0), ("b", "run", False, 3, 70.0, 90.0),
    ]  # fmt: skip
    cells = [
        cell(band, 8.0, same, profile, parity, [[1.0, 0.0], [0.0, action]])
        for profile, parity, same, band, action, _ in rows
    ]
    rest = Remainder(np.zeros(5), 0.0, np.array([row[-1] for row in rows]), np.zeros(5))
    solution = Solution(np.array([1]), np.ones(1), np.zeros((0, 0)))
    # `a` has 40 of 60; `b` all of its 20: weighted by what it does
    assert prevalence(cells, np.full(5, 1e3), solution, rest) == pytest.approx((40 * 40 / 60 + 20) / 60)
    # four times the gap of 2 in each profile's cells is the most that is believed
    tight = np.full(5, 10.0)
    assert prevalence(cells, tight, solution, rest) == pytest.approx((40 * 16 / 60 + 20 * 8 / 20) / 60)


def test_formulas_of_akin_inputs_may_correct_each_other():
    def missed(one, other):
        found = [effect(name) if name in known else CURVES[name].effect for name in (one, other)]
        assert _missed(found[0], found[1]) == _missed(found[1], found[0])
        return _missed(*found)

    known = {"shupe", "bias_quadratic", "warm_up", "bias_ramp", "scale_factor", "time_offset", "clock_skew",
             "azimuth_error", "table_tilt", "saturation", "scale_factor_nonlinearity", "vibration_rectification",
             "scale_factor_asymmetry", "bias_linear", "dead_zone", "scale_factor_temperature"}  # fmt: skip
    for one, other in (
        ("shupe", "bias_quadratic"), ("warm_up", "bias_ramp"), ("time_offset", "clock_skew"),
        ("saturation", "scale_factor_nonlinearity"), ("scale_factor_asymmetry", "vibration_rectification"),
        ("free curve: bias over T_in", "bias_linear"),
        ("free curve: bias over time since power-on", "warm_up"),
    ):  # fmt: skip
        assert missed(one, other) == TOLERANCE, (one, other)
    for one, other in (
        ("scale_factor_temperature", "bias_linear"), ("warm_up", "bias_linear"), ("shupe", "azimuth_error"),
        ("free curve: bias over T_in", "warm_up"), ("saturation", "scale_factor_asymmetry"),
        ("free curve: bias over table angle", "azimuth_error"), ("dead_zone", "saturation"),
        ("time_offset", "shupe"),
    ):  # fmt: skip
        assert missed(one, other) == 0.0, (one, other)
    assert (
        0.0 < missed("azimuth_error", "table_tilt") < missed("free curve: resonance over T_in", "bias_linear")
    )
    assert missed("free curve: resonance over T_in", "bias_linear") < TOLERANCE
    # a memory that had not settled when the record began dies away as what warms up does
    assert 0.0 < missed("shupe", "warm_up") == missed("shupe", "bias_ramp") < MISFIT
    assert missed_beside(CURVES["free curve: rate over table angle"].effect) == 1.0
    for name in ("free curve: bias over table angle", "free curve: scale factor over T_in"):
        assert missed_beside(CURVES[name].effect) == TOLERANCE


EFFECTS = {name: effect(name) for name in ("bias_quadratic", "shupe", "warm_up", "bias_ramp", "bias_cubic")}


def judged(names, left, log_evidence=0.0, total=0.0, **changes):
    rest = Remainder(np.array([total]), 0.0, np.zeros(1), np.zeros(1))
    own = np.array([float(left)])
    one = Judged(
        frozenset(names), frozenset(), log_evidence, NONE, own, rest, NONE, NONE, frozenset({"curve"})
    )
    return replace(one, **changes)


def test_members_that_others_may_stand_for_are_those_of_akin_inputs_fewest_first():
    found = [set(each) for each in correcting(frozenset({"shupe", "bias_quadratic", "warm_up"}), EFFECTS)]
    assert found == [{"bias_quadratic"}, {"shupe"}, {"warm_up"}, {"bias_quadratic", "warm_up"}]
    four = frozenset({"bias_cubic", "bias_quadratic", "warm_up", "bias_ramp"})
    pairs = [set(each) for each in correcting(four, EFFECTS)]
    assert pairs[:4] == [{"bias_cubic"}, {"bias_quadratic"}, {"bias_ramp"}, {"warm_up"}]
    assert {"bias_cubic", "warm_up"} in pairs and {"warm_up", "bias_ramp"} not in pairs and len(pairs) == 8


@pytest.mark.parametrize(("gained", "stays"), [(12.0, False), (12.5, True)])
def test_a_member_that_gains_what_anothers_formula_misses_is_no_effect(gained, stays):
    """0.35 squared of the 100 that every effect takes away; the smaller set inherits what the larger has."""

    def without(one, names):
        return one.left + 100.0 * len(names)

    larger = judged({"bias_quadratic", "shupe"}, 50.0 - gained, 9.0, total=1.0, in_form="larger")
    smaller = judged({"bias_quadratic"}, 50.0, 2.0, total=3.0, in_form="smaller")
    apart = judged({"warm_up"}, 70.0, 1.0)
    found = {one.names: one for one in less_forms([smaller, apart, larger], without, EFFECTS)}
    assert (larger.names in found) is stays and found[apart.names] == apart
    heir = found[smaller.names]
    if stays:
        assert heir == smaller and found[larger.names] == larger
    else:
        assert (heir.log_evidence, heir.rest.total, heir.in_form) == (9.0, 1.0, "larger")
        worse = replace(larger, log_evidence=1.0, rest=replace(larger.rest, pooled=5.0))
        (heir,) = less_forms([smaller, worse], without, EFFECTS)
        assert (heir.log_evidence, heir.rest.total, heir.in_form) == (2.0, 3.0, "smaller")


def test_of_smaller_sets_that_leave_as_little_the_one_that_leaves_least_inherits():
    def without(one, names):
        return one.left + 100.0 * len(names)

    larger = judged({"bias_quadratic", "bias_cubic"}, 48.0, 9.0)
    one, other = judged({"bias_quadratic"}, 55.0, 1.0), judged({"bias_cubic"}, 52.0, 0.0)
    found = {
        min(each.names): each.log_evidence for each in less_forms([one, larger, other], without, EFFECTS)
    }
    assert found == {"bias_quadratic": 1.0, "bias_cubic": 9.0}
    three = judged({"bias_quadratic", "bias_cubic", "shupe"}, 47.0, 12.0)
    found = {min(each.names): each.log_evidence for each in less_forms([one, three, other], without, EFFECTS)}
    assert found == {"bias_quadratic": 1.0, "bias_cubic": 12.0}


def test_what_corrects_a_set_that_corrects_another_comes_to_the_last_of_them():
    def without(one, names):
        return one.left + 100.0 * len(names)

    three = judged({"bias_quadratic", "bias_cubic", "shupe"}, 40.0, 12.0)
    two, one = judged({"bias_quadratic", "bias_cubic"}, 50.0, 5.0), judged({"bias_quadratic"}, 60.0, 1.0)
    for sets in ((one, two, three), (three, one, two)):
        (heir,) = less_forms(sets, without, EFFECTS)
        assert (heir.names, heir.log_evidence) == (one.names, 12.0)


def test_the_best_set_with_an_effect_in_a_curves_place_has_all_the_rest():
    sets = {
        frozenset(names): value
        for names, value in (
            (("curve", "a"), 50.0), (("b", "a"), 3.0), (("c", "a"), 7.0), (("d",), 40.0), (("c",), 30.0),
            (("b", "c", "a"), 60.0), (("other curve", "a"), 45.0), (("a",), 1.0), (("b", "c"), 44.0),
        )
    }  # fmt: skip
    curves = frozenset({"curve", "other curve"})
    assert instead_of("curve", frozenset({"curve", "a"}), sets, curves) == {"c", "a"}
    assert instead_of("curve", frozenset({"curve"}), sets, curves) == {"d"}
    assert instead_of("curve", frozenset({"curve", "e"}), sets, curves) is None
    assert instead_of("a", frozenset({"curve", "a"}), sets, curves) is None


def test_something_is_missing_as_probably_as_what_is_left_says():
    """Log odds of what is left and of a line, less 5; beside a curve for sure."""
    one = judged({"a"}, 0.0, total=4.0)
    assert one.unknown == pytest.approx(1.0 / (1.0 + math.e)) and not one.remains and not one.curved
    lined = replace(one, line=2.0)
    assert lined.unknown == pytest.approx(1.0 / (1.0 + math.exp(-1.0))) and lined.remains
    assert not replace(one, line=1.0).remains
    curved = judged({"a", "curve"}, 0.0)
    assert curved.curved and curved.unknown == 1.0 and not curved.remains


def test_weights_of_sets_sum_to_one_and_a_twentieth_of_each_is_unseen():
    sets = [judged({"a"}, 0.0, 10.0, -1e3), judged({"b"}, 0.0, 9.0, 5.0), judged({"curve"}, 0.0, 8.0)]
    found = set_weights(sets)
    total = 1.0 + math.exp(-1.0) + math.exp(-2.0)
    assert [sum(each) for each in found.values()] == pytest.approx([math.exp(-k) / total for k in range(3)])
    whole = {min(names): both[1] / sum(both) for names, both in found.items()}
    assert whole["curve"] == 1.0 and whole["a"] == pytest.approx(0.05, abs=0.02)
    assert whole["b"] == pytest.approx(0.5 + 0.5 * 0.05, abs=0.01)


def test_columns_of_the_best_set_are_found_among_those_kept():
    """Candidates of 2, 1 and 3 columns behind data and two nominal columns; the first is not kept."""
    candidates = (Candidate("a", 0, (1, 2), 1), Candidate("b", 1, (3,), 1), Candidate("c", 2, (4, 5, 6), 1))
    solution = Solution(np.array([1, 2, 6, 7, 8, 5]), np.arange(6.0), np.eye(6))
    found = SimpleNamespace(
        best=SimpleNamespace(solution=solution), posterior=SimpleNamespace(candidates=candidates)
    )
    own = _renumbered(found, [1, 2], 2)
    assert own.indices.tolist() == [1, 2, 4, 5, 6, 3] and own.values.tolist() == list(range(6))
    assert _renumbered(found, [2, 1], 2).indices.tolist() == [1, 2, 3, 4, 5, 6]


def test_effects_that_cannot_be_seen_are_told_why():
    """A column is seen if its bound stands five noise deviations out, less what the nominal can imitate."""
    variants = [effect(name).variants()[0] for name in ("bias_quadratic", "shupe", "warm_up", "bias_ramp")]
    candidates = [
        Candidate("bias_quadratic", 0, (1,), 1), Candidate("shupe", 1, (2, 3), 1),
        Candidate("warm_up", 2, (4,), 1), Candidate("bias_ramp", 3, (5,), 1),
    ]  # fmt: skip
    bound = [max(-p.low, p.high) for each in variants for p in each.effect.parameters]
    apart = np.array([0.0, (5.1 / bound[0]) ** 2, 0.0, (5.1 / bound[2]) ** 2, (4.9 / bound[3]) ** 2, 1e6])
    gram = np.diag(np.concatenate((apart[:1], [7.0, 7.0], apart[1:])))
    gram[7, 7] = 2e12
    possible, reasons = possible_candidates(np.diag(apart), gram, candidates, variants, 2, 1.0)
    assert possible == [0, 1]
    assert reasons == {
        "warm_up": f"{variants[2].effect.follows} does not change within any run",
        "bias_ramp": "cannot be told from the nominal model's own terms in these runs",
    }
    coarse, reasons = possible_candidates(np.diag(apart), gram, candidates, variants, 2, 1.1)
    assert coarse == [0, 1, 2] and list(reasons) == ["bias_ramp"]
    again = [*candidates, Candidate("warm_up", 2, (6,), 2)]
    wide = np.diag([*apart, 1e6])
    both = np.diag([*np.diag(gram), 1e6])
    possible, reasons = possible_candidates(wide, both, again, [*variants, variants[2]], 2, 1.0)
    assert possible == [0, 1, 4] and list(reasons) == ["bias_ramp"]


def test_every_set_pays_for_its_columns_its_grid_and_how_many_effects_there_are():
    """Independent columns of length 1 with data of 9, 7 and 5 along them; `c` has a column of noughts beside."""
    system = np.diag([200.0, 1.0, 1.0, 1.0, 0.0])
    system[0, 1:4] = system[1:4, 0] = (9.0, 7.0, 5.0)
    candidates = [
        Candidate("a", 0, (1,), 4, log_odds=-1.0), Candidate("b", 1, (2,), 1), Candidate("c", 2, (3, 4), 2),
    ]  # fmt: skip
    found = search(system, candidates, [0, 1, 2]).log_evidence
    one = math.log(0.5 / 3.0)
    assert found[frozenset()] == math.log(0.5)
    assert found[frozenset({0})] == pytest.approx(log_bayes(81.0, 1) + one - math.log(4.0) - 1.0, abs=1e-3)
    assert found[frozenset({1})] == pytest.approx(log_bayes(49.0, 1) + one, abs=1e-3)
    assert found[frozenset({2})] == pytest.approx(log_bayes(25.0, 1) + one - math.log(2.0), abs=1e-3)
    pair = found[frozenset({0, 1})] - (log_bayes(130.0, 2) + 2.0 * one - math.log(4.0) - 1.0)
    triple = found[frozenset({0, 1, 2})] - (log_bayes(155.0, 3) + 3.0 * one - math.log(8.0) - 1.0)
    assert pair < -1.0 and triple == pytest.approx(2.0 * pair, abs=1e-3)
    two = search(system, candidates, [0, 1]).log_evidence
    assert two[frozenset({1})] == pytest.approx(log_bayes(49.0, 1) + math.log(0.25), abs=1e-3)
    assert not any(2 in members for members in two)


def test_a_further_term_of_a_power_series_costs_no_further_mechanism():
    """`a` and `b` are terms of one series, `c` is not: what is curved is one thing, as likely bent as not."""
    system = np.diag([300.0, 1.0, 1.0, 1.0])
    system[0, 1:] = system[1:, 0] = (9.0, 7.0, 5.0)
    candidates = [
        Candidate("a", 0, (1,), 1, series="T"),
        Candidate("b", 1, (2,), 3, series="T"),
        Candidate("c", 2, (3,), 1),
    ]
    found = search(system, candidates, [0, 1, 2]).log_evidence
    apart = search(system, [replace(each, series=None) for each in candidates], [0, 1, 2]).log_evidence
    one, half = math.log(0.5 / 3.0), math.log(0.5)
    expected = log_bayes(130.0, 2) + one + half - math.log(3.0)
    assert found[frozenset({0, 1})] == pytest.approx(expected, abs=1e-3)
    for single in ({0}, {1}, {2}):
        assert found[frozenset(single)] == apart[frozenset(single)]
    assert found[frozenset({0, 2})] == apart[frozenset({0, 2})]
    # with `c` beside them it is two mechanisms, not three
    price = found[frozenset({0, 2})] - log_bayes(106.0, 2)
    assert found[frozenset({0, 1, 2})] == pytest.approx(
        log_bayes(155.0, 3) + price + half - math.log(3.0), abs=1e-3
    )


def test_power_series_are_those_of_one_temperature_and_of_even_rates():
    series = {}
    for name, each in catalogue().items():
        if isinstance(each, Effect) and (own := series_of(each)) is not None:
            series.setdefault(own, set()).add(name)
    alike = {frozenset(names) for names in series.values() if len(names) > 1}
    assert alike == {
        frozenset({"bias_linear", "bias_quadratic", "bias_cubic"}),
        frozenset({"scale_factor_temperature", "scale_factor_quadratic"}),
        frozenset({"scale_factor_asymmetry", "vibration_rectification"}),
    }
    free = free_curves([made_run("a", stimulus(2000), np.random.default_rng(0))])[0]
    curve, term = candidates_of([free, Variant(effect("bias_cubic"), {"lag_s": 0.0})])
    assert (curve.series, term.series) == (None, effect("bias_quadratic").curve)


def test_of_every_effect_the_three_best_points_of_its_grid_are_kept():
    candidates = tuple(Candidate("a" if k < 5 else "b", k, (k + 1,), 5) for k in range(6))
    evidence = {frozenset({k}): value for k, value in enumerate((1.0, 5.0, 3.0, 4.0, 2.0, -9.0))}
    posterior = SetPosterior(candidates, evidence | {frozenset({0, 5}): 9.0, frozenset(): 0.0})
    assert best_of_each(posterior) == [0, 1, 3, 5]
    assert sets_of_note(posterior, 5.0, 3) == [frozenset({0, 5}), frozenset({1})]
    assert sets_of_note(posterior, 4.0, 3) == [frozenset({0, 5})]
    assert sets_of_note(posterior, 99.0, 2) == [frozenset({0, 5}), frozenset({1})]
    assert posterior.by_effects()[frozenset({"a"})] == pytest.approx(
        math.log(sum(math.exp(value) for value in (1.0, 5.0, 3.0, 4.0, 2.0)))
    )


def test_cells_of_one_group_are_weighted_by_their_variance():
    rng = np.random.default_rng(1)
    blocks = [own @ own.T for own in rng.normal(size=(3, 2, 9))]
    at = np.array([0, 2])
    cells = [replace(cell(3, 9.0, block=block), columns=4, at=at) for block in blocks[:2]]
    cells.append(replace(cell(3, 9.0, block=blocks[2]), columns=4, at=np.array([0, 3])))
    found = weighted_gram(cells, np.array([2.0, 4.0, 5.0]))
    expected = np.zeros((4, 4))
    expected[np.ix_(at, at)] = blocks[0] / 2.0 + blocks[1] / 4.0
    expected[np.ix_([0, 3], [0, 3])] += blocks[2] / 5.0
    assert found == pytest.approx(expected)
    assert cells[0].products(np.array([2, 3, 0]))[[0, 0, 2], [0, 2, 2]] == pytest.approx(
        [blocks[0][1, 1], blocks[0][1, 0], blocks[0][0, 0]]
    )
    assert cells[0].products(np.array([2, 3, 0]))[1].tolist() == [0.0] * 3
    lone = [cell(3, 10.0), cell(5, 20.0), cell(6, 20.0)]
    assert tolerated(lone, np.array([5.0, 120.0, 20.0]), 0.5) == pytest.approx(
        [1.0, 1.0 + 0.25 * 100.0 / 20.0, 1.0 + 0.25 * 40.0 / 20.0]
    )
    assert tolerated(lone, np.array([5.0, 120.0, 20.0]), 0.5, 4.0)[1] == 1.0 + 0.25 * 100.0 / 4.0
