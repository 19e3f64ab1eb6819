"""The recurrent model of the patent: a small LSTM on [T_in, dT, G] or other inputs, applied in plain numpy.

Method of patent CN115855016B: inputs min-max normalised to [-1, 1] over the training runs only, one LSTM
layer, a linear head on [bias, scale factor]. The state starts at zero and is warmed up by repeating the first
sample, because a cold state is wrong by tens of ppm at the start. torch is needed to fit (`_lstm_training`),
never to apply.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields
from typing import Any, Self

import numpy as np

from bench.analysis.thermal._lstm_weights import INPUTS, LstmSettings, LstmWeights
from bench.analysis.thermal._stream import FEATURES
from bench.analysis.thermal._types import FeatureRun, Prediction
from drivers.base.errors import ConfigurationError
from drivers.base.plugins import from_extra


class LstmStepper:
    """The network on a stream: the state lives here, one call per step.

    Normalisation, biases and the gates' slopes are folded into one matrix on [hidden, inputs, 1], and what a step
    computes goes into arrays made once: a step costs half of what it does written out.
    """

    def __init__(self, weights: LstmWeights, settings: LstmSettings) -> None:
        self._warm_up = settings.warm_up
        self._seen = [FEATURES.index(name) for name in settings.inputs]
        self._started = False
        n = weights.hidden
        # sigmoid(x) = (1 + tanh(x / 2)) / 2 never overflows, however far an input is out of range.
        slope = np.repeat([0.5, 0.5, 1.0, 0.5], n)
        scale = 2.0 / (weights.input_high - weights.input_low)
        offset = weights.bias + weights.w_input @ weights.normalise(np.zeros(len(self._seen)))
        self._matrix = slope[:, None] * np.hstack(
            [weights.w_hidden, weights.w_input * scale, offset[:, None]]
        )
        self._half, self._shift = slope, 1.0 - slope
        self._w_output = weights.w_output * weights.target_scale[:, None]
        self._b_output = weights.denormalise(weights.b_output)
        self._input = np.concatenate([np.zeros(n + len(self._seen)), [1.0]])
        self._h, self._c, self._work = self._input[:n], np.zeros(n), np.zeros(n)
        self._gates = np.zeros(4 * n)
        self._update, self._forget, self._cell, self._output = self._gates.reshape(4, n)
        self._inputs = self._input[n:-1]

    def step(self, t_in: float, t_out: float, dt_60: float, gradient: float) -> tuple[float, float]:
        """Return (bias_dph, sf_error_ppm) after this sample."""
        features = (t_in, t_out, dt_60, gradient)
        self._inputs[:] = [features[number] for number in self._seen]
        if not self._started:
            self._started = True
            for _ in range(self._warm_up):
                self._advance()
        self._advance()
        bias_dph, sf_error_ppm = (self._w_output @ self._h + self._b_output).tolist()
        return bias_dph, sf_error_ppm

    def _advance(self) -> None:
        gates, work = self._gates, self._work
        np.dot(self._matrix, self._input, out=gates)
        np.tanh(gates, out=gates)
        gates *= self._half
        gates += self._shift
        np.multiply(self._update, self._cell, out=work)
        self._c *= self._forget
        self._c += work
        np.tanh(self._c, out=work)
        np.multiply(self._output, work, out=self._h)


class LstmModel:
    """The LSTM as a `ThermalModel`.

    Bias runs teach only the bias output and scale-factor groups only the other, so the two kinds need no
    pairing. A target that no training run carries is predicted as zero.
    """

    name = "lstm"

    def __init__(self, settings: LstmSettings | None = None, name: str = "lstm") -> None:
        self.settings = settings or LstmSettings()
        self.name = name
        self._weights: LstmWeights | None = None

    @property
    def weights(self) -> LstmWeights:
        """The fitted network; ConfigurationError before a fit."""
        if self._weights is None:
            raise ConfigurationError(f"model {self.name} has not been fitted", remedy="call fit first")
        return self._weights

    def fit(self, train: Sequence[FeatureRun], validation: Sequence[FeatureRun]) -> None:
        """Train on whole runs and keep the epoch that is best on `validation` (on `train` if that is empty).

        Deterministic for `settings.seed` on one processor. Others sum in another order, since their vectors are
        of another width, and over thousands of training steps a last digit grows to another minimum: fit with
        several seeds to see what that is worth.
        """
        from_extra("torch", "torch", "training the LSTM (fit cold-shock --models leaves it out)")
        from bench.analysis.thermal._lstm_training import train_lstm

        self._weights = train_lstm(train, validation, self.settings)

    def predict(self, run: FeatureRun) -> Prediction:
        """Return the drift over a whole run, sample by sample through the stepper: causal by construction."""
        stepper = self.stepper()
        rows = zip(run.t_in, run.t_out, run.dt_60, run.gradient, strict=True)
        outputs = np.array([stepper.step(*row) for row in rows]).reshape(-1, 2)
        return Prediction(bias_dph=outputs[:, 0].copy(), sf_error_ppm=outputs[:, 1].copy())

    def stepper(self) -> LstmStepper:
        """Return a fresh streaming form."""
        return LstmStepper(self.weights, self.settings)

    def to_state(self) -> dict[str, Any]:
        """Return settings and weights."""
        weights = self.weights
        return {
            "settings": asdict(self.settings) | {"inputs": list(self.settings.inputs)},
            "weights": {item.name: getattr(weights, item.name) for item in fields(weights)},
        }

    @classmethod
    def from_state(cls, state: Mapping[str, Any]) -> Self:
        """Restore a fitted model from `to_state`; ValueError if the arrays do not fit together."""
        settings = dict(state["settings"])
        inputs = tuple(settings.pop("inputs", INPUTS))
        if not inputs or not set(inputs) <= set(FEATURES) or len(set(inputs)) < len(inputs):
            raise ValueError(f"inputs {inputs}, not some of {FEATURES}")
        model = cls(LstmSettings(**settings, inputs=inputs))
        weights = LstmWeights(
            **{key: np.asarray(value, dtype=np.float64) for key, value in state["weights"].items()}
        )
        n, m = model.settings.hidden, len(inputs)
        shapes: dict[str, tuple[int, ...]] = {"w_input": (4 * n, m), "w_hidden": (4 * n, n)}
        shapes |= {"bias": (4 * n,), "w_output": (2, n), "input_low": (m,), "input_high": (m,)}
        shapes |= dict.fromkeys(("target_mid", "target_scale", "b_output"), (2,))
        for key, shape in shapes.items():
            if getattr(weights, key).shape != shape:
                raise ValueError(f"{key} of shape {getattr(weights, key).shape}, not {shape}")
        if not (weights.input_high > weights.input_low).all():
            raise ValueError("an input whose range is empty")
        model._weights = weights
        return model
