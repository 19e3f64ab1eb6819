"""A depolarised fibre gyro of a well-drilling company, open loop: its effects, its noise and how its lab logs."""

from __future__ import annotations

from benchmarks.gap_exam import _depolarised_effects as physics
from benchmarks.gap_exam._depolarised_bench import LATITUDE_DEG, SHEET, campaign, read, rows_dph
from benchmarks.gap_exam._family import Effect, Family, Layout
from benchmarks.gap_exam._turning import encoder, heading, known, latency, misalignment

_OF_RATE = ("scale_factor_nonlinearity", "scale_factor_asymmetry")
"""A table that ends close below the fastest rate cuts what turns with the Earth more, or alone."""
_LATE = ("thermal_lag", "relaxation")

EFFECTS = {
    "unequal_layers": known(physics.shupe, "shupe"),
    "glass_transition": known(physics.glassy_shupe, "cold_stress", "shupe_cross"),
    "bowed_spool": known(physics.bowed_spool, "gradient"),
    "residual_polarisation": known(physics.polarisation, "bias_quadratic", "bias_cubic"),
    "late_coupler": known(physics.late_coupler, *_LATE),
    "creeping_glue": known(physics.creeping_glue, "relaxation", "thermal_lag"),
    "sticking_potting": known(physics.sticking_potting, "hysteresis"),
    "sagging_coil": known(physics.sagging_coil, "acceleration_sensitivity"),
    "leaking_cooler": known(physics.wavelength, "scale_factor_temperature"),
    "cooler_out_of_range": known(physics.cooler, "scale_factor_temperature", "scale_factor_quadratic"),
    "modulator_depth": known(physics.modulator_depth, "scale_factor_lag", "scale_factor_temperature"),
    "sine_response": known(physics.sine_response, "scale_factor_nonlinearity"),
    "table_end": Effect(
        physics.table_end, ("saturation",), _OF_RATE, curved=True, sizes=(1e-4, 60.0), signed=False
    ),
    "rectifier": known(physics.rectifier, "scale_factor_asymmetry"),
    "dead_converter": Effect(
        physics.dead_converter, ("dead_zone", "lock_in"), curved=True, sizes=(0.5, 600.0), signed=False
    ),
    "warming_pick_up": known(physics.warming_pick_up, "warm_up"),
    "bridge_flip": known(physics.bridge_flip, "mode_hop"),
    "faraday": heading(physics.faraday),
    "misalignment": misalignment(LATITUDE_DEG),
    "late_samples": latency(LATITUDE_DEG),
    "bearing": encoder((1, 2), 0.25),
    "remanence": Effect(physics.remanence),
    "wound_cable": Effect(physics.wound_cable),
    "spool_resonance": Effect(physics.spool_resonance),
    "fringes": Effect(physics.fringes),
    "hunting_cooler": Effect(physics.hunting_cooler, changing=True),
    "dew": Effect(physics.dew, changing=True),
}

DEPOLARISED = Family(
    name="depolarised_fibre",
    latitude_deg=LATITUDE_DEG,
    sheet=SHEET,
    layout=Layout(
        suffix=".parquet",
        output=("omega", "deg/s"),
        angle=("table", "deg"),
        clock="2023-02-06T06:15:00",
    ),
    effects=EFFECTS,
    noisy={
        "dim_source": (1.4, 4.0, "noise_level"),
        "restless_pick_up": (3.0, 10.0, "bias_instability"),
        "ageing_polariser": (4.0, 14.0, "rate_random_walk"),
    },
    campaign=campaign,
    rows=rows_dph,
    read=read,
)
