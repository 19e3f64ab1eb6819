"""What laser gyros and their bench suffer from, by physics of the instrument; forms are drawn with the unit.

Sources: Aronowitz, The Laser Gyro (1971), on lock-in, backscatter, Langmuir flow; Chow et al., Rev. Mod.
Phys. 57 (1985); Bouc (1967) and Wen (1976) on hysteresis; IEEE Std 647 on the terms of the model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.signal import lfilter

from benchmarks.gap_exam._family import Effect, Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._signals import drawn, follow, markov, slope_per_min, smooth_step, spectrum_of_lags
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._turning import (
    azimuth,
    encoder,
    heading,
    impulses,
    known,
    latency,
    misalignment,
    skew,
    telegraph,
    tilt,
)
from drivers.base.arrays import Array

LATITUDE_DEG = 52.4
_ROOM_C = 23.0


def _sensed(stage: Stage) -> Array:
    return sensed_dph(stage, LATITUDE_DEG)


def _bias_curve(unit: Unit, stage: Stage, size: float) -> Array:
    """Mirror losses over temperature: a parabola, a one-sided exponential, a bathtub or an S."""
    x = (stage.body("block") - _ROOM_C) / 55.0
    a = unit.draw["a"]
    forms = (
        x**2 + 0.3 * (2.0 * a - 1.0) * x**3,
        np.exp(1.5 * x) - 1.0 - 1.5 * x,
        np.abs(x) ** 2.6,
        np.sinh(2.0 * x) - 2.0 * x,
    )
    return np.asarray(size * forms[int(4.0 * unit.draw["form"]) % 4])


def _warming(unit: Unit, stage: Stage, size: float) -> Array:
    """The path bends while the block warms: heat arrives over two stages."""
    late = follow(stage.body("block"), 30.0 + 250.0 * unit.draw["a"], stage.step_s)
    return np.asarray(size * slope_per_min(follow(late, 40.0, stage.step_s), stage.step_s))


def _warming_in_heat(unit: Unit, stage: Stage, size: float) -> Array:
    """Glass ceramic expands by a coefficient that changes sign near room temperature."""
    block = stage.body("block")
    coefficient = np.tanh((block - 20.0) / (40.0 + 60.0 * unit.draw["a"]))
    return np.asarray(size * coefficient * slope_per_min(follow(block, 60.0, stage.step_s), stage.step_s))


def _stiffened(unit: Unit, stage: Stage, size: float) -> Array:
    """The adhesive of the mirrors turns to glass in the cold and strains them as it is cooled."""
    block = stage.body("block")
    glass = -22.0 + 20.0 * unit.draw["a"]
    hard = 0.5 * (1.0 - np.tanh((block - glass) / (4.0 + 6.0 * unit.draw["b"])))
    return np.asarray(size * hard * slope_per_min(follow(block, 40.0, stage.step_s), stage.step_s))


def _gradient(unit: Unit, stage: Stage, size: float) -> Array:
    """The block bows between its warm and its cold side."""
    across = follow(stage.body("block") - stage.body("case"), 20.0 + 100.0 * unit.draw["a"], stage.step_s)
    return np.asarray(size * (across + 0.01 * across * np.abs(across)))


def _lag(unit: Unit, stage: Stage, size: float) -> Array:
    block, scale = stage.body("block"), 90.0 + 350.0 * unit.draw["a"]
    spread = spectrum_of_lags(block, (0.5 * scale, scale, 2.0 * scale), (0.3, 0.5, 0.2), stage.step_s)
    return np.asarray(size * (spread - block))


def _relaxation(unit: Unit, stage: Stage, size: float) -> Array:
    """A stretched exponential after every change of temperature, as a sum of followers."""
    block, middle, width = stage.body("block"), 2400.0 * 1.6 ** (2.0 * unit.draw["a"] - 1.0), 0.5
    times = middle * np.exp(np.linspace(-1.5, 1.5, 7))
    weights = np.exp(-0.5 * (np.log(times / middle) / width) ** 2)
    return np.asarray(
        size * (block - spectrum_of_lags(block, times.tolist(), weights.tolist(), stage.step_s))
    )


def _bouc_wen(unit: Unit, stage: Stage, size: float) -> Array:
    """dz = dT - (b sign(dT z) + c) |z|^p dT / z0^p: a loop whose shape is drawn."""
    every = max(1, round(4.0 / stage.step_s))
    block = stage.body("block")[::every]
    z0, p, b = 4.0 + 16.0 * unit.draw["a"], 1.0 + 1.5 * unit.draw["b"], 0.35 + 0.6 * unit.draw["c"]
    out, z = np.empty(len(block)), 0.0
    for k, change in enumerate(np.diff(block, prepend=block[0]).tolist()):
        out[k] = z
        held = b * math.copysign(1.0, change * z) + (1.0 - b)
        z += change * (1.0 - held * (abs(z) / z0) ** p)
    return np.asarray(size * np.interp(np.arange(stage.steps), np.arange(len(out)) * every, out))


def _warm_up(unit: Unit, stage: Stage, size: float) -> Array:
    """The discharge settles in minutes, its housing in half an hour."""
    on = stage.time_s + stage.power_on_s
    quick, slow = 200.0 + 200.0 * unit.draw["a"], 900.0 + 1200.0 * unit.draw["b"]
    return np.asarray(size * (0.5 * np.exp(-on / quick) + 0.5 * np.exp(-on / slow)))


def _mode_hop(unit: Unit, stage: Stage, size: float) -> Array:
    """The cavity takes the next longitudinal mode, later when cooling than when warming."""
    at = -18.0 + 55.0 * unit.draw["a"]
    late = follow(stage.body("block"), 25.0, stage.step_s)
    return np.asarray(size * smooth_step((late - at) / (0.3 + 0.9 * unit.draw["b"])))


def _sf_temperature(unit: Unit, stage: Stage, size: float) -> Array:
    """The gain of the medium falls with the temperature of its electronics and block."""
    warm = 0.7 * stage.body("block") + 0.3 * stage.body("case") - _ROOM_C
    return np.asarray(1e-6 * size * _sensed(stage) * (warm + 0.004 * unit.draw["a"] * warm**2))


def _sf_lag(unit: Unit, stage: Stage, size: float) -> Array:
    block, scale = stage.body("block"), 500.0 + 2000.0 * unit.draw["a"]
    spread = spectrum_of_lags(block, (0.5 * scale, 1.5 * scale), (0.5, 0.5), stage.step_s)
    return np.asarray(1e-6 * size * _sensed(stage) * (block - spread))


def _sf_asymmetry(unit: Unit, stage: Stage, size: float) -> Array:
    """Both beams have gains of their own; near standstill the two mix."""
    rate = _sensed(stage)
    return np.asarray(1e-6 * size * 0.5 * np.abs(rate) * np.tanh(np.abs(rate) / 30.0))


def _sf_curve(unit: Unit, stage: Stage, size: float) -> Array:
    """Mode pulling: the factor changes with rate, more slowly than its square."""
    speed = np.abs(stage.axis_dps) / 100.0
    power = 1.3 + 0.9 * unit.draw["a"]
    return np.asarray(1e-6 * size * 3600.0 * stage.axis_dps * speed**power / (1.0 + 0.4 * speed**power))


def _saturation(unit: Unit, stage: Stage, size: float) -> Array:
    """The counter misses pulses above a rate: the part `size` of what exceeds it."""
    limit = 62.0 + 25.0 * unit.draw["a"]
    excess = np.maximum(np.abs(stage.axis_dps) - limit, 0.0)
    return np.asarray(-size * 3600.0 * np.sign(stage.axis_dps) * excess)


def _lock_in(unit: Unit, stage: Stage, size: float) -> Array:
    """Backscatter locks the beams below `size` deg/h; the dither left over blurs the band.

    The beat is the mean over the dither's phase of the root of rate^2 - lock^2 (Aronowitz 1971).
    """
    dither = size * (0.15 + 1.1 * unit.draw["a"])
    phase = np.sin(2.0 * np.pi * (np.arange(96) + 0.5) / 96.0)
    grid = np.concatenate((np.linspace(0.0, 4.0, 161), np.geomspace(4.05, 4e6, 240))) * size
    moved = grid[:, None] + dither * phase
    beat = np.sign(moved) * np.sqrt(np.maximum(moved**2 - size**2, 0.0))
    lost = (moved - beat).mean(axis=1)
    rate = _sensed(stage)
    return np.asarray(-np.sign(rate) * np.interp(np.abs(rate), grid, lost))


def _field(turn: Array, elevation: Array, unit: Unit) -> Array:
    """Faraday rotation in the Earth's field: level 0.19, down 0.45, declined to the east."""
    declined = math.radians(-3.0 - 4.0 * unit.draw["b"])
    along = 0.19 * np.cos(elevation) * np.cos(turn - declined) - 0.45 * np.sin(elevation)
    across = 0.19 * np.abs(np.sin(elevation)) * np.cos(turn - declined)
    return np.asarray(along + 0.08 * across)


def _mass(unit: Unit, stage: Stage, size: float) -> Array:
    """The mirrors' mounts give way along gravity, a little across it."""
    elevation = np.radians(stage.elevation_deg)
    return np.asarray(size * (np.sin(elevation) + 0.4 * (2.0 * unit.draw["a"] - 1.0) * np.cos(elevation)))


def _mass_squared(unit: Unit, stage: Stage, size: float) -> Array:
    return np.asarray(size * np.sin(np.radians(stage.elevation_deg)) ** 2)


def _bearing(unit: Unit, stage: Stage, size: float) -> Array:
    """The bearing shakes the dither's suspension, by a power of speed near two."""
    return np.asarray(size * (np.abs(stage.rate_dps) / 100.0) ** (1.6 + 0.9 * unit.draw["a"]))


def _hum(unit: Unit, stage: Stage, size: float) -> Array:
    """A line that samples of a second show at 0.07 to 0.42 Hz, its frequency steady to 1e-6."""
    frequency = 0.07 + 0.35 * unit.draw["a"]
    phase = drawn(unit.seed, "hum", stage.key).uniform(0.0, 2.0 * math.pi)
    return np.asarray(size * np.sin(2.0 * math.pi * frequency * stage.time_s + phase))


def _fringes(unit: Unit, stage: Stage, size: float) -> Array:
    """Light scattered back interferes: bias waves with the block's temperature."""
    period = 9.0 + 12.0 * unit.draw["a"]
    return np.asarray(size * np.sin(2.0 * math.pi * (stage.body("block") / period + unit.draw["b"])))


def _saw(unit: Unit, stage: Stage, size: float) -> Array:
    """The path-length control runs to its end and is reset: a saw tooth over temperature."""
    turns = stage.body("block") / (16.0 + 14.0 * unit.draw["a"]) + unit.draw["b"]
    return np.asarray(size * follow(turns - np.floor(turns) - 0.5, 20.0, stage.step_s))


def _fan(unit: Unit, stage: Stage, size: float) -> Array:
    """The chamber's fan runs fast during ramps and 10 to 20 minutes after: its vibration shifts the bias."""
    air = follow(stage.body("air"), 60.0, stage.step_s)
    ramping = np.abs(slope_per_min(air, stage.step_s)) > 1.8
    after = round((600.0 + 600.0 * unit.draw["a"]) / stage.step_s)
    last = np.maximum.accumulate(np.where(ramping, np.arange(stage.steps), -after - 1))
    on = (np.arange(stage.steps) - last <= after).astype(np.float64)
    return np.asarray(size * follow(on, 8.0, stage.step_s))


def _turning_heat(unit: Unit, stage: Stage, size: float) -> Array:
    """Turning dissipates heat in the slip rings, which reaches the block minutes later."""
    return np.asarray(
        size * follow((stage.rate_dps / 50.0) ** 2, 150.0 + 250.0 * unit.draw["a"], stage.step_s)
    )


def _suspension(unit: Unit, stage: Stage, size: float) -> Array:
    """The dither's suspension rings on after every change of rate."""
    frequency, damping = 0.06 + 0.1 * unit.draw["a"], 0.02 + 0.02 * unit.draw["b"]
    w = 2.0 * math.pi * frequency * stage.step_s
    pole = math.exp(-damping * w)
    kick = np.gradient(stage.axis_dps, stage.step_s)
    middle = 2.0 * pole * math.cos(w)
    return np.asarray(size * lfilter([1.0 - middle + pole * pole], [1.0, -middle, pole * pole], kick))


def _third(unit: Unit, stage: Stage, size: float) -> Array:
    """A bias that repeats three times a turn of the table: cables, three feet."""
    order, turn = 3, np.radians(0.5 * (stage.angle_deg[1:] + stage.angle_deg[:-1]))
    blur = np.sinc(order * np.diff(stage.angle_deg) / 360.0)
    return np.asarray(size * blur * np.cos(order * turn + 2.0 * math.pi * unit.draw["a"]))


def _backlash(unit: Unit, stage: Stage, size: float) -> Array:
    """The gear between encoder and table has play: after a reversal the table follows `size` arcsec late."""
    every = max(1, round(0.5 / stage.step_s))
    angle = stage.angle_deg[::every]
    half = 1.0 / 7200.0
    out, held = np.empty(len(angle)), float(angle[0])
    for k, value in enumerate(angle.tolist()):
        held = min(max(held, value - half), value + half)
        out[k] = held - value
    # a gear that takes up its play does so in half a second: spread over the steps
    behind = np.interp(np.arange(stage.steps + 1), np.arange(len(out)) * every, out)
    return np.asarray(
        3600.0 * size * np.diff(behind) / stage.step_s * np.sin(np.radians(stage.elevation_deg))
    )


def _weather(unit: Unit, stage: Stage, size: float) -> Array:
    """Air pressure of the day, over hours: another curve in every run."""
    rng = drawn(unit.seed, "weather", stage.key)
    slow = markov(1.0, 2500.0, np.full(stage.seconds // 10 + 2, 10.0), rng)
    smooth = follow(slow, 600.0, 10.0)
    return np.asarray(size * np.interp(stage.time_s, np.arange(len(smooth)) * 10.0, smooth))


def _ageing(unit: Unit, stage: Stage, size: float) -> Array:
    """The mirrors' mounts age: what the bias does over temperature grows from repeat to repeat."""
    grown = (stage.number / 9.0) ** 0.7 - 1.0
    x = (follow(stage.body("block"), 300.0, stage.step_s) - _ROOM_C) / 50.0
    return np.asarray(size * grown * (x**2 + 0.6 * x - 0.5 * x**3))


def _after_cycles(unit: Unit, stage: Stage, size: float) -> Array:
    """After some run a joint has come loose: from then on the bias follows the gradient and bends."""
    loose = stage.number >= 9 + int(3.0 * unit.draw["a"])
    across = stage.body("block") - stage.body("case")
    bend = ((stage.body("block") - _ROOM_C) / 40.0) ** 2
    return np.asarray(size * float(loose) * (across / 10.0 + bend))


EFFECTS: Mapping[str, Effect] = {
    "bias_curve": known(_bias_curve, "bias_quadratic", "bias_cubic"),
    "warming": known(_warming, "shupe"),
    "warming_in_heat": known(_warming_in_heat, "shupe_cross"),
    "stiffened": known(_stiffened, "cold_stress"),
    "gradient": known(_gradient, "gradient"),
    "lag": known(_lag, "thermal_lag", "relaxation"),
    "relaxation": known(_relaxation, "relaxation", "thermal_lag"),
    "bouc_wen": known(_bouc_wen, "hysteresis"),
    "warm_up": known(_warm_up, "warm_up"),
    "mode_hop": known(_mode_hop, "mode_hop", truth=lambda unit, size: {"bias_step_dph": size}),
    "sf_temperature": known(_sf_temperature, "scale_factor_temperature", "scale_factor_quadratic"),
    "sf_lag": known(_sf_lag, "scale_factor_lag"),
    "sf_asymmetry": known(
        _sf_asymmetry, "scale_factor_asymmetry", truth=lambda unit, size: {"asymmetry_ppm": size}
    ),
    "sf_curve": known(_sf_curve, "scale_factor_nonlinearity"),
    "saturation": Effect(_saturation, ("saturation", "scale_factor_nonlinearity"), signed=False),
    "lock_in": Effect(_lock_in, ("dead_zone", "lock_in"), curved=True, sizes=(0.02, 12.0), signed=False),
    "misalignment": misalignment(LATITUDE_DEG),
    "azimuth": azimuth(LATITUDE_DEG),
    "tilt": tilt(LATITUDE_DEG),
    "encoder": encoder((1, 2, 3, 5, 6, 9, 18), 0.25),
    "latency": latency(LATITUDE_DEG),
    "skew": skew(LATITUDE_DEG),
    "heading": heading(_field),
    "mass": known(
        _mass,
        "acceleration_sensitivity",
        beside=("heading_sensitivity",),
        truth=lambda unit, size: {"bias_dph_per_g_axial": size},
    ),
    "mass_squared": known(
        _mass_squared, "acceleration_squared", truth=lambda unit, size: {"bias_dph_per_g2": size}
    ),
    "bearing": known(_bearing, "vibration_rectification"),
    "hum": known(_hum, "vibration_or_mains_line"),
    "impulses": impulses(500.0),
    "fringes": Effect(_fringes),
    "saw": Effect(_saw),
    "fan": Effect(_fan),
    "turning_heat": Effect(_turning_heat),
    "suspension": Effect(_suspension),
    "third": Effect(_third),
    "backlash": Effect(_backlash),
    "telegraph": telegraph(900.0),
    "weather": Effect(_weather, changing=True),
    "ageing": Effect(_ageing, changing=True),
    "after_cycles": Effect(_after_cycles, changing=True),
}
