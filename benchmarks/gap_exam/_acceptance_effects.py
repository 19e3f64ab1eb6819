"""What the nominal model of a chip resonator gyro lacks: heat, laser, scattered light, geometry; and what no
catalogue has.
"""

from __future__ import annotations

import math

import numpy as np

from benchmarks.gap_exam import _turning as common
from benchmarks.gap_exam._family import Effect, Unit
from benchmarks.gap_exam._geometry import sensed_dph
from benchmarks.gap_exam._signals import drawn, follow, play, slope_per_min, smooth_step, spectrum_of_lags
from benchmarks.gap_exam._stage import Stage
from drivers.base.arrays import Array

LATITUDE_DEG = 52.3
_TURN = 2.0 * math.pi


def _rate(stage: Stage) -> Array:
    """Return the sensed rate, Earth included, deg/h, (m,)."""
    return sensed_dph(stage, LATITUDE_DEG)


def _from_25(stage: Stage) -> Array:
    """Return the chip's temperature from 25 degC in units of 50 K, (m,)."""
    return (stage.body("chip") - 25.0) / 50.0


def _between(low: float, high: float, share: float) -> float:
    return low + (high - low) * share


# heat -------------------------------------------------------------------------------------------------------


def stress(unit: Unit, stage: Stage, size: float) -> Array:
    """Birefringence by stress of the glass on the chip: a curved bias of its temperature, no lag."""
    bend, x = _between(0.8, 2.0, unit.draw["a"]), _from_25(stage)
    lean = _between(-0.4, 0.4, unit.draw["b"])
    return np.asarray(size * (np.cosh(bend * x) - 1.0 + lean * (np.sinh(bend * x) - bend * x)))


def shupe(unit: Unit, stage: Stage, size: float) -> Array:
    """The ring warms unevenly while the chip warms: odd in the rate of temperature, less than linear."""
    warmed = follow(stage.body("chip"), _between(5.0, 25.0, unit.draw["a"]), stage.step_s)
    speed = slope_per_min(warmed, stage.step_s)
    knee = _between(1.5, 5.0, unit.draw["b"])
    return np.asarray(size * knee * np.arcsinh(speed / knee))


def gradient(unit: Unit, stage: Stage, size: float) -> Array:
    """Heat that crosses the mount bends the carrier: odd in the difference between carrier and case."""
    across = (stage.body("case") - stage.body("carrier")) / _between(6.0, 14.0, unit.draw["c"])
    return np.asarray(size * np.sinh(across))


def creep(unit: Unit, stage: Stage, size: float) -> Array:
    """Glue under the chip follows the carrier by a spectrum of slow lags; what it lacks is stress."""
    slowest = _between(900.0, 2400.0, unit.draw["a"])
    times = (0.15 * slowest, 0.4 * slowest, slowest)
    carrier = stage.body("carrier")
    return np.asarray(size * (carrier - spectrum_of_lags(carrier, times, (0.2, 0.3, 0.5), stage.step_s)))


def warm_up(unit: Unit, stage: Stage, size: float) -> Array:
    """The laser's current settles after power-on by a stretched exponential of the time since."""
    since_s = stage.power_on_s + stage.time_s
    time_s, power = _between(120.0, 500.0, unit.draw["b"]), _between(0.65, 1.0, unit.draw["c"])
    return np.asarray(size * np.exp(-((since_s / time_s) ** power)))


def hysteresis(unit: Unit, stage: Stage, size: float) -> Array:
    """Solder sticks: three play operators of the chip's temperature."""
    chip, wide = stage.body("chip"), _between(4.0, 9.0, unit.draw["a"])
    parts = [chip - play(chip, wide * share) for share in (0.5, 1.0, 1.7)]
    return np.asarray(size * (0.5 * parts[0] + 0.3 * parts[1] + 0.2 * parts[2]))


def mode_hop(unit: Unit, stage: Stage, size: float) -> Array:
    """The laser hops to another mode at a temperature, and back at a lower one."""
    hop, half = _between(39.0, 52.0, unit.draw["c1"]), _between(0.5, 2.5, unit.draw["c2"])
    return np.asarray(size * (play(stage.body("chip"), half) > hop))


def scale_of_heat(unit: Unit, stage: Stage, size: float) -> Array:
    """The ring's size and index change with the chip's temperature: scale factor, ppm."""
    bend, x = _between(-1.2, 1.2, unit.draw["form"]) + 1e-6, _from_25(stage)
    return np.asarray(1e-6 * size * _rate(stage) * np.expm1(bend * x) / bend)


# rate -------------------------------------------------------------------------------------------------------


def locked_dph(rate_dph: Array, half_width_dph: float, power: float) -> Array:
    """Return the rate that scattered light leaves: none within the zone, (|r|^p - w^p)^(1/p) outside."""
    left = np.maximum(np.abs(rate_dph) ** power - half_width_dph**power, 0.0) ** (1.0 / power)
    return np.asarray(np.sign(rate_dph) * left)


def scattered(unit: Unit, stage: Stage, size: float) -> Array:
    """Light scattered backwards locks both directions: a dead zone of half width `size`, deg/h."""
    rate = _rate(stage)
    return locked_dph(rate, size, _between(1.4, 2.6, unit.draw["form"])) - rate


def limited_dph(rate_dph: Array, limit_dph: float, power: float) -> Array:
    """Return a rate that ends at a limit, with a knee of some power."""
    return np.asarray(rate_dph / (1.0 + np.abs(rate_dph / limit_dph) ** power) ** (1.0 / power))


def limit(unit: Unit, stage: Stage, size: float) -> Array:
    """The tracking loop ends at 200 deg/s over `size`."""
    rate = _rate(stage)
    return limited_dph(rate, 3600.0 * 200.0 / size, _between(10.0, 24.0, unit.draw["b"])) - rate


def kerr(unit: Unit, stage: Stage, size: float) -> Array:
    """Unequal powers: the scale factor, ppm, differs between both senses."""
    rate, knee_dph = _rate(stage), 3600.0 * _between(0.2, 3.0, unit.draw["a"])
    return np.asarray(1e-6 * size * rate * np.tanh(rate / knee_dph))


# place ------------------------------------------------------------------------------------------------------


def bent(unit: Unit, stage: Stage, size: float) -> Array:
    """The chip's cantilever bends under gravity along the input axis; it stiffens."""
    force = np.sin(np.radians(stage.elevation_deg))
    stiff = _between(0.3, 1.5, unit.draw["c"])
    return np.asarray(size * np.arctan(stiff * force) / stiff)


def faraday(turn: Array, elevation: Array, unit: Unit) -> Array:
    """Return the Earth's field along the chip's sensitive direction, of the level part 1."""
    return np.asarray(
        np.cos(elevation) * np.cos(turn - _TURN * unit.draw["phase"])
        + 0.3 * np.sin(elevation) * np.cos(turn - _TURN * unit.draw["lean"])
    )


def line(unit: Unit, stage: Stage, size: float) -> Array:
    """The beat of pump current and modulation: a sine of fixed frequency, by chance in phase in each run."""
    hertz = math.exp(_between(math.log(0.006), math.log(0.04), unit.draw["g1"]))
    phase = drawn(unit.seed, "line phase", stage.key).uniform(0.0, _TURN)
    return np.asarray(size * np.sin(_TURN * hertz * stage.time_s + phase))


# foreign ----------------------------------------------------------------------------------------------------


def etalon(unit: Unit, stage: Stage, size: float) -> Array:
    """A stray cavity: fringes of the chip's temperature."""
    period_k = _between(3.0, 8.0, unit.draw["a"])
    return np.asarray(size * np.sin(_TURN * (stage.body("chip") / period_k + unit.draw["phase"])))


def wound(unit: Unit, stage: Stage, size: float) -> Array:
    """The pigtail twists as the table winds it up: bias of the angle since the run began, in whole."""
    turned = 0.5 * (stage.angle_deg[1:] + stage.angle_deg[:-1]) - stage.angle_deg[0]
    return np.asarray(size * np.tanh(turned / _between(120.0, 600.0, unit.draw["b"])))


def darkened(unit: Unit, stage: Stage, size: float) -> Array:
    """The guide darkens from run to run: scale factor, ppm, of the runs made so far."""
    done = 1.0 - math.exp(-stage.number / _between(4.0, 12.0, unit.draw["c"]))
    return np.asarray(1e-6 * size * done * _rate(stage))


def after_turning(unit: Unit, stage: Stage, size: float) -> Array:
    """Power spent at rate heats the loop: bias of the rate's square over 50 deg/s, delayed, settled at rest."""
    squared = np.minimum((stage.axis_dps / 50.0) ** 2, 4.0)
    slow = follow(np.concatenate(([0.0], squared)), _between(25.0, 90.0, unit.draw["a"]), stage.step_s)[1:]
    return np.asarray(size * slow)


def breathing(unit: Unit, stage: Stage, size: float) -> Array:
    """The can breathes with the weather: a slow wave of its own in every run."""
    rng = drawn(unit.seed, "breathing", stage.key)
    period_s, phase = rng.uniform(400.0, 1500.0), rng.uniform(0.0, _TURN)
    return np.asarray(size * (smooth_step(3.0 * np.sin(_TURN * stage.time_s / period_s + phase)) - 0.5))


def rings(unit: Unit, stage: Stage, size: float) -> Array:
    """Bursts at random times that ring down in a minute."""
    rng, result = drawn(unit.seed, "rings", stage.key), np.zeros(stage.steps)
    period_s = _between(20.0, 45.0, unit.draw["b"])
    for begin in np.cumsum(rng.exponential(500.0, 60)):
        since = stage.time_s - begin
        since = np.where(since > 0.0, since, np.inf)
        result += (
            rng.normal()
            * np.exp(-since / 60.0)
            * np.where(np.isfinite(since), np.cos(_TURN * np.minimum(since, 1e6) / period_s), 0.0)
        )
    return size * result


EFFECTS: dict[str, Effect] = {
    "stress": common.known(stress, "bias_quadratic", "bias_cubic"),
    "shupe": common.known(shupe, "shupe"),
    "gradient": common.known(gradient, "gradient"),
    "creep": common.known(creep, "relaxation", "thermal_lag"),
    "warm_up": common.known(warm_up, "warm_up"),
    "hysteresis": common.known(hysteresis, "hysteresis"),
    "mode_hop": common.known(mode_hop, "mode_hop"),
    "scale_of_heat": common.known(scale_of_heat, "scale_factor_temperature", "scale_factor_quadratic"),
    "scattered": Effect(scattered, ("dead_zone", "lock_in"), curved=True, sizes=(0.01, 3000.0), signed=False),
    "limit": Effect(
        limit, ("saturation",), ("scale_factor_nonlinearity",), curved=True, sizes=(0.4, 4.0), signed=False
    ),
    "kerr": common.known(kerr, "scale_factor_asymmetry"),
    "bent": common.known(bent, "acceleration_sensitivity"),
    "faraday": common.heading(faraday),
    "encoder": common.encoder((1, 2), 0.2),
    "latency": common.latency(LATITUDE_DEG),
    "line": Effect(line, ("vibration_or_mains_line",), changing=True),
    "etalon": Effect(etalon),
    "wound": Effect(wound),
    "darkened": Effect(darkened),
    "after_turning": Effect(after_turning),
    "breathing": Effect(breathing, changing=True),
    "rings": Effect(rings, changing=True),
}
NOISY = {
    "bright": (1.6, 4.0, "noise_level"),
    "flickering": (2.5, 6.0, "bias_instability"),
    "wandering": (3.0, 10.0, "rate_random_walk"),
}
