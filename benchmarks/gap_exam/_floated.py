"""Floated rate-integrating gyros with a ball-bearing wheel and pulse rebalance, without a heater.

The float turns in a thick fluid; a loop of current pulses holds it, and a counter adds the pulses up. The lab
logs the counts of a row over its length, latched with the encoder, and thermometers of 1/16 K.
"""

from __future__ import annotations

import numpy as np

from benchmarks.gap_exam._family import Family, Layout, Sheet, Unit
from benchmarks.gap_exam._floated_bench import ENCODER_DEG, LATITUDE_DEG, campaign
from benchmarks.gap_exam._floated_effects import EFFECTS
from benchmarks.gap_exam._signals import flicker, walk
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

SHEET = Sheet(
    arw_deg_per_sqrt_h=0.004,
    bias_instability_dph=0.012,
    rate_random_walk_dph_per_sqrt_h=0.015,
    quantum_arcsec=0.4,
    sf_sigma_ppm=80.0,
    slope_sigma_dph=0.25,
    turn_on_sigma_dph=0.06,
)
LAYOUT = Layout(
    suffix=".csv",
    output=("pulse_rate", "deg/s"),
    angle=("table", "deg"),
    clock="2028-02-24T21:13:07.250",
    temperature_word_k=0.0625,
)
THERMOMETER_K = 0.03


def rows(unit: Unit, stage: Stage, rate_dph: Array, rng: np.random.Generator) -> Array:
    """Return what the counter gives for a true rate (n,): whole pulses of a row over its length, deg/h."""
    sheet, inside = unit.sheet, unit.inside
    gaps = np.diff(stage.edges_s)
    wheel = sheet.arw_deg_per_sqrt_h * inside.get("rough_bearing", 1.0)
    bearing = sheet.bias_instability_dph * inside.get("wandering_grease", 1.0)
    mass = sheet.rate_random_walk_dph_per_sqrt_h * inside.get("creeping_mass", 1.0)
    pulse = sheet.quantum_arcsec * inside.get("heavy_pulses", 1.0)
    noise = wheel * 60.0 / np.sqrt(gaps) * rng.standard_normal(len(gaps))
    noise += flicker(bearing, gaps, rng) + walk(mass, gaps, rng)
    # deg/h and s make arcsec; what does not fill a pulse stays in the float's angle
    turned = np.concatenate(([0.0], np.cumsum((rate_dph + noise) * gaps)))
    counts = np.floor(turned / pulse + rng.uniform())
    return np.asarray(np.diff(counts) * pulse / gaps)


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return what the lab's own devices log: two thermometers (n,), degC, and the encoder's angle (n + 1,)."""
    t_in, t_out = (
        stage.in_rows(felt) + THERMOMETER_K * rng.standard_normal(len(stage.valid))
        for felt in (stage.t_in_c, stage.t_out_c)
    )
    angle = np.round(stage.at_edges(stage.angle_deg) / ENCODER_DEG) * ENCODER_DEG
    return t_in, t_out, angle


def _campaign(unit: Unit) -> list[Stage]:
    return campaign(unit, lost=unit.inside.get("busy_logger", 0.0))


FLOATED = Family(
    name="floated_integrating",
    latitude_deg=LATITUDE_DEG,
    sheet=SHEET,
    layout=LAYOUT,
    effects=EFFECTS,
    noisy={
        "rough_bearing": (1.6, 5.0, "noise_level"),
        "wandering_grease": (2.5, 10.0, "bias_instability"),
        "creeping_mass": (4.0, 25.0, "rate_random_walk"),
        "heavy_pulses": (3.0, 12.0, "quantisation"),
        "busy_logger": (0.004, 0.08, "lost_frames"),
    },
    campaign=_campaign,
    rows=rows,
    read=read,
    weakest_ratio=0.3,
)
