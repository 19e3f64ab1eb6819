"""The ring-laser lab: a dithered laser gyro of three bodies on a geared table, logged as CSV in deg/s and
kelvin.

Heat: case, block and electronics exchange it by conduction, radiation (fourth powers) and free convection,
whose conductance grows with the fourth root of the difference (Incropera & DeWitt, ch. 9). Table: a position
loop that rings at 1.1 Hz with damping 0.25, cogging of order 12; its encoder reads what the table really
does. Noise: white, a first-order Markov process of 1200 s, a slow walk, a counter with a remainder
(Aronowitz, The Laser Gyro, 1971). Log: rows of 1 s, of 0.25 s in rate steps (rows are missing while the table
accelerates) and of 0.5 s in positions (NaN while the table moves); temperatures by a logger of 0.5 Hz in
steps of 0.02 K, interpolated to the rows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from benchmarks.gap_exam._family import Family, Layout, Sheet, Unit
from benchmarks.gap_exam._ring_laser_effects import EFFECTS, LATITUDE_DEG
from benchmarks.gap_exam._signals import drawn, follow, markov, walk
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K

SHEET = Sheet(0.0025, 0.003, 0.001, 0.05, 30.0, 0.03, 0.01)
MARKOV_S = 1200.0
RATES_DPS = (5.0, -5.0, 20.0, -20.0, 45.0, -45.0, 80.0, -80.0, 100.0, -100.0, 60.0, -60.0)
RATE_STEP_S, RAMP_DPS2 = 120.0, 25.0
SWING_S, SWING_DPS, SWING_PERIOD_S = 200.0, 30.0, 40.0
SLOW_DPH = (0.0, 20.0, -20.0, 5.0, -5.0, -12.0, 60.0, -60.0, 200.0, -200.0, -30.0, 0.0)
SLOW_STEP_S = 150.0
POSITION_S, MOVE_S = 110.0, 8.0
_HEADINGS = ((0, 0), (45, 0), (90, 0), (135, 0), (180, 0), (225, 0), (270, 0), (315, 0))
POSITIONS = (*_HEADINGS, (0, 90), (0, -90), (90, 90), (90, -90), (180, 0), (0, 0), (270, 0), (90, 0))
THERMAL_STEP_S = 2.0


@dataclass(frozen=True)
class _Profile:
    code: str
    name: str
    set_points: tuple[tuple[float, float], ...]
    """(time s, degC), joined linearly."""
    conditions: tuple[str, ...]
    row_s: float
    step_s: float
    repeats: int = 3
    judge: bool = False
    phases: tuple[tuple[str, float], ...] = (("run", 0.0),)

    @property
    def duration_s(self) -> float:
        return self.set_points[-1][0]


def _flat(duration_s: float) -> tuple[tuple[float, float], ...]:
    return (0.0, 23.0), (duration_s, 23.0)


_SHOCK = ((0, 23), (300, 23), (720, -33), (2520, -33), (3220, 58), (4720, 58), (5000, 23), (5800, 23))
_OTHER = ((0, 23), (200, 23), (900, 48), (2000, 48), (2500, 5), (3800, 5), (4400, -22), (5600, -22))
_SHOCK_PHASES = (
    ("room", 0.0),
    ("down", 300.0),
    ("cold", 720.0),
    ("up", 2520.0),
    ("hot", 3220.0),
    ("back", 4720.0),
)
PROFILES = (
    _Profile("CY", "two shocks", _SHOCK, ("level", "+15", "-15", "still"), 1.0, 0.25, phases=_SHOCK_PHASES),
    _Profile("LR", "long ramp", ((0, -38), (900, -38), (6200, 56)), ("level",), 1.0, 1.0),
    _Profile(
        "RT", "rate steps", _flat(len(RATES_DPS) * RATE_STEP_S + 60.0 + SWING_S), ("steps",), 0.25, 0.05
    ),
    _Profile("SL", "slow rates", _flat(len(SLOW_DPH) * SLOW_STEP_S), ("slow",), 1.0, 0.25),
    _Profile("PO", "positions", _flat(len(POSITIONS) * POSITION_S), ("sixteen",), 0.5, 0.1),
    _Profile("QU", "room", _flat(3600.0), ("level",), 1.0, 1.0, repeats=2),
    _Profile("OC", "other cycle", _OTHER, ("+15",), 1.0, 0.25, repeats=1, judge=True),
)


def campaign(unit: Unit) -> list[Stage]:
    """Return the runs in the order in which they were made: all conditions once, then again."""
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
        bodies = heat(np.stack([_air(profile, rng) for rng in rngs]), unit, rngs)
        for row, number in enumerate(numbers):
            own = {name: values[row] for name, values in bodies.items()}
            stages[number] = _stage(profile, plans[number][1], plans[number][2], number, own, rngs[row])
    return [stages[number] for number in range(len(plans))]


def _air(profile: _Profile, rng: np.random.Generator) -> Array:
    """Return the chamber's air on the thermal grid: it comes late, overshoots and wanders a little."""
    times, points = np.array(profile.set_points, dtype=np.float64).T
    now = np.arange(0.0, profile.duration_s + THERMAL_STEP_S, THERMAL_STEP_S)
    wanted = np.interp(now - rng.normal(0.0, 8.0), times, points + rng.normal(0.0, 0.3))
    late = follow(wanted, 35.0, THERMAL_STEP_S)
    return np.asarray(
        late + 0.05 * (wanted - late) + markov(0.06, 80.0, np.full(len(now), THERMAL_STEP_S), rng)
    )


def heat(air: Array, unit: Unit, rngs: list[np.random.Generator]) -> dict[str, Array]:
    """Return temperatures (runs, k) of case, block and board, degC, from the air's."""
    spread = unit.draw
    case_j, block_j, board_j = 420.0 * (0.85 + 0.3 * spread["c1"]), 620.0 * (0.85 + 0.3 * spread["c2"]), 110.0
    to_block, board_w = 1.7 * (0.8 + 0.4 * spread["g1"]), 3.5
    warm = np.array([rng.uniform(0.6, 1.0) for rng in rngs])  # how far self-heating had come at the start
    outside = air + ZERO_CELSIUS_K
    case, block = outside[:, 0] + 1.5 * warm, outside[:, 0] + 2.5 * warm
    board = case + 6.0 * warm
    result = {name: np.empty_like(air) for name in ("case", "block", "board")}
    for k in range(air.shape[1]):
        result["case"][:, k], result["block"][:, k], result["board"][:, k] = case, block, board
        cold = outside[:, k] - case
        in_w = (1.1 + 0.35 * np.abs(cold) ** 0.25) * cold + _radiated(outside[:, k], case, 0.05)
        over_w = to_block * (case - block) + _radiated(case, block, 0.02)
        off_w = 0.45 * (board - case)
        across_w = 0.12 * (board - block)
        case = case + THERMAL_STEP_S / case_j * (in_w - over_w + off_w)
        block = block + THERMAL_STEP_S / block_j * (over_w + across_w)
        board = board + THERMAL_STEP_S / board_j * (board_w - off_w - across_w)
    return {name: values - ZERO_CELSIUS_K for name, values in result.items()} | {"air": air}


def _radiated(hot_k: Array, cold_k: Array, area_m2: float) -> Array:
    return np.asarray(0.8 * 5.670374e-8 * area_m2 * (hot_k**4 - cold_k**4))


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
    angle, elevation, moving = _table(profile, condition, steps, rng)
    edges = np.arange(0.0, profile.duration_s + 1e-9, profile.row_s)
    of_row = np.add.reduceat(moving, np.arange(0, steps, round(profile.row_s / profile.step_s))) > 0
    still: NDArray[np.bool_] = ~of_row
    code = profile.code + ("ABCD"[profile.conditions.index(condition)] if len(profile.conditions) > 1 else "")
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
        t_in_c=lifted["block"],
        t_out_c=lifted["case"],
        edges_s=edges,
        valid=still,
        # in rate steps the logger drops rows while the table accelerates, in positions it writes NaN
        kept=still if profile.code == "RT" else np.ones(len(still), dtype=bool),
        phases=profile.phases,
        power_on_s=float(np.round(rng.uniform(60.0, 900.0), 1)),
        held_out=repeat == 2 or profile.judge,
    )


def _table(
    profile: _Profile, condition: str, steps: int, rng: np.random.Generator
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return true angle at edges, elevation, and where the table changes its rate or moves."""
    step_s = profile.step_s
    moving = np.zeros(steps, dtype=bool)
    start = float(rng.uniform(0.0, 360.0))
    if condition == "level":
        return np.full(steps + 1, 90.0), np.zeros(steps), moving
    up = np.full(steps, 90.0)
    if condition == "sixteen":
        return _positions(steps, step_s)
    if condition == "slow":
        wanted = np.repeat(np.array(SLOW_DPH) / 3600.0, round(SLOW_STEP_S / step_s))
        rate = follow(wanted, 0.4, step_s)
    elif condition == "steps":
        level = np.repeat((*RATES_DPS, 0.0, 0.0, 0.0), round(RATE_STEP_S / step_s))[:steps]
        rate = _ringing(_ramped(np.insert(level, 0, 0.0)[:-1], RAMP_DPS2 * step_s), step_s)
        # the table swings at the end, slowly enough for the logger
        swing = round(SWING_S / step_s)
        turn = 2.0 * math.pi * np.arange(swing) * step_s / SWING_PERIOD_S
        level[-swing:] = rate[-swing:] = SWING_DPS * np.sin(turn)
        moving = np.abs(rate - level) > 1e-3 * np.maximum(np.abs(level), 1.0)
    else:
        rate = np.full(steps, 0.0 if condition == "still" else float(condition))
    angle = start + np.concatenate(([0.0], np.cumsum(rate * step_s)))
    # cogging: the motor's torque ripples, the loop holds it to a few arcsec
    cogging = 3.0 / 3600.0 * np.sin(12.0 * np.radians(angle) + 0.3)
    wander = markov(2e-5, 4.0, np.full(steps, step_s), rng) * np.abs(rate)
    drift = np.concatenate(([0.0], np.cumsum(wander * step_s)))
    return angle + (cogging + drift if np.abs(rate).max() > 0.0 else 0.0), up, moving


def _ramped(wanted: Array, most: float) -> Array:
    """Return a rate that changes by at most `most` a step."""
    out, value = np.empty(len(wanted)), 0.0
    for k, target in enumerate(wanted.tolist()):
        value += min(max(target - value, -most), most)
        out[k] = value
    return out


def _ringing(wanted: Array, step_s: float) -> Array:
    """Return what a loop of 1.1 Hz and damping 0.25 makes of a rate."""
    w, z = 2.0 * math.pi * 1.1, 0.25
    pole = math.exp(-z * w * step_s)
    middle = 2.0 * pole * math.cos(w * math.sqrt(1.0 - z * z) * step_s)
    return np.asarray(lfilter([1.0 - middle + pole * pole], [1.0, -middle, pole * pole], wanted))


def _positions(steps: int, step_s: float) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Return a table that goes from position to position, the axis tumbled at the start of each where it must."""
    edges = np.arange(steps + 1) * step_s
    at = np.minimum((edges / POSITION_S).astype(np.int64), len(POSITIONS) - 1)
    angles = np.unwrap(np.array([a for a, _ in POSITIONS], dtype=np.float64), period=360.0)
    part = np.clip((edges - at * POSITION_S) / (MOVE_S - 1.0), 0.0, 1.0)
    before = angles[np.maximum(at - 1, 0)]
    angle = before + (angles[at] - before) * 0.5 * (1.0 - np.cos(np.pi * part))
    elevation = np.array([e for _, e in POSITIONS], dtype=np.float64)[at[:-1]]
    moving = (edges[:-1] - at[:-1] * POSITION_S < MOVE_S) & (at[:-1] > 0)
    return np.asarray(angle), elevation, moving


def rows(unit: Unit, stage: Stage, rate_dph: Array, rng: np.random.Generator) -> Array:
    """Return the gyro's output: noise on the true rate, counted in whole quanta of angle."""
    sheet, factor, gaps = unit.sheet, unit.inside, np.diff(stage.edges_s)
    white = 60.0 * sheet.arw_deg_per_sqrt_h * factor.get("arw", 1.0) / np.sqrt(gaps)
    total = rate_dph + white * rng.standard_normal(len(gaps))
    total = total + markov(sheet.bias_instability_dph * factor.get("drift", 1.0), MARKOV_S, gaps, rng)
    total = total + walk(sheet.rate_random_walk_dph_per_sqrt_h * factor.get("walk", 1.0), gaps, rng)
    quantum = sheet.quantum_arcsec * factor.get("counter", 1.0)
    counted = np.floor(np.concatenate(([0.0], np.cumsum(total * gaps))) / quantum + rng.uniform()) * quantum
    return np.asarray(np.diff(counted) / gaps)


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return what the log has of both temperatures, (n,), and of the angle, (n + 1,)."""
    ends = stage.edges_s[1:]
    sampled = np.arange(0.0, ends[-1] + 2.0, 2.0)

    def logged(true_c: Array) -> Array:
        felt = np.interp(sampled, stage.time_s, true_c) + 0.008 * rng.standard_normal(len(sampled))
        return np.asarray(
            np.interp(ends - 0.5 * np.diff(stage.edges_s), sampled, np.round(felt / 0.02) * 0.02)
        )

    angle = stage.at_edges(stage.angle_deg)
    if stage.turning:
        angle = np.round((angle * 3600.0 + 0.008 * rng.standard_normal(len(angle))) / 0.01) * 0.01 / 3600.0
    return logged(stage.t_in_c), logged(stage.t_out_c), angle


RING_LASER = Family(
    name="ring_laser",
    latitude_deg=LATITUDE_DEG,
    sheet=SHEET,
    layout=Layout(".csv", ("omega_deg_s", "deg/s"), ("table_deg", "deg"), "K"),
    effects=EFFECTS,
    noisy={
        "arw": (1.4, 3.0, "noise_level"),
        "drift": (4.0, 12.0, "bias_instability"),
        "walk": (15.0, 60.0, "rate_random_walk"),
        "counter": (4.0, 16.0, "quantisation"),
    },
    campaign=campaign,
    rows=rows,
    read=read,
)
