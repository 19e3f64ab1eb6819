"""One gyro of a fibre-optic strapdown triad: its data sheet, its lab's campaign, noise and logs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap_exam._campaign import Rates, Sort, at_rest, demands, in_rounds, motor_deg, to_and_fro
from benchmarks.gap_exam._family import Family, Layout, Sheet, Unit
from benchmarks.gap_exam._signals import drawn, flicker, follow, walk
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._strapdown_bench import BODIES, CHAMBER_S, chambered, hydraulic
from benchmarks.gap_exam._strapdown_effects import EFFECTS, LATITUDE_DEG
from drivers.base.arrays import Array

SHEET = Sheet(0.006, 0.02, 0.015, 0.08, 40.0, 0.8, 0.05)
LAYOUT = Layout(".parquet", ("gyro_z", "deg/s"), ("piston", "rad"), "K")
NOISY = {
    "weak_light": (1.5, 5.0, "noise_level"),
    "flicker": (3.0, 10.0, "bias_instability"),
    "wander": (4.0, 25.0, "rate_random_walk"),
    "coarse_counts": (8.0, 60.0, "quantisation"),
    "frozen_words": (0.005, 0.06, "lost_frames"),
}
"""The last is the share of rows in which the logger has the word before, and no factor."""
_STEP_S = 0.1
_SENSOR_S = 12.0
_SETTLES_S = 4.0
_DPS2 = 80.0
_RESOLVER_DEG = 2e-6
RATES_DPS = (0.5, 2.0, 10.0, 30.0, 75.0, 150.0)
_LEVEL = ((0.0, 25.0),)
_CYCLE = (
    (0.0, 25.0),
    (4.0, 25.0),
    (9.0, 62.0),
    (22.0, 62.0),
    (36.0, -38.0),
    (52.0, -38.0),
    (62.0, 25.0),
    (70.0, 25.0),
)
_PLUNGE = (
    (0.0, 25.0),
    (5.0, 25.0),
    (5.2, -25.0),
    (24.0, -25.0),
    (24.2, 45.0),
    (42.0, 45.0),
    (42.2, 20.0),
    (52.0, 20.0),
)
_RATE_CYCLE = (
    (0.0, 25.0),
    (5.0, 25.0),
    (12.0, 57.0),
    (28.0, 57.0),
    (42.0, -22.0),
    (58.0, -22.0),
    (68.0, 25.0),
    (70.0, 25.0),
)
_DAY = ((0.0, 25.0), (6.0, 25.0), (14.0, 48.0), (26.0, 48.0), (42.0, -12.0), (54.0, -12.0), (60.0, 5.0))


def _positions() -> Rates:
    """Return turns by 60 deg, 20 deg/s, every 180 s; then half turns, axis up and down."""
    moves = [(180.0 * k, 60.0) for k in range(1, 6)] + [(1350.0, 180.0), (1830.0, 180.0)]
    return [change for at, by in moves for change in ((at, 20.0), (at + by / 20.0, 0.0))]


def _rate_steps() -> Rates:
    """Return every rate there and back."""
    rates, at = [], 30.0
    for rate in RATES_DPS:
        rates += [(at, rate), (at + 40.0, 0.0), (at + 55.0, -rate), (at + 95.0, 0.0)]
        at += 120.0
    return rates


def _swinging() -> Rates:
    """Return swings of 20 deg, faster and faster: 1 to 25 deg/s."""
    rates, at = [], 20.0
    for rate in (1.0, 3.0, 8.0, 15.0, 25.0):
        until = at + max(4.0 * 20.0 / rate, 80.0)
        rates += to_and_fro(at, until, rate, 20.0)
        at = until + 6.0
    return rates


SORTS = (
    Sort("PS", "six headings", "level, then up and down", 38.0, _LEVEL, turns=_positions, masks=True,
         elevation=((0.0, 0.0), (1140.0, 90.0), (1600.0, -90.0))),
    Sort("CY", "nitrogen cycle", "axis up", 70.0, _CYCLE),
    Sort("PL", "plunge", "axis level east", 52.0, _PLUNGE, start_deg=270.0, elevation=((0.0, 0.0),)),
    Sort("ON", "switch on", "axis level north", 45.0, _LEVEL, elevation=((0.0, 0.0),), powered_s=(0.0, 0.0)),
    Sort("RE", "rest", "axis level north", 60.0, _LEVEL, elevation=((0.0, 0.0),)),
    Sort("RS", "rate steps", "axis up", 13.0, _LEVEL, turns=_rate_steps),
    Sort("WE", "through west", "axis level", 25.0, _LEVEL, start_deg=80.0, elevation=((0.0, 0.0),),
         turns=lambda: [(60.0, 1.0 / 30.0), (660.0, 0.0), (780.0, -1.0 / 30.0), (1380.0, 0.0)]),
    Sort("SW", "swinging", "axis up", 12.0, _LEVEL, repeats=2, held_out=0, turns=_swinging,
         powered_s=(60.0, 90.0)),
    Sort("RC", "swing in cycle", "axis up", 70.0, _RATE_CYCLE, powered_s=(240.0, 300.0),
         turns=lambda: to_and_fro(60.0, 4100.0, 40.0, 1000.0)),
    Sort("DY", "day of work", "axis up", 60.0, _DAY, repeats=1,
         turns=lambda: [*to_and_fro(300.0, 1200.0, 20.0, 300.0), (1300.0, 15.0), (1306.0, 0.0),
                        *to_and_fro(2000.0, 3000.0, 60.0, 1200.0)]),
)  # fmt: skip
"""The runs in the order of a round; the lab does all sorts, then all again."""


def campaign(unit: Unit) -> list[Stage]:
    """Return the campaign of a unit: 27 runs, the first of each sort before the second."""
    return in_rounds(SORTS, lambda sort, repeat, number: _stage(unit, sort, repeat, number))


def _stage(unit: Unit, sort: Sort, repeat: int, number: int) -> Stage:
    rng = drawn(unit.seed, "stage", sort.code, repeat)
    n = round(sort.minutes * 60.0 / _STEP_S)
    edges = np.arange(n + 1, dtype=np.float64) * _STEP_S
    middles = edges[1:] - 0.5 * _STEP_S
    points = [(minute + 0.05 * float(rng.uniform()), value) for minute, value in sort.chamber]
    points = [(minute, value + 0.2 * float(rng.normal())) for minute, value in points]
    wanted = demands(points, 60.0 * sort.minutes + 2.0 * CHAMBER_S, CHAMBER_S)
    kept = chambered(wanted, float(rng.uniform()), cold_start=sort.powered_s[1] == 0.0)
    coarse = np.arange(len(wanted)) * CHAMBER_S
    bodies = {name: np.interp(middles, coarse, kept[name]) for name in BODIES}
    rates = sort.turns()
    demand = motor_deg(rates, edges, sort.start_deg + float(rng.normal(0.0, 0.3)), _DPS2)
    mounted, elevation = sort.elevations(middles)
    valid = at_rest(rates, mounted, edges, _SETTLES_S) if sort.masks else np.ones(n, bool)
    return Stage(
        sort.code, sort.profile, sort.condition, repeat, number, _STEP_S, hydraulic(demand, _STEP_S), elevation,
        bodies, follow(bodies["hub"], _SENSOR_S, _STEP_S), follow(bodies["housing"], _SENSOR_S, _STEP_S),
        edges, valid & _received(n, rng), np.ones(n, bool), (("run", 0.0),), float(rng.uniform(*sort.powered_s)),
        repeat >= sort.repeats - sort.held_out,
    )  # fmt: skip


def _received(rows: int, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which rows have an output, (n,): twice an hour the recorder's buffer runs over for some seconds."""
    there = np.ones(rows, bool)
    for at in rng.integers(50, rows - 300, int(rng.poisson(2.0 * rows * _STEP_S / 3600.0))):
        there[at : at + 5 + int(rng.exponential(25.0))] = False
    return there


def rows(unit: Unit, stage: Stage, true_dph: Array, rng: np.random.Generator) -> Array:
    """Return the logged rate, deg/h, (n,): light's shot noise, flicker, wander, an angle in counts of a ramp."""
    sheet, factor = unit.sheet, unit.inside.get
    gaps = np.diff(stage.edges_s)
    # the sheet's value is typical: a unit may be a little better or worse
    white = (0.96 + 0.07 * unit.draw["g1"]) * sheet.arw_deg_per_sqrt_h * factor("weak_light", 1.0)
    rate = true_dph + 60.0 * white / np.sqrt(gaps) * rng.standard_normal(len(gaps))
    rate = rate + flicker(sheet.bias_instability_dph * factor("flicker", 1.0), gaps, rng)
    rate = rate + walk(sheet.rate_random_walk_dph_per_sqrt_h * factor("wander", 1.0), gaps, rng)
    count = sheet.quantum_arcsec * factor("coarse_counts", 1.0)
    angle = count * np.floor(np.cumsum(np.concatenate(([rng.uniform() * count], rate * gaps))) / count)
    counted = np.diff(angle) / gaps
    held = rng.uniform(size=len(gaps)) < factor("frozen_words", 0.0)
    held[0] = False
    return np.asarray(counted[np.maximum.accumulate(np.where(held, 0, np.arange(len(gaps))))])


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return two platinum thermometers, degC, (n,), each off by its own, and the resolver, deg, (n + 1,)."""
    wiring = drawn(unit.seed, "thermometers").normal(0.0, 0.08, 2)

    def felt(values: Array, off_k: float) -> Array:
        noisy = stage.in_rows(values) + off_k + rng.normal(0.0, 0.015, len(stage.edges_s) - 1)
        return np.asarray(np.round(noisy, 2))

    angle = _RESOLVER_DEG * np.round(stage.at_edges(stage.angle_deg) / _RESOLVER_DEG)
    return felt(stage.t_in_c, wiring[0]), felt(stage.t_out_c, wiring[1]), np.asarray(angle)


STRAPDOWN = Family("fibre_optic_strapdown", LATITUDE_DEG, SHEET, LAYOUT, EFFECTS, NOISY, campaign, rows, read)
