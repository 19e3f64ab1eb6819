"""Limits, units and sums of the diagnosis that few inputs show: equalities, steps, several axes and terms."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.fft import dct
from scipy.stats import chi2

from bench.analysis.gap import Model, Noise, Outlook, Term, _position, _rate, information_gained, outlook
from bench.analysis.gap._data import Group, cut
from bench.analysis.gap._designs import usual_designs
from bench.analysis.gap._evidence import Candidate, log_bayes, search
from bench.analysis.gap._findings import Cause
from bench.analysis.gap._fit import Solution
from bench.analysis.gap._generic import free_curves
from bench.analysis.gap._import import read_mapped_runs
from bench.analysis.gap._judged import Judged, less_forms, told_by_form
from bench.analysis.gap._learn import Learned, _done, _Problem
from bench.analysis.gap._lines import strongest_line
from bench.analysis.gap._position import PositionRun, PositionSignal
from bench.analysis.gap._prepare import prepare
from bench.analysis.gap._rows import steady_beside
from bench.analysis.gap._stochastic import DIFFERS
from bench.analysis.gap._unknown import Remainder
from tests.analysis.gap.conftest import effect, made_run, stimulus

WHITE = Noise(0.004)
NONE = Solution(np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros((0, 0)))
NO_REST = Remainder(np.zeros(1), 0.0, np.zeros(1), np.zeros(1))


def run_of(name="r", n=600, **changes):
    return replace(made_run(name, stimulus(n, cold=False), np.random.default_rng(1)), **changes)


# runs and rows


def test_a_run_that_is_shorter_than_asked_is_itself():
    run = run_of()
    assert cut(run, 600) is run and cut(run, 601) is run and cut(run, 10_000) is run
    slow = replace(run, stimulus=replace(run.stimulus, period_s=2.0))
    assert len(cut(slow, 599).stimulus) == len(cut(slow, 599).output_dph) == 599
    assert cut(slow, 599).stimulus.period_s == 2.0


@pytest.mark.parametrize(("unit", "deg_per_s"), [("deg/s", 1.0), ("deg/h", 1 / 3600), ("rad/s", 180 / np.pi)])
@pytest.mark.parametrize(("row_s", "pulse_arcsec"), [(0.5, 0.5), (0.1, 0.03), (2.0, 1.7)])
def test_the_finest_angle_of_a_log_is_the_pulse_of_its_gyro(tmp_path, unit, deg_per_s, row_s, pulse_arcsec):
    """Whole pulses in rows of one length: a row's rate is pulses over its length, whatever its unit."""
    pulses = np.rint(np.random.default_rng(1).normal(0.0, 300.0, 1500))
    rates = pulses * pulse_arcsec / 3600.0 / row_s / deg_per_s
    rows = [f"{row_s * k:.1f},{rate:.9e}" for k, rate in enumerate(rates)]
    (tmp_path / "log.csv").write_text("\n".join(["t,rate", *rows]), encoding="utf-8")
    (tmp_path / "map.toml").write_text(
        'format = 1\nunit_id = "G7"\nlatitude_deg = 39.1\n[columns]\ntime = { name = "t", unit = "s" }\n'
        f'output = {{ name = "rate", unit = "{unit}" }}\n[[run]]\nfile = "log.csv"\n',
        encoding="utf-8",
    )
    (run,) = read_mapped_runs(tmp_path / "map.toml")
    assert run.finest_arcsec == pytest.approx(pulse_arcsec, rel=1e-5)
    mean = pulses[1:].mean() * pulse_arcsec / row_s
    assert np.nanmean(run.output_dph) == pytest.approx(mean, abs=0.02 * pulses.std() * pulse_arcsec / row_s)


@pytest.mark.parametrize("rate", [0.1, 7.0, -7.0, 300.0])
@pytest.mark.parametrize(("change", "steady"), [(0.0028, True), (-0.0028, True), (0.0032, False)])
def test_a_rate_is_steady_up_to_three_thousandths_of_itself(rate, change, steady):
    """It then goes on into a masked move, on either side; else the move has its mean rate there, too."""
    for behind in (False, True):
        turned = np.array([*[rate * (1.0 - change), rate], *[50.0] * 6, 9.0, 1.0])
        missing = np.isin(np.arange(10), range(2, 8))
        if behind:
            turned, missing = turned[::-1], missing[::-1]
        angle = 5.0 + np.concatenate(([0.0], np.cumsum(turned)))
        found = np.diff(steady_beside(angle, missing))
        found = found[::-1] if behind else found
        assert found[2] == pytest.approx(rate if steady else 50.0)
        assert found[[0, 1, 7, 8, 9]] == pytest.approx([rate * (1.0 - change), rate, 50.0, 9.0, 1.0])
        assert found.sum() == pytest.approx(turned.sum())


# sets of effects


def test_a_column_that_shows_nothing_costs_as_much_as_one():
    """`b` has nothing in these runs; `c` has one column that shows something, and two that do not."""
    system = np.diag([200.0, 1.0, 0.0, 1.0, 1e-7, 0.0])
    system[0, 1] = system[1, 0] = 9.0
    system[0, 3] = system[3, 0] = 7.0
    candidates = [Candidate("a", 0, (1,), 1), Candidate("b", 1, (2,), 1), Candidate("c", 2, (3, 4, 5), 1)]
    found = search(system, candidates, [0, 1, 2]).log_evidence
    one = math.log(0.5 / 3.0)
    for member, gain in ((0, 81.0), (1, 0.0), (2, 49.0)):
        assert found[frozenset({member})] == pytest.approx(log_bayes(gain, 1) + one, abs=1e-3)
    assert log_bayes(0.0, 1) < -1.0


def judged(names, *left, log_evidence=0.0):
    return Judged(
        frozenset(names), frozenset(), log_evidence, NONE, np.array(left), NO_REST, NONE, NONE, frozenset()
    )


EFFECTS = {name: effect(name) for name in ("bias_quadratic", "bias_cubic", "shupe", "warm_up")}


@pytest.mark.parametrize(("gained", "stays"), [(0.48, False), (0.5, True), (0.9, True)])
def test_what_corrects_a_weak_effect_takes_away_no_more_than_its_formula_may_miss(gained, stays):
    """0.35 squared of 4, also where that is less than noise."""
    larger = judged({"bias_quadratic", "shupe"}, 50.0 - gained)
    smaller = judged({"bias_quadratic"}, 50.0)
    found = less_forms([larger, smaller], lambda one, names: one.left + 4.0 * len(names), EFFECTS)
    assert (larger in found) is stays and len(found) == 1 + stays


@pytest.mark.parametrize(
    ("left", "without", "leaves", "part"),
    [
        # nothing is left and next to nothing was there: it acts nowhere, and nothing tells
        ((40.0, 40.0), (40.0, 40.0), 10.0, 0.0),
        # three thousandths of what the effect takes away
        ((40.0, 40.0), (1e5 + 40.0, 40.0), 10.0 + 0.003 * 1e5, 1.0),
        # 100 are left of 1000 where it takes away 900, and a tenth of that is not its own
        ((140.0, 40.0), (1040.0, 40.0), 10.0 + 0.003 * 900.0 + 0.9 * 100.0, 0.9),
        # what is left where it does not act is another's
        ((140.0, 340.0), (1040.0, 340.0), 10.0 + 0.003 * 900.0 + 0.9 * 100.0, 0.9),
    ],
)
@pytest.mark.parametrize("more", [7.0, 60.0])
def test_sets_that_form_alone_tells_apart_differ_as_by_students_likelihood(left, without, leaves, part, more):
    """Fifty independent parts: -25 ln(1 + more / left), and half a log of 51 for a further parameter.

    More counts where the best set's effect acts, by its part.
    """
    cells = [SimpleNamespace(count=40.0, repeatable=True, band=k) for k in range(2)]
    best = judged({"bias_quadratic"}, *left)
    cubic = judged({"bias_cubic"}, left[0] + more, left[1], log_evidence=-1e3)
    shupe = judged({"shupe"}, left[0] + more, left[1] - 2.0 * more, log_evidence=-1e3)
    found = told_by_form([best, cubic, shupe], lambda one, names: np.array(without), cells, EFFECTS)
    behind = 25.0 * math.log(1.0 + part * more / leaves)
    assert [one.log_evidence for one in found] == pytest.approx(
        [0.0, -max(behind, 0.1), -behind - 0.5 * math.log(51.0)], rel=1e-9
    )


# lines, forms and curves


@pytest.mark.parametrize("n", [4000, 1999])
@pytest.mark.parametrize("runs", [1, 3])
def test_a_lines_evidence_is_its_tail_for_all_windows_and_one_set_in_a_hundred(n, runs):
    """All other coefficients are of size one: the energy is chi-square of eight a run but for one of them."""
    group = Group("still", ("0",), ((run_of(n=n),) * runs,))
    told = []
    for size in np.arange(3.0, 9.0, 0.25).tolist():
        rows = np.random.default_rng(2).choice([-1.0, 1.0], size=(runs, n - 1))
        rows[:, 1233] = size
        found = strongest_line([group], [rows], WHITE, {})
        tail = float(chi2.logsf(runs * (7.0 + size**2), 8 * runs))
        expected = -tail - math.log((n - 1) // 8 * 100)
        assert (found is not None) is (expected > 0.0)
        if found is not None:
            assert found.log_evidence == pytest.approx(expected, rel=1e-9)
        told.append(found is not None)
    assert any(told) and not all(told)


def test_curves_on_rate_are_in_ppm_and_others_in_deg_per_h():
    """Their bounds are the same for every gyro."""
    rng = np.random.default_rng(1)
    curves = {each.effect.name: each.effect for each in free_curves([run_of(), made_run("t", TURNING, rng)])}
    of_rate = {name for name in curves if "scale factor over" in name or "rate over" in name}
    assert len(of_rate) >= 4 and len(curves) - len(of_rate) >= 5
    for name, own in curves.items():
        assert own.curve.of_rate is (name in of_rate), name
        units = {parameter.unit.symbol for parameter in own.parameters}
        assert units == ({"ppm"} if name in of_rate else {"deg/h"}), name
        assert {parameter.bounds(7.0) for parameter in own.parameters} == {(-1e6, 1e6)}, name
        if own.nodes:
            assert all(p.name.startswith("ppm_at" if name in of_rate else "dph_at") for p in own.parameters)
            change = np.full(len(own.nodes), 3.0) @ own.columns(TURNING, {"lag_s": 0.0})
            scale = 1e-6 * TURNING.input_rate_dph if name in of_rate else np.ones(len(TURNING))
            assert np.abs(change / scale).max() == pytest.approx(3.0), name


def terms_of(**sizes):
    variants = {name: effect(name).variants()[0] for name in sizes}
    return [Term(variants[name], (size,), (0.1,)) for name, size in sizes.items()]


TURNING = stimulus(900, rate_dps=5.0)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_what_terms_do_in_a_run_is_the_sum_of_their_formulas(count):
    """Each over its columns and samples: two parameters of Shupe's effect, one of the others."""
    run = made_run("r", TURNING, np.random.default_rng(1))
    shupe = Term(effect("shupe").variants()[0], (0.5, -2.0), (0.1, 0.1))
    terms = [shupe, *terms_of(warm_up=3.0, scale_factor=40.0)][:count]
    heat = shupe.variant.columns(TURNING)
    expected = 0.5 * heat[0] - 2.0 * heat[1]
    for term in terms[1:]:
        expected = expected + term.values[0] * term.variant.columns(TURNING)[0]
    found = _done(terms, run)
    assert found.shape == (1, 900) and found[0] == pytest.approx(expected)


@pytest.mark.parametrize("q", [0, 1, 2])
def test_named_effects_are_taken_off_the_data_and_not_off_the_models_columns(q):
    rng = np.random.default_rng(1)
    runs = [made_run(name, TURNING, rng) for name in "ab"]
    own = terms_of(bias_linear=0.0, scale_factor=0.0)[:q]
    model, named = Model("m", tuple(own), WHITE), terms_of(warm_up=30.0, bias_quadratic=0.5)
    data = prepare(runs, model, [])
    (group,), (stack,) = data.groups, data.stacks
    problem, before = _Problem(data, model, named), _Problem(data, model, [])
    whole = stack.chosen(range(1 + q))
    rows = problem._beside_named(group, stack)
    added = sum(term.values[0] * term.variant.columns(TURNING)[0] for term in named)
    taken = dct(added[: rows.shape[2] + 1], norm="ortho")[1:]
    assert whole[:, 0] - rows[:, 0] == pytest.approx(np.stack([taken] * 2), abs=1e-3)
    assert rows[:, 1:].tolist() == whole[:, 1:].tolist()
    assert stack.chosen(range(1 + q)).tolist() == whole.tolist()
    assert before._beside_named(group, stack).tolist() == whole.tolist()
    assert float(problem.before.sum()) > 10.0 * float(before.before.sum())


# where a search stands


@pytest.fixture(scope="module")
def start() -> Outlook:
    designs = [
        each for each in usual_designs(39.1) if each.procedure in ("constant-rotation", "standard-test")
    ]
    return outlook(None, Model("m", (), WHITE), [], designs)


def test_a_run_may_last_just_as_long_as_there_is_time(start):
    hours = sorted({each.hours for each in start.designs})
    assert len(hours) > 1
    names = frozenset({"warm_up"})
    for most_h in hours:
        assert start.showing(names, most_h, 0.0).design.hours == hours[0]
        assert max(each.design.hours for each in start.choices(most_h)) == most_h
    assert start.showing(names, math.nextafter(hours[0], 0.0), 0.0) is None
    assert start.choices(math.nextafter(hours[0], 0.0)) == []


def test_information_gained_is_never_less_than_none():
    """What is less probable than a thousandth counts for nothing, though probabilities then sum to less."""
    before = {"a": 1.0}
    after = {"a": 0.995, **{f"b{k}": 0.0005 for k in range(10)}}
    assert information_gained(before, after) == 0.0
    # nothing was held possible: that one effect acts had one half, one more beside it a quarter of that
    assert information_gained({}, {"a": 1.0}) == pytest.approx(math.log(2.0))
    assert information_gained({}, {"a + b": 1.0}) == pytest.approx(math.log(8.0))
    # no name had less than two together; of what was not among two names each had a quarter
    assert information_gained({"a": 1e-9}, {"a": 0.5, "b": 0.5}) == pytest.approx(0.5 * math.log(4.0))
    assert information_gained({"a": 0.5, "b": 0.5}, {"c": 1.0}) == pytest.approx(math.log(4.0))


# positions, demands, verdicts


def test_of_positions_the_longest_run_is_fitted_from_its_first_time_to_its_last(monkeypatch):
    studied = []
    monkeypatch.setattr(
        _position, "study_heading", lambda log, others: studied.append((log, others)) or "study"
    )
    times = {"early": [0.0, 90.0, 95.0], "long": [5.0, 6.0, 7.0, 105.0], "late": [1000.0, 1080.0, 1099.0]}
    runs = [
        PositionRun(name, "u", SimpleNamespace(time_s=np.array(time_s))) for name, time_s in times.items()
    ]
    logs = {run.run_id: run.log for run in runs}
    for order in (runs, runs[::-1], [runs[1], runs[2], runs[0]]):
        ready = PositionSignal().prepare(order, Model("m", (), WHITE))
        assert ready.fitted == "long" and set(ready.others) == {"early", "late"} and ready.study == "study"
        log, others = studied.pop()
        assert log is logs["long"] and all(others[name] is logs[name] for name in ("early", "late"))


@pytest.mark.parametrize(
    ("unknown", "part", "named"), [(0.9, 0.4, False), (0.9, 0.6, True), (0.2, 0.4, True)]
)
def test_beside_something_unknown_a_cause_is_held_against_the_runs_by_itself(
    monkeypatch, unknown, part, named
):
    """Fitted beside a curve that the closed model lacks it may widen the gap: less than half is no cause."""
    monkeypatch.setattr(_rate, "candidate_variants", lambda *_: effect("warm_up").variants())
    rng = np.random.default_rng(1)
    runs = [made_run(name, TURNING, rng) for name in "ab"]
    signal, model = _rate.RateSignal(), Model("m", (), WHITE)
    data = signal.prepare(runs, model)
    sets = signal.which(data)
    (term,) = terms_of(warm_up=30.0)
    cause = Cause("warm_up", "", 0.9, term, {}, one_of=("warm_up",), set_probability=0.9)
    monkeypatch.setattr(_rate, "causes_of", lambda *_: ((cause,), ()))
    weights = {frozenset({"warm_up"}): (1.0 - unknown, unknown)}
    monkeypatch.setattr(_rate, "set_weights", lambda _: weights)
    monkeypatch.setattr(_rate, "learned", lambda *_: Learned())
    asked = []

    def holding(self, finding, data, sets, runs, among=None):
        asked.append(among)
        return [part]

    monkeypatch.setattr(_rate.RateSignal, "_holding", holding)
    found = signal.finding(data, sets)
    assert asked == ([frozenset({"warm_up"})] if unknown > 0.5 else [])
    assert found.causes == ((cause,) if named else ()) and (cause in found.resembles) is not named
    assert found.verdict == (
        "unknown" if not named else "explained in part" if unknown > 0.5 else "explained"
    )


def test_where_repeats_differ_a_cause_is_there_in_every_one_of_them(monkeypatch):
    """Of two causes one has 0.6 of itself in the least of three repeats, the other 0.4."""
    monkeypatch.setattr(_rate, "candidate_variants", lambda *_: effect("warm_up").variants())
    rng = np.random.default_rng(1)
    runs = [made_run(name, TURNING, rng) for name in "abc"]
    signal, model = _rate.RateSignal(), Model("m", (), WHITE)
    data = signal.prepare(runs, model)
    found, variants = signal.which(data)
    noise = replace(found.data.noise, probabilities={"": 0.05, DIFFERS: 0.95})
    sets = replace(found, data=replace(found.data, noise=noise)), variants
    terms = terms_of(warm_up=30.0, bias_quadratic=1.0)
    causes = tuple(Cause(term.name, "", 0.9, term, {}) for term in terms)
    monkeypatch.setattr(_rate, "causes_of", lambda *_: (causes, ()))
    monkeypatch.setattr(_rate, "set_weights", lambda _: {frozenset(EFFECTS): (0.95, 0.05)})
    parts = {("a", "b", "c"): [1.0, 1.0], ("a",): [0.9, 0.7], ("b",): [0.6, 0.9], ("c",): [0.8, 0.4]}

    def holding(self, finding, data, sets, runs, among=None):
        return parts[tuple(run.run_id for run in runs)]

    monkeypatch.setattr(_rate.RateSignal, "_holding", holding)
    found = signal.finding(data, sets)
    assert found.causes == causes[:1] and found.resembles == causes[1:]
    assert found.verdict == "explained in part"
    assert found.warnings[-1] == "not named, less than half of it is there in every repeat: bias_quadratic"


@pytest.mark.parametrize("name", ["saturation", "dead_zone", "lock_in"])
def test_a_limit_or_a_band_adds_nothing(name: str) -> None:
    """A part of minus 8 % that is known to 1 % is less than nothing; one known to 5 % may be nothing."""
    limit = effect(name)
    assert limit.possible(np.array([0.3]), np.array([[1e-4]]))
    assert limit.possible(np.array([-0.08]), np.array([[25e-4]]))
    assert not limit.possible(np.array([-0.08]), np.array([[1e-4]]))
