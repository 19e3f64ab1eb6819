"""A three-axis industrial MEMS gyro: bias and scale factor over temperature, noise of the class."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from simulators.plant.effect import AxisModel, StateEffect, UnitModel
from simulators.plant.noise import NoiseParameters
from simulators.plant.thermal import AIR, Lag, Link, Network, build_network, tick_matrix

REFERENCE_C = 25.0
MEMS_NOISE = NoiseParameters(arw_deg_per_sqrt_h=0.20, bias_instability_dph=4.0, quantum_arcsec=0.0)
"""Data-sheet class of industrial IMUs: ARW 0.1 to 0.3 deg/sqrt(h), bias instability 2 to 10 deg/h."""


class MemsState(NamedTuple):
    """Outputs of a tick, degC."""

    die_temp_c: float
    sensor_temp_c: float
    case_temp_c: float


def mems_network() -> Network:
    """Return the unit's heat-flow network: a small metal case and the sensor die on its board."""
    capacity = {"case": 60.0, "die": 6.0}
    links = (Link(AIR, "case", 0.35), Link("case", "die", 0.08))
    lags = (Lag("die_sensor", ("die",), 4.0), Lag("case_sensor", ("case",), 5.0))
    return build_network(capacity, links, {"die": 0.4}, lags)


def mems_effects(rng: np.random.Generator) -> tuple[StateEffect[MemsState], ...]:
    """Return one axis's effects; every unit and axis has its own coefficients, drawn from `rng`."""
    offset, slope, curve = rng.standard_normal(3) * (150.0, 5.0, 0.08)
    sf_offset, sf_slope = rng.standard_normal(2) * (500.0, 30.0)
    return (
        StateEffect("bias_offset", "bias_dph", lambda s: float(offset), "calibration", "A constant bias."),
        StateEffect(
            "bias_temperature",
            "bias_dph",
            lambda s: float((slope + curve * (s.die_temp_c - REFERENCE_C)) * (s.die_temp_c - REFERENCE_C)),
            "package stress and electronics",
            "Bias follows the die's temperature, quadratically.",
        ),
        StateEffect(
            "sf_offset", "sf_error_ppm", lambda s: float(sf_offset), "calibration", "A constant SF error."
        ),
        StateEffect(
            "sf_temperature",
            "sf_error_ppm",
            lambda s: float(sf_slope * (s.die_temp_c - REFERENCE_C)),
            "drive amplitude and spring softening",
            "Scale factor follows the die's temperature.",
        ),
    )


def mems_unit(unit_seed: int) -> UnitModel:
    """Return a unit with axes x, y, z."""
    network = mems_network()
    of_state = np.array([network.row("die"), network.row("die_sensor"), network.row("case_sensor")])
    axes = tuple(
        AxisModel(mems_effects(np.random.default_rng((unit_seed, axis))), (), MEMS_NOISE, 6.0, 20.0)
        for axis in range(3)
    )
    return UnitModel(
        axes="xyz",
        axis_models=axes,
        step=tick_matrix(network, of_state, np.zeros_like(of_state)),
        state=MemsState,
        outputs=MemsState._fields,
        truth=("die_temp_c",),
        sensor_noise_c=0.02,
        sensor_lsb_c=0.01,
    )
