"""Effects of tuning-fork gyros and their bench that the catalogue has no name for."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from benchmarks.gap_exam._family import Effect, Unit
from benchmarks.gap_exam._signals import drawn, follow, spectrum_of_lags
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._tuning_fork_bench import compressor_phase_s, compressor_runs
from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K

LAB_C = 22.0
UPTAKE_S = 9000.0
"""Time constant of the moulding's water at 25 degC."""
UPTAKE_EV, BOLTZMANN_EV_PER_K = 0.5, 8.617333e-5
LATCH_K = 1.0
SURGE = 0.8
TAIL_S, TAIL_WEIGHTS = (20.0, 150.0), (0.6, 0.4)


def saturation_hpa(air_c: Array | float) -> Array:
    """Return the saturation pressure of water vapour (Magnus, WMO-No. 8), hPa."""
    air = np.asarray(air_c, float)
    return np.asarray(6.112 * np.exp(17.62 * air / (243.12 + air)))


def uptake_s(package_c: Array) -> Array:
    """Return the time constant of water in the moulding, s, (m,): activated diffusion."""
    inverse = 1.0 / (package_c + ZERO_CELSIUS_K) - 1.0 / (25.0 + ZERO_CELSIUS_K)
    return np.asarray(UPTAKE_S * np.exp(UPTAKE_EV / BOLTZMANN_EV_PER_K * inverse))


def humid_package(unit: Unit, stage: Stage, size: float) -> Array:
    """The moulding swells with the humidity of its air: `size` in deg/h from dry to saturated.

    The chamber has the dew point of the day, and no more than saturated air when it is cold. Units wait in the
    lab.
    """
    dew_c = 4.0 + 10.0 * unit.draw["c2"]
    ends = np.minimum(saturation_hpa(dew_c) / saturation_hpa(stage.body("air")), 1.0)
    start = float(saturation_hpa(dew_c) / saturation_hpa(LAB_C))
    grown = np.cumsum(stage.step_s / uptake_s(stage.body("package")))
    # water in proportion to its own time: a follower in that, at even steps of it
    even = np.linspace(0.0, grown[-1], 4 * stage.steps + 1)
    decay = math.exp(-even[1])
    target = np.interp(even[1:], grown, ends)
    water = lfilter([1.0 - decay], [1.0, -decay], target, zi=[decay * start])[0]
    return np.asarray(size * (np.interp(grown, even[1:], water) - start))


def mode_crossing(unit: Unit, stage: Stage, size: float) -> Array:
    """A spurious mode of the fork crosses the drive's frequency at a temperature: `size` in deg/h.

    In its resonance it answers in phase and out of phase; the demodulator takes some of both.
    """
    at, width = -20.0 + 85.0 * unit.draw["c2"], 1.5 + 2.5 * unit.draw["a"]
    off, mixed = (stage.body("quartz") - at) / width, math.pi * unit.draw["phase"]
    return np.asarray(size * (off * math.cos(mixed) + math.sin(mixed)) / (1.0 + off**2))


def latched_trim(unit: Unit, stage: Stage, size: float) -> Array:
    """Each time the ASIC passes a temperature it latches one of two trim words at random: `size` in deg/h."""
    at = 15.0 + 25.0 * unit.draw["tilt"]
    asic = stage.body("asic")
    beyond = np.where(asic > at + LATCH_K, 1, np.where(asic < at - LATCH_K, -1, 0))
    last = np.maximum.accumulate(np.where(beyond != 0, np.arange(len(asic)), 0))
    passed = np.cumsum(np.diff(beyond[last], prepend=beyond[0]) != 0)
    words = drawn(unit.seed, "latch", stage.key).choice((-0.5, 0.5), int(passed[-1]) + 1)
    return np.asarray(size * words[passed])


def compressor_supply(unit: Unit, stage: Stage, size: float) -> Array:
    """The supply sags while the chamber's compressor runs, more at its start: `size` in deg/h while it runs."""
    runs = compressor_runs(stage.body("demand"), stage.step_s, compressor_phase_s(unit, stage.key))
    sagging = follow(runs, 3.0, stage.step_s)
    return np.asarray(size * (sagging + SURGE * (sagging - follow(sagging, 20.0, stage.step_s))))


def charge_tail(unit: Unit, stage: Stage, size: float) -> Array:
    """The sense capacitor gives back charge of past rates for minutes: `size` as a share of the rate."""
    past = spectrum_of_lags(stage.axis_dps, TAIL_S, TAIL_WEIGHTS, stage.step_s)
    return np.asarray(3600.0 * size * past)


FOREIGN = {
    "humid_package": Effect(humid_package),
    "mode_crossing": Effect(mode_crossing),
    "latched_trim": Effect(latched_trim, changing=True),
    "compressor_supply": Effect(compressor_supply, changing=True),
    "charge_tail": Effect(charge_tail),
}
