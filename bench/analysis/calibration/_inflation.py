"""By how much a navigation filter has to take noise larger than white, so that the sigmas it states are true.

A navigation filter takes the biases of a calibration as constant and noise as white. Biases that wander add
errors that it does not state. Here the errors of an unaided level INS that stands still, altitude held, follow
from the linear model (Schuler's and the Earth's turn in it; Titterton and Weston, Strapdown Inertial Navigation
Technology, chapter 12): once driven by white noise, once by the wander about its mean over the record. The
factor is the ratio of the standard deviations together and of white noise alone; it is of each error and each
time, and a filter takes the largest.

A record shows wander over times up to its own length. What is slower than that it does not show, and no factor
from it covers it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from bench.analysis.calibration._conventions import Noise, Site
from bench.analysis.calibration._estimator import BiasWander
from drivers.base.arrays import Array
from drivers.base.constants import EARTH_AXIS_M

HOURS = (1.0, 3.0, 10.0)
ERRORS = ("heading", "velocity", "position")
_STEP_S = 10.0
_NAVIGATION = 7
"""Position and velocity east and north, attitude east, north, up; then biases of gyros and accelerometers."""
_PARTS = ((6,), (2, 3), (0, 1))
"""States of heading, velocity and position."""


@dataclass(frozen=True, eq=False)
class Inflation:
    """Standard deviations of an unaided INS by white noise alone and with the wander, (3, hours), rows `errors`.

    In rad, m/s and m; of velocity and position the root of both axes' variances. `record_h`: length of the
    record.
    """

    hours: ClassVar[tuple[float, ...]] = HOURS
    errors: ClassVar[tuple[str, ...]] = ERRORS
    white: Array
    whole: Array
    record_h: float

    @property
    def factors(self) -> Array:
        """The factor of each error at each time, (3, hours)."""
        return np.asarray(self.whole / self.white)

    @property
    def factor(self) -> float:
        """The factor that covers every error at every time."""
        return float(self.factors.max())


def inflation(
    noise: Noise, wanders: Sequence[tuple[BiasWander, float]], site: Site, record_s: float
) -> Inflation:
    """Return the factors of white noise and a wander of biases, as a record of `record_s` shows.

    `wanders`: those that it may be and their weights, over which variances are averaged; empty: there is none.
    Navigation begins so long after the record that the wander has forgotten it; its mean over the record is out.
    """
    white = _variances(site, noise, None, record_s)
    added = np.zeros_like(white)
    for time_s in sorted({wander.time_s for wander, _ in wanders}):
        # a variance goes with the squares of both sizes
        alike = [(wander, weight) for wander, weight in wanders if wander.time_s == time_s]
        gyro = math.sqrt(sum(weight * wander.gyro_rad_s**2 for wander, weight in alike))
        accelerometer = math.sqrt(sum(weight * wander.accelerometer_mps2**2 for wander, weight in alike))
        added += _variances(site, None, BiasWander(gyro, accelerometer, time_s), record_s)
    return Inflation(np.sqrt(white), np.sqrt(white + added), record_s / 3600.0)


def mean_variance(time_s: float, record_s: float) -> float:
    """Return the variance of the mean over `record_s` of a Markov process of variance 1 and `time_s`."""
    ratio = record_s / time_s
    return 2.0 / ratio**2 * (ratio + math.expm1(-ratio))


def _variances(site: Site, noise: Noise | None, wander: BiasWander | None, record_s: float) -> Array:
    """Return variances (3, hours) by white noise, or by a wander."""
    size = _NAVIGATION + 10
    f = np.zeros((size, size))
    f[:_NAVIGATION, :_NAVIGATION] = _error_rates(site)
    gyro, accelerometer = slice(7, 10), slice(10, 12)
    for start in (0, 5):  # biases that wander, and their mean over the record, with the other sign
        sign = 1.0 if start == 0 else -1.0
        f[4:7, gyro.start + start : gyro.stop + start] = -sign * np.eye(3)
        f[2:4, accelerometer.start + start : accelerometer.stop + start] = sign * np.eye(2)
    p, drive = np.zeros((size, size)), np.zeros(size)
    if noise is not None:
        drive[2:4], drive[4:7] = noise.vrw**2, noise.arw**2
    if wander is not None:
        sizes = np.array([wander.gyro_rad_s] * 3 + [wander.accelerometer_mps2] * 2) ** 2
        f[range(7, 12), range(7, 12)] = -1.0 / wander.time_s
        drive[7:12] = 2.0 * sizes / wander.time_s
        p[range(7, 12), range(7, 12)] = sizes
        p[range(12, 17), range(12, 17)] = sizes * mean_variance(wander.time_s, record_s)
    ahead = np.eye(size)
    term = np.eye(size)
    for order in range(1, 8):
        term = term @ f * (_STEP_S / order)
        ahead = ahead + term
    q = 0.5 * _STEP_S * (ahead @ np.diag(drive) @ ahead.T + np.diag(drive))
    found, done = [], 0
    for hours in HOURS:
        for _ in range(round(3600.0 * hours / _STEP_S) - done):
            p = ahead @ p @ ahead.T + q
        done = round(3600.0 * hours / _STEP_S)
        found.append([sum(float(p[at, at]) for at in part) for part in _PARTS])
    return np.array(found).T


def _error_rates(site: Site) -> Array:
    """Return F (7, 7) of position, velocity (east, north) and attitude of an INS at rest, altitude held."""
    _, north, up = site.earth_rate_rad_s
    g, r = site.gravity_mps2, EARTH_AXIS_M
    level = math.tan(math.radians(site.latitude_deg))
    f = np.zeros((_NAVIGATION, _NAVIGATION))
    f[0, 2] = f[1, 3] = 1.0
    f[2, 3], f[3, 2] = 2.0 * up, -2.0 * up
    f[2, 5], f[3, 4] = -g, g
    f[4, 5], f[4, 6], f[5, 4], f[6, 4] = up, -north, -up, north
    f[4, 3], f[5, 2], f[6, 2] = -1.0 / r, 1.0 / r, level / r
    f[5, 1], f[6, 1] = -up / r, north / r
    return f
