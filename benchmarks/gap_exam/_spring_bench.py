"""The rate bench of an overhaul workshop: heat of a spring-restrained rate gyro, table, counter's readings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.signal import bilinear, lfilter

from benchmarks.gap_exam._campaign import Rates, Sort, demands, in_rounds, motor_deg, to_and_fro
from benchmarks.gap_exam._family import Unit
from benchmarks.gap_exam._signals import drawn, flicker, follow, walk
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

ROOM_C = 23.0
TOP_DPS = 30.0
"""The greatest rate that the component's maintenance manual asks for."""
MOTOR_W, COIL_W, RUN_UP_FACTOR, RUN_UP_S = 2.5, 0.15, 2.2, 45.0
BODIES = ("case", "oil", "gimbal", "pickoff")
HEAT_J_PER_K = (180.0, 35.0, 45.0, 12.0)
AIR_W_PER_K, CASE_OIL_W_PER_K, OIL_GIMBAL_W_PER_K = 0.9, 0.25, 0.3
CASE_PICKOFF_W_PER_K, OIL_PICKOFF_W_PER_K = 0.12, 0.04
_SETTLED_S = 3600.0
_TABLE_DPS2 = 20.0
_SERVO_RAD_PER_S, _SERVO_DAMPING = 7.0, 0.65
_BLANK_S = 8.0
"""Readings count so long after the table's motor has reached its rate: slews of shorter length have none."""
_AIR_LAG_S, _CYCLE_S, _CYCLE_K = 25.0, 230.0, 0.25
_THERMISTOR_LAG_S, _STUD_LAG_S, _READING_K = 8.0, 4.0, 0.02
_ENCODER_ARCSEC, _ENCODER_STEP_DEG = 0.3, 1e-4
_AT_REST, _ON_THE_MOVE = (0.5, 1), (0.1, 5)
"""Grids: the counter's gate lasts 0.5 s always."""


def within(unit: Unit, name: str, low: float, high: float) -> float:
    """Return a value of a unit from a range, by its draw of some name."""
    return low + (high - low) * unit.draw[name]


# heat ---------------------------------------------------------------------------------------------------------


def network(unit: Unit) -> tuple[Array, Array]:
    """Return (a, b): bodies' temperatures change by a (4, 4) @ T + b (4, 3) @ (air degC, motor W, coil W), K/s.

    The motor heats the gimbal, the gimbal the oil, the oil the case and the pick-off; the case loses to the air.
    """
    to_oil = CASE_OIL_W_PER_K * within(unit, "a", 0.8, 1.25)
    to_gimbal = OIL_GIMBAL_W_PER_K * within(unit, "b", 0.8, 1.25)
    links = np.zeros((4, 4))
    for one, other, w_per_k in (
        (0, 1, to_oil),
        (1, 2, to_gimbal),
        (0, 3, CASE_PICKOFF_W_PER_K),
        (1, 3, OIL_PICKOFF_W_PER_K),
    ):
        links[one, other] = links[other, one] = w_per_k
    gains = links - np.diag(links.sum(axis=1))
    gains[0, 0] -= AIR_W_PER_K
    sources = np.zeros((4, 3))
    sources[0, 0], sources[2, 1], sources[3, 2] = AIR_W_PER_K, 1.0, 1.0
    heat = np.array(HEAT_J_PER_K)[:, None]
    return gains / heat, sources / heat


def heated(unit: Unit, air_c: Array, step_s: float, powered_s: float) -> Array:
    """Return the bodies' temperatures at the middles of steps, (4, m), degC, in air (m,) that holds a step long.

    The unit has been on for `powered_s` at the first step, and off for long before; its motor draws more until
    it has run up.
    """
    a, b = network(unit)
    settled = powered_s >= _SETTLED_S
    lead = 0 if settled else round(powered_s / step_s)
    air = np.concatenate((np.full(lead, air_c[0]), air_c))
    on_s = (np.arange(len(air)) - lead) * step_s + powered_s
    motor = MOTOR_W * np.where(on_s < RUN_UP_S, RUN_UP_FACTOR, 1.0)
    inputs = np.stack((air, motor, np.full(len(air), COIL_W)))
    before = np.array([air_c[0], MOTOR_W if settled else 0.0, COIL_W if settled else 0.0])
    start = np.linalg.solve(a, -b @ before)
    roots, modes = np.linalg.eig(a)
    roots, modes = np.real(roots), np.real(modes)
    driven, first = np.linalg.solve(modes, b @ inputs), np.linalg.solve(modes, start)
    states = np.empty((4, len(air) + 1))
    for k, root in enumerate(roots.tolist()):
        decay = np.exp(root * step_s)
        rises = (decay - 1.0) / root * driven[k]
        states[k] = np.concatenate(
            ([first[k]], lfilter([1.0], [1.0, -decay], rises, zi=[decay * first[k]])[0])
        )
    edges = modes @ states
    return np.asarray(0.5 * (edges[:, 1:] + edges[:, :-1])[:, lead:])


def _air_c(unit: Unit, sort: Sort, key: str, step_s: float) -> Array:
    """Return the chamber's air: it lags behind its demand and cycles about it as its relay switches, (m,)."""
    rng = drawn(unit.seed, "chamber", key)
    demand = demands(sort.chamber, 60.0 * sort.minutes, step_s) + rng.normal(0.0, 0.4)
    air = follow(demand, _AIR_LAG_S, step_s)
    turns = np.arange(len(air)) * step_s / (_CYCLE_S * rng.uniform(0.9, 1.1)) + rng.uniform()
    return np.asarray(air + _CYCLE_K * (4.0 * np.abs(turns % 1.0 - 0.5) - 1.0))


# table --------------------------------------------------------------------------------------------------------


def table_deg(rates: Rates, edges_s: Array, start_deg: float) -> Array:
    """Return the table's true angle at edges (m + 1,): its servo follows the motor's rate with some overshoot."""
    wanted = motor_deg(rates, edges_s, 0.0, _TABLE_DPS2)
    step_s = float(edges_s[1] - edges_s[0])
    square = _SERVO_RAD_PER_S**2
    upper, lower = bilinear([square], [1.0, 2.0 * _SERVO_DAMPING * _SERVO_RAD_PER_S, square], 1.0 / step_s)
    return np.asarray(start_deg + lfilter(upper, lower, wanted))


def readable(rates: Rates, mounted_s: Array, edges_s: Array) -> NDArray[np.bool_]:
    """Return the rows that do not touch a change of rate or of the mount, (n,)."""
    speed, spans = 0.0, [(at - 40.0, at + 20.0) for at in mounted_s.tolist()]
    for begin, rate in rates:
        spans.append((begin, begin + abs(rate - speed) / _TABLE_DPS2))
        speed = rate
    valid = np.ones(len(edges_s) - 1, bool)
    for begin, end in spans:
        valid &= (edges_s[1:] <= begin) | (edges_s[:-1] >= end + _BLANK_S)
    return valid


def ladder(rates: Sequence[float], begin_s: float, hold_s: float, rest_s: float) -> list[tuple[float, float]]:
    """Return rates clockwise, then counter-clockwise, each held, with the table at rest between."""
    steps, at = [], begin_s
    for rate in rates:
        for signed in (rate, -rate):
            steps += [(at, signed), (at + hold_s, 0.0)]
            at += hold_s + rest_s
    return steps


def stairs(rates: Sequence[float], begin_s: float, hold_s: float) -> list[tuple[float, float]]:
    """Return rates held one after the other, without rest between; the last is 0."""
    return [
        *((begin_s + k * hold_s, rate) for k, rate in enumerate(rates)),
        (begin_s + len(rates) * hold_s, 0.0),
    ]


def _full() -> Rates:
    return ladder((1.0, 3.0, 6.0, 12.0, 20.0, TOP_DPS, 20.0, 6.0), 120.0, 45.0, 45.0)


def _short() -> Rates:
    return ladder((1.0, 3.0, 6.0, 12.0, 20.0, TOP_DPS), 120.0, 45.0, 45.0)


def _small() -> Rates:
    up = [0.003, 0.006, 0.01, 0.02, 0.04, 0.08, 0.15, 0.3]
    return stairs([*up, *up[-2::-1], *(-rate for rate in (*up, *up[-2::-1]))], 90.0, 50.0)


def _sweeps() -> Rates:
    return to_and_fro(300.0, 3000.0, 8.0, 48.0)


def _crossed() -> Rates:
    return ladder((6.0, 12.0, 20.0), 90.0, 60.0, 60.0) + ladder((6.0, 12.0, 20.0), 1050.0, 60.0, 60.0)


def _long() -> Rates:
    return ladder((10.0,) * 22, 60.0, 120.0, 15.0)


def _headings() -> Rates:
    # quarter turns, each half a minute before the mount changes
    return [pair for at in range(300, 3300, 300) for pair in ((at - 20.0, 15.0), (at - 14.0, 0.0))]


def _acceptance() -> Rates:
    return ladder((3.0, 12.0, TOP_DPS), 600.0, 90.0, 90.0) + ladder((3.0, 12.0, TOP_DPS), 2400.0, 90.0, 90.0)


_AT_ROOM = ((0.0, ROOM_C),)
_LEVEL, _FORTY_FIVE = ((0.0, 0.0),), ((0.0, 45.0), (960.0, 0.0))
_PLACES = tuple(zip(range(0, 3300, 300), (90, 45, 0, -45, -90, -45, 0, 45, 90, 0, 90), strict=True))
_SLOW = ((0.0, 23.0), (10.0, 23.0), (31.0, 65.0), (50.0, 65.0), (102.0, -40.0), (124.0, -40.0), (155.0, 23.0))
_SHOCK = ((0.0, 23.0), (10.0, 23.0), (14.0, -45.0), (60.0, -45.0), (66.0, 23.0))
_UP_AND_DOWN = ((0.0, 23.0), (4.0, 23.0), (30.0, 62.0), (40.0, 62.0), (88.0, -25.0))
_COOLING = ((0.0, 23.0), (8.0, 23.0), (40.0, -35.0))
_MILD = ((0.0, 23.0), (5.0, 23.0), (20.0, 45.0), (32.0, 45.0), (58.0, 0.0))
SORTS = (
    Sort("RR", "rates", "room", 27.0, _AT_ROOM, turns=_full, grid=_ON_THE_MOVE, masks=True),
    Sort("RH", "rates", "hot", 21.0, ((0.0, 65.0),), turns=_short, grid=_ON_THE_MOVE, masks=True),
    Sort("RC", "rates", "cold", 21.0, ((0.0, -40.0),), turns=_short, grid=_ON_THE_MOVE, masks=True),
    Sort("TH", "threshold", "room", 28.0, _AT_ROOM, turns=_small, grid=_ON_THE_MOVE),
    Sort("SW", "sweep", "cooling", 52.0, _COOLING, turns=_sweeps, grid=_ON_THE_MOVE),
    Sort("PO", "positions", "room", 55.0, _AT_ROOM, turns=_headings, elevation=_PLACES, grid=_ON_THE_MOVE,
         masks=True),
    Sort("XC", "cross rates", "room", 30.0, _AT_ROOM, turns=_crossed, elevation=_FORTY_FIVE, grid=_ON_THE_MOVE,
         masks=True),
    Sort("RT", "turning", "chamber", 102.0, _UP_AND_DOWN, 2, turns=_long, grid=_ON_THE_MOVE, masks=True),
    Sort("SL", "slow chamber", "up", 170.0, _SLOW, grid=_AT_REST),
    Sort("CS", "cold shock", "up", 95.0, _SHOCK, grid=_AT_REST),
    Sort("SR", "start", "room", 60.0, _AT_ROOM, grid=_AT_REST, powered_s=(5.0, 30.0)),
    Sort("SC", "start", "cold", 60.0, ((0.0, -30.0),), 2, grid=_AT_REST, powered_s=(5.0, 30.0)),
    Sort("ST", "standing", "level", 60.0, _AT_ROOM, elevation=_LEVEL, grid=_AT_REST),
    Sort("AC", "acceptance", "mild", 75.0, _MILD, 1, turns=_acceptance, grid=_ON_THE_MOVE, masks=True),
)  # fmt: skip
"""The manual's tests. The acceptance run at the end is held out whole."""


def campaign(unit: Unit) -> list[Stage]:
    """Return the runs of a unit."""

    def make(sort: Sort, repeat: int, number: int) -> Stage:
        return _stage(unit, sort, repeat, number)

    return in_rounds(SORTS, make)


def _stage(unit: Unit, sort: Sort, repeat: int, number: int) -> Stage:
    key = f"{sort.code}|{repeat}"
    rng = drawn(unit.seed, "stage", key)
    step_s, per_row = sort.grid
    steps = round(60.0 * sort.minutes / step_s)
    edges_s: Array = np.arange(steps + 1.0) * step_s
    gates_s = edges_s[::per_row]
    powered_s = float(rng.uniform(*sort.powered_s))
    bodies = dict(zip(BODIES, heated(unit, _air_c(unit, sort, key, step_s), step_s, powered_s), strict=True))
    mounted_s, elevation = sort.elevations(0.5 * (edges_s[1:] + edges_s[:-1]))
    rates = sort.turns()
    # the counter gives nothing before the motor is in step
    valid = gates_s[:-1] + powered_s >= RUN_UP_S
    if sort.masks:
        valid &= readable(rates, mounted_s, gates_s)
    return Stage(
        sort.code,
        sort.profile,
        sort.condition,
        repeat,
        number,
        step_s,
        table_deg(rates, edges_s, sort.start_deg) if rates else np.full(steps + 1, sort.start_deg),
        elevation,
        bodies,
        follow(bodies["oil"], _THERMISTOR_LAG_S, step_s),
        follow(bodies["case"], _STUD_LAG_S, step_s),
        gates_s,
        valid,
        np.ones(len(gates_s) - 1, bool),
        tuple((f"leg {k + 1}", 60.0 * minute) for k, (minute, _) in enumerate(sort.chamber)),
        powered_s,
        repeat >= sort.repeats - sort.held_out,
    )


# reading ------------------------------------------------------------------------------------------------------


def rows(unit: Unit, stage: Stage, rate_dph: Array, rng: np.random.Generator) -> Array:
    """Return what the counter behind the voltage-to-frequency converter gives a gate, deg/h, (n,).

    The demodulated voltage has white noise, 1/f noise of the amplifier and a random walk of the pivots; the
    counter counts whole pulses, what is left over goes into the next gate.
    """
    sheet, gates_s = unit.sheet, np.diff(stage.edges_s)
    white = unit.inside.get("rotor_bearings", 1.0) * sheet.arw_deg_per_sqrt_h
    wander = unit.inside.get("flex_wander", 1.0) * sheet.rate_random_walk_dph_per_sqrt_h
    pulse_arcsec = unit.inside.get("coarse_counter", 1.0) * sheet.quantum_arcsec
    noise = 60.0 * white / np.sqrt(gates_s) * rng.standard_normal(len(gates_s))
    noise += flicker(sheet.bias_instability_dph, gates_s, rng) + walk(wander, gates_s, rng)
    turned_arcsec = np.concatenate(([0.0], np.cumsum((rate_dph + noise) * gates_s)))
    pulses = np.floor(turned_arcsec / pulse_arcsec + rng.uniform())
    return np.asarray(np.diff(pulses) * pulse_arcsec / gates_s)


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return the logged temperatures (n,), degC, and the encoder's angle (n + 1,), deg."""

    def thermometer(values_c: Array) -> Array:
        counts = (stage.in_rows(values_c) + rng.normal(0.0, _READING_K, len(stage.valid))) / _READING_K
        return np.asarray(np.round(counts) * _READING_K)

    angle = stage.at_edges(stage.angle_deg)
    angle = angle + rng.normal(0.0, _ENCODER_ARCSEC / 3600.0, len(angle))
    return (
        thermometer(stage.t_in_c),
        thermometer(stage.t_out_c),
        np.round(angle / _ENCODER_STEP_DEG) * _ENCODER_STEP_DEG,
    )
