"""The MEMS lab: a tactical gyro in a package whose heat spreads in two dimensions, logged as Parquet in rad/s.

Heat: the equation of conduction on 12 x 8 nodes with a die that heats itself, convection on all sides
(Incropera & DeWitt, ch. 5), the lower side against a fixture of its own capacity. Stress: a chain of three
Maxwell elements behind the mismatch of die and frame. Noise: white coloured by an AR(2) filter of the output
stage, 1/f as a sum of relaxations two octaves apart (van der Ziel 1950), a random walk. Log: rows of 0.1,
0.5, 0.8, 1 and 2 s whose stamps jitter by 3 %, some rows lost; NaN while a position is taken up.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.gap_exam._family import Family, Layout, Sheet, Unit
from benchmarks.gap_exam._mems_effects import EFFECTS, LATITUDE_DEG
from benchmarks.gap_exam._signals import drawn, follow, markov, walk
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

SHEET = Sheet(0.06, 0.25, 0.1, 0.0, 300.0, 4.0, 3.0)
AR2, OUTPUT_S = (0.3, -0.3), 0.1
"""Coefficients of the output stage's filter from one of its samples to the next, and the time between them."""
RELAXATIONS_S = 4.0 ** np.arange(0.0, 8.0)
LEVELS_DPS = (0.0, 10.0, -10.0, 40.0, -40.0, 90.0, -90.0, 150.0, -150.0, 220.0, -220.0, 300.0, -300.0, 0.0)
LEVEL_S = 95.0
SWEEP_S, SWING_DPS = 900.0, 60.0
TUMBLE_S, TAKE_UP_S = 64.0, 9.0
TUMBLES = (
    *((30 * k, 0) for k in range(12)),
    *((0, e) for e in (30, 60, 90, -30, -60, -90)),
    *((90, e) for e in (90, 45, -45, -90)),
    (180, 0),
    (0, 0),
)
THERMAL_STEP_S = 2.0
_NODES = (12, 8)
_JITTER = 0.03


@dataclass(frozen=True)
class _Profile:
    code: str
    name: str
    set_points: tuple[tuple[float, float], ...]
    conditions: tuple[str, ...]
    row_s: float
    step_s: float
    repeats: int = 3
    judge: bool = False

    @property
    def duration_s(self) -> float:
        return self.set_points[-1][0]


def _room(duration_s: float) -> tuple[tuple[float, float], ...]:
    return (0.0, 28.0), (duration_s, 28.0)


_TRIANGLE = ((0, 28), (1280, 75), (4280, -35), (6000, 28))
_STAIRS = ((0, 28), (600, 50), (1500, 50), (1900, 66), (2800, 66), (3900, 8), (4800, 8), (5600, -20))
PROFILES = (
    _Profile("TR", "triangle", _TRIANGLE, ("north", "+60", "-60", "up"), 0.8, 0.2),
    _Profile("RA", "slow climb", ((0, -38), (600, -38), (7000, 78)), ("north",), 2.0, 1.0),
    _Profile("RS", "levels", _room(len(LEVELS_DPS) * LEVEL_S), ("levels",), 0.1, 0.02),
    _Profile("SW", "sweep", _room(SWEEP_S), ("swing",), 0.1, 0.02),
    _Profile("TU", "tumble", _room(len(TUMBLES) * TUMBLE_S), ("twenty-four",), 0.5, 0.1),
    _Profile("QU", "room", _room(5400.0), ("north",), 1.0, 1.0, repeats=2),
    _Profile("ST", "stairs", _STAIRS, ("+60",), 0.8, 0.2, repeats=1, judge=True),
)


def campaign(unit: Unit) -> list[Stage]:
    """Return the runs in the order in which they were made: condition by condition, all repeats in turn."""
    plans = [
        (profile, condition, repeat)
        for repeat in range(3)
        for profile in PROFILES
        for condition in profile.conditions
        if repeat < profile.repeats
    ]
    stages: dict[int, Stage] = {}
    for profile in PROFILES:
        numbers = [number for number, plan in enumerate(plans) if plan[0] is profile]
        rngs = [drawn(unit.seed, "run", number) for number in numbers]
        bodies = heat(np.stack([_air(profile, rng) for rng in rngs]), unit)
        for row, number in enumerate(numbers):
            own = {name: values[row] for name, values in bodies.items()}
            stages[number] = _stage(profile, plans[number][1], plans[number][2], number, own, rngs[row])
    return [stages[number] for number in range(len(plans))]


def _air(profile: _Profile, rng: np.random.Generator) -> Array:
    """Return the chamber's air: a controller of second order, on and off by 0.3 K while it cools."""
    times, points = np.array(profile.set_points, dtype=np.float64).T
    now = np.arange(0.0, profile.duration_s + THERMAL_STEP_S, THERMAL_STEP_S)
    late = np.interp(now - rng.normal(0.0, 12.0), times, points + rng.normal(0.0, 0.5, len(points)))
    w, z = 2.0 * math.pi / 260.0 * THERMAL_STEP_S, 0.75
    pole = math.exp(-z * w)
    middle = 2.0 * pole * math.cos(w * math.sqrt(1.0 - z * z))
    response, _ = lfilter(
        [1.0 - middle + pole * pole], [1.0, -middle, pole * pole], late - late[0], zi=[0.0, 0.0]
    )
    switching = 0.15 * np.sign(np.sin(2.0 * math.pi * now / 140.0 + rng.uniform(0.0, 6.0)))
    cooling = np.gradient(late) < -1e-3
    return np.asarray(late[0] + response + follow(switching * cooling, 30.0, THERMAL_STEP_S))


def heat(air: Array, unit: Unit) -> dict[str, Array]:
    """Return temperatures (runs, k) of die, frame, lid and fixture from explicit finite differences."""
    across, down = _NODES
    step, spread = THERMAL_STEP_S, unit.draw
    mix = step * 1.1e-6 * (0.8 + 0.4 * spread["c1"]) / 0.005**2
    loss = step * 3.2e-3 * (0.8 + 0.4 * spread["c2"])
    to_fixture, fixture_s = step * 4.0e-3, 900.0
    own_heat = np.zeros((across, down))
    own_heat[5:7, 3:5] = step * 7e-3
    body = np.repeat(air[:, :1], across * down, axis=1).reshape(-1, across, down)
    body = body + 2.0 + 3.0 * (own_heat > 0.0)
    fixture = air[:, 0].copy()
    out = {name: np.empty_like(air) for name in ("die", "frame", "lid", "fixture")}
    for k in range(air.shape[1]):
        out["die"][:, k] = body[:, 5:7, 3:5].mean(axis=(1, 2))
        out["frame"][:, k] = 0.5 * (body[:, 1, 3:5].mean(axis=1) + body[:, -2, 3:5].mean(axis=1))
        out["lid"][:, k] = body[:, 5:7, -1].mean(axis=1)
        out["fixture"][:, k] = fixture
        now = air[:, k, None]
        change = np.zeros_like(body)
        sideways, upwards = np.diff(body, axis=1), np.diff(body, axis=2)
        change[:, :-1] += sideways
        change[:, 1:] -= sideways
        change[:, :, :-1] += upwards
        change[:, :, 1:] -= upwards
        change *= mix
        change[:, 0] += loss * (now - body[:, 0])
        change[:, -1] += loss * (now - body[:, -1])
        change[:, :, -1] += loss * (now - body[:, :, -1])
        change[:, :, 0] += to_fixture * (fixture[:, None] - body[:, :, 0])
        fixture = (
            fixture + step / fixture_s * (air[:, k] - fixture) + 0.02 * (body[:, :, 0].mean(axis=1) - fixture)
        )
        body = body + change + own_heat
    return out | {"air": air}


def _stage(
    profile: _Profile,
    condition: str,
    repeat: int,
    number: int,
    bodies: dict[str, Array],
    rng: np.random.Generator,
) -> Stage:
    steps = round(profile.duration_s / profile.step_s)
    middle = (np.arange(steps) + 0.5) * profile.step_s
    grid = np.arange(len(bodies["air"])) * THERMAL_STEP_S
    lifted = {name: np.interp(middle, grid, values) for name, values in bodies.items()}
    angle, elevation, moving = _table(condition, steps, profile.step_s, rng)
    edges = np.arange(0.0, profile.duration_s + 1e-9, profile.row_s)
    edges[1:-1] += np.clip(rng.normal(0.0, _JITTER / 2.0, len(edges) - 2), -_JITTER, _JITTER) * profile.row_s
    rows = len(edges) - 1
    moved = np.concatenate(([0.0], np.cumsum(moving)))
    at = np.arange(steps + 1) * profile.step_s
    valid = np.diff(np.interp(edges, at, moved)) < 1e-9
    code = profile.code + ("NPMU"[profile.conditions.index(condition)] if len(profile.conditions) > 1 else "")
    return Stage(
        code=code,
        profile=profile.name,
        condition=condition,
        repeat=repeat,
        number=number,
        step_s=profile.step_s,
        angle_deg=angle,
        elevation_deg=elevation,
        bodies_c=lifted,
        t_in_c=lifted["die"],
        t_out_c=lifted["lid"],
        edges_s=edges,
        valid=valid,
        kept=_not_lost(rows, rng),
        phases=(("run", 0.0),),
        power_on_s=float(np.round(rng.uniform(20.0, 300.0), 1)),
        held_out=repeat == 2 or profile.judge,
    )


def _not_lost(rows: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which rows the logger kept: it loses one to three at a time, about one in two thousand."""
    kept = np.ones(rows, dtype=bool)
    for start in rng.integers(1, rows - 4, rng.poisson(rows / 4000.0)).tolist():
        kept[start : start + int(rng.integers(1, 4))] = False
    return kept


def _table(
    condition: str, steps: int, step_s: float, rng: np.random.Generator
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return true angle at edges, elevation, and where a position is being taken up."""
    still, up = np.zeros(steps, dtype=bool), np.full(steps, 90.0)
    if condition == "north":
        return np.zeros(steps + 1), np.zeros(steps), still
    if condition == "twenty-four":
        return _tumbled(steps, step_s)
    time = (np.arange(steps) + 0.5) * step_s
    if condition == "levels":
        wanted = np.repeat(LEVELS_DPS, round(LEVEL_S / step_s)).astype(np.float64)
        rate = _limited_jerk(wanted, step_s)
    elif condition == "swing":
        # 0.01 to 0.12 Hz about an axis across the input axis, as cross-axis sensitivity is tested
        turns = 0.01 * time + 0.5 * (0.12 - 0.01) / SWEEP_S * time**2
        rate = SWING_DPS * np.sin(2.0 * math.pi * turns)
        up = np.zeros(steps)
    else:
        rate = np.full(steps, 0.0 if condition == "up" else float(condition))
    slow = 3e-5 * np.abs(rate) * np.sin(2.0 * math.pi * time / 37.0 + rng.uniform(0.0, 6.0))
    start = float(rng.uniform(0.0, 360.0))
    return start + np.concatenate(([0.0], np.cumsum((rate + slow) * step_s))), up, still


def _limited_jerk(wanted: Array, step_s: float) -> Array:
    """Return a rate that goes to each level along half a cosine of 2.5 s."""
    rate, length = wanted.copy(), round(2.5 / step_s)
    for start in (np.flatnonzero(np.diff(wanted)) + 1).tolist():
        part = 0.5 * (1.0 - np.cos(np.pi * np.arange(length) / length))
        rate[start : start + length] = wanted[start - 1] + (wanted[start] - wanted[start - 1]) * part
    return rate


def _tumbled(steps: int, step_s: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    edges = np.arange(steps + 1) * step_s
    at = np.minimum((edges / TUMBLE_S + 1e-9).astype(np.int64), len(TUMBLES) - 1)
    angles = np.unwrap(np.array([a for a, _ in TUMBLES], dtype=np.float64), period=360.0)
    elevations = np.array([e for _, e in TUMBLES], dtype=np.float64)
    part = np.clip((edges - at * TUMBLE_S) / (TAKE_UP_S - 2.0), 0.0, 1.0)
    before = np.maximum(at - 1, 0)
    angle = angles[before] + (angles[at] - angles[before]) * part
    elevation = elevations[before] + (elevations[at] - elevations[before]) * part
    moving = (edges[:-1] - at[:-1] * TUMBLE_S < TAKE_UP_S) & (at[:-1] > 0)
    return np.asarray(angle), np.asarray(elevation[1:]), moving


def rows(unit: Unit, stage: Stage, rate_dph: Array, rng: np.random.Generator) -> Array:
    """Return the gyro's output: coloured white noise, 1/f noise and a walk on the true rate; steps if coarse."""
    sheet, factor, gaps = unit.sheet, unit.inside, np.diff(stage.edges_s)
    white = 60.0 * sheet.arw_deg_per_sqrt_h * factor.get("arw", 1.0) / math.sqrt(OUTPUT_S)
    kicks = white * (1.0 - sum(AR2)) * rng.standard_normal(round(stage.edges_s[-1] / OUTPUT_S) + 1)
    angle = np.cumsum(lfilter([1.0], [1.0, -AR2[0], -AR2[1]], kicks)) * OUTPUT_S
    coloured = np.diff(np.interp(stage.edges_s, np.arange(len(angle)) * OUTPUT_S, angle)) / gaps
    flicker = sheet.bias_instability_dph * factor.get("flicker", 1.0) * math.sqrt(math.log(4.0) / math.pi)
    total = (
        rate_dph + coloured + walk(sheet.rate_random_walk_dph_per_sqrt_h * factor.get("walk", 1.0), gaps, rng)
    )
    for time_s in RELAXATIONS_S.tolist():
        total = total + markov(flicker, time_s, gaps, rng)
    if "resolution" in factor:
        quantum = factor["resolution"] * 60.0 * sheet.arw_deg_per_sqrt_h
        whole = np.concatenate(([0.0], np.cumsum(total * gaps)))
        total = np.diff(np.floor(whole / quantum + rng.uniform()) * quantum) / gaps
    return np.asarray(_held(total, factor.get("held", 0.0), rng))


def _held(output: Array, share: float, rng: np.random.Generator) -> Array:
    """Return an output in which a share of the rows repeats the one before: frames lost in the logger."""
    index = np.arange(len(output))
    for start in rng.integers(1, len(output) - 5, rng.poisson(len(output) * share / 2.0)).tolist():
        index[start : start + int(rng.integers(1, 4))] = start - 1
    return output[np.minimum.accumulate(index[::-1])[::-1]] if share else output


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return what the log has of both temperatures, (n,), and of the angle, (n + 1,)."""
    count = len(stage.edges_s) - 1
    die = stage.in_rows(stage.t_in_c) + 0.02 * rng.standard_normal(count)
    lid = stage.in_rows(stage.t_out_c) + 0.03 * rng.standard_normal(count)
    angle = stage.at_edges(stage.angle_deg)
    if stage.turning:
        angle = angle + 0.05 / 3600.0 * rng.standard_normal(count + 1)
    return np.round(die / 0.0625) * 0.0625, np.round(lid, 2), angle


MEMS = Family(
    name="mems",
    latitude_deg=LATITUDE_DEG,
    sheet=SHEET,
    layout=Layout(".parquet", ("rate_rad_s", "rad/s"), ("table_rad", "rad")),
    effects=EFFECTS,
    noisy={
        "arw": (1.4, 3.0, "noise_level"),
        "flicker": (2.5, 8.0, "bias_instability"),
        "walk": (15.0, 60.0, "rate_random_walk"),
        "resolution": (0.5, 5.0, "quantisation"),
        "held": (0.002, 0.03, "lost_frames"),
    },
    campaign=campaign,
    rows=rows,
    read=read,
)
