"""What a CUDA device brings: `make bench-gpu`. LSTM training and the gap's Gram matrices on both.

Skips where torch sees no device. Results must agree: the network's weights after two epochs to 1e-3, the matrices
to 1e-9 of their largest entry.
"""

from __future__ import annotations

from functools import partial

import numpy as np
import torch

from bench.analysis.gap._grams import gram_blocks
from bench.analysis.thermal import prepare
from bench.analysis.thermal._lstm_training import train_lstm
from bench.analysis.thermal._lstm_weights import LstmSettings
from benchmarks._measure import Row, in_turns, row
from benchmarks.fitting import thermal_run
from drivers.base.clock import host_seconds


def compared(device: str) -> list[Row]:
    """Return the rows of `device` against the processor, wall time."""
    runs = [prepare(thermal_run(seed=seed)) for seed in range(65)]
    table = []
    for count in (6, 64):
        train = partial(train_lstm, runs[:count], runs[64:], LstmSettings(epochs=2))
        one, other = train(device=device), train(device="cpu")
        np.testing.assert_allclose(one.w_hidden, other.w_hidden, atol=1e-3)
        pair = in_turns(
            partial(train, device=device), partial(train, device="cpu"), turns=3, timer=host_seconds
        )
        table.append(row(f"LSTM training, two epochs of {count} runs, {device}", pair, "the processor"))
    rows = np.random.default_rng(0).standard_normal((12, 60, 14_000))
    grams = partial(gram_blocks, rows)
    for one_run, other_run in zip(grams(device=device), grams(device="cpu"), strict=True):
        np.testing.assert_allclose(one_run, other_run, atol=1e-9 * np.abs(other_run).max())
    pair = in_turns(partial(grams, device=device), partial(grams, device="cpu"), turns=3, timer=host_seconds)
    return [*table, row(f"gap: Gram matrices of 12 runs of 14,000 samples, {device}", pair, "the processor")]


def main() -> None:
    """Print the table, or that there is nothing to measure."""
    if not torch.cuda.is_available():
        print(f"skipped: torch {torch.__version__} sees no CUDA device")
        return
    from benchmarks.__main__ import show

    print(f"{torch.cuda.get_device_name()}, torch {torch.__version__}")
    show(compared("cuda"))


if __name__ == "__main__":
    main()
