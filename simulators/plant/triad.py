"""A navigation-grade triad of fibre-optic gyros with axes x, y, z, as in an INS: angle random walk and drift."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from simulators.plant.effect import AxisModel, StateEffect, UnitModel
from simulators.plant.noise import NoiseParameters
from simulators.plant.thermal import AIR, Lag, Link, Network, build_network, tick_matrix

TRIAD_NOISE = NoiseParameters(arw_deg_per_sqrt_h=0.002, bias_instability_dph=0.001, quantum_arcsec=0.02)
DRIFT_DPH = 0.01
"""Drift of a horizontal axis; a navigation-grade INS, 1 nautical mile an hour, has about this."""
_SF_PPM = 20.0


class TriadState(NamedTuple):
    """Outputs of a tick, degC."""

    block_temp_c: float
    sensor_temp_c: float
    case_temp_c: float


def triad_unit(unit_seed: int) -> UnitModel:
    """Return a unit; seed 0 drifts by +0.01 deg/h on x and -0.01 deg/h on y, others by draws of that size."""
    network = _network()
    of_state = np.array([network.row("block"), network.row("block_sensor"), network.row("case_sensor")])
    drifts = (DRIFT_DPH, -DRIFT_DPH, 0.5 * DRIFT_DPH)
    if unit_seed:
        drifts = tuple(DRIFT_DPH * np.random.default_rng((unit_seed, 73)).standard_normal(3))
    return UnitModel(
        axes="xyz",
        axis_models=tuple(_axis(float(drift)) for drift in drifts),
        step=tick_matrix(network, of_state, np.zeros_like(of_state)),
        state=TriadState,
        outputs=TriadState._fields,
        truth=("block_temp_c",),
        sensor_noise_c=0.01,
        sensor_lsb_c=0.01,
    )


def _axis(drift_dph: float) -> AxisModel:
    effects = (
        StateEffect[TriadState](
            "drift", "bias_dph", lambda state: drift_dph, "calibration", "A constant drift of the axis."
        ),
        StateEffect[TriadState](
            "sf_offset",
            "sf_error_ppm",
            lambda state: _SF_PPM,
            "calibration",
            "A constant scale-factor error.",
        ),
    )
    return AxisModel(effects, (), TRIAD_NOISE, 0.001, 1.0)


def _network() -> Network:
    capacity = {"case": 2500.0, "block": 1800.0}
    links = (Link(AIR, "case", 1.6), Link("case", "block", 0.9))
    lags = (Lag("block_sensor", ("block",), 8.0), Lag("case_sensor", ("case",), 6.0))
    return build_network(capacity, links, {"block": 9.0}, lags)
