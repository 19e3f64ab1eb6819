"""An acceptance lab with a resonant fibre gyro: its campaign, its noise and how it logs.

Light circles in a closed ring of fibre; the difference of its two resonances is the rate (Sagnac; Ezekiel and
Balsamo, Appl. Phys. Lett. 30, 478, 1977). Rows come by hardware trigger every 0.2 to 2 s, moves are blanked.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap_exam._family import Family, Layout, Sheet, Unit
from benchmarks.gap_exam._resonant_fibre_bench import (
    HEAT_STEP_S,
    Knots,
    Ring,
    heated,
    refined,
    servo,
    swung,
    turned,
    visited,
)
from benchmarks.gap_exam._resonant_fibre_effects import EFFECTS
from benchmarks.gap_exam._resonant_fibre_foreign import LATITUDE_DEG
from benchmarks.gap_exam._signals import drawn, follow
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

SHEET = Sheet(0.009, 0.025, 0.015, 0.49, 120.0, 0.7, 0.3)
_REPEATS = 3
_SETTLING_S = 6.0
_ENCODER_DEG = 360.0 / 2**28
_LOSSES_S = 6000.0
_ROOM_C = 25.0


@dataclass(frozen=True)
class Programme:
    """A procedure: set points of the air (minute, degC) joined by lines, and what table and trunnion do.

    `fluid`: those of the fluid through the mounting plate, if it flows.
    """

    code: str
    profile: str
    condition: str
    seconds: float
    air: Knots = ((0.0, _ROOM_C),)
    fluid: Knots = ()
    start_deg: float = 0.0
    elevation_deg: float = 90.0
    rates: Knots = ()
    dps2: float = 60.0
    waves: tuple[tuple[float, float, float, float, int], ...] = ()
    positions: tuple[tuple[float, float, float], ...] = ()
    grid: tuple[float, int] = (0.5, 2)
    power_on_s: float = 3600.0
    masked: bool = False
    unseen: bool = False


_STEPS_DPS = (0.004, 0.012, 0.03, 0.1, 0.3, 1.0, 3.0, 10.0, 25.0, 50.0, 80.0, 120.0)
_HEADINGS = (0.0, 90.0, 180.0, 270.0, 45.0, 225.0, 135.0, 315.0)
_TUMBLE = (90.0, 60.0, 30.0, 0.0, -30.0, -60.0, -90.0, -45.0, 45.0)
_OVER_TEMPERATURE = (
    (0.0, 25.0),
    (8.0, 25.0),
    (16.0, 60.0),
    (50.0, 60.0),
    (70.0, -30.0),
    (114.0, -30.0),
    (122.0, 25.0),
)


def _both_ways(start_s: float, stay_s: float, rates: Sequence[float]) -> tuple[tuple[float, float], ...]:
    """Return each rate in both directions, and standstill at the end."""
    signed = [sign * rate for rate in rates for sign in (1.0, -1.0)]
    return (
        *((start_s + stay_s * k, rate) for k, rate in enumerate(signed)),
        (start_s + stay_s * len(signed), 0.0),
    )


def _visits(stay_s: float, places: Sequence[tuple[float, float]]) -> tuple[tuple[float, float, float], ...]:
    return tuple((stay_s * k, turn, up) for k, (turn, up) in enumerate(places))


_PLACES = (
    *((turn, 0.0) for turn in _HEADINGS),
    *((turn, 90.0) for turn in _HEADINGS[:4]),
    *((turn, -90.0) for turn in _HEADINGS[:4]),
)
_TUMBLES = (*((20.0, up) for up in _TUMBLE), *((110.0, up) for up in _TUMBLE))

PROGRAMMES = (
    Programme(
        "CS", "cold shock", "up", 6600.0,
        ((0.0, 25.0), (8.0, 25.0), (8.1, -32.0), (58.0, -32.0), (58.1, 25.0)), power_on_s=2400.0,
    ),
    Programme(
        "SR", "slow ramp", "level", 11400.0,
        ((0.0, 25.0), (5.0, 25.0), (45.0, 34.0), (65.0, 34.0), (155.0, 6.0), (175.0, 6.0)),
        ((0.0, 25.0), (5.0, 25.0), (45.0, 67.0), (65.0, 67.0), (155.0, -42.0), (175.0, -42.0)),
        90.0, 0.0, grid=(0.5, 4), power_on_s=1800.0,
    ),
    Programme(
        "RS", "rate steps", "both", 1230.0, rates=_both_ways(60.0, 48.0, _STEPS_DPS), grid=(0.1, 5),
        masked=True,
    ),
    Programme(
        "SI", "sine rates", "up", 720.0, start_deg=120.0, grid=(0.05, 4),
        waves=((30.0, 0.05, 0.05, 50.0, 8), (210.0, 0.2, 0.2, 40.0, 30), (380.0, 0.04, 0.5, 6.0, 80)),
    ),
    Programme(
        "MP", "positions", "sixteen", 3200.0, positions=_visits(200.0, _PLACES), grid=(0.25, 4), masked=True
    ),
    Programme(
        "TB", "tumble", "trunnion", 2880.0, positions=_visits(160.0, _TUMBLES), grid=(0.25, 4), masked=True
    ),
    Programme(
        "LR", "long rest", "level", 10800.0, start_deg=270.0, elevation_deg=0.0, grid=(0.5, 4),
        power_on_s=90.0,
    ),
    Programme(
        "ST", "scale factor", "over temperature", 8400.0, _OVER_TEMPERATURE,
        rates=_both_ways(60.0, 60.0, (60.0,) * 68), grid=(0.2, 5), power_on_s=2700.0,
    ),
    Programme("FR", "reversals", "fast", 620.0, rates=_both_ways(20.0, 4.0, (20.0, 45.0, 80.0) * 24),
              dps2=150.0, grid=(0.05, 4)),
    Programme(
        "DD", "day's duty", "up", 5400.0,
        ((0.0, 25.0), (10.0, 25.0), (22.0, 47.0), (45.0, 47.0), (62.0, -14.0)), (), 30.0, 90.0,
        ((900.0, 15.0), (1500.0, 0.0), (2400.0, -35.0), (3300.0, 0.0), (4000.0, 5.0), (4900.0, 0.0)),
        grid=(0.2, 5), unseen=True,
    ),
)  # fmt: skip


def campaign(unit: Unit) -> list[Stage]:
    """Return the runs in the order in which they are made: each procedure three times, the unseen twice."""
    order = [
        (programme, repeat)
        for repeat in range(_REPEATS)
        for programme in PROGRAMMES
        if repeat < _REPEATS - programme.unseen
    ]
    rngs = [drawn(unit.seed, "resonant", programme.code, repeat) for programme, repeat in order]
    longest = max(programme.seconds + programme.power_on_s for programme, _ in order)
    since_s = np.arange(0.0, longest + 2.0 * HEAT_STEP_S, HEAT_STEP_S)
    asked = np.stack([_set_points(each, each.air, since_s) for each, _ in order], axis=1)
    fluid = np.stack([_set_points(each, each.fluid, since_s) for each, _ in order], axis=1)
    beside = np.array([rng.normal(0.0, 0.2) for rng in rngs])
    pace = np.array([rng.normal(1.0, 0.04) for rng in rngs])
    ring = Ring(0.8 + 0.6 * unit.draw["c1"], 3.0 + 2.5 * unit.draw["c2"])
    heat = heated(asked + beside, fluid + beside, pace, ring)
    return [
        _stage(programme, repeat, number, {name: values[:, number] for name, values in heat.items()}, rng)
        for number, ((programme, repeat), rng) in enumerate(zip(order, rngs, strict=True))
    ]


def _set_points(programme: Programme, points: Knots, since_s: Array) -> Array:
    """Return set points at times since power-on, NaN without any."""
    if not points:
        return np.full(len(since_s), np.nan)
    return np.asarray(np.interp((since_s - programme.power_on_s) / 60.0, *np.array(points).T))


def _stage(
    programme: Programme, repeat: int, number: int, heat: dict[str, Array], rng: np.random.Generator
) -> Stage:
    step_s, steps_a_row = programme.grid
    row_count = round(programme.seconds / step_s / steps_a_row)
    edges = np.asarray(np.arange(row_count * steps_a_row + 1) * step_s, np.float64)
    angle, elevation, moving = _motion(programme, edges, rng)
    valid, kept = np.ones(row_count, bool), _kept(row_count, step_s * steps_a_row, rng)
    if programme.masked:
        settling = np.convolve(moving, np.ones(round(_SETTLING_S / step_s)))[: len(moving)] > 0.5
        valid &= ~settling.reshape(row_count, steps_a_row).any(axis=1)
    # after a loss the counter has what was missed as well
    valid[1:] &= kept[1:] <= kept[:-1]
    middles = np.asarray(programme.power_on_s + edges[:-1] + 0.5 * step_s)
    bodies = {name: refined(values, middles) for name, values in heat.items()}
    phases = tuple((f"air {celsius:g}", 60.0 * minute) for minute, celsius in programme.air)
    return Stage(
        programme.code, programme.profile, programme.condition, repeat, number, step_s, angle, elevation,
        bodies, follow(bodies["hub"], 8.0, step_s), follow(bodies["can"], 5.0, step_s), edges[::steps_a_row],
        valid, kept, phases, programme.power_on_s, programme.unseen or repeat == _REPEATS - 1,
    )  # fmt: skip


def _motion(
    programme: Programme, edges: Array, rng: np.random.Generator
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return true angle at edges, elevation in the steps, and in which the table is sent elsewhere."""
    still = np.zeros(len(edges) - 1, bool)
    elevation = np.full(len(still), programme.elevation_deg)
    if programme.positions:
        return visited(programme.positions, edges)
    if programme.waves:
        return servo(programme.start_deg + swung(programme.waves, edges), programme.grid[0]), elevation, still
    if programme.rates:
        start_deg = programme.start_deg if programme.unseen else rng.uniform(0.0, 360.0)
        angle, moving = turned(programme.rates, edges, start_deg, programme.dps2)
        return angle, elevation, moving
    return np.full(len(edges), programme.start_deg), elevation, still


def _kept(count: int, period_s: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which rows a file has: now and then one to four are lost."""
    kept = np.ones(count, bool)
    for start in rng.integers(1, count - 5, rng.poisson(count * period_s / _LOSSES_S)):
        kept[start : start + rng.integers(1, 5)] = False
    return kept


def rows(unit: Unit, stage: Stage, true_dph: Array, rng: np.random.Generator) -> Array:
    """Return the logged output: a true rate with shot noise, flicker and a walk, in counts of a fringe."""
    sheet, inside = unit.sheet, unit.inside
    period_s, count = float(stage.edges_s[1] - stage.edges_s[0]), len(true_dph)
    white = 60.0 * sheet.arw_deg_per_sqrt_h * inside.get("photons", 1.0) / math.sqrt(period_s)
    rate = true_dph + white * rng.standard_normal(count)
    rate = rate + flicker_dph(
        sheet.bias_instability_dph * inside.get("laser_flicker", 1.0), count, period_s, rng
    )
    kick = sheet.rate_random_walk_dph_per_sqrt_h * inside.get("ring_walk", 1.0) * math.sqrt(period_s / 3600.0)
    rate = rate + np.cumsum(kick * rng.standard_normal(count))
    quantum = sheet.quantum_arcsec * inside.get("coarse_counter", 1.0)
    # one deg/h is one arcsec a second
    counted = np.floor(np.concatenate(([0.0], np.cumsum(rate * period_s))) / quantum + rng.uniform())
    return np.asarray(np.diff(counted) * quantum / period_s)


def flicker_dph(level_dph: float, count: int, period_s: float, rng: np.random.Generator) -> Array:
    """Return noise of the two-sided density level^2 / (2 pi f), by Fourier synthesis."""
    length = 4 * count
    hertz = np.fft.rfftfreq(length, period_s)[1:]
    size = level_dph * np.sqrt(length / period_s / (2.0 * math.pi * hertz) / 2.0)
    waves = size * (rng.standard_normal(len(hertz)) + 1j * rng.standard_normal(len(hertz)))
    return np.asarray(np.fft.irfft(np.concatenate(([0.0], waves)), length)[:count])


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return the logged temperatures, in steps of 0.01 K with noise, and the encoder's angle."""

    def sensor(values_c: Array) -> Array:
        noisy = stage.in_rows(values_c) + rng.normal(0.0, 0.008, len(stage.valid))
        return np.asarray(np.round(noisy / 0.01) * 0.01)

    angle = np.round(stage.at_edges(stage.angle_deg) / _ENCODER_DEG) * _ENCODER_DEG
    return sensor(stage.t_in_c), sensor(stage.t_out_c), np.asarray(angle)


RESONANT_FIBRE = Family(
    "resonant_fibre",
    LATITUDE_DEG,
    SHEET,
    Layout(".parquet", ("omega", "rad/s"), ("table_pos", "deg"), "degC"),
    EFFECTS,
    {
        "photons": (1.5, 3.0, "noise_level"),
        "laser_flicker": (4.0, 12.0, "bias_instability"),
        "ring_walk": (6.0, 25.0, "rate_random_walk"),
        "coarse_counter": (5.0, 15.0, "quantisation"),
    },
    campaign,
    rows,
    read,
)
