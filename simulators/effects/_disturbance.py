"""What a disturbance is: it comes into the output whatever the stimulus, at its own times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal, Protocol

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._effect import Parameter
from simulators.effects._stimulus import Stimulus


@dataclass(frozen=True)
class Record:
    """One run: what acted, the output in deg/h (n,) with NaN where it is missing, and what the model predicts."""

    stimulus: Stimulus
    output_dph: Array
    predict: Callable[[Stimulus], Array]


@dataclass(frozen=True)
class Finding:
    """A disturbance found in records: values and 1 sigma of its parameters, size in words, outputs without it."""

    values: tuple[float, ...]
    sigmas: tuple[float, ...]
    words: str
    outputs_dph: tuple[Array, ...]


@dataclass(frozen=True)
class SamplePath:
    """Where an axis was during n samples: their edges in lab time, and the table's angle there.

    `edges_s`, `angle_deg` float64 (n + 1,); the angle has the mount's azimuth error in it, turns counted.
    `elevation_deg` is the axis above the horizon.
    """

    edges_s: Array
    angle_deg: Array
    elevation_deg: float
    latitude_deg: float
    period_s: float


class Draws(Protocol):
    """Random numbers of one disturbance in a plant: the same for a seed and an index, however calls are cut."""

    def generator(self, block: int) -> np.random.Generator:
        """Return the generator of one block."""

    def uniform(self, number: int) -> Callable[[int, int], Array]:
        """Return what gives numbers of [-0.5, 0.5) by start and count; `number`: which of several."""


@dataclass(frozen=True)
class Disturbance:
    """A disturbance of the output: no column of any fit.

    A diagnosis has `find` look for it in all runs of a unit and takes it out before it fits anything. A plant
    adds what `emulate(values, draws)` gives: angle increments of samples in rad, (n,), at times drawn anew.
    """

    name: str
    parameters: tuple[Parameter, ...]
    source: str
    meaning: str
    find: Callable[[Sequence[Record]], Finding | None]
    emulate: Callable[[Sequence[float], Draws], Callable[[SamplePath], Array]]
    channel: Literal["gyro_rate"] = "gyro_rate"
