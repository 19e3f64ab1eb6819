"""A case of the exam: what the unit suffers from, and the outputs of its runs with noise."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import EARTH_RATE_DPH
from simulators.exam._campaign import LATITUDE_DEG, RunTruth
from simulators.exam._physics import KNOWN, UNKNOWN, Draw, draw_unit

KINDS = ("null", "single", "pair", "unknown", "known and unknown", "stochastic")
SHEET = {"arw": 0.004, "flicker": 0.006, "walk": 0.0, "quantum": 0.05}
STOCHASTIC = {
    "noise_level": ("arw", 0.004 * 1.3, 0.004 * 2.5),
    "bias_instability": ("flicker", 0.006 * 2.0, 0.006 * 6.0),
    "rate_random_walk": ("walk", 0.01, 0.06),
    "quantisation": ("quantum", 0.15, 0.6),
}
SF_SIGMA_PPM = 20.0
SLOPE_SIGMA_DPH = 0.03


@dataclass(frozen=True)
class ExamCase:
    """What is sealed: kind, effects with the signal-to-noise ratio wanted, the unit's draw, noise, seed."""

    seed: int
    kind: str
    effects: tuple[str, ...]
    snr: float
    stochastic: str = ""
    noise: Mapping[str, float] = field(default_factory=lambda: dict(SHEET))
    unit: Draw = field(default_factory=dict)
    sf_ppm: float = 0.0
    slope_dph: float = 0.0


def draw_case(seed: int, kind: str) -> ExamCase:
    """Draw a case of a kind; signal-to-noise ratios are log-uniform from 0.3 to 30."""
    rng = np.random.default_rng((seed, 5))
    snr = float(np.exp(rng.uniform(math.log(0.3), math.log(30.0))))
    known, unknown = list(KNOWN), list(UNKNOWN)
    effects: tuple[str, ...] = ()
    stochastic = ""
    noise = dict(SHEET)
    if kind == "single":
        effects = (str(rng.choice(known)),)
    elif kind == "pair":
        effects = tuple(str(name) for name in rng.choice(known, 2, replace=False))
    elif kind == "unknown":
        effects = (str(rng.choice(unknown)),)
    elif kind == "known and unknown":
        effects = (str(rng.choice(known)), str(rng.choice(unknown)))
    elif kind == "stochastic":
        stochastic = str(rng.choice(list(STOCHASTIC)))
        key, low, high = STOCHASTIC[stochastic]
        noise[key] = float(np.exp(rng.uniform(math.log(low), math.log(high))))
    if len(effects) == 2:
        snr = max(snr, 1.0)
    return ExamCase(
        seed,
        kind=kind,
        effects=effects,
        snr=snr,
        stochastic=stochastic,
        noise=noise,
        unit=draw_unit(rng),
        sf_ppm=float(rng.normal(0.0, SF_SIGMA_PPM)),
        slope_dph=float(rng.normal(0.0, SLOPE_SIGMA_DPH)),
    )


def signal_dph(case: ExamCase, effect: str, run: RunTruth) -> Array:
    """Return an effect's signal of unit amplitude in a run, (n,)."""
    function = KNOWN[effect] if effect in KNOWN else UNKNOWN[effect]
    return function(run, case.unit)


def nominal_dph(case: ExamCase, run: RunTruth) -> Array:
    """Return the output without effects and noise: Earth and table rate, scale factor, bias linear in T_in."""
    latitude, elevation = math.radians(LATITUDE_DEG), np.radians(run.elevation_deg)
    turn = np.radians(run.angle_deg)
    level = np.cos(turn[:-1] + np.linspace(0.05, 0.95, 10)[:, None] * np.diff(turn)).mean(axis=0)
    rate = 3600.0 * np.diff(run.angle_deg) * np.sin(elevation)
    earth = math.sin(latitude) * np.sin(elevation) + math.cos(latitude) * np.cos(elevation) * level
    rate = rate + EARTH_RATE_DPH * earth
    return np.asarray(rate * (1.0 + 1e-6 * case.sf_ppm) + case.slope_dph * (run.t_in_c - 25.0) / 50.0)


def outputs_dph(
    case: ExamCase, runs: Sequence[RunTruth], amplitudes: Mapping[str, float], *, noisy: bool = True
) -> list[Array]:
    """Return the gyro's output of every run, deg/h, (n,)."""
    rng = np.random.default_rng((case.seed, 7))
    outputs = []
    for run in runs:
        total = nominal_dph(case, run)
        for effect, amplitude in amplitudes.items():
            total = total + amplitude * signal_dph(case, effect, run)
        if noisy:
            total = total + _noise(case.noise, len(total), rng)
        outputs.append(total)
    return outputs


def read_temperature(truth_c: Array, rng: np.random.Generator) -> Array:
    """Return a sensor's readings: 0.01 K noise and 0.01 K steps."""
    return np.asarray(np.round((truth_c + rng.normal(0.0, 0.01, len(truth_c))) / 0.01) * 0.01)


def _noise(noise: Mapping[str, float], n: int, rng: np.random.Generator) -> Array:
    """Return white, 1/f (shaped in the frequency domain), random walk, quantisation and turn-on noise."""
    white = 60.0 * noise["arw"] * rng.standard_normal(n)
    long = 4 * n
    frequency = np.fft.rfftfreq(long)
    frequency[0] = frequency[1]
    shaped = np.fft.rfft(rng.standard_normal(long)) * np.sqrt(1.0 / (2.0 * math.pi * frequency))
    flicker = noise["flicker"] * np.fft.irfft(shaped, long)[:n]
    walk = noise["walk"] / 60.0 * np.cumsum(rng.standard_normal(n))
    total = white + flicker + walk + rng.normal(0.0, 0.01)
    quantum = noise["quantum"]
    angle = np.cumsum(total) + rng.uniform(0.0, quantum)
    return np.asarray(np.diff(np.round(angle / quantum) * quantum, prepend=0.0))
