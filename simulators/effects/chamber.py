"""Chamber air: a ramp generator within what the chamber manages, response lag, overshoot, offset."""

from __future__ import annotations

import math

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._channel import ChannelEffect, ChannelInputs, Values
from simulators.effects._effect import Parameter, Unit
from simulators.effects._stimulus import follower, gain

_K, _S = Unit("K"), Unit("s")
CHAMBER_RAMP = ChannelEffect(
    "chamber_ramp",
    "chamber_air",
    (
        Parameter("cooling_k_per_min_at_25c", 0.01, 100.0, _K.per("min")),
        Parameter("cooling_k_per_min_at_minus_40c", 0.01, 100.0, _K.per("min")),
        Parameter("heating_k_per_min", 0.01, 100.0, _K.per("min")),
    ),
    (100.0, 100.0, 100.0),
    "demanded ramp, temperature of the air",
    "IEC 60068-3-5, temperature rate of change",
    "The chamber cannot ramp as fast as it is told to.",
    starts=tuple(
        (warm, cold, heating)
        for warm, cold in ((100.0, 100.0), (30.0, 8.0), (15.0, 4.0), (10.0, 10.0), (8.0, 2.0), (4.0, 4.0))
        for heating in (100.0, 10.0, 4.0)
    ),
)
CHAMBER_OVERSHOOT = ChannelEffect(
    "chamber_overshoot",
    "chamber_air",
    (Parameter("overshoot_s", -600.0, 600.0, _S), Parameter("settling_s", 5.0, 3600.0, _S)),
    (0.0, 120.0),
    "begin and end of a ramp, in proportion to its rate",
    "IEC 60068-3-5, temperature overshoot; response of a proportional-integral controller",
    "The air falls behind when a ramp begins and runs beyond the set point at its end.",
    starts=((10.0, 60.0), (20.0, 300.0)),
)
CHAMBER_RESPONSE = ChannelEffect(
    "chamber_response",
    "chamber_air",
    (Parameter("lag_s", 0.0, 3600.0, _S),),
    (0.0,),
    "demanded ramp",
    "first-order response",
    "The air follows the set point late.",
    starts=((60.0,),),
)
CHAMBER_OFFSET = ChannelEffect(
    "chamber_offset",
    "chamber_air",
    (Parameter("offset_k", -20.0, 20.0, _K),),
    (0.0,),
    "nothing: constant",
    "IEC 60068-3-5, temperature deviation",
    "The air settles beside the set point.",
)
CHAMBER_EFFECTS = (CHAMBER_RAMP, CHAMBER_OVERSHOOT, CHAMBER_RESPONSE, CHAMBER_OFFSET)


def chamber_air(inputs: ChannelInputs, values: Values) -> Array:
    """Ramp generator within what the chamber manages, response lag, overshoot."""
    (lag_s,) = CHAMBER_RESPONSE.of(values)
    overshoot_s, settling_s = CHAMBER_OVERSHOOT.of(values)
    (offset_k,) = CHAMBER_OFFSET.of(values)
    wanted = _ramped(inputs, CHAMBER_RAMP.of(values))
    ramp = np.gradient(wanted, inputs.period_s)
    ahead = follower(ramp, settling_s, inputs.period_s, 0.0)
    beyond = overshoot_s * (follower(ahead, settling_s, inputs.period_s, 0.0) - ahead)
    late = follower(wanted, lag_s, inputs.period_s, inputs.start)
    return np.asarray(late + beyond + offset_k)


def _ramped(inputs: ChannelInputs, most_k_per_min: tuple[float, ...]) -> Array:
    """Set point that moves at the demanded rate, or as fast as the chamber can where that is slower."""
    time_s, here = inputs.time_s, inputs.start
    result = np.full(len(time_s), here)
    ends_s = [demand.time_s for demand in inputs.demands[1:]] + [math.inf]
    for demand, end_s in zip(inputs.demands, ends_s, strict=True):
        now_s = max(demand.time_s, time_s[0] - inputs.period_s)
        first, last = np.searchsorted(time_s, (now_s, end_s)).tolist()
        index = first
        while index <= last and here != demand.target:
            # to the next sample, or to the next demand between two of them
            until_s = min(float(time_s[index]) if index < len(time_s) else math.inf, end_s)
            if math.isinf(until_s):
                break
            fastest = _fastest_k_per_min(most_k_per_min, here, demand.target)
            step = min(demand.ramp_per_s, fastest / 60.0) * (until_s - now_s)
            gap = demand.target - here
            here = demand.target if step >= abs(gap) else here + math.copysign(step, gap)
            if index < last:
                result[index] = here
            now_s, index = until_s, index + 1
        result[min(index, last) :] = here
    return result


def _fastest_k_per_min(most_k_per_min: tuple[float, ...], here_c: float, target_c: float) -> float:
    """Return what the chamber manages: in cooling linear from 25 to -40 degC, never less than 0.01 K/min."""
    warm, cold, heating = most_k_per_min
    most = heating if target_c > here_c else cold + (warm - cold) * (here_c + 40.0) / 65.0
    return max(most, 0.01)


class AirBySecond:
    """The same air as a plant has it: one second at a time, lags by backward differences."""

    def __init__(self, values: Values, air_c: float) -> None:
        self._most = CHAMBER_RAMP.of(values)
        self._overshoot_s, settling_s = CHAMBER_OVERSHOOT.of(values)
        self._settling_gain = gain(settling_s)
        self._late_gain = gain(*CHAMBER_RESPONSE.of(values))
        (self._offset_k,) = CHAMBER_OFFSET.of(values)
        self._late_c, self._ahead, self._beyond = air_c, 0.0, 0.0

    def restart(self, air_c: float) -> None:
        """Begin at the present air when the controller is switched on."""
        self._late_c = air_c - self._offset_k

    def fastest_k_per_min(self, here_c: float, target_c: float) -> float:
        """Return how fast the set point moves at most."""
        return _fastest_k_per_min(self._most, here_c, target_c)

    def step(self, set_point_c: float, moved_k: float) -> float:
        """Return the air a second later, degC, at a set point that has moved by so much in it."""
        self._late_c += (set_point_c - self._late_c) * self._late_gain
        self._ahead += (moved_k - self._ahead) * self._settling_gain
        self._beyond += (self._ahead - self._beyond) * self._settling_gain
        return self._late_c + self._overshoot_s * (self._beyond - self._ahead) + self._offset_k
