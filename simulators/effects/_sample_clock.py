"""The gyro's sample clock against the bench's."""

from __future__ import annotations

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._channel import ChannelEffect, ChannelInputs, Values
from simulators.effects._effect import PPM, Parameter

SAMPLE_CLOCK_SKEW = ChannelEffect(
    "sample_clock_skew",
    "time_stamps",
    (Parameter("skew_ppm", -1e5, 1e5, PPM),),
    (0.0,),
    "time in the run",
    "oscillator's data sheet",
    "The gyro's sample clock is fast (positive) or slow against the bench's.",
    emulated_by="sample_clock",
)


def time_stamps(inputs: ChannelInputs, values: Values) -> Array:
    """Arrival of the earliest sample of each second against its own count at the nominal rate, mean 0, ms."""
    (skew_ppm,) = SAMPLE_CLOCK_SKEW.of(values)
    since_s = inputs.time_s - inputs.time_s.mean()
    return np.asarray(inputs.drive - 1e-3 * skew_ppm * since_s)
