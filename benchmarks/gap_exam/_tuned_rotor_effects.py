"""What may be wrong with a tuned-rotor gyro and its bench: mechanisms in the rotor, torquer, leads and table.

Forms: unbalance and compliance of the rotor by cross products, as in the model equation of IEEE Std 813; loops
of Bouc and Wen (Arch. Comput. Methods Eng. 16, 161, 2009); a half-space's answer exp(t) erfc(sqrt(t)) (Carslaw
and Jaeger, 2.7); viscosity after Vogel. None is a formula of the catalogue.
"""

from __future__ import annotations

import math

import numpy as np
from scipy.signal import lfilter
from scipy.special import erfcx

from benchmarks.gap_exam._family import Effect, Signal, Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._signals import drawn, follow, smooth_step, spectrum_of_lags
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._turning import heading, known, latency, misalignment
from drivers.base.arrays import Array

LATITUDE_DEG = 47.4
_ROOM_C = 25.0
_FASTEST_DPS = 35.0
_MEMORY_S = 10.0
"""Step of loops that depend on the past."""


def _input_dps(stage: Stage) -> Array:
    """Return the true rate that the rotor feels, of the table and of the Earth."""
    return sensed_dph(stage, LATITUDE_DEG) / 3600.0


def gravity_g(elevation_deg: Array) -> Array:
    """Return the specific force in the case, g, (3, m): input axis, the axis across it in the vertical plane,
    the level one.
    """
    e = np.radians(elevation_deg)
    return np.stack((np.sin(e), -np.cos(e), np.zeros_like(e)))


def unbalance_dph(offset: Array, damping: float, elevation_deg: Array, spin: Array) -> Array:
    """Return the drift about the input axis of a rotor whose centre of mass lies off its support.

    H spin x drift balances the torque offset x force, and that of a damped suspension, `damping` times the
    force across the spin axis. `spin` (3,) is a unit vector across the input axis; H is 1.
    """
    force = gravity_g(elevation_deg)
    torque = np.cross(offset, force, axisb=0).T + damping * (force - np.outer(spin, spin @ force))
    return np.asarray(np.cross(spin, torque, axisb=0).T[0])


def compliance_dph(compliance: Array, elevation_deg: Array, spin: Array) -> Array:
    """Return the drift where gravity moves the rotor by a matrix (3, 3) times itself: torque shift x force."""
    force = gravity_g(elevation_deg)
    torque = np.cross((compliance @ force).T, force.T).T
    return np.asarray(np.cross(spin, torque, axisb=0).T[0])


def _spin(unit: Unit) -> Array:
    """Return the spin axis, between the axis across and the level one."""
    towards = math.radians(30.0 + 30.0 * unit.draw["a"])
    return np.array([0.0, math.cos(towards), math.sin(towards)])


def _unbalance(unit: Unit, stage: Stage, size: float) -> Array:
    spin = _spin(unit)
    damping = 1.6 * unit.draw["b"] - 0.8
    return size * unbalance_dph(spin, damping, stage.elevation_deg, spin)


def _pulls(unit: Unit, size: float) -> dict[str, float]:
    """Return the same in closed form: drift along and across gravity's component on the input axis."""
    across = (1.6 * unit.draw["b"] - 0.8) * float(_spin(unit)[2])
    return {"bias_dph_per_g_axial": -size, "bias_dph_per_g_cross": size * across}


def _compliance(unit: Unit, stage: Stage, size: float) -> Array:
    """The bearings are softer along a direction oblique to the input axis."""
    spin, across = _spin(unit), np.array([1.0, 0.0, 0.0])
    soft = math.radians(35.0 + 20.0 * unit.draw["b"])
    axis = math.cos(soft) * across + math.sin(soft) * spin
    return size * compliance_dph(np.outer(axis, axis), stage.elevation_deg, spin)


def _magnet(unit: Unit, stage: Stage, size: float) -> Array:
    """The torquer's magnet loses flux with warmth: current, and so output, grows by its inverse."""
    flux = 1.0 - 1e-6 * (stage.body("magnet") - _ROOM_C) * (1.0 + 0.004 * (stage.body("magnet") - _ROOM_C))
    return np.asarray(size * sensed_dph(stage, LATITUDE_DEG) * (1.0 / flux - 1.0))


def _coil_field(unit: Unit, stage: Stage, size: float) -> Array:
    """The coil's own field weakens the magnet, up to a knee."""
    driven = (_input_dps(stage) / (15.0 + 15.0 * unit.draw["c"])) ** 2
    return np.asarray(size * 1e-6 * sensed_dph(stage, LATITUDE_DEG) * driven / (1.0 + driven))


def _bridge(unit: Unit, stage: Stage, size: float) -> Array:
    """The halves of the current bridge differ by `size` ppm, blurred about zero by their bias current."""
    rate = _input_dps(stage)
    return np.asarray(size * 1.8e-3 * (np.hypot(rate, 0.3) - 0.3))


def _ceiling(unit: Unit, stage: Stage, size: float) -> Array:
    """The amplifier runs out of voltage: 35 deg/s over `size` is its limit, with a knee of the 14th order."""
    over = (_input_dps(stage) * size / _FASTEST_DPS) ** 14
    return np.asarray(3600.0 * _input_dps(stage) * ((1.0 + over) ** (-1.0 / 14.0) - 1.0))


def _stiction(unit: Unit, stage: Stage, size: float) -> Array:
    """Below about `size` deg/s contacts and leads hold the rotor."""
    rate = _input_dps(stage)
    return np.asarray(-3600.0 * rate * np.exp(-(np.abs(rate / size) ** 3)))


def bouc_wen(values: Array, width: float) -> Array:
    """Return the hysteretic part z of d z = d v / width * (1 - |z|^1.5 (0.7 sign(z d v) + 0.3)), from rest."""
    z, result = 0.0, np.zeros(len(values))
    steps = (np.diff(values) / width).tolist()
    for k, step in enumerate(steps):
        along = 1.0 if z * step > 0.0 else -1.0
        z += step * (1.0 - abs(z) ** 1.5 * (0.7 * along + 0.3))
        result[k + 1] = z
    return result


def _leads(unit: Unit, stage: Stage, size: float) -> Array:
    """The flexible leads yield as they shrink and stretch."""
    often = np.arange(0.0, stage.steps * stage.step_s + _MEMORY_S, _MEMORY_S)
    slow = bouc_wen(np.interp(often, stage.time_s, stage.body("core")), 5.0 + 7.0 * unit.draw["c2"])
    return size * np.asarray(np.interp(stage.time_s, often, slow))


def _heat_flow(unit: Unit, stage: Stage, size: float) -> Array:
    """Heat that flows from the slab into the core bends its flange."""
    return size * (stage.body("inner") - stage.body("core"))


def _layers(unit: Unit, stage: Stage, size: float) -> Array:
    """The outer part of the slab warps with the difference across all of it, a little late."""
    return size * follow(stage.body("face") - stage.body("core"), 25.0, stage.step_s)


def _resin(unit: Unit, stage: Stage, size: float) -> Array:
    """The resin that holds the coil follows warmth by a spectrum of times."""
    core = stage.body("core")
    return size * (core - spectrum_of_lags(core, (150.0, 600.0, 2400.0), (0.25, 0.45, 0.3), stage.step_s))


def _gas(unit: Unit, stage: Stage, size: float) -> Array:
    """Windage by a viscosity after Vogel, what a straight line through 25 degC has of it taken off."""
    warm = stage.body("core") - _ROOM_C
    slope = 420.0 / 115.0**2
    return size * (np.exp(420.0 / (115.0 + warm) - 420.0 / 115.0) - 1.0 + slope * warm)


def _run_up(unit: Unit, stage: Stage, size: float) -> Array:
    """The motor's heat spreads from switching on: a half-space's answer, a long tail."""
    on = (stage.time_s + stage.power_on_s) / (200.0 + 500.0 * unit.draw["c1"])
    return size * np.asarray(erfcx(np.sqrt(on)))


def _detent(unit: Unit, stage: Stage, size: float) -> Array:
    """A flexure snaps over, warming at another temperature than cooling, each over half a kelvin."""
    at = 5.0 + 30.0 * unit.draw["form"]
    core, half = stage.body("core"), 0.9
    upper, lower = smooth_step((core - at - half) / 0.15), smooth_step((core - at + half) / 0.15)
    over = np.where(core > at + half, 1, np.where(core < at - half, -1, 0))
    last = np.maximum.accumulate(np.where(over != 0, np.arange(len(core)), 0))
    snapped = np.where(over[last] == 0, np.sign(core[0] - at), over[last]) > 0
    return size * np.where(snapped, lower, upper)


def _mesh(unit: Unit, stage: Stage, size: float) -> Array:
    """The worm's vibration, amplified towards a resonance beyond the highest rate, is rectified."""
    ratio = np.abs(stage.rate_dps) / (65.0 + 25.0 * unit.draw["g1"])
    return np.asarray(size * ratio**2 / ((1.0 - ratio**2) ** 2 + (0.3 * ratio) ** 2))


def _eccentric(unit: Unit, stage: Stage, size: float) -> Array:
    """The encoder's disc sits off centre, `size` arcsec of reading: an eccentric's harmonics, and an oval."""
    turn, phase = np.radians(stage.angle_deg), 2.0 * math.pi * unit.draw["phase"]
    ratio = 0.3 + 0.3 * unit.draw["order"]
    error = np.arctan2(ratio * np.sin(turn + phase), 1.0 - ratio * np.cos(turn + phase)) / ratio
    error = error + 0.3 * np.sin(2.0 * turn + 1.7 * phase)
    return np.asarray(-size * np.diff(error) / stage.step_s * np.sin(np.radians(stage.elevation_deg)))


def _cogs(unit: Unit, stage: Stage, size: float) -> Array:
    """The shaft winds up with the cogging torque, behind the encoder: an order and its third."""
    order = (9, 14, 22)[int(2.999 * unit.draw["order"])]
    turn = np.radians(stage.angle_deg)
    wound = np.sin(order * turn + 6.0 * unit.draw["phase"]) + 0.3 * np.sin(3.0 * order * turn)
    return np.asarray(size * np.diff(wound) / stage.step_s * np.sin(np.radians(stage.elevation_deg)))


def _stray(turn: Array, up: Array, unit: Unit) -> Array:
    """The field of a pump motor beside the table, and what the case's iron makes of it."""
    along = np.cos(turn - 2.0 * math.pi * unit.draw["c"]) * np.cos(up) + 0.4 * np.sin(up)
    return np.asarray(along + 0.25 * along * np.abs(along))


def _torquer_heat(unit: Unit, stage: Stage, size: float) -> Array:
    """The coil's losses, as the square of rate, warm it by and by."""
    lost = (_input_dps(stage) / 20.0) ** 2
    return size * spectrum_of_lags(lost, (90.0, 600.0), (0.4, 0.6), stage.step_s)


def _expanding(unit: Unit, stage: Stage, size: float) -> Array:
    """The centre of mass wanders along the spin axis with warmth."""
    offset = _spin(unit)
    pulled = unbalance_dph(offset, 0.0, stage.elevation_deg, offset)
    return np.asarray(size * pulled * (stage.body("core") - _ROOM_C) / 50.0)


def _after_turning(unit: Unit, stage: Stage, size: float) -> Array:
    """What has sagged under gravity comes back slowly in a new position."""
    pull = gravity_g(stage.elevation_deg)[0]
    return np.asarray(size * (pull - spectrum_of_lags(pull, (25.0, 120.0), (0.5, 0.5), stage.step_s)))


def _hunting(unit: Unit, stage: Stage, size: float) -> Array:
    """The synchronous motor hunts after a jolt of the table: a ringing of 40 s or so."""
    pole = np.exp(stage.step_s * (-1.0 / 70.0 + 2j * math.pi / (32.0 + 20.0 * unit.draw["b"])))
    jolts = np.diff(stage.axis_dps, prepend=stage.axis_dps[0])
    return np.asarray(size * lfilter([1.0], [1.0, -pole], jolts.astype(complex)).imag)


def _tuning(unit: Unit, stage: Stage, size: float) -> Array:
    """At one temperature the suspension's tuning meets a whirl of the bearings."""
    off = (stage.body("core") - 2.0 - 40.0 * unit.draw["form"]) / (1.8 + unit.draw["a"])
    return np.asarray(size / (1.0 + off**2))


def _retainer(unit: Unit, stage: Stage, size: float) -> Array:
    """The bearing's cage runs in one of three states."""
    rng = drawn(unit.seed, "cage", stage.key)
    stays = 15.0 + rng.exponential(170.0, 8 + stage.seconds // 15)
    states = np.cumsum(rng.integers(1, 3, len(stays))) % 3
    return size * np.array([0.0, 1.0, -0.6])[states[np.searchsorted(np.cumsum(stays), stage.time_s)]]


def _aged(unit: Unit, stage: Stage, size: float) -> Array:
    """After some run of the campaign a glued joint is loose: the slope of bias is another from then on."""
    since = stage.number >= 7 + int(9.0 * unit.draw["c1"])
    return np.asarray(size * float(since) * (stage.body("core") - _ROOM_C) / 50.0)


def _weather(unit: Unit, stage: Stage, size: float) -> Array:
    """Air pressure acts on the case: slow waves, other ones in every run."""
    rng = drawn(unit.seed, "weather", stage.key)
    periods_s = rng.uniform(1500.0, 9000.0, 4)
    waves = np.sin(2.0 * math.pi * (stage.time_s / periods_s[:, None] + rng.random((4, 1))))
    return np.asarray(size * rng.normal(1.0, 0.3, 4) @ waves)


def _fan(unit: Unit, stage: Stage, size: float) -> Array:
    """The chamber's fan shakes the rotor while it runs, and it runs by no clock that is logged."""
    return size * follow(stage.body("fan"), 8.0, stage.step_s)


def _changing(signal: Signal) -> Effect:
    return Effect(signal, changing=True)


_RIPPLE = ("table_wobble_once", "table_wobble_twice")
EFFECTS: dict[str, Effect] = {
    "unbalance": known(_unbalance, "acceleration_sensitivity", beside=("heading_sensitivity",), truth=_pulls),
    "compliance": known(_compliance, "acceleration_squared"),
    "magnet": known(
        _magnet, "scale_factor_temperature", "scale_factor_quadratic", beside=("scale_factor_lag",)
    ),
    "coil_field": known(_coil_field, "scale_factor_nonlinearity"),
    "bridge": known(_bridge, "scale_factor_asymmetry", truth=lambda unit, size: {"asymmetry_ppm": size}),
    "ceiling": Effect(
        _ceiling, ("saturation",), ("scale_factor_nonlinearity",), None, True, (0.1, 3.0), signed=False
    ),
    "stiction": Effect(_stiction, ("dead_zone", "lock_in"), curved=True, sizes=(1e-3, 3.0), signed=False),
    "leads": known(_leads, "hysteresis"),
    "heat_flow": known(_heat_flow, "shupe", beside=("gradient",)),
    "layers": known(_layers, "gradient", beside=("shupe",)),
    "resin": known(_resin, "thermal_lag", "relaxation"),
    "gas": known(_gas, "bias_quadratic", "bias_cubic"),
    "run_up": known(_run_up, "warm_up"),
    "detent": known(_detent, "mode_hop", truth=lambda unit, size: {"bias_step_dph": size}),
    "mesh": known(_mesh, "vibration_rectification"),
    "lean": misalignment(LATITUDE_DEG),
    "eccentric": known(_eccentric, *_RIPPLE),
    "cogs": known(_cogs, "table_rate_ripple", *_RIPPLE),
    "latency": latency(LATITUDE_DEG),
    "stray": heading(_stray),
    "torquer_heat": Effect(_torquer_heat),
    "expanding": Effect(_expanding),
    "after_turning": Effect(_after_turning),
    "hunting": Effect(_hunting),
    "tuning": Effect(_tuning),
    "retainer": _changing(_retainer),
    "aged": _changing(_aged),
    "weather": _changing(_weather),
    "fan": _changing(_fan),
}
"""The first twenty have a name in the catalogue, the others none.

Nearly steady heat flows through the slab, so its rate of change and its gradient stand beside each other; a
vertical field is gravity; a knee that only the highest rate reaches is a high power of rate.
"""
