"""What a linear model looks at: features, the case's rate of change, low-passes; for whole runs and streams."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from bench.analysis.thermal._features import CHANGE_S
from bench.analysis.thermal._types import FeatureRun
from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError

LAG_TIMES_S = (40.0, 120.0, 360.0, 1080.0, 3240.0, 9720.0)
"""Time constants of the low-passes: thirds from the sensor's lag to the slowest thermal relaxation."""


@dataclass(frozen=True)
class Signals:
    """Model inputs, shape (n,), and the low-passes of both temperatures, shape (n, len(LAG_TIMES_S)).

    `dt_out` is the change of `t_out` over 60 s in degC/min, as `dt_in` is that of `t_in`.
    """

    t_in: Array
    t_out: Array
    dt_in: Array
    dt_out: Array
    gradient: Array
    low_in: Array
    low_out: Array


def signals(run: FeatureRun) -> Signals:
    """Return the signals of a whole run; all states start as if the first sample had always been there."""
    steps = change_steps(run.step_s)
    earlier = np.concatenate((np.full(steps, run.t_out[0]), run.t_out))[: len(run.t_out)]
    low = low_passes(np.stack([run.t_in, run.t_out]), run.step_s)
    return Signals(
        t_in=run.t_in,
        t_out=run.t_out,
        dt_in=run.dt_60,
        dt_out=(run.t_out - earlier),
        gradient=run.gradient,
        low_in=low[0],
        low_out=low[1],
    )


def lag_terms(inputs: Signals, *, with_temperature: bool) -> Array:
    """Return T_in, T_out and their low-passes, (n, 14); with temperature also the 26 products, (n, 40)."""
    temp = inputs.t_in[:, None]
    linear = [temp, inputs.t_out[:, None], inputs.low_in, inputs.low_out]
    if not with_temperature:
        return np.hstack(linear)
    lags = np.hstack([temp - inputs.low_in, inputs.t_out[:, None] - inputs.low_out])
    return np.hstack([*linear, temp**2, temp**3, lags * temp, lags * temp**2])


def change_steps(step_s: float) -> int:
    """Return the number of steps that make the 60 s of a rate of change; ConfigurationError if they do not."""
    steps = round(CHANGE_S / step_s)
    if steps < 1 or abs(steps * step_s - CHANGE_S) > 1e-9:
        raise ConfigurationError(
            "the step of the features does not divide 60 s",
            where="linear model",
            found=f"{step_s:g} s",
            expected="for instance 10 s",
            remedy="prepare the runs with another step_s",
        )
    return steps


def low_pass_gains(step_s: float) -> Array:
    """Return 1 - exp(-step/tau) of each low-pass y += gain (x - y), the exact one for a held input."""
    return np.asarray(-np.expm1(-step_s / np.array(LAG_TIMES_S)))


def low_passes(values: Array, step_s: float) -> Array:
    """Return the low-passes of series in rows, (m, n) -> (m, n, taus), each starting at its row's first value."""
    gains = low_pass_gains(step_s)
    states = np.empty((values.shape[1], values.shape[0], len(gains)))
    state = np.repeat(values[:, :1], len(gains), axis=1)
    for k, column in enumerate(values.T[:, :, None]):
        state = state + gains * (column - state)
        states[k] = state
    return np.moveaxis(states, 0, 1)


class SignalStream:
    """The same signals one step at a time, as arrays of length 1; starts on its first sample."""

    def __init__(self, step_s: float) -> None:
        self._gains = low_pass_gains(step_s)
        self._earlier_out: deque[float] = deque(maxlen=change_steps(step_s))
        self._low: Array | None = None

    def step(self, t_in: float, t_out: float, dt_60: float, gradient: float) -> Signals:
        """Take one sample and return its signals."""
        now = np.array([[t_in], [t_out]])
        if self._low is None:
            self._low = np.repeat(now, len(self._gains), axis=1)
            self._earlier_out.extend([t_out] * (self._earlier_out.maxlen or 0))
        self._low = self._low + self._gains * (now - self._low)
        change = t_out - self._earlier_out[0]
        self._earlier_out.append(t_out)
        one = np.array([[t_in], [t_out], [dt_60], [change], [gradient]])
        return Signals(one[0], one[1], one[2], one[3], one[4], self._low[:1], self._low[1:])
