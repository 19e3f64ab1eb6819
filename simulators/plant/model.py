"""What a unit of the plant is made of: named effects and noise for each axis, and one thermal step for all."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeVar

import numpy as np

from drivers.base.arrays import Array
from simulators.effects import SamplePath
from simulators.plant.noise import NoiseParameters

T = TypeVar("T")
Readings = Callable[[float, float, float], tuple[float, float]]


@dataclass(frozen=True)
class AxisModel:
    """One sensitive axis: its effects by name, its noise, and 1 sigma of what a power-on draws.

    `bias_dph` and `sf_error_ppm` are functions of the unit's thermal state, evaluated once a tick. `rate_ppm`
    adds to the scale-factor error by the rate in deg/s, float64 (n,) -> (n,); `sample_rad` adds to the angle
    increments themselves, rad, float64 (n,), by the way of the axis.
    """

    bias_dph: Mapping[str, Callable[[Any], float]]
    sf_error_ppm: Mapping[str, Callable[[Any], float]]
    noise: NoiseParameters
    turn_on_bias_dph: float
    turn_on_sf_ppm: float
    rate_ppm: Mapping[str, Callable[[Array], Array]] = field(default_factory=dict)
    sample_rad: Mapping[str, Callable[[SamplePath], Array]] = field(default_factory=dict)


@dataclass(frozen=True)
class UnitModel:
    """A gyro unit: its axes, its thermal step (see `thermal.tick_matrix`) and how to read the outputs.

    Effects take a tick's outputs as a named tuple. Two of these are `sensor_temp_c` (the unit's own sensor) and
    `case_temp_c` (a sensor on its case), read with noise and rounded to the LSB; `truth` names the outputs that
    are recorded beside them. `readings` changes these two, once a tick, from air, sensor and case temperature to
    sensor and case temperature, degC.
    """

    axes: str
    axis_models: tuple[AxisModel, ...]
    step: Array
    outputs: tuple[str, ...]
    truth: tuple[str, ...]
    sensor_noise_c: float = 0.01
    sensor_lsb_c: float = 0.01
    readings: Readings | None = None


EFFECTS = ("bias_dph", "sf_error_ppm", "rate_ppm", "sample_rad")
"""Fields of an `AxisModel` that hold effects."""


def varied(parameters: T, names: Iterable[str], spread: float, rng: np.random.Generator) -> T:
    """Return a dataclass whose named numbers, or tuples of them, vary by `spread` (1 sigma, cut at two)."""
    changes = {}
    for name in names:
        value = np.asarray(getattr(parameters, name))
        factor = 1.0 + spread * np.clip(rng.standard_normal(value.shape), -2.0, 2.0)
        changes[name] = (value * factor).tolist()
    return replace(parameters, **changes)  # type: ignore[type-var]
