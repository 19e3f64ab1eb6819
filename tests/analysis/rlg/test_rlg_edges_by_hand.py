"""Ring laser fits at their edges: single rows, the terms of an axis, rows of a folder, what is refused."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.rlg import _dataset
from bench.analysis.rlg._cycle import AxisGain, Spread, _gain, _terms, load_chamber_cycle, study_chamber_cycle
from bench.analysis.rlg._judge import hysteresis_dph, profile_of
from bench.analysis.rlg._rows import RampRun, ramp_run
from bench.analysis.rlg._study import CORRECTED, FIVE, PLAIN, run_rlg_study
from bench.record.recording import Phase
from drivers.base.errors import ConfigurationError, RecordError


def rows(case, rate, bias, **changes):
    case, rate, bias = (np.asarray(each, float) for each in (case, rate, bias))
    n = len(case)
    run = RampRun("r", "u", 100.0 * np.arange(n), case, case - 2.0, rate, rate, bias, np.zeros(n, np.int64))
    return replace(run, **changes)


def test_a_branch_of_single_rows_has_them_for_means():
    """Cells of 2 degC from the lowest on: rows at 1, 3 and 5 degC of either way, one cell with two of them."""
    case = [-1.0, 1.0, 3.0, 3.5, 5.0, 5.0, 3.0, 1.0]
    rate = [1.0, 1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0]
    bias = [50.0, 1.0, 4.0, 6.0, 9.0, 6.0, 1.0, -1.0]
    # means while warming 1, 5 and 9, while cooling -1, 1 and 6; at -1 degC nothing came back
    expected = math.sqrt((2.0**2 + 4.0**2 + 3.0**2) / 3.0)
    run = rows(case, rate, bias)
    assert hysteresis_dph(run, run.bias_dph) == pytest.approx(expected)
    assert profile_of(run).direction == 1 and profile_of(rows(case[5:], rate[5:], bias[5:])).direction == -1
    assert profile_of(rows([5.0] * 3, [0.0] * 3, [1.0] * 3)).direction == 0
    # cells are counted from whole degrees of two, wherever the run begins
    below = rows([-0.5, 0.5, 0.5, -0.5], [1.0, 1.0, -1.0, -1.0], [3.0, 8.0, 4.0, 1.0])
    assert hysteresis_dph(below, below.bias_dph) == pytest.approx(math.sqrt((2.0**2 + 4.0**2) / 2.0))


def test_an_axis_has_the_terms_of_either_regression_and_what_both_leave():
    """It follows what lags and nothing else: temperature alone explains a part, its past all of it."""
    temp = np.concatenate(
        (np.linspace(-30.0, 50.0, 60), np.linspace(49.0, -40.0, 60), np.linspace(-39.0, 60.0, 80))
    )
    _, dynamic = _terms(temp)
    rng = np.random.default_rng(3)
    means = 2.0 + 0.1 * dynamic[:, 5] + 0.3 * rng.normal(size=200)
    fitted = np.arange(200) <= 119
    found = _gain("x", means, temp, fitted, ~fitted)
    assert set(found.terms_static) <= {"T", "T^2", "T^3"} and "lag T" in found.terms_dynamic
    assert found.left_dynamic.std() < 0.35 < 0.7 < found.left_static.std()
    assert found.after_dynamic.sigma == pytest.approx(np.std(found.left_dynamic[120:], ddof=1))
    assert found.after_static.rms == pytest.approx(math.sqrt(np.mean(found.left_static[120:] ** 2)))
    # before, the mean of the fitted legs foretells it
    apart = means - means[:120].mean()
    assert found.before.sigma == pytest.approx(np.std(apart[120:], ddof=1))
    assert found.before.rms == pytest.approx(math.sqrt(np.mean(apart[120:] ** 2)))
    assert found.means.tolist() == means.tolist() and not found.one_way
    for still in (np.where(fitted, 1.0, means), np.where(fitted, means, 1.0)):
        with pytest.raises(RecordError, match="does not change"):
            _gain("x", still, temp, fitted, ~fitted)


def test_means_beyond_the_fitted_range_are_counted_and_not_judged():
    rng = np.random.default_rng(4)
    temp = np.concatenate((np.linspace(0.0, 40.0, 20), np.linspace(38.0, -40.0, 40)))
    rates = {"x": 0.1 * np.repeat(temp, 25) + 0.01 * rng.normal(size=1500)}
    found = study_chamber_cycle(np.repeat(temp, 25), rates)
    held_out = temp[20:]
    beyond = int((held_out < 0.0).sum())
    assert found.turn == 19 and found.temp_c == pytest.approx(temp)
    assert f"{beyond} of 40 means of the held-out leg are beyond the fitted range" in found.remarks
    assert any(remark.startswith("the fitted leg goes one way only") for remark in found.remarks)
    (axis,) = found.axes
    judged = (axis.means - axis.means[:20].mean())[20:][held_out >= 0.0]
    assert axis.before.sigma == pytest.approx(np.std(judged, ddof=1)) and axis.one_way
    with pytest.raises(RecordError, match="no axis can be judged") as refused:
        study_chamber_cycle(np.repeat(temp, 25), {"y": np.full(1500, np.nan), "z": np.full(1500, 2.0)})
    assert refused.value.found.startswith("y: more than half of its values are missing; z: ")


def test_columns_of_a_log_are_its_gyros_by_axis_and_the_first_temperature_there_is(monkeypatch):
    from bench.analysis.rlg import _cycle

    tables = []
    monkeypatch.setattr(_cycle, "read_mapping", lambda path: SimpleNamespace(axis="y"))
    monkeypatch.setattr(_cycle, "read_log", lambda path, mapping: SimpleNamespace(columns=tables[-1]))
    one, two = np.array([1.0]), np.array([2.0])
    tables.append({"air": one, "t_out": two, "rate_z": one, "rate_x": two, "other": one})
    temp, gyros = load_chamber_cycle(Path("l"), Path("m"))
    assert temp is two and list(gyros) == ["x", "z"] and gyros["z"] is one
    tables.append({"t_in": one, "t_out": two, "output": two})
    temp, gyros = load_chamber_cycle(Path("l"), Path("m"))
    assert temp is one and list(gyros) == ["y"] and gyros["y"] is two
    tables.append({"air": one, "output": two, "rate_y": one})
    assert load_chamber_cycle(Path("l"), Path("m"))[1]["y"] is one
    for columns, said in (({"air": one}, "air"), ({"output": one}, "output"), ({}, "no columns")):
        tables.append(columns)
        with pytest.raises(ConfigurationError, match="needs gyros and a temperature") as refused:
            load_chamber_cycle(Path("l"), Path("m"))
        assert refused.value.found == said


def test_rows_begin_and_end_with_whole_seconds_of_ramps_and_dwells(monkeypatch):
    asked = []
    names = ("settle", "ramp_1", "dwell_1", "ramp_2", "dwell_2", "rest")
    at_s = (0.0, 10.2, 100.7, 150.0, 300.9, 320.5, 400.0)
    phases = [Phase(*each) for each in zip(names, at_s, at_s[1:], strict=False)]

    def opened(kept, **manifest):
        told = {"procedure": "thermal-ramp", "outcome": "aborted", "reason": "by hand", "units": ("g", "h")}
        run = SimpleNamespace(phases=lambda: kept, manifest=SimpleNamespace(**(told | manifest)), place="p")
        return SimpleNamespace(open=lambda folder: run)

    monkeypatch.setattr(_dataset, "_ramp_run", lambda run, *rest: asked.append(rest) or rest[0])
    monkeypatch.setattr(_dataset, "Run", opened(phases))
    assert _dataset.load_ramp_runs(Path("f")) == ["g", "h"] and _dataset.load_ramp_runs(
        Path("f"), ("h",)
    ) == ["h"]
    ramps = [(10.2, 100.7), (150.0, 300.9)]
    assert asked == [("g", 11, 320, ramps), ("h", 11, 320, ramps), ("h", 11, 320, ramps)]
    monkeypatch.setattr(_dataset, "Run", opened(phases[:3]))
    _dataset.load_ramp_runs(Path("f"), ("g",))
    assert asked[-1] == ("g", 11, 150, ramps[:1])
    for kept, reason, found, remedy in (
        (phases[:1], "by hand", "thermal-ramp, aborted: settle", "by hand"),
        ([phases[0], phases[5]], "", "thermal-ramp, aborted: settle, rest", "run thermal-ramp"),
        ([], "", "thermal-ramp, aborted: no phases", "run thermal-ramp"),
    ):
        monkeypatch.setattr(_dataset, "Run", opened(kept, reason=reason))
        with pytest.raises(ConfigurationError, match="has no ramp") as refused:
            _dataset.load_ramp_runs(Path("f"))
        assert (refused.value.found, refused.value.remedy) == (found, remedy)


def test_folders_are_sorted_by_unit_and_only_those_to_judge_on_may_have_been_stopped(monkeypatch):
    taken = {}
    runs = {"a": ["u", "v"], "b": ["u"], "c": ["v"], "stopped": ["u", "w"]}

    def loaded(folder, gyros):
        return [
            SimpleNamespace(unit_id=unit, run_id=f"{folder.name} {unit} {gyros}")
            for unit in runs[folder.name]
        ]

    def study(training, tests, variables, *, p_enter, p_remove):
        taken[training[0].unit_id] = ([run.run_id for run in training], [run.run_id for run in tests])
        return (variables, p_enter, p_remove)

    def opened(folder):
        outcome = "aborted" if folder.name == "stopped" else "completed"
        return SimpleNamespace(place=folder, manifest=SimpleNamespace(outcome=outcome, reason="r"))

    monkeypatch.setattr(_dataset, "Run", SimpleNamespace(open=opened))
    monkeypatch.setattr(_dataset, "load_ramp_runs", loaded)
    monkeypatch.setattr(_dataset, "run_rlg_study", study)
    folders = [Path(name) for name in ("a", "b", "c", "stopped")]
    found = _dataset.study_units(folders[:2], folders[2:], ("g",), ("T1",), p_enter=0.01, p_remove=0.2)
    assert found == dict.fromkeys("uv", (("T1",), 0.01, 0.2))
    assert taken == {
        "u": (["a u ('g',)", "b u ('g',)"], ["stopped u ('g',)"]), "v": (["a v ('g',)"], ["c v ('g',)"]),
    }  # fmt: skip
    assert _dataset.study_units(folders[:1], ())["v"] == (_dataset.CANDIDATES, 0.05, 0.10)
    assert taken["v"][1] == []
    with pytest.raises(ConfigurationError, match="not completed cannot be fitted"):
        _dataset.study_units(folders[3:], ())


def wandering(n, seed, **changes):
    """Two temperatures that wander apart; the bias follows one of them, its rate and white noise."""
    rng = np.random.default_rng(seed)
    case, block = np.cumsum(rng.normal(size=(2, n)), axis=1)
    rate = rng.normal(size=(2, n))
    run = RampRun(
        "r",
        "u",
        100.0 * np.arange(n),
        case,
        block,
        *rate,
        1.0 + 0.5 * case - 0.3 * rate[0],
        np.zeros(n, np.int64),
    )
    return replace(run, bias_dph=run.bias_dph + 0.05 * rng.normal(size=n), **changes)


def test_a_study_needs_three_rows_more_than_variables():
    names = ("T1", "dT1", "T2")
    for n, enough in ((5, False), (6, True)):
        run = wandering(n, 1)
        if enough:
            assert run_rlg_study([run], (), names).variant(PLAIN).result.n == 6
            continue
        with pytest.raises(ConfigurationError, match="too few rows") as refused:
            run_rlg_study([run], (), names)
        assert refused.value.found == "5 rows of 100 s, 3 usable variables"
        assert refused.value.expected == "at least 6 rows and one variable"
    still = wandering(40, 2, case_c=np.full(40, 3.0))
    with pytest.raises(ConfigurationError, match="too few rows") as refused:
        run_rlg_study([still], (), ("T1",))
    assert refused.value.found == "40 rows of 100 s, 0 usable variables"


def test_five_terms_stand_beside_the_selections_with_all_of_them_in():
    runs = [wandering(150, 3, run_id="a"), wandering(150, 4, run_id="b")]
    study = run_rlg_study(runs, [wandering(100, 5, run_id="c")])
    assert [variant.name for variant in study.variants] == [PLAIN, CORRECTED, FIVE]
    five = study.variant(FIVE).result
    assert five.selected == five.names == ("T1", "dT1", "T1*dT1", "dT1^2", "T1-T2")
    bias = np.concatenate([run.bias_dph for run in runs])
    case, block, rate = (np.concatenate([getattr(run, name) for run in runs])
                         for name in ("case_c", "block_c", "case_rate"))  # fmt: skip
    design = np.column_stack((np.ones(300), case, rate, case * rate, rate**2, case - block))
    weights = np.linalg.lstsq(design, bias, rcond=None)[0]
    assert five.final.coefficient == pytest.approx(weights[1:]) and five.final.intercept == pytest.approx(
        weights[0]
    )
    assert five.whitening_rho == 0.0 == study.variant(PLAIN).result.whitening_rho
    assert study.chosen is study.variant(CORRECTED) and study.equation.result.n == 298
    assert {"T1", "dT1"} <= set(study.equation.result.selected)
    assert study.shown()["tests"] == ["c"] and study.unit_id == "u"
    without = run_rlg_study(runs, (), ("T1", "dT1", "T2"))
    assert [variant.name for variant in without.variants] == [PLAIN, CORRECTED]


def test_a_row_needs_more_than_half_of_its_seconds_and_a_run_three_rows():
    time_s = np.arange(1.0, 451.0)
    case, bias = 0.01 * time_s, 5.0 + 0.1 * (np.arange(450) % 100)
    made = ramp_run("r", "u", time_s, case, case + 1.0, bias, true_bias_dph=bias - 5.0)
    assert made.time_s.tolist() == [50.5, 150.5, 250.5, 350.5] and made.remarks == ()
    assert made.case_rate == pytest.approx(np.full(4, 0.6)) and made.true_bias_dph == pytest.approx(
        [4.95] * 4
    )
    holes = bias.copy()
    holes[100:150] = np.nan
    found = ramp_run("r", "u", time_s, case, case + 1.0, holes)
    assert found.remarks == ("1 of 4 rows left out: bias is missing in them",)
    assert found.time_s.tolist() == [50.5, 250.5, 350.5] and found.segment.tolist() == [0, 1, 1]
    holes[120] = 1.0
    assert len(ramp_run("r", "u", time_s, case, case + 1.0, holes).time_s) == 4
    holes[100:150] = holes[300:360] = np.nan
    with pytest.raises(ConfigurationError, match="hardly any rows") as refused:
        ramp_run("r", "u", time_s, case, case + 1.0, holes)
    assert refused.value.found == "2 of 100 s with bias and both temperatures"
    assert refused.value.remedy == "2 of 4 rows left out: bias is missing in them"


@pytest.mark.parametrize(("left", "depends"), [(4.55, False), (4.49, True)])
def test_an_axis_depends_on_the_past_where_that_takes_five_parts_in_a_hundred_more(left, depends):
    """Of 10, temperature leaves 5; with its past 4.55 are 4.5 % less, 4.49 are 5.1 %."""
    none = np.zeros(3)
    parts = [Spread(own, own) for own in (10.0, 5.0, left)]
    axis = AxisGain("x", *parts, ("T",), ("T", "lag T"), none, none, none)
    assert axis.verdict.startswith("depends on the temperature's past or rate (lag T)") == depends
    assert axis.static_pct == pytest.approx(50.0) and axis.dynamic_pct == pytest.approx(100.0 - 10.0 * left)
