"""A tactical Coriolis gyro: a metal cylinder, piezo electrodes, force to rebalance, the maker's table inside.

The table has bias and scale factor over the thermometer at the board, straight lines between the maker's points.
What is left of it, and of drive, glue, alloy and bench, are this family's effects.
"""

from __future__ import annotations

import numpy as np

from benchmarks.gap_exam import _cylinder_effects as effects
from benchmarks.gap_exam._cylinder_bench import LATITUDE_DEG, THERMOMETER_WORD_K, campaign, read
from benchmarks.gap_exam._family import Effect, Family, Layout, Sheet, Unit
from benchmarks.gap_exam._signals import flicker, walk
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._turning import encoder, heading, known, latency, misalignment
from drivers.base.arrays import Array

SHEET = Sheet(
    arw_deg_per_sqrt_h=0.08,
    bias_instability_dph=0.6,
    rate_random_walk_dph_per_sqrt_h=1.0,
    quantum_arcsec=0.5,
    sf_sigma_ppm=300.0,
    slope_sigma_dph=15.0,
    turn_on_sigma_dph=3.0,
)
LAYOUT = Layout(
    suffix=".parquet",
    output=("cvg_rate", "deg/s"),
    angle=("table", "deg"),
    clock="2022-03-14T07:40:00",
    temperature_word_k=THERMOMETER_WORD_K,
)
_HEAT = ("gradient", "shupe", "thermal_lag", "relaxation")
"""What follows heat late by a few minutes is much alike in a chamber."""


def _beside(*own: str) -> tuple[str, ...]:
    return tuple(name for name in _HEAT if name not in own)


EFFECTS: dict[str, Effect] = {
    # the maker's table and what it follows
    "between_factory_points": known(effects.between_factory_points, "bias_quadratic", "bias_cubic"),
    "piezo_gain": known(
        *(effects.piezo_gain, "scale_factor_temperature", "scale_factor_quadratic"),
        beside=("scale_factor_lag",),
    ),
    "late_gain": known(effects.late_gain, "scale_factor_lag"),
    "metal_behind_bead": known(
        *(effects.metal_behind_bead, "thermal_lag"), beside=(*_beside("thermal_lag"), "warm_up")
    ),
    # heat
    "repoling": known(effects.repoling, "warm_up"),
    "warped_base": known(effects.warped_base, "gradient", beside=_beside("gradient")),
    "pyroelectric_charge": known(effects.pyroelectric_charge, "shupe", beside=_beside("shupe")),
    "creeping_glue": known(effects.creeping_glue, "relaxation", beside=_beside("relaxation")),
    "magnetic_damping": known(effects.magnetic_damping, "hysteresis"),
    "range_switch": known(effects.range_switch, "mode_hop"),
    # drive
    "drive_limit": Effect(
        effects.drive_limit,
        ("saturation",),
        ("scale_factor_nonlinearity",),
        curved=True,
        sizes=(1e-3, 0.8),
        signed=False,
    ),
    "dead_band": Effect(
        effects.dead_band, ("dead_zone", "lock_in"), curved=True, sizes=(0.3, 2000.0), signed=False
    ),
    "rayleigh_drive": known(effects.rayleigh_drive, "scale_factor_nonlinearity"),
    "push_and_pull": known(effects.push_and_pull, "scale_factor_asymmetry"),
    "supply_ripple": known(effects.supply_ripple, "vibration_or_mains_line"),
    # mount and table
    "lean": misalignment(LATITUDE_DEG),
    "sag": known(effects.sag, "acceleration_sensitivity", beside=("heading_sensitivity",)),
    "magnetic_alloy": heading(effects.magnetised),
    "bearing_wobble": encoder((1, 2, 30), 0.3),
    "sampler_lag": latency(LATITUDE_DEG),
    # in no catalogue
    "mode_crossing": Effect(effects.mode_crossing),
    "coarse_table": Effect(effects.coarse_table, beside=("mode_hop",)),
    "motor_heat": Effect(effects.motor_heat),
    "soaked_electrodes": Effect(effects.soaked_electrodes),
    "wandering_node": Effect(effects.wandering_node, changing=True),
    "knocks": Effect(effects.knocks, changing=True),
}
NOISY = {
    "tired_preamplifier": (1.3, 4.0, "noise_level"),
    "restless_phase": (3.0, 12.0, "bias_instability"),
    "coarse_counter": (6.0, 40.0, "quantisation"),
}


def rows(unit: Unit, stage: Stage, rate_dph: Array, rng: np.random.Generator) -> Array:
    """Return the logged output, deg/h, (n,): white noise, 1/f, a walk; the angle turned in counts.

    The counter is dithered by a part of a count that it takes away again, so that it errs anew at each reading.
    """
    sheet, gaps_s = unit.sheet, np.diff(stage.edges_s)
    white = 60.0 * sheet.arw_deg_per_sqrt_h * unit.inside.get("tired_preamplifier", 1.0)
    slow = sheet.bias_instability_dph * unit.inside.get("restless_phase", 1.0)
    quantum_arcsec = sheet.quantum_arcsec * unit.inside.get("coarse_counter", 1.0)
    rate = rate_dph + white * rng.standard_normal(len(gaps_s)) / np.sqrt(gaps_s)
    rate = rate + flicker(slow, gaps_s, rng) + walk(sheet.rate_random_walk_dph_per_sqrt_h, gaps_s, rng)
    # a deg/h is an arcsec a second
    turned = np.concatenate(([0.0], np.cumsum(rate * gaps_s))) / quantum_arcsec
    dither = rng.uniform(size=len(turned))
    return np.asarray(np.diff(np.floor(turned + dither) - dither) * quantum_arcsec / gaps_s)


CYLINDER = Family(
    name="cylinder_vibratory",
    latitude_deg=LATITUDE_DEG,
    sheet=SHEET,
    layout=LAYOUT,
    effects=EFFECTS,
    noisy=NOISY,
    campaign=campaign,
    rows=rows,
    read=read,
)
