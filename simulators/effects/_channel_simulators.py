"""The channels' simulators: what each should have shown, given what was demanded of it or acted on it."""

from __future__ import annotations

from collections.abc import Iterable

from drivers.base.arrays import Array
from simulators.effects._channel import Channel, ChannelEffect, ChannelInputs, Values
from simulators.effects._sample_clock import time_stamps
from simulators.effects.chamber import chamber_air
from simulators.effects.heat import case_temperature, gyro_temperature
from simulators.effects.table import table_angle, table_rate


def simulate(
    channel: Channel, inputs: ChannelInputs, values: Values, effects: Iterable[ChannelEffect]
) -> Array:
    """Return what a channel should have shown, (n,): its simulator, then every effect with an `apply`, in order.

    `effects` are the channel's; one that `values` lacks is at its neutral values.
    """
    signal = _SIMULATORS[channel](inputs, values)
    for effect in effects:
        if effect.channel == channel and effect.apply is not None and effect.of(values) != effect.neutral:
            signal = effect.apply(inputs, signal, effect.of(values))
    return signal


_SIMULATORS = {
    "chamber_air": chamber_air,
    "case_temperature": case_temperature,
    "gyro_temperature": gyro_temperature,
    "table_angle": table_angle,
    "table_rate": table_rate,
    "time_stamps": time_stamps,
}
