"""An IMU turned on a table leg by leg: exact increments of its gyros and accelerometers, with every error term.

Rests are constant; turns are integrated over each sample by three-point Gauss quadrature. White noise and
first-order Markov biases come on top.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from drivers.base.arrays import Array
from drivers.base.constants import EARTH_RATE_RAD_S
from drivers.base.errors import ConfigurationError
from simulators.plant.gimbals import turned_about
from simulators.plant.imu import ImuErrors, ImuNoise, with_errors
from simulators.plant.noise import follow

_GAUSS = np.polynomial.legendre.leggauss(3)


@dataclass(frozen=True, eq=False)
class Rest:
    """The table stands for `duration_s`."""

    duration_s: float


@dataclass(frozen=True, eq=False)
class Turn:
    """The table turns about `axis`, a unit vector in b, by `angle_rad`, at constant rate or smoothly from rest to
    rest (angle = A (s - sin(2 pi s) / 2 pi)).
    """

    axis: Array
    angle_rad: float
    duration_s: float
    profile: Literal["constant", "smooth"] = "smooth"


@dataclass(frozen=True, eq=False)
class ImuRecord:
    """Increments over consecutive samples of `period_s`: rad and m/s, shape (n, 3) each."""

    period_s: float
    angle_rad: Array
    velocity_mps: Array


def measure_motion(
    attitude: Array,
    legs: Sequence[Rest | Turn],
    errors: ImuErrors,
    noise: ImuNoise,
    *,
    latitude_deg: float,
    gravity_mps2: float,
    rate_hz: float = 100.0,
    seed: int = 0,
) -> ImuRecord:
    """Return what an IMU measures that starts at C (3, 3), body to east-north-up, and goes through `legs`.

    ConfigurationError if a leg is no whole number of samples, or for lever arms on turns of constant rate, whose
    angular acceleration is not finite.
    """
    latitude = math.radians(latitude_deg)
    earth = EARTH_RATE_RAD_S * np.array([0.0, math.cos(latitude), math.sin(latitude)])
    period = 1.0 / rate_hz
    c = np.asarray(attitude, dtype=np.float64)
    angles, velocities = [], []
    for number, leg in enumerate(legs):
        count = _samples(leg, number, rate_hz)
        if isinstance(leg, Rest):
            rate, force = _at_rest(c[None], earth, gravity_mps2)
            w, f = with_errors(rate, force, np.zeros((1, 3)), np.zeros((1, 3)), errors)
            angles.append(np.repeat(w * period, count, axis=0))
            velocities.append(np.repeat(f * period, count, axis=0))
            continue
        if leg.profile == "constant" and np.any(errors.lever_m):
            raise ConfigurationError(
                "lever arms need smooth turns",
                where=f"leg {number}",
                found="a turn of constant rate",
                expected="profile smooth: constant rate starts and stops with infinite angular acceleration",
            )
        w, f = _through_turn(leg, c, count, earth, gravity_mps2, errors)
        angles.append(w * period)
        velocities.append(f * period)
        c = c @ turned_about(leg.axis, np.array([leg.angle_rad]))[0]
    angle, velocity = np.concatenate(angles), np.concatenate(velocities)
    _add_noise(angle, velocity, noise, period, seed)
    return ImuRecord(period, angle, velocity)


def _samples(leg: Rest | Turn, number: int, rate_hz: float) -> int:
    count = round(leg.duration_s * rate_hz)
    if count < 1 or abs(count - leg.duration_s * rate_hz) > 1e-6:
        raise ConfigurationError(
            "a leg must last a whole number of samples",
            where=f"leg {number}",
            found=f"{leg.duration_s:g} s at {rate_hz:g} Hz",
        )
    return count


def _at_rest(c: Array, earth: Array, gravity_mps2: float) -> tuple[Array, Array]:
    return np.asarray(earth @ c), np.asarray(np.array([0.0, 0.0, gravity_mps2]) @ c)


def _through_turn(
    leg: Turn, start: Array, count: int, earth: Array, gravity_mps2: float, errors: ImuErrors
) -> tuple[Array, Array]:
    """Return the means over each sample of measured rate and specific force, (count, 3) each."""
    nodes, weights = _GAUSS
    s = (np.arange(count)[:, None] + (nodes + 1.0) / 2.0).ravel() / count
    total, duration = leg.angle_rad, leg.duration_s
    if leg.profile == "constant":
        angle, rate, speeding = total * s, np.full_like(s, total / duration), np.zeros_like(s)
    else:
        angle = total * (s - np.sin(2.0 * math.pi * s) / (2.0 * math.pi))
        rate = total / duration * (1.0 - np.cos(2.0 * math.pi * s))
        speeding = total / duration**2 * 2.0 * math.pi * np.sin(2.0 * math.pi * s)
    c = start @ turned_about(leg.axis, angle)
    rest, force = _at_rest(c, earth, gravity_mps2)
    spin = rate[:, None] * leg.axis
    w, f = with_errors(rest + spin, force, spin, speeding[:, None] * leg.axis, errors)
    share = weights / 2.0
    return (
        np.einsum("q,nqi->ni", share, w.reshape(count, 3, 3)),
        np.einsum("q,nqi->ni", share, f.reshape(count, 3, 3)),
    )


def _add_noise(angle: Array, velocity: Array, noise: ImuNoise, period_s: float, seed: int) -> None:
    rng = np.random.default_rng(seed)
    parts = (
        (angle, noise.arw_rad_per_sqrt_s, noise.wander_rad_s),
        (velocity, noise.vrw_mps_per_sqrt_s, noise.wander_mps2),
    )
    for values, white, wander in parts:
        if white:
            values += rng.standard_normal(values.shape) * white * math.sqrt(period_s)
        if wander:
            keep = math.exp(-period_s / noise.wander_time_s)
            drive = rng.standard_normal(values.shape) * math.sqrt(1.0 - keep**2)
            drive[0] /= math.sqrt(1.0 - keep**2)  # stationary from the start
            values += wander * period_s * follow(drive, keep)
    if noise.vibration_mps:
        velocity += np.diff(rng.standard_normal((len(velocity) + 1, 3)) * noise.vibration_mps, axis=0)
