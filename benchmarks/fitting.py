"""Features, stepwise regression and the LSTM: `python -m benchmarks fitting`.

Features against pandas' resampling and rolling means, stepwise against statsmodels' OLS in a loop, the LSTM
against the torch loop one would write first and, on a stream, against torch and 1 % of a processor at 1 kHz.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from importlib.metadata import version
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from bench.analysis.common.stepwise import stepwise
from bench.analysis.thermal import FeatureRun, LstmModel, ThermalRun, prepare
from bench.analysis.thermal._lstm_weights import LstmSettings
from benchmarks._measure import Pair, Row, in_turns, row

if TYPE_CHECKING:
    import torch

_SECONDS = 14_000
_EPOCHS = 4
_STEPS = 1000


def rows() -> Iterator[Row]:
    """Yield the rows of what is installed."""
    for part in (features, selection, training, inference):
        try:
            yield from part()
        except ImportError as missing:
            print(f"skipped: {part.__name__}: {missing}")


def thermal_run(seconds: int = _SECONDS, seed: int = 0) -> ThermalRun:
    """Return a cold shock as smooth curves and noise; bias in deg/h."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(1.0, seconds + 1.0)
    inside = 25.0 - 40.0 * np.sin(np.pi * time_s / seconds) ** 2 + 0.01 * rng.normal(size=seconds)
    return ThermalRun(
        run_id=f"run {seed}",
        unit_id="unit",
        time_s=time_s,
        gyro_temp_c=inside,
        case_temp_c=inside + 2.0 * np.cos(np.pi * time_s / seconds) + 0.01 * rng.normal(size=seconds),
        bias_dph=0.01 * inside + 0.1 * rng.normal(size=seconds),
        sf_error_ppm=None,
        reference=(10.0, 610.0),
    )


def features() -> Iterator[Row]:
    """Inputs and target of a day of 1 s means, on 10 s."""
    import pandas as pd

    run = thermal_run(86_400)
    index = pd.to_datetime(run.time_s, unit="s")
    frame = pd.DataFrame({"t_in": run.gyro_temp_c, "t_out": run.case_temp_c, "bias": run.bias_dph}, index)

    def peer() -> NDArray[np.float64]:
        smooth = frame[["t_in", "t_out"]].rolling(100, min_periods=1).mean().ffill()
        change = (frame["t_in"] - frame["t_in"].shift(60).bfill()).rolling(100, min_periods=1).mean()
        target = frame["bias"].rolling(100, min_periods=50, center=True).mean()
        table = pd.concat([smooth, change.rename("change"), target], axis=1)
        return np.asarray(table.resample("10s", origin="start").first())

    np.testing.assert_allclose(prepare(run).t_in, peer()[:, 0], atol=1e-9)
    name = f"pandas {version('pandas')} rolling and resample"
    title = "features and target of a day of 1 s means"
    yield row(title, in_turns(lambda: prepare(run), peer), name, per=1e3, unit="ms")


def selection() -> Iterator[Row]:
    """Forward and backward selection by p-values among 30 terms, 5,000 rows."""
    import statsmodels.api as sm

    rng = np.random.default_rng(0)
    x = rng.normal(size=(5000, 30))
    y = x[:, ::4] @ rng.uniform(0.5, 2.0, 8) + rng.normal(size=5000)

    def peer() -> list[int]:
        inside: list[int] = []
        while True:
            outside = [k for k in range(30) if k not in inside]
            trials = [sm.OLS(y, sm.add_constant(x[:, [*inside, k]])).fit().pvalues[-1] for k in outside]
            if outside and min(trials) < 0.05:
                inside.append(outside[int(np.argmin(trials))])
                continue
            p = sm.OLS(y, sm.add_constant(x[:, inside])).fit().pvalues[1:]
            if len(p) and p.max() > 0.1:
                inside.pop(int(np.argmax(p)))
                continue
            return inside

    assert stepwise(x, y).selected == tuple(f"x{k + 1}" for k in sorted(peer()))
    pair = in_turns(lambda: stepwise(x, y), peer, turns=3)
    name = f"statsmodels {version('statsmodels')} OLS in a loop"
    yield row("stepwise, 30 candidates, 5,000 rows", pair, name, per=1e3, unit="ms")


def training() -> Iterator[Row]:
    """Epochs of the LSTM on six runs: batched, or run by run as one writes it first. Same chunks, same passes."""
    import torch

    runs = [prepare(thermal_run(seed=seed)) for seed in range(7)]
    model = LstmModel(LstmSettings(epochs=_EPOCHS))

    def ours() -> None:
        model.fit(runs[:6], runs[6:])

    def peer() -> None:
        network, head = torch.nn.LSTM(3, 24), torch.nn.Linear(24, 2)
        parameters = [*network.parameters(), *head.parameters()]
        optimiser = torch.optim.Adam(parameters, lr=6e-3, weight_decay=1e-5)
        for _ in range(_EPOCHS):
            for run in runs[:6]:
                inputs, target = _tensors(run)
                state = None
                for start in range(0, len(inputs), 60):
                    hidden, (h, c) = network(inputs[start : start + 60], state)
                    state = (h.detach(), c.detach())
                    loss = ((head(hidden)[:, :, 0] - target[start : start + 60]) ** 2).mean()
                    optimiser.zero_grad()
                    loss.backward()
                    torch.nn.utils.clip_grad_norm_(parameters, 1.0)
                    optimiser.step()
            with torch.no_grad():
                head(network(_tensors(runs[6])[0])[0])

    pair = in_turns(ours, peer, turns=3)
    title = "LSTM training, an epoch of six runs side by side"
    name = f"torch {version('torch')}, the same network run by run"
    yield row(title, pair, name, per=1e3 / _EPOCHS, unit="ms")


def inference() -> Iterator[Row]:
    """A step of the network on a stream: ours in numpy, torch's, and 1 % of a processor at 1 kHz."""
    import torch

    run = prepare(thermal_run(4000))
    model = LstmModel(LstmSettings(epochs=1))
    model.fit([run], [])
    stepper = model.stepper()
    network, head = torch.nn.LSTM(3, 24), torch.nn.Linear(24, 2)
    state = [network(torch.zeros(1, 1, 3))[1]]

    def ours() -> None:
        for _ in range(_STEPS):
            stepper.step(25.0, 24.0, 0.5, 1.0)

    def peer() -> None:
        with torch.no_grad():
            for _ in range(_STEPS):
                hidden, state[0] = network(torch.tensor([[[25.0, 0.5, 1.0]]]), state[0])
                head(hidden).tolist()

    pair = in_turns(ours, peer)
    micro = partial(row, per=1e6 / _STEPS, unit="us")
    yield micro("LSTM on a stream, a step", pair, f"torch {version('torch')}, LSTM and head")
    limit_s = 0.01 * 1e-3 * _STEPS
    ratio = limit_s / pair.ours_s
    yield micro(
        "LSTM on a stream, a step", Pair(pair.ours_s, limit_s, ratio), "goal: 1 % of a processor at 1 kHz"
    )


def _tensors(run: FeatureRun) -> tuple[torch.Tensor, torch.Tensor]:
    import torch

    inputs = np.column_stack([run.t_in, run.dt_60, run.gradient]) / 40.0
    assert run.bias_dph is not None
    return (
        torch.tensor(inputs[:, None], dtype=torch.float32),
        torch.tensor(run.bias_dph[:, None], dtype=torch.float32),
    )
