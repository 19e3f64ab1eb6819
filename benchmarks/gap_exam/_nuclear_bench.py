"""The bench of the nuclear resonance gyros: a chamber cooled by nitrogen, an air-bearing table, a head.

The chamber's valve opens in windows of 20 s and its probe is late: air ripples in the cold and overshoots
after ramps. Inside the gyro an oven holds the cell at 110 degC and a heater the laser at 62 degC, both with a
finite gain. A programmable controller latches encoder and counter at the end of a scan.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline
from scipy.signal import cont2discrete, lfilter

from benchmarks.gap_exam._campaign import Rates, Sort, at_rest, demands, in_rounds, motor_deg
from benchmarks.gap_exam._family import Unit
from benchmarks.gap_exam._signals import drawn, follow
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

LATITUDE_DEG = 38.27
LAB_C = 23.0
THERMAL_S = 2.0
NODES = {
    "base": 5200.0,
    "frame": 380.0,
    "shield_a": 140.0,
    "shield_b": 120.0,
    "former": 60.0,
    "oven": 8.0,
    "laser": 15.0,
    "board": 55.0,
}
"""Heat capacities, J/K. The shield has two halves; the former carries the field coils."""
_TO_AIR_W_PER_K = {"base": 5.0, "frame": 0.8, "board": 0.05}
_LINKS_W_PER_K = {
    ("base", "frame"): 3.0,
    ("frame", "shield_a"): 0.6,
    ("frame", "shield_b"): 0.32,
    ("shield_a", "former"): 0.14,
    ("shield_b", "former"): 0.10,
    ("former", "oven"): 0.012,
    ("frame", "laser"): 0.2,
    ("laser", "oven"): 0.003,
    ("frame", "board"): 0.5,
}
BOARD_W, COILS_W = 1.8, 0.12
OVEN_C, OVEN_W_PER_K, OVEN_RESET_S, OVEN_MOST_W = 110.0, 0.5, 90.0, 6.0
OVEN_SEES_FORMER = 0.03
"""Share of the former in what the oven's thermistor feels: the cell errs by it."""
LASER_C, LASER_W_PER_K, LASER_MOST_W = 62.0, 0.9, 20.0
DPS2 = 30.0
LOOP_HZ, LOOP_DAMPING = 3.1, 0.8
COGS, COG_ARCSEC = 40, 0.08
SCAN_S = 0.012
ROW_S = 0.5
SLIPS_DPS = 25.0
"""A change of rate beyond it makes the phase loops slip: no output until they hold again."""
CALIBRATION_S, CALIBRATES_S = 1200.0, 6.0
FLUSH_S = 1800.0
POLARISED_S = 300.0
"""After switching on, spins give no phase so long."""

_CALM = (0.25, 2)
_QUICK = (0.1, 5)
_LEVEL = ((0.0, 0.0),)
_TRIANGLE = ((0.0, 20.0), (20.0, 20.0), (85.0, -15.0), (110.0, -15.0), (215.0, 48.0), (240.0, 48.0))
_STEPS = (
    (0.0, 35.0),
    (30.0, 35.0),
    (33.0, 12.0),
    (85.0, 12.0),
    (88.0, -8.0),
    (140.0, -8.0),
    (146.0, 45.0),
    (200.0, 45.0),
)
_CLIMB = ((0.0, -8.0), (15.0, -8.0), (95.0, 44.0), (110.0, 44.0), (135.0, 24.0))
_FLIGHT = ((0.0, 25.0), (20.0, 25.0), (50.0, -5.0), (90.0, -5.0), (105.0, 18.0), (125.0, 38.0), (150.0, 38.0))


def legs(rates_dps: tuple[float, ...], begin_s: float, leg_s: float, pause_s: float) -> Rates:
    """Return legs at rates, with a pause at rest after each."""
    steps = []
    for k, rate in enumerate(rates_dps):
        at = begin_s + k * (leg_s + pause_s)
        steps += [(at, rate), (at + leg_s, 0.0)]
    return steps


def ladder() -> Rates:
    """Return rates up and down a ladder, first one way, then the other."""
    up = (0.1, 0.3, 1.0, 3.0, 5.0, 8.0, 15.0, 30.0, 60.0)
    return legs((*up, *(-rate for rate in reversed(up))), 240.0, 80.0, 30.0)


def carousel() -> Rates:
    """Return slow turns of a level axis, each way at three rates."""
    return [
        (180.0, 0.5),
        (1620.0, -0.5),
        (3060.0, 2.0),
        (3600.0, -2.0),
        (4140.0, 6.0),
        (4440.0, -6.0),
        (4740.0, 0.0),
    ]


def headings() -> Rates:
    """Return moves by 45 degrees, a turn and back."""
    return [
        step
        for k in range(16)
        for step in ((330.0 * (k + 1), 9.0 if k < 8 else -9.0), (330.0 * (k + 1) + 5.0, 0.0))
    ]


def climbing() -> Rates:
    """Return legs all through a change of temperature."""
    return legs((10.0, -10.0, 2.0, -2.0, 20.0, -20.0) * 5, 400.0, 60.0, 190.0)


def flight() -> Rates:
    """Return legs as of a flight that no other run has."""
    return legs((4.0, -12.0, 18.0, 0.7, -4.0, 12.0, -18.0, -0.7), 1000.0, 120.0, 800.0)


def _at(celsius: float, minutes: float) -> tuple[tuple[float, float], ...]:
    return ((0.0, celsius), (minutes, celsius))


_POSITIONS = tuple(
    (480.0 * k, elevation)
    for k, elevation in enumerate((90.0, 60.0, 30.0, 0.0, -30.0, -60.0, -90.0, -45.0, 0.0, 45.0, 90.0))
)
SORTS = (
    Sort("TU", "triangle", "axis up", 240.0, _TRIANGLE, grid=_CALM),
    Sort("TW", "triangle", "axis west", 240.0, _TRIANGLE, 2, elevation=_LEVEL, start_deg=90.0, grid=_CALM),
    Sort("SD", "steps", "axis down", 200.0, _STEPS, elevation=((0.0, -90.0),), grid=_CALM),
    Sort("PU", "power-up", "axis up", 120.0, _at(21.0, 120.0), grid=_CALM, powered_s=(0.0, 0.0)),
    Sort("LR", "ladder", "21 degC", 37.0, _at(21.0, 37.0), turns=ladder, grid=_QUICK),
    Sort("LC", "ladder", "-10 degC", 37.0, _at(-10.0, 37.0), turns=ladder, grid=_QUICK, repeats=2),
    Sort("LH", "ladder", "46 degC", 37.0, _at(46.0, 37.0), turns=ladder, grid=_QUICK, repeats=2),
    Sort("CL", "climb", "axis up", 135.0, _CLIMB, turns=climbing, grid=_QUICK),
    Sort(
        "CA", "carousel", "22 degC", 82.0, _at(22.0, 82.0), 2, turns=carousel, elevation=_LEVEL, grid=_QUICK
    ),
    Sort("PO", "positions", "22 degC", 88.0, _at(22.0, 88.0), elevation=_POSITIONS, grid=_CALM, masks=True),
    Sort(
        "HD",
        "headings",
        "22 degC",
        94.0,
        _at(22.0, 94.0),
        2,
        turns=headings,
        elevation=_LEVEL,
        grid=_QUICK,
        masks=True,
    ),
    Sort("QU", "quiet", "axis up", 240.0, _at(22.0, 240.0), 2, grid=_CALM),
    Sort("FL", "flight", "axis up", 150.0, _FLIGHT, 1, 1, turns=flight, grid=_QUICK),
)


def campaign(unit: Unit, lost: float) -> list[Stage]:
    """Return the runs of a unit; `lost` is the share of rows that never reach the file, by ones and twos."""
    return in_rounds(SORTS, lambda sort, repeat, number: _stage(unit, sort, repeat, number, lost))


def _stage(unit: Unit, sort: Sort, repeat: int, number: int, lost: float) -> Stage:
    rng = drawn(unit.seed, "nuclear", sort.code, repeat)
    step_s = sort.grid[0]
    steps = round(60.0 * sort.minutes / step_s)
    rates = sort.turns()
    angle = table_deg(rates, np.asarray(np.arange(steps + 1) * step_s), sort.start_deg, step_s)
    middles = np.asarray((np.arange(steps) + 0.5) * step_s)
    mounted_s, elevation = sort.elevations(middles)
    powered_s = float(rng.uniform(*sort.powered_s))
    bodies = _bodies(sort, middles, powered_s, rng)
    edges = _row_edges(steps * step_s, rng)
    valid = _valid(edges, rates, powered_s, rng)
    if sort.masks:
        valid &= at_rest(rates, mounted_s, edges, 12.0)
    moves = [60.0 * begin for (begin, low), (_, high) in pairwise(sort.chamber) if low != high]
    return Stage(
        code=sort.code,
        profile=sort.profile,
        condition=sort.condition,
        repeat=repeat,
        number=number,
        step_s=step_s,
        angle_deg=angle,
        elevation_deg=elevation,
        bodies_c=bodies,
        t_in_c=follow(0.6 * bodies["frame"] + 0.4 * bodies["shield_a"], 10.0, step_s),
        t_out_c=follow(0.8 * bodies["base"] + 0.2 * bodies["air"], 5.0, step_s),
        edges_s=edges,
        valid=valid,
        kept=_kept(edges, lost, rng),
        phases=(("soak", 0.0), *(("profile", at) for at in moves[:1])),
        power_on_s=powered_s,
        held_out=repeat >= sort.repeats - sort.held_out,
    )


def table_deg(rates: Rates, edges_s: Array, start_deg: float, step_s: float) -> Array:
    """Return the table's true angle at edges (m + 1,): a loop without zeros behind the demand, and its cogs.

    Air bearings do not stick; the magnets' cogs are what a finite gain leaves, and the encoder sees them.
    """
    bow = 2.0 * np.pi * LOOP_HZ
    b, a, _ = cont2discrete(([bow**2], [1.0, 2.0 * LOOP_DAMPING * bow, bow**2]), step_s, method="foh")
    angle = start_deg + lfilter(np.ravel(b), a, motor_deg(rates, edges_s, start_deg, DPS2) - start_deg)
    wave = np.sin(COGS * np.radians(angle)) + 0.4 * np.cos(3 * COGS * np.radians(angle))
    return np.asarray(angle + COG_ARCSEC / 3600.0 * wave)


def _row_edges(seconds: float, rng: np.random.Generator) -> Array:
    """Return the edges of the rows (n + 1,): the end of the scan in which a period ran out."""
    rows = int(seconds / ROW_S) - 2
    due = rng.uniform(0.0, 0.3) + ROW_S * (1.0 + 4e-5 * rng.standard_normal()) * np.arange(rows + 1)
    scans = np.ceil(due / SCAN_S) + (rng.uniform(size=rows + 1) < 0.01)
    return np.asarray(np.round(scans * SCAN_S, 6))


def _valid(edges_s: Array, rates: Rates, powered_s: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which rows have an output: not before spins are up, in calibrations, after slips."""
    into = (edges_s[1:] + rng.uniform(0.0, CALIBRATION_S)) % CALIBRATION_S
    valid = (into > CALIBRATES_S) & (powered_s + edges_s[:-1] > POLARISED_S)
    before = 0.0
    for at, rate in rates:
        jump = abs(rate - before)
        before = rate
        if jump > SLIPS_DPS:
            valid &= (edges_s[1:] < at) | (edges_s[:-1] > at + jump / DPS2 + 4.0)
    return np.asarray(valid)


def _kept(edges_s: Array, lost: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which rows the file has: some go missing when the buffer is written to disk."""
    into = (edges_s[1:] + rng.uniform(0.0, FLUSH_S)) % FLUSH_S
    gone = into < rng.uniform(1.2, 3.0)
    # a loss takes the next row along in one of two cases
    first = rng.uniform(size=len(into)) < lost / 1.5
    gone |= first
    gone[1:] |= first[:-1] & (rng.uniform(size=len(into) - 1) < 0.5)
    return np.asarray(~gone)


def _bodies(sort: Sort, middles: Array, powered_s: float, rng: np.random.Generator) -> dict[str, Array]:
    """Return temperatures on the fine grid (m,), degC, and the oven's power, W."""
    air = chamber(demands(sort.chamber, 60.0 * sort.minutes, THERMAL_S), rng)
    made = gyro(air, LAB_C if powered_s == 0.0 else None, float(1.0 + 0.02 * rng.standard_normal()))
    coarse = (np.arange(len(air)) + 0.5) * THERMAL_S
    within = np.clip(middles, coarse[0], coarse[-1])
    return {name: np.asarray(CubicSpline(coarse, values)(within)) for name, values in made.items()}


def chamber(demand_c: Array, rng: np.random.Generator) -> Array:
    """Return a chamber's air, degC, at steps of THERMAL_S (n,): it has soaked at the first demand.

    The controller sees a probe that is 14 s late. Heat is continuous; nitrogen comes by a valve that is open
    for a part of each window of 20 s, for 2 s at least.
    """
    air = probe = float(demand_c[0])
    wall = (4.0 * air + LAB_C) / 5.0
    total = (air - wall) / 500.0
    window, opened = 10, 0
    draught = 0.003 * rng.standard_normal(len(demand_c))
    result = np.empty(len(demand_c))
    for k, wanted in enumerate(demand_c.tolist()):
        slope = (air - probe) / 14.0
        probe += THERMAL_S * slope
        power = 0.012 * (wanted - probe) + total - 0.05 * slope
        if -0.11 < power < 0.09:
            total += THERMAL_S * 3e-5 * (wanted - probe)
        if k % window == 0:
            opened = min(round(window * max(-power, 0.0) / 0.11), window)
        cold = 0.11 if k % window < opened else 0.0
        gain = min(max(power, 0.0), 0.09) - cold
        wall += THERMAL_S * ((air - wall) / 2100.0 + (LAB_C - wall) / 8400.0)
        air += THERMAL_S * (gain - (air - wall) / 500.0) + draught[k]
        result[k] = air
    return result


def gyro(air_c: Array, cold_c: float | None, heat: float) -> dict[str, Array]:
    """Return the gyro's temperatures, degC, and `oven_w` at steps of THERMAL_S, by the trapezoidal rule.

    It has settled at the first air, or was off in a room of `cold_c`. `heat` scales what the board takes.
    """
    names = list(NODES)
    at = {name: k for k, name in enumerate(names)}
    flow, given = np.zeros((len(names), len(names))), np.zeros(len(names))
    for (one, other), watts in _LINKS_W_PER_K.items():
        for i, j in ((at[one], at[other]), (at[other], at[one])):
            flow[i, i] -= watts
            flow[i, j] += watts
    for name, watts in _TO_AIR_W_PER_K.items():
        flow[at[name], at[name]] -= watts
        given[at[name]] += watts
    capacity = np.array(list(NODES.values()))
    half = 0.5 * THERMAL_S * flow / capacity[:, None]
    left = np.linalg.inv(np.eye(len(names)) - half)
    advance, push = left @ (np.eye(len(names)) + half), left * (THERMAL_S / capacity)
    fixed = np.zeros(len(names))
    fixed[at["board"]], fixed[at["former"]] = BOARD_W * heat, COILS_W
    held, laser, former = at["oven"], at["laser"], at["former"]
    if cold_c is None:
        state, total = _settled(flow, given * air_c[0] + fixed, held, laser, former)
    else:
        state, total = np.full(len(names), cold_c), 0.0
    pushed, by_oven, by_laser = np.outer(air_c, push @ given) + push @ fixed, push[:, held], push[:, laser]
    result, power = np.empty((len(air_c), len(names))), np.empty(len(air_c))
    for k in range(len(air_c)):
        felt = (1.0 - OVEN_SEES_FORMER) * state[held] + OVEN_SEES_FORMER * state[former]
        asked = OVEN_W_PER_K * (OVEN_C - felt) + total
        watts = min(max(asked, 0.0), OVEN_MOST_W)
        if watts == asked:
            total += THERMAL_S * OVEN_W_PER_K * (OVEN_C - felt) / OVEN_RESET_S
        warms = min(max(LASER_W_PER_K * (LASER_C - state[laser]), 0.0), LASER_MOST_W)
        state = advance @ state + pushed[k] + by_oven * watts + by_laser * warms
        result[k], power[k] = state, watts
    return {"air": air_c, "oven_w": power, **dict(zip(names, result.T, strict=True))}


def _settled(flow: Array, given: Array, held: int, laser: int, former: int) -> tuple[Array, float]:
    """Return temperatures (n,), degC, and the oven's power, W, that stay under given heat (n,), W."""
    n = len(given)
    system, wanted = np.zeros((n + 1, n + 1)), np.zeros(n + 1)
    system[:n, :n], wanted[:n] = -flow, given
    system[laser, laser] += LASER_W_PER_K
    wanted[laser] += LASER_W_PER_K * LASER_C
    system[held, n] = -1.0
    system[n, held], system[n, former], wanted[n] = 1.0 - OVEN_SEES_FORMER, OVEN_SEES_FORMER, OVEN_C
    found = np.linalg.solve(system, wanted)
    return np.asarray(found[:n]), float(found[n])
