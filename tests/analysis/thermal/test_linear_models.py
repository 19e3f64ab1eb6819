"""Linear models on systems whose answer is known in closed form; causality, streaming, state, refusals."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import statsmodels.api as sm
from scipy.signal import lfilter

from bench.analysis.thermal import FeatureRun, ThermalModel
from bench.analysis.thermal._anchor import anchor_runs
from bench.analysis.thermal._linear_models import (
    CubicModel,
    LaggedRidgeModel,
    MultilinearModel,
    StepwiseModel,
)
from drivers.base.errors import ConfigurationError

MODELS = [
    CubicModel,
    MultilinearModel,
    StepwiseModel,
    LaggedRidgeModel,
    lambda: LaggedRidgeModel(with_temperature=True),
]


def one_pole(values: np.ndarray, tau_s: float) -> np.ndarray:
    """First-order lag, exact for an input held over 10 s, at rest at the first value."""
    pole = np.exp(-10.0 / tau_s)
    return np.asarray(lfilter([1 - pole], [1, -pole], values - values[0]) + values[0])


def shock(
    cold_c: float, soak_s: float, room_c: float = 25.0, kind: str = "both", run_id: str = "r", seed: int = 0
) -> FeatureRun:
    """Two lagged temperatures of a shock; no targets yet but zeros."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, 3000.0 + 2 * soak_s, 10.0)
    air = np.interp(
        time_s, [1200, 1600, 1600 + soak_s, 2000 + soak_s], [room_c, cold_c, cold_c, room_c]
    ) + 0.05 * rng.standard_normal(len(time_s))
    t_out = one_pole(air, 100.0)
    t_in = one_pole(t_out, 500.0) + 2.0
    dt_60 = t_in - np.concatenate((np.full(6, t_in[0]), t_in))[: len(t_in)]
    zeros = np.zeros(len(time_s))
    return FeatureRun(
        run_id=run_id,
        unit_id="u",
        step_s=10.0,
        time_s=time_s,
        t_in=t_in,
        t_out=t_out,
        dt_60=dt_60,
        gradient=t_in - t_out,
        bias_dph=zeros if kind != "sf" else None,
        sf_error_ppm=zeros if kind != "bias" else None,
        weight=(time_s >= 600).astype(float),
        reference=(600.0, 1200.0),
    )


def with_targets(run: FeatureRun, bias: np.ndarray, sf: np.ndarray) -> FeatureRun:
    return replace(
        run,
        bias_dph=None if run.bias_dph is None else bias,
        sf_error_ppm=None if run.sf_error_ppm is None else sf,
    )


def lagged(run: FeatureRun) -> FeatureRun:
    """A unit inside the lag models' class: 20-min and 1-min lags of the two temperatures."""
    low_in, low_out = one_pole(run.t_in, 1080.0), one_pole(run.t_out, 40.0)
    return with_targets(run, 4e-3 * (low_in - 25) - 2e-3 * (run.t_in - low_out), 5.0 * (low_in - 25) + 30.0)


def campaign() -> tuple[list[FeatureRun], list[FeatureRun], FeatureRun]:
    train = [
        lagged(shock(-40, 3000, kind="bias", seed=1)),
        lagged(shock(-50, 2000, kind="bias", seed=2)),
        lagged(shock(-45, 4000, kind="sf", seed=3)),
        lagged(shock(-52, 2000, kind="sf", seed=6)),
    ]
    return train, [lagged(shock(-46, 2500, seed=4))], lagged(shock(-55, 1200, seed=5))


def errors(model: ThermalModel, run: FeatureRun) -> tuple[float, float]:
    prediction = model.predict(run)
    assert run.bias_dph is not None and run.sf_error_ppm is not None
    return (
        float(np.abs(prediction.bias_dph - run.bias_dph).max()),
        float(np.abs(prediction.sf_error_ppm - run.sf_error_ppm).max()),
    )


def test_cubic_and_multilinear_recover_their_own_polynomials_far_outside_the_training() -> None:
    def static(run: FeatureRun) -> FeatureRun:
        t = run.t_in
        return with_targets(run, 0.3 - 2e-3 * t + 3e-5 * t**2 - 1e-7 * t**3, 5 * t + 0.02 * t**2)

    train = [static(shock(-40, 3000, kind="bias")), static(shock(-42, 3000, kind="sf", seed=1))]
    for model in (CubicModel(), MultilinearModel()):
        model.fit(train, [])
        assert errors(model, static(shock(-55, 2000, seed=2))) == pytest.approx((0, 0), abs=1e-6)


def test_multilinear_is_ordinary_least_squares() -> None:
    rng = np.random.default_rng(6)
    run = shock(-45, 3000)
    run = replace(run, bias_dph=rng.normal(size=len(run.time_s)))
    model = MultilinearModel()
    model.fit([run], [])
    design = np.column_stack([run.t_in, run.t_in**2, run.t_in**3, run.dt_60, run.gradient])
    used = run.weight > 0
    expected = (
        sm.OLS(run.bias_dph[used], sm.add_constant(design[used])).fit().predict(sm.add_constant(design))
    )
    assert np.allclose(model.predict(run).bias_dph, expected, atol=1e-8)


def test_stepwise_keeps_the_terms_that_made_the_data_and_leaves_the_second_temperature_out() -> None:
    rng = np.random.default_rng(7)

    def made(run: FeatureRun) -> FeatureRun:
        d1 = run.t_out - np.concatenate((np.full(6, run.t_out[0]), run.t_out))[: len(run.t_out)]
        bias = 1e-3 * run.t_out + 0.02 * d1 + 2e-3 * (run.t_out - run.t_in)
        return with_targets(run, bias + 1e-4 * rng.standard_normal(len(bias)), 0 * bias)

    model = StepwiseModel(p_enter=1e-4)
    model.fit([made(shock(-45, 3000, kind="bias", seed=s)) for s in (8, 9)], [])
    bias, sf = (np.flatnonzero(column) for column in model.fitted()[0].coefficients.T)
    case, inside, case_rate, difference = 0, 1, 2, 10
    assert case_rate in bias and len({case, inside, difference} & set(bias)) == 2
    assert not len(sf)
    assert errors(model, made(shock(-52, 2000, seed=10)))[0] < 2e-3


@pytest.mark.parametrize("with_temperature", [False, True])
def test_lag_ridge_finds_a_lag_system_of_its_class_on_an_unseen_profile(with_temperature: bool) -> None:
    train, validation, test = campaign()
    model = LaggedRidgeModel(with_temperature=with_temperature)
    model.fit(train, validation)
    bias, sf = errors(model, test)
    assert bias < 0.01 * np.ptp(test.bias_dph) and sf < 0.01 * np.ptp(test.sf_error_ppm)
    static = CubicModel()
    static.fit(train, validation)
    assert errors(static, test)[0] > 10 * bias


def test_ridge_penalty_is_chosen_on_the_validation_run() -> None:
    rng = np.random.default_rng(11)
    train, validation, _ = campaign()
    noisy = [
        replace(run, bias_dph=None if run.bias_dph is None else rng.normal(0, 1, len(run.time_s)))
        for run in train
    ]
    clean, hopeless = LaggedRidgeModel(), LaggedRidgeModel()
    clean.fit(train, validation)
    hopeless.fit(noisy, validation)
    assert hopeless.ridge[0] > clean.ridge[0]
    assert hopeless.ridge[1] == clean.ridge[1]


@pytest.mark.parametrize("make", MODELS)
def test_check_12_causal_streaming_and_restored(make: type[CubicModel]) -> None:
    train, validation, test = campaign()
    model = make()
    model.fit(train, validation)
    whole = model.predict(test)
    cut = 300
    changed = replace(test, t_in=test.t_in.copy(), t_out=test.t_out.copy(), dt_60=test.dt_60.copy())
    for column in (changed.t_in, changed.t_out, changed.dt_60):
        column[cut:] += 5.0
    assert np.array_equal(model.predict(changed).bias_dph[:cut], whole.bias_dph[:cut])
    assert not np.array_equal(model.predict(changed).bias_dph[cut:], whole.bias_dph[cut:])

    state = model.to_state()
    json.dumps({key: value for key, value in state.items() if not isinstance(value, np.ndarray)})
    restored = type(model).from_state(state)
    assert restored.name == model.name
    assert np.array_equal(restored.predict(test).sf_error_ppm, whole.sf_error_ppm)
    stepper = restored.stepper()
    stream = np.array(
        [stepper.step(*row) for row in zip(test.t_in, test.t_out, test.dt_60, test.gradient, strict=True)]
    )
    assert np.abs(stream[:, 0] - whole.bias_dph).max() < 1e-9 * np.ptp(whole.bias_dph)
    assert np.abs(stream[:, 1] - whole.sf_error_ppm).max() < 1e-9 * np.ptp(whole.sf_error_ppm)


def test_check_12_normalisation_is_of_the_training_rows_with_weight_only() -> None:
    train, validation, test = campaign()
    model = CubicModel()
    model.fit(train, [*validation, test])
    rows = np.concatenate([run.t_in[run.weight > 0] for run in train])
    assert model.map is not None
    assert model.map.centre == pytest.approx([np.mean(rows**power) for power in (1, 2, 3)])
    assert model.map.scale == pytest.approx([np.std(rows**power) for power in (1, 2, 3)])


def test_a_target_nobody_carries_is_not_corrected() -> None:
    train, validation, test = campaign()
    model = LaggedRidgeModel()
    model.fit(train[:2], validation)
    assert not model.predict(test).sf_error_ppm.any() and model.predict(test).bias_dph.any()


def test_refusals_say_what_is_wrong() -> None:
    train, validation, test = campaign()
    model = LaggedRidgeModel()
    with pytest.raises(ConfigurationError, match="not been fitted"):
        model.predict(test)
    with pytest.raises(ConfigurationError, match="not been fitted"):
        model.stepper()
    with pytest.raises(ConfigurationError, match="validation run"):
        model.fit(train, [replace(validation[0], bias_dph=None)])
    with pytest.raises(ConfigurationError, match="cannot be fitted together"):
        model.fit([train[0], replace(train[1], unit_id="other")], validation)
    model.fit(train, validation)
    with pytest.raises(ConfigurationError, match="cannot be applied"):
        model.predict(replace(test, step_s=5.0))
    with pytest.raises(ConfigurationError, match="low-passes"):
        LaggedRidgeModel.from_state({**model.to_state(), "lag_times_s": [1.0]})
    with pytest.raises(ConfigurationError, match="usable row"):
        model.fit([replace(run, weight=0 * run.weight) for run in train], validation)


def test_anchoring_removes_what_different_rooms_put_between_the_runs() -> None:
    """Check 15 in closed form: 5 ppm/degC, rooms of 23 to 27 degC, each run counted from its own reference."""
    rooms = [25.0, 23.0, 27.0, 25.0]
    own = []
    for number, room in enumerate(rooms):
        run = lagged(shock(-42.0 - 3 * number, 3000, room, "sf", f"r{number}", number))
        assert run.sf_error_ppm is not None
        window = (run.time_s >= 600) & (run.time_s < 1200)
        own.append(replace(run, sf_error_ppm=run.sf_error_ppm - run.sf_error_ppm[window].mean()))
    moved = []
    for before, after in zip(own, anchor_runs(own, reference_temp_c=25.0), strict=True):
        assert before.sf_error_ppm is not None and after.sf_error_ppm is not None
        shift = after.sf_error_ppm - before.sf_error_ppm
        assert np.ptp(shift) < 1e-9
        moved.append(shift[0])
    assert moved == pytest.approx([0.0, -10.0, 10.0, 0.0], abs=0.5)
    kept = anchor_runs(own, reference_temp_c=27.0)
    assert kept[2].sf_error_ppm is not None and own[2].sf_error_ppm is not None
    assert np.array_equal(kept[2].sf_error_ppm, own[2].sf_error_ppm)
    assert anchor_runs(own[:1])[0].sf_error_ppm == pytest.approx(own[0].sf_error_ppm)
