"""Nuclear magnetic resonance gyros: two isotopes of xenon precess in a shielded, heated cell with rubidium.

Both isotopes see one field and turn opposite ways, so their phases give the rate and the field apart. The lab
logs the difference of the phases between two edges, read by a time-to-digital counter, in rad/s.
Sources: Walker and Larsen, Adv. At. Mol. Opt. Phys. 65 (2016); Kitching, Knappe and Donley, IEEE Sens. J. 11
(2011); Meyer and Larsen, Gyroscopy Navig. 5 (2014).
"""

from __future__ import annotations

import numpy as np

from benchmarks.gap_exam._family import Family, Layout, Sheet, Unit
from benchmarks.gap_exam._nuclear_bench import LATITUDE_DEG, campaign
from benchmarks.gap_exam._nuclear_effects import EFFECTS
from benchmarks.gap_exam._signals import flicker, walk
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

SHEET = Sheet(
    arw_deg_per_sqrt_h=0.009,
    bias_instability_dph=0.02,
    rate_random_walk_dph_per_sqrt_h=0.02,
    quantum_arcsec=0.7,
    sf_sigma_ppm=30.0,
    slope_sigma_dph=0.4,
    turn_on_sigma_dph=0.08,
)
LAYOUT = Layout(suffix=".parquet", output=("omega", "rad/s"), angle=("theta", "rad"), temperature="K")
THERMISTOR_K = 0.015
LINES = 18_000
"""Lines of the encoder's disc."""
FRINGE_ARCSEC = 0.03
"""What its interpolator errs twice a line."""
ENCODER_DEG = 360.0 / 2**28


def rows(unit: Unit, stage: Stage, rate_dph: Array, rng: np.random.Generator) -> Array:
    """Return what the counter gives for a true rate (n,): the change of the tagged phase over a row, deg/h.

    Photon shot noise on the pumped line turns both phases at random; the fields of the walls and of the pump
    wander and walk.
    """
    sheet, inside = unit.sheet, unit.inside
    gaps = np.diff(stage.edges_s)
    shot = sheet.arw_deg_per_sqrt_h * inside.get("dim_probe", 1.0)
    walls = sheet.bias_instability_dph * inside.get("spotted_walls", 1.0)
    pump = sheet.rate_random_walk_dph_per_sqrt_h * inside.get("walking_pump", 1.0)
    tag = sheet.quantum_arcsec * inside.get("coarse_tags", 1.0)
    # deg/h and s make arcsec; deg/sqrt(h) and s make 60 arcsec
    turned = rate_dph * gaps + 60.0 * shot * np.sqrt(gaps) * rng.standard_normal(len(gaps))
    turned += (flicker(walls, gaps, rng) + walk(pump, gaps, rng)) * gaps
    phase = rng.uniform(0.0, tag) + np.concatenate(([0.0], np.cumsum(turned)))
    return np.asarray(np.diff(np.round(phase / tag)) * tag / gaps)


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return what the lab's own devices log: two thermistors (n,), degC, and the encoder's angle (n + 1,)."""
    felt = np.stack((stage.in_rows(stage.t_in_c), stage.in_rows(stage.t_out_c)))
    t_in, t_out = felt + THERMISTOR_K * rng.standard_normal(felt.shape)
    angle = stage.at_edges(stage.angle_deg)
    angle = angle + FRINGE_ARCSEC / 3600.0 * np.sin(2.0 * LINES * np.radians(angle))
    return t_in, t_out, np.asarray(np.round(angle / ENCODER_DEG) * ENCODER_DEG)


def _campaign(unit: Unit) -> list[Stage]:
    return campaign(unit, lost=unit.inside.get("full_buffer", 0.0))


NUCLEAR = Family(
    name="nuclear_resonance",
    latitude_deg=LATITUDE_DEG,
    sheet=SHEET,
    layout=LAYOUT,
    effects=EFFECTS,
    noisy={
        "dim_probe": (1.6, 5.0, "noise_level"),
        "spotted_walls": (3.0, 10.0, "bias_instability"),
        "walking_pump": (5.0, 25.0, "rate_random_walk"),
        "coarse_tags": (3.0, 10.0, "quantisation"),
        "full_buffer": (0.006, 0.08, "lost_frames"),
    },
    campaign=_campaign,
    rows=rows,
    read=read,
    weakest_ratio=0.5,
)
