"""Quartz tuning-fork gyros of industrial grade: analogue output, charge-balancing converter, sensor on the ASIC.

The evaluation board's converter balances the ratiometric output with pulses of charge of one size; the vendor's
tool counts the pulses of a row, reads the ASIC's temperature register and writes CSV.
"""

from __future__ import annotations

import numpy as np

from benchmarks.gap_exam._family import Family, Layout, Sheet, Unit
from benchmarks.gap_exam._signals import flicker, walk
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._tuning_fork_bench import ENCODER_DEG, LATITUDE_DEG, campaign
from benchmarks.gap_exam._tuning_fork_effects import EFFECTS
from benchmarks.gap_exam._tuning_fork_foreign import FOREIGN
from drivers.base.arrays import Array

RANGE_DPS = 400.0
MODULATOR_HZ = 480e3
PULSE_ARCSEC = 3600.0 * 2.0 * RANGE_DPS / MODULATOR_HZ
"""The angle that one pulse stands for: the modulator chooses between plus and minus full scale each cycle."""
SHEET = Sheet(
    arw_deg_per_sqrt_h=0.12,
    bias_instability_dph=2.5,
    rate_random_walk_dph_per_sqrt_h=4.0,
    quantum_arcsec=PULSE_ARCSEC,
    sf_sigma_ppm=1500.0,
    slope_sigma_dph=30.0,
    turn_on_sigma_dph=10.0,
)
LAYOUT = Layout(suffix=".csv", output=("rate_out", "deg/s"), angle=("servo_position", "deg"))
REGISTER_K = 0.125
REGISTER_NOISE_K = 0.08
"""Noise of the ASIC's temperature sensor, about as large as its step."""
PT100_K = 0.01


def rows(unit: Unit, stage: Stage, rate_dph: Array, rng: np.random.Generator) -> Array:
    """Return what the tool writes for a true rate (n,): pulses of a row over its length, deg/h."""
    sheet, inside = unit.sheet, unit.inside
    lengths_s = np.diff(stage.edges_s)
    amplifier = sheet.arw_deg_per_sqrt_h * inside.get("noisy_charge_amplifier", 1.0)
    junction = sheet.bias_instability_dph * inside.get("flickering_bias_current", 1.0)
    stress = sheet.rate_random_walk_dph_per_sqrt_h * inside.get("creeping_mount", 1.0)
    pulse = sheet.quantum_arcsec * inside.get("divided_modulator_clock", 1.0)
    # N in deg/sqrt(h) is 60 N in deg/h sqrt(s)
    noise = 60.0 * amplifier * rng.standard_normal(len(lengths_s)) / np.sqrt(lengths_s)
    noise += flicker(junction, lengths_s, rng)
    noise += walk(stress, lengths_s, rng)
    # deg/h times s is arcsec; charge below a pulse stays on the integrator
    charge = rng.uniform(0.0, pulse) + np.concatenate(([0.0], np.cumsum((rate_dph + noise) * lengths_s)))
    return np.asarray(pulse * np.diff(np.floor(charge / pulse)) / lengths_s)


def read(unit: Unit, stage: Stage, rng: np.random.Generator) -> tuple[Array, Array, Array]:
    """Return ASIC register and PT100 on the fixture, degC (n,), and the servo's position (n + 1,), deg."""
    count = len(stage.valid)
    register = stage.in_rows(stage.t_in_c) + REGISTER_NOISE_K * rng.standard_normal(count)
    pt100 = stage.in_rows(stage.t_out_c) + PT100_K * rng.standard_normal(count)
    position = ENCODER_DEG * np.round(stage.at_edges(stage.angle_deg) / ENCODER_DEG)
    return REGISTER_K * np.round(register / REGISTER_K), np.round(pt100, 2), position


def _campaign(unit: Unit) -> list[Stage]:
    return campaign(unit, unit.inside.get("overrun_buffer", 0.0))


TUNING_FORK = Family(
    name="quartz_tuning_fork",
    latitude_deg=LATITUDE_DEG,
    sheet=SHEET,
    layout=LAYOUT,
    effects={**EFFECTS, **FOREIGN},
    noisy={
        "noisy_charge_amplifier": (1.6, 5.0, "noise_level"),
        "flickering_bias_current": (2.5, 10.0, "bias_instability"),
        "creeping_mount": (4.0, 25.0, "rate_random_walk"),
        "divided_modulator_clock": (4.0, 16.0, "quantisation"),
        "overrun_buffer": (0.004, 0.08, "lost_frames"),
    },
    campaign=_campaign,
    rows=rows,
    read=read,
)
