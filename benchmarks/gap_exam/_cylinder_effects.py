"""What a metal cylinder gyro does beside its data sheet: table, heat, drive, mount; signals in deg/h, (m,)."""

from __future__ import annotations

import math

import numpy as np
from scipy.special import ndtr

from benchmarks.gap_exam._cylinder_bench import BEAD_HEAT_K, FASTEST_DPS, LATITUDE_DEG
from benchmarks.gap_exam._family import Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._signals import drawn, follow, play, spectrum_of_lags
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K

ROOM_C = 25.0
ROOM_K = ROOM_C + ZERO_CELSIUS_K


def _between(unit: Unit, name: str, low: float, high: float) -> float:
    return low + (high - low) * unit.draw[name]


def _log_between(unit: Unit, name: str, low: float, high: float) -> float:
    return float(low * (high / low) ** unit.draw[name])


def _phase(unit: Unit, name: str) -> float:
    return 2.0 * math.pi * unit.draw[name]


def _sensed(stage: Stage) -> Array:
    return sensed_dph(stage, LATITUDE_DEG)


# the maker's table --------------------------------------------------------------------------------------------

FACTORY_C = (-40.0, 20.0, 80.0)


def loss_peak(t_c: Array, height: float, centre_k: float, activation_k: float) -> Array:
    """Return a relaxation peak of damping over temperature: sech of the distance in reciprocal kelvin.

    Nowick and Berry, Anelastic Relaxation in Crystalline Solids (1972), ch. 3: an activated Debye peak.
    """
    return np.asarray(height / np.cosh(activation_k * (1.0 / (t_c + ZERO_CELSIUS_K) - 1.0 / centre_k)))


def between_factory_points(unit: Unit, stage: Stage, size: float) -> Array:
    """Bias follows a damping peak of height `size`; the table has straight lines between three points."""
    centre, activation = _between(unit, "a", 260.0, 325.0), _between(unit, "form", 3200.0, 5500.0)
    points = np.array(FACTORY_C)
    table = np.interp(stage.t_in_c, points, loss_peak(points, size, centre, activation))
    return np.asarray(loss_peak(stage.t_in_c, size, centre, activation) - table)


def piezo_gain(unit: Unit, stage: Stage, size: float) -> Array:
    """Piezo activity grows towards the Curie point as a power of the distance: `size` in ppm/K at 25 degC."""
    curie_c, exponent = _between(unit, "b", 140.0, 220.0), _between(unit, "form", 0.35, 0.9)
    distance = (curie_c - ROOM_C) / (curie_c - stage.body("metal"))
    per_k = exponent / (curie_c - ROOM_C)
    return np.asarray(1e-6 * size * _sensed(stage) * (distance**exponent - 1.0) / per_k)


def late_gain(unit: Unit, stage: Stage, size: float) -> Array:
    """The table corrects scale factor by the bead, the metal sets it: `size` in ppm/K of their difference."""
    return np.asarray(1e-6 * size * _sensed(stage) * (stage.body("metal") + BEAD_HEAT_K - stage.t_in_c))


def metal_behind_bead(unit: Unit, stage: Stage, size: float) -> Array:
    """Bias grows with the metal's temperature by an exponential law, the table corrects it by the bead's."""
    scale_k = _between(unit, "b", 35.0, 80.0)
    metal, taken_for = stage.body("metal") - ROOM_C, stage.t_in_c - BEAD_HEAT_K - ROOM_C
    return np.asarray(size * scale_k * (np.exp(metal / scale_k) - np.exp(taken_for / scale_k)))


def coarse_table(unit: Unit, stage: Stage, size: float) -> Array:
    """Foreign: the table's values hold for whole cells of temperature; `size` from end to end of a cell."""
    cell_k, begin_c = _between(unit, "c", 6.0, 12.0), _between(unit, "g1", -6.0, 6.0)
    cells = (stage.t_in_c - begin_c) / cell_k
    return np.asarray(size * (cells - np.round(cells)))


# heat ---------------------------------------------------------------------------------------------------------


def repoling(unit: Unit, stage: Stage, size: float) -> Array:
    """Electrodes regain their polarisation under voltage by a power of the time since power came on."""
    time_s, exponent = _log_between(unit, "a", 120.0, 420.0), _between(unit, "form", 0.7, 1.5)
    return np.asarray(size * (1.0 + (stage.power_on_s + stage.time_s) / time_s) ** -exponent)


def warped_base(unit: Unit, stage: Stage, size: float) -> Array:
    """The base, as warm as board and housing, warps on a plate of unlike temperature: `size` in deg/h/K."""
    return np.asarray(size * (0.5 * (stage.body("board") + stage.body("housing")) - stage.body("plate")))


def pyroelectric_charge(unit: Unit, stage: Stage, size: float) -> Array:
    """Warming electrodes make a charge that leaks away: `size` in deg/h per K/min held."""
    leak_s = _log_between(unit, "c", 20.0, 90.0)
    metal = stage.body("metal")
    return np.asarray(size * 60.0 * (metal - follow(metal, leak_s, stage.step_s)) / leak_s)


def creeping_glue(unit: Unit, stage: Stage, size: float) -> Array:
    """The glue's stress by thermal mismatch relaxes, faster in heat (Arrhenius): `size` in deg/h/K."""
    return size * relaxed_strain(
        stage.body("housing"),
        stage.step_s,
        60.0 * _log_between(unit, "a", 15.0, 40.0),
        _between(unit, "b", 1000.0, 2500.0),
    )


def relaxed_strain(t_c: Array, step_s: float, time_s: float, activation_k: float) -> Array:
    """Return the strain, K, that is left of temperature changes, none at first: x' = T' - x / time(T).

    `time_s`: the time constant at 25 degC. Exact for a temperature of straight pieces with the time constant
    of their middles.
    """
    middle = 0.5 * (t_c[1:] + t_c[:-1]) + ZERO_CELSIUS_K
    passed = step_s / time_s * np.exp(activation_k * (1.0 / ROOM_K - 1.0 / middle))
    age = np.concatenate(([0.0], np.cumsum(passed)))
    grown = np.diff(t_c) * -np.expm1(-passed) / passed * np.exp(age[1:])
    return np.concatenate(([0.0], np.cumsum(grown))) * np.exp(-age)


PLAYS_K = (2.0, 5.0, 10.0, 18.0)
_EACH = 32


def magnetic_damping(unit: Unit, stage: Stage, size: float) -> Array:
    """Walls of magnetic domains stick: plays of several widths over the metal's temperature."""
    lean = _between(unit, "form", -0.6, 0.6)
    weights = np.array(PLAYS_K) ** lean
    coarse = stage.body("metal")[::_EACH]
    left = sum(w * (play(coarse, half) - coarse) / half for w, half in zip(weights, PLAYS_K, strict=True))
    at = stage.time_s[::_EACH]
    return np.asarray(size * np.interp(stage.time_s, at, left / weights.sum()))


def range_switch(unit: Unit, stage: Stage, size: float) -> Array:
    """Where damping grows with heat, the drive's amplifier changes its range, and back some kelvin lower."""
    return size * switched(
        stage.body("metal"), _between(unit, "tilt", 0.0, 45.0), _between(unit, "c", 0.5, 3.0)
    )


def switched(values: Array, threshold: float, width: float) -> Array:
    """Return 0 or 1: a switch that closes above a threshold's upper edge and opens below its lower one."""
    state = np.where(
        values > threshold + 0.5 * width, 1.0, np.where(values < threshold - 0.5 * width, 0.0, -1.0)
    )
    state[0] = float(values[0] > threshold)
    last = np.maximum.accumulate(np.where(state >= 0.0, np.arange(len(state)), 0))
    return np.asarray(state[last])


def mode_crossing(unit: Unit, stage: Stage, size: float) -> Array:
    """Foreign: where a mode of the case has the cylinder's frequency, they repel: dispersion over temperature."""
    centre_c, width_k = _between(unit, "order", -5.0, 45.0), _between(unit, "c", 2.0, 5.0)
    x = (stage.body("metal") - centre_c) / width_k
    return np.asarray(size * 2.0 * x / (1.0 + x * x))


def motor_heat(unit: Unit, stage: Stage, size: float) -> Array:
    """Foreign: the table's motor warms by friction, its cover late, and radiates at one side of the case.

    `size`: deg/h at 100 deg/s held.
    """
    heat = np.abs(stage.rate_dps) / 100.0
    winding = follow(heat, 90.0, stage.step_s)
    return size * follow(winding, _log_between(unit, "g1", 200.0, 600.0), stage.step_s)


# drive --------------------------------------------------------------------------------------------------------

STRONGEST_DPS = 1.05 * FASTEST_DPS


def drive_limit(unit: Unit, stage: Stage, size: float) -> Array:
    """The rebalance voltage ends: the greatest rate falls by `size` of itself, and 0.1 % with each kelvin."""
    limit = 3600.0 * STRONGEST_DPS * (1.0 - size) * (1.0 - 1e-3 * (stage.body("metal") - ROOM_C))
    rate = _sensed(stage)
    return np.asarray(np.clip(rate, -limit, limit) - rate)


def dead_band(unit: Unit, stage: Stage, size: float) -> Array:
    """The loop acts beyond a threshold only; its own noise, a share of that, is a dither."""
    return -_sensed(stage) * ignored(_sensed(stage), size, _between(unit, "form", 0.1, 0.5))


def ignored(rate: Array, threshold: float, dither: float) -> Array:
    """Return the share of time that a rate with Gaussian dither, a share of the threshold, is within it."""
    x = rate / threshold
    return np.asarray(ndtr((1.0 - x) / dither) - ndtr((-1.0 - x) / dither))


def rayleigh_drive(unit: Unit, stage: Stage, size: float) -> Array:
    """Piezo activity grows with the size of the voltage (Rayleigh's law) until it is full: `size` in ppm.

    Damjanovic, Rep. Prog. Phys. 61 (1998) 1267, sec. 5.
    """
    full_dph = 3600.0 * _log_between(unit, "b", 60.0, 400.0)
    rate = _sensed(stage)
    return np.asarray(1e-6 * size * rate * np.abs(rate) / (full_dph + np.abs(rate)))


def push_and_pull(unit: Unit, stage: Stage, size: float) -> Array:
    """Two halves of an amplifier differ by `size` ppm of gain and hand over smoothly around rest."""
    over_dph = 3600.0 * _log_between(unit, "a", 0.3, 6.0)
    return np.asarray(0.5e-6 * size * (np.hypot(_sensed(stage), over_dph) - over_dph))


def supply_ripple(unit: Unit, stage: Stage, size: float) -> Array:
    """A converter's ripple beats with the samples: one line, its phase another in every run."""
    line_hz = _log_between(unit, "b", 0.02, 0.4)
    phase = drawn(unit.seed, "ripple", stage.key).uniform(0.0, 2.0 * math.pi)
    return np.asarray(size * np.sin(2.0 * math.pi * line_hz * stage.time_s + phase))


SOAKS_S = (15.0, 60.0, 240.0, 960.0)


def soaked_electrodes(unit: Unit, stage: Stage, size: float) -> Array:
    """Foreign: the rebalance voltage soaks into the electrodes and comes out late (Curie and von Schweidler).

    `size`: deg/h behind 100 deg/s held for long. Shares fall as a power of the lag.
    """
    exponent = _between(unit, "g1", 0.1, 0.6)
    shares = [lag_s**-exponent for lag_s in SOAKS_S]
    return size * spectrum_of_lags(stage.axis_dps / 100.0, SOAKS_S, shares, stage.step_s)


# mount, field, node -------------------------------------------------------------------------------------------


def sag(unit: Unit, stage: Stage, size: float) -> Array:
    """The cylinder hangs down on its stem, which softens with heat: `size` in deg/h/g."""
    softer = 1.0 + _between(unit, "b", 2e-4, 8e-4) * (stage.body("metal") - ROOM_C)
    return np.asarray(size * np.sin(np.radians(stage.elevation_deg)) * softer)


DIP_RAD = math.radians(66.0)


def magnetised(turn_rad: Array, elevation_rad: Array, unit: Unit) -> Array:
    """Return what Earth's field along the axis does to the alloy, in shares of the whole field; it saturates."""
    level = math.cos(DIP_RAD) * np.cos(elevation_rad) * np.cos(turn_rad + _phase(unit, "phase"))
    along = level + math.sin(DIP_RAD) * np.sin(elevation_rad)
    harder = _between(unit, "form", 0.4, 1.6)
    return np.asarray(np.tanh(harder * along) / harder)


def wandering_node(unit: Unit, stage: Stage, size: float) -> Array:
    """Foreign: the wave is held a share of the turn behind the case, and damping differs around the rim.

    Where the node is at a run's begin is chance; it moves on by 0.36 to 0.44 of the angle sensed.
    """
    gain = _between(unit, "a", 0.36, 0.44)
    begin = drawn(unit.seed, "node", stage.key).uniform(0.0, 2.0 * math.pi)
    turned = np.radians(np.cumsum(_sensed(stage)) * stage.step_s / 3600.0)
    return np.asarray(size * np.sin(begin - 2.0 * gain * turned))


def knocks(unit: Unit, stage: Stage, size: float) -> Array:
    """Foreign: a knock and every change of the mount shift the bias, which creeps back by a logarithm of time."""
    rng = drawn(unit.seed, "knocks", stage.key)
    begin_s, share = _log_between(unit, "b", 5.0, 60.0), _between(unit, "c2", 0.05, 0.14)
    total = np.zeros(stage.steps)
    for name, at_s in stage.phases:
        if name.startswith(("knock", "mounted ")):
            since = np.maximum(stage.time_s - at_s, 0.0)
            left = (stage.time_s > at_s) * (1.0 - share * np.log1p(since / begin_s))
            total += rng.choice((-1.0, 1.0)) * rng.uniform(0.5, 1.5) * left
    return size * total
