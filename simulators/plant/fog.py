"""Fibre-optic gyro: thermal network, and bias and scale factor as sums of named effects.

The structure is the usual one of FOG temperature models: static polynomials, Shupe effect by layer, stress in the
winding that follows the coil's temperature rate and stiffens in the cold, and slow relaxation.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from drivers.base.arrays import Array
from simulators.effects import REFERENCE_C
from simulators.plant.fog_parameters import FogCoefficients, FogParameters, spread
from simulators.plant.model import AxisModel, UnitModel
from simulators.plant.shupe import (
    layer_lengths_m,
    layer_weights_m2,
    pigtail_weight_m2,
    rotation_per_integral_dph,
)
from simulators.plant.thermal import AIR, Lag, Link, Network, build_network, step_of

COIL_HEIGHT_M = 0.020
_WINDING_STREAM = 59
"""Random stream of the turn errors: with it unit 0 of the mid grade shows 0.32 deg/h peak to peak of Shupe
effect on the nominal cold shock, as the reference design does (without turn errors it would be 0.35)."""


def fog_network(parameters: FogParameters) -> Network:
    """Return the unit's heat-flow network: case, fixture, board, spool, a radial chain of layers, and lags."""
    t = parameters.thermal
    layers = [f"layer_{index}" for index in range(parameters.layers)]
    area_m2 = math.pi * parameters.fibre.diameter_m * COIL_HEIGHT_M
    between = t.coil_conductivity * area_m2 / (parameters.thickness_m / parameters.layers)
    capacity = {
        "case": t.case_j_per_k,
        "fixture": t.fixture_j_per_k,
        "board": t.board_j_per_k,
        "spool": t.spool_j_per_k,
        **dict.fromkeys(layers, t.coil_j_per_k / parameters.layers),
    }
    links = [
        Link(AIR, "case", t.air_case),
        Link(AIR, "fixture", t.air_fixture),
        Link("fixture", "case", t.fixture_case),
        Link("board", "case", t.board_case),
        Link("spool", "case", t.spool_case),
        Link("spool", layers[0], t.spool_coil),
        Link("case", layers[-1], t.case_coil),
        *(Link(inner, outer, between) for inner, outer in pairwise(layers)),
    ]
    lags = (
        Lag("relaxed", tuple(layers), t.relaxation_s),
        Lag("spool_sensor", ("spool",), t.spool_sensor_lag_s),
        Lag("case_sensor", ("case",), t.case_sensor_lag_s),
    )
    return build_network(capacity, links, {"board": t.board_power_w}, lags)


def shupe_row(parameters: FogParameters, network: Network, unit_seed: int) -> Array:
    """Return the row vector, float64 (n,), that turns node rates in K/s into the Shupe effect in deg/h."""
    rng = np.random.default_rng((unit_seed, _WINDING_STREAM))
    lengths = layer_lengths_m(parameters.fibre, parameters.layers, parameters.turn_error_m, rng)
    weights = layer_weights_m2(lengths, parameters.winding, parameters.mid_point_offset_m)
    row = np.zeros(len(network.names))
    first = network.names.index("layer_0")
    row[first : first + parameters.layers] = weights
    row[network.names.index("case")] += pigtail_weight_m2(weights)
    return row * rotation_per_integral_dph(parameters.fibre)


def fog_axis(p: FogParameters) -> AxisModel:
    """Return what the thermal state and the rate do to bias and scale factor, with the noise."""
    c = p.coefficients
    return AxisModel(
        bias_dph={
            "bias_offset": lambda s: c.offset_dph,
            # usual static temperature models, of the coil and of the electronics
            "coil_static": lambda s: _polynomial(c.coil_static_dph, s.coil_temp_c),
            "board_static": lambda s: _polynomial(c.board_static_dph, s.board_temp_c),
            # Shupe 1980; Mohr 1996: fibre that warms unequally about its mid-point looks like rotation
            "shupe": lambda s: s.shupe_dph,
            # non-linear Shupe coefficient: potting stiffens below its glass transition
            "winding_stress": lambda s: _stress_dph(c, s.coil_temp_c, s.coil_rate_k_per_min),
            # slow tail after a shock: bias decays after the coil has reached its temperature
            "bias_relaxation": lambda s: c.relaxation_dph_per_k * (s.coil_temp_c - s.relaxed_temp_c),
        },
        sf_error_ppm={
            "sf_offset": lambda s: c.offset_ppm,
            # source wavelength and electronics over temperature
            "sf_board": lambda s: _board_sf_ppm(c, s.board_temp_c),
            # thermal expansion of the coil's area
            "sf_coil": lambda s: c.coil_ppm_per_k * (s.coil_temp_c - REFERENCE_C),
            # scale-factor hysteresis over a cycle
            "sf_relaxation": lambda s: c.relaxation_ppm_per_k * (s.coil_temp_c - s.relaxed_temp_c),
        },
        noise=p.noise,
        turn_on_bias_dph=p.turn_on_bias_dph,
        turn_on_sf_ppm=p.turn_on_sf_ppm,
        rate_ppm={
            # IEEE Std 952, scale-factor asymmetry and nonlinearity
            "sf_asymmetry": lambda rate_dps: 0.5 * c.asymmetry_ppm * np.sign(rate_dps),
            "sf_nonlinearity": lambda rate_dps: c.nonlinearity_ppm * (rate_dps / c.nonlinearity_at_dps) ** 2,
        },
    )


def fog_unit(parameters: FogParameters, unit_seed: int) -> UnitModel:
    """Return a unit of a grade; unit 0 has the nominal coefficients."""
    p = spread(parameters, unit_seed)
    network = fog_network(p)
    coil = network.row(*(f"layer_{index}" for index in range(p.layers)))
    outputs = {
        "coil_temp_c": coil,
        "coil_rate_k_per_min": 60.0 * coil,
        "board_temp_c": network.row("board"),
        "relaxed_temp_c": network.row("relaxed"),
        "shupe_dph": shupe_row(p, network, unit_seed),
        "sensor_temp_c": network.row("spool_sensor"),
        "case_temp_c": network.row("case_sensor"),
    }
    return UnitModel(
        axes="x",
        axis_models=(fog_axis(p),),
        step=step_of(network, outputs, ("coil_rate_k_per_min", "shupe_dph")),
        outputs=tuple(outputs),
        truth=("coil_temp_c", "coil_rate_k_per_min", "board_temp_c"),
    )


def _polynomial(coefficients: Sequence[float], temp_c: float) -> float:
    """Return c1 w + c2 w^2 + ... with w = (temperature - 25)/50."""
    w = (temp_c - REFERENCE_C) / 50.0
    total = 0.0
    for coefficient in reversed(coefficients):
        total = (total + coefficient) * w
    return total


def _stress_dph(c: FogCoefficients, coil_temp_c: float, coil_rate_k_per_min: float) -> float:
    cold = c.stress_cold_gain / (1.0 + math.exp((coil_temp_c - c.stress_cold_c) / c.stress_width_k))
    return c.stress_dph_per_k_per_min * (1.0 + cold) * coil_rate_k_per_min


def _board_sf_ppm(c: FogCoefficients, board_temp_c: float) -> float:
    warm = board_temp_c - REFERENCE_C
    return (c.board_linear_ppm_per_k + c.board_quadratic_ppm_per_k2 * warm) * warm
