"""Thermal models, their terms, widths, networks and files, by hand and against numpy."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.common.fan_out import ALONE
from bench.analysis.common.stepwise import stepwise
from bench.analysis.thermal import _anchor, _dataset
from bench.analysis.thermal._anchor import anchor_runs
from bench.analysis.thermal._compensation import Compensation
from bench.analysis.thermal._dataset import _end_s
from bench.analysis.thermal._evaluate import evaluate
from bench.analysis.thermal._features import centred_mean
from bench.analysis.thermal._grey_box import GreyBoxModel, GreyBoxParameters, _cost, _inputs, _terms
from bench.analysis.thermal._hybrid import GreyResidualModel
from bench.analysis.thermal._leave_out import _score, choose
from bench.analysis.thermal._linear_models import (
    RIDGES,
    CubicModel,
    LaggedRidgeModel,
    MultilinearModel,
    StepwiseModel,
)
from bench.analysis.thermal._lstm import LstmModel
from bench.analysis.thermal._lstm_training import _cosine, _initial_weights
from bench.analysis.thermal._lstm_weights import LstmSettings
from bench.analysis.thermal._mean import MeanModel, mean_prediction
from bench.analysis.thermal._registry import new_model, restore_model
from bench.analysis.thermal._regression import anchored_errors, fit_ridge, standardisation, target_rows
from bench.analysis.thermal._selection import ModelScore, fit_models, score_models, score_predictions
from bench.analysis.thermal._signals import lag_terms, signals
from bench.analysis.thermal._stream import FEATURES
from bench.analysis.thermal._sum import SumModel, residual
from bench.analysis.thermal._types import Prediction, ThermalRun
from bench.analysis.thermal._width import PredictionWidth, fit_width
from bench.record.recording import Phase
from drivers.base.errors import ConfigurationError
from tests.analysis.thermal.test_thermal_choices_by_hand import Level, features


def test_terms_are_those_that_the_models_names_say():
    """Of signals 2, 3, 5, 7 and 11: every product is another number."""
    one = SimpleNamespace(t_in=np.array([2.0]), t_out=np.array([3.0]), dt_in=np.array([5.0]),
                          dt_out=np.array([7.0]), gradient=np.array([11.0]))  # fmt: skip
    assert CubicModel().terms(one).tolist() == [[2.0, 4.0, 8.0]]
    assert MultilinearModel().terms(one).tolist() == [[2.0, 4.0, 8.0, 5.0, 11.0]]
    # 1 is the case, 2 the inside
    assert StepwiseModel().terms(one).tolist() == [[3, 2, 7, 5, 21, 10, 49, 25, 9, 4, 1]]


def test_a_stepwise_model_chooses_on_a_row_every_100_s_and_is_fitted_on_all():
    rng = np.random.default_rng(8)
    runs = []
    for name in "ab":
        run = features(name, 600, ord(name), step_s=20.0)
        signal = 3.0 * run.t_in - 0.2 * run.t_out**2
        runs.append(replace(run, bias_dph=signal + rng.normal(0.0, 30.0, 600)))
    model = StepwiseModel(p_enter=0.02)
    model.fit(runs, ())
    rows = target_rows([model.run_terms(run) for run in runs], runs, "bias_dph")
    chosen = stepwise(rows.terms[::5], rows.target[::5], p_enter=0.02, segments=rows.run[::5]).final.included
    assert 1 < chosen.sum() < 11
    design = np.column_stack((np.ones(len(rows.target)), rows.terms[:, chosen]))
    expected = design @ np.linalg.lstsq(design, rows.target, rcond=None)[0]
    assert model.map.apply(rows.terms)[:, 0] == pytest.approx(expected, abs=1e-6 * np.ptp(expected))
    assert not model.map.apply(rows.terms)[:, 1].any()


def test_penalties_of_each_target_are_those_with_the_least_error_on_the_validation_runs():
    runs = [features(name, 50, ord(name), sf=True) for name in "ab"]
    checks = [features("c", 45, 7), features("d", 55, 8, bias=False, sf=True)]
    model = LaggedRidgeModel()
    model.fit(runs, checks)
    maps = fit_ridge([model.run_terms(run) for run in runs], runs, RIDGES)
    for place, (target, check) in enumerate(zip(("bias_dph", "sf_error_ppm"), checks, strict=True)):
        errors = [anchored_errors([own.predict(model.run_terms(check))], [check], target) for own in maps]
        best = int(np.argmin([np.mean(each**2) for each in errors]))
        assert model.ridge[place] == RIDGES[best]
        assert model.map.apply(model.run_terms(check))[:, place] == pytest.approx(
            maps[best].apply(model.run_terms(check))[:, place]
        )
    state = model.to_state()
    again = LaggedRidgeModel.from_state(state)
    assert again.ridge == model.ridge and again.step_s == 10.0 and again.name == "lag_ridge"
    with pytest.raises(ConfigurationError, match="not those of this version"):
        LaggedRidgeModel.from_state({**state, "lag_times_s": [40.0]})


def test_a_grey_box_takes_the_start_that_leads_to_the_least_cost():
    """Two starts that do not move: without a validation run the training cost decides, with one its own."""
    true = GreyBoxParameters(0.03, 0.02, 0.3, 1e-3, -10.0, 6.0)
    other = GreyBoxParameters(0.2, 0.001, 0.02, 4e-4, 10.0, 20.0)
    runs = []
    for name in "abc":
        run = features(name, 120, ord(name))
        (block,) = _terms(true, _inputs([run]), [run], 10.0)
        drift = 40.0 * block[:, 0] + 3.0 * block[:, 7] - 2.0 * block[:, 8] + block[:, 9]
        runs.append(replace(run, bias_dph=drift + 0.05 * np.random.default_rng(ord(name)).normal(size=120)))
    for starts in ((true, other), (other, true)):
        for checks in ((), runs[2:]):
            model = GreyBoxModel(evaluations=1, starts=starts)
            model.fit(runs[:2], checks)
            assert model.parameters.to_vector() == pytest.approx(true.to_vector())
    (fitted,) = fit_ridge([model.run_terms(run) for run in runs[:2]], runs[:2], [1e-9])
    assert model.map.coefficients == pytest.approx(fitted.coefficients)
    assert _cost(model.parameters, fitted, runs[:2], 10.0) < 3.0
    state = model.to_state()
    assert GreyBoxModel.from_state(state).parameters == model.parameters
    assert model.unfitted().starts == (model.parameters,)
    for name, value in (("k_in", 0.0), ("width_c", -1.0)):
        with pytest.raises(ValueError, match="not above zero"):
            GreyBoxModel.from_state({**state, "parameters": {**state["parameters"], name: value}})
    assert GreyBoxModel.from_state({**state, "parameters": {**state["parameters"], "transition_c": 0.0}})
    vector = true.to_vector()
    assert vector == pytest.approx(
        [math.log(0.03), math.log(0.02), math.log(0.3), math.log(1e-3), -1.0, math.log(6)]
    )
    assert GreyBoxParameters.from_vector(vector).to_vector() == pytest.approx(vector)
    fresh = GreyResidualModel(model).unfitted()
    assert fresh.first.starts == (model.parameters,) and fresh.second.with_temperature


def test_a_mean_of_models_is_taken_where_their_errors_cancel():
    runs = []
    for name in "abcd":
        run = features(name, 60, ord(name))
        runs.append(replace(run, bias_dph=run.t_in + 0.01 * np.random.default_rng(ord(name)).normal(size=60)))
    models = {name: Level(name, gain) for name, gain in (("more", 1.2), ("less", 0.8))}
    choice = choose(models, score_models(models, runs[3:]), runs[:3], runs[3:], fan=ALONE)
    assert isinstance(choice.model, MeanModel) and {part.name for part in choice.model.parts} == {
        "more",
        "less",
    }
    assert set(choice.models) == {"more", "less", "mean"} and choice.models["mean"] is choice.model
    assert choice.scores[0].name == "mean" and len(choice.scores) == 3
    assert set(choice.scores[0].parts) == {"more", "less"} and choice.scores[0].score < 0.05
    assert [score.parts for score in choice.scores[1:]] == [(), ()]
    single = _score("more", choice.folds, ("more",), np.array([0.2, 0.3]))
    assert (single.parts, single.left_out, single.score) == ((), 2, pytest.approx(0.25))
    assert single.standard_error == pytest.approx(0.05)
    found = mean_prediction([Prediction(np.array([1.0, 2.0]), np.array([4.0, 0.0])),
                             Prediction(np.array([3.0, 8.0]), np.array([0.0, 0.0]))])  # fmt: skip
    assert (found.bias_dph.tolist(), found.sf_error_ppm.tolist()) == ([2.0, 5.0], [2.0, 0.0])


def test_a_score_is_the_mean_over_the_targets_of_what_is_left():
    runs = [
        features("a", 40, 1),
        features("b", 30, 2, bias=False, sf=True, weightless=7),
        features("c", 20, 3),
    ]
    half = [Prediction(0.5 * (run.bias_dph if run.bias_dph is not None else np.zeros(30)),
                       0.1 * run.sf_error_ppm if run.sf_error_ppm is not None else np.zeros(len(run.time_s)))
            for run in runs]  # fmt: skip
    found = score_predictions("x", half, runs)
    ratios = []
    for target, weightless in (("bias_dph", 5), ("sf_error_ppm", 7)):
        carried = [
            (run, own) for run, own in zip(runs, half, strict=True) if getattr(run, target) is not None
        ]
        left = np.concatenate([anchored_errors([own], [run], target) for run, own in carried])
        raw = np.concatenate([getattr(run, target)[weightless:] for run, _ in carried])
        ratios.append(math.sqrt(np.mean(left**2) / np.mean(raw**2)))
        if target == "bias_dph":
            assert found.bias_rms_dph == pytest.approx(math.sqrt(np.mean(left**2)))
    assert found.score == pytest.approx(np.mean(ratios))
    alone = score_predictions("x", half[:1], runs[:1])
    assert alone.sf_rms_ppm is None and alone.score == pytest.approx(
        alone.bias_rms_dph / math.sqrt(np.mean(runs[0].bias_dph[5:] ** 2))
    )
    with pytest.raises(ConfigurationError, match="no validation run has a usable target") as refused:
        score_predictions("x", half[:1], [replace(runs[0], bias_dph=None)])
    assert refused.value.found == "1 validation runs"
    state = ModelScore("m", 1.0, None, 0.5).to_state()
    assert state == {"name": "m", "bias_rms_dph": 1.0, "sf_rms_ppm": None, "score": 0.5}
    assert len(ModelScore("m", 1.0, None, 0.5, 1, 0.1).to_state()) == 7


def test_models_are_fitted_by_name_and_come_back_by_name():
    runs = [features(name, 60, ord(name)) for name in "ab"]
    models = fit_models(runs, (), ("multilinear", "poly3"))
    assert list(models) == ["multilinear", "poly3"]
    assert [score.name for score in score_models(models, runs[:1])] == sorted(
        models, key=lambda name: score_predictions(name, [models[name].predict(runs[0])], runs[:1]).score
    )
    mean = MeanModel(list(models.values()))
    again = restore_model("mean", mean.to_state())
    assert again.predict(runs[1]).bias_dph == pytest.approx(mean.predict(runs[1]).bias_dph)
    with pytest.raises(ValueError, match="mean of no models"):
        restore_model("mean", {"parts": []})
    with pytest.raises(ConfigurationError, match="no thermal model named 'poly4'"):
        new_model("poly4")


def test_half_widths_grow_with_rate_gradient_and_the_way_out_of_the_range():
    """Base 2, 3 a degC/min, 0.5 a degC of gradient; a tenth of a range outside doubles them, excesses add."""
    width = PredictionWidth(np.array([[2.0, 3.0, 0.5], [0.0, 1.0, 0.0]]), 4)
    ranges = {"t_in": (0.0, 40.0), "t_out": (-10.0, 10.0), "dt_60": (-2.0, 2.0), "gradient": (-8.0, 8.0)}
    rows = np.array(
        [[0.0, 10.0, 0.0, 0.0], [40.0, -10.0, -2.0, 8.0], [44.0, 0.0, 0.0, 0.0], [-2.0, 11.0, 1.0, -4.0]]
    )
    base = [[2.0, 0.0], [12.0, 2.0], [2.0, 0.0], [7.0, 1.0]]
    factor = [1.0, 1.0, 2.0, 1.0 + 10.0 * (2.0 / 40.0 + 1.0 / 20.0)]
    assert width.half_widths(rows, ranges) == pytest.approx(np.array(base) * np.array(factor)[:, None])
    assert PredictionWidth.from_state(width.to_state()).coefficients.tolist() == width.coefficients.tolist()
    for bad in (np.zeros((3, 2)), np.array([[0.0, -1e-9, 0.0], [0.0, 0.0, 0.0]])):
        with pytest.raises(ValueError, match="that are none"):
            PredictionWidth.from_state({"coefficients": bad, "runs": 1})
    runs = [features("a", 40, 1)]
    model = SimpleNamespace(name="m")
    assert Compensation.from_fit(model, runs).half_widths(runs[0]) is None
    known = Compensation.from_fit(model, runs, width=width).half_widths(runs[0])
    used = known[5:]
    expected = 2.0 + 3.0 * np.abs(runs[0].dt_60) + 0.5 * np.abs(runs[0].gradient)
    assert used[:, 0] == pytest.approx(expected[5:]) and known.shape == (40, 2)


def test_a_test_ends_where_it_is_closed_and_else_with_its_last_phase():
    phases = [Phase("hold", 0.0, 50.0), Phase("close", 50.0, 70.0), Phase("close", 70.0, 90.0)]
    assert _end_s(phases) == 50.0
    assert _end_s([Phase("hold", 0.0, 50.0), Phase("shock", 50.0, 80.0), Phase("hold", 80.0, 95.0)]) == 95.0


def test_a_learning_rate_falls_along_half_a_cosine():
    settings = LstmSettings(epochs=5, learning_rate=0.9, final_learning_rate=0.1)
    assert [_cosine(settings, epoch) for epoch in range(5)] == pytest.approx(
        [0.9, 0.5 + 0.4 * math.sqrt(0.5), 0.5, 0.5 - 0.4 * math.sqrt(0.5), 0.1]
    )
    assert _cosine(LstmSettings(epochs=1, learning_rate=0.9), 0) == 0.9


def test_weights_that_do_not_fit_together_are_refused():
    settings = LstmSettings(hidden=3, warm_up=2)
    model = LstmModel(settings)
    with pytest.raises(ConfigurationError, match="has not been fitted"):
        model.stepper()
    model._weights = _initial_weights(
        settings, np.zeros(3), np.ones(3), np.array([1.0, -2.0]), np.array([2.0, 5.0])
    )
    state = model.to_state()
    run = features("a", 12, 3)
    assert LstmModel.from_state(state).predict(run).bias_dph.tolist() == model.predict(run).bias_dph.tolist()
    for key, value in state["weights"].items():
        grown = np.concatenate((np.asarray(value), np.asarray(value)[:1]))
        with pytest.raises(ValueError, match=f"{key} of shape"):
            LstmModel.from_state({**state, "weights": {**state["weights"], key: grown}})
    flat = {**state["weights"], "input_high": np.array([1.0, 0.0, 1.0])}
    with pytest.raises(ValueError, match="range is empty"):
        LstmModel.from_state({**state, "weights": flat})


def test_a_runs_rows_in_and_out_of_range_are_judged_apart():
    """Blocks of +1 and -1, four times as much out of range; the prediction takes half of it off.

    Rows before the reference do not count; a block of 100 s with one step outside is outside.
    """
    n = 4000
    time_s = np.arange(1.0, n + 1.0)
    block = np.where(np.arange(n) // 100 % 2 == 0, 1.0, -1.0) * np.where(np.arange(n) < 2000, 1.0, 4.0)
    outside = np.arange(400) >= 200
    outside[:3] = True
    outside[73] = True
    warm = np.full(n, 25.0)
    run = ThermalRun("r", "u", time_s, warm, warm, 7.0 + block, None, (401.0, 601.0))
    half = Prediction(0.5 * block[::10] + 2.0, 0.5 * block[::10] - 3.0)
    assert evaluate(half, run).apart is None
    found = evaluate(half, run, outside).apart
    inner = np.tile([1.0, -1.0], 8)[np.arange(16) != 3]
    outer = np.append(np.tile([4.0, -4.0], 10), -1.0)
    assert (found.outside, found.count) == (2010, 3600)
    assert (found.inside_before, found.outside_before) == pytest.approx(
        (np.std(inner, ddof=1), np.std(outer, ddof=1))
    )
    assert (found.inside_after, found.outside_after) == pytest.approx(
        (0.5 * found.inside_before, 0.5 * found.outside_before)
    )
    group = evaluate(half, replace(run, bias_dph=None, sf_error_ppm=3.0 + block), outside).apart
    assert (group.inside_before, group.inside_after) == pytest.approx((1.0, 0.5))
    assert group.outside_after == pytest.approx(0.5 * math.sqrt(np.mean(outer**2)))
    both = evaluate(half, replace(run, sf_error_ppm=9.0 * block), outside).apart
    assert both == found


def test_of_two_targets_one_may_have_no_width():
    """The bias is not carried: its row is nothing, and that of the scale factor is found all the same."""
    run = features("a", 400, 2, bias=False, sf=True)
    run = replace(run, sf_error_ppm=np.where(run.time_s < 1100.0, 0.0, np.tile([8.0, -8.0], 200)))
    found = fit_width([(run, Prediction(np.zeros(400), np.zeros(400)))])
    assert not found.coefficients[0].any() and found.runs == 1
    assert found.half_widths(np.zeros(4), dict.fromkeys(FEATURES, (-1.0, 1.0)))[1] == pytest.approx(
        1.5 * 1.96 * 8.0, rel=0.1
    )


def test_a_sum_of_models_adds_both_targets_and_streams_alike():
    class Twice(SumModel):
        name, KEYS = "twice", ("one", "two")

        def __init__(self):
            super().__init__(CubicModel(), MultilinearModel())

    train = [features(name, 80, ord(name), sf=True) for name in "ab"]
    model = Twice()
    model.fit(train, ())
    first = model.first.predict(train[0])
    left = residual(model.first, train[0])
    assert left.bias_dph.tolist() == (train[0].bias_dph - first.bias_dph).tolist()
    assert left.sf_error_ppm.tolist() == (train[0].sf_error_ppm - first.sf_error_ppm).tolist()
    second, found = model.second.predict(train[0]), model.predict(train[0])
    assert found.bias_dph.tolist() == (first.bias_dph + second.bias_dph).tolist()
    assert found.sf_error_ppm.tolist() == (first.sf_error_ppm + second.sf_error_ppm).tolist()
    again = Twice.from_state(model.to_state())
    assert again.predict(train[1]).bias_dph == pytest.approx(model.predict(train[1]).bias_dph)
    assert isinstance(again.second, MultilinearModel)
    stepper, run = again.stepper(), train[0]
    steps = [stepper.step(*row) for row in zip(run.t_in, run.t_out, run.dt_60, run.gradient, strict=True)]
    assert np.array(steps) == pytest.approx(np.column_stack((found.bias_dph, found.sf_error_ppm)), abs=1e-6)


def test_constants_of_runs_are_those_of_a_ridge_on_their_terms_alone(monkeypatch):
    """By numpy on the rows with one column a run, the penalty as rows of its own."""
    ridge = 0.3
    monkeypatch.setattr(_anchor, "_RIDGE", ridge)
    runs = [features(name, 50, ord(name), sf=name == "b") for name in "abc"]
    found = anchor_runs(runs)
    terms = [lag_terms(signals(run), with_temperature=True) for run in runs]
    _, scale = standardisation(terms, runs)
    rows = target_rows(terms, runs, "bias_dph")
    member = (rows.run[:, None] == np.arange(3)).astype(float)
    count = rows.terms.shape[1]
    design = np.vstack([np.hstack([rows.terms / scale, member]),
                        math.sqrt(ridge * len(rows.target)) * np.eye(count, count + 3)])  # fmt: skip
    constants = np.linalg.lstsq(design, np.concatenate((rows.target, np.zeros(count))), rcond=None)[0][count:]
    temps = [run.t_out[5:10].mean() for run in runs]
    kept = constants[np.argmin(np.abs(np.array(temps) - np.median(temps)))]
    for own, run, constant in zip(found, runs, constants, strict=True):
        assert own.bias_dph == pytest.approx(run.bias_dph - (constant - kept), abs=1e-6)
    assert found[1].sf_error_ppm == pytest.approx(runs[1].sf_error_ppm) and found[0].sf_error_ppm is None


def test_rows_of_a_rate_run_are_whole_seconds_from_its_reference_on(monkeypatch):
    monkeypatch.setattr(_dataset, "case_temp_c", lambda run, gyro, start, end: np.full(end - start, 21.0))
    phases = [Phase("settle", 90.2, 100.7), Phase("reference", 100.7, 130.2), Phase("shock", 130.2, 160.9),
              Phase("reference", 170.0, 180.0), Phase("close", 190.0, 200.0)]  # fmt: skip
    run = SimpleNamespace(
        phases=lambda: phases, place="p", checksum="sum",
        manifest=SimpleNamespace(run_id="r", unit=lambda gyro: f"unit of {gyro}", stream={}),
        second_means=lambda gyro, start, end: SimpleNamespace(rate_dps=np.arange(start, end) / 3600.0,
                                                              temp_c=np.full(end - start, 30.0)),
        true_means=lambda gyro, name, start, end: np.array([start, end]),
        earth_rate_dph=lambda time_s: time_s - 3.0,
    )  # fmt: skip
    found = _dataset._rate_run(run, "g", 20.0, 90.2, 160.9)
    assert found.time_s.tolist() == list(range(1, 61)) and found.output_dps[0] == 100.0 / 3600.0
    assert found.reference == (0.0, pytest.approx(30.2)) and found.rate_dps == 20.0
    assert [(pytest.approx(at), name) for at, name in found.phases] == [
        (0.7, "reference"),
        (30.2, "shock"),
    ] or (found.phases[-1] == (pytest.approx(30.2), "shock"))
    assert found.true_sf_error_ppm.tolist() == [100, 160] and found.unit_id == "unit of g"
    phases[0] = Phase("equilibrium", 90.2, 100.7)
    whole = _dataset._bias_run(run, "g")
    assert whole.time_s.tolist() == list(range(91, 191)) and whole.reference == (100.7, 130.2)
    # output of 90 deg/h in the second from 90 on, less an Earth rate of its middle, 90.5 - 3
    assert whole.bias_dph == pytest.approx(np.full(100, 2.5)) and whole.true_bias_dph.tolist() == [90, 190]
    assert (whole.run_id, whole.checksum, whole.meta) == ("r", "sum", {"gyro": "g"})
    assert whole.gyro_temp_c[0] == 30.0 and whole.case_temp_c[0] == 21.0 and whole.sf_error_ppm is None
    run.manifest = SimpleNamespace(outcome="o", reason="")
    with pytest.raises(ConfigurationError, match="no phase 'reference'"):
        _dataset._rate_run(run, "g", 1.0, 131.0, 170.0)


@pytest.mark.parametrize(
    ("count", "known", "there"), [(4, 2, True), (4, 1, False), (5, 3, True), (5, 2, False)]
)
def test_a_mean_around_a_sample_needs_half_of_its_window(count, known, there):
    values = np.full(21, np.nan)
    values[10 - count // 2 : 10 - count // 2 + known] = np.arange(known) + 3.0
    found = centred_mean(values, count)[10]
    assert found == pytest.approx(np.arange(known).mean() + 3.0) if there else math.isnan(found)
    assert centred_mean(np.arange(9.0), 4).tolist() == [0.5, 1.0, 1.5, 2.5, 3.5, 4.5, 5.5, 6.5, 7.0]
