"""The catalogue of effects: what a gyro's output can depend on, as columns of a linear model of the stimulus."""

from simulators.effects._catalogue import CATALOGUE, AnyEffect, catalogue
from simulators.effects._channel import CHANNEL_UNITS, Channel, ChannelEffect, ChannelInputs, Demand
from simulators.effects._channel_simulators import simulate
from simulators.effects._effect import Disturbance, Effect, NoiseEffect, Parameter, Variant
from simulators.effects._stimulus import REFERENCE_C, Stimulus

__all__ = [
    "CATALOGUE",
    "CHANNEL_UNITS",
    "REFERENCE_C",
    "AnyEffect",
    "Channel",
    "ChannelEffect",
    "ChannelInputs",
    "Demand",
    "Disturbance",
    "Effect",
    "NoiseEffect",
    "Parameter",
    "Stimulus",
    "Variant",
    "catalogue",
    "simulate",
]
