"""A navigation-grade triad of fibre-optic gyros with axes x, y, z, as in an INS: angle random walk and drift."""

from __future__ import annotations

import numpy as np

from simulators.plant.model import AxisModel, UnitModel
from simulators.plant.noise import NoiseParameters
from simulators.plant.thermal import case_and_inside, step_of

TRIAD_NOISE = NoiseParameters(arw_deg_per_sqrt_h=0.002, bias_instability_dph=0.001, quantum_arcsec=0.02)
DRIFT_DPH = 0.01
"""Drift of a horizontal axis; a navigation-grade INS, 1 nautical mile an hour, has about this."""
_SF_PPM = 20.0


def triad_unit(unit_seed: int) -> UnitModel:
    """Return a unit; seed 0 drifts by +0.01 deg/h on x and -0.01 deg/h on y, others by draws of that size."""
    drifts = (DRIFT_DPH, -DRIFT_DPH, 0.5 * DRIFT_DPH)
    if unit_seed:
        drifts = tuple(DRIFT_DPH * np.random.default_rng((unit_seed, 73)).standard_normal(3))
    network = case_and_inside("block", (2500.0, 1800.0), (1.6, 0.9), 9.0, 8.0, 6.0)
    outputs = {
        "block_temp_c": network.row("block"),
        "sensor_temp_c": network.row("block_sensor"),
        "case_temp_c": network.row("case_sensor"),
    }
    return UnitModel(
        axes="xyz",
        axis_models=tuple(_axis(float(drift)) for drift in drifts),
        step=step_of(network, outputs),
        outputs=tuple(outputs),
        truth=("block_temp_c",),
    )


def _axis(drift_dph: float) -> AxisModel:
    constant = {"drift": lambda state: drift_dph}, {"sf_offset": lambda state: _SF_PPM}
    return AxisModel(*constant, TRIAD_NOISE, turn_on_bias_dph=0.001, turn_on_sf_ppm=1.0)
