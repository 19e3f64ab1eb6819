"""What a depolarised fibre gyro does beside its model, each effect from its own physics.

Sizes are in deg/h where nothing else is said.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import j1

from benchmarks.gap_exam._depolarised_bench import LATITUDE_DEG, LAYERS, SET_C
from benchmarks.gap_exam._family import Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._signals import drawn, follow, play, slope_per_min, smooth_step, spectrum_of_lags
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K, earth_rate_up_dph

_FASTEST_DPS = 100.0
"""The campaign's fastest rate."""
_VARSHNI_K = 162.0
_TURNS = (1.0, -1.0, -1.0, 1.0)
"""The sense in which each layer of a quadrupole winding is wound, outside first."""
_LONGER = (1.06, 1.02, 0.98, 0.94)
"""Lengths of the layers: outer turns are longer."""


def rate_dps(stage: Stage) -> Array:
    """Return the rate along the axis with the Earth's, deg/s, (m,)."""
    return sensed_dph(stage, LATITUDE_DEG) / 3600.0


def sagnac_rad(unit: Unit, rate: Array) -> Array:
    """Return the Sagnac phase of a rate in deg/s: 0.8 to 1 rad at the fastest."""
    return np.asarray((0.8 + 0.2 * unit.draw["form"]) * rate / _FASTEST_DPS)


# coil and potting ---------------------------------------------------------------------------------------------


def winding(unit: Unit) -> Array:
    """Return the weights (4,) of the layers in the Shupe bias, outside first; their sum is 1.

    Turns that are missing in one of the middle layers leave the quadrupole unbalanced, by their share.
    """
    weights = np.array(_TURNS) * np.array(_LONGER)
    missing = 0.5 + 0.5 * unit.draw["c"]
    weights[1 + int(2.0 * unit.draw["order"]) % 2] += missing
    return np.asarray(weights / weights.sum())


def shupe(unit: Unit, stage: Stage, size: float) -> Array:
    """Shupe bias of a quadrupole winding with unequal layers: `size` deg/h for 1 K/min of all layers."""
    changes = [slope_per_min(stage.body(name), stage.step_s) for name in LAYERS]
    return np.asarray(size * (winding(unit) @ np.stack(changes)))


def glass(unit: Unit, temperature_c: Array) -> Array:
    """Return the potting's modulus, 1 in the glass, a hundredth in the rubber, on a logarithmic scale."""
    middle_c, width_k = -4.0 + 16.0 * unit.draw["g1"], 2.0 + 3.0 * unit.draw["b"]
    return np.asarray(100.0 ** (smooth_step((middle_c - temperature_c) / width_k) - 1.0))


def glassy_shupe(unit: Unit, stage: Stage, size: float) -> Array:
    """Potting presses on the fibre as its temperature changes, by its modulus: stiff in the glass only."""
    middle = 0.5 * (stage.body("layer2") + stage.body("layer3"))
    return size * glass(unit, middle) * slope_per_min(middle, stage.step_s)


def bowed_spool(unit: Unit, stage: Stage, size: float) -> Array:
    """The spool bows as its flange is warmer than the base: fibre at its rim is strained; `size` a kelvin."""
    return size * (stage.body("spool") - stage.body("base"))


def polarisation(unit: Unit, stage: Stage, size: float) -> Array:
    """Light left polarised beats with what crossed over in the coil.

    The phase between them goes with the fibre's birefringence, a fraction of a wave in the whole range; the
    depolarisers' coherence fades as they come nearer to each other.
    """
    off = np.mean([stage.body(name) for name in LAYERS], axis=0) - 25.0
    wave_k = 110.0 + 50.0 * unit.draw["a"]
    phase = 2.0 * math.pi * (off / wave_k + 0.06 * (unit.draw["phase"] - 0.5))
    fades = np.exp(-((off / 160.0) ** 2))
    return np.asarray(size * (1.0 - fades * np.cos(phase)))


def late_coupler(unit: Unit, stage: Stage, size: float) -> Array:
    """The coupler splits by its own temperature; it lies in foam behind the spool; `size` a kelvin."""
    behind_s = 500.0 + 900.0 * unit.draw["c"]
    return size * (follow(stage.body("spool"), behind_s, stage.step_s) - 25.0)


def creeping_glue(unit: Unit, stage: Stage, size: float) -> Array:
    """Glue of the spool's flange is stressed by a change of temperature and relaxes over a spectrum of times.

    The stress of a chain of Maxwell elements is what each follower still lacks.
    """
    fastest_s = 400.0 + 500.0 * unit.draw["a"]
    spool = stage.body("spool")
    times = tuple(fastest_s * 3.0**k for k in range(3))
    weights = tuple(math.exp(-0.6 * unit.draw["form"] * k) for k in range(3))
    return size * (spool - spectrum_of_lags(spool, times, weights, stage.step_s))


def sticking_potting(unit: Unit, stage: Stage, size: float) -> Array:
    """Potting sticks to the spool and slips: friction elements of different strength, whatever the speed."""
    every = 20
    layer = stage.body("layer4")
    coarse = np.append(layer[::every], layer[-1])
    at = np.append(np.arange(0, stage.steps, every), stage.steps - 1)
    widths = (1.5, 4.0, 9.0)
    shares = np.array([0.5, 1.0, 0.5 + unit.draw["g1"]])
    held = sum(share * (coarse - play(coarse, width)) for share, width in zip(shares, widths, strict=True))
    return np.asarray(size / 9.0 * np.interp(np.arange(stage.steps), at, held / shares.sum()))


def sagging_coil(unit: Unit, stage: Stage, size: float) -> Array:
    """The coil's weight presses the lower layers: bias by gravity along the axis; `size` for 1 g."""
    return size * np.sin(np.radians(stage.elevation_deg))


# light and electronics ----------------------------------------------------------------------------------------


def photon_energy(temperature_c: Array) -> Array:
    """Return by how much a diode's photon energy is above that at the set point, in K of slope there, (m,).

    The gap falls as T^2 / (T + 162 K): Varshni, Physica 34 (1967) 149, with InP's constant.
    """

    def fall(kelvin: Array | float) -> Array | float:
        return kelvin**2 / (kelvin + _VARSHNI_K)

    at_k = SET_C + ZERO_CELSIUS_K
    slope = at_k * (at_k + 2.0 * _VARSHNI_K) / (at_k + _VARSHNI_K) ** 2
    return np.asarray((fall(at_k) - fall(temperature_c + ZERO_CELSIUS_K)) / slope)


def wavelength(unit: Unit, stage: Stage, size: float) -> Array:
    """The cooler's thermistor feels its can as well: the diode goes a part of the can's way, or against it.

    Scale factor goes with one over wavelength, as photon energy does; `size` ppm a kelvin of the can at the set
    point.
    """
    return 1e-6 * size * 3600.0 * rate_dps(stage) * photon_energy(stage.body("can"))


def cooler(unit: Unit, stage: Stage, size: float) -> Array:
    """Out of the cooler's range the diode and its wavelength follow the can; `size` ppm a kelvin."""
    return 1e-6 * size * 3600.0 * rate_dps(stage) * photon_energy(SET_C + stage.body("beyond"))


def modulator_depth(unit: Unit, stage: Stage, size: float) -> Array:
    """The modulator's depth follows its own late temperature, the scale factor the Bessel function J1 of it.

    `size` ppm for 50 K.
    """
    behind_s = 400.0 + 700.0 * unit.draw["c1"]
    depth = 2.1 + 0.4 * unit.draw["b"]
    off = (follow(stage.body("spool"), behind_s, stage.step_s) - 25.0) / 50.0
    change = j1(depth * (1.0 + 0.02 * off)) / j1(depth) - 1.0
    per_50k = abs(j1(1.02 * depth) / j1(depth) - 1.0)
    return np.asarray(1e-6 * size * 3600.0 * rate_dps(stage) * change / per_50k)


def sine_response(unit: Unit, stage: Stage, size: float) -> Array:
    """The stored table's amplitude is off: arcsine of a sine too large by `size` ppm, at first a tangent."""
    rate = rate_dps(stage)
    phase = sagnac_rad(unit, rate)
    per_dps = sagnac_rad(unit, np.ones(1))[0]
    return np.asarray(1e-6 * size * 3600.0 * np.tan(phase) / per_dps)


def table_end(unit: Unit, stage: Stage, size: float) -> Array:
    """The stored table ends `size` deg/s below the fastest rate with the Earth's: its last value stays."""
    rate, end = rate_dps(stage), _FASTEST_DPS + earth_rate_up_dph(LATITUDE_DEG) / 3600.0 - size
    return 3600.0 * (np.clip(rate, -end, end) - rate)


def rectifier(unit: Unit, stage: Stage, size: float) -> Array:
    """A rectifier before the one-way converter has unequal resistors: `size` ppm between the two signs.

    Its diodes change over within a few thousandths of a degree a second.
    """
    soft = 0.001 + 0.002 * unit.draw["g1"]
    return np.asarray(0.5e-6 * size * 3600.0 * (np.hypot(rate_dps(stage), soft) - soft))


def dead_converter(unit: Unit, stage: Stage, size: float) -> Array:
    """Modulation that leaks into the demodulator holds the converter still below `size` deg/h.

    Noise carries it over near the threshold.
    """
    rate = 3600.0 * rate_dps(stage)
    steep = 6.0 + 10.0 * unit.draw["form"]
    away = np.minimum(np.abs(rate) / size, 50.0)
    return np.asarray(-rate * np.exp(-(away**steep)))


def warming_pick_up(unit: Unit, stage: Stage, size: float) -> Array:
    """The drive couples into the photodiode's amplifier by a phase that goes with the board's own warmth.

    The board warms in two times, its copper first.
    """
    since = stage.time_s + stage.power_on_s
    copper_s, case_s = 60.0 + 60.0 * unit.draw["c2"], 700.0 + 600.0 * unit.draw["c"]
    lack = 0.35 * np.exp(-since / copper_s) + 0.65 * np.exp(-since / case_s)
    return np.asarray(size * (np.sin(0.8 * (1.0 - lack)) / math.sin(0.8) - 1.0))


def bridge_flip(unit: Unit, stage: Stage, size: float) -> Array:
    """The cooler's bridge changes sides as the can passes a temperature: its current's field steps the bias.

    It changes back half a kelvin lower.
    """
    at_c = 12.0 + 26.0 * unit.draw["a"]
    can = stage.body("can")
    known = np.where(can > at_c + 0.25, 1.0, np.where(can < at_c - 0.25, 0.0, np.nan))
    known[0] = float(can[0] > at_c) if math.isnan(known[0]) else known[0]
    last = np.maximum.accumulate(np.where(np.isnan(known), 0, np.arange(stage.steps)))
    return np.asarray(size * follow(known[last], 4.0, stage.step_s))


# fields and the table -----------------------------------------------------------------------------------------


def faraday(turn_rad: Array, elevation_rad: Array, unit: Unit) -> Array:
    """Bias of the fibre's twist in the Earth's field, 1 for 20 uT along the sensitive direction of the coil.

    That direction lies across the axis and turns with the case; the field points north and down.
    """
    twist = 2.0 * math.pi * unit.draw["tilt"]
    along = np.cos(turn_rad) * np.sin(elevation_rad) * math.cos(twist) - np.sin(turn_rad) * math.sin(twist)
    # north 18 uT, down 46 uT: an upright case has this direction level
    return np.asarray(0.9 * along + 2.3 * np.cos(elevation_rad) * math.cos(twist))


def remanence(unit: Unit, stage: Stage, size: float) -> Array:
    """The motor's current leaves the shield magnetised in the sense of the last turn; it fades slowly."""
    fades_s = 150.0 + 450.0 * unit.draw["c1"]
    driven = np.sign(stage.rate_dps) * (1.0 - np.exp(-np.abs(stage.rate_dps) / 1.5))
    moved = np.abs(stage.rate_dps) > 1e-4
    result = np.empty(stage.steps)
    left, keep = 0.0, math.exp(-stage.step_s / fades_s)
    take = 1.0 - math.exp(-stage.step_s / 8.0)
    for k, (turns, push) in enumerate(zip(moved.tolist(), driven.tolist(), strict=True)):
        left = left + take * (push - left) if turns else keep * left
        result[k] = left
    return size * result


def wound_cable(unit: Unit, stage: Stage, size: float) -> Array:
    """The supply's cable winds round the table's post: its pull on the case goes with all turns so far.

    Some turns of slack do nothing.
    """
    turns = (0.5 * (stage.angle_deg[1:] + stage.angle_deg[:-1]) - stage.angle_deg[0]) / 360.0
    slack = 1.0 + 2.0 * unit.draw["lean"]
    pull = (np.logaddexp(0.0, 3.0 * (turns - slack)) - np.logaddexp(0.0, -3.0 * (turns + slack))) / 3.0
    return np.asarray(size * np.tanh(0.2 * pull))


def spool_resonance(unit: Unit, stage: Stage, size: float) -> Array:
    """Balls of the bearing shake the spool as they pass: at one speed its resonance beats with the modulation.

    Amplitude and phase are those of an oscillator driven at a frequency proportional to speed.
    """
    speed = np.abs(stage.rate_dps)
    own_dps, damping = 27.0 + 6.0 * unit.draw["order"], 0.05 + 0.05 * unit.draw["g1"]
    ratio = speed / own_dps
    real = (1.0 - ratio**2) / ((1.0 - ratio**2) ** 2 + (2.0 * damping * ratio) ** 2)
    return np.asarray(size * ratio**2 * real)


# foreign: light and weather -----------------------------------------------------------------------------------


def fringes(unit: Unit, stage: Stage, size: float) -> Array:
    """A splice reflects into the source's coherence: fringes every few kelvins of the lid, in a span of them."""
    wave_k = 4.0 + 4.0 * unit.draw["a"]
    centre = -5.0 + 50.0 * unit.draw["c2"]
    off = stage.body("lid") - centre
    return np.asarray(
        size * np.exp(-((off / 14.0) ** 2)) * np.sin(2.0 * math.pi * (off / wave_k + unit.draw["phase"]))
    )


def dew(unit: Unit, stage: Stage, size: float) -> Array:
    """Dew settles on the coupler's face while it is colder than the day's dew point, and dries when warmer.

    The film takes light by an exponential of its thickness; the day's dew point differs from run to run.
    """
    point_c = 9.0 + drawn(unit.seed, "weather", stage.key).normal(0.0, 8.0)
    thaws_s = 200.0 + 400.0 * unit.draw["b"]
    colder = (point_c - stage.body("base")) / 10.0
    film, result = 0.0, np.empty(stage.steps)
    per_s = stage.step_s / thaws_s
    for k, push in enumerate(colder.tolist()):
        film = max(0.0, film + per_s * (push if push < 0.0 else push * math.exp(-film)))
        result[k] = film
    return size * (1.0 - np.exp(-result))


def hunting_cooler(unit: Unit, stage: Stage, size: float) -> Array:
    """A cooler at its limit hunts: its current swings about the limit, and with it the field at the coil.

    The swing grows in a few periods and its frequency rises with what the cooler lacks.
    """
    lack = np.abs(stage.body("beyond"))
    strength = follow(lack / (lack + 0.7), 60.0, stage.step_s)
    per_s = (1.0 + 0.15 * lack) / (90.0 + 80.0 * unit.draw["c"])
    swing = np.cumsum(per_s) * stage.step_s + unit.draw["phase"]
    return np.asarray(size * strength * np.sin(2.0 * math.pi * swing))
