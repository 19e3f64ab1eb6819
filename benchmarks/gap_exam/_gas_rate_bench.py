"""The bench of gas rate gyros: heat through plate, case, gas and pump, a chamber with a compressor, a belt-driven
table, the campaign of a production lab.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from benchmarks.gap_exam._campaign import Sort, at_rest, demands, in_rounds
from benchmarks.gap_exam._family import Unit
from benchmarks.gap_exam._signals import drawn, follow
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

LATITUDE_DEG = 35.0
ENCODER_DEG = 360.0 / 2**18
FULL_SCALE_DPS = 100.0
NODES = ("plate", "case", "gas", "pump")
CAPACITY_J_PER_K = np.array([1500.0, 120.0, 18.0, 9.0])
TO_AIR_W_PER_K = np.array([2.5, 0.06, 0.0, 0.0])
BETWEEN_W_PER_K = {(0, 1): 0.5, (1, 2): 0.12, (1, 3): 0.09, (2, 3): 0.03}
HEAT_W = np.array([0.0, 0.15, 0.35, 0.6])
"""Electronics on the case, wires in the gas, pump."""
THERMISTOR_S = 45.0
"""The bead is glued into the case's wall."""
CHAMBER_S = 100.0
_BELT_S = (0.12, 0.08)
_DPS2 = 150.0
_CYCLE_S = 240.0
_RIPPLE_K = 0.15
_ROOM_C = 25.0
_SETTLES_S = 15.0


@dataclass(frozen=True, eq=False)
class Heat:
    """A linear heat network as modes: dT/dt = -A (T - air) + heat / C, A = V diag(poles) V^-1."""

    poles_per_s: Array
    vectors: Array
    inverse: Array

    def warmed(self, since_s: Array) -> Array:
        """Return by how much the gyro's own heat has warmed the nodes since power-up, K, (nodes, m)."""
        drive = (self.inverse @ (HEAT_W / CAPACITY_J_PER_K))[:, None] / self.poles_per_s[:, None]
        return np.asarray(self.vectors @ (drive * -np.expm1(-self.poles_per_s[:, None] * since_s)))

    def followed(self, air_c: Array, step_s: float) -> Array:
        """Return the nodes' temperatures behind an air temperature (m,), settled at the first, (nodes, m)."""
        shares = self.inverse.sum(axis=1)
        modes = []
        for pole in self.poles_per_s:
            decay = float(np.exp(-pole * step_s))
            modes.append(lfilter([1.0 - decay], [1.0, -decay], air_c, zi=[decay * air_c[0]])[0])
        return np.asarray(self.vectors @ (shares[:, None] * np.stack(modes)))


def conductances_w_per_k() -> Array:
    """Return the matrix of conductances, (nodes, nodes): heat that leaves a node for temperatures over air."""
    matrix = np.diag(TO_AIR_W_PER_K)
    for (a, b), value in BETWEEN_W_PER_K.items():
        matrix[[a, b], [a, b]] += value
        matrix[[a, b], [b, a]] -= value
    return matrix


def heat() -> Heat:
    """Return the gyro's network on its plate."""
    poles, vectors = np.linalg.eig(conductances_w_per_k() / CAPACITY_J_PER_K[:, None])
    return Heat(poles.real, vectors.real, np.linalg.inv(vectors.real))


def compressor(air_c: Array, step_s: float) -> Array:
    """Return whether the chamber's compressor runs, 0 or 1, (m,): a share of each cycle that grows with cold."""
    load = np.clip((_ROOM_C - air_c) / 80.0, 0.0, 0.95)
    cycle = (np.arange(len(air_c)) * step_s / _CYCLE_S) % 1.0
    return np.asarray((cycle < load).astype(float))


def chamber_air(demand_c: Array, step_s: float) -> tuple[Array, Array]:
    """Return the air behind a demand (m,), degC, with the compressor's cycles in it, and the compressor."""
    smooth = follow(demand_c, CHAMBER_S, step_s)
    runs = compressor(smooth, step_s)
    swing = runs - np.clip((_ROOM_C - smooth) / 80.0, 0.0, 0.95)
    return smooth - _RIPPLE_K * 2.0 * follow(swing, 0.25 * _CYCLE_S, step_s), runs


def driven_deg(rates: Sequence[tuple[float, float]], steps: int, step_s: float, start_deg: float) -> Array:
    """Return the table's angle at edges (steps + 1,): demands with a limited slope, behind motor and belt."""
    finer = 10
    at = (np.arange(steps * finer) + 0.5) * step_s / finer
    knots, speed = [(0.0, 0.0)], 0.0
    for begin, rate in rates:
        knots += [(begin, speed), (begin + abs(rate - speed) / _DPS2 + 1e-9, rate)]
        speed = rate
    asked = np.interp(at, [when for when, _ in knots], [value for _, value in knots])
    for lag_s in _BELT_S:
        asked = follow(asked, lag_s, step_s / finer)
    means = asked.reshape(steps, finer).mean(axis=1)
    return np.asarray(start_deg + np.concatenate(([0.0], np.cumsum(means) * step_s)))


def _stairs() -> list[tuple[float, float]]:
    """Both senses of each rate in turn, half a minute each, rests between: the largest in the middle."""
    turns, at = [], 60.0
    for rate in (4.0, 15.0, 50.0, 100.0, 75.0, 30.0, 8.0, 90.0, 60.0):
        for sense in (1.0, -1.0):
            turns += [(at, sense * rate), (at + 34.0, 0.0)]
            at += 46.0
    return turns


def _rocking() -> list[tuple[float, float]]:
    """To and fro, ever shorter: filters and clocks show where the rate changes."""
    turns, at = [], 30.0
    for half_s, rate in ((12.0, 20.0), (6.0, 35.0), (3.0, 50.0), (2.0, 60.0)):
        for k in range(2 * round(48.0 / half_s)):
            turns.append((at, rate if k % 2 == 0 else -rate))
            at += half_s
        turns.append((at, 0.0))
        at += 24.0
    return turns


def _errands() -> list[tuple[float, float]]:
    """A van's day: turns of both senses and all sizes, minutes apart."""
    rng = drawn(11, "errands")
    turns: list[tuple[float, float]] = []
    for at in np.arange(240.0, 90.0 * 60.0 - 60.0, 180.0):
        rate = float(rng.choice((-1.0, 1.0)) * np.exp(rng.uniform(np.log(6.0), np.log(95.0))))
        turns += [(float(at), rate), (float(at) + 25.0, 0.0)]
    return turns


def _headings() -> list[tuple[float, float]]:
    """Quarter turns in each position of the mount, 2 minutes between."""
    return [
        edge
        for position in range(7)
        for quarter in range(1, 4)
        for begin in (480.0 * position + 120.0 * quarter,)
        for edge in ((begin, 30.0), (begin + 3.0, 0.0))
    ]


_TUMBLE = tuple(
    (480.0 * k, elevation) for k, elevation in enumerate((90.0, 45.0, 0.0, -45.0, -90.0, 0.0, 90.0))
)
_SLOW = ((0.0, 25.0), (8.0, 25.0), (73.0, -40.0), (108.0, -40.0), (218.0, 70.0), (250.0, 70.0))
_FAST = ((0.0, 25.0), (6.0, 25.0), (21.0, 70.0), (45.0, 70.0), (82.0, -40.0), (106.0, -40.0), (128.0, 25.0))
_DAY = ((0.0, -15.0), (25.0, -15.0), (50.0, 55.0), (62.0, 40.0), (90.0, 5.0))
SORTS = (
    Sort("RL", "ramps", "slow", 250.0, _SLOW, grid=(0.5, 4)),
    Sort("RF", "ramps", "fast", 140.0, _FAST, grid=(0.5, 4)),
    Sort("ON", "switch-on", "room", 45.0, ((0.0, 22.0),), grid=(0.25, 4), powered_s=(0.0, 2.0)),
    Sort("OC", "switch-on", "cold", 45.0, ((0.0, -30.0),), 2, grid=(0.25, 4), powered_s=(0.0, 2.0)),
    Sort("SR", "stairs", "room", 15.0, ((0.0, 23.0),), turns=_stairs, grid=(0.1, 2)),
    Sort("SH", "stairs", "hot", 15.0, ((0.0, 65.0),), 2, turns=_stairs, grid=(0.1, 2)),
    Sort("SC", "stairs", "cold", 15.0, ((0.0, -35.0),), 2, turns=_stairs, grid=(0.1, 2)),
    Sort(
        "TU",
        "tumble",
        "room",
        56.0,
        ((0.0, 24.0),),
        turns=_headings,
        elevation=_TUMBLE,
        grid=(0.2, 5),
        masks=True,
    ),
    Sort("RO", "rocking", "room", 9.0, ((0.0, 23.0),), 2, turns=_rocking, grid=(0.1, 1)),
    Sort(
        "RX",
        "rocking",
        "level",
        9.0,
        ((0.0, 23.0),),
        2,
        turns=_rocking,
        elevation=((0.0, 0.0),),
        grid=(0.1, 1),
    ),
    Sort("VD", "van day", "all", 90.0, _DAY, 2, 2, turns=_errands, grid=(0.25, 2)),
)


def campaign(unit: Unit, lost: float = 0.0) -> list[Stage]:
    """Return the runs of a unit's campaign; the port loses a share `lost` of the rows beside its own pauses."""
    network = heat()
    return in_rounds(SORTS, lambda sort, k, number: _stage(unit, network, sort, k, number, lost))


def _stage(unit: Unit, network: Heat, sort: Sort, repeat: int, number: int, lost: float) -> Stage:
    rng = drawn(unit.seed, "stage", sort.code, repeat)
    step_s, per_row = sort.grid
    demand = demands(sort.chamber, 60.0 * sort.minutes, step_s) + rng.normal(0.0, 0.3)
    steps = len(demand) // per_row * per_row
    demand, time_s = demand[:steps], np.asarray((np.arange(steps) + 0.5) * step_s, np.float64)
    air, runs = chamber_air(demand, step_s)
    on_s = float(rng.uniform(*sort.powered_s))
    nodes = network.followed(air, step_s) + network.warmed(time_s + on_s)
    bodies = {**dict(zip(NODES, nodes, strict=True)), "air": air, "compressor": runs}
    # the operator sets the table by eye before a run
    angle = driven_deg(sort.turns(), steps, step_s, sort.start_deg + float(rng.uniform(0.0, 5.0)))
    mounted_s, elevation = sort.elevations(time_s)
    edges = np.asarray(np.arange(0, steps + 1, per_row) * step_s, np.float64)
    n = len(edges) - 1
    valid = at_rest(sort.turns(), mounted_s, edges, _SETTLES_S) if sort.masks else np.ones(n, bool)
    # the tool closes its file and opens the next one: two rows in 1024 are not written
    kept = (np.arange(n) + int(rng.integers(1024))) % 1024 > 1
    if lost:
        kept &= rng.uniform(size=n) >= lost
    # the row that ends a log is always there
    kept[-1] = True
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
        t_in_c=follow(bodies["case"], THERMISTOR_S, step_s),
        t_out_c=bodies["plate"],
        edges_s=edges,
        valid=valid,
        kept=kept,
        phases=(("run", 0.0),),
        power_on_s=on_s,
        held_out=repeat >= sort.repeats - sort.held_out,
    )
