"""Effects of the nuclear resonance gyros that a catalogue of common mechanisms hardly has.

Sources beside the family's: Born and Wolf, Principles of Optics (1999): etalons; Wu, Happer, Kitron and
Daniels, Phys. Rev. A 42 (1990): quadrupole splitting at walls; Vig, Quartz Crystal Resonators and Oscillators
(2000): ageing.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from benchmarks.gap_exam._family import Effect, Signal, Unit
from benchmarks.gap_exam._nuclear_bench import OVEN_MOST_W, SORTS
from benchmarks.gap_exam._nuclear_parts import DECLINATION_RAD, true_dph, turn_rad
from benchmarks.gap_exam._signals import drawn, follow, smooth_step
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._turning import telegraph
from drivers.base.arrays import Array


def _etalon(unit: Unit, stage: Stage, size: float) -> Array:
    """The cell's window is an etalon: light goes up and down as the laser's wave moves over its fringes."""
    fringe = 2.0 * math.pi * (stage.body("laser") / 2.6 + unit.draw["form"])
    return np.asarray(size / (1.0 + 1.5 * np.sin(0.5 * fringe) ** 2))


def _warm_pool(unit: Unit, stage: Stage, size: float) -> Array:
    """On a level axis a pool of rubidium bridges the cell, and the oven's stray heat moves it."""
    level = np.cos(np.radians(stage.elevation_deg)) ** 2
    return np.asarray(size * level * np.tanh((stage.body("former") - 18.0) / 25.0))


def _dropout(unit: Unit, stage: Stage, size: float) -> Array:
    """A regulator drops out above some temperature of the board: nothing before, a straight line then."""
    over = stage.body("board") - 38.0 - 6.0 * unit.draw["a"]
    return np.asarray(size * 0.4 * np.logaddexp(0.0, over / 0.4) / 10.0)


def _heater_beat(unit: Unit, stage: Stage, size: float) -> Array:
    """The oven's pulses have harmonics that go and come with their duty: the ninth meets the spins."""
    duty = stage.body("oven_w") / OVEN_MOST_W
    return np.asarray(size * np.sin(9.0 * math.pi * duty))


def _spin_memory(unit: Unit, stage: Stage, size: float) -> Array:
    """Cross polarisation of a turn dies with the spins' time, long after the turn."""
    rate = 3600.0 * stage.axis_dps
    return np.asarray(1e-6 * size * (follow(rate, 38.0, stage.step_s) - rate))


def _quadrupole_line(unit: Unit, stage: Stage, size: float) -> Array:
    """Where a rate meets the quadrupole splitting of xenon 131, lines repel: a dispersion about that rate."""
    off = (np.abs(stage.axis_dps) - 4.0 - 3.0 * unit.draw["b"]) / 1.4
    return np.asarray(size * 2.0 * off / (1.0 + off**2))


def _scale_fringes(unit: Unit, stage: Stage, size: float) -> Array:
    """The probe's polariser is a retarder, too: its gain waves with temperature."""
    return np.asarray(
        1e-6 * size * true_dph(stage) * np.sin(2.0 * math.pi * (stage.body("frame") / 11.0 + unit.draw["c"]))
    )


def _eddies(unit: Unit, stage: Stage, size: float) -> Array:
    """Shield and case turn in Earth's field: eddies add to it, with the rate, a quarter turn off."""
    level = np.cos(np.radians(stage.elevation_deg))
    rate = stage.rate_dps / 2.0
    return np.asarray(size * level * rate / (1.0 + np.abs(rate)) * np.sin(turn_rad(stage) + DECLINATION_RAD))


def _relocked(unit: Unit, stage: Stage, size: float) -> Array:
    """Once in a run, at any time, the laser locks anew beside its place and creeps back halfway."""
    rng = drawn(unit.seed, "relocked", stage.key)
    since = stage.time_s - stage.steps * stage.step_s * rng.uniform(0.15, 0.85)
    gone = rng.choice((-1.0, 1.0)) * (
        0.5 + 0.5 * np.exp(-np.maximum(since, 0.0) / rng.uniform(400.0, 1800.0))
    )
    return np.asarray(size * np.where(since > 0.0, gone, 0.0))


def _remanence(unit: Unit, stage: Stage, size: float) -> Array:
    """The shield is demagnetised before a run and keeps another remanence, which falls with warmth."""
    kept = drawn(unit.seed, "remanence", stage.key).standard_normal()
    return np.asarray(-size * kept * np.tanh((stage.body("shield_a") - 20.0) / 40.0))


def _hunting_oven(unit: Unit, stage: Stage, size: float) -> Array:
    """The oven's loop hunts now and then, with another period and strength each time."""
    rng = drawn(unit.seed, "hunting", stage.key)
    begin, lasts = rng.uniform(0.0, 0.6) * stage.seconds, rng.uniform(0.25, 0.5) * stage.seconds
    wave = np.sin(2.0 * math.pi * stage.time_s / rng.uniform(150.0, 500.0) + rng.uniform(0.0, 6.3))
    into = (stage.time_s - begin) / 60.0
    shown = smooth_step(into) * smooth_step(lasts / 60.0 - into)
    return np.asarray(size * rng.uniform(0.4, 1.6) * shown * wave)


_RUNS = sum(sort.repeats for sort in SORTS)


def _ageing_scale(unit: Unit, stage: Stage, size: float) -> Array:
    """The clock ages from run to run, quickly at first: by the logarithm of the time in use."""
    aged = math.log1p(stage.number / 4.0) / math.log1p(_RUNS / 4.0)
    return np.asarray(1e-6 * size * true_dph(stage) * (aged - 0.5))


def _new(signal: Signal, *, changing: bool = False) -> Effect:
    return Effect(signal, changing=changing)


FOREIGN: Mapping[str, Effect] = {
    "etalon": _new(_etalon),
    "warm_pool": _new(_warm_pool),
    "dropout": _new(_dropout),
    "heater_beat": _new(_heater_beat),
    "spin_memory": _new(_spin_memory),
    "quadrupole_line": _new(_quadrupole_line),
    "scale_fringes": _new(_scale_fringes),
    "eddies": _new(_eddies),
    "relocked": _new(_relocked, changing=True),
    "remanence": _new(_remanence, changing=True),
    "hunting_oven": _new(_hunting_oven, changing=True),
    "ageing_scale": _new(_ageing_scale, changing=True),
    "switching_wall": telegraph(700.0),
}
