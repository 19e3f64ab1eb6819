"""Odd recorders: laboratories with habits of their own, their chambers and tables, and what their logs say.

A habit is nothing of the gyro: coarse thermometers, a rounded or commanded rate, ticks of a clock, lost rows. The
chain of heat is air, case, coil and board; the inner thermometer sits on the coil, the outer one on the case.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from benchmarks.gap_exam._campaign import Rates, Sort, demands, in_rounds, motor_deg, to_and_fro
from benchmarks.gap_exam._family import Unit
from benchmarks.gap_exam._recorders_lab import Lab, draw_lab, row_edges
from benchmarks.gap_exam._signals import drawn, follow
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

HEAT_S = 2.0
"""Step of the heat's integration."""
SETTLES_S = 15.0
"""What a lab that blanks moves waits after them."""
FILTER_ROWS = 1.0 / math.sqrt(2.0)
"""Half width of the triangular filter in rows: its variance is that of a mean over a row."""
_EIGHTHS = tuple((k - 3.5) / 8.0 for k in range(8))
_TOP_DPS = 40.0
_COARSE, _MIDDLE, _FINE = (0.1, 1), (0.025, 1), (0.0125, 1)
_ROWS = {"RT": 1, "RC": 1, "RH": 1, "MX": 1, "ST": 2, "SL": 2, "TU": 2, "HE": 2}
"""Which of a lab's rates of rows a sort has; the first where it is not here."""


@dataclass(frozen=True, eq=False)
class Recorded(Stage):
    """A run in a laboratory: `told_deg` (m + 1,) is the angle commanded, `fan` (m,) 1 or 0."""

    lab: Lab | None = None
    told_deg: Array | None = None
    fan: Array | None = None

    @property
    def habits(self) -> Lab:
        if self.lab is None:
            raise ValueError("the run has no laboratory")
        return self.lab

    @property
    def filtered(self) -> bool:
        """Whether rows are points behind a filter: slow rows are always means."""
        return self.habits.sampled and float(np.median(np.diff(self.edges_s))) < 0.15

    def in_rows(self, signal: Array) -> Array:
        """Return means over rows, or points at their middles behind a triangular filter, (n,)."""
        if not self.filtered:
            return super().in_rows(signal)
        wide_s = FILTER_ROWS * float(np.median(np.diff(self.edges_s)))
        middles = 0.5 * (self.edges_s[1:] + self.edges_s[:-1])
        sums = np.concatenate(([0.0], np.cumsum(signal) * self.step_s))
        grid = np.arange(self.steps + 1) * self.step_s

        def mean_about(at_s: Array) -> Array:
            ends = [np.interp(at_s + half * wide_s, grid, sums) for half in (-0.5, 0.5)]
            return np.asarray((ends[1] - ends[0]) / wide_s)

        return np.asarray(np.mean([mean_about(middles + q * wide_s) for q in _EIGHTHS], axis=0))


# heat ---------------------------------------------------------------------------------------------------------


def exchange_per_s(unit: Unit) -> Array:
    """Return the exchange of heat (3, 4), 1/s: case, coil and board with case, coil, board and air."""
    a, b, c = (0.8 + 0.4 * unit.draw[name] for name in ("a", "b", "c"))
    minutes = np.array(
        [
            [np.inf, 25.0, 20.0, 6.0 * a],
            [9.0 * b, np.inf, 40.0, np.inf],
            [7.0 * c, 45.0, np.inf, np.inf],
        ]
    )
    return np.asarray(1.0 / (60.0 * minutes))


def board_heat_k_per_s(unit: Unit) -> float:
    """Return the board's own heat: 4 to 7 K over the case if it went there alone."""
    return float((4.0 + 3.0 * unit.draw["g1"]) * exchange_per_s(unit)[2, 0])


def settled_c(unit: Unit, air_c: float) -> Array:
    """Return the temperatures of case, coil and board in still air, degC, (3,)."""
    flows = exchange_per_s(unit)
    matrix = np.diag(flows.sum(axis=1)) - flows[:, :3]
    heat = np.array([0.0, 0.0, board_heat_k_per_s(unit)])
    return np.asarray(np.linalg.solve(matrix, flows[:, 3] * air_c + heat))


def warmed_c(unit: Unit, air_c: Array, draught: Array, board_off_k: float = 0.0) -> Array:
    """Return case, coil and board, degC, (3, n), for air (n,) every HEAT_S; `draught` (n,) scales its grip."""
    flows = exchange_per_s(unit) * HEAT_S
    inner, outer = flows[:, :3], float(flows[0, 3])
    losses = np.diag(inner.sum(axis=1)) - inner
    heat = np.array([0.0, 0.0, board_heat_k_per_s(unit) * HEAT_S])
    now = settled_c(unit, float(air_c[0])) + np.array([0.0, 0.3, 1.0]) * board_off_k
    result = np.empty((len(air_c), 3))
    for k, (air, grip) in enumerate(zip(air_c.tolist(), draught.tolist(), strict=True)):
        result[k] = now
        now = now - losses @ now + heat
        now[0] += outer * grip * (air - result[k, 0])
    return result.T


def _air(lab: Lab, sort: Sort, seconds: float, rng: np.random.Generator) -> Array:
    """Return the chamber's air in steps of HEAT_S: it follows, cycles, and starts where the last run left it."""
    spread = rng.normal(0.0, lab.start_spread_k) if lab.start_spread_k else 0.0
    wanted = demands(sort.chamber, seconds, HEAT_S)
    time_s = (np.arange(len(wanted)) + 0.5) * HEAT_S
    wanted = wanted + spread * np.exp(-time_s / 400.0)
    cycles = time_s / lab.swing_s + rng.uniform()
    swing = lab.swing_k * (4.0 * np.abs(cycles - np.floor(cycles + 0.5)) - 1.0)
    return follow(wanted, 100.0, HEAT_S) + follow(swing, 20.0, HEAT_S)


def _fan(steps: int, rng: np.random.Generator) -> Array:
    """Return whether a fan blows, (steps,): it switches every 5 to 15 minutes."""
    ends = np.cumsum(rng.uniform(300.0, 900.0, 2 + int(steps * HEAT_S / 300.0)))
    switches = np.searchsorted(ends, (np.arange(steps) + 0.5) * HEAT_S)
    return np.asarray((switches + int(rng.integers(2))) % 2, np.float64)


# table --------------------------------------------------------------------------------------------------------


def moved_deg(lab: Lab, rates: Rates, edges_s: Array, start_deg: float, rng: np.random.Generator) -> Array:
    """Return the table's true angle at even edges (m + 1,): acceleration, creep after stops, limit cycle."""
    step_s = float(edges_s[1] - edges_s[0])
    told = motor_deg(rates, edges_s, start_deg, 1e6 if lab.motion == "first_order" else lab.dps2)
    rate = np.diff(told) / step_s
    if lab.motion == "first_order":
        rate = follow(rate, lab.smooth_s, step_s)
    elif lab.motion == "s_curve":
        wide = max(round(lab.smooth_s / step_s), 1)
        rate = uniform_filter1d(rate, wide, mode="nearest")
    angle = start_deg + np.concatenate(([0.0], np.cumsum(rate) * step_s))
    if lab.tail_deg:
        # a move ends short of its target, and creeps there
        sense = np.sign(np.where(np.abs(rate) > 0.1, rate, 0.0))
        behind = follow(follow(sense, lab.tail_s, step_s), 0.5, step_s)
        angle = angle - lab.tail_deg * np.concatenate(([behind[0]], behind))
    if lab.cycle_deg:
        wander = np.cumsum(rng.standard_normal(len(edges_s))) * math.sqrt(step_s / lab.cycle_s)
        angle = angle + lab.cycle_deg * np.sin(2.0 * math.pi * edges_s / lab.cycle_s + wander)
    return np.asarray(angle)


def blanked(
    told_deg: Array, step_s: float, mounted_s: Array, edges_s: Array, moves: bool
) -> NDArray[np.bool_]:
    """Return which rows (n,) count: none while the mount is changed, and none in and after moves if so wished."""
    spans = [(at - 10.0, at + 20.0) for at in mounted_s.tolist()]
    if moves:
        change = np.flatnonzero(np.abs(np.diff(told_deg, 2)) > 1e-7) * step_s
        spans += [(at - 1.0, at + SETTLES_S) for at in change.tolist()]
    times = np.array([time for span in spans for time in span]).reshape(-1, 2)
    begins = np.searchsorted(np.sort(times[:, 0]), edges_s[1:])
    ends = np.searchsorted(np.sort(times[:, 1]), edges_s[:-1])
    return np.asarray(begins <= ends)


def read_angle_deg(stage: Recorded) -> Array:
    """Return what the log has for the table's angle at the rows' edges, (n + 1,)."""
    lab = stage.habits
    if lab.angle == "command" and stage.told_deg is not None:
        angle = stage.at_edges(stage.told_deg)
    elif lab.angle == "rate":
        gaps = np.diff(stage.edges_s)
        true = stage.at_edges(stage.angle_deg)
        rate = 1e-3 * np.round(np.diff(true) / gaps / 1e-3)
        angle = true[0] + np.concatenate(([0.0], np.cumsum(rate * gaps)))
    else:
        angle = stage.at_edges(stage.angle_deg)
        if lab.resolver_deg:
            angle = lab.resolver_deg * np.round(angle / lab.resolver_deg)
    return np.asarray(np.mod(angle, 360.0) if lab.wrapped else angle)


def read_temperatures_c(unit: Unit, stage: Recorded) -> tuple[Array, Array]:
    """Return the readings of the inner and the outer thermometer in every row, degC, (n,) each."""
    lab, at = stage.habits, stage.edges_s[1:]
    inner = lab.inside.read(stage.t_in_c, stage.step_s, at, drawn(unit.seed, "inner", stage.key))
    return inner, lab.outside.read(stage.t_out_c, stage.step_s, at, drawn(unit.seed, "outer", stage.key))


# runs ---------------------------------------------------------------------------------------------------------


def stepwise(rates: Sequence[float], begin_s: float, dwell_s: float, rest_s: float) -> Rates:
    """Return rates one after the other, a rest behind each."""
    turns: list[tuple[float, float]] = []
    for k, rate in enumerate(rates):
        at = begin_s + k * (dwell_s + rest_s)
        turns += [(at, rate), (at + dwell_s, 0.0)]
    return turns


def indexed(places: int, begin_s: float, dwell_s: float, each_deg: float) -> Rates:
    """Return turns of 10 deg/s that index the table, a dwell before each."""
    turns: list[tuple[float, float]] = []
    for k in range(places):
        at = begin_s + (k + 1) * dwell_s
        turns += [(at, 10.0), (at + each_deg / 10.0, 0.0)]
    return turns


def recorded(unit: Unit, lab: Lab, sort: Sort, repeat: int, number: int) -> Recorded:
    """Return a run of a sort."""
    step_s = sort.grid[0]
    rng = drawn(unit.seed, "run", sort.code, repeat)
    steps = round(60.0 * sort.minutes / step_s)
    seconds = steps * step_s
    # the operator's start and the table's clock have odd fractions
    odd_s = float(rng.uniform(0.0, 1.0))
    rates = [(at + odd_s, rate) for at, rate in sort.turns()]
    grid = np.asarray(np.arange(steps + 1) * step_s, np.float64)
    angle = moved_deg(lab, rates, grid, sort.start_deg, rng)
    told = motor_deg(rates, grid, sort.start_deg, 1e6 if lab.motion == "first_order" else lab.dps2)
    air = _air(lab, sort, seconds, rng)
    fan = _fan(len(air), drawn(unit.seed, "fan", sort.code, repeat))
    off_k = -float(rng.uniform(1.0, 3.0)) if lab.early else 0.0
    draught = 1.0 - 0.3 * fan if lab.fans else np.ones(len(air))
    heat_s = (np.arange(len(air)) + 0.5) * HEAT_S
    time_s = np.asarray((np.arange(steps) + 0.5) * step_s, np.float64)
    warm = [np.interp(time_s, heat_s, body) for body in warmed_c(unit, air, draught, off_k)]
    edges = row_edges(lab, lab.rows_hz[_ROWS.get(sort.code, 0)], seconds, float(rng.uniform(0.0, 1.0)))
    mounted_s, elevation = sort.elevations(time_s)
    kept = np.ones(len(edges) - 1, bool)
    if lab.lost:
        kept[rng.integers(5, len(kept) - 5, int(rng.integers(0, lab.lost + 1)))] = False
    powered = rng.uniform(1200.0, 2400.0) if lab.early else rng.uniform(5400.0, 7200.0)
    return Recorded(
        sort.code,
        sort.profile,
        sort.condition,
        repeat,
        number,
        step_s,
        angle,
        elevation,
        {"air": np.interp(time_s, heat_s, air), **dict(zip(("case", "coil", "board"), warm, strict=True))},
        warm[1],
        warm[0],
        edges,
        blanked(told, step_s, mounted_s, edges, lab.masks and sort.masks),
        kept,
        (("all", 0.0),),
        round(float(powered), 1),
        repeat >= sort.repeats - sort.held_out,
        lab,
        told,
        np.round(np.interp(time_s, heat_s, fan)),
    )


def _sweep(minutes: float) -> Callable[[], Rates]:
    return lambda: to_and_fro(120.0, 60.0 * minutes - 120.0, 10.0, 360.0)


def sorts(lab: Lab, rng: np.random.Generator) -> list[Sort]:
    """Return the sorts of runs of a laboratory: lengths, repeats and dwells are its own."""

    def minutes(usual: float) -> float:
        return float(np.round(usual * lab.stretch * rng.uniform(0.85, 1.15)))

    more = rng.permutation(("ST", "RA", "RT", "SL", "TU"))[: int(rng.integers(3))]

    def often(code: str, usual: int) -> int:
        return usual + int(code in more)

    fast = tuple(sign * rate for rate in (5.0, 10.0, 20.0, _TOP_DPS) for sign in (1.0, -1.0))
    slow = (0.002, -0.002, -0.003, -0.005, 0.005, 0.01, -0.01, 0.02, -0.02, 0.05, -0.05)
    dwell = float(np.round(rng.uniform(35.0, 70.0)))
    rest = float(np.round(rng.uniform(20.0, 40.0)))
    place = float(np.round(rng.uniform(90.0, 150.0)))
    room, cold, hot = 25.0, float(rng.uniform(-28.0, -15.0)), float(rng.uniform(48.0, 60.0))
    ramp, soak, turned, stand = minutes(120.0), minutes(100.0), minutes(75.0), minutes(60.0)
    rates_min = (60.0 + len(fast) * (dwell + rest)) / 60.0 + 2.0
    slow_min = (60.0 + len(slow) * (2.0 * dwell + 20.0)) / 60.0 + 2.0
    tumble = tuple((k * 2.0 * place, e) for k, e in enumerate((90.0, 45.0, 0.0, -45.0, -90.0, 0.0, 90.0)))
    shapes = [(0.0, room), (10.0, room), (0.38 * ramp, cold), (0.75 * ramp, hot), (ramp, room)]
    soaks = [(0.0, room), (8.0, room), (0.15 * soak, -10.0), (0.5 * soak, -10.0), (0.62 * soak, 42.0)]

    def rates_at(code: str, condition: str, air_c: float, repeats: int) -> Sort:
        turns = partial(stepwise, fast, 60.0, dwell, rest)
        return Sort(
            code, "rates", condition, rates_min, [(0.0, air_c)], repeats, turns=turns, grid=_FINE, masks=True
        )

    def still(
        code: str, profile: str, length: float, chamber: list[tuple[float, float]], repeats: int
    ) -> Sort:
        return Sort(code, profile, "up", length, chamber, repeats, grid=_COARSE)

    shock = [(0.0, room), (8.0, room), (10.0, hot), (30.0, hot), (32.0, room)]
    result = [
        still("ST", "standing", stand, [(0.0, room)], often("ST", 2)),
        still("RA", "ramp", ramp, shapes, often("RA", 3)),
        still("SO", "soaks", soak, soaks, 2),
        still("SH", "shock", 60.0, shock, 2),
        rates_at("RT", "room", room, often("RT", 3)),
        rates_at("RC", "cold", cold, 2),
        rates_at("RH", "hot", hot, 2),
        Sort(
            "SL", "slow", "room", slow_min, [(0.0, room)], often("SL", 2),
            turns=lambda: stepwise(slow, 60.0, 2.0 * dwell, 20.0), grid=_MIDDLE,
        ),
        Sort(
            "TU", "tumble", "room", 14.0 * place / 60.0, [(0.0, room)], often("TU", 2),
            elevation=tumble, start_deg=90.0 * int(rng.integers(4)), grid=_MIDDLE,
        ),
        Sort(
            "HE", "headings", "level", 9.0 * (place + 5.0) / 60.0 + 1.0, [(0.0, room)], 2,
            turns=lambda: indexed(8, 0.0, place, 45.0), elevation=((0.0, 0.0),), grid=_MIDDLE,
        ),
        Sort(
            "TR", "turned ramp", "up", turned, [(0.0, cold), (10.0, cold), (0.8 * turned, hot)], 2,
            turns=_sweep(turned), grid=_COARSE,
        ),
        Sort(
            "MX", "mission", "mixed", 40.0, [(0.0, 10.0), (5.0, 10.0), (25.0, 45.0)], 1, 1,
            turns=lambda: [*stepwise((15.0, -30.0, 25.0, -5.0), 200.0, 100.0, 80.0), *stepwise(
                (0.01, -0.004, 8.0), 1300.0, 200.0, 60.0)], grid=_FINE,
        ),
    ]  # fmt: skip
    # a lab lists its sorts as it likes
    return [result[k] for k in rng.permutation(len(result) - 1)] + result[-1:]


def campaign(unit: Unit) -> list[Stage]:
    """Return all runs of the laboratory that has a unit."""
    lab = draw_lab(unit)
    return in_rounds(
        sorts(lab, drawn(unit.seed, "sorts")),
        lambda sort, repeat, number: recorded(unit, lab, sort, repeat, number),
    )
