"""Habits of laboratories: thermometers, tables, counters and clocks that do what each lab calls normal."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.gap_exam._family import Unit
from benchmarks.gap_exam._signals import drawn
from drivers.base.arrays import Array

_ARCSEC = 1.0 / 3600.0
_MOTIONS = ("trapezoid", "s_curve", "first_order")


@dataclass(frozen=True)
class Thermometer:
    """A digital thermometer: step of its code, K, time between readings, time averaged over, noise, K.

    `dithers`: half a code of noise is added before it rounds. `held`: readings that the first one stands for.
    """

    step_k: float
    every_s: float
    average_s: float
    noise_k: float
    dithers: bool = False
    held: int = 1

    def read(self, felt_c: Array, step_s: float, at_s: Array, rng: np.random.Generator) -> Array:
        """Return the readings at times (n,) of a temperature (m,) on a grid of `step_s`, degC."""
        times = np.arange(at_s[0], at_s[-1] + self.every_s, self.every_s)
        times[1 : self.held] = times[0]
        grid = (np.arange(len(felt_c)) + 0.5) * step_s
        if self.average_s > 0.0:
            sums = np.concatenate(([0.0], np.cumsum(felt_c) * step_s))
            edges = np.arange(len(felt_c) + 1) * step_s
            since = np.maximum(times - self.average_s, 0.0)
            spans = np.maximum(times - since, step_s)
            values = (np.interp(since + spans, edges, sums) - np.interp(since, edges, sums)) / spans
        else:
            values = np.interp(times, grid, felt_c)
        values = values + self.noise_k * rng.standard_normal(len(times))
        if self.dithers:
            values = values + self.step_k * rng.uniform(-0.5, 0.5, len(times))
        values[1 : self.held] = values[0]
        codes = self.step_k * np.round(values / self.step_k)
        last = np.floor((at_s - at_s[0]) / self.every_s + 1e-6).astype(np.int64)
        return np.asarray(codes[last])


@dataclass(frozen=True)
class Lab:
    """The habits of a laboratory.

    `angle`: what its log has for the table: "resolver" in steps, "rate" read back in steps of 0.001 deg/s and
    summed, "command": such a table keeps to its ramps. `motion`: how the table accelerates. `tail_deg`: how far
    it is from the end after a stop, and creeps in `tail_s`. `cycle_deg`: amplitude of the servo's limit cycle.
    `output`: "rounded" to `word_dph` or "counted" in arcsec with the rest carried on. `sampled`: points behind an
    anti-alias filter, not means. `masks`: rows in and after moves are blank in runs of steps. `tick_s`: stamps
    stand on ticks. `rows_hz`: rows a second in runs of heat, of the table, at rest.
    """

    inside: Thermometer
    outside: Thermometer
    angle: str
    resolver_deg: float
    wrapped: bool
    motion: str
    dps2: float
    smooth_s: float
    tail_deg: float
    tail_s: float
    cycle_deg: float
    cycle_s: float
    output: str
    word_dph: float
    sampled: bool
    lost: int
    stale: int
    masks: bool
    tick_s: float
    off_ppm: float
    rows_hz: tuple[float, float, float]
    swing_k: float
    swing_s: float
    fans: bool
    early: bool
    start_spread_k: float
    stretch: float


def _thermometer(rng: np.random.Generator) -> Thermometer:
    step_k = float(rng.choice((0.01, 0.0625, 0.1, 0.5)))
    return Thermometer(
        step_k,
        float(rng.choice((1.0, 10.0, 30.0))),
        60.0 if rng.uniform() < 0.25 else 0.0,
        float(rng.uniform(0.01, 0.05)) if rng.uniform() < 0.6 else 0.0,
        bool(rng.uniform() < 0.25),
        2 if rng.uniform() < 0.3 else 1,
    )


def draw_lab(unit: Unit) -> Lab:
    """Return the habits of the laboratory that has a unit."""
    rng = drawn(unit.seed, "lab")

    def some(chance: float, low: float, high: float) -> float:
        value = float(rng.uniform(low, high))
        return value if rng.uniform() < chance else 0.0

    angle = str(rng.choice(("resolver", "resolver", "rate", "command")))
    rows_hz = (
        float(rng.choice((0.5, 1.0, 2.0, 5.0))),
        float(rng.choice((2.0, 5.0, 10.0, 20.0))),
        float(rng.choice((1.0, 2.0, 5.0, 10.0))),
    )
    tick_s = float(rng.choice((0.0, 0.001, 0.1)))
    if tick_s > 0.05 and max(rows_hz) > 10.0:
        tick_s = 0.001
    coarse = rng.uniform() < 0.5
    return Lab(
        inside=_thermometer(rng),
        outside=_thermometer(rng),
        angle=angle,
        resolver_deg=some(0.8, 5.0, 15.0) * _ARCSEC,
        wrapped=bool(rng.uniform() < 0.5),
        motion="trapezoid" if angle == "command" else str(rng.choice(_MOTIONS)),
        dps2=float(rng.uniform(8.0, 20.0)),
        smooth_s=float(rng.uniform(0.3, 1.0)),
        tail_deg=some(0.5, 1e-3, 4e-3),
        tail_s=float(rng.uniform(8.0, 25.0)),
        cycle_deg=some(0.4, 0.2, 0.8) * _ARCSEC,
        cycle_s=float(rng.uniform(6.0, 20.0)),
        output=str(rng.choice(("rounded", "rounded", "counted"))),
        word_dph=float(rng.uniform(3.0, 8.0) if coarse else rng.uniform(0.05, 0.5)),
        sampled=bool(rng.uniform() < 0.4),
        lost=int(rng.integers(1, 5)) if rng.uniform() < 0.5 else 0,
        stale=int(rng.integers(1, 4)) if rng.uniform() < 0.3 else 0,
        masks=bool(rng.uniform() < 0.4),
        tick_s=tick_s,
        off_ppm=float(rng.uniform(-400.0, 400.0)) if tick_s == 0.001 and rng.uniform() < 0.5 else 0.0,
        rows_hz=rows_hz,
        swing_k=some(0.6, 0.1, 0.3),
        swing_s=float(rng.uniform(200.0, 540.0)),
        fans=bool(rng.uniform() < 0.4),
        early=bool(rng.uniform() < 0.4),
        start_spread_k=some(0.6, 1.0, 4.0),
        stretch=float(rng.uniform(0.75, 1.2)),
    )


def row_edges(lab: Lab, rows_hz: float, seconds: float, start_s: float) -> Array:
    """Return the edges of rows on ticks of the lab's clock; two rows stay free at both ends of the run."""
    period_s = 1e-6 * round(1e6 / rows_hz)
    first = start_s + 2.0 * period_s
    count = int((seconds - first - 2.0 * period_s) / (period_s * (1.0 + 1e-6 * abs(lab.off_ppm))))
    edges = first + np.arange(count + 1) * period_s * (1.0 + 1e-6 * lab.off_ppm)
    return np.asarray(lab.tick_s * np.round(edges / lab.tick_s) if lab.tick_s else edges)
