"""The grey box: its chain of layers against thermal closed forms, itself on a unit of its own class."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from bench.analysis.thermal import FeatureRun
from bench.analysis.thermal._diffusion import NODES, diffusion
from bench.analysis.thermal._grey_box import GreyBoxModel, GreyBoxParameters
from drivers.base.errors import ConfigurationError

TRUE = GreyBoxParameters(0.012, 0.02, 0.4, 1 / 2500.0, -25.0, 6.0)


def test_chain_at_rest_between_two_temperatures_is_the_resistor_ladder() -> None:
    chain = diffusion(0.02, 0.01, 0.2, 1e-3, 10.0)
    rest = chain.rest @ np.array([10.0, 40.0])
    # Series resistances 1/k: 50, nine times 5, 100; the flow is 30 / 195.
    flow = 30.0 / (1 / 0.02 + 9 / 0.2 + 1 / 0.01)
    assert rest[0] == pytest.approx(10.0 + flow / 0.02)
    assert np.diff(rest[:NODES]) == pytest.approx(np.full(9, flow / 0.2))
    assert rest[NODES] == pytest.approx(rest[:NODES].mean())
    assert np.allclose(chain.rates(rest, np.array([10.0, 40.0])), 0.0, atol=1e-12)
    assert np.allclose(chain.advance(rest, np.array([10.0, 40.0])), rest, atol=1e-12)


def test_a_step_of_the_chain_is_the_differential_equation() -> None:
    chain = diffusion(0.03, 0.01, 0.25, 1 / 900.0, 10.0)
    start, inputs = np.linspace(-5, 30, NODES + 1), np.array([20.0, -30.0])

    def slope(_: float, x: np.ndarray) -> np.ndarray:
        layers, flow = x[:NODES], np.zeros(NODES)
        flow[:-1] += 0.25 * (layers[1:] - layers[:-1])
        flow[1:] += 0.25 * (layers[:-1] - layers[1:])
        flow[0] += 0.03 * (inputs[0] - layers[0])
        flow[-1] += 0.01 * (inputs[1] - layers[-1])
        return np.append(flow, (layers.mean() - x[NODES]) / 900.0)

    expected = solve_ivp(slope, (0, 10), start, rtol=1e-10, atol=1e-10).y[:, -1]
    assert np.allclose(chain.advance(start, inputs), expected, atol=1e-7)


def unit(cold_c: float, soak_s: float, kind: str, seed: int, noise: float = 1.0) -> FeatureRun:
    """A unit of the model's class, integrated at 1 s by plain Euler steps, noise as of a mid-grade gyro."""
    rng = np.random.default_rng(seed)
    count = int(5200 + soak_s)
    t = np.arange(float(count))
    air = np.interp(t, [1500, 1850, 1850 + soak_s, 2200 + soak_s], [25, cold_c, cold_c, 25.0])
    case, spool = np.full(count, 25.0), np.full(count, 27.0)
    layers, slow = np.full(NODES, 0.0), 0.0
    layers[:] = diffusion(TRUE.k_in, TRUE.k_out, TRUE.k_layer, TRUE.k_relax, 1.0).rest[:NODES] @ [27.0, 25.0]
    slow = float(layers.mean())
    bias, sf = np.zeros(count), np.zeros(count)
    for k in range(1, count):
        case[k] = case[k - 1] + (air[k] - case[k - 1]) / 150.0
        spool[k] = spool[k - 1] + (case[k] + 2.0 - spool[k - 1]) / 400.0
        flow = np.zeros(NODES)
        exchange = TRUE.k_layer * np.diff(layers)
        flow[:-1] += exchange
        flow[1:] -= exchange
        flow[0] += TRUE.k_in * (spool[k] - layers[0])
        flow[-1] += TRUE.k_out * (case[k] - layers[-1])
        layers = layers + flow
        mean, rate = layers.mean(), flow.mean() * 60
        slow += (mean - slow) * TRUE.k_relax
        u = (mean - 25) / 50
        soft = 1 / (1 + np.exp((mean - TRUE.transition_c) / TRUE.width_c))
        bias[k] = 0.05 * u - 0.04 * u**2 + 0.03 * rate * (1 + 1.2 * soft) + 2e-3 * (mean - slow)
        sf[k] = 4.0 * (spool[k] - 27) + 1.8 * (mean - 25) + 0.9 * (mean - slow)
    bias[0], sf[0] = bias[1], sf[1]
    grid = slice(None, None, 10)
    n = len(t[grid])
    bias10 = bias[grid] + noise * 0.008 * rng.standard_normal(n)
    sf10 = sf[grid] + noise * 0.3 * rng.standard_normal(n)
    change = np.concatenate((np.zeros(60), spool[60:] - spool[:-60]))
    return FeatureRun(
        run_id=f"{kind}{seed}",
        unit_id="u",
        step_s=10.0,
        time_s=t[grid],
        t_in=spool[grid],
        t_out=case[grid],
        dt_60=change[grid],
        gradient=(spool - case)[grid],
        bias_dph=bias10 if kind != "sf" else None,
        sf_error_ppm=sf10 if kind != "bias" else None,
        weight=np.ones(n),
        reference=(600.0, 1500.0),
    )


@pytest.fixture(scope="module")
def fitted() -> tuple[GreyBoxModel, FeatureRun]:
    model = GreyBoxModel()
    model.fit(
        [unit(-42, 3600, "bias", 1), unit(-50, 2500, "bias", 2), unit(-45, 3000, "sf", 3)],
        [unit(-46, 2000, "both", 4)],
    )
    return model, unit(-55, 1200, "both", 5, noise=0.0)


def test_predicts_an_unseen_deeper_shock_of_its_class(fitted: tuple[GreyBoxModel, FeatureRun]) -> None:
    model, test = fitted
    prediction = model.predict(test)
    assert test.bias_dph is not None and test.sf_error_ppm is not None
    bias, sf = prediction.bias_dph - test.bias_dph, prediction.sf_error_ppm - test.sf_error_ppm
    assert np.std(bias) < 0.02 * np.ptp(test.bias_dph)
    assert np.std(sf) < 0.003 * np.ptp(test.sf_error_ppm)


def test_finds_the_slow_relaxation(fitted: tuple[GreyBoxModel, FeatureRun]) -> None:
    model, _ = fitted
    assert model.parameters is not None
    assert 1 / model.parameters.k_relax == pytest.approx(2500.0, rel=0.1)


def test_causal_streaming_and_restored(fitted: tuple[GreyBoxModel, FeatureRun]) -> None:
    model, test = fitted
    whole = model.predict(test)
    changed = replace(test, t_in=test.t_in.copy(), t_out=test.t_out.copy())
    changed.t_in[300:] -= 4.0
    changed.t_out[300:] += 4.0
    late = model.predict(changed)
    assert np.array_equal(late.bias_dph[:300], whole.bias_dph[:300])
    assert not np.allclose(late.bias_dph[300:], whole.bias_dph[300:])

    state = model.to_state()
    json.dumps({key: value for key, value in state.items() if not isinstance(value, np.ndarray)})
    restored = GreyBoxModel.from_state(state)
    assert np.array_equal(restored.predict(test).bias_dph, whole.bias_dph)
    stepper = restored.stepper()
    stream = np.array(
        [stepper.step(*row) for row in zip(test.t_in, test.t_out, test.dt_60, test.gradient, strict=True)]
    )
    assert np.abs(stream[:, 0] - whole.bias_dph).max() < 1e-9 * np.ptp(whole.bias_dph)
    assert np.abs(stream[:, 1] - whole.sf_error_ppm).max() < 1e-9 * np.ptp(whole.sf_error_ppm)


def test_first_output_is_already_warm(fitted: tuple[GreyBoxModel, FeatureRun]) -> None:
    model, test = fitted
    prediction = model.predict(test)
    assert np.ptp(prediction.sf_error_ppm[:100]) < 0.5


def test_runs_of_other_lengths_do_not_touch_each_other(fitted: tuple[GreyBoxModel, FeatureRun]) -> None:
    model, _ = fitted
    assert model.map is not None
    bias_only = GreyBoxModel(evaluations=2)
    bias_only.fit([unit(-42, 800, "bias", 1), unit(-50, 300, "bias", 2)], [])
    assert bias_only.map is not None and not bias_only.map.coefficients[:, 1].any()


def test_refuses_before_a_fit() -> None:
    with pytest.raises(ConfigurationError, match="not been fitted"):
        GreyBoxModel().stepper()
