"""Effects of tuning-fork gyros and their bench that the catalogue has a mechanism for."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter
from scipy.special import ndtr

from benchmarks.gap_exam._family import Effect, Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._signals import drawn, play, smooth_step, spectrum_of_lags
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._tuning_fork_bench import (
    CONDUCTANCE_W_PER_K,
    FASTEST_DPS,
    LATITUDE_DEG,
    POWER_W,
    bodies,
)
from benchmarks.gap_exam._turning import encoder, known, misalignment
from drivers.base.arrays import Array

CALIBRATED_C = 25.0
DPH_PER_DPS = 3600.0
PHASE_RAD_PER_50K = 0.02
"""Drift of the demodulator's phase: a degree over 50 K."""
CLIP_FROM_DPS = 1.04 * FASTEST_DPS
WIDEBAND_DPS = 0.4
"""Noise of the output before the converter averages it."""
FIXTURE_RESONANCE_GAIN, FIXTURE_RESONANCE_DPS = 3.0, 12.0
PLAY_K = (3.0, 9.0, 20.0, 36.0)
PLAY_WEIGHTS = (0.2, 0.3, 0.3, 0.2)
PLAY_STEP_S = 5.0
ATTACH_S, ATTACH_WEIGHTS = (420.0, 1500.0, 5400.0), (0.5, 0.3, 0.2)
SOAK_POWER = 0.8
TRIM_C = (-10.0, 10.0, 40.0, 60.0)
TRIM_WIDTH_K = 0.6
BEAT_HZ_PER_K = 5e-5
"""Two forks of 17 kHz whose coefficients differ by 0.003 ppm/K."""


def _per_50k(temperature_c: Array) -> Array:
    return np.asarray((temperature_c - CALIBRATED_C) / 50.0)


# --- bias by temperature, strain and time ---


def quadrature(unit: Unit, stage: Stage, size: float) -> Array:
    """Quadrature passes the demodulator by the sine of its phase: `size` in deg/h of phase drift per 50 K.

    Quadrature follows the fork, the phase the ASIC's filters. The factory has trimmed the slope away.
    """
    growth, bend = 0.3 + 0.5 * unit.draw["a"], unit.draw["b"] - 0.5
    asic = _per_50k(stage.body("asic"))
    phase = PHASE_RAD_PER_50K * (asic + bend * asic**2)
    leak = (1.0 + growth * _per_50k(stage.body("quartz"))) * np.sin(phase) / PHASE_RAD_PER_50K
    return np.asarray(size * (leak - asic))


def package_stress(unit: Unit, stage: Stage, size: float) -> Array:
    """Solder and lid slip at several strains: `size` in deg/h/K of a package that all slips along."""
    times = np.arange(0.0, stage.steps * stage.step_s + PLAY_STEP_S, PLAY_STEP_S)
    driver = np.interp(times, stage.time_s, stage.body("package"))
    slipped = sum(w * play(driver, r) for w, r in zip(PLAY_WEIGHTS, PLAY_K, strict=True))
    return np.asarray(size * np.interp(stage.time_s, times, slipped - CALIBRATED_C))


def die_attach(unit: Unit, stage: Stage, size: float) -> Array:
    """The adhesive under the fork's foot gives way for an hour: `size` in deg/h/K of what it still resists."""
    package = stage.body("package")
    return np.asarray(size * (package - spectrum_of_lags(package, ATTACH_S, ATTACH_WEIGHTS, stage.step_s)))


def element_lag(unit: Unit, stage: Stage, size: float) -> Array:
    """The ASIC compensates by its own temperature, the fork has another: `size` in deg/h/K of difference.

    The factory knew the difference at rest.
    """
    at_rest_k = POWER_W["asic"] / CONDUCTANCE_W_PER_K["package", "asic"]
    return np.asarray(size * (stage.body("quartz") - stage.body("asic") + at_rest_k))


def lid_gradient(unit: Unit, stage: Stage, size: float) -> Array:
    """The package bends between chamber air and fixture: `size` in deg/h/K from fixture to package."""
    steady = bodies(np.array([CALIBRATED_C]), 1.0, math.inf)
    across = stage.body("package") - stage.body("fixture")
    return np.asarray(size * (across - (steady["package"] - steady["fixture"])))


def dielectric_soak(unit: Unit, stage: Stage, size: float) -> Array:
    """The charge amplifier's capacitor soaks by a power of the time since power-up: `size` in deg/h at first."""
    since_s = stage.power_on_s + stage.time_s
    return np.asarray(size * (1.0 + since_s / (25.0 + 50.0 * unit.draw["form"])) ** -SOAK_POWER)


def trim_segment(unit: Unit, stage: Stage, size: float) -> Array:
    """Two segments of the compensation table do not meet: `size` in deg/h of step at the ASIC's temperature.

    The register's noise blurs it.
    """
    at = TRIM_C[int(unit.draw["c1"] * len(TRIM_C)) % len(TRIM_C)]
    return size * smooth_step((stage.body("asic") - at) / TRIM_WIDTH_K)


# --- scale factor ---


def drive_sag(unit: Unit, stage: Stage, size: float) -> Array:
    """Drive amplitude control has no headroom below a temperature of the fork: `size` in ppm/K of lost gain."""
    knee, width = -5.0 + 20.0 * unit.draw["a"], 4.0
    lacking_k = width * np.logaddexp(0.0, (knee - stage.body("quartz")) / width)
    return np.asarray(-size * 1e-6 * lacking_k * DPH_PER_DPS * stage.axis_dps)


def regulator(unit: Unit, stage: Stage, size: float) -> Array:
    """Output ratiometric to a regulator, converter referred to its own: `size` in ppm of band gap per (50 K)^2.

    The parabola of the band gap has its top above room temperature, on the board.
    """
    top = (10.0 + 25.0 * unit.draw["b"]) / 50.0
    gain = (_per_50k(stage.body("board")) - top) ** 2 - top**2
    return np.asarray(-size * 1e-6 * gain * DPH_PER_DPS * stage.axis_dps)


def soft_output(unit: Unit, stage: Stage, size: float) -> Array:
    """The sense amplifier bends towards its rails: `size` as a share of a stage that saturates as a tanh."""
    rail = 330.0 + 270.0 * unit.draw["c"]
    return np.asarray(size * DPH_PER_DPS * (rail * np.tanh(stage.axis_dps / rail) - stage.axis_dps))


def class_ab(unit: Unit, stage: Stage, size: float) -> Array:
    """Upper and lower half of the output stage differ in gain: `size` in ppm. Both conduct at small rates."""
    both = 3.0 + 9.0 * unit.draw["form"]
    return np.asarray(size * 1e-6 * DPH_PER_DPS * (np.hypot(stage.axis_dps, both) - both))


def clipped(above_dps: Array) -> Array:
    """Return the mean that noise of WIDEBAND_DPS about `above_dps` (m,) has above 0: what a rail cuts off."""
    z = above_dps / WIDEBAND_DPS
    return np.asarray(WIDEBAND_DPS * (np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi) + z * ndtr(z)))


def converter_clip(unit: Unit, stage: Stage, size: float) -> Array:
    """The converter's reference is low by a share `size`; the output's zero is not in its middle."""
    upper = CLIP_FROM_DPS * (1.0 - size)
    lower = upper * (1.0 - 0.01 * unit.draw["lean"])
    rate = stage.axis_dps
    return np.asarray(DPH_PER_DPS * (clipped(-rate - lower) - clipped(rate - upper)))


# --- motion ---


def bearing_vibration(unit: Unit, stage: Stage, size: float) -> Array:
    """The fork rectifies what the table's bearing shakes, more where the fixture resonates: `size` in deg/h at
    100 deg/s.
    """
    speed = np.abs(stage.rate_dps)
    off = (speed - (60.0 + 150.0 * unit.draw["phase"])) / FIXTURE_RESONANCE_DPS
    return np.asarray(size * (speed / 100.0) ** 2 * (1.0 + FIXTURE_RESONANCE_GAIN / (1.0 + off**2)))


def _imbalance(unit: Unit) -> tuple[float, float]:
    """Return how much the tines' imbalance answers along the axis and across it, upwards in a level case."""
    towards = 2.0 * math.pi * unit.draw["g1"]
    return math.cos(towards), math.sin(towards)


def tine_imbalance(unit: Unit, stage: Stage, size: float) -> Array:
    """Tines of unequal mass take gravity for Coriolis force: `size` in deg/h/g."""
    axial, cross = _imbalance(unit)
    elevation = np.radians(stage.elevation_deg)
    return np.asarray(size * (axial * np.sin(elevation) + cross * np.cos(elevation)))


def _imbalance_truth(unit: Unit, size: float) -> dict[str, float]:
    axial, cross = _imbalance(unit)
    return {"bias_dph_per_g_axial": size * axial, "bias_dph_per_g_cross": size * cross}


def low_pass(rate: Array, time_s: float, step_s: float) -> Array:
    """Return the step means of a first-order low-pass of a rate constant in each step, (m,), settled at first."""
    decay = math.exp(-step_s / time_s)
    ends = lfilter([1.0 - decay], [1.0, -decay], rate, zi=[decay * rate[0]])[0]
    return np.asarray(rate - time_s / step_s * np.diff(ends, prepend=rate[0]))


def output_filter(unit: Unit, stage: Stage, size: float) -> Array:
    """Two poles of the output's filter are too slow: `size` in s for each."""
    rate = sensed_dph(stage, LATITUDE_DEG)
    slow = low_pass(low_pass(rate, size, stage.step_s), size, stage.step_s)
    return np.asarray(slow - rate)


def neighbour_beat(unit: Unit, stage: Stage, size: float) -> Array:
    """A second unit on the fixture is driven at nearly the same frequency: their beat, `size` in deg/h."""
    start = drawn(unit.seed, "beat", stage.key).uniform()
    frequency = 0.05 + 0.2 * unit.draw["order"] + BEAT_HZ_PER_K * (stage.body("quartz") - CALIBRATED_C)
    turns = start + np.cumsum(frequency) * stage.step_s
    # the mean over a step is less than its middle
    return np.asarray(size * np.sinc(frequency * stage.step_s) * np.sin(2.0 * math.pi * turns))


EFFECTS = {
    "quadrature": known(quadrature, "bias_quadratic", "bias_cubic"),
    "package_stress": known(package_stress, "hysteresis"),
    "die_attach": known(die_attach, "relaxation", beside=("thermal_lag",)),
    "element_lag": known(element_lag, "thermal_lag", beside=("shupe", "relaxation")),
    "lid_gradient": known(lid_gradient, "gradient", beside=("shupe",)),
    "dielectric_soak": known(dielectric_soak, "warm_up"),
    "trim_segment": known(trim_segment, "mode_hop"),
    "drive_sag": known(drive_sag, "scale_factor_temperature", "scale_factor_quadratic"),
    "regulator": known(
        regulator, "scale_factor_quadratic", "scale_factor_temperature", beside=("scale_factor_lag",)
    ),
    "soft_output": known(soft_output, "scale_factor_nonlinearity"),
    "class_ab": known(class_ab, "scale_factor_asymmetry"),
    "converter_clip": Effect(converter_clip, ("saturation",), curved=True, sizes=(1e-3, 0.5), signed=False),
    "bearing_vibration": known(bearing_vibration, "vibration_rectification"),
    "tine_imbalance": known(
        tine_imbalance, "acceleration_sensitivity", beside=("heading_sensitivity",), truth=_imbalance_truth
    ),
    "mount_lean": misalignment(LATITUDE_DEG),
    "encoder_disc": encoder((1, 2), 0.3),
    "output_filter": Effect(
        output_filter,
        ("time_offset",),
        ("clock_skew",),
        lambda unit, size: {"offset_ms": -2e3 * size},
        curved=True,
        sizes=(1e-7, 0.3),
        signed=False,
    ),
    "neighbour_beat": Effect(neighbour_beat, ("vibration_or_mains_line",), changing=True),
}
