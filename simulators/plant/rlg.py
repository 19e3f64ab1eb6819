"""Ring-laser gyro: case and cavity block, and a bias that follows temperatures, their rates and their gradient.

Coefficients are those of a navigation-grade ring laser over -40 .. +65 degC. At the gyro's output the dither is
stripped: what is left of the lock-in is angle random walk, and the fringe counter's resolution.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np

from simulators.effects import REFERENCE_C
from simulators.plant.model import AxisModel, UnitModel, varied
from simulators.plant.noise import NoiseParameters
from simulators.plant.thermal import Network, case_and_inside, step_of

UNIT_SPREAD = 0.15
"""How far coefficients of units lie apart (1 sigma)."""
RUN_SPREAD = 0.03
"""How far one unit's coefficients of temperature lie apart between power cycles (1 sigma): mirrors and mounts do
not settle twice in the same way."""
RIPPLE_PERIOD_K = 9.0


@dataclass(frozen=True)
class RlgCoefficients:
    """Bias in deg/h: per K, K^2, degC/min, and their products; scale factor in ppm and ppm/K."""

    offset: float = 0.004
    per_k: float = -2.2e-4
    per_k2: float = 4e-7
    per_rate: float = 0.024
    per_k_rate: float = -1.6e-4
    per_rate2: float = 0.012
    per_gradient_k: float = 1e-3
    ripple: float = 6e-4
    hysteresis: float = 4e-4
    sf_offset_ppm: float = 4.0
    sf_ppm_per_k: float = 0.08
    sf_asymmetry_ppm: float = 0.6
    sf_nonlinearity_ppm: float = 1.5


_OF_TEMPERATURE = ("per_k", "per_k2", "per_rate", "per_k_rate", "per_rate2", "per_gradient_k")


def lock_in_random_walk(
    residual_lock_in_dps: float, count_arcsec: float = 1.57, peak_dither_dps: float = 100.0
) -> float:
    """Return the angle random walk in deg/sqrt(h) that passing through lock-in leaves in a dithered gyro.

    N = W_L sqrt(S / (2 pi W_D)) with the residual lock-in rate W_L, the angle of a count S and the peak dither
    rate W_D (Aronowitz, The Laser Gyro, 1971; confirmed in arXiv 2005.09749).
    """
    count_deg = count_arcsec / 3600.0
    return 60.0 * residual_lock_in_dps * math.sqrt(count_deg / (2.0 * math.pi * peak_dither_dps))


RLG_NOISE = NoiseParameters(lock_in_random_walk(4.0e-3), 8e-4, 0.3)


def rlg_network() -> Network:
    """Return the heat-flow network: the case in the air, the cavity block in the case, 2 W in the block."""
    return case_and_inside("block", (900.0, 350.0), (1.2, 0.30), 2.0, sensor_lag_s=8.0)


def rlg_coefficients(unit_seed: int, run_seed: int = 0, power_on: int = 0) -> RlgCoefficients:
    """Return a unit's coefficients on a given day after so many power cycles; unit 0 is the nominal one."""
    c = RlgCoefficients()
    if unit_seed:
        names = [item.name for item in fields(c)]
        c = varied(c, names, UNIT_SPREAD, np.random.default_rng((unit_seed, 1)))
    seeds = (unit_seed, 2, run_seed, power_on) if power_on else (unit_seed, 2, run_seed)
    return varied(c, _OF_TEMPERATURE, RUN_SPREAD, np.random.default_rng(seeds))


def rlg_axis(c: RlgCoefficients) -> AxisModel:
    """Return what the thermal state and the rate do to bias and scale factor, with the noise."""
    return AxisModel(
        bias_dph={
            "bias_offset": lambda s: c.offset,
            # usual static temperature model
            "case_static": lambda s: (
                (c.per_k + c.per_k2 * (s.case_c - REFERENCE_C)) * (s.case_c - REFERENCE_C)
            ),
            # regression models of laser gyros over temperature: rate, its square, its product with temperature
            "case_rate": lambda s: (
                (c.per_rate + c.per_k_rate * s.case_c + c.per_rate2 * s.case_rate) * s.case_rate
            ),
            # a gradient unbalances the currents of the discharge arms; the gas flow (Langmuir) drags the light
            "discharge_imbalance": lambda s: c.per_gradient_k * (s.case_c - s.block_c),
            # path-length control: the cavity passes through modes as it expands
            "mode_ripple": lambda s: c.ripple * math.sin(2.0 * math.pi * s.block_c / RIPPLE_PERIOD_K),
            # joints that hold until they slip: bias differs between warming and cooling
            "bias_hysteresis": lambda s: c.hysteresis * math.tanh(s.case_rate / 0.1),
        },
        sf_error_ppm={
            "sf_offset": lambda s: c.sf_offset_ppm,
            # expansion of the cavity
            "sf_temperature": lambda s: c.sf_ppm_per_k * (s.block_c - REFERENCE_C),
        },
        noise=RLG_NOISE,
        turn_on_bias_dph=8e-4,
        turn_on_sf_ppm=0.3,
        rate_ppm={
            # IEEE Std 647, scale-factor asymmetry
            "sf_asymmetry": lambda rate_dps: 0.5 * c.sf_asymmetry_ppm * np.sign(rate_dps),
            # what is left of lock-in at low rates
            "sf_nonlinearity": lambda rate_dps: c.sf_nonlinearity_ppm / (1.0 + np.abs(rate_dps)),
        },
    )


def rlg_unit(unit_seed: int, run_seed: int = 0, power_on: int = 0) -> UnitModel:
    """Return a single-axis unit, switched on for run `run_seed` and again `power_on` times since."""
    network = rlg_network()
    case, block = network.row("case"), network.row("block")
    outputs = {  # degC, and degC/min
        "case_c": case,
        "block_c": block,
        "case_rate": 60.0 * case,
        "block_rate": 60.0 * block,
        "sensor_temp_c": network.row("block_sensor"),
        "case_temp_c": network.row("case_sensor"),
    }
    return UnitModel(
        axes="x",
        axis_models=(rlg_axis(rlg_coefficients(unit_seed, run_seed, power_on)),),
        step=step_of(network, outputs, ("case_rate", "block_rate")),
        outputs=tuple(outputs),
        truth=("case_c", "block_c"),
    )
