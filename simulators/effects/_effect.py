"""What an effect is: one formula of the stimulus with bounded parameters, for diagnosis and emulator alike."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, Flag, auto
from functools import cached_property
from types import MappingProxyType
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from drivers.base.arrays import Array
from drivers.base.errors import ConfigurationError
from simulators.effects._stimulus import REFERENCE_C, Stimulus
from simulators.effects._tick import AtRate, Tick

_RATES_DPS = np.geomspace(1e-3, 200.0, 24)
_FAST_DPS, _SLOW_PART = 1.0, 0.01
Shape = Mapping[str, float]
Formula = Callable[[Stimulus, Shape], Array | tuple[Array, ...] | float]
NO_SHAPE: Shape = MappingProxyType({})


@dataclass(frozen=True)
class Unit:
    """The unit of a parameter. `is_rate`: a rate, or one per something: bounds grow with a coarser gyro."""

    symbol: str
    is_rate: bool = False

    def per(self, other: str) -> Unit:
        """Return this unit for every one of another."""
        return Unit(f"{self.symbol}/{other}", self.is_rate)


DPH = Unit("deg/h", is_rate=True)
PPM = Unit("ppm")


class Input(Flag):
    """What a formula follows. `HISTORY`: what went before, too; `TURN`: it needs a full turn of the table."""

    NONE = 0
    T_IN = auto()
    T_OUT = auto()
    WARMING = auto()
    GRADIENT = auto()
    HISTORY = auto()
    TIME = auto()
    RATE = auto()
    """The input rate along the sensitive axis."""
    TABLE_RATE = auto()
    ANGLE = auto()
    ATTITUDE = auto()
    TURN = auto()
    CLOCKS = auto()
    """How the sample times of gyro and table lie to each other."""
    OTHER_AXES = auto()
    """What the unit's accelerometers, or its gyros about other axes, measure."""


_SLOW = Input.T_IN | Input.T_OUT | Input.WARMING | Input.GRADIENT | Input.HISTORY | Input.TIME
_FAST = Input.RATE | Input.TABLE_RATE | Input.ANGLE | Input.ATTITUDE | Input.TURN


class Causal(Enum):
    """How a plant, which knows the past only, executes a formula."""

    TICK = auto()
    """Once a second, on temperatures and time (`Variant.stepper`)."""
    RATE = auto()
    """On every sample's input rate (`Variant.response_dph`)."""
    SAMPLE = auto()
    """On every sample's angle, attitude and table rate, as a diagnosis does: such a formula has no memory."""


@dataclass(frozen=True)
class Parameter:
    """A named parameter with its unit and the bounds outside which it is not believed.

    A model file without an `optional` one means zero.
    """

    name: str
    low: float
    high: float
    unit: Unit
    optional: bool = False

    def bounds(self, coarseness: float) -> tuple[float, float]:
        """Return the bounds for a gyro that is so many times coarser than an optical one, biases and all."""
        factor = coarseness if self.unit.is_rate else 1.0
        return factor * self.low, factor * self.high


@dataclass(frozen=True)
class Curve:
    """Which free curve can be the real form of an effect: the one over this input, of bias or of scale factor."""

    over: Input
    of_rate: bool = False


@dataclass(frozen=True, eq=False)
class SlowRates:
    """Means over blocks at one rate: input and output rate in deg/h, run number, each (m,).

    `records` are the runs themselves: stimulus and output less input rate in deg/h, (n,), NaN where
    it is missing.
    """

    rate: Array
    output: Array
    run: NDArray[np.int64]
    records: Sequence[tuple[Stimulus, Array]] = ()

    def apart(self, values: Array, use: NDArray[np.bool_]) -> Array:
        """Return values less the mean over their run of those in `use`; of a run without any they stay."""
        result = values.copy()
        for run in np.unique(self.run[use]):
            at = self.run == run
            result[at] -= values[at & use].mean()
        return result


@dataclass(frozen=True)
class Variant:
    """An effect with its non-linear parameters (lags, thresholds) fixed."""

    effect: Effect
    shape: Shape

    def columns(self, stimulus: Stimulus) -> Array:
        """Return deg/h of output for one unit of each parameter, float64 (k, n)."""
        return self.effect.columns(stimulus, self.shape)

    def stepper(self, values: Sequence[float]) -> Callable[[float, float], float]:
        """Return what gives, called once a second with T_in and T_out in degC, bias or scale-factor error."""
        tick, formula, shape = Tick(), self.effect.formula, self.shape

        def step(t_in_c: float, t_out_c: float) -> float:
            tick.move(t_in_c, t_out_c)
            found = np.atleast_1d(formula(tick.in_place_of_stimulus, shape)).tolist()
            return float(sum(value * part for value, part in zip(values, found, strict=True)))

        return step

    def response_dph(self, values: Sequence[float], rate_dph: Array) -> Array:
        """Return what the effect adds to the output at input rates, deg/h, (n,) -> (n,)."""
        return np.asarray(
            np.asarray(values) @ self.effect.columns(AtRate(rate_dph).in_place_of_stimulus, self.shape)
        )


@dataclass(frozen=True)
class Effect:
    """One contribution to the gyro's output: sum over k of parameter k times row k of its formula.

    `formula(stimulus, shape)` returns a row (n,) for each parameter, or the one row of the only parameter, in
    `unit`: deg/h, or ppm of the input rate. If it follows temperatures and time only, a plant calls it once a
    second with numbers in the place of arrays; it calls `lagged` and `slack` in the same order every time, then.
    `inputs` says what it follows (of ppm: beside the rate), `follows` the same in words.

    `shapes` is the grid of non-linear parameters that a diagnosis tries; without any it has one empty shape.
    `propose(rates)` reads shapes (a limit, a band) off the record instead, none where it shows none: there the
    effect is no candidate; `shapes` then has one of usual size. `whole` are shapes
    that are numbers of something. `curve`: the free curve that a diagnosis may take
    for the effect's real form. `also` is what its shapes may bring in; where that was not recorded, a diagnosis
    has the effect all the same. `possible(values, covariance)` says whether there may be an effect of parameters
    (k,) that are known with this covariance (k, k).
    """

    name: str
    parameters: tuple[Parameter, ...]
    formula: Formula
    inputs: Input
    follows: str
    source: str
    meaning: str
    shapes: tuple[Shape, ...] = (NO_SHAPE,)
    unit: Unit = DPH
    curve: Curve | None = None
    propose: Callable[[SlowRates], Sequence[Shape]] | None = None
    whole: tuple[str, ...] = ()
    channel: Literal["gyro_rate"] = "gyro_rate"
    also: Input = Input.NONE
    possible: Callable[[Array, Array], bool] = lambda _, __: True

    def columns(self, stimulus: Stimulus, shape: Shape) -> Array:
        """Return deg/h of output for one unit of each parameter, float64 (k, n)."""
        found = self.formula(stimulus, shape)
        rows = np.stack(found) if isinstance(found, tuple) else np.atleast_2d(found)
        if len(rows) != len(self.parameters):
            raise ConfigurationError(
                "an effect's formula does not give a row for each parameter",
                where=self.name,
                found=f"{len(rows)} rows",
                expected=", ".join(parameter.name for parameter in self.parameters),
            )
        rows = np.broadcast_to(rows, (len(rows), len(stimulus)))
        return np.asarray(1e-6 * stimulus.input_rate_dph * rows) if self.unit == PPM else rows

    @cached_property
    def grids(self) -> dict[str, list[float]]:
        """Values of each shape over the grid, in order."""
        return {key: sorted({float(shape[key]) for shape in self.shapes}) for key in self.shapes[0]}

    @property
    def moving(self) -> tuple[str, ...]:
        """Shapes that have values between the points of the grid."""
        return tuple(key for key, grid in self.grids.items() if len(grid) > 1 and key not in self.whole)

    def variants(self) -> tuple[Variant, ...]:
        """Return the effect at every point of its grid."""
        return tuple(Variant(self, shape) for shape in self.shapes)

    @cached_property
    def parity(self) -> int | None:
        """Whether it adds the same at opposite rates, 1, or the opposite, -1; None if it follows more than rate.

        Nor has one that acts at slow rates only: a band about zero is no part of a curve over all rates.
        """
        if not self.inputs or self.inputs & ~(Input.RATE | Input.TABLE_RATE):
            return None
        rates_dps = np.repeat(_RATES_DPS, 2) * np.tile((1.0, -1.0), len(_RATES_DPS))
        still = np.full(len(rates_dps), REFERENCE_C)
        angle_deg = np.concatenate(([0.0], np.cumsum(rates_dps)))
        s = Stimulus(np.cumsum(np.ones(len(still))), still, still, angle_deg, np.full(len(still), 90.0), 0.0)
        forth, back = self.columns(s, self.shapes[0])[0].reshape(-1, 2).T
        size = float(np.abs(forth).max())
        if np.abs(forth[_RATES_DPS > _FAST_DPS]).max() < _SLOW_PART * size:
            return None
        return next((sign for sign in (1, -1) if np.allclose(forth, sign * back, atol=1e-6 * size)), None)

    @property
    def causal(self) -> Causal:
        """How a plant executes it; ConfigurationError, by name, for one that a plant cannot have."""
        if not self.inputs & ~_SLOW:
            return Causal.TICK
        if not self.inputs & ~Input.RATE:
            return Causal.RATE
        if not self.inputs & ~_FAST and self.unit != PPM:
            return Causal.SAMPLE
        raise ConfigurationError(
            "a plant cannot have an effect of the model",
            where="plant",
            found=self.name,
            expected="an effect of temperatures and time alone, or of rate, angle and attitude alone",
            remedy="take the effect out of the model file; its other effects can be rehearsed without it",
        )


@dataclass(frozen=True)
class NoiseEffect:
    """A stochastic effect; `parameter` is the coefficient of the noise model that it raises."""

    name: str
    parameter: Parameter
    source: str
    meaning: str
    channel: Literal["gyro_rate", "time_stamps"] = "gyro_rate"
