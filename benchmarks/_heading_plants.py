"""Runs of emulated platforms for the heading campaign: calibrations, tests, twins that do not turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from bench.analysis.heading import PlatformLog, fit_reference
from bench.analysis.heading._temperature import ReferenceTemperature
from drivers.base.arrays import Array
from drivers.base.constants import ARCSEC_RAD
from simulators.plant.space_stable import PlatformParameters, PlatformSamples, SpaceStablePlatform

STEP_S = 300.0
WARM_H = 240.0
CALIBRATIONS = {
    "3+1": ((0.0, 48.0), (90.0, 48.0), (180.0, 48.0), (270.0, 48.0)),
    "5+1": ((0.0, 48.0), (60.0, 48.0), (120.0, 48.0), (180.0, 48.0), (240.0, 48.0), (300.0, 48.0)),
    "12+1": ((0.0, 36.0), *((30.0 * k + 15.0, 36.0) for k in range(12))),
    "96 h": ((0.0, 24.0), (90.0, 24.0), (180.0, 24.0), (270.0, 24.0)),
}


@dataclass(frozen=True, eq=False)
class PlatformRun:
    """A run after its alignment, as a log, with the reference temperature of the alignment and the truth."""

    log: PlatformLog
    reference: ReferenceTemperature
    truth: PlatformSamples


def sequence(test: int, seed: int) -> tuple[tuple[float, float], ...]:
    """Return (heading deg, hours) of test 0 .. 3: other headings than any calibration uses."""
    random = np.random.default_rng([seed, test, 77])
    if test == 0:
        return ((0.0, 110.0), (90.0 + random.uniform(10, 20), 48.0), (200.0 + random.uniform(0, 9), 34.0))
    stays = {1: (4, 30.0, 60.0), 2: (7, 12.0, 30.0), 3: (12, 2.0, 8.0)}[test]
    turned = [(random.uniform(0, 360), random.uniform(*stays[1:])) for _ in range(stays[0])]
    turned = [(heading if min(heading, 360 - heading) > 8 else 20.0, hours) for heading, hours in turned]
    last = [(random.uniform(20, 340), 48.0)] if test == 3 else []
    return ((0.0, 24.0), *turned, *last)


def fly(
    parameters: PlatformParameters,
    seed: int,
    stays: tuple[tuple[float, float], ...],
    *,
    step_s: float = STEP_S,
) -> PlatformRun:
    """Return a run: ten warm days at heading 0, alignment, then the stays."""
    warm = round(WARM_H * 3600.0 / step_s)
    platform = SpaceStablePlatform(parameters, seed, step_s)
    before = platform.advance(np.zeros(warm))
    platform.align()
    headings = np.concatenate([np.full(round(3600.0 * hours / step_s), heading) for heading, hours in stays])
    truth = platform.advance(headings)
    log = PlatformLog(
        truth.time_s,
        truth.angle_rad,
        truth.north_as,
        truth.east_as,
        truth.temp_c,
        truth.heading_deg,
        parameters.latitude_deg,
    )
    return PlatformRun(log, fit_reference(before.angle_rad, before.temp_c), truth)


def twin(
    parameters: PlatformParameters,
    seed: int,
    stays: tuple[tuple[float, float], ...],
    *,
    step_s: float = STEP_S,
) -> PlatformRun:
    """Return the same run, with the same noise, without a turn."""
    return fly(parameters, seed, tuple((0.0, hours) for _, hours in stays), step_s=step_s)


def position_error_finite(phi_as: Array, angle_rad: Array, latitude_deg: float) -> tuple[Array, Array]:
    """Return (north, east) errors in arcsec, shape (n,), with the misalignment `phi_as` (n, 3) as a finite turn.

    u_computed = R(phi) u; matters above 0.05 deg of |phi| (40 arcsec of error at 1 deg).
    """
    latitude = np.radians(latitude_deg)
    level, up = np.cos(latitude), np.sin(latitude)
    truth = np.stack(
        [level * np.cos(angle_rad), level * np.sin(angle_rad), np.full_like(angle_rad, up)], axis=-1
    )
    x, y, z = Rotation.from_rotvec(phi_as * ARCSEC_RAD).apply(truth).T
    longitude = (np.arctan2(y, x) - angle_rad + np.pi) % (2.0 * np.pi) - np.pi
    return (np.arctan2(z, np.hypot(x, y)) - latitude) / ARCSEC_RAD, level * longitude / ARCSEC_RAD
