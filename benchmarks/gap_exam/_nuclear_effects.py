"""Effects of the nuclear resonance gyros, each from the physics of cell, laser, shield, loops or table.

Sources beside the family's: Happer and Mathur, Phys. Rev. 163 (1967): light shift; Street and Woolley, Proc.
Phys. Soc. A 62 (1949): after-effect; Krasnosel'skii and Pokrovskii, Systems with Hysteresis (1989): plays;
Ferry, Viscoelastic Properties of Polymers (1980): potting; Adler, Proc. IRE 34 (1946): locking; Gardner,
Phaselock Techniques (2005); Bozorth, Ferromagnetism (1951): Rayleigh's law.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from scipy.special import ndtr

from benchmarks.gap_exam._family import Effect, Unit
from benchmarks.gap_exam._nuclear_bench import LATITUDE_DEG
from benchmarks.gap_exam._nuclear_foreign import FOREIGN
from benchmarks.gap_exam._nuclear_parts import DECLINATION_RAD, DIP_RAD, coarse, former_ahead_k, true_dph
from benchmarks.gap_exam._signals import drawn, follow, slope_per_min, smooth_step, spectrum_of_lags
from benchmarks.gap_exam._stage import Stage
from benchmarks.gap_exam._turning import (
    azimuth,
    heading,
    impulses,
    known,
    latency,
    misalignment,
    skew,
    tilt,
)
from drivers.base.arrays import Array

# what the laser does: dispersion of the pumping line


def _detuning(stage: Stage, centre_c: float, width_k: float) -> Array:
    return np.asarray((stage.body("laser") - centre_c) / width_k)


def _light_shift_zero(unit: Unit, stage: Stage, size: float) -> Array:
    x = _detuning(stage, 54.0 + 1.5 * unit.draw["a"], 4.0)
    return np.asarray(size * 2.0 * x / (1.0 + x**2))


def _light_shift_top(unit: Unit, stage: Stage, size: float) -> Array:
    x = 1.0 + _detuning(stage, 54.2 + unit.draw["b"], 11.0)
    return np.asarray(size * (2.0 * x / (1.0 + x**2) - 1.0))


def _polarisation_flip(unit: Unit, stage: Stage, size: float) -> Array:
    """A surface-emitting laser flips its polarisation where it warms, and flips back 0.35 K lower."""
    upper = 53.0 + 3.5 * unit.draw["c"]
    times, laser = coarse(stage, stage.body("laser"))
    high, states = bool(laser[0] > upper - 0.17), []
    for value in laser.tolist():
        high = value > upper - 0.35 if high else value > upper
        states.append(float(high))
    last = np.clip(np.searchsorted(times, stage.time_s, side="right") - 1, 0, None)
    return np.asarray(size * np.array(states)[last])


# fields that follow temperature


def _field_ramp(unit: Unit, stage: Stage, size: float) -> Array:
    """The isotopes answer a changing field at different speeds: a ramp of the coils' field is left over."""
    ramp = slope_per_min(stage.body("former"), stage.step_s)
    return size * np.asarray(follow(ramp, 22.0, stage.step_s) + 0.3 * follow(ramp, 55.0, stage.step_s)) / 1.3


def _field_ramp_hot(unit: Unit, stage: Stage, size: float) -> Array:
    """The spins' times shorten as the walls relax them, by Arrhenius' law: what a ramp leaves over grows."""
    kelvin = stage.body("former") + 273.15
    faster = np.exp(3800.0 * (1.0 / 298.15 - 1.0 / kelvin)) - 1.0
    return np.asarray(size * faster * slope_per_min(stage.body("former"), stage.step_s))


def _thermocurrent(unit: Unit, stage: Stage, size: float) -> Array:
    """Heat through unlike metals drives a current round the coils: Seebeck's voltage over warming copper."""
    frame, base = stage.body("shield_a"), stage.body("base")
    return np.asarray(size * (frame - base) / (1.0 + 0.0039 * (0.5 * (frame + base) - 20.0)))


def _glassy_potting(unit: Unit, stage: Stage, size: float) -> Array:
    """A Maxwell body whose time grows in the cold strains the coils: what warmth relaxes stays there."""
    times, former = coarse(stage, stage.body("former"))
    step_s = float(times[1] - times[0])
    softens_s = 3.0 + 420.0 / (1.0 + np.exp((former + 3.0) / 2.6))
    stress, stresses = 0.0, []
    for ramp, tau in zip(np.gradient(former, step_s).tolist(), softens_s.tolist(), strict=True):
        kept = math.exp(-step_s / tau)
        stress = stress * kept + ramp * tau * (1.0 - kept)
        stresses.append(stress)
    return np.asarray(size * np.interp(stage.time_s, times, stresses))


def _core_lag(unit: Unit, stage: Stage, size: float) -> Array:
    """The field depends on the former, behind shield and vacuum, and not on the thermistor outside."""
    return np.asarray(size * former_ahead_k(stage) / 50.0)


_AFTER_S = tuple(300.0 * 2.6**k for k in range(6))


def _after_effect(unit: Unit, stage: Stage, size: float) -> Array:
    """Domains of the shield follow temperature by a flat spectrum of times."""
    shield = 0.5 * (stage.body("shield_a") + stage.body("shield_b"))
    late = spectrum_of_lags(shield, _AFTER_S, (1.0,) * len(_AFTER_S), stage.step_s)
    return np.asarray(size * (shield - late) / 50.0)


_PLAYS_K = np.array([1.0, 2.5, 5.0, 9.0, 15.0, 24.0])
_PLAY_WEIGHTS = np.array([0.10, 0.16, 0.24, 0.24, 0.16, 0.10])


def _domain_walls(unit: Unit, stage: Stage, size: float) -> Array:
    """The shield's walls are pinned: a sum of plays, less the straight line that they follow."""
    times, shield = coarse(stage, stage.body("shield_b"))
    at, loops = np.full(len(_PLAYS_K), shield[0]), []
    for value in shield.tolist():
        at = np.maximum(value - _PLAYS_K, np.minimum(value + _PLAYS_K, at))
        loops.append(float(_PLAY_WEIGHTS @ (at - value)))
    return np.asarray(size * np.interp(stage.time_s, times, loops) / 10.0)


def _polarising(unit: Unit, stage: Stage, size: float) -> Array:
    """The two isotopes polarise with times of their own, and their own fields act on the rubidium."""
    on_s = stage.power_on_s + stage.time_s
    slow, quick = 900.0 + 500.0 * unit.draw["c1"], 260.0
    return np.asarray(size * (np.exp(-on_s / slow) - 0.45 * np.exp(-on_s / quick)))


def _leaking_cell(unit: Unit, stage: Stage, size: float) -> Array:
    """Charge creeps off the cell's walls: nearly steadily through a run."""
    return np.asarray(size * 9.0 * -np.expm1(-stage.time_s / 3600.0 / 9.0))


# what turns and what is held


def _loop_gain(unit: Unit, stage: Stage, size: float) -> Array:
    """The field loop has a finite gain that falls with the signal's light: scale follows 1 / (1 + gain)."""
    fallen = np.exp((stage.t_in_c - 25.0) / 130.0)
    weak = 1e-3 * fallen / (1.0 + 1e-3 * fallen)
    at_25 = 1e-3 / (1.0 + 1e-3)
    return np.asarray(1e-6 * size * true_dph(stage) * (weak / at_25 - 1.0) * 2.6)


def _fork_crystal(unit: Unit, stage: Stage, size: float) -> Array:
    """The clock is a tuning-fork crystal: its frequency is highest at its turning point near 26 degC."""
    off = (stage.body("board") - 24.0 - 4.0 * unit.draw["g1"]) / 50.0
    return np.asarray(-1e-6 * size * true_dph(stage) * (off**2 + 0.04 * off**3))


def _coil_lag(unit: Unit, stage: Stage, size: float) -> Array:
    """The coils' constant belongs to the former, which is late behind the thermistor."""
    return np.asarray(1e-6 * size * true_dph(stage) * former_ahead_k(stage) / 5.0)


_LINE_DPS = 45.0


def _arctangent(unit: Unit, stage: Stage, size: float) -> Array:
    """A driven spin's phase is the arctangent of its detuning over the line's width."""
    rate = true_dph(stage)
    x = np.abs(rate) / 3600.0 / _LINE_DPS
    return np.asarray(1e-6 * size * rate * (np.arctan(x) / np.maximum(x, 1e-9) - 1.0))


def _charge_pump(unit: Unit, stage: Stage, size: float) -> Array:
    """Currents up and down differ; noise of the phase rounds the corner off."""
    rate = true_dph(stage)
    return np.asarray(0.5e-6 * size * rate * np.tanh(rate / 3600.0 / 0.15))


_JITTER_DPS = 0.9


def _clipping(unit: Unit, stage: Stage, size: float) -> Array:
    """The oscillator's word ends at 60 deg/s over `size`; what noise of the loop pushes beyond is cut off."""
    rate = true_dph(stage)
    room = (60.0 / size - np.abs(rate) / 3600.0) / _JITTER_DPS
    cut = np.exp(-0.5 * room**2) / math.sqrt(2.0 * math.pi) - room * ndtr(-room)
    return np.asarray(-np.sign(rate) * 3600.0 * _JITTER_DPS * np.maximum(cut, 0.0))


def _squelch(unit: Unit, stage: Stage, size: float) -> Array:
    """A squelch mutes the output below `size` deg/h; noise of the phase makes its edge soft."""
    rate = true_dph(stage)
    return np.asarray(-rate * smooth_step((size - np.abs(rate)) / (0.08 * size)))


def _crosstalk(unit: Unit, stage: Stage, size: float) -> Array:
    """The clock's line at the spins' frequency holds their loop within `size` deg/h and pulls it beyond."""
    rate = true_dph(stage)
    return np.asarray(np.sign(rate) * np.sqrt(np.maximum(rate**2 - size**2, 0.0)) - rate)


def _wobble(orders: Mapping[int, float], *names: str, beside: tuple[str, ...]) -> Effect:
    """The encoder errs by waves of orders with weights: `size` in arcsec."""

    def signal(unit: Unit, stage: Stage, size: float) -> Array:
        turn, phase = np.radians(stage.angle_deg), 2.0 * math.pi * unit.draw["phase"]
        error = np.sum([w * np.sin(n * turn + phase * (1.0 + n % 7)) for n, w in orders.items()], axis=0)
        return np.asarray(-size * np.diff(error) / stage.step_s * np.sin(np.radians(stage.elevation_deg)))

    return Effect(signal, names, beside)


def _leak(turn: Array, elevation: Array, unit: Unit) -> Array:
    """Earth's field leaks through the shield, by Rayleigh's law a little more than in proportion."""
    level = math.cos(DIP_RAD) * np.cos(turn + DECLINATION_RAD) * np.cos(elevation)
    field = level - math.sin(DIP_RAD) * np.sin(elevation)
    return np.asarray(field * (1.0 + 0.25 * np.abs(field)))


def _droplet(unit: Unit, stage: Stage, size: float) -> Array:
    """A drop of rubidium hangs on the wall and sags along the axis until its own tension stops it."""
    along = np.sin(np.radians(stage.elevation_deg))
    return np.asarray(size * np.tanh(0.7 * along) / math.tanh(0.7))


def _sagging_beam(unit: Unit, stage: Stage, size: float) -> Array:
    """The optics sag and a Gaussian beam leaves the cell's middle: light falls with the sag's square."""
    along = np.sin(np.radians(stage.elevation_deg))
    return np.asarray(size * (1.0 - np.exp(-0.9 * along**2)) / (1.0 - math.exp(-0.9)))


def _pump_whine(unit: Unit, stage: Stage, size: float) -> Array:
    """The motor's switching shakes the optics, with a power that levels off above some deg/s."""
    power = (stage.rate_dps / 12.0) ** 2
    return np.asarray(size * power / (1.0 + power))


def _mains(unit: Unit, stage: Stage, size: float) -> Array:
    """The mains' third harmonic beats with the spins' frequency: a slow line that keeps its frequency."""
    phase = drawn(unit.seed, "mains", stage.key).uniform(0.0, 2.0 * math.pi)
    return np.asarray(size * np.sin(2.0 * math.pi * (0.05 + 0.3 * unit.draw["form"]) * stage.time_s + phase))


EFFECTS: Mapping[str, Effect] = {
    "light_shift_zero": known(_light_shift_zero, "bias_cubic", beside=("bias_linear", "bias_quadratic")),
    "light_shift_top": known(_light_shift_top, "bias_quadratic", beside=("bias_linear", "bias_cubic")),
    "polarisation_flip": known(_polarisation_flip, "mode_hop", beside=("hysteresis",)),
    "field_ramp": known(_field_ramp, "shupe"),
    "field_ramp_hot": known(_field_ramp_hot, "shupe_cross", beside=("shupe",)),
    "thermocurrent": known(_thermocurrent, "gradient"),
    "glassy_potting": known(_glassy_potting, "cold_stress", beside=("shupe", "shupe_cross", "relaxation")),
    "core_lag": known(_core_lag, "thermal_lag"),
    "after_effect": known(_after_effect, "relaxation", beside=("thermal_lag",)),
    "domain_walls": known(_domain_walls, "hysteresis"),
    "polarising": known(_polarising, "warm_up"),
    "leaking_cell": known(_leaking_cell, "bias_ramp"),
    "loop_gain": known(
        _loop_gain, "scale_factor_temperature", beside=("scale_factor", "scale_factor_quadratic")
    ),
    "fork_crystal": known(
        _fork_crystal, "scale_factor_quadratic", beside=("scale_factor", "scale_factor_temperature")
    ),
    "coil_lag": known(_coil_lag, "scale_factor_lag"),
    "arctangent": known(_arctangent, "scale_factor_nonlinearity", beside=("scale_factor",)),
    "charge_pump": known(_charge_pump, "scale_factor_asymmetry"),
    "clipping": Effect(
        _clipping,
        ("saturation",),
        ("scale_factor_nonlinearity",),
        curved=True,
        sizes=(0.9, 1.1),
        signed=False,
    ),
    "squelch": Effect(_squelch, ("dead_zone",), curved=True, sizes=(1e-3, 1e4), signed=False),
    "crosstalk": Effect(_crosstalk, ("lock_in",), curved=True, sizes=(1e-3, 1e4), signed=False),
    "misalignment": misalignment(LATITUDE_DEG),
    "azimuth": azimuth(LATITUDE_DEG),
    "tilt": tilt(LATITUDE_DEG),
    "eccentric_disc": _wobble(
        {1: 1.0, 3: 0.12, 5: 0.05}, "table_wobble_once", beside=("table_wobble_twice", "table_rate_ripple")
    ),
    "oval_disc": _wobble(
        {2: 1.0, 4: 0.15, 6: 0.08}, "table_wobble_twice", beside=("table_wobble_once", "table_rate_ripple")
    ),
    "read_heads": _wobble(
        {36: 1.0, 35: 0.2, 72: 0.3}, "table_rate_ripple", beside=("table_wobble_once", "table_wobble_twice")
    ),
    "latency": latency(LATITUDE_DEG),
    "skew": skew(LATITUDE_DEG),
    "leak": heading(_leak),
    "droplet": known(_droplet, "acceleration_sensitivity"),
    "sagging_beam": known(_sagging_beam, "acceleration_squared"),
    "pump_whine": known(_pump_whine, "vibration_rectification"),
    "slips": impulses(420.0),
    "mains": Effect(_mains, ("vibration_or_mains_line",), changing=True),
    **FOREIGN,
}
