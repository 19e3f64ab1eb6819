"""The LSTM against torch, against a lag system it has not seen, and against the promises of a causal model."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.signal import lfilter

from bench.analysis.thermal._lstm import LstmModel
from bench.analysis.thermal._lstm_training import (
    _Batch,
    _epoch,
    _initial_weights,
    _loss_of,
    _network,
    _read_weights,
)
from bench.analysis.thermal._lstm_weights import LstmSettings
from bench.analysis.thermal._registry import is_network, new_model, restore_model
from bench.analysis.thermal._types import FeatureRun
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

QUICK = LstmSettings(hidden=8, epochs=40, learning_rate=2e-2, warm_up=40, chunk=60)


def one_pole(x: Array, tau_s: float) -> Array:
    a = np.exp(-10.0 / tau_s)
    return np.asarray(lfilter([1 - a], [1, -a], x - x[0]) + x[0])


def shock(
    seed: int, low_c: float, rate_c_per_min: float, kind: str = "both", room_c: float = 25.0
) -> FeatureRun:
    """A synthetic unit: bias follows a 10-min lag of T_in and its rate, scale factor a 20-min lag."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 9000.0, 10.0)
    air = np.interp(
        time,
        [1500, 1500 + 60 * (room_c - low_c) / rate_c_per_min, 5500, 6000],
        [room_c, low_c, low_c, room_c],
    )
    t_out, t_in = one_pole(air, 120.0), one_pole(air, 400.0)
    dt_60 = np.concatenate([np.zeros(6), t_in[6:] - t_in[:-6]])
    lag = one_pole(t_in, 600.0)
    bias = 2e-3 * (lag - 25) + 0.03 * dt_60 + rng.normal(0, 2e-3, time.size)
    sf = 5.0 * (one_pole(t_in, 1200.0) - 25) + rng.normal(0, 0.5, time.size)
    return FeatureRun(
        run_id=f"{kind}-{seed}", unit_id="A", step_s=10.0, time_s=time, t_in=t_in, t_out=t_out, dt_60=dt_60,
        gradient=t_in - t_out, bias_dph=bias if kind != "sf" else None,
        sf_error_ppm=sf if kind != "bias" else None, weight=np.ones(time.size), reference=(0.0, 1500.0),
    )  # fmt: skip


@pytest.fixture(scope="module")
def runs() -> dict[str, list[FeatureRun]]:
    return {
        "train": [shock(1, -40, 11, "bias"), shock(2, -50, 13, "bias"), shock(3, -42, 14, "sf"),
                  shock(4, -48, 10, "sf")],
        "validation": [shock(5, -46, 12)],
        "test": [shock(6, -44, 12)],
    }  # fmt: skip


@pytest.fixture(scope="module")
def model(runs: dict[str, list[FeatureRun]]) -> LstmModel:
    model = LstmModel(QUICK)
    model.fit(runs["train"], runs["validation"])
    return model


def rms(x: Array) -> float:
    return float(np.sqrt(np.mean(np.square(x))))


def test_learns_both_lags_from_runs_that_carry_one_target_each(
    model: LstmModel, runs: dict[str, list[FeatureRun]]
) -> None:
    test = runs["test"][0]
    prediction = model.predict(test)
    assert test.bias_dph is not None and test.sf_error_ppm is not None
    assert rms(test.bias_dph - prediction.bias_dph) < 0.12 * rms(test.bias_dph)
    assert rms(test.sf_error_ppm - prediction.sf_error_ppm) < 0.12 * rms(test.sf_error_ppm)


def test_the_numpy_network_is_torchs_lstm(model: LstmModel, runs: dict[str, list[FeatureRun]]) -> None:
    torch = pytest.importorskip("torch")
    run, weights = runs["test"][0], model.weights
    network = torch.nn.LSTM(3, weights.hidden).double()
    head = torch.nn.Linear(weights.hidden, 2).double()
    with torch.no_grad():
        network.weight_ih_l0.copy_(torch.tensor(weights.w_input))
        network.weight_hh_l0.copy_(torch.tensor(weights.w_hidden))
        network.bias_ih_l0.copy_(torch.tensor(weights.bias))
        network.bias_hh_l0.zero_()
        head.weight.copy_(torch.tensor(weights.w_output))
        head.bias.copy_(torch.tensor(weights.b_output))
        raw = np.column_stack([run.t_in, run.dt_60, run.gradient])
        scaled = 2 * (raw - weights.input_low) / (weights.input_high - weights.input_low) - 1
        fed = np.concatenate([np.repeat(scaled[:1], QUICK.warm_up, axis=0), scaled])
        out = head(network(torch.tensor(fed)[:, None])[0])[QUICK.warm_up :, 0].numpy()
    prediction = model.predict(run)
    expected = out * weights.target_scale + weights.target_mid
    np.testing.assert_allclose(prediction.bias_dph, expected[:, 0], atol=1e-12)
    np.testing.assert_allclose(prediction.sf_error_ppm, expected[:, 1], atol=1e-9)


def test_outputs_do_not_depend_on_later_inputs(model: LstmModel, runs: dict[str, list[FeatureRun]]) -> None:
    run, k = runs["test"][0], 300
    changed = replace(run, t_in=np.where(np.arange(run.t_in.size) > k, run.t_in + 7.0, run.t_in))
    before, after = model.predict(run), model.predict(changed)
    np.testing.assert_array_equal(before.bias_dph[: k + 1], after.bias_dph[: k + 1])
    np.testing.assert_array_equal(before.sf_error_ppm[: k + 1], after.sf_error_ppm[: k + 1])
    assert before.sf_error_ppm[k + 1] != after.sf_error_ppm[k + 1]


def test_a_stream_gives_what_the_whole_run_gives(model: LstmModel, runs: dict[str, list[FeatureRun]]) -> None:
    run = runs["test"][0]
    whole, stepper = model.predict(run), model.stepper()
    rows = zip(run.t_in, run.t_out, run.dt_60, run.gradient, strict=True)
    streamed = np.array([stepper.step(*map(float, row)) for row in rows])
    assert np.max(np.abs(streamed[:, 0] - whole.bias_dph)) <= 1e-5 * model.weights.target_scale[0]
    assert np.max(np.abs(streamed[:, 1] - whole.sf_error_ppm)) <= 1e-5 * model.weights.target_scale[1]


def test_scaler_is_of_the_training_runs_only(model: LstmModel, runs: dict[str, list[FeatureRun]]) -> None:
    rows = np.concatenate([np.column_stack([r.t_in, r.dt_60, r.gradient]) for r in runs["train"]])
    np.testing.assert_array_equal(model.weights.input_low, rows.min(axis=0))
    np.testing.assert_array_equal(model.weights.input_high, rows.max(axis=0))


def test_without_warm_up_the_first_outputs_are_wrong(
    model: LstmModel, runs: dict[str, list[FeatureRun]]
) -> None:
    run = runs["test"][0]
    cold = LstmModel.from_state(model.to_state())
    cold.settings = replace(cold.settings, warm_up=0)
    settled = replace(run, **{key: np.repeat(getattr(run, key)[:1], 2000) for key in
                              ("time_s", "t_in", "t_out", "dt_60", "gradient")})  # fmt: skip
    rest = cold.predict(settled).sf_error_ppm[-1]
    assert abs(model.predict(run).sf_error_ppm[0] - rest) < 1.0
    assert abs(cold.predict(run).sf_error_ppm[0] - rest) > 30.0


def test_same_seed_same_weights_and_torch_left_as_found(runs: dict[str, list[FeatureRun]]) -> None:
    torch = pytest.importorskip("torch")
    threads, random_state = torch.get_num_threads(), torch.get_rng_state()
    short = replace(QUICK, epochs=2)
    fits = [LstmModel(replace(short, seed=seed)) for seed in (3, 3, 4)]
    for fit in fits:
        fit.fit(runs["train"], runs["validation"])
    np.testing.assert_array_equal(fits[0].weights.w_hidden, fits[1].weights.w_hidden)
    assert not np.array_equal(fits[0].weights.w_hidden, fits[2].weights.w_hidden)
    assert torch.get_num_threads() == threads
    assert torch.equal(torch.get_rng_state(), random_state)
    assert (torch.full((1,), 2e-38) * 0.25).item() != 0.0, "denormals are still flushed"


def test_the_epoch_kept_is_the_one_best_on_the_validation_run(runs: dict[str, list[FeatureRun]]) -> None:
    """At a constant rate a fit of k epochs is the start of a longer one: a worse epoch must leave no trace."""
    held = runs["validation"][0]
    assert held.bias_dph is not None and held.sf_error_ppm is not None
    validation = replace(held, bias_dph=0.5 * held.bias_dph, sf_error_ppm=0.5 * held.sf_error_ppm)
    constant = replace(QUICK, epochs=1, final_learning_rate=QUICK.learning_rate)
    kept, losses = [], []
    for epochs in range(1, 9):
        model = LstmModel(replace(constant, epochs=epochs))
        model.fit(runs["train"], [validation])
        guess, scale = model.predict(validation), model.weights.target_scale
        kept.append(model.weights.w_hidden)
        errors = [
            (guess.bias_dph - validation.bias_dph) / scale[0],
            (guess.sf_error_ppm - validation.sf_error_ppm) / scale[1],
        ]
        losses.append(sum(rms(error - error[:150].mean()) ** 2 for error in errors))
    improved = np.diff(losses) < -1e-9
    assert improved.any() and not improved.all(), "the case must hold a better and a worse epoch"
    for index, better in enumerate(improved):
        assert better != np.array_equal(kept[index], kept[index + 1])
        assert losses[index + 1] <= losses[index] + 1e-9


def test_padding_weight_zero_and_missing_seconds_do_not_teach(runs: dict[str, list[FeatureRun]]) -> None:
    """Garbage where the weight is zero or the target is missing leaves the fit bitwise alone."""
    clean = runs["train"][0]
    weight = np.where(np.arange(900) < 50, 0.0, 1.0)
    assert clean.bias_dph is not None
    garbage = replace(clean, weight=weight, bias_dph=np.where(weight == 0, 99.0, clean.bias_dph))
    missing = replace(clean, weight=weight, bias_dph=np.where(weight == 0, np.nan, clean.bias_dph))
    short = replace(QUICK, epochs=2)
    fits = [LstmModel(short), LstmModel(short)]
    for fit, run in zip(fits, (garbage, missing), strict=True):
        fit.fit([run, *runs["train"][1:]], [])
    np.testing.assert_array_equal(fits[0].weights.w_input, fits[1].weights.w_input)


def test_an_input_far_out_of_range_neither_overflows_nor_spreads(
    model: LstmModel, runs: dict[str, list[FeatureRun]]
) -> None:
    run = runs["test"][0]
    wild = replace(run, t_in=np.where(np.arange(900) == 10, 1e6, run.t_in))
    assert np.isfinite(model.predict(wild).sf_error_ppm).all()


def test_state_survives_a_round_trip(model: LstmModel, runs: dict[str, list[FeatureRun]]) -> None:
    again = LstmModel.from_state(model.to_state())
    np.testing.assert_array_equal(
        again.predict(runs["test"][0]).bias_dph, model.predict(runs["test"][0]).bias_dph
    )


def test_refusals(model: LstmModel, runs: dict[str, list[FeatureRun]]) -> None:
    with pytest.raises(ConfigurationError, match="has not been fitted"):
        LstmModel().predict(runs["test"][0])
    state = model.to_state()
    with pytest.raises(ValueError, match="bias of shape"):
        LstmModel.from_state({**state, "weights": {**state["weights"], "bias": np.zeros(3)}})


def test_training_ends_when_nothing_gets_better(runs: dict[str, list[FeatureRun]]) -> None:
    """With a learning rate of zero the first epoch stays the best one: `patience` more are made, not all."""
    from bench.analysis.thermal import _lstm_training

    epochs = []
    settings = replace(QUICK, learning_rate=0.0, final_learning_rate=0.0, patience=3)
    with pytest.MonkeyPatch.context() as patch:
        inner = _lstm_training._epoch
        patch.setattr(_lstm_training, "_epoch", lambda *args: (epochs.append(1), inner(*args)))
        _lstm_training.train_lstm(runs["train"], runs["validation"], settings)
    assert len(epochs) == 4


def test_a_device_by_name_gives_what_the_default_gives(runs: dict[str, list[FeatureRun]]) -> None:
    """Also the promise for CUDA, which this machine may not have; see `make bench-gpu`."""
    import torch

    from bench.analysis.thermal._lstm_training import train_lstm

    settings = replace(QUICK, epochs=2)
    plain = train_lstm(runs["train"], runs["validation"], settings, "cpu")
    for device in ("cpu", *(["cuda"] if torch.cuda.is_available() else [])):
        other = train_lstm(runs["train"], runs["validation"], settings, device)
        np.testing.assert_allclose(other.w_hidden, plain.w_hidden, atol=1e-3)


def tensor(rows: Array) -> torch.Tensor:
    return torch.as_tensor(np.asarray(rows, np.float32))


@pytest.mark.parametrize("both", [True, False])
def test_the_loss_is_the_mean_over_targets_of_what_is_left_beside_the_reference(both: bool) -> None:
    """Two runs of six steps; the second target is 3 off everywhere, or in no run at all."""
    rng = np.random.default_rng(1)
    error = rng.normal(size=(6, 2, 2)).astype(np.float32)
    mask, reference = np.ones((6, 2, 2)), np.zeros((6, 2, 2))
    mask[5, 1] = 0.0  # the second run is shorter
    reference[:2] = 1.0
    mask[:, :, 1] *= both
    reference[:, :, 1] *= both
    batch = _Batch(tensor(np.zeros((6, 2, 3))), tensor(-error), tensor(mask), tensor(reference))
    found = _loss_of(lambda inputs: (torch.zeros(6, 2, 2), None), lambda hidden: hidden, batch)  # type: ignore[arg-type]
    expected = []
    for target in range(1 + both):
        left = [error[:6, 0, target], error[:5, 1, target]]
        squares = np.concatenate([(run - run[:2].mean()) ** 2 for run in left])
        expected.append(squares.mean())
    assert found == pytest.approx(np.mean(expected), rel=1e-5)


def test_a_stretch_without_targets_does_not_end_an_epoch() -> None:
    torch.manual_seed(0)
    network, head = torch.nn.LSTM(3, 4), torch.nn.Linear(4, 2)
    rng = np.random.default_rng(0)
    mask = np.ones((30, 1, 2))
    mask[:10] = 0.0
    batch = _Batch(*(tensor(rows) for rows in (rng.normal(size=(30, 1, 3)), np.ones((30, 1, 2)), mask, mask)))
    before = head.weight.detach().clone()
    optimiser = torch.optim.SGD([*network.parameters(), *head.parameters()], lr=0.1)
    _epoch(network, head, batch, optimiser, LstmSettings(hidden=4, chunk=10, warm_up=0))
    assert not torch.equal(before, head.weight)


def test_an_epoch_takes_one_step_a_chunk_with_the_state_carried() -> None:
    """The same with torch's own loop: 7 steps after 2 of warm-up, in chunks of 3."""
    settings = LstmSettings(hidden=3, warm_up=2, chunk=3, seed=4, gradient_clip=0.05)
    weights = _initial_weights(settings, np.array([-1.0, -1.0, -1.0]), np.ones(3), np.zeros(2), np.ones(2))
    rng = np.random.default_rng(6)
    inputs = torch.tensor(rng.normal(size=(9, 2, 3)), dtype=torch.float32)
    targets = torch.tensor(rng.normal(size=(9, 2, 2)), dtype=torch.float32)
    mask = torch.ones(9, 2, 2)
    mask[:2] = 0.0
    mask[7:, 1] = 0.0
    mask[8, 0, 1] = 0.0  # one sample alone in the last chunk
    network, head = _network(weights)
    assert _read_weights(network, head, weights).w_hidden == pytest.approx(weights.w_hidden, abs=1e-6)
    optimiser = torch.optim.SGD([*network.parameters(), *head.parameters()], lr=0.5)
    batch = _Batch(inputs, targets, mask, torch.zeros(9, 2, 2))
    _epoch(network, head, batch, optimiser, settings)

    own, own_head = _network(weights)
    parameters = [*own.parameters(), *own_head.parameters()]
    with torch.no_grad():
        _, state = own(inputs[:2])
    for start in (2, 5, 8):
        hidden, state = own(inputs[start : start + 3], tuple(part.detach() for part in state))
        error = (own_head(hidden) - targets[start : start + 3]) ** 2 * mask[start : start + 3]
        for parameter in parameters:
            parameter.grad = None
        (error.sum() / mask[start : start + 3].sum()).backward()
        norm = math.sqrt(sum(float((parameter.grad**2).sum()) for parameter in parameters))
        with torch.no_grad():
            for parameter in parameters:
                parameter -= 0.5 * parameter.grad * min(1.0, 0.05 / norm)
    found, expected = (_read_weights(*pair, weights) for pair in ((network, head), (own, own_head)))
    for name in ("w_input", "w_hidden", "bias", "w_output", "b_output"):
        assert getattr(found, name) == pytest.approx(getattr(expected, name), abs=1e-5)
    assert found.w_output != pytest.approx(weights.w_output, abs=1e-3)


def test_size_and_seed_of_the_network_are_in_its_name() -> None:
    model = new_model("lstm:hidden=6+seed=3")
    assert isinstance(model, LstmModel) and model.name == "lstm:hidden=6+seed=3"
    assert (model.settings.hidden, model.settings.seed) == (6, 3)
    assert is_network(model.name) and is_network("hybrid") and not is_network("grey_box")
    for wrong in ("lstm:seed", "lstm:layers=2", "lstm:hidden=0", "lstm:seed=-1"):
        with pytest.raises(ConfigurationError, match="a setting that the LSTM does not take"):
            new_model(wrong)


def test_the_network_sees_the_inputs_that_its_name_says() -> None:
    model = new_model("lstm:inputs=t_out/gradient+hidden=4+epochs=2")
    runs = [shock(1, -40.0, 10.0)]
    model.fit(runs, runs)
    assert isinstance(model, LstmModel) and model.settings.inputs == ("t_out", "gradient")
    assert model.weights.input_low == pytest.approx([runs[0].t_out.min(), runs[0].gradient.min()], abs=0.5)
    again = restore_model(model.name, model.to_state()).stepper()
    first = [again.step(0.0, 20.0, 0.0, 1.0), again.step(0.0, 10.0, 0.0, 1.0)]
    blind, seeing = model.stepper(), model.stepper()
    for expected, row in zip(first, ((99.0, 20.0, -7.0, 1.0), (-99.0, 10.0, 7.0, 1.0)), strict=True):
        assert blind.step(*row) == pytest.approx(expected, rel=1e-12)
    assert seeing.step(0.0, 20.0, 0.0, 2.0) != pytest.approx(first[0], abs=1e-9)
    with pytest.raises(ConfigurationError, match=r"'rate'.*t_in \(the gyro's own temperature\), t_out"):
        new_model("lstm:inputs=t_in/rate")
    with pytest.raises(ConfigurationError, match="named twice"):
        new_model("lstm:inputs=t_in/t_in")
    for wrong in ([], ["t_in", "t_in"], ["t_in", "bias_dph"]):
        state = model.to_state()
        with pytest.raises(ValueError, match="inputs"):
            LstmModel.from_state(state | {"settings": state["settings"] | {"inputs": wrong}})


def test_a_network_of_another_size_is_restored_by_its_name() -> None:
    model = new_model("lstm:hidden=4+epochs=2+seed=1")
    runs = [shock(1, -40.0, 10.0)]
    model.fit(runs, runs)
    again = restore_model(model.name, model.to_state())
    assert again.name == model.name
    assert again.predict(runs[0]).bias_dph == pytest.approx(model.predict(runs[0]).bias_dph, abs=1e-12)
    other = new_model("lstm:hidden=4+epochs=2+seed=2")
    other.fit(runs, runs)
    assert not np.allclose(other.predict(runs[0]).bias_dph, model.predict(runs[0]).bias_dph)
