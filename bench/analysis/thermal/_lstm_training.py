"""Training of the LSTM: stateful truncated back-propagation over whole runs side by side, in torch, on one thread
of the processor or on a CUDA device (`bench.analysis.common.device`).

torch keeps its thread count, denormal mode and random state per process; all are as found when the fit is over.
Random numbers come from a numpy generator of our own.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from bench.analysis.common.device import compute_device
from bench.analysis.thermal._lstm_weights import LstmSettings, LstmWeights, input_matrix
from bench.analysis.thermal._regression import TARGETS, in_reference
from bench.analysis.thermal._types import FeatureRun
from drivers.base.arrays import Array


@dataclass(frozen=True)
class _Batch:
    """Runs side by side, time first, padded at the end: (steps, runs, inputs), then three times (steps, runs, 2).

    `mask` weighs the samples, `reference` those of them in the run's reference window.
    """

    inputs: torch.Tensor
    targets: torch.Tensor
    mask: torch.Tensor
    reference: torch.Tensor

    def to(self, device: str) -> _Batch:
        """Return the batch on `device`."""
        parts = (self.inputs, self.targets, self.mask, self.reference)
        return _Batch(*(part.to(device) for part in parts))


def train_lstm(
    train: Sequence[FeatureRun],
    validation: Sequence[FeatureRun],
    settings: LstmSettings,
    device: str | None = None,
) -> LstmWeights:
    """Return the weights after the epoch that is best on `validation` (on `train` if that is empty).

    `device` is torch's name of one, default `compute_device()`. Some training run has a usable sample.
    """
    device = compute_device() if device is None else device
    low, high = _input_range(train, settings.inputs)
    mid, scale = _target_range(train)
    blank = _initial_weights(settings, low, high, mid, scale)
    with _quiet_torch():
        network, head = (part.to(device) for part in _network(blank))
        learning = _batch(train, blank, settings).to(device)
        judging = _batch(validation, blank, settings).to(device) if validation else learning
        _descend(network, head, learning, judging, settings)
        return _read_weights(network, head, blank)


def _input_range(train: Sequence[FeatureRun], inputs: Sequence[str]) -> tuple[Array, Array]:
    rows = np.concatenate([input_matrix(run, inputs)[_usable(run)] for run in train])
    low, high = rows.min(axis=0), rows.max(axis=0)
    return low, np.where(high > low, high, low + 1.0)


def _usable(run: FeatureRun) -> NDArray[np.bool_]:
    return np.asarray(np.isfinite(_targets(run)).any(axis=1) & (run.weight > 0))


def _targets(run: FeatureRun) -> Array:
    missing = np.full(run.time_s.size, np.nan)
    columns = [getattr(run, name) for name in TARGETS]
    return np.column_stack([missing if column is None else column for column in columns])


def _target_range(train: Sequence[FeatureRun]) -> tuple[Array, Array]:
    rows = np.concatenate([_targets(run)[_usable(run)] for run in train])
    mid, scale = np.zeros(2), np.zeros(2)
    for column in range(2):
        values = rows[np.isfinite(rows[:, column]), column]
        if values.size:
            mid[column] = 0.5 * (values.min() + values.max())
            scale[column] = 0.5 * (values.max() - values.min())
    return mid, scale


def _initial_weights(
    settings: LstmSettings, low: Array, high: Array, mid: Array, scale: Array
) -> LstmWeights:
    """Uniform in +-1/sqrt(h), torch's own start for an LSTM and for a linear head of h inputs."""
    rng = np.random.default_rng(settings.seed)
    n, bound = settings.hidden, settings.hidden**-0.5

    def uniform(*shape: int) -> Array:
        return rng.uniform(-bound, bound, shape)

    return LstmWeights(
        input_low=low,
        input_high=high,
        target_mid=mid,
        target_scale=scale,
        w_input=uniform(4 * n, len(settings.inputs)),
        w_hidden=uniform(4 * n, n),
        bias=uniform(4 * n),
        w_output=uniform(2, n),
        b_output=uniform(2),
    )


def _network(weights: LstmWeights) -> tuple[torch.nn.LSTM, torch.nn.Linear]:
    with torch.random.fork_rng(devices=[]):
        network = torch.nn.LSTM(weights.w_input.shape[1], weights.hidden)
        head = torch.nn.Linear(weights.hidden, 2)
    values = {
        network.weight_ih_l0: weights.w_input,
        network.weight_hh_l0: weights.w_hidden,
        network.bias_ih_l0: weights.bias,
        network.bias_hh_l0: np.zeros_like(weights.bias),
        head.weight: weights.w_output,
        head.bias: weights.b_output,
    }
    with torch.no_grad():
        for parameter, value in values.items():
            parameter.copy_(torch.from_numpy(value))
    return network, head


def _read_weights(network: torch.nn.LSTM, head: torch.nn.Linear, blank: LstmWeights) -> LstmWeights:
    def value(parameter: torch.Tensor) -> Array:
        return np.asarray(parameter.detach().cpu().numpy(), dtype=np.float64)

    return replace(
        blank,
        w_input=value(network.weight_ih_l0),
        w_hidden=value(network.weight_hh_l0),
        bias=value(network.bias_ih_l0) + value(network.bias_hh_l0),
        w_output=value(head.weight),
        b_output=value(head.bias),
    )


def _batch(runs: Sequence[FeatureRun], weights: LstmWeights, settings: LstmSettings) -> _Batch:
    """Warm up every run with its first sample, pad at the end; padding and missing samples weigh nothing."""
    length = settings.warm_up + max(run.time_s.size for run in runs)
    inputs = np.zeros((length, len(runs), len(settings.inputs)))
    targets = np.zeros((length, len(runs), 2))
    mask = np.zeros((length, len(runs), 2))
    reference = np.zeros((length, len(runs), 2))
    scale = np.where(weights.target_scale > 0, weights.target_scale, 1.0)
    for index, run in enumerate(runs):
        rows = weights.normalise(input_matrix(run, settings.inputs))
        stop = settings.warm_up + run.time_s.size
        inputs[: settings.warm_up, index] = rows[0]
        inputs[settings.warm_up : stop, index] = rows
        target = (_targets(run) - weights.target_mid) / scale
        known = np.isfinite(target) & _usable(run)[:, None]
        targets[settings.warm_up : stop, index] = np.where(known, target, 0.0)
        mask[settings.warm_up : stop, index] = known * run.weight[:, None]
        reference[settings.warm_up : stop, index] = known & in_reference(run)[:, None]
    return _Batch(*(torch.tensor(part, dtype=torch.float32) for part in (inputs, targets, mask, reference)))


def _descend(
    network: torch.nn.LSTM, head: torch.nn.Linear, learning: _Batch, judging: _Batch, settings: LstmSettings
) -> None:
    """Run the epochs until `patience` of them brought nothing, and leave the best parameters in the modules."""
    parameters = [*network.parameters(), *head.parameters()]
    optimiser = torch.optim.Adam(
        parameters, lr=settings.learning_rate, weight_decay=settings.weight_decay, fused=True
    )
    best_loss, best, best_epoch = np.inf, [parameter.detach().clone() for parameter in parameters], 0
    for epoch in range(settings.epochs):
        if epoch - best_epoch > settings.patience:
            break
        for group in optimiser.param_groups:
            group["lr"] = _cosine(settings, epoch)
        _epoch(network, head, learning, optimiser, settings)
        loss = _loss_of(network, head, judging)
        if loss < best_loss:
            best_loss, best_epoch = loss, epoch
            best = [parameter.detach().clone() for parameter in parameters]
    with torch.no_grad():
        for parameter, value in zip(parameters, best, strict=True):
            parameter.copy_(value)


def _cosine(settings: LstmSettings, epoch: int) -> float:
    progress = epoch / max(1, settings.epochs - 1)
    span = settings.learning_rate - settings.final_learning_rate
    return float(settings.final_learning_rate + 0.5 * span * (1.0 + np.cos(np.pi * progress)))


def _epoch(
    network: torch.nn.LSTM,
    head: torch.nn.Linear,
    batch: _Batch,
    optimiser: torch.optim.Optimizer,
    settings: LstmSettings,
) -> None:
    """Warm the state up, then walk along the runs chunk by chunk, the state carried, the gradient cut."""
    with torch.no_grad():
        state = network(batch.inputs[: settings.warm_up])[1] if settings.warm_up else None
    for start in range(settings.warm_up, batch.inputs.shape[0], settings.chunk):
        window = slice(start, start + settings.chunk)
        mask = batch.mask[window]
        if state is not None:
            state = (state[0].detach(), state[1].detach())
        hidden, state = network(batch.inputs[window], state)
        total = mask.sum()
        if total == 0:
            continue
        loss = (mask * (head(hidden) - batch.targets[window]) ** 2).sum() / total
        optimiser.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(optimiser.param_groups[0]["params"], settings.gradient_clip)
        optimiser.step()


def _loss_of(network: torch.nn.LSTM, head: torch.nn.Linear, batch: _Batch) -> float:
    """Mean over the targets present of their mean squared error: neither outvotes the other by its length.

    Each run's error counts from its mean over the reference window, as it does when a model is judged.
    """
    with torch.no_grad():
        error = head(network(batch.inputs)[0]) - batch.targets
        offset = (batch.reference * error).sum(dim=0) / batch.reference.sum(dim=0).clamp(min=1.0)
        squares = (batch.mask * (error - offset) ** 2).sum(dim=(0, 1))
        weight = batch.mask.sum(dim=(0, 1))
        return float((squares / weight)[weight > 0].mean())


@contextmanager
def _quiet_torch() -> Iterator[None]:
    """One thread (two spin against each other on a small net), denormals flushed; both restored."""
    threads = torch.get_num_threads()
    flushing = bool((torch.full((1,), 2e-38) * 0.25).item() == 0.0)
    torch.set_num_threads(1)
    torch.set_flush_denormal(True)
    try:
        yield
    finally:
        torch.set_flush_denormal(flushing)
        torch.set_num_threads(threads)
