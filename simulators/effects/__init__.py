"""The catalogue of effects: what a gyro's output can depend on, as columns of a linear model of the stimulus."""

from simulators.effects._catalogue import CATALOGUE, AnyEffect, catalogue, effect_named, simulate
from simulators.effects._channel import (
    CHANNEL_UNITS,
    AppliedBySecond,
    Channel,
    ChannelEffect,
    ChannelInputs,
    Demand,
    Values,
    applied,
)
from simulators.effects._disturbance import Disturbance, Draws, Finding, Record, SamplePath
from simulators.effects._effect import (
    DPH,
    PPM,
    Causal,
    Curve,
    Effect,
    Formula,
    Input,
    NoiseEffect,
    Parameter,
    Shape,
    SlowRates,
    Unit,
    Variant,
)
from simulators.effects._learned import FORMS, learned_shape
from simulators.effects._stimulus import REFERENCE_C, Stimulus

__all__ = [
    "CATALOGUE",
    "CHANNEL_UNITS",
    "DPH",
    "FORMS",
    "PPM",
    "REFERENCE_C",
    "AnyEffect",
    "AppliedBySecond",
    "Causal",
    "Channel",
    "ChannelEffect",
    "ChannelInputs",
    "Curve",
    "Demand",
    "Disturbance",
    "Draws",
    "Effect",
    "Finding",
    "Formula",
    "Input",
    "NoiseEffect",
    "Parameter",
    "Record",
    "SamplePath",
    "Shape",
    "SlowRates",
    "Stimulus",
    "Unit",
    "Values",
    "Variant",
    "applied",
    "catalogue",
    "effect_named",
    "learned_shape",
    "simulate",
]
