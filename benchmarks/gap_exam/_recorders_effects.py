"""Effects of a small optical gyro in a closed loop, as odd recorders see them: known ones and foreign ones.

Lags, thresholds and exponents belong to the unit; `size` is a bias in deg/h or parts per million of rate.
"""

from __future__ import annotations

import math

import numpy as np

from benchmarks.gap_exam._family import Effect, Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._recorders_bench import HEAT_S, Recorded
from benchmarks.gap_exam._signals import drawn, follow, play, slope_per_min, spectrum_of_lags
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._turning import encoder, heading, known, skew
from drivers.base.arrays import Array

LATITUDE_DEG = 47.7
_ROOM_C = 25.0
_DIP = 2.0
"""Vertical over horizontal field of the Earth at the latitude."""


def _between(unit: Unit, name: str, low: float, high: float) -> float:
    return low + (high - low) * unit.draw[name]


def _over_room(stage: Stage) -> Array:
    return stage.t_in_c - _ROOM_C


# known to the catalogue ---------------------------------------------------------------------------------------


def leakage(unit: Unit, stage: Stage, size: float) -> Array:
    """The modulator's leakage grows exponentially with temperature: `size` is the bend's bias 40 K over room."""
    theta_k = _between(unit, "c1", 28.0, 60.0)

    def bend(x: Array | float) -> Array:
        return np.asarray(np.expm1(np.divide(x, theta_k)) - np.divide(x, theta_k))

    return np.asarray(size * bend(_over_room(stage)) / bend(40.0))


def coil_rate(unit: Unit, stage: Stage, size: float) -> Array:
    """Heat waves in the coil: odd in its rate of temperature, compressed over some K/min, late by the winding."""
    knee = _between(unit, "form", 1.0, 3.0)
    slope = slope_per_min(follow(stage.t_in_c, 8.0, stage.step_s), stage.step_s)
    wave = follow(slope, _between(unit, "c2", 10.0, 40.0), stage.step_s)
    return np.asarray(size * knee * np.arcsinh(wave / knee))


def late_coupler(unit: Unit, stage: Stage, size: float) -> Array:
    """A coupler's glue follows the temperature by a spectrum of lags: `size` a 10 K that it is behind."""
    lag_s = 60.0 * _between(unit, "a", 6.0, 18.0)
    times = (lag_s / 2.5, lag_s, 2.5 * lag_s)
    late = spectrum_of_lags(stage.t_in_c, times, (0.3, 0.4, 0.3), stage.step_s)
    return np.asarray(size * (late - stage.t_in_c) / 10.0)


def splice_friction(unit: Unit, stage: Stage, size: float) -> Array:
    """Fibre sticks in its potting: three play elements, the bias of all on one side is `size`; no rate in it."""
    every = max(round(HEAT_S / stage.step_s), 1)
    coarse = stage.t_in_c[::every]
    widest_k = _between(unit, "b", 4.0, 10.0)
    widths = (0.25 * widest_k, 0.5 * widest_k, widest_k)
    stuck = np.mean([(play(coarse, width) - coarse) / width for width in widths], axis=0)
    return np.asarray(size * np.interp(np.arange(stage.steps), np.arange(len(coarse)) * every, stuck))


def wavelength(unit: Unit, stage: Stage, size: float) -> Array:
    """The source's wavelength bends to a limit: scale factor, `size` ppm a 25 K at room."""
    theta_k = _between(unit, "g1", 40.0, 110.0) * (1.0 if unit.draw["order"] < 0.5 else -1.0)
    shift = -np.expm1(-_over_room(stage) / theta_k) * theta_k / 25.0
    return np.asarray(1e-6 * size * sensed_dph(stage, LATITUDE_DEG) * shift)


def feedback_asymmetry(unit: Unit, stage: Stage, size: float) -> Array:
    """The ramp's flyback costs one direction more: even in rate, `size` ppm of it over a few deg/s."""
    knee_dps = _between(unit, "form", 0.3, 2.0)
    rate = stage.axis_dps
    return np.asarray(3600e-6 * size * rate * np.tanh(rate / knee_dps))


def dead_band(unit: Unit, stage: Stage, size: float) -> Array:
    """Crosstalk holds the loop at zero: no output below `size` deg/h, all of it above, steep by an exponent."""
    steep = _between(unit, "form", 4.0, 12.0)
    rate = sensed_dph(stage, LATITUDE_DEG)
    return np.asarray(-rate * np.exp(-np.minimum((np.abs(rate) / size) ** steep, 700.0)))


def coil_sag(unit: Unit, stage: Stage, size: float) -> Array:
    """The coil sags under gravity along the axis, and stiffens: odd in it, `size` at 1 g."""
    stiff = _between(unit, "c1", 0.2, 2.0)
    gravity = np.sin(np.radians(stage.elevation_deg))
    return np.asarray(size * gravity * np.sqrt((1.0 + stiff) / (1.0 + stiff * gravity**2)))


def faraday(turn_rad: Array, elevation_rad: Array, unit: Unit) -> Array:
    """The fibre's twist feels the Earth's field along the axis, and its shield saturates: +-1 at most."""
    knee = _between(unit, "tilt", 0.5, 2.0)
    level = np.cos(elevation_rad) * np.cos(turn_rad + 2.0 * math.pi * unit.draw["lean"])
    along = (level + _DIP * np.sin(elevation_rad)) / math.hypot(1.0, _DIP)
    return np.asarray(np.tanh(along / knee) / math.tanh(1.0 / knee))


def supply_line(unit: Unit, stage: Stage, size: float) -> Array:
    """A switching supply beats with the loop: one frequency, another phase in every run."""
    phase = drawn(unit.seed, "supply", stage.key).uniform(0.0, 2.0 * math.pi)
    return np.asarray(size * np.sin(2.0 * math.pi * line_hz(unit) * stage.time_s + phase))


def line_hz(unit: Unit) -> float:
    """Return the frequency of the supply's line: slow enough for the slowest rows."""
    return float(0.02 * 8.0 ** unit.draw["phase"])


# foreign to the catalogue -------------------------------------------------------------------------------------


def fan_current(unit: Unit, stage: Stage, size: float) -> Array:
    """Fans of the chamber load the gyro's supply: a bias while they blow, at other times in every repeat."""
    blows = stage.fan if isinstance(stage, Recorded) and stage.fan is not None else np.zeros(stage.steps)
    return np.asarray(size * (follow(blows, 6.0, stage.step_s) - 0.5))


def self_test(unit: Unit, stage: Stage, size: float) -> Array:
    """The gyro's own self-test: bursts at odd times from a run's start on, each with a tail, alike in repeats."""
    gaps = drawn(unit.seed, "self-test").uniform(150.0, 700.0, 80)
    begins = np.cumsum(gaps)
    last = np.searchsorted(begins, stage.time_s)
    since = np.where(last > 0, stage.time_s - begins[np.maximum(last - 1, 0)], np.inf)
    tail_s = _between(unit, "c2", 20.0, 60.0)
    return np.asarray(size * np.minimum(since, 5.0) / 5.0 * np.exp(-since / tail_s))


def motor_heat(unit: Unit, stage: Stage, size: float) -> Array:
    """The table's motor warms the gyro from below: bias by what it turned minutes ago, through two lags."""
    lag_s = 60.0 * _between(unit, "a", 2.0, 6.0)
    power = np.abs(stage.rate_dps) ** _between(unit, "form", 0.4, 0.9)
    return np.asarray(size * follow(follow(power, lag_s, stage.step_s), 0.6 * lag_s, stage.step_s) / 5.0)


def slew_recovery(unit: Unit, stage: Stage, size: float) -> Array:
    """An amplifier recovers from a change of rate: a stretched tail, `size` after one of 10 deg/s."""
    slow_s = _between(unit, "b", 15.0, 40.0)
    rate = np.sign(stage.axis_dps) * np.sqrt(np.abs(stage.axis_dps) / 10.0)
    tail = 0.6 * (rate - follow(rate, slow_s, stage.step_s)) + 0.4 * (
        rate - follow(rate, 4.0 * slow_s, stage.step_s)
    )
    return np.asarray(size * follow(tail, 1.5, stage.step_s))


EFFECTS = {
    "leakage": known(leakage, "bias_quadratic", "bias_cubic"),
    "coil_rate": known(coil_rate, "shupe", beside=("gradient",)),
    "late_coupler": known(late_coupler, "thermal_lag", "relaxation"),
    "splice_friction": known(splice_friction, "hysteresis"),
    "wavelength": known(wavelength, "scale_factor_temperature", "scale_factor_quadratic"),
    "feedback_asymmetry": known(feedback_asymmetry, "scale_factor_asymmetry"),
    "dead_band": Effect(dead_band, ("dead_zone", "lock_in"), curved=True, sizes=(0.5, 400.0), signed=False),
    "coil_sag": known(coil_sag, "acceleration_sensitivity", beside=("heading_sensitivity",)),
    "faraday": heading(faraday),
    "ripple": encoder((1, 2, 6, 9), 0.2),
    "clock_skew": skew(LATITUDE_DEG),
    "supply_line": Effect(supply_line, ("vibration_or_mains_line",), changing=True),
    "fan_current": Effect(fan_current, changing=True),
    "self_test": Effect(self_test),
    "motor_heat": Effect(motor_heat),
    "slew_recovery": Effect(slew_recovery),
}
