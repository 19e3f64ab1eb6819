"""Choice of a thermal model, its limits, scores and parts, on small made runs and by hand."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bench.analysis.common.statistics import block_means
from bench.analysis.thermal._anchor import anchor_runs
from bench.analysis.thermal._compensation import Compensation, _limits
from bench.analysis.thermal._diffusion import NODES, diffusion
from bench.analysis.thermal._evaluate import evaluate, noise_floor
from bench.analysis.thermal._features import prepare
from bench.analysis.thermal._grey_box import (
    GreyBoxParameters,
    GreyBoxStepper,
    _cost,
    _errors,
    _inputs,
)
from bench.analysis.thermal._grey_box import _terms as grey_terms
from bench.analysis.thermal._leave_out import (
    Fold,
    _alike,
    _folds,
    _last_of_each,
    _predicted,
    _score,
    _tied_with_best,
    _unlike,
    choose,
)
from bench.analysis.thermal._linear_models import LaggedRidgeModel, StepwiseModel, _left_out_scores
from bench.analysis.thermal._lstm import LstmStepper
from bench.analysis.thermal._lstm_training import _batch, _initial_weights, _input_range, _target_range
from bench.analysis.thermal._lstm_weights import INPUTS, LstmSettings
from bench.analysis.thermal._mean import MeanModel
from bench.analysis.thermal._regression import (
    LinearMap,
    anchored_errors,
    fit_ordinary,
    fit_ridge,
    standardisation,
    target_noise,
    target_rows,
)
from bench.analysis.thermal._scale_factor import RateRun, find_shift, scale_factor_group, shifted
from bench.analysis.thermal._selection import ModelScore, score_predictions
from bench.analysis.thermal._signals import LAG_TIMES_S, SignalStream, lag_terms, low_passes, signals
from bench.analysis.thermal._stream import CompensationStream, Flag, Limits
from bench.analysis.thermal._sum import SumStepper, residual
from bench.analysis.thermal._types import FeatureRun, Prediction, ThermalRun
from bench.analysis.thermal._width import fit_width
from drivers.base.errors import ConfigurationError, LimitExceeded, RecordError


def features(name="r", n=40, seed=1, *, bias=True, sf=False, step_s=10.0, weightless=5, **changes):
    """A run from 1000 s on; the first rows weigh nothing, the reference is rows 5 to 9."""
    rng = np.random.default_rng(seed)
    time_s = 1000.0 + step_s * np.arange(n)
    t_in, t_out = 20.0 + np.cumsum(rng.normal(size=n)), 15.0 + np.cumsum(rng.normal(size=n))
    run = FeatureRun(
        name, "u", step_s, time_s, t_in, t_out, rng.normal(size=n), t_in - t_out,
        rng.normal(3.0, 1.0, n) if bias else None, rng.normal(-7.0, 5.0, n) if sf else None,
        (np.arange(n) >= weightless).astype(float), (time_s[5], time_s[10]), f"sum of {name}",
    )  # fmt: skip
    return replace(run, **changes)


def constant(bias=0.0, sf=0.0):
    def predict(run):
        return Prediction(np.full(len(run.time_s), bias), np.full(len(run.time_s), sf))

    return predict


def test_limits_are_those_of_the_rows_that_count_and_outputs_reach_a_quarter_further():
    one, two = features("a", seed=1), features("b", n=60, seed=2, bias=False, sf=True, weightless=9)
    rows = {name: np.concatenate((getattr(one, name)[5:], getattr(two, name)[9:]))
            for name in ("t_in", "t_out", "dt_60", "gradient")}  # fmt: skip
    found = _limits([one, two])
    assert found.inputs == {name: (values.min(), values.max()) for name, values in rows.items()}
    for (low, high), values in (
        (found.bias_dph, one.bias_dph[5:]),
        (found.sf_error_ppm, two.sf_error_ppm[9:]),
    ):
        margin = 0.25 * (values.max() - values.min())
        assert (low, high) == pytest.approx((values.min() - margin, values.max() + margin))
    assert found.trained_from_s == 1050.0
    empty = replace(two, weight=np.zeros(60))
    assert _limits([one, empty]).trained_from_s == 1050.0 and _limits([one]).sf_error_ppm == (0.0, 0.0)


def test_a_compensation_says_which_runs_with_which_targets_it_is_from():
    runs = [features("a", seed=1), features("b", seed=2, sf=True), features("c", seed=3, bias=False, sf=True)]
    found = Compensation.from_fit(SimpleNamespace(name="m"), runs, runs[:1], k_ref=2.0)
    assert [(run.run_id, run.checksum, run.targets) for run in found.training_runs] == [
        ("a", "sum of a", ("bias_dph",)),
        ("b", "sum of b", ("bias_dph", "sf_error_ppm")),
        ("c", "sum of c", ("sf_error_ppm",)),
    ]
    assert [run.run_id for run in found.validation_runs] == ["a"]
    assert found.reference_temp_c == np.median([run.t_in[5:10].mean() for run in runs])
    assert (found.unit_id, found.step_s, found.k_ref, found.width) == ("u", 10, 2.0, None)
    with pytest.raises(ConfigurationError, match="no reference window") as refused:
        Compensation.from_fit(SimpleNamespace(name="m"), [replace(runs[0], reference=(0.0, 999.0))])
    assert refused.value.found == "window 0..999 s"
    with pytest.raises(ConfigurationError, match="cannot be fitted together"):
        Compensation.from_fit(SimpleNamespace(name="m"), [runs[0], replace(runs[1], unit_id="v")])


def test_the_correction_is_held_for_a_step_and_begins_with_the_first_temperature():
    class Counting:
        name = "m"

        def predict(self, run):
            self.seen = run
            return Prediction(np.arange(len(run.time_s)) * 3600.0, np.full(len(run.time_s), 1e5))

    n, model = 47, Counting()
    limits = Limits({"t_in": (-99, 99), "t_out": (-99, 99), "dt_60": (-9, 9), "gradient": (-99, 5.0)},
                    (-1e9, 3600.0), (-1e9, 1e9), 1025.0)  # fmt: skip
    compensation = Compensation.from_fit(SimpleNamespace(name="m"), [features()], k_ref=2.0)
    compensation = replace(compensation, model=model, limits=limits)
    inside = np.full(n, 20.0)
    inside[:7] = np.nan
    inside[20] = np.nan
    rate = np.full(n, 8.0)
    rate[30] = np.nan
    case = np.where(np.arange(n) < 27, 16.0, -90.0)
    found = compensation.apply("u", 1000.0 + np.arange(n), inside, case, rate)
    drift = np.where(np.arange(n) < 7, 0.0, np.minimum((np.arange(n) - 7) // 10, 1))
    assert found.bias_dph.tolist() == (3600.0 * drift).tolist()
    assert found.sf_error_ppm.tolist() == [0.0] * 7 + [1e5] * 40
    expected = (4.0 - drift) / np.where(np.arange(n) < 7, 1.0, 1.1)
    assert found.rate_dps[np.isfinite(rate)] == pytest.approx(expected[np.isfinite(rate)])
    flags = [Flag(int(each)) for each in found.flags]
    assert [Flag.NO_DRIFT in each for each in flags] == [k < 7 for k in range(n)]
    assert [Flag.RESTARTED in each for each in flags] == [k == 7 for k in range(n)]
    assert [Flag.MISSING in each for each in flags] == [k < 7 or k in (20, 30) for k in range(n)]
    assert [Flag.EARLY in each for each in flags] == [k < 25 for k in range(n)]
    assert [Flag.CLAMPED in each for each in flags] == [k >= 27 for k in range(n)]
    assert [Flag.OUT_OF_RANGE in each for each in flags] == [k >= 27 for k in range(n)]
    nothing = compensation.apply("u", 1000.0 + np.arange(n), np.full(n, np.nan), case, rate)
    assert {Flag(int(each)) & Flag.NO_DRIFT for each in nothing.flags} == {Flag.NO_DRIFT}
    assert not nothing.bias_dph.any()


def test_a_stream_that_was_silent_for_more_than_ten_minutes_begins_anew():
    made = []

    def new():
        made.append(0)
        return SimpleNamespace(step=lambda *_: (36.0 * len(made), 0.0))

    inputs = dict.fromkeys(("t_in", "t_out", "dt_60", "gradient"), (-99.0, 99.0))
    stream = CompensationStream(new, 10, Limits(inputs, (-1e3, 1e3), (-1e3, 1e3), 5.0), 1.0)
    rows = [
        (0.0, math.nan, 20.0, Flag.EARLY | Flag.MISSING | Flag.NO_DRIFT, 0),
        (1.0, 20.0, 20.0, Flag.EARLY | Flag.RESTARTED, 1), (2.0, 20.0, 20.0, Flag.EARLY, 1),
        (2.0, 20.0, 20.0, Flag.EARLY | Flag.LATE, 1), (4.0, 20.0, 20.0, Flag.EARLY | Flag.LATE, 1),
        (605.0, 20.0, 20.0, Flag.LATE, 1), (1206.0, 20.0, 20.0, Flag.LATE, 1),
        (1808.0, 20.0, 20.0, Flag.LATE | Flag.RESTARTED, 2), (1809.0, 20.0, math.nan, Flag.MISSING, 2),
        (2411.0, 20.0, math.nan, Flag.MISSING | Flag.LATE | Flag.NO_DRIFT, 0),
        (2412.0, 20.0, 1.0, Flag.RESTARTED, 3),
    ]  # fmt: skip
    for time_s, inside, case, flags, drift in rows:
        sample = stream.push(time_s, inside, case, 1.0)
        assert (sample.flags, sample.bias_dph) == (flags, 36.0 * drift), time_s
        assert sample.rate_dps == pytest.approx(1.0 - 0.01 * drift)


def test_least_squares_of_both_targets_are_numpys_on_the_rows_that_count():
    rng = np.random.default_rng(1)
    runs = [features("a", 40, 1), features("b", 30, 2, bias=False, sf=True), features("c", 35, 3, sf=True)]
    terms = [rng.normal(2.0, 3.0, (len(run.time_s), 3)) for run in runs]
    used = [block[5:] for block in terms]
    centre, scale = standardisation(terms, runs)
    assert centre == pytest.approx(np.concatenate(used).mean(axis=0))
    assert scale == pytest.approx(np.concatenate(used).std(axis=0))
    for column, (target, carriers) in enumerate((("bias_dph", (0, 2)), ("sf_error_ppm", (1, 2)))):
        x = np.concatenate([used[k] for k in carriers])
        y = np.concatenate([getattr(runs[k], target)[5:] for k in carriers])
        rows = target_rows(terms, runs, target)
        assert rows.terms.tolist() == x.tolist() and rows.target.tolist() == y.tolist()
        assert rows.run.tolist() == [k for k in carriers for _ in used[k]]
        whole = np.column_stack((np.ones(len(x)), x))
        weights = np.linalg.lstsq(whole, y, rcond=None)[0]
        fitted = fit_ordinary(terms, runs)
        expected = np.column_stack((np.ones(40), terms[0])) @ weights
        assert fitted.apply(terms[0])[:, column] == pytest.approx(expected)
        (ridged,) = fit_ridge(terms, runs, [0.3])
        z = (x - centre) / scale
        z0 = z - z.mean(axis=0)
        slope = np.linalg.solve(z0.T @ z0 + 0.3 * len(y) * np.eye(3), z0.T @ (y - y.mean()))
        level = y.mean() - z.mean(axis=0) @ slope
        assert ridged.apply(terms[0])[:, column] == pytest.approx((terms[0] - centre) / scale @ slope + level)
    flat = [np.column_stack((block, np.full(len(block), 4.0))) for block in terms]
    assert standardisation(flat, runs)[1][3] == 1.0
    with pytest.raises(ConfigurationError, match="no training run has a usable row"):
        standardisation(terms[:1], [replace(runs[0], weight=np.zeros(40))])
    for name in ("centre", "scale", "coef"):
        state = fitted.to_state()
        with pytest.raises(ValueError, match="shapes"):
            LinearMap.from_state(state | {name: np.zeros(7)})
    with pytest.raises(ValueError, match="not above zero"):
        LinearMap.from_state(state | {"scale": np.array([1.0, 0.0, 1.0])})


def test_errors_count_from_the_reference_window():
    one, two = features("a", 40, 1), features("b", 30, 2, reference=(0.0, 10.0))
    three = features("c", 20, 3, bias=False)
    found = anchored_errors([constant(1.0)(run) for run in (one, two, three)], [one, two, three], "bias_dph")
    expected = np.concatenate((one.bias_dph[5:] - one.bias_dph[5:10].mean(), two.bias_dph[5:] - 1.0))
    assert found == pytest.approx(expected)
    assert anchored_errors([constant()(one)], [one], "sf_error_ppm").tolist() == []
    score = score_predictions("m", [constant(0.5)(one)], [one])
    errors = one.bias_dph[5:] - one.bias_dph[5:10].mean()
    assert score.bias_rms_dph == pytest.approx(math.sqrt(np.mean(errors**2))) and score.sf_rms_ppm is None
    assert score.score == pytest.approx(score.bias_rms_dph / math.sqrt(np.mean(one.bias_dph[5:] ** 2)))
    both = features("d", 40, 4, sf=True)
    score = score_predictions("m", [constant()(both)], [both])
    ratios = [
        math.sqrt(np.mean((v[5:] - v[5:10].mean()) ** 2) / np.mean(v[5:] ** 2))
        for v in (both.bias_dph, both.sf_error_ppm)
    ]  # fmt: skip
    assert score.score == pytest.approx(np.mean(ratios))
    with pytest.raises(ConfigurationError, match="no validation run has a usable target"):
        score_predictions("m", [constant()(three)], [three])
    assert ModelScore("m", 1.0, None, 0.5).to_state() == {
        "name": "m", "bias_rms_dph": 1.0, "sf_rms_ppm": None, "score": 0.5,
    }  # fmt: skip
    assert ModelScore("m", 1.0, None, 0.5, 3, 0.1, ("a", "b")).to_state()["parts"] == ("a", "b")


def test_noise_of_a_target_is_that_of_rows_a_hundred_seconds_apart():
    rng = np.random.default_rng(1)
    noise = np.repeat(rng.normal(0.0, 0.7, 3000), 10)
    run = features("a", 30_000, 1, bias_dph=noise + np.linspace(0, 50, 30_000) ** 2, weightless=0)
    assert target_noise([run])["bias_dph"] == pytest.approx(0.7, rel=0.05)
    assert target_noise([replace(run, step_s=100.0)])["bias_dph"] == pytest.approx(
        1e-6 * np.std(run.bias_dph), rel=0.01
    )
    level = features("b", 40, 2, bias_dph=np.full(40, 3.0))
    assert (
        target_noise([level]) == {"bias_dph": 1e-12}
        and target_noise([replace(level, weight=np.zeros(40))]) == {}
    )


def test_rooms_are_taken_off_where_the_run_nearest_to_the_reference_is_the_zero():
    """The same coil in three rooms: each run's own level differs, its course does not."""
    runs = []
    for name, level, room in (("a", 0.0, 20.0), ("b", 4.0, 25.0), ("c", -3.0, 26.0)):
        run = features(name, 300, ord(name))
        t_out = run.t_out + room - run.t_out[5:10].mean()
        runs.append(replace(run, t_out=t_out, bias_dph=0.3 * run.t_in + 0.02 * t_out + level))
    for wanted, zero in ((None, 4.0), (18.0, 0.0), (99.0, -3.0)):
        found = anchor_runs(runs, reference_temp_c=wanted)
        levels = [float(np.mean(run.bias_dph - 0.3 * run.t_in - 0.02 * run.t_out)) for run in found]
        assert levels == pytest.approx([zero] * 3, abs=0.1)
    assert [run.sf_error_ppm for run in found] == [None] * 3


def fold(*runs, **predictions):
    return Fold(tuple(runs), {name: tuple(p(run) for run in runs) for name, p in predictions.items()})


def test_of_tied_models_the_mean_of_most_is_taken():
    best = np.array([1.0, 2.0, 3.0])
    candidates = {
        ("a",): best, ("b",): best + np.array([0.0, 0.0, 0.3]), ("c",): best + 0.1,
        ("a", "b"): best + np.array([0.3, -0.1, -0.1]), ("a", "b", "c"): best + np.array([0.0, 0.1, 0.2]),
    }  # fmt: skip
    # b is 0.1 +- 0.1 behind, c 0.1 +- 0, the pair 0.03 +- 0.13, the three 0.1 +- 0.058
    assert _tied_with_best(candidates) == [("a",), ("a", "b")]
    assert _tied_with_best({("b",): best, ("a",): best}) == [("b",)]


def test_models_that_part_by_less_than_a_quarter_of_what_is_left_are_alike():
    run, other = (
        features("a", 40, 1, bias_dph=np.tile([1.0, -1.0], 20)),
        features("b", 30, 2, bias=False, sf=True),
    )
    wave = np.tile([0.1, -0.1], 20)

    def near(size):
        def predict(run):
            own = size * wave[: len(run.time_s)]
            return Prediction(own, np.zeros(len(run.time_s)))

        return predict

    folds = [fold(run, other, zero=constant(), near=near(2.4), far=near(2.6))]
    assert _alike(folds, "near", "zero") and not _alike(folds, "far", "zero")
    assert _unlike(folds, ["zero", "near", "far"]) == ["zero", "far"]
    # `near` leaves 0.76 of it and parts from nothing by 0.24, from `far` by 0.02
    assert _unlike(folds, ["near", "zero", "far"]) == ["near", "zero"]


def test_every_run_is_left_out_with_one_of_the_other_kind():
    bias = [features(name, 40, 1) for name in "ab"]
    groups = [features(name, 40, 2, bias=False, sf=True) for name in "cde"]
    both = features("f", 40, 3, sf=True)
    names = [[run.run_id for run in each] for each in _folds([*bias, *groups[:2]], [both, groups[2]])]
    assert names == [["a", "c"], ["b", "d"], ["f"], ["e"]] or names == [["a", "c"], ["b", "d"], ["f", "e"]]
    assert sorted(name for each in names for name in each) == list("abcdef")
    assert [run.run_id for run in _last_of_each([*bias, *groups])] == ["b", "e"]
    assert [run.run_id for run in _last_of_each([both, bias[0]])] == ["a", "f"]
    assert [run.run_id for run in _last_of_each(bias)] == ["b"]


class Level:
    """A model that foretells the mean of the runs it was fitted on, times its gain."""

    def __init__(self, name, gain=1.0):
        self.name, self.gain, self.level = name, gain, math.nan

    def unfitted(self):
        return Level(self.name, self.gain)

    def fit(self, train, validation):
        self.taught = [run.run_id for run in train], [run.run_id for run in validation]
        self.level = self.gain * float(np.mean([run.t_in.mean() for run in train]))

    def predict(self, run):
        return Prediction(self.gain * run.t_in, np.zeros(len(run.time_s)))


def test_a_model_is_chosen_by_what_it_leaves_of_runs_that_it_was_not_fitted_on():
    runs = []
    for name in "abcd":
        run = features(name, 60, ord(name))
        runs.append(replace(run, bias_dph=run.t_in + 0.01 * np.random.default_rng(ord(name)).normal(size=60)))
    models = {name: Level(name, gain) for name, gain in (("good", 1.0), ("fair", 1.3), ("bad", 9.0))}
    scores = [
        ModelScore(name, 1.0, None, score) for name, score in (("fair", 1.0), ("good", 1.2), ("bad", 1.6))
    ]
    choice = choose(models, scores, runs[:3], runs[3:])
    assert choice.model.name == "good" and choice.model.taught == (list("abcd"), [])
    assert [score.name for score in choice.scores] == ["good", "fair", "bad"]
    assert [score.left_out for score in choice.scores] == [4, 4, 0]
    assert [fold.runs[0].run_id for fold in choice.folds] == list("abcd")
    assert set(choice.folds[0].predictions) == {"good", "fair"}
    left = choice.left_out(choice.model)
    assert [run.run_id for run, _ in left] == list("abcd")
    assert left[2][1].bias_dph.tolist() == runs[2].t_in.tolist()
    assert choose(models, scores, runs[:2], ()) is None
    (own,) = _predicted(tuple(runs[:3]), tuple(runs[3:]), (models["good"], (runs[1],)))
    assert own.bias_dph.tolist() == runs[1].t_in.tolist()
    mean = choice.left_out(MeanModel([models["good"], models["fair"]]))
    assert mean[0][1].bias_dph == pytest.approx(1.15 * runs[0].t_in)
    score = _score("x", choice.folds, ("good", "fair"), np.array([0.1, 0.2, 0.4, 0.5]))
    assert (score.score, score.left_out, score.parts) == (pytest.approx(0.3), 4, ("good", "fair"))
    assert score.standard_error == pytest.approx(np.std([0.1, 0.2, 0.4, 0.5], ddof=1) / 2.0)
    own = [
        np.mean((run.bias_dph - 1.15 * run.t_in - (run.bias_dph - 1.15 * run.t_in)[5:10].mean())[5:] ** 2)
        for run in runs
    ]
    assert score.bias_rms_dph == pytest.approx(math.sqrt(np.mean(own))) and score.sf_rms_ppm is None


def test_a_network_ends_its_training_by_the_last_runs_of_each_kind_where_others_are_left_out():
    model = Level("lstm")
    runs = [features(name, 40, ord(name), bias=name in "abc", sf=name in "cde") for name in "abcde"]
    made = []
    model.unfitted = lambda: made.append(Level("lstm")) or made[-1]
    _predicted(tuple(runs), (), (model, (runs[4],)))
    _predicted(tuple(runs[:4]), tuple(runs[4:]), (model, (runs[0],)))
    assert [each.taught for each in made] == [(["a", "b"], ["c", "d"]), (["b", "c", "d"], ["e"])]


def test_parts_are_added_with_their_weight_and_what_is_left_is_the_next_parts_target():
    parts = [SimpleNamespace(step=lambda *inputs, k=k: (k * inputs[0], k * inputs[3])) for k in (1.0, 3.0)]
    assert SumStepper(*parts).step(2.0, 0.0, 0.0, 5.0) == (8.0, 20.0)
    assert SumStepper(*parts, weight=0.5).step(2.0, 0.0, 0.0, 5.0) == (4.0, 10.0)
    run = features("a", 40, 1, sf=True)
    left = residual(SimpleNamespace(predict=constant(1.0, 2.0)), run)
    assert left.bias_dph == pytest.approx(run.bias_dph - 1.0) and left.sf_error_ppm == pytest.approx(
        run.sf_error_ppm - 2.0
    )
    assert residual(SimpleNamespace(predict=constant()), features()).sf_error_ppm is None


def test_penalties_are_judged_on_each_run_left_out():
    runs = [features(name, 40, ord(name)) for name in "abc"]
    runs = [replace(run, bias_dph=2.0 * run.t_in) for run in runs] + [
        features("d", 40, 9, bias=False, sf=True)
    ]
    terms = [run.t_in[:, None] for run in runs]
    found = _left_out_scores(terms, runs)
    assert np.isinf(found[:, 1]).all() and found[:, 0].argmin() == 0
    ridge = 1.0
    squares = []
    for left in range(3):
        rest = [k for k in range(3) if k != left]
        (own,) = fit_ridge([terms[k] for k in rest], [runs[k] for k in rest], [ridge])
        errors = anchored_errors([own.predict(terms[left])], [runs[left]], "bias_dph")
        squares.append(np.mean(errors**2))
    assert found[-1, 0] == pytest.approx(math.sqrt(np.mean(squares)))
    model = LaggedRidgeModel()
    model.fit(runs[:3], ())
    assert model.ridge[0] < 1e-4 and len(model.ridge) == 2
    with pytest.raises(ConfigurationError, match="no validation run to choose") as refused:
        LaggedRidgeModel().fit(runs, runs[:1])
    assert refused.value.found == "no validation run with sf_error_ppm"
    chosen = StepwiseModel()
    chosen.fit(
        [replace(run, time_s=run.time_s) for run in (features("e", 900, 5, bias_dph=None, sf=True),)], ()
    )
    assert not chosen.map.coefficients[:, 0].any()


def test_low_passes_start_settled_and_follow_a_held_step_by_exponentials():
    values = np.array([[5.0, 5.0, 8.0, 8.0, 8.0], [1.0, 1.0, 1.0, 0.0, 0.0]])
    found = low_passes(values, 10.0)
    assert found.shape == (2, 5, 6)
    for place, lag_s in enumerate(LAG_TIMES_S):
        steps = np.array([0, 0, 1, 2, 3])
        assert found[0, :, place] == pytest.approx(8.0 - 3.0 * np.exp(-10.0 * steps / lag_s))
        assert found[1, 4, place] == pytest.approx(math.exp(-20.0 / lag_s))
    run = features("a", 30, 1, step_s=20.0)
    whole, stream = signals(run), SignalStream(20.0)
    assert whole.dt_out[:3].tolist() == (run.t_out[:3] - run.t_out[0]).tolist()
    assert whole.dt_out[3:] == pytest.approx(run.t_out[3:] - run.t_out[:-3])
    for k in range(30):
        own = stream.step(run.t_in[k], run.t_out[k], run.dt_60[k], run.gradient[k])
        for name in ("t_in", "t_out", "dt_in", "dt_out", "gradient", "low_in", "low_out"):
            assert getattr(own, name)[0] == pytest.approx(getattr(whole, name)[k])
    terms = lag_terms(whole, with_temperature=True)
    assert terms.shape == (30, 40)
    assert terms[:, 14] == pytest.approx(run.t_in**2) and terms[:, 15] == pytest.approx(run.t_in**3)
    lags = np.hstack([run.t_in[:, None] - whole.low_in, run.t_out[:, None] - whole.low_out])
    assert terms[:, 16:28] == pytest.approx(lags * run.t_in[:, None])
    assert terms[:, 28:] == pytest.approx(lags * run.t_in[:, None] ** 2)


def test_a_chain_of_layers_follows_its_differential_equation():
    """Ten layers, T_in at one end and T_out at the other, and a state that relaxes to their mean."""
    k_in, k_out, k_layer, k_relax = 0.02, 0.05, 0.3, 0.004
    chain = diffusion(k_in, k_out, k_layer, k_relax, 7.0)
    u = np.array([40.0, -10.0])

    def change(_, x):
        layers = x[:NODES]
        flow = k_layer * np.diff(layers)
        own = np.append(flow, 0.0) - np.concatenate(([0.0], flow))
        own[0] += k_in * (u[0] - layers[0])
        own[-1] += k_out * (u[1] - layers[-1])
        return np.append(own, k_relax * (layers.mean() - x[NODES]))

    start = np.linspace(5.0, 15.0, NODES + 1)
    assert chain.rates(start, u) == pytest.approx(60.0 * change(0.0, start))
    exact = solve_ivp(change, (0.0, 7.0), start, rtol=1e-10, atol=1e-10).y[:, -1]
    assert chain.advance(start, u) == pytest.approx(exact, abs=1e-6)
    assert change(0.0, chain.rest @ u) == pytest.approx(np.zeros(NODES + 1), abs=1e-12)
    course = chain.simulate(np.tile(u, (3, 1, 1)))
    assert course[2, 0] == pytest.approx(chain.rest @ u)


def test_a_grey_boxs_errors_are_in_units_of_each_targets_noise_and_streams_as_it_predicts():
    runs = [features("a", 40, 1, sf=True), features("b", 25, 2)]
    parameters = GreyBoxParameters(0.02, 0.01, 0.2, 5e-4, -20.0, 8.0)
    stacked = _inputs(runs)
    assert (
        stacked.shape == (40, 2, 2)
        and stacked[25:, 1].tolist() == [[runs[1].t_in[-1], runs[1].t_out[-1]]] * 15
    )
    terms = grey_terms(parameters, stacked, runs, 10.0)
    assert [block.shape for block in terms] == [(40, 10), (25, 10)]
    (fitted,) = fit_ridge(terms, runs, [1e-9])
    noise = target_noise(runs)
    expected = sum(
        np.mean(anchored_errors([fitted.predict(block) for block in terms], runs, name) ** 2) / sigma**2
        for name, sigma in noise.items()
    )
    assert _cost(parameters, fitted, runs, 10.0) == pytest.approx(expected)
    errors = _errors(fitted, terms, runs)
    assert {name: len(own) for name, own in errors.items()} == {"bias_dph": 55, "sf_error_ppm": 35}
    assert errors["bias_dph"] == pytest.approx(
        np.concatenate(
            [(run.bias_dph - fitted.apply(block)[:, 0])[5:] for run, block in zip(runs, terms, strict=True)]
        )
    )
    stepper = GreyBoxStepper(parameters, fitted, 10.0)
    rows = zip(runs[0].t_in, runs[0].t_out, runs[0].dt_60, runs[0].gradient, strict=True)
    assert np.array([stepper.step(*row) for row in rows]) == pytest.approx(fitted.apply(terms[0]), abs=1e-6)


def test_training_sees_samples_that_count_between_minus_one_and_one():
    one, two = features("a", 40, 1), features("b", 30, 2, bias=False, sf=True, weightless=7)
    low, high = _input_range([one, two], INPUTS)
    rows = np.concatenate(
        [np.column_stack([run.t_in, run.dt_60, run.gradient])[k:] for run, k in ((one, 5), (two, 7))]
    )
    assert low.tolist() == rows.min(axis=0).tolist() and high.tolist() == rows.max(axis=0).tolist()
    flat = replace(one, dt_60=np.zeros(40))
    assert (_input_range([flat], INPUTS)[0][1], _input_range([flat], INPUTS)[1][1]) == (0.0, 1.0)
    mid, scale = _target_range([one, two])
    for column, values in enumerate((one.bias_dph[5:], two.sf_error_ppm[7:])):
        assert mid[column] == pytest.approx(0.5 * (values.min() + values.max()))
        assert scale[column] == pytest.approx(0.5 * (values.max() - values.min()))
    assert [part.tolist()[1] for part in _target_range([one])] == [0.0, 0.0]
    settings = LstmSettings(hidden=3, warm_up=4, seed=2)
    weights = _initial_weights(settings, low, high, mid, scale)
    assert max(np.abs(weights.w_hidden).max(), np.abs(weights.w_input).max()) < 3**-0.5
    assert weights.w_input.shape == (12, 3) and weights.hidden == 3
    batch = _batch([one, two], weights, settings)
    assert tuple(batch.inputs.shape) == (44, 2, 3)
    inputs = 2.0 * (np.column_stack([two.t_in, two.dt_60, two.gradient]) - low) / (high - low) - 1.0
    assert batch.inputs[4:34, 1].numpy() == pytest.approx(inputs, abs=1e-5)
    assert batch.inputs[:4, 1].numpy() == pytest.approx(np.tile(inputs[0], (4, 1)), abs=1e-5)
    mask = np.zeros((44, 2, 2))
    mask[9:44, 0, 0], mask[11:34, 1, 1] = 1.0, 1.0
    assert batch.mask.numpy().tolist() == mask.tolist()
    window = np.zeros((44, 2, 2))
    window[9:14, 0, 0], window[11:14, 1, 1] = 1.0, 1.0
    assert batch.reference.numpy().tolist() == window.tolist()
    target = np.where(mask[:, 1, 1] > 0, np.pad((two.sf_error_ppm - mid[1]) / scale[1], (4, 10)), 0.0)
    assert batch.targets[:, 1, 1].numpy() == pytest.approx(target, abs=1e-5)


def test_a_networks_step_is_its_equations_written_out():
    """Gates i, f, g, o; the state is warmed up on the first sample."""
    rng = np.random.default_rng(4)
    settings = LstmSettings(hidden=3, warm_up=2, seed=5)
    weights = _initial_weights(settings, np.array([-10.0, -1.0, 0.0]), np.array([30.0, 3.0, 8.0]),
                               np.array([0.5, -2.0]), np.array([3.0, 40.0]))  # fmt: skip
    h, c = np.zeros(3), np.zeros(3)

    def advance(x, h, c):
        scaled = 2.0 * (x - weights.input_low) / (weights.input_high - weights.input_low) - 1.0
        i, f, g, o = (weights.w_input @ scaled + weights.w_hidden @ h + weights.bias).reshape(4, 3)
        gate = [1.0 / (1.0 + np.exp(-each)) for each in (i, f, o)]
        c = gate[1] * c + gate[0] * np.tanh(g)
        return gate[2] * np.tanh(c), c

    stepper = LstmStepper(weights, settings)
    for number in range(4):
        t_in, t_out, rate, gradient = rng.normal(10.0, 9.0, 4)
        for _ in range(3 if number == 0 else 1):
            h, c = advance(np.array([t_in, rate, gradient]), h, c)
        expected = (weights.w_output @ h + weights.b_output) * weights.target_scale + weights.target_mid
        assert stepper.step(t_in, t_out, rate, gradient) == pytest.approx(tuple(expected))


def rate_run(name, rate, late=0, n=3000, seed=1, **changes):
    time_s = np.arange(1.0, n + 1.0)
    course = np.interp(time_s - late, [0, 800, 1100, 2000, 2300, 5000], [25, 25, -40, -40, 25, 25])
    inside = np.interp(time_s - late - 60.0, [0, 800, 1100, 2000, 2300, 5000], [25, 25, -40, -40, 25, 25])
    output = rate * (1.0 + 1e-6 * 3.0 * (inside - 25.0)) + 0.001
    run = RateRun(name, "u", time_s, inside, course, (0.0, 500.0), f"sum {name}", rate_dps=rate,
                  output_dps=output, true_sf_error_ppm=3.0 * (inside - 25.0))  # fmt: skip
    return replace(run, **changes)


def test_runs_of_a_group_are_laid_on_the_first_whichever_is_late():
    runs = [rate_run("a", 20.0, 30), rate_run("b", -20.0, 0, n=2900), rate_run("c", 0.0, 75)]
    found = scale_factor_group(runs)
    assert found.meta["shifts_s"] == [0, -30, 45] and found.meta["rates_dps"] == [20.0, -20.0, 0.0]
    assert (found.run_id, found.checksum, found.unit_id) == ("a+b+c", "sum a+sum b+sum c", "u")
    # the first 30 s of the first have no counterpart, nor what is behind the others' ends
    assert found.time_s[[0, -1]].tolist() == [31.0, 2930.0] or found.time_s[0] == 31.0
    assert found.gyro_temp_c == pytest.approx(runs[0].gyro_temp_c[30 : 30 + len(found.time_s)], abs=1e-6)
    expected = 3.0 * (found.gyro_temp_c - 25.0)
    assert found.sf_error_ppm == pytest.approx(expected, abs=0.01)
    assert found.true_sf_error_ppm == pytest.approx(expected, abs=1e-6)
    apart = [runs[0], replace(runs[1], gyro_temp_c=runs[1].gyro_temp_c + 1.1)]
    with pytest.raises(LimitExceeded, match="differs between the runs"):
        scale_factor_group(apart)
    assert scale_factor_group([runs[0], replace(runs[1], gyro_temp_c=runs[1].gyro_temp_c + 0.9)]).meta[
        "temp_spread_c"
    ] == pytest.approx(0.9)
    lost = scale_factor_group([runs[0], replace(runs[1], true_sf_error_ppm=None)])
    assert lost.true_sf_error_ppm is None
    assert find_shift(runs[0].case_temp_c, runs[2].case_temp_c, max_shift_s=20) == 20
    assert shifted(np.arange(5.0), 2, 6)[:3].tolist() == [2.0, 3.0, 4.0]
    assert np.isnan(shifted(np.arange(5.0), -1, 7)).tolist() == [True] + [False] * 5 + [True]


def test_scores_of_a_run_are_block_means_against_output_truth_and_floor():
    rng = np.random.default_rng(1)
    n = 4000
    time_s = np.arange(1.0, n + 1.0)
    drift = np.where(time_s < 1500, 0.0, 2e-3 * (time_s - 1500))
    noise = rng.normal(0.0, 0.5, n)
    warm = np.full(n, 25.0)
    run = ThermalRun("r", "u", time_s, warm, warm, 7.0 + drift + noise, 3.0 * drift + 0.1 * noise,
                     (500.0, 1500.0), true_bias_dph=1.0 + drift, true_sf_error_ppm=3.0 * drift)  # fmt: skip
    used = time_s >= 500.0
    half = Prediction(0.5 * drift[::10] + 9.0, 2.0 * drift[::10] - 4.0)
    found = evaluate(half, run)
    held = [np.repeat(each, 10) for each in (half.bias_dph - 9.0, half.sf_error_ppm + 4.0)]

    def sigma(values):
        return float(np.std(block_means(values), ddof=1))

    left = (run.bias_dph - held[0])[used]
    assert found.raw_stability_dph == pytest.approx(sigma(run.bias_dph[used]))
    assert found.stability_dph == pytest.approx(sigma(left))
    assert found.improvement_pct == pytest.approx(
        100.0 * (1.0 - found.stability_dph / found.raw_stability_dph)
    )
    assert found.oracle_stability_dph == pytest.approx(sigma(noise[used]))
    assert found.oracle_pct == pytest.approx(
        100.0 * (1.0 - found.oracle_stability_dph / found.raw_stability_dph)
    )
    error = block_means((held[0] - drift)[used])
    assert found.true_rmse_dph == pytest.approx(math.sqrt(np.mean(error**2)), rel=1e-6)
    assert found.true_max_dph == pytest.approx(np.abs(error).max())
    measured = run.sf_error_ppm - run.sf_error_ppm[(time_s >= 500) & (time_s < 1500)].mean()
    error = block_means((measured - held[1])[used])
    assert (found.sf_rms_ppm, found.sf_max_ppm) == pytest.approx(
        (math.sqrt(np.mean(error**2)), np.abs(error).max())
    )
    assert found.sf_raw_rms_ppm == pytest.approx(math.sqrt(np.mean(block_means(measured[used]) ** 2)))
    error = block_means((held[1] - 3.0 * drift)[used])
    assert found.sf_true_max_ppm == pytest.approx(np.abs(error).max(), rel=1e-6)
    assert found.sf_true_rms_ppm == pytest.approx(math.sqrt(np.mean(error**2)), rel=1e-6)
    assert found.noise_floor_dph == pytest.approx(0.05, rel=0.2) == noise_floor(run.bias_dph[used])
    assert math.isnan(noise_floor(np.full(100, np.nan)))
    second = np.diff(block_means(run.bias_dph, 25), 2)
    assert noise_floor(run.bias_dph, short_s=25) == pytest.approx(math.sqrt(np.mean(second**2) / 6.0 / 4.0))


def test_a_width_has_its_quantile_for_each_target_and_counts_runs():
    """Errors of rms 2 + |dT| deg/h, alike in two runs: 1.96 times that."""
    runs = [features(name, 4000, ord(name), sf=name == "b") for name in "ab"]
    for k, run in enumerate(runs):
        error = (2.0 + np.abs(run.dt_60)) * np.tile([1.0, -1.0], 2000)
        runs[k] = replace(run, bias_dph=np.where(run.time_s < 1100, 0.0, error))
    found = fit_width([(run, constant()(run)) for run in runs])
    assert found.runs == 2 and found.coefficients[0] == pytest.approx([3.92, 1.96, 0.0], abs=0.15)
    assert found.coefficients[1, 0] > 0.0


def test_prepared_features_are_counted_from_the_runs_first_second():
    n = 700
    time_s = 50.0 + np.arange(float(n))
    ramp = 0.01 * time_s
    run = ThermalRun("r", "u", time_s, ramp, 2.0 * ramp, 5.0 * ramp, None, (100.0, 300.0))
    found = prepare(run, step_s=20)
    assert found.time_s.tolist() == time_s[::20].tolist() and found.step_s == 20.0
    late = time_s[::20] >= 250.0
    assert found.t_in[late] == pytest.approx(0.01 * (found.time_s[late] - 49.5))
    assert found.gradient[late] == pytest.approx(-0.01 * (found.time_s[late] - 49.5))
    assert found.dt_60[late] == pytest.approx(0.6)
    inner = late & (found.time_s < 690.0)
    assert found.bias_dph[inner] == pytest.approx(0.05 * (found.time_s[inner] - 0.5 - 199.5))
    assert found.weight.tolist() == (found.time_s >= 100.0).astype(float).tolist()
    with pytest.raises(RecordError, match="no case temperature"):
        prepare(replace(run, case_temp_c=np.full(n, np.nan)))
    with pytest.raises(RecordError, match="reference window holds no data"):
        prepare(replace(run, reference=(0.0, 50.0)))
