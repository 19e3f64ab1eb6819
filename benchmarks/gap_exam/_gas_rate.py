"""Gas rate gyros: a pump drives a laminar jet of nitrogen past two hot wires, the Coriolis force bends it.

A bridge weighs the wires against each other; an accumulator adds its output up and a serial port asks for it.
The case has one thermistor of an eighth of a degree. The vendor's tool writes deg/s and loses rows when it
changes files.
"""

from __future__ import annotations

import numpy as np

from benchmarks.gap_exam._family import Family, Layout, Sheet, Unit
from benchmarks.gap_exam._gas_rate_bench import ENCODER_DEG, LATITUDE_DEG, campaign
from benchmarks.gap_exam._gas_rate_effects import EFFECTS
from benchmarks.gap_exam._signals import flicker, walk
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

SHEET = Sheet(
    arw_deg_per_sqrt_h=0.35,
    bias_instability_dph=6.0,
    rate_random_walk_dph_per_sqrt_h=8.0,
    quantum_arcsec=3.6,
    sf_sigma_ppm=3000.0,
    slope_sigma_dph=120.0,
    turn_on_sigma_dph=40.0,
)
LAYOUT = Layout(
    suffix=".csv", output=("gyro_out", "deg/s"), angle=("table_pos", "deg"), temperature_word_k=0.125
)
BEAD_K = 0.08
PROBE_K = 0.2


def rows(unit: Unit, stage: Stage, rate_dph: Array, rng: np.random.Generator) -> Array:
    """Return what the port gives for a true rate (n,): whole counts of angle of a row over its length, deg/h."""
    sheet, inside = unit.sheet, unit.inside
    gaps = np.diff(stage.edges_s)
    hiss = sheet.arw_deg_per_sqrt_h * inside.get("hissing_jet", 1.0)
    wires = sheet.bias_instability_dph * inside.get("crackling_wires", 1.0)
    pump = sheet.rate_random_walk_dph_per_sqrt_h * inside.get("restless_pump", 1.0)
    count = sheet.quantum_arcsec * inside.get("dropped_bits", 1.0)
    felt = rate_dph + 60.0 * hiss / np.sqrt(gaps) * rng.standard_normal(len(gaps))
    felt += flicker(wires, gaps, rng) + walk(pump, gaps, rng)
    # deg/h and s make arcsec; the accumulator keeps what does not fill a count
    counts = np.rint(np.concatenate(([0.0], np.cumsum(felt * gaps))) / count + rng.uniform())
    return np.asarray(np.diff(counts) * count / gaps)


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return bead and plate probe (n,), degC, and the encoder's angle (n + 1,), deg."""
    n = len(stage.valid)
    t_in = stage.in_rows(stage.t_in_c) + BEAD_K * rng.standard_normal(n)
    t_out = stage.in_rows(stage.t_out_c) + PROBE_K * rng.standard_normal(n)
    angle = np.round(stage.at_edges(stage.angle_deg) / ENCODER_DEG) * ENCODER_DEG
    return t_in, t_out, angle


def _campaign(unit: Unit) -> list[Stage]:
    return campaign(unit, lost=unit.inside.get("deaf_port", 0.0))


GAS_RATE = Family(
    name="gas_rate",
    latitude_deg=LATITUDE_DEG,
    sheet=SHEET,
    layout=LAYOUT,
    effects=EFFECTS,
    noisy={
        "hissing_jet": (1.5, 5.0, "noise_level"),
        "crackling_wires": (2.5, 10.0, "bias_instability"),
        "restless_pump": (4.0, 20.0, "rate_random_walk"),
        "dropped_bits": (4.0, 15.0, "quantisation"),
        "deaf_port": (0.005, 0.06, "lost_frames"),
    },
    campaign=_campaign,
    rows=rows,
    read=read,
    weakest_ratio=0.5,
)
