"""Odd recorders: a small optical gyro as its data sheet says, in laboratories whose acquisition has habits.

Every unit has a laboratory of its own: thermometers, table, counter, clock and campaign are drawn anew.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from benchmarks.gap_exam._family import Family, Layout, Sheet, Unit
from benchmarks.gap_exam._recorders_bench import Recorded, campaign, read_angle_deg, read_temperatures_c
from benchmarks.gap_exam._recorders_effects import EFFECTS, LATITUDE_DEG
from benchmarks.gap_exam._signals import flicker, walk
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

SHEET = Sheet(
    arw_deg_per_sqrt_h=0.25,
    bias_instability_dph=1.0,
    rate_random_walk_dph_per_sqrt_h=3.0,
    quantum_arcsec=1.0,
    sf_sigma_ppm=300.0,
    slope_sigma_dph=12.0,
    turn_on_sigma_dph=2.0,
)
_LEAK = 0.05
"""Share of white noise that the filter of points passes to either neighbour."""
_LIMIT_DPH = 3600.0 * 250.0


def rows(unit: Unit, stage: Stage, true_dph: Array, rng: np.random.Generator) -> Array:
    """Return the logged output, deg/h, (n,): noise, filter, counter or word, and a stale row now and then."""
    run, sheet = _recorded(stage), unit.sheet
    gaps_s = np.diff(run.edges_s)
    white = 60.0 * sheet.arw_deg_per_sqrt_h * unit.inside.get("receiver", 1.0)
    noise = white * rng.standard_normal(len(gaps_s) + 2) / math.sqrt(float(np.median(gaps_s)))
    leak = _LEAK if run.filtered else 0.0
    noise = np.convolve(noise, (leak, 1.0 - 2.0 * leak, leak), mode="valid")
    output = true_dph + noise + flicker(sheet.bias_instability_dph, gaps_s, rng)
    output = output + walk(sheet.rate_random_walk_dph_per_sqrt_h, gaps_s, rng)
    output = np.clip(output, -_LIMIT_DPH, _LIMIT_DPH)
    factor = unit.inside.get("counter", 0.0)
    if run.habits.output == "counted" or factor:
        output = counted(output, gaps_s, max(factor, 1.0) * sheet.quantum_arcsec)
    else:
        output = run.habits.word_dph * np.round(output / run.habits.word_dph)
    steady = np.flatnonzero(_steady(run))
    if run.habits.stale and len(steady):
        again = rng.choice(steady, int(rng.integers(0, run.habits.stale + 1)))
        output[again] = output[again - 1]
    return np.asarray(output)


def counted(output_dph: Array, gaps_s: Array, quantum_arcsec: float) -> Array:
    """Return rates from whole quanta of angle in each row, (n,): what is left is counted in the next."""
    turned = np.concatenate(([0.0], np.cumsum(output_dph * gaps_s)))
    return np.asarray(quantum_arcsec * np.diff(np.floor(turned / quantum_arcsec)) / gaps_s)


def _steady(run: Recorded) -> NDArray[np.bool_]:
    """Return the rows (n,) whose rate is that of the row before within 0.3 deg/h, the first apart."""
    rate = np.diff(run.at_edges(run.angle_deg)) / np.diff(run.edges_s)
    return np.concatenate(([False], np.abs(np.diff(rate)) < 0.3 / 3600.0))


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return what the lab logs: both temperatures (n,), degC, and the table's angle (n + 1,), deg."""
    run = _recorded(stage)
    inner, outer = read_temperatures_c(unit, run)
    return inner, outer, read_angle_deg(run)


def _recorded(stage: Stage) -> Recorded:
    if not isinstance(stage, Recorded):
        raise TypeError("the run has no laboratory")
    return stage


RECORDERS = Family(
    name="odd_recorders",
    latitude_deg=LATITUDE_DEG,
    sheet=SHEET,
    layout=Layout(".parquet", ("omega", "deg/h"), ("table", "deg")),
    effects=EFFECTS,
    noisy={"receiver": (1.3, 3.0, "noise_level"), "counter": (20.0, 80.0, "quantisation")},
    campaign=campaign,
    rows=rows,
    read=read,
)
