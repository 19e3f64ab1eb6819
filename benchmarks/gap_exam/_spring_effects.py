"""Effects of spring-restrained rate gyros: bar, pivots, oil, pick-off, motor and the workshop's supply.

What bends with the rate takes the true rate along the input axis, Earth's share included.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from benchmarks.gap_exam._family import Effect, Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._signals import drawn, follow, markov, play, slope_per_min, spectrum_of_lags
from benchmarks.gap_exam._spring_bench import TOP_DPS, within
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._turning import encoder, known, misalignment, skew
from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K

LATITUDE_DEG = 52.7
_DPH = 3600.0
_REFERENCE_C = 25.0
_NEWTON_STEPS = 8
STOP_DPS = 1.002 * TOP_DPS
_MATCHED_C = 30.0


def sensed_dps(stage: Stage) -> Array:
    """Return the true rate along the input axis, deg/s, (m,)."""
    return sensed_dph(stage, LATITUDE_DEG) / _DPH


def viscosity(celsius: Array) -> Array:
    """Return the oil's viscosity over that at 25 degC: Andrade's law, coefficient 0.6 as of silicones."""
    return np.asarray(np.exp(1740.0 * (1.0 / (celsius + ZERO_CELSIUS_K) - 1.0 / (25.0 + ZERO_CELSIUS_K))))


# bar, pivots and stops ----------------------------------------------------------------------------------------


def deflection_dps(rate_dps: Array, stiffening: float, power: float) -> Array:
    """Return the deflection as a rate, deg/s, where bar and flex pivots stiffen as they twist.

    The moment of the spring, x (1 + s |x|^p) in units of the full rate, balances the gyro's.
    """
    wanted = rate_dps / TOP_DPS
    x = wanted.copy()
    for _ in range(_NEWTON_STEPS):
        bend = stiffening * np.abs(x) ** power
        x -= (x * (1.0 + bend) - wanted) / (1.0 + (power + 1.0) * bend)
    return np.asarray(x * TOP_DPS)


def _bar_stiffening(unit: Unit, stage: Stage, size: float) -> Array:
    rate = sensed_dps(stage)
    return _DPH * (deflection_dps(rate, size, within(unit, "form", 1.7, 2.6)) - rate)


def _end_stop(unit: Unit, stage: Stage, size: float) -> Array:
    # a stop is set a little beyond the full rate and stands `size` deg/s too near; it gives way a little
    rate, limit = sensed_dps(stage), STOP_DPS - size
    gives = within(unit, "c1", 0.005, 0.03)
    return np.asarray(_DPH * (gives - 1.0) * (rate - np.clip(rate, -limit, limit)))


def freed_dps(rate_dps: Array, stuck_dps: float, fall: float) -> Array:
    """Return what pivots let pass, deg/s: none below the torque that frees them, then Stribeck friction falls."""
    beyond = np.maximum(np.abs(rate_dps) - stuck_dps, 0.0)
    lost = stuck_dps * np.exp(-beyond / (fall * stuck_dps))
    return np.asarray(np.sign(rate_dps) * np.maximum(np.abs(rate_dps) - lost, 0.0))


def _pivot_threshold(unit: Unit, stage: Stage, size: float) -> Array:
    rate = sensed_dps(stage)
    return _DPH * (freed_dps(rate, size / _DPH, within(unit, "c2", 0.3, 1.5)) - rate)


def unrestored(rate_dps: Array, celsius: Array, damped_s: float, step_s: float) -> Array:
    """Return what viscous damping takes from a rate, deg/s, (m,): time constant `damped_s` at 25 degC.

    The rate holds a step long, the mean over the step is exact: c/k times the gimbal's speed.
    """
    if np.ptp(rate_dps) < 1e-9:
        return np.zeros(len(rate_dps))
    times = damped_s * viscosity(celsius)
    shares = -np.expm1(-step_s / times)
    at, moves = float(rate_dps[0]), np.empty(len(rate_dps))
    for k, (rate, share) in enumerate(zip(rate_dps.tolist(), shares.tolist(), strict=True)):
        moves[k] = share * (rate - at)
        at += moves[k]
    return np.asarray(-times * moves / step_s)


def _oil_lag(unit: Unit, stage: Stage, size: float) -> Array:
    if not stage.turning:
        return np.zeros(stage.steps)
    return _DPH * unrestored(sensed_dps(stage), stage.body("oil"), size, stage.step_s)


def _bar_lag(unit: Unit, stage: Stage, size: float) -> Array:
    # a thermistor in the oil makes up for the bar's modulus, but the bar warms later
    oil = stage.body("oil")
    bar = follow(oil, within(unit, "c1", 240.0, 720.0), stage.step_s)
    return size * _DPH * sensed_dps(stage) * (bar - oil)


def _bar_aftereffect(unit: Unit, stage: Stage, size: float) -> Array:
    # the bar's strain creeps behind its torque by a power law from seconds to half an hour
    times = np.geomspace(5.0, 2000.0, 7)
    weights = times ** -within(unit, "form", 0.05, 0.4)
    rate = sensed_dps(stage)
    crept = spectrum_of_lags(rate, times.tolist(), weights.tolist(), stage.step_s)
    return size * _DPH * (crept - rate)


def _bar_hysteresis(unit: Unit, stage: Stage, size: float) -> Array:
    # slip between bar and clamp: friction elements that yield at rates of their own
    if not stage.turning:
        return np.zeros(stage.steps)
    rate = sensed_dps(stage)
    widths = within(unit, "form", 0.6, 1.6) * np.array([0.1, 0.4, 1.5, 5.0])
    return np.asarray(size * _DPH * np.mean([play(rate, width) - rate for width in widths.tolist()], axis=0))


def _cross_coupling(unit: Unit, stage: Stage, size: float) -> Array:
    # a deflected gimbal takes up the rate along the spin axis, too
    elevation = np.radians(stage.elevation_deg)
    return size * (stage.rate_dps / TOP_DPS) ** 2 * np.sin(elevation) * np.cos(elevation)


# gravity, heat and oil ----------------------------------------------------------------------------------------


def _unbalance(unit: Unit, stage: Stage, size: float) -> Array:
    # centre of mass and of buoyancy lie apart; oil thins out as it warms
    elevation, towards = np.radians(stage.elevation_deg), 2.0 * math.pi * unit.draw["phase"]
    buoyancy = 1.0 + within(unit, "a", 1e-3, 3e-3) * (stage.body("oil") - _REFERENCE_C)
    return np.asarray(size * np.sin(elevation + towards) * buoyancy)


def _anisoelasticity(unit: Unit, stage: Stage, size: float) -> Array:
    # rotor bearings and gimbal give way unlike along spin and input axis
    elevation = np.radians(stage.elevation_deg)
    return np.asarray(2.0 * size * np.sin(elevation) * np.cos(elevation))


def _convection(unit: Unit, stage: Stage, size: float) -> Array:
    # free convection between gimbal side and case: heat flow by a power of the temperature difference
    apart = (stage.body("oil") - stage.body("case")) / 10.0
    return np.asarray(size * np.sign(apart) * np.abs(apart) ** within(unit, "form", 1.05, 1.33))


def _bellows_flow(unit: Unit, stage: Stage, size: float) -> Array:
    # oil that expands flows through the damping gap to the bellows and drags the gimbal by its viscosity
    oil = stage.body("oil")
    return size * viscosity(oil) * slope_per_min(oil, stage.step_s)


def _bellows_friction(unit: Unit, stage: Stage, size: float) -> Array:
    # folds of the bellows slip one after the other
    oil = stage.body("oil")
    widths = within(unit, "form", 0.7, 1.4) * np.array([1.0, 2.5, 5.0, 9.0])
    return np.asarray(size * np.mean([play(oil, width) - oil for width in widths.tolist()], axis=0))


def _cement_creep(unit: Unit, stage: Stage, size: float) -> Array:
    # the cement of the pick-off creeps behind its temperature, a power law of times
    times = np.geomspace(400.0, 6400.0, 5)
    weights = times ** -within(unit, "form", 0.0, 0.5)
    mount = stage.body("pickoff")
    return size * (mount - spectrum_of_lags(mount, times.tolist(), weights.tolist(), stage.step_s))


def _oil_bubble(unit: Unit, stage: Stage, size: float) -> Array:
    # gas leaves the oil in the cold and is dissolved again only some kelvin warmer; it grows for half a minute
    forms = within(unit, "c1", -20.0, 5.0)
    dissolves = forms + within(unit, "c2", 1.5, 5.0)
    oil = stage.body("oil")
    there = bool(oil[0] < 0.5 * (forms + dissolves))
    state = np.where(oil < forms, 1, np.where(oil > dissolves, 0, -1))
    told = np.where(state >= 0, np.arange(len(oil)), -1)
    last = np.maximum.accumulate(told)
    bubble = np.where(last >= 0, state[np.maximum(last, 0)], int(there)).astype(np.float64)
    return size * follow(bubble, within(unit, "b", 8.0, 30.0), stage.step_s)


# pick-off and demodulator -------------------------------------------------------------------------------------


def halves_dps(rate_dps: Array, knee_dps: float) -> Array:
    """Return what a demodulator with unlike diodes rectifies, deg/s: |rate| beyond the diodes' knee, even."""
    scaled = np.abs(rate_dps) / knee_dps
    return np.asarray(knee_dps * (scaled + np.log1p(np.exp(-2.0 * scaled)) - math.log(2.0)))


def _demodulator_halves(unit: Unit, stage: Stage, size: float) -> Array:
    return 0.5 * size * _DPH * halves_dps(sensed_dps(stage), within(unit, "c2", 0.02, 0.3))


def _diode_drift(unit: Unit, stage: Stage, size: float) -> Array:
    # germanium diodes, matched at room temperature, part as it changes
    warmer = (stage.body("pickoff") - _MATCHED_C) / 50.0
    return 0.5 * size * _DPH * halves_dps(sensed_dps(stage), within(unit, "c2", 0.02, 0.3)) * warmer


def excitation(celsius: Array, resistance_share: float) -> Array:
    """Return the E-I pick-off's current over that at 25 degC on a constant voltage, copper in series with iron.

    `resistance_share` is its resistance over its reactance at 25 degC.
    """
    resistance = resistance_share * (1.0 + 0.00393 * (celsius - _REFERENCE_C))
    return np.asarray(math.hypot(resistance_share, 1.0) / np.hypot(resistance, 1.0))


def _pickoff_heat(unit: Unit, stage: Stage, size: float) -> Array:
    share = within(unit, "a", 0.4, 1.4)
    slope_per_k = 0.00393 * share**2 / (1.0 + share**2)
    change = (excitation(stage.body("pickoff"), share) - 1.0) / slope_per_k
    return size * _DPH * sensed_dps(stage) * change


def phase_rad(celsius: Array, peak_c: float, width_k: float) -> Array:
    """Return the phase of the demodulator's reference, rad: a ceramic capacitor loses on both sides of a peak."""
    return np.asarray(np.arctan(np.exp(-(((celsius - peak_c) / width_k) ** 2))))


def _quadrature(unit: Unit, stage: Stage, size: float) -> Array:
    # what stands at right angles leaks through by the reference's error of phase; it fades as the copper warms
    peak, width = within(unit, "c1", 5.0, 40.0), within(unit, "c2", 50.0, 80.0)
    pickoff = stage.body("pickoff")
    error = phase_rad(pickoff, peak, width) - phase_rad(np.array([_REFERENCE_C]), peak, width)
    return size * excitation(pickoff, 0.8) * np.sin(error) / math.sin(0.25)


# motor, table and supply --------------------------------------------------------------------------------------


def _motor_heat(unit: Unit, stage: Stage, size: float) -> Array:
    # the rotor's shaft grows with the motor's heat, then the preload of its bearings settles
    on_s = stage.power_on_s + stage.time_s
    quick_s, slow_s = within(unit, "a", 180.0, 420.0), within(unit, "b", 900.0, 1500.0)
    share = within(unit, "form", 0.4, 0.8)
    return np.asarray(size * (share * np.exp(-on_s / quick_s) + (1.0 - share) * np.exp(-on_s / slow_s)))


def _hunting(unit: Unit, stage: Stage, size: float) -> Array:
    # the rotor swings about the supply's phase; the mean over each step is exact
    hertz = within(unit, "order", 0.17, 0.83)
    phase = drawn(unit.seed, "hunting", stage.key).uniform(0.0, 2.0 * math.pi)
    edges = np.arange(stage.steps + 1) * stage.step_s
    waves = -np.cos(2.0 * math.pi * hertz * edges + phase) / (2.0 * math.pi * hertz)
    return np.asarray(size * np.diff(waves) / stage.step_s)


def shaking(rate_dps: Array, resonance_dps: float) -> Array:
    """Return the power of what the table's gears shake, 1 at the full rate far below the mount's resonance."""
    square = (rate_dps / resonance_dps) ** 2
    return np.asarray((rate_dps / TOP_DPS) ** 2 / ((1.0 - square) ** 2 + 0.5 * square))


def _table_gears(unit: Unit, stage: Stage, size: float) -> Array:
    return size * shaking(stage.rate_dps, within(unit, "order", 1.3, 2.5) * TOP_DPS)


def _inverter_frequency(unit: Unit, stage: Stage, size: float) -> Array:
    # the 400 Hz inverter of the workshop wanders, and with it the rotor's momentum
    rng = drawn(unit.seed, "inverter", stage.key)
    gaps = np.full(stage.steps, stage.step_s)
    return (
        size * _DPH * sensed_dps(stage) * (0.6 * rng.standard_normal() + 0.8 * markov(1.0, 900.0, gaps, rng))
    )


def _shop_compressor(unit: Unit, stage: Stage, size: float) -> Array:
    # the supply sags while the workshop's compressor fills its tank, and rises slowly behind it
    rng = drawn(unit.seed, "compressor", stage.key)
    on_s, off_s = within(unit, "c1", 90.0, 160.0), within(unit, "c2", 200.0, 420.0)
    pairs = 3 + int(stage.seconds / (on_s + off_s) * 1.5)
    spans = np.stack((np.full(pairs, on_s), np.full(pairs, off_s)), axis=1) * rng.uniform(
        0.8, 1.2, (pairs, 2)
    )
    switches = np.cumsum(spans.ravel()) - rng.uniform(0.0, on_s + off_s)
    sags = np.searchsorted(switches, stage.time_s) % 2 == 0
    return size * follow(sags.astype(np.float64), 12.0, stage.step_s)


def _bent(signal: Callable[[Unit, Stage, float], Array], sizes: Sequence[float], *names: str,
          signed: bool = False) -> Effect:  # fmt: skip
    """Return an effect whose signal is not proportional to its size."""
    return Effect(signal, names, curved=True, sizes=(sizes[0], sizes[1]), signed=signed)


EFFECTS = {
    "bar_stiffening": _bent(_bar_stiffening, (1e-6, 0.1), "scale_factor_nonlinearity", signed=True),
    "end_stop": _bent(_end_stop, (0.05, 25.0), "saturation"),
    "pivot_threshold": _bent(_pivot_threshold, (0.5, 20_000.0), "dead_zone", "lock_in"),
    "oil_lag": _bent(_oil_lag, (1e-5, 5.0), "time_offset"),
    "gate_clock": skew(LATITUDE_DEG),
    "demodulator_halves": known(_demodulator_halves, "scale_factor_asymmetry"),
    "pickoff_heat": known(_pickoff_heat, "scale_factor_temperature", "scale_factor_quadratic"),
    "bar_lag": known(_bar_lag, "scale_factor_lag"),
    "convection": known(_convection, "gradient"),
    "unbalance": known(_unbalance, "acceleration_sensitivity", beside=("heading_sensitivity",)),
    "bellows_flow": known(_bellows_flow, "shupe", "shupe_cross", "cold_stress"),
    "bellows_friction": known(_bellows_friction, "hysteresis"),
    "cement_creep": known(_cement_creep, "relaxation", "thermal_lag"),
    "motor_heat": known(_motor_heat, "warm_up"),
    "quadrature": known(_quadrature, "bias_quadratic", "bias_cubic"),
    "oil_bubble": known(_oil_bubble, "mode_hop"),
    "table_gears": known(_table_gears, "vibration_rectification"),
    "hunting": Effect(_hunting, ("vibration_or_mains_line",), changing=True, signed=False),
    "lean": misalignment(LATITUDE_DEG),
    "encoder": encoder((1, 2, 30), 0.3),
    "bar_aftereffect": Effect(_bar_aftereffect),
    "bar_hysteresis": Effect(_bar_hysteresis),
    "cross_coupling": Effect(_cross_coupling),
    "anisoelasticity": Effect(_anisoelasticity),
    "diode_drift": Effect(_diode_drift),
    "inverter_frequency": Effect(_inverter_frequency, changing=True),
    "shop_compressor": Effect(_shop_compressor, changing=True),
}
