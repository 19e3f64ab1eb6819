"""A plant family: a campaign, a gyro's noise, effects known and foreign to the catalogue, and how its lab
logs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

Draw = Mapping[str, float]
"""What a unit has beside the sizes of its effects: lags, thresholds, phases; numbers from 0 to 1 by name."""


@dataclass(frozen=True)
class Sheet:
    """The data sheet: noise as in IEEE Std 952, how far scale factor and slope of bias may be off."""

    arw_deg_per_sqrt_h: float
    bias_instability_dph: float
    rate_random_walk_dph_per_sqrt_h: float
    quantum_arcsec: float
    sf_sigma_ppm: float
    slope_sigma_dph: float
    turn_on_sigma_dph: float


@dataclass(frozen=True)
class Unit:
    """One gyro on its bench. `inside` are effects that change noise or output as a whole: name to size."""

    seed: int
    draw: Draw
    sf_ppm: float
    slope_dph: float
    sheet: Sheet
    inside: Mapping[str, float] = field(default_factory=dict)


Signal = Callable[[Unit, Stage, float], Array]
"""What an effect of some size adds to the rate, deg/h, (m,) on the fine grid."""
Truth = Callable[[Unit, float], dict[str, float]]


@dataclass(frozen=True)
class Effect:
    """An effect. `names`: what the catalogue calls its mechanism, empty if it is foreign to it.

    `beside`: names that are no false causes with it, as these runs show both in one. `truth` gives the true
    values of catalogue parameters that have the same meaning. `curved`: its signal is not proportional to its
    size, which lies in `sizes`. `changing`: it is not the same in every repeat.
    """

    signal: Signal
    names: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    truth: Truth | None = None
    curved: bool = False
    sizes: tuple[float, float] = (1e-6, 1e6)
    changing: bool = False
    signed: bool = True


@dataclass(frozen=True)
class Layout:
    """How the lab logs: file type, columns with units; temperatures in K or degC.

    `clock`: when the first run began, ISO 8601, if rows have date-times; empty for seconds of a run.
    `temperature_word_k`: the size of a thermometer's count if it logs counts of degC; 0 for temperatures.
    """

    suffix: str
    output: tuple[str, str]
    angle: tuple[str, str]
    temperature: str = "degC"
    clock: str = ""
    temperature_word_k: float = 0.0


@dataclass(frozen=True)
class Family:
    """A plant family. `rows` gives the logged output, deg/h, (n,): noise, counter and losses on a true rate (n,).

    `sense` gives the true rate without effects on the fine grid; `read` the logged (t_in, t_out, angle).
    `noisy`: stochastic effects by name, with the range of their factor and what the catalogue calls them.
    `weakest_ratio`: the least signal-to-noise ratio of its effects, where a case asks for no greater one.
    """

    name: str
    latitude_deg: float
    sheet: Sheet
    layout: Layout
    effects: Mapping[str, Effect]
    noisy: Mapping[str, tuple[float, float, str]]
    campaign: Callable[[Unit], list[Stage]]
    rows: Callable[[Unit, Stage, Array, np.random.Generator], Array]
    read: Callable[[Unit, Stage, np.random.Generator], tuple[Array, Array, Array]]
    weakest_ratio: float = 1.0

    @property
    def known(self) -> tuple[str, ...]:
        return tuple(name for name, effect in self.effects.items() if effect.names)

    @property
    def foreign(self) -> tuple[str, ...]:
        return tuple(name for name, effect in self.effects.items() if not effect.names)

    @property
    def nominal_text(self) -> str:
        """The nominal model as a file."""
        s = self.sheet
        return (
            f'format = 1\nname = "nominal"\n\n[noise]\narw_deg_per_sqrt_h = {s.arw_deg_per_sqrt_h}\n'
            f"bias_instability_dph = {s.bias_instability_dph}\n"
            f"rate_random_walk_dph_per_sqrt_h = {s.rate_random_walk_dph_per_sqrt_h}\n"
            f"quantum_arcsec = {s.quantum_arcsec}\n\n"
            f'[[effect]]\nname = "scale_factor"\nparameters = {{ sf_ppm = 0.0 }}\n'
            f"sigma = {{ sf_ppm = {s.sf_sigma_ppm} }}\n\n"
            f'[[effect]]\nname = "bias_linear"\nparameters = {{ bias_dph_per_50k = 0.0 }}\n'
            f"sigma = {{ bias_dph_per_50k = {s.slope_sigma_dph} }}\n"
        )
