"""The hybrid: a sum of its parts, the network fitted on what the linear part leaves, causal."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from bench.analysis.thermal._hybrid import HybridModel
from bench.analysis.thermal._linear_models import LaggedRidgeModel
from bench.analysis.thermal._lstm_weights import LstmSettings
from bench.analysis.thermal._types import FeatureRun
from drivers.base.arrays import Array


def one_pole(x: Array, tau_s: float) -> Array:
    a = np.exp(-10.0 / tau_s)
    return np.asarray(lfilter([1 - a], [1, -a], x - x[0]) + x[0])


def shock(seed: int, low_c: float, rate_c_per_min: float) -> FeatureRun:
    """A lag the ridge can follow, and a cold branch it cannot: a stress term that grows below -20 degC."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 9000.0, 10.0)
    air = np.interp(
        time, [1500, 1500 + 60 * (25 - low_c) / rate_c_per_min, 5500, 6000], [25.0, low_c, low_c, 25.0]
    )
    t_out, t_in = one_pole(air, 120.0), one_pole(air, 400.0)
    dt_60 = np.concatenate([np.zeros(6), t_in[6:] - t_in[:-6]])
    stress = 0.1 / (1 + np.exp((t_in + 20) / 4))
    bias = 2e-3 * (one_pole(t_in, 600.0) - 25) + stress + rng.normal(0, 2e-3, time.size)
    sf = 5.0 * (one_pole(t_in, 1200.0) - 25) + rng.normal(0, 0.5, time.size)
    return FeatureRun(
        f"run-{seed}",
        "A",
        10.0,
        time,
        t_in,
        t_out,
        dt_60,
        t_in - t_out,
        bias,
        sf,
        np.ones(time.size),
        (0.0, 1500.0),
    )


@pytest.fixture(scope="module")
def runs() -> dict[str, list[FeatureRun]]:
    train = [shock(1, -40, 11), shock(2, -50, 13), shock(3, -45, 14)]
    return {"train": train, "validation": [shock(5, -46, 12)], "test": [shock(6, -44, 12)]}


@pytest.fixture(scope="module")
def model(runs: dict[str, list[FeatureRun]]) -> HybridModel:
    model = HybridModel(LstmSettings(hidden=8, epochs=60, learning_rate=2e-2, warm_up=40))
    model.fit(runs["train"], runs["validation"])
    return model


def test_learns_what_the_linear_part_cannot(model: HybridModel, runs: dict[str, list[FeatureRun]]) -> None:
    test, linear = runs["test"][0], LaggedRidgeModel()
    linear.fit(runs["train"], runs["validation"])
    assert test.bias_dph is not None
    left_linear = np.std(test.bias_dph - linear.predict(test).bias_dph)
    left = np.std(test.bias_dph - model.predict(test).bias_dph)
    assert left < 0.7 * left_linear


def test_is_the_sum_of_its_parts_also_on_a_stream(
    model: HybridModel, runs: dict[str, list[FeatureRun]]
) -> None:
    test = runs["test"][0]
    whole = model.predict(test)
    parts = model.first.predict(test).sf_error_ppm + model.second.predict(test).sf_error_ppm
    np.testing.assert_array_equal(whole.sf_error_ppm, parts)
    stepper = model.stepper()
    rows = zip(test.t_in, test.t_out, test.dt_60, test.gradient, strict=True)
    streamed = np.array([stepper.step(*map(float, row)) for row in rows])
    np.testing.assert_allclose(streamed[:, 0], whole.bias_dph, atol=1e-9)
    np.testing.assert_allclose(streamed[:, 1], whole.sf_error_ppm, atol=1e-6)


def test_outputs_do_not_depend_on_later_inputs(model: HybridModel, runs: dict[str, list[FeatureRun]]) -> None:
    run, k = runs["test"][0], 400
    later = np.arange(run.t_in.size) > k
    changed = replace(run, t_in=run.t_in + 5.0 * later, t_out=run.t_out - 3.0 * later)
    before, after = model.predict(run), model.predict(changed)
    np.testing.assert_array_equal(before.bias_dph[: k + 1], after.bias_dph[: k + 1])
    assert before.bias_dph[k + 1] != after.bias_dph[k + 1]


def test_state_survives_a_round_trip(model: HybridModel, runs: dict[str, list[FeatureRun]]) -> None:
    again = HybridModel.from_state(model.to_state())
    np.testing.assert_array_equal(
        again.predict(runs["test"][0]).bias_dph, model.predict(runs["test"][0]).bias_dph
    )
