"""What vibrating gyros and their package suffer from, by physics of the instrument; forms are drawn with the
unit.

Sources: IEEE Std 1431 on Coriolis gyros; Prikhodko et al., Sensors and Actuators A 2013, on quality factor
and package stress over temperature; Weinberg & Kourepenis, JMEMS 15 (2006) on error sources; Ferry on Maxwell
chains of polymers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from benchmarks.gap_exam._family import Effect, Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._signals import drawn, follow, slope_per_min, smooth_step
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._turning import (
    encoder,
    heading,
    impulses,
    known,
    latency,
    misalignment,
    skew,
    telegraph,
)
from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K

LATITUDE_DEG = 37.8
_ROOM_C = 28.0


def _sensed(stage: Stage) -> Array:
    return sensed_dph(stage, LATITUDE_DEG)


def _quadrature(unit: Unit, stage: Stage, size: float) -> Array:
    """Quadrature leaks by a demodulator's phase that turns with temperature: a rational or waving curve."""
    x = (stage.body("die") - _ROOM_C) / 60.0
    forms = (
        x**2 / (1.0 + 0.5 * unit.draw["a"] * x),
        x**3 - 0.4 * x**2,
        np.log1p(np.exp(4.0 * (x - 0.2))),
        1.0 - np.cos(2.2 * x + 0.4 * unit.draw["a"]),
    )
    return np.asarray(size * forms[int(4.0 * unit.draw["form"]) % 4])


def _squeezed(unit: Unit, stage: Stage, size: float) -> Array:
    """Glue under the die shears while it warms; the die lags behind its sensor by little."""
    die = follow(stage.body("die"), 20.0 + 120.0 * unit.draw["a"], stage.step_s)
    return np.asarray(size * slope_per_min(follow(die, 15.0, stage.step_s), stage.step_s))


def _squeezed_more_in_heat(unit: Unit, stage: Stage, size: float) -> Array:
    """The glue's expansion grows with temperature."""
    die = stage.body("die")
    expansion = (die - _ROOM_C) / 45.0 + 0.3 * ((die - _ROOM_C) / 45.0) ** 3
    return np.asarray(size * expansion * slope_per_min(follow(die, 40.0, stage.step_s), stage.step_s))


def _bowed(unit: Unit, stage: Stage, size: float) -> Array:
    """The package bows by the difference between its die and its lid."""
    across = stage.body("die") - stage.body("lid")
    settled = follow(across, 60.0 + 200.0 * unit.draw["a"], stage.step_s)
    return np.asarray(size * (0.7 * across + 0.3 * settled))


def _maxwell(values: Array, times_s: tuple[float, ...], shares: tuple[float, ...], step_s: float) -> Array:
    """Return the stress of a chain of Maxwell elements: each carries what changed and lets go in its own time."""
    total = sum(
        share * (values - follow(values, time_s, step_s))
        for time_s, share in zip(times_s, shares, strict=True)
    )
    return np.asarray(total)


def _quick_stress(unit: Unit, stage: Stage, size: float) -> Array:
    scale = 70.0 + 250.0 * unit.draw["a"]
    times = (0.4 * scale, scale, 2.2 * scale)
    return np.asarray(size * _maxwell(stage.body("die"), times, (0.25, 0.5, 0.25), stage.step_s))


def _slow_stress(unit: Unit, stage: Stage, size: float) -> Array:
    scale = 1800.0 + 2500.0 * unit.draw["a"]
    times = (0.4 * scale, scale, 2.5 * scale)
    return np.asarray(size * _maxwell(stage.body("die"), times, (0.3, 0.4, 0.3), stage.step_s))


def _friction(unit: Unit, stage: Stage, size: float) -> Array:
    """The clip that holds the package slips: elements that stick up to limits of their own (Iwan 1966)."""
    every = max(1, round(4.0 / stage.step_s))
    die = stage.body("die")[::every]
    limits = (2.0 + 10.0 * unit.draw["a"]) * np.array([0.4, 0.8, 1.3, 2.0, 3.0])
    stiffness = 1.0 / limits ** (0.5 + unit.draw["b"])
    held, out = np.zeros(len(limits)), np.empty(len(die))
    for k, change in enumerate(np.diff(die, prepend=die[0]).tolist()):
        held = np.clip(held + change, -limits, limits)
        out[k] = stiffness @ held
    return np.asarray(size * np.interp(np.arange(stage.steps), np.arange(len(out)) * every, out))


def _self_heating(unit: Unit, stage: Stage, size: float) -> Array:
    """After power-on the drive loop and the glass frit settle, as a stretched exponential."""
    on = (stage.time_s + stage.power_on_s) / (350.0 + 700.0 * unit.draw["a"])
    return np.asarray(size * np.exp(-(on ** (0.6 + 0.3 * unit.draw["b"]))))


def _trim_step(unit: Unit, stage: Stage, size: float) -> Array:
    """The compensation in the chip changes its segment at a temperature: a step, smeared by its sensor."""
    at = -15.0 + 65.0 * unit.draw["a"]
    sensor = follow(stage.body("die"), 10.0 + 60.0 * unit.draw["b"], stage.step_s)
    return np.asarray(size * smooth_step((sensor - at) / 0.4))


def _sf_modulus(unit: Unit, stage: Stage, size: float) -> Array:
    """Silicon softens and damping follows the root of absolute temperature: the gain changes by ppm a kelvin."""
    warm = stage.body("die") - _ROOM_C
    root = 600.0 * (np.sqrt((stage.body("die") + ZERO_CELSIUS_K) / (_ROOM_C + ZERO_CELSIUS_K)) - 1.0)
    share = unit.draw["a"]
    return np.asarray(1e-6 * size * _sensed(stage) * (share * warm + (1.0 - share) * root + 0.003 * warm**2))


def _sf_stress(unit: Unit, stage: Stage, size: float) -> Array:
    scale = 400.0 + 2200.0 * unit.draw["a"]
    stress = _maxwell(stage.body("die"), (0.6 * scale, 1.6 * scale), (0.5, 0.5), stage.step_s)
    return np.asarray(1e-6 * size * _sensed(stage) * stress)


def _sf_halves(unit: Unit, stage: Stage, size: float) -> Array:
    """Force and sense combs differ: one way of turning is amplified more, blurred where both share the work."""
    rate = _sensed(stage)
    return np.asarray(1e-6 * size * 0.5 * (np.sqrt(rate**2 + 100.0**2) - 100.0))


def _duffing(unit: Unit, stage: Stage, size: float) -> Array:
    """Springs stiffen with the Coriolis amplitude: a cubic that levels off."""
    x = stage.axis_dps / (200.0 + 150.0 * unit.draw["a"])
    return np.asarray(1e-4 * size * 3600.0 * stage.axis_dps * x**2 / (1.0 + 0.6 * x**2))


def _soft_limit(unit: Unit, stage: Stage, size: float) -> Array:
    """The rebalance amplifier runs out of drive towards its end: a smooth bend of order 4 to 10."""
    limit, order = 330.0, 4.0 + 6.0 * unit.draw["a"]
    x = np.abs(stage.axis_dps) / limit
    return np.asarray(size * 3600.0 * stage.axis_dps * ((1.0 + x**order) ** (-1.0 / order) - 1.0))


def _threshold(unit: Unit, stage: Stage, size: float) -> Array:
    """Below `size` deg/h a comparator hardly answers; how far and how softly is drawn with the unit."""
    rate = _sensed(stage)
    slope, softness = 0.5 * unit.draw["a"], 1.5 + 5.0 * unit.draw["b"]
    return np.asarray(-(1.0 - slope) * rate / (1.0 + (np.abs(rate) / size) ** softness))


def _field(turn: Array, elevation: Array, unit: Unit) -> Array:
    """The coil of a magnetic drive in the Earth's field: level 0.24, down 0.42, with its square."""
    declined = math.radians(13.0 + 3.0 * unit.draw["b"])
    along = 0.24 * np.cos(elevation) * np.cos(turn - declined) - 0.42 * np.sin(elevation)
    return np.asarray(along + 0.3 * along**2)


def _weight(unit: Unit, stage: Stage, size: float) -> Array:
    """The proof mass sags: bias by gravity along and across the axis, stiffening a little."""
    elevation = np.radians(stage.elevation_deg)
    along = np.sin(elevation) + 0.3 * (2.0 * unit.draw["a"] - 1.0) * np.cos(elevation)
    return np.asarray(size * (along - 0.05 * along**3))


def _weight_squared(unit: Unit, stage: Stage, size: float) -> Array:
    return np.asarray(size * np.sin(np.radians(stage.elevation_deg)) ** 2)


def _shaken(unit: Unit, stage: Stage, size: float) -> Array:
    """Vibration of the table's belt is rectified: by speed squared, with a part that levels off."""
    speed = np.abs(stage.rate_dps) / 100.0
    return np.asarray(size * speed**2 / (1.0 + 0.1 * unit.draw["a"] * speed))


def _pump(unit: Unit, stage: Stage, size: float) -> Array:
    """The chamber's pump shakes the fixture: a line at 0.06 to 0.4 Hz in samples of a second."""
    frequency = 0.06 + 0.34 * unit.draw["a"]
    phase = drawn(unit.seed, "pump", stage.key).uniform(0.0, 2.0 * math.pi)
    wave = 2.0 * math.pi * frequency * stage.time_s + phase
    return np.asarray(size * (np.sin(wave) + 0.15 * np.sin(2.0 * wave)))


def _resonance(unit: Unit, stage: Stage, size: float) -> Array:
    """Drive and sense modes cross a spurious mode of the frame at some temperature."""
    x = (stage.body("die") - (-10.0 + 60.0 * unit.draw["a"])) / (2.0 + 4.0 * unit.draw["b"])
    return np.asarray(size * (2.0 * x / (1.0 + x**2) + 0.5 / (1.0 + x**2)))


def _dew(unit: Unit, stage: Stage, size: float) -> Array:
    """Frost melts and dries off while the package warms through a few degrees above zero: a bump, once."""
    lid = stage.body("lid")
    warming = slope_per_min(follow(lid, 60.0, stage.step_s), stage.step_s) > 0.2
    bump = np.exp(-0.5 * ((lid - 5.0 - 8.0 * unit.draw["a"]) / 3.0) ** 2)
    return np.asarray(size * follow(bump * warming, 90.0, stage.step_s))


def _blind_rate(unit: Unit, stage: Stage, size: float) -> Array:
    """Damage by the speed of change, whichever way: the root of its magnitude."""
    speed = np.abs(slope_per_min(follow(stage.body("die"), 80.0, stage.step_s), stage.step_s))
    return np.asarray(size * np.sqrt(speed + 0.01))


def _sf_bow(unit: Unit, stage: Stage, size: float) -> Array:
    """The gap of the combs follows the bow of the package: scale factor by die less lid."""
    across = stage.body("die") - stage.body("lid")
    return np.asarray(1e-6 * size * _sensed(stage) * (across - 3.0))


def _rate_peak(unit: Unit, stage: Stage, size: float) -> Array:
    """At one speed the table's bearing passes a mode of the fixture."""
    speed = np.abs(stage.rate_dps)
    at = (90.0, 150.0, 220.0)[int(3.0 * unit.draw["a"]) % 3]
    return np.asarray(size * np.exp(-0.5 * ((speed - at) / 12.0) ** 2))


def _supply(unit: Unit, stage: Stage, size: float) -> Array:
    """The supply sags while the chamber's compressor runs while it cools, in turns of some minutes."""
    air = stage.body("air")
    cooling = slope_per_min(follow(air, 40.0, stage.step_s), stage.step_s) < -0.3
    running = np.sin(2.0 * math.pi * stage.body("fixture") / (8.0 + 8.0 * unit.draw["a"])) > 0.2
    return np.asarray(size * follow((cooling & running).astype(np.float64), 15.0, stage.step_s))


def _wound_cable(unit: Unit, stage: Stage, size: float) -> Array:
    """A cable pulls at the fixture: twice and five times a turn, whatever the speed."""
    turn = np.radians(0.5 * (stage.angle_deg[1:] + stage.angle_deg[:-1]))
    blur = np.sinc(5.0 * np.diff(stage.angle_deg) / 360.0)
    return np.asarray(size * blur * np.cos(5.0 * turn + 2.0 * math.pi * unit.draw["a"]))


def _moisture(unit: Unit, stage: Stage, size: float) -> Array:
    """Water diffuses in and out over days: every run starts elsewhere and dries while it is warm."""
    start = drawn(unit.seed, "moisture", stage.number).normal()
    dryness = np.cumsum(np.exp((stage.body("die") - 60.0) / 18.0)) * stage.step_s / 900.0
    return np.asarray(size * start * np.exp(-dryness))


def _aged(unit: Unit, stage: Stage, size: float) -> Array:
    """Stress of the mould is let go from cycle to cycle: what the gradient does fades."""
    left = math.exp(-stage.number / 9.0) - 0.5
    return np.asarray(size * left * (stage.body("die") - stage.body("frame") - 3.0))


def _cracked(unit: Unit, stage: Stage, size: float) -> Array:
    """In some run, at its coldest, the glue cracks: from then on the bias bends over temperature."""
    if stage.number < 9 + int(3.0 * unit.draw["a"]):
        return np.zeros(stage.steps)
    x = (stage.body("die") - _ROOM_C) / 50.0
    return np.asarray(size * (np.tanh(3.0 * x) - 1.2 * x))


EFFECTS: Mapping[str, Effect] = {
    "quadrature": known(_quadrature, "bias_quadratic", "bias_cubic"),
    "squeezed": known(_squeezed, "shupe"),
    "squeezed_more_in_heat": known(_squeezed_more_in_heat, "shupe_cross"),
    "bowed": known(_bowed, "gradient"),
    "quick_stress": known(_quick_stress, "thermal_lag", "relaxation"),
    "slow_stress": known(_slow_stress, "relaxation", "thermal_lag"),
    "friction": known(_friction, "hysteresis"),
    "self_heating": known(_self_heating, "warm_up"),
    "trim_step": known(_trim_step, "mode_hop", truth=lambda unit, size: {"bias_step_dph": size}),
    "sf_modulus": known(_sf_modulus, "scale_factor_temperature", "scale_factor_quadratic"),
    "sf_stress": known(_sf_stress, "scale_factor_lag"),
    "sf_halves": known(
        _sf_halves, "scale_factor_asymmetry", truth=lambda unit, size: {"asymmetry_ppm": size}
    ),
    "duffing": known(_duffing, "scale_factor_nonlinearity"),
    "soft_limit": Effect(_soft_limit, ("saturation", "scale_factor_nonlinearity"), signed=False),
    "threshold": Effect(_threshold, ("dead_zone", "lock_in"), curved=True, sizes=(0.5, 3e4), signed=False),
    "misalignment": misalignment(LATITUDE_DEG),
    "encoder": encoder((1, 2, 4, 7, 10, 16), 0.1),
    "latency": latency(LATITUDE_DEG),
    "skew": skew(LATITUDE_DEG),
    "heading": heading(_field),
    "weight": known(
        _weight,
        "acceleration_sensitivity",
        beside=("heading_sensitivity",),
        truth=lambda unit, size: {"bias_dph_per_g_axial": size * 0.96},
    ),
    "weight_squared": known(
        _weight_squared, "acceleration_squared", truth=lambda unit, size: {"bias_dph_per_g2": size}
    ),
    "shaken": known(_shaken, "vibration_rectification"),
    "pump": known(_pump, "vibration_or_mains_line"),
    "impulses": impulses(300.0),
    "resonance": Effect(_resonance),
    "dew": Effect(_dew),
    "blind_rate": Effect(_blind_rate),
    "sf_bow": Effect(_sf_bow),
    "rate_peak": Effect(_rate_peak),
    "supply": Effect(_supply),
    "wound_cable": Effect(_wound_cable),
    "telegraph": telegraph(700.0),
    "moisture": Effect(_moisture, changing=True),
    "aged": Effect(_aged, changing=True),
    "cracked": Effect(_cracked, changing=True),
}
