"""Fibre-optic gyro: parameters of a mid and a navigation grade, and how units of a grade differ.

Unit 0 of a grade is the nominal unit; other unit seeds spread coefficients and conductances.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import MISSING, dataclass, fields, replace

import numpy as np

from simulators.plant.model import varied
from simulators.plant.noise import NoiseParameters
from simulators.plant.shupe import Fibre, Winding


@dataclass(frozen=True)
class FogThermal:
    """Heat capacities in J/K, conductances in W/K, lags in s. Coil conductivity in W/(m K) along the radius."""

    case_j_per_k: float = 720.0
    fixture_j_per_k: float = 2700.0
    board_j_per_k: float = 60.0
    spool_j_per_k: float = 80.0
    coil_j_per_k: float = 100.0
    air_case: float = 1.5
    air_fixture: float = 2.0
    fixture_case: float = 1.0
    board_case: float = 0.5
    spool_case: float = 0.25
    case_coil: float = 0.10
    spool_coil: float = 0.20
    coil_conductivity: float = 0.30
    board_power_w: float = 3.0
    relaxation_s: float = 2700.0
    spool_sensor_lag_s: float = 8.0
    case_sensor_lag_s: float = 5.0


@dataclass(frozen=True)
class FogCoefficients:
    """Coefficients of the effects; u = (coil - 25)/50, v = (board - 25)/50 degC.

    Those with a default are the same in all units.
    """

    coil_static_dph: Sequence[float]
    board_static_dph: Sequence[float]
    offset_dph: float
    stress_dph_per_k_per_min: float
    stress_cold_gain: float
    relaxation_dph_per_k: float
    offset_ppm: float
    board_linear_ppm_per_k: float
    board_quadratic_ppm_per_k2: float
    coil_ppm_per_k: float
    relaxation_ppm_per_k: float
    asymmetry_ppm: float
    nonlinearity_ppm: float
    stress_cold_c: float = -28.0
    stress_width_k: float = 6.0
    nonlinearity_at_dps: float = 300.0


@dataclass(frozen=True)
class FogParameters:
    """Everything that makes a FOG unit."""

    fibre: Fibre
    layers: int
    thickness_m: float
    winding: Winding
    mid_point_offset_m: float
    turn_error_m: float
    thermal: FogThermal
    coefficients: FogCoefficients
    noise: NoiseParameters
    turn_on_bias_dph: float
    turn_on_sf_ppm: float


FOG_MID = FogParameters(
    fibre=Fibre(1000.0, 0.080),
    layers=48,
    thickness_m=0.008,
    winding="quadrupole",
    mid_point_offset_m=0.02,
    turn_error_m=0.004,
    thermal=FogThermal(),
    coefficients=FogCoefficients(
        offset_dph=0.03,
        coil_static_dph=(0.05, -0.04, 0.02),
        board_static_dph=(0.03, 0.02),
        stress_dph_per_k_per_min=0.030,
        stress_cold_gain=1.2,
        relaxation_dph_per_k=2e-3,
        offset_ppm=25.0,
        board_linear_ppm_per_k=4.5,
        board_quadratic_ppm_per_k2=0.020,
        coil_ppm_per_k=1.8,
        relaxation_ppm_per_k=0.9,
        asymmetry_ppm=3.0,
        nonlinearity_ppm=8.0,
    ),
    noise=NoiseParameters(0.004, 0.006, 0.05),
    turn_on_bias_dph=0.010,
    turn_on_sf_ppm=3.0,
)
FOG_NAV = FogParameters(
    fibre=Fibre(1500.0, 0.100),
    layers=72,
    thickness_m=0.006,
    winding="quadrupole",
    mid_point_offset_m=0.018,
    turn_error_m=0.0,
    thermal=FogThermal(case_coil=0.06),
    coefficients=FogCoefficients(
        offset_dph=0.002,
        coil_static_dph=(0.006, -0.004, 0.002),
        board_static_dph=(0.003, 0.002),
        stress_dph_per_k_per_min=0.003,
        stress_cold_gain=1.2,
        relaxation_dph_per_k=2.5e-4,
        offset_ppm=5.0,
        board_linear_ppm_per_k=2.0,
        board_quadratic_ppm_per_k2=0.008,
        coil_ppm_per_k=0.8,
        relaxation_ppm_per_k=0.3,
        asymmetry_ppm=1.0,
        nonlinearity_ppm=2.0,
    ),
    noise=NoiseParameters(0.0008, 0.001, 0.02),
    turn_on_bias_dph=0.001,
    turn_on_sf_ppm=1.0,
)

_CONDUCTANCES = (
    "air_case",
    "air_fixture",
    "fixture_case",
    "board_case",
    "spool_case",
    "case_coil",
    "spool_coil",
    "coil_conductivity",
)
_COEFFICIENTS = tuple(item.name for item in fields(FogCoefficients) if item.default is MISSING)


def spread(parameters: FogParameters, unit_seed: int, fraction: float = 0.20) -> FogParameters:
    """Return the parameters of another unit: coefficients and conductances vary by `fraction` (1 sigma).

    Variations are cut at two sigma, so that no conductance changes sign. Unit 0 is not varied.
    """
    if unit_seed == 0:
        return parameters
    rng = np.random.default_rng((unit_seed, 0))
    return replace(
        parameters,
        coefficients=varied(parameters.coefficients, _COEFFICIENTS, fraction, rng),
        thermal=varied(parameters.thermal, _CONDUCTANCES, fraction, rng),
    )
