"""Pieces of the thermal fits against numbers worked out by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from bench.analysis.rlg._compensation import RlgCompensation
from bench.analysis.thermal._diffusion import NODES
from bench.analysis.thermal._grey_box import GreyBoxParameters, _state_terms
from bench.analysis.thermal._lstm_training import _cosine
from bench.analysis.thermal._lstm_weights import LstmSettings
from bench.analysis.thermal._regression import target_noise
from bench.analysis.thermal._signals import change_steps
from bench.analysis.thermal._stream import Flag
from bench.analysis.thermal._width import _terms
from drivers.base.errors import ConfigurationError


def test_terms_of_a_coil_at_one_temperature_everywhere() -> None:
    """75 degC coil: u = 1; T_in = 50 degC: v = 0.5; the layers warm by 6 degC/min, the case by 2."""
    chain = SimpleNamespace(rates=lambda states, inputs: np.full(NODES + 1, 6.0))
    states = np.append(np.full(NODES, 75.0), 70.0)
    parameters = GreyBoxParameters(0.02, 0.01, 0.2, 5e-4, 75.0, 8.0)
    terms = _state_terms(parameters, chain, states, np.array([50.0, 20.0]), np.array(2.0))  # type: ignore[arg-type]
    assert terms[:5] == pytest.approx([1.0, 1.0, 1.0, 0.5, 0.25])
    assert terms[6:] == pytest.approx([4.0, 6.0, 3.0, 5.0])
    colder = np.append(np.full(NODES, 125.0), 70.0)
    terms = _state_terms(parameters, chain, colder, np.array([50.0, 20.0]), np.array(2.0))  # type: ignore[arg-type]
    assert terms[:3] == pytest.approx([2.0, 4.0, 8.0])


@pytest.mark.parametrize(("step_s", "steps"), [(60.0, 1), (10.0, 6), (0.1, 600), (1.2, 50)])
def test_steps_in_the_minute_of_a_rate_of_change(step_s: float, steps: int) -> None:
    assert change_steps(step_s) == steps


@pytest.mark.parametrize("step_s", [7.0, 45.0, 121.0])
def test_a_step_that_does_not_divide_a_minute_is_refused(step_s: float) -> None:
    with pytest.raises(ConfigurationError, match="does not divide 60 s"):
        change_steps(step_s)


def test_a_width_grows_with_the_size_of_change_and_gradient() -> None:
    features = np.array([[20.0, 18.0, -3.0, 2.0], [-40.0, -44.0, 0.5, -4.0]])
    assert _terms(features).tolist() == [[1.0, 3.0, 2.0], [1.0, 0.5, 4.0]]


def test_each_doubt_about_a_sample_is_a_bit_of_its_own() -> None:
    assert [flag.value for flag in Flag] == [1, 2, 4, 8, 16, 32, 64]


def test_noise_of_a_target_that_only_some_runs_carry() -> None:
    """White noise of 0.5 ppm on a curved drift; no run carries the bias."""
    rng = np.random.default_rng(4)
    t = np.linspace(0.0, 1.0, 4000)
    runs = [
        SimpleNamespace(
            bias_dph=None,
            sf_error_ppm=50.0 * t**2 + rng.normal(0.0, 0.5, len(t)),
            weight=np.ones(len(t)),
            step_s=100.0,
        )
        for _ in range(3)
    ]
    noise = target_noise(runs)  # type: ignore[arg-type]
    assert set(noise) == {"sf_error_ppm"}
    assert noise["sf_error_ppm"] == pytest.approx(0.5, rel=0.05)


def test_the_learning_rate_falls_by_half_a_cosine_from_first_epoch_to_last() -> None:
    settings = LstmSettings(epochs=101, learning_rate=3e-3, final_learning_rate=1e-3)
    assert [_cosine(settings, epoch) for epoch in (0, 50, 100)] == pytest.approx([3e-3, 2e-3, 1e-3])


def test_an_equation_has_the_signs_of_its_coefficients() -> None:
    compensation = RlgCompensation.__new__(RlgCompensation)
    for name, value in (
        ("variables", ("T", "dT/dt")),
        ("coefficients", (-0.25, 2.0)),
        ("intercept_dph", 1.5),
    ):
        object.__setattr__(compensation, name, value)
    assert compensation.equation() == "B = 1.5 - 0.25·T + 2·dT/dt"
