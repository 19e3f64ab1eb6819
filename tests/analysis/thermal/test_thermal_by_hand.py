"""Pieces of the thermal fits against numbers worked out by hand."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
import torch

from bench.analysis.rlg._compensation import RlgCompensation
from bench.analysis.thermal._dataset import _phase
from bench.analysis.thermal._diffusion import NODES
from bench.analysis.thermal._features import _check_grid
from bench.analysis.thermal._grey_box import GreyBoxModel, GreyBoxParameters, _state_terms
from bench.analysis.thermal._hybrid import GreyResidualModel
from bench.analysis.thermal._leave_out import _fit
from bench.analysis.thermal._lstm_training import _cosine, _quiet_torch
from bench.analysis.thermal._lstm_weights import LstmSettings
from bench.analysis.thermal._regression import target_noise
from bench.analysis.thermal._signals import change_steps
from bench.analysis.thermal._stream import CompensationStream, FeatureStream, Flag, Limits
from bench.analysis.thermal._types import Prediction
from bench.analysis.thermal._width import PredictionWidth, _terms, fit_width
from drivers.base.errors import ConfigurationError, RecordError


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


def test_the_parameters_of_a_grey_box_are_what_was_searched() -> None:
    parameters = GreyBoxParameters(0.02, 0.01, 0.2, 5e-4, -17.0, 8.0)
    back = GreyBoxParameters.from_vector(parameters.to_vector())
    assert vars(back) == pytest.approx(vars(parameters), rel=1e-12)


def test_a_grey_box_that_is_given_is_the_one_that_is_used_and_none_is_a_new_one() -> None:
    given = GreyBoxModel(evaluations=3)
    assert GreyResidualModel(given).first is given
    assert isinstance(GreyResidualModel().first, GreyBoxModel)


INPUTS = {"t_in": (-40.0, 60.0), "t_out": (-50.0, 50.0), "dt_60": (-2.0, 2.0), "gradient": (-5.0, 15.0)}


def test_a_width_by_hand_inside_and_a_tenth_outside_of_what_was_trained() -> None:
    """(0.1 + 0.5 x 1.5 + 0.25 x 4) deg/h, twice that where T_in is 10 degC, a tenth of its range, too warm."""
    width = PredictionWidth(np.array([[0.1, 0.5, 0.25], [2.0, 0.0, 1.0]]), 4)
    inside = width.half_widths(np.array([20.0, 16.0, -1.5, 4.0]), INPUTS)
    assert inside.tolist() == pytest.approx([1.85, 6.0])
    outside = width.half_widths(np.array([[70.0, 16.0, -1.5, 4.0], [20.0, -60.0, -1.5, 4.0]]), INPUTS)
    assert outside.ravel().tolist() == pytest.approx([3.7, 12.0, 2.0 * 1.85, 12.0])


def test_the_width_holds_as_many_errors_as_it_says_and_counts_few_runs_as_few() -> None:
    """Errors of 1 deg/h a degC/min; of one run a width is half wider than 1.96 of its rms."""
    rng, n = np.random.default_rng(0), 400
    features = {"t_in": np.zeros(n), "t_out": np.zeros(n), "dt_60": rng.uniform(0.5, 2.0, n)}
    error = features["dt_60"] * np.tile([1.0, -1.0], n // 2)
    run = SimpleNamespace(
        **features,
        gradient=np.zeros(n),
        bias_dph=error,
        sf_error_ppm=None,
        weight=np.ones(n),
        reference=(0.0, 0.0),
        time_s=np.arange(n) + 10.0,
        step_s=1,
    )
    width = fit_width([(run, Prediction(np.zeros(n), np.zeros(n)))])  # type: ignore[arg-type, list-item]
    assert width.runs == 1 and width.coefficients[1].tolist() == [0.0, 0.0, 0.0]
    half = width.half_widths(np.array([0.0, 0.0, 1.0, 0.0]), INPUTS)
    assert half[0] == pytest.approx(1.5 * 1.96, rel=0.05)


def test_zero_degrees_are_a_temperature() -> None:
    stream = FeatureStream(1)
    assert stream.push(20.0, 0.0) == (20.0, 0.0, 0.0, 20.0)


def test_a_stream_without_widths_says_that_it_knows_none() -> None:
    stepper = SimpleNamespace(step=lambda *inputs: (0.36, 0.0))
    limits = Limits(INPUTS, (-1.0, 1.0), (-100.0, 100.0), 0.0)
    stream = CompensationStream(lambda: stepper, 1, limits, 2.0)  # type: ignore[arg-type, return-value]
    sample = stream.push(0.0, 20.0, 15.0, 4.0)
    assert sample.rate_dps == pytest.approx(2.0 - 1e-4) and sample.flags == Flag.RESTARTED
    assert math.isnan(sample.bias_half_dph) and math.isnan(sample.sf_half_ppm)


def test_two_seconds_are_a_grid_and_one_is_none() -> None:
    _check_grid(np.array([5.0, 6.0]), "a run")
    for seconds in ([5.0], [5.0, 6.1], [5.0, 7.0, 8.0]):
        with pytest.raises(RecordError, match="not on a 1 s grid"):
            _check_grid(np.array(seconds), "a run")


@pytest.mark.parametrize(
    ("reason", "said"), [("the table stalled", "the table stalled"), ("", "no reason given")]
)
def test_a_run_without_its_phases_is_refused_with_what_became_of_it(reason: str, said: str) -> None:
    run = SimpleNamespace(place="runs/r", manifest=SimpleNamespace(outcome="aborted", reason=reason))
    with pytest.raises(ConfigurationError, match=f"is marked aborted: {said}"):
        _phase(run, (), "shock")  # type: ignore[arg-type]


def test_a_model_that_can_start_from_a_fit_of_nearly_the_same_runs_does() -> None:
    class Started:
        def fit(self, train: list, validation: tuple) -> None:
            self.taught = (train, validation)

    started = Started()
    model = SimpleNamespace(name="grey_box", unfitted=lambda: started)
    assert _fit(model, ["a", "b"], ["c"]) is started and started.taught == (["a", "b", "c"], ())  # type: ignore[arg-type, list-item, comparison-overlap]


@pytest.mark.parametrize("flushing", [True, False])
def test_training_leaves_denormals_as_they_were(flushing: bool) -> None:
    """2e-38 over four is below the smallest normal number of single precision, 1.18e-38."""
    torch.set_flush_denormal(flushing)
    try:
        with _quiet_torch():
            assert (torch.full((1,), 2e-38) * 0.25).item() == 0.0
        assert ((torch.full((1,), 2e-38) * 0.25).item() == 0.0) == flushing
    finally:
        torch.set_flush_denormal(False)
