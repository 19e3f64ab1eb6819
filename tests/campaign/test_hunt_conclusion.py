"""What a search makes of its runs: repeats that tell nothing, the sooner of two ends, confirmation elsewhere."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest

from bench.analysis.gap import UNKNOWN, Choice, information_gained, key_of
from bench.campaign import _conclusion
from bench.campaign._conclusion import _Told
from bench.campaign.hunt import (
    ALIKE,
    BUDGET,
    DECIDED,
    NO_GAP,
    UNDECIDED,
    Conclusion,
    Hunt,
    Told,
    fewest,
    led,
    next_choice,
)
from bench.record.events.campaign import NextRun, Sought


def design(procedure, hours, **settings):
    return SimpleNamespace(key=key_of(procedure, settings), procedure=procedure, hours=hours)


def ran(procedure, expected, gained, confirming="", **settings):
    return Told(key_of(procedure, settings), expected, gained, confirming)


ENOUGH = [ran(name, 0.1, 0.1) for name in ("p", "q", "r")]
"""Runs of so many procedures that a search may end."""


def after(choices, confirmed=None, showing=None, probabilities=None, within=None):
    outlook = SimpleNamespace(
        choices=lambda most_h: [each for each in choices if each.design.hours <= most_h],
        showing=lambda names, most_h, least: showing if showing and showing.design.hours <= most_h else None,
        probabilities=probabilities or {frozenset({"shupe"}): 0.9, frozenset(): 0.1},
        leading=SimpleNamespace(label=frozenset({"shupe"})),
        designs=[each.design for each in choices],
        information=lambda design, among: within[design.procedure],
    )
    return Conclusion(outlook, None, "shupe", 0.9, 0.95, [], None, confirmed, frozenset({UNKNOWN}))


def test_a_design_that_told_half_is_expected_to_tell_half_again_and_a_surprise_counts_once():
    told = _Told.of([ran("a", 0.38, 0.18), ran("b", 0.3, 4.0)])
    # 0.02 nats as expected stand beside: (0.02 + 0.18) / (0.02 + 0.38)
    assert told.kinds == pytest.approx({"a": 0.5, "b": 1.0})
    assert told.vain == 1.0
    # the repeat was expected to tell 0.2 because half had been taken off 0.4
    again = _Told.of([ran("a", 0.38, 0.18), ran("b", 0.3, 4.0), ran("a", 0.2, 0.0)])
    assert again.kinds["a"] == pytest.approx(0.02 / (0.02 + 0.4))


def test_after_runs_in_vain_every_run_is_expected_to_tell_less_until_one_tells():
    vain = [ran("a", 0.3, 0.0), ran("b", 0.5, 0.0)]
    # 0.02 nats as expected stand beside
    told = _Told.of(vain)
    assert told.vain == pytest.approx(0.02 / 0.82) == told.part(key_of("c", {}))
    assert _Told.of([*vain, ran("x", 0.1, 0.0, confirming="shupe")]).vain == told.vain
    assert _Told.of([*vain, ran("d", 0.02, 0.01)]).vain == 1.0
    # one alone speaks for its kind only
    assert _Told.of(vain[:1]).vain == 1.0
    # a third is expected to tell that much less, and was told nothing of what it would be else
    third = _Told.of([*vain, ran("c", 0.4 * told.vain, 0.0)])
    assert third.vain == pytest.approx(0.02 / (0.82 + 0.4))
    # what its own kind told counts where that is less
    assert [_Told({"a": 0.1}, 0.5).part(key_of(name, {})) for name in "ab"] == [0.1, 0.5]


def test_a_few_that_no_run_tells_apart_end_the_search_if_a_run_has_shown_one_of_them(monkeypatch):
    shupe, lag, none = frozenset({"shupe"}), frozenset({"thermal_lag"}), frozenset()
    choices = [Choice(design("a", 1.0), 0.5), Choice(design("b", 2.0), 0.4)]
    alike = {shupe: 0.6, lag: 0.36, none: 0.04}
    confirming = Choice(design("c", 1.0), math.nan)

    def then(probabilities=alike, within=None, shown=True, history=()):
        within = within or {"a": 0.02, "b": 0.01}
        monkeypatch.setattr(Conclusion, "one_of_shown", shown)
        now = after(choices, None, confirming, probabilities, within)
        return next_choice(now, 9.0, history=[*ENOUGH, *history])

    assert then() == (None, ALIKE)
    assert then(within={"a": 0.02, "b": 0.03})[0] == choices[0]
    # what a run in vain took off counts here, too
    assert then(within={"a": 0.2, "b": 0.3}, history=[ran("x", 0.4, 0.0)] * 2) == (None, ALIKE)
    # no gap, something unknown, or more than four are no answer
    unknown = frozenset({"shupe", UNKNOWN})
    many = {frozenset({name}): 0.19 for name in "abcde"}
    for others in ({shupe: 0.6, none: 0.36, lag: 0.04}, {shupe: 0.6, unknown: 0.36, lag: 0.04}, many):
        assert then(others)[1] == ""
    # one that no run has shown is shown first, once by a run
    assert then(shown=False) == (confirming, "")
    assert then(shown=False, history=[ran("c", 0.1, 0.1)])[0] == choices[0]


def test_one_of_several_is_shown_by_any_run_that_was_left_out(monkeypatch):
    labels = {frozenset({"shupe"}): 0.6, frozenset({"thermal_lag"}): 0.36}
    now = replace(after([], None, None, labels), given=["first", "second", "third"])

    def diagnosed(runs, model, held_out):
        assert held_out[0] not in runs and len(runs) == len(searched.given) - 1
        found = "thermal_lag" if held_out == ["second"] else "gradient"
        causes = (SimpleNamespace(name=found, effects={found}),)
        rate = SimpleNamespace(causes=causes, unknown_probability=0.1, held={found: 0.9}, stochastic={})
        return SimpleNamespace(rate=rate)

    monkeypatch.setattr(_conclusion, "_diagnosed", diagnosed)
    searched = now
    assert now.one_of == tuple(labels) and now.one_of_shown
    searched = replace(now, given=["first", "third"])
    assert not searched.one_of_shown


def test_the_fewest_that_have_a_probability_are_the_most_probable():
    found = {"a": 0.2, "b": 0.5, "c": 0.25, "d": 0.05}
    assert fewest(found, 0.95) == ("b", "c", "a") and fewest(found, 0.5) == ("b",)


def test_a_run_that_told_nothing_makes_place_for_another():
    choices = [Choice(design("a", 1.0), 0.5), Choice(design("b", 2.0), 0.4)]
    now = after(choices)
    assert next_choice(now, 9.0)[0].design.procedure == "a"
    chosen, ended = next_choice(now, 9.0, history=[ran("a", 0.5, 0.0)])
    assert chosen.design.procedure == "b" and ended == ""
    nothing = [*ENOUGH, *[ran("a", 5.0, 0.0), ran("b", 5.0, 0.0)] * 5]
    assert next_choice(now, 9.0, history=nothing) == (None, UNDECIDED)


def test_a_run_that_told_nothing_speaks_for_its_kind():
    """Rotations differ by their rate; a ramp told less an hour, and no ramp was made in vain."""
    slow, fast = design("rotation", 1.0, rate_dps=2.0), design("rotation", 1.0, rate_dps=20.0)
    ramp, both = design("ramp", 2.0, rate_dps=2.0), design("rotation", 1.0, rate_dps=20.0, reversals=3)
    choices = [Choice(slow, 0.9), Choice(fast, 0.8), Choice(ramp, 0.3)]
    history = [ran("rotation", 0.9, 0.0, rate_dps=2.0)]
    assert next_choice(after(choices), 9.0)[0].design is slow
    assert next_choice(after(choices), 9.0, history=history)[0].design is ramp
    assert next_choice(after([*choices, Choice(both, 0.8)]), 9.0, history=history)[0].design is both


def test_a_search_is_open_when_four_runs_in_a_row_told_nothing():
    # however much the next one promises
    now = after([Choice(design("a", 1.0), 1e6)])
    vain, told = ran("x", 0.4, 0.03), ran("y", 0.4, 0.05)
    confirming = ran("c", 0.4, 0.0, confirming="shupe")
    for history in (
        [vain] * 3,
        [vain, told, vain, vain, vain],
        [*[confirming] * 3, vain],
        [vain] * 4 + [told],
    ):
        assert next_choice(now, 9.0, history=history)[0].design.procedure == "a"
    history = [*ENOUGH, told, *[vain] * 2, confirming, *[vain] * 2]
    assert next_choice(now, 9.0, history=history) == (None, UNDECIDED)


def test_of_two_runs_that_would_end_the_search_the_shorter_is_made():
    short = Choice(design("short", 8.0), 0.15, 0.96)
    long = Choice(design("long", 12.0), 0.30, 0.98)
    unsure = Choice(design("unsure", 2.0), 0.02, 0.90)
    assert next_choice(after([long, short, unsure]), 20.0)[0] == short
    # a run that tells more an hour and is shorter than any that would end it comes first
    quick = Choice(design("quick", 1.0), 0.2, 0.92)
    assert next_choice(after([quick, long, short]), 20.0)[0] == quick
    # an order of the caller's own is kept
    assert next_choice(after([long, short]), 20.0, order=list)[0] == long


def test_small_doubts_are_closed_by_short_runs_as_long_as_a_longer_one_is_worth_making():
    short, long = Choice(design("short", 1.0), 0.01, 0.5), Choice(design("long", 12.0), 0.03, 0.99)
    little = Choice(design("little", 0.5), 0.004, 0.5)
    # 0.01 nats in an hour against 0.03 in twelve; 0.004 are less than a quarter of what a run must tell
    assert next_choice(after([little, short, long]), 20.0)[0] == short
    # a run that tells next to nothing but would end the search is made once, then the search is open
    last = Choice(design("last", 3.0), 0.002, 0.96)
    assert next_choice(after([last, little]), 20.0) == (last, "")
    history = [*ENOUGH, ran("last", 0.002, 0.0)]
    assert next_choice(after([last, little]), 20.0, history=history) == (None, UNDECIDED)


def test_an_answer_that_two_runs_in_a_row_did_not_confirm_is_open():
    confirming = Choice(design("c", 1.0), math.nan)
    failed, elses = ran("c", 0.0, 0.0, confirming="shupe"), ran("c", 0.0, 0.0, confirming="gradient")
    other = ran("a", 0.5, 0.4)
    for history in ([], [failed], [failed, failed, other], [failed, other, failed], [failed, elses, failed]):
        assert next_choice(after([], False, confirming), 9.0, history=history) == (confirming, "")
    assert next_choice(after([], False, confirming), 9.0, history=[other, failed, failed]) == (
        None,
        UNDECIDED,
    )


def test_what_is_named_is_confirmed_when_it_was_found_again_and_foretold_some_of_the_newest_run(monkeypatch):
    named = SimpleNamespace(name="shupe", effects={"shupe"})
    explained = [frozenset({"shupe"})]

    def judged(part, causes=(named,), unknown=0.1, noise=(), labels=explained):
        rate = SimpleNamespace(
            causes=causes,
            unknown_probability=unknown,
            held={"shupe": part, "withdrawn": 0.2},
            stochastic=dict.fromkeys(noise, 0.95),
        )
        monkeypatch.setattr(_conclusion, "_diagnosed", lambda *_: SimpleNamespace(rate=rate))
        return _conclusion._confirmed(labels, [1, 2], None)

    assert judged(0.6) == (True, frozenset())
    # nothing of it shows there, another was named, something unknown beside
    assert judged(math.nan) == (False, frozenset({"shupe"}))
    assert judged(0.9, causes=()) == judged(0.9, unknown=0.6) == (False, frozenset({"shupe"}))
    # noise beside it belongs to the answer; of noise alone no share of a gap tells
    line, both = frozenset({"line"}), frozenset({"line", "shupe"})
    assert judged(0.6, noise=["line"], labels=[both]) == (True, frozenset())
    assert judged(0.6, noise=["line"]) == (False, frozenset({"shupe"}))
    assert judged(0.6, labels=[both]) == (False, line)
    assert judged(math.nan, causes=(), noise=["line"], labels=[line]) == (True, frozenset())
    assert judged(math.nan, causes=(), labels=[line]) == (False, line)
    assert _conclusion._confirmed([frozenset()], [1], None) == (True, frozenset())


def test_what_is_named_as_the_form_of_another_effect_is_seen_with_it(monkeypatch):
    both = [frozenset({"table_wobble_once", "table_wobble_twice"})]
    one = SimpleNamespace(name="table_wobble_once", effects=set(both[0]))
    rate = SimpleNamespace(
        causes=[one], unknown_probability=0.1, held={"table_wobble_once": 0.9}, stochastic={}
    )
    monkeypatch.setattr(_conclusion, "_diagnosed", lambda *_: SimpleNamespace(rate=rate))
    assert _conclusion._confirmed(both, [1, 2], None) == (True, frozenset())
    one.effects = {"table_wobble_once"}
    assert _conclusion._confirmed(both, [1, 2], None) == (False, frozenset({"table_wobble_twice"}))


def test_runs_made_to_confirm_are_remembered_with_the_answer_that_they_were_made_for():
    def sought(after, acts):
        return Sought(after, "explained", acts, 0.96, {acts: 0.96}, 1.0, 0.0, None, "")

    def chosen(run, to_confirm):
        return NextRun(run, "thermal-ramp", "", 0.3, 1.0, 9, to_confirm)

    events = [
        sought([], NO_GAP), chosen("a", False), sought(["a"], "shupe"), chosen("b", True),
        sought(["a", "b"], "gradient"), chosen("c", True),
    ]  # fmt: skip
    runs = [SimpleNamespace(name=name, procedure="thermal-ramp", parameters={}) for name in "abc"]
    now = SimpleNamespace(outlook=SimpleNamespace(probabilities={frozenset({"gradient"}): 1.0}))
    history = Hunt._history(
        SimpleNamespace(steps=events), now, [SimpleNamespace(run=run) for run in runs if run.name != "b"]
    )
    assert [told.confirming for told in history] == ["", "gradient"]
    # from a half, the probability before any run, to 0.96, and from there to 1
    gained = [0.96 * math.log(0.96 / 0.5), -math.log(0.96)]
    assert [told.gained for told in history] == pytest.approx(gained)


def test_a_run_that_leads_back_to_where_the_search_stood_before_has_told_nothing():
    swings = [{"gradient": 0.52, "shupe": 0.48}, {"gradient": 0.93, "shupe": 0.07}]
    back = {"gradient": 0.53, "shupe": 0.47}
    assert information_gained(swings[1], back) > 0.5 > 0.001 > led(swings, back)
    assert led([*swings, {"no gap": 1.0}], {"gradient": 0.99, "shupe": 0.01}) == pytest.approx(
        information_gained(swings[1], {"gradient": 0.99, "shupe": 0.01})
    )
    assert led([], back) == 0.0


def test_an_answer_ends_the_search_when_it_was_seen_again_or_cannot_be():
    confirming = Choice(design("c", 1.0), math.nan)
    assert next_choice(after([], True), 9.0) == (None, DECIDED)
    assert next_choice(after([], False, confirming), 9.0) == (confirming, "")
    # of what no run shows nothing is decided; of what the bench time is too short for it is, unconfirmed
    assert next_choice(after([], False), 9.0) == (None, UNDECIDED)
    assert next_choice(after([], False, confirming), 0.5) == (None, DECIDED)
    assert next_choice(after([Choice(design("a", 9.5), 1.0)]), 9.0) == (None, BUDGET)


def test_a_search_ends_only_after_runs_of_three_procedures_that_fit_into_the_bench_time():
    again, slow = Choice(design("p", 0.5, rate_dps=2.0), 0.9), Choice(design("u", 4.0), 0.3)
    quick, ramp = Choice(design("t", 1.0), 0.1), Choice(design("t", 1.5, low_c=-40.0), 0.05)
    bench = [again, quick, ramp, slow]  # by information an hour
    two = [*ENOUGH[:2], ran("q", 0.1, 0.1, low_c=-40.0)]
    for confirmed, ended in ((True, DECIDED), (False, UNDECIDED)):
        answered = after(bench, confirmed)
        assert next_choice(answered, 9.0, history=ENOUGH) == (None, ended)
        assert next_choice(answered, 9.0, history=two) == (quick, "")
        # a repeat of a procedure is none, and what does not fit or is not usable is not made
        assert next_choice(answered, 0.9, history=two) == (None, ended)
        usable = next_choice(answered, 9.0, usable=lambda each: each.procedure != "t", history=two)
        assert usable == (slow, "")
    # an end without an answer comes no sooner; a budget that is spent is spent
    failed = [ran("p", 0.1, 0.1, confirming="shupe")] * 2
    assert next_choice(after(bench, False), 9.0, history=failed) == (quick, "")
    assert next_choice(after(bench, False), 9.0, history=[*ENOUGH, *failed]) == (None, UNDECIDED)
    assert next_choice(after(bench), 0.1, history=two) == (None, BUDGET)


def test_a_run_before_an_end_lasts_no_longer_than_the_runs_so_far_together():
    dear, quick = Choice(design("u", 4.0), 0.3), Choice(design("t", 1.0), 0.1)
    for spent_h, chosen in ((3.0, quick), (4.5, dear)):
        again = Choice(design("p", spent_h), 0.01)
        made = ENOUGH[:2]
        assert next_choice(after([quick, dear, again], True), 9.0, history=made) == (chosen, "")


def test_what_is_named_may_have_shown_in_any_run_after_those_that_it_was_found_in(monkeypatch):
    """The newest run may be one in which it does not act."""
    looked, label = [], frozenset({"shupe"})

    def look(held_out, labels, others, model):
        assert others == [run for run in (1, 2, 3) if run < held_out]
        looked.append(held_out)
        found, seen = looks[held_out]
        return _conclusion._Look(found, seen, frozenset({f"run {held_out}"}))

    monkeypatch.setattr(_conclusion, "_look", look)
    looks = {3: (True, False), 2: (True, True), 1: (False, False)}
    assert _conclusion._confirmed([label], [1, 2, 3], None) == (True, frozenset())
    assert looked == [3, 2]
    assert _conclusion._confirmed([label], [1], None) == (False, frozenset({"run 1"}))
    # before the newest run something else was found: what run 2 had shown was refuted
    looks[3] = (False, False)
    looked.clear()
    assert _conclusion._confirmed([label], [1, 2, 3], None) == (False, frozenset({"run 3"}))
    assert looked == [3]


def test_what_no_run_shows_clearly_is_confirmed_in_one_that_shows_it_faintly():
    faint, asked = Choice(design("c", 1.0), math.nan), []
    now = after([], False)

    def showing(names, most_h, least):
        asked.append((most_h, least))
        return faint if least == 5.0 else None

    now.outlook.showing = showing
    assert next_choice(now, 9.0) == (faint, "") and asked == [(9.0, 10.0), (9.0, 5.0)]
