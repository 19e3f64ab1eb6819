"""The test lab of a well-drilling company and its depolarised fibre gyro: runs, heat, cooler, table and log.

The coil lies in four radial layers on a spool, potted under a lid; a board warms the base. The diode sits on a
Peltier cooler in a can. The thermistor is glued to the spool, a platinum sensor sits on the base.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import expm

from benchmarks.gap_exam._campaign import Rates, Sort, at_rest, demands, in_rounds, motor_deg
from benchmarks.gap_exam._family import Sheet, Unit
from benchmarks.gap_exam._signals import drawn, flicker, follow, walk
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

LATITUDE_DEG = 52.62
SHEET = Sheet(
    arw_deg_per_sqrt_h=0.03,
    bias_instability_dph=0.25,
    rate_random_walk_dph_per_sqrt_h=0.5,
    quantum_arcsec=0.04,
    sf_sigma_ppm=700.0,
    slope_sigma_dph=4.0,
    turn_on_sigma_dph=1.5,
)
NODES = ("base", "lid", "layer1", "layer2", "layer3", "layer4", "spool", "board", "can")
LAYERS = NODES[2:6]
SET_C = 30.0
"""What the cooler holds the diode at."""
SPEED_DPS2 = 40.0
SERVO_S = 0.15
SETTLES_S = 6.0
_HEAT_STEP_S = 2.0
_CHAMBER_K_PER_MIN = 7.0
_CHAMBER_LAG_S = 80.0
_CAPACITIES = (520.0, 110.0, 32.0, 30.0, 28.0, 26.0, 150.0, 60.0, 24.0)
"""J/K of each node."""
_TO_AIR = {"base": 0.85, "lid": 0.42}
_LINKS = {
    ("lid", "layer1"): 0.12,
    ("layer1", "layer2"): 0.55,
    ("layer2", "layer3"): 0.5,
    ("layer3", "layer4"): 0.5,
    ("layer4", "spool"): 0.6,
    ("spool", "base"): 0.45,
    ("lid", "base"): 0.3,
    ("board", "base"): 0.25,
    ("can", "base"): 0.3,
}
"""Conductances, W/K."""
_HEATS_W = {"board": 1.8, "can": 0.9}


def network(unit: Unit) -> tuple[Array, Array, Array]:
    """Return the matrix (9, 9) in 1/s, the air's column (9,) in 1/s and the heating (9,) in K/s of a unit."""
    potting, mount = 0.75 + 0.5 * unit.draw["c1"], 0.8 + 0.4 * unit.draw["c2"]
    index = {name: k for k, name in enumerate(NODES)}
    matrix, air, heat = np.zeros((9, 9)), np.zeros(9), np.zeros(9)
    for (one, other), conductance in _LINKS.items():
        through = conductance * (potting if "layer" in one + other else 1.0)
        a, b = index[one], index[other]
        matrix[a, a] -= through
        matrix[b, b] -= through
        matrix[a, b] += through
        matrix[b, a] += through
    for name, conductance in _TO_AIR.items():
        air[index[name]] = conductance * mount
        matrix[index[name], index[name]] -= conductance * mount
    for name, power in _HEATS_W.items():
        heat[index[name]] = power
    capacity = np.array(_CAPACITIES)
    return matrix / capacity[:, None], air / capacity, heat / capacity


def heated(unit: Unit, air_c: Array, powered_s: float, step_s: float) -> Array:
    """Return the nodes' temperatures (9, n) while the air (n,) is held over each step, degC.

    Without power all were as warm as the first air; power came on `powered_s` before.
    """
    matrix, to_air, heat = network(unit)
    decay = expm(matrix * step_s)
    drive = np.linalg.solve(matrix, decay - np.eye(9))
    rest = -np.linalg.solve(matrix, to_air * air_c[0] + heat)
    state = rest + expm(matrix * powered_s) @ (np.full(9, air_c[0]) - rest)
    result = np.empty((9, len(air_c)))
    for k, push in enumerate(drive @ (np.outer(to_air, air_c) + heat[:, None]).T[..., None]):
        result[:, k] = state
        state = decay @ state + push[:, 0]
    return result


def chamber_air(demand_c: Array, step_s: float) -> Array:
    """Return the air of a chamber that ramps no faster than it can and lags, (n,), degC."""
    most = _CHAMBER_K_PER_MIN / 60.0 * step_s
    reached = np.empty_like(demand_c)
    now = float(demand_c[0])
    for k, asked in enumerate(demand_c.tolist()):
        now += min(max(asked - now, -most), most)
        reached[k] = now
    return follow(reached, _CHAMBER_LAG_S, step_s)


def beyond_cooler(unit: Unit, can_c: Array) -> Array:
    """Return by how much the diode leaves its set point as the cooler is at its limit, K, (m,).

    Heat that the cooler cannot pump away leaves it; the limits are soft over a kelvin.
    """
    hot_c = SET_C + 22.0 + 6.0 * unit.draw["a"]
    cold_c = SET_C - 34.0 - 8.0 * unit.draw["b"]
    return np.asarray(np.logaddexp(0.0, can_c - hot_c) - np.logaddexp(0.0, cold_c - can_c))


def _rates(values: tuple[float, ...], first_s: float, turn_s: float, rest_s: float) -> Rates:
    """Return turns of a rate, each there and back, with a rest after each."""
    result = []
    for k, rate in enumerate(v for value in values for v in (value, -value)):
        begin = first_s + k * (turn_s + rest_s)
        result += [(begin, rate), (begin + turn_s, 0.0)]
    return result


def _headings() -> Rates:
    """Return moves by 45 degrees, eight on and eight back, a stop of 100 s between."""
    return [
        pair
        for k in range(16)
        for pair in ((90.0 + 105.0 * k, 9.0 if k < 8 else -9.0), (95.0 + 105.0 * k, 0.0))
    ]


def _mission() -> Rates:
    """Return a tool face that is turned now and then while the well gets warmer."""
    return [(300.0, 0.05), (700.0, 0.0), (1200.0, 12.0), (1380.0, 0.0), (1800.0, -30.0), (1920.0, 0.0),
            (2500.0, 70.0), (2560.0, 0.0), (3000.0, -0.02), (3300.0, 0.0)]  # fmt: skip


def _fast() -> Rates:
    return _rates((3.0, 10.0, 30.0, 60.0, 100.0), 120.0, 60.0, 30.0)


SORTS = (
    Sort("RR", "rates", "room", 18.0, ((0.0, 24.0),), turns=_fast),
    Sort("RC", "rates", "cold", 18.0, ((0.0, -22.0),), 2, 0, turns=_fast),
    Sort("RH", "rates", "hot", 18.0, ((0.0, 62.0),), 2, 0, turns=_fast),
    Sort("CR", "creep", "room", 36.0, ((0.0, 24.0),), 2, 0, start_deg=35.0,
         turns=lambda: _rates((0.001, 0.004, 0.0055, 0.012, 0.03, 0.12), 90.0, 140.0, 20.0)),
    Sort("HD", "headings", "room", 32.0, ((0.0, 24.0),), 2, 0, turns=_headings,
         elevation=((0.0, 0.0),)),
    Sort("PO", "positions", "room", 50.0, ((0.0, 24.0),), 2, 0, start_deg=90.0, masks=True,
         elevation=((0.0, 90.0), (600.0, 0.0), (1200.0, -90.0), (1800.0, 0.0), (2400.0, 90.0))),
    Sort("RA", "ramp", "round", 100.0,
         ((0.0, 20.0), (8.0, 20.0), (30.0, 64.0), (38.0, 64.0), (80.0, -22.0), (88.0, -22.0), (100.0, 2.0))),
    Sort("DW", "dwells", "stairs", 110.0,
         ((0.0, 45.0), (20.0, 45.0), (24.0, 22.0), (45.0, 22.0), (49.0, 0.0), (70.0, 0.0), (74.0, -22.0),
          (95.0, -22.0), (99.0, 2.0)), 2, 0),
    Sort("SH", "shock", "cold", 75.0,
         ((0.0, 40.0), (10.0, 40.0), (10.1, -25.0), (45.0, -25.0), (45.1, 20.0)), 3, 1),
    Sort("ST", "standing", "fresh", 60.0, ((0.0, 24.0),), 3, 0, powered_s=(40.0, 160.0)),
    Sort("TR", "rates on a ramp", "warming", 60.0, ((0.0, -15.0), (5.0, -15.0), (40.0, 60.0)), 2, 0,
         turns=lambda: _rates((25.0,) * 14, 60.0, 50.0, 70.0)),
    Sort("WE", "well", "mission", 60.0,
         ((0.0, 15.0), (5.0, 15.0), (20.0, 48.0), (40.0, 58.0), (60.0, 35.0)), 1, 1,
         turns=_mission),
)  # fmt: skip
"""The runs in the order of a round."""


def campaign(unit: Unit) -> list[Stage]:
    """Return the runs of a unit."""
    return in_rounds(SORTS, lambda sort, repeat, number: _stage(unit, sort, repeat, number))


def _stage(unit: Unit, sort: Sort, repeat: int, number: int) -> Stage:
    rng = drawn(unit.seed, "run", sort.code, repeat)
    step_s, per_row = sort.grid[0], 5
    seconds = 60.0 * sort.minutes
    edges: Array = np.arange(round(seconds / step_s) + 1.0) * step_s
    middles = edges[:-1] + 0.5 * step_s
    powered_s = float(np.round(rng.uniform(*sort.powered_s)))
    air = chamber_air(
        demands(sort.chamber, seconds, _HEAT_STEP_S) + rng.normal(0.0, 0.15), _HEAT_STEP_S
    ) + 0.08 * np.sin(2.0 * np.pi * (np.arange(round(seconds / _HEAT_STEP_S)) / 130.0 + rng.uniform()))
    coarse = heated(unit, air, powered_s, _HEAT_STEP_S)
    at = np.arange(coarse.shape[1]) * _HEAT_STEP_S
    # the air's steps are softened by the heat step: no jump in a slope
    bodies = {
        name: follow(np.interp(middles, at, row), 3.0, step_s)
        for name, row in zip(NODES, coarse, strict=True)
    }
    bodies["air"] = np.interp(middles, at, air)
    bodies["beyond"] = follow(beyond_cooler(unit, bodies["can"]), 12.0, step_s)
    rates = sort.turns()
    angle = follow(motor_deg(rates, edges, sort.start_deg, SPEED_DPS2), SERVO_S, step_s)
    mounted, elevation = sort.elevations(middles)
    rows = edges[::per_row]
    valid = at_rest(rates, mounted, rows, SETTLES_S) if sort.masks else np.ones(len(rows) - 1, bool)
    held = repeat >= sort.repeats - sort.held_out
    return Stage(
        sort.code, sort.profile, sort.condition, repeat, number, step_s, angle, elevation, bodies,
        follow(0.7 * bodies["spool"] + 0.3 * bodies["layer4"], 8.0, step_s), follow(bodies["base"], 15.0, step_s),
        rows, valid, np.ones(len(rows) - 1, bool), (("run", 0.0),), powered_s, held,
    )  # fmt: skip


def rows_dph(unit: Unit, stage: Stage, true_dph: Array, rng: np.random.Generator) -> Array:
    """Return what the voltage-to-frequency converter's counter shows for a true rate (n,), deg/h."""
    sheet, gaps = unit.sheet, np.diff(stage.edges_s)
    white = 60.0 * sheet.arw_deg_per_sqrt_h * unit.inside.get("dim_source", 1.0)
    rate = true_dph + white / np.sqrt(gaps) * rng.standard_normal(len(gaps))
    rate += flicker(sheet.bias_instability_dph * unit.inside.get("restless_pick_up", 1.0), gaps, rng)
    drift = sheet.rate_random_walk_dph_per_sqrt_h * unit.inside.get("ageing_polariser", 1.0)
    rate += walk(drift, gaps, rng)
    counts = np.floor(np.concatenate(([0.0], np.cumsum(rate * gaps))) / sheet.quantum_arcsec + rng.uniform())
    return np.asarray(np.diff(counts) * sheet.quantum_arcsec / gaps)


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return the logged thermistor and platinum sensor (n,), degC, and the encoder (n + 1,), deg."""
    n = len(stage.edges_s) - 1
    noise_k = 0.004 * rng.standard_normal((2, n))
    angle = stage.at_edges(stage.angle_deg)
    # an encoder of 23 bits
    bit = 360.0 / 2**23
    return (
        stage.in_rows(stage.t_in_c) + noise_k[0],
        stage.in_rows(stage.t_out_c) + noise_k[1],
        np.round(angle / bit) * bit,
    )
