"""A three-axis industrial MEMS gyro: bias and scale factor over temperature, noise of the class."""

from __future__ import annotations

import numpy as np

from simulators.effects import REFERENCE_C
from simulators.plant.model import AxisModel, UnitModel
from simulators.plant.noise import NoiseParameters
from simulators.plant.thermal import case_and_inside, step_of

MEMS_NOISE = NoiseParameters(arw_deg_per_sqrt_h=0.20, bias_instability_dph=4.0, quantum_arcsec=0.0)
"""Data-sheet class of industrial IMUs: ARW 0.1 to 0.3 deg/sqrt(h), bias instability 2 to 10 deg/h."""


def mems_axis(rng: np.random.Generator) -> AxisModel:
    """Return one axis; every unit and axis has its own coefficients, drawn from `rng`."""
    offset, slope, curve = rng.standard_normal(3) * (150.0, 5.0, 0.08)
    sf_offset, sf_slope = rng.standard_normal(2) * (500.0, 30.0)
    return AxisModel(
        bias_dph={
            "bias_offset": lambda s: float(offset),
            # package stress and electronics
            "bias_temperature": lambda s: float(
                (slope + curve * (s.die_temp_c - REFERENCE_C)) * (s.die_temp_c - REFERENCE_C)
            ),
        },
        sf_error_ppm={
            "sf_offset": lambda s: float(sf_offset),
            # drive amplitude and spring softening
            "sf_temperature": lambda s: float(sf_slope * (s.die_temp_c - REFERENCE_C)),
        },
        noise=MEMS_NOISE,
        turn_on_bias_dph=6.0,
        turn_on_sf_ppm=20.0,
    )


def mems_unit(unit_seed: int) -> UnitModel:
    """Return a unit with axes x, y, z: a small metal case and the sensor die on its board."""
    network = case_and_inside("die", (60.0, 6.0), (0.35, 0.08), 0.4, sensor_lag_s=4.0)
    outputs = {
        "die_temp_c": network.row("die"),
        "sensor_temp_c": network.row("die_sensor"),
        "case_temp_c": network.row("case_sensor"),
    }
    return UnitModel(
        axes="xyz",
        axis_models=tuple(mems_axis(np.random.default_rng((unit_seed, axis))) for axis in range(3)),
        step=step_of(network, outputs),
        outputs=tuple(outputs),
        truth=("die_temp_c",),
        sensor_noise_c=0.02,
    )
