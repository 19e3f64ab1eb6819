"""A lab with a dry tuned-rotor gyro in a rebalance loop: its campaign, its noise and how it logs.

Rows come at 1.25 Hz, unevenly, of the slow ramp at 0.4 Hz; some are lost in bursts, the first after a loss and
those of moves have no output. The model of the gyro is that of IEEE Std 813 (dynamically tuned gyros).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.gap_exam._family import Family, Layout, Sheet, Unit
from benchmarks.gap_exam._signals import drawn, follow, markov, walk
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._tuned_rotor_bench import (
    HEAT_STEP_S,
    Slab,
    driven,
    fan_of,
    heated,
    limited_rate,
    refined,
)
from benchmarks.gap_exam._tuned_rotor_effects import EFFECTS, LATITUDE_DEG
from drivers.base.arrays import Array

SHEET = Sheet(0.008, 0.02, 0.012, 0.4, 150.0, 0.6, 0.4)
FLICKER_S = 3.0 ** np.arange(11)
"""Relaxation times whose sum is 1/f from a minute to a day."""
_REPEATS = 3
_ACCELERATION_DPS2 = 12.0
_SETTLING_S = 8.0
_JITTER_S = 0.006
_BURSTS_S = 900.0
_ENCODER_DEG = 360.0 / 2**27
_SWAY_SHARE = 0.09
"""Part of the white noise's variance that is sway of the pier, coloured."""
_SWAY_POLES = 0.6 * np.exp(1j * 1.9)

Knots = tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Programme:
    """A procedure: set points of the air (s, degC), rates (s, deg/s), positions (s, angle, elevation in deg)."""

    code: str
    profile: str
    condition: str
    seconds: float
    air: Knots
    elevation_deg: float = 0.0
    rates: Knots = ()
    positions: tuple[tuple[float, float, float], ...] = ()
    power_on_s: float = 1800.0
    step_s: float = 0.5
    period_s: float = 0.8
    swings: bool = False
    masked: bool = False
    unseen: bool = False


_COLD_AND_HOT: Knots = ((0.0, 25.0), (500.0, -30.0), (2300.0, 62.0), (3700.0, 25.0))
_RATES_DPS = (0.02, 0.06, 0.15, 0.4, 1.0, 3.0, 8.0, 16.0, 25.0, 35.0)
_TUMBLE = tuple(
    (turn, elevation)
    for turn, elevation in (
        *((turn, 0.0) for turn in (0.0, 135.0, 270.0, 45.0, 180.0, 315.0, 90.0, 225.0)),
        *((60.0, elevation) for elevation in (90.0, 50.0, -50.0, -90.0, -25.0, 25.0)),
    )
)


def _staircase(start_s: float, section_s: float) -> Knots:
    both = [sign * rate for rate in _RATES_DPS for sign in (1.0, -1.0)]
    knots = [(start_s + section_s * k, rate) for k, rate in enumerate(both)]
    return (*knots, (start_s + section_s * len(both), 0.0))


def _visits(start_s: float, stay_s: float) -> tuple[tuple[float, float, float], ...]:
    return tuple((start_s + stay_s * k, turn, up) for k, (turn, up) in enumerate(_TUMBLE))


PROGRAMMES = (
    Programme("DW", "dwell", "east", 4200.0, ((0.0, 25.0),), power_on_s=2400.0),
    Programme("HC", "cold and hot", "0", 4500.0, _COLD_AND_HOT, 90.0, power_on_s=900.0),
    Programme(
        "SP", "cold and hot", "+18", 4500.0, _COLD_AND_HOT, 90.0, ((60.0, 18.0), (4430.0, 0.0)),
        power_on_s=900.0, step_s=0.2,
    ),
    Programme(
        "SN", "cold and hot", "-18", 4500.0, _COLD_AND_HOT, 90.0, ((60.0, -18.0), (4430.0, 0.0)),
        power_on_s=900.0, step_s=0.2,
    ),
    Programme(
        "RS", "rates", "up", 1560.0, ((0.0, 25.0),), 90.0, _staircase(60.0, 72.0), step_s=0.1, masked=True
    ),
    Programme(
        "PT", "positions", "all", 4500.0, ((0.0, 25.0), (2200.0, 58.0)),
        positions=(*_visits(100.0, 150.0), *_visits(2400.0, 150.0)), step_s=0.25, masked=True,
    ),
    Programme(
        "SL", "slow ramp", "east", 7200.0, ((0.0, 25.0), (300.0, 26.0), (3000.0, 62.0), (7000.0, -30.0)),
        period_s=2.5, power_on_s=300.0,
    ),
    Programme("OS", "swing", "up", 900.0, ((0.0, 25.0),), 90.0, step_s=0.1, swings=True),
    Programme(
        "MD", "mixed day", "45", 5400.0, ((0.0, 25.0), (600.0, 48.0), (2600.0, -12.0)), 45.0,
        ((1800.0, 7.0), (3000.0, 0.0), (3600.0, -12.0), (4700.0, 0.0)), step_s=0.2, unseen=True,
    ),
)  # fmt: skip


def campaign(unit: Unit) -> list[Stage]:
    """Return the runs in the order in which they are made, all procedures three times, the unseen twice."""
    order = [
        (programme, repeat)
        for repeat in range(_REPEATS)
        for programme in PROGRAMMES
        if repeat < _REPEATS - programme.unseen
    ]
    rngs = [drawn(unit.seed, "stage", programme.code, repeat) for programme, repeat in order]
    longest = max(programme.seconds + programme.power_on_s for programme, _ in order)
    fans = np.stack([fan_of(longest, rng) for rng in rngs], axis=1)
    since_s = np.arange(0.0, len(fans)) * HEAT_STEP_S
    demanded = np.stack([_set_points(programme, since_s) for programme, _ in order], axis=1)
    heat = heated(demanded, fans, Slab(joint_w_per_k=0.9 + 0.4 * unit.draw["c1"]))
    heat["fan"] = fans
    return [
        _stage(programme, repeat, number, {name: values[:, number] for name, values in heat.items()}, rng)
        for number, ((programme, repeat), rng) in enumerate(zip(order, rngs, strict=True))
    ]


def _set_points(programme: Programme, since_s: Array) -> Array:
    """Return the set point at times since power-on; the slow ramp's is a polygon, others step."""
    times, values = np.array(programme.air).T
    if programme.profile == "slow ramp":
        return np.asarray(np.interp(since_s - programme.power_on_s, times, values))
    which = np.searchsorted(times, since_s - programme.power_on_s, "right") - 1
    return np.asarray(values[np.maximum(which, 0)])


def _stage(
    programme: Programme, repeat: int, number: int, heat: dict[str, Array], rng: np.random.Generator
) -> Stage:
    step_s = programme.step_s
    edges = np.arange(0.0, round(programme.seconds / step_s) + 1) * step_s
    angle, elevation, moving = _motion(programme, edges, rng)
    rows = round(programme.seconds / programme.period_s)
    late = np.abs(rng.normal(0.0, _JITTER_S, rows)) + (rng.random(rows) < 0.03) * rng.uniform(0.0, 0.1, rows)
    edges_s = np.concatenate(
        ([0.0], np.minimum(np.arange(1, rows + 1) * programme.period_s + late, edges[-1]))
    )
    valid, kept = np.ones(rows, bool), _kept(edges_s, rng)
    if programme.masked:
        settling = np.convolve(moving, np.ones(round(_SETTLING_S / step_s)))[: len(moving)] > 0.5
        upto = np.interp(edges_s, edges, np.concatenate(([0.0], np.cumsum(settling))))
        valid &= np.diff(upto) < 1e-9
    valid[1:] &= kept[1:] <= kept[:-1]
    middles = programme.power_on_s + edges[:-1] + 0.5 * step_s
    bodies = {name: refined(values, middles) for name, values in heat.items() if name != "fan"}
    bodies["fan"] = np.interp(middles, np.arange(len(heat["fan"])) * HEAT_STEP_S, heat["fan"])
    bodies["magnet"] = follow(bodies["core"], 180.0, step_s)
    phases = tuple((f"air {celsius:g}", start_s) for start_s, celsius in programme.air)
    return Stage(
        programme.code, programme.profile, programme.condition, repeat, number, step_s, angle, elevation,
        bodies, follow(bodies["core"], 9.0, step_s), follow(bodies["face"], 6.0, step_s), edges_s, valid, kept,
        phases, programme.power_on_s, programme.unseen or repeat == _REPEATS - 1,
    )  # fmt: skip


def _motion(
    programme: Programme, edges: Array, rng: np.random.Generator
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return true angle at edges, elevation in the steps, and in which of them the table is sent elsewhere."""
    step_s = programme.step_s
    elevation = np.full(len(edges) - 1, programme.elevation_deg)
    if programme.positions:
        starts, turns, ups = np.array(programme.positions).T
        knots_s, angles, elevations = [0.0], [0.0], [0.0]
        for start_s, turn, up in zip(starts, turns, ups, strict=True):
            lasting = max(abs(turn - angles[-1]) / 20.0, abs(up - elevations[-1]) / 10.0, 1.0)
            knots_s += [start_s, start_s + lasting]
            angles += [angles[-1], turn]
            elevations += [elevations[-1], up]
        motor = np.interp(edges, knots_s, angles)
        elevation = np.interp(0.5 * (edges[1:] + edges[:-1]), knots_s, elevations)
        moving = (np.diff(motor) != 0.0) | (np.diff(elevation, append=elevation[-1]) != 0.0)
        moving[1:] |= moving[:-1]
        return driven(motor, step_s), elevation, moving
    if programme.swings:
        since = np.clip(edges - 60.0, 0.0, 780.0)
        # from 0.03 Hz up to 0.15 Hz in 70 whole swings
        phase = 2.0 * math.pi * (0.03 * since + (70.0 - 0.03 * 780.0) * (since / 780.0) ** 2)
        motor = 14.0 * (1.0 - np.cos(phase)) + 120.0
        return driven(motor, step_s), elevation, np.zeros(len(elevation), bool)
    start_deg = rng.uniform(0.0, 360.0) if programme.rates else 90.0
    motor, moving = limited_rate(programme.rates, edges, _ACCELERATION_DPS2)
    return driven(start_deg + motor, step_s), elevation, moving


def _kept(edges_s: Array, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which rows a file has: bursts of 3 to 15 s are lost."""
    kept = np.ones(len(edges_s) - 1, bool)
    starts = rng.uniform(0.0, edges_s[-1], rng.poisson(edges_s[-1] / _BURSTS_S))
    for start_s in starts:
        kept[(edges_s[1:] > start_s) & (edges_s[1:] <= start_s + rng.uniform(3.0, 15.0))] = False
    return kept


def rows(unit: Unit, stage: Stage, true_dph: Array, rng: np.random.Generator) -> Array:
    """Return the logged output: a true rate with white noise, sway, flicker and a walk, counted in pulses."""
    sheet, inside = unit.sheet, unit.inside
    gaps_s = np.diff(stage.edges_s)
    white = 60.0 * sheet.arw_deg_per_sqrt_h * inside.get("coil_noise", 1.0) / np.sqrt(gaps_s)
    hiss = math.sqrt(1.0 - _SWAY_SHARE) * rng.standard_normal(len(gaps_s))
    rate = true_dph + white * (hiss + _sway(len(gaps_s), rng))
    flicker = (
        sheet.bias_instability_dph * inside.get("bearing_noise", 1.0) * math.sqrt(math.log(3.0) / math.pi)
    )
    rate = rate + sum(markov(flicker, float(time_s), gaps_s, rng) for time_s in FLICKER_S)
    rate = rate + walk(sheet.rate_random_walk_dph_per_sqrt_h * inside.get("pivot_creep", 1.0), gaps_s, rng)
    quantum = sheet.quantum_arcsec * inside.get("coarse_pulses", 1.0)
    # one deg/h is one arcsec a second
    counted = np.round((np.cumsum(rate * gaps_s) + rng.uniform(0.0, quantum)) / quantum) * quantum
    return np.asarray(np.diff(counted, prepend=0.0) / gaps_s)


def _sway(n: int, rng: np.random.Generator) -> Array:
    """Return an AR(2) process with the poles of the pier as the rows see them, its share of a unit variance."""
    a1, a2 = 2.0 * _SWAY_POLES.real, -(abs(_SWAY_POLES) ** 2)
    variance = (1.0 - a2) / ((1.0 + a2) * ((1.0 - a2) ** 2 - a1**2))
    kicks = rng.standard_normal(n + 50) * math.sqrt(_SWAY_SHARE / variance)
    return np.asarray(lfilter([1.0], [1.0, -a1, -a2], kicks)[50:])


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return the logged temperatures, in steps of 0.02 K with noise, and the encoder's angle."""

    def sensor(values_c: Array) -> Array:
        noisy = stage.in_rows(values_c) + rng.normal(0.0, 0.012, len(stage.valid))
        return np.asarray(np.round(noisy / 0.02) * 0.02)

    angle = np.round(stage.at_edges(stage.angle_deg) / _ENCODER_DEG) * _ENCODER_DEG
    return sensor(stage.t_in_c), sensor(stage.t_out_c), np.asarray(angle)


TUNED_ROTOR = Family(
    "tuned_rotor",
    LATITUDE_DEG,
    SHEET,
    Layout(".parquet", ("torquer_rate", "deg/s"), ("table", "deg"), "K"),
    EFFECTS,
    {
        "coil_noise": (1.5, 3.0, "noise_level"),
        "bearing_noise": (4.0, 12.0, "bias_instability"),
        "pivot_creep": (6.0, 25.0, "rate_random_walk"),
        "coarse_pulses": (5.0, 15.0, "quantisation"),
    },
    campaign,
    rows,
    read,
)
