"""A hemispherical resonator gyro in whole-angle mode: its data sheet, its lab's campaign, noise and logs."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap_exam._campaign import Sort, at_rest, demands, in_rounds, motor_deg, to_and_fro
from benchmarks.gap_exam._family import Family, Layout, Sheet, Unit
from benchmarks.gap_exam._hemispherical_bench import BODIES, Fan, belted, chambered
from benchmarks.gap_exam._hemispherical_effects import EFFECTS, LATITUDE_DEG
from benchmarks.gap_exam._signals import drawn, flicker, follow, walk
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

SHEET = Sheet(0.003, 0.008, 0.006, 0.02, 20.0, 0.4, 0.02)
LAYOUT = Layout(
    ".csv", ("hrg_rate", "deg/h"), ("table", "deg"), clock="2026-03-02T06:30:00", temperature_word_k=0.03125
)
NOISY = {
    "amplifier": (1.6, 5.0, "noise_level"),
    "flicker": (4.0, 12.0, "bias_instability"),
    "wander": (5.0, 25.0, "rate_random_walk"),
    "counter": (20.0, 120.0, "quantisation"),
    "held_words": (0.005, 0.06, "lost_frames"),
}
"""The last is the share of rows in which the logger has the word before, and no factor."""
_FAST_S, _SLOW_S = 1.0 / 37.5, 4.0 / 37.5
_ROWS_OF = 10
_ROW_S = _SLOW_S * _ROWS_OF
"""Slow logs have means over 40 of the gyro's words."""
_DPS2 = 300.0
_WORD_K = LAYOUT.temperature_word_k
_ENCODER_DEG = 1e-6
_SENSOR_S = 6.0
_MOVING_S = 6.0
RATES_DPS = (1.0, 3.0, 8.0, 20.0, 45.0, 90.0)
_CABLE_DEG = 1080.0
_RAMP = (
    (0.0, 25.0),
    (8.0, 25.0),
    (36.0, 53.0),
    (48.0, 53.0),
    (112.0, -9.0),
    (126.0, -9.0),
    (160.0, 25.0),
    (172.0, 25.0),
)
_STAIRS = (
    (0.0, 25.0), (20.0, 25.0), (22.0, 44.0), (46.0, 44.0), (48.0, 33.0), (68.0, 33.0),
    (72.0, 2.0), (100.0, 2.0), (103.0, 16.0), (125.0, 16.0),
)  # fmt: skip
_SECTOR_RAMP = ((0.0, 25.0), (6.0, 25.0), (30.0, 49.0), (38.0, 49.0), (86.0, 1.0), (94.0, 1.0), (112.0, 19.0))
_SHIFT = ((0.0, 25.0), (12.0, 25.0), (26.0, 39.0), (50.0, 39.0), (74.0, 8.0), (90.0, 8.0), (105.0, 20.0))
_LEVEL = ((0.0, 25.0),)


def _positions() -> list[tuple[float, float]]:
    """Return turns by 45 deg, 15 deg/s, every 150 s; from second 1200 on half turns."""
    eighths = [(150.0 * k, 45.0) for k in range(1, 8)]
    halves = [(1500.0, 180.0), (1950.0, 180.0)]
    moves = [((at, 15.0), (at + by / 15.0, 0.0)) for at, by in eighths + halves]
    return [change for move in moves for change in move]


def _rate_steps() -> list[tuple[float, float]]:
    """Return every rate there and back, as far as the cable lets it."""
    rates, at = [], 40.0
    for rate in RATES_DPS:
        span = min(45.0, _CABLE_DEG / rate)
        rates += [(at, rate), (at + span, 0.0), (at + span + 15.0, -rate), (at + 2.0 * span + 15.0, 0.0)]
        at += 2.0 * span + 30.0
    return rates


def _swinging() -> list[tuple[float, float]]:
    """Return swings of 30 deg, faster and faster: 3 to 45 deg/s."""
    rates, at = [], 20.0
    for rate in (3.0, 6.0, 12.0, 20.0, 30.0, 45.0):
        until = at + 6.0 * max(30.0 / rate, 4.0)
        rates += to_and_fro(at, until, rate, 30.0)
        at = until + 5.0
    return rates


def _slow_turns() -> list[tuple[float, float]]:
    return [(30.0, 1.5), (750.0, 0.0), (780.0, -1.5), (1500.0, 0.0)]


SORTS = (
    Sort("PO", "positions", "level, then up and down", 37.0, _LEVEL, turns=_positions, masks=True,
         elevation=((0.0, 0.0), (1230.0, 90.0), (1680.0, -90.0)), grid=(_SLOW_S, _ROWS_OF)),
    Sort("TR", "chamber ramp", "axis up", 172.0, _RAMP, grid=(_ROW_S, 1)),
    Sort("ST", "chamber stairs", "axis level west", 125.0, _STAIRS, start_deg=90.0,
         elevation=((0.0, 0.0),), grid=(_ROW_S, 1)),
    Sort("WU", "switch on", "axis up", 75.0, _LEVEL, grid=(_ROW_S, 1), powered_s=(0.0, 0.0)),
    Sort("LR", "long rest", "axis level north", 150.0, _LEVEL, elevation=((0.0, 0.0),),
         grid=(_ROW_S, 1)),
    Sort("RT", "rate steps", "axis up", 15.0, _LEVEL, turns=_rate_steps, start_deg=-540.0, grid=(_FAST_S, 1)),
    Sort("SW", "swinging", "axis up", 8.0, _LEVEL, repeats=2, held_out=0, turns=_swinging, grid=(_FAST_S, 1)),
    Sort("SP", "slow turns", "axis up", 26.0, _LEVEL, turns=_slow_turns, start_deg=-540.0,
         grid=(_SLOW_S, _ROWS_OF)),
    Sort("RR", "sector in ramp", "axis up", 112.0, _SECTOR_RAMP,
         turns=lambda: to_and_fro(60.0, 6600.0, 12.0, 48.0), start_deg=-24.0, grid=(_SLOW_S, _ROWS_OF)),
    Sort("MX", "mixed shift", "axis up", 105.0, _SHIFT, repeats=1, held_out=1,
         turns=lambda: [*to_and_fro(1500.0, 2700.0, 12.0, 48.0), (2800.0, 5.0), (2834.0, 0.0),
                        *to_and_fro(4000.0, 5000.0, 20.0, 60.0)], grid=(_SLOW_S, _ROWS_OF)),
)  # fmt: skip
"""The runs in the order of a round; the lab does all sorts, then all again."""


def campaign(unit: Unit) -> list[Stage]:
    """Return the campaign of a unit: 27 runs, the first of each sort before the second."""
    return in_rounds(SORTS, lambda sort, repeat, number: _stage(unit, sort, repeat, number))


def _stage(unit: Unit, sort: Sort, repeat: int, number: int) -> Stage:
    rng = drawn(unit.seed, "stage", sort.code, repeat)
    fine_s, rows_of = sort.grid
    row_s = fine_s * rows_of
    n = int(sort.minutes * 60.0 / row_s)
    m = n * rows_of
    edges = np.arange(m + 1, dtype=np.float64) * fine_s
    fan = Fan(260.0 + 150.0 * unit.draw["b"], float(rng.uniform()))
    points = [(minute, value + 0.3 * float(rng.normal())) for minute, value in sort.chamber]
    wanted = demands(points, 60.0 * sort.minutes + 2.0 * _ROW_S, _ROW_S)
    cold = sort.powered_s[1] == 0.0
    kept = chambered(wanted, _ROW_S, fan, cold_start=cold)
    middles = 0.5 * (edges[1:] + edges[:-1])
    coarse = (np.arange(len(wanted)) + 0.5) * _ROW_S
    bodies = {name: np.interp(middles, coarse, kept[name]) for name in BODIES}
    rates = sort.turns()
    motor = motor_deg(rates, edges, sort.start_deg + float(rng.normal(0.0, 0.2)), _DPS2)
    table = belted(motor, fine_s) if rates else motor
    mounted, elevation = sort.elevations(middles)
    row_edges = edges[::rows_of]
    valid = np.ones(n, bool)
    if sort.masks:
        valid = at_rest(rates, mounted, row_edges, _MOVING_S)
    return Stage(
        sort.code, sort.profile, sort.condition, repeat, number, fine_s, table, elevation, bodies,
        follow(bodies["flange"], _SENSOR_S, fine_s), follow(bodies["can"], _SENSOR_S, fine_s),
        row_edges, valid, _received(n, row_s, rng), (("run", 0.0),),
        float(rng.uniform(*sort.powered_s)),
        repeat >= sort.repeats - sort.held_out,
    )  # fmt: skip


def _received(rows: int, row_s: float, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Return which rows the file has: some three times an hour the link loses a second or a few."""
    kept = np.ones(rows, bool)
    for at in rng.integers(10, rows - 40, int(rng.poisson(3.0 * rows * row_s / 3600.0))):
        kept[at : at + 1 + int(rng.exponential(2.0) / row_s)] = False
    kept[-10:] = True
    return kept


def rows(unit: Unit, stage: Stage, true_dph: Array, rng: np.random.Generator) -> Array:
    """Return the logged rate, deg/h, (n,): noise of the resonator and its electronics, an angle in counts."""
    sheet, factor = unit.sheet, unit.inside.get
    gaps = np.diff(stage.edges_s)
    # a unit is a little better than its data sheet
    white = (0.93 + 0.07 * unit.draw["g1"]) * sheet.arw_deg_per_sqrt_h * factor("amplifier", 1.0)
    rate = true_dph + 60.0 * white / np.sqrt(gaps) * rng.standard_normal(len(gaps))
    rate = rate + flicker(sheet.bias_instability_dph * factor("flicker", 1.0), gaps, rng)
    rate = rate + walk(sheet.rate_random_walk_dph_per_sqrt_h * factor("wander", 1.0), gaps, rng)
    count = sheet.quantum_arcsec * factor("counter", 1.0)
    angle = count * np.round(np.cumsum(np.concatenate(([rng.uniform() * count], rate * gaps))) / count)
    counted = np.diff(angle) / gaps
    held = rng.uniform(size=len(gaps)) < factor("held_words", 0.0)
    held[0] = False
    return np.asarray(counted[np.maximum.accumulate(np.where(held, 0, np.arange(len(gaps))))])


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return the 12-bit words of flange and can, degC, (n,), and the table's encoder, deg, (n + 1,)."""

    def words(felt: Array) -> Array:
        noisy = stage.in_rows(felt) + rng.normal(0.0, 0.02, len(stage.edges_s) - 1)
        return np.asarray(_WORD_K * np.clip(np.round(noisy / _WORD_K), -2048, 2047))

    angle = _ENCODER_DEG * np.round(stage.at_edges(stage.angle_deg) / _ENCODER_DEG)
    return words(stage.t_in_c), words(stage.t_out_c), np.asarray(angle)


HEMISPHERICAL = Family(
    "hemispherical_resonator", LATITUDE_DEG, SHEET, LAYOUT, EFFECTS, NOISY, campaign, rows, read
)
