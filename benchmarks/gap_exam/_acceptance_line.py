"""An acceptance line: four stations, each with a logger and habits of its own, drawn anew for every unit.

The unit, a chip resonator gyro in a can, has four bodies in a row: chip, carrier, case and adapter. Air takes
heat by natural convection (power 1.25) and radiation (fourth power). The habits of a station are no effects of
the gyro: rows a second, stamps, thermometers, masks, moves, which angle is logged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap_exam._campaign import Rates, demands, in_rounds, motor_deg, to_and_fro
from benchmarks.gap_exam._campaign import Sort as PlainSort
from benchmarks.gap_exam._family import Unit
from benchmarks.gap_exam._signals import drawn, follow
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K

STATIONS = ("table", "chamber", "pier", "tumble")
STAMPS = ("even", "uneven", "jittered", "rounded", "drifting")
BODIES = ("chip", "carrier", "case", "adapter")
_CAPACITIES_J_K = (0.8, 12.0, 60.0, 400.0)
_LINKS_W_K = (0.05, 0.12, 0.35)
_LASER_W = 0.9
_CONVECTION_W = 0.05
_RADIATION_W = 0.018 * 0.8 * 5.670374419e-8
_THERMAL_S = 2.0
_ADAPTER_SHARE = 0.6
_MOUNT_S = (3.0, 12.0)
"""Seconds before and behind a change of the mount that have no output."""
_INSTANT_DPS2 = 1e9
_SPARE_S = 1.0
_ROUNDED_LATE_S = 3e-3
"""How late a row is at most where stamps are rounded."""


@dataclass(frozen=True)
class Habit:
    """How a station logs. `stamp_size`: seconds of jitter or rounding, or the ppm by which its clock is off."""

    rate_factor: float
    stamps: str
    stamp_size: float
    thermometer_noise_k: float
    thermometer_step_k: float
    outer: str
    masks: bool
    missing: float
    jerk_limited: bool
    ramp_s: float
    commanded: bool
    encoder_arcsec: float


@dataclass(frozen=True)
class Sort(PlainSort):
    """A sort of run at a station, with the rows a second that its procedure asks for.

    `sine`: amplitude, deg/s, and frequency, Hz. `store_k`: how much colder the unit came than the air.
    """

    station: str = "table"
    rows_per_s: float = 1.0
    positions: bool = False
    sine: tuple[float, float] | None = None
    store_k: float = 0.0


@dataclass(frozen=True, eq=False)
class LineStage(Stage):
    """A run whose rows were taken at true times `taken_s` (n + 1,); `edges_s` are the stamps in its file."""

    taken_s: Array = field(default_factory=lambda: np.zeros(0))
    logged_deg: Array = field(default_factory=lambda: np.zeros(0))
    habit: Habit | None = None

    def in_rows(self, signal: Array) -> Array:
        """Return the means of a signal (m,) over the true times of the rows, (n,)."""
        return self._means(signal, self.taken_s)


def habit_of(unit: Unit, station: str) -> Habit:
    """Return the habits of a station in a unit's campaign."""
    rng = drawn(unit.seed, "station", station)
    turns = station in ("table", "chamber")
    stamps = str(rng.choice(STAMPS))
    size = {
        "even": 0.0,
        "uneven": rng.uniform(1e-3, 4e-3),
        "jittered": rng.uniform(2e-5, 1e-4) if turns else rng.uniform(1e-3, 4e-3),
        "rounded": 1e-4 if turns else 1e-3,
        "drifting": rng.choice((-1.0, 1.0)) * (rng.uniform(0.3, 1.5) if turns else rng.uniform(5.0, 40.0)),
    }[stamps]
    commanded = bool(rng.uniform() < 0.35)
    return Habit(
        rate_factor=float(rng.choice((0.5, 1.0, 1.6))),
        stamps=stamps,
        stamp_size=float(size),
        thermometer_noise_k=float(rng.uniform(0.002, 0.03)),
        thermometer_step_k=float(rng.choice((0.001, 0.01, 0.0625))),
        outer=str(rng.choice(("case", "air", "demand"))) if station == "chamber" else "case",
        masks=commanded or bool(rng.uniform() < 0.5),
        missing=float(rng.choice((0.0, 0.002, 0.01))),
        jerk_limited=bool(rng.uniform() < 0.5),
        ramp_s=float(rng.uniform(0.4, 1.6)),
        commanded=commanded,
        encoder_arcsec=float(rng.uniform(0.02, 0.3)),
    )


def heat_flows(temperatures_c: Sequence[float], air_c: float, on: float) -> list[float]:
    """Return the heat that each body gains, W: links, the laser on the carrier, air at case and adapter."""
    chip, carrier, case, adapter = temperatures_c
    flows = [
        _LINKS_W_K[0] * (chip - carrier),
        _LINKS_W_K[1] * (carrier - case),
        _LINKS_W_K[2] * (case - adapter),
    ]
    lost = [_to_air(case, air_c), _ADAPTER_SHARE * _to_air(adapter, air_c)]
    return [
        0.1 * _LASER_W * on - flows[0],
        0.9 * _LASER_W * on + flows[0] - flows[1],
        flows[1] - flows[2] - lost[0],
        flows[2] - lost[1],
    ]


def _to_air(body_c: float, air_c: float) -> float:
    apart = body_c - air_c
    hot, cold = body_c + ZERO_CELSIUS_K, air_c + ZERO_CELSIUS_K
    return float(_CONVECTION_W * apart * abs(apart) ** 0.25 + _RADIATION_W * (hot**4 - cold**4))


def heated(air_c: Array, start_c: Sequence[float], on: float = 1.0) -> Array:
    """Return the bodies' temperatures, (4, n), by steps of 2 s in air (n,) from a start on."""
    state, result = list(start_c), np.empty((4, len(air_c)))
    for k, air in enumerate(air_c.tolist()):
        gains = heat_flows(state, air, on)
        state = [
            t + _THERMAL_S * gain / capacity
            for t, gain, capacity in zip(state, gains, _CAPACITIES_J_K, strict=True)
        ]
        result[:, k] = state
    return result


def campaign(unit: Unit) -> list[Stage]:
    """Return the runs of a unit's acceptance, sort by sort."""
    rng = drawn(unit.seed, "line")
    habits = {station: habit_of(unit, station) for station in STATIONS}
    sorts = _sorts(rng)
    abandoned = str(rng.choice([sort.code for sort in sorts if sort.repeats > 2]))

    def make(sort: PlainSort, repeat: int, number: int) -> Stage:
        assert isinstance(sort, Sort)
        aborted = sort.code == abandoned and repeat == 1
        return _stage(unit, sort, habits[sort.station], repeat, number, aborted)

    return in_rounds(sorts, make)


def _sorts(rng: np.random.Generator) -> list[Sort]:
    """Return the procedures of the line; repeats are uneven."""
    room = float(rng.uniform(19.0, 25.0))
    flat, warm = ((0.0, room), (400.0, room)), (5400.0, 9000.0)
    steps = [(8.0 + 24.0 * k, rate) for k, rate in enumerate((5, -5, 20, -20, 50, -50, 100, -100))]
    slow = [(20.0 + 40.0 * k, 0.004 * 2.2**k * (-1) ** k) for k in range(8)]
    tumbled = tuple((60.0 * k, e) for k, e in enumerate((90.0, 45.0, 0.0, -45.0, -90.0, -30.0, 30.0, 90.0)))
    turns = [(50.0 * k + dt, rate) for k in range(1, 9) for dt, rate in ((-6.0, 7.5), (0.0, 0.0))]
    sweep = float(rng.choice((6.0, 10.0)))

    def check() -> Rates:
        return [*to_and_fro(1200.0, 1700.0, sweep, 30.0 * sweep), (1720.0, 0.0)]

    def soak(code: str, value: float, repeats: int) -> Sort:
        points = ((0.0, value), (100.0, value))
        return Sort(code, "soak", f"at {value:g} degC", 32.0, points, repeats, 1 if repeats > 2 else 0,
                    check, station="chamber", rows_per_s=0.5, powered_s=warm)  # fmt: skip

    ramp = (
        (0.0, room),
        (10.0, room),
        (50.0, 62.0),
        (65.0, 62.0),
        (130.0, -18.0),
        (145.0, -18.0),
        (170.0, room),
    )
    shock = ((0.0, room), (8.0, room), (11.0, 55.0), (30.0, 55.0), (33.0, 0.0), (60.0, 0.0))
    return [
        Sort("RS", "rate steps", "both ways", 3.5, flat, 3, 1, lambda: [*steps, (200.0, 0.0)],
             station="table", rows_per_s=4.0, powered_s=warm),
        Sort("SI", "rate sine", "40 deg/s", 1.2, flat, int(rng.integers(2, 4)), 1, station="table",
             rows_per_s=20.0, sine=(40.0, float(rng.uniform(0.08, 0.4))), powered_s=warm),
        Sort("SL", "slow rates", "both ways", 6.0, flat, 2, 0, lambda: [*slow, (340.0, 0.0)],
             station="table", rows_per_s=1.0, powered_s=warm),
        Sort("AZ", "headings", "level", 8.0, flat, 2, 0, lambda: turns, elevation=((0.0, 0.0),),
             positions=True, station="tumble", rows_per_s=1.0, powered_s=warm),
        Sort("TU", "tumble", "eight places", 8.0, flat, 3, 1, elevation=tumbled, station="tumble",
             rows_per_s=1.0, powered_s=warm),
        soak("S1", -20.0, 1), soak("S2", 25.0, 1), soak("S3", 60.0, 1),
        Sort("RA", "ramp", "full range", 175.0, ramp, 3, 1, station="chamber", rows_per_s=0.2, powered_s=warm),
        Sort("SH", "shock", "in 3 min", 60.0, shock, 2, 0, station="chamber", rows_per_s=0.4, powered_s=warm),
        Sort("ST", "standing", "level", 130.0, flat, 2, 0, start_deg=90.0, elevation=((0.0, 0.0),),
             station="pier", rows_per_s=0.2, powered_s=warm),
        Sort("PC", "power cycle", "cold", 25.0, flat, 3, 1, station="pier", rows_per_s=0.5,
             powered_s=(2.0, 20.0), store_k=float(rng.uniform(0.0, 8.0))),
    ]  # fmt: skip


def _stage(unit: Unit, sort: Sort, habit: Habit, repeat: int, number: int, aborted: bool) -> LineStage:
    rng = drawn(unit.seed, "stage", sort.code, repeat)
    step_s = 0.02 if sort.sine else 0.1
    length_s = 60.0 * sort.minutes * (float(rng.uniform(0.4, 0.7)) if aborted else 1.0)
    edges = np.asarray(np.arange(round((length_s + _SPARE_S) / step_s) + 1) * step_s, np.float64)
    middles = 0.5 * (edges[1:] + edges[:-1])
    mounted_s, elevation = sort.elevations(middles)
    asked, angle = _angles(sort, habit, edges, step_s)
    powered_s = float(rng.uniform(*sort.powered_s))
    bodies = _temperatures(sort, powered_s, edges[-1], rng)
    at = np.arange(bodies["air"].size) * _THERMAL_S
    bodies = {name: np.asarray(np.interp(middles, at, values)) for name, values in bodies.items()}
    taken, stamps = _clock(habit, sort.rows_per_s * habit.rate_factor, length_s, rng)
    moves = _moves(sort, habit, asked, angle, step_s)
    valid = ~_touched(moves, taken, step_s)
    for when in mounted_s.tolist():
        valid &= (taken[1:] <= when - _MOUNT_S[0]) | (taken[:-1] >= when + _MOUNT_S[1])
    kept = rng.uniform(size=len(valid)) >= habit.missing
    return LineStage(
        sort.code, sort.profile, sort.condition, repeat, number, step_s, angle, elevation, bodies,
        follow(bodies["carrier"], 15.0, step_s), bodies[habit.outer], stamps, valid, kept,
        (("run", 0.0),), powered_s, repeat >= sort.repeats - sort.held_out, taken,
        asked if habit.commanded else angle, habit,
    )  # fmt: skip


def _angles(sort: Sort, habit: Habit, edges: Array, step_s: float) -> tuple[Array, Array]:
    """Return the table's angle as commanded and as it was, (m + 1,): a move takes `ramp_s`."""
    if sort.sine is not None:
        amplitude, hertz = sort.sine
        speed = 2.0 * math.pi * hertz
        sine = sort.start_deg + amplitude / speed * (1.0 - np.cos(speed * edges))
        return sine, sine
    asked = motor_deg(sort.turns(), edges, sort.start_deg, _INSTANT_DPS2)
    if not sort.turns():
        return asked, asked
    angle = asked
    for _ in range(2 if habit.jerk_limited else 1):
        angle = _smoothed(angle, round(habit.ramp_s / step_s) // 2)
    return asked, angle


def _smoothed(values: Array, half: int) -> Array:
    """Return the running means over 2 half + 1 values; ends go on as they are."""
    wide = np.pad(values, half, mode="edge")
    sums = np.concatenate(([0.0], np.cumsum(wide)))
    return np.asarray((sums[2 * half + 1 :] - sums[: -2 * half - 1]) / (2 * half + 1))


def _moves(sort: Sort, habit: Habit, asked: Array, angle: Array, step_s: float) -> NDArray[np.bool_]:
    """Return the fine steps (m,) that the station blanks."""
    if sort.positions:
        return np.asarray((np.abs(np.diff(angle)) > 1e-9) | (np.abs(np.diff(asked)) > 1e-9))
    if not habit.masks or sort.sine is not None:
        return np.zeros(len(angle) - 1, bool)
    off = np.abs(angle - asked) > 1e-9
    return np.asarray(off[1:] | off[:-1])


def _touched(moves: NDArray[np.bool_], taken: Array, step_s: float) -> NDArray[np.bool_]:
    """Return the rows (n,) that share time with some of the fine steps (m,)."""
    sums = np.concatenate(([0], np.cumsum(moves)))
    first = np.floor(taken[:-1] / step_s + 1e-6).astype(np.int64)
    last = np.minimum(np.ceil(taken[1:] / step_s - 1e-6).astype(np.int64), len(moves))
    return np.asarray(sums[last] > sums[first])


def _temperatures(
    sort: Sort, powered_s: float, end_s: float, rng: np.random.Generator
) -> Mapping[str, Array]:
    """Return the bodies, air and demand at steps of 2 s, (k,) each; before the run the unit warmed up."""
    before = max(1, round(powered_s / _THERMAL_S))
    demand = demands(sort.chamber, end_s + 2.0 * _THERMAL_S, _THERMAL_S)
    wander = 0.15 * np.sin(
        2.0 * np.pi * np.arange(len(demand)) * _THERMAL_S / 1700.0 + rng.uniform(0.0, 6.28)
    )
    air = follow(demand, 90.0, _THERMAL_S) + wander - wander[0]
    start = float(air[0]) - sort.store_k
    warm = heated(np.full(before, air[0]), (start, start, start, float(air[0])))
    bodies = heated(air, warm[:, -1].tolist())
    return {**dict(zip(BODIES, bodies, strict=True)), "air": air, "demand": demand}


def _clock(habit: Habit, rows_per_s: float, length_s: float, rng: np.random.Generator) -> tuple[Array, Array]:
    """Return the true times of the rows' edges and their stamps, (n + 1,) each."""
    taken = np.arange(int(length_s * rows_per_s + 1e-9) + 1) / rows_per_s
    late = np.concatenate(([0.0], rng.uniform(0.0, 1.0, len(taken) - 1)))
    if habit.stamps == "uneven":
        taken = taken + habit.stamp_size * late
        return taken, taken
    if habit.stamps == "jittered":
        return taken, taken + habit.stamp_size * late
    if habit.stamps == "rounded":
        taken = taken + _ROUNDED_LATE_S * late
        return taken, np.round(taken / habit.stamp_size) * habit.stamp_size
    if habit.stamps == "drifting":
        return taken, taken * (1.0 + 1e-6 * habit.stamp_size)
    return taken, taken


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return the logged temperatures (n,), degC, and the angle (n + 1,), deg, as the station has them."""
    if not isinstance(stage, LineStage) or stage.habit is None:
        return stage.in_rows(stage.t_in_c), stage.in_rows(stage.t_out_c), stage.at_edges(stage.angle_deg)
    habit, logged = stage.habit, []
    for values in (stage.t_in_c, stage.t_out_c):
        felt = stage.in_rows(values) + habit.thermometer_noise_k * rng.standard_normal(len(stage.valid))
        logged.append(np.round(felt / habit.thermometer_step_k) * habit.thermometer_step_k)
    angle = np.interp(stage.taken_s, np.arange(stage.steps + 1) * stage.step_s, stage.logged_deg)
    if not habit.commanded and stage.turning:
        angle = angle + habit.encoder_arcsec / 3600.0 * rng.standard_normal(len(angle))
    return logged[0], logged[1], np.asarray(angle)
