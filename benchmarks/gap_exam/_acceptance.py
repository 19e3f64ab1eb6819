"""Acceptance line: a maker's chip resonator gyros pass a rate table, a chamber, a pier and a tumble fixture,
each with a logger of its own.
"""

from __future__ import annotations

import numpy as np

from benchmarks.gap_exam._acceptance_effects import EFFECTS, LATITUDE_DEG, NOISY
from benchmarks.gap_exam._acceptance_line import LineStage, campaign, read
from benchmarks.gap_exam._family import Family, Layout, Sheet, Unit
from benchmarks.gap_exam._signals import flicker, walk
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

SHEET = Sheet(
    arw_deg_per_sqrt_h=0.05,
    bias_instability_dph=0.6,
    rate_random_walk_dph_per_sqrt_h=1.5,
    quantum_arcsec=0.5,
    sf_sigma_ppm=400.0,
    slope_sigma_dph=15.0,
    turn_on_sigma_dph=4.0,
)


def rows(unit: Unit, stage: Stage, rate_dph: Array, rng: np.random.Generator) -> Array:
    """Return the output of the rows, deg/h, (n,): noise of the sheet, then a counter of whole quanta."""
    edges = stage.taken_s if isinstance(stage, LineStage) else stage.edges_s
    sheet, gaps = unit.sheet, np.diff(edges)
    white = 60.0 * sheet.arw_deg_per_sqrt_h * unit.inside.get("bright", 1.0)
    level = sheet.bias_instability_dph * unit.inside.get("flickering", 1.0)
    wander = sheet.rate_random_walk_dph_per_sqrt_h * unit.inside.get("wandering", 1.0)
    rate = rate_dph + white / np.sqrt(gaps) * rng.standard_normal(len(gaps))
    rate = rate + flicker(level, gaps, rng) + walk(wander, gaps, rng)
    # deg/h are arcsec/s
    turned = np.concatenate(([0.0], np.cumsum(rate * gaps))) + rng.uniform(0.0, sheet.quantum_arcsec)
    counted = sheet.quantum_arcsec * np.floor(turned / sheet.quantum_arcsec)
    return np.asarray(np.diff(counted) / gaps)


ACCEPTANCE = Family(
    name="acceptance_line",
    latitude_deg=LATITUDE_DEG,
    sheet=SHEET,
    layout=Layout(".csv", ("rate_dps", "deg/s"), ("table_deg", "deg")),
    effects=EFFECTS,
    noisy=NOISY,
    campaign=campaign,
    rows=rows,
    read=read,
)
