"""Every run is left out once: the choice between models, their mean, and how wide a prediction is."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.special import erf

from bench.analysis.thermal import FeatureRun, Prediction
from bench.analysis.thermal._compensation import Compensation
from bench.analysis.thermal._leave_out import choose
from bench.analysis.thermal._mean import MeanModel
from bench.analysis.thermal._selection import fit_models, score_models
from bench.analysis.thermal._stream import FEATURES
from bench.analysis.thermal._types import ThermalModel
from bench.analysis.thermal._width import LEVEL, PER_EXCESS, PredictionWidth, fit_width, further_run
from drivers.base.arrays import Array

NAMES = ("poly3", "multilinear", "lag_ridge")


def one_pole(x: Array, tau_s: float) -> Array:
    a = np.exp(-10.0 / tau_s)
    return np.asarray(lfilter([1 - a], [1, -a], x - x[0]) + x[0])


def shock(seed: int, low_c: float, soak_s: float, rng_scale: float = 2e-3) -> FeatureRun:
    """A bias that follows a lag of the inner temperature, and a scale factor that follows another."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 9000.0, 10.0)
    corners = [1500, 1500 + 6 * (25 - low_c), 1500 + 6 * (25 - low_c) + soak_s]
    air = np.interp(time, [*corners, corners[-1] + 400.0], [25.0, low_c, low_c, 25.0])
    t_out, t_in = one_pole(air, 120.0), one_pole(air, 400.0)
    dt_60 = np.concatenate([np.zeros(6), t_in[6:] - t_in[:-6]])
    bias = 2e-3 * (one_pole(t_in, 1080.0) - 25) + rng_scale * rng.standard_normal(time.size)
    sf = 5.0 * (one_pole(t_in, 1080.0) - 25) + 0.5 * rng.standard_normal(time.size)
    weight = (time > 100.0).astype(np.float64)
    return FeatureRun(
        f"run-{seed}", "A", 10.0, time, t_in, t_out, dt_60, t_in - t_out, bias, sf, weight, (100.0, 1500.0)
    )


@pytest.fixture(scope="module")
def runs() -> tuple[list[FeatureRun], list[FeatureRun]]:
    train = [shock(1, -40, 3000), shock(2, -50, 2000), shock(3, -45, 4000)]
    return train, [shock(5, -46, 3000)]


@pytest.fixture(scope="module")
def models(runs: tuple[list[FeatureRun], list[FeatureRun]]) -> dict[str, ThermalModel]:
    return fit_models(*runs, NAMES)


def test_every_run_is_left_out_once_and_the_right_model_is_taken(
    runs: tuple[list[FeatureRun], list[FeatureRun]], models: dict[str, ThermalModel]
) -> None:
    choice = choose(models, score_models(models, runs[1]), *runs)
    assert choice is not None and choice.model.name == "lag_ridge", "its lag is one of the model's own"
    assert sorted(run.run_id for run, _ in choice.left_out(choice.model)) == [
        "run-1",
        "run-2",
        "run-3",
        "run-5",
    ]
    assert choice.scores[0].left_out == 4 and choice.scores[0].standard_error is not None
    for run, prediction in choice.left_out(choice.model):
        assert run.bias_dph is not None
        error = (run.bias_dph - prediction.bias_dph)[run.weight > 0]
        assert np.std(error) == pytest.approx(2e-3, rel=0.1), "noise is all that is left of a run not fitted"


def test_the_model_taken_has_learnt_from_every_run(
    runs: tuple[list[FeatureRun], list[FeatureRun]], models: dict[str, ThermalModel]
) -> None:
    choice = choose(models, score_models(models, runs[1]), *runs)
    assert choice is not None
    shifted = replace(runs[1][0], bias_dph=runs[1][0].bias_dph + 0.5 * (runs[1][0].t_in < -30.0))  # type: ignore[operator]
    other = choose(models, score_models(models, runs[1]), runs[0], [shifted])
    assert other is not None
    apart = choice.model.predict(runs[1][0]).bias_dph - other.model.predict(runs[1][0]).bias_dph
    assert np.abs(apart).max() > 0.02


def test_two_runs_are_too_few_to_leave_one_out(
    runs: tuple[list[FeatureRun], list[FeatureRun]], models: dict[str, ThermalModel]
) -> None:
    assert choose(models, score_models(models, runs[1]), runs[0][:1], runs[1]) is None


class Biased:
    """Predicts the truth of this file's gyro with an error of its own."""

    def __init__(self, name: str, sign: float) -> None:
        self.name, self.sign = name, sign

    def unfitted(self) -> Biased:
        return self

    def fit(self, train: object, validation: object) -> None:
        pass

    def predict(self, run: FeatureRun) -> Prediction:
        assert run.bias_dph is not None and run.sf_error_ppm is not None
        wrong = self.sign * np.where(run.time_s > 3000.0, 1.0, 0.0)
        return Prediction(run.bias_dph + 0.01 * wrong, run.sf_error_ppm + 10.0 * wrong)


def test_where_nothing_is_decided_the_mean_is_taken(runs: tuple[list[FeatureRun], list[FeatureRun]]) -> None:
    """Two models with opposite errors of one size: either is as good as the other, their mean is right."""
    rivals: dict[str, ThermalModel] = {"up": Biased("up", 1.0), "down": Biased("down", -1.0)}  # type: ignore[dict-item]
    choice = choose(rivals, score_models(rivals, runs[1]), *runs)
    assert choice is not None and choice.scores[0].parts in {("up", "down"), ("down", "up")}
    left = choice.model.predict(runs[0][0]).bias_dph - runs[0][0].bias_dph
    assert np.abs(left).max() < 1e-12
    assert choice.scores[0].score == pytest.approx(0.0, abs=1e-12)


def test_a_mean_streams_as_it_predicts_and_comes_back_from_its_file(
    runs: tuple[list[FeatureRun], list[FeatureRun]], models: dict[str, ThermalModel], tmp_path: Path
) -> None:
    mean = MeanModel([models["multilinear"], models["lag_ridge"]])
    width = PredictionWidth(np.array([[0.01, 0.002, 0.0], [1.0, 0.0, 0.1]]), 4)
    made = Compensation.from_fit(mean, runs[0], runs[1], width=width)
    made.save(tmp_path / "mean.gyrocomp")
    loaded = Compensation.load(tmp_path / "mean.gyrocomp")
    run = runs[1][0]
    expected = sum(models[name].predict(run).bias_dph for name in ("multilinear", "lag_ridge")) / 2.0
    np.testing.assert_allclose(loaded.model.predict(run).bias_dph, expected, atol=1e-12)
    stepper = loaded.model.stepper()
    rows = zip(*(getattr(run, name) for name in FEATURES), strict=True)
    np.testing.assert_allclose([stepper.step(*row)[0] for row in rows], expected, atol=1e-9)
    np.testing.assert_array_equal(loaded.half_widths(run), made.half_widths(run))


def test_an_interval_holds_what_it_says_on_runs_of_its_kind_and_is_wider_outside() -> None:
    """Errors that are normal with a known scale: 1.96 of it holds 95 %, more where the temperature changes."""
    rng = np.random.default_rng(7)

    def made(seed: int) -> tuple[FeatureRun, Prediction]:
        run = shock(seed, -45.0, 3000.0, 0.0)
        assert run.bias_dph is not None and run.sf_error_ppm is not None
        scale = 0.01 + 0.02 * np.abs(run.dt_60)
        moved = replace(run, reference=(-2.0, -1.0))
        return moved, Prediction(run.bias_dph + scale * rng.standard_normal(len(scale)), run.sf_error_ppm)

    width = fit_width([made(seed) for seed in range(40)])
    run, prediction = made(99)
    inputs = {name: (float(getattr(run, name).min()), float(getattr(run, name).max())) for name in FEATURES}
    features = np.column_stack([getattr(run, name) for name in FEATURES])
    half = width.half_widths(features, inputs)
    assert run.bias_dph is not None
    inside = np.abs(run.bias_dph - prediction.bias_dph) <= half[:, 0]
    assert inside.mean() == pytest.approx(0.955, abs=0.02)
    assert width.coefficients[0, 0] == pytest.approx(1.96 * 0.01, rel=0.15)
    colder = features.copy()
    colder[:, 0] -= 0.1 * (inputs["t_in"][1] - inputs["t_in"][0])
    at = int(np.argmin(features[:, 0]))
    assert width.half_widths(colder, inputs)[at, 0] == pytest.approx(half[at, 0] * (1.0 + 0.1 * PER_EXCESS))


@pytest.mark.parametrize(("runs", "spread"), [(4, 0.3), (4, 0.8), (8, 0.8)])
def test_few_runs_that_differ_hold_as_much_of_the_next_as_they_say(runs: int, spread: float) -> None:
    """Four hundred campaigns of runs whose errors are log-normal in size: 95 % of the next run's on average."""
    rng = np.random.default_rng(11)
    held = []
    for _ in range(400):
        *seen, further = np.exp(spread * rng.standard_normal(runs + 1))
        held.append(erf(further_run(np.array(seen)) / further / np.sqrt(2.0)))
    assert np.mean(held) == pytest.approx(LEVEL, abs=0.02)


def test_runs_that_agree_need_no_more_than_a_normal_quantile() -> None:
    assert further_run(np.full(4, 3.0)) == pytest.approx(3.0 * 1.95996, rel=1e-4)
    assert further_run(np.array([1.0, 3.0, 3.0, 9.0])) > 2.0 * further_run(np.full(4, 3.0))
