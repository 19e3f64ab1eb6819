"""The bench of the tuning-fork gyros: a servo table in a chamber, the heat of the board, the campaign."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from benchmarks.gap_exam._campaign import (
    Rates,
    Sort,
    at_rest,
    demands,
    in_rounds,
    motor_deg,
    to_and_fro,
)
from benchmarks.gap_exam._family import Unit
from benchmarks.gap_exam._signals import drawn, follow
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

LATITUDE_DEG = 48.74
ENCODER_DEG = 1e-4
FASTEST_DPS = 250.0
DPS2 = 120.0
SETTLES_S = 1.5
SERVO_HZ, SERVO_DAMPING = 2.5, 0.8
TICK_S = 1.0 / 64.0
"""The tool closes a row at a tick of the computer's timer: rows of 0.2 s have 12 or 13 ticks."""

CAPACITY_J_PER_K: Mapping[str, float] = {
    "fixture": 450.0,  # half a kilogram of aluminium
    "board": 12.0,  # with the regulator
    "package": 0.6,  # ceramic with lid
    "asic": 0.02,
    "quartz": 0.004,  # the fork on its foot, in vacuum
}
BODIES = tuple(CAPACITY_J_PER_K)
CONDUCTANCE_W_PER_K: Mapping[tuple[str, str], float] = {
    ("air", "fixture"): 0.9,
    ("air", "board"): 0.06,
    ("air", "package"): 0.004,
    ("fixture", "board"): 0.5,
    ("board", "package"): 0.04,
    ("package", "asic"): 0.012,
    ("package", "quartz"): 1.2e-4,
}
POWER_W: Mapping[str, float] = {"board": 0.25, "asic": 0.045}
"""The linear regulator's loss and the ASIC's own, from power-up on."""
PT100_S = 8.0

CHAMBER_PER_S, CHAMBER_DAMPING = 1.0 / 40.0, 0.7
COMPRESSOR_S = 150.0
COMPRESSOR_K = 0.4
"""How far the air falls while the compressor runs on, above what its share of time does."""


def bodies(air_c: Array, step_s: float, powered_s: float) -> dict[str, Array]:
    """Return the bodies' temperatures at the middles of steps for air (m,), degC, (m,) each.

    Before the run the air was as at first for long, and power was on for `powered_s`. Exact for air that is
    constant in a step: the network's modes are followers.
    """
    capacity = np.array(list(CAPACITY_J_PER_K.values()))
    size = len(BODIES)
    flow, to_air = np.zeros((size, size)), np.zeros(size)
    for (one, other), conductance in CONDUCTANCE_W_PER_K.items():
        j = BODIES.index(other)
        flow[j, j] += conductance
        if one == "air":
            to_air[j] = conductance
            continue
        i = BODIES.index(one)
        flow[i, i] += conductance
        flow[i, j] -= conductance
        flow[j, i] -= conductance
    power = np.array([POWER_W.get(name, 0.0) for name in BODIES])
    root = np.sqrt(capacity)
    per_s, modes = np.linalg.eigh(flow / np.outer(root, root))
    by_air, by_power = (modes.T @ (heat / root) / per_s for heat in (to_air, power))
    ends = by_air[:, None] * air_c + by_power[:, None]
    temperatures: Array | float = 0.0
    for k in range(size):
        start = ends[k, 0] - by_power[k] * math.exp(-per_s[k] * powered_s)
        decay, half = math.exp(-per_s[k] * step_s), math.exp(-0.5 * per_s[k] * step_s)
        after = lfilter([1.0 - decay], [1.0, -decay], ends[k], zi=[decay * start])[0]
        before = np.concatenate(([start], after[:-1]))
        middle = half * before + (1.0 - half) * ends[k]
        temperatures = temperatures + np.outer(modes[:, k] / root, middle)
    return dict(zip(BODIES, np.asarray(temperatures), strict=True))


def compressor_share(demand_c: Array) -> Array:
    """Return the share of time that the compressor runs at a demand, (m,): at 25 degC it dries air."""
    return np.asarray(np.clip(0.2 + (15.0 - demand_c) / 80.0, 0.0, 0.9))


def compressor_runs(demand_c: Array, step_s: float, phase_s: float) -> Array:
    """Return 1 where the compressor runs and 0 where it stands, (m,): `phase_s` of a cycle was over at first."""
    into = np.mod((np.arange(len(demand_c)) + 0.5) * step_s + phase_s, COMPRESSOR_S) / COMPRESSOR_S
    return np.asarray(into < compressor_share(demand_c), dtype=float)


def compressor_phase_s(unit: Unit, key: str) -> float:
    """Return where in its cycle the compressor is at the start of the run of a key."""
    return float(drawn(unit.seed, "compressor", key).uniform(0.0, COMPRESSOR_S))


def chamber_air(demand_c: Array, step_s: float, phase_s: float) -> Array:
    """Return the air of the chamber (m,), degC: a controller of second order, and the compressor's cycle."""
    w, z = CHAMBER_PER_S, CHAMBER_DAMPING
    above = _filtered([w * w], [1.0, 2.0 * z * w, w * w], demand_c - demand_c[0], step_s)
    cycle = compressor_runs(demand_c, step_s, phase_s) - compressor_share(demand_c)
    return np.asarray(demand_c[0] + above - COMPRESSOR_K * follow(cycle, 30.0, step_s))


def servo_deg(asked_deg: Array, step_s: float) -> Array:
    """Return where a servo with velocity feed-forward stands for an angle asked for, (m + 1,): no lag at a steady
    rate, an overshoot after a change of rate.
    """
    w, z = 2.0 * math.pi * SERVO_HZ, SERVO_DAMPING
    moved = _filtered([2.0 * z * w, w * w], [1.0, 2.0 * z * w, w * w], asked_deg - asked_deg[0], step_s)
    return np.asarray(asked_deg[0] + moved)


def _filtered(numerator: list[float], denominator: list[float], values: Array, step_s: float) -> Array:
    """Return the response to values that are joined by straight lines, from rest."""
    above, below, _ = cont2discrete((numerator, denominator), step_s, method="foh")
    return np.asarray(lfilter(above.ravel(), below, values))


def row_edges(seconds: float, row_s: float) -> Array:
    """Return the rows' edges: the last tick of the timer before each is due."""
    due = np.arange(math.floor(seconds / row_s + 1e-9) + 1) * row_s
    return np.asarray(np.floor(due / TICK_S + 1e-9) * TICK_S)


def steady(rates: Rates, edges_s: Array) -> NDArray[np.bool_]:
    """Return the rows in which the table neither changes its rate nor settles after that, (n,)."""
    free, speed = np.ones(len(edges_s) - 1, bool), 0.0
    for begin, rate in rates:
        end = begin + abs(rate - speed) / DPS2 + SETTLES_S
        free &= (edges_s[1:] <= begin) | (edges_s[:-1] >= end)
        speed = rate
    return free


def stairs(start_s: float, levels_dps: tuple[float, ...], each_s: float) -> list[tuple[float, float]]:
    """Return rates: each level in turn and its opposite, the table at rest between them."""
    rates, at = [], start_s
    for level in levels_dps:
        for rate in (level, -level):
            rates += [(at, rate), (at + each_s, 0.0)]
            at += 2.0 * each_s
    return rates


def _level_turns() -> Rates:
    return [(30.0, 2.0), (390.0, 30.0), (570.0, 0.0), (600.0, -30.0), (780.0, -2.0), (1140.0, 0.0)]


def _rates_at_three_temperatures() -> Rates:
    return [rate for minute in _PLATEAUS for rate in stairs(60.0 * minute + 60.0, (50.0, 150.0, 250.0), 45.0)]


def _drives() -> Rates:
    return [*to_and_fro(300.0, 1500.0, 80.0, 160.0), *to_and_fro(2400.0, 3600.0, 80.0, 160.0)]


_PLATEAUS = (0.0, 50.0, 99.0)
_PLATEAU_MINUTES = 12.0
_SOAK_MINUTES = 10.0
"""What is logged of a soak before the table starts."""
_WARMED = (5400.0, 9000.0)
_ROOM = ((0.0, 25.0),)
_QUICK, _COMMON, _SLOW = (0.05, 4), (0.1, 5), (0.5, 2)
# up and down in turn at the end: drift is told from gravity
_POSITIONS = (
    (0.0, 90.0), (300.0, 0.0), (1320.0, -90.0), (1620.0, 45.0), (1920.0, -45.0),
    (2220.0, 90.0), (2520.0, -90.0), (2820.0, 90.0), (3120.0, -90.0),
)  # fmt: skip

SORTS = (
    Sort(
        "TC", "temperature cycle", "axis up", 142.0,
        ((10.0, 25.0), (28.0, 80.0), (48.0, 80.0), (86.0, -35.0), (106.0, -35.0), (126.0, 25.0)),
        grid=_SLOW, powered_s=_WARMED,
    ),
    Sort(
        "TS", "temperature soak", "axis up", 184.0,
        tuple(
            (4.0 + 20.0 * k + hold, level)
            for k, level in enumerate((25.0, 45.0, 65.0, 45.0, 25.0, 5.0, -15.0, 5.0, 25.0))
            for hold in (0.0, 10.0)
        ),
        grid=_SLOW, powered_s=_WARMED,
    ),
    Sort("CU", "power-up", "-20 degC", 40.0, ((0.0, -20.0),), grid=_SLOW, powered_s=(2.0, 6.0)),
    Sort("WU", "power-up", "25 degC", 40.0, _ROOM, 2, grid=_SLOW, powered_s=(2.0, 6.0)),
    Sort(
        "RS", "rate steps", "25 degC", 14.0, _ROOM,
        turns=lambda: stairs(20.0, (10.0, 25.0, 50.0, 100.0, 150.0, 200.0, 250.0), 25.0),
        grid=_QUICK, masks=True, powered_s=_WARMED,
    ),
    Sort(
        "RT", "rate steps", "-30, 25 and 70 degC", 111.0,
        ((_PLATEAU_MINUTES, -30.0), (31.0, 25.0), (62.0, 25.0), (77.0, 70.0)),
        turns=_rates_at_three_temperatures, grid=_COMMON, masks=True, powered_s=_WARMED,
    ),
    Sort(
        "SW", "rate sweeps", "sectors of 120 deg", 15.0, _ROOM,
        turns=lambda: [*to_and_fro(20.0, 440.0, 60.0, 120.0), *to_and_fro(460.0, 880.0, 30.0, 120.0)],
        grid=_QUICK, powered_s=_WARMED,
    ),
    Sort(
        "PT", "positions", "25 degC", 57.0, _ROOM,
        turns=lambda: [move for at in (550.0, 800.0, 1050.0) for move in ((at, 30.0), (at + 3.0, 0.0))],
        elevation=_POSITIONS, grid=_SLOW, masks=True, powered_s=_WARMED,
    ),
    Sort(
        "LT", "level turns", "25 degC", 20.0, _ROOM, 2,
        turns=_level_turns, elevation=((0.0, 0.0),), grid=_COMMON, powered_s=_WARMED,
    ),
    Sort(
        "DC", "drive", "-10 to 55 degC", 70.0,
        ((2.0, 25.0), (14.0, 55.0), (24.0, 55.0), (46.0, -10.0)), 2, 2,
        turns=_drives, grid=_COMMON, powered_s=_WARMED,
    ),
)  # fmt: skip


def campaign(unit: Unit, lost: float = 0.0) -> list[Stage]:
    """Return the runs of a unit; `lost` is the share of rows that the tool loses."""
    return in_rounds(SORTS, lambda sort, k, number: _run(unit, sort, k, number, lost))


def _run(unit: Unit, sort: Sort, repeat: int, number: int, lost: float) -> Stage:
    rng = drawn(unit.seed, "run", sort.code, repeat)
    seconds = 60.0 * sort.minutes
    step_s, per_row = sort.grid
    powered_s = float(rng.uniform(*sort.powered_s))
    # somebody starts program and log by hand, within half a minute; the chamber is calibrated to 0.3 K
    late_min, off_k = rng.uniform(0.0, 0.5), rng.normal(0.0, 0.3)
    demand = demands([(at + late_min, value + off_k) for at, value in sort.chamber], seconds, step_s)
    key = f"{sort.code}|{repeat}"
    air = chamber_air(demand, step_s, compressor_phase_s(unit, key))
    felt = bodies(air, step_s, powered_s)
    rates = sort.turns()
    edges: Array = np.arange(round(seconds / step_s) + 1.0) * step_s
    mounted_s, elevation = sort.elevations(edges[:-1] + 0.5 * step_s)
    # the table is referenced for positions only; else it starts where it stood
    start_deg = 0.0 if len(mounted_s) else ENCODER_DEG * round(rng.uniform(0.0, 360.0) / ENCODER_DEG)
    written = row_edges(seconds, step_s * per_row)
    valid = np.ones(len(written) - 1, bool)
    if sort.masks:
        valid = at_rest(rates, mounted_s, written, SETTLES_S) if len(mounted_s) else steady(rates, written)
    kept = _logged(sort, written)
    valid &= kept
    return Stage(
        code=sort.code,
        profile=sort.profile,
        condition=sort.condition,
        repeat=repeat,
        number=number,
        step_s=step_s,
        angle_deg=servo_deg(motor_deg(rates, edges, start_deg, DPS2), step_s),
        elevation_deg=elevation,
        bodies_c={**felt, "air": air, "demand": demand},
        t_in_c=felt["asic"],
        t_out_c=follow(felt["fixture"], PT100_S, step_s),
        edges_s=written,
        valid=valid,
        kept=kept & ~overrun(len(kept), lost, drawn(unit.seed, "overrun", key)),
        phases=(("run", 0.0),),
        power_on_s=powered_s,
        held_out=repeat >= sort.repeats - sort.held_out,
    )


def _logged(sort: Sort, edges_s: Array) -> NDArray[np.bool_]:
    """Return which rows the tool wrote: where rates are tested hot and cold it stands still in between."""
    if sort.code != "RT":
        return np.ones(len(edges_s) - 1, bool)
    begins_s = 60.0 * np.array(_PLATEAUS)[:, None]
    return np.asarray(
        (
            (edges_s[:-1] >= begins_s - 60.0 * _SOAK_MINUTES)
            & (edges_s[1:] <= begins_s + 60.0 * _PLATEAU_MINUTES)
        ).any(axis=0)
    )


def overrun(count: int, share: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which of so many rows were lost, (count,): a full buffer loses one to seven rows at once."""
    lost = np.zeros(count, bool)
    # the first row stays, as a log begins with it; overlaps make the share a little smaller
    for begin in np.flatnonzero(rng.uniform(size=count) < share / 4.0):
        lost[max(begin, 1) : begin + int(rng.integers(1, 8))] = True
    return lost
