"""What is wrong with closed-loop fibre-optic gyros in a common housing (H. C. Lefevre, The Fiber-Optic Gyroscope;
D. M. Shupe, Appl. Opt. 19, 654, 1980), each from the heat in the coil, the loop or the light.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from benchmarks.gap_exam._family import Effect, Signal, Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._signals import drawn, follow, slope_per_min, smooth_step
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._turning import (
    encoder,
    heading,
    impulses,
    known,
    latency,
    misalignment,
    skew,
    telegraph,
)
from drivers.base.arrays import Array

LATITUDE_DEG = 43.6
_STIFF_C, _STIFF_WIDTH_K = -12.0, 5.0
"""Below it the potting is a glass."""
_LOOP_PER_K, _LOOP_INNER = 1.0 / 14.0, 0.2
_FIELD_NORTH_UT, _FIELD_WEST_UT, _FIELD_UP_UT = 22.0, -6.0, -41.0
"""In the lab, with its steel."""
_ALONG = 0.2
_PUMP_HZ = 0.37
_BEAT_HZ_PER_K = 0.003


def _of(shape: Callable[[Unit, Stage], Array]) -> Signal:
    """Return the signal that is a shape times its size."""
    return lambda unit, stage, size: np.asarray(size * shape(unit, stage))


def _rate_dph(stage: Stage) -> Array:
    return sensed_dph(stage, LATITUDE_DEG)


def _powered_s(stage: Stage) -> Array:
    return np.asarray(stage.time_s + stage.power_on_s)


def _coil_k_per_min(stage: Stage) -> Array:
    return slope_per_min(stage.body("coil"), stage.step_s)


def _trimmed(unit: Unit, stage: Stage) -> Array:
    """The middle of the fibre is not the middle of the coil: its mean warming counts (Shupe)."""
    return _coil_k_per_min(stage)


def _quadrupole(unit: Unit, stage: Stage) -> Array:
    """A quadrupole winding leaves the warming of the gradient across the layers (Shupe)."""
    return slope_per_min(stage.body("wound"), stage.step_s)


def _thermo_optic(unit: Unit, stage: Stage) -> Array:
    """The fibre's thermo-optic coefficient grows with temperature: of warming times temperature."""
    return np.asarray(_coil_k_per_min(stage) * (stage.body("coil") - 25.0) / 50.0)


def _glassy(unit: Unit, stage: Stage) -> Array:
    """Below its glass transition the potting squeezes the fibre as fast as it cools (Mohr)."""
    frozen = smooth_step((_STIFF_C - stage.body("coil")) / _STIFF_WIDTH_K)
    return np.asarray(_coil_k_per_min(stage) * frozen)


def _pigtails(unit: Unit, stage: Stage) -> Array:
    """Two Gaussian modes slide off each other as chip and fibre expand: exp(-(x / w)^2) of the coupling."""
    off = (stage.body("hub") - 15.0 - 20.0 * unit.draw["a"]) / 70.0
    return np.asarray(1.0 - np.exp(-(off**2)))


def _late_coil(unit: Unit, stage: Stage) -> Array:
    """The loss along the fibre goes with the coil's temperature, which comes after the hub's."""
    return np.asarray(stage.body("coil") - stage.body("hub"))


def _shield_heat(unit: Unit, stage: Stage) -> Array:
    """The splitter sits between housing and hub and feels their difference."""
    return np.asarray(stage.body("hub") - stage.body("housing"))


def loop(values: Array) -> Array:
    """Return hysteresis h (m,) of the Coleman-Hodgdon sort, from rest at the first value.

    dh = a (x - h) |dx| + b dx: where x goes one way, x - h tends to (1 - b) / a in that direction.
    """
    behind, before, kept = 0.0, float(values[0]), []
    for value in values.tolist():
        moved = value - before
        if moved:
            limit = math.copysign((1.0 - _LOOP_INNER) / _LOOP_PER_K, moved)
            behind = limit + (behind - limit) * math.exp(-_LOOP_PER_K * abs(moved))
        before = value
        kept.append(behind)
    return np.asarray(values - values[0] - np.array(kept))


def _glue(unit: Unit, stage: Stage) -> Array:
    return loop(stage.body("hub"))


def _connector(unit: Unit, stage: Stage) -> Array:
    return smooth_step((stage.body("hub") - _connector_c(unit)) / 0.2)


def _connector_c(unit: Unit) -> float:
    return -14.0 + 14.0 * unit.draw["b"] if unit.draw["form"] < 0.5 else 36.0 + 12.0 * unit.draw["b"]


def _source_settles(unit: Unit, stage: Stage) -> Array:
    return np.asarray(np.exp(-_powered_s(stage) / (240.0 + 480.0 * unit.draw["c"])))


def _wavelength(unit: Unit, stage: Stage) -> Array:
    """The source's wavelength goes with the hub, and the scale factor against it, per ppm/K."""
    return np.asarray(1e-6 * (stage.body("hub") - 25.0) * _rate_dph(stage))


def _wider_coil(unit: Unit, stage: Stage) -> Array:
    """Length times diameter of the coil grow as it warms, some time after the hub."""
    late = follow(stage.body("coil"), 200.0 + 300.0 * unit.draw["c1"], stage.step_s)
    return np.asarray(1e-6 * (late - 25.0) * _rate_dph(stage))


def _finite_gain(unit: Unit, stage: Stage) -> Array:
    """A loop of finite gain leaves some Sagnac phase; its sine falls short with the cube."""
    rate = _rate_dph(stage)
    return np.asarray(1e-6 * rate * (rate / 3.6e5) ** 2)


def _flyback(unit: Unit, stage: Stage) -> Array:
    """Resets by 2 pi of the ramp are too large in one direction and too small in the other."""
    return np.asarray(1e-6 * np.abs(_rate_dph(stage)))


def _coupled_modulator(unit: Unit, stage: Stage, size: float) -> Array:
    """Modulation couples into the detector: the loop holds still up to a rate, deg/h."""
    rate = _rate_dph(stage)
    return np.asarray(np.where(np.abs(rate) < size, -rate, 0.0))


def _faraday(turn: Array, elevation: Array, unit: Unit) -> Array:
    """A twisted fibre in the lab's field, in 50 uT: along one radius of the coil, and a little along its axis."""
    zero, up, level = np.zeros_like(turn), np.sin(elevation), np.cos(elevation)
    axis = np.stack((level * np.cos(turn), level * np.sin(turn), up))
    one = np.stack((-up * np.cos(turn), -up * np.sin(turn), level))
    other = np.stack((-np.sin(turn), np.cos(turn), zero))
    angle = 2.0 * math.pi * unit.draw["lean"]
    felt = math.cos(angle) * one + math.sin(angle) * other + _ALONG * axis
    return np.asarray(np.array([_FIELD_NORTH_UT, _FIELD_WEST_UT, _FIELD_UP_UT]) / 50.0 @ felt)


def _pump(unit: Unit, stage: Stage) -> Array:
    """The table's pump comes through at one frequency, at any phase."""
    phase = float(drawn(unit.seed, "pump", stage.key).uniform(0.0, 2.0 * math.pi))
    return np.asarray(np.sin(2.0 * math.pi * _PUMP_HZ * (1.0 + 0.1 * unit.draw["g1"]) * stage.time_s + phase))


def _polarised(unit: Unit, stage: Stage) -> Array:
    """Light that crosses over and back interferes as the birefringence goes with temperature: fringes."""
    coil = stage.body("coil") - 25.0
    period_k = 9.0 + 8.0 * unit.draw["order"]
    return np.asarray(np.sin(2.0 * math.pi * (coil / period_k + unit.draw["phase"]) + 4e-4 * coil**2))


def _cooler_spent(unit: Unit, stage: Stage) -> Array:
    """Above some temperature the source's cooler gives all it has: the source runs warm, and the bias with it."""
    return np.asarray(np.maximum(stage.body("hub") - 44.0 - 8.0 * unit.draw["tilt"], 0.0))


def _source_ages(unit: Unit, stage: Stage) -> Array:
    """The source drifts in wavelength over the weeks of a campaign: a scale factor of its own for every run."""
    return np.asarray(1e-6 * (stage.number / 26.0 - 0.5) * _rate_dph(stage))


def _source_warms(unit: Unit, stage: Stage) -> Array:
    """The wavelength comes to rest minutes after the source was switched on."""
    return np.asarray(
        1e-6 * np.exp(-_powered_s(stage) / (300.0 + 300.0 * unit.draw["c2"])) * _rate_dph(stage)
    )


def _zero_beat(unit: Unit, stage: Stage) -> Array:
    """The modulators of two gyros beat; their frequencies part with temperature and meet at one."""
    apart_hz = _BEAT_HZ_PER_K * (stage.body("hub") - 10.0 - 25.0 * unit.draw["g1"])
    phase = float(drawn(unit.seed, "beat", stage.key).uniform(0.0, 2.0 * math.pi))
    return np.asarray(np.sin(2.0 * math.pi * np.cumsum(apart_hz) * stage.step_s + phase))


def _valve_coil(unit: Unit, stage: Stage) -> Array:
    """The solenoid of the nitrogen valve has a field of its own."""
    return follow(stage.body("valve"), 1.0, stage.step_s)


def _modulator_comb(unit: Unit, stage: Stage) -> Array:
    """Where the ramp's frequency meets that of the modulator they disturb each other: over and over in rate."""
    return np.asarray(np.sin(2.0 * math.pi * _rate_dph(stage) / (3600.0 * (5.0 + 4.0 * unit.draw["c"]))))


EFFECTS: dict[str, Effect] = {
    "trimmed_coil": known(_of(_trimmed), "shupe"),
    "quadrupole": known(_of(_quadrupole), "shupe"),
    "thermo_optic": known(_of(_thermo_optic), "shupe_cross"),
    "glassy_potting": known(_of(_glassy), "cold_stress", beside=("shupe_cross",)),
    "pigtails": known(_of(_pigtails), "bias_quadratic", "bias_cubic"),
    "late_coil": known(_of(_late_coil), "thermal_lag", "relaxation"),
    "shield_heat": Effect(
        _of(_shield_heat), ("gradient",), ("shupe",), lambda unit, size: {"bias_dph_per_k": size}
    ),
    "glue_loops": known(_of(_glue), "hysteresis"),
    "connector": Effect(_of(_connector), ("mode_hop",), (), lambda unit, size: {"bias_step_dph": size}),
    "source_settles": known(_of(_source_settles), "warm_up"),
    "wavelength": Effect(
        _of(_wavelength), ("scale_factor_temperature",), (), lambda unit, size: {"sf_ppm_per_k": size}
    ),
    "wider_coil": known(_of(_wider_coil), "scale_factor_lag", beside=("scale_factor_temperature",)),
    "finite_gain": known(_of(_finite_gain), "scale_factor_nonlinearity"),
    "flyback": Effect(
        _of(_flyback), ("scale_factor_asymmetry",), (), lambda unit, size: {"asymmetry_ppm": 2.0 * size}
    ),
    "coupled_modulator": Effect(
        _coupled_modulator, ("dead_zone", "lock_in"), curved=True, sizes=(0.005, 8.0), signed=False
    ),
    "faraday": heading(_faraday),
    "pump_line": Effect(_of(_pump), ("vibration_or_mains_line",), changing=True),
    "mounting": misalignment(LATITUDE_DEG),
    "resolver": encoder((1, 2), 0.3),
    "latency": latency(LATITUDE_DEG),
    "slow_clock": skew(LATITUDE_DEG),
    "impulses": impulses(300.0),
    "polarised_light": Effect(_of(_polarised)),
    "cooler_spent": Effect(_of(_cooler_spent)),
    "ageing_source": Effect(_of(_source_ages), changing=True),
    "warming_source": Effect(_of(_source_warms)),
    "zero_beat": Effect(_of(_zero_beat), changing=True),
    "valve_coil": Effect(_of(_valve_coil), changing=True),
    "modulator_comb": Effect(_of(_modulator_comb)),
    "splice": telegraph(300.0),
}
"""Effects by name; from `polarised_light` on the catalogue has no name for them."""
