"""What the exam's gyros suffer from: each a signal in deg/h from a run's truth, for unit amplitude.

None uses the catalogue's code or, where the physics has a choice, its formula: distributed diffusion and Mohr's
integral for the rate of temperature change, a Preisach stack for play, rotation matrices for Earth rate, two time
constants for one. `rng` draws what a unit has (lags, thresholds); it is the same for all runs of a case.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import EARTH_RATE_DPH
from simulators.exam._campaign import LATITUDE_DEG, RunTruth

Draw = dict[str, float]
Signal = Callable[[RunTruth, Draw], Array]


def draw_unit(rng: np.random.Generator) -> Draw:
    """Return what a unit's effects depend on beside their amplitude."""
    return {
        "lag": float(rng.uniform(0.7, 1.4)),
        "at_c": float(rng.uniform(-35.0, 15.0)),
        "angle": float(rng.uniform(0.0, 2.0 * math.pi)),
        "period_s": float(rng.uniform(90.0, 500.0)),
        "mix": float(rng.uniform(0.2, 0.8)),
    }


def _coil(run: RunTruth) -> Array:
    return np.asarray(run.layer_c.mean(axis=1))


def _follow(values: Array, time_s: float) -> Array:
    from scipy.signal import lfilter  # slow to import

    decay = math.exp(-1.0 / time_s)
    return np.asarray(lfilter([1.0 - decay], [1.0, -decay], values, zi=[decay * values[0]])[0])


def _rates_dph(run: RunTruth) -> Array:
    return np.asarray(np.diff(run.angle_deg) * 3600.0 * np.sin(np.radians(run.elevation_deg)))


def _axis(run: RunTruth, lean_rad: float, towards_rad: float, azimuth_rad: float) -> Array:
    """Return the rate in deg/h on an axis that leans, integrated at ten points of each sample."""
    total = np.zeros(len(run.time_s))
    latitude = math.radians(LATITUDE_DEG)
    table_dph = np.diff(run.angle_deg) * 3600.0
    elevation = np.radians(run.elevation_deg)
    for part in (np.arange(10) + 0.5) / 10.0:
        heading = np.radians(run.angle_deg[:-1] + part * np.diff(run.angle_deg)) + azimuth_rad
        along = np.stack((np.cos(elevation), np.zeros_like(elevation), np.sin(elevation)))
        across = np.stack((-np.sin(elevation), np.zeros_like(elevation), np.cos(elevation)))
        side = np.array([0.0, 1.0, 0.0])[:, None]
        lean = math.cos(towards_rad) * across * -1.0 + math.sin(towards_rad) * side
        axis = math.cos(lean_rad) * along + math.sin(lean_rad) * lean
        north = axis[0] * np.cos(heading) - axis[1] * np.sin(heading)
        total += 0.1 * (
            EARTH_RATE_DPH * (math.cos(latitude) * north + math.sin(latitude) * axis[2]) + table_dph * axis[2]
        )
    return total


def _preisach(run: RunTruth, draw: Draw) -> Array:
    """Return a stack of plays of exponentially distributed width, 12 of them, on the coil's temperature."""
    temperature = _coil(run)[::5]
    halves = np.linspace(1.0, 34.0, 12)
    weights = np.exp(-halves / (9.0 * draw["lag"]))
    value = np.full(12, temperature[0])
    out = np.empty(len(temperature))
    for k, now in enumerate(temperature.tolist()):
        value = np.clip(value, now - halves, now + halves)
        out[k] = weights @ (value - now)
    return np.asarray(np.interp(np.arange(len(run.time_s)), np.arange(len(out)) * 5.0, out / weights.sum()))


def _hop(run: RunTruth, draw: Draw) -> Array:
    t = _coil(run)
    late = _follow(t, 40.0)
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip((0.5 * (t + late) - draw["at_c"]) / 0.8, -40, 40))))


def _two_relaxations(t: Array, draw: Draw) -> Array:
    slow = 0.6 * _follow(t, 1700.0 * draw["lag"]) + 0.4 * _follow(t, 4600.0 * draw["lag"])
    return t - slow


def _self_heating(run: RunTruth, draw: Draw) -> Array:
    tau = 900.0 * draw["lag"]
    return np.asarray(0.75 * np.exp(-run.time_s / tau) + 0.25 * np.exp(-run.time_s / (3.0 * tau)))


def _servo_ripple(run: RunTruth, draw: Draw, order: int) -> Array:
    """Return the rate error of an angle disturbance sin(order a) + a tenth of its third harmonic, integrated."""
    rate = np.sin(np.radians(run.elevation_deg))
    turn = np.radians(run.angle_deg)
    swing = np.sin(order * turn + draw["angle"]) + 0.1 * np.sin(3 * order * turn)
    return np.asarray(1e-6 * np.degrees(np.diff(swing)) * 3600.0 / order * rate)


def _stiffened(run: RunTruth, draw: Draw) -> Array:
    t = _coil(run)
    stiffness = 1.0 / (1.0 + ((t + 70.0) / 38.0) ** 6)
    return np.asarray(60.0 * np.gradient(t) * stiffness)


def _shifted(run: RunTruth, draw: Draw) -> Array:
    """Return the change of a sample's mean rate for 1 ms: rate at its end less rate at its start."""
    return np.asarray(3.6 * np.diff(run.edge_rate_dps) * np.sin(np.radians(run.elevation_deg)))


def _gravity(run: RunTruth, draw: Draw) -> Array:
    elevation = np.radians(run.elevation_deg)
    return np.asarray(np.sin(elevation + 0.5 * draw["mix"]))


def _dipole(run: RunTruth, draw: Draw) -> Array:
    turn = np.radians(run.azimuth_deg)
    spread = np.sinc(np.diff(run.angle_deg) / 360.0)
    return np.asarray(spread * (np.cos(turn + draw["angle"]) + 0.1 * np.cos(2 * turn)))


KNOWN: dict[str, Signal] = {
    "shupe": lambda run, d: run.shupe_dph,
    "bias_quadratic": lambda run, d: np.cosh((_coil(run) - 25.0) / 60.0) - 1.0,
    "bias_cubic": lambda run, d: np.sinh((_coil(run) - 25.0) / 45.0) - (_coil(run) - 25.0) / 45.0,
    "hysteresis": _preisach,
    "relaxation": lambda run, d: _two_relaxations(_coil(run), d),
    "warm_up": _self_heating,
    "cold_stress": _stiffened,
    "gradient": lambda run, d: run.layer_c[:, 0] - run.t_out_c,
    "mode_hop": _hop,
    "scale_factor_temperature": lambda run, d: (
        1e-6 * _rates_dph(run) * (run.board_c - 30.0 + 0.002 * (run.board_c - 30.0) ** 2)
    ),
    "scale_factor_lag": lambda run, d: 1e-6 * _rates_dph(run) * _two_relaxations(_coil(run), d),
    "scale_factor_asymmetry": lambda run, d: 1e-6 * _rates_dph(run) * np.tanh(_rates_dph(run) / 7200.0),
    "scale_factor_nonlinearity": lambda run, d: (
        1e-3
        * (np.sin(np.radians(_rates_dph(run) / 3600.0) * 0.35) * 3600.0 / np.radians(0.35) - _rates_dph(run))
    ),
    "azimuth_error": lambda run, d: _axis(run, 0.0, 0.0, math.radians(0.3)) - _axis(run, 0.0, 0.0, 0.0),
    "axis_misalignment": lambda run, d: (
        _axis(run, math.radians(0.05), d["angle"], 0.0) - _axis(run, 0.0, 0.0, 0.0)
    ),
    "heading_sensitivity": _dipole,
    "table_wobble_once": lambda run, d: _servo_ripple(run, d, 1),
    "table_wobble_twice": lambda run, d: _servo_ripple(run, d, 2),
    "time_offset": _shifted,
    "acceleration_sensitivity": _gravity,
}


def _compressor(run: RunTruth, draw: Draw) -> Array:
    """Return a square wave, its field felt while the chamber is cold."""
    on = np.sin(2.0 * math.pi * run.time_s / draw["period_s"] + run.repeat) > 0.3
    return np.asarray(on * (run.air_c < 10.0), dtype=np.float64)


def _resonance(run: RunTruth, draw: Draw) -> Array:
    return np.asarray(np.exp(-0.5 * ((_coil(run) - draw["at_c"]) / 3.0) ** 2))


def _blind_rate(run: RunTruth, draw: Draw) -> Array:
    return np.asarray(np.abs(60.0 * np.gradient(_coil(run))) ** 1.5)


def _rate_gradient(run: RunTruth, draw: Draw) -> Array:
    return np.asarray(1e-6 * _rates_dph(run) * (run.layer_c[:, 0] - run.layer_c[:, -1]))


def _rate_modes(run: RunTruth, draw: Draw) -> Array:
    """Return a scale factor that ripples with temperature (interference in the source's spectrum)."""
    return np.asarray(1e-6 * _rates_dph(run) * np.sin(2.0 * math.pi * run.board_c / 23.0 + draw["angle"]))


def _wander(run: RunTruth, draw: Draw) -> Array:
    """Return bias that ripples with temperature every 20 K or so (etalon in the optics)."""
    return np.asarray(np.sin(2.0 * math.pi * _coil(run) / (14.0 + 12.0 * draw["mix"]) + draw["angle"]))


UNKNOWN: dict[str, Signal] = {
    "compressor": _compressor,
    "resonance": _resonance,
    "blind_rate": _blind_rate,
    "rate_times_gradient": _rate_gradient,
    "scale_factor_fringes": _rate_modes,
    "bias_fringes": _wander,
}
