"""The bench of the floated gyros: chamber with a compressor that cycles, heavy plate, table, tumbling mount.

The gyro has no heater: float and fluid follow the flange, and the wheel and the torquer warm them.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.signal import cont2discrete, lfilter

from benchmarks.gap_exam._campaign import Rates, Sort, at_rest, demands, in_rounds, motor_deg, to_and_fro
from benchmarks.gap_exam._family import Unit
from benchmarks.gap_exam._signals import drawn, follow
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

LATITUDE_DEG = 42.36
ROOM_C = 22.0
THERMAL_S = 2.0
BODIES = ("plate", "case", "bell_a", "bell_b", "fluid", "float")
_CAPACITY_J_PER_K = np.array([9000.0, 420.0, 65.0, 58.0, 52.0, 74.0])
_TO_AIR_W_PER_K = np.array([6.0, 0.5, 0.10, 0.04, 0.0, 0.0])
_LINKS_W_PER_K = {
    ("plate", "case"): 4.0,
    ("case", "bell_a"): 1.2,
    ("case", "bell_b"): 0.9,
    ("case", "fluid"): 0.8,
    ("bell_a", "fluid"): 0.35,
    ("bell_b", "fluid"): 0.25,
    ("fluid", "float"): 1.5,
}
WHEEL_W = 3.2
SPIN_UP_W = 9.0
SPIN_UP_S = 25.0
TORQUER_W = 0.9
"""Heat of the torquer at FASTEST_DPS; it goes with the square of the current, hence of the rate."""
FASTEST_DPS = 25.0
DPS2 = 18.0
SERVO_HZ = 2.2
SERVO_DAMPING = 0.62
SLOTS = 24
SLOT_ARCSEC = 0.05
ENCODER_DEG = 360.0 / 2**29
ROTATION_S = 3600.0
"""The logger begins a new file of its own once an hour and has no rows for some seconds."""

_SLOW = (0.4, 2)
_FAST = (0.1, 4)
_STAIRS = (
    (0.0, 22.0),
    (40.0, 22.0),
    (75.0, -12.0),
    (125.0, -12.0),
    (170.0, 30.0),
    (205.0, 30.0),
    (225.0, 50.0),
    (270.0, 50.0),
)
_SHOCK = ((0.0, 44.0), (30.0, 44.0), (32.0, -8.0), (85.0, -8.0), (87.0, 40.0), (150.0, 40.0))
_MISSION = ((0.0, 22.0), (15.0, 22.0), (55.0, 2.0), (80.0, 2.0), (110.0, 35.0), (140.0, 35.0))


def staircase() -> Rates:
    """Return legs of both signs, short enough for a slip ring to stay cool."""
    rates, begin = [], 300.0
    for rate in (0.5, -0.5, 2.0, -2.0, 5.0, -5.0, 10.0, -10.0, 16.0, -16.0, 25.0, -25.0):
        rates += [(begin, rate), (begin + 120.0, 0.0)]
        begin += 170.0
    return rates


def slow_sweeps() -> Rates:
    """Return sweeps near zero rate: what sticks shows there."""
    return [*to_and_fro(240.0, 1600.0, 0.02, 3.0), *to_and_fro(1700.0, 3300.0, 0.06, 9.0)]


def indexing() -> Rates:
    """Return twelve moves of 30 degrees, a dwell of seven minutes before each."""
    return [step for k in range(12) for step in ((420.0 * (k + 1), 10.0), (420.0 * (k + 1) + 3.0, 0.0))]


def mission() -> Rates:
    """Return a few legs amid changes of temperature."""
    begins = ((1500.0, 8.0), (1800.0, -8.0), (4200.0, 20.0), (4320.0, -3.0), (7500.0, -20.0), (7700.0, 3.0))
    return [step for at, rate in begins for step in ((at, rate), (at + 90.0, 0.0))]


_TUMBLE = tuple(
    (560.0 * k, elevation)
    for k, elevation in enumerate((0.0, 45.0, 90.0, 60.0, 30.0, 0.0, -30.0, -60.0, -90.0, -45.0, 0.0))
)
_LEVEL = ((0.0, 0.0),)


def _at(celsius: float, minutes: float) -> tuple[tuple[float, float], ...]:
    return ((0.0, celsius), (minutes, celsius))


SORTS = (
    Sort("SU", "stairs", "axis up", 270.0, _STAIRS, grid=_SLOW),
    Sort("SN", "stairs", "axis north", 270.0, _STAIRS, grid=_SLOW, elevation=_LEVEL),
    Sort("HU", "shock", "axis up", 150.0, _SHOCK, grid=_SLOW),
    Sort("HE", "shock", "axis east", 150.0, _SHOCK, grid=_SLOW, elevation=_LEVEL, start_deg=270.0),
    Sort("KU", "switch-on", "axis up", 110.0, _at(20.0, 110.0), grid=_SLOW, powered_s=(0.0, 0.0)),
    Sort("RA", "rates", "22 degC", 41.0, _at(22.0, 41.0), turns=staircase, grid=_FAST),
    Sort("RC", "rates", "-5 degC", 41.0, _at(-5.0, 41.0), turns=staircase, grid=_FAST),
    Sort("RH", "rates", "45 degC", 41.0, _at(45.0, 41.0), turns=staircase, grid=_FAST, repeats=2),
    Sort("SW", "sweeps", "22 degC", 56.0, _at(22.0, 56.0), turns=slow_sweeps, grid=_FAST, repeats=2),
    Sort("TU", "tumble", "22 degC", 102.0, _at(22.0, 102.0), elevation=_TUMBLE, grid=_SLOW, masks=True),
    Sort(
        "IX",
        "indexing",
        "axis level",
        92.0,
        _at(22.0, 92.0),
        turns=indexing,
        elevation=_LEVEL,
        grid=_FAST,
        masks=True,
    ),
    Sort("NI", "night", "axis east", 240.0, _at(21.0, 240.0), elevation=_LEVEL, start_deg=270.0, grid=_SLOW),
    Sort("MI", "mission", "axis up", 140.0, _MISSION, 1, 1, turns=mission, grid=_FAST),
)


def campaign(unit: Unit, lost: float) -> list[Stage]:
    """Return the runs of a unit; `lost` is the share of rows that never reach the file, one by one."""
    return in_rounds(SORTS, lambda sort, repeat, number: _stage(unit, sort, repeat, number, lost))


def _stage(unit: Unit, sort: Sort, repeat: int, number: int, lost: float) -> Stage:
    rng = drawn(unit.seed, "stage", sort.code, repeat)
    step_s, a_row = sort.grid
    steps = round(60.0 * sort.minutes / step_s)
    rates = sort.turns()
    edges_fine, middles = np.arange(steps + 1) * step_s, (np.arange(steps) + 0.5) * step_s
    angle = table_deg(rates, np.asarray(edges_fine), sort.start_deg, step_s)
    powered_s = float(rng.uniform(*sort.powered_s))
    bodies = _bodies(sort, angle, powered_s, rng)
    mounted_s, elevation = sort.elevations(np.asarray(middles))
    edges = _row_edges(steps * step_s, a_row * step_s, rng)
    valid = np.ones(len(edges) - 1, bool)
    if sort.masks:
        valid = at_rest(rates, mounted_s, edges, 25.0)
    changes = [minute for (minute, before), (_, after) in pairwise(sort.chamber) if before != after]
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
        t_in_c=follow(0.7 * bodies["bell_a"] + 0.3 * bodies["bell_b"], 12.0, step_s),
        t_out_c=follow(0.85 * bodies["plate"] + 0.15 * bodies["air"], 6.0, step_s),
        edges_s=edges,
        valid=valid,
        kept=_kept(edges, lost, rng),
        phases=(("hold", 0.0), *(("change", 60.0 * minute) for minute in changes[:1])),
        power_on_s=powered_s,
        held_out=repeat >= sort.repeats - sort.held_out,
    )


def table_deg(rates: Rates, edges_s: Array, start_deg: float, step_s: float) -> Array:
    """Return the table's true angle at edges (m + 1,): a loop of the second type after the motor's demand.

    The slots of the motor pull at it while it turns; the encoder sees what they do.
    """
    demand = motor_deg(rates, edges_s, start_deg, DPS2)
    bow = 2.0 * np.pi * SERVO_HZ
    damp = 2.0 * SERVO_DAMPING * bow
    # the demand is straight between edges
    b, a, _ = cont2discrete(([damp, bow**2], [1.0, damp, bow**2]), step_s, method="foh")
    angle = start_deg + np.asarray(lfilter(np.ravel(b), a, demand - start_deg))
    return np.asarray(angle + SLOT_ARCSEC / 3600.0 * np.sin(SLOTS * np.radians(angle)))


def _row_edges(seconds: float, period_s: float, rng: np.random.Generator) -> Array:
    """Return the edges of the rows (n + 1,): a desktop computer's timer, late by some ms, at times by more."""
    begin = rng.uniform(0.0, 0.05)
    rows = int((seconds - begin - 0.3) / period_s)
    late = np.minimum(np.abs(rng.normal(0.0, 0.003, rows + 1)), 0.02)
    late += np.where(rng.uniform(size=rows + 1) < 0.002, rng.uniform(0.02, 0.15, rows + 1), 0.0)
    return np.asarray(np.round(begin + np.arange(rows + 1) * period_s + late, 6))


def _kept(edges_s: Array, lost: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which rows the file has: the change of file has none, and single rows go missing."""
    into = (edges_s[1:] + rng.uniform(600.0, ROTATION_S)) % ROTATION_S
    kept = into > rng.uniform(3.0, 8.0)
    kept &= rng.uniform(size=len(into)) >= lost
    return np.asarray(kept)


def _bodies(sort: Sort, angle_deg: Array, powered_s: float, rng: np.random.Generator) -> dict[str, Array]:
    """Return temperatures on the fine grid, degC, and the compressor's load from 0 to 1."""
    step_s = sort.grid[0]
    demand = demands(sort.chamber, 60.0 * sort.minutes, THERMAL_S)
    air, compressor = chamber(demand, rng)
    middles = np.asarray((np.arange(len(angle_deg) - 1) + 0.5) * step_s)
    coarse = np.asarray((np.arange(len(air)) + 0.5) * THERMAL_S)
    speed = np.diff(
        np.interp(np.arange(len(air) + 1) * THERMAL_S, np.append(0.0, middles + 0.5 * step_s), angle_deg)
    )
    coil_w = TORQUER_W * (speed / THERMAL_S / FASTEST_DPS) ** 2
    on_s = powered_s + coarse
    wheel_w = np.where(on_s < SPIN_UP_S, SPIN_UP_W, WHEEL_W * (1.0 + 0.02 * rng.standard_normal()))
    nodes = network(
        air, wheel_w, coil_w, cold=powered_s == 0.0, airflow=float(np.exp(0.04 * rng.standard_normal()))
    )
    made = {"air": air, **dict(zip(BODIES, nodes, strict=True)), "compressor": compressor}
    return {name: _fine(values, middles, coarse, step_s) for name, values in made.items()}


def _fine(values: Array, middles: Array, coarse: Array, step_s: float) -> Array:
    # straight lines have corners: what goes with a slope would see them
    return follow(np.interp(middles, coarse, values), 2.0 * THERMAL_S, step_s)


def chamber(demand_c: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return a chamber's air, degC, and its compressor's load at steps of THERMAL_S (n,).

    A proportional-integral controller; the heater follows it, the compressor runs at 15 % or more of its load
    and must rest for 90 s, so that the air saws in a cold hold.
    """
    wall_k_s, heat_k_s, cool_k_s = 1.0 / 600.0, 0.10, 0.12
    air = float(demand_c[0])
    wall = (6.0 * air + ROOM_C) / 7.0
    total = (air - wall) * wall_k_s
    running, rested_s = False, 90.0
    airs, loads = np.empty(len(demand_c)), np.empty(len(demand_c))
    stirred = 0.004 * rng.standard_normal(len(demand_c))
    for k, wanted in enumerate(demand_c.tolist()):
        off = wanted - air
        power = 0.02 * off + total
        if -cool_k_s < power < heat_k_s:
            total += THERMAL_S * 4e-5 * off
        rested_s += THERMAL_S
        if running and power > 0.0:
            running, rested_s = False, 0.0
        elif not running and power < -0.004 and rested_s > 90.0:
            running = True
        load = float(np.clip(-power / cool_k_s, 0.15, 1.0)) if running else 0.0
        change = min(max(power, 0.0), heat_k_s) - load * cool_k_s - (air - wall) * wall_k_s + stirred[k]
        wall += THERMAL_S * ((air - wall) / 1500.0 + (ROOM_C - wall) / 9000.0)
        air += THERMAL_S * change
        airs[k], loads[k] = air, load
    return airs, loads


def conductances() -> tuple[Array, Array]:
    """Return the matrix (6, 6) of the flow between bodies and that from the air (6,), both W/K."""
    links = np.zeros((len(BODIES), len(BODIES)))
    for (one, other), watts in _LINKS_W_PER_K.items():
        i, j = BODIES.index(one), BODIES.index(other)
        links[[i, j], [j, i]] += watts
        links[[i, j], [i, j]] -= watts
    return links - np.diag(_TO_AIR_W_PER_K), _TO_AIR_W_PER_K


def network(
    air_c: Array, wheel_w: Array, coil_w: Array, *, cold: bool = False, airflow: float = 1.0
) -> Array:
    """Return the temperatures of BODIES, (6, n), degC, at steps of THERMAL_S, settled at the first step.

    `cold`: nothing was on before. The coil sits in bell b. `airflow` scales what the air gives to plate and case.
    """
    flow, given = conductances()
    flow = flow - np.diag((airflow - 1.0) * given)
    heat = np.outer(airflow * given, air_c)
    heat[BODIES.index("float")] += wheel_w
    heat[BODIES.index("bell_b")] += coil_w
    rates = flow / _CAPACITY_J_PER_K[:, None]
    decay = expm(rates * THERMAL_S)
    gain = np.linalg.solve(rates, decay - np.eye(len(BODIES))) / _CAPACITY_J_PER_K
    before = airflow * given * air_c[0] if cold else heat[:, 0]
    state = -np.linalg.solve(flow, before)
    pushes = (gain @ heat).T
    nodes = np.empty(heat.T.shape)
    for k in range(len(air_c)):
        state = decay @ state + pushes[k]
        nodes[k] = state
    return nodes.T
