"""The catalogue of effects: what a gyro's output can depend on, as columns of a linear model of the stimulus."""

from simulators.effects._catalogue import CATALOGUE, catalogue
from simulators.effects._effect import Effect, NoiseEffect, Parameter, Variant
from simulators.effects._stimulus import EARTH_RATE_DPH, REFERENCE_C, Stimulus

__all__ = [
    "CATALOGUE",
    "EARTH_RATE_DPH",
    "REFERENCE_C",
    "Effect",
    "NoiseEffect",
    "Parameter",
    "Stimulus",
    "Variant",
    "catalogue",
]
