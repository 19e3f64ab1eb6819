"""A platform's position, what recordings are read, facts for JSON, and what is learned, on small made ones."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.gap import (
    Diagnosis,
    Learned,
    Model,
    Noise,
    Shrinkage,
    Term,
    _channels,
    _describe,
    _position,
    _recordings,
    read_recordings,
)
from bench.analysis.gap._causes import _rivals
from bench.analysis.gap._channel_run import RunSource
from bench.analysis.gap._channels import ChannelFinding
from bench.analysis.gap._data import check_runs, cut
from bench.analysis.gap._disturbed import Disturbed, lines_hz
from bench.analysis.gap._facts import diagnosis_facts, identifiable_facts, log_gap_facts
from bench.analysis.gap._findings import Cause, Place
from bench.analysis.gap._fit import Floor, Solution
from bench.analysis.gap._generic import free_curves
from bench.analysis.gap._identify import Identifiable
from bench.analysis.gap._learn import _Fitted, _Problem, learned
from bench.analysis.gap._model_file import ChannelTerm
from bench.analysis.gap._noise import Periodogram
from bench.analysis.gap._position import PositionSignal, _places, _shrinkage, _term
from bench.analysis.gap._prepare import prepare
from bench.analysis.gap._rate import RateFinding
from bench.analysis.gap._rehearsal import LogGap, LogGaps
from bench.analysis.gap._stochastic import NoiseVerdict, _raised, _usual
from bench.analysis.gap._suggest import Suggestion
from bench.analysis.gap._where import RegimePlace
from bench.present.cli.gap import _text
from bench.present.report import _gap
from bench.record.benchfile import load_bench_file
from bench.record.events.run import AngleDemand, HomeDemand, RateDemand
from bench.record.events.safe import SafeState
from bench.record.recording._events import Line
from drivers.base.errors import ConfigurationError
from simulators.effects import ChannelEffect, ChannelInputs, catalogue
from tests.analysis.gap.conftest import effect, made_run, stimulus
from tests.safety.test_takeover import DEMO

WHITE = Noise(0.004)


def safe(device):
    return SafeState(device, "an alarm", "x")


def test_a_channel_is_searched_where_its_gap_is_clear_and_beyond_what_its_model_claims(monkeypatch):
    monkeypatch.setattr(_channels, "search_effects", lambda *_: "searched")
    clear, noise = Place("", "p", "b", 1.0, 1.0, 9.0, 1e-9), Place("", "p", "b", 0.0, 0.0, 1.0, 0.5)
    for rms, places, searched in ((2.0, [noise, clear], True), (1.0, [clear], False), (2.0, [noise], False)):
        fields = dict.fromkeys(("cells", "floor", "effects", "terms", "weight"))
        data = SimpleNamespace(**fields, rms=rms, accuracy=1.0, least=1.0, places=places, nominal="nominal")
        found = _channels.ChannelSignal("table_rate").which(data)
        assert found == ("searched" if searched else (["nominal"], "nominal"))


def test_noise_is_raised_where_it_has_clearly_more_power_at_some_time_scale():
    data = [Periodogram(np.array([0.01, 0.5]), np.ones(2), np.ones(2), period_s) for period_s in (1.0, 9.0)]
    for factor, raised in ((1.1, False), (1.25, True), (3.0, True)):
        assert _raised(data, Noise(factor * 0.004), WHITE) is raised
    # a walk shows in the slowest alone
    assert _raised(data, Noise(0.004, 0.0, 3.0), WHITE) and not _raised(data, Noise(0.004, 0.0, 1e-3), WHITE)
    usual = _usual(Noise(0.01, 9.0, 7.0), Noise(0.004, 0.1, 0.5))
    assert 0.004 < usual.arw_deg_per_sqrt_h < 0.006 and 0.1 < usual.bias_instability_dph < 0.2
    assert usual.rate_random_walk_dph_per_sqrt_h == 7.0


@pytest.mark.parametrize("part", ["t_in_c", "t_out_c", "angle_deg", "elevation_deg"])
def test_a_run_without_a_temperature_or_an_angle_is_refused(part):
    s = stimulus(300)
    values = getattr(s, part).copy()
    values[7] = np.nan
    with pytest.raises(ConfigurationError, match="a temperature or angle is missing"):
        check_runs([replace(run_of("r"), stimulus=replace(s, **{part: values}))])


@pytest.mark.parametrize("part", ["output_dph", "phase", "angle_deg"])
@pytest.mark.parametrize("by", [-1, 1])
def test_arrays_of_a_run_are_of_one_length(part, by):
    run = run_of("r")
    check_runs([run])
    if part == "angle_deg":
        wrong = replace(run, stimulus=replace(run.stimulus, angle_deg=np.zeros(301 + by)))
    else:
        wrong = replace(run, **{part: np.resize(getattr(run, part), 300 + by)})
    with pytest.raises(ConfigurationError, match="differ in length"):
        check_runs([wrong])


@pytest.mark.parametrize(("missing", "refused"), [(180, False), (181, True)])
def test_three_fifths_of_a_run_may_be_missing(missing, refused):
    run = run_of("r")
    run = replace(run, output_dph=np.where(np.arange(300) < missing, np.nan, run.output_dph))
    if refused:
        with pytest.raises(ConfigurationError, match="too much of the output is missing") as told:
            check_runs([run])
        assert told.value.found == "60 %"
    else:
        check_runs([run])
    for count, short in ((64, False), (63, True)):
        if short:
            with pytest.raises(ConfigurationError, match="too short"):
                check_runs([cut(run_of("r"), count)])
        else:
            check_runs([cut(run_of("r"), count)])
    with pytest.raises(ConfigurationError, match="no runs to diagnose"):
        check_runs([])


@pytest.mark.parametrize(
    ("file", "axis", "another"), [("demo.toml", "table", "another"), ("two_axis.toml", "inner", "outer")]
)
def test_a_demand_ends_when_its_axis_is_told_another_or_the_table_is_made_safe(file, axis, another):
    """The axis that carries the unit is the innermost."""
    bench = load_bench_file(DEMO.with_name(file))
    first, rate, home = (
        AngleDemand("table", axis, 90.0),
        RateDemand("table", axis, 5.0),
        HomeDemand("table", axis),
    )
    told = [
        (1.0, first),
        (2.0, AngleDemand("table", another, 9.0)),
        (3.0, safe("chamber")),
        (4.0, rate),
        (5.0, safe("zebra")),
        (7.0, safe("table")),
        (8.0, home),
        (12.0, None),
    ]
    run = SimpleNamespace(
        manifest=SimpleNamespace(bench=bench.model_dump(mode="json")),
        lines=[Line(time_s, event) for time_s, event in told],
    )
    found = [(start, end, type(event).__name__) for start, end, event in RunSource(run, "").table_demands()]
    assert found == [
        (1.0, 4.0, "AngleDemand"),
        (4.0, 7.0, "RateDemand"),
        (7.0, 8.0, "SafeState"),
        (8.0, 12.0, "HomeDemand"),
    ]


def test_rivals_are_listed_the_most_probable_first():
    sets = {frozenset({name}): (0.1 * k, 0.01) for k, name in enumerate("abcde", 1)}
    assert list(_rivals("e", frozenset({"e"}), sets, frozenset())) == ["d", "c", "b", "a"]


def study(cause="temperature", mixed=False, judgements=(), findings=(), **evidence):
    costs = {"none": 900.0, "temperature": 40.0, "steps": 60.0, "residual": 0.5} | evidence
    found = SimpleNamespace(cause=cause, mixed=mixed, **costs)
    model = SimpleNamespace(
        evidence=found,
        hours=100.0,
        headings=4,
        gain=np.arange(9.0).reshape(3, 3),
        sigma=np.full((3, 3), 0.5),
        tau_s=7200.0,
    )
    return SimpleNamespace(model=model, judgements=judgements, findings=findings)


STAYS = [
    SimpleNamespace(start=10 * k, stop=10 * k + 10, heading_deg=90.0 * k, duration_s=7200.0) for k in range(4)
]


def judgement(name="a", held_out=False):
    """Errors of 3 and 4 arcsec after the first stay, twice that in the last; a fifth of them after."""
    size = np.repeat([0.0, 1.0, 1.0, 2.0], 10)
    return SimpleNamespace(
        name=name,
        held_out=held_out,
        north_before_as=3.0 * size,
        east_before_as=4.0 * size,
        north_after_as=0.6 * size,
        east_after_as=0.8 * size,
        rms_before_as=7.0,
        rms_after_as=1.4,
    )


@pytest.fixture
def stayed(monkeypatch):
    monkeypatch.setattr(_position, "stays", lambda log: STAYS)


def test_places_of_a_position_are_its_stays_after_the_first(stayed):
    log = SimpleNamespace(time_s=np.arange(40.0))
    found = _places("a", log, study(judgements=(judgement("b", True), judgement())))
    assert [place.heading_deg for place in found] == [90.0, 180.0, 270.0]
    assert [place.hours for place in found] == [2.0] * 3
    assert [place.rms_before_as for place in found] == pytest.approx([5.0, 5.0, 10.0])
    assert [place.rms_after_as for place in found] == pytest.approx([1.0, 1.0, 2.0])
    assert [place.share for place in found] == pytest.approx([1 / 6, 1 / 6, 4 / 6])
    share = _shrinkage("a", study(judgements=(judgement("b"), judgement())), log)
    assert (share.share, share.low, share.high) == pytest.approx((0.96, 0.96, 0.96))
    assert (share.rms_before, share.rms_after, share.run_id) == (7.0, 1.4, "a")


def test_without_a_judgement_the_error_itself_is_shown(stayed, monkeypatch):
    left = SimpleNamespace(
        north_as=np.repeat([0.0, 3.0, 0.0, 6.0], 10), east_as=np.repeat([0.0, 4.0, 1.0, 0.0], 10)
    )
    monkeypatch.setattr(_position, "without_start", lambda *_: left)
    found = _places("a", SimpleNamespace(time_s=np.arange(40.0)), study(judgements=(judgement("b", True),)))
    left.east_as[25:30] = np.nan
    found = _places("a", SimpleNamespace(time_s=np.arange(40.0)), study())
    assert [place.rms_before_as for place in found] == [5.0, 1.0, 6.0]
    assert [place.rms_after_as for place in found] == [5.0, 1.0, 6.0]
    assert [place.share for place in found] == pytest.approx([250 / 615, 5 / 615, 360 / 615])


def test_a_fitted_heading_effect_is_added_to_that_of_the_model():
    found = _term(study().model, None)
    assert found.values == (*range(9), 2.0) and found.sigmas == (*[0.5] * 9, pytest.approx(0.2))
    before = replace(found, values=(*[10.0] * 9, 5.0))
    assert _term(study().model, before).values == (*(10.0 + k for k in range(9)), 2.0)


@pytest.mark.parametrize(
    ("costs", "cause", "mixed", "verdict", "named"),
    [
        ({}, "temperature", False, "explained", "heading_effect"),
        ({}, "temperature", True, "explained in part", "heading_effect"),
        ({"temperature": 300.0}, "heading", False, "explained", "heading_steps"),
        ({"none": 20.0}, "none", False, "no gap", ""),
        ({"none": 20.0}, "temperature", False, "no gap", ""),
        ({"temperature": 300.0}, "temperature", False, "unknown", ""),
    ],
)
def test_the_verdict_on_a_position(stayed, costs, cause, mixed, verdict, named):
    signal, whole = PositionSignal(), study(cause, mixed, (judgement(), judgement("c")), **costs)
    whole.findings = (SimpleNamespace(what="short", consequence="coarse"),)
    log = SimpleNamespace(time_s=np.arange(40.0))
    data = SimpleNamespace(term=None, fitted="a", left={"a": log}, others={"c": log}, study=whole)
    sets = signal.which(data)
    assert set(sets) == {"", "heading_effect", "heading_steps"} and sum(sets.values()) == pytest.approx(1.0)
    found = signal.finding(data, sets)
    assert found.verdict == verdict and [each.name for each in found.causes] == ([named] if named else [])
    assert found.unknown is (verdict in ("unknown", "explained in part")) and found.warnings == (
        "short: coarse",
    )
    assert found.null_probability == sets[""] and found.unit == "arcsec"
    for each in found.causes:
        assert each.probability == min(sets[named], 0.95)
        assert (each.term is not None) is (named == "heading_effect")
    assert [each.run_id for each in found.held_out] == (["c"] if named == "heading_effect" else [])
    facts = diagnosis_facts(Diagnosis("u", Model("m", (), WHITE), (found,), {"a": "s"}))
    assert facts["verdict"] == verdict and facts["no_gap_probability"] == sets[""]
    assert len(facts["places"]) == 3 and facts["causes"] == {
        each.name: each.probability for each in found.causes
    }


def run_of(name):
    return made_run(name, stimulus(300), np.random.default_rng(1))


def test_held_out_is_a_run_that_is_given_or_one_of_its_own(monkeypatch, tmp_path):
    monkeypatch.setattr(_recordings, "is_platform_run", lambda path: path.name.startswith("platform"))
    logs = [SimpleNamespace(run_id=name, has_rate=True) for name in ("m1", "m2")]
    monkeypatch.setattr(_recordings, "_logs", lambda path, gyro: logs if path.suffix == ".toml" else None)
    monkeypatch.setattr(_recordings, "LogSource", lambda made: made)
    monkeypatch.setattr(_recordings, "channels_of", lambda source: ([], {}))
    monkeypatch.setattr(_recordings, "rate_of", lambda made, axis: run_of(made.run_id))
    monkeypatch.setattr(_recordings, "load_gap_runs", lambda path, gyro: [run_of(f"{path.name} {gyro}")])
    inputs = ChannelInputs(np.arange(9.0), np.zeros(9), 0.0, 1.0)
    series = _recordings.ChannelSeries(
        "chamber_air", "a fog", inputs, np.zeros(9), np.full(9, "x"), np.zeros(9, bool), 0.1
    )
    monkeypatch.setattr(
        _recordings, "load_channels", lambda path, gyro: ([series], {"table_rate": path.name})
    )
    monkeypatch.setattr(_recordings, "load_platform_run", lambda path: _position.PositionRun("p", "u", None))
    (tmp_path / "own.toml").write_text("")
    found = read_recordings([Path("x.toml"), Path("a")], [Path("m2"), tmp_path / "own.toml"], "fog")
    assert [run.run_id for run in found.runs] == ["m1", "a fog", "a fog"]
    assert [run.run_id for run in found.held_out] == ["m2", "m1", "m2"]
    assert found.missing == {"table_rate": "a"} and not found.of_platform
    assert [run.run_id for run in found.shown] == ["m2", "m1", "m2"]
    assert read_recordings([Path("platform 1")]).of_platform
    with pytest.raises(ConfigurationError, match="no such run to hold out") as refused:
        read_recordings([Path("x.toml")], [Path("m3")])
    assert (refused.value.found, refused.value.expected[-6:]) == ("m3", "m1, m2")
    with pytest.raises(ConfigurationError, match="every run is held out"):
        read_recordings([Path("x.toml")], [Path("m1"), Path("m2")])
    with pytest.raises(ConfigurationError, match="a platform and of a gyro"):
        read_recordings([Path("platform 1"), Path("a")])
    assert len(read_recordings([Path("platform 1"), Path("platform 2")]).runs) == 2


def cause(name):
    variant = effect(name).variants()[0]
    count = len(variant.effect.parameters)
    term = Term(variant, tuple(range(1, count + 1)), (0.5,) * count)
    return Cause(
        name,
        "",
        0.9,
        term,
        {"warm_up": 0.05},
        credibility=math.nan,
        one_of=(name, "warm_up"),
        set_probability=0.95,
    )


def rate_finding(**changes):
    verdict = NoiseVerdict(
        WHITE, {"noise_level": 0.9}, "repeats", {"noise_level": 0.005, "quantisation": 1.0}, WHITE
    )
    place = Place("shock", "run", "5..9 min", 0.5, 1.0, 4.0, 1e-9, 7.0)
    line = SimpleNamespace(
        name="line", effect=catalogue()["vibration_or_mains_line"], values=(3.0, 0.2), sigmas=(0.1, 1e-4)
    )
    fields = {
        "signal": "rate",
        "unit": "deg/h",
        "verdict": "explained",
        "causes": (cause("shupe"),),
        "places": (place,),
        "phases": (replace(place, part="cold"),),
        "left": (),
        "stochastic": {"noise_level": 0.9, "line": 0.95},
        "terms": (),
        "model": Model("m", (), WHITE),
        "resembles": (),
        "unknown_probability": math.nan,
        "null_probability": 0.0,
        "set_probabilities": {frozenset({"b", "a"}): 0.7, frozenset(): 0.3},
        "disturbed": Disturbed([], (line,), {}, {}),
        "noise": verdict,
        "floor": Floor(np.ones(1), np.ones(1), True),
        "regimes": (RegimePlace("T_in", "degC", -40.0, -30.0, 0.3, 0.5, 4.0, 1e-4),),
        "unidentifiable": {"x": "why"},
        "unknown_parts": (
            _describe.UnknownPart("T_in", "It follows.", unit="ppm", at=(1.0,), term=cause("shupe").term),
        ),
        "latitude_deg": 39.1,
        "held_out": (
            Shrinkage(0.9, 0.8, 0.99, 2.0, 0.2, by_profile={"a": 0.9, "b": math.nan}, active=(True,)),
        ),
    }
    return RateFinding(**(fields | changes))


def test_a_cause_of_two_formulas_is_told_closed_and_shown_as_one():
    """What draws its form has values of its own in JSON, in the closed model's name and on the page."""
    other = cause("warm_up").term
    one = replace(cause("shupe"), form=(other,))
    found = rate_finding(causes=(one,), terms=one.terms, learned=None, held_out=())
    (facts,) = diagnosis_facts(Diagnosis("u", Model("m", (), WHITE), (found,), {}))["causes"]
    assert [form["name"] for form in facts["form"]] == ["warm_up"]
    assert list(facts["form"][0]["parameters"].values()) == list(other.values)
    assert one.effects == {"shupe", "warm_up"} and one.terms == (one.term, other)
    assert found.closing[:2] == ("shupe", "warm_up")
    text = _text._rivals(one)
    assert text == "; they follow the same, so one mechanism acts: shupe or warm_up (95 %)"
    verdict = _gap._verdict(found, None, None)
    assert verdict.headlines[0].label == "shupe or warm up" and verdict.headlines[0].value == "95"
    row = _gap._cause_row(one, 1.0, "named")
    assert "one mechanism with what follows the same: shupe or warm up, 95 %" in row.cells[2].text
    assert "with warm up: " in row.cells[3].text


def test_facts_of_a_rate_are_its_findings_under_their_names():
    following = [Suggestion("p", "t", 2.0, 5.0, "a or b", {"x": 1})]
    air = ChannelFinding(signal="chamber_air", unit="K", verdict="not seen", reason="no chamber")
    facts = diagnosis_facts(
        Diagnosis("u", Model("m", (), WHITE), (rate_finding(), air), {"r": "s"}), following
    )
    (found,) = facts["causes"]
    names = [parameter.name for parameter in effect("shupe").parameters]
    assert found["parameters"] == dict(zip(names, (1.0, 2.0), strict=True)) and found[
        "sigma"
    ] == dict.fromkeys(names, 0.5)
    assert (found["set"], found["explained_where_it_acts"], found["shape"]) == (
        ["shupe", "warm_up"],
        None,
        {"lag_s": 0.0},
    )
    assert facts["stochastic_coefficients"] == {"noise_level": 0.005} and facts["unknown_probability"] is None
    assert (
        facts["sets"] == {"a + b": 0.7, "": 0.3}
        and facts["disturbances"][0]["parameters"]["frequency_hz"] == 0.2
    )
    assert facts["places"] == [
        {
            "profile": "shock",
            "parity": "run",
            "band": "5..9 min",
            "rms_dph": 0.5,
            "share": 1.0,
            "energy_ratio": 4.0,
            "p_value": 1e-9,
        }
    ]
    assert facts["phases"][0]["phase"] == "cold" and facts["phases"][0]["start_s"] == 7.0
    assert facts["regimes"][0]["low"] == -40.0 and facts["unknown_parts"] == [
        {
            "follows": "T_in", "sentence": "It follows.", "lag_s": None, "frequency_hz": None, "harmonic": 0,
            "unit": "ppm", "at": [1.0], "curve": [],
        }
    ]  # fmt: skip
    held = facts["held_out"]
    assert (held["share"], held["interval_95"], held["rms_before_dph"], held["rms_after_dph"]) == (
        0.9,
        [0.8, 0.99],
        2.0,
        0.2,
    )
    assert held["by_profile"] == {"a": 0.9} and facts["learned"] is None
    assert facts["channels"] == [{"channel": "chamber_air", "verdict": "not seen", "reason": "no chamber"}]
    assert facts["next"][0]["log_odds"] == 5.0 and facts["runs"] == {"r": "s"}
    nothing = Learned(share=0.5, by_profile={"a": 0.1}, valid={"T": (1.0, 2.0)}, reason="why")
    taken = diagnosis_facts(
        Diagnosis("u", Model("m", (), WHITE), (rate_finding(learned=nothing, held_out=()),), {})
    )
    assert taken["learned"] == {
        "terms": [],
        "share_left_out": None,
        "by_profile": {"a": 0.1},
        "valid": {"T": [1.0, 2.0]},
        "reason": "why",
    }
    assert taken["held_out"] is None
    whole = replace(nothing, terms=(cause("shupe").term,))
    taken = diagnosis_facts(Diagnosis("u", Model("m", (), WHITE), (rate_finding(learned=whole),), {}))
    assert taken["learned"]["share_left_out"] == 0.5 and taken["learned"]["terms"][0]["name"] == "shupe"
    assert lines_hz(rate_finding().disturbed.terms) == [0.2]


def test_facts_of_a_channel_what_runs_can_show_and_logs():
    rate = catalogue()["table_rate_error"]
    assert isinstance(rate, ChannelEffect)
    own = Cause(
        "table_rate_error", "", 0.9, ChannelTerm(rate, (5.0, 6.0), (0.1, 0.2)), {"x": 0.1}, nominal=(1.0, 0.0)
    )
    place = Place("", "turn", "8..32 s", 0.5, 1.0, 4.0, 1e-9, 7.0)
    found = ChannelFinding(
        signal="table_rate",
        unit="deg/s",
        verdict="explained",
        causes=(own,),
        places=(place,),
        rms=2.0,
        floor_rms=0.1,
        floor_source="quiet",
        explained=0.9,
        held_out=(Shrinkage(0.9, 0.8, 0.95, 2.0, 0.2),),
    )
    facts = diagnosis_facts(Diagnosis("u", Model("m", (), WHITE), (rate_finding(), found), {}))["channels"][0]
    assert facts["causes"][0]["nominal"] == {"error_ppm": 1.0, "offset_mdps": 0.0}
    assert facts["causes"][0]["parameters"] == {"error_ppm": 5.0, "offset_mdps": 6.0}
    assert facts["places"] == [
        {
            "phase": "turn",
            "band": "8..32 s",
            "rms": 0.5,
            "start_s": 7.0,
            "share": 1.0,
            "energy_ratio": 4.0,
            "p_value": 1e-9,
        }
    ]
    assert facts["held_out"] == {"share": 0.9, "low": 0.8, "high": 0.95, "rms_before": 2.0, "rms_after": 0.2}
    assert (facts["rms"], facts["floor_rms"], facts["floor_from"], facts["explained"]) == (
        2.0,
        0.1,
        "quiet",
        0.9,
    )
    shown = identifiable_facts([Identifiable("a", {"x": math.inf}, {"b": 0.01})])
    assert shown == {"effects": [{"effect": "a", "least": {"x": None}, "alike": {"b": 0.01}, "reason": ""}]}
    gap = LogGap("all", "deg/h", 2.0, 1.0, 0.5, math.nan)
    rows = log_gap_facts(LogGaps(rate=(gap,)))
    assert (
        rows["gaps"][0]["share"] is None and rows["gaps"][0]["rms_closed"] == 1.0 and rows["channels"] == []
    )
    assert list(log_gap_facts(LogGaps(headings=(gap,)))) == ["headings"]


@pytest.fixture(scope="module")
def rippled():
    """Two profiles with a bias of a sine over T_in that no effect has, three repeats each."""
    runs = []
    rng = np.random.default_rng(3)
    for profile, n in (("short", 1500), ("long", 2000)):
        s = stimulus(n)
        extra = 3.0 * np.sin(s.warm_k / 4.0)
        runs += [made_run(f"{profile} {k}", s, rng, extra, profile=profile) for k in range(3)]
    model = Model("m", (), WHITE)
    data = prepare(runs, model, [])
    return data, model, _Problem(data, model, [])


def test_energy_gone_from_a_profile_is_that_of_a_fit_to_the_others(rippled):
    """By ridge regression of the rows themselves, of one form over temperature; and what is left of each run."""
    _, _, problem = rippled
    place = next(k for k, one in enumerate(problem.candidates) if one.form.name == "bias over T_in")
    form = _Fitted(place, 1, 1.0)
    assert problem.profiles == ("short", "long") and (problem.gap > problem.noise).all()
    root = math.sqrt(float(problem.gap.sum())) * problem.roots(place)[1]
    forms = [np.float64(own)[:, 0] for own in problem._rows[1 + place]]
    columns = [root.T @ own for own in forms]
    data = [own[0, 0, : forms[k].shape[1]] for k, own in enumerate(problem._rows[0])]
    gone = []
    for left, other in ((0, 1), (1, 0)):
        x = columns[other]
        done = np.linalg.solve(x @ x.T + np.eye(len(x)), x @ data[other]) @ columns[left]
        gone.append(float(data[left] @ data[left] - (data[left] - done) @ (data[left] - done)))
    assert problem.gone_left_out([form]) == pytest.approx(gone, rel=1e-4)
    assert (np.array(gone) > 0.5 * problem.gap).all() and problem.harmed([form]) == []
    for root in problem.roots(place):
        assert sum(float(np.sum((root.T @ own) ** 2)) for own in forms) == pytest.approx(1.0, rel=1e-4)


def test_a_ripple_is_learned_with_the_range_it_holds_in(rippled):
    data, model, _ = rippled
    found = learned(data, model, [])
    assert (
        found.terms and found.share > 0.9 and set(found.by_profile) == {"short", "long"} and not found.reason
    )
    assert found.nominal == () and found.valid["rate, deg/s"] == pytest.approx((0.0, 0.0), abs=1e-9)
    s = data.groups[1].flat[0].stimulus
    made = sum(np.array(term.values) @ term.variant.columns(s) for term in found.terms)
    wanted = 3.0 * np.sin(s.warm_k / 4.0)
    assert np.std(made - wanted - np.mean(made - wanted)) < 0.2
    gain = float(np.mean([found.by_profile[name] for name in found.by_profile]))
    assert found.share == pytest.approx(gain, abs=0.1)
    (alone,) = [group for group in data.groups if group.profile == "long"]
    one = learned(prepare(alone.flat, model, []), model, [])
    assert one.terms == () and one.reason.startswith("one profile only")


def test_what_is_left_is_described_where_no_curve_is_and_repeats_do_not_differ(monkeypatch):
    place = Place("shock", "run", "5..9 min", 0.5, 1.0, 4.0, 1e-9)
    asked = []
    monkeypatch.setattr(_describe, "left_of_runs", lambda data, solution: "left")
    monkeypatch.setattr(_describe, "regime_map", lambda *given: asked.append(given[1:2]) or [])

    def found(differs=0.0, line=None, lined=0.0):
        noise = SimpleNamespace(differs=differs, noise=WHITE)
        best = SimpleNamespace(
            members=frozenset({0}),
            line=lined,
            solution=Solution(np.array([1, 2, 3]), np.array([9.0, 5.0, 6.0]), np.eye(3)),
        )
        data = SimpleNamespace(noise=noise, groups=(), floor=None)
        posterior = SimpleNamespace(candidates=(SimpleNamespace(columns=(1, 2)),))
        return SimpleNamespace(best=best, data=data, posterior=posterior, line=line)

    shupe = [effect("shupe").variants()[0]]
    (rest,) = _describe.unknown_parts(found(), shupe, [place], {})
    assert rest.sentence.startswith("It shows in shock (run)") and asked == [("left",)]
    assert _describe.unknown_parts(found(differs=0.5), shupe, [place], {}) == []
    assert _describe.unknown_parts(found(), shupe, [replace(place, p_value=0.5)], {}) == []
    line = _describe.SpectralLine("shock", 40.0, 0.1, 9.0, 0.5)
    (told,) = _describe.unknown_parts(found(line=line, lined=2.0), shupe, [place], {})
    assert told.frequency_hz == 0.025
    (rest,) = _describe.unknown_parts(found(line=line), shupe, [place], {})
    assert rest.frequency_hz is None
    curves = free_curves([made_run("r", stimulus(600), np.random.default_rng(1))])
    curve = next(
        each for each in curves if each.effect.name.endswith("bias over T_in") and len(each.effect.nodes) == 2
    )
    (part,) = _describe.unknown_parts(found(), [curve], [place], {})
    assert part.term.values == (5.0, 6.0) and part.follows == "T_in"
