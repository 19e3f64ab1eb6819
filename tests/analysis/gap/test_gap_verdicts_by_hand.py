"""Causes, doubts, verdicts and warnings on the rate, by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.gap import Model, Noise, Shrinkage, Term
from bench.analysis.gap._causes import (
    _fitted,
    _genuine,
    _mechanisms,
    _nameable,
    _one_of,
    _rivals,
    causes_of,
    models_with_and_without,
)
from bench.analysis.gap._data import Group
from bench.analysis.gap._diagnose import Diagnosis, closed_model, diagnose
from bench.analysis.gap._disturbed import Disturbed
from bench.analysis.gap._evidence import Candidate, SetPosterior
from bench.analysis.gap._findings import Cause, rivals_of
from bench.analysis.gap._fit import Floor, Solution, solve
from bench.analysis.gap._judged import Judged, same_driver
from bench.analysis.gap._learn import Learned
from bench.analysis.gap._model_file import model_text, parse_model
from bench.analysis.gap._rate import (
    RateFinding,
    _by_repeat,
    _constant,
    _doubted,
    _shaken,
    _stochastic,
    _verdict,
)
from bench.analysis.gap._remarks import of_floor, of_nominal
from bench.analysis.gap._stochastic import NoiseVerdict
from bench.analysis.gap._unknown import Remainder
from bench.analysis.gap._which import set_weights
from simulators.effects import Variant
from tests.analysis.gap.conftest import effect, made_run, stimulus
from tests.analysis.gap.test_gap_judgements_by_hand import cell

WHITE = Noise(0.004)
RUN = made_run("r", stimulus(600, rate_dps=5.0), np.random.default_rng(1))


WEIGHTS = {
    frozenset({"a"}): (0.3, 0.15), frozenset({"b"}): (0.2, 0.06), frozenset({"c"}): (0.12, 0.0),
    frozenset({"a", "d"}): (0.0, 0.1), frozenset({"curve"}): (0.0, 0.07),
}  # fmt: skip


def test_a_name_stands_for_all_that_could_be_in_its_place_until_one_surely_acts():
    assert _one_of("a", {"b": 0.3, "c": 0.1, "d": 0.05}, WEIGHTS) == ("a", "b", "c")
    assert _one_of("a", {"b": 0.3}, WEIGHTS) == ("a", "b") and _one_of("a", {}, WEIGHTS) == ("a",)
    sure = {frozenset({"a"}): (0.5, 0.4), frozenset({"b"}): (0.1, 0.0)}
    assert _one_of("a", {"b": 0.1}, sure) == ("a",)
    assert _nameable(("a", "b"), WEIGHTS) and not _nameable(("a",), WEIGHTS)
    assert _nameable(("a", "b", "c", "d"), WEIGHTS) and not _nameable(("a", "b", "c", "d", "e"), WEIGHTS)


def test_rivals_are_the_sets_with_another_effect_in_the_same_place():
    """Beside an `a` of 0.45 `b` has 0.26 and `c` 0.12; the curve is none, and `a` beside `d` has no rival."""
    assert _rivals("a", frozenset({"a"}), WEIGHTS, frozenset({"curve"})) == pytest.approx(
        {"b": 0.26 / 0.83, "c": 0.12 / 0.83}
    )
    assert list(_rivals("c", frozenset({"c"}), WEIGHTS, frozenset({"curve"}))) == ["a", "b"]
    assert _rivals("d", frozenset({"a", "d"}), WEIGHTS, frozenset({"curve"})) == {}
    two = {frozenset({"a", "x"}): 96.0, frozenset({"b", "x"}): 2.0, frozenset({"c", "x"}): 2.1,
           frozenset({"b"}): 99.0}  # fmt: skip
    assert rivals_of("a", frozenset({"a", "x"}), two) == pytest.approx({"c": 2.1 / 100.1})


VARIANTS = [effect(name).variants()[0] for name in ("bias_quadratic", "shupe", "warm_up")]
CANDIDATES = (
    Candidate("bias_quadratic", 0, (1,), 1), Candidate("shupe", 1, (2, 3), 1), Candidate("warm_up", 2, (4,), 1),
)  # fmt: skip
MODEL = Model("m", (Term(effect("bias_linear").variants()[0], (0.0,), (0.3,)),), WHITE)


def found_of(weights, rows, *, names=("shupe", "warm_up"), energy=0.0):
    """A search that found shupe's effect and a warm-up in one cell of rows [data, nominal, columns]."""
    gram = rows @ rows.T
    cells = [cell(3, 60.0, block=gram)]
    places = {"bias_quadratic": [2], "shupe": [3, 4], "warm_up": [5]}
    sets = []
    for own, both in weights.items():
        members = frozenset(k for k, one in enumerate(CANDIDATES) if one.effect in own)
        columns = [column for name in sorted(own, key=list(places).index) for column in places[name]]
        solution = solve(gram, MODEL.sigmas, columns)
        total = math.log((both[1] + 1e-12) / (both[0] + 1e-12))
        sets.append(
            Judged(own, members, math.log(sum(both)), solution, np.array([60.0]),
                   Remainder(np.array([total + 5.0]), 0.0, np.array([energy]), np.zeros(1)),
                   solution, solution, frozenset())
        )  # fmt: skip
    best = next(one for one in sets if one.names == frozenset(names))
    posterior = SetPosterior(CANDIDATES, {one.members: one.log_evidence for one in sets})
    return SimpleNamespace(
        data=SimpleNamespace(cells=cells, noise=SimpleNamespace(noise=WHITE)), variance=np.ones(1),
        before=np.array([1e4]), posterior=posterior, judged=sets, best=best,
    )  # fmt: skip


def rows_of(seed=1):
    rng = np.random.default_rng(seed)
    columns = rng.normal(size=(5, 60)) * np.array([1.0, 2.0, 3.0, 4.0, 5.0])[:, None]
    return np.concatenate(
        ((np.array([0.5, 0.0, 3.0, -1.0, 2.0]) @ columns + rng.normal(size=60))[None], columns)
    )


def genuine(term, unknown=False):
    """How sure a cause is with nothing left where it acts: by its standard deviations, 20 at most."""
    sigmas = max(abs(value) / sigma for value, sigma in zip(term.values, term.sigmas, strict=True))
    return 1.0 / (1.0 + math.exp(-(1.1 + 1.7 * math.log(min(sigmas, 20.0) / 10.0) + 0.9 - 0.5 * unknown)))


def test_a_cause_is_as_sure_as_its_size_what_is_left_and_the_unknown_beside_it_make_it():
    def sure(sigmas, left, unknown=0.0):
        return _genuine(Term(VARIANTS[1], (0.1, -2.0), (1.0, 2.0 / sigmas)), 1.0 - left, unknown)

    assert sure(10.0, 0.01) == pytest.approx(1.0 / (1.0 + math.exp(-1.1)))
    twice = 1.0 / (1.0 + math.exp(-1.1 - 1.7 * math.log(2.0)))
    assert sure(20.0, 0.01) == sure(90.0, 0.01) == pytest.approx(twice)
    assert sure(10.0, 0.001) == sure(10.0, 0.0) == pytest.approx(1.0 / (1.0 + math.exp(-2.0)))
    assert sure(10.0, 0.1, 0.6) == pytest.approx(1.0 / (1.0 + math.exp(0.3)))
    assert sure(3.0, 0.01) == sure(1.0, 0.01) < 0.3 < sure(5.0, 0.01) < 0.5


def late_and_settling(time_s, stretch=1.0, lag_s=250.0, other="thermal_lag"):
    late = next(each for each in effect(other).variants() if "lag_s" in each.shape)
    late = Variant(late.effect, {**late.shape, "lag_s": lag_s})
    settling = Variant(effect("warm_up"), {"time_constant_s": time_s, "stretch": stretch})
    causes = [
        Cause(each.effect.name, "", 0.9, Term(each, (1.0,) * len(each.effect.parameters), (0.1,)), {},
              one_of=(each.effect.name,), set_probability=0.9)
        for each in (settling, late)
    ]  # fmt: skip
    return _mechanisms(causes, {}, {"warm_up": 5.0, other: 1.0}, {"warm_up": 1.0, other: 1.0})


@pytest.mark.parametrize(("time_s", "stretch"), [(250.0, 1.0), (130.0, 1.0), (480.0, 0.98)])
def test_what_settles_with_the_lag_of_something_late_is_how_its_body_starts(time_s, stretch):
    (one,) = late_and_settling(time_s, stretch)
    assert one.name == "thermal_lag" and [term.name for term in one.terms] == ["thermal_lag", "warm_up"]
    assert one.one_of == ("thermal_lag",) and one.probability == 0.9


@pytest.mark.parametrize(
    ("time_s", "stretch", "other"),
    [(120.0, 1.0, "thermal_lag"), (510.0, 1.0, "thermal_lag"), (250.0, 0.9, "thermal_lag"),
     (250.0, 1.0, "scale_factor_lag")],
)  # fmt: skip
def test_what_settles_otherwise_or_in_another_unit_is_a_cause_of_its_own(time_s, stretch, other):
    assert {each.name for each in late_and_settling(time_s, stretch, other=other)} == {"warm_up", other}


def test_what_only_may_be_an_effect_is_not_named():
    """Beside something unknown a cause of three standard deviations is true less often than not."""
    rows = rows_of()
    rows[0] = 2.0 * rows[5] + 3.3 * rows[4] / np.linalg.norm(rows[4])
    for both, named_too in (((1.0, 0.0), True), ((0.0, 1.0), False)):
        named, doubtful = causes_of(found_of({frozenset({"shupe", "warm_up"}): both}, rows), VARIANTS, MODEL)
        weak = next(each for each in (*named, *doubtful) if each.name == "shupe")
        assert (weak in named) is named_too
        assert "warm_up" in [each.name for each in named]


def test_causes_have_values_and_probability_of_their_sets_and_rivals_fitted_in_their_place():
    rows = rows_of()
    weights = {
        frozenset({"shupe", "warm_up"}): (0.7, 0.05), frozenset({"bias_quadratic", "warm_up"}): (0.2, 0.05)
    }  # fmt: skip
    found = found_of(weights, rows)
    named, doubtful = causes_of(found, VARIANTS, MODEL)
    assert [cause.name for cause in named] == ["shupe", "warm_up"] and not doubtful
    shupe, warm_up = named
    own = set_weights(found.judged)
    first = sum(own[frozenset({"shupe", "warm_up"})])
    assert shupe.probability == pytest.approx(genuine(shupe.term) * first)
    assert warm_up.probability == pytest.approx(genuine(warm_up.term))
    assert shupe.alternatives == pytest.approx({"bias_quadratic": 1.0 - first}) and not warm_up.alternatives
    assert shupe.one_of == ("shupe", "bias_quadratic") and warm_up.one_of == ("warm_up",)
    assert shupe.set_probability == pytest.approx(genuine(shupe.term)) and shupe.credibility == 1.0
    whole = np.concatenate((rows[[1, 3, 4, 5]].T, [[1.0 / 0.3, 0, 0, 0]]))
    values = np.linalg.lstsq(whole, np.append(rows[0], 0.0), rcond=None)[0]
    sigmas = np.sqrt(np.diag(np.linalg.inv(whole.T @ whole)))
    assert shupe.term.values == pytest.approx(tuple(values[1:3]), rel=1e-6)
    assert shupe.term.sigmas == pytest.approx(tuple(sigmas[1:3]), rel=1e-6)
    assert (shupe.term.variant, shupe.meaning) == (VARIANTS[1], VARIANTS[1].effect.meaning)
    whole = np.concatenate((rows[[1, 2, 5]].T, [[1.0 / 0.3, 0, 0]]))
    values = np.linalg.lstsq(whole, np.append(rows[0], 0.0), rcond=None)[0]
    rival = shupe.rivals["bias_quadratic"]
    assert rival.values == pytest.approx((values[1],), rel=1e-6) and rival.variant == VARIANTS[0]
    assert _fitted(2, found.best.solution, found, VARIANTS, 1) == warm_up.term


@pytest.mark.parametrize(("alike", "each"), [(0.0, (4.0, 0.0)), (1.0, (2.0, 2.0))])
def test_of_what_the_runs_do_not_bound_the_bounds_are_known(alike, each):
    """A column of nothing adds nothing; of two alike only the sum shows, 4, which is shared."""
    found = found_of({frozenset({"shupe", "warm_up"}): (1.0, 0.0)}, rows_of())
    columns = np.array([[1.0, 0.0], [alike, 1e-5]])
    covariance = np.linalg.inv(columns @ columns.T)
    values = covariance @ columns @ np.array([4.0, 1e-3])
    indices = np.array([column + 1 for column in CANDIDATES[1].columns])
    term = _fitted(1, Solution(indices, values, covariance), found, VARIANTS, 1)
    low, high = (
        np.array(bound) for bound in zip(*(p.bounds(1.0) for p in term.effect.parameters), strict=True)
    )
    assert high - low == pytest.approx((high - low)[0])
    assert term.values == pytest.approx(each, abs=1e-3)
    hidden = [False, True] if not alike else [True, True]
    assert [s == h for s, h in zip(term.sigmas, high - low, strict=True)] == hidden
    assert ("not to be seen" in term.fitted(1.0, "+-").split(", ")[0]) is hidden[0]
    model = replace(MODEL, terms=(term,))
    assert parse_model(model_text(model), "closed").terms[0].values == pytest.approx(term.values)


def test_effects_of_one_driver_are_one_cause_with_the_weaker_one_as_its_form():
    """Columns of sizes 2 and 4 with values 1 and 3: the second does (4 * 3)^2 of (2 * 1)^2 + (4 * 3)^2."""
    rng = np.random.default_rng(3)
    basis = np.linalg.qr(rng.normal(size=(60, 3)))[0].T
    nominal, weak, strong = 60.0 * basis[0], 2.0 * basis[1], 4.0 * basis[2]
    rows = np.stack((20.0 * weak + 60.0 * strong, nominal, weak, strong))
    variants = [effect(name).variants()[0] for name in ("cold_stress", "shupe_cross")]
    candidates = (Candidate("cold_stress", 0, (1,), 1), Candidate("shupe_cross", 1, (2,), 1))
    gram, names = rows @ rows.T, frozenset({"cold_stress", "shupe_cross"})
    solution = solve(gram, MODEL.sigmas, [2, 3])
    rest = Remainder(np.array([-9.0]), 0.0, np.array([0.0]), np.zeros(1))
    judged = Judged(
        names, frozenset({0, 1}), 0.0, solution, np.array([60.0]), rest, solution, solution, frozenset()
    )
    found = SimpleNamespace(
        data=SimpleNamespace(cells=[cell(3, 60.0, block=gram)], noise=SimpleNamespace(noise=WHITE)),
        variance=np.ones(1), before=np.array([1e4]),
        posterior=SetPosterior(candidates, {judged.members: 0.0}), judged=[judged], best=judged,
    )  # fmt: skip
    (one,), doubtful = causes_of(found, variants, MODEL)
    assert not doubtful and one.name == "shupe_cross" and one.one_of == ("shupe_cross", "cold_stress")
    assert [term.name for term in one.terms] == ["shupe_cross", "cold_stress"] and one.effects == names
    assert [term.values[0] for term in one.terms] == pytest.approx([60.0, 20.0], rel=1e-6)
    assert one.set_probability == pytest.approx(genuine(one.term))
    assert one.probability == pytest.approx(genuine(one.term) * 240.0**2 / (240.0**2 + 40.0**2), rel=1e-6)


def test_models_without_a_cause_lack_all_that_is_fitted_for_it():
    found = found_of({frozenset({"shupe", "warm_up"}): (1.0, 0.0)}, rows_of())

    def names(among, gone):
        models = models_with_and_without(found, VARIANTS, MODEL, gone, among)
        return [[term.name for term in model.terms] for model in models]

    both = {"shupe", "warm_up"}
    assert names(both, [{"shupe"}, both]) == [
        ["bias_linear", "shupe", "warm_up"], ["bias_linear", "warm_up"], ["bias_linear"]
    ]  # fmt: skip
    assert names({"shupe"}, []) == [["bias_linear", "shupe"]]


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("cold_stress", "shupe_cross", True), ("bias_quadratic", "bias_cubic", True),
        ("scale_factor_asymmetry", "vibration_rectification", True), ("thermal_lag", "relaxation", True),
        ("saturation", "scale_factor_nonlinearity", True), ("shupe", "gradient", False),
        ("table_wobble_once", "table_wobble_twice", False), ("dead_zone", "saturation", False),
        ("bias_quadratic", "scale_factor_quadratic", False), ("azimuth_error", "table_tilt", False),
    ],
)  # fmt: skip
def test_one_driver_is_the_same_input_or_the_same_parity_in_the_rate(one, other, same):
    assert same_driver(effect(one), effect(other)) is same is same_driver(effect(other), effect(one))


@pytest.mark.parametrize(
    ("unknown", "left", "prevalent"), [(0.9, 1e9, False), (0.9, 0.0, True), (0.3, 1e9, True)]
)
def test_beside_something_unknown_a_cause_does_most_of_what_is_there(unknown, left, prevalent):
    weights = {frozenset({"shupe", "warm_up"}): (1.0 - unknown, unknown)}
    named, doubtful = causes_of(found_of(weights, rows_of(), energy=left), VARIANTS, MODEL)
    assert [cause.name for cause in (named if prevalent else doubtful)] == ["shupe", "warm_up"]
    assert len(named) + len(doubtful) == 2


def test_beside_something_unknown_a_cause_is_more_probable_than_four_fifths():
    for share, sure in ((0.85, True), (0.7, False)):
        weights = {
            frozenset({"shupe", "warm_up"}): (0.0, share), frozenset({"warm_up"}): (0.0, 1.0 - share)
        }  # fmt: skip
        named, doubtful = causes_of(found_of(weights, rows_of()), VARIANTS, MODEL)
        assert ("shupe" in {cause.name for cause in named}) is sure
        assert {cause.name for cause in (*named, *doubtful)} == {"shupe", "warm_up"}


def cause(name, probability=0.9):
    variant = effect(name).variants()[0]
    term = Term(variant, (1.0,) * len(variant.effect.parameters), (0.1,) * len(variant.effect.parameters))
    return Cause(name, "", probability, term, {})


def finding(**changes):
    verdict = NoiseVerdict(WHITE, {"": 1.0}, "repeats", {}, WHITE)
    causes = (cause("shupe", 0.8), cause("warm_up", 0.7))
    fields = {
        "signal": "rate", "unit": "deg/h", "verdict": "explained", "causes": causes,
        "terms": tuple(each.term for each in causes), "model": Model("m", (), WHITE), "resembles": (),
        "unknown_probability": 0.1, "null_probability": 0.0, "set_probabilities": {},
        "disturbed": Disturbed([], (), {}, {"impulses": "They click."}), "noise": verdict,
        "floor": Floor(np.ones(1), np.ones(1), True), "phases": (), "regimes": (), "unidentifiable": {},
        "unknown_parts": (), "latitude_deg": 39.1,
    }  # fmt: skip
    return RateFinding(**(fields | changes))


def test_a_cause_of_which_less_than_half_is_there_is_no_longer_named():
    whole = finding(warnings=("before",))
    assert _doubted(whole, [0.5, math.nan], "here") is whole
    less = _doubted(whole, [0.49, 0.9], "in every repeat")
    assert [each.name for each in less.causes] == ["warm_up"] and less.terms == whole.terms[1:]
    assert [each.name for each in less.resembles] == ["shupe"] and less.verdict == "explained in part"
    assert less.unknown_probability == 0.8
    assert less.warnings == ("before", "not named, less than half of it is there in every repeat: shupe")
    none = _doubted(replace(whole, unknown_probability=0.95), [-1.0, 0.0], "here")
    assert (none.causes, none.verdict, none.unknown_probability) == ((), "unknown", 0.95)
    assert none.warnings[-1].endswith("here: shupe, warm_up") and none.terms == ()


def test_a_closed_model_has_causes_learned_terms_and_disturbances():
    line = SimpleNamespace(name="vibration_or_mains_line")
    whole = finding(disturbed=Disturbed([], (line,), {}, {}))
    assert whole.closing == ("shupe", "warm_up", "vibration_or_mains_line")
    terms = (cause("shupe").term,)
    with_learned = replace(whole, learned=Learned(terms, nominal=(cause("bias_linear").term,)))
    assert with_learned.closing == ("shupe", "warm_up", "learned", "vibration_or_mains_line")
    assert with_learned.nominal.terms == (cause("bias_linear").term,)
    assert replace(whole, learned=Learned()).closing == whole.closing
    assert replace(whole, learned=Learned()).nominal is whole.model
    assert finding().size_of("impulses") == "They click." and finding().size_of("noise_level") == ""


def test_verdicts_on_the_rate():
    still = [made_run("r", stimulus(600, cold=False), np.random.default_rng(1))]
    assert _verdict(False, 0.9, still, 0.0) == "nothing to identify"
    assert _verdict(True, 0.1, still, 0.0) == "explained" and _verdict(False, 0.9, still, 0.5) == "unknown"
    for named, unknown, verdict in (
        (True, 0.51, "explained in part"), (False, 0.51, "unknown"), (True, 0.5, "explained"),
        (False, 0.5, "no gap"),
    ):  # fmt: skip
        assert _verdict(named, unknown, [RUN], 0.0) == verdict


def test_nothing_changes_within_two_kelvin_a_hundredth_of_a_rate_half_a_degree_up_and_one_about():
    s = stimulus(600, cold=False)

    def constant(**changes):
        return _constant([replace(RUN, stimulus=replace(s, **own)) for own in ({}, changes)])

    half = np.arange(600) < 300
    edges = np.arange(601.0)
    assert constant() and constant(t_in_c=s.t_in_c + 1.9) and not constant(t_in_c=s.t_in_c + 2.1)
    assert constant(angle_deg=s.angle_deg + 360.9) and not constant(angle_deg=s.angle_deg + 1.1)
    assert constant(angle_deg=10.0 + 0.9 * edges / 600) and not constant(angle_deg=10.0 + 0.011 * edges)
    assert constant(elevation_deg=s.elevation_deg - 0.4 * half) and not constant(
        elevation_deg=s.elevation_deg - 0.6 * half
    )


def test_noise_of_quantisation_in_a_log_of_finer_steps_is_a_base_that_shakes():
    def verdict(name, quantum=1.0):
        probabilities = {"": 0.1, name: 0.9}
        return NoiseVerdict(Noise(0.004, quantum_arcsec=quantum), probabilities, "repeats", {}, WHITE)

    runs = [replace(RUN, finest_arcsec=each, lost_fraction=2e-4 * each) for each in (0.05, 0.19)]
    assert _shaken(verdict("quantisation"), runs) == 0.9
    assert _shaken(verdict("quantisation", 0.9), runs) == 0.0 == _shaken(verdict("noise_level"), runs)
    assert _shaken(verdict("quantisation"), [*runs, RUN]) == 0.0  # of which the steps are not known
    assert _stochastic(verdict("noise_level"), [RUN]) == {"noise_level": 0.9}
    assert _stochastic(verdict("differs between repeats"), runs) == {}
    lossy = [replace(RUN, lost_fraction=share) for share in (1e-5, 1.1e-4)]
    assert _stochastic(verdict("noise_level"), lossy) == {"noise_level": 0.9, "lost_frames": 1.0}


def test_runs_of_all_groups_are_gathered_by_the_number_of_their_repeat():
    names = [[["a1", "a2", "a3"], ["b1"]], [["c1", "c2"]]]
    groups = [
        Group(
            "p", tuple("xy"[: len(each)]), tuple(tuple(replace(RUN, run_id=n) for n in own) for own in each)
        )
        for each in names
    ]
    found = [[run.run_id for run in own] for own in _by_repeat(groups)]
    assert found == [["a1", "b1", "c1"], ["a2", "c2"], ["a3"]]


def test_warnings_say_what_a_floor_rests_on_and_what_short_runs_hide():
    def warned(*runs, repeats=True, source="repeats"):
        groups = [Group("p", ("0",), ((run,),)) for run in runs]
        noise = NoiseVerdict(WHITE, {"": 1.0}, source, {}, WHITE)
        floor = Floor(np.ones(1), np.ones(1), repeats)
        return of_floor(SimpleNamespace(floor=floor, noise=noise, groups=groups))

    long = made_run("r", stimulus(4000), np.random.default_rng(1))
    assert warned(long) == []
    bare = warned(long, repeats=False, source="data sheet")
    assert bare == [
        "no repeated runs: the noise floor rests on data sheet",
        "no repeats and no quiet run: a wrong data sheet would look like a gap",
    ]
    short = made_run("r", stimulus(3599), np.random.default_rng(1))
    (one,) = warned(short)
    assert one.startswith("the longest run has 3599 s: what takes longer than 1800 s")
    slow = replace(short, stimulus=replace(short.stimulus, period_s=2.0))
    assert warned(short, slow) == [] == warned(long, short)
    still = replace(long, stimulus=replace(long.stimulus, t_in_c=25.0 + 1.9 * (np.arange(4000) < 9)))
    assert len(warned(still)) == 1 and "temperature hardly changes" in warned(still)[0]
    assert warned(still, long) == []
    flat = replace(long, stimulus=replace(long.stimulus, t_in_c=long.stimulus.t_out_c))
    assert len(warned(flat, flat)) == 1 and "one temperature only" in warned(flat)[0]


def test_a_share_that_held_out_runs_do_not_show_has_its_caution():
    def shrunk(low, high, active=(True, False, True)):
        return Shrinkage(0.5 * (low + high), low, high, 1.0, 1.0, active=active)

    assert shrunk(0.51, 0.9).caution == "" == shrunk(-0.5, 0.1, (False,)).caution
    assert "half of the gap or more may stay" in shrunk(0.5, 0.9).caution
    assert "half of the gap or more may stay" in shrunk(-0.5, 0.001).caution
    assert "come no nearer" in shrunk(-0.5, 0.0).caution and shrunk(0.0, 1.0).cells == 2


def test_a_parameter_of_the_nominal_model_that_runs_deny_is_said():
    """Told as 10 +- 0.5 deg/h per 50 K, and 2 in the runs: 16 deviations are no uncertainty of the model."""
    slope = effect("bias_linear").variants()[0]
    told = Model("m", (Term(slope, (10.0,), (0.5,)),), WHITE)
    (sentence,) = of_nominal(told, told.moved(np.array([-8.0]), np.array([0.19])))
    assert "bias_linear, bias_dph_per_50k is 2 in these runs, not 10 +- 0.5" in sentence
    assert not of_nominal(told, told.moved(np.array([1.4]), np.array([0.1])))
    runs = []
    for number in range(3):
        s = stimulus(3000)
        extra = 2.0 * effect("bias_linear").columns(s, dict(slope.shape))[0]
        runs.append(made_run(f"shock {number}", s, np.random.default_rng(number), extra))
    found = diagnose(runs, told, []).rate
    assert any("the nominal model is wrong: bias_linear" in each for each in found.warnings)
    sure = Model("m", (Term(slope, (2.0,), (0.5,)),), WHITE)
    assert not any("the nominal model is wrong" in each for each in diagnose(runs, sure, []).rate.warnings)


def test_a_closed_model_knows_all_runs_that_it_rests_on():
    model = Model("m", (), WHITE, fitted_on={"first": "1"})
    found = Diagnosis("U", model, (), {"second": "2"})
    assert closed_model(found).fitted_on == {"first": "1", "second": "2"}
