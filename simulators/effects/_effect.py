"""What an effect is: columns on the gyro's output as a function of the stimulus, with bounded parameters."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from simulators.effects._stimulus import Stimulus

Columns = Callable[[Stimulus, Mapping[str, float]], NDArray[np.float64]]
NO_SHAPE: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class Parameter:
    """A named parameter with its unit in the name and the bounds outside which it is not believed."""

    name: str
    low: float
    high: float

    def bounds(self, coarseness: float) -> tuple[float, float]:
        """Return the bounds for a gyro that is so many times coarser than an optical one, biases and all."""
        factor = coarseness if "_dph" in self.name else 1.0
        return factor * self.low, factor * self.high


@dataclass(frozen=True)
class Variant:
    """An effect with its non-linear parameters (lags, thresholds) fixed."""

    effect: Effect
    shape: Mapping[str, float]

    def columns(self, stimulus: Stimulus) -> NDArray[np.float64]:
        """Return deg/h of output for one unit of each parameter, float64 (k, n)."""
        return self.effect.columns(stimulus, self.shape)


@dataclass(frozen=True)
class Effect:
    """One contribution to the gyro's output: sum over k of parameter k times column k, in deg/h.

    `columns(stimulus, shape)` returns float64 (k, n), k = len(parameters). `shapes` is the grid of non-linear
    parameters that a diagnosis tries; an effect without any has one empty shape. Of a `proposed` one the shape (a
    limit, a band) is read off the record, and the effect is no candidate where the record shows none; `shapes`
    then has one of usual size. `follows` says in words which input the effect follows.
    """

    name: str
    parameters: tuple[Parameter, ...]
    columns: Columns
    follows: str
    source: str
    meaning: str
    shapes: tuple[Mapping[str, float], ...] = (NO_SHAPE,)
    channel: Literal["gyro_rate"] = "gyro_rate"
    proposed: bool = False

    def variants(self) -> tuple[Variant, ...]:
        """Return the effect at every point of its grid."""
        return tuple(Variant(self, shape) for shape in self.shapes)


@dataclass(frozen=True)
class NoiseEffect:
    """A stochastic effect; `parameter` is the coefficient of the noise model that it raises."""

    name: str
    parameter: Parameter
    source: str
    meaning: str
    channel: Literal["gyro_rate", "time_stamps"] = "gyro_rate"


@dataclass(frozen=True)
class Disturbance:
    """What comes into the output whatever the stimulus, at its own times: no column of any fit.

    A diagnosis finds it in the record and takes it out before it fits anything; a plant draws times and phases.
    """

    name: str
    parameters: tuple[Parameter, ...]
    source: str
    meaning: str
    channel: Literal["gyro_rate"] = "gyro_rate"
