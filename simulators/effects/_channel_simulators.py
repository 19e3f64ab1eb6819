"""The channels' simulators: what each should have shown, given what was demanded of it or acted on it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

import numpy as np

from drivers.base.arrays import Array
from simulators.effects._channel import Channel, ChannelEffect, ChannelInputs
from simulators.effects._stimulus import REFERENCE_C

Values = Mapping[str, tuple[float, ...]]
"""Effect's name to the values of its parameters."""


def simulate(
    channel: Channel, inputs: ChannelInputs, values: Values, effects: Iterable[ChannelEffect]
) -> Array:
    """Return what a channel should have shown, (n,): its simulator, then every effect with an `apply`, in order.

    `effects` are the channel's; one that `values` lacks is at its neutral values.
    """
    own = [effect for effect in effects if effect.channel == channel]
    full = {effect.name: values.get(effect.name, effect.neutral) for effect in own}
    signal = _SIMULATORS[channel](inputs, full)
    for effect in own:
        if effect.apply is not None and full[effect.name] != effect.neutral:
            signal = effect.apply(inputs, signal, full[effect.name])
    return signal


def _follower(values: Array, time_constant_s: float, period_s: float, start: float) -> Array:
    """First-order follower, exact for an input that is linear between samples; `start` is its first value."""
    if time_constant_s < 1e-6 * period_s:
        return values
    decay = math.exp(-period_s / time_constant_s)
    mean = (1.0 - decay) * time_constant_s / period_s
    coefficients = [1.0 - mean, mean - decay]
    from scipy.signal import lfilter  # here: a lab starts without scipy (decision 0021)

    first = start - coefficients[0] * values[0]
    result, _ = lfilter(coefficients, [1.0, -decay], values, zi=[first])
    return np.asarray(result)


def _air(inputs: ChannelInputs, values: Values) -> Array:
    """Ramp generator within what the chamber manages, response lag, overshoot."""
    (lag_s,) = values["chamber_response"]
    overshoot_s, settling_s = values["chamber_overshoot"]
    (offset_k,) = values["chamber_offset"]
    wanted = _ramped(inputs, values["chamber_ramp"])
    ramp = np.gradient(wanted, inputs.period_s)
    ahead = _follower(ramp, settling_s, inputs.period_s, 0.0)
    beyond = overshoot_s * (_follower(ahead, settling_s, inputs.period_s, 0.0) - ahead)
    late = _follower(wanted, lag_s, inputs.period_s, inputs.start)
    return np.asarray(late + beyond + offset_k)


def _ramped(inputs: ChannelInputs, most_k_per_min: tuple[float, ...]) -> Array:
    """Set point that moves at the demanded rate, or as fast as the chamber can where that is slower.

    What it can in cooling changes linearly from 25 to -40 degC and is never less than 0.01 K/min.
    """
    warm, cold, heating = most_k_per_min
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
            most = heating if demand.target > here else cold + (warm - cold) * (here + 40.0) / 65.0
            step = min(demand.ramp_per_s, max(most, 0.01) / 60.0) * (until_s - now_s)
            gap = demand.target - here
            here = demand.target if step >= abs(gap) else here + math.copysign(step, gap)
            if index < last:
                result[index] = here
            now_s, index = until_s, index + 1
        result[min(index, last) :] = here
    return result


def _node(
    inputs: ChannelInputs,
    conductance: float,
    capacity: float,
    inner: tuple[float, float],
    power_w: float,
    start: float,
) -> Array:
    """Temperature of a body in exchange with `drive` and with a mass behind it: two modes, exactly.

    C dT/dt = G (drive - T) + Gi (Ti - T) + P;  Ci dTi/dt = Gi (T - Ti). Both begin at `start`.
    """
    inner_conductance, inner_capacity = inner
    dynamics = np.array(
        [
            [-(conductance + inner_conductance) / capacity, inner_conductance / capacity],
            [inner_conductance / inner_capacity, -inner_conductance / inner_capacity],
        ]
    )
    rates, modes = np.linalg.eig(dynamics)
    drive = conductance * inputs.drive + power_w
    weights = np.linalg.solve(modes, np.array([1.0 / capacity, 0.0]))
    at_start = np.linalg.solve(modes, np.full(2, start))
    result = np.zeros(len(inputs.drive))
    for k in range(2):
        gain = -weights[k] / rates[k]
        forced = _follower(gain * drive, -1.0 / rates[k], inputs.period_s, at_start[k])
        result += modes[0, k] * forced
    return result


def _case(inputs: ChannelInputs, values: Values) -> Array:
    (conductance,) = values["air_to_case_conductance"]
    (capacity,) = values["case_heat_capacity"]
    inner_capacity, inner_conductance = values["fixture_heat"]
    (power_w,) = values["self_heating_power"]
    return _node(inputs, conductance, capacity, (inner_conductance, inner_capacity), power_w, inputs.start)


def _inside(inputs: ChannelInputs, values: Values) -> Array:
    (conductance,) = values["case_to_gyro_conductance"]
    (capacity,) = values["gyro_heat_capacity"]
    inner_capacity, inner_conductance = values["gyro_core_heat"]
    (power_w,) = values["gyro_heating_power"]
    (offset_k,) = values["temperature_sensor_offset"]
    (gain_percent,) = values["temperature_sensor_gain"]
    (lag_s,) = values["temperature_sensor_lag"]
    start = (inputs.start - offset_k + 0.01 * gain_percent * REFERENCE_C) / (1.0 + 0.01 * gain_percent)
    true = _node(inputs, conductance, capacity, (inner_conductance, inner_capacity), power_w, start)
    late = _follower(true, lag_s, inputs.period_s, start)
    return late + 0.01 * gain_percent * (late - REFERENCE_C) + offset_k


def _angle(inputs: ChannelInputs, values: Values) -> Array:
    """Held positions: what is off the demanded angle, arcsec."""
    (offset,) = values["table_position_offset"]
    (creep,) = values["table_position_creep"]
    cosine, sine = values["table_encoder_eccentricity"]
    turn = np.radians(inputs.angle_deg)
    since_h = _since_change_s(inputs) / 3600.0
    return np.asarray(
        inputs.drive + offset + creep * since_h + cosine * (np.cos(turn) - 1.0) + sine * np.sin(turn)
    )


def _rate(inputs: ChannelInputs, values: Values) -> Array:
    error_ppm, offset_mdps = values["table_rate_error"]
    once, twice = values["table_rate_ripple_once"], values["table_rate_ripple_twice"]
    turn = np.radians(inputs.angle_deg)
    ripple = once[0] * np.cos(turn) + once[1] * np.sin(turn)
    ripple += twice[0] * np.cos(2.0 * turn) + twice[1] * np.sin(2.0 * turn)
    return np.asarray(inputs.drive * (1.0 + 1e-6 * (error_ppm + ripple)) + 1e-3 * offset_mdps)


def _stamps(inputs: ChannelInputs, values: Values) -> Array:
    """Arrival of the earliest sample of each second against its own count at the nominal rate, mean 0, ms."""
    (skew_ppm,) = values["sample_clock_skew"]
    since_s = inputs.time_s - inputs.time_s.mean()
    return np.asarray(inputs.drive - 1e-3 * skew_ppm * since_s)


def _since_change_s(inputs: ChannelInputs) -> Array:
    """Return time since the demand last changed, (n,): `demands` say when."""
    starts = np.array([demand.time_s for demand in inputs.demands] or [inputs.time_s[0]])
    at = np.maximum(np.searchsorted(starts, inputs.time_s, side="right") - 1, 0)
    return np.asarray(inputs.time_s - starts[at])


_SIMULATORS = {
    "chamber_air": _air,
    "case_temperature": _case,
    "gyro_temperature": _inside,
    "table_angle": _angle,
    "table_rate": _rate,
    "time_stamps": _stamps,
}
