"""The bench of a metal cylinder gyro: chamber, heat from plate to metal, table servo, runs of a campaign.

The gyro stands on a plate in a chamber on the table. Its board warms itself; the cylinder hangs in vacuum on a
stem and gets heat by that stem and by radiation. The maker's thermometer is at a post of the board.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import cont2discrete, lfilter

from benchmarks.gap_exam._campaign import Rates, Sort, at_rest, demands, in_rounds, motor_deg, to_and_fro
from benchmarks.gap_exam._family import Unit
from benchmarks.gap_exam._signals import drawn, follow
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K

LATITUDE_DEG = 50.4
FASTEST_DPS = 200.0
STEP_S = 0.125
"""The gyro sends 8 means a second; a row is a mean of one or more of them."""

# heat ---------------------------------------------------------------------------------------------------------

BODIES = ("air", "plate", "housing", "board", "metal")
HEAT_STEP_S = 2.0
BOARD_W = 1.3
PLATE_J_PER_K, HOUSING_J_PER_K, BOARD_J_PER_K, METAL_J_PER_K = 900.0, 160.0, 14.0, 9.0
POSTS_W_PER_K = 0.09
STEM_W_PER_K = 0.035
RADIATES_W_PER_K4 = 5.1e-11
"""Emissivity 0.3 on 30 cm2, between the housing and the cylinder."""
CHAMBER_LAG_S = 90.0
AIR_WAVE_K = 0.4
BEAD_S = 8.0
PLATE_SENSOR_S = 12.0
SELF_HEAT_K = BOARD_W / POSTS_W_PER_K
"""How much warmer than the housing the board is at rest."""
BEAD_ON_BOARD = 0.3
BEAD_HEAT_K = BEAD_ON_BOARD * SELF_HEAT_K
"""How much warmer than housing and metal the thermometer is at rest."""


@dataclass(frozen=True)
class Heat:
    """Heat passes from plate to housing by pads of `pads_w_per_k`; all else is alike in every unit."""

    pads_w_per_k: float

    def flows(self, air: float, turning: float, at: Sequence[float], power_w: float) -> tuple[float, ...]:
        """Return the heat that plate, housing, board and metal gain, W, at temperatures `at`, degC.

        Air takes heat by natural convection, conductance as the fourth root of the difference, and by what
        the turning table adds: `turning`, the square root of its speed in deg/s.
        """
        plate, housing, board, metal = at
        on_plate, on_housing = air - plate, air - housing
        from_air = on_plate * (1.0 + 0.3 * abs(on_plate) ** 0.25 + 0.05 * turning)
        to_housing = on_housing * (0.2 + 0.08 * abs(on_housing) ** 0.25 + 0.01 * turning)
        through = self.pads_w_per_k * (plate - housing)
        posts = POSTS_W_PER_K * (board - housing)
        k_housing, k_metal = housing + ZERO_CELSIUS_K, metal + ZERO_CELSIUS_K
        stem = STEM_W_PER_K * (housing - metal) + RADIATES_W_PER_K4 * (k_housing**4 - k_metal**4)
        return from_air - through, to_housing + through + posts - stem, power_w - posts, stem

    def followed(self, air_c: Array, speed_dps: Array, powered_s: float) -> Array:
        """Return the temperatures (4, k) of plate, housing, board, metal in steps of HEAT_STEP_S.

        Before the run the unit was powered for `powered_s` in air as at its begin, and off before that.
        """
        at = [float(air_c[0])] * 4
        before = int(powered_s / HEAT_STEP_S)
        result = np.empty((4, len(air_c)))
        capacities = (PLATE_J_PER_K, HOUSING_J_PER_K, BOARD_J_PER_K, METAL_J_PER_K)
        airs, turns = air_c.tolist(), np.sqrt(speed_dps).tolist()
        for k in range(-before, len(airs)):
            air, turning = (airs[k], turns[k]) if k >= 0 else (airs[0], 0.0)
            flows = self.flows(air, turning, at, BOARD_W)
            at = [t + HEAT_STEP_S * w / c for t, w, c in zip(at, flows, capacities, strict=True)]
            if k >= 0:
                result[:, k] = at
        return result


def heat_of(unit: Unit) -> Heat:
    """Return the heat paths of a unit: its pads were pressed more or less."""
    return Heat(0.8 + 0.6 * unit.draw["c1"])


def chamber_air(demand_c: Array, step_s: float, k_per_min: float) -> Array:
    """Return the chamber's air: it follows its demand with a lag, and no faster than it can."""
    air, most = float(demand_c[0]), k_per_min * step_s / 60.0
    result = np.empty(len(demand_c))
    share = 1.0 - math.exp(-step_s / CHAMBER_LAG_S)
    for k, wanted in enumerate(demand_c.tolist()):
        air += min(most, max(-most, share * (wanted - air)))
        result[k] = air
    return result


# table --------------------------------------------------------------------------------------------------------

DPS2 = 300.0
SERVO_RAD_S, SERVO_DAMPING = 14.0, 0.65
SETTLES_S = 2.5


def servo_deg(rates: Rates, steps: int, start_deg: float) -> Array:
    """Return the table's angle at edges (steps + 1,): its speed follows ramps as a second-order servo does."""
    edges = np.arange(steps + 1.0) * STEP_S
    wanted = np.diff(motor_deg(rates, edges, start_deg, DPS2)) / STEP_S
    servo = ([SERVO_RAD_S**2], [1.0, 2.0 * SERVO_DAMPING * SERVO_RAD_S, SERVO_RAD_S**2])
    numerator, denominator, _ = cont2discrete(servo, STEP_S)
    speed = lfilter(numerator.ravel(), denominator, wanted)
    return np.concatenate(([start_deg], start_deg + np.cumsum(speed) * STEP_S))


def ladder(rates_dps: Sequence[float], held_s: float, pause_s: float, first_s: float) -> Rates:
    """Return each rate in both senses, a pause behind each."""
    turns: list[tuple[float, float]] = []
    begin = first_s
    for rate in rates_dps:
        for signed in (rate, -rate):
            turns += [(begin, signed), (begin + held_s, 0.0)]
            begin += held_s + pause_s
    return turns


def bursts(at_min: Sequence[float], rates_dps: Sequence[float], held_s: float) -> Rates:
    """Return at each of some minutes the rates of a ladder."""
    return [turn for at in at_min for turn in ladder(rates_dps, held_s, 10.0, 60.0 * at)]


def _headings() -> Rates:
    """Every three minutes 30 degrees further, all the way back in one, then six turns in each sense."""
    there = [turn for k in range(1, 13) for turn in ((180.0 * k, 20.0), (180.0 * k + 1.5, 0.0))]
    return [*there, (180.0 * 13, -20.0), (180.0 * 13 + 18.0, 0.0), *ladder((24.0,), 90.0, 30.0, 2420.0)]


def moves(rates: Rates) -> Rates:
    """Return the turns of less than a minute: they bring the table elsewhere, longer ones are measured."""
    pairs = zip(rates[::2], rates[1::2], strict=True)
    return [turn for begin, end in pairs if end[0] - begin[0] < 60.0 for turn in (begin, end)]


def _swings() -> Rates:
    return [*to_and_fro(60.0, 540.0, 40.0, 100.0), *to_and_fro(600.0, 1080.0, 90.0, 135.0)]


def _mission() -> Rates:
    return [
        *bursts((14.0, 41.0, 77.0), (25.0, 120.0), 25.0),
        *to_and_fro(95.0 * 60.0, 99.0 * 60.0, 30.0, 90.0),
    ]


# runs ---------------------------------------------------------------------------------------------------------

ROOM_C = 23.0
_ROOM = ((0.0, ROOM_C),)
_CYCLE = (
    *((0.0, 23.0), (15.0, 23.0), (35.0, 65.0), (75.0, 65.0), (125.0, -35.0), (170.0, -35.0), (200.0, 23.0)),
    (225.0, 23.0),
)
_STAIRS = tuple(
    point for k in range(6) for point in ((32.0 * k, 60.0 - 19.0 * k), (32.0 * k + 22.0, 60.0 - 19.0 * k))
)
_SHOCK = ((0.0, 60.0), (20.0, 60.0), (24.0, 5.0), (65.0, 5.0), (69.0, 60.0), (105.0, 60.0))
_MISSION = ((0.0, 23.0), (10.0, 23.0), (35.0, -20.0), (60.0, -20.0), (100.0, 50.0), (115.0, 50.0))
_TUMBLE = tuple(
    (300.0 * k, angle) for k, angle in enumerate((90.0, 45.0, 0.0, -45.0, -90.0, -30.0, 30.0, 90.0))
)
_KNOCKS_S = (7200.0, 8400.0, 9600.0)
SHOCK_K_PER_MIN, CHAMBER_K_PER_MIN = 15.0, 3.0


def _stairs_turns() -> Rates:
    on_steps = [32.0 * k + 16.0 for k in range(6)]
    on_ramps = [32.0 * k + 26.0 for k in range(5)]
    return bursts(sorted(on_steps + on_ramps), (60.0,), 30.0)


SORTS = (
    Sort("CY", "cycle", "axis up", 225.0, _CYCLE, grid=(STEP_S, 8)),
    Sort("ST", "stairs", "rates at each", 192.0, _STAIRS, turns=_stairs_turns, grid=(STEP_S, 4)),
    Sort(
        *("RS", "rates", "room", 22.0, _ROOM),
        turns=lambda: ladder((1.0, 3.0, 10.0, 30.0, 60.0, 100.0, 150.0, FASTEST_DPS), 45.0, 30.0, 60.0),
        grid=(STEP_S, 1),
    ),
    Sort(
        *("RQ", "slow rates", "room", 40.0, _ROOM),
        repeats=2,
        held_out=0,
        turns=lambda: ladder((0.005, 0.01, 0.02, 0.05, 0.1, 0.3), 150.0, 45.0, 30.0),
        grid=(STEP_S, 2),
    ),
    Sort(
        *("PO", "headings", "axis level", 45.0, _ROOM),
        turns=_headings,
        elevation=((0.0, 0.0),),
        grid=(STEP_S, 4),
        masks=True,
    ),
    Sort(
        *("TU", "tumble", "room", 40.0, _ROOM),
        repeats=2,
        held_out=0,
        start_deg=90.0,
        elevation=_TUMBLE,
        grid=(STEP_S, 8),
        masks=True,
    ),
    Sort(
        *("SI", "swings", "room", 19.0, _ROOM),
        repeats=2,
        held_out=0,
        turns=_swings,
        grid=(STEP_S, 1),
    ),
    Sort("CS", "cold start", "minus 20", 75.0, ((0.0, -20.0),), grid=(STEP_S, 8), powered_s=(0.0, 0.0)),
    Sort(
        *("SH", "thermal shock", "axis level", 105.0, _SHOCK),
        repeats=2,
        held_out=0,
        start_deg=30.0,
        elevation=((0.0, 0.0),),
        grid=(STEP_S, 8),
    ),
    Sort("LS", "standing", "knocked", 180.0, _ROOM, grid=(STEP_S, 8)),
    Sort("MI", "mission", "axis up", 115.0, _MISSION, repeats=1, turns=_mission, grid=(STEP_S, 2)),
)


def phases_of(sort: Sort) -> tuple[tuple[str, float], ...]:
    """Return what the lab's plan calls the parts of a run, with their begins, s."""
    if sort.code == "LS":
        return ("standing", 0.0), *((f"knock {k + 1}", at) for k, at in enumerate(_KNOCKS_S))
    if sort.code == "TU":
        return ("mounted", 0.0), *((f"mounted {k + 2}", at) for k, (at, _) in enumerate(sort.elevation[1:]))
    if len(sort.chamber) == 1:
        return (("run", 0.0),)
    named = []
    for k, ((at, here), (_, then)) in enumerate(zip(sort.chamber[:-1], sort.chamber[1:], strict=True)):
        named.append((f"{'soak' if here == then else 'ramp'} {k + 1}", 60.0 * at))
    return tuple(named)


def make_stage(unit: Unit, sort: Sort, repeat: int, number: int) -> Stage:
    """Return a run: where the table stands at its begin and the wave of the room's air are by chance."""
    rng = drawn(unit.seed, "stage", sort.code, repeat)
    steps = round(60.0 * sort.minutes / STEP_S)
    rates = sort.turns()
    free = bool(rates) and not sort.masks
    angle = servo_deg(rates, steps, 360.0 * float(rng.uniform()) if free else sort.start_deg)
    at_s: Array = (np.arange(steps) + 0.5) * np.float64(STEP_S)
    powered_s = float(rng.uniform(*sort.powered_s)) if sort.powered_s[1] > 0.0 else 0.0
    bodies = dict(
        zip(BODIES, _temperatures(unit, sort, np.diff(angle) / STEP_S, powered_s, rng), strict=True)
    )
    bead = (1.0 - BEAD_ON_BOARD) * bodies["housing"] + BEAD_ON_BOARD * bodies["board"]
    mounted_s, elevation = sort.elevations(at_s)
    edges: Array = np.arange(0, steps + 1, sort.grid[1]) * np.float64(STEP_S)
    valid = np.ones(len(edges) - 1, bool)
    if sort.masks:
        valid = at_rest(moves(rates), mounted_s, edges, SETTLES_S)
    # the logger of the headings pauses where the other writes empty rows
    kept: NDArray[np.bool_] = valid.copy() if sort.code == "PO" else np.ones(len(valid), bool)
    return Stage(
        *(sort.code, sort.profile, sort.condition, repeat, number, STEP_S, angle, elevation, bodies),
        t_in_c=follow(bead, BEAD_S, STEP_S),
        t_out_c=follow(bodies["plate"], PLATE_SENSOR_S, STEP_S),
        edges_s=edges,
        valid=valid,
        kept=kept,
        phases=phases_of(sort),
        power_on_s=powered_s,
        held_out=repeat >= sort.repeats - sort.held_out,
    )


def _temperatures(
    unit: Unit, sort: Sort, rate_dps: Array, powered_s: float, rng: np.random.Generator
) -> list[Array]:
    """Return air, plate, housing, board and metal on the fine grid, degC, (m,) each."""
    seconds = 60.0 * sort.minutes
    demand = demands(sort.chamber, seconds, HEAT_STEP_S)
    at = (np.arange(len(demand)) + 0.5) * HEAT_STEP_S
    air = chamber_air(demand, HEAT_STEP_S, SHOCK_K_PER_MIN if sort.code == "SH" else CHAMBER_K_PER_MIN)
    if len(sort.chamber) == 1 and sort.code != "CS":
        period_s, phase = 60.0 * rng.uniform(18.0, 35.0), rng.uniform(0.0, 2.0 * math.pi)
        air = air + AIR_WAVE_K * np.sin(2.0 * math.pi * at / period_s + phase)
    each = round(HEAT_STEP_S / STEP_S)
    speed = np.abs(rate_dps).reshape(-1, each).mean(axis=1)
    followed = heat_of(unit).followed(air, speed, powered_s)
    fine = (np.arange(len(rate_dps)) + 0.5) * STEP_S
    # a step of the heat's grid ends with its value
    ends = np.concatenate(([0.0], at + 0.5 * HEAT_STEP_S))
    columns = [np.concatenate((row[:1], row)) for row in (air, *followed)]
    return [np.asarray(np.interp(fine, ends, column)) for column in columns]


def campaign(unit: Unit) -> list[Stage]:
    """Return all runs of a unit."""
    return in_rounds(SORTS, lambda sort, repeat, number: make_stage(unit, sort, repeat, number))


# reading ------------------------------------------------------------------------------------------------------

THERMOMETER_WORD_K = 1.0 / 128.0
THERMOMETER_NOISE_K = 0.01
ENCODER_DEG = 0.36 / 3600.0


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return what thermometers and encoder say: means over rows with noise, whole counts of angle."""
    n = len(stage.valid)
    t_in, t_out = (
        stage.in_rows(felt) + THERMOMETER_NOISE_K * rng.standard_normal(n)
        for felt in (stage.t_in_c, stage.t_out_c)
    )
    angle = ENCODER_DEG * np.round(stage.at_edges(stage.angle_deg) / ENCODER_DEG)
    return t_in, t_out, angle
