"""A synthetic unit with thermal lags, and a compensation of each kind fitted on it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.signal import lfilter

from bench.analysis.thermal import FeatureRun, ThermalModel, ThermalRun, prepare
from bench.analysis.thermal._compensation import Compensation
from bench.analysis.thermal._grey_box import GreyBoxModel
from bench.analysis.thermal._hybrid import GreyResidualModel, HybridModel
from bench.analysis.thermal._linear_models import (
    CubicModel,
    LaggedRidgeModel,
    MultilinearModel,
    StepwiseModel,
)
from bench.analysis.thermal._lstm import LstmModel
from bench.analysis.thermal._lstm_weights import INPUTS
from bench.analysis.thermal._mean import MeanModel
from drivers.base.arrays import Array


def one_pole(x: Array, tau_s: float) -> Array:
    a = np.exp(-1.0 / tau_s)
    return np.asarray(lfilter([1 - a], [1, -a], x - x[0]) + x[0])


def thermal_run(seed: int, low_c: float, rate_c_per_min: float, kind: str = "both") -> ThermalRun:
    """A cold shock at 1 s from power-on: noise, lags of 10 and 20 min, a rate term in the drift."""
    rng = np.random.default_rng(seed)
    time = np.arange(1.0, 9001.0)
    cooling_s = 60 * (25.0 - low_c) / rate_c_per_min
    air = np.interp(time, [1800, 1800 + cooling_s, 5500, 5500 + cooling_s], [25.0, low_c, low_c, 25.0])
    case, inside = one_pole(air, 120.0), one_pole(air, 400.0)
    noise = rng.normal(0.0, 1.0, (4, time.size))
    bias = 2e-3 * (one_pole(inside, 600.0) - 25) + 1.8 * np.gradient(inside) + 0.02 * noise[0]
    sf = 5.0 * (one_pole(inside, 1200.0) - 25) + 5.0 * noise[1]
    return ThermalRun(
        f"{kind}-{seed}", "unit A", time, inside + 0.01 * noise[2], case + 0.01 * noise[3],
        bias if kind != "sf" else None, sf if kind != "bias" else None, (600.0, 1800.0), checksum=f"{seed:064x}",
    )  # fmt: skip


def network_state(
    hidden: int, low: Array, high: Array, inputs: tuple[str, ...] = INPUTS
) -> dict[str, object]:
    """An LSTM of the right size with weights drawn at random: arithmetic does not care what it learnt."""
    rng, bound = np.random.default_rng(hidden), hidden**-0.5
    shapes = {
        "w_input": (4 * hidden, len(inputs)), "w_hidden": (4 * hidden, hidden), "bias": (4 * hidden,),
        "w_output": (2, hidden), "b_output": (2,),
    }  # fmt: skip
    weights = {
        name: rng.uniform(-bound, bound, shape).astype(np.float32).astype(float)
        for name, shape in shapes.items()
    }
    scaler = {"input_low": low, "input_high": high, "target_mid": np.array([0.01, -150.0]),
              "target_scale": np.array([0.25, 200.0])}  # fmt: skip
    return {"settings": {"hidden": hidden, "inputs": list(inputs)}, "weights": {**weights, **scaler}}


@pytest.fixture(scope="session")
def runs() -> dict[str, list[FeatureRun]]:
    train = [thermal_run(1, -41, 11, "bias"), thermal_run(2, -50, 13, "bias"), thermal_run(3, -42, 14, "sf"),
             thermal_run(4, -48, 10, "sf")]  # fmt: skip
    return {"train": [prepare(run) for run in train], "validation": [prepare(thermal_run(5, -46, 12))]}


@pytest.fixture(scope="session")
def test_run() -> ThermalRun:
    return thermal_run(7, -46, 12)


@pytest.fixture(scope="session")
def compensations(runs: dict[str, list[FeatureRun]]) -> Callable[[str], Compensation]:
    low, high = np.array([-50.0, -3.5, -15.0]), np.array([26.0, 3.5, 25.0])

    def lstm() -> LstmModel:
        return LstmModel.from_state(network_state(24, low, high))

    def lstm_of_case() -> LstmModel:
        inputs = ("gradient", "t_out")
        model = LstmModel.from_state(network_state(5, low[[2, 0]], high[[2, 0]], inputs))
        model.name = "lstm:hidden=5+inputs=gradient/t_out"
        return model

    def hybrid() -> HybridModel:
        linear = LaggedRidgeModel()
        linear.fit(runs["train"], runs["validation"])
        return HybridModel.from_state({"linear": linear.to_state(), "network": network_state(16, low, high)})

    def fitted(model: ThermalModel) -> ThermalModel:
        model.fit(runs["train"], runs["validation"])
        return model

    makers: dict[str, Callable[[], ThermalModel]] = {
        "poly3": lambda: fitted(CubicModel()),
        "multilinear": lambda: fitted(MultilinearModel()),
        "stepwise": lambda: fitted(StepwiseModel()),
        "lag_ridge": lambda: fitted(LaggedRidgeModel()),
        "lag_ridge_x_temp": lambda: fitted(LaggedRidgeModel(with_temperature=True)),
        "grey_box": lambda: fitted(GreyBoxModel(evaluations=6)),
        "grey_box_residual": lambda: fitted(GreyResidualModel(GreyBoxModel(evaluations=6))),
        "lstm": lstm,
        "lstm_of_case": lstm_of_case,
        "mean": lambda: MeanModel(
            [compensation(name).model for name in ("lag_ridge", "grey_box", "lstm_of_case")]
        ),
        "hybrid": hybrid,
    }
    made: dict[str, Compensation] = {}

    def compensation(name: str) -> Compensation:
        if name not in made:
            made[name] = Compensation.from_fit(makers[name](), runs["train"], runs["validation"], k_ref=1.25)
        return made[name]

    return compensation
