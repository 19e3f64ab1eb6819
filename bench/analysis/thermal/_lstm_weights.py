"""Settings and weights of the LSTM: what training makes and the network runs on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from bench.analysis.thermal._types import FeatureRun
from drivers.base.arrays import Array

INPUTS = ("t_in", "dt_60", "gradient")
"""What the network of the source sees: temperature, its rate and the gradient."""


@dataclass(frozen=True)
class LstmSettings:
    """What a fit does; the defaults are the reference figures of the design notes.

    `chunk` is the length in steps of the truncated back-propagation, `warm_up` how often the first sample is
    fed before the run. Training ends early after `patience` epochs without a better one. `inputs`: which of
    `FEATURES` the network sees, in this order.
    """

    hidden: int = 24
    epochs: int = 300
    learning_rate: float = 6e-3
    final_learning_rate: float = 2e-4
    chunk: int = 60
    warm_up: int = 180
    gradient_clip: float = 1.0
    weight_decay: float = 1e-5
    seed: int = 0
    patience: int = 40
    inputs: tuple[str, ...] = INPUTS


@dataclass(frozen=True)
class LstmWeights:
    """Everything the network needs to run; h = hidden units, m = inputs, gate rows in the order i, f, g, o.

    `input_low`, `input_high` (m,) in the order of the settings' `inputs`; `target_mid`, `target_scale` (2,) in
    the order of `TARGETS`; `w_input` (4h, m), `w_hidden` (4h, h), `bias` (4h,) on the normalised inputs;
    `w_output` (2, h), `b_output` (2,) give the normalised targets.
    """

    input_low: Array
    input_high: Array
    target_mid: Array
    target_scale: Array
    w_input: Array
    w_hidden: Array
    bias: Array
    w_output: Array
    b_output: Array

    @property
    def hidden(self) -> int:
        """Number of units h."""
        return int(self.w_hidden.shape[1])

    def normalise(self, inputs: Array) -> Array:
        """Map (..., m) inputs to [-1, 1] over the training range, without clipping outside it."""
        return (inputs - self.input_low) * (2.0 / (self.input_high - self.input_low)) - 1.0

    def denormalise(self, outputs: Array) -> Array:
        """Map (..., 2) network outputs to deg/h and ppm."""
        return outputs * self.target_scale + self.target_mid


def input_matrix(run: FeatureRun, inputs: Sequence[str]) -> Array:
    """Return the inputs of a run, shape (n, m), columns as in `inputs`."""
    return np.column_stack([getattr(run, name) for name in inputs])
