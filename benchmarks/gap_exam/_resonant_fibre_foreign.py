"""What may be wrong with a resonant fibre gyro and its bench that the catalogue has no name for."""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter

from benchmarks.gap_exam._family import Effect, Signal, Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._resonant_fibre_bench import RADII_M, SHELLS
from benchmarks.gap_exam._signals import drawn, follow, markov, spectrum_of_lags
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

LATITUDE_DEG = 52.2
ROOM_C = 25.0
_ROUND = 10
"""Runs of the first round."""


def ring_c(stage: Stage) -> Array:
    """Return the ring's mean temperature, by the fibre's length in its shells."""
    return np.asarray(
        sum(r * stage.body(str(k)) for k, r in zip(range(SHELLS), RADII_M, strict=True)) / RADII_M.sum()
    )


def _eigenmodes(unit: Unit, stage: Stage, size: float) -> Array:
    """The resonance of the other polarisation runs through that in use as birefringence turns with warmth."""
    phase = 2.0 * math.pi * ((ring_c(stage) - ROOM_C) / (16.0 + 10.0 * unit.draw["a"]) + unit.draw["phase"])
    return np.asarray(size * np.sin(phase) / (1.0 + 2.0 * (1.0 - np.cos(phase))))


def _shifter_heat(unit: Unit, stage: Stage, size: float) -> Array:
    """The frequency shifter's drive, as the size of rate, warms the ring's leads by and by."""
    drive = np.abs(sensed_dph(stage, LATITUDE_DEG)) / 3600.0 / 60.0
    return size * spectrum_of_lags(drive, (90.0 + 60.0 * unit.draw["b"], 700.0), (0.4, 0.6), stage.step_s)


def _soft_flange(unit: Unit, stage: Stage, size: float) -> Array:
    """The ring sags along its axis, more where its flange is warm."""
    return np.asarray(size * np.sin(np.radians(stage.elevation_deg)) * (stage.body("hub") - ROOM_C) / 50.0)


def _slow_sag(unit: Unit, stage: Stage, size: float) -> Array:
    """After the case is laid over, its potting gives way for some minutes."""
    pull = np.sin(np.radians(stage.elevation_deg))
    return np.asarray(size * (pull - spectrum_of_lags(pull, (40.0, 220.0), (0.4, 0.6), stage.step_s)))


def _levelling(unit: Unit, stage: Stage, size: float) -> Array:
    """The laser's power control rings after the speed, and with it the light in the ring, has changed."""
    pole = np.exp(stage.step_s * (-1.0 / 60.0 + 2j * math.pi / (28.0 + 16.0 * unit.draw["b"])))
    speed = np.abs(stage.rate_dps)
    jolts = np.diff(speed, prepend=speed[0]) / 60.0
    return np.asarray(size * lfilter([1.0], [1.0, -pole], jolts.astype(complex)).imag)


def _two_modes(unit: Unit, stage: Stage, size: float) -> Array:
    """The laser is in the one or the other of two modes, at its pleasure."""
    rng = drawn(unit.seed, "modes", stage.key)
    count = 4 + stage.seconds // 40
    stays = (20.0 + rng.exponential((260.0, 110.0), (count, 2))).ravel()
    first = int(rng.integers(2))
    return size * ((np.searchsorted(np.cumsum(stays[first:]), stage.time_s) + first) % 2).astype(float)


def _weather(unit: Unit, stage: Stage, size: float) -> Array:
    """The ring's hollow core has the hall's air: doors and weather act on it."""
    rng = drawn(unit.seed, "pressure", stage.key)
    gaps = np.full(stage.seconds // 10 + 3, 10.0)
    waves = markov(1.0, 900.0, gaps, rng) + 0.4 * markov(1.0, 150.0, gaps, rng)
    return size * np.asarray(np.interp(stage.time_s, np.arange(len(gaps)) * 10.0, waves))


def _compressor(unit: Unit, stage: Stage, size: float) -> Array:
    """The chamber's compressor shakes while it runs: in the cold longer, and by no clock that is logged."""
    rng = drawn(unit.seed, "compressor", stage.key)
    air, running = stage.body("air"), np.zeros(stage.steps)
    start_s, end_s = -float(rng.uniform(0.0, 200.0)), stage.steps * stage.step_s
    while start_s < end_s:
        cycle_s = float(rng.uniform(140.0, 380.0))
        at = min(max(int(start_s / stage.step_s), 0), stage.steps - 1)
        share = min(max(0.38 - 0.0085 * (float(air[at]) - ROOM_C), 0.08), 0.9)
        running[
            max(int(start_s / stage.step_s), 0) : max(int((start_s + share * cycle_s) / stage.step_s), 0)
        ] = 1.0
        start_s += cycle_s
    return size * follow(running, 6.0, stage.step_s)


def _cracked_splice(unit: Unit, stage: Stage, size: float) -> Array:
    """After some run of the first two rounds a support is loose: the diameter is another, by `size` ppm."""
    since = stage.number >= _ROUND - 4 + int(9.0 * unit.draw["c1"])
    return np.asarray(1e-6 * size * float(since) * sensed_dph(stage, LATITUDE_DEG))


def _slips(unit: Unit, stage: Stage, size: float) -> Array:
    """While the spool shrinks or grows, turns slip now and then: a jolt of the bias, half of it to stay."""
    rng = drawn(unit.seed, "slips", stage.key)
    travelled = np.cumsum(np.abs(np.diff(stage.body("hub"), prepend=stage.body("hub")[0])))
    result = np.zeros(stage.steps)
    at_k = float(rng.exponential(7.0))
    while at_k < travelled[-1]:
        since = stage.time_s - stage.time_s[int(np.searchsorted(travelled, at_k))]
        jolt = float(rng.choice((-1.0, 1.0)) * rng.uniform(0.4, 1.6))
        decaying = np.exp(-np.maximum(since, 0.0) / 200.0)
        result += np.where(since >= 0.0, jolt * 0.5 * (1.0 + decaying), 0.0)
        at_k += float(rng.exponential(7.0))
    return size * result


def _changing(signal: Signal) -> Effect:
    return Effect(signal, changing=True)


FOREIGN: dict[str, Effect] = {
    "eigenmodes": Effect(_eigenmodes),
    "shifter_heat": Effect(_shifter_heat),
    "soft_flange": Effect(_soft_flange),
    "slow_sag": Effect(_slow_sag),
    "levelling": Effect(_levelling),
    "two_modes": _changing(_two_modes),
    "weather": _changing(_weather),
    "compressor": _changing(_compressor),
    "cracked_splice": _changing(_cracked_splice),
    "slips": _changing(_slips),
}
