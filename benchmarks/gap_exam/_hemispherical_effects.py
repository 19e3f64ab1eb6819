"""What is wrong with hemispherical resonators, their mounts and a belt-driven table: averaged equations of the
standing wave (D. D. Lynch, Vibratory gyro analysis by the method of averaging, 1995), mounts as loops and
Maxwell bodies, charges on electrodes.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from benchmarks.gap_exam._family import Effect, Signal, Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._hemispherical_bench import PULLEYS
from benchmarks.gap_exam._signals import drawn, follow, play, smooth_step, spectrum_of_lags
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._turning import azimuth, encoder, impulses, known, latency, misalignment, skew, tilt
from drivers.base.arrays import Array
from drivers.base.constants import ZERO_CELSIUS_K

LATITUDE_DEG = 52.2
BRYAN = 0.2775
"""Turn of the pattern against the case for a turn of the case, n = 2 on a hemisphere."""
_ROOM_K = 25.0 + ZERO_CELSIUS_K
_ACTIVATION_K = 3500.0
"""Activation energy of losses at the shell's surface over Boltzmann's constant."""
_PLAYS_K = (2.0, 5.0, 11.0, 22.0)
_CREEP_S = (300.0, 900.0, 2700.0)
_WINDUP_S = 25.0
_CROSSING_K = 1.8


def pattern_rad(stage: Stage) -> Array:
    """Return by how much the pattern stands off its place at a run's start, rad, (m,), middles of steps.

    The pattern lags behind the case by Bryan's factor times the turn; before each run it is parked.
    """
    turns = np.radians(sensed_dph(stage, LATITUDE_DEG)) * stage.step_s / 3600.0
    return np.asarray(-BRYAN * (np.cumsum(turns) - 0.5 * turns))


def anisotropy(stage: Stage, order: int, axis_rad: float) -> Array:
    """Return the sine of `order` times the pattern's angle to an axis of the shell, (m,).

    A difference of damping between the two modes of n = 2 acts with order 4: it is the same again after 90 deg.
    """
    return np.asarray(np.sin(order * (pattern_rad(stage) - axis_rad)))


def _parked(stage: Stage) -> Array:
    """Return how much of a damping's drift is there, (m,): all of it where the pattern was parked."""
    return anisotropy(stage, 4, -math.pi / 8.0)


def losses(shell_c: Array) -> Array:
    """Return the surface losses of the shell over those at 25 degC, less 1: Arrhenius' law."""
    kelvin = shell_c + ZERO_CELSIUS_K
    return np.asarray(np.exp(_ACTIVATION_K * (1.0 / _ROOM_K - 1.0 / kelvin)) - 1.0)


def plays(values: Array, widths: tuple[float, ...]) -> Array:
    """Return the mean of play operators (Prandtl-Ishlinskii) of half widths, (m,), at rest in the beginning."""
    return np.asarray(sum(play(values, width) for width in widths) / len(widths))


def stretched(seconds: Array, time_s: float, power: float) -> Array:
    """Return the relaxation of charges in a dielectric: exp(-(t / time)^power), Kohlrausch."""
    return np.asarray(np.exp(-((np.maximum(seconds, 0.0) / time_s) ** power)))


def _of(shape: Callable[[Unit, Stage], Array]) -> Signal:
    """Return the signal that is a shape times its size."""
    return lambda unit, stage, size: np.asarray(size * shape(unit, stage))


def _powered_s(stage: Stage) -> Array:
    return np.asarray(stage.time_s + stage.power_on_s)


def _damping(unit: Unit, stage: Stage) -> Array:
    """A damping mismatch that grows with the losses."""
    return np.asarray(losses(stage.body("shell")) * _parked(stage))


def _quadrature(unit: Unit, stage: Stage) -> Array:
    """Frequency mismatch times error of the demodulator's phase, both linear in the electronics' temperature.

    One vanishes near 20, the other near 32 degC.
    """
    flange = stage.body("flange")
    split, phase = flange - 16.0 - 8.0 * unit.draw["a"], flange - 28.0 - 8.0 * unit.draw["b"]
    return np.asarray(split * phase / 2500.0)


def _late_shell(unit: Unit, stage: Stage) -> Array:
    return np.asarray((stage.body("shell") - stage.body("flange")) * _parked(stage))


def _creep(unit: Unit, stage: Stage) -> Array:
    """Stress in the glue of the stem: elastic against what has not crept away, Maxwell bodies in parallel."""
    flange = stage.body("flange")
    return np.asarray(flange - spectrum_of_lags(flange, _CREEP_S, (1.0, 1.0, 1.0), stage.step_s))


def _solder(unit: Unit, stage: Stage) -> Array:
    return plays(stage.body("flange"), _PLAYS_K)


def _seat(unit: Unit, stage: Stage) -> Array:
    """The spring washer of the mount sits otherwise above some temperature."""
    return smooth_step((stage.body("flange") - _seat_c(unit)) / 0.15)


def _seat_c(unit: Unit) -> float:
    return 6.0 + 10.0 * unit.draw["a"] if unit.draw["form"] < 0.5 else 33.0 + 10.0 * unit.draw["a"]


def _charging(unit: Unit, stage: Stage) -> Array:
    """Charges on the electrodes' glass spread after the high voltage came on."""
    return stretched(_powered_s(stage), 900.0 + 1200.0 * unit.draw["c"], 0.8)


def _leaking(unit: Unit, stage: Stage) -> Array:
    """The floating charge of the shell leaks off within days: a ramp, set back before every run."""
    return np.asarray(stage.time_s / 3600.0)


def _axial_g(stage: Stage) -> Array:
    return np.asarray(np.sin(np.radians(stage.elevation_deg)))


def _shaken(unit: Unit, stage: Stage) -> Array:
    """The belt's teeth shake the case as fast as the table turns: rectified, with the square of the rate."""
    return np.asarray((stage.rate_dps / 100.0) ** 2)


def _clocked(unit: Unit, stage: Stage) -> Array:
    """The processor's crystal beside the flange: what it counts an hour, per ppm/K."""
    return np.asarray(1e-6 * (stage.body("flange") - 25.0) * sensed_dph(stage, LATITUDE_DEG))


def _thick(unit: Unit, stage: Stage) -> Array:
    """Bryan's factor changes as the shell grows, late as it is."""
    late = follow(stage.body("shell"), 600.0 + 900.0 * unit.draw["c2"], stage.step_s)
    return np.asarray(1e-6 * (late - 25.0) * sensed_dph(stage, LATITUDE_DEG))


def _centrifugal(unit: Unit, stage: Stage) -> Array:
    """The shell widens as it turns: Bryan's factor errs with the square of the rate."""
    rate = sensed_dph(stage, LATITUDE_DEG)
    return np.asarray(1e-6 * rate * (rate / 3.6e5) ** 2)


def _damping_wave(unit: Unit, stage: Stage) -> Array:
    axis = math.pi * unit.draw["c1"]
    return np.asarray(anisotropy(stage, 4, axis) - math.sin(-4.0 * axis))


def _pick_off(unit: Unit, stage: Stage) -> Array:
    """Unequal gains of the pick-offs: the angle read errs with order 8, the rate with its slope, per radian."""
    phase = 8.0 * (pattern_rad(stage) - math.pi * unit.draw["c2"])
    return np.asarray(np.cos(phase) * 8.0 * sensed_dph(stage, LATITUDE_DEG))


def _crossing(unit: Unit, stage: Stage) -> Array:
    """A bending mode of the stem crosses the working frequency: a dispersion around one temperature."""
    off = (stage.body("shell") - 5.0 - 36.0 * unit.draw["tilt"]) / _CROSSING_K
    return np.asarray(2.0 * off / (1.0 + off * off))


def _fanned(unit: Unit, stage: Stage) -> Array:
    """The fan shakes the case while it runs."""
    return follow(stage.body("fan"), 4.0, stage.step_s)


def _hits(unit: Unit, stage: Stage) -> Array:
    """Charge comes in lumps at any time and drains away."""
    rng = drawn(unit.seed, "lumps", stage.key)
    seconds = stage.steps * stage.step_s
    lumps = np.zeros(stage.steps)
    count = 1 + int(rng.poisson(seconds / 1500.0))
    np.add.at(lumps, rng.integers(0, stage.steps, count), rng.choice((-1.0, 1.0), count))
    return np.asarray(_drained(lumps, 420.0, stage.step_s))


def _drained(lumps: Array, time_s: float, step_s: float) -> Array:
    """Return the sum of lumps (m,) that decay exponentially."""
    level = follow(np.concatenate(([0.0], lumps)), time_s, step_s)[1:]
    return np.asarray(level / (1.0 - math.exp(-step_s / time_s)))


def _ageing(unit: Unit, stage: Stage) -> Array:
    """The getter is spent: the slope of damping over temperature grows from run to run."""
    return np.asarray((stage.number / 26.0 - 0.5) * (stage.body("shell") - 25.0) / 50.0 * _parked(stage))


def _windup(unit: Unit, stage: Stage) -> Array:
    """Every change of rate leaves quadrature, of one sign, that its loop takes out."""
    jerked = np.abs(np.diff(stage.rate_dps, prepend=stage.rate_dps[0])) / stage.step_s
    return follow(np.concatenate(([0.0], jerked)), _WINDUP_S, stage.step_s)[1:]


def _pulley(unit: Unit, stage: Stage) -> Array:
    """The encoder sits on the motor: an eccentric pulley turns the table otherwise than it says."""
    turn = PULLEYS * np.radians(0.5 * (stage.angle_deg[1:] + stage.angle_deg[:-1]))
    phase = 2.0 * math.pi * unit.draw["phase"]
    return np.asarray(3600.0 * stage.axis_dps * np.sin(turn + phase))


EFFECTS: dict[str, Effect] = {
    "damping_mismatch": known(
        _of(_damping), "bias_quadratic", "bias_cubic", beside=("thermal_lag", "relaxation")
    ),
    "quadrature_leak": Effect(
        _of(_quadrature), ("bias_quadratic",), (), lambda unit, size: {"bias_dph_per_50k2": size}
    ),
    "late_shell": known(_of(_late_shell), "thermal_lag", "relaxation"),
    "stem_glue": known(_of(_creep), "relaxation", "thermal_lag"),
    "stem_heat": Effect(
        _of(lambda unit, stage: stage.body("can") - stage.body("flange")), ("gradient",), ("shupe",),
        lambda unit, size: {"bias_dph_per_k": -size},
    ),
    "solder_loops": known(_of(_solder), "hysteresis"),
    "washer": Effect(_of(_seat), ("mode_hop",), (), lambda unit, size: {"bias_step_dph": size}),
    "charging": known(_of(_charging), "warm_up"),
    "leaking_charge": Effect(_of(_leaking), ("bias_ramp",), (), lambda unit, size: {"bias_dph_per_h": size}),
    "sagging_shell": Effect(
        _of(lambda unit, stage: _axial_g(stage)), ("acceleration_sensitivity",), ("heading_sensitivity",),
        lambda unit, size: {"bias_dph_per_g_axial": size},
    ),
    "soft_electrodes": Effect(
        _of(lambda unit, stage: _axial_g(stage) ** 2), ("acceleration_squared",), (),
        lambda unit, size: {"bias_dph_per_g2": size},
    ),
    "belt_shake": Effect(
        _of(_shaken), ("vibration_rectification",), (), lambda unit, size: {"bias_dph_at_100dps": size}
    ),
    "crystal": Effect(
        _of(_clocked), ("scale_factor_temperature",), (), lambda unit, size: {"sf_ppm_per_k": size}
    ),
    "thick_shell": known(_of(_thick), "scale_factor_lag", beside=("scale_factor_temperature",)),
    "centrifugal": known(_of(_centrifugal), "scale_factor_nonlinearity"),
    "bracket": misalignment(LATITUDE_DEG),
    "case_mark": azimuth(LATITUDE_DEG),
    "table_feet": tilt(LATITUDE_DEG),
    "eccentric_encoder": encoder((1, 2), 0.2),
    "latency": latency(LATITUDE_DEG),
    "slow_clock": skew(LATITUDE_DEG),
    "sparks": impulses(400.0),
    "damping_wave": Effect(_of(_damping_wave)),
    "pick_off_wave": Effect(_of(_pick_off)),
    "mode_crossing": Effect(_of(_crossing)),
    "fan_shake": Effect(_of(_fanned), changing=True),
    "charge_lumps": Effect(_of(_hits), changing=True),
    "spent_getter": Effect(_of(_ageing), changing=True),
    "quadrature_windup": Effect(_of(_windup)),
    "eccentric_pulley": Effect(_of(_pulley)),
}  # fmt: skip
"""Effects by name; from `damping_wave` on the catalogue has no name for them."""
